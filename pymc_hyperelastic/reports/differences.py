"""Whether groups differ: the result of ``ph.compare_classes``."""

from typing import Any

import numpy as np
import xarray as xr

from pymc_hyperelastic.evidence.stored import read_json
from pymc_hyperelastic.mechanics.interpolation import evenly
from pymc_hyperelastic.plots.comparison import plot_comparison
from pymc_hyperelastic.reports.blocks import (
    BAD,
    CAUTION,
    NOTE,
    Block,
    Found,
    Page,
    Probability,
    Table,
    Text,
    in_words,
    is_table,
    short,
)
from pymc_hyperelastic.reports.measurements import warn_of_simulated

# Sensitivity to the prior from which on it has a say; share of specimens whose lack is told.
_SENSITIVE, _LACKING = 0.05, 0.005
# Pressures of curves that a table shows.
_MOST_PRESSURES = 3


def is_comparison(result: Any) -> bool:
    """Whether this comes from ``ph.compare_classes``."""
    return is_table(result, "difference", "comparison", "quantity")


def check_comparison(found: Found, page: Page) -> None:
    """Say how many differences were looked at, and which rest on the prior or on few specimens."""
    result: xr.Dataset = found.result
    warn_of_simulated(result.attrs, page)
    if "words" in result.attrs:
        page.notice(NOTE, f"{found.title}: {result.attrs['words']}.")
    page.check("how far differences between groups rest on priors")
    if "prior_sensitivity" in result:
        typical = result["prior_sensitivity"].sel(statistic="typical")
        largest = typical.max([d for d in typical.dims if d != "quantity"])
        told = [
            f"{name} (sensitivity {short(float(largest.sel(quantity=name)))})"
            for name in result["quantity"].values.tolist()
            if float(largest.sel(quantity=name)) > _SENSITIVE
        ]
        if told:
            words = f"the prior has a say in the difference of {in_words(told)}"
            page.notice(CAUTION, f"{found.title}: {words}.")
    for name in result["quantity"].values.tolist():
        own = result.sel(quantity=name)
        if "lacking" in own and float(own["lacking"].max()) > _LACKING:
            page.notice(
                CAUTION,
                f"{found.title}: up to {float(own['lacking'].max()):.1%} of the specimens of a "
                f"group have no {name}, and what is said is that of the others.",
            )
        if bool(own["difference"].sel(statistic="typical").isnull().any()):
            page.notice(CAUTION, f"{found.title}: the difference of {name} is not known.")
    if "log_bayes_factor_se" in result:
        page.check("errors of Bayes factors")
        infinite = ~np.isfinite(result["log_bayes_factor_se"].values)
        if infinite.any():
            of = in_words(result["comparison"].values[infinite].tolist())
            page.notice(BAD, f"{found.title}: the Bayes factor of {of} has an infinite error.")


def show_comparison(found: Found, page: Page) -> list[Block]:
    """Differences as a figure and tables."""
    result: xr.Dataset = found.result
    held = f"median and {100 * float(result.attrs['interval']):.3g} % of the posterior"
    blocks = page.figure(
        plot_comparison,
        result,
        label=f"Differences between groups: {found.title}",
        caption=f"Differences between groups: {found.title}. Points or lines, and intervals or "
        f"bands: {held}.",
    )
    tube = read_json(result, "tube", {})
    if tube:
        told = in_words([f"{name.replace('_', ' ')} {short(v)}" for name, v in tube.items()])
        blocks.append(Text(f"All materials were looked at in one tube: {told} (mm, rad)."))
    blocks += [_values(found), _differences(found)]
    if "log_bayes_factor" in result:
        columns = ["comparison", "log Bayes factor", "its standard error"]
        numbers = {"log_bayes_factor": float, "log_bayes_factor_se": float}
        numbers["probability_of_difference"] = Probability
        rows = [
            [str(c), *(kind(result[n].sel(comparison=c)) for n, kind in numbers.items())]
            for c in result["comparison"].values.tolist()
        ]
        columns.append("probability of a difference")
        caption = f"Whether groups differ at all, as whole distributions: {found.title}"
        blocks.append(Table(caption, columns, rows))
    return blocks


