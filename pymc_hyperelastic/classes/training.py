"""Find measurements that are in the training data of a class twice, or again in other data.

Fits warn of copies among the training data. Classification and cross-validation refuse new data,
and data that are left out, that are in the training data: a class always fits its own data.
"""

from collections.abc import Hashable, Iterator, Mapping, Sequence

import numpy as np
import xarray as xr

from pymc_hyperelastic.data.inflation import (
    FEWEST_COPIED,
    describe_test,
    measured_radius,
    points_of,
)
from pymc_hyperelastic.messages import warn_user
from pymc_hyperelastic.models.settings import inflation_data_of
from pymc_hyperelastic.quantities import SHEET_VARIABLES
from pymc_hyperelastic.rounding import DIGITS

# Rounded radius and pressure, by which points are compared.
Point = tuple[float, ...]
# Data, and the index of a test, that hold a point: by the point, and by a label of the holder.
Held = dict[Point, dict[str, tuple[xr.Dataset, int]]]


def check_new(new_data: xr.Dataset, classes: Mapping[str, xr.DataTree], fresh: bool) -> None:
    """Check that a class was not fitted to the new data.

    Experiments are compared by their points, not by their names. `fresh` is True if the classes
    model a new specimen as a new draw from the class distribution. A second experiment on a
    training specimen is not such a draw.

    Raises
    ------
    ValueError
        If all points of an experiment are in the training data of one class.

    Warns
    -----
    UserWarning
        If `fresh` is True and a specimen of the new data has the name of a training specimen.
    """
    specimens = new_data["specimen"].values.astype(str)
    training_specimens: dict[str, list[str]] = {}
    held: Held = {}
    for name, fitted in classes.items():
        if "constant_data" not in fitted.children:
            continue
        training = inflation_data_of(fitted)
        _add_points(held, training, [name] * training.sizes["test"])
        again = np.isin(specimens, training["specimen"].values.astype(str))
        if again.any():
            training_specimens[name] = list(dict.fromkeys(specimens[again].tolist()))
    for test, copies in _copies(new_data, held):
        for name, (training, other) in copies.items():
            raise ValueError(
                f"{describe_test(new_data, test)}: these measurements are in the training data of "
                f"class {name!r}, as {describe_test(training, other)}. The class was fitted to "
                "them, and would always be favoured: leave them out of ph.fit_classes, or use "
                "ph.cross_validate, which leaves out one specimen after the other"
            )
    if training_specimens and fresh:
        names = " and ".join(f"{n} of class {name!r}" for name, n in training_specimens.items())
        warn_user(
            f"the new data hold the specimens {names}, whose other measurements were in the "
            "training data: with variability each is modelled as a new specimen, and therefore "
            "looks more typical of its class than it is. Leave these specimens out of the classes, "
            "or rename them if they are different specimens"
        )


def warn_of_copies(groups: Mapping[str, xr.Dataset]) -> None:
    """Warn of the first test whose points are also those of a specimen with another name.

    Warns
    -----
    UserWarning
        If there is such a test, of at least three points.
    """
    held = _held_by_specimens(groups)
    for data in groups.values():
        sizes = np.bincount(data["test"].values, minlength=data.sizes["test"])
        for test, copies in _copies(data, held):
            others = {*copies} - {data["specimen"].values[test]}
            if others and sizes[test] >= FEWEST_COPIED:
                warn_user(
                    f"{describe_test(data, test)}: these {sizes[test]} points are listed under the "
                    f"specimen {min(others, key=str)!r} as well, and would count twice: if one "
                    "was copied by mistake, remove it"
                )
                return


def check_left_out(groups: Mapping[str, xr.Dataset], units: Mapping[str, Hashable]) -> None:
    """Raise if a test of a specimen is also in the data of a specimen of another unit.

    `units` gives the unit of each specimen; the specimens of a unit are left out together.
    """
    held = _held_by_specimens(groups)
    for data in groups.values():
        for test, copies in _copies(data, held):
            unit = units[data["specimen"].values[test]]
            others = sorted(specimen for specimen in copies if units[specimen] != unit)
            if others:
                raise ValueError(
                    f"{describe_test(data, test)}: these measurements are listed under the "
                    f"specimen {others[0]!r} as well, so that classes would be fitted to data that "
                    "are left out: drop one of the specimens, or leave both out together with "
                    "leave_out"
                )


def _held_by_specimens(groups: Mapping[str, xr.Dataset]) -> Held:
    """Return the specimens that hold each point."""
    held: Held = {}
    for data in groups.values():
        _add_points(held, data, data["specimen"].values.tolist())
    return held


def _add_points(held: Held, data: xr.Dataset, labels: Sequence[str]) -> None:
    """Add all points of the data, each with the label of its test."""
    for point, test in zip(_points(data), data["test"].values.tolist(), strict=True):
        held.setdefault(point, {})[labels[test]] = data, test


def _copies(
    data: xr.Dataset, held: Held
) -> Iterator[tuple[int, dict[str, tuple[xr.Dataset, int]]]]:
    """For each test, yield the labels that hold all its points, and where they hold the first."""
    points = _points(data)
    for test in range(data.sizes["test"]):
        first, *others = [held.get(point, {}) for point in points[points_of(data, test)]]
        in_all = set(first).intersection(*others)
        yield test, {label: place for label, place in first.items() if label in in_all}


def _points(data: xr.Dataset) -> list[Point]:
    """Return the rounded radius and pressure of each point, or stretches and stresses."""
    columns = [data[name] for name in SHEET_VARIABLES if name in data]
    if "pressure" in data:
        columns += [measured_radius(data), data["pressure"]]
    measured = np.stack([column.values.astype(float) for column in columns], axis=1)
    # Variables of the other kind are NaN, and become 0 at all points of the test.
    return [tuple(point) for point in np.round(np.nan_to_num(measured), DIGITS).tolist()]
