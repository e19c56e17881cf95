"""The work on one batch of a cohort, in any process."""

import warnings
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from typing import Any, ClassVar, NamedTuple

import numpy as np
import xarray as xr
from threadpoolctl import threadpool_limits

from pymc_hyperelastic.data.select import labels_of_units, tests_at, units_of
from pymc_hyperelastic.io.store import Part
from pymc_hyperelastic.parallel import LOCK

Prepared = Callable[[xr.Dataset], xr.Dataset]


class Work(ABC):
    """Settings of the work on each specimen, or each experiment, of a cohort.

    They are sent to the workers. The result of one specimen depends only on its own measurements
    and on these settings.
    """

    #: Name of the work in a manifest.
    name: ClassVar[str]

    by: str
    """``"specimen"`` or ``"test"``."""

    @abstractmethod
    def manifest(self) -> dict[str, Any]:
        """All that decides the numbers, but for the data, as JSON has it."""

    @abstractmethod
    def prepare(self) -> Prepared:
        """Set up once in a process: a function of some specimens' data."""


# Variable of a result: why the fit of a specimen is doubtful; empty if it is not.
DOUBTFUL = "doubtful"


class Remarks(NamedTuple):
    """Messages about units of a batch. Each begins with the label of the unit."""

    failed: list[str]
    doubtful: list[str]


# The prepared work of this process, by its token: one at a time.
_prepared: dict[str, Prepared] = {}


def run_batch(work: Work, token: str, data: xr.Dataset, part: Part) -> Remarks:
    """Do the work of a batch and write its part of the store.

    Parameters
    ----------
    work : Work
        What is done.
    token : str
        By which a process knows that it has prepared this work already.
    data : xarray.Dataset
        Those of the batch.
    part : Part
        Its part of the store.

    Returns
    -------
    Remarks
        Why units failed, or have a doubtful fit.
    """
    # All that a warning would say stands in the results.
    with LOCK, warnings.catch_warnings(), threadpool_limits(1):
        warnings.simplefilter("ignore")
        if token not in _prepared:
            _prepared.clear()
            _prepared[token] = work.prepare()
        result = _each_alone_if_needed(_prepared[token], data, work.by)
        # All labels are in a file of their own: to read a part takes as long as it has variables.
        part.save(result.drop_vars([*labels_of(data, work.by)]))
    labels = units_of(data, work.by)

    def messages(name: str) -> list[str]:
        texts = result[name].values.tolist() if name in result else [""] * len(labels)
        return [f"{label}: {text}" for label, text in zip(labels, texts, strict=True) if text]

    return Remarks(messages("error"), messages(DOUBTFUL))


def _each_alone_if_needed(run: Prepared, data: xr.Dataset, by: str) -> xr.Dataset:
    """Results of a batch; an error that data can cause becomes a row with its message."""
    try:
        return run(data)
    except (ValueError, ArithmeticError) as error:
        units = units_of(data, by)
        if len(units) == 1:
            return failure(data, by, str(error))
    return joined(
        [_each_alone_if_needed(run, tests_at(data, tests), by) for tests in units.values()], by
    )


def failure(data: xr.Dataset, by: str, message: str) -> xr.Dataset:
    """Rows of what failed, with a message each."""
    return xr.Dataset(
        {"error": (by, np.full(len(units_of(data, by)), message))}, labels_of(data, by)
    )


def labels_of(data: xr.Dataset, by: str) -> dict[str, Any]:
    """Coordinates of the units of these data."""
    return {name: (by, v.astype(str)) for name, (_, v) in labels_of_units(data, by).items()}


def joined(rows: Sequence[xr.Dataset], by: str) -> xr.Dataset:
    """Results one below the other; what failed lacks what the others have: NaN, or no text."""
    variables: dict[str, Any] = {}
    for name in dict.fromkeys(name for row in rows for name in row.variables):
        like = next(row[name] for row in rows if name in row).variable
        if by not in like.dims:
            variables[name] = like
            continue
        pieces = [
            row[name].variable if name in row else filled(like, by, row.sizes[by]) for row in rows
        ]
        variables[name] = xr.Variable.concat(pieces, by)
    first = max(rows, key=lambda row: len(row.variables))
    coords = [name for name in first.coords if name in variables]
    return xr.Dataset(variables, attrs=first.attrs).set_coords(coords)


def filled(like: xr.Variable, dim: str, size: int) -> xr.Variable:
    """Return a variable like another, of a given length along a dimension, filled with NaN or 0."""
    shape = [size if d == dim else n for d, n in like.sizes.items()]
    empty = np.nan if like.dtype.kind == "f" else np.zeros((), like.dtype).item()
    return xr.Variable(like.dims, np.full(shape, empty, like.dtype), like.attrs)
