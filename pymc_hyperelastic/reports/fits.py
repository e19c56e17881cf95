"""Fitted classes and sampled models in a report: fits and parameters."""

from collections.abc import Mapping
from contextlib import suppress
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from pymc_hyperelastic.data.sheets import tubes_of
from pymc_hyperelastic.models.settings import holds_inflation_data, inflation_data_of
from pymc_hyperelastic.plots.density import plot_parameter_density
from pymc_hyperelastic.plots.fit import plot_fit
from pymc_hyperelastic.plots.fitted_curves import signals_of
from pymc_hyperelastic.plots.residuals import knows_noise
from pymc_hyperelastic.plots.style import fitted_classes
from pymc_hyperelastic.predictions.members import specimens_differ, with_parameters
from pymc_hyperelastic.reports.meanings import meaning_of
from pymc_hyperelastic.reports.measurements import show_measurements
from pymc_hyperelastic.reports.page import (
    PROB,
    Interval,
    Page,
    frame_of,
    in_words,
    interval_of,
    listed,
    percent,
)
from pymc_hyperelastic.reports.settings import (
    known_wall,
    reference_stress_of,
    units_of,
    uses_forces,
)

# Dimensions of variables that are no unknowns.
_OF_DATA = {"obs", "tube_obs", "sheet_obs", "test", "tube_test"}
# Signals of a fit, in the titles of their figures.
_SIGNALS = {
    "pressure": "pressure",
    "stiffness": "slope of the pressure",
    "axial_force": "axial force",
    "extension_radius": "radius in extension tests",
    "extension_force": "axial force in extension tests",
    "stress": "stress of sheets",
}


def classes_of(result: xr.DataTree, page: Page) -> dict[str, xr.DataTree]:
    """Return the fitted classes by name; a sampled model has the title of the result."""
    return {page.title: result} if "posterior" in result.children else fitted_classes(result)


def tubes_in(tree: xr.DataTree) -> xr.Dataset | None:
    """Return the tests of tubes to which a result was fitted; None if it holds none."""
    return tubes_of(inflation_data_of(tree)) if holds_inflation_data(tree) else None


def of_class(name: str, result: xr.Dataset, names: str) -> pd.DataFrame:
    """Return variables of the specimens of a class, with the class as second column."""
    frame = frame_of(result, names, "specimen")
    frame.insert(1, "class", name)
    return frame


def show_training(result: xr.DataTree, page: Page) -> None:
    """Add the data to which classes were fitted."""
    title = page.title
    for name, tree in classes_of(result, page).items():
        if holds_inflation_data(tree):
            page.title = name if name == title else f"class {name}"
            show_measurements(inflation_data_of(tree), page)
    page.title = title


def show_fits(result: xr.DataTree, page: Page) -> None:
    """Add bands of the posterior with the data, and the misfit of each specimen."""
    classes = classes_of(result, page)
    if not all(map(holds_inflation_data, classes.values())):
        page.text("The result holds no data with which its curves could be compared.")
        return
    differ = all(map(specimens_differ, classes.values()))
    residuals, strips = all(map(knows_noise, classes.values())), ""
    if residuals:
        strips = (
            " Strips: residuals in standard deviations of the measurement error; if the model is "
            "right, about 19 of 20 lie between the dashed lines."
        )
    of_classes = [signals_of(tree) for tree in classes.values()]
    for signal in dict.fromkeys(signal for signals in of_classes for signal in signals):
        what = _SIGNALS[signal]
        if any("outer_diameter" in inflation_data_of(tree) for tree in classes.values()):
            what = what.replace("radius", "outer diameter")
        whose = "each specimen" if differ else "the class in the tube of each specimen"
        if signal == "stress":
            whose = "the specimen of each test" if differ else "each test"
        note = (
            f"Lines and bands: median and {percent(PROB)} interval of the posterior for {whose}, "
            f"without measurement error. Points: data.{strips}"
        )
        page.figure(
            f"Fit of the {what}",
            plot_fit,
            result,
            note=note,
            signal=signal,
            residuals=residuals,
            ci_prob=PROB,
            pressure_unit=page.at.pressure_unit,
        )
    measured = any("axial_force" in inflation_data_of(tree) for tree in classes.values())
    if measured and not any(map(uses_forces, classes.values())):
        page.text("Axial forces were measured, and were not used in the fit.")
    if differ and all("specimens" in tree.children for tree in classes.values()):
        tables = [
            of_class(name, tree["specimens"].to_dataset(), "specimen misfit freedom")
            for name, tree in classes.items()
        ]
        table = pd.concat(tables)
        if table["misfit"].notna().any():
            page.table(
                "Best curve of each specimen",
                table,
                "The misfit is the sum of squared residuals, in variances of the measurement "
                "error. If the model is right, it is about the number of degrees of freedom.",
            )


