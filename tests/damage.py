"""Results that are damaged at random, as an editor, a bad disk or another program may do."""

import json
from collections.abc import Callable
from random import Random
from typing import Any

import numpy as np
import xarray as xr

# What may stand in place of an attribute, and of something inside the JSON of one.
ATTRIBUTES = (
    *("", "null", "{", "[]", "{}", "[[]]", '"text"', "NaN", "3", "text", "[" * 100_000),
    *(0, -1, 1.5, np.nan, np.array([1, 2]), np.array(["a", "b"]), np.float64(2), 10**30),
)
VALUES = (
    *(None, True, 0, -1, 3, 1.5, 10**400, float("nan"), float("inf"), -float("inf")),
    *("", "text", "sample", "os.system", "__class__", "../../etc/passwd"),
    *([], {}, [[]], [1, 2], [None], ["Uniform", [0, 1]], ["sample", [1]], {"a": 1}, {"sd": -1}),
)
NUMBERS = (np.nan, np.inf, -np.inf, 0.0, -1.0, 1e6)
DTYPES = ("<U8", object, int, bool, complex, "float32", "datetime64[ns]")

# What hardly anything reads, and is seldom damaged: the others are more interesting.
UNREAD = ("sample_stats",)
UNREAD_ATTRIBUTES = {
    *("created_at", "creation_library", "creation_library_version", "creation_library_language"),
    *("sample_dims", "versions", "noise_in_words", "random_seed"),
}

Groups = dict[str, xr.Dataset]


def groups_of(result: xr.DataTree | xr.Dataset) -> Groups:
    """Groups by path, without checksums: older files have none."""
    nodes = (
        {".": result}
        if isinstance(result, xr.Dataset)
        else {node.relative_to(result): node.to_dataset(inherit=False) for node in result.subtree}
    )
    for path, data in nodes.items():
        nodes[path] = data.assign_attrs({})
        nodes[path].attrs = {k: v for k, v in data.attrs.items() if k != "checksum"}
    return nodes


def together(groups: Groups, single: bool) -> xr.DataTree | xr.Dataset:
    return (
        groups["."]
        if single
        else xr.DataTree.from_dict(
            {"/" if path == "." else path: data for path, data in groups.items()}
        )
    )


def damaged(groups: Groups, random: Random) -> Groups:
    """The groups with one or two of them damaged."""
    for _ in range(random.choice((1, 1, 1, 2))):
        groups = random.choice(WAYS)(dict(groups), random)
    return groups


def _some(groups: Groups, random: Random, there: Callable[[xr.Dataset], Any]) -> str | None:
    known = [path for path, data in groups.items() if there(data)]
    read = [path for path in known if not path.endswith(UNREAD)]
    known = read if read and random.random() < 0.95 else known
    return random.choice(known) if known else None


def _attribute(groups: Groups, random: Random) -> Groups:
    path = _some(groups, random, lambda data: data.attrs)
    if path is not None:
        attrs = dict(groups[path].attrs)
        read = sorted(set(attrs) - UNREAD_ATTRIBUTES) or sorted(attrs)
        name = random.choice(read if random.random() < 0.95 else sorted(attrs))
        if random.random() < 0.3:
            del attrs[name]
        else:
            attrs[name] = random.choice(ATTRIBUTES)
        groups[path] = groups[path].assign_attrs({})
        groups[path].attrs = attrs
    return groups


def _json(groups: Groups, random: Random) -> Groups:
    def texts(data):
        return sorted(k for k, v in data.attrs.items() if str(v).startswith(("{", "[")))

    path = _some(groups, random, texts)
    if path is None:
        return groups
    name = random.choice(texts(groups[path]))
    try:
        said = json.loads(groups[path].attrs[name])
        text = json.dumps(_within(said, random))
    except (TypeError, ValueError, RecursionError):
        return groups
    if random.random() < 0.1:
        text = text[: random.randrange(len(text))]
    # All classes alike, or one of them.
    everywhere = random.random() < 0.7
    for other, data in groups.items():
        if other == path or (everywhere and name in data.attrs):
            groups[other] = data.assign_attrs({name: text})
    return groups


