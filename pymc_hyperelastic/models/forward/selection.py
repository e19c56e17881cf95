"""The selection of nodes for the materials of a prior, which many data points pay for."""

from dataclasses import replace

import numpy as np
import pytensor.tensor as pt
import xarray as xr

from pymc_hyperelastic.mechanics.selected_nodes import SelectedNodes
from pymc_hyperelastic.models.forward.prior_draws import (
    BEYOND,
    FEWEST,
    batches,
    in_numbers,
    largest_measured,
    largest_pressures,
    spread,
)
from pymc_hyperelastic.models.forward.tabulated import TabulatedQuadrature
from pymc_hyperelastic.models.forward.tube_variables import Array, WallVariables
from pymc_hyperelastic.models.moduli import has_additive_stress

# Materials from which nodes are selected, and for which they are then checked.
_SELECTED_FROM = 400
# Batches of draws among which these are looked for.
_MOST_BATCHES = 6
# Rounds in which materials with inaccurate curves are added; chosen by experiment.
_MOST_ROUNDS = 4
# Largest error of the few materials that may be inaccurate, relative to the largest value: the size
# of an error of measurement.
_VISIBLE = 1e-2
# Accepted error of all materials, in tolerances: far below an error of measurement. Chosen by
# experiment.
_ALL = 100.0
# Fraction of inaccurate materials with which no selection of nodes will do.
_TOO_MANY = 0.5
# Tolerance of the snapshots, in tolerances of the curves; chosen by experiment.
_OF_SNAPSHOTS = 1e-2
# Fraction of inaccurate materials from which on corners of the prior do not matter.
_MANY = 0.1


def select_nodes(
    tabulated: TabulatedQuadrature, wall: WallVariables, data: xr.Dataset, inaccurate: float
) -> TabulatedQuadrature | None:
    """Return matrices of nodes that are selected for possible materials of the prior, or None.

    Materials whose curves err by more than the tolerance are added, until among fresh draws no
    larger fraction is `inaccurate`.
    """
    energy, tolerance = wall.energy, tabulated.tolerance
    basis = SelectedNodes(
        energy,
        has_additive_stress(energy),
        _OF_SNAPSHOTS * tolerance,
        split=bool(energy.kinks(pt.zeros(()), **wall.parameters)),
    )
    pool = batches(wall.unknown)

    def draw() -> list[Array]:
        found: list[list[Array]] = []
        for _ in range(_MOST_BATCHES):
            draws = next(pool)
            pressures = largest_pressures(wall, data, draws)
            possible = (pressures < largest_measured(data, BEYOND)).all(axis=0)
            found.append([values[possible] for values in draws])
            if sum(len(values[0]) for values in found) >= _SELECTED_FROM:
                break
        return [np.concatenate(values)[:_SELECTED_FROM] for values in zip(*found, strict=True)]

    first = draw()
    if len(first[0]) < FEWEST:
        return None
    learned = in_numbers(wall, data, first if inaccurate > _MANY else spread(first))
    found: TabulatedQuadrature | None = replace(tabulated, basis=basis)
    for _ in range(_MOST_ROUNDS):
        found = found and found.with_materials(data, learned)
        if found is None:
            break
        draws = draw()
        errors = found.errors(data, in_numbers(wall, data, draws))
        wrong = errors > tolerance
        few = wrong.mean() <= inaccurate and errors.max() < _VISIBLE
        if few or errors.max() < _ALL * tolerance:
            return found
        if wrong.mean() > _TOO_MANY:
            break
        learned = in_numbers(wall, data, [values[wrong] for values in draws])
    return None
