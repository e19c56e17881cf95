"""What a settings file says of a laboratory's tables: columns, units, constants, conventions."""

import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

from pymc_hyperelastic.data.files.headers import KINDS, LABELS, Heading, heading
from pymc_hyperelastic.data.files.numerals import DECIMALS, LARGEST
from pymc_hyperelastic.data.files.spellings import Unit, internal_unit, known_unit, units_of
from pymc_hyperelastic.data.files.text import SEPARATORS
from pymc_hyperelastic.data.inflation import listed
from pymc_hyperelastic.data.labels import plain_label
from pymc_hyperelastic.messages import in_one_line, shown

# Units of all columns of a kind, as arguments of inflation_data are called.
OF_KIND = {
    "pressure_unit": "pressure",
    "radius_unit": "length",
    "angle_unit": "angle",
    "force_unit": "force",
}
# Arguments of inflation_data that a file may state as they are; it checks their values.
CONVENTIONS = ("measured", "opening_angle_convention", "radii_of", "cycles")
_NAMES = (*LABELS, *KINDS)
_SECTIONS = {"columns": _NAMES, "units": tuple(KINDS), "constants": _NAMES}
# Characters of a file of settings, and of a line of it: the memory that a TOML key takes grows with
# the square of its parts.
_LARGEST_FILE = 200_000
_LONGEST_LINE = 1000
_KEYS = (
    *CONVENTIONS,
    *OF_KIND,
    "decimal",
    "separator",
    "ignore",
    *_SECTIONS,
    "files",
    "likelihood",
)


class Constant(NamedTuple):
    """A number that is the same in all rows, and its unit, if its name tells."""

    value: float
    unit: Unit | None = None


Constants = dict[str, Constant | str]


@dataclass(frozen=True)
class Settings:
    """What is said of all tables of a study, checked.

    Examples
    --------
    >>> settings = settings_of({"pressure_unit": "mmHg", "columns": {"pressure": "Druck"}}, "")
    >>> settings.columns["Druck"].name, settings.unit_of("pressure").spelling
    ('pressure', 'mmHg')
    """

    conventions: dict[str, str] = field(default_factory=dict)
    columns: dict[str, Heading] = field(default_factory=dict)
    constants: Constants = field(default_factory=dict)
    files: dict[str, Constants] = field(default_factory=dict)
    units: dict[str, Unit] = field(default_factory=dict)
    units_of_kinds: dict[str, Unit] = field(default_factory=dict)
    ignore: tuple[str, ...] = ()
    decimal: str | None = None
    separator: str | None = None
    likelihood: dict[str, str | float] = field(default_factory=dict)
    """Sizes of errors by name, for the command line."""

    def unit_of(self, name: str) -> Unit | None:
        """Unit that is said for a column, or for all of its kind."""
        return self.units.get(name, self.units_of_kinds.get(KINDS[name]))


def read_settings(path: Path) -> Settings:
    """Settings of a TOML file. Raises ValueError where it is none, or says what is not known."""
    try:
        with path.open(encoding="utf-8-sig") as file:
            text = file.read(_LARGEST_FILE + 1)
        longest = max(map(len, text.splitlines()), default=0)
        if len(text) > _LARGEST_FILE or longest > _LONGEST_LINE:
            raise ValueError(
                f"{path.name} is no file of settings: it has more than {_LARGEST_FILE} characters, "
                f"or a line of more than {_LONGEST_LINE}; divide long lists between lines"
            )
        said = tomllib.loads(text)
    except (tomllib.TOMLDecodeError, UnicodeDecodeError, RecursionError) as error:
        raise ValueError(f"{path.name} is not a TOML file in UTF-8: {in_one_line(error)}") from None
    return settings_of(said, path.name)


