"""Tubes whose radii and geometry are known, and parts of their walls."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pymc_hyperelastic.mechanics.tube import opening_factor, stretches

Array = NDArray[np.float64]


class KnownTubes(NamedTuple):
    """Tubes whose radii and geometry are known, one entry a point; or parts of their walls."""

    radius: Array
    """Internal radius, mm."""
    inner_radius: Array
    outer_radius: Array
    axial_stretch: Array
    opening_angle: Array
    growth: Array
    """How the internal radius of the whole wall grows with the one that was measured."""
    share: Array | float = 1.0
    """How its own internal radius grows with that of the whole wall."""

    def at(self, points: NDArray) -> "KnownTubes":
        """Some of the points."""
        return KnownTubes(*(np.broadcast_to(v, self.radius.shape)[points] for v in self))

    @property
    def walls(self) -> list[Array]:
        """Internal radius and geometry, each (point, 1)."""
        return [values[:, None] for values in self[:5]]

    @property
    def log_hoop(self) -> tuple[Array, Array]:
        """``ln λθ`` at the inner and at the outer face, between which it is monotonic."""
        tube = {
            "inner_radius": self.inner_radius,
            "axial_stretch": self.axial_stretch,
            "opening_angle": self.opening_angle,
        }
        inner, outer = (
            np.log(stretches(face, self.radius, **tube)[1])
            for face in (self.inner_radius, self.outer_radius)
        )
        return inner, outer

    def divided(self) -> tuple["KnownTubes", "KnownTubes"]:
        r"""Each wall in two, where ``λθ ≥ 1`` and where ``λθ < 1``.

        .. math:: λ_θ = \frac{k r}{R} = 1 \quad\Leftrightarrow\quad
            R^2 \left(1 - \frac{k}{λ_z}\right) = k^2 a^2 - \frac{k}{λ_z} A^2

        A part of a wall is a tube in the tube. Where a wall has only one of them, the other has no
        thickness.
        """
        inner, outer = self.log_hoop
        crossed = (inner < 0) != (outer < 0)
        k = opening_factor(self.opening_angle)
        ratio = np.where(crossed, k / self.axial_stretch, 0.0)
        square = ((k * self.radius) ** 2 - ratio * self.inner_radius**2) / (1 - ratio)
        place = np.clip(np.sqrt(np.where(crossed, square, 0.0)), self.inner_radius, None)
        place = np.where(crossed, np.minimum(place, self.outer_radius), self.outer_radius)
        within = self._replace(outer_radius=place, share=np.ones_like(place))
        around = self._replace(radius=place / k, inner_radius=place, share=self.radius * k / place)
        taut, slack = (
            KnownTubes(*(np.where(first, a, b) for a, b in zip(within, around, strict=True)))
            for first in (inner >= 0, inner < 0)
        )
        return taut, slack
