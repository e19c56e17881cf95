"""Quantities that the specimens of a class have, draw by draw of its distribution."""

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray
from scipy import linalg, stats

from pymc_hyperelastic.classes.variable import Variability
from pymc_hyperelastic.data.select import specimens_apart
from pymc_hyperelastic.mechanics.tube import GEOMETRY
from pymc_hyperelastic.models.settings import has_layers, inflation_data_of
from pymc_hyperelastic.predictions.members import posterior_of
from pymc_hyperelastic.predictions.properties import tube_properties
from pymc_hyperelastic.quantities import IN_RESULTS, unit_text

Array = NDArray[np.float64]

# Of the points of a Latin hypercube that stand for specimens: the same for all draws of classes.
_SEED = 1
# Materials whose properties are found at once.
_AT_ONCE = 20_000
# Properties of a tube that classes are compared by.
PROPERTIES = (
    "radius",
    "outer_radius",
    "stiffness",
    "compliance",
    "distensibility",
    "peterson_modulus",
    "incremental_modulus",
    "pulse_wave_velocity",
    "circumferential_stress",
    "axial_stress",
    "circumferential_material_stiffness",
    "axial_material_stiffness",
    "stored_energy",
    "stored_energy_change",
    "in_vivo_axial_stretch",
)
_LOGARITHM = "log "
BETWEEN_PRESSURES = ("stored_energy_change", "in_vivo_axial_stretch")


@dataclass(frozen=True)
class Place:
    """Where properties are looked at: the tube, and pressures in a unit."""

    tube: Mapping[str, float]
    pressure: Array
    pressure_unit: str
    pressure_range: tuple[float, float] | None
    density: float


def standard_specimens(size: int, count: int) -> Array:
    """Standard normal numbers of the typical specimen, 0, and of so many others: (specimen, size).

    The others are evenly spread in probability, as quantiles of one number are, with the mean 0 and
    the covariance 1 as nearly as so many can have it.
    """
    cube = stats.qmc.LatinHypercube(size, scramble=False, optimization="random-cd", rng=_SEED)
    points = stats.norm.ppf(cube.random(count))
    points -= points.mean(axis=0)
    if count > size + 1:
        factor = np.linalg.cholesky(np.cov(points.T, ddof=0).reshape(size, size))
        points = linalg.solve_triangular(factor, points.T, lower=True).T
    return np.concatenate([np.zeros((1, size)), points])


def known_quantities(kind: Variability) -> list[str]:
    """What can be compared of a class's specimens: coordinates, parameters and properties."""
    values = kind.scale.numbers([np.zeros(1) for _ in kind.scale.names])
    parameters = [
        f"{name}[{i}]" if value.ndim > 1 else name
        for name, value in values.items()
        for i in range(value.shape[1] if value.ndim > 1 else 1)
    ]
    return [*kind.scale.names, *parameters, *PROPERTIES]


def unit_of(name: str, kind: Variability) -> str | None:
    """Unit of a quantity, or of its logarithm; None if there is no such quantity."""
    known = known_quantities(kind)
    bare = name if name in known else name.removeprefix(_LOGARITHM)
    if bare not in known:
        return None
    if bare != name or bare in kind.scale.names:
        return "1"
    return unit_text(IN_RESULTS[bare].unit) if bare in PROPERTIES else ""


def is_logarithm(name: str, kind: Variability) -> bool:
    """Whether a ratio of two of them means nothing."""
    return name in kind.scale.names or name not in known_quantities(kind)


def values_of(
    kind: Variability, coordinates: Array, names: Sequence[str], place: Place
) -> dict[str, Array]:
    """Each quantity (pressure, draw, specimen) of specimens with these coordinates.

    It is NaN where a specimen has none, as of a tube that does not reach the pressure.
    """
    shape = (len(place.pressure), *coordinates.shape[1:])
    known = known_quantities(kind)
    bare = {n: n if n in known else n.removeprefix(_LOGARITHM) for n in names}
    parameters = kind.scale.numbers([*coordinates])
    found = _properties(kind, parameters, [n for n in PROPERTIES if n in bare.values()], place)
    for name in set(bare.values()) - set(found):
        if name in kind.scale.names:
            values = coordinates[kind.scale.names.index(name)]
        else:
            base, _, entry = name.partition("[")
            values = parameters[base][..., int(entry[:-1])] if entry else parameters[base]
        found[name] = np.broadcast_to(values, shape)
    with np.errstate(invalid="ignore", divide="ignore"):
        return {n: found[b] if n == b else np.log(found[b]) for n, b in bare.items()}


