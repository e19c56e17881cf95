"""One table of measured, geometric and derived quantities: names, units, labels, spellings, ranges.

Readers, validation, attributes of results, predictions, figures and reports look quantities up in
:data:`QUANTITIES`. Numbers inside the package have the unit that :data:`UNITS` lists first.
"""

from dataclasses import dataclass
from math import inf, pi

#: Units of each dimension: first the unit inside the package, then others that input may have. All
#: others are refused: to pint a pixel is 1/96 inch, and a point a length too.
UNITS = {
    "pressure": ["kPa", "Pa", "hPa", "MPa", "mmHg", "torr", "cmH2O", "mbar", "bar", "psi"],
    "length": ["mm", "um", "nm", "cm", "m", "inch"],
    "force": ["mN", "uN", "N", "gf", "dyn"],
    "angle": ["rad", "deg"],
    "ratio": ["1", "%"],
    "stiffness": ["kPa/mm"],
    "compliance": ["mm2/kPa"],
    "distensibility": ["1/kPa"],
    "velocity": ["m/s"],
    "label": ["1"],
}
#: Powers of a length that input may have.
UNITS["stress"] = UNITS["pressure"]
POWERS = {"length": 1, "area": 2, "volume": 3}
for _dimension in ("area", "volume"):
    UNITS[_dimension] = [f"{unit}{POWERS[_dimension]}" for unit in UNITS["length"]]


@dataclass(frozen=True)
class QuantitySpec:
    r"""Properties of a quantity, or of a column of labels.

    Examples
    --------
    >>> QUANTITIES["compliance"].unit, QUANTITIES["compliance"].label
    ('mm2/kPa', 'compliance $\\mathrm{d}A/\\mathrm{d}p$ (mm²/kPa)')
    """

    name: str
    """In tables, Datasets and results."""
    dimension: str
    """A key of :data:`UNITS`, such as ``"pressure"``; ``"label"`` for text and integers."""
    long_name: str
    """For people: the attribute ``long_name``."""
    symbol: str = ""
    """TeX without dollar signs."""
    lies_on: str = ""
    """Dimension of data, ``"obs"`` or ``"test"``, if data may hold it."""

    @property
    def unit(self) -> str:
        """Unit inside the package, such as ``"kPa"``; ``"1"`` if it has none."""
        return UNITS[self.dimension][0]

    @property
    def attributes(self) -> dict[str, str]:
        """Attributes of a variable."""
        return {"units": self.unit, "long_name": self.long_name}

    @property
    def label(self) -> str:
        """Label of an axis, with symbol and unit."""
        symbol = f" ${self.symbol}$" if self.symbol else ""
        unit = "" if self.unit == "1" else f" ({unit_text(self.unit)})"
        return f"{self.long_name}{symbol}{unit}"


def unit_text(unit: str) -> str:
    """Unit as people read it."""
    return unit.replace("mm2", "mm²").replace("mm3", "mm³")


