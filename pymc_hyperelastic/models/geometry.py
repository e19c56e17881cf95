"""Unknown geometry of a tube: priors, and measured values with their errors."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import e, isfinite
from numbers import Real
from typing import Any

import numpy as np
import pymc as pm
import xarray as xr

from pymc_hyperelastic.data.geometry import kept_circle_of
from pymc_hyperelastic.data.inflation import (
    at_points,
    describe_test,
    extension_tests,
    points_of,
)
from pymc_hyperelastic.data.select import specimens_of
from pymc_hyperelastic.mechanics.layers import Layer, check_energy, check_layers
from pymc_hyperelastic.mechanics.reference_tube import WALL
from pymc_hyperelastic.mechanics.strain_energy.base import StrainEnergy
from pymc_hyperelastic.mechanics.tube import (
    GEOMETRY,
    inferred_geometry,
    measure_of,
    reopened,
    with_wall,
)
from pymc_hyperelastic.models.priors import check_by_name, check_prior, complete_wall
from pymc_hyperelastic.quantities import MEASURES, SHEET_MEASURES

# Measures that give the outer radius, together with the inner one.
_OUTER = ("outer_radius", "thickness", "wall_area")
# Variables of the data from which other measures follow.
_BEHIND = {
    "thickness": ("inner_radius", "outer_radius"),
    "wall_area": ("inner_radius", "outer_radius", "opening_angle"),
}


@dataclass(frozen=True)
class MeasuredValue:
    r"""A measure of the tube that was measured with an error, for each specimen by itself.

    With the measured value ``v`` and its standard deviation ``s``, a specimen has

    .. math:: v \, e^{z s/v}, \qquad z \sim N(0, 1),

    of a length, an area or a stretch, which stay positive, and ``v + z s`` of an angle. The value
    is that of the data, and a thickness is the difference of both radii. Other measures keep their
    measured values. An error of the thickness or of the wall area leaves the radius as it is that
    was stated with it in :class:`~pymc_hyperelastic.Tube`; of a closed ring that of the ring, from
    which the radii of the sector follow. If both radii were stated, it is the inner one. An error
    of the opening angle leaves the middle line and the thickness of the closed ring.

    A sheet has the measures ``sheet_thickness`` and ``gauge_length``, of which the data hold no
    values: their `sd` is relative. With the true thickness ``h e^{z s}`` a measured stress is the
    true one times ``e^{z s}``; with the true gauge length ``L e^{z s}`` the true stretch is
    ``1 + (λ − 1) e^{−z s}``. Cauchy stresses count as computed with the measured stretch, as the
    nominal stress times ``λ``. A posterior holds ``e^{z s}`` under the names of these measures.

    Tests of one specimen share ``z``, its *deviation*. An error that several specimens share is
    taken as if each had its own.

    Parameters
    ----------
    sd : float, optional
        Standard deviation, in mm, mm² or rad, that of an axial stretch in 1, and those of measures
        of a sheet relative to the measured value. The default is that of the data, such as
        ``thickness_sd``, see :func:`pymc_hyperelastic.inflation_data`; measures of a sheet have
        none.

    Raises
    ------
    TypeError, ValueError
        If it is no positive number.

    See Also
    --------
    inflation_model, Layer

    Examples
    --------
    >>> import pymc_hyperelastic as ph
    >>> data = ph.load_dataset("simulated_sheep_aorta")
    >>> model = ph.inflation_model(
    ...     ph.Ogden(), data, 4 * ph.mmHg, priors={"thickness": ph.MeasuredValue(sd=0.1)}
    ... )
    >>> [rv.name for rv in model.free_RVs]
    ['mu', 'alpha', 'thickness_deviation']
    """

    sd: float | None = None

    def __post_init__(self) -> None:
        if self.sd is None:
            return
        expected = "a standard deviation in mm, mm² or rad, a positive number"
        if isinstance(self.sd, bool) or not isinstance(self.sd, Real):
            raise TypeError(f"sd is {self.sd!r}; expected {expected}")
        if not isfinite(self.sd) or self.sd <= 0:
            raise ValueError(f"sd is {self.sd}; expected {expected}")


def split_by_owner(
    energy: StrainEnergy | Sequence[Layer], what: str, by_name: Any
) -> tuple[dict[str, Any], dict[str, Any]]:
    """Split a dict by name, such as `priors`, into that of the material and that of the tube.

    The names of the tube are those of :data:`~pymc_hyperelastic.quantities.MEASURES`. All other
    names are of the material, or of the class.

    Raises
    ------
    TypeError
        If it is no dict; `what` is the name of the argument.
    ValueError
        If the strain energy has a parameter with the name of a measure of the tube.
    """
    if isinstance(energy, Sequence):
        check_layers(energy)
        laws = [layer.energy for layer in energy]
    else:
        check_energy(energy)
        laws = [energy]
    for law in laws:
        for name in law.parameter_names:
            if name in (*MEASURES, *SHEET_MEASURES):
                raise ValueError(
                    f"{law.name} has a parameter {name!r}, which is the name of a measure of a "
                    "tube or a sheet: give the parameter another name"
                )
    given = check_by_name(what, by_name)
    measures = (*MEASURES, *SHEET_MEASURES)
    tube = {name: value for name, value in given.items() if name in measures}
    return {name: value for name, value in given.items() if name not in tube}, tube


def complete_unknowns(
    energy: StrainEnergy | Sequence[Layer], priors: Any, model: pm.Model | None = None
) -> tuple[StrainEnergy | list[Layer], dict[str, Any], dict[str, Any]]:
    """Return the wall, the priors of all its parameters, and the unknown geometry of the tube."""
    material, tube = split_by_owner(energy, "priors", priors)
    return *complete_wall(energy, material, model), check_geometry(tube, model)


def check_geometry(given: Mapping[str, Any], model: pm.Model | None = None) -> dict[str, Any]:
    """Return the unknown geometry as a dict, or raise if it is unsound."""
    given = dict(given)
    for name, prior in given.items():
        if name in SHEET_MEASURES:
            _check_measure_of_sheet(name, prior)
            continue
        if name not in MEASURES:
            raise ValueError(
                f"a prior is given for {name!r}; of a tube one may infer {[*MEASURES]}"
            )
        if not isinstance(prior, MeasuredValue):
            check_prior(name, prior, model=model)
    outer = [name for name in _OUTER if name in given]
    if len(outer) > 1:
        raise ValueError(f"{outer} state the same: give a prior for one of them")
    wall = [name for name in outer if name != "outer_radius"]
    if wall and "inner_radius" not in given and not isinstance(given[wall[0]], MeasuredValue):
        raise ValueError(
            f"{wall[0]} is inferred together with inner_radius; where that is known, give a prior "
            f"for outer_radius, or ph.MeasuredValue(sd=...) if {wall[0]} was measured with an error"
        )
    return given


def _check_measure_of_sheet(name: str, prior: Any) -> None:
    if not isinstance(prior, MeasuredValue) or prior.sd is None:
        raise TypeError(
            f"the prior of {name!r} is {prior!r}; expected its relative standard deviation, such "
            "as ph.MeasuredValue(sd=0.05)"
        )
    if prior.sd >= 1:
        raise ValueError(
            f"the prior of {name!r} is {prior!r}, an error of 100 % or more: its sd is relative, "
            "such as ph.MeasuredValue(sd=0.05) for 5 %"
        )


def of_tubes(geometry: Mapping[str, Any] | None) -> dict[str, Any]:
    """Those of tubes."""
    return {name: v for name, v in (geometry or {}).items() if name not in SHEET_MEASURES}


def of_sheets(geometry: Mapping[str, Any] | None) -> dict[str, Any]:
    """Those of sheets."""
    return {name: v for name, v in (geometry or {}).items() if name in SHEET_MEASURES}


def check_measured_only(geometry: Mapping[str, Any]) -> None:
    """Raise if a measure of the tube has a prior that is none of its specimen's own."""
    for name, value in geometry.items():
        if not isinstance(value, MeasuredValue):
            raise TypeError(
                f"the prior of {name!r} is {value!r}; where specimens differ, expected "
                "ph.MeasuredValue(): the measured value of each, with its error"
            )


