"""Valid tables of measurements, and functions that change them."""

from dataclasses import fields

import numpy as np
import pandas as pd
import xarray as xr

from pymc_hyperelastic.data.table import inflation_data
from pymc_hyperelastic.mechanics.reference_tube import Tube

GEOMETRY = {"inner_radius": 7.0, "outer_radius": 9.0}
# How the package itself states an opened sector.
SECTOR = {"convention": "whole", "radii_of": "sector"}
# Axial forces of the six points of good_frame, two of them missing and one as text.
FORCES = (1.0, np.nan, 3.0, "4.5", None, 6.0)


def good_frame() -> pd.DataFrame:
    """Two specimens, three tests of two points, rows labelled 10 to 15."""
    return pd.DataFrame(
        {
            "group": ["C1", "C1", "C1", "C1", "C2", "C2"],
            "specimen": ["S1", "S1", "S1", "S1", "S2", "S2"],
            "experiment": [1, 1, 2, 2, 1, 1],
            "radius": [7.2, 8.0, 7.3, 8.1, 7.1, 7.6],
            "pressure": [1.0, 6.0, 1.2, 6.5, 1.1, 9.0],
            "A": 7.0,
            "B": 9.0,
            "stretch": 1.2,
            "angle": 60.0,
        },
        index=range(10, 16),
    )


def curve(radius=None, pressure=None, *, points: int = 9, **columns) -> pd.DataFrame:
    """One inflation of specimen S1, from 1 to 17 kPa unless other pressures are given."""
    radius = np.linspace(7.2, 9.6, points) if radius is None else radius
    pressure = np.linspace(1.0, 17.0, points) if pressure is None else pressure
    frame = pd.DataFrame({"specimen": "S1", "experiment": 1, "radius": radius})
    return frame.assign(pressure=pressure).assign(**columns)


def changed(column: str, row: int, value: object, **columns) -> pd.DataFrame:
    """Build the good frame, perhaps with other columns, with one value replaced."""
    frame = good_frame().assign(**columns)
    frame[column] = frame[column].astype(object)
    frame.at[row, column] = value
    return frame


def build(frame: object = None, **arguments: object) -> xr.Dataset:
    """Build data; the arguments are those of Tube and of inflation_data."""
    frame = good_frame() if frame is None else frame
    return inflation_data(frame, **with_tube({**GEOMETRY, **arguments}))


def with_tube(arguments: dict) -> dict:
    """Return arguments in which those of Tube are one Tube."""
    names = [field.name for field in fields(Tube)]
    tube = Tube(**{name: arguments[name] for name in names if name in arguments})
    return {k: v for k, v in arguments.items() if k not in names} | {"tube": tube}


def with_values(name: str, values: object) -> xr.Dataset:
    """Build valid data, then replace the values of a variable without a check."""
    data = build()
    return data.assign({name: (data[name].dims, values, data[name].attrs)})


def with_diameters(diameter=(20.0, 22.0, 20.4, 22.4, 19.8, 21.0), **columns) -> pd.DataFrame:
    """Outer diameters in place of internal radii, and perhaps other columns."""
    return good_frame().drop(columns="radius").assign(outer_diameter=diameter, **columns)


def by_diameter(frame: object = None, **arguments: object) -> xr.Dataset:
    frame = with_diameters() if frame is None else frame
    return build(frame, measured="outer_diameter", **arguments)
