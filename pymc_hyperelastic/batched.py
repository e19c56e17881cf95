"""Functions of a model's variables for many points at once: compiled soon, and only once."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
import pymc as pm
import pytensor
import pytensor.tensor as pt
from numpy.typing import NDArray
from pymc.distributions.distribution import SymbolicRandomVariable
from pymc.initial_point import make_initial_point_expression
from pymc.logprob.utils import local_check_parameter_to_ninf_switch
from pymc.pytensorf import compile as compile_pymc
from pymc.pytensorf import join_nonshared_inputs, reseed_rngs
from pytensor.compile.mode import Mode
from pytensor.compile.sharedvalue import SharedVariable
from pytensor.graph.basic import Apply, Variable
from pytensor.graph.fg import FrozenFunctionGraph, FunctionGraph
from pytensor.graph.replace import clone_replace, vectorize_graph
from pytensor.graph.rewriting.basic import dfs_rewriter, in2out, node_rewriter
from pytensor.graph.rewriting.db import RewriteDatabaseQuery
from pytensor.graph.traversal import ancestors, graph_inputs
from pytensor.scalar.math import Softplus
from pytensor.tensor.elemwise import Elemwise
from pytensor.tensor.random.op import RandomVariable
from pytensor.tensor.variable import TensorVariable

__all__ = ["BatchedFunction", "prior_sampler", "value_shapes"]

Array = NDArray[np.float64]


@node_rewriter([Elemwise])
def _softplus_in_numpy(fgraph: FunctionGraph, node: Apply) -> list[Variable] | None:
    """``ln(1 + e^x)``, in the transform of every bounded variable, is a Python loop otherwise."""
    if not isinstance(node.op.scalar_op, Softplus):
        return None
    x = node.inputs[0]
    return [pt.maximum(x, 0.0) + pt.log1p(pt.exp(-pt.abs(x)))]


# What runs a hundred times on thousands of points is best left to NumPy: it compiles in a second,
# numba or C in a minute. Fused operations, and powers made of them, would run point by point.
_FUSED = ["fusion", "inplace", "local_pow_to_nested_squaring"]
_NUMPY = Mode("py", RewriteDatabaseQuery(include=["fast_run"], exclude=_FUSED)).register(
    (dfs_rewriter(_softplus_in_numpy), 99)
)


# Recording where in the code each node was made would take a third of the time.
_without_traces = pytensor.config.change_flags(traceback__limit=0)


@dataclass(frozen=True)
class BatchedFunction:
    """A function of a model's free variables, compiled for many points at once.

    Shared variables are inputs of the compiled function. Models whose expressions are equal but for
    the values of shared variables therefore share one compilation.
    """

    function: Any
    shared: tuple[SharedVariable, ...]

    # Compiled functions by their expression.
    _cache: ClassVar[dict[tuple, Any]] = {}

    @classmethod
    @_without_traces
    def of_model(
        cls,
        model: pm.Model,
        outputs: Sequence[Variable],
        compile_kwargs: dict[str, Any] | None = None,
    ) -> "BatchedFunction":
        """Compile `outputs`, expressions of the model's value variables.

        `compile_kwargs` are options of ``pytensor.function``; without a mode NumPy does the work.
        """
        compile_kwargs = {"mode": _NUMPY} | (compile_kwargs or {})
        point = {name: np.zeros(shape) for name, shape in value_shapes(model).items()}
        outputs, joined = join_nonshared_inputs(point, outputs, model.value_vars)
        shared = tuple(v for v in graph_inputs(outputs) if isinstance(v, SharedVariable))
        key = FrozenFunctionGraph.from_io([joined, *shared], outputs), str(compile_kwargs)
        if key not in cls._cache:
            inputs = {v: v.type() for v in shared}
            batch, outputs = _of_a_batch(joined, outputs)
            cls._cache[key] = pytensor.function(
                [batch, *inputs.values()],
                clone_replace(outputs, inputs),
                on_unused_input="ignore",
                **compile_kwargs,
            )
        return cls(cls._cache[key], shared)

    def __call__(self, particles: Array) -> list[Array]:
        """Value of every output at every particle, the particles along the first axis."""
        # A proposal may be so wild that its pressures overflow: its score says so.
        with np.errstate(all="ignore"):
            return self.function(particles, *(v.get_value(borrow=True) for v in self.shared))


def _of_a_batch(
    point: TensorVariable, outputs: Sequence[Variable]
) -> tuple[TensorVariable, list[Variable]]:
    """Many points in place of one, and what becomes of the outputs."""
    # A particle that gives a distribution impossible parameters is impossible by itself: once
    # vectorised, PyMC's checks would refuse all.
    graph = FunctionGraph(outputs=outputs, clone=False)
    in2out(local_check_parameter_to_ninf_switch).rewrite(graph)
    batch = pt.matrix("particles", dtype=point.dtype)
    outputs = vectorize_graph(list(graph.outputs), {point: batch})
    # An output that no variable enters is one number for all particles.
    return batch, [
        out if out.type.ndim else pt.broadcast_to(out, (batch.shape[0],)) for out in outputs
    ]


def value_shapes(model: pm.Model) -> dict[str, tuple[int, ...]]:
    """Shapes of the value variables by name, evaluated only where the types do not tell them."""
    shapes = {v.name: v.type.shape for v in model.value_vars}
    if any(None in shape for shape in shapes.values()):
        point = model.initial_point(random_seed=0)
        shapes = {name: np.shape(point[name]) for name in shapes}
    return shapes


def prior_sampler(model: pm.Model, draws: int) -> Callable[[np.random.Generator], dict[str, Array]]:
    """Compile a function that draws the model's free variables from the prior, independently.

    They are on the unconstrained scale, by the name of the value variable, and from the prior also
    where a variable has an initial value: the evidence needs it so.
    """
    expressions = make_initial_point_expression(
        free_rvs=model.free_RVs,
        rvs_to_transforms=model.rvs_to_transforms,
        initval_strategies=dict.fromkeys(model.free_RVs),
        default_strategy="prior",
        return_transformed=True,
    )
    names = [model.rvs_to_values[rv].name for rv in model.free_RVs]
    nodes = [v.owner for v in ancestors(expressions) if _is_random(v)]
    at_once = all(isinstance(node.op, RandomVariable) and node.op.ndims_params for node in nodes)
    if at_once:
        expressions = _of_size(expressions, draws)
    function, updates = compile_pymc(
        [], expressions, random_seed=False, mode=_NUMPY, return_updates=True
    )

    def sample(rng: np.random.Generator) -> dict[str, Array]:
        reseed_rngs(list(updates), rng.integers(2**63))
        if at_once:
            values = function()
        else:
            # A distribution that is made of others cannot always be drawn as a batch.
            values = [np.stack(v) for v in zip(*(function() for _ in range(draws)), strict=True)]
        return dict(zip(names, values, strict=True))

    return sample


def _of_size(expressions: Sequence[Variable], draws: int) -> list[Variable]:
    """Expressions of independent draws: those without random parents become batches."""
    batched = {}
    for variable in ancestors(expressions):
        if not _is_random(variable):
            continue
        # The first parameter decides about the size.
        parameter = variable.owner.op.dist_params(variable.owner)[0]
        if not any(map(_is_random, ancestors([parameter]))):
            batched[parameter] = pt.broadcast_to(parameter, (draws, *parameter.shape))
    return vectorize_graph(expressions, batched)


def _is_random(variable: Variable) -> bool:
    return variable.owner is not None and isinstance(
        variable.owner.op, RandomVariable | SymbolicRandomVariable
    )
