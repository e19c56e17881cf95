"""What the columns of a laboratory's table are, by their names.

Names are looked up in the tables of this module; nothing is guessed from likeness.
"""

import re
import unicodedata
from typing import NamedTuple

from pymc_hyperelastic.data.files.spellings import is_unit, known_unit
from pymc_hyperelastic.data.inflation import MEASURES

LABELS = ("specimen", "experiment", "group", "cycle", "phase", "animal", "split")
# Columns that tables of points cannot do without, besides what was measured.
NEEDED = ("specimen", "experiment", "pressure")
# What each number is of.
KINDS = {
    "radius": "length",
    "outer_diameter": "length",
    "pressure": "pressure",
    "axial_force": "force",
    "inner_radius": "length",
    "outer_radius": "length",
    "thickness": "length",
    "wall_area": "area",
    "wall_volume": "volume",
    "length": "length",
    "axial_stretch": "ratio",
    "opening_angle": "angle",
}
KINDS |= {f"{name}_sd": KINDS[name] for name in MEASURES}

# Other names of columns, as they are compared: small letters, all else between them one "_".
SYNONYMS = {
    "specimen": "sample id specimen_id sample_id",
    "experiment": "test run experiment_id",
    "group": "class",
    "radius": "r current_radius internal_radius current_inner_radius",
    "outer_diameter": "external_diameter current_outer_diameter od",
    "pressure": "p transmural_pressure luminal_pressure internal_pressure avg_pressure pavg",
    "axial_force": "reduced_axial_force",
    "inner_radius": "unloaded_inner_radius inner_radius_unloaded",
    "outer_radius": "unloaded_outer_radius outer_radius_unloaded",
    "thickness": "wall_thickness unloaded_thickness thickness_unloaded",
    "wall_area": "wall_area_unloaded unloaded_wall_area",
    "length": "unloaded_length length_unloaded",
    "axial_stretch": "stretch lambda_z lambdaz λz λ_z",
}
# Diameters that are taken for radii by half.
DIAMETERS = {
    "radius": "inner_diameter internal_diameter lumen_diameter",
    "inner_radius": "unloaded_inner_diameter inner_diameter_unloaded",
    "outer_radius": "unloaded_outer_diameter outer_diameter_unloaded",
}
_KNOWN = {name: (name, 1.0) for name in (*LABELS, *KINDS)}
_KNOWN |= {other: (name, 1.0) for name, others in SYNONYMS.items() for other in others.split()}
_KNOWN |= {other: (name, 0.5) for name, others in DIAMETERS.items() for other in others.split()}

# A name that people who keep tables give to a specimen, and pressure myographs to a diameter.
TWO_MEANINGS = {"id": ("specimen", "inner_diameter")}

# Letters of a name with its unit; what is longer is a remark.
_LONGEST_NAME = 80


class Heading(NamedTuple):
    """What a column is: its name in the package, what it is times, and the unit in its name."""

    name: str
    scale: float
    unit: str | None


def heading(text: str) -> Heading | None:
    """What a column is by its name, or None if the name is not known.

    Examples
    --------
    >>> heading("Pressure (mmHg)")
    Heading(name='pressure', scale=1.0, unit='mmHg')
    >>> heading("inner diameter / µm")
    Heading(name='radius', scale=0.5, unit='µm')
    >>> heading("wall_volume_mm3").unit
    'mm3'
    >>> heading("note") is None
    True
    """
    for name, unit in _readings(text):
        if known := _KNOWN.get(comparable(name)):
            if known[0] in LABELS and unit is not None:
                continue
            return Heading(*known, unit)
    return None


def names_of(name: str) -> list[str]:
    """Names by which a column is known, its own first, as messages list them.

    Examples
    --------
    >>> names_of("radius")[:3]
    ['radius', 'r', 'current radius']
    """
    return [other.replace("_", " ") for other, (known, _) in _KNOWN.items() if known == name]


def comparable(text: str) -> str:
    """Name as it is compared: small letters, with one "_" for all that is no letter or number.

    Examples
    --------
    >>> comparable(" Outer  Diameter")
    'outer_diameter'
    """
    return re.sub(r"[\W_]+", "_", unicodedata.normalize("NFKC", text).casefold()).strip("_")


def called(text: str) -> list[str]:
    """What a column is called, with its unit and without, as it is compared.

    Examples
    --------
    >>> called("Druck [mmHg]")
    ['druck_mmhg', 'druck']
    """
    return [comparable(text), *(comparable(name) for name, _ in _readings(text))]


def unit_in(text: str, kind: str) -> str | None:
    """Unit in a name that is not one of the package's own, or None.

    Examples
    --------
    >>> unit_in("Druck in mmHg", "pressure")
    'mmHg'
    """
    units = [unit for _, unit in _readings(text) if unit is not None]
    return next((unit for unit in units if known_unit(unit, kind)), None)


def _readings(text: str) -> list[tuple[str, str | None]]:
    """Ways to divide a name into name and unit."""
    text = " ".join(text.split())
    if len(text) > _LONGEST_NAME:
        return []
    readings: list[tuple[str, str | None]] = [(text, None)]
    if found := re.fullmatch(r"(.*?)\s*(?:\[(.*)\]|\((.*)\)|\{(.*)\})", text):
        name, *units = found.groups()
        # Brackets do not count as part of the name, but what stands in them may be no unit.
        return [(name, next(unit for unit in units if unit is not None).strip())]
    if re.search(r".\s*/\s*.", text):
        name, _, unit = text.partition("/")
        readings.append((name.strip(), unit.strip()))
    for end in re.finditer(r"[\s_,]+", text):
        name, unit = text[: end.start()], text[end.end() :]
        name = re.sub(r"[\s_,]+in$", "", name)
        if is_unit(unit):
            readings.append((name, unit))
    return readings
