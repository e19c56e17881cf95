"""Fitted classes and sampled models: their fits, posteriors and elastic properties."""

from collections.abc import Iterator
from contextlib import suppress
from typing import Any, NamedTuple

import numpy as np
import xarray as xr
from arviz_stats.base import array_stats
from numpy.typing import NDArray

from pymc_hyperelastic.models.settings import inflation_data_of
from pymc_hyperelastic.plots.density import plot_parameter_density
from pymc_hyperelastic.plots.fit import plot_pressure_fit
from pymc_hyperelastic.plots.force import plot_axial_force
from pymc_hyperelastic.plots.style import fitted_classes
from pymc_hyperelastic.predictions.members import specimens_differ, with_parameters
from pymc_hyperelastic.reports.blocks import Block, Found, Page, Table, Text
from pymc_hyperelastic.reports.laws import units_of
from pymc_hyperelastic.reports.measurements import show_measurements

Array = NDArray[np.float64]

# Of the intervals and bands of a report, and of its regions.
PROB = 0.95
_REGIONS = (0.5, PROB)
# Of both signs are draws of which more than this share have the rarer one.
_BOTH_SIGNS = 0.01
# Range of draws, relative to the largest, up to which they are constant but for rounding errors.
_CONSTANT = 1e-12


def are_fits(result: Any) -> bool:
    """Whether these are fitted classes, or a sampled model."""
    if not isinstance(result, xr.DataTree):
        return False
    return "posterior" in result.children or any(
        "posterior" in child.children for child in result.children.values()
    )


def by_name(found: Found) -> dict[str, xr.DataTree]:
    """The classes of a result; a sampled model has the title of the result."""
    fitted = fitted_classes(found.result)
    return {found.title: found.result} if "posterior" in found.result.children else fitted


def has_data(tree: xr.DataTree) -> bool:
    """Whether a result holds the inflation data to which it was fitted."""
    return "constant_data" in tree.children and "radius" in tree["constant_data"].data_vars


def show_training(found: Found, page: Page) -> list[Block]:
    """The data to which classes were fitted."""
    blocks: list[Block] = []
    for name, tree in by_name(found).items():
        if has_data(tree):
            title = name if name == found.title else f"class {name}"
            blocks += show_measurements(Found(title, inflation_data_of(tree)), page)
    return blocks


def show_fits(found: Found, page: Page) -> list[Block]:
    """Bands of the posterior over the data, of pressure and, where it was measured, of force."""
    trees = by_name(found)
    if not all(map(has_data, trees.values())):
        return [Text("The result holds no data beside which its curves could be shown.")]
    material = "the typical material in the tube of each specimen"
    whose = material if _differ(trees) else "all specimens together"
    held = f"median and {100 * PROB:.3g} % of the posterior of {whose}, without error"
    blocks = page.figure(
        plot_pressure_fit,
        found.result,
        label=f"Fit of pressure and its slope: {found.title}",
        caption=f"Fit of pressure and of its slope. Lines and bands: {held}. Points: the data.",
        prob=PROB,
        pressure_unit=page.pressure_unit,
    )
    if any("axial_force" in inflation_data_of(tree) for tree in trees.values()):
        blocks += page.figure(
            plot_axial_force,
            found.result,
            label=f"Fit of the axial force: {found.title}",
            caption=f"Fit of the reduced axial force. Lines and bands: {held}. Points: the data.",
            prob=PROB,
        )
    if _differ(trees) and all("specimens" in tree.children for tree in trees.values()):
        blocks.append(_specimens(found.title, trees))
    return blocks


def _differ(trees: dict[str, xr.DataTree]) -> bool:
    return all(map(specimens_differ, trees.values()))


