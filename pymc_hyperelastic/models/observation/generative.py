"""The generative likelihood: measured pressures, and forces, as observed variables."""

from collections.abc import Callable, Mapping
from functools import partial, reduce
from operator import and_
from typing import Any

import numpy as np
import pymc as pm
import pytensor.tensor as pt
import xarray as xr
from numpy.typing import NDArray
from pytensor.compile.sharedvalue import SharedVariable
from pytensor.tensor.variable import TensorVariable
from scipy.linalg import solve_banded

from pymc_hyperelastic.models.forward import ForwardModel, SymbolicTube
from pymc_hyperelastic.models.forward.blocks import block_arrays, block_product, identity_of_tests
from pymc_hyperelastic.models.observation.noise import sd_of_sigma
from pymc_hyperelastic.models.observation.slopes import precision_root, whiten, with_slopes

Array = NDArray[np.float64]

# kPa, or mN: beyond any tube; the square of what is smaller does not overflow.
_LARGEST_MEAN = np.float64(1e30)


def register_measurements(
    tube: SymbolicTube,
    curves: Mapping[str, TensorVariable],
    *,
    sigma: Any,
    slope_weight: float = 0.0,
    force_sigma: Any = None,
    dims: str | None = "obs",
    bounded: bool = True,
) -> None:
    r"""Add the measured pressures, and forces, as observed variables.

    .. math:: y \sim \mathcal{N}\big(\tilde μ, \tfrac{σ^2}{2} (B^T B)^{-1}\big), \qquad
        B^T B = I + β D^T D, \qquad B^T B \tilde μ = m + β D^T s

    ``B`` is lower triangular and ``√2 (B y − B μ̃)/σ`` standard normal: entry ``i`` of its
    log-density, with ``ln B_ii``, is ``ln p(y_i | the y before)``. Where the curves of a parameter
    overflow, or the tube is impossible, means are infinite and the log-likelihood ``−inf``, unless
    it is not `bounded`.
    """
    forward, conditions = tube.forward, tube.conditions()

    def possible(mean: TensorVariable) -> TensorVariable:
        if not bounded:
            return mean
        small = pt.all(pt.abs(mean) < _LARGEST_MEAN)
        return pt.where(reduce(and_, [small, *conditions]), mean, np.inf)

    settings = {"observed": _measured(forward, "pressure", dims), "dims": dims}
    if not with_slopes(slope_weight):
        sd = sd_of_sigma(_double(sigma))
        pm.Normal("measured_pressure", possible(curves["pressure"]), sd, **settings)
    else:

        def linear_of(data: xr.Dataset) -> Callable[[Array, Array], Array]:
            return partial(whiten, precision_root(data, slope_weight), data, slope_weight)

        mean = tube.mapped(("whitened", slope_weight), linear_of)
        _correlated_normal(forward, possible(mean), sigma, slope_weight, **settings)
    if force_sigma is not None:
        rows = forward.share("force_rows", lambda data: {"rows": _rows_of_forces(data)})["rows"]
        if dims:
            model = pm.modelcontext(None)
            dims = model.name_for("force_obs")
            model.add_coord(dims, _rows_of_forces(forward.data))
        pm.Normal(
            "measured_axial_force",
            possible(curves["axial_force"][rows]),
            sd_of_sigma(_double(force_sigma)),
            observed=_measured(forward, "axial_force", dims),
            dims=dims,
        )


def _measured(forward: ForwardModel, name: str, dims: str | None) -> SharedVariable:
    """What was measured of a quantity, where it was, as data of the model in context."""

    def arrays_of(data: xr.Dataset) -> dict[str, Array]:
        values = data[name].values.astype(float)
        return {f"{name}_data": values[np.isfinite(values)]}

    def make(values: Array, name: str) -> SharedVariable:
        return pm.Data(name, values, dims=dims)

    return forward.share(("measured", name), arrays_of, make)[f"{name}_data"]


def _rows_of_forces(data: xr.Dataset) -> NDArray[np.intp]:
    return np.flatnonzero(np.isfinite(data["axial_force"].values))


def _correlated_normal(
    forward: ForwardModel, mean: TensorVariable, sigma: Any, slope_weight: float, **settings: Any
) -> TensorVariable:
    """Pressures ``y`` with independent ``B y`` about `mean`, of the standard deviation ``σ/√2``."""

    def arrays_of(data: xr.Dataset) -> dict[str, Array]:
        root = precision_root(data, slope_weight)
        below = np.zeros_like(root)
        below[0], below[2, :-2] = root[2], root[0, 2:]
        inverse = solve_banded((2, 0), below, identity_of_tests(data))
        return {"before": root[0], "root": root[2], **block_arrays(data, inverse)}

    inputs = forward.share(("root", slope_weight), arrays_of)

    def logp(value: Any, mean: TensorVariable, sigma: TensorVariable, *_: Any) -> TensorVariable:
        # What is rolled in from the end has the factor 0.
        white = inputs["root"] * value + inputs["before"] * pt.roll(value, 2, axis=-1)
        # Else the gradient by sigma would be infinite where a mean is.
        possible = pt.isfinite(mean)
        square = pt.square(pt.where(possible, white - mean, 0.0) / sigma)
        log_density = pt.log(inputs["root"]) - pt.log(np.pi * pt.square(sigma)) / 2 - square
        return pt.where(possible, log_density, -np.inf)

    def dist(mean: TensorVariable, sigma: TensorVariable, *inverse: Any) -> TensorVariable:
        blocks, points, place, _ = inverse
        white = pm.Normal.dist(mean, sd_of_sigma(sigma))
        return block_product(blocks, {"points": points, "place": place}, white)

    # One density for each point, given those before it: what criteria by points look at.
    return pm.CustomDist(
        "measured_pressure",
        mean,
        _double(sigma),
        *(inputs[name] for name in ("blocks", "points", "place")),
        dist=dist,
        logp=logp,
        signature="(n),(),(t,m,m),(k),(n)->(n)",
        **settings,
    )


def _double(value: Any) -> TensorVariable:
    """A number in double precision: PyTensor reads 7.0 as a single-precision one."""
    return pt.as_tensor(value, dtype="float64")
