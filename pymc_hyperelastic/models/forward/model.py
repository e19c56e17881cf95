"""The forward model of a tube."""

from collections.abc import Callable, Hashable, Mapping, Sequence, Set
from copy import copy
from dataclasses import replace
from functools import cache
from typing import Any, NamedTuple

import numpy as np
import pymc as pm
import pytensor
import pytensor.tensor as pt
import xarray as xr
from numpy.typing import NDArray
from pytensor.compile.sharedvalue import SharedVariable
from pytensor.graph.basic import Variable
from pytensor.tensor.variable import TensorVariable

from pymc_hyperelastic.data.inflation import (
    at_points,
    evenly_along,
    extension_tests,
    points_of,
)
from pymc_hyperelastic.mechanics.empirical import fewer_nodes
from pymc_hyperelastic.mechanics.interpolation import MOST_NODES
from pymc_hyperelastic.mechanics.layers import Layer
from pymc_hyperelastic.mechanics.strain_energy.base import StrainEnergy
from pymc_hyperelastic.mechanics.wall_nodes import WallNodes
from pymc_hyperelastic.models.forward.collocated import Collocated
from pymc_hyperelastic.models.forward.direct import ByPoints, Direct, WallVariables
from pymc_hyperelastic.models.forward.rules import (
    HIGHEST_ORDER,
    Mode,
    errors_of,
    like_measured,
    way_to_integrate,
)
from pymc_hyperelastic.models.geometry import measured_of, priors_of
from pymc_hyperelastic.models.priors import with_variables

Array = NDArray[np.float64]
Arrays = dict[str, NDArray]

# kPa², or (kPa/mm)²: far beyond any tube; what is made of smaller numbers does not overflow.
_LARGEST_MISFIT = np.float64(1e60)
# Points of a specimen up to which all nodes in its walls are candidates for few.
_MOST_IN_WALLS = 400
# Nodes of a specimen with which it pays to find few that are right for materials like some.
_MANY_NODES = 100
# Radii of a test at which a pressure is seen to rise.
_RADII_BETWEEN = 20


