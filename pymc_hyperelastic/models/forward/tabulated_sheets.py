"""Stresses of sheets under known stretches as constant matrices times responses at a few points.

The sum of squared misfits of any number of points is then that of as many rows as twice the number
of nodes, as for tubes: see :func:`~pymc_hyperelastic.mechanics.collocation.collocate`.
"""

from typing import Any

import numpy as np
import pytensor.tensor as pt
import xarray as xr
from numpy.typing import NDArray
from pytensor.graph.utils import MissingInputError
from pytensor.tensor.variable import TensorVariable

from pymc_hyperelastic.data.variables import nominal_points
from pymc_hyperelastic.mechanics.collocation import compressed_rows
from pymc_hyperelastic.mechanics.interpolation import evenly
from pymc_hyperelastic.mechanics.selected_nodes import COMPARED, SelectedNodes
from pymc_hyperelastic.mechanics.strain_energy.base import IsotropicStrainEnergy, StrainEnergy
from pymc_hyperelastic.mechanics.wall import response
from pymc_hyperelastic.models.forward.choose import BEYOND, FINER, draws_of_prior
from pymc_hyperelastic.models.forward.numbers import numeric_stresses
from pymc_hyperelastic.models.forward.tube_variables import Array, Arrays, Values, WallVariables
from pymc_hyperelastic.models.moduli import has_additive_stress
from pymc_hyperelastic.quantities import STRESSES

# Points from which on nodes are selected: the stresses of fewer take less time than the selection.
_MANY_POINTS = 200


class TabulatedSheets:
    """Stresses of sheets whose stretches are all known, from responses at selected nodes."""

    def __init__(self, energy: StrainEnergy, basis: SelectedNodes) -> None:
        self.energy, self.basis = energy, basis

    def arrays(self, data: xr.Dataset) -> Arrays:
        """Return nodes, and the matrix and target of the compressed misfits.

        With the responses ``g = (T, 2 σy − T)`` at the nodes, stresses are ``σx = D T`` and
        ``σy = D g_y``; a QR factorisation leaves as many rows as there are responses.
        """
        log_x, log_y = known_stretches(self.energy, data)
        factors = _nominal_factors(data, log_x, log_y)
        nodes = self._nodes(log_x, log_y)
        weights, _ = nodes.weights(log_x, log_y)
        blocks = [np.hstack([weights.T, 0 * weights.T]), np.hstack([weights.T, weights.T]) / 2]
        parts = []
        for block, factor, name in zip(blocks, factors, STRESSES, strict=True):
            target = data[name].values.astype(float)
            there = np.isfinite(target)
            rows = block[there] * factor[there, None]
            parts.append(np.column_stack([rows, target[there]]))
        rows, residual = compressed_rows(np.concatenate(parts))
        return {
            "log_x": nodes.places[0],
            "log_y": nodes.places[1],
            "matrix": rows[:, :-1],
            "target": rows[:, -1],
            "residual": np.array(residual),
        }

    def sum_of_squares(self, inputs: Values, parameters: Values) -> TensorVariable:
        """Return the sum of the squared misfits."""
        entries = self.energy.split(parameters)
        log_x, log_y, *entries = pt.broadcast_arrays(inputs["log_x"], inputs["log_y"], *entries)
        at_nodes = [response(self.energy, log_x, log_y, entries, force=f) for f in (False, True)]
        row = pt.concatenate(at_nodes, axis=-1)[..., None, :]
        found = (row @ inputs["matrix"].swapaxes(-1, -2)).squeeze(-2)
        return pt.sum(pt.square(found - inputs["target"])) + inputs["residual"]

    def errors(self, data: xr.Dataset, materials: list[Array]) -> Array:
        """Return the largest error of the stresses of each material, relative to the largest."""
        log_x, log_y = known_stretches(self.energy, data)
        nodes = self._nodes(log_x, log_y)
        some = evenly(len(log_x), COMPARED)
        weights, _ = nodes.weights(log_x[some], log_y[some])
        exact = _stresses(self.energy, (log_x[some], log_y[some]), materials)
        found = _stresses(self.energy, nodes.places, materials) @ weights
        scale = np.abs(exact).max(axis=(0, 2))
        error = np.abs(found - exact).max(axis=(0, 2)) / np.where(scale > 0, scale, 1.0)
        return np.where(np.isnan(error), np.inf, error)

    def _nodes(self, log_x: Array, log_y: Array) -> Any:
        some = evenly(len(log_x), COMPARED)
        in_order = np.argsort(log_x, kind="stable")[some]
        return self.basis.interpolation_at(log_x[in_order], log_y[in_order])


@np.errstate(all="ignore")  # some of the materials may be impossible
def tabulated_sheets(
    energy: StrainEnergy,
    data: xr.Dataset,
    parameters: Values,
    *,
    tolerance: float,
    inaccurate: float,
) -> TabulatedSheets | None:
    """Return a table for possible materials of the prior, or None.

    There is no table for few points, or if a stretch depends on the material.

    Nodes are selected for half of the draws of the prior, and must do for the other half, of which
    a fraction `inaccurate` may err by more than the `tolerance`.
    """
    log_x, log_y = known_stretches(energy, data)
    if len(log_x) < _MANY_POINTS or not np.isfinite(log_x + log_y).all():
        return None
    try:
        walls = draws_of_prior(WallVariables(energy, dict(parameters), {}), data.sizes["test"])
    except (MissingInputError, NotImplementedError):  # the range of the prior is not known
        return None
    some = evenly(len(log_x), COMPARED)
    places = log_x[some], log_y[some]
    largest = np.abs(_stresses(energy, places, walls.materials)).max(axis=(0, 2))
    measured = max(float(np.nanmax(np.abs(data[n].values), initial=0.0)) for n in STRESSES)
    possible = np.flatnonzero(largest < BEYOND * measured)
    first, others = np.array_split(possible, 2)
    if not (first.size and others.size):
        return None
    basis = SelectedNodes(energy, has_additive_stress(energy), FINER * tolerance, with_force=True)
    basis = basis.with_materials_at(places, walls.some(first).materials)
    found = TabulatedSheets(energy, basis)
    wrong = found.errors(data, walls.some(others).materials) > tolerance
    return found if wrong.mean() <= inaccurate else None


def known_stretches(energy: StrainEnergy, data: xr.Dataset) -> tuple[Array, Array]:
    """Return the logarithms of both stretches at all points; NaN where one is not known.

    The free lateral stretch of an isotropic sheet does not depend on its parameters.
    """
    x, y = (np.log(data[f"stretch_{axis}"].values.astype(float)) for axis in "xy")
    if isinstance(energy, IsotropicStrainEnergy):
        return np.where(np.isnan(x), -y / 2, x), np.where(np.isnan(y), -x / 2, y)
    return x, y


def _stresses(energy: StrainEnergy, places: tuple[Array, Array], materials: list[Array]) -> NDArray:
    """Return Cauchy stresses along x and y, (axis, material, place)."""
    return np.stack(numeric_stresses(energy, *places, [x[:, None] for x in materials])[:2])


def _nominal_factors(data: xr.Dataset, log_x: Array, log_y: Array) -> tuple[Array, Array]:
    """Return the factors of Cauchy stresses that make them the measured ones."""
    nominal = nominal_points(data)
    return np.where(nominal, np.exp(-log_x), 1.0), np.where(nominal, np.exp(-log_y), 1.0)