def measured_of(geometry: Mapping[str, Any]) -> dict[str, MeasuredValue]:
    """Those that were measured with an error."""
    return {name: value for name, value in geometry.items() if isinstance(value, MeasuredValue)}


def priors_of(geometry: Mapping[str, Any]) -> dict[str, Any]:
    """Those that have a prior, one value for all tests."""
    return {name: value for name, value in geometry.items() if not isinstance(value, MeasuredValue)}


def check_measured(data: xr.Dataset, measured: Mapping[str, MeasuredValue], layered: bool) -> None:
    """Raise unless the data hold the values and errors of all measures with an error."""
    if layered and set(measured) & set(_OUTER):
        raise ValueError(
            "layers state the thickness of the wall: give a layer's thickness a prior, "
            "ph.Layer(..., thickness=pm.LogNormal.dist(...))"
        )
    walls = [name for name in WALL if name in measured]
    if walls and "inner_radius" in measured and kept_circle_of(data).any():
        raise ValueError(
            f"errors are given of inner_radius and {walls[0]}, but the inner radius follows from "
            f"the measured outer radius, or from the ring: give that of {walls[0]} alone"
        )
    if "axial_stretch" in measured:
        _check_held(data, "and ph.MeasuredValue holds one error for all of it")
    for name, value in measured.items():
        for needed in _BEHIND.get(name, (name,)):
            who = f"priors={{{name!r}: ph.MeasuredValue(...)}}"
            _check_known(data, needed, f", and {who} needs it")
        if value.sd is None:
            if f"{name}_sd" not in data:
                raise ValueError(
                    f"the data hold no {name}_sd: state it with the data, ph.Tube(..., sd="
                    f"{{{name!r}: ...}}), or give the number here, ph.MeasuredValue(sd=...)"
                )
            _check_known(data, f"{name}_sd", ", and ph.MeasuredValue() needs it")


