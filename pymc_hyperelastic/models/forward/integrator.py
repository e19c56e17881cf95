"""The interface of integrators, by which a forward model computes curves and misfits.

The general one is quadrature of the wall at every point.
"""

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any, ClassVar

import numpy as np
import pytensor.tensor as pt
import xarray as xr
from pytensor.tensor.variable import TensorVariable

from pymc_hyperelastic.data.inflation import at_points, measured_radius, points_of
from pymc_hyperelastic.mechanics.integrals import (
    SMALLEST_STEP,
    RadiusAtPressure,
    wall_force,
    wall_pressure,
)
from pymc_hyperelastic.mechanics.interpolation import evenly
from pymc_hyperelastic.mechanics.wall import OVERFLOW, WALL_ORDER
from pymc_hyperelastic.models.forward.blocks import table_arrays, table_of
from pymc_hyperelastic.models.forward.numbers import numeric_curves
from pymc_hyperelastic.models.forward.tube_variables import (
    Array,
    Arrays,
    CurrentTube,
    Curves,
    GeometrySd,
    Points,
    Values,
    WallVariables,
    current_tube,
    tube_inputs,
)
from pymc_hyperelastic.models.priors import is_inferred

# Points at which curves are compared, besides the ends of tests.
_COMPARED_POINTS = 128
# Rounds in which an integrator is made accurate for materials whose curves were not; one or two
# usually suffice.
MOST_ROUNDS = 4

# Differences between curves and targets by name, and the conditions for them.
Differences = tuple[Curves, list[TensorVariable]]


@dataclass(frozen=True, kw_only=True)
class Integrator(ABC):
    """A way to compute the curves of a tube, with an error estimate.

    The arrays that a method makes of the data are inputs of the method after it, where they may be
    shared variables. A `wall` holds variables of a model, or for :meth:`values`, :meth:`errors` and
    :meth:`refined` numbers, one for each material.
    """

    by_points: ClassVar[bool]
    """True if misfits are computed from the curves at all points, and need their arrays."""
    with_force: bool = False
    """True if the axial force is a curve, too."""
    by_test: bool = False
    """True if each test has parameters of its own."""
    geometry_sd: GeometrySd = ()
    """Errors of the measured geometry; only quadrature at every point admits them."""

    @abstractmethod
    def curve_arrays(self, data: xr.Dataset) -> Arrays:
        """Return the arrays of the data for :meth:`curves`."""

    @abstractmethod
    def curves(self, inputs: Values, wall: WallVariables) -> Curves:
        """Return pressure and stiffness at the points.

        If the axial force is measured, there are ``axial_force`` and its ``force_slope`` by the
        internal radius. ``growth`` is the derivative of the internal by the measured radius,
        ``radius`` the internal radius if it depends on an unknown geometry, and ``possible`` is
        true for a possible tube, unless each is.
        """

    @abstractmethod
    def misfit_arrays(self, data: xr.Dataset, targets: Mapping[str, Array]) -> Arrays:
        """Return the arrays of targets, which may be NaN, for :meth:`differences`."""

    @abstractmethod
    def differences(self, inputs: Values, wall: WallVariables, error_in: str) -> Differences:
        """Return differences between curves and targets, and the conditions for them."""

    @abstractmethod
    def values(self, data: xr.Dataset, wall: WallVariables, points: Points) -> Arrays:
        """Return curves (material, point) of a wall in numbers at some of the points."""

    @property
    def settings(self) -> dict[str, Any]:
        """Settings that all integrators have."""
        return {f.name: getattr(self, f.name) for f in fields(Integrator)}

    def quadrature(self, order: int) -> "PointwiseQuadrature":
        """Return pointwise quadrature of the same curves."""
        return PointwiseQuadrature(order, **self.settings)

    @abstractmethod
    def refined(self, data: xr.Dataset, wall: WallVariables) -> "Integrator":
        """Return an integrator that is accurate for the materials of this wall, too."""

    @np.errstate(all="ignore")  # some of the materials may be impossible
    def errors(self, data: xr.Dataset, wall: WallVariables) -> Array:
        """Return the largest error of the curves of each material.

        Curves are compared with a rule of 96 nodes, more than any integrator has. The error is
        relative to the largest value of the curve in the tests of a specimen. Forces may be nil:
        they are compared with the thrust ``π a² p`` of the pressure, if that is larger. An error
        that is not a number counts as infinite. Matrices are compared by their pressures and forces
        alone, and not by their slopes.
        """
        points = compared_points(data)
        exact = self.quadrature(3 * WALL_ORDER).values(data, wall, points)
        found = self.values(data, wall, points)
        specimen = data["specimen"].values[data["test"].values[points]]
        errors = np.zeros(1)
        for own in (specimen == label for label in np.unique(specimen)):
            scales = {k: np.abs(v[:, own]).max(axis=1) for k, v in exact.items()}
            if "axial_force" in scales:
                radius = data["radius"].values[points][own]
                thrust = np.pi * np.nanmax(radius, initial=0.0) ** 2 * scales["pressure"]
                scales["axial_force"] = np.maximum(scales["axial_force"], thrust)
            for name, curve in found.items():
                error = np.abs(curve - exact[name])[:, own].max(axis=1)
                error = error / np.where(scales[name] > 0, scales[name], 1.0)
                errors = np.maximum(errors, np.where(np.isnan(error), np.inf, error))
        return errors