def _within(said: Any, random: Random) -> Any:
    """JSON in which something is replaced, left out or added."""
    if isinstance(said, dict | list) and said and random.random() < 0.85:
        keys = list(said) if isinstance(said, dict) else list(range(len(said)))
        key = random.choice(keys)
        said = said.copy()
        chance = random.random()
        if chance < 0.15:
            del said[key]
        elif chance < 0.25 and isinstance(said, dict):
            said["stranger"] = random.choice(VALUES)
        else:
            said[key] = _within(said[key], random)
        return said
    return random.choice(VALUES)


def _variable(groups: Groups, random: Random) -> Groups:
    path = _some(groups, random, lambda data: data.variables)
    if path is None:
        return groups
    data = groups[path]
    name = random.choice(sorted(map(str, data.variables)))
    others = [other for other in data.data_vars if str(other) != name]
    chance = random.random()
    if chance < 0.5:
        groups[path] = data.drop_vars(name)
    elif chance < 0.75 or not others:
        groups[path] = data.rename_vars({name: "stranger"})
    else:
        groups[path] = data.assign({random.choice(others): data[name].variable})
    return groups


def _group(groups: Groups, random: Random) -> Groups:
    path = random.choice(sorted(groups))
    other = random.choice(sorted(groups))
    chance = random.random()
    if chance < 0.3 and path != ".":
        return {k: v for k, v in groups.items() if k != path and not k.startswith(f"{path}/")}
    if chance < 0.5:
        return groups | {path: xr.Dataset(attrs=groups[path].attrs)}
    if chance < 0.7:
        return groups | {path: groups[other], other: groups[path]}
    if chance < 0.85 and path != ".":
        return {(f"{k}_2" if k == path else k): v for k, v in groups.items()}
    return groups | {f"{path}/stranger" if path != "." else "stranger": groups[other]}


def _dimension(groups: Groups, random: Random) -> Groups:
    path = _some(groups, random, lambda data: data.sizes)
    if path is None:
        return groups
    data = groups[path]
    dim = random.choice(sorted(map(str, data.sizes)))
    chance = random.random()
    if chance < 0.4:
        groups[path] = data.isel({dim: slice(0, random.choice((0, 0, 1, 2)))})
    elif chance < 0.55:
        groups[path] = data.isel({dim: 0} if data.sizes[dim] else {}, drop=True)
    elif chance < 0.75:
        groups[path] = data.drop_vars(dim, errors="ignore").rename_dims({dim: "stranger"})
    elif chance < 0.85:
        groups[path] = data.expand_dims(stranger=random.choice((1, 2)))
    else:
        groups[path] = data.drop_vars(dim, errors="ignore")
    return groups


def _number(groups: Groups, random: Random) -> Groups:
    def numeric(data):
        return [n for n in data.data_vars if data[n].dtype.kind == "f" and data[n].size]

    path = _some(groups, random, numeric)
    if path is None:
        return groups
    data = groups[path]
    name, value = random.choice(sorted(map(str, numeric(data)))), random.choice(NUMBERS)
    values = data[name].values.copy()
    values[
        ...
        if random.random() < 0.3
        else np.unravel_index(random.randrange(values.size), values.shape)
    ] = value
    groups[path] = data.assign({name: (data[name].dims, values, data[name].attrs)})
    return groups


def _type(groups: Groups, random: Random) -> Groups:
    path = _some(groups, random, lambda data: data.variables)
    if path is None:
        return groups
    data = groups[path]
    name, dtype = random.choice(sorted(map(str, data.variables))), random.choice(DTYPES)
    try:
        with np.errstate(invalid="ignore"):
            values = data[name].values.astype(dtype)
    except (TypeError, ValueError, OverflowError):
        values = np.full(data[name].shape, "text", object)
    if dtype is object:
        values = np.full(data[name].shape, None, object)
    data = data.drop_indexes(name, errors="ignore")
    groups[path] = data.assign({name: (data[name].dims, values)})
    return groups


WAYS = (_attribute, _json, _json, _variable, _group, _dimension, _number, _type)
