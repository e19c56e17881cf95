"""A model is an ordinary, labelled PyMC model whose cost does not grow with the data."""

import numpy as np
import oracles
import pandas as pd
import pymc as pm
import pytensor
import pytest
import xarray as xr
from problems import AS_WRITTEN, LAWS
from pytensor.compile.sharedvalue import SharedVariable
from pytensor.graph.traversal import ancestors
from tables import SECTOR

import pymc_hyperelastic as ph
from pymc_hyperelastic.mechanics.collocation import CollocatedPressureIntegral

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
    function = pm.compile(inputs, variables, mode=AS_WRITTEN, on_unused_input="ignore")
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
        np.testing.assert_allclose(values, expected.eval(mode=AS_WRITTEN), rtol=ROUNDING)


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


# --- a geometry that is not known ----------------------------------------------------------------

TRUE_TUBE = {"inner_radius": 1.0, "outer_radius": 1.4, "axial_stretch": 1.2, "opening_angle": 0.7}
MEASURED = ("outer_diameter", "radius")
# What is inferred, with values near the tube's own.
UNKNOWN = {
    "inner and outer radius": {"inner_radius": 0.97, "outer_radius": 1.42},
    "outer radius": {"outer_radius": 1.43},
    "thickness": {"inner_radius": 1.02, "thickness": 0.37},
    "wall area": {"inner_radius": 1.02, "wall_area": 2.7},
    "wall area and angle": {"inner_radius": 1.02, "wall_area": 2.7, "opening_angle": 0.8},
    "stretch and angle": {"axial_stretch": 1.15, "opening_angle": 0.75},
}
# Central differences with this step, relative to the largest derivative by a logarithm.
STEP, DIFFERENCE_TOLERANCE = 1e-5, 1e-6
# Sums of squares by two rules of different order.
SAME_CURVES = 1e-9


def unbounded(values) -> dict:
    """Priors without bounds, whose variables are the values themselves."""
    return {name: pm.Normal.dist(1.0, 50.0) for name in values}


def tube_data(measured="radius", **geometry) -> xr.Dataset:
    """One curve of a stretched, opened tube, with axial forces."""
    known = TRUE_TUBE | geometry
    radius = np.array([1.05, 1.1, 1.2, 1.3])
    k = 2 * np.pi / (2 * np.pi - TRUE_TUBE["opening_angle"])
    wall = (1.4**2 - 1.0**2) / (k * TRUE_TUBE["axial_stretch"])
    frame = pd.DataFrame({"specimen": "S", "experiment": 3, "radius": radius})
    frame["outer_diameter"] = 2 * np.sqrt(radius**2 + wall)
    frame["pressure"] = [2.0, 3.0, 6.0, 11.0]
    frame["axial_force"] = [12.0, 13.0, np.nan, 19.0]
    return ph.inflation_data(frame, **known, **SECTOR, measured=measured)


def likelihood_of(model: pm.Model, gradient: bool = False):
    """Likelihood, perhaps with its gradient, as a function of the value variables."""
    (value,) = model.replace_rvs_by_values([model["likelihood"]])
    outputs = [value, *(pytensor.grad(value, model.value_vars) if gradient else ())]
    return pytensor.function(model.value_vars, outputs, mode=AS_WRITTEN)


def tube_of(values: dict) -> dict:
    """Geometry of a tube in the terms of the data, written once more."""
    tube = TRUE_TUBE | {k: v for k, v in values.items() if k in TRUE_TUBE}
    if "thickness" in values:
        tube["outer_radius"] = tube["inner_radius"] + values["thickness"]
    if "wall_area" in values:
        cut = 2 * np.pi - tube["opening_angle"]
        # A sector of this angle, which the area of the ring that was cut fills.
        tube["outer_radius"] = np.sqrt(tube["inner_radius"] ** 2 + 2 * values["wall_area"] / cut)
    return tube


