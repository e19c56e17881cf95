"""A mode of PyTensor in which functions of many points run in NumPy, without a Python loop."""

from collections.abc import Callable, Sequence
from functools import partial, reduce
from typing import Any

import numpy as np
import pytensor.tensor as pt
from pytensor.compile.builders import OpFromGraph
from pytensor.compile.mode import Mode
from pytensor.graph.basic import Apply, Variable
from pytensor.graph.fg import FunctionGraph
from pytensor.graph.op import Op
from pytensor.graph.replace import vectorize_graph
from pytensor.graph.rewriting.basic import dfs_rewriter, node_rewriter
from pytensor.graph.rewriting.db import RewriteDatabaseQuery
from pytensor.scalar.basic import Clip
from pytensor.scalar.math import Softplus
from pytensor.tensor.basic import Split
from pytensor.tensor.blockwise import Blockwise
from pytensor.tensor.elemwise import Elemwise
from pytensor.tensor.linalg.decomposition.cholesky import Cholesky
from pytensor.tensor.linalg.decomposition.eigen import Eigh
from pytensor.tensor.linalg.solvers.triangular import SolveTriangular
from pytensor.tensor.type import TensorType
from pytensor.tensor.utils import import_func_from_string

from pymc_hyperelastic.evidence.mixture import Array


@node_rewriter([Elemwise])
def _scalars_in_numpy(fgraph: FunctionGraph, node: Apply) -> list[Variable] | None:
    """``ln(1 + e^x)``, in the transform of every bounded variable, and clipping are loops else.

    NumPy's own ``clip`` takes bounds otherwise that are in the wrong order.
    """
    if isinstance(node.op.scalar_op, Softplus):
        x = node.inputs[0]
        return [pt.maximum(x, 0.0) + pt.log1p(pt.exp(-pt.abs(x)))]
    if isinstance(node.op.scalar_op, Clip):
        x, low, high = node.inputs
        return [pt.switch(x < low, low, pt.minimum(x, high)).astype(node.outputs[0].dtype)]
    return None


@node_rewriter([Blockwise])
def _batch_of_graphs(fgraph: FunctionGraph, node: Apply) -> list[Variable] | None:
    """Operations that are graphs of others, such as ``logsumexp``, are a Python loop otherwise."""
    if not isinstance(node.op.core_op, OpFromGraph):
        return None
    graph = node.op.core_op.fgraph
    inputs = [v.type() for v in graph.inputs]
    outputs = graph.bind(dict(zip(graph.inputs, inputs, strict=True)))
    return vectorize_graph(outputs, dict(zip(inputs, node.inputs, strict=True)))


@node_rewriter([Blockwise])
def _batch_of_splits(fgraph: FunctionGraph, node: Apply) -> list[Variable] | None:
    """A split, as in the gradient of joined arrays, is a Python loop otherwise."""
    core = node.op.core_op
    if not isinstance(core, Split):
        return None
    x, sizes = node.inputs
    if not all(sizes.type.broadcastable[:-1]):
        return None  # not all are split alike
    axis = node.op.batch_ndim(node) + core.axis
    return Split(core.len_splits, axis)(x, sizes.flatten(), return_list=True)


class _NumpyCall(Op):
    """A NumPy function by itself: what PyTensor checks around it takes longer than small arrays."""

    __props__ = ("function", "type")

    def __init__(self, function: Callable[..., Any], type: TensorType) -> None:
        self.function, self.type = function, type

    def make_node(self, *inputs: Variable) -> Apply:
        return Apply(self, inputs, [self.type()])

    def perform(self, node: Apply, inputs: Sequence[Any], outputs: Any) -> None:
        # NumPy returns numbers for numbers, not arrays.
        outputs[0][0] = np.asarray(self.function(*inputs))


