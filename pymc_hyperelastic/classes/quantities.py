"""Coordinates, parameters and tube properties of specimens, for draws of a class's distribution.

:func:`~pymc_hyperelastic.compare_classes` and :func:`~pymc_hyperelastic.plan_study` use them.
"""

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray
from scipy import linalg, stats

from pymc_hyperelastic.classes.hierarchical import HierarchicalClass
from pymc_hyperelastic.data.select import specimens_apart
from pymc_hyperelastic.data.sheets import tubes_of
from pymc_hyperelastic.mechanics.reference_tube import Tube
from pymc_hyperelastic.mechanics.tube import GEOMETRY
from pymc_hyperelastic.models.settings import has_layers, inflation_data_of, named_layers
from pymc_hyperelastic.predictions.conditions import Conditions, as_conditions
from pymc_hyperelastic.predictions.measured import Extrapolated, beyond_pressures, warned
from pymc_hyperelastic.predictions.members import SEED, posterior_of
from pymc_hyperelastic.predictions.properties import tube_properties
from pymc_hyperelastic.quantities import IN_RESULTS, unit_text

Array = NDArray[np.float64]

#: Share of specimens without a quantity, or that cannot bear a test, above which there is a
#: warning.
MOST_LACKING = 0.005
# Number of materials whose properties are computed in one batch, to limit the memory.
_BATCH_SIZE = 20_000
# Properties of a tube by which classes can be compared.
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
    "axial_force",
    "axial_stress",
    "circumferential_material_stiffness",
    "axial_material_stiffness",
    "stored_energy",
    "stored_energy_change",
    "in_vivo_axial_stretch",
)
# Prefix of a name that takes the logarithm of the quantity.
_LOG_PREFIX = "log "
# Properties that depend on two pressures, the `pressure_range`.
BETWEEN_PRESSURES = ("stored_energy_change", "in_vivo_axial_stretch")


def standard_specimens(size: int, count: int) -> Array:
    """Return standard normal coordinates of the typical specimen and of `count` other specimens.

    The shape is (1 + count, size). The first row, of the typical specimen, is 0. The others are a
    Latin hypercube sample with mean 0. If `count` exceeds ``size + 1``, they are transformed so
    that their covariance matrix is the identity.
    """
    cube = stats.qmc.LatinHypercube(size, scramble=False, optimization="random-cd", rng=SEED)
    points = stats.norm.ppf(cube.random(count))
    points -= points.mean(axis=0)
    if count > size + 1:
        factor = np.linalg.cholesky(np.cov(points.T, ddof=0).reshape(size, size))
        points = linalg.solve_triangular(factor, points.T, lower=True).T
    return np.concatenate([np.zeros((1, size)), points])


def known_quantities(kind: HierarchicalClass) -> list[str]:
    """Return the names of coordinates, parameters and properties of specimens of a class."""
    return [*kind.scale.names, *parameters_of(kind), *PROPERTIES]


def parameters_of(kind: HierarchicalClass) -> list[str]:
    """Return the names of the parameters, one for each entry, such as ``"mu[0]"``."""
    values = kind.scale.numbers([np.zeros(1) for _ in kind.scale.names])
    return [
        f"{name}[{i}]" if value.ndim > 1 else name
        for name, value in values.items()
        for i in range(value.shape[1] if value.ndim > 1 else 1)
    ]


def unit_of(name: str, kind: HierarchicalClass) -> str | None:
    """Return the unit of a quantity or of its logarithm; None if the name is unknown."""
    bare = name.removeprefix(_LOG_PREFIX)
    if bare not in known_quantities(kind):
        return None
    if bare != name or bare in kind.scale.names:
        return "1"
    if bare in PROPERTIES:
        return unit_text(IN_RESULTS[bare].unit)
    units = [layer.units for layer in named_layers(kind.scale.wall)]
    return next(of[parameter] for of in units if (parameter := bare.partition("[")[0]) in of)


def is_logarithm(name: str, kind: HierarchicalClass) -> bool:
    """Return True for quantities on a log scale, which have no ratio."""
    return name in kind.scale.names or name.startswith(_LOG_PREFIX)


