"""Tubes in numbers: curves, stresses and radii of as many tubes as there are draws, at once."""

from collections.abc import Callable, Mapping
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
import pytensor
import pytensor.tensor as pt
from numpy.typing import NDArray

from pymc_hyperelastic.mechanics.axial_force import AxialForceIntegral
from pymc_hyperelastic.mechanics.material import MaterialIntegral
from pymc_hyperelastic.mechanics.pressure import PressureIntegral
from pymc_hyperelastic.mechanics.strain_energy.base import StrainEnergy
from pymc_hyperelastic.mechanics.tube import (
    GEOMETRY,
    current_radius,
    hoop_elongation,
    inferred_geometry,
    internal_radius_from_outer_radius,
    opening_factor,
)
from pymc_hyperelastic.mechanics.wall import WALL_ORDER
from pymc_hyperelastic.models.forward.tube_variables import WallVariables
from pymc_hyperelastic.models.geometry import deviated_tube

Array = NDArray[np.float64]

# A curve is followed in steps of the logarithm of the radius, so short that none leaps over a
# maximum and the minimum beyond it, and no further than 20 times the radius at which it starts.
_STEP, _FARTHEST = 0.05, np.log(20.0)
# Newton's method squares its error: a step of this size leaves one below rounding. An interval that
# is shorter than the second number without such a step holds the end of the branch.
_NEWTON_STEP, _NO_LENGTH = 1e-9, 1e-13
# Relative distance beyond the outer radius of a layer up to which a circle is at the interface.
_AT_INTERFACE = 1e-12
# Compiled functions that are kept: ten laws with a few orders each.
_COMPILED = 64
# Points that are integrated together: their arrays stay in the processor's cache.
_PIECE = 4096


class Circles(NamedTuple):
    """Circles of one layer of the wall: stretches and stress differences, along a last axis."""

    log_hoop: Array
    log_axial: Array
    hoop_difference: Array
    axial_difference: Array


class Stresses(NamedTuple):
    """Cauchy stresses at circles of the wall, kPa, and where these are, mm."""

    current: Array
    radial: Array
    hoop: Array
    axial: Array


class WallMeans(NamedTuple):
    """Means over the current area of the wall, kPa; see :class:`MaterialIntegral`."""

    energy: Array
    hoop_stiffness: Array
    axial_stiffness: Array


class LayerNumbers(NamedTuple):
    """A layer of tubes: its law, its place in the reference wall, entries of the parameters."""

    energy: StrainEnergy
    inner_radius: Array
    outer_radius: Array
    entries: list[Array]


