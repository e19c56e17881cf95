"""Batched SMC on models that have nothing to do with tubes, against evidences in closed form."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pymc as pm
import pytensor.tensor as pt
import pytest
import xarray as xr
from scipy import integrate, stats
from scipy.special import gammaln, logsumexp

import pymc_hyperelastic as ph
from pymc_hyperelastic.smc import combine_chains

SEED = 20250
# Tests of one estimate with a fixed seed: an honest error bar is exceeded three times over once in
# 370 runs.
STANDARD_ERRORS = 3
# A chain of a thousand particles resolves means and sds to a thirtieth of an sd; resampled
# particles are worth less.
PARTICLE_TOLERANCE = 0.15
# A test of honesty fails for this fraction of honest kernels, on either side.
SIGNIFICANCE = 0.001


# --- models with known evidence ------------------------------------------------------------------


@dataclass(frozen=True)
class Problem:
    """A model, its exact log evidence, and exact posterior means and sds of its variable."""

    build: Callable[[], pm.Model]
    log_evidence: float
    variable: str
    mean: np.ndarray
    sd: np.ndarray


def gaussian(dimension: int) -> Problem:
    """Normal prior and normal measurements, one of each variable, of rising precision."""
    noise = np.linspace(0.1, 1.0, dimension)
    measured = np.linspace(-2.0, 2.0, dimension) if dimension > 1 else np.array([1.5])

    def build():
        with pm.Model() as model:
            x = pm.Normal("x", 0, 1, shape=dimension)
            pm.Normal("y", x, noise, observed=measured)
        return model

    shrink = 1 / (1 + noise**2)
    evidence = stats.norm.logpdf(measured, 0, np.sqrt(1 + noise**2)).sum()
    return Problem(build, evidence, "x", shrink * measured, noise * np.sqrt(shrink))


def two_modes() -> Problem:
    """Two narrow peaks in the plane, of unequal weight and width, far apart in a wide prior."""
    weight = np.array([0.3, 0.7])
    centre = np.array([[-6.0, 2.0], [4.0, -3.0]])
    width, prior = np.array([0.3, 0.15]), 10.0

    def build():
        with pm.Model() as model:
            x = pm.Normal("x", 0, prior, shape=2)
            peaks = [
                np.log(w) + pm.logp(pm.Normal.dist(c, s), x).sum()
                for w, c, s in zip(weight, centre, width, strict=True)
            ]
            pm.Potential("peaks", pt.logsumexp(pt.stack(peaks)))
        return model

    # The prior narrows each peak and draws it to the middle.
    total = np.sqrt(prior**2 + width**2)[:, None]
    parts = np.log(weight) + stats.norm.logpdf(centre, 0, total).sum(axis=1)
    evidence = logsumexp(parts)
    share = np.exp(parts - evidence)[:, None]
    mean = centre * (prior / total) ** 2
    variance = (width[:, None] * prior / total) ** 2
    average = (share * mean).sum(axis=0)
    sd = np.sqrt((share * (variance + (mean - average) ** 2)).sum(axis=0))
    return Problem(build, float(evidence), "x", average, sd)


def regression() -> Problem:
    """Bayesian linear regression with observed variables and correlated coefficients."""
    rng = np.random.default_rng(3)
    design = np.column_stack([np.ones(30), rng.uniform(2, 4, (30, 2))])
    noise, prior = 0.5, np.array([10.0, 2.0, 2.0])
    response = design @ [1.0, -0.7, 1.2] + noise * rng.standard_normal(30)

    def build():
        with pm.Model() as model:
            intercept = pm.Normal("intercept", 0, prior[0])
            slope = pm.Normal("slope", 0, prior[1:], shape=2)
            pm.Normal("y", intercept + design[:, 1:] @ slope, noise, observed=response)
        return model

    precision = np.diag(prior**-2) + design.T @ design / noise**2
    mean = np.linalg.solve(precision, design.T @ response / noise**2)
    sd = np.sqrt(np.diag(np.linalg.inv(precision)))
    covariance = noise**2 * np.eye(30) + (design * prior**2) @ design.T
    evidence = stats.multivariate_normal.logpdf(response, np.zeros(30), covariance)
    return Problem(build, float(evidence), "slope", mean[1:], sd[1:])


def simplex() -> Problem:
    """Dirichlet prior of probabilities, counted: a variable that is transformed to fewer."""
    prior, counts = np.array([1.0, 2.0, 3.0, 0.5]), np.array([12, 3, 30, 1])

    def build():
        with pm.Model() as model:
            p = pm.Dirichlet("p", prior)
            pm.Multinomial("counted", counts.sum(), p, observed=counts)
        return model

    after = prior + counts
    total = after.sum()
    return Problem(
        build,
        float(stats.dirichlet_multinomial.logpmf(counts, prior, counts.sum())),
        "p",
        after / total,
        np.sqrt(after * (total - after) / total**2 / (total + 1)),
    )


def poisson() -> Problem:
    """Gamma prior of a matrix of rates, each counted twice: a positive variable of two axes."""
    shape, rate = 2.0, 0.5
    counts = np.array([[[3, 0, 12], [7, 1, 2]], [[4, 1, 9], [5, 2, 2]]])

    def build():
        with pm.Model() as model:
            x = pm.Gamma("x", shape, rate, shape=counts.shape[1:])
            pm.Poisson("counted", x, observed=counts)
        return model

    total = shape + counts.sum(axis=0)
    evidence = shape * np.log(rate) - gammaln(shape) + gammaln(total) - total * np.log(rate + 2)
    evidence = evidence.sum() - gammaln(counts + 1).sum()
    return Problem(build, float(evidence), "x", total / (rate + 2), np.sqrt(total) / (rate + 2))


PROBLEMS = {
    "Gaussian in 1 dimension": gaussian(1),
    "Gaussian in 5 dimensions": gaussian(5),
    "Gaussian in 20 dimensions": gaussian(20),
    "two modes": two_modes(),
    "regression": regression(),
    "simplex": simplex(),
    "Poisson rates": poisson(),
}


@pytest.mark.parametrize("name", PROBLEMS)
def test_evidence_and_posterior_are_the_exact_ones(name):
    """Known evidences, means and sds of models with vectors, matrices, simplices and two modes."""
    problem = PROBLEMS[name]
    tree = ph.sample_smc(problem.build(), 1000, 4, random_seed=SEED, progressbar=False)
    value, error = ph.log_evidence(tree)
    assert abs(value - problem.log_evidence) < STANDARD_ERRORS * error
    assert error < 0.2
    particles = tree["posterior"][problem.variable].values
    assert particles.shape == (4, 1000, *problem.mean.shape)
    mean, sd = particles.mean(axis=(0, 1)), particles.std(axis=(0, 1))
    np.testing.assert_array_less(np.abs(mean - problem.mean), PARTICLE_TOLERANCE * problem.sd)
    np.testing.assert_array_less(np.abs(sd / problem.sd - 1), PARTICLE_TOLERANCE)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["Gaussian in 5 dimensions", "two modes", "regression"])
def test_error_bars_are_honest(name):
    """Over twenty seeds the evidence lies within one and two standard errors as often as it says.

    Failing means that an honest kernel had a chance of one in a thousand, by the binomial
    distribution of the coverage and the chi-squared distribution of the squared errors.
    """
    problem, seeds = PROBLEMS[name], 20
    model = problem.build()
    errors = []
    for seed in range(seeds):
        value, error = ph.log_evidence(
            ph.sample_smc(model, 500, 2, random_seed=seed, progressbar=False)
        )
        errors.append((value - problem.log_evidence) / error)
    errors = np.abs(errors)
    for width in (1, 2):
        expected = stats.chi2.cdf(width**2, 1)
        assert np.sum(errors < width) >= stats.binom.ppf(SIGNIFICANCE, seeds, expected)
    # The larger of two estimates is reported: it may be too large by a half, not by more.
    low, high = np.sqrt(stats.chi2.ppf([SIGNIFICANCE, 1 - SIGNIFICANCE], seeds) / seeds)
    assert low / 1.5 < np.sqrt(np.mean(errors**2)) < high


def test_both_modes_have_their_share():
    """Particles divide between far peaks in proportion to what each holds of the evidence."""
    tree = ph.sample_smc(two_modes().build(), 2000, 4, random_seed=SEED, progressbar=False)
    total = np.hypot(10, [0.3, 0.15])
    parts = [0.3, 0.7] * np.prod(stats.norm.pdf([[-6, 2], [4, -3]], 0, total[:, None]), axis=1)
    share = float((tree["posterior"]["x"][..., 0] < 0).mean())
    assert abs(share - parts[0] / parts.sum()) < 0.05


def test_kernel_runs_in_pymc_sample_smc():
    """PyMC's own driver takes the kernel, and reports the same kind of evidence."""
    problem = regression()
    with problem.build():
        tree = pm.sample_smc(
            1000,
            kernel=ph.BatchedSMC,
            chains=2,
            cores=1,
            random_seed=SEED,
            progressbar=False,
            threshold=0.6,
        )
    final = np.array(
        [
            np.asarray(chain, float)[np.isfinite(np.asarray(chain, float))][-1]
            for chain in tree["sample_stats"]["log_marginal_likelihood"].values
        ]
    )
    variance = [
        np.asarray(chain, float)[np.isfinite(np.asarray(chain, float))][-1]
        for chain in tree["sample_stats"]["log_evidence_variance"].values
    ]
    value, error = combine_chains(final, np.sqrt(variance))
    assert abs(value - problem.log_evidence) < STANDARD_ERRORS * error
    mean = tree["posterior"]["slope"].mean(("chain", "draw")).values
    np.testing.assert_array_less(np.abs(mean - problem.mean), PARTICLE_TOLERANCE * problem.sd)


