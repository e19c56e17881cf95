"""Predictions of every kind of result: models, layers, classes, populations."""

import warnings

import fits
import numpy as np
import pandas as pd
import pymc as pm
import pytest
import xarray as xr
from problems import AS_WRITTEN
from variable_classes import SIGMA, TRAINING, classify, fit

import pymc_hyperelastic as ph

SEED = 733
# The same integral by the same rule, and through the inverse of a curve.
ROUNDING, INVERSE = 1e-12, 1e-10
NOISE = ph.Gaussian(SIGMA / np.sqrt(2))
LAYERS = [ph.Layer(ph.NeoHookean(), 1.2), ph.Layer(ph.Demiray(), pm.Uniform.dist(0.5, 1.0))]
LAYER_DRAWS = {"mu_1": (30.0, 3.0), "mu_2": (20.0, 2.0), "b_2": (2.0, 0.1)}
LAYER_DRAWS |= {"thickness_2": (0.8, 0.02)}
UNKNOWN_TUBE = {"inner_radius": pm.Uniform.dist(6, 8), "thickness": pm.Uniform.dist(1, 3)}


def as_sampled(model: pm.Model, **draws) -> xr.DataTree:
    """Return a result of `sample_smc` with normal draws in place of sampled ones."""
    rng = np.random.default_rng(SEED)
    posterior = {
        name: (("chain", "draw"), mean + sd * rng.standard_normal((2, 20)))
        for name, (mean, sd) in draws.items()
    }
    coords = {"chain": range(2), "draw": range(20)}
    groups = model.study.result_groups(model) | {"posterior": xr.Dataset(posterior, coords)}
    tree = xr.DataTree.from_dict(groups)
    tree.attrs = model.study.result_attrs(model)
    return tree


def measured(*unknown: str) -> xr.Dataset:
    """Return the data of the soft specimens, without these radii of their tubes."""
    data = TRAINING["soft"]
    return data.assign({name: np.nan * data[name] for name in unknown})


def sampled(energy=None, data=None, priors=None, **draws) -> xr.DataTree:
    data = measured() if data is None else data
    model = ph.inflation_model(energy or ph.NeoHookean(), data, NOISE, priors=priors)
    return as_sampled(model, **draws)


def population() -> xr.DataTree:
    model = ph.population_model(ph.NeoHookean(), TRAINING["soft"], NOISE)
    tree = as_sampled(model, mu=(40.0, 4.0))
    posterior = tree["posterior"].to_dataset()
    of_specimens = posterior["mu"] * xr.DataArray(
        [0.8, 1.0, 1.3], {"specimen": ["A1", "A2", "A3"]}, "specimen"
    )
    strain = (np.log(0.25) + 0 * posterior["mu"]).expand_dims(coordinate=["log_reference_strain"])
    tree["posterior"] = xr.DataTree(xr.Dataset({"mu": of_specimens, "location": strain}))
    return tree


def with_inferred_radius(tree: xr.DataTree) -> xr.DataTree:
    """Return the result with draws of the inner radius, which its data do not have."""
    posterior, data = (tree[name].to_dataset() for name in ("posterior", "constant_data"))
    radius = 7.0 + 0.05 * (posterior["mu_1"] - 30) / 3
    changed = {"posterior": xr.DataTree(posterior.assign(inner_radius=radius))}
    unknown = data.assign(inner_radius=np.nan * data["inner_radius"])
    return tree.copy().assign(changed | {"constant_data": xr.DataTree(unknown)})


@pytest.fixture(scope="module")
def results() -> dict[str, xr.DataTree]:
    """Return one result of each kind."""
    tube = {"inner_radius": (7.0, 0.05), "thickness": (2.0, 0.05)}
    no_tube = measured("inner_radius", "outer_radius")
    settings = {"draws": 100, "chains": 2, "training": {"soft": TRAINING["soft"]}}
    with pytest.warns(UserWarning, match="class 'soft': the fit is doubtful"):  # specimens differ
        pooled = fit(variability=None, **settings)
    layers = sampled(LAYERS, measured("outer_radius"), **LAYER_DRAWS)
    return {
        "inflation_model": sampled(mu=(40.0, 2.0)),
        "inferred geometry": sampled(None, no_tube, UNKNOWN_TUBE, mu=(40.0, 2.0), **tube),
        "layers": layers,
        "layers, inferred geometry": with_inferred_radius(layers),
        "pooled class": pooled["soft"],
        "variable class": fits.fit("neo_hookean_classes")["soft"],
        "population_model": population(),
    }


