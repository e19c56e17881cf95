"""Numbers with units, and the likelihood, that options of the command line state."""

import re
from collections.abc import Mapping
from typing import Any

import pymc as pm
import xarray as xr

from pymc_hyperelastic.data.sheets import sheets_of, tubes_of
from pymc_hyperelastic.data.units import to_internal
from pymc_hyperelastic.models.likelihoods import (
    Gaussian,
    Likelihood,
    SlopeAugmented,
    balanced_slope_weight,
)
from pymc_hyperelastic.models.likelihoods.errors import SIZES

UNKNOWN = "unknown"
# Quantity that has each unit of the package.
_QUANTITIES = {"kPa": "pressure", "mN": "force", "mm": "length"}
# Sizes of a Gaussian likelihood only.
_WITHOUT_SLOPES = ("pressure_sd", "force_sd", "diameter_sd", "stress_sd")
# Sizes of a slope-augmented likelihood only.
_WITH_SLOPES = ("force_sigma", "slope_weight")
# Scales of the half-normal priors of sizes that may be unknown, in kPa, mN and mm. They are wide:
# an error as large as the scale is visible on a curve of an artery. Stresses of sheets are several
# times the pressures of tubes.
_PRIOR_SDS = {
    "pressure_sd": 1.0,
    "sigma": 1.0,
    "force_sd": 10.0,
    "force_sigma": 10.0,
    "diameter_sd": 0.05,
    "stress_sd": 10.0,
}


def likelihood_of_options(
    options: Mapping[str, str | float | None], table: Mapping[str, str | float], data: xr.Dataset
) -> Likelihood:
    """Return the likelihood of the options ``--pressure-sd``, ``--sigma`` and so on.

    Parameters
    ----------
    options : dict of str to str or float
        Texts such as ``"2 mmHg"`` or ``"unknown"`` by the name of a size, and a number for
        ``slope_weight``; None if not given.
    table : dict of str to str or float
        The table ``[likelihood]`` of a settings file. An option replaces its value.
    data : xarray.Dataset
        The tests: their kinds, and the balanced slope weight.

    Raises
    ------
    ValueError
        If a size is no number with a unit, or sizes exclude each other.
    """
    given = {name: value for name, value in options.items() if value is not None}
    places = {name: f"likelihood.{name}" for name in table}
    places |= {name: f"--{name.replace('_', '-')}" for name in given}
    values: dict[str, str | float] = {**table, **given}
    known = [*_PRIOR_SDS, "force_offset_sd", "slope_weight"]
    for name in values:
        if name not in known:
            raise ValueError(f"{places[name]} is not known; expected some of {known}")
    with_slopes = "sigma" in values
    for name in _WITHOUT_SLOPES if with_slopes else _WITH_SLOPES:
        if name in values:
            if with_slopes:
                raise ValueError(
                    f"{places[name]} and {places['sigma']} are given, of which one excludes the "
                    "other: leave one of them away"
                )
            raise ValueError(
                f"{places[name]} is given, but it belongs to sigma: give sigma, or leave "
                f"{places[name]} away"
            )
    weight = values.pop("slope_weight", None)
    if not with_slopes and tubes_of(data) is not None:
        values.setdefault("pressure_sd", UNKNOWN)
    if sheets_of(data) is not None:
        values.setdefault("stress_sd", UNKNOWN)
    errors: dict[str, Any] = {}
    for name, value in values.items():
        if value == UNKNOWN and name in _PRIOR_SDS:
            errors[name] = pm.HalfNormal.dist(_PRIOR_SDS[name])
        else:
            errors[name] = size_of(places[name], value, _QUANTITIES[SIZES[name].unit])
    if not with_slopes:
        return Gaussian(**errors)
    weight = balanced_slope_weight(data) if weight is None else weight
    return SlopeAugmented(slope_weight=weight, **errors)


def size_of(place: str, text: str | float, quantity: str) -> float:
    """Return a positive number with its unit, in the unit of the package.

    The `place` is where the user wrote it, such as ``--pressure-sd``, for messages.

    Raises
    ------
    ValueError
        If the text is something else.
    """
    found = re.fullmatch(r"\s*([-+\d.eE]+)\s*([^\d\s.].*?)\s*", str(text))
    try:
        number = float(found[1])  # type: ignore[index]
    except (TypeError, ValueError):
        raise ValueError(
            f"{place} is {text!r}; expected a number and its unit, as in '2 mmHg'"
        ) from None
    if not number > 0:
        raise ValueError(f"{place} is {text!r}; expected a positive number")
    assert found is not None
    return float(to_internal(number, found[2], quantity, keyword=place))
