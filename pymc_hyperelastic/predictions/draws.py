"""Material and tube of each draw of a posterior."""

from collections.abc import Sequence
from numbers import Real
from typing import Any, NamedTuple, TypedDict, Unpack

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from pymc_hyperelastic.data.plausible import check_plausible_pressures
from pymc_hyperelastic.data.units import mmHg, to_internal
from pymc_hyperelastic.data.validation import Check, check_known
from pymc_hyperelastic.mechanics.layers import Layer, ReferenceLayer, check_geometry
from pymc_hyperelastic.mechanics.strain_energy import StrainEnergy
from pymc_hyperelastic.mechanics.tube import GEOMETRY, inferred_geometry
from pymc_hyperelastic.models.forward import TubeNumbers
from pymc_hyperelastic.models.settings import NamedLayer
from pymc_hyperelastic.predictions.measured import (
    ROUNDING,
    Extrapolated,
    Measured,
    measured_by,
    typical_tests,
    warn_user,
)
from pymc_hyperelastic.predictions.members import Member
from pymc_hyperelastic.predictions.walls import values_by_draw, wall_draws_of
from pymc_hyperelastic.quantities import IN_RESULTS

Array = NDArray[np.float64]

# Radii between the ends of the data.
_RADII = 40


class Draws(NamedTuple):
    """Material and tube of each draw."""

    tube: TubeNumbers
    """Arrays that broadcast to (chain, draw, 1)."""
    coords: dict[str, xr.DataArray]
    typical: dict[str, Any]
    """Geometry, of which what differs between draws has its median.

    The axial stretch may be an array, one for each of the radii or pressures that are asked for.
    """
    inferred: dict[str, float]
    """Medians of what is inferred of the geometry, or of the wall."""
    member: Member
    """Of whom they are."""
    of_class: str | None = None
    """Name of the class, if the result is one of several."""

    @property
    def tests(self) -> xr.Dataset | None:
        """Tests of whom they are, on typical tubes."""
        data = self.member.data
        return None if data is None else typical_tests(data, self.inferred)

    @property
    def measured(self) -> Measured | None:
        """Where the tubes were measured by which the parameters are known, if the result tells."""
        evidence = self.member.evidence
        return None if evidence is None else measured_by(typical_tests(evidence, self.inferred))

    @property
    def without_force(self) -> bool:
        """Whether no axial force was measured in the tests that the parameters come from."""
        evidence = self.member.evidence
        if evidence is None:
            return False  # nobody knows
        return "axial_force" not in evidence or bool(evidence["axial_force"].isnull().all())

    def at_each_stretch(self, points: Array) -> Array:
        """Radii or pressures, as many as axial stretches are given; one is that at all of them.

        Raises
        ------
        ValueError
            If there are as many as several of both, but not as many of one as of the other.
        """
        count = np.size(self.typical["axial_stretch"])
        if points.size == 1 and count > 1:
            return np.full(count, points[0])
        self._check_stretches(points)
        return points

    def _check_stretches(self, points: Array) -> None:
        count = np.size(self.typical["axial_stretch"])
        if count not in (1, points.size):
            raise ValueError(
                f"axial_stretch has {count} values, and there are {points.size} radii or "
                "pressures: expected one value, or one for each of these"
            )

    def radius_at(self, pressure: Array) -> Array:
        """Internal radius (chain, draw, pressure) on the rising branch; NaN and a warning if none.

        Raises
        ------
        ValueError
            If no draw reaches any of the pressures.
        """
        self._check_stretches(pressure)
        radius = self.tube.radius_at(pressure)
        several = np.size(self.typical["axial_stretch"]) > 1
        _report_unreached(radius, pressure, several, self.of_class)
        return radius

    def extrapolated_radii(self, radius: Array) -> Extrapolated | None:
        """Which internal radii are beyond what was measured; None if the result does not tell."""
        self._check_stretches(radius)
        measured = self.measured
        if measured is None:
            return None
        return measured.at_radii(radius, self.typical)._replace(of_class=self.of_class)

    def extrapolated_pressures(
        self, pressure: Array, radius: Array, unit: str
    ) -> Extrapolated | None:
        """Which pressures, given in a unit, and with these radii, are beyond what was measured."""
        measured = self.measured
        if measured is None:
            return None
        # Draws that do not reach a pressure would have to be inflated further than the others.
        median = np.median(np.where(np.isnan(radius), np.inf, radius), axis=(0, 1))
        found = measured.at_pressures(pressure, median, self.typical, unit)
        return found._replace(of_class=self.of_class)

    def dataset(
        self, axes: dict[str, Array], extrapolated: Extrapolated | None = None, **variables: Array
    ) -> xr.Dataset:
        """Label arrays of the dimensions chain, draw and those of `axes`.

        Along the first of `axes` the points are `extrapolated`, or not, and at axial stretches of
        their own if several are given.
        """
        dims = ("chain", "draw", *axes)
        values = {name: (dims, value) for name, value in variables.items()}
        coords: dict[str, Any] = {**self.coords, **axes}
        if extrapolated is not None:
            coords["extrapolated"] = next(iter(axes)), extrapolated.points
        if axes and np.ndim(self.typical["axial_stretch"]):
            coords["axial_stretch"] = next(iter(axes)), self.typical["axial_stretch"]
        result = xr.Dataset(values, coords)
        if self.member.name is not None:
            result.attrs["specimen"] = self.member.name
        for name in set(result.variables) & set(IN_RESULTS):
            result[name].attrs = IN_RESULTS[name].attributes
        return result