def _specimens(title: str, trees: dict[str, xr.DataTree]) -> Table:
    rows = []
    for name, tree in trees.items():
        specimens = tree["specimens"].to_dataset()
        for i, specimen in enumerate(specimens["specimen"].values.tolist()):
            own = specimens.isel(specimen=i)
            numbers = [float(own[k]) for k in ("misfit", "freedom", "pareto_k", "standard_error")]
            rows.append([str(specimen), name, *numbers, str(own["method"].item())])
    columns = ["specimen", "class", "squared misfit", "degrees of freedom", "Pareto shape"]
    columns += ["error of log evidence", "integrated by"]
    caption = (
        f"How well the best curve of each specimen follows its data, and how it was integrated: "
        f"{title}. With known noise the squared misfit, in its standard deviations, is about the "
        "number of degrees of freedom."
    )
    return Table(caption, columns, rows)


def show_posteriors(found: Found, page: Page) -> list[Block]:
    """The joint posterior of two parameters, and a table of all."""
    trees = by_name(found)
    shown = {name: posterior_rows(tree) for name, tree in trees.items()}
    blocks: list[Block] = []
    if all(sum("|" not in row.name for row in of_class) > 1 for of_class in shown.values()):
        regions = " and ".join(f"{100 * prob:.3g} %" for prob in _REGIONS)
        blocks += page.figure(
            plot_parameter_density,
            found.result,
            label=f"Joint posterior of two parameters: {found.title}",
            caption=f"Joint posterior of two parameters; the regions hold {regions}.",
            probs=_REGIONS,
        )
    rows = []
    for name, of_class in shown.items():
        units = units_of(trees[name])
        for variable, draws, rhat, effective in of_class:
            unit = units.get(variable.strip("|").split("[")[0], "")
            rows.append([variable, name, unit, *summary(draws), effective, rhat])
    columns = ["parameter", "class", "unit", "mean", "sd", *ends(), "effective draws", "R-hat"]
    of = " of the typical specimen, and of the distribution of the class" if _differ(trees) else ""
    blocks.append(Table(f"Posterior of the parameters{of}: {found.title}", columns, rows))
    return blocks


class Row(NamedTuple):
    """A number of a posterior: draws (chain, draw), R-hat, and effective draws."""

    name: str
    draws: Array
    rhat: float
    effective: float


def posterior_rows(tree: xr.DataTree) -> list[Row]:
    """Each number of a posterior, and the absolute value of what has both signs."""
    with suppress(ValueError):  # of what specimen is typical, if the result does not name its law
        tree = with_parameters(tree, None)
    posterior = tree["posterior"].to_dataset()
    rows = []
    for name, draws in _entries(posterior):
        rows.append(Row(name, draws, *_convergence(draws)))
        negative = float(np.mean(draws < 0))
        if _BOTH_SIGNS < negative < 1 - _BOTH_SIGNS and "[" not in name:
            size = np.abs(draws)
            rows.append(Row(f"|{name}|", size, *_convergence(size)))
    return rows


def _entries(posterior: xr.Dataset) -> Iterator[tuple[str, Array]]:
    for name, variable in posterior.data_vars.items():
        variable = variable.transpose("chain", "draw", ...)
        rest = variable.dims[2:]
        if not rest:
            yield str(name), variable.values
        elif len(rest) == 1 and rest[0] not in ("obs", "test") and name != "correlation_unit":
            for i, label in enumerate(variable[rest[0]].values.tolist()):
                yield f"{name}[{label}]", variable.values[..., i]


def summary(values: Array) -> list[float]:
    """Mean, standard deviation, and the ends of an interval with equal tails."""
    known = values[np.isfinite(values)]
    if not known.size:
        return [np.nan] * 4
    low, high = np.quantile(known, [(1 - PROB) / 2, (1 + PROB) / 2])
    return [float(known.mean()), float(known.std(ddof=1)), float(low), float(high)]


def ends() -> list[str]:
    """Headings of the ends of an interval."""
    return [f"{100 * q:.3g} %" for q in ((1 - PROB) / 2, (1 + PROB) / 2)]


def _convergence(draws: Array) -> tuple[float, float]:
    """R-hat of several chains, and effective draws."""
    if not np.isfinite(draws).all() or np.ptp(draws) <= _CONSTANT * np.abs(draws).max():
        return np.nan, np.nan
    rhat = float(array_stats.rhat(draws)) if len(draws) > 1 else np.nan
    return rhat, float(array_stats.ess(draws))
