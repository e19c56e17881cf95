"""Tests of sheets and of tubes in one Dataset, and each kind by itself."""

import numpy as np
import xarray as xr

from pymc_hyperelastic.data.select import tests_at
from pymc_hyperelastic.data.variables import STRESS_MEASURE, sheet_tests
from pymc_hyperelastic.quantities import SHEET_VARIABLES


def tubes_of(data: xr.Dataset) -> xr.Dataset | None:
    """Return the tests of tubes, as inflation data without any sheets; None without tubes."""
    if STRESS_MEASURE not in data.variables:
        return data
    tubes = ~sheet_tests(data)
    return tests_at(data, np.flatnonzero(tubes)) if tubes.any() else None


def sheets_of(data: xr.Dataset) -> xr.Dataset | None:
    """Return the tests of sheets, without variables of tubes; None without sheets."""
    sheets = sheet_tests(data)
    if not sheets.any():
        return None
    own = data if sheets.all() else tests_at(data, np.flatnonzero(sheets))
    return own.drop_vars([name for name in own.data_vars if name not in SHEET_VARIABLES])
