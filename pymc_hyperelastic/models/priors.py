"""Priors of material parameters: documented defaults, the user's own, and how they are stored."""

from collections.abc import Mapping, Sequence
from math import isnan
from typing import Any

import numpy as np
import pymc as pm
import pytensor
import pytensor.tensor as pt
from pymc.distributions.distribution import SymbolicRandomVariable
from pymc.exceptions import NotConstantValueError
from pymc.pytensorf import constant_fold
from pytensor.graph.basic import Constant, Variable
from pytensor.graph.replace import clone_replace
from pytensor.graph.traversal import ancestors
from pytensor.tensor.random.op import RandomVariable
from pytensor.tensor.random.type import RandomType
from pytensor.tensor.variable import TensorVariable

from pymc_hyperelastic.evidence.checks import check_precision
from pymc_hyperelastic.files.stored import is_number, shown
from pymc_hyperelastic.mechanics.layers import Layer, check_energy, check_layers
from pymc_hyperelastic.mechanics.strain_energy.base import StrainEnergy


def complete_priors(
    energy: StrainEnergy,
    priors: dict[str, TensorVariable] | None = None,
    model: pm.Model | None = None,
) -> dict[str, TensorVariable]:
    """Priors of all parameters of `energy`: those given, and uniform defaults for the others.

    A default prior is uniform over :attr:`Parameter.prior_range`, as in the paper. It is a fixed
    physical range and knows nothing of the data. In place of a prior there may be a variable of the
    `model` that is going to have them.

    >>> import pymc as pm, pymc_hyperelastic as ph
    >>> from pymc_hyperelastic.models.priors import complete_priors
    >>> list(complete_priors(ph.Ogden(), {"alpha": pm.Uniform.dist(0, 20)}))
    ['mu', 'alpha']
    """
    if priors is not None and not isinstance(priors, Mapping):
        raise TypeError(
            'priors must be a dict such as {"mu": pm.Uniform.dist(0, 50)}, not '
            f"{type(priors).__name__}"
        )
    given = dict(priors or {})
    for name, prior in given.items():
        if name not in energy.parameter_names:
            raise ValueError(
                f"a prior is given for {name!r}, but {energy.name} has the parameters "
                f"{list(energy.parameter_names)}"
            )
    for p in energy.parameters:
        if p.name in given:
            check_prior(p.name, given[p.name], p.size, model)
    return {
        p.name: given[p.name] if p.name in given else pm.Uniform.dist(*p.prior_range, shape=p.size)
        for p in energy.parameters
    }


def complete_wall(
    energy: StrainEnergy | Sequence[Layer],
    priors: dict[str, TensorVariable] | None = None,
    model: pm.Model | None = None,
) -> tuple[StrainEnergy | list[Layer], dict[str, TensorVariable]]:
    """A material, or layers in which nothing is missing, and the priors of all parameters."""
    check_precision()
    if not isinstance(energy, Sequence):
        check_energy(energy)
        return energy, complete_priors(energy, priors, model)
    if priors:
        raise TypeError("layers take their own priors, Layer(..., mu=...): give no others")
    check_layers(energy)
    return complete_layers(energy, model)


def complete_layers(
    layers: Sequence[Layer], model: pm.Model | None = None
) -> tuple[list[Layer], dict[str, TensorVariable]]:
    """Layers in which nothing is missing, and the distributions in them by name.

    A name carries the number of the layer, counted from inside, unless the distribution stands in
    several layers.
    """
    filled = []
    places: dict[TensorVariable, list[tuple[str, int]]] = {}
    for number, layer in enumerate(layers, start=1):
        parameters = {
            p.name: layer.parameters[p.name]
            if p.name in layer.parameters
            else pm.Uniform.dist(*p.prior_range, shape=p.size)
            for p in layer.energy.parameters
        }
        sizes = {p.name: p.size for p in layer.energy.parameters} | {"thickness": None}
        for name, value in {**parameters, "thickness": layer.thickness}.items():
            if is_inferred(value):
                check_prior(f"{name}_{number}", value, sizes[name], model)
                places.setdefault(value, []).append((name, number))
            else:
                _check_number(f"{name}_{number}", value, sizes[name])
        filled.append(Layer(layer.energy, layer.thickness, **parameters))
    named = {}
    for prior, [(name, number), *others] in places.items():
        named[name if others else f"{name}_{number}"] = prior
    if len(named) < len(places):
        raise ValueError(
            "two distributions would have one name: what is shared must be shared by all layers "
            f"that have it; here are {sorted(named)}"
        )
    return filled, named


def with_variables(
    layers: Sequence[Layer],
    distributions: Mapping[str, TensorVariable],
    variables: Mapping[str, TensorVariable],
) -> list[Layer]:
    """The layers with random variables in place of their distributions."""
    registered = {prior: variables[name] for name, prior in distributions.items()}

    def variable(value: Any) -> Any:
        return registered.get(value, value) if is_inferred(value) else value

    return [
        Layer(
            layer.energy,
            variable(layer.thickness),
            **{name: variable(value) for name, value in layer.parameters.items()},
        )
        for layer in layers
    ]