class GivenTube(TypedDict, total=False):
    """What a caller may say of the tube, where the result does not, or something else is meant."""

    energy: StrainEnergy | Sequence[Layer] | None
    specimen: str | None
    inner_radius: float | None
    outer_radius: float | None
    axial_stretch: float | Sequence[float] | NDArray[np.float64] | None
    """One for all points, or one for each."""
    opening_angle: float | None
    radius_unit: str
    """Of all radii that are given."""


def draws_of(tree: xr.DataTree, **tube: Unpack[GivenTube]) -> Draws:
    """Material and tube by draw: as given, else as inferred, else that of the data."""
    strangers = [name for name in tube if name not in GivenTube.__annotations__]
    if strangers:
        raise TypeError(
            f"{strangers[0]!r} is no property of a tube; expected {list(GivenTube.__annotations__)}"
        )
    wall, member, values = wall_draws_of(tree, tube.get("energy"), tube.get("specimen"))
    posterior = member.posterior
    layered = "thickness" in wall[0].values
    given = _given_geometry(**tube)
    if layered and "outer_radius" in given:
        raise ValueError("outer_radius cannot be given with layers: each has its own thickness")
    names = _inferred_measures(posterior, layered)
    inferred = {k: values_by_draw(posterior, k) for k in names if k not in given}
    medians = {name: float(np.median(values_by_draw(posterior, name))) for name in names}
    if layered:
        thickness = np.sum(np.broadcast_arrays(*(v["thickness"] for v in values)), axis=0)
        inferred["thickness"], medians["thickness"] = thickness, float(np.median(thickness))
    geometry = _geometry(member.data, inferred, given)
    typical = _geometry(member.data, medians, given)
    return Draws(
        TubeNumbers(_layers(wall, values, geometry), geometry),
        {name: posterior[name] for name in ("chain", "draw")},
        {name: v.item() if v.size == 1 else v.ravel() for name, v in typical.items()},
        medians,
        member,
        tree.name,
    )


def _layers(
    wall: list[NamedLayer], values: list[dict[str, Array]], geometry: dict[str, Array]
) -> list[ReferenceLayer]:
    """The layers of tubes, one around the other."""
    layers = []
    inner = geometry["inner_radius"]
    for layer, of_layer in zip(wall, values, strict=True):
        outer = geometry["outer_radius"]
        if "thickness" in of_layer:
            check_geometry(thickness=of_layer["thickness"])
            outer = inner + of_layer["thickness"]
        parameters = {name: of_layer[name] for name in layer.energy.parameter_names}
        layers.append(ReferenceLayer(layer.energy, inner, outer, layer.energy.split(parameters)))
        inner = outer
    return layers


def _given_geometry(**tube: Unpack[GivenTube]) -> dict[str, Any]:
    """What is given of the geometry, in mm and rad."""
    given: dict[str, Any] = {k: v for k, v in tube.items() if k in GEOMETRY and v is not None}
    for name, value in given.items():
        if name == "axial_stretch" and not isinstance(value, Real):
            given[name] = checked_numbers(name, value, "axial stretches, one for each point")
        elif not isinstance(value, Real):
            raise TypeError(f"{name} is {value!r}; expected a number")
        if name in ("inner_radius", "outer_radius"):
            given[name] = float(_millimetres(value, **tube))
    return given


def _millimetres(radius: Any, **tube: Unpack[GivenTube]) -> Array:
    unit = tube.get("radius_unit", "mm")
    return to_internal(radius, unit, "length", keyword="radius_unit")


def _inferred_measures(posterior: xr.Dataset, layered: bool) -> list[str]:
    """What is inferred of the tube; of measures of its wall one, which gives the outer radius."""
    measures = () if layered else ("outer_radius", "thickness", "wall_area")
    wall = [name for name in measures if name in posterior][:1]
    return [name for name in GEOMETRY if name in posterior and name != "outer_radius"] + wall


def _geometry(
    data: xr.Dataset | None, inferred: dict[str, Any], given: dict[str, Any]
) -> dict[str, Array]:
    """Reference tube: as it is given, else as it was inferred, else that of the data."""
    tube = _common_geometry(data) | inferred | given
    wall = next((name for name in ("thickness", "wall_area") if name in inferred), None)
    if wall and "outer_radius" in given:
        del tube[wall]
    elif wall:
        del tube["outer_radius"]  # that of the data
        check_geometry(**{wall: tube[wall]})
    unknown = [name for name, value in tube.items() if value is None]
    if unknown:
        raise ValueError(_not_one_tube(data, unknown))
    tube = inferred_geometry(tube)
    check_geometry(**tube)
    values = {name: np.asarray(tube[name], float) for name in GEOMETRY}
    # What is given as a list is by points, the last axis.
    return {n: v[None, None] if v.ndim == 1 else np.atleast_3d(v) for n, v in values.items()}


