"""A model is an ordinary, labelled PyMC model whose cost does not grow with the data."""

import numpy as np
import pandas as pd
import pymc as pm
import pytest
import xarray as xr
from pytensor.compile.sharedvalue import SharedVariable
from pytensor.graph.traversal import ancestors

import pymc_hyperelastic as ph
from pymc_hyperelastic.collocation import CollocatedPressureIntegral

# The same rule in the same precision, compiled in another graph: the last digits may differ.
ROUNDING = 1e-12
# Sums of squares over all points, one by collocation and one by direct quadrature.
SAME_LIKELIHOOD = 1e-9

NOISE = {"sigma": 5 * ph.mmHg, "slope_weight": 1.0}
OGDEN_POINT = {"mu": 6.0, "alpha": 8.0}


@pytest.fixture(scope="module")
def data() -> xr.Dataset:
    return ph.select(ph.load_dataset("simulated_sheep_aorta"), specimen=["S1", "S4"], experiment=1)


@pytest.fixture(scope="module")
def model(data) -> pm.Model:
    return ph.ogden_model(data, **NOISE)


def at(model: pm.Model, variables: list, values: dict) -> list:
    """Value of the variables at the given values of the free random variables."""
    inputs = [model[name] for name in values]
    function = pm.compile(inputs, variables, mode="FAST_COMPILE", on_unused_input="ignore")
    return function(*values.values())


def ops_of(variable) -> set:
    return {type(v.owner.op) for v in ancestors([variable]) if v.owner is not None}


def test_names_dims_and_coords(model, data):
    """Everything in a model has a name, and what belongs to points or tests is labelled so."""
    assert [rv.name for rv in model.free_RVs] == ["mu", "alpha"]
    assert [v.name for v in model.deterministics] == ["pressure", "stiffness"]
    assert [v.name for v in model.potentials] == ["likelihood"]
    assert model.named_vars_to_dims == {"pressure": ("obs",), "stiffness": ("obs",)}
    assert list(model.coords) == ["obs", "test"]
    assert len(model.coords["obs"]) == data.sizes["obs"]
    assert list(model.coords["test"]) == [
        "specimen 'S1', experiment 1",
        "specimen 'S4', experiment 1",
    ]


@pytest.mark.parametrize("draw", ["model_to_graphviz", "model_to_mermaid"])
def test_graph_is_readable(model, draw):
    """The drawn model shows each quantity by its name once, the points as a plate, and no more."""
    if draw == "model_to_graphviz":
        pytest.importorskip("graphviz")
    text = str(getattr(pm, draw)(model))
    for name in ("mu", "alpha", "pressure", "stiffness", "likelihood", "Uniform", "obs"):
        assert name in text
    assert len(text.splitlines()) < 50


def test_deterministics_are_the_pressure_of_the_tube(model, data):
    """The labelled pressures and stiffnesses are those of `inflation_pressure`."""
    points = data["test"].values
    tube = {
        name: data[name].values[points]
        for name in ("inner_radius", "outer_radius", "axial_stretch", "opening_angle")
    }
    found = at(model, [model["pressure"], model["stiffness"]], OGDEN_POINT)
    for values, function in zip(
        found, (ph.inflation_pressure, ph.inflation_stiffness), strict=True
    ):
        expected = function(ph.Ogden(), data["radius"].values, **tube, **OGDEN_POINT)
        np.testing.assert_allclose(values, expected.eval(mode="FAST_COMPILE"), rtol=ROUNDING)


@pytest.mark.parametrize("name", ["sigma", "slope_weight"])
def test_noise_is_inferred_when_it_has_a_prior(data, name):
    """A prior in place of a number is a random variable; at that number the likelihood is equal."""
    inferred = ph.ogden_model(data, **{**NOISE, name: pm.HalfNormal.dist(2)})
    assert [rv.name for rv in inferred.free_RVs] == ["mu", "alpha", name]
    known = ph.ogden_model(data, **NOISE)
    (found,) = at(inferred, [inferred["likelihood"]], {**OGDEN_POINT, name: NOISE[name]})
    (expected,) = at(known, [known["likelihood"]], OGDEN_POINT)
    np.testing.assert_allclose(found, expected, rtol=ROUNDING)


@pytest.mark.parametrize(
    ("factory", "energy"),
    [
        (ph.power_law_neo_hookean_model, ph.PowerLawNeoHookean()),
        (ph.ogden_model, ph.Ogden()),
        (ph.criscione_model, ph.CriscioneType()),
    ],
    ids=lambda x: getattr(x, "name", ""),
)
def test_factory_is_the_general_model(data, factory, energy):
    """Each factory is `inflation_model` of its material, and passes every setting on."""
    last = energy.parameter_names[-1]
    settings = {**NOISE, "priors": {last: pm.Uniform.dist(1, 9)}, "mode": "quadrature"}
    special, general = factory(data, **settings), ph.inflation_model(energy, data, **settings)
    assert special.study.energy == general.study.energy == energy
    assert special.study.attrs() == general.study.attrs()
    assert special.study.attrs()["priors"].endswith(f'"{last}": ["Uniform", [1.0, 9.0]]}}')
    assert CollocatedPressureIntegral not in ops_of(special["likelihood"])


@pytest.mark.parametrize(
    ("mode", "op"),
    [
        ("auto", CollocatedPressureIntegral),
        ("collocation", CollocatedPressureIntegral),
        ("quadrature", ph.PressureIntegral),
    ],
)
def test_likelihood_is_made_of_one_named_op(model, data, mode, op):
    """In each mode the integral is one Op in the graph of the density, for people to find."""
    chosen = ph.ogden_model(data, **NOISE, mode=mode)
    both = {CollocatedPressureIntegral, ph.PressureIntegral}
    assert both & ops_of(chosen.logp()) == {op}
    (found,) = at(chosen, [chosen["likelihood"]], OGDEN_POINT)
    (expected,) = at(model, [model["likelihood"]], OGDEN_POINT)
    np.testing.assert_allclose(found, expected, rtol=SAME_LIKELIHOOD)


def test_cost_does_not_grow_with_the_data():
    """The density of 6000 points has the arrays of that of 60: same number, same shapes."""

    def shapes(points: int) -> list[tuple[int, ...]]:
        frame = pd.DataFrame({"specimen": "S1", "experiment": np.repeat([1, 2, 3], points // 3)})
        frame["radius"] = np.tile(np.linspace(7.2, 9.5, points // 3), 3)
        frame["pressure"] = frame["radius"] - 7
        many = ph.inflation_data(frame, inner_radius=7.0, outer_radius=9.0)
        density = ph.ogden_model(many, **NOISE).logp()
        arrays = [v for v in ancestors([density]) if isinstance(v, SharedVariable)]
        return sorted(v.get_value().shape for v in arrays if hasattr(v.type, "shape"))

    assert shapes(60) == shapes(6000)


def test_likelihood_takes_numbers_and_any_random_variable(data):
    """A parameter may be known, or depend on others: the likelihood is that of its value."""
    with pm.Model() as own:
        log_mu = pm.Normal("log_mu", 0, 1)
        parameters = {"mu": pm.math.exp(log_mu), "alpha": 8}
        ph.inflation_likelihood("curves", ph.Ogden(), data, parameters, **NOISE)
    reference = ph.ogden_model(data, **NOISE, mode="quadrature")
    (found,) = at(own, [own["curves"]], {"log_mu": np.log(6.0)})
    (expected,) = at(reference, [reference["likelihood"]], OGDEN_POINT)
    np.testing.assert_allclose(found, expected, rtol=SAME_LIKELIHOOD)
