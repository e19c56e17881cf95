"""Gradients of models, tempering from the prior or a reference, and bridges from particles."""

import numpy as np
import pymc as pm
import pytensor.tensor as pt
import pytest
from agreement import ROUNDING, SEED, Regression, assert_agrees, assert_gradients
from pytensor.compile.ops import wrap_py
from scipy import stats
from scipy.differentiate import jacobian
from scipy.optimize import brentq
from scipy.special import logsumexp
from tiers import deep

import pymc_hyperelastic as ph
from pymc_hyperelastic.evidence.integral import BridgeFromParticles
from pymc_hyperelastic.evidence.mixture import GaussianMixture
from pymc_hyperelastic.evidence.path import GeometricPath, Reference
from pymc_hyperelastic.evidence.search import find_reference
from pymc_hyperelastic.evidence.target import Target
from pymc_hyperelastic.evidence.tempering import Settings, TemperedSMC


@wrap_py([pt.dvector], [pt.dvector])
def doubled(x):
    """Return twice a vector, by an operation without a gradient."""
    return 2 * x


def normal_means(count=6, op=lambda x: 2 * x):
    """Return a model whose likelihood is normal in each unknown, and its log evidence."""
    measured = np.arange(count) / 2
    with pm.Model() as model:
        x = pm.Normal("x", 0, 1, shape=count)
        pm.Normal("y", op(x), 1.0, observed=measured)
    return model, stats.norm(0, np.sqrt(5)).logpdf(measured).sum()


def test_gradients_of_prior_and_likelihood_equal_difference_quotients():
    rng = np.random.default_rng(SEED)
    design = rng.normal(size=(20, 6))
    with pm.Model() as model:
        slope = pm.Normal("slope", 0, 2, shape=6)
        sigma = pm.HalfNormal("sigma", 1)
        pm.Normal("y", design @ slope, sigma, observed=design.sum(axis=1) + rng.normal(size=20))
    target, points = Target(model), rng.normal(0, 0.5, (4, 7))
    assert target.has_gradients and not Target(normal_means(4)[0]).has_gradients
    densities, *found = target.gradients(points)
    np.testing.assert_allclose(densities[:2], target.score(points))
    for part in (0, 1):

        def height(columns, part=part):
            return target.score(columns.reshape(7, -1).T)[part].reshape(columns.shape[1:])

        expected = [jacobian(height, point).df for point in points]
        np.testing.assert_allclose(found[part], expected, rtol=1e-5, atol=1e-5)
    value, gradient, _ = target.derivatives(points, np.ones(7))
    np.testing.assert_allclose(value, sum(densities[:2]))
    np.testing.assert_allclose(gradient, sum(found))


def test_reference_mixes_the_prior_and_a_mixture_in_given_shares():
    """Its density, gradient and draws; the mixture is far from the prior."""
    mixture = GaussianMixture(
        np.log([0.3, 0.7]),
        np.array([[20.0, 1.0], [22.0, -1.0]]),
        np.array([[[1.0, 0.0], [0.5, 0.3]], [[0.2, 0.0], [-0.4, 0.7]]]),
        4.0,
    )
    prior, reference = stats.norm(0, 3), Reference(mixture, 0.2)

    def log_density(points):
        return reference.log_density(points, prior.logpdf(points).sum(axis=1))

    points = np.random.default_rng(SEED).normal(5, 5, (5, 2))
    log_prior = prior.logpdf(points).sum(axis=1)
    expected = np.logaddexp(np.log(0.2) + log_prior, np.log(0.8) + mixture.log_density(points))
    np.testing.assert_allclose(log_density(points), expected)
    value, gradient = reference.gradient(points, log_prior, -points / 9)
    np.testing.assert_allclose(value, expected)
    assert_gradients(gradient, log_density, points)
    drawn = reference.draw(lambda n, rng: np.zeros((n, 2)), 50, np.random.default_rng(SEED))
    assert np.sum(drawn[:, 0] == 0) == 10


def test_first_tempering_step_follows_from_the_particle_weights():
    """Temperature, evidence and variance of independent particles follow from their weights."""
    model, _ = normal_means(3)
    target, rng = Target(model), np.random.default_rng(SEED)
    particles = target.draw_prior(400, rng)
    tempering = TemperedSMC(GeometricPath(target), particles, rng, Settings(threshold=0.6))
    _, log_likelihood = target.score(particles)

    def effective(beta):
        weights = np.exp(beta * (log_likelihood - log_likelihood.max()))
        return weights.sum() ** 2 / np.sum(weights**2)

    tempering.reweight()
    exact = brentq(lambda beta: effective(beta) - 0.6 * 400, 1e-6, 1)
    assert tempering.beta == pytest.approx(exact, rel=0.01)
    log_weights = tempering.beta * log_likelihood
    log_mean = logsumexp(log_weights) - np.log(400)
    assert tempering.log_evidence == pytest.approx(log_mean, rel=ROUNDING)
    relative = np.exp(log_weights - log_mean)
    assert tempering.variance == pytest.approx(np.sum((relative - 1) ** 2) / 400**2, rel=1e-9)
    assert tempering.effective_sample_size == pytest.approx(effective(tempering.beta))
    tempering.resample()
    counts = np.bincount(tempering.eve, minlength=400)
    assert np.all(np.abs(counts - relative) < 1) and tempering.ancestors == np.sum(counts > 0)


