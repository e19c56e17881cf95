"""Tubes that are inferred, or that were measured with an error."""

import json

import numpy as np
import pandas as pd
import pymc as pm
import pytensor
import pytest
from problems import AS_WRITTEN
from scipy import stats
from shared_errors import COMPLEX_STEP, ogden, paper_log_density, pressure_and_force
from tables import SECTOR

import pymc_hyperelastic as ph
from pymc_hyperelastic.mechanics.tube import opened_sector

# Sums of squares by two rules of different order.
LIKELIHOOD_TOLERANCE = 1e-9
# Central differences with this step, relative to the largest derivative by a logarithm.
STEP, GRADIENT_TOLERANCE = 1e-5, 1e-6

# --- one tube that is inferred -------------------------------------------------------------------

TUBE = {"inner_radius": 1.0, "outer_radius": 1.4, "axial_stretch": 1.2, "opening_angle": 0.7}
OGDEN = {"mu": 6.0, "alpha": 8.0}
SIGMA, FORCE_SIGMA, SLOPE_WEIGHT = 5 * ph.mmHg, 3.0, 1.0
RADIUS = np.array([1.05, 1.1, 1.2, 1.3])
OUTER = np.sqrt(RADIUS**2 + (1.4**2 - 1.0) * (2 * np.pi - 0.7) / (2 * np.pi) / 1.2)
PRESSURE, FORCE = np.array([2.0, 3.0, 6.0, 11.0]), np.array([12.0, 13.0, np.nan, 19.0])
# Inferred measures with values near those of the tube, impossible values, measured quantity.
UNKNOWN = [
    (
        {"outer_radius": 1.43, "axial_stretch": 1.15},
        [(0.9, 1.2), (-1.5, 1.2), (0.0, 1.2), (50.0, 1.2), (1.4, -1.0)],
        "outer_diameter",
    ),
    (
        {"inner_radius": 1.02, "thickness": 0.37},
        [(1.0, -0.1), (-3.0, 1.0), (-3.0, 5.0), (1.0, 3.0), (1e4, 1e4)],
        "outer_diameter",
    ),
    (
        {"inner_radius": 1.02, "wall_area": 2.7, "opening_angle": 0.8},
        [(1.0, -1e3, 0.5), (1.0, 0.0, 0.5), (1.0, 2.5, 7.0), (1.0, 2.5, -7.0)],
        "radius",
    ),
]


def tube_data(measured, **geometry):
    """One curve of a stretched, opened tube, with axial forces."""
    frame = pd.DataFrame({"specimen": "S", "experiment": 3, "radius": RADIUS, "pressure": PRESSURE})
    frame = frame.assign(outer_diameter=2 * OUTER, axial_force=FORCE)
    return ph.inflation_data(frame, ph.Tube(**TUBE | geometry, **SECTOR), measured=measured)


def exact_likelihood(measured, values, mu, alpha):
    """Pressures, slopes and forces of a tube with these measures, by independent quadrature."""
    tube = TUBE | {k: v for k, v in values.items() if k in TUBE}
    inner, axial, angle = tube["inner_radius"], tube["axial_stretch"], tube["opening_angle"]
    outer, k = tube["outer_radius"], 2 * np.pi / (2 * np.pi - angle)
    if "thickness" in values:
        outer = inner + values["thickness"]
    if "wall_area" in values:
        # The cross-section of the ring is that of the sector that was cut from it.
        outer = np.sqrt(inner**2 + 2 * values["wall_area"] / (2 * np.pi - angle))
    place, radius = RADIUS, RADIUS + 1j * COMPLEX_STEP
    if measured == "outer_diameter":
        place, area = OUTER, (outer**2 - inner**2) / (k * axial)
        radius = np.sqrt((OUTER + 1j * COMPLEX_STEP) ** 2 - area)
    layers = [(ogden(mu, alpha), outer - inner)]
    pressure, force = pressure_and_force(layers, radius, inner, np.full(4, axial), k)
    of_pressure = paper_log_density(place, pressure, PRESSURE, SIGMA, SLOPE_WEIGHT)
    error = (force.real - FORCE)[np.isfinite(FORCE)]
    of_force = np.sum(error**2) / FORCE_SIGMA**2 + 1.5 * np.log(np.pi * FORCE_SIGMA**2)
    return of_pressure - of_force


