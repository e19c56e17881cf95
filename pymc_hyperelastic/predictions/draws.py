"""Build the material and the geometry of the tube for each draw of a posterior.

All functions of this folder that predict curves, stresses or properties call :func:`draws_of`.
"""

from collections.abc import Sequence
from numbers import Real
from typing import Any, NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from pymc_hyperelastic.data.units import mmHg
from pymc_hyperelastic.mechanics.layers import Layer, ReferenceLayer, check_geometry
from pymc_hyperelastic.mechanics.reference_tube import WALL, Tube
from pymc_hyperelastic.mechanics.strain_energy import StrainEnergy
from pymc_hyperelastic.mechanics.tube import GEOMETRY, inferred_geometry
from pymc_hyperelastic.models.forward import TubeNumbers
from pymc_hyperelastic.models.settings import NamedLayer
from pymc_hyperelastic.predictions.measured import (
    Extrapolated,
    Measured,
    measured_by,
    typical_tests,
    warn_user,
)
from pymc_hyperelastic.predictions.members import Member
from pymc_hyperelastic.predictions.walls import values_by_draw, wall_draws_of
from pymc_hyperelastic.quantities import IN_RESULTS
from pymc_hyperelastic.rounding import ROUNDING

Array = NDArray[np.float64]


class Draws(NamedTuple):
    """Material and tube of each draw of a posterior."""

    tube: TubeNumbers
    """Arrays that broadcast to (chain, draw, 1)."""
    coords: dict[str, xr.DataArray]
    """Coordinates ``chain`` and ``draw``."""
    typical: dict[str, Any]
    """Geometry (mm, rad), with the median of each measure that differs between draws.

    The axial stretch may be an array, with one value for each radius or pressure of a prediction.
    """
    inferred: dict[str, float]
    """Medians of the inferred measures of the geometry, including the thickness of the wall."""
    member: Member
    """Specimen whose parameters and tests are used."""
    of_class: str | None = None
    """Name of the class, if the result is one of several classes."""

    @property
    def measured(self) -> Measured | None:
        """Measured range of the tests behind the parameters; None if the result has no data."""
        evidence = self.member.evidence
        return None if evidence is None else measured_by(typical_tests(evidence, self.inferred))

    @property
    def without_force(self) -> bool:
        """True if the result has data, and none of them is an axial force."""
        evidence = self.member.evidence
        if evidence is None:
            return False
        return "axial_force" not in evidence or bool(evidence["axial_force"].isnull().all())

    def at_each_stretch(self, points: Array) -> Array:
        """Return radii or pressures, one for each axial stretch; repeat a single one.

        Raises
        ------
        ValueError
            If the numbers of points and axial stretches differ, and both exceed one.
        """
        count = np.size(self.typical["axial_stretch"])
        if points.size > 1 and count not in (1, points.size):
            raise ValueError(
                f"axial_stretch has {count} values, and there are {points.size} radii or "
                "pressures: expected one axial stretch, or one for each radius or pressure"
            )
        return np.broadcast_to(points, max(count, points.size))

    def radius_at(self, pressure: Array) -> Array:
        """Return internal radii (mm), (chain, draw, pressure), on the rising branch of the curve.

        Draws that do not reach a pressure give NaN and a warning.

        Raises
        ------
        ValueError
            If no draw reaches any of the pressures.
        """
        radius = self.tube.radius_at(pressure)
        several = np.size(self.typical["axial_stretch"]) > 1
        _report_unreached(radius, pressure, several, self.of_class)
        return radius

    def extrapolated_radii(self, radius: Array) -> Extrapolated | None:
        """Flag internal radii outside the measured range; None if the result has no data."""
        measured = self.measured
        if measured is None:
            return None
        return measured.at_radii(radius, self.typical)._replace(of_class=self.of_class)

    def extrapolated_pressures(
        self, pressure: Array, radius: Array, unit: str
    ) -> Extrapolated | None:
        """Flag pressures outside the measured range; None if the result has no data.

        `radius` has the radii (chain, draw, pressure) at the pressures, and `unit` is that in which
        the user gave the pressures.
        """
        measured = self.measured
        if measured is None:
            return None
        # A draw that does not reach the pressure counts as infinitely inflated.
        median = np.median(np.where(np.isnan(radius), np.inf, radius), axis=(0, 1))
        found = measured.at_pressures(pressure, median, self.typical, unit)
        return found._replace(of_class=self.of_class)

    def dataset(
        self, axes: dict[str, Array], extrapolated: Extrapolated | None = None, **variables: Array
    ) -> xr.Dataset:
        """Return variables (chain, draw, and `axes`) as a Dataset with units and long names.

        The coordinates ``extrapolated``, and ``axial_stretch`` if there are several stretches, lie
        along the first of `axes`.
        """
        dims = ("chain", "draw", *axes)
        values = {name: (dims, value) for name, value in variables.items()}
        coords: dict[str, Any] = {**self.coords, **axes}
        if extrapolated is not None:
            coords["extrapolated"] = next(iter(axes)), extrapolated.points
        if axes and np.ndim(self.typical["axial_stretch"]):
            coords["axial_stretch"] = next(iter(axes)), self.typical["axial_stretch"]
        return labelled(xr.Dataset(values, coords), self.member)


