"""Slopes of measured curves by central differences, and the normaliser of their likelihood.

A slope is taken by the radius at a held axial stretch. Extension tests have no slopes.
"""

import numpy as np
import xarray as xr
from scipy.linalg import cholesky_banded, eigvals_banded, solve_banded

from pymc_hyperelastic.data.inflation import (
    check_inflation_data,
    describe_test,
    extension_tests,
    measured_radius,
    points_of,
)
from pymc_hyperelastic.mechanics.interpolation import chebyshev_nodes, value_to_coefficient

# Two radii count as one if they differ by less than this fraction of the largest step of their
# test: no instrument resolves them, and a slope between them would be a rounding error.
_SAME_STEP = 1e-5
# The same as a fraction of the largest radius of the test.
_SAME_RADIUS = 1e-7
# Largest diagonal entry of ``I + β DᵀD``: beyond it the 1 is rounded by more than a thousandth, and
# with it the determinant.
_LARGEST_PRECISION = 1e13


def balanced_slope_weight(data: xr.Dataset) -> float:
    r"""Slope weight ``β`` at which errors of slope and of pressure weigh alike.

    .. math:: β = \frac{\sum_i p_i^2}{\sum_i s_i^2}

    with the measured pressures ``p`` and their central differences ``s``: a model whose pressures
    and slopes are all wrong by the same fraction is penalised equally for both. Extension tests,
    which have no slopes, are left out of both sums.

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
        If a test has too few points or repeated radii for a slope, all pressures are equal, or all
        tests are extension tests.

    See Also
    --------
    SlopeAugmented

    Examples
    --------
    >>> import pymc_hyperelastic as ph
    >>> round(ph.balanced_slope_weight(ph.load_dataset("simulated_sheep_aorta")), 2)
    3.03
    """
    check_inflation_data(data)
    check_slopes(data)
    slope = measured_slopes(data)
    if not np.any(slope):
        raise ValueError("all slopes of the measured pressures are zero: no balance exists")
    with_slope = ~extension_tests(data)[data["test"].values]
    return float(np.sum(data["pressure"].values[with_slope] ** 2) / np.sum(slope**2))


def check_slopes(data: xr.Dataset) -> None:
    """Raise unless the data have slopes, between distinct radii."""
    if extension_tests(data).all():
        raise ValueError(
            f"{describe_test(data, 0)}: axial_stretch varies within this test and all others; "
            "extension tests have no slopes: take ph.Gaussian(...), or add inflation tests"
        )
    central_differences(data)


def measured_slopes(data: xr.Dataset) -> np.ndarray:
    """Central differences of the measured pressures at the interior points, kPa/mm."""
    interior, difference = central_differences(data)
    pressure = data["pressure"].values
    return difference * (pressure[interior + 1] - pressure[interior - 1])


def central_differences(data: xr.Dataset) -> tuple[np.ndarray, np.ndarray]:
    """Interior points of inflation tests, and the factor ``1/(r[i+1] − r[i−1])`` at each."""
    interior, difference = [np.empty(0, int)], [np.empty(0)]
    radius = measured_radius(data).values
    what = "half the outer diameter" if "outer_diameter" in data else "radius"
    for test in np.flatnonzero(~extension_tests(data)).tolist():
        points = points_of(data, test)
        rows = np.arange(points.start + 1, points.stop - 1)
        if not rows.size:
            raise ValueError(
                f"{describe_test(data, test)} has {points.stop - points.start} point(s), but the "
                "slope term needs at least 3: drop the experiment or set slope_weight=0"
            )
        step = radius[rows + 1] - radius[rows - 1]
        nearest = max(_SAME_STEP * np.abs(step).max(), _SAME_RADIUS * radius[points].max())
        alike = np.flatnonzero(np.abs(step) <= nearest)
        if alike.size:
            first = rows[alike[0]]
            labels = data["row"].values if "row" in data.coords else np.arange(radius.size)
            raise ValueError(
                f"{describe_test(data, test)}: {what} repeats at rows {labels[first - 1]} and "
                f"{labels[first + 1]} ({radius[first - 1]:.6g} mm); the slope term needs distinct "
                "neighbouring radii: drop one or set slope_weight=0"
            )
        interior.append(rows)
        difference.append(1 / step)
    return np.concatenate(interior), np.concatenate(difference)