KINDS = ["inflation_model", "inferred geometry", "layers", "layers, inferred geometry"]
KINDS += ["pooled class", "variable class", "population_model"]
DIFFER = ("variable class", "population_model")
PREDICTIONS = {
    "predict_pressure": (ph.predict_pressure, [8.0, 8.5]),
    "predict_axial_force": (ph.predict_axial_force, [8.0, 8.5]),
    "radius_at_pressure": (ph.radius_at_pressure, [2.0, 3.0]),
    "tube_properties": (ph.tube_properties, [2.0, 3.0]),
    "in mmHg": (ph.tube_properties, ph.Conditions([15, 22], pressure_unit="mmHg")),
    # The least of the measured pressures: the softest draw of a class does not reach 2 kPa.
    "wall_stress": (ph.wall_stress, [1.1, 1.4]),
    "admissible": (ph.is_admissible, None),
}


# Each kind twice, with and without a specimen, and each prediction twice.
PAIRS = [
    (kind, question, specimen)
    for shift, specimen in ((0, None), (3, "A2"))
    for kind, question in zip(KINDS, np.roll(list(PREDICTIONS), shift).tolist(), strict=True)
]
SOME_KINDS = [
    ("inferred geometry", None),
    ("layers, inferred geometry", "A2"),
    ("variable class", None),
    ("population_model", "A2"),
]


@pytest.mark.parametrize(("kind", "question", "specimen"), PAIRS)
def test_prediction_is_finite_and_names_its_specimen(results, kind, question, specimen):
    function, at = PREDICTIONS[question]
    tree = results[kind]
    found = function(tree, at, specimen=specimen)
    for name in found:
        assert found[name].sizes["chain"] == 2
        assert found[name].sizes["draw"] == tree["posterior"].sizes["draw"]
        assert np.isfinite(found[name]).all()
    typical = "typical" if kind in DIFFER else None
    assert found.attrs.get("specimen") == (specimen or typical)
    assert not found["extrapolated"].any()


@pytest.mark.parametrize(("kind", "specimen"), SOME_KINDS)
def test_stored_energy_change_is_the_difference_between_two_pressures(results, kind, specimen):
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        at = ph.Conditions([2.0, 3.0], pressure_range=(2.0, 3.0))
        found = ph.tube_properties(results[kind], at, specimen=specimen)
    change = found["stored_energy"].diff("pressure").squeeze("pressure", drop=True)
    xr.testing.assert_allclose(found["stored_energy_change"], change.rename(None), rtol=INVERSE)
    stretch = found["in_vivo_axial_stretch"]
    assert stretch.attrs["draws_without"] == np.isnan(stretch).sum()
    # Without forces, either no draw has an in vivo stretch, or the law alone determines it.
    finite = bool(np.isfinite(stretch).any())
    warning = "rests on the strain energy" if finite else "have no in vivo axial stretch"
    assert any(warning in str(w.message) for w in caught)
    assert ("in_vivo_extrapolated" in found.coords) == finite
    assert not found.coords["range_extrapolated"]


@pytest.mark.parametrize(("kind", "specimen"), SOME_KINDS)
def test_fit_is_drawn_with_the_data_of_the_specimen(results, kind, specimen):
    chosen = None if specimen is None else [specimen]
    figure = ph.plot_fit(results[kind], specimens=chosen, backend="none")
    assert "extrapolated" not in figure.viz
    title = figure.get_viz("figure_title")["string"] if "figure_title" in figure.viz else ""
    assert "typical specimen" not in title
    panels = figure.viz["points"]["pressure"].squeeze(drop=True)
    tests = np.char.find(TRAINING["soft"]["specimen"].values.astype(str), specimen or "") == 0
    points = [np.isfinite(panel["x"]).sum() for panel in panels.values.ravel()]
    assert sum(points) == 7 * tests.sum()


# --- the numbers ---------------------------------------------------------------------------------


