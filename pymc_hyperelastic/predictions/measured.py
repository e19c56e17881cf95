"""Flag predictions outside the measured range, where they rest on the strain energy alone.

The data inform about a material in the range of its measured stretches. A prediction is
*extrapolated*

at a radius
    if the hoop and axial stretches of the wall lie outside the convex hull of the measured ones. On
    one tube at one axial stretch this means outside the measured radii;
at a pressure
    if it is lower or higher than all pressures measured on this tube at this axial stretch, in
    inflation tests or in extension tests that pass through this stretch. Pressures of other tubes,
    or at other axial stretches, cannot be compared. If the data have such tests, the prediction is
    extrapolated only if its median radius is extrapolated as well.

An inferred geometry is replaced by its median.
"""

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from pymc_hyperelastic.data.inflation import at_points, extension_tests, points_of
from pymc_hyperelastic.data.units import mmHg
from pymc_hyperelastic.mechanics.tube import (
    GEOMETRY,
    inferred_geometry,
    internal_radius_from_outer_radius,
    stretches,
)
from pymc_hyperelastic.messages import warn_user
from pymc_hyperelastic.rounding import DIGITS, ROUNDING

Array = NDArray[np.float64]


class Extrapolated(NamedTuple):
    """Flags of the points of a prediction that are extrapolated."""

    points: NDArray[np.bool_]
    """True for each extrapolated point."""
    words: str
    """Range of the extrapolated points, and range that was measured, for the warning."""
    of_class: str | None = None
    """Name of the class, if the result is one of several classes."""


class Measured(NamedTuple):
    """Tubes and measured ranges of the tests of a result.

    The dimension ``test`` has one entry for each inflation test, and one for each point of an
    extension test, because its points differ in axial stretch.
    """

    tubes: dict[str, Array]
    """Geometry (mm, rad) by ``test``."""
    radius: Array
    """Smallest and largest internal radius, mm, (end, test)."""
    axial: Array
    """Smallest and largest axial stretch of the whole test, (end, test)."""
    pressure: Array
    """Lowest and highest pressure of the whole test, kPa, (end, test)."""

    def at_radii(self, radius: Array, tube: Mapping[str, Any]) -> Extrapolated:
        """Flag extrapolated internal radii of a tube, at one axial stretch or one per radius."""
        beyond = self._beyond_stretches(radius, tube)
        held = np.array_equal(*self.axial) and not np.ndim(tube["axial_stretch"])
        if held and self._on(tube, tube["axial_stretch"]).all():
            words = f"internal radius {ends_in_words(radius[beyond.points])} mm, measured "
            return beyond._replace(words=words + f"{ends_in_words(self.radius)} mm")
        return beyond

    def at_pressures(
        self, pressure: Array, radius: Array, tube: Mapping[str, Any], unit: str
    ) -> Extrapolated:
        """Flag extrapolated pressures (kPa) of a tube, given its median radii at these pressures.

        The tube has one axial stretch, or one per pressure. `unit` is that of the user's pressures:
        it decides whether the message suggests mmHg.
        """
        stretches = np.broadcast_to(tube["axial_stretch"], pressure.shape)
        comparable = np.array([self._on(tube, stretch) for stretch in stretches])
        # Without a comparable test the ends are NaN, and every pressure is beyond them.
        lowest, highest = np.where(comparable, self.pressure[:, None], np.nan)
        low, high = np.fmin.reduce(lowest, axis=1), np.fmax.reduce(highest, axis=1)
        beyond = ~_between(pressure, low, high)
        words = f"pressure {_in_both_units(pressure[beyond])}"
        if comparable.all():
            words += f", measured {_in_both_units(self.pressure)}"
            as_mmhg = _between(pressure * mmHg, self.pressure.min(), self.pressure.max())
            if unit == "kPa" and as_mmhg.all():
                words += " (if mmHg were meant: ph.Conditions(..., pressure_unit='mmHg'))"
            return Extrapolated(beyond, words)
        stretched = self._beyond_stretches(radius, tube)
        beyond &= stretched.points
        words = f"pressure {_in_both_units(pressure[beyond])}, {stretched.words}"
        return Extrapolated(beyond, words)

    def hoop_stretches(self) -> Array:
        """Return the extreme hoop stretches of the wall of each test, (end and surface, test)."""
        return np.concatenate([_hoop_stretches(a, self.tubes) for a in self.radius])

    def _on(self, tube: Mapping[str, Any], stretch: float) -> NDArray[np.bool_]:
        """Return True for each test on this tube whose axial stretches include `stretch`."""
        unloaded = [name for name in GEOMETRY if name != "axial_stretch"]
        same = [np.isclose(self.tubes[n], tube[n], rtol=ROUNDING, atol=0) for n in unloaded]
        return np.all([*same, _between(stretch, *self.axial)], axis=0)

    def _beyond_stretches(self, radius: Array, tube: Mapping[str, Any]) -> Extrapolated:
        """Flag radii whose wall stretches lie outside the convex hull of the measured ones."""
        axial = np.broadcast_to(tube["axial_stretch"], radius.shape)
        measured = self.tubes["axial_stretch"]
        outside = ~_between(axial, measured.min(), measured.max())
        if outside.all():
            words = f"axial stretch {ends_in_words(axial)}, measured {ends_in_words(measured)}"
            return Extrapolated(outside, words)
        of_tests = self.hoop_stretches()
        low = -upper_hull(axial, measured, -of_tests.min(axis=0))
        high = upper_hull(axial, measured, of_tests.max(axis=0))
        asked = _hoop_stretches(radius, tube)
        # NaN radii, which a draw does not reach, count as extrapolated.
        beyond = outside | ~_between(asked, low, high).all(axis=0)
        words = (
            f"hoop stretch of the wall {ends_in_words(asked[:, beyond])} at axial stretch "
            f"{ends_in_words(axial)}, measured {low.min():.4g} to {high.max():.4g}"
        )
        if outside.any():
            words += f" at {ends_in_words(measured)}"
        return Extrapolated(beyond, words)


