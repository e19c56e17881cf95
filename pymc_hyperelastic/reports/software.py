"""What a study was computed with, and what its methods were."""

from collections.abc import Sequence
from importlib.metadata import PackageNotFoundError, version
from typing import Any

import xarray as xr

from pymc_hyperelastic.evidence.stored import read_json
from pymc_hyperelastic.reports.blocks import Found, Page
from pymc_hyperelastic.reports.kinds import Kind

_PACKAGES = ("pymc-hyperelastic", "pymc", "pytensor", "arviz", "numpy", "xarray", "matplotlib")

# How the sentence of a law begins, and that of a further one.
_MODELLED, _ALSO = "Each vessel was modelled", "Each vessel was also modelled"


def methods_of(found: Sequence[tuple[Found, Kind]], page: Page) -> list[str]:
    """Sentences on the methods, each once, and with what they were carried out."""
    said: dict[str, str] = {}
    software = {name: _version(name) for name in _PACKAGES}
    for each, kind in found:
        with page.listening(f"The methods of {each.title}"):
            for sentence in kind.methods(each):
                # Of several laws each but the first is one more.
                several = any(known.startswith(_MODELLED) for known in said)
                also = sentence.replace(_MODELLED, _ALSO) if several else sentence
                if sentence not in said:
                    said[sentence] = also
        software |= stored_versions(each.result)
    return [
        *said.values(),
        f"All was computed with pymc_hyperelastic {software['pymc-hyperelastic']} on PyMC "
        f"{software['pymc']}, PyTensor {software['pytensor']} and NumPy {software['numpy']}.",
    ]


def versions_of(found: Sequence[tuple[Found, Kind]]) -> list[tuple[str, str, str]]:
    """Packages with their versions when the results were made, if they say so, and now."""
    then: dict[str, list[str]] = {name: [] for name in _PACKAGES}
    for each, _ in found:
        for name, number in stored_versions(each.result).items():
            if number not in then.setdefault(name, []):
                then[name].append(number)
    return [
        (name, ", ".join(numbers) or "not told", _version(name)) for name, numbers in then.items()
    ]


def _version(name: str) -> str:
    try:
        return version(name)
    except PackageNotFoundError:
        return "not installed"


def stored_versions(result: Any) -> dict[str, str]:
    """Versions that a result holds, by package; those of its first class."""
    if not isinstance(result, xr.DataTree):
        return {}
    trees = [result, *result.children.values()]
    telling = [tree for tree in trees if "versions" in tree.attrs]
    stored = read_json(telling[0], "versions", {}) if telling else {}
    return {str(name): str(number) for name, number in stored.items()}
