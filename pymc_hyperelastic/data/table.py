"""Inflation data from a table of measured points."""

from collections.abc import Mapping
from math import nan
from typing import Any, Literal, get_args

import numpy as np
import pandas as pd
import xarray as xr

from pymc_hyperelastic.data.columns import (
    Rows,
    check_frame,
    groups_of,
    plain_array,
    rows_of,
)
from pymc_hyperelastic.data.extension import stretches_of
from pymc_hyperelastic.data.geometry import errors_of_tube, kept_circle, reference_tube
from pymc_hyperelastic.data.inflation import check_data, defects_of
from pymc_hyperelastic.data.order import Cycles, last_cycles, order_of_points
from pymc_hyperelastic.data.plausible import check_plausible
from pymc_hyperelastic.data.units import to_internal
from pymc_hyperelastic.data.validation import Check, Problems, check_known
from pymc_hyperelastic.data.variables import POINTS
from pymc_hyperelastic.mechanics.reference_tube import Tube, check_is_tube, stated_wall
from pymc_hyperelastic.mechanics.tube import GEOMETRY, internal_radius_from_outer_radius
from pymc_hyperelastic.quantities import IN_DATA, POWERS

MeasuredLength = Literal["radius", "outer_diameter"]
# Key of a frame's attrs under which read_tests says in which units columns were read.
UNITS_IN_FILES = "units_in_files"


