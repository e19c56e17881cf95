"""The slope-augmented likelihood of inflation curves."""

from collections.abc import Mapping
from math import isfinite
from numbers import Real
from typing import Any, Literal, get_args

import numpy as np
import pymc as pm
import pytensor
import pytensor.tensor as pt
import xarray as xr
from pytensor.graph.basic import Constant, Variable
from pytensor.tensor.variable import TensorVariable
from scipy.linalg import cholesky_banded, eigvals_banded

from pymc_hyperelastic.collocation import (
    CollocatedPressureIntegral,
    chebyshev_nodes,
    collocate,
    nodes_needed,
    value_to_coefficient,
)
from pymc_hyperelastic.data import GEOMETRY, check_inflation_data, describe_test, points_of
from pymc_hyperelastic.pressure import PressureIntegral
from pymc_hyperelastic.strain_energy.base import StrainEnergy

__all__ = [
    "balanced_slope_weight",
    "check_likelihood",
    "inflation_likelihood",
    "likelihood_inputs",
    "log_likelihood",
    "nodes_for",
    "register_likelihood",
    "shared_inputs",
]

Mode = Literal["auto", "collocation", "quadrature"]

# kPa², or (kPa/mm)²: far beyond any tube; what is made of smaller numbers does not overflow.
_LARGEST_MISFIT = np.float64(1e60)


def inflation_likelihood(
    name: str,
    energy: StrainEnergy,
    data: xr.Dataset,
    parameters: dict[str, Any],
    *,
    sigma: Any,
    slope_weight: Any,
    mode: Mode = "auto",
) -> TensorVariable:
    r"""Add the likelihood of inflation curves to the PyMC model of the context, as a Potential.

    With ``Δp`` the model's pressures minus the measured ones, ``Δs`` its stiffnesses minus the
    central differences ``(p[i+1] − p[i−1])/(r[i+1] − r[i−1])`` at the interior points of each
    test, and ``D`` the matrix of these differences,

    .. math::

        \ln L = -\frac{|Δp|^2}{σ^2} - \frac{β}{σ^2} |Δs|^2
            - \frac{N}{2} \ln(π σ^2) + \frac12 \ln\det(I + β D^T D).

    The first two terms are the paper's. The others do not depend on the material: they normalise
    the likelihood as a density of the pressures, but for the small gap between the model's slopes
    and the differences of its own pressures, so that evidences are absolute and ``σ`` and ``β``
    can be inferred. There is no factor ½ with ``σ``, which is ``√2`` standard deviations.
    Where the pressure of a parameter overflows, the log-likelihood is ``−inf`` and its gradient 0.

    Parameters
    ----------
    name : str
        Name of the Potential.
    energy : StrainEnergy
        The material.
    data : xarray.Dataset
        Inflation data, see :func:`pymc_hyperelastic.inflation_data`.
    parameters : dict of str to tensor_like
        The material parameters by name: random variables, expressions or numbers.
    sigma : tensor_like
        The paper's ``σ``, kPa; a number or a random variable.
    slope_weight : tensor_like
        The paper's ``β``, mm²; a number or a random variable. With the number 0 slopes play no
        part. See :func:`balanced_slope_weight`.
    mode : {"auto", "collocation", "quadrature"}
        How the integral over the wall is taken. With "auto" it is a constant matrix, whose cost
        does not depend on the number of points, where that reaches rounding error over the range of
        the parameters' prior, and else direct quadrature at every point.

    Returns
    -------
    TensorVariable
        The Potential, a scalar.

    Raises
    ------
    TypeError
        If the parameters are not those of the strain energy, something is not a scalar, or no
        model is in context.
    ValueError
        If the name is taken, `sigma` or `slope_weight` is an impossible number, or a test has too
        few points or repeated radii for a slope.

    Examples
    --------
    >>> import pymc as pm, pymc_hyperelastic as ph
    >>> data = ph.load_dataset("simulated_sheep_aorta")
    >>> with pm.Model():
    ...     stiffness = pm.Gamma("stiffness", 2, 0.1)
    ...     potential = ph.inflation_likelihood(
    ...         "curves",
    ...         ph.Ogden(),
    ...         data,
    ...         {"mu": stiffness, "alpha": 6.0},
    ...         sigma=5 * ph.mmHg,
    ...         slope_weight=1.0,
    ...     )
    """
    if pm.Model.get_context(error_if_none=False) is None:
        raise TypeError("no model is in context: add the likelihood inside `with pm.Model():`")
    check_likelihood(energy, data, parameters, sigma=sigma, slope_weight=slope_weight)
    parameters = {key: _as_scalar(key, value) for key, value in parameters.items()}
    nodes = nodes_for(energy, data, parameters, mode)
    noise = {"sigma": sigma, "slope_weight": slope_weight}
    return register_likelihood(name, energy, data, nodes, parameters, **noise)


