"""The interface of integrators, by which a forward model computes curves and misfits."""

from abc import ABC, abstractmethod
from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np
import xarray as xr
from numpy.typing import NDArray
from pytensor.tensor.variable import TensorVariable

from pymc_hyperelastic.data.inflation import at_points, measured_radius, points_of
from pymc_hyperelastic.mechanics.interpolation import evenly
from pymc_hyperelastic.models.forward.numbers import numeric_curves
from pymc_hyperelastic.models.forward.tube_variables import Array, Arrays, WallVariables

# Largest slope (kPa/mm) and largest sum of squares (kPa² or their units): far beyond any tube, and
# multiples of such sums do not overflow.
LARGEST = np.float64(1e60)
# Nodes of the quadrature with which curves are compared: more than any integrator has, which are 64
# at most.
REFERENCE_ORDER = 96
# Points at which curves are compared, besides the ends of tests.
_COMPARED_POINTS = 128
# Rounds in which an integrator is made accurate for materials whose curves were not; one or two
# usually suffice.
MOST_ROUNDS = 4


class Integrator(ABC):
    """A way to compute the curves of a tube, with an error estimate.

    The arrays that a method makes of the data are inputs of the method after it, where they may be
    shared variables. A `wall` holds variables of a model, or for :meth:`values`, :meth:`errors` and
    :meth:`refined` numbers, one for each material.
    """

    by_points: ClassVar[bool]
    """True if misfits are computed from the curves at all points, and need their arrays."""
    with_force: bool
    by_test: bool

    @property
    def geometry_sd(self) -> tuple[tuple[str, float | None], ...]:
        """Names and standard deviations of a measured geometry; None are those of the data."""
        return ()

    @abstractmethod
    def curve_arrays(self, data: xr.Dataset) -> Arrays:
        """Return the arrays of the data for :meth:`curves`, :meth:`slopes`, :meth:`conditions`."""

    @abstractmethod
    def curves(self, inputs: Mapping[str, Any], wall: WallVariables) -> dict[str, TensorVariable]:
        """Return pressure and stiffness at the points, and the axial force if it is measured."""

    @abstractmethod
    def slopes(self, inputs: Mapping[str, Any], wall: WallVariables) -> dict[str, TensorVariable]:
        """Return derivatives of the curves by the radius that was measured."""

    @abstractmethod
    def conditions(self, inputs: Mapping[str, Any], wall: WallVariables) -> list[TensorVariable]:
        """Return the conditions under which the tube is possible, unless it is known to be."""

    @abstractmethod
    def misfit_arrays(self, data: xr.Dataset, targets: Mapping[str, Array]) -> Arrays:
        """Return the arrays of targets, which may be NaN, for :meth:`differences`."""

    @abstractmethod
    def differences(
        self, inputs: Mapping[str, Any], wall: WallVariables, error_in: str
    ) -> tuple[dict[str, TensorVariable], list[TensorVariable]]:
        """Return differences between curves and targets, and the conditions for them."""

    @abstractmethod
    def values(
        self, data: xr.Dataset, wall: WallVariables, points: NDArray[np.intp]
    ) -> dict[str, Array]:
        """Return curves (material, point) of a wall in numbers at some of the points."""

    @abstractmethod
    def refined(self, data: xr.Dataset, wall: WallVariables) -> "Integrator":
        """Return an integrator that is accurate for the materials of this wall, too."""

    @np.errstate(all="ignore")  # some of the materials may be impossible
    def errors(self, data: xr.Dataset, wall: WallVariables) -> Array:
        """Return the largest error of the curves of each material, compared with a finer rule.

        It is relative to the largest value of the curve in the tests of a specimen. Forces may be
        nil: they are compared with the thrust ``π a² p`` of the pressure, if that is larger. An
        error that is not a number counts as infinite. Matrices are compared by their pressures and
        forces alone, and not by their slopes.
        """
        points = compared_points(data)
        settings = REFERENCE_ORDER, self.with_force, self.geometry_sd
        exact = numeric_curves(data, wall, points, *settings)
        found = self.values(data, wall, points)
        specimen = np.unique(data["specimen"].values, return_inverse=True)[1]
        specimen = specimen[data["test"].values[points]]
        errors = np.zeros(1)
        for own in (specimen == i for i in np.unique(specimen)):
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


def compared_points(data: xr.Dataset) -> NDArray[np.intp]:
    """Return points at which curves are compared: the ends of tests, and others evenly spread."""
    ends = np.concatenate(ends_of_tests(data))
    points = np.union1d(ends, evenly(data.sizes["obs"], _COMPARED_POINTS))
    return points[evenly(len(points), _COMPARED_POINTS)]


def ends_of_tests(data: xr.Dataset) -> list[NDArray[np.intp]]:
    """Return the points at the ends of each test: of its radii, and of its axial stretches."""
    along = [measured_radius(data).values, at_points(data, "axial_stretch")]
    spans = [points_of(data, test) for test in range(data.sizes["test"])]
    return [
        np.unique([s.start + f(x[s]) for x in along for f in (np.argmin, np.argmax)]) for s in spans
    ]