def half_log_determinant(data: xr.Dataset, slope_weight: float) -> float:
    """``½ ln det(I + β DᵀD)``, of a matrix with two bands."""
    return float(np.sum(np.log(_cholesky(_precision_bands(data, slope_weight), data)[-1])))


def compressed_spectrum(data: xr.Dataset) -> tuple[np.ndarray, np.ndarray]:
    r"""Few numbers ``s`` and multiplicities ``m`` that stand for the eigenvalues of ``DᵀD``.

    .. math:: \ln\det(I + β D^T D) = \sum_k m_k \ln(1 + β s_k) \quad \text{for every } β > 0

    As a function of ``ln s``, ``ln(1 + β s)`` has its singularities ``±π`` away from the real axis,
    whatever ``β``: interpolation at Chebyshev points in ``ln s`` converges as a geometric series.
    """
    bands = _gram_bands(*central_differences(data), data.sizes["obs"])
    tests = (points_of(data, test) for test in np.flatnonzero(~extension_tests(data)).tolist())
    # The first two of each test are zero, but for rounding; all of an extension test's are.
    of_tests = [eigvals_banded(bands[:, points])[2:] for points in tests]
    eigenvalues = np.concatenate([np.empty(0), *of_tests])
    if not eigenvalues.size:
        return eigenvalues, eigenvalues
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


def precision_root(data: xr.Dataset, slope_weight: float) -> np.ndarray:
    """Lower triangular ``B`` with ``BᵀB = I + β DᵀD``, as the upper bands of ``Bᵀ``.

    If errors ``e`` have the precision ``BᵀB``, the entries of ``B e`` are independent and have one
    variance: row ``i`` of ``B`` gives the density of point ``i`` given the points before it. The
    only entries of a row are at ``i`` and ``i − 2``, the last and the first band.
    """
    bands = _precision_bands(data, slope_weight)
    # The usual factor has the transpose first: it is that of the points in reversed order.
    reversed_bands = bands[:, ::-1].copy()
    reversed_bands[0, 2:] = bands[0, :1:-1]
    factor = _cholesky(reversed_bands, data)
    root = factor[:, ::-1].copy()
    root[0, :2], root[0, 2:] = 0.0, factor[0, :1:-1]
    return root


def whiten(
    root: np.ndarray, data: xr.Dataset, slope_weight: float, pressure: np.ndarray, slope: np.ndarray
) -> np.ndarray:
    """``B μ̃ = B⁻ᵀ (m + β Dᵀ s)``: the expected ``B y`` of pressures and slopes at every point.

    Both arguments may have several columns. Slopes at the ends of a test, and slopes of extension
    tests, are ignored.
    """
    interior, difference = central_differences(data)
    weighted = (slope_weight * difference * slope[interior].T).T
    right = pressure.astype(float)
    np.add.at(right, interior + 1, weighted)
    np.add.at(right, interior - 1, -weighted)
    return solve_banded((0, 2), root, right)


def _precision_bands(data: xr.Dataset, slope_weight: float) -> np.ndarray:
    """``I + β DᵀD`` in SciPy's upper banded form."""
    bands = slope_weight * _gram_bands(*central_differences(data), data.sizes["obs"])
    bands[-1] += 1.0
    return bands


def _cholesky(bands: np.ndarray, data: xr.Dataset) -> np.ndarray:
    """Cholesky factor, or an error that names the nearest radii where rounding spoils it."""
    if bands[-1].max() < _LARGEST_PRECISION:
        return cholesky_banded(bands)
    interior, difference = central_differences(data)
    i = interior[np.argmax(np.abs(difference))]
    labels = data["row"].values if "row" in data.coords else np.arange(data.sizes["obs"])
    place = describe_test(data, int(data["test"].values[i]))
    raise ValueError(
        f"{place}: the radii of rows {labels[i - 1]} and {labels[i + 1]} are "
        f"{1 / np.abs(difference).max():.3g} mm apart, too little beside the slope weight for the "
        "slope term: drop one, or give a smaller slope_weight, or 0"
    )


def _gram_bands(interior: np.ndarray, difference: np.ndarray, size: int) -> np.ndarray:
    """``DᵀD`` in SciPy's upper banded form; the row of ``D`` at ``i`` has ``∓d`` at ``i ∓ 1``."""
    bands = np.zeros((3, size))
    np.add.at(bands[2], interior - 1, difference**2)
    np.add.at(bands[2], interior + 1, difference**2)
    bands[0, interior + 1] = -(difference**2)
    return bands
