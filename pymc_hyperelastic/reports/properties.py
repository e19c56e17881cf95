"""Elastic properties of the tubes of a result."""

from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from pymc_hyperelastic.data.inflation import extension_tests, held_stretches, points_of
from pymc_hyperelastic.evidence.results import thinned_draws
from pymc_hyperelastic.mechanics.tube import GEOMETRY
from pymc_hyperelastic.models.records import inflation_data_of
from pymc_hyperelastic.plots.properties import plot_elastic_properties
from pymc_hyperelastic.plots.style import fitted_classes, per_kilopascal
from pymc_hyperelastic.predictions.properties import tube_properties
from pymc_hyperelastic.quantities import IN_RESULTS, unit_text
from pymc_hyperelastic.reports.blocks import Block, Found, Page, Table, Text
from pymc_hyperelastic.reports.fits import PROB, by_name, ends, has_data, summary

Array = NDArray[np.float64]

# Pressures of a table unless they are given, and of a curve.
_IN_TABLE, _IN_CURVE = 3, 25
# Draws of a class in a figure: more move no line visibly, and take their time at every pressure.
_DRAWN = 1000
_PROPERTIES = (
    "compliance",
    "distensibility",
    "peterson_modulus",
    "incremental_modulus",
    "pulse_wave_velocity",
)


def show_properties(found: Found, page: Page) -> list[Block]:
    """Elastic properties at pressures that were measured, or that are asked for."""
    trees = by_name(found)
    if not all(map(has_data, trees.values())):
        return []
    data = [inflation_data_of(tree) for tree in trees.values()]
    span = _measured_pressures(data, page)
    if page.pressure is not None:
        pressures = page.pressure
        curve = np.linspace(pressures.min(), pressures.max(), _IN_CURVE)
    elif span is not None:
        pressures, curve = (np.linspace(*span, n) for n in (_IN_TABLE, _IN_CURVE))
    else:
        return [Text("There is no pressure that all experiments reached.")]
    tube, said = _one_tube(data, "layers" in next(iter(trees.values())).attrs)
    blocks: list[Block] = []
    if len(set(curve.tolist())) > 1:
        blocks += page.figure(
            plot_elastic_properties,
            _thinned(found.result),
            curve,
            label=f"Elastic properties over the pressure: {found.title}",
            caption=f"Elastic properties over the pressure{said}. Lines and bands: median and "
            f"{100 * PROB:.3g} % of the posterior.",
            aloud=False,  # the table of the same warns of the same
            prob=PROB,
            pressure_unit=page.pressure_unit,
            tube=tube,
        )
    rows = []
    told: dict[str, Any] = {"pressure_unit": page.pressure_unit, **tube}
    for name, tree in trees.items():
        with page.listening(f"The elastic properties in {found.title}"):
            properties = tube_properties(tree, pressures, **told)
            for i, pressure in enumerate(pressures.tolist()):
                at = properties.isel(pressure=i)
                rows += [
                    [
                        IN_RESULTS[key].long_name,
                        name,
                        pressure,
                        unit_text(IN_RESULTS[key].unit),
                        *_middle(at[key].values),
                    ]
                    for key in _PROPERTIES
                ]
    columns = ["property", "class", f"pressure ({page.pressure_unit})", "unit", "median"]
    if rows:
        caption = f"Elastic properties{said}: {found.title}"
        blocks.append(Table(caption, [*columns, *ends()], rows))
    return blocks


def _thinned(result: xr.DataTree) -> xr.DataTree:
    """The result with as many draws of each class as a figure needs."""
    if "posterior" in result.children:
        return thinned_draws(result, _DRAWN)
    thinned = xr.DataTree.from_dict({})
    for name, tree in fitted_classes(result).items():
        thinned[name] = thinned_draws(tree, _DRAWN)
    return thinned


def _measured_pressures(data: list[xr.Dataset], page: Page) -> tuple[float, float] | None:
    """From which to which pressure all inflation tests reach."""
    low, high = 0.0, np.inf
    for of_class in data:
        for test in np.flatnonzero(~extension_tests(of_class)).tolist():
            own = of_class["pressure"].values[points_of(of_class, test)]
            low, high = max(low, float(own.min())), min(high, float(own.max()))
    unit = per_kilopascal(page.pressure_unit)
    return (low * unit, high * unit) if low < high < np.inf else None


def _one_tube(data: list[xr.Dataset], layered: bool) -> tuple[dict[str, float], str]:
    """The tube in the middle of all that were measured, where these differ, and that it is."""
    tube = {}
    for name in GEOMETRY:
        values = _known([d[name].values for d in data])
        if values.size and np.ptp(values) > 0 and not (layered and name == "outer_radius"):
            # A stretch that was held, if there is one, says more than those on the way.
            held = _known([held_stretches(d) for d in data]) if name == "axial_stretch" else values
            tube[name] = float(np.median(held if held.size else values))
    if not tube:
        return {}, ""
    return tube, " of the tube in the middle of those that were measured"


def _middle(values: Array) -> list[float]:
    """Median, which a few draws of softening materials do not move, and the ends."""
    known = values[np.isfinite(values)]
    return [float(np.median(known)) if known.size else np.nan, *summary(values)[2:]]


def _known(values: list[Array]) -> Array:
    together = np.concatenate(values)
    return together[np.isfinite(together)]
