"""Numeric tubes: curves, stresses and radii of as many tubes as there are draws, at once."""

from collections.abc import Callable, Sequence
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
import pytensor
import pytensor.tensor as pt
import xarray as xr
from numpy.typing import NDArray

from pymc_hyperelastic.mechanics.integrals import (
    LONGEST_STEP,
    SMALLEST_STEP,
    wall_force,
    wall_material,
    wall_pressure,
)
from pymc_hyperelastic.mechanics.layers import LayeredTube, ReferenceLayer
from pymc_hyperelastic.mechanics.sheet import stresses_at
from pymc_hyperelastic.mechanics.strain_energy.base import StrainEnergy
from pymc_hyperelastic.mechanics.tube import UNLOADED, measure_of, opening_factor, stretches
from pymc_hyperelastic.mechanics.wall import PIECE, WALL_ORDER
from pymc_hyperelastic.models.forward.tube_variables import WallVariables, current_tube, tube_inputs

Array = NDArray[np.float64]

# Logarithm of the ratio of the radii between which a pressure is looked for.
_FARTHEST = np.log(20.0)


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


class TubeNumbers(LayeredTube):
    """Tubes of the same laws, whose parameters and geometry are arrays that broadcast.

    The last axis is that of the radii or pressures that are asked for. The geometry has the names
    of GEOMETRY, in their order.
    """

    def each(self, change: Callable[[Array], Array]) -> "TubeNumbers":
        """The same with every array changed."""
        layers = [
            ReferenceLayer(law, change(inner), change(outer), [change(entry) for entry in entries])
            for law, inner, outer, entries in self.layers
        ]
        return TubeNumbers(layers, {name: change(value) for name, value in self.geometry.items()})

    def with_axis(self) -> "TubeNumbers":
        """The same with one axis more, for places in the wall."""
        return self.each(lambda value: value[..., None])

    def stretched(self, axial_stretch: Array) -> "TubeNumbers":
        """The same tubes at other axial stretches."""
        return self._replace(geometry={**self.geometry, "axial_stretch": axial_stretch})

    def pressure(self, radius: Any) -> tuple[Array, Array]:
        """Pressure and stiffness at internal radii."""
        pressure, stiffness = _integrate(wall_pressure, self, radius)
        return pressure, stiffness

    def axial_force(self, radius: Any) -> Array:
        """Reduced axial force at internal radii."""
        return _integrate(wall_force, self, radius)[0]

    def wall_means(self, radius: Any) -> WallMeans:
        """Stored energy and material stiffness at internal radii, as means over the wall."""
        sums = np.array(_integrate(wall_material, self, radius))
        # A radius may be NaN, of which a comparison within the law knows nothing.
        return WallMeans(*np.where(np.isnan(radius), np.nan, sums / self.wall_area))

    @property
    def wall_area(self) -> Array:
        """Current area of the wall's cross-section, mm²: it does not depend on the pressure."""
        return measure_of("wall_area", self.geometry) / self.geometry["axial_stretch"]

    def circles(self, layer: ReferenceLayer, radius: Array, reference: Array) -> Circles:
        """Circles of a layer, of these reference radii, at internal radii of the wall."""
        _, hoop, axial = stretches(reference, radius, **self.unloaded)
        log_hoop = np.log(hoop)
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
        # The wall beyond a circle is a tube; its pressure is the radial stress at the circle.
        beyond = []
        hoop, axial = np.full((2, *current.shape), np.nan)
        for layer in self.layers:
            last = layer is self.layers[-1]
            beyond.append(layer._replace(outer_radius=np.maximum(reference, layer.outer_radius)))
            circles = self.circles(layer, radius, reference)
            within = last | (reference < layer.outer_radius)
            here = np.isnan(hoop) & (within | np.isclose(reference, layer.outer_radius))
            hoop = np.where(here, circles.hoop_difference, hoop)
            axial = np.where(here, circles.axial_difference, axial)
        wall = TubeNumbers(beyond, {**self.geometry, "inner_radius": reference})
        load = _integrate(wall_pressure, wall, current)[0]
        return Stresses(current, -load, hoop - load, axial - load)

    def radius_at(self, pressure: Array) -> Array:
        """Internal radius at pressures, on the rising branch of the curve, or NaN.

        Newton's method in the logarithm of the radius, from the radius ``a₀`` of the unloaded tube.
        A step that leaves the rising branch, or leads away from the pressure, is taken back, and
        those after it are half as long at most.
        """
        entries = [np.shape(entry) for layer in self.layers for entry in layer.entries]
        geometry = [np.shape(value) for value in self.geometry.values()]
        shape = np.broadcast_shapes(np.shape(pressure), *geometry, *entries)
        target = np.ravel(np.broadcast_to(pressure, shape))
        tubes = self.each(lambda value: np.ravel(np.broadcast_to(value, shape)))
        inner, _, axial, angle = tubes.geometry.values()
        start = inner / np.sqrt(opening_factor(angle) * axial)
        # ln(a/a₀), the step that is tried there, the step of Newton's method, and its bound.
        place, step, newton = np.zeros((3, start.size))
        longest, lacking = np.full(start.size, LONGEST_STEP), np.full(start.size, np.inf)
        found = np.full(start.size, np.nan)
        active = np.arange(start.size)
        while active.size:
            tried = place[active] + step[active]
            radius = start[active] * np.exp(tried)
            value, slope = tubes.each(lambda x: x[active]).pressure(radius)
            left = target[active] - value
            better = (slope > 0) & (slope < np.inf) & (np.abs(left) < lacking[active])
            moved = active[better]
            place[moved], lacking[moved] = tried[better], np.abs(left[better])
            newton[moved] = left[better] / (slope * radius)[better]
            longest[active[~better]] /= 2
            solved = moved[np.abs(newton[moved]) < SMALLEST_STEP]
            found[solved] = (start * np.exp(place) * (1 + newton))[solved]
            step[active] = np.clip(newton[active], -longest[active], longest[active])
            going_on = (longest[active] > SMALLEST_STEP) & (np.abs(place[active]) < _FARTHEST)
            active = active[going_on & np.isnan(found[active])]
        return found.reshape(shape)


