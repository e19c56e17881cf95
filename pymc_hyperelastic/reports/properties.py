"""Elastic properties in a report, at pressures that were measured or that the user gave."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pandas as pd
import xarray as xr
from numpy.typing import NDArray

from pymc_hyperelastic.data.inflation import extension_tests, held_stretches, points_of
from pymc_hyperelastic.evidence.results import thinned_draws
from pymc_hyperelastic.mechanics.reference_tube import Tube
from pymc_hyperelastic.mechanics.tube import GEOMETRY
from pymc_hyperelastic.models.settings import has_layers
from pymc_hyperelastic.plots.properties import plot_elastic_properties
from pymc_hyperelastic.plots.style import per_kilopascal
from pymc_hyperelastic.predictions.properties import tube_properties
from pymc_hyperelastic.quantities import unit_text
from pymc_hyperelastic.reports.fits import classes_of, tubes_in
from pymc_hyperelastic.reports.measurements import tube_in_words
from pymc_hyperelastic.reports.page import (
    PRESSURES,
    PROB,
    Interval,
    Page,
    in_words,
    interval_of,
    listed,
    percent,
)
from pymc_hyperelastic.rounding import short

Array = NDArray[np.float64]
# Intervals of properties by words, unit and pressure.
_Intervals = dict[tuple[str, str, float], Interval]

_PROPERTIES = [
    "compliance",
    "distensibility",
    "peterson_modulus",
    "incremental_modulus",
    "pulse_wave_velocity",
]


def show_properties(result: xr.DataTree, page: Page) -> None:
    """Add a figure and a table of elastic properties."""
    classes = classes_of(result, page)
    held = [tubes_in(tree) for tree in classes.values()]
    data = [tubes for tubes in held if tubes is not None]
    if not data or len(data) < len(held):
        return
    at = page.at
    if at.pressure is None:
        span = _common_pressures(data)
        if span is None:
            page.text(
                "Elastic properties are not shown: there is no pressure that all experiments "
                "reached. To show them, give ph.report pressures, as in at=[10, 12]."
            )
            return
        pressures = np.linspace(*span, PRESSURES) * per_kilopascal(at.pressure_unit)
        at = replace(at, pressure=pressures)
    middle = _middle_tube(data, layered=has_layers(next(iter(classes.values()))))
    of_tube = _tube_sentence(middle, at.geometry())
    at = replace(at, pressure_range=None, tube=Tube(**middle | at.geometry()))
    pressures = at.pressures
    if np.ptp(pressures) > 0:
        thinned = {name: thinned_draws(tree) for name, tree in classes.items()}
        page.figure(
            "Elastic properties over the pressure",
            plot_elastic_properties,
            xr.DataTree.from_dict(thinned),
            replace(at, pressure=np.linspace(pressures.min(), pressures.max(), 25)),
            note=f"{of_tube}Lines and bands: median and {percent(PROB)} interval.",
            warned=False,  # the table gives the same warnings, for all draws
            ci_prob=PROB,
        )
    found = {}
    for name, tree in classes.items():
        with page.catching(f"Elastic properties of {page.title}"):
            found[name] = _intervals(tube_properties(tree, at), pressures)
    if found:
        _show_table(found, at.pressure_unit, of_tube, page)
        _summarise(found, at.pressure_unit, page)


def _tube_sentence(middle: Mapping[str, float], given: Mapping[str, float]) -> str:
    """Describe the tube of the properties, from medians of measured tubes and given sizes."""
    if not middle and not given:
        return ""
    medians = "; other sizes are medians of the measured tubes" if given else ", medians"
    return f"All properties are those of one tube ({tube_in_words({**middle, **given})}{medians}). "


def _show_table(found: Mapping[str, _Intervals], unit: str, of_tube: str, page: Page) -> None:
    """Add a table with a row for each property and pressure, and a column for each class."""
    what = f"median ({percent(PROB)} interval)"
    headings = {name: f"class {name}" if len(found) > 1 else what for name in found}
    rows = []
    for words, of, pressure in next(iter(found.values())):
        row = {"property": words, f"pressure ({unit})": pressure, "unit": of}
        rows.append(row | {headings[name]: own[words, of, pressure] for name, own in found.items()})
    note = f"{what.capitalize()} of the posterior. " if len(found) > 1 else ""
    page.table("Elastic properties", pd.DataFrame(rows), f"{note}{of_tube}".strip())


def _summarise(found: Mapping[str, _Intervals], unit: str, page: Page) -> None:
    """Note the first property at the middle pressure, and the least certain property."""
    places = [*next(iter(found.values()))]
    middle = places[len(places) // (2 * len(_PROPERTIES)) * len(_PROPERTIES)]
    values = [f"{in_words(own[middle])} in {name}" for name, own in found.items()]
    words, of, pressure = middle
    page.values.append(
        f"The {words} at {short(pressure)} {unit} is {listed(values)}, in {of} (median, "
        f"{percent(PROB)} interval)."
    )
    for name, own in found.items():
        for (words, of, pressure), interval in own.items():
            page.uncertain(interval, f"the {words} of {name} at {short(pressure)} {unit}", of)


def _intervals(properties: xr.Dataset, pressures: Array) -> _Intervals:
    """Return median and interval of each property, by its words, unit and pressure."""
    found: _Intervals = {}
    for i, pressure in enumerate(pressures.tolist()):
        for key in _PROPERTIES:
            attrs = properties[key].attrs
            place = attrs["long_name"], unit_text(attrs["units"]), pressure
            found[place] = interval_of(properties[key].isel(pressure=i).values)
    return found


def _common_pressures(data: list[xr.Dataset]) -> tuple[float, float] | None:
    """Return the range of pressures, kPa, that all inflation tests reached; None without one."""
    low, high = 0.0, np.inf
    for of_class in data:
        for test in np.flatnonzero(~extension_tests(of_class)).tolist():
            own = of_class["pressure"].values[points_of(of_class, test)]
            low, high = max(low, float(own.min())), min(high, float(own.max()))
    return (low, high) if low < high < np.inf else None


def _middle_tube(data: list[xr.Dataset], layered: bool) -> dict[str, float]:
    """Return the medians of the dimensions in which the measured tubes differ."""
    tube = {}
    for name in GEOMETRY:
        if layered and name == "outer_radius":
            continue
        values = _finite([d[name].values for d in data])
        if values.size and np.ptp(values) > 0:
            # The held stretches of inflation tests; those of extension tests vary.
            held = _finite([held_stretches(d) for d in data]) if name == "axial_stretch" else values
            tube[name] = float(np.median(held if held.size else values))
    return tube


def _finite(values: list[Array]) -> Array:
    together = np.concatenate(values)
    return together[np.isfinite(together)]
