"""Covariates of specimens, and pairs of specimens of the same animal.

Both are read from the data of fitted classes or from tables of the user, for
:func:`~pymc_hyperelastic.compare_classes`.
"""

from collections.abc import Hashable, Sequence
from datetime import datetime
from numbers import Real
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr
from numpy.typing import NDArray

from pymc_hyperelastic.data.select import specimens_apart
from pymc_hyperelastic.messages import listed, warn_user
from pymc_hyperelastic.models.settings import inflation_data_of
from pymc_hyperelastic.predictions.members import names_of_specimens
from pymc_hyperelastic.rounding import ROUNDING

Array = NDArray[np.float64]
# Values by group and specimen.
OfSpecimens = dict[str, dict[str, Any]]


def pairs_of(tree: xr.DataTree, pair: Any) -> list[tuple[Hashable, str, str]]:
    """Return each animal with its specimens in the first and in the second group.

    Raises
    ------
    ValueError
        If there are not two groups, or an animal does not have one specimen in each.
    """
    groups = list(tree.children)
    if len(groups) != 2:
        raise ValueError(f"pair needs two groups; got {groups}")
    animals = [
        [(animal, name) for name, animal in of_group.items()]
        for of_group in _by_specimen(tree, "pair", pair).values()
    ]
    for group, rows in zip(groups, animals, strict=True):
        names = [animal for animal, _ in rows]
        twice = [animal for animal in names if names.count(animal) > 1]
        if twice:
            raise ValueError(
                f"animal {twice[0]!r} has several specimens in class {group!r}: "
                f"{listed(name for animal, name in rows if animal == twice[0])}"
            )
    first, second = dict(animals[0]), dict(animals[1])
    for own, other, group in ((first, second, groups[1]), (second, first, groups[0])):
        alone = [animal for animal in own if animal not in other]
        if alone:
            raise ValueError(
                f"animal {alone[0]!r}, specimen {own[alone[0]]!r}, has no specimen in class "
                f"{group!r}: leave the animal out of both classes"
            )
    return [(animal, name, second[animal]) for animal, name in first.items()]


class Covariates:
    """Standardised covariates of each specimen, with categories as indicator variables.

    Attributes
    ----------
    names : list of str
        Names of the covariates; a category has one indicator for each value except the first.
    middle : array, shape (covariate)
        Means over all specimens.
    scale : array, shape (covariate)
        Standard deviations over all specimens.
    """

    def __init__(self, tree: xr.DataTree, given: Any) -> None:
        columns: dict[str, OfSpecimens] = {}
        given = [given] if isinstance(given, str) else given
        for name in given if given is not None else []:
            values = given[name] if not isinstance(given, (list, tuple)) else name
            columns |= _as_numbers(name, _by_specimen(tree, name, values))
        self.names = list(columns)
        places = [(g, s) for g, names in _specimens(tree).items() for s in names]
        table = np.array([[columns[n][g][s] for n in columns] for g, s in places], float)
        table = table.reshape(len(places), len(columns))
        self.middle, self.scale = table.mean(axis=0), table.std(axis=0)
        largest = np.abs(table).max(axis=0, initial=0.0)
        for name, sd, size in zip(self.names, self.scale, largest, strict=True):
            if not sd > ROUNDING * size:
                raise ValueError(f"covariate {name!r} is the same for all specimens")
        standard = (table - self.middle) / self.scale
        self._rows = dict(zip(places, standard, strict=True))
        self._warn_of_groups(standard, [list(tree.children).index(g) for g, _ in places])

    def of(self, group: str, specimen: str) -> Array:
        """Return the standardised covariates of a specimen."""
        return self._rows[group, specimen]

    def _warn_of_groups(self, table: Array, group: Sequence[int]) -> None:
        """Warn if groups and covariates are collinear."""
        indicators = np.eye(max(group) + 1)[group]
        both = np.concatenate([indicators, table], axis=1)
        if np.linalg.matrix_rank(both, rtol=ROUNDING) < both.shape[1]:
            warn_user(
                f"the groups and the covariates {self.names} are collinear: their separate effects "
                "are determined by the priors only"
            )


def _specimens(tree: xr.DataTree) -> dict[str, list[str]]:
    """Return the names of the specimens by group."""
    return {group: names_of_specimens(fitted) for group, fitted in tree.children.items()}


def _by_specimen(tree: xr.DataTree, what: str, given: Any) -> OfSpecimens:
    """Return the value of each specimen, from a variable of the data or from a dict."""
    found: OfSpecimens = {}
    for group, specimens in _specimens(tree).items():
        if isinstance(given, str):
            data = inflation_data_of(tree[group])
            if given not in data.variables or data[given].dims != ("test",):
                raise ValueError(
                    f"{what}: the data of class {group!r} have no variable {given!r} by test; give "
                    "the name of such a variable, or a dict from specimens to values"
                )
            parts = specimens_apart(data)
            values = {n: [*np.unique(parts[n][given].values)] for n in specimens}
            for name, several in values.items():
                if len(several) > 1:
                    raise ValueError(
                        f"{what}: specimen {name!r} of class {group!r} has several values of "
                        f"{given!r}: {listed(np.asarray(several).tolist())}"
                    )
            # Dates stay dates, which are no numbers of nanoseconds.
            found[group] = {
                n: v if isinstance(v, np.datetime64) else np.asarray(v).item()
                for n, (v,) in values.items()
            }
            continue
        table = {str(k): v for k, v in dict(given).items()}
        for name in specimens:
            if name not in table:
                raise ValueError(f"{what}: specimen {name!r} of class {group!r} has no value")
        found[group] = {name: table[name] for name in specimens}
    return found


def _as_numbers(name: str, values: OfSpecimens) -> dict[str, OfSpecimens]:
    """Return a covariate as numbers; a category as indicators of all values except the first."""
    flat = [(g, s, v) for g, of_group in values.items() for s, v in of_group.items()]
    for group, specimen, value in flat:
        where = f"covariate {name!r} of specimen {specimen!r} of class {group!r}"
        if np.ndim(value):
            raise ValueError(f"{where} has several values: give one for each specimen")
        if isinstance(value, (datetime, np.datetime64)):
            raise ValueError(
                f"{where} is the date {value}: give a number, such as of days, or a text"
            )
        if pd.isna(value) or str(value).strip() in ("", "nan"):
            raise ValueError(f"{where} is missing: leave the specimen out, or state it")
        if isinstance(value, (Real, np.bool_)) and np.isinf(float(value)):
            raise ValueError(f"{where} is {value!r}; expected a finite number")
    numeric = [isinstance(v, (Real, np.bool_)) for _, _, v in flat]
    if all(numeric):
        return {name: values}
    if any(numeric):
        raise ValueError(f"covariate {name!r} is a number for some specimens but not for others")
    levels = sorted({str(v) for _, _, v in flat})
    return {
        f"{name}={level}": {
            g: {s: float(str(v) == level) for s, v in of_group.items()}
            for g, of_group in values.items()
        }
        for level in levels[1:]
    } or {name: {g: dict.fromkeys(of_group, 0.0) for g, of_group in values.items()}}
