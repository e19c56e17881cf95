"""Read planned tests from the user's settings, and find the specimens that can bear them."""

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from pymc_hyperelastic.classes.hierarchical import HierarchicalClass
from pymc_hyperelastic.classes.quantities import complete_conditions
from pymc_hyperelastic.data.geometry import kept_circle_of
from pymc_hyperelastic.data.plausible import check_plausible_pressures
from pymc_hyperelastic.data.select import specimens_apart
from pymc_hyperelastic.data.sheets import combine_tests, sheets_of, tubes_of
from pymc_hyperelastic.data.units import to_internal
from pymc_hyperelastic.data.variables import REQUIRED, STRESS_MEASURE
from pymc_hyperelastic.evidence.checks import check_count
from pymc_hyperelastic.mechanics.reference_tube import WALL, Tube
from pymc_hyperelastic.mechanics.tube import GEOMETRY
from pymc_hyperelastic.models.forward import numeric_stresses
from pymc_hyperelastic.models.geometry import deviated_tube, deviation_name, of_tubes
from pymc_hyperelastic.models.likelihoods.signals import LARGEST
from pymc_hyperelastic.models.settings import inflation_data_of
from pymc_hyperelastic.predictions.draws import draws_of, stated_geometry
from pymc_hyperelastic.predictions.members import posterior_of
from pymc_hyperelastic.quantities import SHEET_VARIABLES, STRESSES
from pymc_hyperelastic.rounding import ROUNDING

Array = NDArray[np.float64]
Arrays = Mapping[str, Array]

# Settings that a user may give of a test of a tube.
_OF_TUBE = ("pressure", "radius", "pressure_unit", "axial_stretch", "points", "force", "tube")
# Settings that a user may give of a test of a sheet.
_OF_SHEET = ("stretch_x", "stretch_y", "stress_measure", "points")
# Variables of the data that are measured, and so simulated.
_MEASURED = ("pressure", "axial_force", *STRESSES)


class Defaults(NamedTuple):
    """Settings that planned tests take from the classes, or from earlier tests of the specimen."""

    kind: HierarchicalClass
    tube: dict[str, float]
    """Radii (mm) and opening angle (rad) of the unloaded tube, and axial stretch."""
    sds: dict[str, float]
    """Standard deviations of the measures of tubes and sheets that have an error."""
    stress_measures: list[str]
    """Measures of the stresses of sheets in the classes."""

    @classmethod
    def of(
        cls, kind: HierarchicalClass, classes: xr.DataTree, given: xr.Dataset | None
    ) -> "Defaults":
        """Return the defaults by classes and the earlier tests, if any, of the specimen."""
        datasets = [inflation_data_of(fitted) for fitted in classes.children.values()]
        # The outer radius of a layered wall follows from the thicknesses, and stays NaN.
        medians = complete_conditions(classes, [], None).geometry()
        tube: dict[str, float] = {"outer_radius": np.nan, **medians}
        if given is not None and (own := tubes_of(given)) is not None:
            names = ("inner_radius", "outer_radius", "opening_angle")
            tube |= {name: float(own[name].values[0]) for name in names}
        if not set(WALL).isdisjoint(kind.geometry):
            kept = [kept_circle_of(data) for data in (datasets if given is None else [given])]
            tube["kept_circle"] = float(np.median(np.concatenate(kept)))
        sds = {n: _sd_of(n, measured.sd, datasets) for n, measured in kind.geometry.items()}
        sheets = [own for data in datasets if (own := sheets_of(data)) is not None]
        measures = {str(m) for data in sheets for m in data[STRESS_MEASURE].values}
        return cls(kind, tube, sds, sorted(measures))


def _sd_of(name: str, given: float | None, datasets: list[xr.Dataset]) -> float:
    """Return the standard deviation of a measure's error: `given`, or the specimens' median."""
    if given is not None:
        return given
    tubes = [own for data in datasets if (own := tubes_of(data)) is not None]
    parts = [part for data in tubes for part in specimens_apart(data).values()]
    return float(np.median([part[f"{name}_sd"].values[0] for part in parts]))


