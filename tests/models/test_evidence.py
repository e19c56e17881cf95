"""Evidences, predictives and posteriors of inflation curves against exact quadrature."""

from functools import cache

import arviz as az
import exact
import numpy as np
import pandas as pd
import pymc as pm
import pytensor.tensor as pt
import pytest
from scipy.optimize import brentq, minimize_scalar
from scipy.stats import norm

import pymc_hyperelastic as ph

SEED = 1731
ENERGIES = {e.name: e for e in (ph.PowerLawNeoHookean(), ph.Ogden(), ph.CriscioneType())}
CLASSES = ("C1", "C2")

# An honest standard error is exceeded threefold once in 370 runs; seeds are fixed.
STANDARD_ERRORS = 3
# Nats. Odds of classes are then right to a sixth, where they decide anything.
EVIDENCE_TOLERANCE = 0.15
# The quadrature's own, and that of the known number, which is stated to this many digits.
EXACT_TOLERANCE = 1e-6
# Two independent quadratures, one of them good to 1e-6.
QUADRATURE_TOLERANCE = 2e-6
# Share of a mirrored mode, half by symmetry: thirty standard deviations of a fair coin would be
# 0.17 with 8000 particles, so what this catches is a mode that is lost or half lost.
MODE_SHARE_TOLERANCE = 0.05
# Two numbers a sampler are compared with a tolerance in Monte Carlo standard errors.
MONTE_CARLO_ERRORS = 4
# An optimum to what its search resolves: the log density is flat to 1e-12 of it there.
MODE_TOLERANCE = 1e-4


# --- the quadrature itself -----------------------------------------------------------------------

# Six simulated experiments of twenty points, whose evidence was computed apart from this package:
# Ogden, A = 7, B = 9 mm, sigma = 5 mmHg, slope weight 1 mm^2, mu uniform on (1, 150) mmHg, alpha
# uniform on (-20, 20).
KNOWN_LOG_EVIDENCE = -182.95031244
KNOWN_BOX = ((1.0, 150.0), (-20.0, 20.0))
KNOWN_SIGMA, KNOWN_SLOPE_WEIGHT = 5.0, 1.0


def known_data():
    """Three specimens, each with its own modulus and exponent; an error of gain, drift and noise.

    Pressures are in mmHg but called kPa: an evidence holds in any unit that is kept throughout.
    """
    rng = np.random.default_rng(100)
    rows = []
    radius = np.linspace(7.3, 10.2, 20)
    for specimen in "PQR":
        modulus = 45.0 * np.exp(0.08 * rng.standard_normal())
        exponent = 7.5 * np.exp(0.05 * rng.standard_normal())
        tube = exact.Curve(radius, np.zeros(20), 7.0, 9.0)
        ideal = modulus * tube.responses("Ogden", exponent)[0][0]
        for experiment in (1, 2):
            gain, drift = rng.standard_normal(2)
            pressure = ideal * (1 + 0.02 * gain) + 1.5 * drift * np.sin(np.linspace(0, 3, 20))
            pressure += 0.5 * rng.standard_normal(20)
            table = {"radius": radius, "pressure": pressure}
            rows.append(pd.DataFrame({"specimen": specimen, "experiment": experiment, **table}))
    tube = {"inner_radius": 7.0, "outer_radius": 9.0}
    return ph.inflation_data(pd.concat(rows), **tube, check="ignore")


def test_quadrature_gives_the_known_evidence():
    """The exact side of every test here is held to a number from elsewhere."""
    noise = {"sigma": KNOWN_SIGMA, "slope_weight": KNOWN_SLOPE_WEIGHT}
    value = exact.log_evidence_2d(known_data(), "Ogden", box=KNOWN_BOX, **noise)
    assert abs(value - KNOWN_LOG_EVIDENCE) < EXACT_TOLERANCE


def test_package_gives_the_known_evidence():
    """SMC reproduces the known evidence within its error bars."""
    priors = {"mu": pm.Uniform.dist(*KNOWN_BOX[0]), "alpha": pm.Uniform.dist(*KNOWN_BOX[1])}
    model = ph.ogden_model(
        known_data(), sigma=KNOWN_SIGMA, slope_weight=KNOWN_SLOPE_WEIGHT, priors=priors
    )
    tree = ph.sample_smc(model, random_seed=SEED, progressbar=False, var_names=list(priors))
    value, error = ph.log_evidence(tree)
    assert abs(value - KNOWN_LOG_EVIDENCE) < min(STANDARD_ERRORS * error, EVIDENCE_TOLERANCE)