@pytest.mark.parametrize(
    ("name", "measured"), [(name, MEASURED[i % 2]) for i, name in enumerate(UNKNOWN)]
)
def test_inferred_geometry_is_that_geometry(name, measured):
    """Density, likelihood and gradient are those of the tube with the geometry that was drawn."""
    values, settings = UNKNOWN[name], {**NOISE, "force_sigma": 3.0}
    missing = {k: None for k in values if k in TRUE_TUBE}
    data = tube_data(measured, **missing)
    priors = unbounded(OGDEN_POINT)
    model = ph.ogden_model(data, **settings, priors=priors, geometry=unbounded(values))
    assert [rv.name for rv in model.free_RVs] == [*OGDEN_POINT, *values]
    names = [v.name for v in model.deterministics]
    inferred_radius = ["radius"] if measured == "outer_diameter" else []
    assert names == ["pressure", "stiffness", "axial_force", *inferred_radius]

    function = likelihood_of(model, gradient=True)
    point = np.array([*OGDEN_POINT.values(), *values.values()])
    value, *gradient = function(*point)
    # The tube's own stretch and angle are in the measured data; the geometry replaces the rest.
    moved = tube_data(measured, **tube_of(values))
    known = ph.ogden_model(moved, **settings, priors=priors, mode="quadrature")
    (expected,) = likelihood_of(known)(*OGDEN_POINT.values())
    np.testing.assert_allclose(value, expected, rtol=SAME_CURVES)

    log_density = model.compile_logp(mode=AS_WRITTEN)(
        dict(zip([v.name for v in model.value_vars], point, strict=True))
    )
    log_prior = -0.5 * ((point - 1) / 50) ** 2 - np.log(50 * np.sqrt(2 * np.pi))
    np.testing.assert_allclose(log_density, value + log_prior.sum(), rtol=ROUNDING)

    differences = [
        (function(*point + step)[0] - function(*point - step)[0]) / (2 * STEP)
        for step in np.diag(STEP * point)
    ]
    np.testing.assert_allclose(
        gradient * point,
        differences,
        rtol=0,
        atol=DIFFERENCE_TOLERANCE * np.abs(differences).max(),
    )


IMPOSSIBLE = {
    "inner and outer radius": [(1.0, 0.9), (1.0, 1.0), (-1.0, 1.4), (-2.0, -1.0), (0.0, 1.4)],
    "outer radius": [(0.9,), (-1.5,), (0.0,)],
    "thickness": [(1.0, -0.1), (1.0, -5.0), (-3.0, 1.0), (-3.0, 5.0)],
    "wall area": [(1.0, -1.0), (1.0, -1e3), (1.0, 0.0)],
    "wall area and angle": [(1.0, -1e3, 0.5), (1.0, 2.5, 7.0), (1.0, 2.5, -7.0)],
    "stretch and angle": [(-1.0, 0.5), (1.2, 6.5), (1.2, -6.5)],
}
NO_ROOM = {"thickness": [(1.0, 3.0), (1e4, 1e4)], "outer radius": [(50.0,)]}


@pytest.mark.parametrize(
    ("name", "measured"), [(name, MEASURED[i % 2 - 1]) for i, name in enumerate(UNKNOWN)]
)
def test_impossible_tubes_are_turned_down(name, measured):
    """Their likelihood is minus infinity with a gradient that is finite, and others are finite.

    So are those of a law whose stress overflows.
    """
    energy = ph.Demiray()
    model = ph.inflation_model(
        energy,
        tube_data(measured),
        **NOISE,
        force_sigma=3.0,
        priors=unbounded(energy.parameter_names),
        geometry=unbounded(UNKNOWN[name]),
    )
    function = likelihood_of(model, gradient=True)
    assert np.isfinite(function(20.0, 1.0, *UNKNOWN[name].values())).all()
    no_room = NO_ROOM.get(name, []) if measured == "outer_diameter" else []
    tubes = IMPOSSIBLE[name] + no_room
    steep = [(20.0, b, *UNKNOWN[name].values()) for b in (1e3, 1e5)]
    with np.errstate(all="ignore"):
        for point in [*((20.0, 1.0, *tube) for tube in tubes), *steep]:
            value, *gradient = function(*point)
            assert value == -np.inf, point
            assert np.all(np.isfinite(gradient)), point


