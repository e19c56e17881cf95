"""Bridge sampling: evidences from draws of any sampler, against exact ones; and when it doubts."""

import warnings
from itertools import product

import numpy as np
import pymc as pm
import pytensor.tensor as pt
import pytest
import xarray as xr
from evidences import PROBLEMS
from pymc.distributions import transforms
from pytensor.compile.mode import Mode
from scipy import stats
from tiers import deep, long

import pymc_hyperelastic as ph
from pymc_hyperelastic.evidence.batched import BatchedFunction
from pymc_hyperelastic.evidence.proposal import fitted_proposal
from pymc_hyperelastic.evidence.unconstrained import unconstrained_draws

SEED = 20250
# Single estimates are held to so many of their standard errors; seeds are fixed.
STANDARD_ERRORS = 4.0
# Root mean square of the errors over those that were stated, of a hundred runs: at best 1, and less
# where doubling the correlation of the parts is too cautious.
HONEST = (0.65, 1.4)
# What a transform and its inverse lose, in logarithms and sums of a few numbers of order one.
ROUNDING = 1e-7
CHAINS, DRAWS = 4, 500
PROPOSALS = ["normal", "warped", "mixture", "auto"]


def as_tree(**variables) -> xr.DataTree:
    """A result by any sampler: variables by (chain, draw, ...)."""
    posterior = {
        name: (("chain", "draw", *(f"{name}_{i}" for i in range(np.ndim(values) - 2))), values)
        for name, values in variables.items()
    }
    return xr.DataTree.from_dict({"posterior": xr.Dataset(posterior)})


def by_chain(values, chains=CHAINS):
    """Independent draws, dealt to chains."""
    return np.reshape(values, (chains, -1, *np.shape(values)[1:]))


def autoregressive(rng, chains, draws, dimension, phi):
    """Standard normal chains, of which each draw resembles the one before by `phi`."""
    noise = rng.standard_normal((chains, draws, dimension))
    noise[:, 1:] *= np.sqrt(1 - phi**2)
    for i in range(1, draws):
        noise[:, i] += phi * noise[:, i - 1]
    return noise


def assert_agrees(estimate, exact, at_most):
    """The estimate is near the exact value by its own standard error, and that is small."""
    assert estimate.standard_error < at_most
    assert abs(estimate.value - exact) < STANDARD_ERRORS * estimate.standard_error


# --- a regression, whose evidence and posterior are known ----------------------------------------


class Regression:
    """Correlated coefficients with normal priors, and normal noise that is known."""

    def __init__(self, coefficients, seed=SEED, shift=0.0):
        rng = np.random.default_rng(seed)
        rows, noise, scale = 2 * coefficients, 0.5, np.linspace(1, 3, coefficients)
        design = rng.normal(size=(rows, coefficients)) + rng.normal(size=(rows, 1))
        y = design @ (scale * rng.normal(size=coefficients)) + noise * rng.normal(size=rows) + shift
        with pm.Model(coords={"column": range(coefficients)}) as self.model:
            slope = pm.Normal("slope", 0, scale, dims="column")
            pm.Normal("y", pt.dot(design, slope), noise, observed=y)
        precision = design.T @ design / noise**2 + np.diag(scale**-2)
        self.mean = np.linalg.solve(precision, design.T @ y / noise**2)
        self.factor = np.linalg.cholesky(np.linalg.inv(precision))
        covariance = (design * scale) @ (design * scale).T + noise**2 * np.eye(rows)
        self.log_evidence = stats.multivariate_normal(cov=covariance).logpdf(y)

    def draws(self, rng, chains=CHAINS, draws=DRAWS, phi=0.0, width=1.0):
        standard = autoregressive(rng, chains, draws, len(self.mean), phi)
        return as_tree(slope=self.mean + width * standard @ self.factor.T)


@pytest.fixture(scope="module")
def regression():
    return Regression(5)


