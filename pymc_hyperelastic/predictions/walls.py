"""Read the strain energies of a wall's layers, and their parameters by draw, from a result.

Predictions and material cards call :func:`wall_draws_of`.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from pymc_hyperelastic.evidence.results import check_result
from pymc_hyperelastic.evidence.stored import check_numbers
from pymc_hyperelastic.mechanics.layers import Layer
from pymc_hyperelastic.mechanics.strain_energy import StrainEnergy
from pymc_hyperelastic.models.settings import NamedLayer, named_layers, wall_of
from pymc_hyperelastic.predictions.members import Member, member_of

Array = NDArray[np.float64]


class WallDraws(NamedTuple):
    """The layers of a wall, from the inside out, and the draws of their parameters."""

    wall: list[NamedLayer]
    member: Member
    """Specimen whose parameters they are."""
    values: list[dict[str, Array]]
    """Parameters and thickness of each layer: (chain, draw, 1), vectors (chain, draw, 1, entry)."""


def wall_draws_of(
    tree: xr.DataTree, energy: StrainEnergy | Sequence[Layer] | None, specimen: str | None
) -> WallDraws:
    """Return the wall of a result, or of `energy` if given, with its parameters by draw.

    Raises
    ------
    ValueError
        If the result has no posterior, or the posterior lacks a parameter of the wall.
    """
    check_result(tree)
    if "posterior" not in tree.children:
        raise ValueError(
            f"the result has no posterior; its groups are {sorted(tree.children)} (if these are "
            "classes, select one: classes['C1'])"
        )
    wall = wall_of(tree) if energy is None else named_layers(energy)
    member = member_of(tree, wall, specimen)
    _check_names(wall, member.posterior)
    return WallDraws(wall, member, [_layer_values(layer, member.posterior) for layer in wall])


def _check_names(wall: list[NamedLayer], posterior: xr.Dataset) -> None:
    """Raise ValueError unless the posterior has all named parameters of the wall."""
    needed = [v for layer in wall for v in layer.values.values() if isinstance(v, str)]
    if not needed:
        raise ValueError(
            "all parameters and thicknesses of these layers are numbers, so that no value is taken "
            "from the posterior: leave out the parameters that were inferred, or give "
            "distributions for them, such as ph.Layer(ph.NeoHookean(), 0.3)"
        )
    lacking = [name for name in needed if name not in posterior]
    if lacking:
        law = " and ".join(dict.fromkeys(layer.energy.name for layer in wall))
        raise ValueError(f"the posterior lacks {lacking}, parameters of {law}")


def _layer_values(layer: NamedLayer, posterior: xr.Dataset) -> dict[str, Array]:
    """Return parameters, and the thickness of a layer: (chain, draw, 1), vectors with entries."""
    sizes = {p.name: p.size for p in layer.energy.parameters}
    return {
        name: values_by_draw(posterior, value, sizes.get(name))
        if isinstance(value, str)
        else np.asarray(value, float)[None, None, None]
        for name, value in layer.values.items()
    }


def values_by_draw(posterior: xr.Dataset, name: str, size: int | None = None) -> Array:
    """Return draws of a scalar, (chain, draw, 1), or of a vector, (chain, draw, 1, entry).

    `size` is the number of entries of a vector, or None for a scalar.
    """
    check_numbers(posterior, posterior, name, None, " of the posterior")
    variable = posterior[name]
    if size is None:
        single = [d for d in variable.dims if d not in ("chain", "draw") and variable.sizes[d] == 1]
        variable = variable.squeeze(single)
    rest = [d for d in variable.dims if d not in ("chain", "draw")]
    if variable.ndim - len(rest) != 2 or len(rest) != (size is not None):
        raise ValueError(
            f"{name!r} of the posterior has the dimensions {variable.dims}; expected chain and draw"
            + (
                f" and a dimension of its {size} entries"
                if size
                else ": select one along each other one"
            )
        )
    return variable.transpose("chain", "draw", *rest).values.astype(float)[:, :, None]
