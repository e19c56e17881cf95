"""Differences between groups, by ``ph.compare_classes``, in a report."""

import numpy as np
import xarray as xr

from pymc_hyperelastic.files.stored import read_json
from pymc_hyperelastic.mechanics.interpolation import evenly
from pymc_hyperelastic.plots.comparison import plot_comparison
from pymc_hyperelastic.reports.measurements import warn_of_simulated
from pymc_hyperelastic.reports.page import (
    BAD,
    CAUTION,
    NOTE,
    Entry,
    Page,
    frame_of,
    interval_ends,
    listed,
    short,
)

# Sensitivity above which the prior influences a difference (Kallioinen et al. 2024).
_SENSITIVE = 0.05
# Share of specimens without a quantity above which it is a warning.
_LACKING = 0.005
# Pressures of a curve that the tables show.
_MOST_PRESSURES = 3


def check_comparison(entry: Entry, page: Page) -> None:
    """Add notices on the number of differences, the prior, and specimens without a quantity."""
    result: xr.Dataset = entry.result
    warn_of_simulated(result.attrs, page)
    if "words" in result.attrs:
        page.notice(NOTE, result.attrs["words"])
    page.check("the sensitivity of differences to priors")
    for name in result["quantity"].values.tolist():
        own = result.sel(quantity=name)
        typical = own.sel(statistic="typical")
        sensitivity = float(typical["prior_sensitivity"].max()) if "prior_sensitivity" in own else 0
        if sensitivity > _SENSITIVE:
            words = f"the prior influences the difference of {name}: its sensitivity is"
            page.notice(CAUTION, f"{words} {short(sensitivity)}")
        if "lacking" in own and float(own["lacking"].max()) > _LACKING:
            words = (
                f"up to {float(own['lacking'].max()):.1%} of the specimens of a group have no "
                f"{name}; the result describes the others"
            )
            page.notice(CAUTION, words)
        if bool(typical["difference"].isnull().any()):
            page.notice(CAUTION, f"the difference of {name} is unknown")
    if "log_bayes_factor_se" in result:
        page.check("errors of Bayes factors")
        infinite = ~np.isfinite(result["log_bayes_factor_se"].values)
        if infinite.any():
            of = listed(result["comparison"].values[infinite].tolist())
            page.notice(BAD, f"the error of the Bayes factor of {of} is infinite")


def show_comparison(entry: Entry, page: Page) -> None:
    """Add differences as a figure and tables."""
    result: xr.Dataset = entry.result
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
    dims, at = [], {}
    if "pressure" in result.dims:
        dims = ["pressure"]
        at = {"pressure": f"pressure ({result.attrs['pressure_unit']})"}
        result = result.isel(pressure=evenly(result.sizes["pressure"], _MOST_PRESSURES))
    low, high = interval_ends(prob)
    columns = {"quantity": "quantity", "unit": "unit", "group": "group", "statistic": "statistic"}
    columns |= at | {"value": "median", "value_sd": "sd"}
    columns |= {"value_interval:low": low, "value_interval:high": high}
    values = result.assign_coords(unit=result["unit"].where(result["unit"] != "1", ""))
    frame = frame_of(values, columns, ["quantity", "group", "statistic", *dims])
    page.table("Values of the groups", frame)
    columns = {"quantity": "quantity", "comparison": "comparison"} | at
    columns |= {
        "difference": "difference",
        "difference_interval:low": low,
        "difference_interval:high": high,
        "probability_of_rise": "probability of a rise",
        "effect_size": "effect size",
        "effect_size_interval:low": f"effect size, {low}",
        "effect_size_interval:high": f"effect size, {high}",
        "best_accuracy": "best accuracy",
    }
    if "prior_sensitivity" in result:
        columns["prior_sensitivity"] = "sensitivity to the prior"
    typical = result.sel(statistic="typical", drop=True)
    page.table(
        "Differences of the typical specimens",
        frame_of(typical, columns, ["quantity", "comparison", *dims]),
        "Effect sizes are in units of the standard deviation between specimens. The best accuracy "
        "is that of an ideal decision about one new specimen.",
    )
    if "log_bayes_factor" in result:
        columns = {
            "comparison": "comparison",
            "log_bayes_factor": "log Bayes factor",
            "log_bayes_factor_se": "its standard error",
            "probability_of_difference": "probability of a difference",
        }
        frame = frame_of(result, columns, ["comparison"])
        page.table("Bayes factors of different against equal distributions", frame)


def comparison_methods(entry: Entry, page: Page) -> None:
    """Add sentences on how groups were compared."""
    result: xr.Dataset = entry.result
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
            "Whether groups differ at all was judged by the Bayes factor of different against "
            "equal distributions of their specimens."
        )
