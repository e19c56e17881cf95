"""The forward model of tubes."""

from collections.abc import Callable, Hashable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import pymc as pm
import pytensor.tensor as pt
import xarray as xr
from pytensor.tensor.variable import TensorVariable

from pymc_hyperelastic.data.inflation import at_points, evenly_along, extension_tests, points_of
from pymc_hyperelastic.mechanics.layers import Layer
from pymc_hyperelastic.mechanics.strain_energy.base import StrainEnergy
from pymc_hyperelastic.mechanics.wall import OVERFLOW, WALL_ORDER
from pymc_hyperelastic.models.forward.base import ForwardModel, SymbolicTests
from pymc_hyperelastic.models.forward.choose import Mode, choose_integrator
from pymc_hyperelastic.models.forward.integrator import (
    MOST_ROUNDS,
    Integrator,
    PointwiseQuadrature,
    conditions_of,
    slopes_of,
)
from pymc_hyperelastic.models.forward.tube_variables import (
    Array,
    Arrays,
    Curves,
    Values,
    WallVariables,
)
from pymc_hyperelastic.models.geometry import measured_of, of_tubes, priors_of
from pymc_hyperelastic.models.priors import with_variables

# Radii of a test at which it is checked that pressure rises.
_RADII_BETWEEN = 20


class TubeForward(ForwardModel):
    """Pressures, axial forces and slopes of tubes at the measured points, for any parameters.

    Parameters
    ----------
    wall : StrainEnergy or sequence of Layer
        The material, or its layers with distributions for inferred parameters.
    data : xarray.Dataset
        Inflation data.
    parameters, geometry : dict of str to TensorVariable
        Distributions, or random expressions, of the unknown material parameters and geometry, by
        name: curves are accurate over their range. A geometry that was measured with an error is
        :class:`MeasuredValue`.
    mode : {"auto", "collocation", "quadrature"}
        How the wall is integrated.
    with_force : bool
        If True, axial force is measured.
    error_in : {"pressure", "radius"}
        The quantity that was measured with an error, whose misfit is computed.
    by_test : bool
        If True, each test has parameters of its own: vectors with one entry for each test.
    tolerance : float
        Largest error of curves, relative to the largest value of each. Chebyshev nodes and
        pointwise quadrature are chosen for smaller errors.
    inaccurate : float
        Fraction of the materials of the prior whose curves may err by more: a few have fibres that
        stiffen by orders of magnitude within a hundredth of a wall. It may be larger for callers
        that refine the curves of the materials that they find, see :func:`until_accurate`.
    replaceable : bool
        See :class:`ForwardModel`.

    Raises
    ------
    ValueError
        If there is no such mode, or collocation was asked for and is not possible.
    """

    def __init__(
        self,
        wall: StrainEnergy | Sequence[Layer],
        data: xr.Dataset,
        parameters: Values,
        geometry: Values | None = None,
        *,
        mode: Mode = "auto",
        with_force: bool = False,
        error_in: str = "pressure",
        by_test: bool = False,
        tolerance: float = 1e-9,
        inaccurate: float = 1 / 200,
        replaceable: bool = True,
    ) -> None:
        super().__init__(data, by_test=by_test, replaceable=replaceable)
        self.error_in = error_in
        self._energy, self._distributions = wall, dict(parameters)
        measured, self._geometry = measured_of(geometry or {}), priors_of(geometry or {})
        deviations = {name: pm.Normal.dist() for name in measured}
        sd = tuple((name, value.sd) for name, value in measured.items())
        self.integrator: Integrator = choose_integrator(
            self._wall(parameters, self._geometry, deviations),
            data,
            PointwiseQuadrature(WALL_ORDER, with_force=with_force, by_test=by_test, geometry_sd=sd),
            mode=mode,
            known_radii=error_in == "pressure",
            tolerance=tolerance,
            inaccurate=inaccurate,
        )

    def errors(self, data: xr.Dataset, parameters: Values, geometry: Values | None = None) -> Array:
        """Return the largest error of the curves of each material."""
        return self.integrator.errors(data, self._wall(parameters, geometry))

    @property
    def unknown(self) -> tuple[list[str], list[str]]:
        """Names of the unknown material parameters, and of the unknown geometry."""
        return [*self._distributions], [*self._geometry]

    def refined(
        self, data: xr.Dataset, parameters: Values, geometry: Values | None = None
    ) -> "TubeForward":
        """Return the same with curves that are accurate for these materials, too."""
        wall = self._wall(parameters, geometry)
        return self._changed(integrator=self.integrator.refined(data, wall))

    def between(self) -> "TubeForward":
        """The same tests at radii evenly spread between the ends of each.

        Those of an extension test are at axial stretches that are evenly spread.
        """
        return self._changed(data=_between(self.data))

    @property
    def _folded(self) -> bool:
        # Constant matrices would be stored in the compiled function.
        return super()._folded and self.integrator.by_points

    def with_variables(
        self, parameters: Values, geometry: Values | None = None, deviations: Values | None = None
    ) -> "SymbolicTube":
        """The tubes with variables of a model in place of the distributions."""
        return SymbolicTube(self, self._wall(parameters, geometry, of_tubes(deviations)))

    def _wall(
        self, parameters: Values, geometry: Values | None = None, deviations: Values | None = None
    ) -> WallVariables:
        """The wall with variables or numbers in place of the distributions."""
        unknown = geometry or {}, deviations or {}
        if isinstance(self._energy, StrainEnergy):
            return WallVariables(self._energy, dict(parameters), *unknown)
        layers = with_variables(self._energy, self._distributions, parameters)
        return WallVariables(layers, {}, *unknown)


