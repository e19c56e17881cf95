"""Where the tubes of a result were measured: beyond that a prediction rests on its law alone.

What tells of a material is how far it was stretched. A prediction is *extrapolated* where it leaves
what was measured:

at a radius
    where circles of the wall have hoop and axial stretches that lie outside the convex hull of
    those that were measured. On one tube at one axial stretch that is outside its measured radii;
at a pressure
    that is lower or higher than all that were measured on this tube at this axial stretch, in
    inflation tests or in extension tests that pass through it. To tests on other tubes, or at other
    axial stretches, pressures do not compare: if there are such, it is extrapolated only if the
    wall at its median radius is, too.

Where the geometry is inferred, its median stands for it.
"""

import warnings
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
from pymc_hyperelastic.messages import PACKAGE

Array = NDArray[np.float64]

# Relative: what was measured is within, however it was rounded.
ROUNDING = 1e-9
# Digits to which axial stretches are rounded before they are compared.
_DIGITS = 9


class Extrapolated(NamedTuple):
    """Which of the points that were asked for are beyond what was measured."""

    points: NDArray[np.bool_]
    words: str
    """What was asked for there, and what was measured."""
    of_class: str | None = None
    """Which of several classes predicts, as a warning names it."""


class Measured(NamedTuple):
    """The tests of a result: on which tubes, and from where to where.

    Every point of an extension test is at an axial stretch of its own, and stands here beside the
    inflation tests.
    """

    tubes: dict[str, Array]
    """Geometry of each test, or point."""
    radius: Array
    """Smallest and largest internal radius of each, mm: (end, test)."""
    axial: Array
    """Least and largest axial stretch of each; of a point those of its test."""
    pressure: Array
    """Lowest and highest pressure, kPa, likewise."""

    def at_radii(self, radius: Array, tube: Mapping[str, Any]) -> Extrapolated:
        """Which internal radii of a tube, of one axial stretch or one each, are beyond."""
        beyond = self._beyond_stretches(radius, tube)
        held = np.array_equal(*self.axial) and not np.ndim(tube["axial_stretch"])
        if held and self._on(tube, tube["axial_stretch"]).all():
            words = f"internal radius {_ends(radius[beyond.points])} mm, measured "
            return beyond._replace(words=words + f"{_ends(self.radius)} mm")
        return beyond

    def at_pressures(
        self, pressure: Array, radius: Array, tube: Mapping[str, Any], unit: str
    ) -> Extrapolated:
        """Which pressures, given in a unit, are beyond in a tube that has these median radii.

        The tube has one axial stretch, or one for each of them.
        """
        stretches = np.broadcast_to(tube["axial_stretch"], pressure.shape)
        here = np.array([self._on(tube, stretch) for stretch in stretches])
        there = here.any(axis=1)
        low, high = (
            np.where(there, extreme(np.where(here, of_tests, far), axis=1), np.nan)
            for extreme, of_tests, far in zip(
                (np.min, np.max), self.pressure, (np.inf, -np.inf), strict=True
            )
        )
        beyond = ~_between(pressure, low, high)
        words = f"pressure {_in_both_units(pressure[beyond])}"
        if here.all():
            words += f", measured {_in_both_units(self.pressure)}"
            as_mmhg = _between(pressure * mmHg, self.pressure.min(), self.pressure.max())
            if unit == "kPa" and as_mmhg.all():
                words += " (if mmHg were meant: pressure_unit='mmHg')"
            return Extrapolated(beyond, words)
        stretched = self._beyond_stretches(radius, tube)
        beyond &= stretched.points
        words = f"pressure {_in_both_units(pressure[beyond])}, {stretched.words}"
        return Extrapolated(beyond, words)

    def _on(self, tube: Mapping[str, Any], stretch: float) -> NDArray[np.bool_]:
        """Which tests are on this tube, and have, or pass through, this axial stretch."""
        unloaded = [name for name in GEOMETRY if name != "axial_stretch"]
        same = [np.isclose(self.tubes[n], tube[n], rtol=ROUNDING, atol=0) for n in unloaded]
        return np.all([*same, _between(stretch, *self.axial)], axis=0)

    def _beyond_stretches(self, radius: Array, tube: Mapping[str, Any]) -> Extrapolated:
        """At which radii the wall of a tube is stretched as none was."""
        axial = np.broadcast_to(tube["axial_stretch"], radius.shape)
        measured = self.tubes["axial_stretch"]
        outside = ~_between(axial, measured.min(), measured.max())
        if outside.all():
            words = f"axial stretch {_ends(axial)}, measured {_ends(measured)}"
            return Extrapolated(outside, words)
        of_tests = np.concatenate([_hoop_stretches(a, self.tubes) for a in self.radius])
        low = -_upper_hull(axial, measured, -of_tests.min(axis=0))
        high = _upper_hull(axial, measured, of_tests.max(axis=0))
        asked = _hoop_stretches(radius, tube)
        # A radius that is NaN is not between.
        beyond = outside | ~_between(asked, low, high).all(axis=0)
        words = (
            f"hoop stretch of the wall {_ends(asked[:, beyond])} at axial stretch {_ends(axial)}, "
            f"measured {low.min():.4g} to {high.max():.4g}"
        )
        if outside.any():
            words += f" at {_ends(measured)}"
        return Extrapolated(beyond, words)