@np.errstate(all="ignore")  # an impossible tube has no radius
def numeric_curves(
    data: xr.Dataset,
    wall: WallVariables,
    points: NDArray[np.intp],
    order: int,
    with_force: bool = False,
    geometry_sd: tuple[tuple[str, float | None], ...] = (),
) -> dict[str, Array]:
    """Return curves (material, point) of a numeric wall at some points of the data, by quadrature.

    The numbers of the wall have shape (material), and its deviations (material, test). Curves of an
    impossible tube are NaN.
    """
    inputs = tube_inputs(data, geometry_sd)
    inputs = {name: values[points] for name, values in inputs.items()}
    test = data["test"].values[points]
    deviations = {name: z[:, test] for name, z in wall.deviations.items()}
    columns = wall.mapped(lambda values: np.reshape(values, (-1, 1)))
    current = current_tube(np, inputs, columns._replace(deviations=deviations))
    radius = np.where(current.possible, current.radius, np.nan)
    curves = _integrate(wall_pressure, current.tube, radius, order, "FAST_COMPILE")
    if with_force:
        curves += _integrate(wall_force, current.tube, radius, order, "FAST_COMPILE")[:1]
    return dict(zip(("pressure", "stiffness", "axial_force"), curves, strict=False))


def _integrate(
    integral: Callable,
    tube: LayeredTube,
    radius: Any,
    order: int = WALL_ORDER,
    mode: str | None = None,
) -> list[Array]:
    """Integrals over the walls of numeric tubes at internal radii; all arrays broadcast."""
    function = _compiled(integral, tuple(layer.energy for layer in tube.layers), order, mode)
    return _evaluate(function, radius, *tube.inputs)


@lru_cache(maxsize=64)
def _compiled(
    integral: Callable, energies: tuple[StrainEnergy, ...], order: int, mode: str | None
) -> Any:
    """Compile an integral over walls, for vectors of radii and of `LayeredTube.inputs`."""
    count = len(UNLOADED) + sum(1 + len(energy.entry_names) for energy in energies)
    radius, *inputs = [pt.dvector() for _ in range(1 + count)]
    outputs = integral(LayeredTube.of_inputs(energies, inputs), radius, order)
    return pytensor.function([radius, *inputs], [*outputs], mode=mode)


@lru_cache(maxsize=64)
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


@lru_cache(maxsize=64)
def _sheet_stresses(energy: StrainEnergy, free: str) -> Any:
    """Compile :func:`stresses_at` for vectors: logarithms of the known stretches, entries."""
    log_x, log_y = (None if axis == free else pt.dvector() for axis in "xy")
    entries = [pt.dvector() for _ in energy.entry_names]
    known = [log for log in (log_x, log_y) if log is not None]
    outputs = stresses_at(energy, log_x, log_y, entries)
    return pytensor.function([*known, *entries], [*outputs], on_unused_input="ignore")


def numeric_stresses(
    energy: StrainEnergy, log_x: Array | None, log_y: Array | None, entries: Sequence[Any]
) -> list[Array]:
    """Return what :func:`stresses_at` returns, for arrays that broadcast."""
    free = "x" if log_x is None else "y" if log_y is None else ""
    known = [log for log in (log_x, log_y) if log is not None]
    return _evaluate(_sheet_stresses(energy, free), *known, *entries)


@np.errstate(all="ignore")  # a radius may be NaN, or so large that the stress overflows
def _evaluate(function: Any, *inputs: Any) -> list[Array]:
    """Outputs of a function of vectors at inputs that broadcast."""
    full = np.broadcast_arrays(*inputs)
    starts = range(0, max(full[0].size, 1), PIECE)
    pieces = [function(*(x.flat[start : start + PIECE] for x in full)) for start in starts]
    return [np.concatenate(parts).reshape(full[0].shape) for parts in zip(*pieces, strict=True)]