def values_of(
    kind: HierarchicalClass, coordinates: Array, names: Sequence[str], at: Conditions
) -> dict[str, Array]:
    """Return quantities of specimens by name, each of shape (pressure, draw, specimen).

    `coordinates` has the shape (coordinate, draw, specimen). A quantity is NaN where it does not
    exist, for example where a tube does not reach the pressure.
    """
    shape = (len(at.pressures), *coordinates.shape[1:])
    bare = {name: name.removeprefix(_LOG_PREFIX) for name in names}
    parameters = kind.scale.numbers([*coordinates])
    found = _properties(kind, parameters, [n for n in PROPERTIES if n in bare.values()], at)
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
    kind: HierarchicalClass,
    parameters: Mapping[str, Array],
    wanted: Sequence[str],
    at: Conditions,
) -> dict[str, Array]:
    """Return properties of tubes of these materials, computed in batches of draws."""
    if not wanted:
        return {}
    if not set(wanted) & set(BETWEEN_PRESSURES):
        at = replace(at, pressure_range=None)
    parameters = {name: values.copy() for name, values in parameters.items()}
    draws, specimens = next(iter(parameters.values())).shape[:2]
    entries = [values.reshape(draws, specimens, -1) for values in parameters.values()]
    # Parameters may overflow for extreme draws: properties of such specimens are NaN.
    finite = np.isfinite(np.concatenate(entries, axis=2)).all(axis=2)
    for values in parameters.values():
        values[~finite] = 1.0
    parts = []
    for rows in np.array_split(np.arange(draws), min(draws, -(-finite.size // _BATCH_SIZE))):
        batch = {name: values[rows] for name, values in parameters.items()}
        tree = xr.DataTree.from_dict({"posterior": posterior_of(batch)})
        with warnings.catch_warnings():
            # The caller warns once about all specimens without a property.
            warnings.simplefilter("ignore")
            found = tube_properties(tree, at, energy=kind.energy, check="ignore")
        parts.append({name: _with_pressures(found[name], len(at.pressures)) for name in wanted})
    joined = {name: np.concatenate([part[name] for part in parts], axis=1) for name in wanted}
    return {name: np.where(finite, values, np.nan) for name, values in joined.items()}


def _with_pressures(values: xr.DataArray, count: int) -> Array:
    """Return values of shape (pressure, draw, specimen); repeat those without a pressure axis."""
    if "pressure" not in values.dims:
        values = values.expand_dims(pressure=count)
    return values.transpose("pressure", "chain", "draw").values


def complete_conditions(
    groups: xr.DataTree, names: Sequence[str], at: Any, *, one_pressure: bool = False
) -> Conditions:
    """Return the conditions for these quantities, with all measures of one tube.

    Measures of the tube that are not stated are medians over specimens, each of which is
    represented by the median of its tests. Warns of implausibly large pressures, and of pressures
    that were not measured.

    Raises
    ------
    ValueError
        If a pressure is missing, or several axial stretches are stated, or several pressures in
        place of `one_pressure`.
    """
    at = as_conditions(at)
    bare = [name.removeprefix(_LOG_PREFIX) for name in names]
    between = [name for name in bare if name in BETWEEN_PRESSURES]
    wanted = [name for name in bare if name in PROPERTIES and name not in between]
    if wanted and at.pressure is None:
        raise ValueError(
            f"{wanted[0]} depends on the pressure: give at=..., pressures in kPa, or with their "
            "unit, such as at=ph.Conditions(90, pressure_unit='mmHg')"
        )
    if between and at.pressure_range is None:
        raise ValueError(
            f"{between[0]} depends on two pressures: give "
            "at=ph.Conditions(pressure_range=(diastolic, systolic))"
        )
    if wanted:
        at.in_kilopascal()
    if between:
        at.range_in_kilopascal()
    tubes = [tubes_of(inflation_data_of(fitted)) for fitted in groups.children.values()]
    parts = [part for data in tubes if data is not None for part in specimens_apart(data).values()]
    layered = has_layers(next(iter(groups.children.values())))
    measured = [n for n in GEOMETRY if not (layered and n == "outer_radius")]
    tube: dict[str, Any] = {
        name: float(np.median([np.median(part[name].values) for part in parts]))
        for name in measured
        if parts
    }
    tube |= at.geometry()
    # Sheets have no tube of their own, of which a missing radius is reported later.
    tube = {"axial_stretch": 1.0} | tube
    if np.ndim(tube["axial_stretch"]):
        raise ValueError(f"{at.tube}: expected one axial stretch, at which all are compared")
    at = replace(at, pressure=0.0 if at.pressure is None else at.pressure, tube=Tube(**tube))
    if one_pressure and len(at.pressures) > 1:
        raise ValueError(f"at states the pressures {at.pressures.tolist()}; expected one pressure")
    for found in beyond_measured(groups, names, at).values():
        warned(found)
    return at


def beyond_measured(
    groups: xr.DataTree, names: Sequence[str], at: Conditions
) -> dict[tuple[str, str], Extrapolated]:
    """Flag pressures beyond all that were measured on tubes of a group, by group and property."""
    flags = {}
    for group, fitted in groups.children.items():
        tests = tubes_of(inflation_data_of(fitted))
        for name in names if tests is not None else ():
            bare = name.removeprefix(_LOG_PREFIX)
            if bare in BETWEEN_PRESSURES:
                found = beyond_pressures(at.range_in_kilopascal("ignore"), tests)
                found = found._replace(points=np.full(len(at.pressures), found.points.any()))
            elif bare in PROPERTIES:
                found = beyond_pressures(at.in_kilopascal("ignore"), tests)
            else:
                continue
            flags[group, name] = found._replace(of_class=group)
    return flags
