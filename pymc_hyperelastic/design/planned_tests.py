"""Read planned tests from the user's settings, and compute the radii of specimens in them."""

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from pymc_hyperelastic.classes.hierarchical import HierarchicalClass
from pymc_hyperelastic.data.inflation import at_points
from pymc_hyperelastic.data.units import to_internal
from pymc_hyperelastic.evidence.checks import check_count
from pymc_hyperelastic.mechanics.reference_tube import Tube
from pymc_hyperelastic.mechanics.tube import GEOMETRY
from pymc_hyperelastic.models.geometry import deviated_tube, deviation_name
from pymc_hyperelastic.predictions.draws import draws_of, stated_geometry
from pymc_hyperelastic.predictions.members import posterior_of

Array = NDArray[np.float64]

# Number of points of a test by default.
_POINTS = 20
# Settings of a test that a user may give.
_SETTINGS = ("pressure", "radius", "pressure_unit", "axial_stretch", "points", "force", "tube")
# Pressure below which a tube counts as not inflated, kPa: 0 up to rounding errors. A test at a held
# radius needs a larger one.
_NO_PRESSURE = 1e-9


class PlannedTest(NamedTuple):
    """A planned test: pressure or radius, and axial stretch, at each point."""

    control: str
    """Controlled variable, ``"pressure"`` or ``"radius"``."""
    held: Array
    """Values of the controlled variable, constant or increasing, kPa or mm, (point,)."""
    axial_stretch: Array
    """Axial stretches, constant or increasing, (point,)."""
    force: bool
    """True if the axial force is measured."""
    tube: dict[str, float]
    """Stated radii, mm, and opening angle, rad."""
    words: str
    """Description of the test, in the user's units."""

    def measures(self, typical: Mapping[str, float]) -> dict[str, float]:
        """Return the measures of the tube: the stated ones, else the typical ones."""
        return {**typical, **self.tube}


Design = list[PlannedTest]


def words_of(design: Design) -> str:
    """Return a description of the tests of a design."""
    return "; ".join(test.words for test in design)


def as_design(name: str, given: Any, kind: HierarchicalClass) -> Design:
    """Convert the user's dict, or list of dicts, to a design; raise if a setting is invalid.

    `name` is the name of the design in errors, and `kind` describes the classes.
    """
    tests = [given] if isinstance(given, Mapping) else list(given)
    if not tests:
        raise ValueError(f"design {name!r} has no tests")
    return [_as_test(name, test, kind) for test in tests]


def _as_test(name: str, given: Any, kind: HierarchicalClass) -> PlannedTest:
    label = f"design {name!r}"
    if not isinstance(given, Mapping):
        raise TypeError(
            f"{label}: a test is a dict such as {{'pressure': (10, 140), 'axial_stretch': 1.5}}, "
            f"not {given!r}"
        )
    unknown = [key for key in given if key not in _SETTINGS]
    if unknown:
        raise ValueError(f"{label}: {unknown[0]!r} is unknown; a test has {list(_SETTINGS)}")
    controls = [name for name in ("pressure", "radius") if name in given]
    if len(controls) != 1:
        raise ValueError(f"{label}: a test has either a 'pressure' or a 'radius'; got {controls}")
    points = given.get("points", _POINTS)
    check_count(f"{label}: points", points, 1)
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
    values = (
        f"{held[0]:.4g} {unit}" if np.ptp(held) == 0 else f"{held[0]:.4g} to {held[-1]:.4g} {unit}"
    )
    if control == "pressure":
        held = np.asarray(to_internal(held, pressure_unit, "pressure"))
    stretch = _range(label, "axial_stretch", given.get("axial_stretch", 1.0), points)
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
        words = f"stretched from {stretch[0]:.4g} to {stretch[-1]:.4g} at {values}"
    words += ", with force" * bool(force)
    tube = _stated_tube(label, given.get("tube"))
    return PlannedTest(control, held, stretch, bool(force), tube, words)


def _stated_tube(label: str, tube: Tube | None) -> dict[str, float]:
    stated = {} if tube is None else stated_geometry(tube)
    if "axial_stretch" in stated:
        raise ValueError(f"{label}: give the axial stretch of a test as 'axial_stretch': ...")
    return stated


def _range(label: str, name: str, given: Any, points: int) -> Array:
    try:
        ends = np.atleast_1d(np.asarray(given, float))
    except (TypeError, ValueError):
        ends = np.empty(0)
    if ends.size not in (1, 2) or not np.isfinite(ends).all() or np.any(np.diff(ends) < 0):
        raise ValueError(
            f"{label}: {name} is {given!r}; expected a number, or a pair of increasing numbers"
        )
    return np.linspace(ends[0], ends[-1], points)