def register_likelihood(
    name: str,
    energy: StrainEnergy,
    data: xr.Dataset,
    nodes: int | None,
    parameters: dict[str, Any],
    *,
    sigma: Any,
    slope_weight: Any,
) -> TensorVariable:
    """Add the likelihood of checked input, with the number of nodes of :func:`nodes_for`."""
    inputs = shared_inputs(name, likelihood_inputs(data, nodes, slope_weight=slope_weight))
    return pm.Potential(
        name,
        log_likelihood(energy, inputs, parameters, sigma=sigma, slope_weight=slope_weight),
    )


def likelihood_inputs(
    data: xr.Dataset, nodes: int | None, *, slope_weight: Any
) -> dict[str, np.ndarray]:
    """Arrays by which the data enter :func:`log_likelihood`.

    They are kept apart from its expression, so that one compiled expression serves all data. With
    `nodes` they are those of collocation, else those of direct quadrature.
    """
    interior, slope = np.zeros(0, int), np.zeros(0)
    inputs = {"points": np.array(float(data.sizes["obs"]))}
    if _with_slopes(slope_weight):
        interior, slope = central_differences(data)[0], measured_slopes(data)
        if isinstance(slope_weight, Variable):
            inputs["eigenvalues"], inputs["multiplicities"] = compressed_spectrum(data)
        else:
            inputs["half_log_determinant"] = np.array(half_log_determinant(data, slope_weight))
    if nodes is not None:
        return inputs | collocate(data, nodes, interior, slope)
    tests = data["test"].values
    return inputs | {
        "radius": data["radius"].values.astype(float),
        "pressure": data["pressure"].values.astype(float),
        **{name: data[name].values.astype(float)[tests] for name in GEOMETRY},
        "interior": interior,
        "slope": slope,
    }


def shared_inputs(name: str, inputs: dict[str, np.ndarray]) -> dict[str, Variable]:
    """Shared variables of these arrays, which arrays of other lengths may replace."""
    return {
        key: pytensor.shared(value, name=f"{name}_{key}", shape=(None,) * value.ndim)
        for key, value in inputs.items()
    }


def nodes_for(
    energy: StrainEnergy, data: xr.Dataset, parameters: dict[str, Any], mode: Mode
) -> int | None:
    """Nodes of the collocation; None for direct quadrature."""
    if mode not in get_args(Mode):
        raise ValueError(f"mode is {mode!r}; expected one of {get_args(Mode)}")
    nodes = None if mode == "quadrature" else nodes_needed(energy, data, parameters)
    if nodes is None and mode == "collocation":
        raise ValueError(
            f"the response of {energy.name} cannot be collocated over the range of these "
            "parameters: use mode='quadrature'"
        )
    return nodes


def log_likelihood(
    energy: StrainEnergy,
    inputs: dict[str, Any],
    parameters: dict[str, Any],
    *,
    sigma: Any,
    slope_weight: Any,
) -> TensorVariable:
    """Log-likelihood of :func:`inflation_likelihood` as an expression of arrays and parameters."""
    if "log_hoop" in inputs:
        names: tuple[str, ...] = ("log_hoop", "log_axial", "pressure_matrix", "slope_matrix")
        op = CollocatedPressureIntegral(strain_energy=energy)
        targets = inputs["pressure_target"], inputs["slope_target"]
        residuals = inputs["pressure_residual"], inputs["slope_residual"]
        rows = slice(None)
    else:
        names = ("radius", *GEOMETRY)
        op = PressureIntegral(strain_energy=energy)
        targets = inputs["pressure"], inputs["slope"]
        residuals = 0.0, 0.0
        rows = inputs["interior"]
    values = (parameters[name] for name in energy.parameter_names)
    response = op(*(inputs[name] for name in names), *values)

    pressure, stiffness = response
    misfit, possible = _misfit(pressure - targets[0])
    misfit += residuals[0]
    log_density = -inputs["points"] / 2 * pt.log(np.pi * pt.square(sigma))
    if _with_slopes(slope_weight):
        slope_misfit, slope_possible = _misfit(stiffness[rows] - targets[1])
        possible &= slope_possible
        misfit += slope_weight * (slope_misfit + residuals[1])
        if isinstance(slope_weight, Variable):
            logs = pt.log1p(slope_weight * inputs["eigenvalues"])
            log_density += pt.sum(inputs["multiplicities"] * logs) / 2
        else:
            log_density += inputs["half_log_determinant"]
    return pt.where(possible, log_density - misfit / pt.square(sigma), -np.inf)


