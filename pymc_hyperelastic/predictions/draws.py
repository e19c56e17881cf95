"""Material and tube of each draw of a posterior, and what follows for all draws at once."""

import warnings
from collections.abc import Sequence
from functools import cache
from numbers import Real
from typing import Any, NamedTuple

import numpy as np
import pytensor
import pytensor.tensor as pt
import xarray as xr
from numpy.typing import NDArray

from pymc_hyperelastic.data.inflation import GEOMETRY
from pymc_hyperelastic.mechanics.layers import check_energy
from pymc_hyperelastic.mechanics.pressure import PressureIntegral, check_geometry
from pymc_hyperelastic.mechanics.strain_energy import StrainEnergy
from pymc_hyperelastic.mechanics.tube import (
    current_radius,
    hoop_elongation,
    inferred_geometry,
    opening_factor,
)
from pymc_hyperelastic.models.results import check_result, inflation_data_of, strain_energy_of

__all__ = [
    "Draws",
    "Wall",
    "checked_numbers",
    "checked_radii",
    "draws_of",
    "radii_of_data",
    "radius_at",
    "wall_of",
]

Array = NDArray[np.float64]

# A curve is followed in steps of the logarithm of the radius, so short that none leaps over a
# maximum and the minimum beyond it, and no further than 20 times the radius at which it starts.
_STEP, _FARTHEST = 0.05, np.log(20.0)
# Newton's method squares its error: a step of this size leaves one below rounding. An interval that
# is shorter than the second number without such a step holds the end of the branch.
_NEWTON_STEP, _NO_LENGTH = 1e-9, 1e-13
# Points that are integrated together: their arrays stay in the processor's cache.
_PIECE = 4096
# Radii between the ends of the data.
_RADII = 40

# What a result holds: unit, name for people.
_NAMES = {
    "pressure": ("kPa", "pressure"),
    "stiffness": ("kPa/mm", "stiffness"),
    "axial_force": ("mN", "reduced axial force"),
    "radius": ("mm", "internal radius"),
    "outer_radius": ("mm", "current outer radius"),
    "compliance": ("mm2/kPa", "area compliance"),
    "distensibility": ("1/kPa", "area distensibility"),
    "peterson_modulus": ("kPa", "Peterson's elastic modulus"),
    "incremental_modulus": ("kPa", "incremental elastic modulus"),
    "pulse_wave_velocity": ("m/s", "pulse wave velocity"),
    "sigma_rr": ("kPa", "radial Cauchy stress"),
    "sigma_tt": ("kPa", "hoop Cauchy stress"),
    "sigma_zz": ("kPa", "axial Cauchy stress"),
    "position": ("1", "place in the reference wall, 0 inside to 1 outside"),
    "current_radius": ("mm", "current radius of the place in the wall"),
}


class Draws(NamedTuple):
    """Material and tube of each draw: arrays that broadcast to (chain, draw, 1)."""

    energy: StrainEnergy
    geometry: dict[str, Array]
    """By the names of GEOMETRY, in their order."""
    entries: list[Array]
    coords: dict[str, xr.DataArray]

    def with_axis(self) -> "Draws":
        """The same with one axis more, for places in the wall."""
        geometry = {name: value[..., None] for name, value in self.geometry.items()}
        entries = [entry[..., None] for entry in self.entries]
        return self._replace(geometry=geometry, entries=entries)

    def integrate(self, kind: Any, radius: Any, **other: Any) -> list[Array]:
        """Outputs of an integral over the wall at internal radii, or over the wall of `other`."""
        function = _integral(kind, self.energy)
        return _evaluate(function, radius, *(self.geometry | other).values(), *self.entries)

    def dataset(self, axes: dict[str, Array], **variables: Array) -> xr.Dataset:
        """Label arrays of the dimensions chain, draw and those of `axes`."""
        dims = ("chain", "draw", *axes)
        values = {name: (dims, value) for name, value in variables.items()}
        result = xr.Dataset(values, {**self.coords, **axes})
        for name in set(result.variables) & set(_NAMES):
            units, long_name = _NAMES[name]
            result[name].attrs = {"units": units, "long_name": long_name}
        return result