@pytest.mark.parametrize("proposal", PROPOSALS)
def test_evidence_of_a_regression(regression, proposal):
    """Every proposal gives the closed form, within a hundredth."""
    tree = regression.draws(np.random.default_rng(SEED))
    found = ph.log_evidence_by_bridge(regression.model, tree, proposal=proposal, random_seed=SEED)
    assert_agrees(found, regression.log_evidence, 0.015)


def errors_over_stated(dimension, chains, draws, phi, runs):
    """Errors of many runs over the standard errors that these stated."""
    regression, rng = Regression(dimension), np.random.default_rng(SEED)
    found = [
        ph.log_evidence_by_bridge(
            regression.model, regression.draws(rng, chains, draws, phi), random_seed=run
        )
        for run in range(runs)
    ]
    value, error = np.transpose(found)
    assert np.isfinite(error).all()
    return (value - regression.log_evidence) / error


@pytest.mark.parametrize(
    ("dimension", "chains", "draws", "phi", "runs"),
    [
        (4, 4, 250, 0.0, 40),
        *deep(
            [
                (10, 2, 1000, 0.0, 100),
                (30, 4, 1000, 0.7, 100),
            ]
        ),
        *long(
            [
                (10, 12, 200, 0.0, 100),
                (10, 1, 2000, 0.0, 100),
                (10, 4, 1000, 0.0, 100),
                (10, 4, 1000, 0.7, 100),
                (30, 4, 1000, 0.0, 100),
                (50, 4, 1000, 0.0, 100),
                (50, 4, 1000, 0.7, 100),
                (150, 4, 1000, 0.0, 50),
            ]
        ),
    ],
)
def test_stated_errors_are_those_that_are_made(dimension, chains, draws, phi, runs):
    """Of independent and of autocorrelated draws, with one chain and with several."""
    ratio = errors_over_stated(dimension, chains, draws, phi, runs)
    assert HONEST[0] < np.sqrt(np.mean(ratio**2)) < HONEST[1]
    assert abs(ratio.mean()) < 4 / np.sqrt(runs)


def test_autocorrelation_counts(regression):
    """Where draws resemble those before them, the standard error is larger for it."""
    rng = np.random.default_rng(SEED)
    errors = [
        ph.log_evidence_by_bridge(
            regression.model, regression.draws(rng, 4, 2000, phi), random_seed=1, proposal="normal"
        ).standard_error
        for phi in (0.0, 0.8)
    ]
    assert errors[1] > 1.5 * errors[0]


def test_one_seed_gives_one_result(regression):
    """The same seed gives the same estimate, another seed another one."""
    tree = regression.draws(np.random.default_rng(SEED))
    first, again, other = (
        ph.log_evidence_by_bridge(regression.model, tree, random_seed=seed) for seed in (1, 1, 2)
    )
    assert first == again != other


def test_more_proposal_draws_help(regression):
    """Their share of the error shrinks."""
    tree = regression.draws(np.random.default_rng(SEED))
    few, many = (
        ph.log_evidence_by_bridge(regression.model, tree, proposal_draws=n, random_seed=1)
        for n in (400, 40000)
    )
    assert many.standard_error < 0.7 * few.standard_error


@pytest.mark.parametrize(
    ("unknowns", "draws", "at_most"), [(200, 1000, 0.1), *deep([(1000, 1500, 0.2)])]
)
def test_many_unknowns(unknowns, draws, at_most):
    """A common mean and hundreds of others, correlated through it."""
    rng = np.random.default_rng(SEED)
    y, noise = rng.normal(1, 1, unknowns - 1), rng.uniform(0.5, 1, unknowns - 1)
    with pm.Model() as model:
        mu = pm.Normal("mu", 0, 2)
        group = pm.Normal("group", mu, 0.7, shape=unknowns - 1)
        pm.Normal("y", group, noise, observed=y)
    total = noise**2 + 0.7**2
    exact = stats.multivariate_normal(cov=np.diag(total) + 4.0).logpdf(y)
    variance = 1 / (np.sum(1 / total) + 1 / 4)
    mu = rng.normal(variance * np.sum(y / total), np.sqrt(variance), (CHAINS, draws, 1))
    weight = 0.7**2 / total
    group = (
        mu
        + weight * (y - mu)
        + noise * np.sqrt(weight) * rng.normal(size=(CHAINS, draws, unknowns - 1))
    )
    found = ph.log_evidence_by_bridge(model, as_tree(mu=mu[..., 0], group=group), random_seed=SEED)
    assert_agrees(found, exact, at_most)


