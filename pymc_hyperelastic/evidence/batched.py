"""Compile functions of a model's variables that take many points at once."""

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import prod
from typing import Any

import numpy as np
import pymc as pm
import pytensor
import pytensor.tensor as pt
from pymc.distributions.custom import CustomDistRV
from pymc.distributions.distribution import SymbolicRandomVariable
from pymc.initial_point import make_initial_point_expression
from pymc.logprob.transforms import SimplexTransform
from pymc.logprob.utils import local_check_parameter_to_ninf_switch
from pymc.pytensorf import join_nonshared_inputs
from pytensor.compile.sharedvalue import SharedVariable
from pytensor.graph.basic import Apply, Variable
from pytensor.graph.fg import FrozenFunctionGraph, FunctionGraph
from pytensor.graph.replace import clone_replace, vectorize_graph
from pytensor.graph.rewriting.basic import in2out
from pytensor.graph.traversal import ancestors, graph_inputs
from pytensor.tensor.random.op import RandomVariable
from pytensor.tensor.random.type import RandomType
from pytensor.tensor.variable import TensorConstant, TensorVariable

from pymc_hyperelastic.evidence.in_numpy import IN_NUMPY
from pymc_hyperelastic.evidence.mixture import Array

# Recording the line of code of each node would take a third of the time.
without_traces = pytensor.config.change_flags(traceback__limit=0)


# Points that are evaluated in one call. Fewer spend their time on calling NumPy, more leave the
# cache: 512 are within 1.7 times of the best number for eight models of different cost.
CHUNK = 512
# Points times numbers of the largest array of data in one call, at most: an array of 32 MB.
_CHUNK_NUMBERS = 2**22

# Modules whose distributions draw batches.
_IN_LIBRARIES = re.compile(r"(pymc|pytensor)\.")
# Compiled functions that are kept: those of all models of a long session.
_MOST_COMPILED = 500
# Compiled functions by their expressions, the oldest first.
_compiled: dict[tuple, Any] = {}