@pytest.mark.parametrize("dimension", [2, 8])
def test_moves_keep_particles_distributed_as_the_posterior(dimension):
    """Random walks in few unknowns, Hamiltonian moves in more; step lengths are adapted."""
    model, _ = normal_means(dimension)
    rng = np.random.default_rng(SEED)
    mean, sd = 2 * np.arange(dimension) / 2 / 5, np.sqrt(1 / 5)
    start = mean + sd * rng.standard_normal((500, dimension))
    tempering = TemperedSMC(GeometricPath(Target(model)), start, rng, beta=1.0)
    tempering.local_move._length *= 20 if dimension < 5 else 5
    for _ in range(8):
        tempering.stay()
    assert 0.3 < tempering.acceptance < 0.95
    assert tempering.capped == 0
    draws, log_density = tempering.trajectories
    assert draws.shape == (500, tempering.moves, dimension)
    np.testing.assert_allclose(log_density[:, 0], sum(Target(model).score(draws[:, 0])))
    last = draws[:, -1]
    assert np.all(np.abs(last.mean(axis=0) - mean) < 4 * sd / np.sqrt(500))
    # The relative standard error of an sd is 1/sqrt(1000).
    np.testing.assert_allclose(last.std(axis=0), sd, rtol=4 / np.sqrt(1000))


def test_after_the_limit_of_capped_stages_particles_move_once_per_stage():
    model, _ = normal_means(3)
    target, rng = Target(model), np.random.default_rng(SEED)
    particles, moves = target.draw_prior(100, rng), []
    hasty = TemperedSMC(GeometricPath(target), particles, rng, Settings(forget=1e-9, most_capped=1))
    while hasty.beta < 1:
        for step in (hasty.reweight, hasty.resample, hasty.adapt, hasty.move):
            step()
        moves.append(hasty.moves)
    assert hasty.capped == hasty.stages > 1 and np.isinf(hasty.variance)
    assert moves == [50] + [1] * (hasty.stages - 1)
    assert np.isfinite(TemperedSMC(GeometricPath(target), particles, rng).run().variance)


def test_path_counts_nan_scores():
    with pm.Model() as model:
        x = pm.Normal("x", 0, 1, shape=5)
        pm.Potential("p", pt.sqrt(x[0]) - pt.sum(x**2))
    path = GeometricPath(Target(model))
    points = np.random.default_rng(SEED).standard_normal((50, 5))
    path.at(points)
    assert path.nan_count == np.sum(points[:, 0] < 0)


def test_model_without_gradients_is_sampled():
    model, exact = normal_means(5, doubled)
    assert not Target(model).has_gradients
    tree = ph.sample_smc(model, 300, 1, random_seed=SEED, progressbar=False)
    assert_agrees(ph.log_evidence(tree), exact, 0.1)


def test_search_with_an_expensive_density_still_finds_the_mode():
    class Costly(Target):
        def cost(self):
            return 10**9

    model, exact = normal_means(1)
    found = find_reference(Costly(model), np.random.default_rng(SEED))
    np.testing.assert_allclose(found.evidence["log_masses"], [exact], atol=0.01)


def test_bridge_from_tempered_particles_gives_the_exact_evidence():
    """Each call moves the particles further, and returns as many draws as it is asked for."""
    model, exact = normal_means(30)
    rng = np.random.default_rng(1)
    bridge = BridgeFromParticles(Target(model), rng)
    sizes = 1000, 6000
    found = [bridge.integral(size, rng) for size in sizes]
    for size, integral in zip(sizes, found, strict=True):
        assert len(integral.particles) == size
        assert_agrees(integral.log_value, exact, 0.1)
    assert found[0].log_value != found[1].log_value


@pytest.mark.parametrize("factor", [1.5, *deep([1.0, -1.0])])
def test_guide_with_wrong_gradients_still_gives_the_exact_distribution(factor):
    """The gradients of the guide are too steep or have the opposite sign."""

    class Wrong(Target):
        def gradients(self, points):
            densities, *gradients = super().gradients(points)
            return densities, *(factor * values for values in gradients)

    problem, rng = Regression(40), np.random.default_rng(2)
    model = problem.model
    found = BridgeFromParticles(Target(model), rng, guide=Wrong(model)).integral(2000, rng)
    value, error = found.log_value
    assert abs(value - problem.log_evidence) < 4 * error
    if factor > 0:
        assert error < 0.1
        off = np.abs(found.particles.mean(axis=0) - problem.mean)
        np.testing.assert_array_less(off, 0.2 * problem.sd)
        # The relative standard error is 1.6 % for independent particles; these are correlated.
        assert found.particles.std(axis=0) == pytest.approx(problem.sd, rel=0.12)
