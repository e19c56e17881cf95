"""Differences between groups, by ``ph.compare_classes``, in a report."""

import numpy as np
import xarray as xr

from pymc_hyperelastic.classes.quantities import MOST_LACKING
from pymc_hyperelastic.evidence.stored import read_json
from pymc_hyperelastic.mechanics.interpolation import evenly
from pymc_hyperelastic.plots.comparison import plot_comparison
from pymc_hyperelastic.reports.measurements import warn_of_simulated
from pymc_hyperelastic.reports.page import (
    BAD,
    CAUTION,
    NOTE,
    Page,
    frame_of,
    listed,
    short,
)

# Sensitivity above which the prior influences a difference (Kallioinen et al. 2024).
_SENSITIVE = 0.05
# Pressures of a curve that the tables show.
_MOST_PRESSURES = 3


def _check(result: xr.Dataset, page: Page) -> None:
    """Add notices on the number of differences, the prior, and specimens without a quantity."""
    warn_of_simulated(result.attrs, page)
    if "words" in result.attrs:
        page.notice(NOTE, result.attrs["words"])
    for name in result["quantity"].values.tolist():
        own = result.sel(quantity=name)
        typical = own.sel(statistic="typical")
        sensitivity = float(typical["prior_sensitivity"].max()) if "prior_sensitivity" in own else 0
        if sensitivity > _SENSITIVE:
            words = f"the prior influences the difference of {name}: its sensitivity is"
            page.notice(CAUTION, f"{words} {short(sensitivity)}")
        if "lacking" in own and float(own["lacking"].max()) > MOST_LACKING:
            words = (
                f"up to {float(own['lacking'].max()):.1%} of the specimens of a group have no "
                f"{name}; the result describes the others"
            )
            page.notice(CAUTION, words)
        if bool(typical["difference"].isnull().any()):
            page.notice(CAUTION, f"the difference of {name} is unknown")
    if "log_bayes_factor_se" in result:
        infinite = ~np.isfinite(result["log_bayes_factor_se"].values)
        if infinite.any():
            of = listed(result["comparison"].values[infinite].tolist())
            page.notice(BAD, f"the error of the Bayes factor of {of} is infinite")


def show_comparison(result: xr.Dataset, page: Page) -> None:
    """Add differences as a figure and tables."""
    _check(result, page)
    _add_methods(result, page)
    prob = float(result.attrs["interval"])
    page.figure(
        "Differences between groups",
        plot_comparison,
        result,
        note=f"Median and {100 * prob:.3g} % interval of the posterior.",
    )
    if tube := read_json(result, "tube", {}):
        sizes = listed([f"{name.replace('_', ' ')} {short(v)}" for name, v in tube.items()])
        page.text(f"All materials are compared in one tube, in mm and rad: {sizes}.")
    dims = []
    if "pressure" in result.dims:
        dims = ["pressure"]
        result = result.isel(pressure=evenly(result.sizes["pressure"], _MOST_PRESSURES))
        page.text(f"Pressures in the tables are in {result.attrs['pressure_unit']}.")
    place = "pressure " if dims else ""
    names = f"quantity unit group statistic {place}value value_sd value_interval"
    frame = frame_of(result, names, "quantity", "group", "statistic", *dims)
    page.table("Values of the groups", frame)
    names = (
        f"quantity comparison {place}difference difference_interval probability_of_rise "
        "effect_size effect_size_interval best_accuracy prior_sensitivity"
    )
    typical = result.sel(statistic="typical", drop=True)
    page.table(
        "Differences of the typical specimens",
        frame_of(typical, names, "quantity", "comparison", *dims),
        "Effect sizes are in units of the standard deviation between specimens. The best accuracy "
        "is that of an ideal decision about one new specimen.",
    )
    if "log_bayes_factor" in result:
        names = "comparison log_bayes_factor log_bayes_factor_se probability_of_difference"
        frame = frame_of(result, names, "comparison")
        page.table("Bayes factors of different against equal distributions", frame)


def _add_methods(result: xr.Dataset, page: Page) -> None:
    """Add sentences on how groups were compared."""
    names = result["quantity"].values.tolist()
    count = int(result.attrs.get("compared", len(names)))
    at = ""
    if "pressure" in result.coords:
        pressures, unit = np.atleast_1d(result["pressure"].values), result.attrs["pressure_unit"]
        if len(pressures) > 1:
            ends = f"{short(float(pressures.min()))} to {short(float(pressures.max()))}"
            at = f" at pressures from {ends} {unit}"
        elif pressures[0]:
            at = f" at {short(float(pressures[0]))} {unit}"
    page.methods += [
        f"The groups {listed(result['group'].values.tolist())} were compared by the posterior of "
        f"the difference of their typical specimens in {listed(names)}{at}, all in one tube; "
        f"intervals hold {100 * float(result.attrs['interval']):.3g} %.",
        f"In all {count} differences were compared, without a correction for their number."
        if count > 1
        else "One difference was compared.",
    ]
    if "log_bayes_factor" in result:
        page.methods.append(
            "Bayes factors compare different distributions of the specimens of the groups with "
            "one distribution for all specimens."
        )
