"""Whether new data are new: a class says nothing of data from which it was learned."""

import warnings
from collections.abc import Hashable, Mapping

import numpy as np
import xarray as xr

from pymc_hyperelastic.data.inflation import describe_test, measured_radius
from pymc_hyperelastic.messages import PACKAGE
from pymc_hyperelastic.models.settings import inflation_data_of

# kPa and mm: what the conversion of units, or a file, may change of a number.
_DECIMALS = 9


def check_new(new_data: xr.Dataset, classes: Mapping[str, xr.DataTree], fresh: bool) -> None:
    """Raise if an experiment is one of those from which a class was learned.

    It is if all its points are points of the class, whatever it is named. Where specimens are
    `fresh` draws from their class, another experiment on one of the class's own is warned of: what
    it shares with that, the class took part in.
    """
    specimens = new_data["specimen"].values.astype(str)
    known: dict[str, list[str]] = {}
    for name, fitted in classes.items():
        if "constant_data" not in fitted.children:
            continue
        training = inflation_data_of(fitted)
        _check_points(new_data, training, name)
        again = np.isin(specimens, training["specimen"].values.astype(str))
        if again.any():
            known[name] = list(dict.fromkeys(specimens[again].tolist()))
    if known and fresh:
        names = " and ".join(f"{own} of class {name!r}" for name, own in known.items())
        warnings.warn(
            f"the new data name the specimens {names}, whose other measurements were in the "
            "training data: with variability each is taken for a specimen that the class has never "
            "seen, and looks more like it than it should. Leave these specimens out of the "
            "classes, or give them other names if they are others",
            skip_file_prefixes=(PACKAGE,),
        )


def _check_points(new_data: xr.Dataset, training: xr.Dataset, name: str) -> None:
    """Raise, naming specimen and class, if a test has no point that is not the class's."""
    seen = dict(zip(_points(training), training["test"].values.tolist(), strict=True))
    tests = [seen.get(point) for point in _points(new_data)]
    known = np.array([test is not None for test in tests])
    for test in range(new_data.sizes["test"]):
        of_test = np.flatnonzero(new_data["test"].values == test)
        if known[of_test].all():
            place = describe_test(training, int(tests[of_test[0]] or 0))
            raise ValueError(
                f"{describe_test(new_data, test)}: these measurements are in the training data of "
                f"class {name!r}, as {place}. A class has learned from them, and would always "
                "claim them: leave them out of ph.fit_classes, or let ph.calibration_report leave "
                "out one specimen after the other"
            )


def check_left_out(classes: Mapping[str, xr.Dataset], units: Mapping[str, Hashable]) -> None:
    """Raise if what is left out stays in the classes under another specimen's name."""
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
                    f"{describe_test(data, i)}: these measurements stand under the specimen "
                    f"{others[0]!r} as well, and classes would be learned from what is left out: "
                    "drop one of them, or leave both out together with leave_out"
                )


def _points(data: xr.Dataset) -> list[tuple[float, ...]]:
    """Radius and pressure of each point, rounded: what makes a curve the one that it is."""
    measured = np.stack([measured_radius(data).values, data["pressure"].values], axis=1)
    return [tuple(point) for point in np.round(measured.astype(float), _DECIMALS).tolist()]
