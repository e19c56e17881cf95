"""Elastic properties in a report, at pressures that were measured or that the user gave."""

from dataclasses import replace

import numpy as np
import pandas as pd
import xarray as xr
from numpy.typing import NDArray

from pymc_hyperelastic.data.inflation import extension_tests, held_stretches, points_of
from pymc_hyperelastic.evidence.results import thinned_draws
from pymc_hyperelastic.mechanics.reference_tube import Tube
from pymc_hyperelastic.mechanics.tube import GEOMETRY
from pymc_hyperelastic.models.settings import has_layers, inflation_data_of
from pymc_hyperelastic.plots.properties import plot_elastic_properties
from pymc_hyperelastic.plots.style import per_kilopascal
from pymc_hyperelastic.predictions.conditions import Conditions
from pymc_hyperelastic.predictions.properties import tube_properties
from pymc_hyperelastic.reports.fits import PROB, classes_of, has_data
from pymc_hyperelastic.reports.page import Page, interval_ends

Array = NDArray[np.float64]

# Pressures of the table, unless the user gives them.
_IN_TABLE = 3
# Pressures of the figure.
_IN_FIGURE = 25
# Draws of a class in the figure: more are slow, and change no line visibly.
_DRAWN = 1000
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
    if not all(map(has_data, classes.values())):
        return
    data = [inflation_data_of(tree) for tree in classes.values()]
    at = page.at
    if at.pressure is None:
        span = _common_pressures(data)
        if span is None:
            page.text("There is no pressure that all experiments reached.")
            return
        pressures = np.linspace(*span, _IN_TABLE) * per_kilopascal(at.pressure_unit)
        at = replace(at, pressure=pressures)
    middle = _middle_tube(data, layered=has_layers(next(iter(classes.values()))))
    of_tube = "The tube is the median of the measured ones. " if middle else ""
    if at.tube is not None:
        of_tube = f"The tube is {at.tube}, with medians of what it does not state. "
    at = replace(at, pressure_range=None, tube=Tube(**middle | at.geometry()))
    pressures = at.pressures
    if np.ptp(pressures) > 0:
        thinned = {name: thinned_draws(tree, _DRAWN) for name, tree in classes.items()}
        page.figure(
            "Elastic properties over the pressure",
            plot_elastic_properties,
            xr.DataTree.from_dict(thinned),
            replace(at, pressure=np.linspace(pressures.min(), pressures.max(), _IN_FIGURE)),
            note=f"{of_tube}Lines and bands: median and {100 * PROB:.3g} % interval.",
            warned=False,  # the table gives the same warnings, for all draws
            ci_prob=PROB,
        )
    tables = []
    for name, tree in classes.items():
        with page.catching(f"Elastic properties of {page.title}"):
            properties = tube_properties(tree, at)
            tables.append(_table(name, properties, at))
    if tables:
        page.table("Elastic properties", pd.concat(tables), of_tube.strip())


def _table(name: str, properties: xr.Dataset, at: Conditions) -> pd.DataFrame:
    """Return median and interval of each property at each pressure, by finite draws."""
    quantiles = [0.5, (1 - PROB) / 2, (1 + PROB) / 2]
    rows = []
    for i, pressure in enumerate(at.pressures.tolist()):
        for key in _PROPERTIES:
            draws = properties[key].isel(pressure=i).values
            known = draws[np.isfinite(draws)]
            numbers = np.quantile(known, quantiles) if known.size else np.full(3, np.nan)
            attrs = properties[key].attrs
            unit = attrs["units"].replace("mm2", "mm²")
            rows.append([attrs["long_name"], name, pressure, unit, *numbers.tolist()])
    columns = ["property", "class", f"pressure ({at.pressure_unit})", "unit", "median"]
    return pd.DataFrame(rows, columns=[*columns, *interval_ends(PROB)])


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
