"""Select tests of a cohort that span the ranges of all: a model set up for them serves all."""

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from pymc_hyperelastic.data.inflation import at_points, extension_tests, measured_radius
from pymc_hyperelastic.data.select import tests_at
from pymc_hyperelastic.data.variables import sheet_tests
from pymc_hyperelastic.mechanics.interpolation import evenly
from pymc_hyperelastic.mechanics.tube import GEOMETRY
from pymc_hyperelastic.quantities import SHEET_VARIABLES

# Tests that are taken besides those at the ends of any range.
_MOST = 200


def representatives(data: xr.Dataset) -> xr.Dataset:
    """Tests that hold the smallest and largest of all that was measured, and some between.

    With them curves are made right for all: a process of a cluster need not know a hundred thousand
    specimens to judge one.
    """
    test, tests = data["test"].values, data.sizes["test"]
    if tests <= _MOST:
        return data
    columns: dict[str, NDArray] = {}
    kinds, sheets = [], sheet_tests(data)
    if not sheets.all():
        columns |= _columns_of_tubes(data)
        kinds += [~sheets & extension_tests(data), ~sheets & ~extension_tests(data)]
    if "axial_force" in data:
        kinds.append(np.bincount(test, data["axial_force"].notnull().values, tests) > 0)
    if sheets.any():
        columns |= {name: data[name].values.astype(float) for name in SHEET_VARIABLES}
        free = [np.isnan(columns[f"stretch_{axis}"]) for axis in "xy"]
        for points in (~free[0] & ~free[1], *free):
            kinds.append(sheets & (np.bincount(test, points, tests) > 0))
    chosen = {*evenly(tests, _MOST).tolist()}
    for values in columns.values():
        if np.isfinite(values).any():
            chosen |= {int(test[np.nanargmin(values)]), int(test[np.nanargmax(values)])}
    chosen |= {int(kind.argmax()) for kind in kinds if kind.any()}
    return tests_at(data, sorted(chosen))


def _columns_of_tubes(data: xr.Dataset) -> dict[str, NDArray]:
    columns = {name: at_points(data, name) for name in GEOMETRY}
    radius = measured_radius(data).values.astype(float)
    columns["radius"] = radius
    columns["stretch"] = radius / columns["inner_radius"]
    columns["wall"] = columns["outer_radius"] / columns["inner_radius"]
    columns["pressure"] = data["pressure"].values.astype(float)
    return columns