def _not_one_tube(data: xr.Dataset | None, unknown: list[str]) -> str:
    """What is not known of a tube, or differs between tests, and how to say which is meant."""
    none = np.array([])
    tubes = {name: none if data is None else np.unique(data[name].values) for name in unknown}
    measured = {
        k: list(dict.fromkeys(f"{x:.6g}" for x in v if np.isfinite(x))) for k, v in tubes.items()
    }
    found = [
        f"{k} ({', '.join(v[:4] + ['...'] * (len(v) > 4)) or 'unknown'})"
        for k, v in measured.items()
    ]
    say = ", ".join(f"{k}={v[0] if v else '...'}" for k, v in measured.items())
    message = f"the result's data do not have one {', one '.join(found)}: say which, such as {say}"
    # Other tests of a specimen may be at another stretch, but are on the same tube.
    names = [] if data is None else list(dict.fromkeys(data["specimen"].values.tolist()))
    if len(names) > 1:
        message += f", or whose tube it is, such as specimen={names[0]!r}"
    return f"{message}; in a figure tube={{{unknown[0]!r}: ...}}"


def _common_geometry(data: xr.Dataset | None) -> dict[str, Any]:
    """Geometry that all tests of the data share, up to rounding errors; None where they differ."""
    default: dict[str, Any] = dict.fromkeys(GEOMETRY)
    default |= {"axial_stretch": 1.0, "opening_angle": 0.0}
    if data is None:
        return default
    values = {name: data[name].values.ravel() for name in default}
    return {
        name: float(v[0])
        if np.isfinite(v[0]) and np.isclose(v, v[0], rtol=ROUNDING, atol=0).all()
        else None
        for name, v in values.items()
    }


def checked_numbers(name: str, values: Any, expected: str) -> Array:
    """A list of finite numbers, or one, as an array."""
    try:
        numbers = np.atleast_1d(np.asarray(values, float))
    except (TypeError, ValueError):
        numbers = np.array([])
    if numbers.ndim != 1 or not numbers.size or not np.all(np.isfinite(numbers)):
        raise ValueError(f"{name} must be a list of {expected}; got {values!r}")
    return numbers


def checked_pressures(pressure: Any, unit: str, check: Check) -> Array:
    """Pressures in some unit as an array, kPa; those that no tube is inflated to are doubted."""
    pressures = to_internal(
        checked_numbers("pressure", pressure, f"pressures in {unit}"), unit, "pressure"
    )
    check_known(check)
    check_plausible_pressures(pressures, check)
    return pressures


def checked_radii(internal_radius: Any, **tube: Unpack[GivenTube]) -> Array:
    """A list of radii, in the unit of those of the tube, as an array, mm."""
    expected = f"positive radii in {tube.get('radius_unit', 'mm')}"
    radii = checked_numbers("internal_radius", internal_radius, expected)
    if not np.all(radii > 0):
        raise ValueError(f"internal_radius must be a list of {expected}; got {internal_radius!r}")
    return _millimetres(radii, **tube)


def radii_of_data(data: xr.Dataset | None) -> Array:
    """Radii between the ends of the data, mm."""
    measured = np.array([]) if data is None else data["radius"].values
    measured = measured[np.isfinite(measured)]
    if not measured.size:
        raise ValueError("the result holds no radii: say at which to look, internal_radius=...")
    return np.linspace(measured.min(), measured.max(), _RADII)


def _report_unreached(
    radius: Array, pressure: Array, several_stretches: bool, of_class: str | None
) -> None:
    """Warn of pressures that some draws do not reach; raise if none reaches any."""
    unreached = np.isnan(radius)
    where = "on the rising branch of the curve, see ph.radius_at_pressure"
    whose = f"class {of_class!r}: " if of_class else ""
    names = [f"{p:g} kPa ({p / mmHg:.4g} mmHg)" for p in pressure]
    if unreached.all():
        wanted = ", ".join(dict.fromkeys(names))
        raise ValueError(f"{whose}no draw reaches a pressure of {wanted} {where}")
    count = unreached.sum(axis=(0, 1))
    if not count.any():
        return
    if several_stretches:
        missed = f"{unreached.any(axis=-1).sum()} do not reach the pressure at "
        missed += f"{(count > 0).sum()} of {count.size} axial stretches"
    else:
        missed = ", ".join(
            f"{n} do not reach {name}" for name, n in zip(names, count, strict=True) if n
        )
    draws = radius[..., 0].size
    warn_user(f"{whose}of {draws} draws {missed} {where}; the values are NaN there")