def _misfit(difference: TensorVariable) -> tuple[TensorVariable, TensorVariable]:
    """Sum of squares, 0 where it overflows, and whether it does not."""
    total = pt.sum(pt.square(difference))
    possible = total < _LARGEST_MISFIT
    # Else a noise parameter's gradient would be 0 * inf. That of the material is zero by the
    # integral itself.
    return pt.where(possible, total, 0.0), possible


def balanced_slope_weight(data: xr.Dataset) -> float:
    r"""Slope weight ``β`` at which errors of slope and of pressure weigh alike.

    .. math:: β = \frac{\sum_i p_i^2}{\sum_i s_i^2}

    with the measured pressures ``p`` and their central differences ``s``: a model whose pressures
    and slopes are all wrong by the same fraction is penalised equally for both.

    Use one value for all classes (that of all data together): evidences under different
    likelihoods cannot be compared.

    Parameters
    ----------
    data : xarray.Dataset
        Inflation data.

    Returns
    -------
    float
        ``β`` in mm².

    Raises
    ------
    ValueError
        If a test has too few points or repeated radii for a slope, or all pressures are equal.

    Examples
    --------
    >>> import pymc_hyperelastic as ph
    >>> round(ph.balanced_slope_weight(ph.load_dataset("simulated_sheep_aorta")), 2)
    3.03
    """
    check_inflation_data(data)
    slope = measured_slopes(data)
    if not np.any(slope):
        raise ValueError("all slopes of the measured pressures are zero: no balance exists")
    return float(np.sum(data["pressure"].values ** 2) / np.sum(slope**2))


def measured_slopes(data: xr.Dataset) -> np.ndarray:
    """Central differences of the measured pressures at the interior points, kPa/mm."""
    interior, difference = central_differences(data)
    pressure = data["pressure"].values
    return difference * (pressure[interior + 1] - pressure[interior - 1])


def central_differences(data: xr.Dataset) -> tuple[np.ndarray, np.ndarray]:
    """Interior points of every test, and the factor ``1/(r[i+1] − r[i−1])`` at each.

    Raises
    ------
    ValueError
        If a test has fewer than three points, or the two neighbours of a point share one radius.
    """
    interior, difference = [], []
    radius = data["radius"].values
    for test in range(data.sizes["test"]):
        points = points_of(data, test)
        rows = np.arange(points.start + 1, points.stop - 1)
        if not rows.size:
            raise ValueError(
                f"{describe_test(data, test)} has {points.stop - points.start} point(s), but the "
                "slope term needs at least 3: drop the experiment or set slope_weight=0"
            )
        step = radius[rows + 1] - radius[rows - 1]
        if not np.all(step):
            first = rows[np.flatnonzero(step == 0)[0]]
            labels = data["row"].values if "row" in data.coords else np.arange(radius.size)
            raise ValueError(
                f"{describe_test(data, test)}: radius repeats at rows {labels[first - 1]} and "
                f"{labels[first + 1]} ({radius[first - 1]:.6g} mm); the slope term needs distinct "
                "neighbouring radii: drop one or set slope_weight=0"
            )
        interior.append(rows)
        difference.append(1 / step)
    return np.concatenate(interior), np.concatenate(difference)


def half_log_determinant(data: xr.Dataset, slope_weight: float) -> float:
    """``½ ln det(I + β DᵀD)``, of a matrix with two bands."""
    bands = slope_weight * _gram_bands(*central_differences(data), data.sizes["obs"])
    bands[-1] += 1.0
    return float(np.sum(np.log(cholesky_banded(bands)[-1])))


