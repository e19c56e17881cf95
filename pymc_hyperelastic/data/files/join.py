"""Tables of specimens, or of experiments, joined to points by their labels."""

import numpy as np
import pandas as pd

from pymc_hyperelastic.data.columns import differ
from pymc_hyperelastic.data.validation import refuse
from pymc_hyperelastic.messages import enumerated, listed, shown


def named(keys: list[str], labels: tuple) -> str:
    """Labels of a test or a specimen, as messages name them."""
    return ", ".join(f"{key} {label!r}" for key, label in zip(keys, labels, strict=True))


def joined(frame: pd.DataFrame, tables: list[pd.DataFrame]) -> tuple[pd.DataFrame, list[str]]:
    """Points with the columns that tables have for their specimens; and rows without points."""
    words = []
    for keys in (["specimen"], ["specimen", "experiment"]):
        of_keys = [t for t in tables if ("experiment" in t) == ("experiment" in keys)]
        if not of_keys:
            continue
        # One table a group is one table.
        table = pd.concat(of_keys)
        known, wanted = (pd.MultiIndex.from_frame(t[keys]) for t in (table, frame))
        labels = pd.factorize(known)[0]
        first = table.index[np.unique(labels, return_index=True)[1][labels]]
        refuse(
            [
                f"{table.index[i]}: {named(keys, known[i])} stands here and in {first[i]}: "
                "remove one"
                for i in np.flatnonzero(known.duplicated())
            ]
        )
        at = known.get_indexer(wanted)
        there = listed(dict.fromkeys(table[keys[-1]]))
        refuse(
            [
                f"{frame.index[i]}: {named(keys, wanted[i])} has no row in the table of "
                f"{keys[-1]}s, which has {there}: write labels in the same way, letter by letter"
                for i in np.flatnonzero((at < 0) & ~wanted.duplicated())
            ]
        )
        for name in table.columns.difference(keys, sort=False):
            frame = _with_column(frame, name, table.iloc[at][name])
        idle = np.setdiff1d(np.arange(len(known)), at)
        if idle.size:
            labels_of = enumerated(named(keys, known[i]) for i in idle)
            words.append(f"not used, without points: {labels_of}")
    return frame, words


def _with_column(frame: pd.DataFrame, name: str, column: pd.Series) -> pd.DataFrame:
    """The frame with a column, which agrees with its own if it has one."""
    values = column.to_numpy()
    if name in frame:
        own = frame[name].to_numpy()
        refuse(
            [
                f"{frame.index[i]}: {name} is {shown(own[i : i + 1].tolist()[0])}, and "
                f"{shown(values[i : i + 1].tolist()[0])} in {column.index[i]}: "
                "correct one, or name the column of one in the list ignore of the settings"
                for i in np.flatnonzero(differ(own, values))
            ]
        )
    return frame.assign(**{name: values})