def labelled(found: xr.Dataset, member: Member) -> xr.Dataset:
    """Add units and long names to a prediction, and the name of the specimen."""
    if member.name is not None:
        found.attrs["specimen"] = member.name
    for name in set(found.variables) & set(IN_RESULTS):
        found[name].attrs = IN_RESULTS[name].attributes
    return found


def draws_of(
    result: xr.DataTree,
    tube: Tube | None = None,
    specimen: str | None = None,
    energy: StrainEnergy | Sequence[Layer] | None = None,
) -> Draws:
    """Return material and tube of each draw.

    Each measure of the tube is the stated one, else the inferred value, else the value of the data.
    """
    wall, of_all, values = wall_draws_of(result, energy, specimen)
    member, posterior = of_all.of_tubes(), of_all.posterior
    layered = "thickness" in wall[0].values
    given = {} if tube is None else stated_geometry(tube)
    if layered and "outer_radius" in given:
        raise ValueError("outer_radius cannot be given with layers: each has its own thickness")
    medians = medians_of_measures(posterior, layered)
    inferred = {k: values_by_draw(posterior, k) for k in medians if k not in given}
    if layered:
        thickness = np.sum(np.broadcast_arrays(*(v["thickness"] for v in values)), axis=0)
        inferred["thickness"], medians["thickness"] = thickness, float(np.median(thickness))
    if member.data is None and of_all.data is not None:
        _check_stated(inferred, given, specimen)
    geometry = _geometry(member.data, inferred, given)
    typical = _geometry(member.data, medians, given)
    return Draws(
        TubeNumbers(_layers(wall, values, geometry), geometry),
        {name: posterior[name] for name in ("chain", "draw")},
        {name: v.item() if v.size == 1 else v.ravel() for name, v in typical.items()},
        medians,
        member,
        result.name,
    )


def _layers(
    wall: list[NamedLayer], values: list[dict[str, Array]], geometry: dict[str, Array]
) -> list[ReferenceLayer]:
    """Return the layers of the unloaded wall, from the inside out."""
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


def stated_geometry(tube: Tube) -> dict[str, Any]:
    """Return the stated radii (mm), axial stretch and opening angle (rad) of a tube.

    The axial stretch may be an array, with one value for each point of a prediction.

    Raises
    ------
    TypeError
        If `tube` is no Tube, or a measure no number.
    ValueError
        If the tube states standard deviations, a measure of the wall without a radius, or radii
        that depend on an opening angle without this angle.
    """
    if not isinstance(tube, Tube):
        raise TypeError(f"tube is {tube!r}; expected ph.Tube(...), such as ph.Tube(7.0, 9.0)")
    if tube.sd is not None:
        raise ValueError(f"{tube}: standard deviations belong to ph.inflation_data; leave sd out")
    for name in (*GEOMETRY, *WALL):
        value = getattr(tube, name)
        if not (value is None or isinstance(value, Real) or name == "axial_stretch"):
            raise TypeError(f"{name} is {value!r}; expected a number")
    if tube.opening_angle is None and (tube.wall_area is not None or tube.radii_of == "ring"):
        # The angle of the specimen may be another one than 0, which Tube.geometry would assume.
        raise ValueError(f"{tube}: radii depend on the opening angle; state opening_angle, or 0.0")
    stated = tube.geometry()
    if not isinstance(stated.get("axial_stretch", 1.0), Real):
        expected = "axial stretches, one for each point"
        stated["axial_stretch"] = checked_numbers("axial_stretch", tube.axial_stretch, expected)
    return stated


def medians_of_measures(posterior: xr.Dataset, layered: bool = False) -> dict[str, float]:
    """Return the medians of the inferred measures of the tube; none if no tube was inferred.

    There is at most one measure of the wall, from which the outer radius follows.
    """
    measures = () if layered else ("outer_radius", "thickness", "wall_area")
    wall = [name for name in measures if name in posterior][:1]
    names = [name for name in GEOMETRY if name in posterior and name != "outer_radius"] + wall
    return {name: float(np.median(values_by_draw(posterior, name))) for name in names}


