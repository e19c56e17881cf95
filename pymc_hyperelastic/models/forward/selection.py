"""The selection of nodes for the materials of a prior, which many data points pay for."""

from dataclasses import replace

import numpy as np
import pytensor.tensor as pt
import xarray as xr

from pymc_hyperelastic.mechanics.selected_nodes import SelectedNodes
from pymc_hyperelastic.models.forward.integrator import MOST_ROUNDS
from pymc_hyperelastic.models.forward.tabulated import TabulatedQuadrature
from pymc_hyperelastic.models.forward.tube_variables import WallVariables
from pymc_hyperelastic.models.moduli import has_additive_stress

# Tolerance of snapshots, and of orders of quadrature, in tolerances of the curves: those of other
# materials err by more than those of the materials for which they are chosen.
FINER = 1e-2


def select_nodes(
    tabulated: TabulatedQuadrature, draws: WallVariables, data: xr.Dataset, inaccurate: float
) -> TabulatedQuadrature | None:
    """Return matrices of nodes that are selected for possible `draws` of the prior, or None.

    Nodes are selected for some of the draws, and others whose curves err by more than the tolerance
    are added, until among fresh draws no larger fraction is `inaccurate`.
    """
    energy, tolerance = draws.energy, tabulated.tolerance
    split = bool(energy.kinks(pt.zeros(()), **draws.parameters))
    basis = SelectedNodes(energy, has_additive_stress(energy), FINER * tolerance, split=split)
    first, *others = np.array_split(np.arange(len(draws.materials[0])), MOST_ROUNDS + 1)
    found = replace(tabulated, basis=basis)
    learned = draws.some(first)
    for chosen in others:
        found = found.with_materials(data, learned)
        fresh = draws.some(chosen)
        wrong = found.errors(data, fresh) > tolerance
        if wrong.mean() <= inaccurate:
            return found
        learned = fresh.some(wrong)
    return None
