"""Functions of a model for many points at once: equal to SciPy at each point, without a loop."""

import numpy as np
import pymc as pm
import pytensor
import pytensor.tensor as pt
import pytest
from agreement import ROUNDING
from pytensor.tensor.blockwise import Blockwise
from pytensor.tensor.elemwise import Elemwise
from pytensor.tensor.special import xlogy
from scipy import linalg, special, stats

import pymc_hyperelastic as ph
from pymc_hyperelastic.evidence import batched
from pymc_hyperelastic.evidence.batched import BatchedFunction, unconstrain
from pymc_hyperelastic.evidence.integral import integrate
from pymc_hyperelastic.evidence.target import Target

SEED = 911
POINTS = np.random.default_rng(SEED).standard_normal((50, 4))


def covariance(xp, x):
    """Return a matrix that has a Cholesky factor for most points."""
    return xp.outer(x, x) + xp.diag(xp.exp(x)) + 0.5 * x[0] * np.ones((4, 4))


def factor(x):
    return pt.linalg.cholesky(covariance(pt, pt.abs(x)))


def factor_by_scipy(x):
    return linalg.cholesky(covariance(np, np.abs(x)), lower=True)


def factor_or_nan(x):
    try:
        return linalg.cholesky(covariance(np, x), lower=True)
    except linalg.LinAlgError:
        return np.full((4, 4), np.nan)


def clipped(x, low, high):
    """Clip as PyTensor does: if the bounds are in the wrong order, the lower one counts first."""
    return np.where(x < low, low, np.where(x > high, high, x))


CASES = {
    "logsumexp of rows": (
        lambda x: pt.logsumexp(pt.outer(x, x), axis=-1),
        lambda x: special.logsumexp(np.outer(x, x), axis=-1),
    ),
    "logsumexp of -inf": (lambda x: pt.logsumexp(pt.where(x < 9.0, -np.inf, x)), lambda x: -np.inf),
    "logaddexp": (lambda x: pt.logaddexp(x, -x[::-1]), lambda x: np.logaddexp(x, -x[::-1])),
    "product with the logarithm of zero": (
        lambda x: xlogy(pt.maximum(x, 0.0), pt.maximum(x, 0.0)),
        lambda x: special.xlogy(np.maximum(x, 0.0), np.maximum(x, 0.0)),
    ),
    "bounds": (lambda x: pt.clip(x, -0.5, x[0]), lambda x: clipped(x, -0.5, x[0])),
    "infinite bound": (lambda x: pt.clip(x, 0.0, np.inf), lambda x: clipped(x, 0.0, np.inf)),
    "softplus": (pt.softplus, lambda x: np.logaddexp(0.0, x)),
    "sum of many": (
        lambda x: pt.exp(x) + x[0] + x**2 + x[::-1],
        lambda x: np.exp(x) + x[0] + x**2 + x[::-1],
    ),
    "gradient of parts": (
        lambda x: pt.grad(pt.exp(pt.concatenate([x[:1] * x[1:2], x[2:]])).sum(), x),
        lambda x: np.exp([x[0] * x[1], x[0] * x[1], x[2], x[3]]) * [x[1], x[0], 1, 1],
    ),
    "eigenvalues": (
        lambda x: pt.linalg.eigh(covariance(pt, x))[0],
        lambda x: np.linalg.eigvalsh(covariance(np, x)),
    ),
    "Cholesky factor": (factor, factor_by_scipy),
    "factor that may not exist": (lambda x: pt.linalg.cholesky(covariance(pt, x)), factor_or_nan),
    "lower triangle and matrix": (
        lambda x: pt.linalg.solve_triangular(factor(x), pt.outer(x, x), lower=True, b_ndim=2),
        lambda x: linalg.solve_triangular(factor_by_scipy(x), np.outer(x, x), lower=True),
    ),
    "upper triangle and vector": (
        lambda x: pt.linalg.solve_triangular(factor(x).T, x, lower=False, b_ndim=1),
        lambda x: linalg.solve_triangular(factor_by_scipy(x).T, x, lower=False),
    ),
}


