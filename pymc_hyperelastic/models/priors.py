"""Priors of material parameters: defaults, checks, registration in a model, and records in files.

Records are lists of names and numbers, so that reading a file executes no code from it.
"""

import re
from collections.abc import Mapping, Sequence
from contextlib import suppress
from math import isnan
from typing import Any

import numpy as np
import pymc as pm
import pytensor
import pytensor.tensor as pt
from numpy.typing import NDArray
from pymc.distributions.distribution import SymbolicRandomVariable
from pymc.exceptions import NotConstantValueError
from pymc.pytensorf import constant_fold
from pytensor.graph.basic import Constant, Variable
from pytensor.graph.replace import clone_replace
from pytensor.graph.traversal import ancestors
from pytensor.tensor.random.op import RandomVariable
from pytensor.tensor.random.type import RandomType
from pytensor.tensor.variable import TensorVariable as Tensor

from pymc_hyperelastic.evidence.batched import is_random, sampler
from pymc_hyperelastic.evidence.checks import check_precision
from pymc_hyperelastic.evidence.stored import is_number
from pymc_hyperelastic.mechanics.layers import Layer, check_energy, check_layers
from pymc_hyperelastic.mechanics.strain_energy.base import StrainEnergy
from pymc_hyperelastic.messages import shown
from pymc_hyperelastic.quantities import MEASURES, SHEET_MEASURES

# Draws of a prior for its moments and probabilities: an estimate of the prior probability 0.05 has
# a relative standard error of 3 %.
PRIOR_DRAWS = 20000
# Draws of a prior for its range: they miss values of probability 0.5 % one time in 150.
RANGE_DRAWS = 1000
# Fewest draws that stand for a distribution: four of five samples of this size hold a draw of any
# tenth of it.
FEW_DRAWS = 16


def complete_priors(
    energy: StrainEnergy, priors: dict[str, Tensor] | None = None, model: pm.Model | None = None
) -> dict[str, Tensor]:
    """Return priors of all parameters: those given, and uniform defaults for the others.

    A default prior is uniform over :attr:`Parameter.prior_range`. A given prior is a distribution,
    or a variable of `model`. TypeError if `priors` are no such distributions; ValueError if a name
    is no parameter of `energy`.

    Examples
    --------
    >>> import pymc as pm, pymc_hyperelastic as ph
    >>> list(complete_priors(ph.Ogden(), {"alpha": pm.Uniform.dist(0, 20)}))
    ['mu', 'alpha']
    """
    sizes = {p.name: p.size for p in energy.parameters}
    return _default_priors(energy) | check_priors(priors, sizes, energy.name, model)


def _default_priors(energy: StrainEnergy) -> dict[str, Any]:
    return {p.name: pm.Uniform.dist(*p.prior_range, shape=p.size) for p in energy.parameters}


def complete_wall(
    energy: StrainEnergy | Sequence[Layer],
    priors: dict[str, Tensor] | None = None,
    model: pm.Model | None = None,
) -> tuple[StrainEnergy | list[Layer], dict[str, Tensor]]:
    """Return the material, or the layers with all parameters, and the priors of all parameters."""
    check_precision()
    if not isinstance(energy, Sequence):
        check_energy(energy)
        return energy, complete_priors(energy, priors, model)
    if priors:
        raise TypeError(
            "layers take their own priors: give them as Layer(..., mu=...); `priors` holds those "
            f"of the tube alone, not of {next(iter(priors))!r}"
        )
    check_layers(energy)
    return complete_layers(energy, model)


def complete_layers(
    layers: Sequence[Layer], model: pm.Model | None = None
) -> tuple[list[Layer], dict[str, Tensor]]:
    """Add default priors to layers, and return the layers and their distributions by name.

    The name of a distribution ends with the number of its layer, counted from the inside. A
    distribution that several layers share has a name without a number. TypeError if a value is
    neither a number nor a distribution of the parameter's size; ValueError if two distributions
    would have the same name.
    """
    filled = []
    places: dict[Tensor, list[tuple[str, int]]] = {}
    for number, layer in enumerate(layers, start=1):
        parameters = _default_priors(layer.energy) | layer.parameters
        sizes = {p.name: p.size for p in layer.energy.parameters} | {"thickness": None}
        for name, value in {**parameters, "thickness": layer.thickness}.items():
            if is_inferred(value):
                check_prior(f"{name}_{number}", value, sizes[name], model)
                places.setdefault(value, []).append((name, number))
            else:
                _check_number(f"{name}_{number}", value, sizes[name])
        filled.append(Layer(layer.energy, layer.thickness, **parameters))
    named = {
        name if others else f"{name}_{number}": prior
        for prior, [(name, number), *others] in places.items()
    }
    if len(named) < len(places):
        raise ValueError(
            f"two distributions would have the same name; the names are {sorted(named)}. If layers "
            "share the distribution of a parameter, all layers with this parameter must share it"
        )
    return filled, named


