"""The slope-augmented likelihood: its numbers, its normaliser, its gradients and its limits."""

from itertools import product

import exact
import numpy as np
import pandas as pd
import pymc as pm
import pytensor
import pytensor.tensor as pt
import pytest
from problems import AS_WRITTEN
from tables import SECTOR

import pymc_hyperelastic as ph
from pymc_hyperelastic.models.observation import Observation
from pymc_hyperelastic.models.observation.slopes import central_differences, compressed_spectrum

ENERGIES = (ph.PowerLawNeoHookean(), ph.Ogden(), ph.CriscioneType())

# Both sides are exact to about 1e-12 of the largest pressure, which enters as a square.
LIKELIHOOD_TOLERANCE = 1e-9
# The gradient sums the same terms with a derivative of the response, which loses two digits more.
GRADIENT_TOLERANCE = 1e-7
# Sums of the same terms in another order.
ROUNDING = 1e-12
# Second differences of a parabola are exact but for rounding, here of logs of size 1e2.
CURVATURE_TOLERANCE = 1e-8
SIGMA, SLOPE_WEIGHT = 15 * ph.mmHg, 3.2


def tube_frame(specimen, inner, outer, axial, angle, *, points=9, seed=1):
    """Made-up points of a stiffening tube, from below its reference radius to 1.5 times it."""
    rng = np.random.default_rng(seed)
    growth = np.sort(rng.uniform(0.92, 1.5, points))
    pressure = 12 * (np.exp(2.2 * (growth - 1)) - 1) + 0.2 * rng.standard_normal(points)
    return pd.DataFrame(
        {
            "specimen": specimen,
            "experiment": 1,
            "radius": inner * growth,
            "pressure": pressure,
            "inner": inner,
            "outer": outer,
            "axial": axial,
            "angle": angle,
        }
    )


def dataset(*frames):
    geometry = {"inner_radius": "inner", "outer_radius": "outer", "axial_stretch": "axial"}
    return ph.inflation_data(
        pd.concat(frames, ignore_index=True),
        **geometry,
        opening_angle="angle",
        angle_unit="deg",
        check="ignore",
        **SECTOR,
    )


PLAIN = tube_frame("plain", 7.0, 9.0, 1.0, 0.0)
STRETCHED = tube_frame("stretched", 0.4, 0.52, 1.5, 90.0, seed=2)
SHORTENED = tube_frame("shortened", 3.0, 5.1, 0.9, 0.0, points=6, seed=3)
OPENED = tube_frame("opened", 3.0, 4.0, 1.0, 140.0, points=12, seed=4)
MIXED = dataset(PLAIN, STRETCHED, SHORTENED, OPENED)


def untransformed(name, low, high):
    return pm.Uniform(name, low, high, default_transform=None)


def compiled_likelihood(
    energy, data, *, sigma=SIGMA, slope_weight=SLOPE_WEIGHT, mode="auto", gradient=False
):
    """Compile the Potential (and its gradient) as a function of parameters and inferred noise.

    `sigma` and `slope_weight` may be pairs, the ranges between which they are inferred.
    """
    noise = {"sigma": sigma, "slope_weight": slope_weight}
    with pm.Model() as model:
        parameters = {p.name: untransformed(p.name, *p.prior_range) for p in energy.parameters}
        for name, value in noise.items():
            if isinstance(value, tuple):
                noise[name] = untransformed(name, *value)
        potential = ph.inflation_likelihood("curves", energy, data, parameters, mode=mode, **noise)
    (value,) = model.replace_rvs_by_values([potential])
    inputs = model.value_vars
    outputs = [value, *pytensor.grad(value, inputs)] if gradient else value
    return pytensor.function(inputs, outputs, mode=AS_WRITTEN)


def parameter_points(energy, count=20, seed=5):
    """Corners of the default prior, pulled in by a hair, its middle, and draws from it."""
    (low, high) = np.array([p.prior_range for p in energy.parameters]).T
    middle, half = (low + high) / 2, (high - low) / 2 * (1 - 1e-6)
    corners = [middle + half * sign for sign in product((-1, 1), repeat=len(middle))]
    draws = np.random.default_rng(seed).uniform(low, high, (count, len(low)))
    return np.concatenate([corners, middle[None], draws])


def exact_likelihood(energy, data, points, *, sigma=SIGMA, slope_weight=SLOPE_WEIGHT):
    return exact.log_likelihood(
        exact.curves_of(data), energy.name, *points.T, sigma=sigma, slope_weight=slope_weight
    )