def _check_stated(inferred: dict[str, Any], given: dict[str, Any], specimen: str | None) -> None:
    """Raise ValueError if a result of sheets alone is asked about a tube that is not stated."""
    wall = {"outer_radius", "thickness", "wall_area"} & {*inferred, *given}
    if not wall or "inner_radius" not in inferred | given:
        what = "result" if specimen is None else f"specimen {specimen!r} of the result"
        raise ValueError(
            f"the {what} holds no tube, only tests of sheets: state a tube, such as "
            "tube=ph.Tube(inner_radius=7.0, outer_radius=9.0), in ph.Conditions if the function "
            "has an argument `at`; stresses of a sheet are predicted by ph.predict_stress"
        )


def _geometry(
    data: xr.Dataset | None, inferred: dict[str, Any], given: dict[str, Any]
) -> dict[str, Array]:
    """Return the reference tube (mm, rad), as arrays that broadcast to (chain, draw, 1).

    Each measure is the given value, else the inferred value, else the value of the data.
    """
    tube = _common_geometry(data) | inferred | given
    wall = next((name for name in ("thickness", "wall_area") if name in inferred), None)
    if wall and "outer_radius" in given:
        del tube[wall]
    elif wall:
        del tube["outer_radius"]  # the data's, which the inferred measure replaces
        check_geometry(**{wall: tube[wall]})
    unknown = [name for name, value in tube.items() if value is None]
    if unknown:
        raise ValueError(_not_one_tube(data, unknown))
    tube = inferred_geometry(tube)
    check_geometry(**tube)
    values = {name: np.asarray(tube[name], float) for name in GEOMETRY}
    # A list has one value for each point, along the last axis.
    return {n: v[None, None] if v.ndim == 1 else np.atleast_3d(v) for n, v in values.items()}


def _not_one_tube(data: xr.Dataset | None, unknown: list[str]) -> str:
    """Return the message for measures that are unknown, or that differ between tests."""
    no_values = np.array([])
    tubes = {name: no_values if data is None else np.unique(data[name].values) for name in unknown}
    measured = {
        k: list(dict.fromkeys(f"{x:.6g}" for x in v if np.isfinite(x))) for k, v in tubes.items()
    }
    found = [
        f"{k} ({', '.join(v[:4] + ['...'] * (len(v) > 4)) or 'unknown'})"
        for k, v in measured.items()
    ]
    example = ", ".join(f"{k}={v[0] if v else '...'}" for k, v in measured.items())
    message = (
        f"the result's data do not have one {', one '.join(found)}: state the tube, such as "
        f"tube=ph.Tube({example}), in ph.Conditions if the function has an argument `at`"
    )
    # Tests of one specimen may differ in axial stretch, so that its name would not help.
    names = [] if data is None else list(dict.fromkeys(data["specimen"].values.tolist()))
    if len(names) > 1:
        message += f", or give the specimen whose tube is meant, such as specimen={names[0]!r}"
    return message


def _common_geometry(data: xr.Dataset | None) -> dict[str, Any]:
    """Return each measure that all tests share up to rounding errors, else None.

    Without data the axial stretch is 1 and the opening angle 0.
    """
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
    """Return a finite number, or a list of finite numbers, as a 1-D array; else raise."""
    try:
        numbers = np.atleast_1d(np.asarray(values, float))
    except (TypeError, ValueError):
        numbers = np.array([])
    if numbers.ndim != 1 or not numbers.size or not np.all(np.isfinite(numbers)):
        raise ValueError(f"{name} must be a list of {expected}; got {values!r}")
    return numbers


def checked_radii(internal_radius: Any) -> Array:
    """Return radii, mm, as an array; raise unless they are positive."""
    expected = "positive radii in mm"
    radii = checked_numbers("internal_radius", internal_radius, expected)
    if not np.all(radii > 0):
        raise ValueError(f"internal_radius must be a list of {expected}; got {internal_radius!r}")
    return radii


def radii_of_data(data: xr.Dataset | None) -> Array:
    """Return equidistant radii (mm) from the smallest to the largest of the data."""
    measured = np.array([]) if data is None else data["radius"].values
    measured = measured[np.isfinite(measured)]
    if not measured.size:
        raise ValueError("the result holds no measured radii: give internal_radius=...")
    return np.linspace(measured.min(), measured.max())


def _report_unreached(
    radius: Array, pressure: Array, several_stretches: bool, of_class: str | None
) -> None:
    """Warn of pressures that some draws do not reach; raise if no draw reaches any pressure."""
    unreached = np.isnan(radius)
    where = "on the rising branch of the curve, see ph.radius_at_pressure"
    prefix = f"class {of_class!r}: " if of_class else ""
    names = [f"{p:g} kPa ({p / mmHg:.4g} mmHg)" for p in pressure]
    if unreached.all():
        pressures = ", ".join(dict.fromkeys(names))
        raise ValueError(f"{prefix}no draw reaches a pressure of {pressures} {where}")
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
    warn_user(f"{prefix}of {draws} draws {missed} {where}; the values are NaN there")