class PlannedTube(NamedTuple):
    """A planned test of a tube: pressure or radius, and axial stretch, at each point."""

    control: str
    """Controlled variable, ``"pressure"`` or ``"radius"``."""
    held: Array
    """Values of the controlled variable, constant or increasing, kPa or mm, (point,)."""
    axial_stretch: Array
    """Axial stretches, constant or increasing, (point,)."""
    force: bool
    """True if the axial force is measured."""
    tube: dict[str, float]
    """Radii, mm, and opening angle, rad, and the standard deviations of measures with an error."""
    words: str
    """Description of the test, in the user's units."""

    def data(self) -> xr.Dataset:
        """Return the test as data; radii and measured values are placeholders, 1."""
        ones = np.ones(len(self.held))
        measured = {"radius": ones, "pressure": ones}
        measured["axial_force"] = ones if self.force else ones * np.nan
        variables: dict[str, Any] = {name: ("test", [value]) for name, value in self.tube.items()}
        variables |= {name: ("obs", values) for name, values in measured.items()}
        varies = np.ptp(self.axial_stretch) > 0
        stretch = ("obs", self.axial_stretch) if varies else ("test", self.axial_stretch[:1])
        return xr.Dataset(variables | {"axial_stretch": stretch}, _points(self.held))

    def radii(self, energy: Any, material: Arrays, deviations: Arrays) -> Array:
        """Return internal radii (mm), (specimen, point); NaN if it cannot bear the test.

        `material` has the parameters of the specimens, and `deviations` the errors of the measures
        in standard deviations.
        """
        held = np.ptp(self.axial_stretch) == 0
        measured = self.tube | ({"axial_stretch": self.axial_stretch[0]} if held else {})
        of_tube = of_tubes(deviations)
        tubes = dict(deviated_tube(measured, of_tube)) if of_tube else measured
        if not held:
            tubes["axial_stretch"] = self.axial_stretch
        by_specimen = [
            n for n in GEOMETRY if np.ndim(tubes.get(n, 0)) and (held or n != "axial_stretch")
        ]
        values = {**material} | {name: np.asarray(tubes.pop(name)) for name in by_specimen}
        posterior = posterior_of({name: v[None] for name, v in values.items()})
        tree = xr.DataTree.from_dict({"posterior": posterior})
        finite = [n for n in GEOMETRY if n in tubes and np.isfinite(tubes[n]).all()]
        drawn = draws_of(tree, Tube(**{n: tubes[n] for n in finite}), energy=energy)
        if self.control == "pressure":
            return drawn.tube.radius_at(self.held)[0]
        pressure = drawn.tube.pressure(self.held)[0][0]
        return np.where(pressure > ROUNDING, self.held, np.nan)  # a larger one inflates the tube


class PlannedSheet(NamedTuple):
    """A planned test of a sheet: stretches at each point, and the measured stresses."""

    stretches: dict[str, Array]
    """Stretches along each axis, (point,); NaN along a free axis."""
    stress_measure: str
    """``"cauchy"`` or ``"nominal"``."""
    gauge_length_sd: float
    """Relative standard deviation of the gauge length; 0 without an error."""
    words: str
    """Description of the test."""

    def data(self) -> xr.Dataset:
        """Return the test as data; measured stresses are placeholders, 1."""
        variables = {}
        for axis, stretch in self.stretches.items():
            variables[f"stretch_{axis}"] = "obs", stretch
            variables[f"stress_{axis}"] = "obs", np.where(np.isnan(stretch), np.nan, 1.0)
        measure = {STRESS_MEASURE: ("test", [self.stress_measure])}
        return xr.Dataset(variables, _points(self.stretches["x"]) | measure)

    def radii(self, energy: Any, material: Arrays, deviations: Arrays) -> Array:
        """Return 0 in place of radii, (specimen, point); NaN if it cannot bear the test.

        The stretches of a sheet are known. The arguments are those of :meth:`PlannedTube.radii`.
        """
        entries = [np.asarray(entry)[:, None] for entry in energy.split(material)]
        shorter = np.exp(-self.gauge_length_sd * deviations.get("gauge_length", np.zeros(1)))
        with np.errstate(all="ignore"):  # a stretch may be negative by the true gauge length
            log_x, log_y = (
                None if np.isnan(stretch).all() else np.log1p((stretch - 1) * shorter[:, None])
                for stretch in self.stretches.values()
            )
        stress_x, stress_y, *_ = np.abs(numeric_stresses(energy, log_x, log_y, entries))
        return np.where((stress_x < LARGEST) & (stress_y < LARGEST), 0.0, np.nan)


def _points(values: Array) -> dict[str, Any]:
    """Return the coordinates of the points of one test, which have these values."""
    return {"test": ("obs", np.zeros(len(values), int))}


Design = list[PlannedTube | PlannedSheet]


def words_of(design: Design) -> str:
    """Return a description of the tests of a design."""
    return "; ".join(test.words for test in design)


def as_design(name: str, given: Any, defaults: Defaults) -> Design:
    """Convert the user's dict, or list of dicts, to a design; raise if a setting is invalid.

    `name` is the name of the design in errors.
    """
    tests = [given] if isinstance(given, Mapping) else list(given)
    if not tests:
        raise ValueError(f"design {name!r} has no tests")
    return [_as_test(f"design {name!r}", test, defaults) for test in tests]


