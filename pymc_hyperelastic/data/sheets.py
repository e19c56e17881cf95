"""Tests of sheets and of tubes in one Dataset, and each kind by itself."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from pymc_hyperelastic.data.columns import plain_array
from pymc_hyperelastic.data.inflation import at_points, check_data
from pymc_hyperelastic.data.select import tests_at
from pymc_hyperelastic.data.variables import (
    OPTIONAL,
    STRESS_MEASURE,
    TEST_LABELS,
    sheet_tests,
)
from pymc_hyperelastic.messages import shown
from pymc_hyperelastic.quantities import IN_TABLES, SHEET_VARIABLES

# Separators by which different texts of an attribute are joined.
_BETWEEN_TEXTS = {"title": ", ", "description": " ", "source": " ", "understood": "\n"}


def tubes_of(data: xr.Dataset) -> xr.Dataset | None:
    """Return the tests of tubes, as inflation data without any sheets; None without tubes."""
    if STRESS_MEASURE not in data.variables:
        return data
    tubes = ~sheet_tests(data)
    return tests_at(data, np.flatnonzero(tubes)) if tubes.any() else None


def sheets_of(data: xr.Dataset) -> xr.Dataset | None:
    """Return the tests of sheets, without variables of tubes; None without sheets."""
    sheets = sheet_tests(data)
    if not sheets.any():
        return None
    own = data if sheets.all() else tests_at(data, np.flatnonzero(sheets))
    return own.drop_vars([name for name in own.data_vars if name not in SHEET_VARIABLES])


def combine_tests(*datasets: xr.Dataset) -> xr.Dataset:
    """Combine tests of tubes and of sheets, or several Datasets of one kind, in one Dataset.

    Parameters
    ----------
    *datasets : xarray.Dataset
        Data of :func:`inflation_data`, :func:`sheet_data`, :func:`read_tests` or
        :func:`load_dataset`, one after the other.

    Returns
    -------
    xarray.Dataset
        All tests, in the order of the datasets, with ``test`` counted anew. If there are tests of
        tubes and of sheets, the variables of one kind are NaN for tests of the other, and the
        coordinate ``stress_measure`` is empty for tests of tubes. A label that a dataset lacks,
        such as ``cycle``, is empty for its tests. Titles and sources are joined; ``simulated`` is 1
        if one of the datasets is simulated.

    Raises
    ------
    TypeError
        If the data are no Datasets.
    ValueError
        If a dataset is not sound; if two tests have the same labels, or a specimen has two groups;
        if tubes of some datasets only have outer diameters, or standard deviations of a measure.

    See Also
    --------
    inflation_data, sheet_data, select

    Examples
    --------
    >>> import pandas as pd, pymc_hyperelastic as ph
    >>> tubes = ph.select(ph.load_dataset("simulated_sheep_aorta"), specimen="S1")
    >>> strip = pd.DataFrame(
    ...     {
    ...         "specimen": "S1",
    ...         "experiment": "strip",
    ...         "group": "C1",
    ...         "stretch": [1.1, 1.2],
    ...         "stress": [20.0, 50.0],
    ...     }
    ... )
    >>> sheets = ph.sheet_data(strip, stress="cauchy", kind="uniaxial")
    >>> data = ph.combine_tests(tubes, sheets)
    >>> data["experiment"].values.tolist(), data["stress_measure"].values.tolist()
    (['1', '2', '3', 'strip'], ['', '', '', 'cauchy'])
    """
    for number, data in enumerate(datasets, start=1):
        if isinstance(data, list | tuple):
            raise TypeError(
                "the datasets are in a list: give them by themselves, combine_tests(*list)"
            )
        try:
            check_data(data)
        except (TypeError, ValueError) as error:
            raise type(error)(f"dataset {number}: {error}") from None
    if not datasets:
        raise ValueError("there are no datasets: give one or more, combine_tests(tubes, sheets)")
    _check_labels(datasets)
    _check_variables(datasets)
    first = np.cumsum([0, *(data.sizes["test"] for data in datasets)])
    test = [data["test"].values + start for data, start in zip(datasets, first, strict=False)]
    names = dict.fromkeys(name for data in datasets for name in data.variables)
    if not all("row" in data.variables for data in datasets):
        names.pop("row", None)
    combined = {name: _combined(datasets, str(name)) for name in names if name != "test"}
    combined["test"] = ("obs", np.concatenate(test), datasets[0]["test"].attrs)
    coordinates = dict.fromkeys(name for data in datasets for name in data.coords if name in names)
    data = xr.Dataset(combined, attrs=_attributes(datasets)).set_coords(list(coordinates))
    check_data(data)
    return data


def _combined(datasets: Sequence[xr.Dataset], name: str) -> tuple[str, NDArray, dict[Any, Any]]:
    """Dimension, values and attributes of a variable of all datasets."""
    there = [data[name] for data in datasets if name in data.variables]
    dimension = "obs" if any(of.dims == ("obs",) for of in there) else "test"
    is_text = any(of.dtype.kind not in "bif" for of in there)
    is_label = (
        is_text or name == "row" or (name in IN_TABLES and IN_TABLES[name].dimension == "label")
    )
    parts: list[NDArray] = []
    for data in datasets:
        if name not in data.variables:
            parts.append(np.full(data.sizes[dimension], "" if is_label else np.nan))
        elif data[name].dims == (dimension,):
            parts.append(data[name].values)
        else:
            parts.append(at_points(data, name))
    if is_label:
        values = plain_array([label for part in parts for label in part.tolist()])
    else:
        values = np.concatenate(parts)
    return dimension, values, there[0].attrs


def _check_labels(datasets: Sequence[xr.Dataset]) -> None:
    """Raise if tests of two datasets have the same labels, or a specimen has two groups."""
    tests: dict[tuple, int] = {}
    groups: dict[str, tuple[int, str]] = {}
    for number, data in enumerate(datasets, start=1):
        missing = [""] * data.sizes["test"]
        columns = [
            data[name].values.astype(str).tolist() if name in data.variables else missing
            for name in [*TEST_LABELS, "group"]
        ]
        for *labels, group in zip(*columns, strict=True):
            first = tests.setdefault(tuple(labels), number)
            if first != number:
                known = zip(TEST_LABELS, labels, strict=True)
                test = ", ".join(f"{name} {label!r}" for name, label in known if label)
                raise ValueError(
                    f"datasets {first} and {number} both have {test}: give the tests of one "
                    "dataset other labels, such as data.assign_coords(experiment='sheet ' + "
                    "data['experiment'].astype(str))"
                )
            first, other = groups.setdefault(labels[0], (number, group))
            if other != group:
                raise ValueError(
                    f"specimen {labels[0]!r} is in group {other!r} in dataset {first} and in group "
                    f"{group!r} in dataset {number}: a specimen has one group. Give the tables of "
                    "both a column 'group', or the specimens different names"
                )


def _check_variables(datasets: Sequence[xr.Dataset]) -> None:
    """Raise if tubes of some datasets only have a variable that all must have, or none."""
    for number, data in enumerate(datasets, start=1):
        for name, variable in data.variables.items():
            if variable.dims not in (("obs",), ("test",)):
                raise ValueError(
                    f"dataset {number}: {shown(name)} has dimensions {variable.dims}; expected "
                    f"('obs',) or ('test',): drop it, data.drop_vars({name!r})"
                )
    of_tubes = {i: d for i, d in enumerate(datasets, start=1) if not sheet_tests(d).all()}
    for name in OPTIONAL:
        having = [number for number, data in of_tubes.items() if name in data.variables]
        lacking = [number for number in of_tubes if number not in having]
        if name not in ("axial_force", "kept_circle") and having and lacking:
            how = "combine tubes that were measured in the same way, or say measured='radius'"
            if name != "outer_diameter":
                how = f"state it for all tubes, or drop it, data.drop_vars({name!r})"
            raise ValueError(
                f"the tubes of dataset {having[0]} have {name!r}, and those of dataset "
                f"{lacking[0]} do not: {how}"
            )


def _attributes(datasets: Sequence[xr.Dataset]) -> dict[Any, Any]:
    """Attributes of all datasets: joined texts, and others if they are equal."""
    attributes = {}
    for name in dict.fromkeys(name for data in datasets for name in data.attrs):
        values = [data.attrs[name] for data in datasets if name in data.attrs]
        if name in _BETWEEN_TEXTS:
            attributes[name] = _BETWEEN_TEXTS[name].join(dict.fromkeys(map(str, values)))
        elif name == "simulated":
            attributes[name] = max(values)
        elif len(values) == len(datasets) and all(
            value is values[0] or bool(np.all(value == values[0])) for value in values
        ):
            attributes[name] = values[0]
    return attributes
