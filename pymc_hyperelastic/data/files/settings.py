"""Settings of a laboratory's tables: columns, units, constants, conventions."""

import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, get_args

from pymc_hyperelastic.data.files.headers import Heading, heading
from pymc_hyperelastic.data.files.numerals import DECIMALS, LARGEST
from pymc_hyperelastic.data.files.text import LARGEST_FILE, SEPARATORS
from pymc_hyperelastic.data.labels import plain_label
from pymc_hyperelastic.data.order import Cycles
from pymc_hyperelastic.data.table import MeasuredLength
from pymc_hyperelastic.data.units import Unit, expected_units, known_unit
from pymc_hyperelastic.mechanics.reference_tube import Convention, RadiiOf
from pymc_hyperelastic.messages import in_one_line, listed, shown
from pymc_hyperelastic.quantities import IN_TABLES

# Units of all columns of a dimension, as arguments of inflation_data are called.
UNIT_KEYS = {
    "pressure_unit": "pressure",
    "stress_unit": "stress",
    "radius_unit": "length",
    "angle_unit": "angle",
    "force_unit": "force",
}
# Choices of inflation_data and of Tube that a file may state, and their values.
CONVENTIONS = {
    "measured": get_args(MeasuredLength),
    "opening_angle_convention": get_args(Convention),
    "radii_of": get_args(RadiiOf),
    "cycles": get_args(Cycles),
}
_CHOICES = CONVENTIONS | {"decimal": tuple(DECIMALS), "separator": tuple(SEPARATORS)}
_NUMBERS = tuple(name for name, spec in IN_TABLES.items() if spec.dimension != "label")
_SECTIONS = {"columns": tuple(IN_TABLES), "units": _NUMBERS, "constants": tuple(IN_TABLES)}
_KEYS = (*_CHOICES, *UNIT_KEYS, "ignore", *_SECTIONS, "files", "likelihood")
# Characters of a line of a file of settings: the memory that a TOML key takes grows with the square
# of its parts.
_LONGEST_LINE = 1000

# Labels, and numbers in the units of the package, that are the same in all rows.
Constants = dict[str, float | str]


@dataclass(frozen=True)
class Settings:
    """Checked settings of all tables of a study."""

    conventions: dict[str, str] = field(default_factory=dict)
    columns: dict[str, Heading] = field(default_factory=dict)
    constants: Constants = field(default_factory=dict)
    files: dict[str, Constants] = field(default_factory=dict)
    units: dict[str, Unit] = field(default_factory=dict)
    units_of_dimensions: dict[str, Unit] = field(default_factory=dict)
    ignore: tuple[str, ...] = ()
    decimal: str | None = None
    separator: str | None = None
    likelihood: dict[str, str | float] = field(default_factory=dict)
    """Sizes of errors by name, for the command line."""

    def constants_of(self, file: str) -> Constants:
        """Constants of all files, and of this one."""
        return self.constants | self.files.get(file, {})

    def unit_of(self, name: str) -> Unit | None:
        """Unit that is said for a column, or for all of its dimension."""
        return self.units.get(name, self.units_of_dimensions.get(IN_TABLES[name].dimension))


def read_settings(path: Path) -> Settings:
    """Settings of a TOML file. Raises ValueError if it is none, or has unknown keys."""
    try:
        with path.open(encoding="utf-8-sig") as file:
            text = file.read(LARGEST_FILE + 1)
        longest = max(map(len, text.splitlines()), default=0)
        if len(text) > LARGEST_FILE or longest > _LONGEST_LINE:
            raise ValueError(
                f"{path.name} is no file of settings: it has more than "
                f"{LARGEST_FILE / 1e6:.0f} million characters, or a line of more than "
                f"{_LONGEST_LINE}; divide long lists between lines"
            )
        stated = tomllib.loads(text)
    except (tomllib.TOMLDecodeError, UnicodeDecodeError, RecursionError) as error:
        raise ValueError(f"{path.name} is not a TOML file in UTF-8: {in_one_line(error)}") from None
    return settings_of(stated, path.name)