# --- shapes of posteriors, and the scales of variables -------------------------------------------

# A model without data has the evidence 1, and independent draws of the prior are its posterior's.


def positive():
    pm.Gamma("x", 0.5, 2.0, shape=3)
    pm.HalfNormal("y", 3.0)
    pm.Exponential("z", 0.1)


def between():
    a = pm.Uniform("a", -1, 4)
    pm.Uniform("b", a, a + pt.exp(a))
    pm.Beta("c", 0.7, 2.0, shape=2)
    pm.TruncatedNormal("d", a, 1.0, lower=a - 1, upper=a + 0.5)


def on_a_simplex():
    pm.Dirichlet("w", np.array([[1.0, 2.0, 0.5], [3.0, 1.0, 1.0]]))


def summing_to_zero():
    pm.ZeroSumNormal("z", 2.0, shape=(2, 4))


def on_a_circle():
    pm.VonMises("angle", [0.0, 2.8], [0.3, 2.0])


def heavy_tailed():
    pm.StudentT("t", nu=3, shape=5)
    pm.Cauchy("c", 0.0, 2.0)


def unequal_tails():
    pm.SkewNormal("s", mu=0, sigma=1, alpha=6, shape=3)
    pm.Gumbel("g", 1.0, 2.0)
    pm.AsymmetricLaplace("a", kappa=3.0, mu=0.0, b=1.0)


def banana():
    x = pm.Normal("x", 0, 2)
    pm.Normal("y", x**2 / 3, 1)


def funnel():
    v = pm.Normal("v", 0, 3)
    pm.Normal("x", 0, pt.exp(v / 2), shape=3)


def hierarchy():
    tau = pm.HalfNormal("tau", 1)
    mu = pm.Normal("mu", 0, 5)
    pm.Normal("group", mu, tau, shape=(4, 3))


def two_modes():
    pm.NormalMixture("x", w=[0.3, 0.7], mu=[-4.0, 4.0], sigma=[1.0, 0.5], shape=2)


PRIORS = [
    positive,
    between,
    on_a_simplex,
    summing_to_zero,
    on_a_circle,
    heavy_tailed,
    unequal_tails,
    banana,
    funnel,
    hierarchy,
    two_modes,
]


def prior_draws(model, count=CHAINS * DRAWS):
    drawn = pm.draw(model.free_RVs, count, random_seed=SEED, mode=Mode("py", "fast_compile"))
    return as_tree(**{v.name: by_chain(x) for v, x in zip(model.free_RVs, drawn, strict=True)})


@pytest.mark.parametrize("prior", PRIORS, ids=lambda prior: prior.__name__)
def test_evidence_of_no_data_is_one(prior):
    """Whatever the variables' scale and shape, bounds that depend on others among them."""
    with pm.Model() as model:
        prior()
    found = ph.log_evidence_by_bridge(model, prior_draws(model), random_seed=SEED)
    assert_agrees(found, 0.0, 0.1)


def test_ordered_variables():
    """Three that are ordered are one of six orders."""
    with pm.Model() as model:
        pm.Normal("x", [0.0, 0.0, 0.0], 2.0, transform=transforms.ordered, initval=[-1, 0, 1])
    x = np.sort(np.random.default_rng(SEED).normal(0, 2, (CHAINS, DRAWS, 3)))
    found = ph.log_evidence_by_bridge(model, as_tree(x=x), random_seed=SEED)
    assert_agrees(found, -np.log(6), 0.02)