class TubeNumbers(NamedTuple):
    """Tubes of the same laws, whose parameters and geometry are arrays that broadcast.

    The last axis is that of the radii or pressures that are asked for.
    """

    layers: list[LayerNumbers]
    """From the inside out; of a wall of one material it is one."""
    geometry: dict[str, Array]
    """Geometry of the whole tube, by the names of GEOMETRY, in their order."""

    @classmethod
    @np.errstate(all="ignore")  # an impossible tube has no radius
    def of_wall(
        cls, inputs: Mapping[str, Array], wall: WallVariables
    ) -> tuple["TubeNumbers", Array]:
        """Return tubes (material, point) of a wall in numbers, and their internal radii.

        The `inputs` are those of :func:`tube_inputs` at each point, with its ``test``. The numbers
        of the wall have shape (material), and deviations (material, test).
        """

        def column(values: Any) -> Array:
            return np.reshape(values, (-1, 1))

        deviations = {name: z[:, inputs["test"]] for name, z in wall.deviations.items()}
        known = deviated_tube(inputs, deviations)
        tube = inferred_geometry(known | {name: column(v) for name, v in wall.geometry.items()})
        inner = tube["inner_radius"]
        if isinstance(wall.energy, StrainEnergy):
            entries = [column(entry) for entry in wall.energy.split(wall.parameters)]
            layers = [LayerNumbers(wall.energy, inner, tube["outer_radius"], entries)]
        else:
            layers, begin = [], inner
            for layer in wall.energy:
                end = begin + column(layer.thickness)
                entries = [column(entry) for entry in layer.energy.split(layer.parameters)]
                layers.append(LayerNumbers(layer.energy, begin, end, entries))
                begin = end
            tube["outer_radius"] = begin
        geometry = {name: tube[name] for name in GEOMETRY}
        if "radius" in inputs:
            return cls(layers, geometry), inputs["radius"]
        outer = inputs["current_outer_radius"]
        return cls(layers, geometry), internal_radius_from_outer_radius(outer, **geometry)

    def curves(
        self, radius: Any, order: int = WALL_ORDER, *, with_force: bool = False
    ) -> dict[str, Array]:
        """Pressure and stiffness at internal radii, and the axial force if it is asked for."""
        pressure, stiffness = self.pressure(radius, order)
        curves = {"pressure": pressure, "stiffness": stiffness}
        return curves | ({"axial_force": self.axial_force(radius, order)} if with_force else {})

    def each(self, change: Callable[[Array], Array]) -> "TubeNumbers":
        """The same with every array changed."""
        layers = [
            LayerNumbers(
                layer.energy,
                change(layer.inner_radius),
                change(layer.outer_radius),
                [change(entry) for entry in layer.entries],
            )
            for layer in self.layers
        ]
        return TubeNumbers(layers, {name: change(value) for name, value in self.geometry.items()})

    def with_axis(self) -> "TubeNumbers":
        """The same with one axis more, for places in the wall."""
        return self.each(lambda value: value[..., None])

    def stretched(self, axial_stretch: Array) -> "TubeNumbers":
        """The same tubes at other axial stretches."""
        return self._replace(geometry={**self.geometry, "axial_stretch": axial_stretch})

    def current(self, reference: Array, radius: Any) -> Array:
        """Return the current radii of circles at an internal radius."""
        return current_radius(reference, radius, **self._unloaded)

    def pressure(self, radius: Any, order: int = WALL_ORDER) -> tuple[Array, Array]:
        """Pressure and stiffness at internal radii."""
        pressure: Any = 0.0
        stiffness: Any = 0.0
        for i, layer in enumerate(self.layers):
            own = self.current(layer.inner_radius, radius) if i else radius
            of_layer = self._integrate(PressureIntegral, layer, own, layer.inner_radius, order)
            pressure = pressure + of_layer[0]
            # The internal radius a' of a layer grows by a/a' when that of the wall grows by 1.
            stiffness = stiffness + of_layer[1] * (radius / own if i else 1.0)
        return pressure, stiffness

    def axial_force(self, radius: Any, order: int = WALL_ORDER) -> Array:
        """Reduced axial force at internal radii."""
        force: Any = 0.0
        for i, layer in enumerate(self.layers):
            own = self.current(layer.inner_radius, radius) if i else radius
            own_force = self._integrate(AxialForceIntegral, layer, own, layer.inner_radius, order)
            force = force + own_force[0]
        return force

    def wall_means(self, radius: Any) -> WallMeans:
        """Stored energy and material stiffness at internal radii, as means over the wall."""
        sums: Any = 0.0
        for i, layer in enumerate(self.layers):
            own = self.current(layer.inner_radius, radius) if i else radius
            of_layer = self._integrate(MaterialIntegral, layer, own, layer.inner_radius)
            sums = sums + np.array(of_layer)
        # A radius may be NaN, of which a comparison within the law knows nothing.
        return WallMeans(*np.where(np.isnan(radius), np.nan, sums / self.wall_area))

    @property
    def wall_area(self) -> Array:
        """Current area of the wall's cross-section, mm²: it does not depend on the pressure."""
        inner, outer, axial, angle = self.geometry.values()
        return np.pi * (outer - inner) * (outer + inner) / (opening_factor(angle) * axial)

    def circles(self, layer: LayerNumbers, radius: Array, reference: Array) -> Circles:
        """Circles of a layer, of these reference radii, at internal radii of the wall."""
        angle, axial = self.geometry["opening_angle"], self.geometry["axial_stretch"]
        delta = hoop_elongation(radius, reference, **self._unloaded)
        log_hoop = (np.log(opening_factor(angle) / axial) + np.log1p(delta)) / 2
        log_axial = np.broadcast_to(np.log(axial), log_hoop.shape)
        function = _stress_differences(layer.energy)
        differences = _evaluate(function, log_hoop, log_axial, *layer.entries)
        return Circles(log_hoop, log_axial, *differences)

    def stresses(self, radius: Array, position: Array) -> Stresses:
        """Stresses at places in the reference wall, from 0 inside to 1 outside.

        At an interface, where hoop and axial stress jump, they are those of the layer within.
        """
        inner, outer = self.geometry["inner_radius"], self.geometry["outer_radius"]
        reference = inner + position * (outer - inner)
        current = self.current(reference, radius)
        load: Any = 0.0
        hoop, axial = np.full_like(current, np.nan), np.full_like(current, np.nan)
        for i, layer in enumerate(self.layers):
            last = i == len(self.layers) - 1
            # The wall beyond a circle is a tube; its pressure is the radial stress at the circle.
            begin = np.maximum(reference, layer.inner_radius)
            begin = begin if last else np.minimum(begin, layer.outer_radius)
            own = self.current(begin, radius)
            load = load + self._integrate(PressureIntegral, layer, own, begin)[0]
            circles = self.circles(layer, radius, reference)
            outermost = layer.outer_radius * (1 + _AT_INTERFACE)
            here = np.isnan(hoop) & (last | (reference <= outermost))
            hoop = np.where(here, circles.hoop_difference, hoop)
            axial = np.where(here, circles.axial_difference, axial)
        return Stresses(current, -load, hoop - load, axial - load)

    def radius_at(self, pressure: Array) -> Array:
        """Internal radius at pressures, on the rising branch of the curve, or NaN.

        Newton's method in the logarithm of the radius. It starts at ``a₀`` and moves along the
        branch in short steps until the pressure has been passed, or the slope is no longer
        positive; from then on it stays between the last place before that and the first one after.
        """
        entries = [np.shape(entry) for layer in self.layers for entry in layer.entries]
        geometry = [np.shape(value) for value in self.geometry.values()]
        shape = np.broadcast_shapes(np.shape(pressure), *geometry, *entries)
        target = np.ravel(np.broadcast_to(pressure, shape))
        tubes = self.each(lambda value: np.ravel(np.broadcast_to(value, shape)))
        inner, _, axial, angle = tubes.geometry.values()
        start = inner / np.sqrt(opening_factor(angle) * axial)
        way = np.sign(target - tubes.pressure(start)[0])
        # Places are |ln(a/a₀)|: the last before the end, the first beyond it, the next to look at.
        before, beyond = np.zeros_like(start), np.full_like(start, np.inf)
        place, lacking_before = np.zeros_like(start), np.full_like(start, np.inf)
        found = np.full_like(start, np.nan)
        active, turn = np.arange(start.size), 0
        while active.size:
            turn += 1
            at, direction = place[active], way[active]
            radius = start[active] * np.exp(direction * at)
            value, slope = tubes.each(lambda x: x[active]).pressure(radius)
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
        return found.reshape(shape)

    @property
    def _unloaded(self) -> dict[str, Array]:
        """The tube, but for its outer radius, on which no circle within depends."""
        return {name: v for name, v in self.geometry.items() if name != "outer_radius"}

    def _integrate(
        self,
        kind: Any,
        layer: LayerNumbers,
        radius: Any,
        begin: Array,
        order: int = WALL_ORDER,
    ) -> list[Array]:
        """An integral over a layer from a reference radius, which is now at `radius`."""
        axial, angle = self.geometry["axial_stretch"], self.geometry["opening_angle"]
        geometry = begin, layer.outer_radius, axial, angle
        return _evaluate(_integral(kind, layer.energy, order), radius, *geometry, *layer.entries)


@lru_cache(maxsize=_COMPILED)
def _integral(kind: Any, energy: StrainEnergy, order: int) -> Any:
    """Compile an integral for vectors: internal radius, geometry, entries of the parameters."""
    inputs = [pt.dvector() for _ in range(5 + len(energy.entry_names))]
    outputs = kind(strain_energy=energy, order=order)(*inputs, return_list=True)
    # Predictions take many points; to compare orders a few points are enough.
    mode = None if order == WALL_ORDER else "FAST_COMPILE"
    return pytensor.function(inputs, outputs, mode=mode)


@lru_cache(maxsize=_COMPILED)
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
