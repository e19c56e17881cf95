"""Random results are saved as they are or refused by name; files of them are read or refused."""

import os
import random
import tempfile
import warnings
from datetime import date, datetime
from functools import cache
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pandas as pd
import pytest
import xarray as xr
from tiers import deep

import pymc_hyperelastic as ph
from pymc_hyperelastic.io.checksum import groups_of
from pymc_hyperelastic.io.results import open_table
from pymc_hyperelastic.messages import shown

# FUZZ multiplies the number of cases of the second tier, which are then new ones at each run.
FUZZ = int(os.environ.get("FUZZ", "1"))
FIRST_TIER, SECOND_TIER = 100, 1000 * FUZZ
# Letters of a message at most: it is read in a terminal.
LONGEST_MESSAGE = 2000

DTYPES = ["f8", "f4", "f2", "i8", "i4", "u1", "u8", "?", "U3", "S3", "c16", "longdouble"]
TIMES = ["datetime64[s]", "datetime64[ns]", "datetime64[D]", "timedelta64[s]", "timedelta64[ns]"]
OBJECTS = [
    ["a", ""], ["a", None], ["a", np.nan], ["a", 1], [1, 2], [1.5, None], [True, False],
    [date(2024, 5, 1)] * 2, [[1], [2, 3]], [b"a", b"b"], [{}, {}], [10**30, 1], [pd.NA, "a"],
]  # fmt: skip
NAMES = [
    "mu", "x", "noise_sd", "µ²", "a b", "a/b", ".", "..", "", "a\0b", "\ud800", 3, ("a", 1), None,
    "_FillValue", "_Netcdf4Dimid", "units", "scale_factor", "checksum", "coordinates", "CLASS",
    "_nc3_strict", "DIMENSION_LIST", "NAME", "dtype", "a" * 300, " ", "a.b", "-", "e\u0301", "\n",
    "_NCProperties", "missing_value", "calendar", "grid_mapping", "store", "REFERENCE_LIST",
]  # fmt: skip
ATTRIBUTES = [
    "text", "", "µ", "a\0b", "\ud800", "x" * 70_000, "days since 2020", "i8", "x y", "nan",
    np.array("t"), 1, -(2**63), 2**63, 2**64, 10**400, 1.5, np.nan, 1j, np.float32(0.1),
    np.int8(3), True, np.bool_(True), None, [], [1], [1, 2], (1, 2), [1, 2.5], [1, "a"], ["a"],
    ["a", "b"], ("a", "b"), [True, False], [None], [[1, 2], [3, 4]], [[1], [2, 3]], np.arange(3),
    np.eye(2), np.arange(20_000.0), range(3), np.array(["a", "bc"]), np.array([], "U1"),
    np.array(["a", 1], object), np.array([True, False]), {"a": 1}, {1: 2}, {"a": {1}}, {1, 2},
    b"a", b"\xff", date(2024, 5, 1), datetime(2024, 5, 1, 12), pd.Timestamp("2024-05-01"),
    np.datetime64("2024-05-01"), np.timedelta64(1, "s"), Path("a/b"), pd.NA,
    np.array(["a", None], object), pd.Series([1, 2]), np.ma.masked, object(), len, ph,
]  # fmt: skip


def variable(rng: random.Random, dims: list[Any], size: dict[Any, int]) -> Any:
    """Return values of a random type along dimensions, or some that have one of their own."""
    shape = tuple(size[dim] for dim in dims)
    count = int(np.prod(shape))
    match rng.choice(["plain"] * 4 + ["time", "object", "extension"]):
        case "time":
            times = np.arange(count).astype(rng.choice(TIMES))
            if count and rng.random() < 0.3:
                times[rng.randrange(count)] = rng.choice(["NaT", -(10**9), 10**9])
            return times.reshape(shape)
        case "object":
            values = np.empty(count, object)
            values[:] = (rng.choice(OBJECTS) * count)[:count]
            return values.reshape(shape)
        case "extension" if len(shape) == 1:
            kind = rng.choice(["category", "string", "Int64", "boolean"])
            return pd.array([rng.choice([1, 0]) for _ in range(count)], "Int64").astype(kind)
    values = np.arange(count, dtype=float)
    if count and rng.random() < 0.2:
        values[rng.randrange(count)] = rng.choice([np.nan, np.inf, -0.0, 1e300, 5e-324])
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # NaN as an integer
        return values.astype(rng.choice(DTYPES)).reshape(shape)