@pytest.mark.skipif(
    tuple(map(int, pm.__version__.split(".")[:2])) < (6, 4),
    reason="the density of LKJ did not integrate to one",
)
def test_covariances():
    """A factor of a covariance, whose correlations are drawn by their partial correlations."""
    with pm.Model() as model:
        pm.LKJCholeskyCov("factor", n=3, eta=2.0, sd_dist=pm.Exponential.dist(1.0))
    # Of three variables: Beta(η + 1/2) for two pairs, and Beta(η) for the third, given the first.
    rng = np.random.default_rng(SEED)
    r12, r13 = 2 * rng.beta(2.5, 2.5, (2, CHAINS, DRAWS)) - 1
    r23 = 2 * rng.beta(2, 2, (CHAINS, DRAWS)) - 1
    rows = np.zeros((CHAINS, DRAWS, 3, 3))
    rows[..., 0, 0] = 1
    rows[..., 1, 0], rows[..., 1, 1] = r12, np.sqrt(1 - r12**2)
    rows[..., 2, 0], rows[..., 2, 1] = r13, r23 * np.sqrt(1 - r13**2)
    rows[..., 2, 2] = np.sqrt((1 - r23**2) * (1 - r13**2))
    factor = rng.exponential(size=(CHAINS, DRAWS, 3, 1)) * rows
    tree = as_tree(factor=factor[..., *np.tril_indices(3)])
    found = ph.log_evidence_by_bridge(model, tree, random_seed=SEED)
    assert_agrees(found, 0.0, 0.05)


def test_potentials_and_missing_data_count():
    """A potential is part of the density, and a value that was not measured is a variable."""
    with pm.Model() as model:
        x = pm.Normal("x", 0, 1)
        with pytest.warns(pm.exceptions.ImputationWarning):
            pm.Normal("y", x, 1, observed=np.ma.masked_invalid([0.4, np.nan]))
        pm.Potential("p", -(x**2) / 2 + 3)
    # Two densities of x and one of y: precision 3 in all, and y without an observation is free.
    rng, exact = np.random.default_rng(SEED), 3 - 0.5 * np.log(2 * np.pi * 3) - 0.4**2 / 3
    x = rng.normal(0.4 / 3, 1 / np.sqrt(3), (CHAINS, DRAWS))
    tree = as_tree(x=x, y_unobserved=rng.normal(x, 1)[..., None])
    found = ph.log_evidence_by_bridge(model, tree, random_seed=SEED)
    assert_agrees(found, exact, 0.02)


# --- proposals -----------------------------------------------------------------------------------


def test_correlations_are_kept_where_draws_know_them():
    """Forty independent unknowns keep none of those found, and those of a common factor theirs."""
    rng = np.random.default_rng(SEED)
    independent = rng.normal(size=(2, 100, 40))
    common = 0.1 * independent + rng.normal(size=(2, 100, 1))
    for draws, least, most in ((independent, -0.01, 0.01), (common, 0.97, 1.0)):
        factor = fitted_proposal(draws, 200.0, "normal", rng).factors[0]
        covariance = factor @ factor.T
        correlation = covariance[0, 1] / np.sqrt(covariance[0, 0] * covariance[1, 1])
        assert least < correlation < most


def test_auto_takes_what_foretells_other_draws_best():
    """One normal distribution of normal draws, Student's t of such, and several of two modes."""
    rng = np.random.default_rng(SEED)
    normal = rng.normal(size=(4, 500, 3))
    student = rng.standard_normal((4, 500, 8)) / rng.gamma(2, 0.5, (4, 500, 1))
    two_modes = rng.normal(size=(4, 500, 2)) + rng.choice([-9, 9], (4, 500, 1))
    found = [fitted_proposal(draws, 2000.0, "auto", rng) for draws in (normal, student, two_modes)]
    assert len(found[0].means) == 1 < len(found[2].means)
    assert [np.isfinite(mixture.freedom) for mixture in found] == [False, True, False]


