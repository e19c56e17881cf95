"""The order of a test's points, by which slopes are taken: as measured, sorted, or refused.

Points of an inflation test stand in the order of radii, those of an extension test in that of axial
stretches, and those of a sheet in that of the stretch that varies most.
"""

from typing import Literal, get_args

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from pymc_hyperelastic.data.columns import Rows, labels_of
from pymc_hyperelastic.data.extension import clearly_extended
from pymc_hyperelastic.data.inflation import row_text
from pymc_hyperelastic.rounding import ROUNDING

Array = NDArray[np.float64]
Points = NDArray[np.intp]
Cycles = Literal["last", "all"]

#: A curve that falls back by a smaller part of its range is one that rises with measurement errors.
LEAST_FALL = 0.1
_SLOPES = "slopes are taken between neighbouring rows"


def last_cycles(frame: pd.DataFrame, cycles: Cycles) -> pd.DataFrame:
    """Rows of the last cycle of every experiment; those before it precondition the tissue.

    The last cycle has the highest number, or if cycles have names it is the one that comes last.
    """
    if cycles not in get_args(Cycles):
        raise ValueError(f"cycles is {cycles!r}; expected one of {get_args(Cycles)}")
    if "cycle" not in frame or cycles == "all":
        return frame
    tests = [labels_of(frame, name) for name in ("specimen", "experiment")]
    test, _ = pd.factorize(pd.MultiIndex.from_arrays(tests))
    cycle = labels_of(frame, "cycle")
    rank = cycle if cycle.dtype.kind == "i" else pd.factorize(cycle)[0]
    last = pd.Series(rank).groupby(test).transform("max").to_numpy()
    return frame[rank == last]


def order_of_points(
    rows: Rows,
    measured: str,
    points: dict[str, Array],
    stretch: Array,
    varying: NDArray[np.bool_],
) -> Points:
    """Rows test by test, each in the order of its curve.

    A test in which radius or pressure never turns stays as it is, and so does one that turns by
    less than a tenth of its range, as readings do. Rows that were shuffled are sorted by the
    radius, which is doubted, if the pressure then never falls. All else is an error.

    In a test whose axial `stretch`, given by rows, is `varying`, it is the stretch that does not
    turn; rows that were shuffled are sorted by it, whatever the radius does.
    """
    tests = _points_of_tests(rows)
    compared = {
        name: points[name] for name in (measured, "pressure", "axial_force") if name in points
    }
    if varying.any():
        compared = {"axial_stretch": np.where(varying[rows.test], stretch, np.nan)} | compared
    repeated = _repeated(rows, compared)
    order = []
    for test in tests:
        own = test[~repeated[test]]
        extended = varying[rows.test[own[0]]] and clearly_extended(stretch[own])
        name = "axial_stretch" if extended else measured
        along = stretch[own] if extended else points[measured][own]
        pressure = None if extended else points["pressure"][own]
        order.append(_sorted(rows, own, name, along, pressure))
    _refuse_repeated(rows, compared, tests, repeated)
    return np.concatenate(order)


def order_of_sheet_points(
    rows: Rows, points: dict[str, Array], stretches: dict[str, Array]
) -> Points:
    """Rows test by test, each in the order of the stretch that varies most in it.

    The `stretches` are the given measures of them, by the names of their columns. Rows that were
    shuffled are sorted, which is doubted; rows up and down, as in loading and unloading, are an
    error.
    """
    tests = _points_of_tests(rows)
    repeated = _repeated(rows, points)
    order = []
    for test in tests:
        own = test[~repeated[test]]
        known = {name: x[own] for name, x in stretches.items() if np.isfinite(x[own]).all()}
        name = max(known, key=lambda name: np.ptp(known[name]), default=None)
        order.append(own if name is None else _sorted(rows, own, name, known[name], None))
    _refuse_repeated(rows, points, tests, repeated)
    return np.concatenate(order)


def _points_of_tests(rows: Rows) -> list[Points]:
    # Stable: points keep the frame's order inside a test, also if its rows are scattered.
    gathered = np.argsort(rows.test, kind="stable")
    return np.split(gathered, np.cumsum(np.bincount(rows.test))[:-1])


