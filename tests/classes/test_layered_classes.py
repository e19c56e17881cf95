"""Classes of specimens whose walls are layers."""

from functools import cache

import numpy as np
import pandas as pd
import pymc as pm
import pytensor.tensor as pt
import pytest
import xarray as xr

import pymc_hyperelastic as ph
from pymc_hyperelastic.classes.kinds import kind_of_classes
from pymc_hyperelastic.models.study import wall_attrs

INNER, THICKNESS, SHEET = 7.0, 2.0, 30.0  # mm, mm, kPa
NOISE = {"noise_sd": 0.2}
RADIUS = np.linspace(7.2, 9.2, 6)
SEED = 20261124  # any would do
SETTINGS = {"variability": "specimen", "random_seed": SEED, "progressbar": False}
FEW = {"draws": 200, "chains": 1}


def two_layers(thickness=None, **parameters):
    """A sheet of known stiffness and of a thickness that may be unknown, in an Ogden solid."""
    unknown = pm.LogNormal.dist(np.log(0.6), 0.2)
    sheet = ph.Layer(ph.NeoHookean(), unknown if thickness is None else thickness, mu=SHEET)
    return [sheet, ph.Layer(ph.Ogden(), 1.4, **parameters)]


def specimens(scale, first=1, count=2, seed=1) -> xr.Dataset:
    """Pressures of such walls, with errors of 0.2 kPa."""
    rng, tables = np.random.default_rng(seed), []
    for number in range(first, first + count):
        mu, alpha = np.exp(np.log([30 * scale, 6.0]) + rng.normal(0, [0.2, 0.1]))
        wall = two_layers(0.6 * np.exp(rng.normal(0, 0.1)), mu=mu, alpha=alpha)
        pressure = ph.inflation_pressure(wall, RADIUS, inner_radius=INNER).eval()
        table = {"radius": RADIUS, "pressure": pressure + rng.normal(0, 0.2, RADIUS.size)}
        tables.append(pd.DataFrame(table).assign(specimen=f"S{number}", experiment=1))
    return ph.inflation_data(pd.concat(tables), inner_radius=INNER, outer_radius=None)


def both_classes() -> dict[str, xr.Dataset]:
    return {"soft": specimens(1.0), "stiff": specimens(2.5, first=11, seed=2)}


@cache
def fitted() -> xr.DataTree:
    return ph.fit_classes(two_layers(), {"soft": specimens(1.0)}, **NOISE, **SETTINGS, **FEW)


@pytest.mark.deep
def test_one_layer_is_a_wall_of_its_law():
    """A layer that is all of the wall has the evidence, and the predictive, of its law."""
    data = specimens(1.0)
    wall = data.assign(outer_radius=("test", np.full(data.sizes["test"], INNER + THICKNESS)))
    new = specimens(1.0, first=21, count=1, seed=3)
    new_wall = new.assign(outer_radius=("test", [INNER + THICKNESS]))
    layers = [ph.Layer(ph.Ogden(), THICKNESS)]
    classes = {
        "law": ph.fit_classes(ph.Ogden(), {"C": wall}, **NOISE, **SETTINGS, **FEW),
        "layer": ph.fit_classes(layers, {"C": data}, **NOISE, **SETTINGS, **FEW),
    }
    evidences = [ph.log_evidence(tree["C"]) for tree in classes.values()]
    error = np.hypot(*(e.standard_error for e in evidences))
    assert abs(evidences[0].value - evidences[1].value) < 4 * error
    found = [
        ph.classify(part, tree, random_seed=SEED)["log_evidence"].item()
        for part, tree in zip((new_wall, new), classes.values(), strict=True)
    ]
    assert found[0] == pytest.approx(found[1], abs=0.1)


@pytest.mark.deep
def test_specimens_fall_into_the_class_of_their_layers(tmp_path):
    """A soft wall and a stiff one, each with a sheet whose thickness nobody knows."""
    tree = ph.fit_classes(two_layers(), both_classes(), **NOISE, **SETTINGS, **FEW)
    tree = of_a_file(tree, tmp_path / "classes.nc")
    names = tree["soft"]["posterior"]["coordinate"].values.tolist()
    assert names == ["log_reference_strain_2", "log_alpha_2", "log_thickness_1"]
    for name, scale in {"soft": 1.0, "stiff": 2.5}.items():
        new = specimens(scale, first=31, count=1, seed=4)
        assert ph.classify(new, tree, random_seed=SEED)["decision"].item() == name


def of_a_file(tree, path) -> xr.DataTree:
    tree.copy().to_netcdf(path, engine="h5netcdf")
    return xr.open_datatree(path, engine="h5netcdf").load()


def test_layers_are_stored_with_the_class(tmp_path):
    """Of a file, the settings and predictions of a class are those of the fit."""
    tree = fitted()
    again = of_a_file(tree, tmp_path / "classes.nc")
    assert kind_of_classes(again).attrs() == kind_of_classes(tree).attrs()
    for specimen in (None, "S2"):
        of_file, of_fit = (
            ph.predict_pressure(t["soft"], RADIUS, specimen=specimen) for t in (again, tree)
        )
        xr.testing.assert_identical(of_file, of_fit)


def test_typical_specimen_has_the_layers_of_its_location():
    """Its pressures are those of the layers with the numbers that its coordinates stand for."""
    tree = fitted()["soft"]
    pressure = ph.predict_pressure(tree, RADIUS)["pressure"].isel(chain=0, draw=7)
    location = tree["posterior"]["location"].isel(chain=0, draw=7)
    strain, alpha, thickness = np.exp(location.values)
    # At this hoop strain the stress σθθ − σrr is 20 kPa.
    unit = {"mu": pt.constant(1.0), "alpha": pt.constant(alpha)}
    rise = ph.Ogden().stress_difference(pt.constant(strain), pt.constant(0.0), **unit)
    layers = two_layers(thickness, mu=20.0 / rise.eval(), alpha=alpha)
    expected = ph.inflation_pressure(layers, RADIUS, inner_radius=INNER).eval()
    np.testing.assert_allclose(pressure, expected, rtol=1e-9)
    measured = ph.predict_pressure(tree, RADIUS, specimen="S1")["pressure"].mean(("chain", "draw"))
    assert abs(measured - ph.select(specimens(1.0), specimen="S1")["pressure"].values).max() < 1.0


def test_other_layers_do_not_compare():
    """Classes, and predictions, of other layers than these are refused."""
    tree = fitted()
    thinner = [ph.Layer(ph.NeoHookean(), 0.3, mu=SHEET), ph.Layer(ph.Ogden(), 1.4)]
    other = tree["soft"].copy()
    other.attrs |= wall_attrs(thinner)
    del other.attrs["checksum"]
    both = xr.DataTree(children={"soft": tree["soft"], "other": other})
    with pytest.raises(ValueError, match="layers"):
        ph.classify(specimens(1.0, first=31, count=1, seed=4), both)
    with pytest.raises(TypeError, match="leave energy out"):
        ph.predict_pressure(tree["soft"], RADIUS, energy=thinner)


@pytest.mark.deep
def test_report_takes_layers():
    """Layers alone are one wall, of which specimens are left out."""
    settings = {"random_seed": SEED, "progressbar": False, "draws": 200}
    report = ph.calibration_report(two_layers(), both_classes(), **NOISE, **settings)
    assert report["strain_energy"].values.tolist() == ["NeoHookean in Ogden"]
    assert (report["log_score"] > np.log(0.5)).all()
