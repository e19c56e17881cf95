"""Parts of data: some tests, by label or by position."""

import warnings
from collections.abc import Collection, Hashable, Iterable, Sequence
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from pymc_hyperelastic.data.inflation import (
    check_data,
    describe_test,
    extension_tests,
)
from pymc_hyperelastic.data.variables import (
    OPTIONAL,
    OPTIONAL_LABELS,
    REQUIRED,
    STRESS_MEASURE,
    sheet_tests,
)
from pymc_hyperelastic.messages import PACKAGE, listed, shown
from pymc_hyperelastic.quantities import SHEET_VARIABLES


def select(
    data: xr.Dataset,
    specimen: Hashable | Iterable[Hashable] | None = None,
    experiment: Hashable | Iterable[Hashable] | None = None,
    group: Hashable | Iterable[Hashable] | None = None,
    *,
    cycle: Hashable | Iterable[Hashable] | None = None,
    phase: Hashable | Iterable[Hashable] | None = None,
    **labels: Hashable | Iterable[Hashable],
) -> xr.Dataset:
    """Keep the tests with the given labels.

    Parameters
    ----------
    data : xarray.Dataset
        Data of tubes, of sheets or of both, see :func:`inflation_data` and :func:`sheet_data`.
    specimen, experiment, group, cycle, phase : label or list of labels, optional
        What to keep; a test must satisfy all that are given. Cycles and phases are those of the
        columns of :func:`inflation_data`, such as ``phase="loading"``.
    **labels
        Other labels that tests have, such as ``stress_measure="nominal"``, or ``split="new"`` and
        ``animal="M1"`` of :func:`~pymc_hyperelastic.read_tests`.

    Returns
    -------
    xarray.Dataset
        The selected tests, in the order of `data`, with ``test`` counted anew.

    Raises
    ------
    ValueError
        If a label is unknown or no test is left; the message lists what exists.

    See Also
    --------
    inflation_data, sheet_data, combine_tests, read_tests

    Examples
    --------
    >>> import pymc_hyperelastic as ph
    >>> data = ph.load_dataset("simulated_sheep_aorta")
    >>> ph.select(data, group="C2", experiment=[1, 2]).sizes["test"]
    4
    """
    check_data(data)
    keep = np.ones(data.sizes["test"], dtype=bool)
    given = {"specimen": specimen, "experiment": experiment, "group": group}
    given |= {"cycle": cycle, "phase": phase, **labels}
    asked = {name: _as_labels(wanted) for name, wanted in given.items() if wanted is not None}
    for name, wanted in asked.items():
        if name not in data.coords or data[name].dims != ("test",):
            labelled = [n for n in data.coords if data[n].dims == ("test",)]
            how = (
                "give inflation_data() a table with such a column"
                if name in OPTIONAL_LABELS
                else f'add it by data.assign_coords({name}=("test", [...]))'
            )
            raise ValueError(f"the data do not name a {name}, only {listed(labelled)}: {how}")
        # Compared as text: a specimen named 7 in a spreadsheet is '7' here.
        present = [str(label) for label in data[name].values.tolist()]
        unknown = [label for label in wanted if str(label) not in present]
        if unknown:
            existing = dict.fromkeys(data[name].values.tolist())
            raise ValueError(
                f"no {name} {shown(unknown[0])} in the data; there are {listed(existing)}"
            )
        keep &= np.isin(present, [str(label) for label in wanted])
    if not keep.any():
        criteria = ", ".join(f"{name}={wanted!r}" for name, wanted in asked.items())
        raise ValueError(f"no test with {criteria} in the data; there are {_inventory(data)}")
    return tests_at(data, np.flatnonzero(keep))


def tests_at(data: xr.Dataset, positions: Sequence[int] | np.ndarray) -> xr.Dataset:
    """Keep the tests at the given positions, which must rise, with ``test`` counted anew.

    If no extension test is kept, the axial stretch is one number a test, as in data without any.
    Variables of sheets are dropped if no test of a sheet is kept, and so are those of tubes.
    """
    # Points stand in the order of their tests, so that only those of the few that are kept are
    # looked at.
    test = data["test"].values
    first, last = (np.searchsorted(test, positions, side) for side in ("left", "right"))
    points = [np.arange(*ends) for ends in zip(first, last, strict=True)]
    own: NDArray[np.intp] = np.concatenate(points) if points else np.empty(0, np.intp)
    chosen = data.isel(obs=own, test=positions)
    renumbered = np.searchsorted(positions, test[own])
    # In its place: to assign coordinates anew takes as long as all else here.
    chosen["test"].data = renumbered
    if STRESS_MEASURE in chosen.variables:
        sheets = sheet_tests(chosen)
        if not sheets.any():
            chosen = chosen.drop_vars([*SHEET_VARIABLES, STRESS_MEASURE], errors="ignore")
        elif sheets.all():
            return chosen.drop_vars([*REQUIRED, *OPTIONAL], errors="ignore")
    stretch = chosen["axial_stretch"]
    if stretch.dims == ("obs",) and not extension_tests(chosen).any():
        held = stretch.values[np.unique(renumbered, return_index=True)[1]]
        chosen = chosen.assign(axial_stretch=("test", held, stretch.attrs))
    return chosen