@pytest.mark.parametrize("law", ["PowerLawNeoHookean", "Ogden"])
def test_quadrature_agrees_with_a_plain_grid(law):
    """A fine midpoint grid over the posterior of one experiment, with no idea in it at all.

    The power law's posterior ends at the edge of its prior, n = 30.
    """
    curves = exact.curves_of(ph.select(study(), specimen="S1", experiment=1))
    prior = box(law)
    fit = exact.posterior(curves, law, box=prior, **noise())
    grids = []
    for nodes, (low, high) in zip((fit.modulus, fit.exponent), prior, strict=True):
        centre, sd = fit.mean(nodes), fit.sd(nodes)
        if law == "Ogden" and (low, high) == prior[1]:
            low, centre, sd = 0.0, fit.mean(np.abs(nodes)), fit.sd(np.abs(nodes))
        ends = max(low, centre - 14 * sd), min(high, centre + 14 * sd)
        step = (ends[1] - ends[0]) / 500
        grids.append((ends[0] + step * (np.arange(500) + 0.5), step))
    (modulus, first), (exponent, second) = grids
    top, curvature, peak = exact.parabola(curves, law, exponent, **noise())
    log_density = top[:, None] - curvature[:, None] * (modulus - peak[:, None]) ** 2
    modes = 2 if law == "Ogden" else 1
    total = modes * np.exp(log_density).sum() * first * second
    log_area = sum(np.log(high - low) for low, high in prior)
    # The grid's own error, where the posterior ends at an edge: the square of its step.
    assert abs(np.log(total) - log_area - fit.log_evidence) < 1e-4


# --- the simulated study -------------------------------------------------------------------------


@cache
def study():
    return ph.load_dataset("simulated_sheep_aorta")


def noise():
    return {"sigma": 15 * ph.mmHg, "slope_weight": ph.balanced_slope_weight(study())}


def box(law):
    return tuple(p.prior_range for p in ENERGIES[law].parameters)


def training(name):
    return ph.select(study(), group=name, experiment=[1, 2])


def new_experiments():
    return ph.select(study(), experiment=3)


@cache
def exact_posterior(law, name, new=None):
    """Posterior of a class, perhaps together with one of the new experiments."""
    curves = exact.curves_of(training(name))
    if new is not None:
        curves = [*curves, exact.curves_of(new_experiments())[new]]
    return exact.posterior(curves, law, box=box(law), **noise())


@pytest.fixture(scope="module")
def fits():
    """Fitted classes of each law, made when first asked for."""

    @cache
    def fit(law):
        return ph.fit_classes(
            ENERGIES[law],
            {name: training(name) for name in CLASSES},
            random_seed=SEED,
            progressbar=False,
            **noise(),
        )

    return fit


def assert_evidence(value, error, truth):
    assert abs(value - truth) < STANDARD_ERRORS * error
    assert abs(value - truth) < EVIDENCE_TOLERANCE


@pytest.mark.parametrize("name", CLASSES)
@pytest.mark.parametrize("law", ENERGIES)
def test_class_evidence_is_exact(fits, law, name):
    """Three laws, two classes: SMC within its error bars of quadrature."""
    assert_evidence(*ph.log_evidence(fits(law)[name]), exact_posterior(law, name).log_evidence)


@pytest.mark.parametrize("name", CLASSES)
@pytest.mark.parametrize("law", ENERGIES)
def test_class_posterior_is_exact(fits, law, name):
    """Means and sds of the particles, with the exponent's sign left out of account."""
    truth, posterior = exact_posterior(law, name), fits(law)[name]["posterior"]
    names = ENERGIES[law].parameter_names
    assert_moments(posterior[names[0]], truth, truth.modulus)
    assert_moments(np.abs(posterior[names[1]]), truth, np.abs(truth.exponent))


