"""Planned tests, and specimens in them: the radii that each would have."""

from collections.abc import Mapping
from typing import Any, NamedTuple, cast

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from pymc_hyperelastic.classes.variable import Variability
from pymc_hyperelastic.data.inflation import at_points
from pymc_hyperelastic.data.units import to_internal
from pymc_hyperelastic.evidence.checks import check_count
from pymc_hyperelastic.mechanics.tube import GEOMETRY
from pymc_hyperelastic.models.geometry import deviated_tube, deviation_name
from pymc_hyperelastic.predictions.draws import GivenTube, draws_of
from pymc_hyperelastic.predictions.members import posterior_of

Array = NDArray[np.float64]

_POINTS = 20
_SETTINGS = ("pressure", "radius", "axial_stretch", "points", "force")
# kPa: a pressure that is not larger is 0 but for rounding errors. A tube without pressure is not
# held at a radius.
_NO_PRESSURE = 1e-9


class PlannedTest(NamedTuple):
    """A test at so many points."""

    control: str
    """``"pressure"`` or ``"radius"``."""
    held: Array
    """What the control is held at, or rises over, kPa or mm."""
    axial_stretch: Array
    """Held, or rising."""
    force: bool
    words: str
    """What is varied, and what is held, as a user stated it."""


Design = list[PlannedTest]


def words_of(design: Design) -> str:
    """What is done in the tests."""
    return "; ".join(test.words for test in design)


def as_design(name: str, given: Any, kind: Variability, pressure_unit: str) -> Design:
    """One or several tests as a user states them."""
    tests = [given] if isinstance(given, Mapping) else list(given)
    if not tests:
        raise ValueError(f"design {name!r} has no tests")
    return [_as_test(name, test, kind, pressure_unit) for test in tests]


def _as_test(name: str, given: Any, kind: Variability, pressure_unit: str) -> PlannedTest:
    who = f"design {name!r}"
    if not isinstance(given, Mapping):
        raise TypeError(
            f"{who}: a test is a dict such as {{'pressure': (10, 140), 'axial_stretch': 1.5}}, not "
            f"{given!r}"
        )
    strangers = [key for key in given if key not in _SETTINGS]
    if strangers:
        raise ValueError(f"{who}: {strangers[0]!r} is unknown; a test has {list(_SETTINGS)}")
    controls = [name for name in ("pressure", "radius") if name in given]
    if len(controls) != 1:
        raise ValueError(f"{who}: a test has either a 'pressure' or a 'radius'; got {controls}")
    points = given.get("points", _POINTS)
    check_count(f"{who}: points", points, 1)
    with_force = kind.likelihood.with_force
    force = given.get("force", with_force)
    if force and not with_force:
        raise ValueError(
            f"{who} measures the axial force, and the classes were fitted without its error: it "
            "would not be known what it tells"
        )
    control = controls[0]
    held = _range(who, control, given[control], points)
    unit = {"pressure": pressure_unit, "radius": "mm"}[control]
    over = (
        f"{held[0]:.4g} {unit}" if np.ptp(held) == 0 else f"{held[0]:.4g} to {held[-1]:.4g} {unit}"
    )
    if control == "pressure":
        held = np.asarray(to_internal(held, pressure_unit, "pressure"))
    stretch = _range(who, "axial_stretch", given.get("axial_stretch", 1.0), points)
    if np.ptp(held) > 0 and np.ptp(stretch) > 0:
        raise ValueError(f"{who}: either the {control} or the axial stretch varies, not both")
    if np.ptp(stretch) > 0 and "axial_stretch" in kind.geometry:
        raise ValueError(
            f"{who}: the axial stretch varies, and is not known exactly: such a test cannot be "
            "planned"
        )
    if held[0] < 0 or (control == "radius" and held[0] == 0) or stretch[0] <= 0:
        raise ValueError(f"{who}: pressures are 0 or more, and radii and stretches more than 0")
    words = f"{over} at a stretch of {stretch[0]:.4g}"
    if np.ptp(stretch) > 0:
        words = f"stretched from {stretch[0]:.4g} to {stretch[-1]:.4g} at {over}"
    return PlannedTest(control, held, stretch, bool(force), words + (", with force" * bool(force)))


def _range(who: str, name: str, given: Any, points: int) -> Array:
    try:
        ends = np.atleast_1d(np.asarray(given, float))
    except (TypeError, ValueError):
        ends = np.empty(0)
    if ends.size not in (1, 2) or not np.isfinite(ends).all() or np.any(np.diff(ends) < 0):
        raise ValueError(f"{who}: {name} is {given!r}; expected a number, or a pair that rises")
    return np.linspace(ends[0], ends[-1], points)


def radii_of(
    kind: Variability,
    tests: Design,
    specimens: Mapping[str, Array],
    tube: Mapping[str, float],
    sds: Mapping[str, float],
) -> Array:
    """Internal radii (specimen, obs) of specimens in these tests; NaN where there are none.

    Specimens are given by the variables of their model, along the first axis.
    """
    own = bool(kind.experiment_effect)
    found = []
    errors = {f"{name}_sd": sd for name, sd in sds.items()}
    deviations = {name: specimens[deviation_name(name)][:, 0] for name in kind.geometry}
    for i, test in enumerate(tests):
        coordinates = [
            specimens[f"{n}_of_test"][:, i] if own else specimens[n][:, 0] for n in kind.scale.names
        ]
        values = kind.scale.numbers(coordinates)
        held = np.ptp(test.axial_stretch) == 0
        measured = {**tube, **errors} | ({"axial_stretch": test.axial_stretch[0]} if held else {})
        known = dict(deviated_tube(measured, deviations)) if deviations else measured
        if not held:
            known["axial_stretch"] = test.axial_stretch
        by_specimen = [
            n for n in GEOMETRY if np.ndim(known.get(n, 0)) and (held or n != "axial_stretch")
        ]
        values |= {name: np.asarray(known.pop(name)) for name in by_specimen}
        posterior = posterior_of({name: v[None] for name, v in values.items()})
        tree = xr.DataTree.from_dict({"posterior": posterior})
        there = [n for n in GEOMETRY if n in known and np.isfinite(known[n]).all()]
        given = {"energy": kind.energy} | {name: known[name] for name in there}
        drawn = draws_of(tree, **cast(GivenTube, given))
        if test.control == "pressure":
            found.append(drawn.tube.radius_at(test.held)[0])
        else:
            pressure = drawn.tube.pressure(test.held)[0][0]
            found.append(np.where(pressure > _NO_PRESSURE, test.held, np.nan))
    return np.concatenate(found, axis=1)


def empty_data(
    kind: Variability, tests: Design, tube: Mapping[str, float], sds: Mapping[str, float]
) -> xr.Dataset:
    """Data of a specimen in these tests, whose radii and measured values are still to come."""
    of_points = np.repeat(np.arange(len(tests)), [len(t.held) for t in tests])
    stretches = [t.axial_stretch for t in tests]
    varies = any(np.ptp(s) > 0 for s in stretches)
    variables: dict[str, Any] = {
        name: ("test", np.full(len(tests), value)) for name, value in tube.items()
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
    """Of the tests of one specimen, to which the points belong."""
    return {
        "test": ("obs", of_points),
        "row": ("obs", np.arange(len(of_points))),
        "specimen": ("test", ["new"] * tests),
        "experiment": ("test", np.arange(1, tests + 1)),
        "group": ("test", ["all"] * tests),
    }


def beside(given: xr.Dataset | None, planned: xr.Dataset) -> xr.Dataset:
    """Tests that a specimen has had, and those planned for it, as one dataset."""
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
