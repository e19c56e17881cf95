"""Select tests of a cohort that span the ranges of all: a model set up for them serves all."""

import numpy as np
import xarray as xr

from pymc_hyperelastic.data.inflation import at_points, extension_tests, measured_radius
from pymc_hyperelastic.data.select import tests_at
from pymc_hyperelastic.mechanics.interpolation import evenly
from pymc_hyperelastic.mechanics.tube import GEOMETRY

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
    columns = {name: at_points(data, name) for name in GEOMETRY}
    radius = measured_radius(data).values.astype(float)
    columns["radius"] = radius
    columns["stretch"] = radius / columns["inner_radius"]
    columns["wall"] = columns["outer_radius"] / columns["inner_radius"]
    columns["pressure"] = data["pressure"].values.astype(float)
    chosen = {*evenly(tests, _MOST).tolist()}
    for values in columns.values():
        if np.isfinite(values).any():
            chosen |= {int(test[np.nanargmin(values)]), int(test[np.nanargmax(values)])}
    kinds = [extension_tests(data), ~extension_tests(data)]
    if "axial_force" in data:
        kinds.append(np.bincount(test, data["axial_force"].notnull().values, tests) > 0)
    chosen |= {int(kind.argmax()) for kind in kinds if kind.any()}
    return tests_at(data, sorted(chosen))