# --- modes ---------------------------------------------------------------------------------------


def chains_in_modes(weights, width=1.0):
    """Four chains of a mixture, each with its share of the right mode, which is 0.7."""
    rng = np.random.default_rng(SEED)
    with pm.Model() as model:
        pm.NormalMixture("x", w=[0.3, 0.7], mu=[-4.0, 4.0], sigma=[width, width / 2])
    right = rng.random((CHAINS, DRAWS)) < np.reshape(weights, (-1, 1))
    x = np.where(right, rng.normal(4, width / 2, right.shape), rng.normal(-4, width, right.shape))
    return model, as_tree(x=x)


def test_a_mode_that_no_chain_met_is_missing():
    """The mass of the others is found: that is all that draws can tell, and the page says so."""
    found = ph.log_evidence_by_bridge(*chains_in_modes([1, 1, 1, 1]), random_seed=SEED)
    assert_agrees(found, np.log(0.7), 0.01)


@pytest.mark.parametrize(
    ("weights", "width"),
    [([0, 1, 1, 1], 1.0), ([0, 1, 1, 1], 1e-3), ([0.2, 0.9, 0.7, 0.5], 1.0)],
)
def test_chains_that_disagree_about_modes_are_not_trusted(weights, width):
    """Chains in different modes, or with different shares of them, do not know the shares."""
    with pytest.warns(UserWarning, match=r"the chains disagree \(R-hat \d+\.\d\d of x\)"):
        found = ph.log_evidence_by_bridge(*chains_in_modes(weights, width), random_seed=SEED)
    assert found.standard_error == np.inf and np.isfinite(found.value)


# --- when it doubts ------------------------------------------------------------------------------


def doubtful(model, tree, match, **settings):
    with pytest.warns(UserWarning, match=match):
        found = ph.log_evidence_by_bridge(model, tree, random_seed=SEED, **settings)
    assert found.standard_error == np.inf


def test_draws_of_other_data_are_found_out(regression):
    """Those of a posterior that lies elsewhere, or is wider by a tenth."""
    rng = np.random.default_rng(SEED)
    other = Regression(5, shift=0.3).draws(rng)
    doubtful(regression.model, other, "not distributed as the posterior", proposal="normal")
    wide = regression.draws(rng, draws=1000, width=1.1)
    doubtful(regression.model, wide, "not distributed as the posterior")


def test_draws_of_a_chain_that_stands_still(regression):
    """One chain of four never moved."""
    tree = regression.draws(np.random.default_rng(SEED))
    tree["posterior"]["slope"][0] = tree["posterior"]["slope"].values[0, 0]
    doubtful(regression.model, tree, "the chains disagree")


def test_slow_chains(regression):
    """Chains that took a few hundred steps across the posterior."""
    tree = regression.draws(np.random.default_rng(SEED), phi=0.998)
    doubtful(regression.model, tree, "the chains disagree|too short")


def test_divergent_transitions(regression):
    """A few in a thousand, as in the neck of a funnel; one or two in thousands are nothing."""
    tree = regression.draws(np.random.default_rng(SEED))
    diverging = np.zeros((CHAINS, DRAWS), bool)
    diverging[0, :2] = True
    tree["sample_stats"] = xr.DataTree(xr.Dataset({"diverging": (("chain", "draw"), diverging)}))
    found = ph.log_evidence_by_bridge(regression.model, tree, random_seed=SEED)
    assert np.isfinite(found.standard_error)
    tree["sample_stats"]["diverging"][1, :7] = True
    doubtful(regression.model, tree, "9 of 2000 transitions diverged")