def inflation_data(
    frame: pd.DataFrame,
    tube: Tube,
    *,
    measured: MeasuredLength = "radius",
    radius_unit: str = "mm",
    pressure_unit: str = "kPa",
    angle_unit: str = "rad",
    force_unit: str = "mN",
    cycles: Cycles = "last",
    check: Check = "warn",
) -> xr.Dataset:
    """Build the inflation Dataset from a table of measured points.

    Parameters
    ----------
    frame : pandas.DataFrame
        One row for each point, with the columns ``specimen``, ``experiment``, ``pressure``, the
        column that `measured` names, and optionally ``axial_force`` (reduced axial force; missing
        where it was not measured), ``group``, ``cycle`` and ``phase`` (such as loading and
        unloading); other columns are ignored. A specimen and an experiment, with a cycle and a
        phase if the table has them, name one test. The rows of a test stand in the order of
        inflation or deflation, or of axial extension.
    tube : Tube
        Reference tube and axial stretch, see :class:`~pymc_hyperelastic.Tube`. Each measure is a
        number, or the name of a column that is constant within each test; ``nan`` says that it is
        not known. Lengths have the unit `radius_unit`, an area its square, a volume its cube, and
        an angle the unit `angle_unit`. With an opening angle, `tube` has to state the convention,
        and whether the radii are those of the sector or of the ring.

        A radius that is not stated is not known. It may be inferred, see ``priors`` of
        :func:`~pymc_hyperelastic.inflation_model`. An axial stretch that is not stated is 1, and an
        opening angle 0. A column of the axial stretch may vary within a test, which is then an
        extension test, mostly at a held pressure. Inflation and extension tests on a specimen stand
        in one table. Extension tests have no slopes.

        The standard deviations in ``tube.sd`` have the units of their measures, and are of the
        angle that is given. The Dataset holds them as ``thickness_sd`` and so on;
        :class:`~pymc_hyperelastic.MeasuredValue` uses them in a model. It also needs
        ``kept_circle``, the circle in the wall of the sector that keeps its radius if the wall is
        thicker than measured: 0 is the inner one, which is meant if the variable is missing, and 1
        the outer one, which is kept if it was stated with a measure of the wall.
    measured : {"radius", "outer_diameter"}
        The quantity that was measured with the pressure, and the name of its column: the current
        internal radius, or the current outer diameter, from which the internal radius follows by
        incompressibility. Slopes are derivatives with respect to the radius, or half the diameter.
    radius_unit, pressure_unit, angle_unit, force_unit : str
        Units of the table, as pint knows them, such as ``"um"``, ``"mmHg"``, ``"deg"``. A diameter
        has the unit of the radius.
    cycles : {"last", "all"}
        The cycles of an experiment to use, if the table has a column ``cycle``. By default the last
        cycle, with the highest number, since the earlier cycles precondition the tissue.
    check : {"warn", "raise", "ignore"}
        The reaction to input that is possible, but probably a mistake, see Warns.

    Returns
    -------
    xarray.Dataset
        Dimension ``obs`` with ``radius`` (internal, mm; NaN where it depends on an unknown
        measure), ``pressure`` (kPa), ``outer_diameter`` (mm) and ``axial_force`` (mN) if measured,
        and the coordinates ``test`` and ``row`` (the frame's index label); the points of a test
        stand together, in the frame's order. Dimension ``test``, in order of first appearance, with
        ``inner_radius``, ``outer_radius`` (of the opened sector, mm), ``axial_stretch``,
        ``opening_angle`` (whole, rad), NaN where unknown, and the coordinates ``specimen``,
        ``experiment``, ``group`` (``"all"`` without such a column) and, if the table has them,
        ``cycle`` and ``phase``. If a test is an extension test, ``axial_stretch`` has the dimension
        ``obs``, for all tests.

    Warns
    -----
    UserWarning
        If the rows of a test were shuffled; they are sorted by the measured quantity, along which
        the pressure then rises, or by the axial stretch that varies. If a stretch varies by less
        than a hundredth, or in a few rows only. If a number is taken for the axial stretch or the
        opening angle, and a column of that name says something else. If a pressure, a length, a
        stretch, an angle or a force is beyond what soft tubes have, such as 120 kPa where 120 mmHg
        was meant; the ranges are on the page What a file may look like. If the error of the wall is
        stated with the outer radius. `check` makes it an error, or silences it.

    Raises
    ------
    TypeError
        If `frame` is not a DataFrame or `tube` not a Tube, or if a measure of the tube is neither a
        number nor a str.
    ValueError
        If a column, label or value is missing, is text, is not finite or is impossible for a
        tube; if radii, angle or group change within a test; if an angle or the radii may mean two
        things, or do not determine the tube; if a unit does not fit; if rows of a test repeat, or
        run up and down as in loading and unloading.

    See Also
    --------
    Tube, sheet_data, read_tests, select

    Examples
    --------
    >>> import numpy as np, pandas as pd, pymc_hyperelastic as ph
    >>> frame = pd.DataFrame(
    ...     {"specimen": "S1", "experiment": 1, "radius": [7.1, 7.6], "pressure": [5.0, 30.0]}
    ... )
    >>> data = ph.inflation_data(frame, ph.Tube(7.0, 9.0), pressure_unit="mmHg")
    >>> dict(data.sizes)
    {'obs': 2, 'test': 1}

    A closed ring of which one radius, wall area and Fung's angle are known:

    >>> ring = ph.Tube(
    ...     outer_radius=8.0,
    ...     wall_area=88.0,
    ...     radii_of="ring",
    ...     opening_angle=45.0,
    ...     convention="fung",
    ... )
    >>> data = ph.inflation_data(frame, ring, angle_unit="deg", pressure_unit="mmHg")
    >>> [round(data[name].item(), 3) for name in ("inner_radius", "outer_radius")]
    [8.332, 10.333]
    >>> round(float(np.rad2deg(data["opening_angle"].item())), 6)
    90.0
    """
    if measured not in get_args(MeasuredLength):
        raise ValueError(f"measured is {measured!r}; expected one of {get_args(MeasuredLength)}")
    check_known(check)
    check_frame(frame, ("specimen", "experiment", measured, "pressure"))
    check_is_tube(tube)
    problems = Problems(check, frame.attrs.get(UNITS_IN_FILES, {}))
    rows = rows_of(last_cycles(frame, cycles), problems)
    units = {
        "length": radius_unit,
        "pressure": pressure_unit,
        "angle": angle_unit,
        "force": force_unit,
    }
    points = {name: rows.numbers(name) for name in (measured, "pressure")}
    if "axial_force" in rows.frame:
        points["axial_force"] = rows.numbers("axial_force", may_be_missing=True)
    given = {name: getattr(tube, name) for name in (*GEOMETRY, *stated_wall(tube))}
    unstated = dict.fromkeys(GEOMETRY, nan) | {"axial_stretch": 1.0, "opening_angle": 0.0}
    given |= {name: value for name, value in unstated.items() if given[name] is None}
    axial_stretch = given.pop("axial_stretch")
    stretch = rows.of_points("axial_stretch", axial_stretch)
    measures = _of_tests(rows, given, units)
    errors = _of_tests(rows, tube.sd or {}, units, "sd[{!r}]")
    problems.stop()

    stretch, varying = stretches_of(rows, stretch)
    order = order_of_points(rows, measured, points, stretch, varying)
    values = {name: _internal(numbers[order], name, units) for name, numbers in points.items()}
    values["axial_stretch"] = stretch[order] if varying.any() else stretch[rows.first]
    sector = reference_tube(rows, tube, measures)
    values |= sector
    values |= errors_of_tube(rows, tube, errors)
    kept = kept_circle(tube, measures, sector["opening_angle"])
    if np.nan_to_num(kept).any():
        values["kept_circle"] = kept
    groups = groups_of(rows)
    if measured == "outer_diameter":
        geometry = {name: values[name][rows.test[order]] for name in sector}
        geometry["axial_stretch"] = stretch[order]
        # NaN where the geometry is not known or the wall does not fit in; tests with an opening
        # angle of 2π are refused below.
        with np.errstate(invalid="ignore", divide="ignore"):
            values["radius"] = internal_radius_from_outer_radius(
                values["outer_diameter"] / 2, **geometry
            )
    data = dataset_of(rows, order, values, groups, "obs" if varying.any() else "test")
    refuse_defects(data, rows)
    rows.doubt_overlooked("axial_stretch", axial_stretch)
    rows.doubt_overlooked("opening_angle", given["opening_angle"])
    check_plausible(data, problems)
    problems.report()
    return data


