"""Checks of the model and the numbers that a user gives."""

from collections.abc import Sequence
from numbers import Integral, Real
from typing import Any

import numpy as np
import pymc as pm
import pytensor
from numpy.typing import NDArray
from pymc.distributions.censored import CensoredRV
from pymc.distributions.distribution import DiracDeltaRV
from pymc.vartypes import discrete_types
from pytensor.graph.traversal import ancestors

# Distributions of floats of which some value has a positive probability. Hurdle distributions, and
# mixtures of a spike and a slab, have a DiracDelta as a component.
_WITH_POINT_MASS = CensoredRV, DiracDeltaRV


def check_count(name: str, value: Any, least: int) -> None:
    """Raise unless `value` is a whole number, `least` at least."""
    if not isinstance(value, Integral) or isinstance(value, bool):
        raise TypeError(f"{name} is {value!r}; expected a whole number")
    if value < least:
        raise ValueError(f"{name} is {value}; expected at least {least}")


def check_fraction(name: str, value: Any) -> None:
    """Raise unless `value` is a number between 0 and 1, neither of them included."""
    if not isinstance(value, Real) or not 0 < float(value) < 1:
        raise ValueError(f"{name} is {value!r}; expected a number between 0 and 1")


def check_names(var_names: Sequence[str] | None, known: Sequence[str]) -> None:
    """Raise unless `var_names` is a list of names of known variables, or None."""
    if isinstance(var_names, str):
        raise TypeError(f"var_names must be a list of names, not {var_names!r}")
    lacking = [name for name in var_names or () if name not in known]
    if lacking:
        raise ValueError(f"the model has no variables {lacking}; it has {list(known)}")


def check_shape(what: str, shape: Sequence[int], expected: Sequence[int | None]) -> None:
    """Raise unless a shape is the expected one, in which None is any size."""
    fits = [n in (None, m) for n, m in zip(expected, shape, strict=False)]
    if len(expected) != len(shape) or not all(fits):
        raise ValueError(
            f"{what} has the shape {tuple(shape)}, the model's {tuple(expected)}: do they belong "
            "together?"
        )


def check_precision() -> None:
    """Raise if PyTensor computes with half of the digits that this package needs."""
    if pytensor.config.floatX != "float64":
        raise ValueError(
            f"PyTensor's floatX is {pytensor.config.floatX!r}, and integrals over walls and "
            'evidences need float64: set pytensor.config.floatX = "float64" before the model is '
            "made"
        )


def check_model(model: Any) -> None:
    """Raise unless `model` is a PyMC model, and no part of another one."""
    check_precision()
    if not isinstance(model, pm.Model):
        raise TypeError(f"expected a pm.Model, not {type(model).__name__}")
    if not model.isroot:
        raise ValueError(
            f"the model {model.name!r} is a part of another one: take the whole, its `model.root`"
        )


def check_continuous(model: pm.Model, who: str = "expected") -> None:
    """Raise unless the model has free variables, all of them with a density."""
    discrete = [v.name for v in model.value_vars if v.dtype in discrete_types]
    if discrete or not model.value_vars:
        what = f"discrete: {discrete}" if discrete else "none"
        raise ValueError(f"{who} a model with continuous free variables; here are {what}")
    if point_masses := [rv.name for rv in model.free_RVs if _has_point_mass(rv)]:
        raise ValueError(
            f"{who} a model whose free variables have densities; the priors of {point_masses} give "
            "a single value a positive probability (pm.DiracDelta, pm.Censored, a hurdle): compare "
            "the evidences of a model with this value and of a model with a continuous prior"
        )


def _has_point_mass(variable: Any) -> bool:
    return any(v.owner and isinstance(v.owner.op, _WITH_POINT_MASS) for v in ancestors([variable]))


def check_repeatable(log_density: NDArray[np.floating], again: NDArray[np.floating]) -> None:
    """Raise if the log density of the same points differs when it is computed `again`."""
    if not np.allclose(again, log_density):
        raise ValueError(
            "the density of the model is random: the same point had another one when it was "
            "computed again. Such a model has no evidence"
        )


def no_progress(*_: Any) -> None:
    """Progress that nobody watches."""