def test_curves_of_layers_use_the_parameters_of_each_draw(results):
    """Curves of each draw are those of the layers with its numbers, in the tube of its data."""
    tree, radius = results["layers"], [8.0, 8.5]
    functions = {
        "pressure": (ph.predict_pressure, ph.inflation_pressure),
        "stiffness": (ph.predict_pressure, ph.inflation_stiffness),
        "axial_force": (ph.predict_axial_force, ph.axial_force),
    }
    at = {k: float(v[1, 7]) for k, v in tree["posterior"].data_vars.items()}
    media = ph.Layer(ph.NeoHookean(), 1.2, mu=at["mu_1"])
    outside = ph.Layer(ph.Demiray(), at["thickness_2"], mu=at["mu_2"], b=at["b_2"])
    for name, (predict, function) in functions.items():
        found = predict(tree, radius)[name]
        xr.testing.assert_identical(found, predict(tree, radius, energy=LAYERS)[name])
        expected = function([media, outside], radius, ph.Tube(7.0)).eval(mode=AS_WRITTEN)
        np.testing.assert_allclose(found[1, 7], expected, rtol=ROUNDING)


def test_layers_of_one_material_equal_a_single_wall(results):
    """A wall divided into layers of its own material has unchanged properties and stresses."""
    mu, tree = pm.Uniform.dist(0, 100), results["inflation_model"]
    layers = [ph.Layer(ph.NeoHookean(), t, mu=mu) for t in (0.5, 1.2, 0.3)]
    for function, at in PREDICTIONS.values():
        xr.testing.assert_allclose(
            function(tree, at, energy=layers), function(tree, at), rtol=INVERSE
        )
    points = np.array([0.0, 0.1, 0.25, 0.5, 0.85, 0.9, 1.0])
    found, expected = (
        ph.wall_stress(tree, [2.0, 4.0], points=points, energy=wall) for wall in (layers, None)
    )
    for name in found:
        np.testing.assert_allclose(found[name], expected[name], rtol=INVERSE, atol=1e-12)


def test_stresses_of_layers_balance_the_pressure(results):
    """``∫ σθθ dr = p a`` through layers of different laws, and the radial stress is continuous."""
    tree, points = results["layers"].isel(chain=[0], draw=[3]), np.linspace(0, 1, 4001)
    stress = ph.wall_stress(tree, [4.0], points=points).squeeze(["chain", "draw", "pressure"])
    a = ph.radius_at_pressure(tree, [4.0])["radius"].item()
    hoop = np.trapezoid(stress["sigma_tt"], stress["current_radius"])
    np.testing.assert_allclose(hoop, 4.0 * a, rtol=1e-4)  # of one jump between nodes
    np.testing.assert_allclose(stress["sigma_rr"][[0, -1]], [-4.0, 0.0], atol=1e-9)
    assert np.abs(np.diff(stress["sigma_rr"])).max() < 0.01
    jump = np.abs(np.diff(stress["sigma_tt"]))
    assert jump.max() > 100 * np.median(jump)


def test_typical_specimen_has_the_modulus_of_the_location(results):
    """A neo-Hookean solid has ``T = μ (λ² − λ⁻²)`` of 20 kPa at the reference strain."""
    unit = ph.predict_pressure(sampled(mu=(1.0, 0.0)), [8.0])["pressure"].values[0, 0, 0]
    for kind in DIFFER:
        location = results[kind]["posterior"]["location"].squeeze("coordinate")
        strain = np.exp(location.transpose("chain", "draw").values)
        found = ph.predict_pressure(results[kind], [8.0])["pressure"].values[..., 0]
        np.testing.assert_allclose(found, 20 / (2 * np.sinh(2 * strain)) * unit, rtol=INVERSE)


def test_specimen_of_a_class_is_predicted_with_its_own_modulus(results):
    """The curves of a specimen determine its modulus more than its class does."""
    unit = ph.predict_pressure(sampled(mu=(1.0, 0.0)), [8.0])["pressure"].values[0, 0, 0]
    for specimen, mu in {"A1": 30.0, "A2": 38.0, "A3": 50.0}.items():
        found = ph.predict_pressure(results["variable class"], [8.0], specimen=specimen)
        moduli = found["pressure"].values / unit
        assert moduli.std() < 2.0
        assert abs(moduli.mean() - mu) < 4 * moduli.std()
        again = ph.predict_pressure(results["variable class"], [8.0], specimen=specimen)
        xr.testing.assert_identical(found, again)
        of_population = ph.predict_pressure(results["population_model"], [8.0], specimen=specimen)
        expected = results["population_model"]["posterior"]["mu"].sel(specimen=specimen) * unit
        np.testing.assert_allclose(of_population["pressure"][..., 0], expected)