@pytest.mark.parametrize("slope_weight", [SLOPE_WEIGHT, 0], ids=["slopes", "no slopes"])
@pytest.mark.parametrize("energy", ENERGIES, ids=str)
def test_likelihood_is_the_exact_one(energy, slope_weight):
    """Tubes of different radii, axial stretches and opening angles, over the prior's whole range.

    At the prior's end the pressure exceeds the measured one by ten powers of ten.
    """
    points = parameter_points(energy)
    package = compiled_likelihood(energy, MIXED, slope_weight=slope_weight)
    np.testing.assert_allclose(
        [package(*point) for point in points],
        exact_likelihood(energy, MIXED, points, slope_weight=slope_weight),
        rtol=LIKELIHOOD_TOLERANCE,
    )


@pytest.mark.parametrize("inferred", ["sigma", "slope_weight", "both"])
@pytest.mark.parametrize("energy", ENERGIES, ids=str)
def test_inferred_noise_gives_the_number_of_known_noise(energy, inferred):
    """Normaliser included, for noise from far too small to far too large and any slope weight."""
    ranges = {"sigma": (0.0, 100.0), "slope_weight": (0.0, 1e5)}
    chosen = {n: r for n, r in ranges.items() if inferred in (n, "both")}
    package = compiled_likelihood(energy, MIXED, **chosen)
    values = {"sigma": (0.01, 2.0, 90.0), "slope_weight": (1e-6, 1e-2, 3.2, 1e4)}
    point = parameter_points(energy, count=1)[-1:]
    for combination in product(*(values[name] for name in chosen)):
        noise = dict(zip(chosen, combination, strict=True))
        np.testing.assert_allclose(
            package(*point[0], *combination),
            exact_likelihood(energy, MIXED, point, **noise)[0],
            rtol=LIKELIHOOD_TOLERANCE,
        )


@pytest.mark.parametrize("slope_weight", [0, 0.3, 5.0])
@pytest.mark.parametrize("points", [3, 4])
def test_likelihood_is_a_density_of_the_pressures(points, slope_weight):
    """As a function of the pressures it is Gaussian, with the normaliser of its own curvature.

    It integrates to one without slopes. With slopes it integrates to ``exp(-c/sigma^2)``, where
    ``c >= 0`` is the smallest misfit that any pressures can have: a tangent's slope is no central
    difference.
    """
    frame = tube_frame("tiny", 7.0, 9.0, 1.1, 30.0, points=points)
    data = dataset(frame)
    energy, parameters, sigma = ph.Ogden(), (6.0, 8.0), 4.0

    noise = {"sigma": sigma, "slope_weight": slope_weight}
    values = dict(zip(energy.parameter_names, parameters, strict=True))

    observation = Observation(**noise)
    forward = observation.forward_model(energy, data, values, mode="quadrature")
    function = pytensor.function(
        [], observation.log_likelihood(forward.tube(values)), mode=AS_WRITTEN
    )

    def log_density(pressure):
        forward.set_data(data.assign(pressure=data["pressure"].copy(data=pressure)))
        return float(function())

    unit, base = np.eye(points), np.zeros(points)
    zero = log_density(base)
    plus = np.array([log_density(e) for e in unit])
    twice = np.array([log_density(2 * e) for e in unit])
    precision = np.zeros((points, points))
    for i in range(points):
        precision[i, i] = -(twice[i] - 2 * plus[i] + zero)
        for j in range(i):
            both = log_density(unit[i] + unit[j])
            precision[i, j] = precision[j, i] = -(both - plus[i] - plus[j] + zero)
    slope = plus - zero + np.diag(precision) / 2
    highest = zero + slope @ np.linalg.solve(precision, slope) / 2
    log_integral = highest - np.linalg.slogdet(precision / (2 * np.pi))[1] / 2

    (curve,) = exact.curves_of(data)
    difference = curve.differences()
    pressure, stiffness = (
        parameters[0] * unit_response[0]
        for unit_response in curve.responses(energy.name, parameters[1])
    )
    # The smallest misfit, by least squares over the pressures.
    rows = np.concatenate([np.eye(points), np.sqrt(slope_weight) * difference])
    wanted = np.concatenate([pressure, np.sqrt(slope_weight) * stiffness[1:-1]])
    gap = np.sum((rows @ np.linalg.lstsq(rows, wanted)[0] - wanted) ** 2)
    assert abs(log_integral + gap / sigma**2) < CURVATURE_TOLERANCE
    np.testing.assert_allclose(
        precision, 2 / sigma**2 * rows.T @ rows, atol=CURVATURE_TOLERANCE, rtol=0
    )


def test_slopes_never_cross_experiments():
    """Experiments together have the sum of their log-likelihoods, in whatever order they come."""
    energy, parameters = ph.Ogden(), (6.0, 8.0)
    frames = (PLAIN, PLAIN.assign(experiment=2, radius=PLAIN["radius"] + 0.1), OPENED)
    alone = [compiled_likelihood(energy, dataset(frame))(*parameters) for frame in frames]
    for order in ((0, 1, 2), (2, 0, 1)):
        together = compiled_likelihood(energy, dataset(*(frames[i] for i in order)))(*parameters)
        np.testing.assert_allclose(together, sum(alone), rtol=ROUNDING)