@dataclass(frozen=True)
class PointwiseQuadrature(Integrator):
    """Gauss-Legendre quadrature at every point, split at the kinks of the law."""

    by_points: ClassVar[bool] = True

    order: int
    """Nodes of each wall, or of each piece between kinks."""

    def curve_arrays(self, data: xr.Dataset) -> Arrays:
        """Return the arrays of the data for :meth:`curves`."""
        arrays = tube_inputs(data, self.geometry_sd)
        if self.by_test or self.geometry_sd:
            arrays["test"] = data["test"].values
        return arrays

    def curves(self, inputs: Values, wall: WallVariables) -> Curves:
        """Return pressure and stiffness at the points, and others, see :class:`Integrator`."""
        current = self._tube(inputs, wall)
        pressure, stiffness = wall_pressure(current.tube, current.radius, self.order)
        curves = {"pressure": pressure, "stiffness": stiffness, "growth": current.growth}
        if self.with_force:
            force, slope = wall_force(current.tube, current.radius, self.order)
            curves |= {"axial_force": force, "force_slope": slope}
        if (wall.geometry or wall.deviations) and current.excess is not None:
            curves["radius"] = current.radius
        return curves if wall.known_tube else curves | {"possible": current.possible}

    def misfit_arrays(self, data: xr.Dataset, targets: Mapping[str, Array]) -> Arrays:
        """Return the arrays of targets, which may be NaN, for :meth:`differences`."""
        arrays: Arrays = {}
        for name, target in targets.items():
            rows = np.flatnonzero(np.isfinite(target))
            if name == "force_sum":
                arrays |= table_arrays(data["test"].values[rows], data.sizes["test"])
            else:
                arrays |= {f"{name}_rows": rows, f"{name}_target": target[rows]}
        return arrays

    def differences(self, inputs: Values, wall: WallVariables, error_in: str) -> Differences:
        """Return differences between curves and targets, and the conditions for them.

        With the error in the radius, radius and force are those of the tube at the measured
        pressure.
        """
        if error_in == "radius":
            return self._at_pressure(inputs, wall)
        curves = self.curves(inputs, wall)
        differences = {"pressure": curves["pressure"] - inputs["pressure_target"]}
        if "slope_rows" in inputs:
            slope = slopes_of(curves)["pressure"][inputs["slope_rows"]]
            differences["slope"] = slope - inputs["slope_target"]
        if "force_rows" in inputs:
            differences |= force_differences(inputs, curves["axial_force"])
        return differences, conditions_of(curves)

    def values(self, data: xr.Dataset, wall: WallVariables, points: Points) -> Arrays:
        """Return curves (material, point) of a numeric wall at some of the points."""
        settings = self.order, self.with_force, self.geometry_sd
        return numeric_curves(data, wall, points, *settings)

    def refined(self, data: xr.Dataset, wall: WallVariables) -> "PointwiseQuadrature":
        """Return the rule of twice the order of any wall: its error is that order's squared."""
        return self.quadrature(2 * WALL_ORDER)

    def _tube(self, inputs: Values, wall: WallVariables) -> CurrentTube:
        def at_points(value: Any) -> Any:
            return value[inputs["test"]] if self.by_test and is_inferred(value) else value

        of_points = {name: z[inputs["test"]] for name, z in wall.deviations.items()}
        wall = wall.mapped(at_points)._replace(geometry=wall.geometry, deviations=of_points)
        return current_tube(pt, inputs, wall)

    def _at_pressure(self, inputs: Values, wall: WallVariables) -> Differences:
        """Differences at the measured pressures, and the conditions for radii there."""
        current = self._tube(inputs, wall)
        energies = tuple(layer.energy for layer in current.tube.layers)
        op = RadiusAtPressure(strain_energies=energies, order=self.order)
        radius, last_step = op(inputs["pressure_target"], current.radius, *current.tube.inputs)
        found = last_step < SMALLEST_STEP
        radius = pt.where(found, radius, current.radius)
        differences = {"radius": current.measured(radius) - current.measured(current.radius)}
        if "force_rows" in inputs:
            force, _ = wall_force(current.tube, radius, self.order)
            differences |= force_differences(inputs, force)
        conditions = [] if wall.known_tube else [pt.all(current.possible)]
        return differences, [*conditions, pt.all(found)]


def slopes_of(curves: Curves) -> Curves:
    """Return derivatives of the curves by the radius that was measured."""
    slopes = {"pressure": curves["stiffness"]}
    if "force_slope" in curves:
        slopes["axial_force"] = curves["force_slope"]
    # The gradient of an infinite slope would be 0 * inf.
    bounded = {name: pt.where(pt.isfinite(s), s, OVERFLOW) for name, s in slopes.items()}
    return {name: slope * curves["growth"] for name, slope in bounded.items()}


def conditions_of(curves: Curves) -> list[TensorVariable]:
    """Return the conditions under which the tube is possible, unless it is known to be."""
    return [pt.all(curves["possible"])] if "possible" in curves else []


def force_differences(inputs: Values, force: TensorVariable) -> Curves:
    """Return differences between forces and targets, and their sums if these have a target."""
    error = force[inputs["force_rows"]] - inputs["force_target"]
    sums = {"force_sum": table_of(error, inputs).sum(axis=-1)} if "points" in inputs else {}
    return {"force": error} | sums


def compared_points(data: xr.Dataset) -> Points:
    """Return points at which curves are compared: the ends of tests, and others evenly spread."""
    ends = np.concatenate(ends_of_tests(data))
    points = np.union1d(ends, evenly(data.sizes["obs"], _COMPARED_POINTS))
    return points[evenly(len(points), _COMPARED_POINTS)]


def ends_of_tests(data: xr.Dataset) -> list[Points]:
    """Return the points at the ends of each test: of its radii, and of its axial stretches."""
    along = [measured_radius(data).values, at_points(data, "axial_stretch")]
    spans = [points_of(data, test) for test in range(data.sizes["test"])]
    return [
        np.unique([s.start + f(x[s]) for x in along for f in (np.argmin, np.argmax)]) for s in spans
    ]