@pytest.mark.parametrize(("values", "impossible", "measured"), UNKNOWN)
def test_likelihood_of_an_inferred_tube_is_exact_and_zero_if_impossible(
    values, impossible, measured
):
    """Gradients agree with differences, and are finite for impossible tubes."""
    names, steep = list(values), [(6.0, alpha, *values.values()) for alpha in (1e4, 1e6)]
    missing = {name: np.nan for name in names if name in TUBE}
    likelihood = ph.SlopeAugmented(SIGMA, SLOPE_WEIGHT, force_sigma=FORCE_SIGMA)
    priors = {name: pm.Normal.dist(1.0, 50.0) for name in [*OGDEN, *names]}
    data = tube_data(measured, **missing)
    model = ph.ogden_model(data, likelihood, priors=priors, mode="quadrature")
    (value,) = model.replace_rvs_by_values([model["likelihood"]])
    outputs = [value, *pytensor.grad(value, model.value_vars)]
    function = pytensor.function(model.value_vars, outputs, mode=AS_WRITTEN)
    point = np.array([*OGDEN.values(), *values.values()])
    found, *gradient = function(*point)
    expected = exact_likelihood(measured, values, **OGDEN)
    np.testing.assert_allclose(found, expected, rtol=LIKELIHOOD_TOLERANCE)
    differences = [
        (function(*point + step)[0] - function(*point - step)[0]) / (2 * STEP)
        for step in np.diag(STEP * point)
    ]
    atol = GRADIENT_TOLERANCE * np.abs(differences).max()
    np.testing.assert_allclose(gradient * point, differences, rtol=0, atol=atol)
    with np.errstate(all="ignore"):
        for bad in [*((*OGDEN.values(), *tube) for tube in impossible), *steep]:
            found, *gradient = function(*bad)
            assert found == -np.inf, bad
            assert np.all(np.isfinite(gradient)), bad


# --- tubes of specimens that were measured with an error -----------------------------------------

RING_ANGLE = 1.1
NOISE = ph.Gaussian(pressure_sd=0.4, force_sd=2.0)


def table():
    """Return two tests of each of two specimens; the second one has a thicker wall."""
    rows = [
        {"specimen": name, "experiment": test, "radius": r, "outer": outer, "pressure": 60 * r - 25}
        | {"axial_force": 20.0 + r, "outer_diameter": 2 * r + 0.2, "stretch": 1.3 + 0.1 * test}
        for name, outer in (("S1", 0.6), ("S2", 0.63))
        for test in (0, 1)
        for r in (0.55, 0.6, 0.66, 0.7)
    ]
    return pd.DataFrame(rows)


def ring_data(measured="radius", sd=None):
    cut = {"opening_angle": RING_ANGLE, "convention": "whole", "radii_of": "ring"}
    tube = ph.Tube(0.5, "outer", axial_stretch="stretch", **cut, sd=sd)
    return ph.inflation_data(table(), tube, measured=measured, check="ignore")


def log_density(model, **point):
    start = model.initial_point() | {k: np.asarray(v, float) for k, v in point.items()}
    return float(model.compile_logp(sum=True, mode=AS_WRITTEN)(start))


def changed(data, name, z, sd):
    """Return data of rings with a measure that deviates by `z` standard deviations."""
    of_test, tube = np.repeat(z, 2), ("inner_radius", "outer_radius", "opening_angle")
    inner, outer, angle = (data[k].values for k in tube)
    if name in ("inner_radius", "axial_stretch"):
        value = data[name].values
        return data.assign({name: ("test", value * np.exp(of_test * sd / value))})
    # The closed ring has the thickness and the middle line of the sector.
    h, middle = outer - inner, (outer + inner) / 2 * (2 * np.pi - angle) / (2 * np.pi)
    inner = middle - h / 2
    if name == "thickness":
        h = h * np.exp(of_test * sd / h)
    if name == "wall_area":
        area = 2 * np.pi * middle * h
        h = np.sqrt(inner**2 + area / np.pi * np.exp(of_test * sd / area)) - inner
    if name == "opening_angle":
        angle = angle + of_test * sd
    values = (*opened_sector(inner, inner + h, opening_angle=angle), angle)
    return data.assign({k: ("test", value) for k, value in zip(tube, values, strict=True)})


def with_radii(data):
    """Return data with the internal radii that follow from the outer diameters."""
    if "outer_diameter" not in data:
        return data
    k = 2 * np.pi / (2 * np.pi - data["opening_angle"].values)
    excess = (data["outer_radius"].values ** 2 - data["inner_radius"].values ** 2) / k
    at_points = (excess / data["axial_stretch"].values)[data["test"].values]
    return data.assign(
        radius=("obs", np.sqrt((data["outer_diameter"].values / 2) ** 2 - at_points))
    )


Z = np.array([[0.7, -1.2], [-0.4, 0.3]])


