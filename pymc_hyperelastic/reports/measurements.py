"""Measured data in a report: a table of specimens, or of tests of sheets, and the curves."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from pymc_hyperelastic.data.inflation import check_data, extension_tests, measured_radius
from pymc_hyperelastic.data.select import specimens_apart, tests_at
from pymc_hyperelastic.data.sheets import sheets_of, tubes_of
from pymc_hyperelastic.data.variables import OPTIONAL_LABELS, STRESS_MEASURE
from pymc_hyperelastic.plots.inflation import plot_inflation
from pymc_hyperelastic.plots.sheet_tests import plot_sheet_tests
from pymc_hyperelastic.plots.style import per_kilopascal
from pymc_hyperelastic.reports.page import NOTE, Page, listed, plural
from pymc_hyperelastic.rounding import short

# Heading of each quantity of the table. Angles are shown in degrees.
_HEADINGS = {
    "axial_stretch": "axial stretch",
    "axial_force": "axial force (mN)",
    "inner_radius": "inner radius without load (mm)",
    "outer_radius": "outer radius without load (mm)",
    "opening_angle": "opening angle (°)",
}

# Stretch along an axis in which a sheet is free.
_FREE = "free"


def tube_in_words(sizes: Mapping[str, float]) -> str:
    """Return the sizes of a tube in words.

    >>> tube_in_words({"inner_radius": 3.783, "opening_angle": 1.0})
    'inner radius without load 3.783 mm and opening angle 57.3°'
    """
    words = []
    for name, size in sizes.items():
        heading = _HEADINGS.get(name, name.replace("_", " "))
        text, _, unit = heading.removesuffix(")").partition(" (")
        words.append(f"{text} {short(_as_shown(name, size))} {unit}".rstrip().replace(" °", "°"))
    return listed(words)


def _as_shown(name: str, value: Any) -> Any:
    return np.degrees(value) if name == "opening_angle" else value


def warn_of_simulated(attrs: Any, page: Page) -> None:
    """Add a notice if data are simulated."""
    if attrs.get("simulated"):
        title = attrs.get("title") or page.title
        todo = "Do not report the results as those of vessels"
        page.notice(NOTE, "these data are simulated, not measured", todo, title)


def show_measurements(data: xr.Dataset, page: Page) -> None:
    """Add where the data come from, a table of the specimens, and the curves."""
    with page.catching(page.title):
        check_data(data)
    warn_of_simulated(data.attrs, page)
    if any(data.identical(shown) for shown in page.data):
        return
    page.data.append(data)
    texts = [data.attrs.get(name) for name in ("title", "description", "source")]
    words = " ".join(f"{str(text).rstrip('.')}." for text in texts if text)
    if words and words not in page.shown:
        page.shown.add(words)
        page.text(words)
    tubes, sheets = tubes_of(data), sheets_of(data)
    if tubes is not None:
        _show_tubes(tubes, page, alone=sheets is None)
    if sheets is not None:
        _show_sheets(sheets, page, alone=tubes is None)


def _show_tubes(data: xr.Dataset, page: Page, alone: bool) -> None:
    specimens = specimens_apart(data)
    rows = [_specimen_row(name, own, page.at.pressure_unit) for name, own in specimens.items()]
    page.table("Specimens" if alone else "Specimens, tubes", pd.DataFrame(rows))
    page.figure(
        "Measured curves" if alone else "Measured curves of tubes",
        plot_inflation,
        data,
        note=f"{_counts(data, len(specimens))}.",
        group_by="axial_stretch" if len(specimens) == 1 else "group",
        pressure_unit=page.at.pressure_unit,
    )


def _show_sheets(data: xr.Dataset, page: Page, alone: bool) -> None:
    rows = [_sheet_row(tests_at(data, [test])) for test in range(data.sizes["test"])]
    free = any(_FREE in row.values() for row in rows)
    note = "Along an axis in which the sheet was free no stretch is needed." if free else ""
    page.table("Tests of sheets", pd.DataFrame(rows), note)
    count = len(dict.fromkeys(data["specimen"].values.tolist()))
    page.figure(
        "Measured stresses" if alone else "Measured stresses of sheets",
        plot_sheet_tests,
        data,
        note=f"{_counts(data, count)}.",
    )


def _sheet_row(test: xr.Dataset) -> dict[str, Any]:
    """Return a row of the table of tests of sheets."""
    labels = ("specimen", "group", "experiment", *OPTIONAL_LABELS)
    row: dict[str, Any] = {
        name: str(test[name].values[0]) for name in labels if name in test.coords
    }
    measure = str(test["stress_measure"].values[0]).replace("cauchy", "Cauchy")
    row |= {"points": test.sizes["obs"], "stress": measure}
    for axis in "xy":
        free = not np.isfinite(test[f"stretch_{axis}"].values).any()
        row[f"stretch along {axis}"] = _FREE if free else _range(test[f"stretch_{axis}"])
        row[f"stress along {axis} (kPa)"] = _range(test[f"stress_{axis}"])
    return row


def _counts(data: xr.Dataset, specimens: int) -> str:
    tests = plural(data.sizes["test"], "test")
    if STRESS_MEASURE not in data.variables and (extended := int(extension_tests(data).sum())):
        tests += f" (including {plural(extended, 'extension test')})"
    return f"{plural(specimens, 'specimen')}, {tests}, {plural(data.sizes['obs'], 'point')}"


def _specimen_row(name: str, own: xr.Dataset, pressure_unit: str) -> dict[str, Any]:
    if "outer_diameter" in own:
        heading, length = "outer diameter (mm)", 2 * measured_radius(own)
    else:
        heading, length = "internal radius (mm)", measured_radius(own)
    row = {
        "specimen": name,
        "group": ", ".join(dict.fromkeys(own["group"].values.astype(str).tolist())),
        "tests": own.sizes["test"],
        "points": own.sizes["obs"],
        heading: _range(length),
        f"pressure ({pressure_unit})": _range(own["pressure"] * per_kilopascal(pressure_unit)),
    }
    return row | {
        heading: _range(_as_shown(name, own[name]))
        for name, heading in _HEADINGS.items()
        if name in own
    }


def _range(values: xr.DataArray) -> float | str:
    """Return one number, or the text ``"low to high"``."""
    known = values.values[np.isfinite(values.values)]
    if not known.size:
        return "not known"
    low, high = float(known.min()), float(known.max())
    return low if short(low) == short(high) else f"{short(low)}\u00a0to\u00a0{short(high)}"