def test_evidence_of_an_unknown_radius():
    """Sampled evidence, cubature, and a plain sum over a grid of both parameters agree."""
    data = tube_data(inner_radius=None, axial_stretch=1.0, opening_angle=0.0)
    ranges = {"mu": (5.0, 60.0), "inner_radius": (0.8, 1.1)}
    mu, radius = (pm.Uniform.dist(*ends) for ends in ranges.values())
    model = ph.inflation_model(
        ph.NeoHookean(),
        data,
        sigma=3.0,
        slope_weight=0,
        priors={"mu": mu},
        geometry={"inner_radius": radius},
    )
    node, weight = np.polynomial.legendre.leggauss(60)
    grids = [(low + high) / 2 + (high - low) / 2 * node for low, high in ranges.values()]
    log_likelihood = np.empty((node.size, node.size))
    unit = np.array(
        [
            [
                oracles.neo_hookean_pressure(1.0, a, inner, TRUE_TUBE["outer_radius"])
                for a in data["radius"].values
            ]
            for inner in grids[1]
        ]
    )
    error = grids[0][:, None, None] * unit - data["pressure"].values
    log_likelihood = -(error**2).sum(axis=-1) / 9.0 - 4 / 2 * np.log(np.pi * 9.0)
    exact = np.log(np.sum(np.exp(log_likelihood) * np.outer(weight, weight)) / 4)

    cubature = ph.log_evidence_by_quadrature(model)
    assert abs(cubature.value - exact) < 1e-6
    result = ph.sample_smc(model, draws=500, chains=2, random_seed=1, progressbar=False)
    sampled = ph.log_evidence(result)
    assert abs(sampled.value - exact) < 4 * sampled.standard_error < 0.5


# --- layers --------------------------------------------------------------------------------------


def layered_data(**settings) -> xr.Dataset:
    return tube_data(**({"outer_radius": None} | settings))


def exact_layered_likelihood(layers, inner_radius: float) -> float:
    """Pressures, slopes and normaliser of the curve by adaptive quadrature of the wall."""
    data = tube_data()
    radius, measured = data["radius"].values, data["pressure"].values
    place = {name: TRUE_TUBE[name] for name in ("axial_stretch", "opening_angle")}

    def pressure(internal_radius):
        return oracles.layered_pressure(layers, internal_radius, inner_radius, **place)

    curve = np.array([float(pressure(a)) for a in radius])
    stiffness = [
        float(oracles.derivative(pressure, {"internal_radius": a}, "internal_radius"))
        for a in radius[1:-1]
    ]
    difference = np.zeros((2, 4))
    for row in range(2):
        step = radius[row + 2] - radius[row]
        difference[row, [row, row + 2]] = -1 / step, 1 / step
    sigma, weight = NOISE["sigma"], NOISE["slope_weight"]
    gram = (np.eye(4) + weight * difference.T @ difference) / (np.pi * sigma**2)
    misfit = np.sum((curve - measured) ** 2)
    misfit += weight * np.sum((stiffness - difference @ measured) ** 2)
    return np.linalg.slogdet(gram)[1] / 2 - misfit / sigma**2


def test_layers_have_the_likelihood_of_one_wall():
    """Numbers, parameters and a thickness that are inferred: all enter one integral."""
    law, outer_law = LAWS["NeoHookean"], LAWS["Demiray"]
    layers = [
        ph.Layer(ph.NeoHookean(), 0.25, mu=pm.Normal.dist(0, 50)),
        ph.Layer(ph.Demiray(), pm.Normal.dist(0, 5), mu=12.0, b=pm.Normal.dist(0, 5)),
    ]
    model = ph.inflation_model(layers, layered_data(), **NOISE)
    assert [rv.name for rv in model.free_RVs] == ["mu_1", "b_2", "thickness_2"]
    function = likelihood_of(model, gradient=True)
    value, *gradient = function(20.0, 1.5, 0.15)
    exact = exact_layered_likelihood(
        [
            oracles.Layer(law.energy, {"mu": 20.0}, 1.25),
            oracles.Layer(outer_law.energy, {"mu": 12.0, "b": 1.5}, 1.4),
        ],
        1.0,
    )
    np.testing.assert_allclose(value, exact, rtol=SAME_CURVES)
    assert np.all(np.isfinite(gradient))
    # A layer of negative thickness is none, also where the wall as a whole has some.
    for thickness in (-0.1, 0.0, -10.0):
        value, *gradient = function(20.0, 1.5, thickness)
        assert value == -np.inf
        assert np.all(np.isfinite(gradient))