def compressed_spectrum(data: xr.Dataset) -> tuple[np.ndarray, np.ndarray]:
    r"""Few numbers ``s`` and multiplicities ``m`` that stand for the eigenvalues of ``DᵀD``.

    .. math:: \ln\det(I + β D^T D) = \sum_k m_k \ln(1 + β s_k) \quad \text{for every } β > 0

    As a function of ``ln s``, ``ln(1 + β s)`` has its singularities ``±π`` away from the real axis,
    whatever ``β``: interpolation at Chebyshev points in ``ln s`` converges as a geometric series.
    """
    bands = _gram_bands(*central_differences(data), data.sizes["obs"])
    tests = (points_of(data, test) for test in range(data.sizes["test"]))
    eigenvalues = np.concatenate([eigvals_banded(bands[:, points]) for points in tests])
    # Two of each test are zero, but for rounding.
    eigenvalues = eigenvalues[eigenvalues > 1e-14 * eigenvalues.max()]
    logs = np.log(eigenvalues)
    centre, half = (logs.max() + logs.min()) / 2, np.ptp(logs) / 2
    if half > 0:
        rate = (np.pi + np.hypot(np.pi, half)) / half
        count = int(np.ceil(np.log(1e16) / np.log(rate)))
        if count < len(logs):
            angle = np.arccos(((logs - centre) / half).clip(-1, 1))
            moments = np.array([np.cos(k * angle).sum() for k in range(count)])
            eigenvalues = np.exp(centre + half * chebyshev_nodes(count))
            return eigenvalues, moments @ value_to_coefficient(count)
    return eigenvalues, np.ones(len(logs))


def _gram_bands(interior: np.ndarray, difference: np.ndarray, size: int) -> np.ndarray:
    """``DᵀD`` in SciPy's upper banded form; the row of ``D`` at ``i`` has ``∓d`` at ``i ∓ 1``."""
    bands = np.zeros((3, size))
    np.add.at(bands[2], interior - 1, difference**2)
    np.add.at(bands[2], interior + 1, difference**2)
    bands[0, interior + 1] = -(difference**2)
    return bands


def check_likelihood(
    energy: StrainEnergy,
    data: xr.Dataset,
    parameters: Mapping[str, Any],
    *,
    sigma: Any,
    slope_weight: Any,
) -> None:
    """Raise unless the likelihood of `data` can be written down."""
    PressureIntegral(strain_energy=energy)  # it says so if this is no strain energy
    if not isinstance(parameters, Mapping):
        raise TypeError(
            f"parameters must be a dict with the keys {list(energy.parameter_names)}, not "
            f"{type(parameters).__name__}"
        )
    if set(parameters) != set(energy.parameter_names):
        raise TypeError(
            f"{energy.name} has the parameters {list(energy.parameter_names)}, but "
            f"{sorted(parameters)} were given"
        )
    check_inflation_data(data)
    expected = {
        "sigma": "a positive number of kPa (5 mmHg is 5 * ph.mmHg)",
        "slope_weight": "a number of mm², 0 to leave the slopes out",
    }
    for name, value in (("sigma", sigma), ("slope_weight", slope_weight)):
        if isinstance(value, Variable):
            if value.type.ndim:
                raise TypeError(
                    f"{name} has {value.type.ndim} dimension(s); expected {expected[name]}, or a "
                    "scalar distribution"
                )
            continue
        if isinstance(value, bool) or not isinstance(value, Real):
            raise TypeError(f"{name} is {value!r}; expected {expected[name]}, or a distribution")
        if not isfinite(value) or value < 0 or (name == "sigma" and value == 0):
            raise ValueError(f"{name} is {value}; expected {expected[name]}")

    if _with_slopes(slope_weight):
        central_differences(data)


def _as_scalar(name: str, value: Any) -> TensorVariable:
    try:
        # As 6.0, PyTensor would keep a number in single precision.
        scalar = pt.as_tensor(value if isinstance(value, Variable) else np.asarray(value, float))
    except (TypeError, ValueError):
        raise TypeError(
            f"parameter {name!r} is {value!r}; expected a number, an expression or a random "
            "variable"
        ) from None
    if scalar.type.ndim:
        raise TypeError(
            f"parameter {name!r} has {scalar.type.ndim} dimension(s); expected a scalar"
        )
    if isinstance(scalar, Constant) and not np.isfinite(scalar.data):
        raise ValueError(f"parameter {name!r} is {value}; expected a finite number")
    return scalar


def _with_slopes(slope_weight: Any) -> bool:
    return isinstance(slope_weight, Variable) or slope_weight != 0