def test_too_few_draws_for_so_many_correlated_unknowns():
    """A covariance of eighty unknowns is not known from two hundred draws."""
    regression = Regression(80)
    tree = regression.draws(np.random.default_rng(SEED), draws=50)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        found = ph.log_evidence_by_bridge(regression.model, tree, random_seed=SEED)
    error = abs(found.value - regression.log_evidence)
    assert caught or error < STANDARD_ERRORS * found.standard_error
    assert found.standard_error > 0.1


def test_a_posterior_where_proposals_are_impossible():
    """A ridge that hardly any point is on: no proposal meets it, and nothing is known."""
    rng = np.random.default_rng(SEED)
    with pm.Model() as model:
        x = pm.Normal("x", 0, 1, shape=2)
        on_ridge = pt.abs(pt.sum(x**2) - 1) < 1e-9
        pm.Potential("ridge", pt.switch(on_ridge, 0.0, -np.inf))
    angle = rng.uniform(0, 2 * np.pi, (CHAINS, DRAWS))
    tree = as_tree(x=np.stack([np.cos(angle), np.sin(angle)], axis=-1))
    with pytest.warns(UserWarning, match="hardly overlap"):
        found = ph.log_evidence_by_bridge(model, tree, random_seed=SEED)
    assert found.standard_error == np.inf


# --- how draws may come --------------------------------------------------------------------------


def test_one_chain_or_many_thinned_or_in_single_precision(regression):
    """All give the evidence; nothing is asked of a tree but its posterior."""
    rng = np.random.default_rng(SEED)
    for tree in (
        regression.draws(rng, chains=1, draws=1000),
        regression.draws(rng, chains=2),
        regression.draws(rng, chains=20, draws=50),
        regression.draws(rng, draws=3000, phi=0.7).isel(draw=slice(None, None, 5)),
        regression.draws(rng, draws=60),
    ):
        found = ph.log_evidence_by_bridge(regression.model, tree, random_seed=SEED)
        assert_agrees(found, regression.log_evidence, 0.05)
    double = regression.draws(rng)
    single = double.map_over_datasets(lambda group: group.astype("float32"))
    found, other = (
        ph.log_evidence_by_bridge(regression.model, tree, random_seed=SEED)
        for tree in (double, single)
    )
    assert found.value == pytest.approx(other.value, abs=1e-4)


def test_dimensions_in_any_order_and_files(regression, tmp_path):
    """A tree with labelled dimensions, transposed, and back from a file, gives the same."""
    tree = regression.draws(np.random.default_rng(SEED))
    expected = ph.log_evidence_by_bridge(regression.model, tree, random_seed=SEED)
    slope = tree["posterior"]["slope"].rename(slope_0="column")
    other = xr.DataTree.from_dict({"posterior": slope.transpose().to_dataset()})
    other.to_netcdf(tmp_path / "run.nc", engine="h5netcdf")
    for tree in (other, xr.load_datatree(tmp_path / "run.nc", engine="h5netcdf")):
        assert ph.log_evidence_by_bridge(regression.model, tree, random_seed=SEED) == expected


def test_transforms_are_inverted():
    """What a sampler moved is had again from what it stored."""
    with pm.Model() as model:
        positive()
        on_a_simplex()
        pm.LKJCholeskyCov("factor", n=3, eta=2.0, sd_dist=pm.Exponential.dist(1.0))
        pm.LKJCorr("correlation", n=3, eta=2.0)
        pm.ZeroSumNormal("sum", 2.0, shape=(2, 4))
        pm.Normal("up", [0.0, 1.0, 2.0], transform=transforms.ordered, initval=[0, 1, 2])
        y = pm.Normal("bound", 0, 1)
        pm.Uniform("inside", y, y + 1)
    stored = model.replace_rvs_by_values(model.free_RVs)
    constrain = BatchedFunction.of_model(model, stored)
    moved = np.random.default_rng(SEED).normal(size=(20, constrain.dimension))
    draws = {v.name: by_chain(x) for v, x in zip(model.free_RVs, constrain(moved), strict=True)}
    found, _ = unconstrained_draws(model, as_tree(**draws))
    np.testing.assert_allclose(found, by_chain(moved), rtol=ROUNDING, atol=ROUNDING)


