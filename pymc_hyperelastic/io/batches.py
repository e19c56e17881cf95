"""Compute specimens or tests in batches, and keep finished batches in a store.

:func:`~pymc_hyperelastic.fit_cohort` and :func:`~pymc_hyperelastic.classify` call
:func:`run_in_batches`.
"""

import warnings
from abc import abstractmethod
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, ClassVar, NamedTuple

import numpy as np
import xarray as xr
from pymc.progress_bar import create_simple_progress

from pymc_hyperelastic.data.select import labels_of_units, tests_at, units_of
from pymc_hyperelastic.io.atomic import remove_abandoned
from pymc_hyperelastic.io.checksum import digests_of
from pymc_hyperelastic.io.store import Part, Parts, Store
from pymc_hyperelastic.messages import PACKAGE
from pymc_hyperelastic.parallel.run import Batch, run_batches, workers_for
from pymc_hyperelastic.parallel.work import Work

Prepared = Callable[[xr.Dataset], xr.Dataset]

#: Name of the part that holds the labels of all units.
UNITS = "units"
#: Variable of a result: why the fit of a specimen is doubtful; empty if it is not.
DOUBTFUL = "doubtful"
# Attribute of a part that could not be computed because processes died. It may not have been its
# fault, and the next call tries it again.
_DIED = "processes_that_died"


class Remarks(NamedTuple):
    """Messages about units, by their labels: errors, and why results are doubtful."""

    failed: dict[str, str]
    doubtful: dict[str, str]


class UnitWork(Work):
    """Settings of the work on each specimen, or each test, of inflation data.

    The result of one specimen depends only on its own measurements and on these settings.
    """

    #: Name of the work in a manifest.
    name: ClassVar[str]

    by: str
    """``"specimen"`` or ``"test"``."""

    @abstractmethod
    def prepare(self) -> Prepared:
        """Set up once in a process: a function of some specimens' data."""

    def doubts(self, result: xr.Dataset) -> list[str]:
        """Return for each unit why its result is doubtful; an empty text if it is not."""
        return _texts(result, DOUBTFUL, self.by)

    def remarks(self, result: xr.Dataset, labels: Sequence[str]) -> Remarks:
        """Return messages about the units of a result, which have these labels."""

        def by_label(texts: list[str]) -> dict[str, str]:
            return {label: text for label, text in zip(labels, texts, strict=True) if text}

        return Remarks(by_label(_texts(result, "error", self.by)), by_label(self.doubts(result)))

    def do(self, prepared: Prepared, data: xr.Dataset, part: Any) -> Remarks:
        """Compute a batch, and write its part without labels.

        All labels are in a file of their own: reading a part takes as long as it has variables.
        """
        result = _each_alone_if_needed(prepared, data, self.by)
        part.save(result.drop_vars([*labels_of(data, self.by)]))
        return self.remarks(result, [*units_of(data, self.by)])


def _texts(result: xr.Dataset, name: str, by: str) -> list[str]:
    return result[name].values.tolist() if name in result else [""] * result.sizes[by]


def run_in_batches(
    work: UnitWork,
    manifest: Mapping[str, Any],
    data: xr.Dataset,
    store: str | Path | Store,
    *,
    progressbar: bool = True,
) -> Remarks:
    """Compute the missing units of a store.

    Parameters
    ----------
    work : UnitWork
        The computation of each unit.
    manifest : mapping
        All that decides the numbers besides the data, see :class:`Parts`.
    data : xarray.Dataset
        Inflation data of all units.
    store : Store, str or Path
        The folder, and who computes.
    progressbar : bool
        Whether to show progress.

    Returns
    -------
    Remarks
        Messages about all units in their order, also about the units that the store had before.

    Raises
    ------
    ValueError
        If the store holds other work.
    OSError
        If the store cannot be written, or no worker is left. Finished batches are kept.
    """
    store = store if isinstance(store, Store) else Store(store)
    units = units_of(data, work.by)
    about = {"work": work.name, "by": work.by, "units": len(units)}
    parts = Parts(store.folder, {**about, **manifest, **digests_of({"data": data})})
    parts.remember(UNITS, lambda: xr.Dataset(coords=labels_of(data, work.by)))
    cohort = _Cohort(work, data, units, parts)
    found = cohort.kept()
    todo = cohort.missing(store.batch_size)
    if todo:
        with (progress := create_simple_progress(progressbar)):
            bar = progress.add_task(work.name, completed=0, total=len(units))
            progress.update(bar, completed=len(units) - sum(batch.size for batch in todo))
            workers = workers_for(work, store.client, store.cores, len(todo))
            try:
                for batch, remarks in run_batches(
                    todo, workers, cohort.data_of, cohort.part_of, cohort.give_up
                ):
                    found.append(remarks)
                    progress.advance(bar, batch.size)
            except OSError as error:
                raise type(error)(
                    f"{error}. Finished batches are in {parts.folder}: the same call continues"
                ) from error
            except KeyboardInterrupt:
                warnings.warn(
                    f"interrupted: finished batches are in {parts.folder}; the same call continues",
                    skip_file_prefixes=(PACKAGE,),
                )
                raise
            finally:
                workers.close()
                if store.client is None:  # a cluster may write on, on a disk without locks
                    remove_abandoned(parts.folder)
    failed, doubtful = ({k: v for each in kind for k, v in each.items()} for kind in zip(*found))
    return Remarks(*({k: kind[k] for k in units if k in kind} for kind in (failed, doubtful)))