def with_variables(
    layers: Sequence[Layer], distributions: Mapping[str, Tensor], variables: Mapping[str, Tensor]
) -> list[Layer]:
    """Return the layers with `variables` by name, or numbers, instead of their distributions."""
    registered = {prior: variables[name] for name, prior in distributions.items()}
    replaced = []
    for layer in layers:
        values = {"thickness": layer.thickness, **layer.parameters}
        inferred = {n: registered.get(v, v) for n, v in values.items() if is_inferred(v)}
        replaced.append(Layer(layer.energy, **values | inferred))
    return replaced


def check_priors(
    priors: Any, sizes: Mapping[str, int | None], owner: str, model: pm.Model | None = None
) -> dict[str, Any]:
    """Return priors as a dict; raise unless they are those of unknowns of the `owner`.

    The `sizes` of the unknowns are numbers of entries, None for a scalar.
    """
    given = check_by_name("priors", priors)
    for name, prior in given.items():
        if name not in sizes:
            raise ValueError(
                f"a prior is given for {name!r}, but {owner} has the parameters {list(sizes)}, and "
                f"a tube the measures {list(MEASURES)}, a sheet {list(SHEET_MEASURES)}"
            )
        check_prior(name, prior, sizes[name], model)
    return given


def check_by_name(what: str, given: Any) -> dict[str, Any]:
    """Return the argument `what` as a dict, empty for None; TypeError if it is no dict."""
    if given is not None and not isinstance(given, Mapping):
        raise TypeError(
            f'{what} must be a dict by name such as {{"mu": pm.Uniform.dist(0, 50)}}, not '
            f"{type(given).__name__}"
        )
    return dict(given or {})


def check_prior(
    name: str, prior: Any, size: int | None = None, model: pm.Model | None = None
) -> None:
    """Raise TypeError unless `prior` is an unregistered distribution, or a variable of `model`.

    `size` is the number of entries of a vector, None for a scalar.
    """
    if not belongs_to(prior, model):
        _check_distribution(name, prior)
    static = prior.type.shape
    # The static shape of a computed variable may be unknown.
    if static not in ([()] if size is None else [(size,), (None,)]):
        expected = "a scalar" if size is None else f"{size} entries, as with shape={size}"
        raise TypeError(f"the prior of {name!r} has the shape {static}; expected {expected}")


def belongs_to(variable: Any, model: pm.Model | None) -> bool:
    """Return True for a variable of `model`, and for one computed from such variables."""
    if model is None or not is_inferred(variable):
        return False
    named = set(model.root.named_vars.values())
    if variable in named:
        return True
    return not is_random(variable) and any(v in named for v in ancestors([variable]))


def _check_distribution(name: str, prior: Any) -> None:
    """Raise TypeError unless `prior` is a distribution that does not depend on a model."""
    if not is_inferred(prior) or not is_random(prior):
        raise TypeError(
            f"the prior of {name!r} is {prior!r}; expected a distribution such as "
            "pm.Uniform.dist(0, 50)"
        )
    # A distribution has no name until it is registered in a model.
    parents = [v for v in ancestors(prior.owner.inputs) if is_random(v)]
    linked = [v for v in (prior, *parents) if v.name]
    if _takes_scalars(prior.owner.op):
        linked += parents
    if linked:
        culprit = linked[0].name or linked[0]
        raise TypeError(
            f"the prior of {name!r} depends on the random variable {culprit!r}; expected an "
            "independent distribution, such as pm.Uniform.dist(0, 50). To use variables of your "
            "own model, call ph.inflation_model inside `with model:`, or ph.inflation_likelihood"
        )


def _check_number(name: str, value: Any, size: int | None) -> None:
    try:
        number = np.asarray(value, float)
    except (TypeError, ValueError):
        number = np.array(np.nan)
    if number.shape != (() if size is None else (size,)) or not np.isfinite(number).all():
        expected = "a number" if size is None else f"{size} numbers"
        raise TypeError(f"{name} is {value!r}; expected {expected}, or a distribution")


def _parameters_of(op: type) -> int | None:
    """Number of scalar parameters of a univariate distribution; None for any other."""
    symbolic = issubclass(op, SymbolicRandomVariable)
    signature = getattr(op, "extended_signature" if symbolic else "signature", None) or ""
    inputs = r"\[rng\],\[size\](,\(\))*->\[rng\]," if symbolic else r"(\(\),?)*->"
    return signature.count("()") - 1 if re.fullmatch(inputs + r"\(\)", signature) else None


# Distributions that can be stored, by name in PyMC: class, and number of scalar parameters.
_STORABLE: dict[str, tuple[Any, int]] = {
    name: (member, count)
    for name, member in vars(pm.distributions).items()
    if isinstance(op := getattr(member, "rv_type", None), type)
    and (count := _parameters_of(op)) is not None
}
_NAMES: dict[type, str] = {member.rv_type: member.__name__ for member, _ in _STORABLE.values()}