@pytest.mark.parametrize("energy", ENERGIES, ids=str)
def test_collocation_agrees_with_quadrature(energy):
    """The constant matrix and the direct rule: value and gradient, over the prior's range."""
    collocated, direct = (
        compiled_likelihood(
            energy, MIXED, sigma=(0.0, 100.0), slope_weight=(0.0, 1e4), mode=mode, gradient=True
        )
        for mode in ("collocation", "quadrature")
    )
    noise = SIGMA, SLOPE_WEIGHT
    ranges = [p.prior_range for p in energy.parameters]
    scale = np.array([*(high - low for low, high in ranges), *noise])
    for point in parameter_points(energy, count=40):
        values, gradients = zip(
            *(
                (value, np.array(gradient))
                for value, *gradient in (
                    function(*point, *noise) for function in (collocated, direct)
                )
            ),
            strict=True,
        )
        np.testing.assert_allclose(*values, rtol=LIKELIHOOD_TOLERANCE)
        # Components in comparable units: what the log-likelihood changes by over a prior's width.
        first, second = (gradient * scale for gradient in gradients)
        assert np.max(np.abs(first - second)) <= GRADIENT_TOLERANCE * np.max(np.abs(second)), point


def test_collocated_likelihood_costs_the_same_for_any_number_of_points():
    """Arrays that enter the compiled expression do not grow with the data."""
    small = ph.load_dataset("simulated_sheep_aorta")
    sizes = []
    for data in (ph.select(small, specimen="S1"), small):
        with pm.Model() as model:
            parameters = {"mu": pm.Uniform("mu", 0, 100), "alpha": pm.Uniform("alpha", -40, 40)}
            ph.inflation_likelihood(
                "curves", ph.Ogden(), data, parameters, sigma=SIGMA, slope_weight=SLOPE_WEIGHT
            )
        shared = [
            v.get_value().size
            for v in pytensor.graph.traversal.graph_inputs(model.potentials)
            if isinstance(v, pytensor.compile.SharedVariable) and v.name and "matrix" in v.name
        ]
        sizes.append(sum(shared))
    assert 0 < sizes[1] <= 1.5 * sizes[0]  # the wall's range of stretches is a little wider


def test_determinant_of_many_points_is_compressed():
    """With an inferred slope weight few numbers stand for the eigenvalues of thousands of points.

    The dense determinant has a condition number of up to ``β s``, here 1e8, and a size of 1e3.
    """
    frames = [
        tube_frame(name, 7.0, 9.0, 1.0, 0.0, points=points, seed=seed).assign(
            radius=np.cumsum(np.random.default_rng(seed).uniform(0.5, 1.5, points)) * 4 / points + 6
        )
        for name, points, seed in (("many", 700, 1), ("few", 40, 2))
    ]
    data = dataset(*frames)
    eigenvalues, multiplicities = compressed_spectrum(data)
    assert eigenvalues.size < 100
    difference = np.zeros((data.sizes["obs"] - 4, data.sizes["obs"]))
    rows, step = central_differences(data)
    for row, (point, inverse) in enumerate(zip(rows, step, strict=True)):
        difference[row, [point + 1, point - 1]] = inverse, -inverse
    identity = np.eye(data.sizes["obs"])
    for slope_weight in (1e-8, 1e-3, 1.0, 1e3):
        _, exact_value = np.linalg.slogdet(identity + slope_weight * difference.T @ difference)
        value = multiplicities @ np.log1p(slope_weight * eigenvalues)
        assert abs(value - exact_value) < LIKELIHOOD_TOLERANCE * max(1.0, abs(exact_value))


def test_balanced_slope_weight_weighs_slopes_and_pressures_alike():
    """A model wrong by one fraction in pressures and slopes is punished equally for both."""
    data = ph.load_dataset("simulated_sheep_aorta")
    weight = ph.balanced_slope_weight(data)
    curves = exact.curves_of(data)
    fraction = 0.07
    wrong_pressure = sum(np.sum((fraction * c.pressure) ** 2) for c in curves)
    wrong_slope = sum(np.sum((fraction * c.differences() @ c.pressure) ** 2) for c in curves)
    assert abs(weight * wrong_slope / wrong_pressure - 1) < ROUNDING
    scaled = data.assign(pressure=data["pressure"] * 7)
    assert abs(ph.balanced_slope_weight(scaled) / weight - 1) < ROUNDING


def test_balanced_slope_weight_needs_slopes():
    """Constant pressure has no balance, and the message says so."""
    with pytest.raises(ValueError, match="no balance"):
        ph.balanced_slope_weight(dataset(PLAIN.assign(pressure=3.0)))


