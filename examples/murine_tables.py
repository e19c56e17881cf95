"""Read the tables of the murine vaginal walls, before and after elastase, as inflation data.

The measurements are those of A. R. Akintunde et al., Journal of Biomechanical Engineering 141
(2019) 021011. They are not part of this package.
"""

import os
from pathlib import Path

import pandas as pd
import xarray as xr

import pymc_hyperelastic as ph

FOLDER = Path(os.environ.get("MURINE_ELASTASE", "murine_elastase"))
FORMAT = """
The environment variable MURINE_ELASTASE names the folder of these tables, or they are in a folder
murine_elastase beside the script:

murine_elastase_geometry.csv, one row a specimen: specimen, group, animal,
  outer_diameter_unloaded_mm, thickness_unloaded_mm, opening_angle_deg
murine_elastase_pd.csv, one row a point: specimen, test (test1, test2, test3 by rising axial
  stretch), axial_stretch, pressure_mmHg, outer_diameter_um, transducer_force_mN
murine_elastase_fl.csv, the same of the extension tests (force_length1 to 4 by rising pressure)
"""
# Below this pressure the wall is still folded, and not a tube.
LOWEST = 3.5  # mmHg


def read(folder: Path = FOLDER, *, extended: bool = False) -> tuple[xr.Dataset, pd.DataFrame]:
    """Return the inflation data of all specimens, and the table of specimens.

    The radii are those of the closed ring. The opening angle is Fung's, measured from the middle of
    the inner side to the two ends of the sector. If `extended`, the data include the extension
    tests, and axial forces with an unknown offset in each test.
    """
    if not folder.is_dir():
        raise FileNotFoundError(f"there is no folder {folder}{FORMAT}")
    geometry = pd.read_csv(folder / "murine_elastase_geometry.csv")
    points = pd.read_csv(folder / "murine_elastase_pd.csv")
    points = points[points["pressure_mmHg"] > LOWEST]
    if extended:
        points = pd.concat([points, pd.read_csv(folder / "murine_elastase_fl.csv")])
        points = points.rename(columns={"transducer_force_mN": "axial_force"})
    points = points.drop(columns=["source", "group", "animal"], errors="ignore")
    points = points.merge(geometry, on="specimen")
    data = ph.inflation_data(
        points.assign(
            experiment=points["test"],
            pressure=points["pressure_mmHg"],
            outer_diameter=points["outer_diameter_um"] / 1e3,
            outer=points["outer_diameter_unloaded_mm"] / 2,
        ),
        ph.Tube(
            outer_radius="outer",
            thickness="thickness_unloaded_mm",
            axial_stretch="axial_stretch",
            opening_angle="opening_angle_deg",
            convention="fung",
            radii_of="ring",
        ),
        measured="outer_diameter",
        pressure_unit="mmHg",
        angle_unit="deg",
    )
    return data, geometry