def check_prior(
    name: str, prior: Any, size: int | None = None, model: pm.Model | None = None
) -> None:
    """Raise TypeError unless `prior` is a distribution of that size that belongs to no model yet.

    A scalar has no size. With a `model`, it may be a variable of that instead.
    """
    if not belongs_to(prior, model):
        _check_distribution(name, prior)
    shape = () if size is None else (size,)
    static = prior.type.shape
    # What is computed need not know its size beforehand.
    if len(static) != len(shape) or any(s not in (n, None) for s, n in zip(static, shape)):
        expected = "a scalar" if size is None else f"{size} entries, as with shape={size}"
        raise TypeError(f"the prior of {name!r} has the shape {static}; expected {expected}")


def belongs_to(variable: Any, model: pm.Model | None) -> bool:
    """Whether something is a variable of a model, or computed from such."""
    if model is None or not is_inferred(variable):
        return False
    named = set(model.root.named_vars.values())
    if variable in named:
        return True
    return not _is_random(variable) and any(v in named for v in ancestors([variable]))


def _check_distribution(name: str, prior: Any) -> None:
    """Raise TypeError unless `prior` is a distribution that belongs to no model yet."""
    node = getattr(prior, "owner", None)
    if node is None or not isinstance(node.op, RandomVariable | SymbolicRandomVariable):
        raise TypeError(
            f"the prior of {name!r} is {prior!r}; expected a distribution such as "
            "pm.Uniform.dist(0, 50)"
        )
    # A distribution has no name until it is registered in a model.
    parents = [v for v in ancestors(node.inputs) if _is_random(v)]
    linked = [v for v in (prior, *parents) if v.name]
    if _takes_scalars(node.op):
        linked += parents
    if linked:
        culprit = linked[0].name or linked[0]
        raise TypeError(
            f"the prior of {name!r} depends on the random variable {culprit!r}; "
            "expected a distribution by itself, such as pm.Uniform.dist(0, 50). Variables of a "
            "model of your own are taken by ph.inflation_model, where that is called inside "
            "`with model:`, and by ph.inflation_likelihood"
        )


def _check_number(name: str, value: Any, size: int | None) -> None:
    expected = "a number" if size is None else f"{size} numbers"
    try:
        number = np.asarray(value, float)
    except (TypeError, ValueError):
        number = np.array(np.nan)
    if number.shape != (() if size is None else (size,)) or not np.isfinite(number).all():
        raise TypeError(f"{name} is {value!r}; expected {expected}, or a distribution")


def prior_to_record(name: str, prior: TensorVariable) -> list[Any]:
    """Distribution as ``[name, parameters]``, for attributes of a file; a vector's size follows."""
    node = prior.owner
    distribution = _DISTRIBUTIONS.get(type(node.op))
    try:
        if distribution is not None and _takes_scalars(node.op):
            parameters = constant_fold(_in_double(node.op.dist_params(node)))
            return [distribution, [p.tolist() for p in parameters], *prior.type.shape]
    except NotConstantValueError:
        pass
    raise ValueError(
        f"the prior of {name!r} cannot be stored with the results: use one of PyMC's univariate "
        "distributions with numbers for parameters, such as pm.Gamma.dist(2, 0.1)"
    )


def prior_from_record(record: Any, name: str = "") -> TensorVariable:
    """Distribution from what :func:`prior_to_record` stored, under a name.

    Raises
    ------
    ValueError
        If it is no such record: it may come from a file, and is looked up in a table of known
        distributions alone.
    """
    if not isinstance(record, list) or len(record) < 2:
        raise ValueError(
            f"the prior of {name!r} is {shown(record)}; expected [name, [parameters]], and the "
            "size of a vector"
        )
    distribution, parameters, *size = record
    if not isinstance(distribution, str) or distribution not in _READABLE:
        raise ValueError(
            f"the prior of {name!r} is {shown(distribution)}, which is no distribution that is "
            f"stored with results; these are {sorted(_READABLE)}"
        )
    known, count = _READABLE[distribution]
    if len(size) > 1 or not all(type(n) is int and 1 <= n <= _LARGEST_SIZE for n in size):
        raise ValueError(
            f"the prior of {name!r} has the size {shown(size)}; expected nothing, or one whole "
            "number"
        )
    if not isinstance(parameters, list) or len(parameters) != count:
        raise ValueError(
            f"the prior of {name!r}, {distribution}, has the parameters {shown(parameters)}; "
            f"expected a list of {count}"
        )
    for parameter in parameters:
        entries = parameter if isinstance(parameter, list) else [parameter]
        whole = not isinstance(parameter, list) or len(parameter) in (1, *size)
        if not whole or not all(is_number(x) and not isnan(x) for x in entries):
            raise ValueError(
                f"the prior of {name!r}, {distribution}, has the parameter {shown(parameter)}; "
                "expected a number, or as many as its size"
            )
    return _rebuild(
        known.rv_op, [pt.constant(p, dtype="float64") for p in parameters], size or None
    )