def typical_tests(data: xr.Dataset, inferred: Mapping[str, float]) -> xr.Dataset:
    """Tests of tubes whose unknown measures have these medians; NaN is what remains unknown."""
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
    """What was measured in tests; None if nothing is known of their tubes."""
    points = {name: tests[name].values for name in ("radius", "pressure")}
    points |= {name: at_points(tests, name) for name in GEOMETRY}
    columns: list[dict[str, Array]] = []
    for test, extended in enumerate(extension_tests(tests)):
        own = {name: values[points_of(tests, test)] for name, values in points.items()}
        ends = {name: np.array([[v.min()], [v.max()]]) for name, v in own.items()}
        if extended:
            count = own["radius"].size
            ends = {name: np.repeat(v, count, axis=1) for name, v in ends.items()}
            ends["radius"] = np.stack([own["radius"]] * 2)
        at_each = own["axial_stretch"] if extended else own["axial_stretch"][:1]
        columns.append(ends | {"at_each": at_each[None]})
    joined = {n: np.concatenate([c[n] for c in columns], axis=1) for n in columns[0]}
    known = np.isfinite(np.concatenate([*joined.values()])).all(axis=0)
    if not known.any():
        return None
    joined = {name: values[:, known] for name, values in joined.items()}
    tubes = {name: joined[name][0] for name in GEOMETRY} | {"axial_stretch": joined["at_each"][0]}
    return Measured(tubes, joined["radius"], joined["axial_stretch"], joined["pressure"])


def warned(extrapolated: Extrapolated | None) -> Extrapolated | None:
    """The same, after a warning if something is extrapolated."""
    if extrapolated is not None and extrapolated.points.any():
        count = int(extrapolated.points.sum())
        whose = f"class {extrapolated.of_class!r}: " if extrapolated.of_class else ""
        warn_user(
            f"{whose}{count} of {extrapolated.points.size} points {'is' if count == 1 else 'are'} "
            f"extrapolated, where nothing was measured and the law decides: {extrapolated.words}"
        )
    return extrapolated


def warn_user(words: str) -> None:
    """Warn at the line that called the package."""
    warnings.warn(words, skip_file_prefixes=(PACKAGE,))


def _hoop_stretches(radius: Array, tube: Mapping[str, Array | float]) -> Array:
    """Hoop stretches at the inner and the outer surface, between which are those of the wall."""
    rest = {name: value for name, value in tube.items() if name != "outer_radius"}
    faces = tube["inner_radius"], tube["outer_radius"]
    return np.array([stretches(face, radius, **rest)[1] for face in faces])


def _upper_hull(at: Array, x: Array, y: Array) -> Array:
    """Height of the convex hull of points (x, y) at places between them."""
    # Stretches that differ by rounding errors are one.
    at, x = at.round(_DIGITS), x.round(_DIGITS)
    hull: list[tuple[float, float]] = []
    for place in np.unique(x):
        point = place, y[x == place].max()
        while len(hull) > 1 and _turns_left(hull[-2], hull[-1], point):
            hull.pop()
        hull.append(point)
    return np.interp(at, *np.transpose(hull))


def _turns_left(a: tuple[float, float], b: tuple[float, float], c: tuple[float, float]) -> bool:
    """Whether the way from `a` over `b` to `c` turns to the left, or goes straight on."""
    return (b[0] - a[0]) * (c[1] - a[1]) >= (b[1] - a[1]) * (c[0] - a[0])


def _between(x: Array | float, low: Array | float, high: Array | float) -> NDArray[np.bool_]:
    margin = ROUNDING * np.maximum(np.abs(low), np.abs(high))
    return np.logical_and(x >= low - margin, x <= high + margin)


def _ends(values: Array) -> str:
    """The least and the largest of some numbers, in words; NaN are those that were not reached."""
    finite = values[np.isfinite(values)]
    if not finite.size:
        return "beyond all"
    low, high = f"{finite.min():.4g}", f"{finite.max():.4g}"
    return low if low == high else f"{low} to {high}"


def _in_both_units(pressure: Array) -> str:
    return f"{_ends(pressure)} kPa ({_ends(pressure / mmHg)} mmHg)"
