"""Differences between groups, by ``ph.compare_classes``, in a report."""

import numpy as np
import pandas as pd
import xarray as xr

from pymc_hyperelastic.classes.quantities import MOST_LACKING, PROPERTIES
from pymc_hyperelastic.evidence.stored import read_json
from pymc_hyperelastic.mechanics.interpolation import evenly
from pymc_hyperelastic.plots.comparison import plot_comparison
from pymc_hyperelastic.reports.meanings import quantity_in_words
from pymc_hyperelastic.reports.measurements import tube_in_words, warn_of_simulated
from pymc_hyperelastic.reports.page import (
    BAD,
    CAUTION,
    NOTE,
    PRESSURES,
    Page,
    frame_of,
    in_words,
    listed,
    percent,
)
from pymc_hyperelastic.rounding import DIGITS, short

# Sensitivity above which the prior influences a difference (Kallioinen et al. 2024).
_SENSITIVE = 0.05


def _check(result: xr.Dataset, page: Page) -> None:
    """Add notices on the number of differences, the prior, and specimens without a quantity."""
    warn_of_simulated(result.attrs, page)
    if "words" in result.attrs and result.attrs.get("compared") != 1:
        todo = "Read a single interval that excludes 0 as a hint, not as a proof"
        page.notice(NOTE, result.attrs["words"], todo)
    for name in result["quantity"].values.tolist():
        own = result.sel(quantity=name)
        typical = own.sel(statistic="typical")
        sensitivity = float(typical["prior_sensitivity"].max()) if "prior_sensitivity" in own else 0
        if sensitivity > _SENSITIVE:
            words = f"the prior influences the difference of {name}: its sensitivity is"
            todo = "Compare again with other priors, and report both results"
            page.notice(CAUTION, f"{words} {short(sensitivity)}", todo)
        if "lacking" in own and float(own["lacking"].max()) > MOST_LACKING:
            words = (
                f"up to {float(own['lacking'].max()):.1%} of the specimens of a group have no "
                f"{name}; the result describes the others"
            )
            page.notice(CAUTION, words, "Compare at a lower pressure, which all of them reach")
        if "extrapolated" in own and own["extrapolated"].any():
            words = f"{name} is compared at a pressure that was not measured in every group"
            page.notice(CAUTION, words, "Compare at a measured pressure, or measure there")
        if bool(typical["difference"].isnull().any()):
            words = f"the difference of {name} is unknown"
            page.notice(CAUTION, words, "Compare at a pressure that the specimens reach")
    if "log_bayes_factor_se" in result:
        infinite = ~np.isfinite(result["log_bayes_factor_se"].values)
        if infinite.any():
            of = listed(result["comparison"].values[infinite].tolist())
            words = f"the error of the Bayes factor of {of} is infinite"
            page.notice(BAD, words, "Compare again with more draws, and do not use the factor")


def show_comparison(result: xr.Dataset, page: Page) -> None:
    """Add differences as a figure and tables."""
    _check(result, page)
    _add_methods(result, page)
    page.figure(
        "Differences between groups",
        plot_comparison,
        result,
        note=f"Median and {percent(result.attrs['interval'])} interval of the posterior.",
    )
    if (tube := read_json(result, "tube", {})) and is_of_tubes(result):
        page.text(f"All materials are compared in one tube: {tube_in_words(tube)}.")
    page.findings += [
        _finding(result.sel(comparison=name)) for name in result["comparison"].values.tolist()
    ]
    result = _thinned(result)
    if "pressure" in result.dims:
        page.text(f"Pressures in the tables are in {result.attrs['pressure_unit']}.")
    _show_values(result, page)
    _show_differences(result, page)
    if "log_bayes_factor" in result:
        names = "comparison log_bayes_factor probability_of_difference"
        frame = frame_of(result, names, "comparison")
        page.table(
            "Bayes factors of different against equal distributions",
            frame,
            "They judge all parameters together. A log Bayes factor above 0 is evidence that the "
            "groups differ; below 0, that they have one distribution. The probability is that "
            "of different distributions if both are equally probable before the data.",
        )


def _thinned(result: xr.Dataset) -> xr.Dataset:
    """Return some pressures of a curve."""
    if "pressure" not in result.dims:
        return result
    return result.isel(pressure=evenly(result.sizes["pressure"], PRESSURES))


def _finding(result: xr.Dataset) -> str:
    """Return a sentence on the clearest difference of one comparison, and on all together."""
    typical = result.sel(statistic="typical", drop=True)
    typical = typical.stack(place=["quantity", *({"pressure"} & {*typical.dims})])
    direction = typical["probability_of_direction"].fillna(0.0).values.round(DIGITS)
    own = typical.isel(place=int(direction.argmax()))
    prob = percent(result.attrs["interval"])
    interval = frame_of(own.expand_dims("place"), "difference_interval", "place").iloc[0, 0]
    unit = "" if own["unit"].item() == "1" else f" {own['unit'].item()}"
    low, high = typical["difference_interval"].transpose("bound", ...).values
    excluded, total = int(((low > 0) | (high < 0)).sum()), typical.sizes["place"]
    value = f"{quantity_in_words(own['quantity'].item())}{{}} {in_words(interval)}{unit}"
    if total == 1:
        excludes = "excludes" if excluded else "contains"
        found = f"the difference in the {value.format(' is')}; its {prob} interval {excludes} 0"
    else:
        found = (
            f"{excluded or 'none'} of {total} differences {'have' if excluded > 1 else 'has'} a "
            f"{prob} interval that excludes 0; the clearest is the one in the {value.format(',')}"
        )
    text = f"{result['comparison'].item()}: {found}"
    if "log_bayes_factor" in result:
        chance = in_words(float(result["probability_of_difference"]), "probability")
        text += f". The probability that the groups differ at all is {chance}; 0.5 before the data"
    return f"{text}."