def check_tube(
    wall: StrainEnergy | Sequence[Layer], data: xr.Dataset, geometry: Mapping[str, Any] | None
) -> None:
    """Raise unless the data or the `geometry` state the whole tube."""
    check_measured(data, measured_of(geometry or {}), not isinstance(wall, StrainEnergy))
    inferred = inferred_geometry(priors_of(geometry or {}))
    needed = set(GEOMETRY) - set(inferred)
    if not isinstance(wall, StrainEnergy):
        needed.discard("outer_radius")
        if "outer_radius" in inferred or not data["outer_radius"].isnull().all():
            raise ValueError(
                "layers state the thickness of the wall, and the data its outer radius: leave that "
                "away, ph.inflation_data(frame, ph.Tube(inner_radius=...))"
            )
    if "axial_stretch" in inferred:
        _check_held(data, "in which it was measured, and its prior is one for all tests")
    for name in sorted(needed):
        prior = f"give it a prior, priors={{{name!r}: ...}}"
        _check_known(data, name, f": state it with the data, or {prior}")


def _check_known(data: xr.Dataset, name: str, then: str) -> None:
    """Raise, saying what then, unless a measure is known of every test."""
    for test in np.flatnonzero(data[name].isnull()):
        raise ValueError(f"{describe_test(data, int(test))}: {name} is not known{then}")


def _check_held(data: xr.Dataset, reason: str) -> None:
    """Raise, with the reason, unless the axial stretch is held in every test."""
    for test in np.flatnonzero(extension_tests(data)):
        raise ValueError(
            f"{describe_test(data, int(test))}: axial_stretch varies within this test, {reason}: "
            "leave it out"
        )


def register_deviations(geometry: Mapping[str, Any], dims: str = "specimen") -> dict[str, Any]:
    """Deviations of the specimens' measures, in the model of the context.

    A measure of a sheet, relative to the measured value, is a variable of the model, too.
    """
    deviations = {
        name: pm.Normal(deviation_name(name), 0.0, 1.0, dims=dims) for name in measured_of(geometry)
    }
    for name, measure in of_sheets(geometry).items():
        pm.Deterministic(name, pm.math.exp(measure.sd * deviations[name]), dims=dims)
    return deviations


def deviation_name(name: str) -> str:
    """Name of the variable that says how far a measure is from its measured value."""
    return f"{name}_deviation"


def register_measures(
    data: xr.Dataset,
    geometry: Mapping[str, Any],
    deviations: Mapping[str, Any],
    dims: str = "specimen",
) -> None:
    """The specimens' tubes, each as in the first of its tests, as far as they deviate."""
    errors = {name: m.sd for name, m in measured_of(of_tubes(geometry)).items()}
    tube = tube_of_specimens(data, errors)
    for name, values in changed_measures(tube, of_tubes(deviations)).items():
        pm.Deterministic(name, values, dims=dims)


def tube_of_specimens(data: xr.Dataset, errors: Mapping[str, float | None]) -> dict[str, Any]:
    """Return the measured tube of each specimen, and its errors; None is the error in the data."""
    first = np.unique(specimens_of(data)[1], return_index=True)[1]
    points = [points_of(data, int(test)).start for test in first]
    tube: dict[str, Any] = {name: at_points(data, name)[points] for name in GEOMETRY}
    tube["kept_circle"] = kept_circle_of(data)[first]
    for name, sd in errors.items():
        tube[f"{name}_sd"] = data[f"{name}_sd"].values[first] if sd is None else np.float64(sd)
    return tube


def deviated_tube(tube: Mapping[str, Any], deviations: Mapping[str, Any]) -> dict[str, Any]:
    """Return a tube that deviates from the measured one, see :class:`MeasuredValue`.

    The `tube` holds measured values, their errors by names such as ``thickness_sd``, and the
    ``kept_circle``, see :func:`~pymc_hyperelastic.mechanics.tube.with_wall`. Deviations are in
    standard deviations.
    """
    measured = {name: tube[name] for name in GEOMETRY}
    changes = {name: deviation * tube[f"{name}_sd"] for name, deviation in deviations.items()}
    angle = changes.pop("opening_angle", None)
    values = {}
    for name, change in changes.items():
        value = measure_of(name, measured)
        values[name] = value * e ** (change / value)
    walls = {name: value for name, value in values.items() if name in WALL}
    known = measured | {name: value for name, value in values.items() if name not in walls}
    for name, value in walls.items():
        known = with_wall(known, name, value, tube["kept_circle"])
    if angle is not None:
        # The ring that was measured opens by another angle.
        known = reopened(known, measured["opening_angle"] + angle)
    return known | walls


def changed_measures(tube: Mapping[str, Any], deviations: Mapping[str, Any]) -> dict[str, Any]:
    """Return those measures of a :func:`deviated_tube` that deviate from the measured ones."""
    trial = deviated_tube(tube, dict.fromkeys(deviations, 1.0))
    return {
        name: values
        for name, values in deviated_tube(tube, deviations).items()
        if name not in tube or not np.array_equal(trial[name], tube[name], equal_nan=True)
    }
