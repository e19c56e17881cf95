"""The order of a test's points, by which slopes are taken: as measured, sorted, or refused.

Points of an inflation test stand in the order of radii, those of an extension test in that of axial
stretches.
"""

from typing import Literal, get_args

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from pymc_hyperelastic.data.columns import Rows, labels_of
from pymc_hyperelastic.data.extension import clearly_extended

Cycles = Literal["last", "all"]

# A curve that falls back by less of its range is one that rises with errors of measurement.
_FALL = 0.1
# Relative tolerance of that fall: exactly a tenth does not count, in any unit of pressure.
_ROUNDING = 1e-9
# Legs of a cycle have at least so many rows on average; those of shuffled rows have 1.5.
_LEG = 4


def last_cycles(frame: pd.DataFrame, cycles: Cycles) -> pd.DataFrame:
    """Rows of the last cycle of every experiment; those before it precondition the tissue.

    The last is the one of the highest number, or where cycles have names the one that comes last.

    Examples
    --------
    >>> frame = pd.DataFrame({"specimen": "S1", "experiment": 1, "cycle": [1, 1, 2, 2]})
    >>> last_cycles(frame, "last").index.tolist()
    [2, 3]
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
    rows: Rows, measured: str, stretch: NDArray[np.float64], varying: NDArray[np.bool_]
) -> tuple[NDArray[np.intp], list[str]]:
    """Rows test by test, each in the order of its curve; and what was sorted, in words.

    A test in which radius or pressure never turns stays as it is, and so does one that turns by
    less than a tenth of its range, as readings do. Rows that were shuffled are sorted by the
    radius if the pressure then never falls. All else is refused.

    In a test whose axial `stretch`, given by rows, is `varying`, it is the stretch that does not
    turn; rows that were shuffled are sorted by it, whatever the radius does.
    """
    radius, pressure = rows.numbers(measured), rows.numbers("pressure")
    # Stable: points keep the frame's order inside a test, also where its rows are scattered.
    gathered = np.argsort(rows.test, kind="stable")
    parts = np.split(gathered, np.cumsum(np.bincount(rows.test))[:-1])
    of_rows = varying[rows.test]
    _refuse_repeated(rows, measured, parts, np.where(of_rows, stretch, np.nan))
    order, doubts = [], []
    for points in parts:
        along, name = radius[points], measured
        if varying[rows.test[points[0]]] and clearly_extended(stretch[points]):
            along, name = stretch[points], "axial_stretch"
            order.append(_in_order_of_stretch(rows, points, along))
        else:
            order.append(_in_order(rows, points, along, pressure[points], measured))
        if not np.array_equal(order[-1], points):
            turn = points[_first_turn(along)]
            doubts.append(
                f"{rows.place(turn)}: {name} turns back here; the rows of the experiment were "
                "shuffled, and have been sorted by it"
            )
    return np.concatenate(order), doubts


def _in_order(
    rows: Rows,
    points: NDArray[np.intp],
    radius: NDArray[np.float64],
    pressure: NDArray[np.float64],
    measured: str,
) -> NDArray[np.intp]:
    """One test's rows, of these radii and pressures."""
    if _never_turns(radius) or _never_turns(pressure):
        return points
    turns = min(_turns(radius), _turns(pressure))
    found = f"{rows.place(points[_first_turn(radius)])}: {measured} turns back here"
    if _up_and_down(turns, len(points)):
        raise ValueError(f"{found}, as if this were loading and unloading; {_fixes(measured)}")
    ascending = np.argsort(radius, kind="stable")
    if np.all(np.diff(pressure[ascending]) >= 0):
        return points[ascending]
    if turns:
        raise ValueError(f"{found}, and sorted by it the pressure falls; {_fixes(measured)}")
    return points


def _in_order_of_stretch(
    rows: Rows, points: NDArray[np.intp], stretch: NDArray[np.float64]
) -> NDArray[np.intp]:
    """Rows of one extension test, of these stretches."""
    turns = 0 if _never_turns(stretch) else _turns(stretch)
    if _up_and_down(turns, len(points)):
        raise ValueError(
            f"{rows.place(points[_first_turn(stretch)])}: axial_stretch turns back here, as if "
            "this were loading and unloading, between which a wall loses energy; "
            f"{_named_or_sorted('axial_stretch')}"
        )
    return points[np.argsort(stretch, kind="stable")] if turns else points


def _up_and_down(turns: int, count: int) -> bool:
    """Whether so many rows turn as those of cycles do, and not as shuffled ones."""
    return turns == 1 or (turns > 0 and count >= _LEG * (turns + 1))


def _never_turns(x: NDArray[np.float64]) -> bool:
    steps = np.diff(x)
    return bool(np.all(steps >= 0) or np.all(steps <= 0))


def _first_turn(x: NDArray[np.float64]) -> int:
    """First point that is not on the way on which its curve began."""
    steps = np.diff(x)
    began = np.sign(steps[np.flatnonzero(steps)[0]])
    return int(np.flatnonzero(steps * began < 0)[0]) + 1


def _turns(x: NDArray[np.float64]) -> int:
    """How often a curve turns back by more than a part of its range."""
    fall = _FALL * np.ptp(x) * (1 + _ROUNDING)
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


def _refuse_repeated(
    rows: Rows, measured: str, parts: list[NDArray[np.intp]], stretch: NDArray[np.float64]
) -> None:
    """Raise where a row repeats another of its test, at the same stretch: it would count twice."""
    compared = [name for name in (measured, "pressure", "axial_force") if name in rows.frame]
    columns = [rows.numbers(name, may_be_missing=True) for name in compared]
    if np.isfinite(stretch).any():
        compared, columns = ["axial_stretch", *compared], [stretch, *columns]
    values = np.column_stack(columns)
    twice = pd.DataFrame(values).assign(test=rows.test).duplicated().to_numpy()
    for points in parts:
        if not twice[points].any():
            continue
        i = points[np.argmax(twice[points])]
        first = next(j for j in points if np.array_equal(values[j], values[i], equal_nan=True))
        found = zip(compared, values[i], strict=True)
        raise ValueError(
            f"{rows.place(i)}: repeats row {rows.frame.index[first]} "
            f"({', '.join(f'{n} {x:.6g}' for n, x in found if np.isfinite(x))}), and would count "
            "twice: drop it, frame.drop_duplicates()"
        )


def _fixes(measured: str) -> str:
    return f"slopes are taken between neighbouring rows: {_named_or_sorted(measured)}"


def _named_or_sorted(along: str) -> str:
    return (
        "name loading and unloading in a column 'phase', cycles in a column 'cycle', and choose "
        "with ph.select(data, phase=...); or, if the rows were only shuffled, sort them, "
        f"frame.sort_values({along!r})"
    )