def priors_from_records(records: Any) -> dict[str, TensorVariable]:
    """Distributions by name from records by name."""
    if not isinstance(records, dict):
        raise ValueError(f"priors are {shown(records)}; expected a JSON object of names to records")
    return {name: prior_from_record(record, name) for name, record in records.items()}


def class_name_of(record: Any) -> str:
    """Name of the class of a distribution that :func:`prior_to_record` stored; some have two names.

    Raises ValueError as :func:`prior_from_record` does.

    Examples
    --------
    >>> class_name_of(["Uniform", [0.0, 1.0]])
    'Uniform'
    """
    prior_from_record(record)
    return _READABLE[record[0]][0].__name__


def _parameters_of(op: type) -> int | None:
    """How many numbers state a distribution of numbers; None of any other distribution."""
    symbolic = issubclass(op, SymbolicRandomVariable)
    signature = getattr(op, "extended_signature" if symbolic else "signature", None) or ""
    given, _, made = signature.partition("->")
    if symbolic and not given.startswith("[rng],[size]"):
        return None
    if symbolic:
        given, made = given.removeprefix("[rng],[size]"), made.removeprefix("[rng],")
    if made != "()" or given.replace("()", "").replace(",", ""):
        return None
    return given.count("()")


# PyMC's distributions by the type of the random variable that they make.
_DISTRIBUTIONS: dict[type, str] = {
    member.rv_type: name
    for name, member in vars(pm.distributions).items()
    if isinstance(getattr(member, "rv_type", None), type)
}
# Those that `prior_to_record` writes, under all their names, and how many numbers state each.
_READABLE: dict[str, tuple[Any, int]] = {
    name: (member, count)
    for name, member in vars(pm.distributions).items()
    if isinstance(op := getattr(member, "rv_type", None), type)
    and (count := _parameters_of(op)) is not None
}
# Entries of a vector: of more no law has as many.
_LARGEST_SIZE = 10_000


def is_inferred(value: Any) -> bool:
    """Whether a quantity is a variable, and not a number."""
    return isinstance(value, Variable)


def register_priors(priors: Mapping[str, TensorVariable]) -> dict[str, TensorVariable]:
    """Make priors random variables of the model in context."""
    return {name: register_prior(name, prior) for name, prior in priors.items()}


def register_prior(name: str, prior: TensorVariable) -> TensorVariable:
    """Make `prior` a random variable of the model in context, unless it is a part of that already.

    A copy is registered: one distribution may serve several models, or several parameters.
    """
    model = pm.modelcontext(None)
    if belongs_to(prior, model):
        return prior
    node = prior.owner
    if _takes_scalars(node.op):
        size = prior.type.shape or None
        copy = _rebuild(node.op, _in_double(node.op.dist_params(node)), size)
    else:
        inputs = [_generator() if isinstance(x.type, RandomType) else x for x in node.inputs]
        copy = node.op.make_node(*inputs).outputs[node.outputs.index(prior)]
    return model.register_rv(copy, name=name)


def _in_double(variables: Sequence[Variable]) -> list[Variable]:
    """Copies in which numbers have double precision: as 3 or 0.5, PyTensor keeps them in less."""
    short = ("int8", "int16", "float16", "float32")
    numbers = [
        v
        for v in ancestors(variables)
        if isinstance(v, Constant)
        and getattr(v.type, "dtype", "") in short
        and (v.type.ndim == 0 or v.type.dtype.startswith("float"))
    ]
    double = {v: pt.constant(v.data, dtype="float64") for v in numbers}
    return clone_replace(list(variables), double, rebuild_strict=False)


def _rebuild(op: Any, parameters: Sequence[Any], size: Sequence[int] | None) -> TensorVariable:
    """Distribution of the same kind, with a random generator of its own."""
    if isinstance(op, RandomVariable):
        return op(*parameters, size=size, rng=_generator(), return_next_rng=True)[1]
    return getattr(op, "rv_op", op)(*parameters, size=size)


def _is_random(x: Variable) -> bool:
    return x.owner is not None and isinstance(x.owner.op, RandomVariable | SymbolicRandomVariable)


def _takes_scalars(op: Any) -> bool:
    """Whether a distribution is stated by scalars alone, and by no other distributions."""
    of_its_own = isinstance(op, RandomVariable) or str(op.extended_signature).startswith("[rng]")
    return of_its_own and not any(op.ndims_params)


def _generator() -> Variable:
    return pytensor.shared(np.random.default_rng())