_LABELS = [
    QuantitySpec("specimen", "label", "specimen", lies_on="test"),
    QuantitySpec("experiment", "label", "experiment on the specimen", lies_on="test"),
    QuantitySpec("group", "label", "group", lies_on="test"),
    QuantitySpec("cycle", "label", "cycle of the experiment", lies_on="test"),
    QuantitySpec("phase", "label", "phase of the cycle", lies_on="test"),
    QuantitySpec("stress_measure", "label", "measure of the stress of a sheet", lies_on="test"),
    QuantitySpec("kind", "label", "kind of the test of a sheet"),
    QuantitySpec("animal", "label", "animal"),
    QuantitySpec("split", "label", "split"),
]
_MEASURED = [
    QuantitySpec("radius", "length", "internal radius", "a", "obs"),
    QuantitySpec("outer_diameter", "length", "outer diameter", "d_o", "obs"),
    QuantitySpec("pressure", "pressure", "pressure", "p", "obs"),
    QuantitySpec("axial_force", "force", "reduced axial force", "F", "obs"),
    QuantitySpec("stretch_x", "ratio", "stretch along x", r"\lambda_x", "obs"),
    QuantitySpec("stretch_y", "ratio", "stretch along y", r"\lambda_y", "obs"),
    QuantitySpec("stress_x", "stress", "stress along x", lies_on="obs"),
    QuantitySpec("stress_y", "stress", "stress along y", lies_on="obs"),
]
#: Variables of the points of sheets: the stretches along both axes, then the stresses.
STRESSES = ("stress_x", "stress_y")
SHEET_VARIABLES = ("stretch_x", "stretch_y", *STRESSES)
_TUBE = [
    QuantitySpec("inner_radius", "length", "inner radius of the reference tube", "A", "test"),
    QuantitySpec("outer_radius", "length", "outer radius of the reference tube", "B", "test"),
    QuantitySpec("thickness", "length", "thickness of the unloaded wall"),
    QuantitySpec("wall_area", "area", "area of the unloaded wall"),
    QuantitySpec("wall_volume", "volume", "volume of the unloaded wall"),
    QuantitySpec("length", "length", "length of the unloaded tube"),
    QuantitySpec("axial_stretch", "ratio", "axial stretch", r"\lambda_z", "test"),
    QuantitySpec("opening_angle", "angle", "opening angle of the cut ring", r"\Phi", "test"),
]
#: Measures of the deformation and of the load of a sheet, and of the sheet itself, by dimension. A
#: column of one ends with ``_x`` or ``_y``, or belongs to the axis along which the sheet is pulled.
OF_SHEETS = {
    "stretch": "ratio",
    "engineering_strain": "ratio",
    "green_strain": "ratio",
    "displacement": "length",
    "stress": "stress",
    "cauchy_stress": "stress",
    "nominal_stress": "stress",
    "force": "force",
    "gauge_length": "length",
    "area": "area",
}
_ENDS = {"": "", "_x": " along x", "_y": " along y"}
_SHEET = [
    QuantitySpec(f"{name}{end}", dimension, f"{name.replace('_', ' ')} of a sheet{along}")
    for name, dimension in OF_SHEETS.items()
    for end, along in _ENDS.items()
    if f"{name}{end}" not in SHEET_VARIABLES
]
#: Names of columns in files besides a quantity's own: small letters, separated by spaces, and "_"
#: for all that is neither a letter nor a digit.
SPELLINGS = {
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
_OF_SHEETS = {
    "engineering_strain": "nominal_strain strain",
    "green_strain": "green_lagrange_strain",
    "displacement": "extension",
    "cauchy_stress": "true_stress",
    "nominal_stress": "engineering_stress pk1_stress 1st_pk_stress first_piola_kirchhoff_stress",
    "force": "load",
    "gauge_length": "gage_length",
    "area": "cross_section cross_sectional_area",
}
SPELLINGS |= {
    f"{name}{end}": " ".join(f"{other}{end}" for other in others.split())
    for name, others in _OF_SHEETS.items()
    for end in _ENDS
}
SPELLINGS |= {f"stretch_{a}": f"lambda_{a} lambda{a} λ{a} λ_{a}" for a in "xy"}
SPELLINGS |= {f"stress_{a}": f"sigma_{a} sigma{a} σ{a} σ_{a}" for a in "xy"}
SPELLINGS["kind"] = "kind_of_test test_kind"
#: Names of columns in files that hold a diameter, of which half is taken.
DIAMETERS = {
    "radius": "inner_diameter internal_diameter lumen_diameter",
    "inner_radius": "unloaded_inner_diameter inner_diameter_unloaded",
    "outer_radius": "unloaded_outer_diameter outer_diameter_unloaded",
}
#: Measures of the reference tube whose standard deviations inflation data may hold.
MEASURES = (
    "inner_radius",
    "outer_radius",
    "thickness",
    "wall_area",
    "axial_stretch",
    "opening_angle",
)
#: Measures of a sheet that models may take as uncertain, by factors: see MeasuredValue.
SHEET_MEASURES = ("sheet_thickness", "gauge_length")
_ERRORS = [
    QuantitySpec(
        f"{spec.name}_sd",
        spec.dimension,
        f"standard deviation of the {spec.name.replace('_', ' ')}",
        lies_on="test",
    )
    for spec in _TUBE
    if spec.name in MEASURES
]
#: Measured, geometric quantities and labels by name: whatever a table may hold.
IN_TABLES = {spec.name: spec for spec in (*_LABELS, *_MEASURED, *_TUBE, *_SHEET, *_ERRORS)}
#: The same, and what a Dataset of tests holds besides: see inflation_data.
IN_DATA = IN_TABLES | {
    "kept_circle": QuantitySpec(
        "kept_circle", "ratio", "circle in the wall that a thicker wall keeps", lies_on="test"
    )
}
#: Names of columns that tables of sheets alone may hold.
IN_SHEET_TABLES = {*SHEET_VARIABLES, "kind", "stress_measure", *(spec.name for spec in _SHEET)}

_DERIVED = [
    QuantitySpec("stiffness", "stiffness", "stiffness", r"\mathrm{d}p/\mathrm{d}a"),
    QuantitySpec("compliance", "compliance", "compliance", r"\mathrm{d}A/\mathrm{d}p"),
    QuantitySpec("distensibility", "distensibility", "distensibility"),
    QuantitySpec("peterson_modulus", "pressure", "Peterson's modulus"),
    QuantitySpec("incremental_modulus", "pressure", "incremental modulus"),
    QuantitySpec("pulse_wave_velocity", "velocity", "pulse wave velocity"),
    QuantitySpec("circumferential_stress", "pressure", "mean circumferential Cauchy stress"),
    QuantitySpec("axial_stress", "pressure", "mean axial Cauchy stress"),
    QuantitySpec(
        "circumferential_material_stiffness", "pressure", "circumferential material stiffness"
    ),
    QuantitySpec("axial_material_stiffness", "pressure", "axial material stiffness"),
    QuantitySpec("stored_energy", "pressure", "stored energy per volume"),
    QuantitySpec(
        "stored_energy_change",
        "pressure",
        "change of stored energy per volume, diastole to systole",
    ),
    QuantitySpec("in_vivo_axial_stretch", "ratio", "in vivo axial stretch"),
    QuantitySpec("sigma_rr", "pressure", "radial Cauchy stress"),
    QuantitySpec("sigma_tt", "pressure", "hoop Cauchy stress"),
    QuantitySpec("sigma_zz", "pressure", "axial Cauchy stress"),
    QuantitySpec("position", "ratio", "place in the reference wall, 0 inside to 1 outside"),
    QuantitySpec("current_radius", "length", "current radius of the place in the wall"),
    QuantitySpec("extrapolated", "ratio", "whether it is beyond what was measured"),
    QuantitySpec("force_offset", "force", "offset of the force transducer"),
    # In results the radius of the inflated tube, in tables that of the reference tube.
    QuantitySpec("outer_radius", "length", "current outer radius", "b"),
]
#: Quantities of results by name.
IN_RESULTS = {spec.name: spec for spec in (*_MEASURED, IN_TABLES["axial_stretch"], *_DERIVED)}
#: Every quantity by name; ``outer_radius`` is that of the reference tube.
QUANTITIES = IN_RESULTS | IN_TABLES


@dataclass(frozen=True)
class PlausibleRange:
    """The sizes that a quantity has in soft tubes or sheets; :data:`MISTAKES` explains others.

    The ranges hold arteries from arterioles to a dilated aorta, veins and other soft tubes, and
    sheets from brain to tendon and rubber, with some room.
    """

    what: str
    """The quantity in words; it has one value in each test."""
    unit: str
    low: float
    high: float
    doubted_unit: str = ""
    """The dimension whose unit may be the mistake."""


_HOOP = "the hoop stretch at the {} pressure, over that without load,"
#: Ranges outside which a test is doubted. 40 kPa are 300 mmHg.
PLAUSIBLE = {
    "highest_pressure": PlausibleRange("the highest pressure", "kPa", 0.1, 40.0, "pressure"),
    "lowest_pressure": PlausibleRange("the lowest pressure", "kPa", -2.0, inf),
    "ring_radius": PlausibleRange(
        "the inner radius of the closed tube without load", "mm", 0.01, 30.0, "length"
    ),
    "largest_radius": PlausibleRange("the largest internal radius", "mm", 0.01, 40.0, "length"),
    "wall": PlausibleRange("the thickness of the wall over its mean radius", "", 0.01, 0.8),
    "axial_stretch": PlausibleRange("axial_stretch", "", 0.8, 2.5),
    "opening_angle": PlausibleRange("the opening angle", "rad", 0.06, 2 * pi, "angle"),
    "first_stretch": PlausibleRange(_HOOP.format("lowest"), "", 0.75, 1.7),
    "last_stretch": PlausibleRange(_HOOP.format("highest"), "", 0.9, 2.6),
    "axial_stress": PlausibleRange(
        "the largest axial force over the area of the wall", "kPa", 0.0, 2000.0, "force"
    ),
    "largest_stretch": PlausibleRange("the largest stretch of a sheet", "", 0.6, 10.0),
    "smallest_stretch": PlausibleRange("the smallest stretch of a sheet", "", 0.3, inf),
    "largest_strain": PlausibleRange(
        "the largest change of a length of a sheet over its unloaded length", "", 0.003, inf
    ),
    "largest_stress": PlausibleRange(
        "the largest stress of a sheet", "kPa", 0.01, 200000.0, "stress"
    ),
    "lateral_stretch": PlausibleRange(
        "the stretch across the axis along which a sheet is pulled", "", 0.0, 1.02
    ),
    "thickness_stretch": PlausibleRange(
        "the stretch of the thickness, 1/(λx λy), of a sheet pulled along one axis", "", 0.0, 1.02
    ),
}
_OF_LENGTHS = (
    "was another unit meant? radius_unit=... is that of every length, measured or of the tube"
)
_OF_STRETCHES = (
    "are inner_radius and outer_radius diameters, in another unit, or of another tube?",
    "is the measured radius a diameter, in another unit than inner_radius, or of another tube?",
)
_OF_STRAINS = "Then name its column engineering_strain (λ − 1) or green_strain ((λ² − 1)/2)"
#: The likely mistake if a quantity is below its range, and if it is above.
MISTAKES = {
    "highest_pressure": (
        "was it given in MPa or bar, pressure_unit=...?",
        'was it given in mmHg or Pa, pressure_unit="mmHg"?',
    ),
    "lowest_pressure": (
        "was the pressure around the tube, or the gauge's zero, not subtracted?",
        "",
    ),
    "ring_radius": (_OF_LENGTHS, _OF_LENGTHS),
    "largest_radius": (_OF_LENGTHS, _OF_LENGTHS),
    "wall": (
        "is inner_radius a diameter, or are the two radii not of one tube?",
        "is outer_radius a diameter?",
    ),
    "axial_stretch": (
        "was a strain given? A strain of 0.45 is a stretch of 1.45",
        "was it given in per cent? 145 % is a stretch of 1.45",
    ),
    "opening_angle": ('were radians given with angle_unit="deg"?', ""),
    "first_stretch": _OF_STRETCHES,
    "last_stretch": _OF_STRETCHES,
    "axial_stress": ("", "was another unit meant, force_unit=...?"),
    "largest_stretch": (
        f"was a strain given? {_OF_STRAINS}",
        "was a strain given in per cent, 45 for 0.45, or is the gauge length in another unit than "
        "the displacement?",
    ),
    "smallest_stretch": (f"was a strain given? {_OF_STRAINS}", ""),
    "largest_strain": (
        "is the gauge length in another unit than the displacement, or is this the change of a "
        "stretch?",
        "",
    ),
    "largest_stress": (
        "was another unit meant, stress_unit=... or force_unit=..., length_unit=...?",
        "was another unit meant, stress_unit=... or force_unit=..., length_unit=...?",
    ),
    "lateral_stretch": (
        "",
        "were the axes exchanged, or is this a biaxial test, kind='biaxial'?",
    ),
    "thickness_stretch": (
        "",
        "the sheet would become thicker where it is pulled: were the axes exchanged, is one "
        "stretch over another length, or is the material compressible?",
    ),
}