@pytest.mark.deep
@pytest.mark.parametrize("law", ENERGIES)
def test_class_predictives_are_exact(fits, law):
    """Five new experiments under two classes: the evidence gained by training on them as well.

    Half of them belong to the other class, fifty standard deviations of the posterior away.
    """
    result = ph.classify(new_experiments(), fits(law), random_seed=SEED, progressbar=False)
    truth = np.array(
        [
            [
                exact_posterior(law, name, i).log_evidence - exact_posterior(law, name).log_evidence
                for name in CLASSES
            ]
            for i in range(result.sizes["test"])
        ]
    )
    error = np.abs(result["log_evidence"].values - truth)
    # As rarely exceeded by the largest of ten as by a single one.
    largest = norm.isf(norm.sf(STANDARD_ERRORS) / error.size)
    assert np.all(error < largest * result["log_evidence_se"].values), error
    assert np.all(error < EVIDENCE_TOLERANCE), error


@pytest.mark.parametrize("name", CLASSES)
@pytest.mark.parametrize(("law", "exponent"), [("Ogden", "alpha"), ("CriscioneType", "b")])
def test_mirrored_modes_have_equal_shares(fits, law, exponent, name):
    """Both signs of the exponent are found, and half of the particles have either."""
    share = float((fits(law)[name]["posterior"][exponent] > 0).mean())
    assert abs(share - 0.5) < MODE_SHARE_TOLERANCE


@pytest.mark.parametrize(
    ("law", "box"),
    [("Ogden", ((0, 100), (-40, 40))), ("PowerLawNeoHookean", ((0, 200), (0.3, 30)))],
)
def test_agrees_with_a_second_quadrature(law, box):
    """Mirrored modes, and a posterior that touches the prior's edge, on the simulated study."""
    data = ph.load_dataset("simulated_sheep_aorta")
    noise = {"sigma": 15 * ph.mmHg, "slope_weight": ph.balanced_slope_weight(data)}
    training = ph.select(data, group="C2", experiment=[1, 2])
    energy = ph.StrainEnergy.from_name(law)
    found = ph.log_evidence_by_quadrature(ph.inflation_model(energy, training, **noise))
    truth = exact.log_evidence_2d(training, law, **noise, box=box)
    assert abs(found.value - truth) < QUADRATURE_TOLERANCE


# --- a thin ridge --------------------------------------------------------------------------------

# Ranges of the modulus, in kPa, and of the exponent.
RIDGE_BOX = ((0.0, 50.0), (-80.0, 80.0))
RIDGE_SIGMA, RIDGE_SLOPE_WEIGHT = np.sqrt(2) * 2 * ph.mmHg, 0.0


@cache
def small_tube():
    """One experiment on a tube so small and steep that it tells the modulus to a factor only.

    The radii are those at even pressures up to 25 mmHg; the errors of the pressures are given.
    """
    inner, outer, modulus, exponent = 1.0, 1.3, 0.01, 55.0

    def pressure(radius):
        tube = exact.Curve(np.array([radius]), np.zeros(1), inner, outer)
        return modulus * tube.responses("Ogden", exponent)[0].item()

    ideal = np.linspace(0, 25, 11) * ph.mmHg
    radius = [brentq(lambda r, p=p: pressure(r) - p, 0.9, 1.5) for p in ideal]
    error = 1.4 * ph.mmHg * np.sin(2 * np.arange(11))
    table = {"specimen": "M", "experiment": 1, "radius": radius, "pressure": ideal + error}
    assert 1.15 < max(radius) / inner < 1.3
    return ph.inflation_data(pd.DataFrame(table), inner_radius=inner, outer_radius=outer)


@cache
def ridge_model():
    mu, alpha = (pm.Uniform.dist(*ends) for ends in RIDGE_BOX)
    noise = {"sigma": RIDGE_SIGMA, "slope_weight": RIDGE_SLOPE_WEIGHT}
    return ph.ogden_model(small_tube(), priors={"mu": mu, "alpha": alpha}, **noise)


@cache
def ridge_truth():
    noise = {"sigma": RIDGE_SIGMA, "slope_weight": RIDGE_SLOPE_WEIGHT}
    truth = exact.posterior(exact.curves_of(small_tube()), "Ogden", box=RIDGE_BOX, **noise)
    # A ridge indeed: the modulus is not even known to its own size, in a prior 500 times as wide.
    assert truth.sd(truth.modulus) > truth.mean(truth.modulus)
    assert truth.sd(truth.modulus) < RIDGE_BOX[0][1] / 500
    return truth


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_thin_ridge_has_the_exact_evidence(seed):
    """Two mirrored ridges, thin and bent, which hold a ten-thousandth of the prior."""
    tree = ph.sample_smc(
        ridge_model(), 2000, 2, random_seed=seed, progressbar=False, var_names=["mu", "alpha"]
    )
    assert_evidence(*ph.log_evidence(tree), ridge_truth().log_evidence)


