"""Transform draws of any sampler to the unconstrained scale of a model's variables."""

from collections.abc import Callable

import numpy as np
import pymc as pm
import xarray as xr
from numpy.typing import NDArray
from pymc.logprob.transforms import CircularTransform

from pymc_hyperelastic.evidence.batched import BatchedFunction, unconstrain, value_shapes
from pymc_hyperelastic.evidence.checks import check_continuous, check_model, check_shape
from pymc_hyperelastic.evidence.mixture import Array
from pymc_hyperelastic.evidence.results import check_result
from pymc_hyperelastic.evidence.target import in_one_period

# Logarithm of a density of zero: a finite number, so that differences are defined.
NOTHING = -1e300

_DRAWS = ("chain", "draw")
_AT_A_BOUND = (
    "at a bound, which is infinitely far on the unconstrained scale. Rounding moves draws there: "
    "sample once more and keep the unconstrained draws too, as pm.sample(..., "
    "idata_kwargs={'include_transformed': True}) does, or leave these draws out"
)


def unconstrained_draws(model: pm.Model, tree: xr.DataTree) -> tuple[Array, list[str]]:
    """Return draws of all free variables, (chain, draw, unknown), and the unknowns' variables.

    Draws that the tree holds as ``unconstrained_posterior`` are preferred to those of the
    posterior: none of them was rounded to a bound.
    """
    check_model(model)
    check_continuous(model)
    posterior, shapes = _posterior(model, tree), value_shapes(model)
    size = posterior[0].shape[:2]
    values = _stored(model, tree, shapes, size)
    if values is None:
        flat = unconstrain(model, [v.reshape(-1, *v.shape[2:]) for v in posterior])
        values = [v.reshape(*size, *v.shape[1:]) for v in flat]
        for rv, value in zip(model.free_RVs, values, strict=True):
            _check_draws(rv.name, value, shapes[model.rvs_to_values[rv].name], _AT_A_BOUND)
    values = [value.reshape(*size, -1).astype(float) for value in values]
    names = np.repeat([rv.name for rv in model.free_RVs], [v.shape[2] for v in values])
    return np.concatenate(values, axis=2), names.tolist()


def log_density_function(model: pm.Model) -> Callable[[Array], Array]:
    """Return a function of points (..., d): the logarithm of what integrates to the evidence."""
    function = BatchedFunction.of_model(model, [model.logp() + in_one_period(model)])

    def density(points: Array) -> Array:
        flat = points.reshape(-1, points.shape[-1])
        values = function(flat)[0].astype(float)
        # A density may be infinite where numbers overflow.
        values[~np.isfinite(values)] = NOTHING
        return values.reshape(points.shape[:-1])

    return density


def _posterior(model: pm.Model, tree: xr.DataTree) -> list[Array]:
    """Draws of each free variable as they were stored."""
    check_result(tree, "pm.sample, ph.sample_smc or another sampler")
    if "posterior" not in tree.children:
        raise ValueError(f"the tree has no posterior; its groups are {sorted(tree.children)}")
    posterior = tree["posterior"]
    if lacking := [rv.name for rv in model.free_RVs if rv.name not in posterior.data_vars]:
        raise ValueError(
            f"the posterior lacks {lacking}, free variables of the model; it has "
            f"{list(posterior.data_vars)}: sample without var_names, or with all of them"
        )
    values = []
    for rv in model.free_RVs:
        if not set(_DRAWS) <= set(posterior[rv.name].dims):
            raise ValueError(
                f"{rv.name!r} has the dimensions {posterior[rv.name].dims}; expected 'chain', "
                "'draw' and its own"
            )
        values.append(posterior[rv.name].transpose(*_DRAWS, ...).values)
        _check_draws(rv.name, values[-1], rv.type.shape, "not finite: leave the chain out")
    return values


def _stored(
    model: pm.Model, tree: xr.DataTree, shapes: dict[str, tuple[int, ...]], size: tuple[int, ...]
) -> list[Array] | None:
    """Unconstrained draws of each free variable, if they are in the tree, all of the same size."""
    # Angles there may have gone round the circle.
    if any(isinstance(of, CircularTransform) for of in model.rvs_to_transforms.values()):
        return None
    stored, values = tree.children.get("unconstrained_posterior", {}), []
    for name in (model.rvs_to_values[rv].name for rv in model.free_RVs):
        if name not in stored or not set(_DRAWS) <= set(stored[name].dims):
            return None
        value = stored[name].transpose(*_DRAWS, ...).values
        if value.shape != (*size, *shapes[name]) or not np.isfinite(value).all():
            return None
        values.append(value)
    return values


def _check_draws(name: str, value: Array, expected: tuple[int | None, ...], what: str) -> None:
    check_shape(f"{name!r} of the posterior", value.shape[2:], expected)
    bad = ~np.isfinite(value).reshape(*value.shape[:2], -1).all(axis=-1)
    refuse_draws(bad, f"draws of {name!r}", f"are {what}")


def refuse_draws(bad: NDArray[np.bool_], draws: str, fault: str) -> None:
    """Raise ValueError that names the first of the bad draws, (chain, draw), if there are any."""
    if bad.any():
        chain, draw = np.argwhere(bad)[0]
        raise ValueError(
            f"{bad.sum()} of {bad.size} {draws}, the first of them draw {draw} of chain {chain}, "
            f"{fault}"
        )