class ForwardModel:
    """What a tube shows where it was measured, for any parameters.

    The data enter compiled expressions as shared variables: :meth:`set_data` puts others in their
    place.

    Parameters
    ----------
    wall : StrainEnergy or sequence of Layer
        The material, or its layers with distributions for what is inferred of them.
    data : xarray.Dataset
        Inflation data.
    parameters, geometry : dict of str to TensorVariable
        Distributions, or random expressions, of what is inferred of the material, and of what is
        not known of the tube, by name: curves are right over their range. What was measured of the
        tube with an error is :class:`Measured`.
    mode : {"auto", "collocation", "quadrature"}
        How the wall is integrated.
    with_force : bool
        Whether axial force is measured.
    error_in : {"pressure", "radius"}
        What was measured with an error, and what a misfit tells.
    by_test : bool
        Whether each test has parameters of its own, vectors of the length of the tests.
    nearby : bool
        Whether curves of a specimen are mostly those of :meth:`nearby` materials. All others take
        long then, and slopes are not known.
    replaceable : bool
        Whether other data may take the place of these. Else what quadrature needs of them alone is
        computed when a function is compiled.

    Raises
    ------
    ValueError
        If there is no such mode, or collocation was asked for and is not possible.
    """

    def __init__(
        self,
        wall: StrainEnergy | Sequence[Layer],
        data: xr.Dataset,
        parameters: Mapping[str, Any],
        geometry: Mapping[str, Any] | None = None,
        *,
        mode: Mode = "auto",
        with_force: bool = False,
        error_in: str = "pressure",
        by_test: bool = False,
        nearby: bool = False,
        replaceable: bool = True,
    ) -> None:
        self.data, self.error_in, self._replaceable = data, error_in, replaceable
        self.by_test = by_test
        self._wall, self._distributions = wall, dict(parameters)
        measured = measured_of(geometry or {})
        deviations = {name: pm.Normal.dist() for name in measured}
        unknown = priors_of(geometry or {})
        self._stated = WallVariables(wall, self._parameters(parameters), unknown, deviations)
        settings: dict[str, Any] = {"with_force": with_force, "by_test": by_test, "nearby": nearby}
        settings["known_radii"] = error_in == "pressure"
        settings["errors"] = {name: value.sd for name, value in measured.items()}
        self._mode, self._settings = mode, settings
        self.way: Any = way_to_integrate(self._stated, data, mode=mode, **settings)
        self._known: Sequence[Array] = ()
        self._shared: dict[Hashable, tuple[Callable, dict[str, SharedVariable]]] = {}

    def with_data(self, data: xr.Dataset) -> "ForwardModel":
        """The same for other data of the same kind, at other radii say."""
        other = copy(self)
        other.data, other._shared = data, {}
        return other

    def errors(self, data: xr.Dataset, parameters: Mapping[str, Any]) -> Array:
        """Errors of curves of so many materials, relative to the largest value of each.

        Curves are right over the range of the distributions, of which materials may lie outside.
        Of layers nothing is said.
        """
        if not isinstance(self._wall, StrainEnergy):
            return np.zeros(1)
        return errors_of(self.way, self._wall, data, self._wall.split(parameters))

    def right_for(self, parameters: Mapping[str, Any]) -> "ForwardModel":
        """The same with curves that are right for these materials too."""
        if not isinstance(self._wall, StrainEnergy):
            raise TypeError("layers have no materials that curves are made right for")
        known = self._wall.split(parameters)
        if self._known:
            known = [np.concatenate(both) for both in zip(self._known, known, strict=True)]
        other = self.for_all(known)
        if isinstance(other.way, Direct):
            other.way = replace(other.way, order=HIGHEST_ORDER)
        return other

    @property
    def in_walls(self) -> bool:
        """Whether curves are by all nodes in the walls of a specimen."""
        return isinstance(self.way, Collocated) and isinstance(self.way.basis, WallNodes)

    def takes(self, data: xr.Dataset) -> bool:
        """Whether matrices of a specimen with these data are of a size that pays."""
        return not self.in_walls or data.sizes["obs"] <= _MOST_IN_WALLS

    def for_all(self, known: Sequence[Array] = ()) -> "ForwardModel":
        """The same by curves for all materials of the priors, of specimens of any number of points.

        They are right for materials that are `known`, entry by entry, too, and take long to make.
        """
        other, settings = copy(self), self._settings | {"known": known, "nearby": False}
        other.way = way_to_integrate(self._stated, self.data, mode=self._mode, **settings)
        other._known, other._shared = known, {}
        return other

    def nearby(
        self, draw: Callable[[], Mapping[str, Any]], variables: Set[SharedVariable]
    ) -> dict[SharedVariable, NDArray]:
        """Values of some of the shared variables that are right for materials like drawn ones.

        By these, whatever is made of curves takes less time. There are none where curves have few
        nodes already.
        """
        if not isinstance(self.way, Collocated) or not isinstance(self._wall, StrainEnergy):
            return {}
        energy, known, draw = self._wall, {}, cache(draw)

        def fewer(log_hoop: Array, log_axial: Array) -> tuple[NDArray[np.intp], Array]:
            # Curves and misfits have the same places.
            key = log_hoop.tobytes(), log_axial.tobytes()
            if key not in known:
                places, materials = (log_hoop, log_axial), energy.split(draw())
                known[key] = fewer_nodes(energy, places, materials, with_force=self.way.with_force)
            return known[key]

        values: dict[SharedVariable, NDArray] = {}
        for _, inputs in self._shared.values():
            arrays = {name: v.get_value(borrow=True) for name, v in inputs.items()}
            nodes = sum(v.size for name, v in arrays.items() if name.endswith("log_hoop"))
            if nodes >= _MANY_NODES and not variables.isdisjoint(inputs.values()):
                nearby = self.way.nearby_arrays(arrays, fewer)
                values |= {inputs[name]: array for name, array in nearby.items()}
        return values

    def by_matrices(self) -> "ForwardModel | None":
        """The same by constant matrices, of as many stretches as there may be; None if none can be.

        They take a tenth of the time. For which materials they are right, :meth:`errors` tells.
        """
        way, known = self.way, self._stated.known_tube and self._settings["known_radii"]
        if not isinstance(way, Direct) or not known or extension_tests(self.data).any():
            return None
        other = copy(self)
        other.way = Collocated(MOST_NODES, way.with_force, way.by_test)
        other._shared = {}
        return other

    def could_show(self, data: xr.Dataset, parameters: Mapping[str, Any]) -> NDArray[np.bool_]:
        """Whether materials might have shown a test of the data, with errors as large as a half."""
        if not isinstance(self._wall, StrainEnergy):
            raise TypeError("of layers it is not known what they show")
        return like_measured(self._wall, data, self._wall.split(parameters))

    def between(self) -> "ForwardModel":
        """The same tests at radii evenly spread between the ends of each.

        Those of an extension test are at axial stretches that are evenly spread.
        """
        return self.with_data(_between(self.data))

    def set_data(self, data: xr.Dataset) -> None:
        """Put other data of the same kind in the place of these, in all that was made of them."""
        if not self._replaceable:
            raise TypeError("these data are constants here: make the forward model replaceable")
        if data is self.data:
            return
        self.data = data
        for arrays_of, inputs in self._shared.values():
            arrays = arrays_of(data)
            if arrays.keys() != inputs.keys():
                raise ValueError(f"these data are of another kind: {sorted(arrays)} are measured")
            for name, value in arrays.items():
                inputs[name].set_value(value, borrow=True)

    def share(
        self,
        key: Hashable,
        arrays_of: Callable[[xr.Dataset], Arrays],
        make: Callable[[NDArray, str], Any] | None = None,
    ) -> dict[str, SharedVariable]:
        """Shared variables of arrays that are made of the data, and follow them.

        Where arrays of the same `key` have been shared, those are returned. Data of other lengths
        may replace these.
        """
        if key not in self._shared:
            folded = not self._replaceable and isinstance(self.way, Direct)
            make = make or (pt.constant if folded else _shared_variable)
            inputs = {name: make(value, name) for name, value in arrays_of(self.data).items()}
            self._shared[key] = arrays_of, inputs
        return self._shared[key][1]

    def tube(
        self,
        parameters: Mapping[str, Any],
        geometry: Mapping[str, Any] | None = None,
        deviations: Mapping[str, Any] | None = None,
    ) -> "SymbolicTube":
        """The tube with variables of a model in place of the distributions.

        The `deviations` of what was measured of the tube, in standard deviations, are vectors of
        the length of the tests.
        """
        wall: Any = self._wall
        if not isinstance(wall, StrainEnergy):
            wall = with_variables(wall, self._distributions, parameters)
        known = geometry or {}, deviations or {}
        return SymbolicTube(self, WallVariables(wall, self._parameters(parameters), *known))

    def _parameters(self, parameters: Mapping[str, Any]) -> dict[str, Any]:
        """Parameters of one material; layers bring their own."""
        return dict(parameters) if isinstance(self._wall, StrainEnergy) else {}