# --- what a run returns --------------------------------------------------------------------------


@pytest.fixture(scope="module")
def model():
    return regression().build()


@pytest.fixture(scope="module")
def tree(model):
    return ph.sample_smc(model, 300, 3, random_seed=SEED, progressbar=False)


def test_one_seed_gives_one_result(model, tree):
    """The same seed gives the same particles, another seed others, no seed a seed to write down."""
    again = ph.sample_smc(model, 300, 3, random_seed=SEED, progressbar=False)
    xr.testing.assert_equal(again["posterior"].to_dataset(), tree["posterior"].to_dataset())
    assert ph.log_evidence(again) == ph.log_evidence(tree)
    other = ph.sample_smc(model, 300, 3, random_seed=SEED + 1, progressbar=False)
    assert ph.log_evidence(other) != ph.log_evidence(tree)
    unseeded = ph.sample_smc(model, 100, 1, progressbar=False)
    seed = int(unseeded.attrs["random_seed"])
    repeated = ph.sample_smc(model, 100, 1, random_seed=seed, progressbar=False)
    assert ph.log_evidence(repeated) == ph.log_evidence(unseeded)


def test_chains_are_independent(tree):
    """No two chains share particles, whatever the single seed."""
    slope = tree["posterior"]["slope"].values
    for i in range(3):
        for j in range(i):
            assert not np.any(np.isin(slope[i], slope[j]))