def _as_test(label: str, given: Any, defaults: Defaults) -> PlannedTube | PlannedSheet:
    if not isinstance(given, Mapping):
        raise TypeError(
            f"{label}: a test is a dict such as {{'pressure': (10, 140), 'axial_stretch': 1.5}} or "
            f"{{'stretch_x': (1, 1.3)}}, not {given!r}"
        )
    of_sheet = "stretch_x" in given or "stretch_y" in given
    for key in given:
        if key not in (_OF_SHEET if of_sheet else _OF_TUBE):
            settings = f"of a sheet has {[*_OF_SHEET]}"
            if not of_sheet:
                settings = f"of a tube has {[*_OF_TUBE]}, and one {settings}"
            raise ValueError(f"{label}: {key!r} is unknown; a test {settings}")
    likelihood = defaults.kind.likelihood
    kind, other = ("sheet", "tube") if of_sheet else ("tube", "sheet")
    if not (likelihood.with_sheets if of_sheet else likelihood.with_tubes):
        error = "stress_sd" if of_sheet else "pressure_sd"
        raise ValueError(
            f"{label} has a test of a {kind}, but the classes were fitted to {other}s alone, so "
            f"that its information cannot be computed: plan tests of {other}s, or fit the classes "
            f"to {kind}s as well, with a {error}"
        )
    points = given.get("points", 20)
    check_count(f"{label}: points", points, 1)
    return (_as_sheet if of_sheet else _as_tube)(label, given, points, defaults)


def _as_tube(label: str, given: Mapping[str, Any], points: int, defaults: Defaults) -> PlannedTube:
    controls = [name for name in ("pressure", "radius") if name in given]
    if len(controls) != 1:
        raise ValueError(
            f"{label}: a test of a tube has either a 'pressure' or a 'radius', and one of a sheet "
            f"a 'stretch_x', a 'stretch_y' or both; got {controls}"
        )
    kind = defaults.kind
    with_force = kind.likelihood.with_force
    force = given.get("force", with_force)
    if force and not with_force:
        raise ValueError(
            f"{label} measures the axial force, but the classes were fitted without its error, so "
            "that its information cannot be computed: leave out 'force', or fit the classes with a "
            "force_sd"
        )
    control = controls[0]
    held = _range(label, control, given[control], points)
    pressure_unit = given.get("pressure_unit", "kPa")
    unit = {"pressure": pressure_unit, "radius": "mm"}[control]
    values = f"{_in_words(held)} {unit}"
    if control == "pressure":
        held = np.asarray(to_internal(held, pressure_unit, "pressure"))
        check_plausible_pressures(held[-1:])
    stretch = _range(
        label, "axial_stretch", given.get("axial_stretch", defaults.tube["axial_stretch"]), points
    )
    if np.ptp(held) > 0 and np.ptp(stretch) > 0:
        raise ValueError(
            f"{label}: either the {control} or the axial stretch may vary, but not both"
        )
    if np.ptp(stretch) > 0 and "axial_stretch" in kind.geometry:
        raise ValueError(
            f"{label}: tests with a varying axial stretch cannot be planned, because the classes "
            "were fitted with an error of the axial stretch: give one number"
        )
    if held[0] < 0 or (control == "radius" and held[0] == 0) or stretch[0] <= 0:
        raise ValueError(
            f"{label}: pressures must be 0 or more, and radii and stretches more than 0"
        )
    words = f"{values} at a stretch of {stretch[0]:.4g}"
    if np.ptp(stretch) > 0:
        words = f"stretched from {_in_words(stretch)} at {values}"
    words += ", with force" * bool(force)
    tube = defaults.tube | _stated_tube(label, given.get("tube"))
    tube |= {f"{n}_sd": sd for n, sd in of_tubes(defaults.sds).items()}
    return PlannedTube(control, held, stretch, bool(force), tube, words)


def _stated_tube(label: str, tube: Tube | None) -> dict[str, float]:
    stated = {} if tube is None else stated_geometry(tube)
    if "axial_stretch" in stated:
        raise ValueError(f"{label}: give the axial stretch of a test as 'axial_stretch': ...")
    return stated


