"""Many specimens that were fitted one by one, by ``ph.fit_cohort``, in a report."""

import numpy as np
import pandas as pd
import xarray as xr

from pymc_hyperelastic.cohort import QUANTILES
from pymc_hyperelastic.evidence.importance import LARGEST_PARETO_K
from pymc_hyperelastic.quantities import unit_text
from pymc_hyperelastic.reports.decisions import failed_of, names_of, warn_of_messages
from pymc_hyperelastic.reports.meanings import quantity_in_words
from pymc_hyperelastic.reports.measurements import warn_of_simulated
from pymc_hyperelastic.reports.page import BAD, CAUTION, Page, plural

_NOTE = (
    "The quantiles are those of the posterior medians of the specimens; the last column is the "
    "uncertainty of one specimen."
)
_HEADINGS = [f"{name.replace('50 %', 'median')} of the specimens" for name in QUANTILES]


def show_cohort_evidence(tree: xr.DataTree, page: Page) -> None:
    """Add how many specimens were sampled, and notices on failures and unreliable posteriors."""
    evidence = tree["evidence"].to_dataset()
    failed = failed_of(evidence)
    warn_of_simulated(tree.attrs, page)
    warn_of_messages(evidence, page)
    if "log_evidence_se" in evidence:
        infinite = np.isinf(evidence["log_evidence_se"].values)
        heavy = (evidence["pareto_k"].values >= LARGEST_PARETO_K) & ~failed & ~infinite
        words = f"a few weights dominate a posterior (Pareto shape of {LARGEST_PARETO_K} or more)"
        names = names_of(evidence)
        more = "Fit these specimens again with more draws"
        page.notice_where(BAD, "the error of an evidence is infinite", more, names, infinite)
        page.notice_where(CAUTION, words, more, names, heavy)
    others = f"; {plural(int(failed.sum()), 'other')} could not be sampled" if failed.any() else ""
    count = plural(int((~failed).sum()), "specimen")
    page.methods.append(f"The posteriors of {count} were sampled one by one{others}.")
    law = tree.attrs.get("law", "The law")
    page.values.append(f"{law} was fitted to {count}, one by one{others}.")
    methods = evidence["method"].to_series() if "method" in evidence else pd.Series([], dtype=str)
    counts = methods.where(~failed, "not sampled").value_counts().sort_index()
    page.table("Sampling methods of the specimens", counts.rename("specimens").reset_index())


def show_cohort_posteriors(tree: xr.DataTree, page: Page) -> None:
    """Add how parameters differ between specimens, and the uncertainty of one specimen."""
    rows = []
    for name, draws in tree["posterior"].data_vars.items():
        medians, sds = draws.median(("chain", "draw")), draws.std(("chain", "draw"))
        entries = [dim for dim in medians.dims if str(dim).endswith("_entry")]
        for i in range(medians.sizes[entries[0]] if entries else 1):
            at = {entries[0]: i} if entries else {}
            numbers = [*_quantiles(medians.isel(at)), float(sds.isel(at).median())]
            rows.append([f"{name}[{i}]" if entries else name, *numbers])
    columns = ["parameter", *_HEADINGS, "median of the posterior sd"]
    frame = pd.DataFrame(rows, columns=columns)
    page.table("Posterior medians of the parameters", frame, _NOTE)


def show_cohort_properties(tree: xr.DataTree, page: Page) -> None:
    """Add how elastic properties differ between specimens."""
    if "properties" not in tree.children:
        return
    properties = tree["properties"].to_dataset()
    rows = []
    for name, intervals in properties.data_vars.items():
        if "interval" not in intervals.dims:
            continue
        for i, pressure in enumerate(np.ravel(properties["pressure"])):
            at = {"pressure": i} if "pressure" in intervals.dims else {}
            low, median, high = intervals.isel(at).transpose("interval", ...)
            unit = unit_text(str(intervals.attrs.get("units", "")))
            numbers = [*_quantiles(median), float((high - low).median())]
            rows.append([quantity_in_words(str(name)), unit, float(pressure), *numbers])
    pressure = f"pressure ({properties['pressure'].attrs.get('units', 'kPa')})"
    columns = ["property", "unit", pressure, *_HEADINGS, "median width of the intervals"]
    frame = pd.DataFrame(rows, columns=columns)
    page.table("Posterior medians of the elastic properties", frame, _NOTE)


def _quantiles(values: xr.DataArray) -> list[float]:
    return values.quantile([*QUANTILES.values()]).values.tolist()