@node_rewriter([Elemwise])
def _elementwise_by_numpy(fgraph: FunctionGraph, node: Apply) -> list[Variable] | None:
    """Call NumPy directly where it gives the type that is due."""
    result = node.outputs[0].type
    if node.op.nfunc_spec is None:
        return None
    name, count, _ = node.op.nfunc_spec
    function = import_func_from_string(name)
    if len(node.inputs) > count:  # a sum or product of many
        function = partial(_fold, function)
    example = function(*(np.ones(v.type.ndim * (1,), v.dtype) for v in node.inputs))
    return [_NumpyCall(function, result)(*node.inputs)] if example.dtype == result.dtype else None


def _fold(function: Callable[..., Any], *values: Any) -> Any:
    """Small arrays come first."""
    return reduce(function, sorted(values, key=np.size))


def _eigh(matrices: Array) -> Array:
    """Return eigenvalues in the first row, eigenvectors in columns below; NaN if not finite."""
    finite = np.isfinite(matrices).all(axis=(-2, -1))[..., None, None]
    values, vectors = np.linalg.eigh(np.where(finite, matrices, 0.0))
    return np.where(finite, np.concatenate([values[..., None, :], vectors], axis=-2), np.nan)


@node_rewriter([Blockwise])
def _matrices_by_numpy(fgraph: FunctionGraph, node: Apply) -> list[Variable] | None:
    """Eigenvalues, Cholesky factors and triangular solves are Python loops otherwise."""
    core, result = node.op.core_op, node.outputs[-1].type
    if isinstance(core, Eigh) and core.lower:
        both = _NumpyCall(_eigh, result.clone(shape=(None,) * result.ndim))(*node.inputs)
        return [both[..., 0, :], both[..., 1:, :]]
    if result.dtype != "float64":
        return None
    if isinstance(core, Cholesky) and core.lower:
        return [_NumpyCall(_cholesky, result)(*node.inputs)]
    if isinstance(core, SolveTriangular) and not core.unit_diagonal:
        solve = _solve_lower if core.lower else _solve_upper
        return [_NumpyCall(partial(solve, core.b_ndim), result)(*node.inputs)]
    return None


def _cholesky(matrices: Array) -> Array:
    """Return lower Cholesky factors; NaN for matrices that have none."""
    try:
        return np.linalg.cholesky(matrices)
    except np.linalg.LinAlgError:
        # NumPy refuses all for the sake of one.
        if matrices.ndim == 2:
            return np.full_like(matrices, np.nan)
        return np.stack([_cholesky(matrix) for matrix in matrices])


def _solve_lower(ndim: int, factors: Array, known: Array) -> Array:
    """Solve equations by lower triangular matrices, for vectors or for the columns of matrices."""
    if ndim == 1:
        return _solve_lower(2, factors, known[..., None])[..., 0]
    batch = np.broadcast_shapes(factors.shape[:-2], known.shape[:-2])
    solution = np.empty(batch + known.shape[-2:])
    for i in range(known.shape[-2]):
        before = np.einsum("...j,...jk->...k", factors[..., i, :i], solution[..., :i, :])
        solution[..., i, :] = (known[..., i, :] - before) / factors[..., i, i, None]
    return solution


def _solve_upper(ndim: int, factors: Array, known: Array) -> Array:
    """The same by upper ones, which are lower ones from the other end."""
    turned = (Ellipsis, slice(None, None, -1)) + (slice(None),) * (ndim - 1)
    return _solve_lower(ndim, factors[..., ::-1, ::-1], known[turned])[turned]


# Functions that run a hundred times on thousands of points are compiled for NumPy in a second, for
# numba or C in a minute. Fused operations, and powers made of them, would run point by point.
_FUSED = ["fusion", "inplace", "local_pow_to_nested_squaring", "local_div_exp_to_mul_exp"]
# Graphs inside of operations are opened before the rewrites at position 2, which are right for
# infinite numbers; all else comes last.
IN_NUMPY = (
    Mode("py", RewriteDatabaseQuery(include=["fast_run"], exclude=_FUSED))
    .register((dfs_rewriter(_batch_of_graphs), 1.9))
    .register((dfs_rewriter(_batch_of_splits), 97))
    .register((dfs_rewriter(_matrices_by_numpy), 98))
    .register((dfs_rewriter(_scalars_in_numpy), 99))
    .register((dfs_rewriter(_elementwise_by_numpy), 100))
)