def test_stages_are_rectangular_and_padded_with_nan(tree):
    """Every statistic is (chain, stage); temperatures of a chain rise to 1, then NaN follows."""
    stats_ = tree["sample_stats"].to_dataset()
    assert {v.dims for v in stats_.data_vars.values()} == {("chain", "stage")}
    for beta in stats_["beta"].values:
        known = beta[np.isfinite(beta)]
        assert known[-1] == 1 and np.all(np.diff(known) > 0) and known[0] > 0
        assert np.isfinite(beta[: len(known)]).all()
    final = [row[np.isfinite(row)][-1] for row in stats_["log_marginal_likelihood"].values]
    np.testing.assert_array_equal(tree["evidence"]["log_evidence"].values, final)


def test_unconstrained_particles_are_stored_beside_the_posterior():
    """Positive variables are stored twice: as they are, and as the logarithms that were moved."""
    tree = ph.sample_smc(poisson().build(), 100, 2, random_seed=SEED, progressbar=False)
    np.testing.assert_allclose(
        np.log(tree["posterior"]["x"].values), tree["unconstrained_posterior"]["x_log__"].values
    )


def test_netcdf_round_trip(tree, tmp_path):
    """A result is saved and read without loss, padded stages included."""
    tree.to_netcdf(tmp_path / "run.nc", engine="h5netcdf")
    loaded = xr.load_datatree(tmp_path / "run.nc", engine="h5netcdf")
    for group in tree.children:
        xr.testing.assert_equal(loaded[group].to_dataset(), tree[group].to_dataset())
    assert ph.log_evidence(loaded) == ph.log_evidence(tree)
    assert loaded.attrs == tree.attrs


def test_only_wanted_variables_are_kept(model):
    """`var_names` chooses the posterior's variables, and unknown ones are named."""
    tree = ph.sample_smc(model, 50, 1, random_seed=SEED, progressbar=False, var_names=["intercept"])
    assert list(tree["posterior"].data_vars) == ["intercept"]
    with pytest.raises(ValueError, match="no variables \\['curvature'\\]"):
        ph.sample_smc(model, 50, 1, random_seed=SEED, progressbar=False, var_names=["curvature"])


def interrupt_at(monkeypatch, call):
    """Make the kernel's n-th stage of moves meet Ctrl-C."""
    mutate, calls = ph.BatchedSMC.mutate, []

    def interrupted(self):
        calls.append(1)
        if len(calls) == call:
            raise KeyboardInterrupt
        mutate(self)

    monkeypatch.setattr(ph.BatchedSMC, "mutate", interrupted)


def test_interrupt_keeps_complete_chains(model, tree, monkeypatch):
    """Ctrl-C in the second chain leaves the first one as it would have been."""
    stages = int(np.isfinite(tree["sample_stats"]["beta"].values[0]).sum())
    interrupt_at(monkeypatch, stages + 2)
    with pytest.warns(UserWarning, match="1 of 3 chains are complete"):
        kept = ph.sample_smc(model, 300, 3, random_seed=SEED, progressbar=False)
    np.testing.assert_array_equal(kept["posterior"]["slope"], tree["posterior"]["slope"][:1])
    assert kept["evidence"].sizes["chain"] == 1
    assert np.isfinite(ph.log_evidence(kept)).all()


