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
from pytensor.tensor.variable import TensorVariable
from scipy.linalg import solve_banded

from pymc_hyperelastic.models.forward import ForwardModel, SymbolicTube
from pymc_hyperelastic.models.forward.blocks import block_arrays, block_product, identity_of_tests
from pymc_hyperelastic.models.observation.noise import sd_of_sigma
from pymc_hyperelastic.models.observation.signals import (
    LARGEST,
    as_double,
    force_arrays,
    measured,
    offset_log_density,
    rows_of_forces,
    signals_of,
)
from pymc_hyperelastic.models.observation.slopes import precision_root, whiten, with_slopes

Array = NDArray[np.float64]


def register_measurements(
    tube: SymbolicTube,
    curves: Mapping[str, TensorVariable],
    *,
    sigma: Any,
    slope_weight: float = 0.0,
    force_sigma: Any = None,
    force_offset_sd: Any = None,
    diameter_noise_sd: Any = None,
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

    With an offset of the transducer the entries of the forces are those of each given the ones
    before it in its test, see :func:`offset_log_density`; with an error of the diameter they are
    given the pressures, too, see :func:`signals_of`.
    """
    forward, conditions = tube.forward, tube.conditions()

    def possible(mean: TensorVariable) -> TensorVariable:
        small = [pt.all(pt.abs(mean) < LARGEST)] if bounded else []
        needed = [*small, *conditions]
        return pt.where(reduce(and_, needed), mean, np.inf) if needed else mean

    def data_of(name: str, dims: str | None) -> dict[str, Any]:
        values = measured(forward, name, lambda array, name: pm.Data(name, array, dims=dims))
        return {"observed": values, "dims": dims}

    settings = data_of("pressure", dims)
    errors = {"sigma": sigma, "force_sigma": force_sigma, "diameter_noise_sd": diameter_noise_sd}
    expected = signals_of(tube, curves, **errors)
    if not with_slopes(slope_weight):
        mean, sd = possible(expected.pressure), expected.pressure_sd
        pressure = pm.Normal("measured_pressure", mean, sd, **settings)
    else:

        def linear_of(data: xr.Dataset) -> Callable[[Array, Array], Array]:
            return partial(whiten, precision_root(data, slope_weight), data, slope_weight)

        mean = tube.mapped(("whitened", slope_weight), linear_of)
        pressure = _correlated_normal(forward, possible(mean), sigma, slope_weight, **settings)
    if force_sigma is None:
        return
    if dims:
        model = pm.modelcontext(None)
        dims = model.name_for("force_obs")
        model.add_coord(dims, rows_of_forces(forward.data))
    settings = data_of("axial_force", dims)
    rows = force_arrays(tube)["rows"]
    # With an error of the diameter they depend on the pressures, drawn ones where these are drawn.
    mean = possible(expected.force_given(pressure, rows))
    if force_offset_sd is None:
        pm.Normal("measured_axial_force", mean, expected.force_sd, **settings)
    else:
        _offset_normal(tube, mean, expected.force_sd, force_offset_sd, **settings)


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

    def unwhitened(white: TensorVariable, blocks: Any, points: Any, place: Any) -> TensorVariable:
        return block_product(blocks, {"points": points, "place": place}, white)

    def dist(mean: TensorVariable, sigma: TensorVariable, *inverse: Any) -> TensorVariable:
        return unwhitened(pm.Normal.dist(mean, sd_of_sigma(sigma)), *inverse[:3])

    # One density for each point, given those before it: what criteria by points look at.
    return pm.CustomDist(
        "measured_pressure",
        mean,
        pt.zeros_like(mean) + as_double(sigma),
        *(inputs[name] for name in ("blocks", "points", "place")),
        dist=dist,
        logp=logp,
        support_point=lambda _rv, _size, mean, _sigma, *inverse: unwhitened(mean, *inverse),
        signature="(n),(n),(t,m,m),(k),(n)->(n)",
        **settings,
    )


def _offset_normal(
    tube: SymbolicTube, mean: TensorVariable, sd: Any, offset_sd: Any, **settings: Any
) -> TensorVariable:
    """Forces about `mean` with errors of their own, and one that all of a test share."""
    inputs = force_arrays(tube)

    def logp(
        value: Any, mean: TensorVariable, sd: TensorVariable, offset_sd: Any, *_: Any
    ) -> TensorVariable:
        possible = pt.isfinite(mean)
        error = pt.where(possible, value - mean, 0.0)
        log_density = offset_log_density(error, pt.square(sd), offset_sd, inputs)
        return pt.where(possible, log_density, -np.inf)

    def dist(
        mean: TensorVariable, sd: TensorVariable, offset_sd: Any, test: Any, points: Any, _: Any
    ) -> TensorVariable:
        of_tests = pt.zeros_like(points.sum(axis=-1), dtype="float64")
        offset = pm.Normal.dist(of_tests, offset_sd)
        return pm.Normal.dist(mean + offset[test], sd)

    return pm.CustomDist(
        "measured_axial_force",
        mean,
        pt.zeros_like(mean) + sd,
        as_double(offset_sd),
        inputs["test"],
        inputs["points"],
        dist=dist,
        logp=logp,
        support_point=lambda _rv, _size, mean, *_: mean,
        signature="(n),(n),(),(n),(t,m)->(n)",
        **settings,
    )
