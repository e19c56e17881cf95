"""Compute the in vivo axial stretch, and the change of stored energy, between two pressures.

:func:`~pymc_hyperelastic.tube_properties` calls :func:`between_pressures`. The in vivo stretch is
that at which the reduced axial force is equal at both pressures.
"""

import numpy as np
import xarray as xr
from numpy.typing import NDArray
from scipy.optimize import elementwise

from pymc_hyperelastic.data.validation import Check
from pymc_hyperelastic.models.forward import TubeNumbers
from pymc_hyperelastic.predictions.conditions import Conditions
from pymc_hyperelastic.predictions.draws import Array, Draws
from pymc_hyperelastic.predictions.measured import Extrapolated, warn_user, warned
from pymc_hyperelastic.rounding import ROUNDING

# Axial stretches that bracket the in vivo stretch. Neighbours are so close that a change of sign
# between them is a single root. The ends are stated in the docstring of tube_properties.
_STRETCHES = np.geomspace(0.8, 2.5, 9)


def between_pressures(draws: Draws, at: Conditions, check: Check) -> xr.Dataset:
    """Return in vivo stretch and change of stored energy (kPa) between two pressures.

    If the result has data, the scalar coordinates ``range_extrapolated`` and
    ``in_vivo_extrapolated`` flag extrapolation, with a warning. Draws without an in vivo stretch,
    and data without an axial force, also cause warnings.
    """
    pressure, unit = draws.at_each_stretch(at.range_in_kilopascal(check)), at.pressure_unit
    radius = draws.radius_at(pressure)
    stored = draws.tube.wall_means(radius).energy
    stretch = in_vivo_stretch(draws.tube, pressure)
    result = draws.dataset(
        {}, stored_energy_change=stored[..., 1] - stored[..., 0], in_vivo_axial_stretch=stretch
    )
    undefined = np.isnan(stretch)
    result["in_vivo_axial_stretch"].attrs["draws_without"] = int(undefined.sum())
    ends = dict(zip(("diastolic_pressure", "systolic_pressure"), at.pressure_range, strict=True))
    for name in result:
        result[name].attrs |= ends | {"pressure_unit": unit}
    _report(undefined, pressure, draws.without_force)
    flags = {"range_extrapolated": warned(draws.extrapolated_pressures(pressure, radius, unit))}
    if not undefined.all():
        flags["in_vivo_extrapolated"] = _extrapolated(draws, pressure, stretch, unit)
    coords = {name: bool(flag.points.any()) for name, flag in flags.items() if flag is not None}
    return result.assign_coords(coords)


def _report(undefined: NDArray[np.bool_], pressure: Array, without_force: bool) -> None:
    """Warn of draws without an in vivo stretch, and of data without an axial force."""
    if undefined.any():
        (low, high), (diastole, systole) = _STRETCHES[[0, -1]], pressure
        warn_user(
            f"of {undefined.size} draws {undefined.sum()} have no in vivo axial stretch from "
            f"{low:g} to {high:g}, at which the reduced axial force turns from falling to rising "
            f"between {diastole:.4g} and {systole:.4g} kPa; the values are NaN there"
        )
    if without_force and not undefined.all():
        warn_user(
            "the in vivo axial stretch rests on the strain energy alone: the result's data have no "
            "axial force"
        )


def _extrapolated(draws: Draws, pressure: Array, stretch: Array, unit: str) -> Extrapolated | None:
    """Flag, with a warning, pressures that are extrapolated at the median in vivo stretch."""
    if draws.measured is None:
        return None
    median = float(np.nanmedian(stretch))
    tube = draws.tube.stretched(np.atleast_3d(median))
    at_median = draws._replace(tube=tube, typical=draws.typical | {"axial_stretch": median})
    beyond = at_median.extrapolated_pressures(pressure, tube.radius_at(pressure), unit)
    if beyond is not None and beyond.points.any():
        warn_user(
            "the in vivo axial stretch is extrapolated, and rests on the strain energy alone: "
            f"{beyond.words}"
        )
    return beyond


def in_vivo_stretch(tube: TubeNumbers, pressure: Array) -> Array:
    """Return the smallest axial stretch at which the change of axial force becomes positive.

    The change is that of the reduced axial force from the lower to the higher pressure (kPa): it is
    negative in a shorter tube and positive in a longer one. The result has the shape (chain, draw),
    with NaN for draws without such a stretch.
    """
    draws, shape = _flat(tube)
    count = shape[0] * shape[1]

    def rise(stretch: Array, draw: NDArray[np.intp]) -> Array:
        """Return the change of force of draws at a stretch, divided by the thrust π a² p."""
        stretched = draws.each(lambda value: value[draw]).stretched(stretch[:, None])
        radius = stretched.radius_at(pressure)
        force = stretched.axial_force(radius)
        return (force[:, 1] - force[:, 0]) / (np.pi * radius[:, 1] ** 2 * pressure[1])

    falls, rises = np.full(count, np.nan), np.full(count, np.nan)
    active = np.arange(count)
    for stretch in _STRETCHES:
        by = rise(np.full(active.size, stretch), active)
        crossed = (by > ROUNDING) & np.isfinite(falls[active])
        rises[active[crossed]] = stretch
        falls[active[by < -ROUNDING]] = stretch
        falls[active[np.isnan(by)]] = np.nan
        active = active[~crossed]
    found, bracketed = np.full(count, np.nan), np.flatnonzero(np.isfinite(rises))
    if bracketed.size:
        root = elementwise.find_root(
            lambda stretch, draw: rise(stretch, draw.astype(int)),
            (falls[bracketed], rises[bracketed]),
            args=(bracketed,),
            tolerances={"xrtol": ROUNDING},
        )
        # A force that jumps through zero has no root: the change does not become small there.
        is_root = root.success & (np.abs(root.f_x) < 1e-6)
        found[bracketed] = np.where(is_root, root.x, np.nan)
    return found.reshape(shape)


def _flat(tube: TubeNumbers) -> tuple[TubeNumbers, tuple[int, int]]:
    """Return the tubes with shape (chain·draw, 1), and the numbers of chains and draws."""
    entries = [np.shape(entry) for layer in tube.layers for entry in layer.entries]
    geometry = [np.shape(value) for value in tube.geometry.values()]
    chains, draws, _ = np.broadcast_shapes(*geometry, *entries)
    flat = tube.each(lambda value: np.broadcast_to(value, (chains, draws, 1)).reshape(-1, 1))
    return flat, (chains, draws)