def test_interrupt_before_any_chain_is_complete_is_an_interrupt(model, monkeypatch):
    """There is nothing to return yet."""
    interrupt_at(monkeypatch, 2)
    with pytest.raises(KeyboardInterrupt):
        ph.sample_smc(model, 300, 3, random_seed=SEED, progressbar=False)


# --- what is refused, and what is counted --------------------------------------------------------


def test_nan_scores_count_as_impossible_and_are_reported():
    """A likelihood that is NaN on half the prior gives the evidence of the other half."""
    with pm.Model() as model:
        x = pm.Normal("x", 0, 1)
        pm.Potential("root", -25 * (pt.sqrt(x) - 1) ** 2)
    exact, _ = integrate.quad(
        lambda x: stats.norm.pdf(x) * np.exp(-25 * (np.sqrt(x) - 1) ** 2), 0, 10, points=[1]
    )
    tree = ph.sample_smc(model, 1000, 4, random_seed=SEED, progressbar=False)
    value, error = ph.log_evidence(tree)
    assert abs(value - np.log(exact)) < STANDARD_ERRORS * error
    assert np.all(tree["posterior"]["x"] > 0)
    assert tree["sample_stats"]["nan_scores"].sum() > 0
    assert np.all(np.isfinite(tree["posterior"]["x"]))


def no_variables():
    with pm.Model() as model:
        pm.Potential("p", pt.constant(1.0))
    return model


def discrete():
    with pm.Model() as model:
        k = pm.Poisson("k", 3)
        pm.Normal("y", k, 1, observed=2.0)
    return model


def no_likelihood():
    with pm.Model() as model:
        pm.Normal("x", 0, 1)
    return model


def impossible():
    with pm.Model() as model:
        x = pm.Normal("x", 0, 1)
        pm.Potential("p", pt.where(x > 1e6, 0.0, -np.inf))
    return model


@pytest.mark.parametrize(
    ("build", "message"),
    [
        (no_variables, "continuous free variables; here are none"),
        (discrete, r"discrete: \['k'\]"),
        (no_likelihood, "nothing to temper"),
        (impossible, "none of the 100 initial particles has a finite likelihood"),
    ],
)
def test_models_that_cannot_be_sampled_say_why(build, message):
    """One error each, which names what is wrong with the model."""
    with pytest.raises(ValueError, match=message):
        ph.sample_smc(build(), 100, 1, random_seed=SEED, progressbar=False)


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"threshold": 1.5}, "threshold.* between 0 and 1"),
        ({"tempered": ["z"]}, r"\['y'\], not \['z'\]"),
    ],
)
def test_impossible_settings_say_why(model, settings, message):
    """One error each, which names the setting."""
    with pytest.raises(ValueError, match=message):
        ph.sample_smc(model, 100, 1, random_seed=SEED, progressbar=False, **settings)


def test_only_tempered_terms_enter_the_evidence():
    """Terms that are not tempered count as prior, from whose posterior the particles start.

    The evidence is then that of both terms over that of the untempered one.
    """
    noise, first, second = 0.5, 0.8, -0.4
    with pm.Model() as model:
        x = pm.Normal("x", 0, 1)
        pm.Normal("first", x, noise, observed=first)
        pm.Normal("second", x, noise, observed=second)
    variance = 1 / (1 + noise**-2)
    mean = variance * first / noise**2
    rng = np.random.default_rng(SEED)
    start = [{"x": rng.normal(mean, np.sqrt(variance), 2000)} for _ in range(2)]
    tree = ph.sample_smc(
        model, 2000, 2, random_seed=SEED, progressbar=False, start=start, tempered=["second"]
    )
    exact = stats.norm.logpdf(second, mean, np.sqrt(variance + noise**2))
    value, error = ph.log_evidence(tree)
    assert abs(value - exact) < STANDARD_ERRORS * error


def test_log_evidence_needs_a_result_with_one(tree):
    """Any other tree is refused, with the names of the groups that it does have."""
    with pytest.raises(ValueError, match=r"no evidence; its groups are \['posterior'\]"):
        ph.log_evidence(xr.DataTree.from_dict({"posterior": tree["posterior"].to_dataset()}))


def test_chains_are_averaged_as_evidences():
    """The mean is of evidences, not of their logarithms; the error is the larger of two."""
    evidences = np.log([1.0, 3.0])
    value, error = combine_chains(evidences, np.array([0.01, 0.01]))
    assert value == pytest.approx(np.log(2.0))
    assert error == pytest.approx(np.std([0.5, 1.5], ddof=1) / np.sqrt(2))
    value, error = combine_chains(evidences[:1], np.array([0.3]))
    assert (value, error) == (0.0, pytest.approx(0.3))
