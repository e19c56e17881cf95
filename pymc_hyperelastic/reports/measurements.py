"""Inflation data in a report: a table of specimens, and the curves."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from pymc_hyperelastic.data.inflation import (
    check_data,
    extension_tests,
    measured_radius,
)
from pymc_hyperelastic.data.select import specimens_apart
from pymc_hyperelastic.plots.inflation import plot_inflation
from pymc_hyperelastic.plots.style import per_kilopascal
from pymc_hyperelastic.reports.page import NOTE, Page, listed, plural
from pymc_hyperelastic.rounding import short

# Heading and unit, in units of the package, of each quantity of the table.
_QUANTITIES = {
    "axial_stretch": ("axial stretch", 1.0),
    "axial_force": ("axial force (mN)", 1.0),
    "inner_radius": ("inner radius without load (mm)", 1.0),
    "outer_radius": ("outer radius without load (mm)", 1.0),
    "opening_angle": ("opening angle (°)", np.pi / 180),
}


def tube_in_words(sizes: Mapping[str, float]) -> str:
    """Return the sizes of a tube in words.

    >>> tube_in_words({"inner_radius": 3.783, "opening_angle": 1.0})
    'inner radius without load 3.783 mm and opening angle 57.3°'
    """
    words = []
    for name, size in sizes.items():
        heading, unit = _QUANTITIES.get(name, (name.replace("_", " "), 1.0))
        text, _, of = heading.removesuffix(")").partition(" (")
        words.append(f"{text} {short(size / unit)} {of}".rstrip().replace(" °", "°"))
    return listed(words)


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
    specimens = specimens_apart(data)
    rows = [_specimen_row(name, own, page.at.pressure_unit) for name, own in specimens.items()]
    page.table("Specimens", pd.DataFrame(rows))
    page.figure(
        "Measured curves",
        plot_inflation,
        data,
        note=f"{_counts(data, len(specimens))}.",
        group_by="axial_stretch" if len(specimens) == 1 else "group",
        pressure_unit=page.at.pressure_unit,
    )


def _counts(data: xr.Dataset, specimens: int) -> str:
    extended = int(extension_tests(data).sum())
    tests = plural(data.sizes["test"], "experiment")
    if extended:
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
        "experiments": own.sizes["test"],
        "points": own.sizes["obs"],
        heading: _range(length),
        f"pressure ({pressure_unit})": _range(own["pressure"] * per_kilopascal(pressure_unit)),
    }
    there = {key: of for key, of in _QUANTITIES.items() if key in own}
    return row | {text: _range(own[key] / unit) for key, (text, unit) in there.items()}


def _range(values: xr.DataArray) -> float | str:
    """Return one number, or the text ``"low to high"``."""
    known = values.values[np.isfinite(values.values)]
    if not known.size:
        return "not known"
    low, high = float(known.min()), float(known.max())
    return low if short(low) == short(high) else f"{short(low)}\u00a0to\u00a0{short(high)}"