def _places(result: xr.Dataset) -> list[tuple[list[float], xr.Dataset]]:
    """Each pressure that a table shows, and the result there."""
    if "pressure" not in result.dims:
        return [([], result)]
    chosen = evenly(result.sizes["pressure"], _MOST_PRESSURES)
    parts = [result.isel(pressure=i) for i in chosen.tolist()]
    return [([float(part["pressure"])], part) for part in parts]


def _at(result: xr.Dataset) -> list[str]:
    return [f"pressure ({result.attrs['pressure_unit']})"] if "pressure" in result.dims else []


def _ends(value: xr.DataArray) -> list[float]:
    return [float(value.sel(bound=bound)) for bound in ("low", "high")]


def _interval(result: xr.Dataset) -> list[str]:
    prob = float(result.attrs["interval"])
    return [f"{100 * q:.3g} %" for q in ((1 - prob) / 2, (1 + prob) / 2)]


def _values(found: Found) -> Table:
    result: xr.Dataset = found.result
    rows = []
    for name in result["quantity"].values.tolist():
        for group in result["group"].values.tolist():
            for statistic in result["statistic"].values.tolist():
                for at, part in _places(result):
                    own = part.sel(quantity=name, group=group, statistic=statistic)
                    numbers = [float(own["value"]), float(own["value_sd"])]
                    numbers += _ends(own["value_interval"])
                    unit = str(own["unit"].item())
                    row = [name, unit if unit != "1" else "", group, statistic]
                    rows.append([*row, *at, *numbers])
    columns = ["quantity", "unit", "group", "statistic", *_at(result), "median", "sd"]
    return Table(f"Values of the groups: {found.title}", [*columns, *_interval(result)], rows)


def _differences(found: Found) -> Table:
    result: xr.Dataset = found.result
    rows = []
    for name in result["quantity"].values.tolist():
        for comparison in result["comparison"].values.tolist():
            for at, part in _places(result):
                own = part.sel(quantity=name, comparison=comparison)
                typical = own.sel(statistic="typical")
                numbers = [float(typical["difference"]), *_ends(typical["difference_interval"])]
                numbers += [
                    Probability(typical["probability_of_rise"]),
                    float(own["effect_size"]),
                    *_ends(own["effect_size_interval"]),
                    float(own["best_accuracy"]),
                ]
                if "prior_sensitivity" in typical:
                    numbers.append(float(typical["prior_sensitivity"]))
                rows.append([name, comparison, *at, *numbers])
    ends = _interval(result)
    columns = ["quantity", "comparison", *_at(result), "difference", *ends]
    columns += ["probability of a rise", "effect size"]
    columns += [*(f"effect size, {end}" for end in ends), "best accuracy"]
    if "prior_sensitivity" in result:
        columns.append("sensitivity to the prior")
    caption = (
        f"Differences of the typical specimens: {found.title}. Effect sizes are in spreads between "
        "specimens; the best accuracy is that about a single new specimen."
    )
    return Table(caption, columns, rows)


def comparison_sentences(found: Found) -> list[str]:
    """How groups were compared, as sentences of an article."""
    result: xr.Dataset = found.result
    groups = [str(g) for g in result["group"].values]
    names = [str(q) for q in result["quantity"].values]
    count = int(result.attrs.get("compared", len(names)))
    at = ""
    if "pressure" in result.dims:
        low, high = (float(f(result["pressure"].values)) for f in (np.min, np.max))
        at = f" at pressures from {short(low)} to {short(high)} {result.attrs['pressure_unit']}"
    elif "pressure" in result.coords and float(result["pressure"]):
        at = f" at {short(float(result['pressure']))} {result.attrs['pressure_unit']}"
    sentences = [
        f"The groups {in_words(groups)} were compared by the posterior of the difference of "
        f"their typical specimens in {in_words(names)}{at}, all in one tube; intervals hold "
        f"{100 * float(result.attrs['interval']):.3g} %.",
        f"In all {count} differences were looked at, and nothing was corrected for their number."
        if count > 1
        else "One difference was looked at.",
    ]
    if "log_bayes_factor" in result:
        sentences.append(
            "Whether groups differ at all was judged by the Bayes factor of different against "
            "equal distributions of their specimens."
        )
    return sentences