def radii_of(
    kind: HierarchicalClass,
    tests: Design,
    specimens: Mapping[str, Array],
    tube: Mapping[str, float],
    sds: Mapping[str, float],
) -> Array:
    """Return internal radii (mm), (specimen, obs), of specimens in these tests.

    A specimen that cannot bear a test has NaN. Specimens are given by the variables of their model,
    along the first axis. `tube` has the measures that a test does not state, and `sds` the
    standard deviations of their errors.
    """
    by_test = kind.variability.experiment_effect
    found = []
    errors = {f"{name}_sd": sd for name, sd in sds.items()}
    deviations = {name: specimens[deviation_name(name)][:, 0] for name in kind.geometry}
    for i, test in enumerate(tests):
        coordinates = [
            specimens[f"{n}_of_test"][:, i] if by_test else specimens[n][:, 0]
            for n in kind.scale.names
        ]
        values = kind.scale.numbers(coordinates)
        held = np.ptp(test.axial_stretch) == 0
        measured = {**test.measures(tube), **errors} | (
            {"axial_stretch": test.axial_stretch[0]} if held else {}
        )
        tubes = dict(deviated_tube(measured, deviations)) if deviations else measured
        if not held:
            tubes["axial_stretch"] = test.axial_stretch
        by_specimen = [
            n for n in GEOMETRY if np.ndim(tubes.get(n, 0)) and (held or n != "axial_stretch")
        ]
        values |= {name: np.asarray(tubes.pop(name)) for name in by_specimen}
        posterior = posterior_of({name: v[None] for name, v in values.items()})
        tree = xr.DataTree.from_dict({"posterior": posterior})
        finite = [n for n in GEOMETRY if n in tubes and np.isfinite(tubes[n]).all()]
        drawn = draws_of(tree, Tube(**{n: tubes[n] for n in finite}), energy=kind.energy)
        if test.control == "pressure":
            found.append(drawn.tube.radius_at(test.held)[0])
        else:
            pressure = drawn.tube.pressure(test.held)[0][0]
            found.append(np.where(pressure > _NO_PRESSURE, test.held, np.nan))
    return np.concatenate(found, axis=1)


def empty_data(
    kind: HierarchicalClass, tests: Design, tube: Mapping[str, float], sds: Mapping[str, float]
) -> xr.Dataset:
    """Return a Dataset of one specimen in these tests; radii and measured values are NaN."""
    of_points = np.repeat(np.arange(len(tests)), [len(t.held) for t in tests])
    stretches = [t.axial_stretch for t in tests]
    varies = any(np.ptp(s) > 0 for s in stretches)
    variables: dict[str, Any] = {
        name: ("test", np.array([test.measures(tube)[name] for test in tests])) for name in tube
    }
    variables |= {f"{n}_sd": ("test", np.full(len(tests), sd)) for n, sd in sds.items()}
    variables["axial_stretch"] = (
        ("obs", np.concatenate(stretches))
        if varies
        else ("test", np.array([s[0] for s in stretches]))
    )
    blank = np.full(len(of_points), np.nan)
    variables |= {"radius": ("obs", blank), "pressure": ("obs", blank)}
    if kind.likelihood.with_force:
        variables["axial_force"] = "obs", blank
    return xr.Dataset(variables, _labels(of_points, len(tests)))


def _labels(of_points: NDArray[np.intp], tests: int) -> dict[str, Any]:
    """Return coordinates of one specimen; `of_points` has the test of each point."""
    return {
        "test": ("obs", of_points),
        "row": ("obs", np.arange(len(of_points))),
        "specimen": ("test", ["new"] * tests),
        "experiment": ("test", np.arange(1, tests + 1)),
        "group": ("test", ["all"] * tests),
    }


def beside(given: xr.Dataset | None, planned: xr.Dataset) -> xr.Dataset:
    """Join earlier tests of a specimen, if any, and its planned tests to one Dataset."""
    if given is None:
        return planned
    varies = any("obs" in data["axial_stretch"].dims for data in (given, planned))
    both: dict[str, Any] = {}
    for name, values in planned.data_vars.items():
        if varies and name == "axial_stretch":
            parts = [at_points(data, "axial_stretch") for data in (given, planned)]
        else:
            parts = [data[name].values for data in (given, planned)]
        dim = "obs" if varies and name == "axial_stretch" else values.dims[0]
        both[str(name)] = dim, np.concatenate(parts)
    had = given.sizes["test"]
    of_points = np.concatenate([given["test"].values, planned["test"].values + had])
    return xr.Dataset(both, _labels(of_points, had + planned.sizes["test"]))