def _of_tests(
    rows: Rows, given: Mapping[str, float | str], units: Mapping[str, str], form: str = "{}"
) -> dict[str, np.ndarray]:
    """One number a test of measures of the tube, in the units of the package."""
    return {
        name: _internal(rows.of_tests(form.format(name), value), name, units)
        for name, value in given.items()
    }


def _internal(values: np.ndarray, name: str, units: Mapping[str, str]) -> np.ndarray:
    """Values of a quantity in the unit of the package."""
    dimension = IN_DATA[name].dimension
    if dimension == "ratio":
        return values
    if dimension in POWERS:
        power = POWERS[dimension]
        return to_internal(values, units["length"], "length", keyword="radius_unit", power=power)
    return to_internal(values, units[dimension], dimension)


def refuse_defects(data: xr.Dataset, rows: Rows) -> None:
    """Raise with all unsound values of a Dataset, except in tests with an error already."""
    for place, what, dimension, of_test, test in defects_of(data):
        if test not in rows.failed:
            rows.problems.add(place, what, dimension, of_test)
    rows.problems.stop()
    check_data(data)


def dataset_of(
    rows: Rows,
    order: np.ndarray,
    values: dict[str, np.ndarray],
    groups: np.ndarray,
    stretch_dimension: str = "test",
) -> xr.Dataset:
    """Values and labels, each on its dimension."""
    row = plain_array(rows.frame.index[order].tolist())
    coordinates: dict[str, Any] = {
        name: ("obs", of_points, {"units": "1", "long_name": POINTS[name]})
        for name, of_points in {"test": rows.test[order], "row": row}.items()
    }
    labels = {name: label[rows.first] for name, label in rows.labels.items()} | {"group": groups}
    variables, coordinates_of_tests = (
        {
            name: (
                stretch_dimension if name == "axial_stretch" else IN_DATA[name].lies_on,
                array,
                IN_DATA[name].attributes,
            )
            for name, array in arrays.items()
        }
        for arrays in (values, labels)
    )
    return xr.Dataset(variables, coordinates | coordinates_of_tests)
