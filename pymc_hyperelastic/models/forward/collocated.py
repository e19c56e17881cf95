"""Curves as constant matrices times the material's response, for known radii and geometry."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytensor.tensor as pt
import xarray as xr
from numpy.typing import NDArray
from pytensor.tensor.variable import TensorVariable

from pymc_hyperelastic.data.inflation import at_points, extension_tests, measured_radius
from pymc_hyperelastic.mechanics.collocation import (
    CollocatedAxialForce,
    CollocatedPressureIntegral,
    collocate,
    curve_matrices,
)
from pymc_hyperelastic.mechanics.empirical import EmpiricalNodes
from pymc_hyperelastic.mechanics.interpolation import (
    Basis,
    Group,
    Nodes,
    curve_errors,
    groups_by,
)
from pymc_hyperelastic.mechanics.known_tubes import KnownTubes
from pymc_hyperelastic.mechanics.strain_energy.base import StrainEnergy
from pymc_hyperelastic.mechanics.tube import GEOMETRY
from pymc_hyperelastic.mechanics.wall_nodes import WallNodes
from pymc_hyperelastic.models.forward.blocks import positions, table_arrays, table_of
from pymc_hyperelastic.models.forward.direct import WallVariables

Array = NDArray[np.float64]
Arrays = dict[str, NDArray]
# Of places, ``ln λθ`` and ``ln λz``, those that are nodes, and weights: see :func:`fewer_nodes`.
FewerNodes = Callable[[Array, Array], tuple[NDArray[np.intp], Array]]

# What names the arrays of extension tests.
_EXTENSION = "extension_"


def known_tubes(data: xr.Dataset) -> KnownTubes:
    """The tube at every point of the data."""
    radius = data["radius"].values.astype(float)
    geometry = {name: at_points(data, name) for name in GEOMETRY}
    return KnownTubes(radius, **geometry, growth=measured_radius(data).values / radius)


def groups_of(
    data: xr.Dataset, tubes: KnownTubes, *, by_test: bool = False
) -> tuple[list[Group], list[Group]]:
    """Groups of inflation tests at one axial stretch each, and one of all extension tests.

    With `by_test` each test is a group.
    """
    test = data["test"].values
    extended = extension_tests(data)[test]
    keys = (test, test) if by_test else (tubes.axial_stretch, np.zeros_like(test))
    held = groups_by(tubes, keys[0], np.flatnonzero(~extended), varied=False)
    varied = groups_by(tubes, keys[1], np.flatnonzero(extended), varied=True)
    return held, varied


def groups_of_specimens(data: xr.Dataset, tubes: KnownTubes, *, by_test: bool) -> list[Group]:
    """Groups of all tests on a specimen, or each test as a group."""
    test = data["test"].values
    specimen = np.unique(data["specimen"].values, return_inverse=True)[1]
    key = test if by_test else specimen[test]
    return groups_by(tubes, key, np.arange(len(test)), varied=True)


@dataclass(frozen=True)
class Collocated:
    """Constant matrices of so many Chebyshev stretches, or of nodes of another kind.

    Those of inflation tests are `nodes`, those of extension tests `grid`: 0, or None, if there are
    none, and then none may take the place of the data. With a `basis`, of nodes that the law asks
    for or of all in the walls, neither is needed, and tests of both kinds are a group. If only
    `taut` parts of walls count, these are where ``λθ ≥ 1``. The methods are those of
    :class:`~pymc_hyperelastic.models.forward.direct.Direct`; geometry is known, and plays no part
    in them.
    """

    nodes: int
    with_force: bool = False
    by_test: bool = False
    grid: Nodes | None = None
    taut: bool = False
    basis: EmpiricalNodes | WallNodes | None = None

    def tubes(self, data: xr.Dataset) -> KnownTubes:
        """The walls at all points, or their taut parts."""
        tubes = known_tubes(data)
        return tubes.divided()[0] if self.taut else tubes

    def errors(self, energy: StrainEnergy, data: xr.Dataset, materials: Sequence[Array]) -> Array:
        """Errors of curves of materials, see :func:`curve_errors`."""
        tubes = self.tubes(data)
        of_parts = [
            curve_errors(energy, basis, tubes, own, materials, with_force=self.with_force)
            for groups, basis in self._parts(data, tubes).values()
            if (own := [group for group in groups if group.points.size])
        ]
        return np.max(of_parts, axis=0)

    def curve_arrays(self, data: xr.Dataset) -> Arrays:
        """Arrays by which the data enter :meth:`curves`."""
        tubes = self.tubes(data)
        arrays = self._which(data) | {"growth": tubes.growth}
        for prefix, (groups, nodes) in self._parts(data, tubes).items():
            matrices, place = curve_matrices(tubes, groups, nodes)
            if not self.with_force:
                del matrices["force_matrix"], matrices["force_slope_matrix"]
            of_part = matrices | {"place": place}
            arrays |= {prefix + name: array for name, array in of_part.items()}
        return arrays

    def curves(self, inputs: Mapping[str, Any], wall: WallVariables) -> dict[str, TensorVariable]:
        """What the model says at the points."""

        def of_groups(part: Mapping[str, Any], entries: Sequence[Any]) -> dict[str, Any]:
            matrices = part["pressure_matrix"], part["stiffness_matrix"]
            pressure, stiffness = self._pressure(part, *matrices, wall, entries)
            curves = {"pressure": pressure, "stiffness": stiffness}
            if self.with_force:
                curves["axial_force"] = self._force(part, part["force_matrix"], wall, entries)
            return curves

        return self._at_points(inputs, wall, of_groups)

    def slopes(self, inputs: Mapping[str, Any], wall: WallVariables) -> dict[str, TensorVariable]:
        """How the curves rise with the radius that was measured, at the stretch of each point."""

        def of_groups(part: Mapping[str, Any], entries: Sequence[Any]) -> dict[str, Any]:
            matrices = part["pressure_matrix"], part["stiffness_matrix"]
            slopes = {"pressure": self._pressure(part, *matrices, wall, entries)[1]}
            if self.with_force:
                matrix = part["force_slope_matrix"]
                slopes["axial_force"] = self._force(part, matrix, wall, entries)
            return slopes

        by_radius = self._at_points(inputs, wall, of_groups)
        return {name: slope * inputs["growth"] for name, slope in by_radius.items()}

    def conditions(self, *_: Any) -> list[TensorVariable]:
        """None: known tubes are possible."""
        return []

    def misfit_arrays(self, data: xr.Dataset, targets: Mapping[str, Array]) -> Arrays:
        """Arrays by which data and targets, NaN where there are none, enter :meth:`differences`.

        As many numbers as there are stretches stand for all points, see :func:`collocate`.
        """
        tubes, arrays = self.tubes(data), self._which(data)
        arrays.pop("extended", None)
        compressed = {name: target for name, target in targets.items() if name != "force_sum"}
        residuals = {f"{name}_residual": np.zeros(()) for name in compressed}
        for prefix, (groups, nodes) in self._parts(data, tubes).items():
            of_part = collocate(tubes, groups, nodes, compressed)
            for name, residual in residuals.items():
                residual += of_part.pop(name)
            if "force_sum" in targets:
                rows = np.isfinite(targets["force_sum"])
                of_part |= _force_sum_arrays(data, tubes, groups, nodes, rows)
            arrays |= {prefix + name: array for name, array in of_part.items()}
        if "force_sum" in targets:
            known, tests = np.nan_to_num(targets["force_sum"]), data.sizes["test"]
            arrays["force_sum_target"] = np.bincount(data["test"].values, known, minlength=tests)
        return arrays | residuals

    def differences(
        self, inputs: Mapping[str, Any], wall: WallVariables, error_in: str
    ) -> tuple[dict[str, list[TensorVariable]], list[TensorVariable]]:
        """Differences between curves and targets, compressed."""
        response: dict[str, list[TensorVariable]] = {}
        sums = []
        for part, entries in self._inputs(inputs, wall):
            # Without slopes, as many rows of nothing.
            slope_matrix = part.get("slope_matrix", part["pressure_matrix"][:, :0])
            pressure, slope = self._pressure(
                part, part["pressure_matrix"], slope_matrix, wall, entries
            )
            found = {"pressure": pressure, "slope": slope}
            if "force_target" in part:
                found["force"] = self._force(part, part["force_matrix"], wall, entries)
            for name, curve in found.items():
                if f"{name}_target" in part:
                    response.setdefault(name, []).append(curve - part[f"{name}_target"])
            if "force_sum_matrix" in part:
                of_groups = self._force(part, part["force_sum_matrix"], wall, entries)
                sums.append(table_of(of_groups.flatten(), part).sum(axis=-1))
        if sums:
            response["force_sum"] = [sum(sums) - inputs["force_sum_target"]]
        return response, []

    def mapped_arrays(self, data: xr.Dataset, linear: Any) -> Arrays:
        """Arrays by which the data, and a linear map of each test, enter :meth:`mapped`."""
        tubes = self.tubes(data)
        arrays, growth = self._which(data), tubes.growth[:, None]
        for prefix, (groups, nodes) in self._parts(data, tubes).items():
            matrices, place = curve_matrices(tubes, groups, nodes)
            shape = matrices["pressure_matrix"].shape
            points = np.concatenate([group.points for group in groups])
            pressure, stiffness = np.zeros((2, len(place), shape[2]))
            pressure[points] = matrices["pressure_matrix"].reshape(-1, shape[2])[place[points]]
            stiffness[points] = matrices["stiffness_matrix"].reshape(-1, shape[2])[place[points]]
            matrix = np.zeros((shape[0] * shape[1], shape[2]))
            matrix[place[points]] = linear(pressure, stiffness * growth)[points]
            of_part = {
                "log_hoop": matrices["log_hoop"],
                "log_axial": matrices["log_axial"],
                "mapped_matrix": matrix.reshape(shape),
                "no_slopes": np.zeros((shape[0], 0, shape[2])),
                "place": place,
            }
            arrays |= {prefix + name: array for name, array in of_part.items()}
        return arrays

    def mapped(self, inputs: Mapping[str, Any], wall: WallVariables) -> TensorVariable:
        """A linear map of pressures and slopes: one constant matrix times the response."""

        def of_groups(part: Mapping[str, Any], entries: Sequence[Any]) -> dict[str, Any]:
            matrices = part["mapped_matrix"], part["no_slopes"]
            return {"mapped": self._pressure(part, *matrices, wall, entries)[0]}

        return self._at_points(inputs, wall, of_groups)["mapped"]

    def nearby_arrays(self, arrays: Arrays, fewer: FewerNodes) -> Arrays:
        """Arrays of few nodes in place of some of these, where there are at most half as many."""
        nearby: Arrays = {}
        for prefix in (_EXTENSION, ""):
            part = {n.removeprefix(prefix): v for n, v in arrays.items() if n.startswith(prefix)}
            arrays = {n: v for n, v in arrays.items() if not n.startswith(prefix)}
            if "log_hoop" in part:
                of_part = _by_fewer(part, fewer)
                if 2 * of_part["log_hoop"].size <= part["log_hoop"].size:
                    nearby |= {prefix + name: array for name, array in of_part.items()}
        return nearby

    def _at_points(
        self,
        inputs: Mapping[str, Any],
        wall: WallVariables,
        of_groups: Callable[[Mapping[str, Any], Sequence[Any]], dict[str, Any]],
    ) -> dict[str, TensorVariable]:
        """Curves over the points, of those that each of the parts has by groups."""
        of_parts = [
            {name: rows.flatten()[part["place"]] for name, rows in of_groups(part, own).items()}
            for part, own in self._inputs(inputs, wall)
        ]
        return {name: _joined(inputs, [part[name] for part in of_parts]) for name in of_parts[0]}

    def _parts(
        self, data: xr.Dataset, tubes: KnownTubes
    ) -> dict[str, tuple[Sequence[Group], Basis]]:
        """Groups and nodes of inflation tests and of extension tests, by what names their arrays.

        Where there are no tests of one kind a group without points stands for them.
        """
        if self.basis:
            return {"": (groups_of_specimens(data, tubes, by_test=self.by_test), self.basis)}
        held, varied = groups_of(data, tubes, by_test=self.by_test)
        for there, stretches, kind in (
            (held, self.nodes, "inflation tests, in which axial_stretch is held"),
            (varied, self.grid, "extension tests, in which axial_stretch varies"),
        ):
            if there and not stretches:
                raise ValueError(
                    f"these data hold {kind}, and those in whose place they are put hold none: "
                    "make the model of data that hold both"
                )
        if self.grid is None:
            return {"": (held, Nodes(self.nodes))}
        return {
            "": (held, Nodes(self.nodes)) if held else _NOTHING,
            _EXTENSION: (varied, self.grid) if varied else _NOTHING,
        }

    def _which(self, data: xr.Dataset) -> Arrays:
        """Which points are of extension tests; by test, of which test each group is."""
        if self.grid is None:
            return {}
        extended = extension_tests(data)
        arrays: Arrays = {"extended": extended[data["test"].values]}
        if self.by_test:
            for prefix, there in (("", ~extended), (_EXTENSION, extended)):
                tests = np.flatnonzero(there)
                arrays[f"{prefix}tests"] = tests if tests.size else np.zeros(1, int)
        return arrays

    def _inputs(
        self, inputs: Mapping[str, Any], wall: WallVariables
    ) -> list[tuple[Mapping[str, Any], list[Any]]]:
        """Inputs and entries of the parameters of each of the parts."""
        entries = wall.energy.split(wall.parameters)
        if self.grid is None:
            return [(inputs, entries)]
        start = len(_EXTENSION)
        varied = {k[start:]: v for k, v in inputs.items() if k.startswith(_EXTENSION)}
        held = {k: v for k, v in inputs.items() if not k.startswith(_EXTENSION)}
        if not self.by_test:
            return [(held, entries), (varied, entries)]
        return [(part, [x[part["tests"]] for x in entries]) for part in (held, varied)]

    def _pressure(
        self,
        part: Mapping[str, Any],
        pressure_matrix: Any,
        slope_matrix: Any,
        wall: WallVariables,
        entries: Sequence[Any],
    ) -> tuple[TensorVariable, TensorVariable]:
        integral = CollocatedPressureIntegral(strain_energy=wall.energy, per_group=self.by_test)
        return integral(*_stretches(part), pressure_matrix, slope_matrix, *entries)

    def _force(
        self, part: Mapping[str, Any], matrix: Any, wall: WallVariables, entries: Sequence[Any]
    ) -> TensorVariable:
        integral = CollocatedAxialForce(strain_energy=wall.energy, per_group=self.by_test)
        return integral(*_stretches(part), matrix, *entries)


def _by_fewer(part: Arrays, fewer: FewerNodes) -> Arrays:
    """Places of fewer nodes in each group, and matrices of the responses there."""
    places = part["log_hoop"], part["log_axial"]
    found = [fewer(hoop, axial) for hoop, axial in zip(*places, strict=True)]
    # Groups are padded to the same number, by their first node.
    most = max(len(nodes) for nodes, _ in found)
    chosen = np.array([np.pad(n, (0, most - len(n)), constant_values=n[0]) for n, _ in found])
    weights = np.array([np.pad(d, [(0, most - len(d)), (0, 0)]) for _, d in found])
    matrices = {n: v @ weights.mT for n, v in part.items() if n.endswith("_matrix")}
    hoop, axial = (np.take_along_axis(x, chosen, axis=1) for x in places)
    return matrices | {"log_hoop": hoop, "log_axial": axial}


# One node, where the tube is at rest.
_NOTHING = [Group(np.empty(0, int), (0.0, 0.0), (0.0, 0.0))], Nodes(1)


def _stretches(inputs: Mapping[str, Any]) -> tuple[Any, Any]:
    return inputs["log_hoop"], inputs["log_axial"]


def _joined(inputs: Mapping[str, Any], of_parts: Sequence[TensorVariable]) -> TensorVariable:
    """Curves at the points, of which each is of an inflation test or of an extension test."""
    if len(of_parts) == 1:
        return of_parts[0]
    held, varied = of_parts
    return pt.where(inputs["extended"], varied, held)


def _force_sum_arrays(
    data: xr.Dataset,
    tubes: KnownTubes,
    groups: Sequence[Group],
    basis: Basis,
    measured: NDArray[np.bool_],
) -> Arrays:
    """Matrices of the sum of each test's forces: a row for each group that it has points in.

    With them the table of these rows, test by test. A test without a force in these groups has
    none.
    """
    matrices, place = curve_matrices(tubes, groups, basis)
    forces = matrices["force_matrix"].reshape(-1, matrices["log_hoop"].shape[1])
    of_groups = [group.points[measured[group.points]] for group in groups]
    rows, tests = np.concatenate(of_groups), data.sizes["test"]
    group = np.repeat(np.arange(len(groups)), [len(points) for points in of_groups])
    # What a test has in one group, group by group, and then test by test.
    both, part_of = np.unique(group * tests + data["test"].values[rows], return_inverse=True)
    group, test = np.divmod(both, tests)
    position, width = positions(group)
    sums = np.zeros((len(groups), width, forces.shape[1]))
    row = group * width + position
    np.add.at(sums.reshape(-1, forces.shape[1]), row[part_of], forces[place[rows]])
    by_test = np.argsort(test, kind="stable")
    table = table_arrays(test[by_test], tests)
    # Without rows there is nothing to point to.
    points = row[by_test][table["points"]] if row.size else table["points"]
    return {"force_sum_matrix": sums, "points": points, "there": table["there"]}