class Misfits(NamedTuple):
    """Sums of squared differences between a model and what was measured, by quantity."""

    squares: dict[str, TensorVariable]
    conditions: list[TensorVariable]
    """What must hold for there to be any."""
    force_sums: TensorVariable | None = None
    """Of each test, the sum of the differences themselves."""


class SymbolicTube(NamedTuple):
    """What a tube of variable material and geometry shows at the points of the data."""

    forward: ForwardModel
    wall: WallVariables

    def curves(self) -> dict[str, TensorVariable]:
        """Pressure and stiffness at the points, by their names.

        With measured forces ``axial_force`` as well, and ``radius``, the internal one, where it
        depends on what is unknown of the tube.
        """
        way = self.forward.way
        return way.curves(self.forward.share("curves", way.curve_arrays), self.wall)

    def conditions(self) -> list[TensorVariable]:
        """What must hold for there to be such a tube, where that is not known beforehand."""
        way = self.forward.way
        return way.conditions(self.forward.share("curves", way.curve_arrays), self.wall)

    def slopes(self) -> dict[str, TensorVariable]:
        """How the curves rise with the radius that was measured, by the names of the curves.

        ``pressure`` (kPa/mm), and with measured forces ``axial_force`` (mN/mm).
        """
        way = self.forward.way
        return way.slopes(self.forward.share("curves", way.curve_arrays), self.wall)

    def misfits(self, key: Hashable, targets_of: Callable[[xr.Dataset], Arrays]) -> Misfits:
        """Sums of squared differences between the curves and targets.

        `targets_of` gives what was measured at each point of data, NaN where nothing was:
        ``"pressure"`` (kPa), ``"slope"`` (kPa/mm, by the radius that was measured), ``"force"``
        (mN). Its `key` tells them from other targets of the same data. The sums have these names;
        with the error in the radius there is ``"radius"`` (mm²) in place of the pressure. With
        ``"force_sum"``, the forces once more, their differences are added up test by test as well.
        """
        way = self.forward.way
        inputs = self._inputs(
            ("misfits", key), lambda data: way.misfit_arrays(data, targets_of(data))
        )
        differences, conditions = way.differences(inputs, self.wall, self.forward.error_in)
        (force_sums,) = differences.pop("force_sum", [None])
        squares = {}
        for name, parts in differences.items():
            total = sum(pt.sum(pt.square(difference)) for difference in parts)
            conditions.append(total < _LARGEST_MISFIT)
            # Else a noise parameter's gradient would be 0 * inf. That of the material is zero by
            # the integral itself.
            known = pt.where(conditions[-1], total, 0.0)
            squares[name] = known + inputs.get(f"{name}_residual", 0.0)
            if name == "force" and force_sums is not None:
                force_sums = pt.where(conditions[-1], force_sums, 0.0)
        return Misfits(squares, conditions, force_sums)

    def mapped(self, key: Hashable, linear_of: Callable[[xr.Dataset], Callable]) -> TensorVariable:
        """A linear map of the pressures, and of the slopes by the radius that was measured.

        `linear_of` gives the map that belongs to data: it takes both as columns over ``obs``, and
        mixes no two tests. Its `key` tells it from other maps of the same data.
        """
        way = self.forward.way
        inputs = self._inputs(
            ("mapped", key), lambda data: way.mapped_arrays(data, linear_of(data))
        )
        return way.mapped(inputs, self.wall)

    def _inputs(self, key: Hashable, arrays_of: Callable[[xr.Dataset], Arrays]) -> dict[str, Any]:
        """Shared variables of a misfit or a map, with those of curves where it is made of these."""
        way, own = self.forward.way, self.forward.share(key, arrays_of)
        by_points = isinstance(way, ByPoints)
        return self.forward.share("curves", way.curve_arrays) | own if by_points else own


def _shared_variable(value: NDArray, name: str) -> Variable:
    return pytensor.shared(value, name=name, shape=(None,) * value.ndim)


def _between(data: xr.Dataset) -> xr.Dataset:
    names = [name for name in ("radius", "outer_diameter") if name in data]
    measured = {name: data[name].values.astype(float) for name in names}
    measured["axial_stretch"] = at_points(data, "axial_stretch")
    extended = extension_tests(data)
    between: dict[str, list[NDArray]] = {name: [] for name in measured}
    for test in range(data.sizes["test"]):
        own = {name: values[points_of(data, test)] for name, values in measured.items()}
        for name, values in own.items():
            along = own["axial_stretch"] if extended[test] else values
            between[name].append(evenly_along(along, values, _RADII_BETWEEN))
    points = {name: ("obs", np.concatenate(values)) for name, values in between.items()}
    of_points = np.repeat(np.arange(data.sizes["test"]), _RADII_BETWEEN)
    of_tests = {k: v for k, v in data.data_vars.items() if v.dims == ("test",) and k not in points}
    return xr.Dataset(points, {"test": ("obs", of_points)}).assign(of_tests)