def test_agrees_with_sequential_monte_carlo():
    """Two ways that share nothing but the model."""
    with pm.Model() as model:
        mu = pm.Normal("mu", 0, 5)
        sigma = pm.HalfNormal("sigma", 2)
        pm.Normal("y", mu, sigma, observed=[1.2, 0.4, 2.2, 1.9, 0.3])
    tree = ph.sample_smc(model, 500, 4, random_seed=SEED, progressbar=False)
    tempered = ph.log_evidence(tree)
    found = ph.log_evidence_by_bridge(model, tree, random_seed=SEED)
    assert_agrees(found, ph.log_evidence_by_quadrature(model).value, 0.02)
    assert abs(found.value - tempered.value) < STANDARD_ERRORS * tempered.standard_error


def test_draws_at_a_bound_need_the_unconstrained_ones():
    """Rounding took them there; if the unconstrained draws were kept, nothing is lost."""
    with pm.Model() as model:
        pm.Beta("x", 2, 2)
    tree = prior_draws(model)
    logit = np.log(tree["posterior"]["x"] / (1 - tree["posterior"]["x"]))
    tree["posterior"]["x"][1, 7] = 1.0
    tree["posterior"]["x"][2, 3] = 0.0
    with pytest.raises(ValueError, match=r"2 of 2000 draws of 'x', the first of them draw 7 of ch"):
        ph.log_evidence_by_bridge(model, tree)
    tree["unconstrained_posterior"] = xr.DataTree(logit.to_dataset(name="x_logodds__"))
    assert_agrees(ph.log_evidence_by_bridge(model, tree, random_seed=SEED), 0.0, 0.02)


# --- what cannot be -------------------------------------------------------------------------------


def test_other_objects_are_refused(regression):
    """A model, a tree, and what they must hold, by name."""
    tree = regression.draws(np.random.default_rng(SEED))
    with pytest.raises(TypeError, match=r"expected a pm\.Model, not str"):
        ph.log_evidence_by_bridge("model", tree)
    with pytest.raises(TypeError, match=r"expected the DataTree of pm\.sample, .* not Dataset"):
        ph.log_evidence_by_bridge(regression.model, tree["posterior"].to_dataset())
    with pytest.raises(ValueError, match=r"no posterior; its groups are \['prior'\]"):
        ph.log_evidence_by_bridge(
            regression.model, xr.DataTree.from_dict({"prior": tree["posterior"]})
        )
    with pytest.raises(ValueError, match=r"lacks \['slope'\], free variables .* \['slopes'\]"):
        ph.log_evidence_by_bridge(
            regression.model, as_tree(slopes=tree["posterior"]["slope"].values)
        )
    with pytest.raises(
        ValueError, match=r"'slope' has the shape \(4,\) in the posterior and \(5,\) in the"
    ):
        ph.log_evidence_by_bridge(regression.model, tree.isel(slope_0=slice(4)))
    with pytest.raises(ValueError, match=r"'slope' has the dimensions \('draw', 'slope_0'\)"):
        ph.log_evidence_by_bridge(regression.model, tree.isel(chain=0))
    with pytest.raises(ValueError, match="proposal is 'cauchy'; expected one of"):
        ph.log_evidence_by_bridge(regression.model, tree, proposal="cauchy")
    with pytest.raises(ValueError, match="proposal_draws is 10; expected at least 200"):
        ph.log_evidence_by_bridge(regression.model, tree, proposal_draws=10)
    with pytest.raises(TypeError, match="random_seed is 'x'"):
        ph.log_evidence_by_bridge(regression.model, tree, random_seed="x")