def _sorted(rows: Rows, points: Points, name: str, along: Array, pressure: Array | None) -> Points:
    """Order of one test by the quantity `name`, with a doubt or an error if it turns."""
    if rows.test[points[0]] in rows.failed:
        return points
    order = _order_along(rows, points, name, along, pressure)
    if not np.array_equal(order, points):
        rows.problems.doubt(
            "order",
            rows.place(points[_first_turn(along)]),
            f"{name} turns back here; the rows of the experiment were shuffled, and have been "
            "sorted by it",
        )
    return order


def _order_along(
    rows: Rows, points: Points, name: str, along: Array, pressure: Array | None
) -> Points:
    """Order of one test by the quantity `name`; without pressures its points have no slopes."""
    ascending = np.argsort(along, kind="stable")
    if _never_turns(along) or (pressure is not None and _never_turns(pressure)):
        return points
    turns = _turns(along) if pressure is None else min(_turns(along), _turns(pressure))
    if _up_and_down(turns, len(points)):
        why = "as if this were loading and unloading"
        why += ", between which a material loses energy" if pressure is None else f"; {_SLOPES}"
    elif pressure is None:
        return points[ascending] if turns else points
    elif np.all(np.diff(pressure[ascending]) >= 0):
        return points[ascending]
    elif turns:
        why = f"and sorted by it the pressure falls; {_SLOPES}"
    else:
        return points
    sort = "sort them" if rows.of_files else f"sort them, frame.sort_values({name!r})"
    rows.refuse(
        points[_first_turn(along)],
        f"{name} turns back here, {why}: name loading and unloading in a column 'phase', cycles "
        "in a column 'cycle', and choose with ph.select(data, phase=...); or, if the rows were "
        f"only shuffled, {sort}",
    )
    return points


def _up_and_down(turns: int, count: int) -> bool:
    """Return True if a curve turns as often as cycles do, and less often than shuffled rows.

    A cycle has at least 4 rows between two turns on average, and shuffled rows have 1.5.
    """
    return turns == 1 or (turns > 0 and count >= 4 * (turns + 1))


def _never_turns(x: Array) -> bool:
    steps = np.diff(x)
    return bool(np.all(steps >= 0) or np.all(steps <= 0))


def _first_turn(x: Array) -> int:
    """First point at which a curve leaves the direction of its beginning."""
    steps = np.diff(x)
    began = np.sign(steps[np.flatnonzero(steps)[0]])
    return int(np.flatnonzero(steps * began < 0)[0]) + 1


def _turns(x: Array) -> int:
    """How often a curve turns back by more than a part of its range."""
    fall = LEAST_FALL * np.ptp(x) * (1 + ROUNDING)
    turns, way, high, low = 0, 0, x[0], x[0]
    for value in x[1:]:
        high, low = max(high, value), min(low, value)
        if way >= 0 and high - value > fall:
            turns, way, low = turns + (way > 0), -1, value
            high = value
        elif way <= 0 and value - low > fall:
            turns, way, high = turns + (way < 0), 1, value
            low = value
    return turns


def _repeated(rows: Rows, compared: dict[str, Array]) -> NDArray[np.bool_]:
    """Return the rows that repeat another of their test.

    The order of a test is that of its other rows: loading and unloading meet at equal points, and
    are an error of the order.
    """
    return pd.DataFrame(compared).assign(test=rows.test).duplicated().to_numpy()


def _refuse_repeated(
    rows: Rows, compared: dict[str, Array], tests: list[Points], repeated: NDArray[np.bool_]
) -> None:
    """Refuse the first repeated row of each test that has no other error: it would count twice."""
    values = np.column_stack(list(compared.values()))
    drop = (
        "delete the line"
        if rows.of_files
        else "drop it, by frame.drop_duplicates(subset=[...]) of labels and measured values"
    )
    for points in tests:
        if not repeated[points].any() or rows.test[points[0]] in rows.failed:
            continue
        i = points[np.argmax(repeated[points])]
        first = next(j for j in points if np.array_equal(values[j], values[i], equal_nan=True))
        found = zip(compared, values[i], strict=True)
        cells = ", ".join(f"{name} {x:.6g}" for name, x in found if np.isfinite(x))
        rows.refuse(
            i,
            f"repeats {row_text(rows.frame.index[first])} ({cells}), and would count twice: {drop}",
        )
