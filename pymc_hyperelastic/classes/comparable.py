"""Check that evidences of strain energies are comparable: same data and same likelihood."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import xarray as xr

from pymc_hyperelastic.messages import warn_user
from pymc_hyperelastic.models.settings import (
    holds_inflation_data,
    inflation_data_of,
    model_settings_of,
)


class Fit(NamedTuple):
    """Fitted results of one strain energy."""

    label: str
    fitted: Mapping[str, xr.DataTree]
    """Results by class; a single result has the name ``""``."""
    likelihood: str | None
    """The likelihood in words; None if the result does not state it."""


def likelihood_said(tree: xr.DataTree) -> str | None:
    """Return the likelihood of one result in words; None if the result does not state it."""
    settings = model_settings_of(tree)
    likelihood = None if settings is None else settings.make_likelihood()
    if settings is None or likelihood is None:
        return None
    if settings.variability == "none":
        return f"the likelihood {likelihood!r}"
    # Errors belong to each specimen and may differ between laws; the signals may not.
    forces = " and forces" if likelihood.with_force else ""
    return f"variability={settings.variability!r}, of pressures{forces}"


def check_comparable(fits: Sequence[Fit], argument: str) -> None:
    """Raise ValueError, naming the difference, unless the evidences of the fits are comparable.

    Warn about fits that do not record their data or likelihood. `argument` is the name of the
    user's argument, for messages.
    """
    first = fits[0]
    for fit in fits:
        if list(fit.fitted) != list(first.fitted):
            raise ValueError(
                f"{argument} holds {fit.label} with the classes {list(fit.fitted)}, but "
                f"{first.label} has the classes {list(first.fitted)}: give results with the same "
                "classes"
            )
        if None not in (fit.likelihood, first.likelihood) and fit.likelihood != first.likelihood:
            raise ValueError(
                f"{argument} holds {fit.label} with {fit.likelihood}, but {first.label} has "
                f"{first.likelihood}: their evidences do not compare"
            )
        for name, tree in fit.fitted.items():
            data = [_data_of(t) for t in (tree, first.fitted[name])]
            differs = _what_differs(*data) if data[0] is not None and data[1] is not None else ""
            if differs:
                of = f"class {name!r} has other training data" if name else "there are other data"
                raise ValueError(
                    f"{of} under {fit.label} than under {first.label} ({differs}): their evidences "
                    "do not compare"
                )
    _warn_of_unknown(fits, argument)


def _warn_of_unknown(fits: Sequence[Fit], argument: str) -> None:
    """Warn about fits that do not record their data or likelihood."""
    if len(fits) == 1:
        return
    for fit in fits:
        recorded = {
            "from which inflation data": all(_data_of(t) is not None for t in fit.fitted.values()),
            "with which likelihood": fit.likelihood is not None,
        }
        unknown = " and ".join(what for what, is_recorded in recorded.items() if not is_recorded)
        if unknown:
            warn_user(
                f"{argument}: {fit.label} does not say {unknown} it was made; evidences compare "
                "only for the same data and likelihood: check that all fits have the same"
            )


def _data_of(tree: xr.DataTree) -> xr.Dataset | None:
    """Return the inflation data of a result; None if the model has other data."""
    return inflation_data_of(tree) if holds_inflation_data(tree) else None


def _what_differs(one: xr.Dataset, other: xr.Dataset) -> str:
    """Describe how two sets of inflation data differ; return an empty string if they are equal."""
    if one.equals(other):
        return ""
    for dim, things in (("test", "tests"), ("obs", "points")):
        if one.sizes[dim] != other.sizes[dim]:
            return f"{one.sizes[dim]} {things}, not {other.sizes[dim]}"
    names = dict.fromkeys([*one.variables, *other.variables])
    equal = {
        n for n in names if n in one and n in other and one[n].variable.equals(other[n].variable)
    }
    return "in " + ", ".join(str(name) for name in names if name not in equal)
