"""Tests of sheets and of tubes in one Dataset, and each kind by itself.

The points of sheets have stretches ``stretch_x`` and ``stretch_y``, NaN in a direction in which the
sheet is free, and stresses ``stress_x`` and ``stress_y`` in kPa, NaN where none was measured. The
coordinate ``stress_measure`` on ``test`` says which stress that is: ``"cauchy"`` or ``"nominal"``.
It is empty for tests of tubes. Data without this coordinate are tests of tubes alone. Variables of
tubes are NaN for tests of sheets, and the other way round.
"""

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from pymc_hyperelastic.data.select import tests_at

#: Variables of the points of sheets.
SHEET_VARIABLES = ("stretch_x", "stretch_y", "stress_x", "stress_y")
#: Coordinate of tests that says which stress was measured.
STRESS_MEASURE = "stress_measure"


def sheet_tests(data: xr.Dataset) -> NDArray[np.bool_]:
    """Return True for tests of sheets."""
    if STRESS_MEASURE not in data.variables:
        return np.zeros(data.sizes["test"], bool)
    return data[STRESS_MEASURE].values.astype(str) != ""


def tubes_of(data: xr.Dataset) -> xr.Dataset | None:
    """Return the tests of tubes, as inflation data without any sheets; None without tubes."""
    sheets = sheet_tests(data)
    if not sheets.any():
        return data
    if sheets.all():
        return None
    names = [name for name in (*SHEET_VARIABLES, STRESS_MEASURE) if name in data.variables]
    return tests_at(data, np.flatnonzero(~sheets)).drop_vars(names)


def sheets_of(data: xr.Dataset) -> xr.Dataset | None:
    """Return the tests of sheets, without variables of tubes; None without sheets."""
    sheets = sheet_tests(data)
    if not sheets.any():
        return None
    own = data if sheets.all() else tests_at(data, np.flatnonzero(sheets))
    return own.drop_vars([name for name in own.data_vars if name not in SHEET_VARIABLES])