def assert_no_loop(batched):
    """No node of the compiled function calls another one for each point in Python."""
    for node in batched.function.maker.fgraph.apply_nodes:
        assert not isinstance(node.op, Blockwise), node
        assert not (isinstance(node.op, Elemwise) and node.op.nfunc_spec is None), node


@pytest.mark.parametrize("case", CASES)
def test_batched_function_equals_scipy_at_each_point(case):
    with pm.Model() as model:
        pm.Flat("x", shape=4)
    expression, expected = CASES[case]
    batched = BatchedFunction.of_model(model, [expression(*model.value_vars)])
    assert_no_loop(batched)
    (values,) = batched(POINTS)
    each = np.array([expected(point) for point in POINTS])
    np.testing.assert_allclose(values, each, rtol=ROUNDING, atol=ROUNDING)
    if case == "factor that may not exist":
        assert 0 < np.isnan(values[:, 0, 0]).sum() < len(POINTS)


def test_batched_densities_of_mixtures_and_correlated_normals_equal_scipy():
    """The log densities of PyMC are evaluated without a loop over the points."""
    rng = np.random.default_rng(SEED)
    y, z = rng.normal(size=20), rng.normal(size=(20, 3))
    with pm.Model() as model:
        share = pm.Dirichlet("share", np.ones(3))
        pm.NormalMixture("y", share, [-1.0, 0.0, 1.0], 1.0, observed=y)
        entries = pm.Normal("entries", shape=6)
        lower = pt.zeros((3, 3))[np.tril_indices(3)].set(entries)
        pm.MvNormal("z", np.zeros(3), cov=pt.eye(3) + lower @ lower.T, observed=z)
    terms = model.logp([model["y"], model["z"]], sum=False)
    batched = BatchedFunction.of_model(model, terms)
    assert_no_loop(batched)
    points = rng.standard_normal((5, 8))
    for x, of_mixture, of_normal in zip(points, *batched(points), strict=True):
        logs = special.log_softmax([*x[:2], -x[:2].sum()])
        density = special.logsumexp(logs + stats.norm([-1, 0, 1]).logpdf(y[:, None]), axis=1)
        np.testing.assert_allclose(of_mixture, density, rtol=ROUNDING)
        lower = np.zeros((3, 3))
        lower[np.tril_indices(3)] = x[2:]
        normal = stats.multivariate_normal(np.zeros(3), np.eye(3) + lower @ lower.T)
        np.testing.assert_allclose(of_normal, normal.logpdf(z), rtol=ROUNDING)


def test_chunk_size_follows_from_the_current_size_of_shared_data():
    """Points that exceed the chunk are evaluated in parts."""
    data = pytensor.shared(np.zeros(10), shape=(None,))
    with pm.Model() as model:
        x = pm.Normal("x")
        pm.Potential("sum", pt.sum(pt.exp(x * data)))
    function = BatchedFunction.of_model(model, model.replace_rvs_by_values(model.potentials))
    assert function.chunk == 512 and function.data_size == 10
    data.set_value(np.linspace(0, 1, 2**20))
    assert function.chunk == 4 and function.data_size == 2**20
    points = np.random.default_rng(SEED).standard_normal((9, 1))
    each = [function(point[None])[0] for point in points]
    np.testing.assert_allclose(function(points)[0], np.concatenate(each), rtol=ROUNDING)
    data.set_value(np.zeros(10))
    assert function.chunk == 512


def test_cost_counts_the_computed_numbers():
    """The cost grows with the data, and does not depend on earlier evaluations."""
    data = pytensor.shared(np.zeros(10), shape=(None,))
    with pm.Model() as model:
        x = pm.Normal("x")
        pm.Potential("sum", pt.sum(pt.exp(x * data)))
    function = BatchedFunction.of_model(model, model.replace_rvs_by_values(model.potentials))
    few = function.cost()
    # Products, exponentials, a sum, and a few reshaped inputs.
    assert 20 < few < 60
    data.set_value(np.zeros(10_000))
    assert 20_000 < function.cost() < 40_000
    data.set_value(np.zeros(10))
    function(np.zeros((2000, 1)))
    assert function.cost() == few