def draws_of(tree: xr.DataTree, energy: StrainEnergy | None, tube: Sequence[Any]) -> Draws:
    """Material and tube by draw; `tube` is what the caller gives of GEOMETRY, else None."""
    check_result(tree)
    if "posterior" not in tree.children:
        raise ValueError(
            f"the result has no posterior; its groups are {sorted(tree.children)} (of a class: "
            "classes['C1'] in place of classes)"
        )
    if isinstance(energy, Sequence):
        raise TypeError(
            "predictions are for a wall of one material, energy=ph.Ogden(); for a wall of layers "
            "give the draws to ph.inflation_pressure"
        )
    energy = energy or strain_energy_of(tree)
    check_energy(energy)
    posterior = tree["posterior"].to_dataset()
    lacking = [name for name in energy.parameter_names if name not in posterior]
    if lacking:
        raise ValueError(f"the posterior lacks {lacking}, parameters of {energy.name}")
    parameters = {p.name: _values(posterior, p.name, p.size) for p in energy.parameters}
    coords = {name: posterior[name] for name in ("chain", "draw")}
    geometry = _geometry_of(tree, posterior, dict(zip(GEOMETRY, tube, strict=True)))
    return Draws(energy, geometry, energy.split(parameters), coords)


def _geometry_of(
    tree: xr.DataTree, posterior: xr.Dataset, given: dict[str, Any]
) -> dict[str, Array]:
    """The tube by draw: as given, else as inferred, else that of the data."""
    given = {name: value for name, value in given.items() if value is not None}
    for name, value in given.items():
        if not isinstance(value, Real):
            raise TypeError(f"{name} is {value!r}; expected a number")
    inferred = [name for name in GEOMETRY if name in posterior and name not in given]
    tube = _common_geometry(tree) | given | {name: _values(posterior, name) for name in inferred}
    wall = next((name for name in ("thickness", "wall_area") if name in posterior), None)
    if wall and not {"outer_radius"} & {*given, *inferred}:
        del tube["outer_radius"]  # it is that of the data
        tube[wall] = _values(posterior, wall)
        check_geometry(**{wall: tube[wall]})
    unknown = [name for name, value in tube.items() if value is None]
    if unknown:
        raise ValueError(
            f"the result's data do not have one {' and one '.join(unknown)}: give what is meant, "
            f"{', '.join(name + '=...' for name in unknown)}"
        )
    tube = inferred_geometry(tube)
    check_geometry(**tube)
    return {name: np.atleast_3d(np.asarray(tube[name], float)) for name in GEOMETRY}


def _common_geometry(tree: xr.DataTree) -> dict[str, Any]:
    """Geometry that all tests of the result's data share; None where they differ."""
    default: dict[str, Any] = dict.fromkeys(GEOMETRY)
    default |= {"axial_stretch": 1.0, "opening_angle": 0.0}
    if "constant_data" not in tree.children:
        return default
    data = inflation_data_of(tree)
    values = {name: np.unique(data[name].values) for name in default}
    return {
        name: float(value[0]) if value.size == 1 and np.isfinite(value[0]) else None
        for name, value in values.items()
    }


def _values(posterior: xr.Dataset, name: str, size: int | None = None) -> Array:
    """Draws of a number by (chain, draw, 1), of a vector by (chain, draw, 1, entry)."""
    variable = posterior[name]
    if size is None:
        single = [d for d in variable.dims if d not in ("chain", "draw") and variable.sizes[d] == 1]
        variable = variable.squeeze(single)
    rest = [d for d in variable.dims if d not in ("chain", "draw")]
    if variable.ndim - len(rest) != 2 or len(rest) != (size is not None):
        raise ValueError(
            f"{name!r} of the posterior has the dimensions {variable.dims}; expected chain and draw"
            + (f" and that of its {size} entries" if size else ": select one of each other")
        )
    return variable.transpose("chain", "draw", *rest).values.astype(float)[:, :, None]