@pytest.mark.parametrize(
    ("sds", "measured"),
    [
        ({"thickness": 0.02, "opening_angle": 0.2}, "radius"),
        ({"inner_radius": 0.01, "axial_stretch": 0.05}, "outer_diameter"),
        ({"wall_area": 0.03}, "radius"),
    ],
)
def test_density_at_deviations_equals_the_density_of_the_deviating_tube(sds, measured):
    """The likelihood is that of data with the deviating tube; the prior is standard normal."""
    stated = measured == "radius"  # by the data, or by the model
    data = other = ring_data(measured, sds) if stated else ring_data(measured)
    priors = {
        name: ph.MeasuredValue() if stated else ph.MeasuredValue(sd) for name, sd in sds.items()
    }
    settings = {"likelihood": NOISE, "mode": "quadrature"}
    model = ph.inflation_model(ph.Ogden(), data, **settings, priors=priors)
    for z, (name, sd) in zip(Z, sds.items(), strict=False):
        other = changed(other, name, z, sd)
    other = with_radii(other)
    expected = log_density(ph.inflation_model(ph.Ogden(), other, **settings))
    expected += stats.norm.logpdf(Z[: len(sds)]).sum()
    deviations = {f"{name}_deviation": z for z, name in zip(Z, sds, strict=False)}
    found = log_density(model, **deviations)
    assert found == pytest.approx(expected, rel=LIKELIHOOD_TOLERANCE)

    names = [n for n in ("inner_radius", "outer_radius", "axial_stretch") if n in model.named_vars]
    outputs = model.replace_rvs_by_values([model[name] for name in names])
    point = model.initial_point() | deviations
    function = model.compile_fn(outputs, inputs=model.value_vars, on_unused_input="ignore")
    tube = function(point)
    assert tube
    for name, values in zip(names, tube, strict=True):
        np.testing.assert_allclose(values, other[name].values[::2])


def wall_data(radius, name, wall, radii_of):
    """Return data of tubes of which one radius and a measure of the wall, by test, are stated."""
    stated = {"inner_radius": 0.5, "outer_radius": "outer"}
    cut = {"opening_angle": RING_ANGLE, "convention": "whole", "radii_of": radii_of}
    tube = ph.Tube(**{radius: stated[radius]}, axial_stretch="stretch", **{name: name}, **cut)
    frame = table().assign(**{name: np.repeat(wall, 4)})
    return ph.inflation_data(frame, tube, measured="outer_diameter", check="ignore")


@pytest.mark.parametrize("radii_of", ["sector", "ring"])
@pytest.mark.parametrize(("name", "wall"), [("thickness", [0.1, 0.12]), ("wall_area", [0.3, 0.4])])
@pytest.mark.parametrize("radius", ["inner_radius", "outer_radius"])
def test_wall_with_an_error_keeps_the_radius_that_was_stated_with_it(radius, name, wall, radii_of):
    """The density at a deviation is that of data with another wall and the same radius."""
    wall, sd = np.repeat(wall, 2), 0.02
    data = wall_data(radius, name, wall, radii_of)
    settings = {"likelihood": NOISE, "mode": "quadrature"}
    priors = {name: ph.MeasuredValue(sd)}
    model = ph.inflation_model(ph.Ogden(), data, **settings, priors=priors)
    other = wall_data(radius, name, wall * np.exp(np.repeat(Z[0], 2) * sd / wall), radii_of)
    expected = log_density(ph.inflation_model(ph.Ogden(), other, **settings))
    expected += stats.norm.logpdf(Z[0]).sum()
    found = log_density(model, **{f"{name}_deviation": Z[0]})
    assert found == pytest.approx(expected, rel=LIKELIHOOD_TOLERANCE)
    # The radii that deviate are variables of the model.
    kept = {radius} if radii_of == "sector" else set()
    radii = {v.name for v in model.deterministics} & {"inner_radius", "outer_radius"}
    assert radii == {"inner_radius", "outer_radius"} - kept


def test_errors_of_the_inner_radius_and_of_a_wall_stated_with_the_outer_one_are_refused():
    data = wall_data("outer_radius", "thickness", [0.1] * 4, "sector")
    priors = {"thickness": ph.MeasuredValue(0.01), "inner_radius": ph.MeasuredValue(0.01)}
    with pytest.raises(ValueError, match="the inner radius follows from the measured outer radius"):
        ph.inflation_model(ph.Ogden(), data, NOISE, priors=priors)


@pytest.mark.parametrize("unknown", [ph.MeasuredValue(0.1), pm.LogNormal.dist(-1.0, 0.2)])
def test_results_of_uncertain_tubes_store_their_likelihood_but_no_priors(unknown):
    """Laws can then be compared; priors are stored for classes only."""
    likelihood = ph.Gaussian(pressure_sd=0.3, force_sd=2.0)
    priors = {"thickness": unknown}
    if not isinstance(unknown, ph.MeasuredValue):
        priors["inner_radius"] = pm.LogNormal.dist(0.0, 0.1)
    model = ph.ogden_model(tube_data("radius"), likelihood, priors=priors)
    settings = json.loads(model.study.result_attrs(model)["model_settings"])
    assert settings["likelihood"] == likelihood.to_record()
    assert settings["priors"] is None
