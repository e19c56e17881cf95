"""What follows from two pressures between which a tube works: its stretch in vivo, its energy."""

import numpy as np
import xarray as xr
from numpy.typing import NDArray
from scipy.optimize import elementwise

from pymc_hyperelastic.models.forward import TubeNumbers
from pymc_hyperelastic.predictions.draws import Array, Draws
from pymc_hyperelastic.predictions.measured import Extrapolated, warn_user, warned

# In vivo stretches are looked for between the ends of these, which are so close to each other that
# a change of sign between neighbours is one.
_STRETCHES = np.geomspace(0.8, 2.5, 9)
# A change of force below this part of the thrust of the pressure is rounding. Laws that say nothing
# of axial force have no other.
_ROUNDING = 1e-9
# Relative error of the stretch, and the change of force that may be left there.
_TOLERANCE, _NO_RISE = 1e-9, 1e-6
# Steps of Newton's method in a radius, the longest of them, and one after which none is needed.
_STEPS, _LARGEST_STEP, _LAST_STEP = 8, 0.1, 1e-6


def between_pressures(draws: Draws, pressure: Array, unit: str) -> xr.Dataset:
    """In vivo stretch, and change of energy, of draws between two pressures given in a unit.

    With the scalar coordinates ``range_extrapolated`` and ``in_vivo_extrapolated``, if the result
    tells what was measured. Warns of both, of draws without an in vivo stretch, and where no axial
    force was measured.
    """
    radius = draws.radius_at(pressure)
    stored = draws.tube.wall_means(radius).energy
    stretch = in_vivo_stretch(draws.tube, pressure)
    result = draws.dataset(
        {},
        stored_energy_change=stored[..., 1] - stored[..., 0],
        in_vivo_axial_stretch=stretch,
    )
    none = np.isnan(stretch)
    result["in_vivo_axial_stretch"].attrs["draws_without"] = int(none.sum())
    ends = dict(zip(("diastolic_pressure", "systolic_pressure"), pressure.tolist(), strict=True))
    for name in result:
        result[name].attrs |= ends
    _report(none, pressure, draws.without_force)
    flags = {"range_extrapolated": warned(draws.extrapolated_pressures(pressure, radius, unit))}
    if not none.all():
        flags["in_vivo_extrapolated"] = _extrapolated(draws, pressure, stretch, unit)
    known = {name: bool(flag.points.any()) for name, flag in flags.items() if flag is not None}
    return result.assign_coords(known)


def _report(none: NDArray[np.bool_], pressure: Array, without_force: bool) -> None:
    """Warn of draws without an in vivo stretch, and of stretches that rest on the law alone."""
    if none.any():
        (low, high), (diastole, systole) = _STRETCHES[[0, -1]], pressure
        warn_user(
            f"of {none.size} draws {none.sum()} have no in vivo axial stretch from {low:g} to "
            f"{high:g}, at which the reduced axial force turns from falling to rising between "
            f"{diastole:.4g} and {systole:.4g} kPa; the values are NaN there"
        )
    if without_force and not none.all():
        warn_user(
            "the in vivo axial stretch rests on the law: no axial force is among the result's data"
        )


def _extrapolated(draws: Draws, pressure: Array, stretch: Array, unit: str) -> Extrapolated | None:
    """Whether the tube was not measured at its median in vivo stretch, and a warning if so."""
    if draws.measured is None:
        return None
    median = float(np.nanmedian(stretch))
    tube = draws.tube.stretched(np.atleast_3d(median))
    at_median = draws._replace(tube=tube, typical=draws.typical | {"axial_stretch": median})
    beyond = at_median.extrapolated_pressures(pressure, tube.radius_at(pressure), unit)
    if beyond is not None and beyond.points.any():
        warn_user(f"the in vivo axial stretch is extrapolated, by the law alone: {beyond.words}")
    return beyond


def in_vivo_stretch(tube: TubeNumbers, pressure: Array) -> Array:
    """Least axial stretch at which the reduced axial force turns from falling to rising.

    By (chain, draw), between a lower and a higher pressure; NaN if there is none. Where the force
    falls, the tube at that length would push; where it rises, pull.
    """
    draws, shape = _flat(tube)
    count = shape[0] * shape[1]
    near = np.full((count, 2), np.nan)

    def rise(stretch: Array, draw: NDArray[np.intp]) -> Array:
        """Rise of force of draws, in parts of the thrust, by radii near the last ones."""
        some = draws.each(lambda value: value[draw]).stretched(stretch[:, None])
        near[draw] = _radius(some, pressure, near[draw])
        return _rise(some, pressure, near[draw])

    falls, rises = np.full(count, np.nan), np.full(count, np.nan)
    active = np.arange(count)
    for stretch in _STRETCHES:
        by = rise(np.full(active.size, stretch), active)
        crossed = (by > _ROUNDING) & np.isfinite(falls[active])
        rises[active[crossed]] = stretch
        falls[active[by < -_ROUNDING]] = stretch
        falls[active[np.isnan(by)]] = np.nan
        active = active[~crossed]
    found, some = np.full(count, np.nan), np.flatnonzero(np.isfinite(rises))
    if some.size:
        root = elementwise.find_root(
            lambda stretch, draw: rise(stretch, draw.astype(int)),
            (falls[some], rises[some]),
            args=(some,),
            tolerances={"xrtol": _TOLERANCE},
        )
        # Radii that were looked for from afar have the last word, and a force that jumps has none.
        there = draws.each(lambda value: value[some]).stretched(root.x[:, None])
        left = np.abs(_rise(there, pressure, there.radius_at(pressure)))
        found[some] = np.where(root.success & (left < _NO_RISE), root.x, np.nan)
    return found.reshape(shape)


def _flat(tube: TubeNumbers) -> tuple[TubeNumbers, tuple[int, int]]:
    """The tubes along one axis, and another of length 1; how many chains and draws there are."""
    entries = [np.shape(entry) for layer in tube.layers for entry in layer.entries]
    geometry = [np.shape(value) for value in tube.geometry.values()]
    chains, draws, _ = np.broadcast_shapes(*geometry, *entries)
    flat = tube.each(lambda value: np.broadcast_to(value, (chains, draws, 1)).reshape(-1, 1))
    return flat, (chains, draws)


def _rise(tube: TubeNumbers, pressure: Array, radius: Array) -> Array:
    """Rise of the reduced axial force between two pressures, in parts of the thrust."""
    force = tube.axial_force(radius)
    return (force[:, 1] - force[:, 0]) / (np.pi * radius[:, 1] ** 2 * pressure[1])


def _radius(tube: TubeNumbers, pressure: Array, near: Array) -> Array:
    """Radii at pressures, by Newton's method from radii near to them; from afar where it fails."""
    radius, step = near, np.full(near.shape, np.nan)
    for _ in range(_STEPS):
        value, slope = tube.pressure(radius)
        with np.errstate(all="ignore"):
            step = np.where(slope > 0, (pressure - value) / (slope * radius), np.nan)
        radius = radius * (1 + np.clip(step, -_LARGEST_STEP, _LARGEST_STEP))
        if not np.any(np.abs(step) > _LAST_STEP):
            break
    lost = ~(np.abs(step) <= _LAST_STEP).all(axis=1)
    if lost.any():
        radius[lost] = tube.each(lambda value: value[lost]).radius_at(pressure)
    return radius
