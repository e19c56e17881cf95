"""Posteriors of tubes made by hand: draws of parameters, and their curves."""

import numpy as np
import pandas as pd
import pytest
import xarray as xr

import pymc_hyperelastic as ph

# Relative tolerances of another formula for the same number, and of the inverse of a curve.
ROUNDING, INVERSE = 1e-12, 1e-10
# Central differences with a relative step of 1e-4.
DIFFERENCE = 1e-6

SHEEP = {"inner_radius": 7.0, "outer_radius": 9.0}
TUBES = {
    "sheep aorta": SHEEP | {"axial_stretch": 1.0, "opening_angle": 0.0},
    "stretched": SHEEP | {"axial_stretch": 1.4, "opening_angle": 0.0},
    "in vivo": {
        "inner_radius": 0.4,
        "outer_radius": 0.52,
        "axial_stretch": 1.5,
        "opening_angle": np.deg2rad(90.0),
    },
    "thick, opened the other way": {
        "inner_radius": 1.0,
        "outer_radius": 2.5,
        "axial_stretch": 0.9,
        "opening_angle": np.deg2rad(-40.0),
    },
}
LAWS = {
    "NeoHookean": (ph.NeoHookean(), {"mu": 20.0}),
    "MooneyRivlin": (ph.MooneyRivlin(), {"c10": 10.0, "c01": 2.0}),
    "Gent": (ph.Gent(), {"mu": 20.0, "limit": 40.0}),
    "Ogden": (ph.Ogden(), {"mu": 6.0, "alpha": 8.0}),
    "steep Ogden": (ph.Ogden(), {"mu": 6.0, "alpha": -25.0}),
    "OgdenSeries": (ph.OgdenSeries(2), {"mu": [12.0, -2.0], "alpha": [3.0, -6.0]}),
    "CriscioneType": (ph.CriscioneType(), {"a": 3.0, "b": 4.0}),
    "fibres": (ph.HolzapfelGasserOgden(), {"c": 10.0, "k1": 30.0, "k2": 2.0, "beta": 40.0}),
}

# The first tier has each law and each tube along a diagonal.
every_tube_and_law = pytest.mark.parametrize(
    ("tube", "energy", "parameters"),
    [
        pytest.param(
            tube, *law, id=f"{tube_name}, {name}", marks=() if i == j % 4 else pytest.mark.deep
        )
        for i, (tube_name, tube) in enumerate(TUBES.items())
        for j, (name, law) in enumerate(LAWS.items())
    ],
)


def result(**variables) -> xr.DataTree:
    """Return a result of one chain: variables by draw, vectors by (draw, entry)."""
    posterior = {
        name: (("chain", "draw", f"{name}_entry")[: np.ndim(values) + 1], [values])
        for name, values in variables.items()
    }
    return xr.DataTree.from_dict({"posterior": xr.Dataset(posterior)})


def one_draw(parameters: dict) -> xr.DataTree:
    return result(**{name: [value] for name, value in parameters.items()})


def closing(tube: dict) -> float:
    """Return the factor by which angles grow when the opened sector is closed."""
    return 2 * np.pi / (2 * np.pi - tube["opening_angle"])


def radii_of(tube: dict) -> np.ndarray:
    """Return radii from a collapsing to a far inflated tube."""
    stretch = tube["axial_stretch"] * closing(tube)
    return tube["inner_radius"] / np.sqrt(stretch) * np.array([0.8, 1.0, 1.01, 1.3, 1.6])


def curve(energy, parameters, radius, tube) -> np.ndarray:
    settings = {"tube": ph.Tube(**tube), "energy": energy}
    predicted = ph.predict_pressure(one_draw(parameters), radius, **settings)
    return predicted["pressure"].values[0, 0]


AT_RADII = (ph.predict_pressure, ph.predict_axial_force, ph.is_admissible)
AT_PRESSURES = (ph.radius_at_pressure, ph.tube_properties, ph.wall_stress)


def ask(function, tree, points, tube=None, **settings) -> xr.Dataset:
    """Return a prediction at these radii (mm) or pressures (kPa), for a tube that is a dict."""
    stated = ph.Tube(**tube or {})
    if function in AT_RADII:
        return function(tree, points, tube=stated, **settings)
    return function(tree, ph.Conditions(points, tube=stated), **settings)


def fitted_tree(energy: str = "NeoHookean", **variables) -> xr.DataTree:
    """Return a posterior with its inflation data and the name of its law."""
    data = ph.select(ph.load_dataset("simulated_sheep_aorta"), specimen="S1", experiment=1)
    tree = result(**variables)
    tree["observed_data"] = xr.DataTree(data[["pressure"]].reset_coords(drop=True))
    tree["constant_data"] = xr.DataTree(data.drop_vars("pressure"))
    tree.attrs["strain_energy"] = energy
    return tree


def fitted_to(data: xr.Dataset, energy: str, tree: xr.DataTree) -> xr.DataTree:
    """Return a posterior with these inflation data and the name of its law."""
    tree["constant_data"] = xr.DataTree(data)
    tree.attrs["strain_energy"] = energy
    return tree


def exact_points(energy, parameters: dict, tests: dict, tube: dict) -> pd.DataFrame:
    """Return the points of tests without errors; each test has pressures and axial stretches."""
    tables = []
    for experiment, given in tests.items():
        pressure, stretch = np.broadcast_arrays(*given)
        at = ph.Conditions(pressure, tube=ph.Tube(axial_stretch=stretch, **tube))
        curve = ph.tube_properties(one_draw(parameters), at, energy=energy)
        numbers = {name: curve[name].values[0, 0] for name in ("radius", "axial_force")}
        numbers |= {"pressure": pressure, "stretch": stretch}
        tables.append(pd.DataFrame({"specimen": "S1", "experiment": experiment} | numbers))
    return pd.concat(tables, ignore_index=True)


SOFTENING = {"mu": 20.0, "n": 0.3}


def maximum_of_softening() -> tuple[float, float]:
    """Return radius and pressure of the maximum of the softening curve."""
    low, high = 7.0, 30.0
    for _ in range(5):
        radius = np.linspace(low, high, 200)
        pressure = curve(ph.PowerLawNeoHookean(), SOFTENING, radius, SHEEP)
        i = int(pressure.argmax())
        low, high = radius[max(i - 1, 0)], radius[i + 1]
    return radius[i], float(pressure[i])