def _properties(
    kind: Variability,
    parameters: Mapping[str, Array],
    wanted: Sequence[str],
    place: Place,
) -> dict[str, Array]:
    """Properties of tubes of these materials, some draws of the class's distribution at a time."""
    draws, specimens = next(iter(parameters.values())).shape[:2]
    if not wanted:
        return {}
    step = max(1, _AT_ONCE // specimens)
    settings: dict[str, Any] = dict(place.tube) | {"density": place.density}
    if set(wanted) & set(BETWEEN_PRESSURES):
        settings["pressure_range"] = place.pressure_range
    parts = []
    for start in range(0, draws, step):
        some = {n: v[start : start + step] for n, v in parameters.items()}
        # Numbers that overflow are no material: such specimens have no property.
        entries = [v.reshape(*v.shape[:2], -1) for v in some.values()]
        sound = np.isfinite(np.concatenate(entries, axis=2)).all(axis=2)
        some = {n: np.where(_like(sound, v), v, 1.0) for n, v in some.items()}
        tree = xr.DataTree.from_dict({"posterior": posterior_of(some)})
        with warnings.catch_warnings():
            # What they do not reach is told of all of them together.
            warnings.simplefilter("ignore")
            found = tube_properties(
                tree,
                place.pressure,
                pressure_unit=place.pressure_unit,
                energy=kind.energy,
                check="ignore",
                **settings,
            )
        by_name = {name: _with_pressures(found[name], len(place.pressure)) for name in wanted}
        parts.append({name: np.where(sound, values, np.nan) for name, values in by_name.items()})
    return {name: np.concatenate([p[name] for p in parts], axis=1) for name in wanted}


def _like(sound: NDArray[np.bool_], values: Array) -> NDArray[np.bool_]:
    """Which specimens are sound, for all entries of a parameter."""
    return sound.reshape(*sound.shape, *(1,) * (values.ndim - 2))


def _with_pressures(values: xr.DataArray, count: int) -> Array:
    """By (pressure, draw, specimen), also what is the same at all pressures."""
    if "pressure" not in values.dims:
        values = values.expand_dims(pressure=count)
    return values.transpose("pressure", "chain", "draw").values


def place_of(
    groups: xr.DataTree,
    names: Sequence[str],
    pressure: Any,
    pressure_range: Any,
    pressure_unit: str,
    density: float,
    tube: dict[str, float],
) -> Place:
    """Where the quantities are looked at; the tube is that in the middle of all that were measured.

    Each specimen counts once.
    """
    if pressure is None:
        wanted = [name for name in names if name in PROPERTIES]
        if wanted:
            raise ValueError(f"{wanted[0]} is that of a tube at a pressure: say pressure=...")
        pressure = 0.0
    wanted = [name for name in names if name in BETWEEN_PRESSURES]
    if wanted and pressure_range is None:
        raise ValueError(
            f"{wanted[0]} follows from two pressures: say pressure_range=(diastolic, systolic)"
        )
    parts = [
        part
        for fitted in groups.children.values()
        for part in specimens_apart(inflation_data_of(fitted)).values()
    ]
    layered = has_layers(next(iter(groups.children.values())))
    measured = [n for n in GEOMETRY if not (layered and n == "outer_radius")]
    middle = {
        name: float(np.median([np.median(part[name].values) for part in parts]))
        for name in measured
    }
    return Place(
        middle | tube,
        np.atleast_1d(np.asarray(pressure, float)),
        pressure_unit,
        pressure_range,
        density,
    )