def _show_values(result: xr.Dataset, page: Page) -> None:
    """Add the statistics of each quantity, with a column for each group."""
    tables = []
    for group in result["group"].values.tolist():
        own = _frame(result.sel(group=group, drop=True), "statistic", "unit value_interval")
        tables.append(own.rename(columns={own.columns[-1]: f"group {group}"}))
    frame = pd.concat([tables[0], *(table.iloc[:, -1] for table in tables[1:])], axis=1)
    page.table(
        "Values of the groups",
        frame,
        f"Median ({percent(result.attrs['interval'])} interval) of the posterior. A "
        "typical specimen is the middle one of its group; mean and spread are the mean and the "
        "standard deviation over all specimens of the group, measured or not.",
    )


def _show_differences(result: xr.Dataset, page: Page) -> None:
    """Add the differences of the typical specimens of the groups."""
    names = (
        "unit difference_interval ratio_interval probability_of_rise effect_size_interval "
        "best_accuracy"
    )
    typical = _with_ratios(result.sel(statistic="typical", drop=True))
    page.table(
        "Differences of the typical specimens",
        _frame(typical, "comparison", names),
        "The ratio is that of the two groups. Effect sizes are differences in standard deviations "
        "between specimens. The best accuracy is the share of single new specimens that this "
        "quantity could at best assign to the right group; 0.5 is guessing.",
    )


def _frame(result: xr.Dataset, dim: str, names: str) -> pd.DataFrame:
    """Return variables by quantity in words, a further dimension, and pressure if there are any."""
    dims = ["quantity", dim, *({"pressure"} & {*result.dims})]
    frame = frame_of(result, f"{' '.join(dims)} {names}", *dims)
    frame["quantity"] = frame["quantity"].map(quantity_in_words)
    return frame


def _with_ratios(typical: xr.Dataset) -> xr.Dataset:
    """Add the ratios of quantities whose logarithms were compared."""
    names = typical["quantity"].values.tolist()
    of_logs = xr.DataArray([n.startswith(("log ", "log_")) for n in names], dims="quantity")
    return typical.assign(
        {
            f"ratio{part}": typical[f"ratio{part}"].where(
                ~of_logs, np.exp(typical[f"difference{part}"])
            )
            for part in ("", "_interval")
            if f"ratio{part}" in typical
        }
    )


def show_diagnosis(result: xr.Dataset, page: Page) -> None:
    """Add how far priors and data decide the differences."""
    typical = _thinned(result).sel(statistic="typical", drop=True)
    if "prior_sensitivity" in typical:
        page.table(
            "Sensitivity of the differences",
            _frame(typical, "comparison", "prior_sensitivity likelihood_sensitivity"),
            "Changes of a difference as the prior, or the likelihood, is raised to a power near 1. "
            f"Above {_SENSITIVE}, the prior or the data influence the difference.",
        )


def _add_methods(result: xr.Dataset, page: Page) -> None:
    """Add sentences on how groups were compared."""
    names = result["quantity"].values.tolist()
    words = [quantity_in_words(name) for name in names]
    count = int(result.attrs.get("compared", len(names)))
    at, tube = "", ", all in one tube" if is_of_tubes(result) else ""
    if tube and "pressure" in result.coords:
        pressures, unit = np.atleast_1d(result["pressure"].values), result.attrs["pressure_unit"]
        if len(pressures) > 1:
            ends = f"{short(float(pressures.min()))} to {short(float(pressures.max()))}"
            at = f" at pressures from {ends} {unit}"
        elif pressures[0]:
            at = f" at {short(float(pressures[0]))} {unit}"
    page.methods += [
        f"The groups {listed(result['group'].values.tolist())} were compared by the posterior of "
        f"the difference of their typical specimens in {listed(words)}{at}{tube}; "
        f"intervals hold {percent(result.attrs['interval'])}.",
        f"In total, {count} differences were compared, without a correction for their number."
        if count > 1
        else "One difference was compared.",
    ]
    if "log_bayes_factor" in result:
        page.methods.append(
            "Bayes factors compare different distributions of the specimens of the groups with "
            "one distribution for all specimens."
        )


def is_of_tubes(result: xr.Dataset) -> bool:
    """Return True if a compared quantity is a property of a tube, not of the material alone."""
    names = result["quantity"].values.tolist()
    return any(name.removeprefix("log ") in PROPERTIES for name in names)