def test_thin_ridge_is_integrated_whole():
    """The package's own quadrature follows the ridge to its ends, with an error as stated."""
    found = ph.log_evidence_by_quadrature(ridge_model())
    assert abs(found.value - ridge_truth().log_evidence) < EXACT_TOLERANCE
    assert found.standard_error < EXACT_TOLERANCE


# --- one-sided and mapped priors -----------------------------------------------------------------


@cache
def one_sided_model():
    """Ogden's model of the first class with a prior on positive exponents only, for NUTS."""
    return ph.ogden_model(training("C1"), priors={"alpha": pm.Uniform.dist(0, 40)}, **noise())


def one_sided_truth():
    curves = exact.curves_of(training("C1"))
    return exact.posterior(curves, "Ogden", box=(box("Ogden")[0], (0, 40)), **noise())


@pytest.fixture(scope="module")
def one_sided():
    return ph.sample_smc(one_sided_model(), random_seed=SEED, progressbar=False)


def test_one_sided_prior_has_the_evidence_of_both_sides(one_sided):
    """Half the range doubles the density: ``Z = int_0^40 L/40 = int_-40^40 L/80``, as L is even."""
    both = exact_posterior("Ogden", "C1").log_evidence
    assert abs(one_sided_truth().log_evidence - both) < EXACT_TOLERANCE
    assert_evidence(*ph.log_evidence(one_sided), both)


STRETCH = 1.1
# Away from alpha = 0, where the map between the two sets of parameters is singular.
MAPPED_BOX = ((0.0, 100.0), (4.0, 40.0))


def stretched_training():
    data = training("C1")
    return data.assign(axial_stretch=data["axial_stretch"] * STRETCH)


def test_ogden_and_criscione_have_one_evidence_under_a_mapped_prior():
    """The two laws are one model of pressure, whatever the axial stretch.

    The map is ``a = (8 mu/alpha^2) cosh(alpha ln(lz)/2)``, ``b = alpha/2``. It holds exactly, with
    the density that Ogden's prior has in ``a`` and ``b``, and by SMC with Ogden's
    variables passed through the map.
    """
    data = stretched_training()
    (mu_low, mu_high), (alpha_low, alpha_high) = MAPPED_BOX
    ogden = exact.log_evidence_2d(data, "Ogden", box=MAPPED_BOX, **noise())

    def log_prior(a, b):
        # mu = a b^2/(2 cosh(b ln lz)) and alpha = 2 b have the Jacobian b^2/cosh(b ln lz). The
        # bound of mu is far from the posterior, and not imposed.
        log_jacobian = 2 * np.log(b) - np.log(np.cosh(b * np.log(STRETCH)))
        return log_jacobian - np.log((mu_high - mu_low) * (alpha_high - alpha_low)) + 0 * a

    mapped_box = ((0.0, 100.0), (alpha_low / 2, alpha_high / 2))
    criscione = exact.log_evidence_2d(
        data, "CriscioneType", box=mapped_box, log_prior=log_prior, **noise()
    )
    assert abs(ogden - criscione) < EXACT_TOLERANCE

    with pm.Model() as mapped:
        mu = pm.Uniform("mu", mu_low, mu_high)
        alpha = pm.Uniform("alpha", alpha_low, alpha_high)
        parameters = {
            "a": 8 * mu / alpha**2 * pt.cosh(alpha / 2 * np.log(STRETCH)),
            "b": alpha / 2,
        }
        ph.inflation_likelihood("curves", ph.CriscioneType(), data, parameters, **noise())
    priors = {
        "mu": pm.Uniform.dist(mu_low, mu_high),
        "alpha": pm.Uniform.dist(alpha_low, alpha_high),
    }
    for model in (mapped, ph.ogden_model(data, priors=priors, **noise())):
        tree = ph.sample_smc(model, random_seed=SEED, progressbar=False, var_names=list(priors))
        assert_evidence(*ph.log_evidence(tree), ogden)