def typical_tests(data: xr.Dataset, inferred: Mapping[str, float]) -> xr.Dataset:
    """Return the tests with the inferred medians in their geometry; unknown measures stay NaN.

    Missing internal radii are computed from the outer diameters.
    """
    tubes = {name: data[name].values.astype(float) for name in GEOMETRY}
    tubes = inferred_geometry(
        tubes | {k: np.full(data.sizes["test"], v) for k, v in inferred.items()}
    )
    data = data.assign({name: (data[name].dims, value) for name, value in tubes.items()})
    if np.isfinite(data["radius"]).all() or "outer_diameter" not in data:
        return data
    of_points = {name: at_points(data, name) for name in GEOMETRY}
    with np.errstate(invalid="ignore"):
        radius = internal_radius_from_outer_radius(data["outer_diameter"].values / 2, **of_points)
    return data.assign(radius=("obs", radius))


def measured_by(tests: xr.Dataset) -> Measured | None:
    """Return the measured ranges of tests; None if no test has a known tube."""
    points = {name: tests[name].values for name in ("radius", "pressure")}
    points |= {name: at_points(tests, name) for name in GEOMETRY}
    columns: list[dict[str, Array]] = []
    for test, extended in enumerate(extension_tests(tests)):
        of_test = {name: values[points_of(tests, test)] for name, values in points.items()}
        ends = {name: np.array([[v.min()], [v.max()]]) for name, v in of_test.items()}
        if extended:
            count = of_test["radius"].size
            ends = {name: np.repeat(v, count, axis=1) for name, v in ends.items()}
            ends["radius"] = np.stack([of_test["radius"]] * 2)
        at_each = of_test["axial_stretch"] if extended else of_test["axial_stretch"][:1]
        columns.append(ends | {"at_each": at_each[None]})
    joined = {n: np.concatenate([c[n] for c in columns], axis=1) for n in columns[0]}
    finite = np.isfinite(np.concatenate([*joined.values()])).all(axis=0)
    if not finite.any():
        return None
    joined = {name: values[:, finite] for name, values in joined.items()}
    tubes = {name: joined[name][0] for name in GEOMETRY} | {"axial_stretch": joined["at_each"][0]}
    return Measured(tubes, joined["radius"], joined["axial_stretch"], joined["pressure"])


def beyond_pressures(pressure: Array, tests: xr.Dataset) -> Extrapolated:
    """Flag pressures, kPa, that are lower or higher than all that were measured in tests."""
    measured = tests["pressure"].values
    beyond = ~_between(pressure, measured.min(), measured.max())
    words = f"pressure {_in_both_units(pressure[beyond])}, measured {_in_both_units(measured)}"
    return Extrapolated(beyond, words)


def warned(extrapolated: Extrapolated | None) -> Extrapolated | None:
    """Warn if any point is extrapolated, and return the argument."""
    if extrapolated is not None and extrapolated.points.any():
        count = int(extrapolated.points.sum())
        prefix = f"class {extrapolated.of_class!r}: " if extrapolated.of_class else ""
        warn_user(
            f"{prefix}{count} of {extrapolated.points.size} points {'is' if count == 1 else 'are'} "
            f"extrapolated: {extrapolated.words}. Outside the measured range predictions rest on "
            "the strain energy alone"
        )
    return extrapolated


def _hoop_stretches(radius: Array, tube: Mapping[str, Array | float]) -> Array:
    """Return hoop stretches (surface, radius) at the inner and the outer surface.

    All other hoop stretches of the wall lie between these two.
    """
    rest = {name: value for name, value in tube.items() if name != "outer_radius"}
    faces = tube["inner_radius"], tube["outer_radius"]
    return np.array([stretches(face, radius, **rest)[1] for face in faces])


def upper_hull(at: Array, x: Array, y: Array) -> Array:
    """Return the upper edge of the convex hull of points (x, y), interpolated at `at`."""
    # Stretches that differ only by rounding errors count as equal.
    at, x = at.round(DIGITS), x.round(DIGITS)
    hull: list[tuple[float, float]] = []
    for place in np.unique(x):
        point = place, y[x == place].max()
        while len(hull) > 1 and _turns_left(hull[-2], hull[-1], point):
            hull.pop()
        hull.append(point)
    return np.interp(at, *np.transpose(hull))


def _turns_left(a: tuple[float, float], b: tuple[float, float], c: tuple[float, float]) -> bool:
    """Return True if the path from `a` over `b` to `c` turns left or is straight."""
    return (b[0] - a[0]) * (c[1] - a[1]) >= (b[1] - a[1]) * (c[0] - a[0])


def _between(x: Array | float, low: Array | float, high: Array | float) -> NDArray[np.bool_]:
    margin = ROUNDING * np.maximum(np.abs(low), np.abs(high))
    return np.logical_and(x >= low - margin, x <= high + margin)


def ends_in_words(values: Array) -> str:
    """Return "smallest to largest" of the finite values, as text; NaN are pressures not reached."""
    finite = values[np.isfinite(values)]
    if not finite.size:
        return "beyond all"
    low, high = f"{finite.min():.4g}", f"{finite.max():.4g}"
    return low if low == high else f"{low} to {high}"


def _in_both_units(pressure: Array) -> str:
    return f"{ends_in_words(pressure)} kPa ({ends_in_words(pressure / mmHg)} mmHg)"
