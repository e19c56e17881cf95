"""What the wall of a result is made of: its laws, and their parameters by draw."""

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
    """The layers of a wall, from the inside out, and their parameters."""

    wall: list[NamedLayer]
    member: Member
    """Of whom they are."""
    values: list[dict[str, Array]]
    """Of each layer its parameters, and its thickness: by (chain, draw, 1), vectors by entry."""


def wall_draws_of(
    tree: xr.DataTree, energy: StrainEnergy | Sequence[Layer] | None, specimen: str | None
) -> WallDraws:
    """The wall of a result, or that of `energy`, with the parameters that its posterior holds."""
    check_result(tree)
    if "posterior" not in tree.children:
        raise ValueError(
            f"the result has no posterior; its groups are {sorted(tree.children)} (of a class: "
            "classes['C1'] in place of classes)"
        )
    wall = wall_of(tree) if energy is None else named_layers(energy)
    member = member_of(tree, wall, specimen)
    _check_names(wall, member.posterior)
    return WallDraws(wall, member, [_layer_values(layer, member.posterior) for layer in wall])


def _check_names(wall: list[NamedLayer], posterior: xr.Dataset) -> None:
    """Raise unless the posterior holds what the wall needs of it."""
    needed = [v for layer in wall for v in layer.values.values() if isinstance(v, str)]
    if not needed:
        raise ValueError(
            "all of these layers is given in numbers, and nothing is taken from the posterior: "
            "distributions stand for what was inferred, ph.Layer(ph.NeoHookean(), 0.3)"
        )
    lacking = [name for name in needed if name not in posterior]
    if lacking:
        law = " and ".join(dict.fromkeys(layer.energy.name for layer in wall))
        raise ValueError(f"the posterior lacks {lacking}, parameters of {law}")


def _layer_values(layer: NamedLayer, posterior: xr.Dataset) -> dict[str, Array]:
    """Parameters, and thickness if it is a layer: by (chain, draw, 1), vectors by entry too."""
    sizes = {p.name: p.size for p in layer.energy.parameters}
    return {
        name: values_by_draw(posterior, value, sizes.get(name))
        if isinstance(value, str)
        else np.asarray(value, float)[None, None, None]
        for name, value in layer.values.items()
    }


def values_by_draw(posterior: xr.Dataset, name: str, size: int | None = None) -> Array:
    """Draws of a number by (chain, draw, 1), of a vector by (chain, draw, 1, entry)."""
    check_numbers(posterior, posterior, name, None, " of the posterior")
    variable = posterior[name]
    if size is None:
        single = [d for d in variable.dims if d not in ("chain", "draw") and variable.sizes[d] == 1]
        variable = variable.squeeze(single)
    rest = [d for d in variable.dims if d not in ("chain", "draw")]
    if variable.ndim - len(rest) != 2 or len(rest) != (size is not None):
        raise ValueError(
            f"{name!r} of the posterior has the dimensions {variable.dims}; expected chain and draw"
            + (f" and that of its {size} entries" if size else ": select one of each other")
        )
    return variable.transpose("chain", "draw", *rest).values.astype(float)[:, :, None]