def test_discrete_variables_are_refused():
    """There is no density of them, nor is there anything without variables."""
    with pm.Model() as model:
        pm.Poisson("count", 3)
    with pytest.raises(ValueError, match=r"here are discrete: \['count'\]"):
        ph.log_evidence_by_bridge(model, as_tree(count=np.ones((2, 500))))
    with pytest.raises(ValueError, match="here are none"):
        ph.log_evidence_by_bridge(pm.Model(), as_tree(count=np.ones((2, 500))))


def test_draws_that_cannot_be_are_refused(regression):
    """Too few of them, not finite, all the same, or impossible: the first one is named."""
    rng = np.random.default_rng(SEED)
    with pytest.raises(ValueError, match=r"4 chain\(s\) of 10 draws are too few for 5 unknown"):
        ph.log_evidence_by_bridge(regression.model, regression.draws(rng, draws=10))
    with pytest.raises(ValueError, match=r"of 100 draws are too few for 200 .* must be 404 draws"):
        many = Regression(200)
        ph.log_evidence_by_bridge(many.model, many.draws(rng, chains=2, draws=100))
    tree = regression.draws(rng)
    tree["posterior"]["slope"][2, 5, 1] = np.nan
    with pytest.raises(ValueError, match=r"1 of 2000 draws of 'slope', .* draw 5 of chain 2, are"):
        ph.log_evidence_by_bridge(regression.model, tree)
    for chains, stuck in product([1, 2], [slice(None, 250), slice(250, None)]):
        still = regression.draws(rng, chains=chains)
        still["posterior"]["slope"][-1, stuck, 1] = 0.3
        with pytest.raises(ValueError, match=rf"chain {chains - 1} stands .* in \['slope'\], "):
            ph.log_evidence_by_bridge(regression.model, still)
    tree["posterior"]["slope"][..., 1] = 0.3
    with pytest.raises(ValueError, match=r"all draws of \['slope'\] are the same"):
        ph.log_evidence_by_bridge(regression.model, tree)
    with pm.Model() as model:
        x = pm.Normal("x", 0, 1)
        pm.Uniform("y", x, x + 1, observed=0.5)
    tree = as_tree(x=rng.uniform(-0.5, 0.6, (CHAINS, DRAWS)))
    with pytest.raises(
        ValueError, match=r"of 2000 draws, .* density of zero, or none: are these draws of"
    ):
        ph.log_evidence_by_bridge(model, tree)


# --- samplers ------------------------------------------------------------------------------------


@pytest.mark.deep
@pytest.mark.parametrize("sampler", ["pymc", "nutpie"])
def test_eight_schools_by_nuts(sampler):
    """Where the coordinates are good, the evidence is; where NUTS diverges, it is not trusted."""
    settings = {"chains": 4, "random_seed": SEED, "progressbar": False, "nuts_sampler": sampler}
    problem = PROBLEMS["eight_schools_noncentred"]
    model = problem.model()
    with model:
        tree = pm.sample(cores=1, target_accept=0.95, **settings)
    found = ph.log_evidence_by_bridge(model, tree, random_seed=SEED)
    assert_agrees(found, problem.log_evidence(), 0.02)
    model = PROBLEMS["eight_schools"].model()
    with model, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        tree = pm.sample(cores=1, **settings)
    doubtful(model, tree, "transitions diverged|the chains disagree")


@pytest.mark.deep
@pytest.mark.parametrize("sampler", ["nuts", "metropolis", "smc"])
def test_draws_of_pymc(regression, sampler):
    """NUTS, Metropolis and PyMC's own SMC, of the same regression."""
    settings = {"chains": 4, "cores": 1, "random_seed": SEED, "progressbar": False}
    with regression.model, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        if sampler == "nuts":
            tree = pm.sample(**settings)
        elif sampler == "metropolis":
            tree = pm.sample(20000, tune=5000, step=pm.DEMetropolisZ(), **settings)
        else:
            tree = pm.sample_smc(2000, **settings)
    found = ph.log_evidence_by_bridge(regression.model, tree, random_seed=SEED)
    assert_agrees(found, regression.log_evidence, 0.03)
