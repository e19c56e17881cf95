"""Numbers with units, and the likelihood, that options of the command line state."""

import re
from collections.abc import Mapping
from typing import Any, Literal

import pymc as pm
import xarray as xr

from pymc_hyperelastic.data.units import to_internal
from pymc_hyperelastic.models.likelihoods import (
    Gaussian,
    Likelihood,
    SlopeAugmented,
    balanced_slope_weight,
)

Quantity = Literal["pressure", "length", "force", "angle"]
UNKNOWN = "unknown"
# Quantity that has each size.
_QUANTITIES: dict[str, Quantity] = {
    "pressure_sd": "pressure",
    "sigma": "pressure",
    "force_sd": "force",
    "force_sigma": "force",
    "force_offset_sd": "force",
    "diameter_sd": "length",
}
# Scales of the half-normal priors of unknown sizes, by quantity. They are wide: an error as large
# as the scale is visible on a curve of an artery.
_PRIOR_SDS: dict[Quantity, float] = {
    "pressure": 1.0,  # kPa
    "force": 10.0,  # mN
    "length": 0.05,  # mm
}


def likelihood_of_options(
    sizes: Mapping[str, str | None], slope_weight: float | None, data: xr.Dataset
) -> Likelihood:
    """Return the likelihood of the options ``--pressure-sd``, ``--sigma`` and so on.

    Parameters
    ----------
    sizes : dict of str to str
        Texts such as ``"2 mmHg"`` or ``"unknown"`` by the name of a size; None if not given.
    slope_weight : float, optional
        The weight of slopes, mm².
    data : xarray.Dataset
        Inflation data, for the balanced slope weight.

    Raises
    ------
    ValueError
        If a size is no number with a unit, or options exclude each other.
    """
    given = {name: text for name, text in sizes.items() if text is not None}
    with_slopes = "sigma" in given
    excluded = ("pressure_sd", "force_sd", "diameter_sd") if with_slopes else ("force_sigma",)
    for name in excluded:
        if name in given:
            other = "belongs to --pressure-sd, not to" if with_slopes else "needs"
            raise ValueError(f"{_option(name)} {other} --sigma: leave one of the two away")
    if slope_weight is not None and not with_slopes:
        raise ValueError(
            "--slope-weight is given without --sigma: give --sigma, √2 standard deviations of "
            "pressures, in place of --pressure-sd; or leave --slope-weight away"
        )
    errors = {name: _error(name, text) for name, text in given.items()}
    if not with_slopes:
        return Gaussian(**{"pressure_sd": _error("pressure_sd", UNKNOWN)} | errors)
    weight = balanced_slope_weight(data) if slope_weight is None else slope_weight
    return SlopeAugmented(slope_weight=weight, **errors)


def size_of(name: str, text: str, quantity: Quantity) -> float:
    """Return a positive number with its unit, in the unit of the package.

    Raises
    ------
    ValueError
        If the text is something else.
    """
    option = _option(name)
    found = re.fullmatch(r"\s*([-+\d.eE]+)\s*([^\d\s].*?)\s*", text)
    try:
        number = float(found[1])  # type: ignore[index]
    except (TypeError, ValueError):
        raise ValueError(
            f"{option} is {text!r}; expected a number and its unit, as in '2 mmHg'"
        ) from None
    if not number > 0:
        raise ValueError(f"{option} is {text!r}; expected a positive number")
    assert found is not None
    return float(to_internal(number, found[2], quantity, keyword=option))


def _error(name: str, text: str) -> Any:
    """Return the size of an error; for an unknown size, its prior."""
    quantity = _QUANTITIES[name]
    if text == UNKNOWN and name != "force_offset_sd":
        return pm.HalfNormal.dist(_PRIOR_SDS[quantity])
    return size_of(name, text, quantity)


def _option(name: str) -> str:
    return f"--{name.replace('_', '-')}"
