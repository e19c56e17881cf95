"""The generative likelihood: measured pressures, and forces, as observed variables."""

from collections.abc import Mapping, Sequence
from functools import reduce
from operator import and_
from typing import Any, Literal

import numpy as np
import pymc as pm
import pytensor.tensor as pt
import xarray as xr
from pytensor.graph.basic import Variable
from pytensor.tensor.variable import TensorVariable
from scipy.linalg import solve_banded

from pymc_hyperelastic.data.inflation import measured_radius, points_of
from pymc_hyperelastic.mechanics.collocation import CollocatedPressureIntegral, curve_matrices
from pymc_hyperelastic.mechanics.layers import Layer
from pymc_hyperelastic.mechanics.strain_energy.base import StrainEnergy
from pymc_hyperelastic.models.likelihood import OVERFLOW, ErrorIn, shared_inputs, with_slopes
from pymc_hyperelastic.models.rules import Rule, current_tube, tube_inputs
from pymc_hyperelastic.models.slopes import precision_root, whiten

__all__ = ["Likelihood", "check_generative", "register_measurements"]

Likelihood = Literal["paper", "generative"]

# kPa, or mN: beyond any tube; the square of what is smaller does not overflow.
_LARGEST_MEAN = np.float64(1e30)


def check_generative(slope_weight: Any, error_in: ErrorIn) -> None:
    """Raise unless the measured pressures can be an observed variable."""
    if error_in == "radius":
        raise ValueError(
            "with likelihood='generative' the measured pressures are drawn at known radii: leave "
            "error_in='radius' away, or take likelihood='paper'"
        )
    if isinstance(slope_weight, Variable):
        raise ValueError(
            "with likelihood='generative' slope_weight must be a number of mm², such as "
            "ph.balanced_slope_weight(data), and no distribution: it is part of the covariance, "
            "which is factorised once; take likelihood='paper' to infer it"
        )


def register_measurements(
    energy: StrainEnergy | Sequence[Layer],
    data: xr.Dataset,
    rule: Rule,
    parameters: dict[str, Any],
    curves: Mapping[str, TensorVariable],
    *,
    sigma: Any,
    slope_weight: float,
    force_sigma: Any = None,
    geometry: Mapping[str, Any] | None = None,
) -> None:
    r"""Add the measured pressures, and forces, as observed variables.

    .. math:: y \sim \mathcal{N}\big(\tilde μ, \tfrac{σ^2}{2} (B^T B)^{-1}\big), \qquad
        B^T B = I + β D^T D, \qquad B^T B \tilde μ = m + β D^T s

    ``B`` is lower triangular and ``√2 (B y − B μ̃)/σ`` standard normal: entry ``i`` of its
    log-density, with ``ln B_ii``, is ``ln p(y_i | the y before)``. Where the curves of a parameter
    overflow, or the tube is impossible, means are infinite and the log-likelihood ``−inf``.
    """
    layered = not isinstance(energy, StrainEnergy)
    conditions = []
    if rule.method == "quadrature" or layered:
        current = current_tube(energy, tube_inputs(data), geometry or {}, parameters)
        conditions = [current.possible] if geometry or layered else []

    def possible(mean: TensorVariable) -> TensorVariable:
        small = pt.all(pt.abs(mean) < _LARGEST_MEAN)
        return pt.where(reduce(and_, [small, *conditions]), mean, np.inf)

    pressure = pm.Data("pressure_data", data["pressure"].values.astype(float), dims="obs")
    name = "measured_pressure"
    settings = {"observed": pressure, "dims": "obs"}
    if not with_slopes(slope_weight):
        mean = possible(curves["pressure"])
        pm.Normal(name, mean, _double(sigma) / np.sqrt(2.0), **settings)
    else:
        root = precision_root(data, slope_weight)
        if rule.method == "collocation" and isinstance(energy, StrainEnergy):
            mean = _whitened_by_collocation(energy, data, rule, parameters, root, slope_weight)
        else:
            stiffness = pt.where(pt.isfinite(curves["stiffness"]), curves["stiffness"], OVERFLOW)
            slope = stiffness * current.growth
            mean = _whitened(data, curves["pressure"], slope, root, slope_weight)
        _correlated_normal(name, data, possible(mean), sigma, root, **settings)
    if force_sigma is not None:
        rows = np.flatnonzero(np.isfinite(data["axial_force"].values))
        model = pm.modelcontext(None)
        model.add_coord("force_obs", rows)
        force = data["axial_force"].values[rows].astype(float)
        pm.Normal(
            "measured_axial_force",
            possible(curves["axial_force"][rows]),
            _double(force_sigma) / np.sqrt(2.0),
            observed=pm.Data("axial_force_data", force, dims="force_obs"),
            dims="force_obs",
        )


