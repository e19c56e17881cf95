"""Tubes in numbers: curves, stresses and radii of as many tubes as there are draws, at once."""

from functools import cache
from typing import Any, NamedTuple

import numpy as np
import pytensor
import pytensor.tensor as pt
from numpy.typing import NDArray

from pymc_hyperelastic.mechanics.axial_force import AxialForceIntegral
from pymc_hyperelastic.mechanics.pressure import PressureIntegral
from pymc_hyperelastic.mechanics.strain_energy.base import StrainEnergy
from pymc_hyperelastic.mechanics.tube import current_radius, hoop_elongation, opening_factor

Array = NDArray[np.float64]

# A curve is followed in steps of the logarithm of the radius, so short that none leaps over a
# maximum and the minimum beyond it, and no further than 20 times the radius at which it starts.
_STEP, _FARTHEST = 0.05, np.log(20.0)
# Newton's method squares its error: a step of this size leaves one below rounding. An interval that
# is shorter than the second number without such a step holds the end of the branch.
_NEWTON_STEP, _NO_LENGTH = 1e-9, 1e-13
# Points that are integrated together: their arrays stay in the processor's cache.
_PIECE = 4096


class Wall(NamedTuple):
    """Circles of the wall: radii, stretches and stress differences, the place along a last axis."""

    reference: Array
    current: Array
    log_hoop: Array
    log_axial: Array
    hoop_difference: Array
    axial_difference: Array


class TubeNumbers(NamedTuple):
    """Tubes of one law, whose parameters and geometry are arrays that broadcast.

    The last axis is that of the radii or pressures that are asked for.
    """

    energy: StrainEnergy
    geometry: dict[str, Array]
    """By the names of GEOMETRY, in their order."""
    entries: list[Array]

    def with_axis(self) -> "TubeNumbers":
        """The same with one axis more, for places in the wall."""
        geometry = {name: value[..., None] for name, value in self.geometry.items()}
        return self._replace(
            geometry=geometry, entries=[entry[..., None] for entry in self.entries]
        )

    def pressure(self, radius: Any, **other: Any) -> tuple[Array, Array]:
        """Pressure and stiffness at internal radii, or those of the wall of an `other` geometry."""
        pressure, stiffness = self._integrate(PressureIntegral, radius, **other)
        return pressure, stiffness

    def axial_force(self, radius: Any) -> Array:
        """Reduced axial force at internal radii."""
        (force,) = self._integrate(AxialForceIntegral, radius)
        return force

    def wall(self, radius: Array, position: Array) -> Wall:
        """State of the wall at internal radii, at places from 0 inside to 1 outside."""
        inner, outer, axial, angle = self.geometry.values()
        tube = {"inner_radius": inner, "axial_stretch": axial, "opening_angle": angle}
        reference = inner + position * (outer - inner)
        delta = hoop_elongation(radius, reference, **tube)
        log_hoop = (np.log(opening_factor(angle) / axial) + np.log1p(delta)) / 2
        log_axial = np.broadcast_to(np.log(axial), log_hoop.shape)
        function = _stress_differences(self.energy)
        differences = _evaluate(function, log_hoop, log_axial, *self.entries)
        current = current_radius(reference, radius, **tube)
        return Wall(reference, current, log_hoop, log_axial, *differences)

    def radius_at(self, pressure: Array) -> Array:
        """Internal radius at pressures, on the rising branch of the curve; NaN if there is none.

        Newton's method in the logarithm of the radius. It starts at ``a₀`` and moves along the
        branch in short steps until the pressure has been passed, or the slope is no longer
        positive; from then on it stays between the last place before that and the first one after.
        """
        full = np.broadcast_arrays(pressure, *self.geometry.values(), *self.entries)
        target, *inputs = (np.ravel(x) for x in full)
        inner, _, axial, angle = inputs[:4]
        start = inner / np.sqrt(opening_factor(angle) * axial)
        curve = _integral(PressureIntegral, self.energy)
        way = np.sign(target - _evaluate(curve, start, *inputs)[0])
        # Places are |ln(a/a₀)|: the last before the end, the first beyond it, the next to look at.
        before, beyond = np.zeros_like(start), np.full_like(start, np.inf)
        place, lacking_before = np.zeros_like(start), np.full_like(start, np.inf)
        found = np.full_like(start, np.nan)
        active, turn = np.arange(start.size), 0
        while active.size:
            turn += 1
            at, direction = place[active], way[active]
            radius = start[active] * np.exp(direction * at)
            value, slope = _evaluate(curve, radius, *(x[active] for x in inputs))
            with np.errstate(all="ignore"):
                lacking = direction * (target[active] - value)
                newton = at + np.where(slope > 0, lacking / (slope * radius), np.nan)
            passed = ~((lacking > 0) & (lacking <= lacking_before[active]) & (slope > 0))
            beyond[active[passed]] = at[passed]
            before[active[~passed]] = at[~passed]
            lacking_before[active[~passed]] = lacking[~passed]
            solved = np.abs(newton - at) < _NEWTON_STEP
            found[active[solved]] = (radius * (1 + direction * (newton - at)))[solved]
            low, high = before[active], np.minimum(beyond[active], before[active] + _STEP)
            further = np.where(high < beyond[active], high, (low + high) / 2)
            # Now and then the interval is halved, so that the search ends in any case.
            trusted = (newton > low) & (newton < high) & (turn % 4 > 0)
            place[active] = np.where(trusted, newton, further)
            ended = (high - low < _NO_LENGTH) | (low > _FARTHEST)
            active = active[~solved & ~ended]
        return found.reshape(full[0].shape)

    def _integrate(self, kind: Any, radius: Any, **other: Any) -> list[Array]:
        function = _integral(kind, self.energy)
        return _evaluate(function, radius, *(self.geometry | other).values(), *self.entries)


@cache
def _integral(kind: Any, energy: StrainEnergy) -> Any:
    """Compile an integral for vectors: internal radius, geometry, entries of the parameters."""
    inputs = [pt.dvector() for _ in range(5 + len(energy.entry_names))]
    return pytensor.function(inputs, kind(strain_energy=energy)(*inputs, return_list=True))


@cache
def _stress_differences(energy: StrainEnergy) -> Any:
    """Compile ``σθθ − σrr`` and ``σzz − σrr`` for vectors: logarithms of two stretches, entries."""
    inputs = [pt.dvector() for _ in range(2 + len(energy.entry_names))]
    log_hoop, log_axial, *entries = inputs
    parameters = energy.join(entries)
    outputs = [
        energy.stress_difference(log_hoop, log_axial, **parameters),
        energy.axial_stress_difference(log_hoop, log_axial, **parameters),
    ]
    return pytensor.function(inputs, outputs, on_unused_input="ignore")


def _evaluate(function: Any, *inputs: Any) -> list[Array]:
    """Outputs of a function of vectors at inputs that broadcast."""
    full = np.broadcast_arrays(*inputs)
    starts = range(0, max(full[0].size, 1), _PIECE)
    # A radius may be NaN, or so large that the stress overflows.
    with np.errstate(all="ignore"):
        pieces = [function(*(x.flat[start : start + _PIECE] for x in full)) for start in starts]
    return [np.concatenate(parts).reshape(full[0].shape) for parts in zip(*pieces, strict=True)]