def warn_of(remarks: Remarks, units: int) -> None:
    """Warn if some of all units failed, or are doubtful; name the first of them."""
    for texts, name, kind in (
        (remarks.failed, "error", "failed"),
        (remarks.doubtful, DOUBTFUL, "have a doubtful fit"),
    ):
        if texts:
            label, text = next(iter(texts.items()))
            warnings.warn(
                f"{len(texts)} of {units} {kind}: see {name!r} of the result; the first is "
                f"{label}: {text}",
                skip_file_prefixes=(PACKAGE,),
            )


class _Cohort:
    """Units of data, and the parts of a store that hold their results."""

    def __init__(
        self, work: UnitWork, data: xr.Dataset, units: dict[str, list[int]], parts: Parts
    ) -> None:
        self._work, self._data, self._parts = work, data, parts
        self._labels, self._tests = [*units], [*units.values()]
        self._there = np.zeros(len(units), bool)

    def data_of(self, batch: Batch) -> xr.Dataset:
        """Return the data of a batch."""
        tests = self._tests[batch.first : batch.last]
        return tests_at(self._data, np.sort(np.concatenate(tests)))

    def part_of(self, batch: Batch) -> Part:
        """Return the part of a batch."""
        return self._parts.of_part(name_of_part(batch.first, batch.last))

    def give_up(self, batch: Batch, why: str) -> Remarks:
        """Keep a row with the reason for a unit of which processes died."""
        row = failure(self.data_of(batch), self._work.by, why)
        self.part_of(batch).save(row.assign_attrs({_DIED: batch.deaths}))
        return Remarks({self._labels[batch.first]: why}, {})

    def kept(self) -> list[Remarks]:
        """Read the parts that the store has, and return remarks on their units."""
        remarks = [Remarks({}, {})]
        for first, last in parts_of(self._parts.folder):
            part = self._parts.kept(name_of_part(first, last))
            if part is not None and _DIED not in part.attrs:
                self._there[first:last] = True
                remarks.append(self._work.remarks(part, self._labels[first:last]))
        return remarks

    def missing(self, batch_size: int) -> deque[Batch]:
        """Return batches of the units of which the store has no part."""
        lacking = np.flatnonzero(~self._there)
        runs = np.split(lacking, np.flatnonzero(np.diff(lacking) > 1) + 1)
        return deque(
            Batch(first, min(first + batch_size, int(run[-1]) + 1))
            for run in runs
            if run.size
            for first in range(int(run[0]), int(run[-1]) + 1, batch_size)
        )


def name_of_part(first: int, last: int) -> str:
    """Return the name of the part of units from one number to before another."""
    return f"{first:09d}-{last:09d}"


def parts_of(folder: Path) -> list[tuple[int, int]]:
    """First and last number of the units of each part of a store, none of them twice."""
    names = [path.stem.split("-") for path in folder.glob("?????????-?????????.nc")]
    ends = [(int(first), int(last)) for first, last in names if (first + last).isdigit()]
    kept: list[tuple[int, int]] = []
    # Take the longest of several parts that begin at the same unit. Parts overlap if a process that
    # outlived its driver has written units that another process has computed again.
    for first, last in sorted(ends, key=lambda pair: (pair[0], -pair[1])):
        if not kept or first >= kept[-1][1]:
            kept.append((first, last))
    return kept


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