def settings_of(stated: Mapping[str, Any], place: str) -> Settings:
    """Settings that are stated in `place`, the name of a file or nothing, checked."""
    where = f"{place}: " if place else "settings: "
    for key, value in stated.items():
        if key not in _KEYS:
            raise ValueError(f"{where}{shown(key)} is not known; expected some of {listed(_KEYS)}")
        if key in _CHOICES:
            choices = _CHOICES[key]
            if not isinstance(value, str):
                raise _unexpected(f"{where}{key}", value, "text in quotation marks")
            if value not in choices:
                raise _unexpected(f"{where}{key}", value, f"one of {choices}")
        elif key == "ignore" and not _is_texts(value):
            raise _unexpected(f"{where}ignore", value, "a list of column names")
    sections = {
        key: _section(where, key, stated.get(key, {}))
        for key in ("files", "likelihood", *_SECTIONS)
    }
    settings = Settings(
        {key: stated[key] for key in CONVENTIONS if key in stated},
        _columns(where, sections["columns"]),
        units={
            name: _unit(f"{where}units.{name}", unit, IN_TABLES[name].dimension)
            for name, unit in sections["units"].items()
        },
        units_of_dimensions={
            dimension: _unit(f"{where}{key}", stated[key], dimension)
            for key, dimension in UNIT_KEYS.items()
            if key in stated
        },
        ignore=tuple(stated.get("ignore", ())),
        decimal=stated.get("decimal"),
        separator=stated.get("separator"),
        likelihood=_likelihood(where, sections["likelihood"]),
    )
    settings.constants.update(_constants(where, sections["constants"], settings))
    for file, constants in sections["files"].items():
        of_file = f"{where}files.{shown(file)}: "
        section = _section(of_file, "constants", constants)
        settings.files[file] = _constants(of_file, section, settings)
    return settings


def _unexpected(place: str, value: object, expected: str) -> ValueError:
    return ValueError(f"{place} is {shown(value)}; expected {expected}")


def _section(where: str, key: str, section: object) -> Mapping[str, Any]:
    """A table of the settings, whose names are known."""
    if not isinstance(section, Mapping):
        example = 'tables, such as [files."a.csv"]' if key == "files" else f"a table, [{key}]"
        raise _unexpected(f"{where}{key}", section, example)
    for name in section if key in _SECTIONS else ():
        # Names may be others, have units, and be of diameters, of which half is taken.
        if name not in _SECTIONS[key] and not (key != "units" and heading(name)):
            raise ValueError(
                f"{where}{key} has {shown(name)}, which is not known; expected some of "
                f"{listed(_SECTIONS[key])}"
            )
    return section


def _likelihood(where: str, section: Mapping[str, Any]) -> dict[str, str | float]:
    for name, value in section.items():
        if isinstance(value, bool) or not isinstance(value, str | int | float):
            raise _unexpected(
                f"{where}likelihood.{name}",
                value,
                "a number and its unit as text, as in '2 mmHg', or a number of mm² for "
                "slope_weight",
            )
    return dict(section)


def _is_texts(value: object) -> bool:
    return isinstance(value, list | tuple) and all(isinstance(v, str) for v in value)


def _columns(where: str, stated: Mapping[str, Any]) -> dict[str, Heading]:
    """The meanings of the columns that the settings name."""
    columns: dict[str, Heading] = {}
    for key, texts in stated.items():
        texts = [texts] if isinstance(texts, str) else texts
        if not _is_texts(texts):
            raise _unexpected(
                f"{where}columns.{key}",
                texts,
                "the name of a column as text, or a list of names that it has in several files",
            )
        columns |= {text: known for text in texts if (known := heading(key))}
    return columns


def _constants(where: str, stated: Mapping[str, Any], settings: Settings) -> Constants:
    constants: Constants = {}
    for key, value in stated.items():
        known = heading(key)
        assert known is not None  # which was checked
        name, place = known.name, f"{where}constants.{key}"
        if name in constants:
            raise ValueError(
                f"{where}constants has two of {name}, the second is {shown(key)}: remove one"
            )
        if isinstance(value, bool) or not isinstance(value, int | float | str):
            raise _unexpected(place, value, "a number or text")
        if known.is_label:
            try:
                constants[name] = plain_label(value)
            except ValueError as error:
                raise ValueError(f"{place}: {error}") from None
            continue
        in_name = f"its unit in its name, as in {name}_{IN_TABLES[name].unit}, or in units.{name}"
        if isinstance(value, str) or not abs(value) < LARGEST:
            is_ratio = known.dimension == "ratio"
            raise _unexpected(place, value, "a number" if is_ratio else f"a number, and {in_name}")
        unit = settings.unit_of(name) or known_unit("", known.dimension)
        if known.unit is not None:
            unit = _unit(place, known.unit, known.dimension)
        if unit is None:
            raise ValueError(f"{place} is {value:g}, without a unit: state {in_name}")
        constants[name] = known.scale * float(value) * unit.factor
    return constants


def _unit(place: str, spelling: object, dimension: str) -> Unit:
    unit = known_unit(spelling, dimension) if isinstance(spelling, str) else None
    if unit is None:
        raise ValueError(
            f"{place} is {shown(spelling)}, which is not a known unit of {dimension}; expected one "
            f"of {expected_units(str(spelling), dimension)}"
        )
    return unit
