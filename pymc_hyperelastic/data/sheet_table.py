"""Data of sheets from a table of measured points."""

from typing import get_args

import numpy as np
import pandas as pd
import xarray as xr

from pymc_hyperelastic.data.columns import Rows, check_frame, groups_of, rows_of
from pymc_hyperelastic.data.order import Cycles, last_cycles, order_of_sheet_points
from pymc_hyperelastic.data.plausible import check_plausible_sheets
from pymc_hyperelastic.data.sheet_columns import (
    AXES,
    ByAxis,
    Measure,
    StatedStress,
    as_in_frame,
    check_columns,
    columns_of,
    completed,
    deformation_in,
    kinds_of,
    measures_of,
    numbers_of,
    stretches_of_sheet,
    without_free,
)
from pymc_hyperelastic.data.table import UNITS_IN_FILES, dataset_of, refuse_defects
from pymc_hyperelastic.data.units import to_internal
from pymc_hyperelastic.data.validation import Check, Problems, check_known
from pymc_hyperelastic.data.variables import STRESS_MEASURE
from pymc_hyperelastic.quantities import IN_TABLES


def sheet_data(
    frame: pd.DataFrame,
    *,
    stress: StatedStress,
    kind: str = "biaxial",
    gauge_length: Measure | None = None,
    area: Measure | None = None,
    stress_unit: str = "kPa",
    force_unit: str = "mN",
    length_unit: str = "mm",
    cycles: Cycles = "last",
    check: Check = "warn",
) -> xr.Dataset:
    r"""Build the Dataset of tests of sheets from a table of measured points.

    A sheet is stretched along its axes x and y, and its faces are not loaded. The name of a column
    states its content. The table has one of the first four pairs, and one of the last two:

    ==================================================  ======================================
    columns                                             content
    ==================================================  ======================================
    ``stretch_x``, ``stretch_y``                        stretch: deformed over unloaded length
    ``engineering_strain_x``, ``engineering_strain_y``  λ − 1, with the stretch λ
    ``green_strain_x``, ``green_strain_y``              (λ² − 1)/2
    ``displacement_x``, ``displacement_y``              change of the length `gauge_length`
    ``stress_x``, ``stress_y``                          the stress that `stress` states
    ``force_x``, ``force_y``                            force on `area`, with ``stress="force"``
    ==================================================  ======================================

    A column without ``_x`` or ``_y``, such as ``stretch``, belongs to the axis along which the
    `kind` of test pulls.

    Parameters
    ----------
    frame : pandas.DataFrame
        One row for each point, with the columns ``specimen``, ``experiment``, those of the table
        above, and optionally ``group``, ``cycle`` and ``phase``, as in :func:`inflation_data`;
        other columns are ignored. If the stretch of an axis is missing in all rows of a test, the
        sheet is free along this axis. A missing stress was not measured. The rows of a test stand
        in the order of loading or unloading.
    stress : {"cauchy", "nominal", "force"}
        Measure of the stress: force over the deformed cross-section (Cauchy), or over the unloaded
        one (nominal, first Piola-Kirchhoff, engineering stress). With ``"force"`` the table has
        forces, and `area` makes nominal stresses of them. There is no default, because no check
        finds a wrong choice: the two stresses differ by the factor λ, and without a law each of
        them is as plausible as the other.
    kind : str
        Kind of all tests, or name of a column of kinds that is constant within each test:

        ================================  ======================================================
        ``"biaxial"``                     columns of both axes are given
        ``"uniaxial"``, ``"uniaxial_x"``  pulled along x, and free along y
        ``"uniaxial_y"``                  pulled along y, and free along x
        ``"equibiaxial"``                 the stretch along y equals that along x
        ``"pure_shear"``                  pulled along x, and the stretch along y is 1
        ================================  ======================================================

        All but the first need one stretch and one stress. The stress across, of an equibiaxial test
        or of pure shear, is used if the table has columns ``stress_x`` and ``stress_y``. If a
        uniaxial test has stretches along both axes, the one across is not used in a model; it is
        only checked.
    gauge_length : float, str or tuple, optional
        The unloaded length that a displacement extends, in the unit of the displacement: a number
        or the name of a column, or two of these in a tuple, for x and for y.
    area : float, str or tuple, optional
        Unloaded cross-section on which a force acts, in the square of `length_unit`: a number or
        the name of a column, or two of these in a tuple, perpendicular to x and to y.
    stress_unit, force_unit, length_unit : str
        Units of the table, as pint knows them, such as ``"MPa"``, ``"N"``, ``"um"``.
    cycles : {"last", "all"}
        The cycles of an experiment to use, if the table has a column ``cycle``. By default the last
        cycle, with the highest number, since the earlier cycles precondition the tissue.
    check : {"warn", "raise", "ignore"}
        The reaction to input that is possible, but probably a mistake, see Warns.

    Returns
    -------
    xarray.Dataset
        Dimension ``obs`` with ``stretch_x``, ``stretch_y`` (NaN along a free axis), ``stress_x``
        and ``stress_y`` (kPa; NaN where not measured), and the coordinates ``test`` and ``row``
        (the frame's index label). Dimension ``test``, in order of first appearance, with the
        coordinates ``specimen``, ``experiment``, ``group`` (``"all"`` without such a column),
        ``stress_measure`` (``"cauchy"`` or ``"nominal"``) and, if the table has them, ``cycle`` and
        ``phase``.

    Warns
    -----
    UserWarning
        If the rows of a test were shuffled; they are sorted by the stretch that varies most. If the
        table has a column ``kind`` that is not used. If a stress pulls against the stretch. If a
        uniaxial test becomes wider or thicker where it is pulled. If a stretch or a stress is
        beyond what soft sheets have, such as a strain where a stretch was meant; the ranges are on
        the page What a file may look like. `check` makes it an error, or silences it.

    Raises
    ------
    TypeError
        If `frame` is not a DataFrame, or a measure of the sheet is neither a number nor a str.
    ValueError
        If a column, label or value is missing, is text, is not finite or is impossible for a
        sheet; if the table states the deformation twice; if a free direction has a stress; if
        `area` or `gauge_length` is missing, or is not used; if a unit does not fit; if rows of a
        test repeat, or run up and down as in loading and unloading.

    See Also
    --------
    inflation_data, combine_tests, sheet_stress, select

    Examples
    --------
    >>> import pandas as pd, pymc_hyperelastic as ph
    >>> frame = pd.DataFrame(
    ...     {
    ...         "specimen": "S1",
    ...         "experiment": "equal",
    ...         "stretch_x": [1.05, 1.1],
    ...         "stretch_y": [1.05, 1.1],
    ...         "stress_x": [12.0, 31.0],
    ...         "stress_y": [9.0, 22.0],
    ...     }
    ... )
    >>> data = ph.sheet_data(frame, stress="cauchy")
    >>> dict(data.sizes), data["stress_y"].values.tolist()
    ({'obs': 2, 'test': 1}, [9.0, 22.0])

    A strip, 20 mm long with a cross-section of 4 mm², pulled by forces in N:

    >>> strip = pd.DataFrame(
    ...     {"specimen": "S2", "experiment": 1, "displacement": [1.0, 2.0], "force": [0.2, 0.6]}
    ... )
    >>> data = ph.sheet_data(
    ...     strip, stress="force", kind="uniaxial", gauge_length=20.0, area=4.0, force_unit="N"
    ... )
    >>> data["stretch_x"].values.tolist(), data["stress_x"].values.tolist()
    ([1.05, 1.1], [50.0, 150.0])
    >>> data["stretch_y"].values.tolist(), data["stress_measure"].item()
    ([nan, nan], 'nominal')
    """
    check_known(check)
    if stress not in get_args(StatedStress):
        raise ValueError(f"stress is {stress!r}; expected one of {get_args(StatedStress)}")
    check_frame(frame, ("specimen", "experiment"))
    deformation, load = deformation_in(frame.columns), "force" if stress == "force" else "stress"
    _check_measures(deformation, stress, gauge_length, area)
    problems = Problems(check, frame.attrs.get(UNITS_IN_FILES, {}))
    rows = rows_of(last_cycles(frame, cycles), problems)
    kinds = kinds_of(rows, kind)
    check_columns(rows, deformation, kinds)
    check_columns(rows, load, kinds)
    problems.stop()

    deformations, loads = numbers_of(rows, deformation, kinds), numbers_of(rows, load, kinds)
    lengths: ByAxis = {}
    if gauge_length is not None:
        lengths = measures_of(rows, "gauge_length", gauge_length, deformations)
    stretches = stretches_of_sheet(rows, deformation, deformations, lengths)
    stretches, lateral = completed(rows, deformation, stretches, kinds)
    loads = without_free(rows, load, loads, stretches, kinds)
    if area is None:
        stresses = {
            axis: to_internal(of_axis, stress_unit, "stress") for axis, of_axis in loads.items()
        }
    else:
        stresses = _stress_of_force(rows, loads, area, force_unit, length_unit)
    groups = groups_of(rows)
    problems.stop()

    values = {f"stretch_{axis}": stretches[axis] for axis in AXES}
    values |= {f"stress_{axis}": stresses[axis] for axis in AXES}
    order = order_of_sheet_points(rows, values, as_in_frame(rows, deformation, deformations))
    values = {name: numbers[order] for name, numbers in values.items()}
    measures = np.full(rows.first.size, "nominal" if stress == "force" else stress)
    data = dataset_of(rows, order, values, groups).assign_coords(
        {STRESS_MEASURE: ("test", measures, IN_TABLES[STRESS_MEASURE].attributes)}
    )
    refuse_defects(data, rows)
    check_plausible_sheets(data, lateral[order], problems)
    problems.report()
    return data