def test_layers_without_room_are_turned_down():
    """Within a measured outer diameter a wall cannot be as thick as it likes."""
    layers = [
        ph.Layer(ph.NeoHookean(), 0.25, mu=20.0),
        ph.Layer(ph.NeoHookean(), pm.Normal.dist(0, 5), mu=12.0),
    ]
    model = ph.inflation_model(layers, layered_data(measured="outer_diameter"), **NOISE)
    function = likelihood_of(model, gradient=True)
    assert np.isfinite(function(0.15)).all()
    value, gradient = function(5.0)
    assert value == -np.inf
    assert np.isfinite(gradient)


def test_numbers_make_the_layers_of_a_wall():
    """Vectors of numbers are as good as distributions; the likelihood of numbers is a number."""
    series = ph.OgdenSeries(terms=2)
    parameters = {"mu": [20.0, -3.0], "alpha": [2.0, -2.0]}
    halves = [ph.Layer(series, 0.2, **parameters), ph.Layer(series, 0.2, **parameters)]
    model = ph.inflation_model(halves, layered_data(), **NOISE)
    assert not model.free_RVs
    energy = LAWS["OgdenSeries(terms=2)"].energy
    flat = {"mu_0": 20.0, "mu_1": -3.0, "alpha_0": 2.0, "alpha_1": -2.0}
    exact = exact_layered_likelihood([oracles.Layer(energy, flat, 1.4)], 1.0)
    (value,) = likelihood_of(model)()
    np.testing.assert_allclose(value, exact, rtol=SAME_CURVES)


def test_a_distribution_in_two_layers_is_one_variable():
    """It has the name without a number; what is missing has its default prior and a number."""
    shared = pm.Gamma.dist(2, 0.1)
    layers = [
        ph.Layer(ph.Demiray(), 0.2, mu=shared),
        ph.Layer(ph.Demiray(), 0.2, mu=shared, b=2.0),
    ]
    model = ph.inflation_model(layers, layered_data(), **NOISE)
    assert [rv.name for rv in model.free_RVs] == ["mu", "b_1"]
    alone = ph.inflation_model(
        ph.Demiray(), tube_data(), **NOISE, priors={"b": pm.Uniform.dist(0, 20)}, mode="quadrature"
    )
    b = 2.0
    values = {"mu": 15.0, "b_1": b}
    (found,) = at(model, [model["likelihood"]], values)
    (expected,) = at(alone, [alone["likelihood"]], {"mu": 15.0, "b": b})
    np.testing.assert_allclose(found, expected, rtol=SAME_CURVES)


# --- vector parameters ---------------------------------------------------------------------------


def test_vector_parameters_are_vectors_of_the_model(data):
    """One variable for each, of its size, and the likelihood of its entries in their order."""
    series = ph.OgdenSeries(terms=2)
    model = ph.inflation_model(series, data, **NOISE)
    assert {rv.name: rv.type.shape for rv in model.free_RVs} == {"mu": (2,), "alpha": (2,)}
    point = {"mu": np.array([4.0, 1.0]), "alpha": np.array([3.0, 9.0])}
    (found,) = at(model, [model["likelihood"]], point)
    layer = ph.OgdenSeries(terms=1)
    # Terms add up, so that pressures do.
    tube = {k: data[k].values[data["test"].values] for k in TRUE_TUBE}
    curves = [
        sum(
            function(layer, data["radius"].values, **tube, mu=[mu], alpha=[alpha]).eval(
                mode=AS_WRITTEN
            )
            for mu, alpha in zip(point["mu"], point["alpha"], strict=True)
        )
        for function in (ph.inflation_pressure, ph.inflation_stiffness)
    ]
    for values, expected in zip(
        at(model, [model["pressure"], model["stiffness"]], point), curves, strict=True
    ):
        np.testing.assert_allclose(values, expected, rtol=SAME_CURVES)
    swapped = {name: value[::-1] for name, value in point.items()}
    (other,) = at(model, [model["likelihood"]], swapped)
    np.testing.assert_allclose(found, other, rtol=SAME_LIKELIHOOD)
    crossed = point | {"mu": point["mu"][::-1]}
    (crossed,) = at(model, [model["likelihood"]], crossed)
    assert abs(crossed - found) > 1
