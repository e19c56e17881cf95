"""Priors of material parameters: documented defaults, the user's own, and how they are stored."""

from typing import Any

import numpy as np
import pymc as pm
import pytensor
from pymc.exceptions import NotConstantValueError
from pymc.pytensorf import constant_fold
from pytensor.graph.basic import Constant, Variable
from pytensor.tensor.random.op import RandomVariable
from pytensor.tensor.random.type import RandomType
from pytensor.tensor.variable import TensorVariable

from pymc_hyperelastic.strain_energy.base import StrainEnergy

__all__ = ["check_prior", "complete_priors", "prior_from_record", "prior_to_record"]


def complete_priors(
    energy: StrainEnergy, priors: dict[str, TensorVariable] | None = None
) -> dict[str, TensorVariable]:
    """Priors of all parameters of `energy`: those given, and uniform defaults for the others.

    A default prior is uniform over :attr:`Parameter.prior_range`, as in the paper. It is a fixed
    physical range and knows nothing of the data.

    Parameters
    ----------
    energy : StrainEnergy
        The material.
    priors : dict of str to TensorVariable, optional
        Distributions such as ``{"mu": pm.Uniform.dist(0, 50)}``.

    Returns
    -------
    dict of str to TensorVariable
        One distribution for each parameter, in the order of the strain energy.

    Raises
    ------
    TypeError
        If a prior is not a distribution.
    ValueError
        If a name is not a parameter of the strain energy.

    Examples
    --------
    >>> import pymc as pm, pymc_hyperelastic as ph
    >>> from pymc_hyperelastic.priors import complete_priors
    >>> list(complete_priors(ph.Ogden(), {"alpha": pm.Uniform.dist(0, 20)}))
    ['mu', 'alpha']
    """
    given = dict(priors or {})
    for name, prior in given.items():
        if name not in energy.parameter_names:
            raise ValueError(
                f"a prior is given for {name!r}, but {energy.name} has the parameters "
                f"{list(energy.parameter_names)}"
            )
        check_prior(name, prior)
    return {
        p.name: given[p.name] if p.name in given else pm.Uniform.dist(*p.prior_range)
        for p in energy.parameters
    }


def check_prior(name: str, prior: Any) -> None:
    """Raise TypeError unless `prior` is a scalar distribution that belongs to no model yet."""
    if not isinstance(prior, TensorVariable) or prior.owner is None:
        raise TypeError(
            f"the prior of {name!r} is {prior!r}; expected a distribution such as "
            "pm.Uniform.dist(0, 50)"
        )
    if prior.ndim:
        raise TypeError(f"the prior of {name!r} has {prior.ndim} dimension(s); expected a scalar")


def prior_to_record(name: str, prior: TensorVariable) -> list[Any]:
    """Distribution as ``[name, parameters]``, for attributes of a file.

    Raises
    ------
    ValueError
        If the distribution is not one of PyMC's own with fixed parameters.
    """
    node = prior.owner
    distribution = _DISTRIBUTIONS.get(type(node.op))
    try:
        if distribution is not None:
            parameters = constant_fold(node.op.dist_params(node))
            return [distribution, [float(p) for p in parameters]]
    except NotConstantValueError:
        pass
    raise ValueError(
        f"the prior of {name!r} cannot be stored with the results: use one of PyMC's univariate "
        "distributions with numbers for parameters, such as pm.Gamma.dist(2, 0.1)"
    )


def prior_from_record(record: list[Any]) -> TensorVariable:
    """Distribution from what :func:`prior_to_record` stored."""
    name, parameters = record
    return getattr(pm, name).rv_op(*(np.float64(p) for p in parameters))


# PyMC's distributions by the type of the random variable that they make.
_DISTRIBUTIONS = {
    type(member.rv_op): name
    for name, member in vars(pm.distributions).items()
    if isinstance(member, type) and isinstance(getattr(member, "rv_op", None), RandomVariable)
}


def is_inferred(value: Any) -> bool:
    """Whether a quantity is a variable, and not a number."""
    return isinstance(value, Variable)


def register_prior(name: str, prior: TensorVariable) -> TensorVariable:
    """Make `prior` a random variable of the model in context.

    A copy is registered: one distribution may serve several models, or several parameters.
    """
    node = prior.owner
    inputs = [
        pytensor.shared(np.random.default_rng()) if isinstance(x.type, RandomType) else _as_float(x)
        for x in node.inputs
    ]
    copy = node.op.make_node(*inputs).outputs[node.outputs.index(prior)]
    return pm.modelcontext(None).register_rv(copy, name=name)


def _as_float(x: Variable) -> Variable:
    # In PyTensor the logarithm of a small integer has single precision.
    small_integer = isinstance(x, Constant) and getattr(x.type, "dtype", "") in ("int8", "int16")
    return x.astype("float64") if small_integer and x.type.ndim == 0 else x
