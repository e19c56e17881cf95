"""Check that new data, and data that are left out, are not in the training data of a class.

Classification and cross-validation call the checks: a class always fits its own training data.
"""

import warnings
from collections.abc import Hashable, Mapping

import numpy as np
import xarray as xr

from pymc_hyperelastic.data.inflation import describe_test, measured_radius
from pymc_hyperelastic.messages import PACKAGE
from pymc_hyperelastic.models.settings import inflation_data_of

# Decimals to which points, in kPa and mm, are compared: converting units, or writing a file, may
# change the last digits of a number.
_DECIMALS = 9


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
    for name, fitted in classes.items():
        if "constant_data" not in fitted.children:
            continue
        training = inflation_data_of(fitted)
        _check_points(new_data, training, name)
        again = np.isin(specimens, training["specimen"].values.astype(str))
        if again.any():
            training_specimens[name] = list(dict.fromkeys(specimens[again].tolist()))
    if training_specimens and fresh:
        names = " and ".join(f"{n} of class {name!r}" for name, n in training_specimens.items())
        warnings.warn(
            f"the new data hold the specimens {names}, whose other measurements were in the "
            "training data: with variability each is modelled as a new specimen, and therefore "
            "looks more typical of its class than it is. Leave these specimens out of the classes, "
            "or rename them if they are different specimens",
            skip_file_prefixes=(PACKAGE,),
        )


def _check_points(new_data: xr.Dataset, training: xr.Dataset, name: str) -> None:
    """Raise, naming specimen and class, if all points of a test are in the training data."""
    test_of_point = dict(zip(_points(training), training["test"].values.tolist(), strict=True))
    tests = [test_of_point.get(point) for point in _points(new_data)]
    in_training = np.array([test is not None for test in tests])
    for test in range(new_data.sizes["test"]):
        of_test = np.flatnonzero(new_data["test"].values == test)
        if in_training[of_test].all():
            place = describe_test(training, int(tests[of_test[0]] or 0))
            raise ValueError(
                f"{describe_test(new_data, test)}: these measurements are in the training data of "
                f"class {name!r}, as {place}. The class was fitted to them, and would always be "
                "favoured: leave them out of ph.fit_classes, or use ph.calibration_report, which "
                "leaves out one specimen after the other"
            )


def check_left_out(classes: Mapping[str, xr.Dataset], units: Mapping[str, Hashable]) -> None:
    """Raise if a test of a specimen is also in the data of a specimen of another unit.

    `units` gives the unit of each specimen; the specimens of a unit are left out together.
    """
    holders: dict[tuple[float, ...], set[str]] = {}
    for data in classes.values():
        of_point = data["specimen"].values[data["test"].values].tolist()
        for point, specimen in zip(_points(data), of_point, strict=True):
            holders.setdefault(point, set()).add(specimen)
    for data in classes.values():
        points, test = _points(data), data["test"].values
        for i, specimen in enumerate(data["specimen"].values.tolist()):
            copies = set.intersection(*(holders[points[j]] for j in np.flatnonzero(test == i)))
            others = sorted(s for s in copies if units[s] != units[specimen])
            if others:
                raise ValueError(
                    f"{describe_test(data, i)}: these measurements are listed under the specimen "
                    f"{others[0]!r} as well, so that classes would be fitted to data that are left "
                    "out: drop one of the specimens, or leave both out together with leave_out"
                )


def _points(data: xr.Dataset) -> list[tuple[float, ...]]:
    """Return the rounded radius and pressure of each point, by which points are compared."""
    measured = np.stack([measured_radius(data).values, data["pressure"].values], axis=1)
    return [tuple(point) for point in np.round(measured.astype(float), _DECIMALS).tolist()]
