"""Read a dataclass from JSON; an error names the place that holds another type than its field."""

from dataclasses import MISSING, fields, is_dataclass
from types import NoneType, UnionType
from typing import Any, get_args, get_origin, get_type_hints

from pymc_hyperelastic.evidence.stored import is_number
from pymc_hyperelastic.messages import shown

_WORDS = {str: "text", float: "a number", bool: "true or false", NoneType: "null"}
_WORDS |= {list: "a JSON list", dict: "a JSON object"}


def from_json(kind: Any, value: Any, place: str) -> Any:
    """Return a value of JSON as a type: a dataclass, list, dict, union, or what JSON has.

    ValueError if the value is of another type, or lacks entries of a dataclass.

    Examples
    --------
    >>> from_json(dict[str, float | None], {"sd": 1, "mean": None}, "the record")
    {'sd': 1, 'mean': None}
    """
    members: tuple[Any, ...] = get_args(kind) if isinstance(kind, UnionType) else (kind,)
    for member in members:
        basic = dict if is_dataclass(member) else get_origin(member) or member
        if basic is Any or (is_number(value) if basic is float else type(value) is basic):
            break
    else:
        basics = [dict if is_dataclass(m) else get_origin(m) or m for m in members]
        expected = " or ".join(_WORDS[basic] for basic in basics)
        raise ValueError(f"{place} is {shown(value)}; expected {expected}")
    if is_dataclass(member):
        types = get_type_hints(member)
        needed = {f.name for f in fields(member) if f.default is f.default_factory is MISSING}
        missing, unknown = sorted(needed - value.keys()), sorted(value.keys() - types.keys())
        if missing or unknown:
            raise ValueError(
                f"{place} lacks the entries {missing} and has the unknown entries "
                f"{shown(unknown)}; expected {[*types]}"
            )
        make: Any = member
        return make(**{k: from_json(types[k], v, f"{place}.{k}") for k, v in value.items()})
    if basic is list and isinstance(value, list):
        return [from_json(get_args(member)[0], v, f"{place}[{i}]") for i, v in enumerate(value)]
    if basic is dict and isinstance(value, dict):
        return {k: from_json(get_args(member)[1], v, f"{place}.{k}") for k, v in value.items()}
    return value
