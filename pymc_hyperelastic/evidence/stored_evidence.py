"""Read the evidence of a result, as this package or PyMC's sampler stored it."""

import numpy as np
import xarray as xr

from pymc_hyperelastic.evidence.mixture import Array
from pymc_hyperelastic.evidence.results import check_result
from pymc_hyperelastic.evidence.stored import (
    check_numbers,
    damaged,
    is_number,
    read_group,
    read_number,
)
from pymc_hyperelastic.evidence.verdicts import VERDICTS, registered_checks

# Variables without which there is no evidence.
_NEEDED = ("log_evidence", "log_evidence_se")
# Dimensions of the variables of the group ``evidence``.
_VARIABLES: dict[str, tuple[str, ...]] = {
    **dict.fromkeys((*_NEEDED, "stages_capped", "ancestor_fraction", "pareto_k"), ("chain",)),
    **dict.fromkeys(("forward", "forward_se", "forward_beta", "at_modes", "at_modes_se"), ()),
    **dict.fromkeys(("at_bounds", "unmet"), ()),
    "at_limit": ("limit",),
}
# Variables without which an evidence, or its error, is unknown.
_NEVER_NAN = ("log_evidence", "at_bounds", "unmet", "forward_beta")
# Variables that are needed if another variable is there.
_TOGETHER = {
    "ancestor_fraction": "stages_capped",
    "forward_se": "forward",
    "at_modes_se": "at_modes",
}


def check_evidence(tree: xr.DataTree) -> None:
    """Raise unless the evidence of a result, and its diagnosis, can be read."""
    evidence_of(tree)
    if "diagnosis" in tree.children:
        stored_diagnosis(tree)


def stored_diagnosis(tree: xr.DataTree) -> xr.Dataset:
    """Return the diagnosis that was stored."""
    said = tree["diagnosis"].to_dataset()
    verdict, words = (said.attrs.get(name) for name in ("verdict", "words"))
    if not isinstance(verdict, str) or verdict not in VERDICTS or not isinstance(words, str):
        expected = f"expected one of {list(VERDICTS)}"
        raise damaged(tree, f"its diagnosis has the verdict {verdict!r}; {expected}")
    return said


def evidence_of(tree: xr.DataTree) -> xr.Dataset:
    """Return what a result says of its evidence, by chain."""
    check_result(tree)
    if "evidence" in tree.children:
        evidence = read_group(tree, "evidence")
        variables, together = dict(_VARIABLES), dict(_TOGETHER)
        for checks in registered_checks:
            variables |= checks.variables
            together |= checks.together
        for name, dims in variables.items():
            partner = together.get(name)
            needed = name in _NEEDED or partner in evidence or partner in tree.children
            if needed or name in evidence:
                check_numbers(tree, evidence, name, dims, " of 'evidence'", finite=False)
            if name in _NEVER_NAN and name in evidence and np.isnan(evidence[name]).any():
                raise damaged(tree, f"{name!r} of 'evidence' is no number")
        return evidence
    stats = tree.get("sample_stats", xr.DataTree()).to_dataset()
    if "log_evidence_variance" in stats and "stage" not in stats.dims:
        return _evidence_of_pymc(tree, stats)
    raise ValueError(
        f"the result has no evidence; its groups are {sorted(tree.children)}. It comes from "
        "ph.sample_smc or ph.fit_classes (for a class: ph.log_evidence(classes['C1']))"
    )


def _evidence_of_pymc(tree: xr.DataTree, stats: xr.Dataset) -> xr.Dataset:
    """The same from what PyMC's driver stores of the kernel: a list of stages for each chain."""

    def of_chains(name: str) -> list[Array]:
        found = []
        for stages in stats[name].values if name in stats and stats[name].ndim else []:
            numbers = np.atleast_1d(np.asarray(stages, object)).tolist()
            found.append(np.array([x for x in numbers if is_number(x)], float))
        if not found or not all(np.isfinite(stages).any() for stages in found):
            raise damaged(tree, f"{name!r} of 'sample_stats' holds no stages, or no numbers")
        return found

    def last(name: str) -> Array:
        return np.array([stages[~np.isnan(stages)][-1] for stages in of_chains(name)])

    found = {
        "log_evidence": last("log_marginal_likelihood"),
        "log_evidence_se": np.sqrt(last("log_evidence_variance")),
        "ancestor_fraction": last("ancestors") / read_number(stats, "_n_draws"),
        "stages_capped": np.array([np.nanmean(stages) for stages in of_chains("capped")]),
    }
    return xr.Dataset({name: ("chain", values) for name, values in found.items()})
