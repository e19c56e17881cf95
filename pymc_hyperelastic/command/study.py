"""The folder of a study: which results it holds, by the names of their files."""

from pathlib import Path

import xarray as xr

from pymc_hyperelastic.io.open import open_result
from pymc_hyperelastic.models.settings import law_names_of

CLASSES, COMPARISON = "classes", "comparison"
#: Folder of the store of decisions.
CLASSIFIED = "classified"


def classes_of(folder: Path) -> list[xr.DataTree]:
    """Fitted classes of a study, of each strain energy.

    Raises
    ------
    FileNotFoundError
        If the folder has no fitted classes.
    """
    paths = sorted(folder.glob(f"{CLASSES}-*.nc"))
    if not paths:
        raise FileNotFoundError(
            f"{folder} holds no classes: make them with 'pymc-hyperelastic fit', and name the "
            "folder by --out"
        )
    found = []
    for path in paths:
        classes = open_result(path)
        if not isinstance(classes, xr.DataTree):
            raise ValueError(f"{path} holds no classes")
        found.append(classes)
    return found


def results_of(folder: Path) -> dict[str, xr.Dataset | xr.DataTree]:
    """All results of a study, by titles of a report."""
    results: dict[str, xr.Dataset | xr.DataTree] = {}
    trees = classes_of(folder)
    for tree in trees:
        laws = " and ".join(law_names_of(next(iter(tree.children.values()))))
        results["Classes" if len(trees) == 1 else f"Classes of {laws}"] = tree
    if (folder / CLASSIFIED).is_dir():
        classified = open_result(folder / CLASSIFIED)
        assert isinstance(classified, xr.Dataset)
        results["New specimens"] = classified.load()
    for path in sorted(folder.glob(f"{COMPARISON}-*.nc")):
        results[f"Differences {path.stem.removeprefix(f'{COMPARISON}-')}"] = open_result(path)
    return results
