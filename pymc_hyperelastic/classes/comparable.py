"""Whether evidences of laws compare: they do where data, noise and likelihood are the same."""

import warnings
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import xarray as xr

from pymc_hyperelastic.files.place import PACKAGE
from pymc_hyperelastic.files.stored import read_json, read_text
from pymc_hyperelastic.models.study import holds_inflation_data, inflation_data_of


class Fit(NamedTuple):
    """A law that was fitted."""

    label: str
    fitted: Mapping[str, xr.DataTree]
    """By class; a result that is no class by itself has the name ``""``."""
    noise: str | None
    """How measurements differ from curves, in words; None if the result does not say."""


def noise_of(tree: xr.DataTree) -> str | None:
    """How measurements differ from curves, by what one result says of noise and likelihood."""
    if "variability" in tree.attrs:
        # Noise is a part of such a model, and may differ; what was measured may not.
        settings = read_json(tree, "variability_settings", {})
        forces = " and forces" if {"force_sigma", "force_noise_sd"} & set(settings) else ""
        return f"variability={read_text(tree, 'variability')!r}, of pressures{forces}"
    noise, likelihood = read_text(tree, "noise", None), read_text(tree, "likelihood", None)
    if noise is None:
        return None
    return f"the noise {noise}" + (f" and the likelihood {likelihood!r}" if likelihood else "")


def check_comparable(fits: Sequence[Fit], argument: str) -> None:
    """Raise, naming what differs, unless the evidences of these laws compare.

    The `argument` is that by which they were given. Of what does not say how it was made, it is
    warned: nothing is known against it.
    """
    first = fits[0]
    for fit in fits:
        if list(fit.fitted) != list(first.fitted):
            raise ValueError(
                f"{argument} holds the classes {list(fit.fitted)}, not {list(first.fitted)} as the "
                "others"
            )
        if None not in (fit.noise, first.noise) and fit.noise != first.noise:
            raise ValueError(
                f"{argument} holds {fit.label} with {fit.noise}, but {first.label} has "
                f"{first.noise}: their evidences do not compare"
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
    """Warn of what does not say from which data, or with which noise, it was made."""
    if len(fits) == 1:
        return
    for fit in fits:
        known = {
            "from which inflation data": all(_data_of(t) is not None for t in fit.fitted.values()),
            "with which noise": fit.noise is not None,
        }
        unknown = " and ".join(what for what, is_known in known.items() if not is_known)
        if unknown:
            warnings.warn(
                f"{argument}: {fit.label} does not say {unknown} it was made; evidences compare "
                "only under the same data, noise and likelihood: see to it that they are",
                skip_file_prefixes=(PACKAGE,),
            )


def _data_of(tree: xr.DataTree) -> xr.Dataset | None:
    """Inflation data of a result; none of a model of something else."""
    return inflation_data_of(tree) if holds_inflation_data(tree) else None


def _what_differs(one: xr.Dataset, other: xr.Dataset) -> str:
    """In what two sets of inflation data differ; nothing if they are equal."""
    if one.equals(other):
        return ""
    for dim, things in (("test", "tests"), ("obs", "points")):
        if one.sizes[dim] != other.sizes[dim]:
            return f"{one.sizes[dim]} {things}, not {other.sizes[dim]}"
    names = dict.fromkeys([*one.variables, *other.variables])
    alike = {
        n for n in names if n in one and n in other and one[n].variable.equals(other[n].variable)
    }
    return "in " + ", ".join(str(name) for name in names if name not in alike)