def test_likelihood_inside_a_model_of_ones_own():
    """A hierarchical model with equal moduli has the log-density of the pooled model's likelihood.

    Each specimen has its own modulus there, drawn about a mean; the exponent is shared.
    """
    data = ph.load_dataset("simulated_sheep_aorta")
    specimens = ["S1", "S2", "S4"]
    noise = {"sigma": SIGMA, "slope_weight": SLOPE_WEIGHT}
    with pm.Model(coords={"specimen": specimens}) as hierarchy:
        mean = pm.Normal("mean", np.log(30), 1)
        log_mu = pm.Normal("log_mu", mean, 0.2, dims="specimen")
        alpha = pm.Normal("alpha", 7, 2)
        for i, specimen in enumerate(specimens):
            ph.inflation_likelihood(
                f"curves_{specimen}",
                ph.Ogden(),
                ph.select(data, specimen=specimen),
                {"mu": pt.exp(log_mu[i]), "alpha": alpha},
                **noise,
            )
    pooled = ph.ogden_model(ph.select(data, specimen=specimens), **noise)

    (total,) = hierarchy.replace_rvs_by_values([sum(hierarchy.potentials)])
    (likelihood,) = pooled.replace_rvs_by_values([pooled["likelihood"]])
    ours = pytensor.function(hierarchy.value_vars, total, mode=AS_WRITTEN, on_unused_input="ignore")
    theirs = pytensor.function(pooled.value_vars, likelihood, mode=AS_WRITTEN)
    mu, alpha = 37.0, 6.5
    unconstrained = [np.log(mu / (100 - mu)), np.log((alpha + 40) / (40 - alpha))]
    value = ours(0.0, np.full(3, np.log(mu)), alpha)
    np.testing.assert_allclose(value, theirs(*unconstrained), rtol=LIKELIHOOD_TOLERANCE)
    np.testing.assert_allclose(
        value,
        exact_likelihood(ph.Ogden(), ph.select(data, specimen=specimens), np.array([[mu, alpha]]))[
            0
        ],
        rtol=LIKELIHOOD_TOLERANCE,
    )


UNBOUNDED = {
    "mu": pm.Normal.dist(0, 50),
    "n": pm.Normal.dist(0, 10),
    "alpha": pm.Normal.dist(0, 10),
    "a": pm.Normal.dist(0, 50),
    "b": pm.Normal.dist(0, 10),
}
EXTREMES = (-1000.0, -710.0, -40.0, -1.0, -1e-12, 0.0, 1e-12, 1.0, 40.0, 710.0, 1000.0)


@pytest.mark.parametrize("unbounded", [False, True], ids=["default priors", "unbounded priors"])
@pytest.mark.parametrize("mode", ["collocation", "quadrature"])
@pytest.mark.parametrize("energy", ENERGIES, ids=str)
def test_extreme_parameters_have_no_nan(energy, mode, unbounded):
    """The log-likelihood is a number or minus infinity, and its gradient always finite.

    Unconstrained coordinates go as far as a diverging sampler might; without the bounds of the
    default priors, exponents of 1000 overflow and negative ``n`` has no energy at all.
    """
    if mode == "collocation" and unbounded and energy.name == "PowerLawNeoHookean":
        pytest.skip("near n = 0 the response has a pole: it cannot be collocated, and says so")
    priors = {n: UNBOUNDED[n] for n in energy.parameter_names} if unbounded else None
    model = ph.inflation_model(
        energy, MIXED, sigma=SIGMA, slope_weight=SLOPE_WEIGHT, priors=priors, mode=mode
    )
    (likelihood,) = model.replace_rvs_by_values([model["likelihood"]])
    inputs = model.value_vars
    # As a sampler has it: the ends of the priors are the limits of sigmoids that are simplified.
    function = pytensor.function(
        inputs, [likelihood, *pytensor.grad(likelihood, inputs)], mode="FAST_COMPILE"
    )
    rejected = 0
    with np.errstate(all="ignore"):
        for point in product(EXTREMES, repeat=len(inputs)):
            value, *gradient = function(*point)
            assert not np.isnan(value) and value < np.inf, point
            assert np.all(np.isfinite(gradient)), point
            if value == -np.inf:
                rejected += 1
                assert not np.any(gradient), point
    assert (rejected > 0) == unbounded


def test_what_cannot_be_collocated_says_so():
    """Asked for outright, collocation fails with what to do; by default quadrature steps in."""
    priors = {"n": pm.Normal.dist(0, 10)}
    noise = {"sigma": SIGMA, "slope_weight": SLOPE_WEIGHT, "priors": priors}
    with pytest.raises(ValueError, match="mode='quadrature'"):
        ph.power_law_neo_hookean_model(MIXED, mode="collocation", **noise)
    ph.power_law_neo_hookean_model(MIXED, **noise)
