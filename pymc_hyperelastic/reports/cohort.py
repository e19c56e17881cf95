"""Many specimens that were fitted one by one, by ``ph.fit_cohort``, in a report."""

import numpy as np
import pandas as pd
import xarray as xr

from pymc_hyperelastic.evidence.importance import LARGEST_PARETO_K
from pymc_hyperelastic.reports.decisions import (
    failed_of,
    names_of,
    warn_of_failures,
    warn_of_some,
)
from pymc_hyperelastic.reports.measurements import warn_of_simulated
from pymc_hyperelastic.reports.page import BAD, CAUTION, Entry, Page, plural

# Quantiles over the specimens.
_QUANTILES = {"2.5 %": 0.025, "median": 0.5, "97.5 %": 0.975}
_HEADINGS = [f"{name} of the specimens" for name in _QUANTILES]


def check_cohort(entry: Entry, page: Page) -> None:
    """Add notices on specimens that failed, or whose posterior is unreliable."""
    evidence = entry.result["evidence"].to_dataset()
    warn_of_simulated(entry.result.attrs, page)
    page.check("errors of the evidences of specimens, and Pareto shapes of their weights")
    warn_of_failures(evidence, page)
    if "log_evidence_se" in evidence:
        infinite = np.isinf(evidence["log_evidence_se"].values)
        heavy = evidence["pareto_k"].values >= LARGEST_PARETO_K
        words = f"a few weights dominate a posterior (Pareto shape of {LARGEST_PARETO_K} or more)"
        cases = [
            (BAD, "the error of an evidence is infinite", infinite),
            (CAUTION, words, heavy & ~failed_of(evidence) & ~infinite),
        ]
        warn_of_some(page, names_of(evidence), cases)


def show_cohort_evidence(entry: Entry, page: Page) -> None:
    """Add how many specimens were sampled, by method."""
    evidence = entry.result["evidence"].to_dataset()
    failed = failed_of(evidence)
    methods = pd.Series(
        evidence["method"].values.astype(str)[~failed] if "method" in evidence else []
    )
    counts = {"not sampled": int(failed.sum())} | methods.value_counts().sort_index().to_dict()
    frame = pd.DataFrame(counts.items(), columns=["method", "specimens"])
    page.table("Sampling methods of the specimens", frame)


def show_cohort_posteriors(entry: Entry, page: Page) -> None:
    """Add how parameters differ between specimens, and the uncertainty of one specimen."""
    rows = []
    for name, variable in entry.result["posterior"].data_vars.items():
        for label, draws in _entries(str(name), variable):
            known = draws.stack(sample=("chain", "draw")).dropna(draws.dims[0], how="all")
            if known.size:
                medians, sds = known.median("sample"), known.std("sample")
                rows.append([label, *_quantiles(medians), float(sds.median())])
    columns = ["parameter", *_HEADINGS, "median of the posterior sd"]
    page.table("Posterior medians of the parameters", pd.DataFrame(rows, columns=columns))


def _entries(name: str, values: xr.DataArray) -> list[tuple[str, xr.DataArray]]:
    """Return each entry of a parameter, with its label."""
    rest = [dim for dim in values.dims if str(dim).endswith("_entry")]
    if not rest:
        return [(name, values)]
    return [(f"{name}[{i}]", values.isel({rest[0]: i})) for i in range(values.sizes[rest[0]])]


def _quantiles(values: xr.DataArray) -> list[float]:
    return np.quantile(values.values, [*_QUANTILES.values()]).tolist()


def show_cohort_properties(entry: Entry, page: Page) -> None:
    """Add how elastic properties differ between specimens."""
    if "properties" not in entry.result.children:
        return
    rows = []
    for name, variable in entry.result["properties"].data_vars.items():
        if "interval" not in variable.dims:
            continue
        for at in range(variable.sizes.get("pressure", 1)):
            own = variable.isel(pressure=at) if "pressure" in variable.dims else variable
            low, median, high = (own.isel(interval=i).values.ravel() for i in range(3))
            known = np.isfinite(median)
            if known.any():
                rows.append(
                    {
                        "property": str(name).replace("_", " "),
                        "unit": str(variable.attrs.get("units", "")),
                        "pressure": float(np.ravel(entry.result["properties"]["pressure"])[at]),
                        **dict(
                            zip(_HEADINGS, _quantiles(own.isel(interval=1)[known]), strict=True)
                        ),
                        "median width of the intervals": float(np.median((high - low)[known])),
                    }
                )
    page.table("Posterior medians of the elastic properties", pd.DataFrame(rows))


def cohort_methods(entry: Entry, page: Page) -> None:
    """Add a sentence on how the cohort was fitted."""
    failed = failed_of(entry.result["evidence"].to_dataset())
    count, others = int((~failed).sum()), plural(int(failed.sum()), "other")
    rest = f"; {others} could not be sampled" if failed.any() else ""
    page.methods.append(
        f"The posteriors of {plural(count, 'specimen')} were sampled one by one{rest}."
    )
