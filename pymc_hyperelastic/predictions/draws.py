"""Material and tube of each draw of a posterior."""

import warnings
from collections.abc import Sequence
from numbers import Real
from typing import Any, NamedTuple, TypedDict, Unpack

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from pymc_hyperelastic.data.doubt import Check, check_known
from pymc_hyperelastic.data.plausible import check_plausible_pressures
from pymc_hyperelastic.evidence.results import check_result
from pymc_hyperelastic.mechanics.layers import check_energy, check_geometry
from pymc_hyperelastic.mechanics.strain_energy import StrainEnergy
from pymc_hyperelastic.mechanics.tube import GEOMETRY, inferred_geometry
from pymc_hyperelastic.models.forward import TubeNumbers
from pymc_hyperelastic.models.study import inflation_data_of, strain_energy_of

Array = NDArray[np.float64]

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
    """Material and tube of each draw."""

    tube: TubeNumbers
    """Arrays that broadcast to (chain, draw, 1)."""
    coords: dict[str, xr.DataArray]

    def radius_at(self, pressure: Array) -> Array:
        """Internal radius (chain, draw, pressure) on the rising branch; NaN and a warning if none.

        Raises
        ------
        ValueError
            If no draw reaches any of the pressures.
        """
        radius = self.tube.radius_at(pressure)
        _report_unreached(radius, pressure)
        return radius

    def dataset(self, axes: dict[str, Array], **variables: Array) -> xr.Dataset:
        """Label arrays of the dimensions chain, draw and those of `axes`."""
        dims = ("chain", "draw", *axes)
        values = {name: (dims, value) for name, value in variables.items()}
        result = xr.Dataset(values, {**self.coords, **axes})
        for name in set(result.variables) & set(_NAMES):
            units, long_name = _NAMES[name]
            result[name].attrs = {"units": units, "long_name": long_name}
        return result


class GivenTube(TypedDict, total=False):
    """What a caller may say of the tube, where the result does not, or something else is meant."""

    energy: StrainEnergy | None
    inner_radius: float | None
    outer_radius: float | None
    axial_stretch: float | None
    opening_angle: float | None


def draws_of(tree: xr.DataTree, **tube: Unpack[GivenTube]) -> Draws:
    """Material and tube by draw: as given, else as inferred, else that of the data."""
    check_result(tree)
    strangers = [name for name in tube if name not in GivenTube.__annotations__]
    if strangers:
        raise TypeError(
            f"{strangers[0]!r} is no property of a tube; expected {list(GivenTube.__annotations__)}"
        )
    energy = tube.get("energy")
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
    given = {name: value for name, value in tube.items() if name in GEOMETRY}
    geometry = _geometry_of(tree, posterior, given)
    return Draws(TubeNumbers(energy, geometry, energy.split(parameters)), coords)


def _geometry_of(
    tree: xr.DataTree, posterior: xr.Dataset, given: dict[str, Any]
) -> dict[str, Array]:
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


def checked_pressures(pressure: Any, check: Check, *, stacklevel: int) -> Array:
    """A list of pressures as an array; those that no tube is inflated to are doubted."""
    pressures = checked_numbers("pressure", pressure, "pressures in kPa")
    check_known(check)
    check_plausible_pressures(pressures, check, stacklevel=stacklevel + 1)
    return pressures


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