def some(rng: random.Random, values: list[Any], odd: float) -> Any:
    """Return one of the first three values, or with a probability one of all."""
    return rng.choice(values) if rng.random() < odd else rng.choice(values[:3])


def table(rng: random.Random) -> xr.Dataset:
    odd = rng.choice([0.0, 0.1, 0.4])
    dims = {some(rng, ["draw", "test", "mu", *NAMES], odd): rng.choice([0, 1, 2, 3])}
    dims |= {some(rng, ["chain", "k", *NAMES], odd): rng.choice([1, 2, 3])}
    variables = {}
    for _ in range(rng.choice([0, 1, 1, 2, 3])):
        along = rng.choice([[], [*dims][:1], [*dims]])
        attrs = {
            some(rng, NAMES, odd): some(rng, ATTRIBUTES, odd) for _ in range(rng.choice([0, 0, 1]))
        }
        variables[some(rng, NAMES, odd)] = (along, variable(rng, along, dims), attrs)
    coords = {dim: variable(rng, [dim], dims) for dim in dims if rng.random() < 0.3}
    data = xr.Dataset(variables, {n: (n, v) for n, v in coords.items()})
    if rng.random() < 0.05 and len(data.sizes) > 1:
        data = data.stack(sample=[*data.sizes])
    data.attrs = {
        some(rng, NAMES, odd): some(rng, ATTRIBUTES, odd) for _ in range(rng.choice([0, 1, 2]))
    }
    if data.variables and rng.random() < 0.1:
        data[rng.choice([*data.variables])].encoding = rng.choice(
            [
                {"dtype": "i2", "scale_factor": 0.1},
                {"dtype": "f4"},
                {"zlib": True},
                {"_FillValue": 0},
                {"units": "days since 2000-01-01"},
                {"unlimited_dims": {"draw"}},
                {"chunksizes": (1,)},
            ]
        )
    return data