@dataclass(frozen=True)
class BatchedFunction:
    """A function of a model's free variables, compiled for many points at once.

    Models that differ in the values of shared variables alone share one compilation.
    """

    function: Any
    shared: tuple[SharedVariable, ...]
    dimension: int
    largest_constant: int
    """Numbers in the largest constant of the function, such as observed data."""

    @classmethod
    @without_traces
    def of_model(
        cls,
        model: pm.Model,
        outputs: Sequence[Variable],
        compile_kwargs: dict[str, Any] | None = None,
    ) -> "BatchedFunction":
        """Compile `outputs`, expressions of the model's value variables.

        `compile_kwargs` are options of ``pytensor.function``; without a mode NumPy does the work.
        """
        if any(isinstance(variable.type, RandomType) for variable in graph_inputs(outputs)):
            raise ValueError(
                "the density of the model is random, as with pm.Minibatch, and has no evidence: "
                "give the model all of its data"
            )
        compile_kwargs = {"mode": IN_NUMPY} | (compile_kwargs or {})
        shapes, values = value_shapes(model), model.value_vars
        constants = (v for v in ancestors(outputs) if isinstance(v, TensorConstant))
        largest = max((np.size(v.data) for v in constants), default=0)

        def batch() -> tuple[list[TensorVariable], list[Variable]]:
            # Joining all variables takes as long as the comparison of expressions.
            zeros = {name: np.zeros(shape) for name, shape in shapes.items()}
            joined, point = join_nonshared_inputs(zeros, outputs, values)
            # A particle with impossible parameters is impossible by itself. PyMC's checks, once
            # vectorised, would refuse all particles.
            graph = FunctionGraph(outputs=joined, clone=False)
            in2out(local_check_parameter_to_ninf_switch).rewrite(graph)
            particles = pt.matrix("particles", dtype=point.dtype)
            batched = vectorize_graph(list(graph.outputs), {point: particles})
            # An output that no variable enters is one number for all particles.
            size = (particles.shape[0],)
            return [particles], [v if v.type.ndim else pt.broadcast_to(v, size) for v in batched]

        key = *shapes.values(), str(compile_kwargs)
        function, shared = _compile(values, outputs, batch, key, **compile_kwargs)
        # NumPy accepts any array, and checks take longer than operations on small arrays.
        function.trust_input = compile_kwargs["mode"] is IN_NUMPY
        return cls(function, shared, sum(map(prod, shapes.values())), largest)

    def __call__(self, particles: Array) -> list[Array]:
        """Return every output at every particle, the particles along the first axis."""
        values = [v.get_value(borrow=True) for v in self.shared]
        size = self.chunk
        # A proposal may be so wild that its pressures overflow: its score says so.
        with np.errstate(all="ignore"):
            starts = range(0, len(particles), size) or [0]
            parts = [self.function(particles[i : i + size], *values) for i in starts]
        return [np.concatenate(outputs) for outputs in zip(*parts, strict=True)]

    @property
    def data_size(self) -> int:
        """Numbers in the largest array of data, at least 1."""
        shared = (np.size(v.get_value(borrow=True)) for v in self.shared)
        return max(self.largest_constant, *shared, 1)

    def cost(self) -> int:
        """Return how many numbers are computed for one point: a time that no machine decides.

        It is the size of the data if another backend does the work.
        """
        if self.function.maker.mode is not IN_NUMPY:
            return self.data_size
        graph = self.function.maker.fgraph
        given = [np.zeros((1, self.dimension)), *(v.get_value(borrow=True) for v in self.shared)]
        values, total = dict(zip(graph.inputs, given, strict=True)), 0
        with np.errstate(all="ignore"):
            for node in graph.toposort():
                outputs: list[list[Any]] = [[None] for _ in node.outputs]
                inputs = [values[v] if v in values else v.data for v in node.inputs]
                node.op.perform(node, inputs, outputs)
                for variable, (value,) in zip(node.outputs, outputs, strict=True):
                    values[variable] = value
                    total += np.size(value)
        return max(total, 1)

    @property
    def chunk(self) -> int:
        """Number of points that are evaluated in one call; it depends on the data alone."""
        return max(1, min(CHUNK, _CHUNK_NUMBERS // self.data_size))


def value_shapes(model: pm.Model) -> dict[str, tuple[int, ...]]:
    """Return shapes of the value variables by name; evaluate a point if types lack a shape."""
    shapes = {v.name: v.type.shape for v in model.value_vars}
    if any(None in shape for shape in shapes.values()):
        point = model.initial_point(random_seed=0)
        shapes = {name: np.shape(point[name]) for name in shapes}
    return shapes


def side_by_side(values: Sequence[Array]) -> Array:
    """All entries of several variables as columns, the points along the first axis."""
    return np.concatenate([np.reshape(v, (len(v), -1)) for v in values], axis=1)


class _SharesAboveZero(SimplexTransform):
    """Transform of shares; those rounded to 0, without a logarithm, become the least number."""

    def forward(self, value: TensorVariable, *inputs: Variable) -> TensorVariable:
        return super().forward(pt.maximum(value, np.nextafter(0.0, 1.0)), *inputs)


@without_traces
def prior_sampler(model: pm.Model) -> Callable[[int, np.random.Generator], dict[str, Array]]:
    """Compile a function of a number and a generator: independent draws of the prior.

    They are on the unconstrained scale, by the name of the value variable, and ignore initial
    values.
    """
    transforms = {
        rv: _SharesAboveZero() if isinstance(transform, SimplexTransform) else transform
        for rv, transform in model.rvs_to_transforms.items()
    }
    expressions = make_initial_point_expression(
        free_rvs=model.free_RVs,
        rvs_to_transforms=transforms,
        initval_strategies=dict.fromkeys(model.free_RVs),
        default_strategy="prior",
        return_transformed=True,
    )
    names = [model.rvs_to_values[rv].name for rv in model.free_RVs]
    sample = sampler(expressions)
    return lambda count, rng: dict(zip(names, sample(count, rng), strict=True))


@without_traces
def sampler(expressions: Sequence[Variable]) -> Callable[[int, np.random.Generator], list[Array]]:
    """Compile a function of a number and a generator: independent draws of random expressions.

    The values of each expression are along its first axis, draws of one point in the same place.
    """
    at_once = all(_draws_batches(v.owner) for v in ancestors(expressions) if is_random(v))

    def batch() -> tuple[list[TensorVariable], list[Variable]]:
        count = pt.lscalar("count")
        outputs = _of_size(expressions, count) if at_once else expressions
        # PyTensor locks constants of which it asks this. A view that was taken before seems to be
        # open, and SciPy fails to open it.
        for variable in ancestors(outputs):
            if isinstance(variable, TensorConstant):
                variable.unique_value
        return [count], list(outputs)

    function, shared = _compile([], expressions, batch, ("draws",), mode=IN_NUMPY)

    def value(variable: SharedVariable, rng: np.random.Generator) -> Any:
        """Value of a shared variable; of a random generator a new one."""
        if isinstance(variable.type, RandomType):
            return np.random.default_rng(rng.integers(2**63))
        return variable.get_value(borrow=True)

    def draw(count: int, rng: np.random.Generator) -> list[Array]:
        return function(count, *(value(v, rng) for v in shared))

    def sample(count: int, rng: np.random.Generator) -> list[Array]:
        if at_once:
            return draw(count, rng)
        # A distribution that is made of others cannot always be drawn as a batch.
        each = [draw(1, rng) for _ in range(count)]
        return [np.stack(values) for values in zip(*each, strict=True)]

    return sample


@without_traces
def unconstrain(model: pm.Model, values: Sequence[Array]) -> list[Array]:
    """Draws of the free variables, along the first axis, on their unconstrained scales."""
    transforms = [(rv, model.rvs_to_transforms[rv]) for rv in model.free_RVs]
    # A bound may depend on other variables.
    outputs = [of.forward(rv, *rv.owner.inputs) if of else rv for rv, of in transforms]
    # Draws come in single precision too.
    draws = {rv: pt.tensor(dtype="float64", shape=(None, *rv.type.shape)) for rv in model.free_RVs}
    inputs, outputs = [*draws.values()], vectorize_graph(outputs, draws)
    function, shared = _compile(inputs, outputs, lambda: (inputs, outputs), mode=IN_NUMPY)
    numbers = *(np.asarray(v, float) for v in values), *(v.get_value(borrow=True) for v in shared)
    with np.errstate(all="ignore"):
        return function(*numbers)


def _compile(
    inputs: Sequence[Variable],
    outputs: Sequence[Variable],
    batch: Callable[[], tuple[Sequence[Variable], Sequence[Variable]]],
    key: tuple = (),
    **options: Any,
) -> tuple[Any, tuple[SharedVariable, ...]]:
    """Compile what `batch` makes of expressions, unless it was done before.

    The shared variables, which are returned too, become further inputs.
    """
    shared = tuple(v for v in graph_inputs(outputs) if isinstance(v, SharedVariable))
    key = FrozenFunctionGraph.from_io([*inputs, *shared], outputs), *key
    if key not in _compiled:
        if len(_compiled) >= _MOST_COMPILED:
            del _compiled[next(iter(_compiled))]
        inputs, outputs = batch()
        values = {v: v.type() for v in shared}
        inputs, outputs = [*inputs, *values.values()], clone_replace(outputs, values)
        _compiled[key] = pytensor.function(inputs, outputs, on_unused_input="ignore", **options)
    return _compiled[key], shared


def _of_size(expressions: Sequence[Variable], draws: TensorVariable) -> list[Variable]:
    """Expressions of independent draws: those without random parents become batches."""
    batched = {}
    for variable in ancestors(expressions):
        if not is_random(variable):
            continue
        # The first parameter decides about the size.
        parameter = variable.owner.op.dist_params(variable.owner)[0]
        if not any(map(is_random, ancestors([parameter]))):
            batched[parameter] = pt.broadcast_to(parameter, (draws, *parameter.shape))
    return vectorize_graph(expressions, batched)


def _draws_batches(node: Apply) -> bool:
    """Return True for a library's distribution with parameters; a user's may not take many."""
    own = isinstance(node.op, CustomDistRV) or not _IN_LIBRARIES.match(type(node.op).__module__)
    return isinstance(node.op, RandomVariable) and bool(node.op.ndims_params) and not own


def is_random(variable: Variable) -> bool:
    """Return True for draws of a distribution of PyMC or PyTensor."""
    op = variable.owner and variable.owner.op
    return isinstance(op, RandomVariable | SymbolicRandomVariable)
