"""Valid data of sheets, made by hand, and joint data of sheets and tubes."""

import numpy as np
import xarray as xr

from pymc_hyperelastic.data.datasets import load_dataset
from pymc_hyperelastic.data.select import select
from pymc_hyperelastic.quantities import IN_TABLES, SHEET_VARIABLES

NAN = np.nan
# A biaxial test and one along x, of two points each; kPa.
VALUES = {
    "stretch_x": [1.0, 1.2, 1.1, 1.3],
    "stretch_y": [1.0, 1.1, NAN, NAN],
    "stress_x": [0.0, 9.0, 4.0, 12.0],
    "stress_y": [0.1, NAN, NAN, NAN],
}


def by_hand(**changed: object) -> xr.Dataset:
    """Build data of sheets without any function of the package; None leaves a variable out."""
    values = {name: ("obs", VALUES[name], IN_TABLES[name].attributes) for name in SHEET_VARIABLES}
    labels = {
        "test": ("obs", [0, 0, 1, 1]),
        "row": ("obs", [10, 11, 12, 13]),
        "specimen": ("test", ["S1", "S1"]),
        "experiment": ("test", ["biaxial", "uniaxial"]),
        "group": ("test", ["all", "all"]),
        "stress_measure": ("test", ["cauchy", "nominal"]),
    }
    for name, value in changed.items():
        into = labels if name in labels else values
        into[name] = (into[name][0], value) if isinstance(value, list) else value
    into = ({n: v for n, v in d.items() if v is not None} for d in (values, labels))
    return xr.Dataset(*into)


def joint_by_hand(**changed: object) -> xr.Dataset:
    """Two tests of tubes before two tests of sheets; without any function for both."""
    tubes = select(load_dataset("simulated_sheep_aorta"), specimen="S4", experiment=[1, 2])
    tubes = tubes.assign(
        {name: ("obs", np.full(tubes.sizes["obs"], NAN)) for name in SHEET_VARIABLES}
    ).assign_coords(stress_measure=("test", ["", ""]))
    sheets = by_hand()
    missing = {
        name: (dims, np.full([sheets.sizes[d] for d in dims], NAN))
        for name, dims in ((name, tubes[name].dims) for name in tubes.data_vars)
        if name not in sheets
    }
    sheets = sheets.assign(missing).assign_coords(test=("obs", [2, 2, 3, 3]))
    joint = {}
    for name in (*tubes.data_vars, *tubes.coords):
        dims = tubes[name].dims
        parts = [each[name].values for each in (tubes, sheets)]
        if any(part.dtype.kind == "U" for part in parts):
            parts = [part.astype(str) for part in parts]
        joint[name] = (dims, np.concatenate(parts))
    data = xr.Dataset(joint).set_coords(list(tubes.coords))
    for name, value in changed.items():
        data[name] = (data[name].dims, value)
    return data