# --- other samplers ------------------------------------------------------------------------------


def assert_moments(draws, truth, nodes, *, least_effective=100):
    """Mean and sd of draws (chain, draw), within Monte Carlo errors that are themselves known."""
    values = np.asarray(draws)
    assert az.ess(values) > least_effective
    mean_error = float(az.mcse(values, method="mean"))
    sd_error = float(az.mcse(values, method="sd"))
    assert abs(values.mean() - truth.mean(nodes)) < MONTE_CARLO_ERRORS * mean_error
    assert abs(values.std() - truth.sd(nodes)) < MONTE_CARLO_ERRORS * sd_error


def assert_one_sided_moments(tree):
    truth = one_sided_truth()
    assert_moments(tree["posterior"]["mu"], truth, truth.modulus)
    assert_moments(tree["posterior"]["alpha"], truth, truth.exponent)


def start():
    truth = one_sided_truth()
    return {"mu": truth.mean(truth.modulus), "alpha": truth.mean(truth.exponent)}


SAMPLING = {"chains": 2, "cores": 1, "random_seed": SEED, "progressbar": False}


def test_smc_agrees_with_quadrature(one_sided):
    """Posterior means and sds of the batched kernel."""
    assert_one_sided_moments(one_sided)


@pytest.mark.deep
def test_nuts_agrees_with_quadrature():
    """Posterior means and sds of PyMC's NUTS under a one-sided prior, without divergences."""
    tree = pm.sample(draws=1000, tune=500, model=one_sided_model(), nuts_sampler="pymc", **SAMPLING)
    assert_one_sided_moments(tree)
    assert not tree["sample_stats"]["diverging"].any()
    assert {"pressure", "stiffness"} <= set(tree["posterior"].data_vars)
    assert tree["posterior"]["pressure"].dims == ("chain", "draw", "obs")


@pytest.mark.deep
def test_nutpie_agrees_with_quadrature():
    """Posterior means and sds of nutpie's NUTS, where it is installed."""
    pytest.importorskip("nutpie")
    tree = pm.sample(
        draws=1000, tune=500, model=one_sided_model(), nuts_sampler="nutpie", **SAMPLING
    )
    assert_one_sided_moments(tree)


@pytest.mark.deep
def test_metropolis_agrees_with_quadrature():
    """Posterior means and sds of random-walk Metropolis, the paper's algorithm."""
    with one_sided_model():
        # From the prior's middle its first proposals overflow an exponential of PyMC's.
        tree = pm.sample(draws=8000, tune=1000, step=pm.Metropolis(), initvals=start(), **SAMPLING)
    assert_one_sided_moments(tree)


@pytest.mark.deep
def test_stock_smc_takes_the_models():
    """PyMC's own kernel reaches the same evidence and posterior.

    It states no error bar, so that half a nat is asked of two runs of 500 particles.
    """
    tree = pm.sample_smc(draws=500, model=one_sided_model(), **SAMPLING)
    stages = np.asarray(tree["sample_stats"]["log_marginal_likelihood"].values)
    final = [np.asarray(chain, float) for chain in np.atleast_1d(stages)]
    final = [chain[np.isfinite(chain)][-1] for chain in final]
    truth = one_sided_truth()
    assert np.all(np.abs(np.array(final) - truth.log_evidence) < 0.5)
    mu = tree["posterior"]["mu"].values
    assert abs(mu.mean() - truth.mean(truth.modulus)) < 0.2 * truth.sd(truth.modulus)


@pytest.mark.deep
def test_find_map_finds_the_mode():
    """Under uniform priors the mode is the largest likelihood, found here in one dimension."""
    curves = exact.curves_of(training("C1"))

    def negative(alpha):
        return -exact.parabola(curves, "Ogden", [alpha], **noise())[0][0]

    alpha = minimize_scalar(negative, bracket=(5, 7, 9), tol=1e-10).x
    mu = exact.parabola(curves, "Ogden", [alpha], **noise())[2][0]
    found = pm.find_MAP(
        model=one_sided_model(), return_inferencedata=True, jitter=False, progressbar=False
    )
    assert abs(float(found["posterior"]["mu"].squeeze()) / mu - 1) < MODE_TOLERANCE
    assert abs(float(found["posterior"]["alpha"].squeeze()) / alpha - 1) < MODE_TOLERANCE
