"""Priors and densities for which a sampler can be wrong without a warning."""

import numpy as np
import pymc as pm
import pytensor.tensor as pt
import pytest
from difficult_evidences import DIFFICULT
from scipy import stats
from scipy.special import betaln, i0

import pymc_hyperelastic as ph
from pymc_hyperelastic.evidence.batched import prior_sampler

SEED, STANDARD_ERRORS = 1, 4


def sampled(model):
    return ph.sample_smc(model, 500, 2, random_seed=SEED, progressbar=False)


def assert_right(model, exact):
    found = ph.log_evidence(sampled(model))
    assert abs(found.value - exact) < STANDARD_ERRORS * found.standard_error < 0.2


def test_mode_in_a_half_of_the_prior_with_only_poor_draws_is_found():
    """An instrument works, with small noise, or fails: half of the prior has nearly all mass."""
    rng, size, noise = np.random.default_rng(4), 5, 0.1
    design = rng.normal(size=(12, size))
    y = design @ np.full(size, 0.8) + noise * rng.normal(size=12)
    with pm.Model() as model:
        works, slopes = pm.Normal("works") > 0, pm.Normal("slopes", shape=size)
        mean = pt.switch(works, pt.dot(design, slopes), 0.0)
        pm.Normal("y", mean, pt.switch(works, noise, 1.5), observed=y)
    covariance = design @ design.T + noise**2 * np.eye(12)
    alive = stats.multivariate_normal(np.zeros(12), covariance).logpdf(y)
    dead = stats.norm.logpdf(y, 0, 1.5).sum()
    assert_right(model, np.log(0.5) + np.logaddexp(alive, dead))


@pytest.mark.parametrize("place", [0.5, 3.0])
def test_evidence_of_an_angle_counts_its_period_once(place):
    """The density is that of von Mises, also where its mode is beside the end of the period."""
    with pm.Model() as model:
        angle = pm.VonMises("angle", 0.0, 1e-9)
        pm.Potential("likelihood", 20 * pt.cos(angle - place))
    exact = np.log(i0(20))
    assert_right(model, exact)
    assert ph.log_evidence_by_quadrature(model).value == pytest.approx(exact, abs=1e-6)


def test_prior_draws_of_a_custom_distribution_are_independent():
    def draw(width, rng=None, size=None):
        return width * rng.uniform(-1, 1, size=size)

    def logp(value, width):
        return pt.switch(pt.abs(value) < width, -pt.log(2 * width), -np.inf)

    with pm.Model() as model:
        pm.CustomDist("x", 4.0, logp=logp, random=draw)
    draws = prior_sampler(model)(200, np.random.default_rng(SEED))["x"]
    assert len(np.unique(draws)) == 200 and stats.kstest(draws / 8 + 0.5, "uniform").pvalue > 1e-3


@pytest.mark.parametrize(
    ("shapes", "successes", "sound"),
    [((0.01, 1.0), 5, True), ((0.1, 0.1), 5, True), ((0.001, 0.001), 5, False)],
)
@pytest.mark.filterwarnings("ignore:the evidence is not to be trusted")
def test_posterior_mass_rounded_to_a_bound_increases_the_evidence_error(shapes, successes, sound):
    """A probability is rounded to 0 or 1 where its logit is still far from its largest value."""
    with pm.Model() as model:
        pm.Binomial("y", 5, pm.Beta("p", *shapes), observed=successes)
    tree = sampled(model)
    found = ph.log_evidence(tree)
    exact = betaln(shapes[0] + successes, shapes[1] + 5 - successes) - betaln(*shapes)
    assert abs(found.value - exact) < STANDARD_ERRORS * found.standard_error
    assert np.isfinite(found.standard_error) == sound
    assert sound or "rounded to a bound" in tree["diagnosis"].attrs["words"]


def test_dirichlet_draws_rounded_to_zero_have_finite_unconstrained_values():
    """In half of the draws two of the shares are smaller than the smallest float."""
    alpha, counts = np.full(4, 0.01), np.array([7, 0, 3, 0])
    with pm.Model() as model:
        pm.Multinomial("y", n=10, p=pm.Dirichlet("share", alpha), observed=counts)
    draws = prior_sampler(model)(1000, np.random.default_rng(SEED))["share_simplex__"]
    assert np.isfinite(draws).all()


@pytest.mark.filterwarnings("ignore:the evidence is not to be trusted")
def test_chain_whose_particles_hardly_move_ends_early_and_is_not_trusted():
    """In six stages particles may stop before their correlation with the start is small."""
    with pm.Model() as model:
        x = pm.Normal("x", 0, 1, shape=3)
        pm.Normal("y", x, 0.01, observed=np.ones(3))
    settings = {"forget": 1e-9, "max_moves": 4, "from_modes": False}
    tree = ph.sample_smc(model, 200, 1, random_seed=SEED, progressbar=False, **settings)
    moves = tree["sample_stats"]["moves"].values[0]
    assert len(moves) > 6 and np.all(moves[:6] == 4) and np.all(moves[6:] == 1)
    assert np.isinf(ph.log_evidence(tree).standard_error)
    assert "only once per stage" in tree["diagnosis"].attrs["words"]


@pytest.mark.deep
@pytest.mark.filterwarnings("ignore:the evidence is")
def test_modes_missed_by_the_search_are_reported():
    """Three change points in any order have six equal modes, which optimisation does not find."""
    tree = ph.sample_smc(
        DIFFICULT["great effort"]["change_points_3"].model(), 500, 2, random_seed=SEED
    )
    assert float(tree["evidence"]["unmet"]) > 0.1
    assert "mode may be missing" in tree["diagnosis"].attrs["words"]


def test_posterior_far_from_the_prior_is_reported_and_found_from_its_mode():
    """The posterior is a thousand standard deviations away from the prior."""
    with pm.Model() as model:
        x = pm.Normal("x", 0.0, 1.0)
        pm.Normal("y", x, 1.0, observed=2000.0)
    with pytest.warns(UserWarning, match="far from the prior.* does a prior contradict the data"):
        tree = sampled(model)
    found, exact = ph.log_evidence(tree), stats.norm(0, np.sqrt(2)).logpdf(2000.0)
    assert abs(found.value - exact) < STANDARD_ERRORS * found.standard_error < 0.2
    # The posterior is N(1000, 1/2), known from 1000 nearly independent particles.
    error = STANDARD_ERRORS * np.sqrt(0.5 / 1000)
    assert tree["posterior"]["x"].mean() == pytest.approx(1000.0, abs=error, rel=0)
    assert tree["diagnosis"]["verdict"].sel(check="prior's side") == "doubtful"
