"""Curves as constant matrices times the material's response, for known radii and geometry."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np
import pytensor.tensor as pt
import xarray as xr

from pymc_hyperelastic.data.inflation import at_points, extension_tests, measured_radius
from pymc_hyperelastic.mechanics.collocation import (
    CollocatedIntegral,
    collocate,
    curve_matrices,
    wall_matrices,
)
from pymc_hyperelastic.mechanics.interpolation import (
    ChebyshevNodes,
    Group,
    KnownTubes,
    groups_by,
    response_function,
)
from pymc_hyperelastic.mechanics.selected_nodes import SelectedNodes
from pymc_hyperelastic.mechanics.tube import GEOMETRY
from pymc_hyperelastic.mechanics.wall import WALL_ORDER
from pymc_hyperelastic.models.forward.blocks import table_arrays
from pymc_hyperelastic.models.forward.integrator import Differences, Integrator, force_differences
from pymc_hyperelastic.models.forward.tube_variables import (
    Array,
    Arrays,
    Curves,
    Points,
    Values,
    WallVariables,
)


@dataclass(frozen=True)
class TabulatedQuadrature(Integrator):
    """Constant matrices times the responses of the material at the nodes of a basis.

    The geometry must be known; data that replace others must be of the same kind.
    """

    by_points: ClassVar[bool] = False

    basis: ChebyshevNodes | SelectedNodes
    """Chebyshev points in ``ln λθ`` for each axial stretch, or quadrature nodes that are selected
    in the walls of each specimen."""
    tolerance: float
    """Largest error of the curves, relative to their largest value, of materials for which the
    basis is refined."""

    def curve_arrays(self, data: xr.Dataset) -> Arrays:
        """Return the arrays of the data for :meth:`curves`."""
        tubes, groups = self.groups(data)
        matrices, place = curve_matrices(tubes, groups, self.basis)
        if not self.with_force:
            del matrices["force_matrix"], matrices["force_slope_matrix"]
        return matrices | {"place": place, "growth": tubes.growth}

    def curves(self, inputs: Values, wall: WallVariables) -> Curves:
        """Return pressure and stiffness at the points, and others, see :class:`Integrator`."""
        curves = self._integrals(inputs, ("pressure", "stiffness"), wall)
        if self.with_force:
            curves |= self._integrals(inputs, ("force", "force_slope"), wall)
            curves["axial_force"] = curves.pop("force")
        of_points = {name: rows.flatten()[inputs["place"]] for name, rows in curves.items()}
        return of_points | {"growth": inputs["growth"]}

    def misfit_arrays(self, data: xr.Dataset, targets: Mapping[str, Array]) -> Arrays:
        """Return the arrays of targets, which may be NaN, for :meth:`differences`.

        As many numbers as there are nodes stand for all points, see :func:`collocate`.
        """
        tubes, groups = self.groups(data)
        matrices, place = curve_matrices(tubes, groups, self.basis)
        if "force_sum" not in targets:
            return collocate(tubes, groups, matrices, targets)
        # The forces of a test have points in several groups: those with sums are not compressed.
        others = {name: target for name, target in targets.items() if not name.startswith("force")}
        arrays = collocate(tubes, groups, matrices, others)
        rows = np.flatnonzero(np.isfinite(targets["force"]))
        arrays |= table_arrays(data["test"].values[rows], data.sizes["test"])
        arrays |= {"force_rows": place[rows], "force_target": targets["force"][rows]}
        return arrays | {"force_matrix": matrices["force_matrix"]}

    def differences(self, inputs: Values, wall: WallVariables, error_in: str) -> Differences:
        """Return differences between curves and targets, compressed."""
        known = [name for name in ("pressure", "slope") if f"{name}_target" in inputs]
        found = self._integrals(inputs, known, wall)
        response = {name: rows - inputs[f"{name}_target"] for name, rows in found.items()}
        if "force_target" in inputs:
            force = self._integrals(inputs, ("force",), wall)["force"]
            if "force_rows" in inputs:
                response |= force_differences(inputs, force.flatten())
            else:
                response["force"] = force - inputs["force_target"]
        return response, []

    def values(self, data: xr.Dataset, wall: WallVariables, points: Points) -> Arrays:
        """Return curves (material, point) of a numeric wall at some of the points."""
        entries = [values[:, None] for values in wall.materials]
        tubes, groups = self.groups(data)
        kinds = {"pressure": False} | ({"axial_force": True} if self.with_force else {})
        curves = {name: np.full((len(entries[0]), len(points)), np.nan) for name in kinds}
        for group in groups:
            own = np.isin(points, group.points)
            if not own.any():
                continue
            interpolation = self.basis.interpolation(tubes, group)
            matrices = wall_matrices(tubes.at(points[own]), interpolation)
            log_hoop, log_axial = (x[None] for x in interpolation.places)
            for name, force in kinds.items():
                response = response_function(wall.energy, force)(log_hoop, log_axial, *entries)[0]
                curves[name][:, own] = response @ matrices["force" if force else name].T
        return curves

    def refined(self, data: xr.Dataset, wall: WallVariables) -> Integrator:
        """Return an integrator that is accurate for the materials of this wall, too.

        It has more of the selected nodes, or is pointwise quadrature if they will not do.
        """
        if isinstance(self.basis, SelectedNodes):
            other = self.with_materials(data, wall)
            if other.errors(data, wall).max() <= self.tolerance:
                return other
        return self.quadrature(WALL_ORDER)

    def with_materials(self, data: xr.Dataset, wall: WallVariables) -> "TabulatedQuadrature":
        """Return the same with nodes that are selected for these materials, too."""
        basis: Any = self.basis
        return replace(self, basis=basis.with_materials(self.groups(data)[0], wall.materials))

    def groups(self, data: xr.Dataset) -> tuple[KnownTubes, list[Group]]:
        """Return the tubes at all points of the data, and groups of points that share nodes."""
        if self.basis.by_stretch and extension_tests(data).any():
            raise ValueError(
                "axial_stretch varies within a test of these data, and in no test of the data that "
                "the model was made of: make the model of data that hold extension tests"
            )
        radius = data["radius"].values.astype(float)
        geometry = {name: at_points(data, name) for name in GEOMETRY}
        tubes = KnownTubes(radius, **geometry, growth=measured_radius(data).values / radius)
        key = test = data["test"].values
        if not self.by_test and self.basis.by_stretch:
            key = tubes.axial_stretch
        elif not self.by_test:
            key = data["specimen"].values[test]
        return tubes, groups_by(tubes, key)

    def _integrals(self, inputs: Values, names: Sequence[str], wall: WallVariables) -> Curves:
        """Matrices of these names, all of them of forces or none, times the responses at nodes."""
        force = names[0].startswith("force")
        integral = CollocatedIntegral(strain_energy=wall.energy, force=force)
        entries = wall.energy.split(wall.parameters)
        if self.by_test:
            entries = [pt.expand_dims(entry, -1) for entry in entries]
        matrices = [inputs[f"{name}_matrix"] for name in names]
        nodes = inputs["log_hoop"], inputs["log_axial"]
        rows = integral(*nodes, *matrices, *entries, return_list=True)
        return dict(zip(names, rows, strict=True))
