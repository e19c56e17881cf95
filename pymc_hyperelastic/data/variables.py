"""Names and dimensions of what a Dataset of tests holds: of tubes, of sheets, or of both.

The points of sheets have stretches ``stretch_x`` and ``stretch_y``, NaN in a direction in which the
sheet is free, and stresses ``stress_x`` and ``stress_y`` in kPa, NaN where none was measured. The
coordinate ``stress_measure`` on ``test`` says which stress that is: ``"cauchy"`` or ``"nominal"``.
It is empty for tests of tubes. Data without this coordinate are tests of tubes alone. In data of
both kinds, variables of tubes are NaN for tests of sheets, and the other way round. Data of sheets
alone have no variables of tubes.
"""

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from pymc_hyperelastic.mechanics.tube import GEOMETRY
from pymc_hyperelastic.messages import shown
from pymc_hyperelastic.quantities import IN_DATA, MEASURES, SHEET_VARIABLES

REQUIRED = ("radius", "pressure", *GEOMETRY)
OPTIONAL = ("outer_diameter", "axial_force", "kept_circle", *(f"{name}_sd" for name in MEASURES))
LABELS = ("specimen", "experiment", "group")
# Label of tests of sheets, and its values. It is empty for tubes, and data of tubes alone lack it.
STRESS_MEASURE = "stress_measure"
STRESS_MEASURES = ("cauchy", "nominal")
# Labels of tests if an experiment holds several curves.
OPTIONAL_LABELS = ("cycle", "phase")
# Labels that together name a test.
TEST_LABELS = ("specimen", "experiment", *OPTIONAL_LABELS)
# Coordinates of points.
POINTS = {
    "test": "experiment that the point belongs to",
    "row": "row of the point in its table",
}

# Dimensions of what data of tubes, of sheets, and any data must hold, or may hold.
_OF_TUBES, _MAY_BE_OF_TUBES, _OF_SHEETS, _OF_ANY, _MAY_BE_OF_ANY = (
    {name: IN_DATA[name].lies_on if name in IN_DATA else "obs" for name in names}
    for names in (
        REQUIRED,
        OPTIONAL,
        (*SHEET_VARIABLES, STRESS_MEASURE),
        ("test", *LABELS),
        ("row", *OPTIONAL_LABELS),
    )
)


def sheet_tests(data: xr.Dataset) -> NDArray[np.bool_]:
    """Return True for tests of sheets."""
    if STRESS_MEASURE not in data.variables:
        return np.zeros(data.sizes["test"], bool)
    return data.variables[STRESS_MEASURE].values.astype(str) != ""


def kinds_of_tests(data: xr.Dataset) -> tuple[bool, bool]:
    """Return whether there are tests of tubes, and whether there are tests of sheets."""
    sheets = sheet_tests(data)
    return not sheets.all(), bool(sheets.any())


def nominal_points(data: xr.Dataset) -> NDArray[np.bool_]:
    """Return True for points of sheets at which nominal stresses were measured."""
    return (data.variables[STRESS_MEASURE].values == "nominal")[data["test"].values]


def dimensions_of(data: xr.Dataset) -> tuple[dict[str, str], dict[str, str]]:
    """Dimensions of the variables that data of their kind must hold, and of those they may hold."""
    variables = data.variables
    if STRESS_MEASURE not in variables:
        if of_sheets := [name for name in SHEET_VARIABLES if name in variables]:
            raise ValueError(
                f"the data hold {of_sheets[0]!r} of sheets, and lack {STRESS_MEASURE!r} "
                "(dimension 'test'), 'cauchy' or 'nominal' for tests of sheets and '' for tests of "
                "tubes: make data of sheets with sheet_data(frame, ...)"
            )
        return _OF_ANY | _OF_TUBES, _MAY_BE_OF_ANY | _MAY_BE_OF_TUBES
    measures = variables[STRESS_MEASURE]
    if measures.dims != ("test",):
        raise ValueError(f"{STRESS_MEASURE!r} has dimensions {measures.dims}; expected ('test',)")
    for i, measure in enumerate(measures.values.tolist()):
        if measure not in ("", *STRESS_MEASURES):
            raise ValueError(
                f"{STRESS_MEASURE} of test {i} is {shown(measure)}; expected one of "
                f"{STRESS_MEASURES}, or '' for a test of a tube"
            )
    if not all(measures.values.tolist()):
        return _OF_ANY | _OF_TUBES | _OF_SHEETS, _MAY_BE_OF_ANY | _MAY_BE_OF_TUBES
    of_tubes = [name for name in (*REQUIRED, *OPTIONAL) if name in variables]
    if of_tubes:
        raise ValueError(
            f"the data are of sheets alone, and hold {of_tubes[0]!r} of tubes: drop it, "
            f"data.drop_vars({of_tubes[0]!r})"
        )
    return _OF_ANY | _OF_SHEETS, _MAY_BE_OF_ANY