def _check_measures(
    deformation: str, stress: str, gauge_length: Measure | None, area: Measure | None
) -> None:
    """Raise unless measures of the sheet are given if they are needed, and not otherwise."""
    displaced = deformation == "displacement"
    if displaced and gauge_length is None:
        raise ValueError(
            "the deformation is a displacement, and gauge_length is not given: give the unloaded "
            "length that it extends, in the same unit, as a number or the name of a column"
        )
    if not displaced and gauge_length is not None:
        raise ValueError(
            f"gauge_length is given, and the deformation is a {deformation.replace('_', ' ')}: "
            f"name its columns {columns_of('displacement')[1]!r} and "
            f"{columns_of('displacement')[2]!r} if they hold displacements, or leave gauge_length "
            "out"
        )
    if stress == "force" and area is None:
        raise ValueError(
            "stress='force', and area is not given: give the unloaded cross-section on which the "
            "force acts, in the square of length_unit, as a number or the name of a column"
        )
    if stress != "force" and area is not None:
        raise ValueError(
            f"area is given, and stress={stress!r}: say stress='force' if the columns hold forces, "
            "or leave area out"
        )


def _stress_of_force(
    rows: Rows, forces: ByAxis, area: Measure, force_unit: str, length_unit: str
) -> ByAxis:
    """Nominal stresses, kPa, of forces on the unloaded cross-section; 1 mN/mm² is 1 kPa."""
    areas = measures_of(rows, "area", area, forces)
    return {
        axis: to_internal(force, force_unit, "force")
        / to_internal(areas[axis], length_unit, "length", power=2)
        for axis, force in forces.items()
    }
