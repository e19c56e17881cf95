"""Tables of specimens, or of experiments, joined to points by their labels."""

import numpy as np
import pandas as pd

from pymc_hyperelastic.data.columns import differ
from pymc_hyperelastic.data.doubt import refuse
from pymc_hyperelastic.data.inflation import listed


def named(keys: list[str], labels: tuple) -> str:
    """Labels of a test or a specimen, as messages name them.

    Examples
    --------
    >>> named(["specimen", "experiment"], ("S1", 2))
    "specimen 'S1', experiment 2"
    """
    return ", ".join(f"{key} {label!r}" for key, label in zip(keys, labels, strict=True))


def joined(frame: pd.DataFrame, tables: list[pd.DataFrame]) -> tuple[pd.DataFrame, list[str]]:
    """Points with what the tables say of their specimens, and which of these have no points.

    Examples
    --------
    >>> points = pd.DataFrame({"specimen": ["S1"], "pressure": [2.0]}, index=["a.csv, line 2"])
    >>> tubes = pd.DataFrame({"specimen": ["S1", "S2"], "thickness": 0.1}, index=["b, 2", "b, 3"])
    >>> frame, words = joined(points, [tubes])
    >>> frame["thickness"].tolist(), words
    ([0.1], ["not used, without points: specimen 'S2'"])
    """
    words = []
    for keys in (["specimen"], ["specimen", "experiment"]):
        of_keys = [t for t in tables if ("experiment" in t) == ("experiment" in keys)]
        if not of_keys:
            continue
        # One table a group is one table.
        told = pd.concat(of_keys)
        known, wanted = (pd.MultiIndex.from_frame(t[keys]) for t in (told, frame))
        refuse(
            [
                f"{told.index[i]}: {named(keys, known[i])} stands here and in "
                f"{told.index[known == known[i]][0]}: remove one"
                for i in np.flatnonzero(known.duplicated())
            ]
        )
        at = known.get_indexer(wanted)
        refuse(
            [
                f"{frame.index[i]}: {named(keys, wanted[i])} has no row in the table of "
                f"{keys[-1]}s, which has {listed(dict.fromkeys(told[keys[-1]]))}: write labels in "
                "the same way, letter by letter"
                for i in np.flatnonzero((at < 0) & ~wanted.duplicated())
            ]
        )
        for name in told.columns.difference(keys, sort=False):
            frame = _with_column(frame, name, told.iloc[at][name])
        idle = [named(keys, known[i]) for i in range(len(known)) if i not in at]
        words += [f"not used, without points: {', '.join(idle)}"] * bool(idle)
    return frame, words


def _with_column(frame: pd.DataFrame, name: str, told: pd.Series) -> pd.DataFrame:
    """The frame with a column, which agrees with its own if it has one."""
    values = told.to_numpy()
    if name in frame:
        own = frame[name].to_numpy()
        refuse(
            [
                f"{frame.index[i]}: {name} is {own[i]!r}, and {values[i]!r} in {told.index[i]}: "
                "correct one, or name the column of one in the list ignore of the settings"
                for i in np.flatnonzero(differ(own, values))
            ]
        )
    return frame.assign(**{name: values})