def test_seeded_results_do_not_depend_on_the_chunk(monkeypatch):
    """The number of points of a search is fixed, so that results do not depend on free memory."""
    with pm.Model() as model:
        x = pm.Normal("x", 0, 1, shape=2)
        pm.Normal("y", x, [0.1, 0.3], observed=[1.0, -0.5])
    found = []
    for chunk in (256, 512, 1024):
        monkeypatch.setattr(batched, "CHUNK", chunk)
        tree = ph.sample_smc(model, 600, 2, random_seed=SEED, progressbar=False)
        integral = integrate(Target(model), 600, np.random.default_rng(SEED))
        found.append([tree["posterior"]["x"].values, ph.log_evidence(tree), *integral[:2]])
    for other in found[1:]:
        np.testing.assert_array_equal(other[0], found[0][0])
        assert other[1:] == found[0][1:]


def test_models_that_differ_in_shared_values_share_a_compilation():
    def function(value):
        data = pytensor.shared(value)
        with pm.Model() as model:
            x = pm.Normal("x")
            pm.Potential("product", (x * data).sum())
        outputs = model.replace_rvs_by_values(model.potentials)
        return BatchedFunction.of_model(model, outputs)

    first, second = function(np.array([2.0])), function(np.array([3.0]))
    assert first.function is second.function
    point = np.array([[0.5]])
    assert [float(f(point)[0][0]) for f in (first, second)] == [1.0, 1.5]


def test_variables_of_unknown_length_have_separate_compilations():
    def score(lengths):
        with pm.Model() as model:
            x, y = (
                pm.Normal(name, pt.zeros(pytensor.shared(length)))
                for name, length in zip("xy", lengths, strict=True)
            )
            pm.Potential("p", pt.sum(x) - 2 * pt.sum(y))
        outputs = model.replace_rvs_by_values([model["p"]])
        return BatchedFunction.of_model(model, outputs)(np.ones((3, 5)))[0]

    np.testing.assert_array_equal(score((1, 4)), np.full(3, -7.0))
    np.testing.assert_array_equal(score((4, 1)), np.full(3, 2.0))


def test_draws_of_the_prior_are_independent_and_depend_on_their_parents():
    """Draws ignore initial values, and are possible before and after a score."""
    with pm.Model() as model:
        mean = pm.Normal("mean", 3, 2, initval=100.0)
        spread = pm.Exponential("spread", 0.5)
        pm.Normal("child", mean, 0.1, shape=2)
        pm.Normal("y", 0, spread, observed=[0.5, -0.5])
    target, rng = Target(model), np.random.default_rng(1)
    draws = target.draw_prior(4000, rng)
    assert np.isfinite(target.score(draws[:5])).all()
    assert target.draw_prior(7, rng).shape == (7, 4)
    constrained = np.column_stack([draws[:, 0], np.exp(draws[:, 1])])
    assert stats.kstest(constrained[:, 0], stats.norm(3, 2).cdf).pvalue > 0.001
    assert stats.kstest(constrained[:, 1], stats.expon(scale=2).cdf).pvalue > 0.001
    for child in draws[:, 2:].T:
        assert stats.kstest((child - draws[:, 0]) / 0.1, stats.norm.cdf).pvalue > 0.001
    found = unconstrain(model, [constrained[:, 0], constrained[:, 1], draws[:, 2:]])
    np.testing.assert_allclose(found[1], draws[:, 1], rtol=ROUNDING)


def test_prior_that_cannot_be_drawn_in_batches_is_drawn_one_by_one():
    """A distribution that is made of others, such as a random walk, has no batches."""
    with pm.Model() as model:
        start = pm.Normal.dist(5.0, 0.1)
        pm.GaussianRandomWalk("walk", sigma=0.1, init_dist=start, steps=3)
        pm.Potential("p", -1.0 * model["walk"].sum())
    draws = Target(model).draw_prior(50, np.random.default_rng(1))
    assert draws.shape == (50, 4) and len(np.unique(draws)) == 200
    assert abs(draws[:, 3].mean() - 5) < 4 * 0.2 / np.sqrt(50)
