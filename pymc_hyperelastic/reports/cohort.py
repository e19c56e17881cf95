"""Many specimens, each fitted by itself: the result of ``ph.fit_cohort``."""

from typing import Any

import numpy as np
import xarray as xr

from pymc_hyperelastic.evidence.importance import LARGEST_PARETO_K
from pymc_hyperelastic.reports.blocks import (
    BAD,
    CAUTION,
    Block,
    Found,
    Page,
    Table,
    plural,
    some_in_words,
)
from pymc_hyperelastic.reports.decisions import failed_of, failures, names_of
from pymc_hyperelastic.reports.measurements import warn_of_simulated

# What is told of numbers that differ from specimen to specimen.
_QUANTILES = {"2.5 %": 0.025, "median": 0.5, "97.5 %": 0.975}
_OVER = [f"{name} of the specimens" for name in _QUANTILES]


def is_cohort(result: Any) -> bool:
    """Whether this is what ``ph.open_cohort`` gives of a fitted cohort."""
    return (
        isinstance(result, xr.DataTree)
        and {"posterior", "evidence"} <= set(result.children)
        and "error" in result["evidence"].data_vars
    )


def check_cohort(found: Found, page: Page) -> None:
    """Say what failed, and whose posterior is not to be trusted."""
    tree: xr.DataTree = found.result
    evidence = tree["evidence"].to_dataset()
    warn_of_simulated(tree.attrs, page)
    page.check("errors of the evidences of single specimens, and Pareto shapes of their weights")
    for words in failures(evidence):
        page.notice(CAUTION, f"{found.title}: {words}.")
    names = np.array(names_of(evidence), dtype=object)
    if "log_evidence_se" not in evidence:
        return
    infinite = np.isinf(evidence["log_evidence_se"].values)
    heavy = (evidence["pareto_k"].values >= LARGEST_PARETO_K) & ~failed_of(evidence) & ~infinite
    for level, where, words in (
        (BAD, infinite, "an evidence has an infinite error"),
        (
            CAUTION,
            heavy,
            f"a few weights decide a posterior (Pareto shape from {LARGEST_PARETO_K} on)",
        ),
    ):
        if where.any():
            page.notice(level, f"{found.title}: {words}: {some_in_words(names[where].tolist())}.")


def show_cohort_trust(found: Found, page: Page) -> list[Block]:
    """How many were sampled, and how."""
    evidence = found.result["evidence"].to_dataset()
    failed = failed_of(evidence)
    rows: list[list[Any]] = [["not sampled", int(failed.sum())]]
    if "method" in evidence:
        methods = evidence["method"].values.astype(str)[~failed]
        rows += [[m, int((methods == m).sum())] for m in sorted(set(methods.tolist()))]
    return [Table(f"How specimens were sampled: {found.title}", ["by", "specimens"], rows)]


def show_cohort_posteriors(found: Found, page: Page) -> list[Block]:
    """Parameters over the specimens: what is found of each, and how well it is known."""
    posterior = found.result["posterior"].to_dataset()
    rows = []
    for name, variable in posterior.data_vars.items():
        each = variable.stack(sample=("chain", "draw"))
        for label, own in _entries(str(name), each):
            known = own.dropna(own.dims[0], how="all")
            middle, sd = known.median("sample").values, known.std("sample").values
            if middle.size:
                rows.append([label, *np.quantile(middle, [*_QUANTILES.values()]), np.median(sd)])
    columns = ["parameter", *_OVER, "posterior sd of one (median)"]
    caption = f"Posterior medians of the parameters, over the specimens: {found.title}"
    return [Table(caption, columns, rows)] if rows else []


def show_cohort_properties(found: Found, page: Page) -> list[Block]:
    """Elastic properties over the specimens."""
    if "properties" not in found.result.children:
        return []
    properties = found.result["properties"].to_dataset()
    rows = []
    for name, variable in properties.data_vars.items():
        if "interval" not in variable.dims:
            continue
        for at in range(properties.sizes.get("pressure", 1)):
            own = variable.isel(pressure=at) if "pressure" in variable.dims else variable
            low, middle, high = (own.isel(interval=i).values.ravel() for i in range(3))
            there = np.isfinite(middle)
            if there.any():
                over = np.quantile(middle[there], [*_QUANTILES.values()])
                pressure = float(np.atleast_1d(properties["pressure"].values)[at])
                unit = str(variable.attrs.get("units", ""))
                width = float(np.median((high - low)[there]))
                rows.append([str(name).replace("_", " "), unit, pressure, *over, width])
    columns = ["property", "unit", "pressure", *_OVER, "width of the interval of one (median)"]
    caption = f"Elastic properties (posterior medians), over the specimens: {found.title}"
    return [Table(caption, columns, rows)] if rows else []


def cohort_sentences(found: Found) -> list[str]:
    """How a cohort was fitted, as sentences of an article."""
    evidence = found.result["evidence"].to_dataset()
    failed = failed_of(evidence)
    count = plural(int((~failed).sum()), "specimen")
    left = f"; {plural(int(failed.sum()), 'other')} could not be" if failed.any() else ""
    return [f"The posteriors of {count} were sampled, each by itself{left}."]


def _entries(name: str, values: xr.DataArray) -> list[tuple[str, xr.DataArray]]:
    """Each number of a parameter, by (unit, sample)."""
    rest = [dim for dim in values.dims if str(dim).endswith("_entry")]
    if not rest:
        return [(name, values)]
    return [(f"{name}[{i}]", values.isel({rest[0]: i})) for i in range(values.sizes[rest[0]])]
