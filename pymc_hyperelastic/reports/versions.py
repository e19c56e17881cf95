"""Versions of packages with which results were made, and checksums of results, in a report."""

from collections.abc import Mapping
from typing import Any

import pandas as pd
import xarray as xr

from pymc_hyperelastic.evidence.stored import read_json
from pymc_hyperelastic.io.checksum import digest_of
from pymc_hyperelastic.reports.page import Page


def versions_of(result: Any) -> dict[str, list[str]]:
    """Return the versions of each package with which a result was made."""
    trees = [result, *result.children.values()] if isinstance(result, xr.DataTree) else []
    versions: dict[str, list[str]] = {}
    for tree in trees:
        for name, number in read_json(tree, "versions", {}).items():
            versions.setdefault(name, []).append(str(number))
    return {name: [*dict.fromkeys(numbers)] for name, numbers in versions.items()}


def show_versions(results: Mapping[str, Any], kinds: Mapping[str, str], page: Page) -> None:
    """Add the kind, the versions and the checksum of each result."""
    rows = []
    for name, result in results.items():
        with page.catching(f"Versions of {name}"):
            versions = versions_of(result).items()
            made = ", ".join(f"{package} {' or '.join(n)}" for package, n in versions)
            rows.append([name, kinds[name], made, digest_of(result)])
    page.table(
        "Results on this page",
        pd.DataFrame(rows, columns=["result", "kind", "made with", "SHA-256"], dtype=object),
        "The SHA-256 checksum identifies the numbers and settings of a result: two results with "
        "the same checksum are the same.",
    )
