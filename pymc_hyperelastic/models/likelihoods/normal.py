r"""Log densities of normal errors, independent or with an offset that a test shares.

An offset ``o ~ N(0, s_o²)`` shifts all forces of a test. Given errors ``u_i`` of forces with
variances ``w_i``,

.. math:: o \sim \mathcal{N}(v \textstyle\sum_i u_i / w_i,\ v), \qquad
    1/v = 1/s_o^2 + \textstyle\sum_i 1/w_i .
"""

from collections.abc import Mapping
from typing import Any

import numpy as np
import pytensor.tensor as pt
from pytensor.tensor.variable import TensorVariable

from pymc_hyperelastic.models.forward.blocks import table_of
from pymc_hyperelastic.models.priors import is_inferred


def normal_log_density(square: Any, variance: Any, count: Any = 1.0) -> TensorVariable:
    """Return the log density of normal errors.

    Parameters
    ----------
    square : tensor_like
        Squared errors, or sums of them.
    variance : tensor_like
        Variance of each error.
    count : tensor_like, default 1
        Number of errors in each sum.
    """
    return -(square / variance + count * pt.log(2 * np.pi * variance)) / 2


def log_density_by_points(
    error: TensorVariable, variance: Any, offset_sd: Any, inputs: Mapping[str, Any]
) -> TensorVariable:
    """Return the log density of each force, given those before it in its test.

    The offset is integrated out. The `inputs` are those of :func:`force_arrays`.
    """
    sums = (pt.cumsum(x, axis=-1) - x for x in weights_of_tests(error, variance, inputs))
    mean, left = (x.flatten()[inputs["place"]] for x in offset_moments(*sums, offset_sd))
    return normal_log_density(pt.square(error - mean), variance + left)


def log_density_ratio_of_offset(precision: Any, weighted: Any, offset_sd: Any) -> TensorVariable:
    """Return what an offset adds to the log density of independent errors, from the same sums."""
    mean, variance = offset_moments(precision, weighted, offset_sd)
    shrinkage = variance / pt.square(as_double(offset_sd))
    return (pt.square(mean) / variance + pt.log(shrinkage)) / 2


def offset_moments(
    precision: Any, weighted: Any, offset_sd: Any
) -> tuple[TensorVariable, TensorVariable]:
    """Return the posterior mean and variance of an offset.

    Parameters
    ----------
    precision, weighted : tensor_like
        Sums of the precisions of its errors, and of the errors times their precisions.
    offset_sd : tensor_like
        Standard deviation of the prior of the offset.
    """
    prior = pt.square(as_double(offset_sd))
    variance = prior / (1 + prior * precision)
    return variance * weighted, variance


def weights_of_tests(
    error: TensorVariable, variance: Any, inputs: Mapping[str, Any]
) -> tuple[TensorVariable, TensorVariable]:
    """Return the precision of each error, and error times precision, as tables by test."""
    precision = table_of(pt.zeros_like(error) + 1 / variance, inputs)
    return precision, table_of(error / variance, inputs)


def as_double(value: Any) -> TensorVariable:
    """Return a tensor in double precision: PyTensor reads 7.0 as a single-precision number."""
    return pt.cast(value, "float64") if is_inferred(value) else pt.as_tensor(value, dtype="float64")