def _whitened_by_collocation(
    energy: StrainEnergy,
    data: xr.Dataset,
    rule: Rule,
    parameters: dict[str, Any],
    root: np.ndarray,
    slope_weight: float,
) -> TensorVariable:
    """``B μ̃`` of known tubes: one constant matrix times the response."""
    arrays, place = curve_matrices(data, rule.nodes)
    shape = arrays["pressure_matrix"].shape
    pressure, stiffness = (
        arrays[name].reshape(-1, rule.nodes)[place]
        for name in ("pressure_matrix", "stiffness_matrix")
    )
    growth = (measured_radius(data) / data["radius"]).values[:, None]
    matrix = np.zeros((shape[0] * shape[1], shape[2]))
    matrix[place] = whiten(root, data, slope_weight, pressure, stiffness * growth)
    arrays = {
        "log_hoop": arrays["log_hoop"],
        "log_axial": arrays["log_axial"],
        "matrix": matrix.reshape(shape),
        "no_slopes": np.zeros((shape[0], 0, shape[2])),
    }
    inputs = shared_inputs("whitened", arrays)
    integral = CollocatedPressureIntegral(strain_energy=energy)
    mean, _ = integral(*inputs.values(), *energy.split(parameters))
    return mean.flatten()[place]


def _whitened(
    data: xr.Dataset,
    pressure: TensorVariable,
    slope: TensorVariable,
    root: np.ndarray,
    slope_weight: float,
) -> TensorVariable:
    """``B μ̃`` of any curves."""
    blocks = _Blocks(data)
    zero = np.zeros_like(blocks.identity)
    matrices = {
        "of_pressure": blocks.of(whiten(root, data, slope_weight, blocks.identity, zero)),
        "of_slope": blocks.of(whiten(root, data, slope_weight, zero, blocks.identity)),
    }
    inputs = shared_inputs("whitened", matrices)
    return blocks.product(inputs["of_pressure"], pressure) + blocks.product(
        inputs["of_slope"], slope
    )


def _correlated_normal(
    name: str,
    data: xr.Dataset,
    mean: TensorVariable,
    sigma: Any,
    root: np.ndarray,
    **settings: Any,
) -> TensorVariable:
    """Variable ``y`` with independent ``B y`` about `mean`, of the standard deviation ``σ/√2``."""
    inputs = shared_inputs(name, {"before": root[0], "root": root[2]})
    below = np.zeros_like(root)
    below[0], below[2, :-2] = root[2], root[0, 2:]
    blocks = _Blocks(data)
    inverse = pt.constant(blocks.of(solve_banded((2, 0), below, blocks.identity)))

    def logp(value: Any, mean: TensorVariable, sigma: TensorVariable) -> TensorVariable:
        # What is rolled in from the end has the factor 0.
        white = inputs["root"] * value + inputs["before"] * pt.roll(value, 2, axis=-1)
        # Else the gradient by sigma would be infinite where a mean is.
        possible = pt.isfinite(mean)
        square = pt.square(pt.where(possible, white - mean, 0.0) / sigma)
        log_density = pt.log(inputs["root"]) - pt.log(np.pi * pt.square(sigma)) / 2 - square
        return pt.where(possible, log_density, -np.inf)

    def dist(mean: TensorVariable, sigma: TensorVariable, size: Any) -> TensorVariable:
        return blocks.product(inverse, pm.Normal.dist(mean, sigma / np.sqrt(2.0)))

    # One density for each point, given those before it: what criteria by points look at.
    return pm.CustomDist(
        name, mean, _double(sigma), dist=dist, logp=logp, signature="(n),()->(n)", **settings
    )


class _Blocks:
    """Products with a matrix that has one block for each test, all padded to one size."""

    def __init__(self, data: xr.Dataset) -> None:
        test, points = data["test"].values, data.sizes["obs"]
        spans = [points_of(data, i) for i in range(data.sizes["test"])]
        size = max(span.stop - span.start for span in spans)
        position = np.arange(points) - np.array([span.start for span in spans])[test]
        self.identity = np.eye(size)[position]
        self._shape = len(spans), size
        self._place = test * size + position
        self._points = np.zeros(len(spans) * size, int)
        self._points[self._place] = np.arange(points)

    def of(self, rows: np.ndarray) -> np.ndarray:
        """Blocks (test, row, column) of rows (obs, column)."""
        padded = np.zeros((self._points.size, self._shape[1]))
        padded[self._place] = rows
        return padded.reshape(*self._shape, -1)

    def product(self, blocks: TensorVariable, vector: TensorVariable) -> TensorVariable:
        """Product of the blocks with a vector over ``obs``."""
        columns = vector[self._points].reshape((*self._shape, 1))
        return (blocks @ columns).flatten()[self._place]


def _double(value: Any) -> TensorVariable:
    """A number in double precision: PyTensor reads 7.0 as a single-precision one."""
    return pt.as_tensor(value, dtype="float64")