def random_result(rng: random.Random) -> xr.Dataset | xr.DataTree | None:
    """Return a random result, or nothing where xarray itself makes none."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            if rng.random() < 0.5:
                return table(rng).copy()
            groups = {
                rng.choice(["/", "/C1", "/C1/posterior", "/a b", "/µ"]): table(rng)
                for _ in range(2)
            }
            return xr.DataTree.from_dict(groups).copy()
    except Exception:  # xarray takes no such names or values
        return None


def plain(value: Any) -> Any:
    """Return an attribute as a file gives it back."""
    if isinstance(value, dict | date | Path):
        return None  # text of them
    value = np.ravel(value)
    return value.astype("i8") if value.dtype.kind == "b" else value


def differences(found: xr.Dataset | xr.DataTree, result: xr.Dataset | xr.DataTree) -> list[str]:
    """Return what of a result is another after saving."""
    again, wrong = dict(groups_of(found)), []
    for at, table in groups_of(result):
        read = again[at]
        if {*read.variables} != {*table.variables} or {*read.coords} != {*table.coords}:
            return [f"{at} has the variables {[*read.variables]}"]
        wrong += [f"{at}: {why}" for why in other_attributes(read.attrs, table.attrs)]
        for name in table.variables:
            a, b = read.variables[name], table.variables[name]
            if not a.equals(b) or (b.dtype.kind in "fiub" and a.dtype != b.dtype):
                wrong.append(f"variable {name!r} of {at}")
            wrong += [f"{name!r} of {at}: {why}" for why in other_attributes(a.attrs, b.attrs)]
    return wrong


def other_attributes(found: dict, given: dict) -> list[str]:
    if {*found} - {"checksum"} != {*given} - {"checksum"}:
        return [f"attributes {[*found]}, not {[*given]}"]
    pairs = {name: (plain(found[name]), plain(given[name])) for name in {*given} - {"checksum"}}
    return [
        f"attribute {name!r} is {a!r}, not {b!r}"[:200]
        for name, (a, b) in pairs.items()
        if b is not None and not np.array_equal(a, b, equal_nan=b.dtype.kind == "f")
    ]


def names_in(result: xr.Dataset | xr.DataTree) -> set[str]:
    nodes = [result] if isinstance(result, xr.Dataset) else list(result.subtree)
    tables = [*nodes, *(v for n in nodes for v in n.variables.values())]
    names = {n for t in tables for n in t.attrs}
    return {shown(name) for name in names | {n for t in nodes for n in (*t.variables, *t.dims)}}


def check_saving(seed: int, folder: Path) -> str:
    """Save and open a random result; return what happened."""
    result = random_result(random.Random(seed))
    if result is None:
        return "no result"
    try:
        ph.save_result(result, folder / "result.nc")
    except (TypeError, ValueError) as error:
        text = str(error)
        assert "\n" not in text and len(text) < LONGEST_MESSAGE, text
        assert " together, " in text or any(name in text for name in names_in(result)), text
        assert isinstance(result, xr.Dataset) or "group '/" in text, text
        return "refused"
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        found = ph.open_result(folder / "result.nc")
    assert not (wrong := differences(found, result)), wrong
    return "saved"


DEEP = "[" * 100_000
JSON = [DEEP, '{"a":' * 50 + "1" + "}" * 50, "{", "null", "[]", '{"groups": {}, "sha256": 1}']
JSON += [
    '{"groups": {"..": [[], []]}, "sha256": ""}',
    '{"groups": {"C1": [[1], {}]}, "sha256": []}',
]
VALUES = [*JSON, "text", "", b"\xff", 1.5, np.nan, np.arange(3), h5py.Empty("f8"), 10**6]
VALUES += ["days since 2020", "days since -99999-01-01", "x y", "../x", np.bytes_(b"a")]
VALUES += [np.zeros((2, 2)), "a" * 70_000]
FIELDS = ["_FillValue", "scale_factor", "add_offset", "missing_value", "units", "calendar", "dtype"]
FIELDS += ["coordinates", "grid_mapping", "_Unsigned", "_Netcdf4Dimid", "CLASS", "NAME", "checksum"]
TYPES = ["f8", "i1", "S3", "c16", "f2", np.dtype([("a", "f8"), ("b", "S2")]), np.dtype("V5")]
TYPES += [h5py.ref_dtype, h5py.regionref_dtype, h5py.enum_dtype({"A": 0, "B": 1})]
TYPES += [h5py.special_dtype(vlen=kind) for kind in (str, bytes, np.dtype("f8"))]


@cache
def intact() -> list[bytes]:
    """Return a file of a table, and one of a tree."""
    text = {"text": ("x", ["a", "", "µ<b>"]), "flag": ("x", [True, False, True])}
    one = xr.Dataset({"mu": (("draw", "x"), np.eye(2, 3)), **text}, {"x": ["S1", "S2", "S3"]})
    one.attrs = {"priors": '{"mu": ["Uniform", [0, 1]]}', "seed": 1}
    day = ("k", np.array(["2024-05-01"], "M8[s]"))
    tree = {"/": xr.Dataset({"day": day, "empty": ("none", np.empty(0))}), "/C1": one[[]]}
    files = []
    with tempfile.TemporaryDirectory() as folder:
        for result in (one, xr.DataTree.from_dict(tree | {"/C1/posterior": one})):
            ph.save_result(result, Path(folder, "intact.nc"))
            files.append(Path(folder, "intact.nc").read_bytes())
    return files


def damage(rng: random.Random, path: Path) -> None:
    """Change one thing in an HDF5 file."""
    with h5py.File(path, "a") as file:
        names = []
        file.visit(names.append)
        place = rng.choice([*names, "/"])
        entry, group = (
            file[place],
            file[rng.choice([n for n in [*names, "/"] if isinstance(file[n], h5py.Group)])],
        )
        match rng.choice(
            ["drop", "attribute", "attribute", "new", "move", "variable", "shape", "link"]
        ):
            case "drop" if entry.attrs and rng.random() < 0.7:
                del entry.attrs[rng.choice([*entry.attrs])]
            case "drop" if place != "/":
                del file[place]
            case "attribute" if entry.attrs:
                entry.attrs[rng.choice([*entry.attrs])] = rng.choice(VALUES)
            case "new":
                entry.attrs[rng.choice(FIELDS)] = rng.choice(VALUES)
            case "move" if place != "/":
                file.move(place, rng.choice(["other", "C1/other", "x y", "mu", "C1", "a.b"]))
            case "variable":
                group.create_dataset("odd", rng.choice([(), (2,), (0,), (2, 3)]), rng.choice(TYPES))
            case "shape" if place != "/" and isinstance(entry, h5py.Dataset):
                del file[place]
                shape = rng.choice([(), (2, 3), (3, 2), (0,), (10**9,), (1,) * 30])
                kind, chunks = rng.choice(["f8", "S1", "i4"]), (1,) * len(shape) or None
                file.create_dataset(place, shape, kind, chunks=chunks)
            case "link":
                other = h5py.ExternalLink("b.nc", "/mu")
                group["odd"] = rng.choice([entry, h5py.SoftLink("/mu"), other, np.dtype("f8")])


def check_opening(seed: int, folder: Path) -> str:
    """Open a damaged file; return what happened."""
    rng = random.Random(seed)
    content = rng.choice(intact())
    path = folder / "damaged.nc"
    kind = rng.choice(["byte", "bytes", "cut", "hdf5", "hdf5", "hdf5"])
    if kind != "hdf5":
        changed = bytearray(content)
        for _ in range(1 if kind == "byte" else 20):
            changed[rng.randrange(len(content))] = rng.randrange(256)
        path.write_bytes(changed[: rng.randrange(len(content))] if kind == "cut" else changed)
    else:
        path.write_bytes(content)
        if rng.random() < 0.5:
            with h5py.File(path, "a") as file:
                file.attrs.pop("checksum")
        for _ in range(rng.choice([1, 1, 2, 3])):
            try:
                damage(rng, path)
            except Exception:  # HDF5 does not make everything
                pass
    opener = rng.choice([ph.open_result, ph.open_result, open_table])
    try:
        with warnings.catch_warnings(record=True):
            warnings.simplefilter("always")
            found = opener(path)
    except (ValueError, OSError) as error:
        text = str(error)
        assert "\n" not in text and len(text) < LONGEST_MESSAGE and path.name in text, text
        return "refused"
    for _, table in groups_of(found):
        assert all(variable.values is not None for variable in table.variables.values())
    return "opened"


CHECKS = {"saving": check_saving, "opening": check_opening}


@pytest.mark.parametrize(
    "check, cases",
    [*((c, FIRST_TIER) for c in CHECKS), *deep((c, SECOND_TIER) for c in CHECKS)],
)
# h5py and h5netcdf cannot close some files that they could not open, and warn of that.
@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
def test_random_results_are_stored_unchanged_or_refused_in_one_line(check, cases, tmp_path):
    first = 0 if FUZZ == 1 else random.randrange(10**9)
    outcomes = {CHECKS[check](seed, tmp_path) for seed in range(first, first + cases)}
    assert outcomes >= {"refused", "saved" if check == "saving" else "opened"}