def checked_numbers(name: str, values: Any, expected: str) -> Array:
    """A list of finite numbers, or one, as an array."""
    try:
        numbers = np.atleast_1d(np.asarray(values, float))
    except (TypeError, ValueError):
        numbers = np.array([])
    if numbers.ndim != 1 or not numbers.size or not np.all(np.isfinite(numbers)):
        raise ValueError(f"{name} must be a list of {expected}; got {values!r}")
    return numbers


def checked_radii(internal_radius: Any) -> Array:
    """A list of radii as an array."""
    radii = checked_numbers("internal_radius", internal_radius, "positive radii in mm")
    if not np.all(radii > 0):
        raise ValueError(
            f"internal_radius must be a list of positive radii in mm; got {internal_radius!r}"
        )
    return radii


def radii_of_data(tree: xr.DataTree) -> Array:
    """Radii between the ends of the data."""
    group = tree.children.get("constant_data", {})
    measured = group["radius"].values if "radius" in group else np.array([])
    measured = measured[np.isfinite(measured)]
    if not measured.size:
        raise ValueError("the result holds no radii: say at which to look, internal_radius=...")
    return np.linspace(measured.min(), measured.max(), _RADII)


# --- calculations for all draws at once ----------------------------------------------------------


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


class Wall(NamedTuple):
    """Circles of the wall: radii, stretches and stress differences by (chain, draw, ..., place)."""

    reference: Array
    current: Array
    log_hoop: Array
    log_axial: Array
    hoop_difference: Array
    axial_difference: Array


def wall_of(draws: Draws, radius: Array, position: Array) -> Wall:
    """State of the wall at internal radii, whose last axis is that of the places."""
    inner, outer, axial, angle = draws.geometry.values()
    tube = {"inner_radius": inner, "axial_stretch": axial, "opening_angle": angle}
    reference = inner + position * (outer - inner)
    delta = hoop_elongation(radius, reference, **tube)
    log_hoop = (np.log(opening_factor(angle) / axial) + np.log1p(delta)) / 2
    log_axial = np.broadcast_to(np.log(axial), log_hoop.shape)
    differences = _evaluate(_stress_differences(draws.energy), log_hoop, log_axial, *draws.entries)
    current = current_radius(reference, radius, **tube)
    return Wall(reference, current, log_hoop, log_axial, *differences)


def radius_at(draws: Draws, pressure: Array) -> Array:
    """Internal radius (chain, draw, pressure) on the rising branch; NaN, with a warning, if none.

    Newton's method in the logarithm of the radius. It starts at ``a₀`` and moves along the branch
    in short steps until the pressure has been passed, or the slope is no longer positive; from then
    on it stays between the last place before that and the first one after.
    """
    full = np.broadcast_arrays(pressure, *draws.geometry.values(), *draws.entries)
    target, *inputs = (np.ravel(x) for x in full)
    inner, _, axial, angle = inputs[:4]
    start = inner / np.sqrt(opening_factor(angle) * axial)
    curve = _integral(PressureIntegral, draws.energy)
    way = np.sign(target - _evaluate(curve, start, *inputs)[0])
    # Places are |ln(a/a₀)|: the last before the end, the first beyond it, the next to look at.
    before, beyond, place = np.zeros_like(start), np.full_like(start, np.inf), np.zeros_like(start)
    lacking_before = np.full_like(start, np.inf)
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
    result = found.reshape(full[0].shape)
    _report_unreached(result, pressure)
    return result


def _report_unreached(radius: Array, pressure: Array) -> None:
    """Warn of pressures that some draws do not reach; raise if none reaches any."""
    unreached = np.isnan(radius)
    where = "on the rising branch of the curve, see ph.radius_at_pressure"
    if unreached.all():
        wanted = ", ".join(f"{p:g}" for p in pressure)
        raise ValueError(f"no draw reaches a pressure of {wanted} kPa {where}")
    count = unreached.sum(axis=(0, 1))
    if count.any():
        missed = ", ".join(
            f"{n} do not reach {p:g} kPa" for p, n in zip(pressure, count, strict=True) if n
        )
        warnings.warn(
            f"of {radius[..., 0].size} draws {missed} {where}; the values are NaN there",
            stacklevel=4,
        )