def _as_sheet(
    label: str, given: Mapping[str, Any], points: int, defaults: Defaults
) -> PlannedSheet:
    stretches, pulled, free = {}, [], []
    for axis in "xy":
        name = f"stretch_{axis}"
        stretches[axis] = np.full(points, np.nan)
        if name not in given:
            free.append(f"free along {axis}")
            continue
        stretches[axis] = _range(label, name, given[name], points, increasing=False)
        if stretches[axis].min() <= 0:
            raise ValueError(
                f"{label}: {name} is {given[name]!r}; expected deformed over unloaded length, more "
                "than 0 and 1 for an unstretched sheet"
            )
        pulled.append(f"{_in_words(stretches[axis])} along {axis}")
    measures = defaults.stress_measures
    measure = given.get("stress_measure", measures[0] if len(measures) == 1 else None)
    if measure not in measures:
        stated = f"is {measure!r}" if "stress_measure" in given else "is missing"
        raise ValueError(
            f"{label}: stress_measure {stated}; expected one of {measures}, the measured stresses "
            "of the classes, whose error is stress_sd"
        )
    words = "stretched " + ", ".join([" and ".join(pulled), *free])
    if len(measures) > 1:
        words += f", {str(measure).replace('cauchy', 'Cauchy')} stress"
    return PlannedSheet(stretches, str(measure), defaults.sds.get("gauge_length", 0.0), words)


def _range(label: str, name: str, given: Any, points: int, increasing: bool = True) -> Array:
    try:
        ends = np.atleast_1d(np.asarray(given, float))
    except (TypeError, ValueError):
        ends = np.empty(0)
    falls = increasing and np.any(np.diff(ends) < 0)
    if ends.ndim > 1 or ends.size not in (1, 2) or not np.isfinite(ends).all() or falls:
        pair = "a pair of increasing numbers" if increasing else "a pair of numbers"
        raise ValueError(f"{label}: {name} is {given!r}; expected a number, or {pair}")
    return np.linspace(ends[0], ends[-1], points)


def _in_words(values: Array) -> str:
    """Return a constant, or the ends of a range, as text."""
    constant = np.ptp(values) == 0
    return f"{values[0]:.4g}" if constant else f"{values[0]:.4g} to {values[-1]:.4g}"


def radii_of(kind: HierarchicalClass, tests: Design, specimens: Arrays) -> Array:
    """Return internal radii (mm) in these tests, (specimen, obs), or 0 in tests of sheets.

    A specimen that cannot bear a test has NaN. Specimens are given by the variables of their model,
    along the first axis.
    """
    by_test = kind.variability.experiment_effect
    deviations = {name: specimens[deviation_name(name)][:, 0] for name in kind.geometry}
    found = []
    for i, test in enumerate(tests):
        coordinates = [
            specimens[f"{n}_of_test"][:, i] if by_test else specimens[n][:, 0]
            for n in kind.scale.names
        ]
        found.append(test.radii(kind.energy, kind.scale.numbers(coordinates), deviations))
    return np.concatenate(found, axis=1)


def data_of(kind: HierarchicalClass, given: xr.Dataset | None, tests: Design) -> xr.Dataset:
    """Return a Dataset of one specimen in its earlier tests, if any, and then in planned tests.

    In planned tests radii and measured values are placeholders.
    """
    datasets = [test.data() for test in tests]
    names = {*REQUIRED, "axial_force", "kept_circle", *SHEET_VARIABLES, STRESS_MEASURE, "test"}
    # Other standard deviations are settings of the classes.
    names |= {f"{name}_sd" for name, measured in kind.geometry.items() if measured.sd is None}
    parts, number = [], 0
    for data in datasets if given is None else [given, *datasets]:
        own = data.drop_vars([name for name in data.variables if name not in names])
        count = own.sizes["test"]
        labels = {
            "specimen": ["new"] * count,
            "experiment": np.arange(number, number + count),
            "group": ["all"] * count,
        }
        parts.append(own.assign_coords({n: ("test", v) for n, v in labels.items()}))
        number += count
    return combine_tests(*parts)


def with_radii(data: xr.Dataset, radii: Array) -> xr.Dataset:
    """Return data with these radii of :func:`radii_of`, (obs,), in the planned tests of tubes."""
    if "radius" not in data:
        return data
    radius = data["radius"].values.copy()
    planned = radius[-len(radii) :]
    planned[np.isfinite(planned)] = radii[np.isfinite(planned)]
    return data.assign(radius=("obs", radius))


def with_measured(data: xr.Dataset, drawn: Arrays, count: int) -> xr.Dataset:
    """Return data with drawn values of the last `count` points, which are in planned tests.

    `drawn` has values at all points with a measured value, by the name of the observed variable.
    """
    changed = {}
    for name in _MEASURED:
        if f"measured_{name}" not in drawn:
            continue
        values = data[name].values.copy()
        measured = np.flatnonzero(np.isfinite(values))
        planned = measured >= len(values) - count
        values[measured[planned]] = drawn[f"measured_{name}"][planned]
        changed[name] = "obs", values
    return data.assign(changed)