def until_accurate[T](
    forward: ForwardModel,
    take: Callable[[ForwardModel], tuple[T, tuple[Any, ...]]],
    tolerance: float,
) -> tuple[T, bool]:
    """Repeat a computation with finer integrators until the curves it depends on are accurate.

    `take` computes a result with a forward model, and returns it with the data and materials for
    which the curves must be accurate: the arguments of :meth:`ForwardModel.errors`. The second
    value is False if the curves are still inaccurate after a few rounds.
    """
    for rounds_left in range(MOST_ROUNDS, -1, -1):
        found, materials = take(forward)
        # An error that is not a number is infinite.
        if forward.errors(*materials).max() <= tolerance:
            return found, True
        if rounds_left:
            forward = forward.refined(*materials)
    return found, False


class Misfits(NamedTuple):
    """Sums of squared differences between a model and measurements, by quantity."""

    squares: dict[str, TensorVariable]
    conditions: list[TensorVariable]
    """Conditions for the tube, and for a sum of squares that does not overflow."""
    force_sums: TensorVariable | None = None
    """Sum of the differences of forces in each test."""


@dataclass(frozen=True)
class SymbolicTube(SymbolicTests):
    """A tube of variable material and geometry at the points of the data."""

    forward: TubeForward
    wall: WallVariables

    def curves(self) -> Curves:
        """Pressure and stiffness at the points, by their names.

        With measured forces there is ``axial_force``, and if the internal radius depends on an
        unknown geometry, ``radius``.
        """
        beside = ("force_slope", "growth", "possible")
        return {name: v for name, v in self._curves().items() if name not in beside}

    def conditions(self) -> list[TensorVariable]:
        """Conditions under which the tube is possible, unless it is known to be."""
        return conditions_of(self._curves())

    def slopes(self) -> Curves:
        """How the curves rise with the radius that was measured, by the names of the curves.

        ``pressure`` (kPa/mm), and with measured forces ``axial_force`` (mN/mm).
        """
        return slopes_of(self._curves())

    def misfits(self, key: Hashable, targets_of: Callable[[xr.Dataset], Arrays]) -> Misfits:
        """Sums of squared differences between the curves and targets.

        `targets_of` returns the measured value at each point of data, or NaN:
        ``"pressure"`` (kPa), ``"slope"`` (kPa/mm, by the radius that was measured), ``"force"``
        (mN). Other targets have another `key`. The sums have these names;
        with the error in the radius there is ``"radius"`` (mm²) in place of the pressure. With
        ``"force_sum"``, the forces once more, their differences are added up test by test as well.
        """
        integrator = self.forward.integrator
        inputs: dict[str, Any] = self.forward.share(
            ("misfits", key), lambda data: integrator.misfit_arrays(data, targets_of(data))
        )
        if integrator.by_points:
            inputs = self._curve_inputs | inputs
        differences, conditions = integrator.differences(inputs, self.wall, self.forward.error_in)
        force_sums = differences.pop("force_sum", None)
        squares = {}
        for name, difference in differences.items():
            total = pt.sum(pt.square(difference))
            conditions.append(total < OVERFLOW)
            # Else a noise parameter's gradient would be 0 * inf. That of the material is zero by
            # the integral itself.
            known = pt.where(conditions[-1], total, 0.0)
            squares[name] = known + inputs.get(f"{name}_residual", 0.0)
            if name == "force" and force_sums is not None:
                force_sums = pt.where(conditions[-1], force_sums, 0.0)
        return Misfits(squares, conditions, force_sums)

    def _curves(self) -> Curves:
        return self.forward.integrator.curves(self._curve_inputs, self.wall)

    @property
    def _curve_inputs(self) -> dict[str, Any]:
        return self.forward.share("curves", self.forward.integrator.curve_arrays)


def _between(data: xr.Dataset) -> xr.Dataset:
    names = [n for n in ("radius", "outer_diameter", "axial_stretch") if n in data]
    measured, extended = {name: at_points(data, name) for name in names}, extension_tests(data)
    points: dict[str, Any] = {}
    for name, values in measured.items():
        between = []
        for test in range(data.sizes["test"]):
            own = points_of(data, test)
            along = measured["axial_stretch"] if extended[test] else values
            between.append(evenly_along(along[own], values[own], _RADII_BETWEEN))
        points[name] = "obs", np.concatenate(between)
    of_points = np.repeat(np.arange(data.sizes["test"]), _RADII_BETWEEN)
    of_tests = {k: v for k, v in data.data_vars.items() if v.dims == ("test",) and k not in points}
    return xr.Dataset(points, {"test": ("obs", of_points)}).assign(of_tests)
