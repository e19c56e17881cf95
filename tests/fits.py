"""Standard fits that many tests and docstring examples read; each fit is made once.

A fit is stored as a netCDF file in a folder whose name is a hash of everything that can change it.
All processes of a test run, and later runs of the same code, read the same file.
"""

import hashlib
from collections.abc import Callable
from functools import cache
from importlib.metadata import version
from pathlib import Path

import pytensor
import pytest
import xarray as xr
from filelock import FileLock

import pymc_hyperelastic as ph

PACKAGE = Path(ph.__file__).parent
FOLDER = Path(__file__).parent / ".fits"
# This file, and data that it fits.
SOURCES = (Path(__file__), Path(__file__).with_name("variable_classes.py"))
# A new version of one of these packages may change draws.
LIBRARIES = ("numpy", "scipy", "xarray", "pytensor", "pymc", "arviz-base")
# Fits of the simulated aortas: enough draws for every test that reads them, and quick to make.
SETTINGS = {"draws": 500, "chains": 2, "random_seed": 1, "progressbar": False}
SLOPE_AUGMENTED = ph.SlopeAugmented(sigma=5 * ph.mmHg, slope_weight=3.0)


def training() -> dict[str, xr.Dataset]:
    """Return two groups of simulated aortas, two tests of each specimen."""
    data = ph.load_dataset("simulated_sheep_aorta")
    return {name: ph.select(data, group=name, experiment=[1, 2]) for name in ("C1", "C2")}


def sampled() -> xr.DataTree:
    """Sample the posterior of one material for the tests of one specimen."""
    data = ph.select(ph.load_dataset("simulated_sheep_aorta"), specimen="S1")
    return ph.sample_smc(ph.ogden_model(data, SLOPE_AUGMENTED), **SETTINGS)


def pooled() -> xr.DataTree:
    """Fit two classes whose specimens share one material, though those of C1 differ."""
    with pytest.warns(UserWarning, match=r"class 'C1': the fit is doubtful.*specimen 'S3'"):
        return ph.fit_classes(ph.Ogden(), training(), SLOPE_AUGMENTED, **SETTINGS)


def hierarchical() -> xr.DataTree:
    """Fit two classes whose specimens differ."""
    settings = SETTINGS | {"chains": 1, "variability": "specimen"}
    return ph.fit_classes(ph.Ogden(), training(), 5 * ph.mmHg, **settings)


def neo_hookean_classes() -> xr.DataTree:
    """Fit two classes of one-parameter specimens; variable_classes has their exact evidences."""
    import variable_classes  # only here: it inflates a tube when it is imported

    return variable_classes.fit()


FITS: dict[str, Callable[[], xr.DataTree]] = {
    function.__name__: function for function in (sampled, pooled, hierarchical, neo_hookean_classes)
}


@cache
def _folder() -> Path:
    """Return the folder of fits made by this code with these versions of its dependencies."""
    digest = hashlib.sha256()
    for path in [*sorted(PACKAGE.rglob("*.py")), *sorted(PACKAGE.rglob("*.csv")), *SOURCES]:
        digest.update(path.read_bytes())
    for library in LIBRARIES:
        digest.update(version(library).encode())
    return FOLDER / digest.hexdigest()[:16]


def stored(name: str) -> Path:
    """Return the file of a fit; the first process that asks for it makes it."""
    path = _folder() / f"{name}.nc"
    path.parent.mkdir(parents=True, exist_ok=True)
    with FileLock(path.with_suffix(".lock")):
        if not path.exists():
            # The same functions, and so the same draws, whichever test asks first.
            with pytensor.config.change_flags(mode="FAST_COMPILE", traceback__limit=0):
                ph.save_result(FITS[name](), path)
    return path


@cache
def _opened(name: str) -> xr.DataTree:
    return ph.open_result(stored(name))


def fit(name: str) -> xr.DataTree:
    """Return a copy of a fit, which the test may change."""
    return _opened(name).copy(deep=True)