def specimens_of(data: xr.Dataset) -> tuple[list[str], NDArray[np.intp]]:
    """Specimens in the order of the data, and which of them each test is of."""
    labels = [str(name) for name in data["specimen"].values.tolist()]
    place = {name: i for i, name in enumerate(dict.fromkeys(labels))}
    return [*place], np.array([place[name] for name in labels])


def labels_of_units(data: xr.Dataset, by: str) -> dict[str, tuple[str, NDArray]]:
    """Coordinates that name the units of :func:`units_of`."""
    first = [tests[0] for tests in units_of(data, by).values()]
    names = ("specimen", "experiment", "group") if by == "test" else ("specimen", "group")
    return {name: (by, data[name].values[first]) for name in names}


def units_of(data: xr.Dataset, by: str) -> dict[str, list[int]]:
    """Tests that are judged together, each by itself or all on a specimen, by what to call them."""
    if by == "test":
        return {describe_test(data, i): [i] for i in range(data.sizes["test"])}
    units: dict[str, list[int]] = {}
    for i, name in enumerate(data["specimen"].values.tolist()):
        units.setdefault(str(name), []).append(i)
    return units


def specimens_apart(
    data: xr.Dataset, specimens: Collection[str] | None = None
) -> dict[str, xr.Dataset]:
    """Those of the specimens that the data hold, or all of them, each by itself."""
    return {
        name: tests_at(data, tests)
        for name, tests in units_of(data, "specimen").items()
        if specimens is None or name in specimens
    }


def without_specimens(data: xr.Dataset, specimens: Collection[str]) -> xr.Dataset:
    """Tests of all other specimens."""
    return tests_at(data, np.flatnonzero(~np.isin(data["specimen"].values, list(specimens))))


def warn_of_repeats(data: xr.Dataset) -> None:
    """Warn if several phases of a specimen, or cycles of an experiment, are fitted together."""
    place, phases = _repeated(data, "phase", ["specimen"])
    if phases:
        warnings.warn(
            f"{place} has the phases {listed(phases)}, which are used together as tests of one "
            "material; a hyperelastic material has the same curve in all phases: choose one, "
            f"ph.select(data, phase={shown(phases[0])})",
            skip_file_prefixes=(PACKAGE,),
        )
    place, cycles = _repeated(data, "cycle", ["specimen", "experiment"])
    if cycles:
        warnings.warn(
            f"{place} has the cycles {listed(cycles)}, which are used together as independent "
            "tests; cycles of one experiment are not independent, so that the posterior is too "
            "narrow, and the first ones precondition the tissue: choose the last one, "
            f"cycles='last' or ph.select(data, cycle={shown(cycles[-1])})",
            skip_file_prefixes=(PACKAGE,),
        )


def _repeated(data: xr.Dataset, label: str, names: list[str]) -> tuple[str, list[Hashable]]:
    """Return the first specimen, or experiment, whose tests have several labels, and these."""
    if label not in data.coords:
        return "", []
    found: dict[tuple, dict[Hashable, None]] = {}
    for *of, value in zip(*(data[n].values.tolist() for n in (*names, label)), strict=True):
        found.setdefault(tuple(of), {})[value] = None
    for of_test, labels in found.items():
        if len(labels) > 1:
            words = (f"{n} {shown(x)}" for n, x in zip(names, of_test, strict=True))
            return ", ".join(words), [*labels]
    return "", []


def _inventory(data: xr.Dataset) -> str:
    experiments: dict[tuple, list[str]] = {}
    labels = (data[name].values.tolist() for name in ("group", "specimen", "experiment"))
    for group, specimen, experiment in zip(*labels, strict=True):
        experiments.setdefault((group, specimen), []).append(repr(experiment))
    return "; ".join(
        f"group {group!r}, specimen {specimen!r}, experiment {', '.join(names)}"
        for (group, specimen), names in experiments.items()
    )


def _as_labels(wanted: Hashable | Iterable[Hashable]) -> list[Hashable]:
    several = isinstance(wanted, Iterable) and not isinstance(wanted, str)
    labels: list[Any] = list(wanted) if several else [wanted]  # type: ignore[arg-type]
    return [label.item() if isinstance(label, np.generic) else label for label in labels]