def test_specimen_argument_selects_the_tube_of_the_specimen():
    """If tubes differ, the name of a specimen determines the tube; the material is shared."""
    frame = pd.DataFrame({"specimen": ["S1"] * 3 + ["S2"] * 3, "experiment": 1})
    frame["radius"], frame["pressure"] = [7.2, 7.6, 8.0, 7.2, 7.6, 9.0], [2.0, 4.0, 7.0] * 2
    frame["B"] = [9.0] * 3 + [9.5] * 3
    data = ph.inflation_data(frame, ph.Tube(inner_radius=7.0, outer_radius="B"))
    tree = as_sampled(ph.inflation_model(ph.NeoHookean(), data, NOISE), mu=(40.0, 1.0))
    with pytest.raises(ValueError, match=r"outer_radius=.*specimen="):
        ph.predict_pressure(tree, [7.5])
    found = ph.predict_pressure(tree, [7.5, 8.5], specimen="S1")
    expected = ph.predict_pressure(tree, [7.5, 8.5], tube=ph.Tube(outer_radius=9.0))
    np.testing.assert_array_equal(found["pressure"], expected["pressure"])
    assert not found["extrapolated"].any()  # the other specimen was inflated further


def test_extrapolation_of_a_specimen_uses_its_own_measured_range(results):
    """The measured ranges of other specimens are ignored."""
    tree = results["variable class"].copy(deep=True)
    data = tree["constant_data"].to_dataset()
    keep = ~((data["test"].values == 0) & (data["radius"].values > 8.0))
    for group in ("constant_data", "observed_data"):
        tree[group] = xr.DataTree(tree[group].to_dataset().isel(obs=keep))
    with pytest.warns(UserWarning, match="8.5 mm, measured 7.3 to"):
        assert ph.predict_pressure(tree, [8.5], specimen="A1")["extrapolated"].all()
    assert not ph.predict_pressure(tree, [8.5], specimen="A2")["extrapolated"].any()
    assert not ph.predict_pressure(tree, [8.5])["extrapolated"].any()


# --- unsupported ----------------------------------------------------------------------------------


def predict(tree, **settings):
    return ph.predict_pressure(tree, 8.0, **settings)


def fit_layers():
    return fit(LAYERS, {"C": measured("outer_radius")}, variability=None)


def with_experiment_effect(tree):
    tree, posterior = tree.copy(), tree["posterior"].to_dataset()
    tree["posterior"] = xr.DataTree(posterior.assign(experiment_spread=posterior["spread"]))
    return tree


def with_attrs(tree, **attrs):
    tree = tree.copy()
    tree.attrs = attrs
    return tree


def without_data(tree):
    return with_attrs(tree.filter(lambda node: node.name == "posterior"), strain_energy="Demiray")


# The kind of result, a call, and the message.
UNSUPPORTED = [
    ("layers", lambda tree: fit_layers(), "do not make a class.*ph.inflation_model"),
    ("layers", lambda tree: classify(TRAINING["soft"], tree), "ph.fit_classes"),
    ("layers", lambda tree: predict(tree, tube=ph.Tube(outer_radius=9.0)), "outer_radius.*layers"),
    ("layers", lambda tree: predict(with_attrs(tree)), r"energy=\[ph.Layer\(...\), ...\]"),
    ("variable class", lambda tree: predict(tree, specimen="A9"), "no specimen 'A9'.*'A1', 'A2'"),
    ("variable class", lambda tree: predict(tree, energy=ph.Ogden()), "log_alpha.*leave energy"),
    ("variable class", lambda tree: predict(tree, energy=LAYERS), "one strain .*leave energy out"),
    (
        "variable class",
        lambda tree: predict(with_experiment_effect(tree), specimen="A1"),
        "experiment_effect.*typical specimen.*ph.population_model",
    ),
    (
        "population_model",
        lambda tree: predict(with_attrs(tree, strain_energy="NeoHookean")),
        "reference_stress.*specimen='",
    ),
    ("inflation_model", lambda tree: predict(without_data(tree), specimen="A1"), "holds no data"),
    (
        "pooled class",
        lambda tree: ph.plot_parameter_density(tree, specimen="A1"),
        "all spec.*share",
    ),
]


@pytest.mark.parametrize(("kind", "call", "message"), UNSUPPORTED)
def test_unsupported_prediction_is_refused(results, kind, call, message):
    with pytest.raises((TypeError, ValueError), match=message), warnings.catch_warnings():
        warnings.simplefilter("error")
        call(results[kind])