def prior_to_record(name: str, prior: Tensor) -> list[Any]:
    """Return a distribution as ``[name, parameters]``, or ``[name, parameters, size]`` of a vector.

    ValueError if the distribution is not univariate, or its parameters are not numbers.
    """
    node = prior.owner
    with suppress(KeyError, NotConstantValueError):
        distribution = _NAMES[type(node.op)]
        parameters = constant_fold(_in_double(node.op.dist_params(node)))
        return [distribution, [p.tolist() for p in parameters], *prior.type.shape]
    raise ValueError(
        f"the prior of {name!r} cannot be stored with the results; expected a univariate "
        "distribution of PyMC whose parameters are numbers, such as pm.Gamma.dist(2, 0.1)"
    )


def prior_from_record(record: Any, name: str = "") -> Tensor:
    """Return the distribution of a record of :func:`prior_to_record`; `name` is for messages.

    ValueError if it is no such record, which can only name distributions of PyMC.
    """
    try:
        distribution, parameters, *size = record
        member, count = _STORABLE[distribution]
        entries = [p if isinstance(p, list) else [p] for p in parameters]
        valid = (
            isinstance(parameters, list)
            and len(parameters) == count
            and len(size) <= 1
            and all(type(n) is int and n >= 1 for n in size)
            and all(len(p) in (1, *size) for p in entries)
            and all(is_number(x) and not isnan(x) for p in entries for x in p)
        )
    except (TypeError, ValueError, KeyError):
        valid = False
    if not valid:
        subject = f"the prior of {name!r}" if name else "a prior"
        raise ValueError(
            f"{subject} is {shown(record)}; expected [name, parameters], or [name, "
            "parameters, size] for a vector, with the name of a univariate distribution of PyMC "
            "and its parameters as numbers"
        )
    variables = [pt.constant(p, dtype="float64") for p in parameters]
    return _rebuild(member.rv_op, variables, size or None)


def priors_from_records(records: Any) -> dict[str, Tensor]:
    """Return the distributions of a dict of records, see :func:`prior_from_record`."""
    if not isinstance(records, dict):
        raise ValueError(f"priors are {shown(records)}; expected a JSON object of records by name")
    return {name: prior_from_record(record, name) for name, record in records.items()}


def draws_of(expressions: Sequence[Tensor], draws: int) -> list[NDArray]:
    """Return joint draws of random expressions, along the first axis of each."""
    with np.errstate(all="ignore"):
        return sampler(expressions)(draws, np.random.default_rng(1))


def positive_draws(name: str, prior: Tensor, count: int = RANGE_DRAWS) -> NDArray[np.float64]:
    """Return draws from the prior of a quantity; ValueError unless all are positive."""
    (draws,) = draws_of([prior], count)
    if not draws.min() > 0:  # also if draws are NaN
        raise ValueError(
            f"the prior of {name!r} has draws such as {draws.min():.3g}; expected a distribution "
            "of positive numbers, such as pm.LogNormal.dist(-1, 0.3)"
        )
    return draws


def is_inferred(value: Any) -> bool:
    """Return True if a quantity is a PyTensor variable rather than a number."""
    return isinstance(value, Variable)


def register_priors(priors: Mapping[str, Tensor]) -> dict[str, Tensor]:
    """Register priors as random variables of the model in context, see :func:`register_prior`."""
    return {name: register_prior(name, prior) for name, prior in priors.items()}


def register_prior(name: str, prior: Tensor) -> Tensor:
    """Register a copy of `prior` as a random variable of the model in context.

    A variable that already belongs to the model is returned unchanged.
    """
    model = pm.modelcontext(None)
    if belongs_to(prior, model):
        return prior
    node = prior.owner
    if _takes_scalars(node.op):
        parameters = _in_double(node.op.dist_params(node))
        copy = _rebuild(node.op, parameters, prior.type.shape or None)
    else:
        inputs = [_generator() if isinstance(x.type, RandomType) else x for x in node.inputs]
        copy = node.op.make_node(*inputs).outputs[node.outputs.index(prior)]
    return model.register_rv(copy, name=name)


def _in_double(variables: Sequence[Variable]) -> list[Variable]:
    """Copy variables with all constants in double precision; PyTensor stores 3 or 0.5 in less."""

    def is_short(v: Any) -> bool:
        dtype = getattr(v.type, "dtype", "")
        return dtype in ("float16", "float32") or (dtype in ("int8", "int16") and v.type.ndim == 0)

    numbers = [v for v in ancestors(variables) if isinstance(v, Constant) and is_short(v)]
    double = {v: pt.constant(v.data, dtype="float64") for v in numbers}
    return clone_replace(list(variables), double, rebuild_strict=False)


def _rebuild(op: Any, parameters: Sequence[Any], size: Sequence[int] | None) -> Tensor:
    """Make a distribution of the type `op` with a new random generator."""
    if isinstance(op, RandomVariable):
        return op(*parameters, size=size, rng=_generator(), return_next_rng=True)[1]
    return getattr(op, "rv_op", op)(*parameters, size=size)


def _takes_scalars(op: Any) -> bool:
    """Return True if the parameters are scalars, and none is another distribution."""
    is_basic = isinstance(op, RandomVariable) or str(op.extended_signature).startswith("[rng]")
    return is_basic and not any(op.ndims_params)


def _generator() -> Variable:
    return pytensor.shared(np.random.default_rng())