def show_parameters(result: xr.DataTree, page: Page) -> None:
    """Add the joint posterior of two parameters, and a table of all."""
    classes = classes_of(result, page)
    found = {name: _intervals(tree) for name, tree in classes.items()}
    names = [*dict.fromkeys(name for own in found.values() for name in own)]
    if len([name for name in names if not name.startswith("|")]) > 1:
        page.figure(
            "Joint posterior of two parameters",
            plot_parameter_density,
            result,
            note=f"The regions hold 50 % and {percent(PROB)}.",
            ci_probs=(0.5, PROB),
        )
    first = next(iter(classes.values()))
    units, wall, stress = units_of(first), known_wall(first), reference_stress_of(first)
    what = f"median ({percent(PROB)} interval)"
    rows = []
    for name in names:
        row: dict[str, str | Interval] = {
            "parameter": name,
            "meaning": meaning_of(name, wall, stress),
            "unit": units.get(name.strip("|").split("[")[0], ""),
        }
        for of_class, own in found.items():
            row[f"class {of_class}" if len(found) > 1 else what] = own.get(name, "")
        rows.append(row)
    note = f"{what.capitalize()} of the posterior. "
    if specimens_differ(first):
        note += (
            "The parameters of the material are those of the typical specimen, which has the mean "
            "of the specimens of its class in the logarithms of the parameters; the others "
            "describe how specimens differ, and the measurement errors. Logarithms are natural. "
        )
    if len(found) > 1:
        note += "A class is the model of the specimens of one group."
    page.table("Parameters", pd.DataFrame(rows, dtype=object), note.strip())
    with_data = [tree for tree in classes.values() if holds_inflation_data(tree)]
    if names and with_data and all(tubes_in(tree) is None for tree in with_data):
        _summarise(names[0], found, rows[0], page)


def _summarise(
    name: str, found: Mapping[str, Mapping[str, Interval]], row: Mapping[str, Any], page: Page
) -> None:
    """Note the first parameter, in place of a property of a tube."""
    values = [f"{in_words(own[name])} in {of}" for of, own in found.items() if name in own]
    what = f"The {row['meaning']} ({name})" if row["meaning"] else name
    unit = f", in {row['unit']}" if row["unit"] else ""
    page.values.append(f"{what} is {listed(values)}{unit} (median, {percent(PROB)} interval).")


def _intervals(tree: xr.DataTree) -> dict[str, Interval]:
    """Return median and interval of each unknown, entry by entry."""
    found = {}
    for name, draws in unknowns_of(tree).data_vars.items():
        entries = draws.transpose(..., "chain", "draw")
        for place in np.ndindex(entries.shape[:-2]):
            # An entry without a label has its number.
            dims = zip(entries.dims, place, strict=False)
            labels = [str(entries[dim].values[i]) for dim, i in dims]
            entry = f"{name}[{', '.join(labels)}]" if labels else str(name)
            found[entry] = interval_of(entries.values[place])
    return found


def unknowns_of(tree: xr.DataTree) -> xr.Dataset:
    """Return the unknowns, and the absolute value of each scalar whose interval has both signs."""
    with suppress(ValueError):  # the typical specimen, unless the law is unknown
        tree = with_parameters(tree, None)
    posterior = tree["posterior"].to_dataset()
    chosen = {}
    for name, draws in posterior.data_vars.items():
        if draws.ndim > 3 or _OF_DATA & {*draws.dims} or name == "correlation_unit":
            continue
        chosen[name] = draws
        if draws.ndim == 2 and (1 - PROB) / 2 < float((draws < 0).mean()) < (1 + PROB) / 2:
            chosen[f"|{name}|"] = abs(draws)
    return xr.Dataset(chosen)
