"""Where the tubes of a result were measured: beyond that a prediction rests on its law alone.

What tells of a material is how far it was stretched. A prediction is *extrapolated* where it leaves
what was measured:

at a radius
    where circles of the wall have hoop and axial stretches that lie outside the convex hull of
    those that were measured. On one tube at one axial stretch that is outside its measured radii;
at a pressure
    that is lower or higher than all that were measured on this tube. To tests on other tubes, or at
    other axial stretches, pressures do not compare: if there are such, it is extrapolated only
    if the wall at its median radius is, too.

Where the geometry is inferred, its median stands for it.
"""

import warnings
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from pymc_hyperelastic.data.inflation import points_of
from pymc_hyperelastic.data.units import mmHg
from pymc_hyperelastic.evidence.checks import PACKAGE
from pymc_hyperelastic.mechanics.tube import (
    GEOMETRY,
    inferred_geometry,
    internal_radius_from_outer_radius,
    stretches,
)

Array = NDArray[np.float64]

# Relative: what was measured is within, however it was rounded.
_ROUNDING = 1e-9


class Extrapolated(NamedTuple):
    """Which of the points that were asked for are beyond what was measured."""

    points: NDArray[np.bool_]
    words: str
    """What was asked for there, and what was measured."""
    of_class: str | None = None
    """Which of several classes predicts, as a warning names it."""


class Measured(NamedTuple):
    """The tests of a result: on which tubes, and from where to where."""

    tubes: dict[str, Array]
    """Geometry by test."""
    radius: Array
    """Smallest and largest internal radius of each test, mm: (end, test)."""
    pressure: Array
    """Lowest and highest pressure, kPa, likewise."""

    def at_radii(self, radius: Array, tube: Mapping[str, float]) -> Extrapolated:
        """Which internal radii of a tube are beyond."""
        beyond = self._beyond_stretches(radius, tube)
        if self._on(tube).all():
            words = f"internal radius {_ends(radius[beyond.points])} mm, measured "
            return beyond._replace(words=words + f"{_ends(self.radius)} mm")
        return beyond

    def at_pressures(
        self, pressure: Array, radius: Array, tube: Mapping[str, float], unit: str
    ) -> Extrapolated:
        """Which pressures, given in a unit, are beyond in a tube that has these median radii."""
        here = self._on(tube)
        beyond = np.ones(pressure.shape, bool)
        if here.any():
            on_this = self.pressure[:, here]
            beyond = ~_between(pressure, on_this.min(), on_this.max())
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

    def _on(self, tube: Mapping[str, float]) -> NDArray[np.bool_]:
        """Which tests are on this tube."""
        same = [np.isclose(self.tubes[n], tube[n], rtol=_ROUNDING, atol=0) for n in GEOMETRY]
        return np.all(same, axis=0)

    def _beyond_stretches(self, radius: Array, tube: Mapping[str, float]) -> Extrapolated:
        """At which radii the wall of a tube is stretched as none was."""
        axial, measured = tube["axial_stretch"], self.tubes["axial_stretch"]
        if not _between(axial, measured.min(), measured.max()):
            words = f"axial stretch {axial:.4g}, measured {_ends(measured)}"
            return Extrapolated(np.ones(radius.shape, bool), words)
        of_tests = np.concatenate([_hoop_stretches(a, self.tubes) for a in self.radius])
        low = -_upper_hull(axial, measured, -of_tests.min(axis=0))
        high = _upper_hull(axial, measured, of_tests.max(axis=0))
        asked = _hoop_stretches(radius, tube)
        # A radius that is NaN is not between.
        beyond = ~_between(asked, low, high).all(axis=0)
        words = (
            f"hoop stretch of the wall {_ends(asked[:, beyond])} at axial stretch {axial:.4g}, "
            f"measured {low:.4g} to {high:.4g}"
        )
        return Extrapolated(beyond, words)


def typical_tests(data: xr.Dataset, inferred: Mapping[str, float]) -> xr.Dataset:
    """Tests of tubes whose unknown measures have these medians; NaN is what remains unknown."""
    tubes = {name: data[name].values.astype(float) for name in GEOMETRY}
    tubes = inferred_geometry(
        tubes | {k: np.full(data.sizes["test"], v) for k, v in inferred.items()}
    )
    data = data.assign({name: ("test", value) for name, value in tubes.items()})
    if np.isfinite(data["radius"]).all() or "outer_diameter" not in data:
        return data
    of_points = {name: value[data["test"].values] for name, value in tubes.items()}
    with np.errstate(invalid="ignore"):
        radius = internal_radius_from_outer_radius(data["outer_diameter"].values / 2, **of_points)
    return data.assign(radius=("obs", radius))


def measured_by(tests: xr.Dataset) -> Measured | None:
    """What was measured in tests; None if nothing is known of their tubes."""
    spans = [points_of(tests, test) for test in range(tests.sizes["test"])]
    radius, pressure = (
        np.array([[f(tests[name].values[span]) for span in spans] for f in (np.min, np.max)])
        for name in ("radius", "pressure")
    )
    tubes = {name: tests[name].values for name in GEOMETRY}
    known = np.isfinite([*tubes.values(), *radius, *pressure]).all(axis=0)
    if not known.any():
        return None
    tubes = {name: value[known] for name, value in tubes.items()}
    return Measured(tubes, radius[:, known], pressure[:, known])


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


def _upper_hull(at: float, x: Array, y: Array) -> float:
    """Height of the convex hull of points (x, y) at one place between them."""
    hull: list[tuple[float, float]] = []
    for place in np.unique(x):
        point = place, y[x == place].max()
        while len(hull) > 1 and _turns_left(hull[-2], hull[-1], point):
            hull.pop()
        hull.append(point)
    return float(np.interp(at, *np.transpose(hull)))


def _turns_left(a: tuple[float, float], b: tuple[float, float], c: tuple[float, float]) -> bool:
    """Whether the way from `a` over `b` to `c` turns to the left, or goes straight on."""
    return (b[0] - a[0]) * (c[1] - a[1]) >= (b[1] - a[1]) * (c[0] - a[0])


def _between(x: Array | float, low: float, high: float) -> NDArray[np.bool_]:
    margin = _ROUNDING * max(abs(low), abs(high))
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
