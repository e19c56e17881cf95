"""The data as they were understood: a table of specimens, and the curves."""

from typing import Any

import numpy as np
import xarray as xr

from pymc_hyperelastic.data.inflation import (
    check_inflation_data,
    extension_tests,
    measured_radius,
)
from pymc_hyperelastic.data.select import specimens_apart
from pymc_hyperelastic.plots.inflation import plot_inflation
from pymc_hyperelastic.plots.style import per_kilopascal
from pymc_hyperelastic.reports.blocks import NOTE, Block, Found, Page, Table, Text, plural, short

_RANGES = {
    "axial_stretch": ("axial stretch", 1.0),
    "axial_force": ("axial force (mN)", 1.0),
    "inner_radius": ("inner radius at rest (mm)", 1.0),
    "outer_radius": ("outer radius at rest (mm)", 1.0),
    "opening_angle": ("opening angle (°)", 180 / np.pi),
}


def are_measurements(result: Any) -> bool:
    """Whether this is inflation data."""
    return isinstance(result, xr.Dataset) and {"pressure", "radius", "specimen"} <= set(
        result.variables
    )


def check_measurements(found: Found, page: Page) -> None:
    """Say if data are simulated, or not sound."""
    with page.listening(found.title):
        check_inflation_data(found.result)
    warn_of_simulated(found.result.attrs, page)


def warn_of_simulated(attrs: Any, page: Page) -> None:
    """Say it if data are simulated."""
    page.check("whether data are simulated")
    if attrs.get("simulated"):
        title = attrs.get("title") or "some of the data"
        page.notice(NOTE, f"The data are simulated, and nothing was measured: {title}.")


def show_measurements(found: Found, page: Page) -> list[Block]:
    """A table of the specimens, where the data come from, and their curves."""
    data: xr.Dataset = found.result
    if any(isinstance(known, xr.Dataset) and data.identical(known) for known in page.shown):
        return []
    page.shown.append(data)
    blocks: list[Block] = []
    said = [data.attrs.get(name) for name in ("title", "description", "source")]
    words = " ".join(f"{str(s).rstrip('.')}." for s in said if s)
    if words and words not in page.shown:
        page.shown.append(words)
        blocks.append(Text(words))
    blocks.append(_specimens(found.title, data, page.pressure_unit))
    of = {"axial_stretch" if len(specimens_apart(data)) == 1 else "group"}
    blocks += page.figure(
        plot_inflation,
        data,
        label=f"Measured curves: {found.title}",
        caption=f"Measured curves: {found.title}. {counted(data)}.",
        group_by=of.pop(),
        pressure_unit=page.pressure_unit,
    )
    return blocks


def counted(data: xr.Dataset) -> str:
    """How many specimens, experiments and points there are.

    >>> import pymc_hyperelastic as ph
    >>> counted(ph.load_dataset("simulated_sheep_aorta"))
    '5 specimens, 15 experiments, 300 points'
    """
    specimens = len(specimens_apart(data))
    extended = int(extension_tests(data).sum())
    tests = plural(data.sizes["test"], "experiment")
    if extended:
        tests += (
            f" ({extended} of them {'an extension test' if extended == 1 else 'extension tests'})"
        )
    return f"{plural(specimens, 'specimen')}, {tests}, {plural(data.sizes['obs'], 'point')}"


def _specimens(title: str, data: xr.Dataset, pressure_unit: str) -> Table:
    by_diameter = "outer_diameter" in data
    read = "outer diameter (mm)" if by_diameter else "internal radius (mm)"
    there = [name for name in _RANGES if name in data]
    columns = ["specimen", "group", "experiments", "points", read, f"pressure ({pressure_unit})"]
    columns += [_RANGES[name][0] for name in there]
    rows = []
    for specimen, own in specimens_apart(data).items():
        length = 2 * measured_radius(own) if by_diameter else measured_radius(own)
        groups = dict.fromkeys(str(g) for g in own["group"].values.tolist())
        row = [specimen, ", ".join(groups), own.sizes["test"], own.sizes["obs"]]
        row += [_range(length.values)]
        row += [_range(own["pressure"].values * per_kilopascal(pressure_unit))]
        row += [_range(own[name].values * _RANGES[name][1]) for name in there]
        rows.append(row)
    return Table(f"Specimens: {title}", columns, rows)


def _range(values: Any) -> float | str:
    """One number, or from where to where they reach."""
    known = values[np.isfinite(values)]
    if not known.size:
        return "not known"
    low, high = float(known.min()), float(known.max())
    return low if short(low) == short(high) else f"{short(low)}\u00a0to\u00a0{short(high)}"
