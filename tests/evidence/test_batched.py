"""Functions of many points at once: what each point gives by itself, and no loop over them."""

import numpy as np
import pymc as pm
import pytensor
import pytensor.tensor as pt
import pytest
from pytensor.tensor.blockwise import Blockwise
from pytensor.tensor.elemwise import Elemwise
from pytensor.tensor.special import xlogy
from scipy import linalg, special, stats

from pymc_hyperelastic.evidence.batched import BatchedFunction
from pymc_hyperelastic.evidence.target import Target

SEED = 911
POINTS = np.random.default_rng(SEED).standard_normal((50, 4))
# A few sums and products in another order.
ROUNDING = 1e-12


def covariance(xp, x):
    """A matrix that has a Cholesky factor for most points."""
    return xp.outer(x, x) + xp.diag(xp.exp(x)) + 0.5 * x[0] * np.ones((4, 4))


def factor(x):
    return pt.linalg.cholesky(covariance(pt, pt.abs(x)))


def factor_by_scipy(x):
    return linalg.cholesky(covariance(np, np.abs(x)), lower=True)


def factor_or_none(x):
    try:
        return linalg.cholesky(covariance(np, x), lower=True)
    except linalg.LinAlgError:
        return np.full((4, 4), np.nan)


def clipped(x, low, high):
    """Bounds as PyTensor has them: if they are in the wrong order the lower one counts first."""
    return np.where(x < low, low, np.where(x > high, high, x))


CASES = {
    "logsumexp": (pt.logsumexp, special.logsumexp),
    "logsumexp of rows": (
        lambda x: pt.logsumexp(pt.outer(x, x), axis=-1),
        lambda x: special.logsumexp(np.outer(x, x), axis=-1),
    ),
    "logsumexp that keeps its axis": (
        lambda x: pt.logsumexp(pt.outer(x, x), axis=0, keepdims=True),
        lambda x: special.logsumexp(np.outer(x, x), axis=0, keepdims=True),
    ),
    "logsumexp of nothing": (
        lambda x: pt.logsumexp(pt.where(x < 9.0, -np.inf, x)),
        lambda x: -np.inf,
    ),
    "logaddexp": (lambda x: pt.logaddexp(x, -x[::-1]), lambda x: np.logaddexp(x, -x[::-1])),
    "product of zero": (
        lambda x: xlogy(pt.maximum(x, 0.0), pt.maximum(x, 0.0)),
        lambda x: special.xlogy(np.maximum(x, 0.0), np.maximum(x, 0.0)),
    ),
    "bounds": (lambda x: pt.clip(x, -0.5, x[0]), lambda x: clipped(x, -0.5, x[0])),
    "an open bound": (lambda x: pt.clip(x, 0.0, np.inf), lambda x: clipped(x, 0.0, np.inf)),
    "softplus": (pt.softplus, lambda x: np.logaddexp(0.0, x)),
    "einsum": (lambda x: pt.einsum("i,j->ij", x, x), lambda x: np.outer(x, x)),
    "diagonal": (pt.diag, np.diag),
    "factor": (factor, factor_by_scipy),
    "factor of what has none": (lambda x: pt.linalg.cholesky(covariance(pt, x)), factor_or_none),
    "solved for a vector": (
        lambda x: pt.linalg.solve_triangular(factor(x), x, lower=True, b_ndim=1),
        lambda x: linalg.solve_triangular(factor_by_scipy(x), x, lower=True),
    ),
    "solved for a matrix": (
        lambda x: pt.linalg.solve_triangular(factor(x), pt.outer(x, x), lower=True, b_ndim=2),
        lambda x: linalg.solve_triangular(factor_by_scipy(x), np.outer(x, x), lower=True),
    ),
    "solved from the other end": (
        lambda x: pt.linalg.solve_triangular(factor(x).T, x, lower=False, b_ndim=1),
        lambda x: linalg.solve_triangular(factor_by_scipy(x).T, x, lower=False),
    ),
}


def loops(batched):
    """Nodes of a compiled function that call others for each point in Python."""
    nodes = batched.function.maker.fgraph.apply_nodes

    def is_loop(op):
        return isinstance(op, Blockwise) or (isinstance(op, Elemwise) and op.nfunc_spec is None)

    return [node for node in nodes if is_loop(node.op)]


@pytest.mark.parametrize("case", CASES)
def test_many_points_at_once(case):
    """A function of many points is SciPy's of each, and has no loop over them in Python."""
    with pm.Model() as model:
        pm.Flat("x", shape=4)
    expression, expected = CASES[case]
    batched = BatchedFunction.of_model(model, [expression(*model.value_vars)])
    assert not loops(batched)
    (values,) = batched(POINTS)
    each = np.array([expected(point) for point in POINTS])
    np.testing.assert_allclose(values, each, rtol=ROUNDING, atol=ROUNDING)
    if case == "factor of what has none":
        assert 0 < np.isnan(values[:, 0, 0]).sum() < len(POINTS)


def test_mixtures_and_correlated_normals_need_no_loop():
    """Log densities of PyMC's mixtures and multivariate normals are plain NumPy."""
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
    assert not loops(batched)
    points = rng.standard_normal((5, batched.dimension))
    for x, of_mixture, of_normal in zip(points, *batched(points), strict=True):
        logs = special.log_softmax([*x[:2], -x[:2].sum()])
        density = special.logsumexp(logs + stats.norm([-1, 0, 1]).logpdf(y[:, None]), axis=1)
        np.testing.assert_allclose(of_mixture, density, rtol=ROUNDING)
        lower = np.zeros((3, 3))
        lower[np.tril_indices(3)] = x[2:]
        normal = stats.multivariate_normal(np.zeros(3), np.eye(3) + lower @ lower.T)
        np.testing.assert_allclose(of_normal, normal.logpdf(z), rtol=ROUNDING)


def test_memory_is_that_of_the_data_at_hand():
    """How many points are scored together does not depend on what was scored before."""
    data = pytensor.shared(np.zeros(10), shape=(None,))
    with pm.Model() as model:
        x = pm.Normal("x")
        pm.Potential("sum", pt.sum(pt.exp(x * data)))
    function = BatchedFunction.of_model(model, model.replace_rvs_by_values(model.potentials))
    few = function.filling(2**24)
    data.set_value(np.zeros(10_000))
    many = function.filling(2**24)
    assert 500 * many < few
    data.set_value(np.zeros(10))
    assert function.filling(2**24) == few


def test_the_prior_is_drawn_before_and_after_a_score():
    """Constants that SciPy's distributions share with the model are locked in between."""
    with pm.Model() as model:
        spread = pm.HalfNormal("spread", 1)
        pm.Normal("y", 0, spread, observed=[0.5, -0.5])
    target, rng = Target(model), np.random.default_rng(1)
    assert target.draw_prior(5, rng).shape == (5, 1)
    assert np.isfinite(target.score(np.zeros((1, 1)))).all()
    assert target.draw_prior(7, rng).shape == (7, 1)


def test_expressions_of_other_lengths_are_other_functions():
    """Of two variables whose types have no length, either may be the longer one."""

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