def settings_of(said: Mapping[str, Any], place: str) -> Settings:
    """Check what is said in `place`, the name of a file or nothing."""
    where = f"{place}: " if place else "settings: "
    for key, value in said.items():
        if key not in _KEYS:
            raise ValueError(f"{where}{shown(key)} is not known; expected some of {listed(_KEYS)}")
        if key in _SECTIONS:
            _check_section(where, key, value)
        elif key == "files":
            _check_files(where, value)
        elif key == "likelihood":
            _check_likelihood(where, value)
        elif key == "ignore":
            if not _is_texts(value):
                raise ValueError(
                    f"{where}ignore is {shown(value)}; expected a list of column names"
                )
        elif not isinstance(value, str):
            raise ValueError(f"{where}{key} is {shown(value)}; expected text in quotation marks")
    for key, marks in (("decimal", DECIMALS), ("separator", SEPARATORS)):
        if key in said and said[key] not in marks:
            raise ValueError(f"{where}{key} is {shown(said[key])}; expected one of {listed(marks)}")
    return Settings(
        {key: said[key] for key in CONVENTIONS if key in said},
        _columns(said.get("columns", {})),
        _constants(f"{where}constants", said.get("constants", {})),
        {
            file: _constants(f"{where}files.{shown(file)}", constants)
            for file, constants in said.get("files", {}).items()
        },
        {
            name: _unit(where, f"units.{name}", unit, KINDS[name])
            for name, unit in said.get("units", {}).items()
        },
        {kind: _unit(where, key, said[key], kind) for key, kind in OF_KIND.items() if key in said},
        tuple(said.get("ignore", ())),
        said.get("decimal"),
        said.get("separator"),
        dict(said.get("likelihood", {})),
    )


def _check_section(where: str, key: str, section: object) -> None:
    if not isinstance(section, Mapping):
        raise ValueError(f"{where}{key} is {shown(section)}; expected a table, [{key}]")
    for name, value in section.items():
        # Names may be others, have units, and be of diameters, of which half is taken.
        if name not in _SECTIONS[key] and not (key != "units" and heading(name)):
            raise ValueError(
                f"{where}{key} has {shown(name)}, which is not known; expected some of "
                f"{listed(_SECTIONS[key])}"
            )
        if key == "columns" and not (isinstance(value, str) or _is_texts(value)):
            raise ValueError(
                f"{where}columns.{name} is {shown(value)}; expected the name of a column as text, "
                "or a list of names that it has in several files"
            )


def _check_files(where: str, files: object) -> None:
    if not isinstance(files, Mapping):
        raise ValueError(
            f'{where}files is {shown(files)}; expected tables, such as [files."a.csv"]'
        )
    for file, constants in files.items():
        _check_section(f"{where}files.{shown(file)}: ", "constants", constants)


def _check_likelihood(where: str, section: object) -> None:
    if not isinstance(section, Mapping):
        raise ValueError(f"{where}likelihood is {shown(section)}; expected a table, [likelihood]")
    for name, value in section.items():
        if isinstance(value, bool) or not isinstance(value, str | int | float):
            raise ValueError(
                f"{where}likelihood.{name} is {shown(value)}; expected a number and its unit as "
                "text, as in '2 mmHg', or a number of mm² for slope_weight"
            )


def _is_texts(value: object) -> bool:
    return isinstance(value, list | tuple) and all(isinstance(v, str) for v in value)


def _columns(said: Mapping[str, str | Sequence[str]]) -> dict[str, Heading]:
    """What the columns are that are named."""
    return {
        text: known
        for key, texts in said.items()
        for text in ([texts] if isinstance(texts, str) else texts)
        if (known := heading(key))
    }


def _constants(where: str, said: Mapping[str, Any]) -> Constants:
    constants: Constants = {}
    for key, value in said.items():
        known = heading(key)
        assert known is not None  # which was checked
        name, scale, spelling = known
        if name in constants:
            raise ValueError(f"{where} has two of {name}, the second is {shown(key)}: remove one")
        if isinstance(value, bool) or not isinstance(value, int | float | str):
            raise ValueError(f"{where}.{key} is {shown(value)}; expected a number or text")
        if name in LABELS:
            try:
                constants[name] = plain_label(value)
            except ValueError as error:
                raise ValueError(f"{where}.{key}: {error}") from None
        elif isinstance(value, str) or not abs(value) < LARGEST:
            unit_of = internal_unit(KINDS[name])
            of_unit = f", and its unit in its name, as in {name}_{unit_of}, or in units.{name}"
            raise ValueError(
                f"{where}.{key} is {shown(value)}; expected a number{of_unit if unit_of else ''}"
            )
        else:
            unit = None if spelling is None else _unit("", f"{where}.{key}", spelling, KINDS[name])
            constants[name] = Constant(scale * float(value), unit)
    return constants


def _unit(where: str, key: str, spelling: object, kind: str) -> Unit:
    unit = known_unit(spelling, kind) if isinstance(spelling, str) else None
    if unit is None:
        raise ValueError(
            f"{where}{key} is {shown(spelling)}, which is not a known unit of {kind}; expected one "
            f"of {units_of(kind)}"
        )
    return unit
