"""Slopes of measured curves by central differences, and the precision of pressures given slopes.

A slope is by the radius at a held axial stretch. Extension tests have no slopes.
"""

import numpy as np
import xarray as xr
from scipy.linalg import eigvalsh_tridiagonal

from pymc_hyperelastic.data.inflation import (
    check_data,
    describe_test,
    extension_tests,
    measured_radius,
)
from pymc_hyperelastic.data.sheets import tubes_of


def balanced_slope_weight(data: xr.Dataset) -> float:
    r"""Slope weight ``β`` at which errors of slope and of pressure weigh alike.

    .. math:: β = \frac{\sum_i p_i^2}{\sum_i s_i^2}

    with the measured pressures ``p`` and their central differences ``s``: a model whose pressures
    and slopes are all wrong by the same fraction is penalised equally for both. Extension tests and
    tests of sheets are left out. Use one value for all classes, that of all data together:
    evidences under different likelihoods cannot be compared.

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
        If a test has too few points or repeated radii for a slope, or no slope differs from 0, or
        if there are no tests of tubes.

    See Also
    --------
    SlopeAugmented

    Examples
    --------
    >>> import pymc_hyperelastic as ph
    >>> round(ph.balanced_slope_weight(ph.load_dataset("simulated_sheep_aorta")), 2)
    3.03
    """
    check_data(data)
    tubes = tubes_of(data)
    if tubes is None:
        raise ValueError(
            "the data hold tests of sheets only, which have no slopes: give their errors in "
            "ph.Gaussian(stress_sd=...)"
        )
    data = tubes
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
    test, with_slope = data["test"].values, ~extension_tests(data)
    radius = measured_radius(data).values
    counts = np.bincount(test, minlength=len(with_slope))
    short = np.flatnonzero(with_slope & (counts < 3))
    if short.size:
        raise ValueError(
            f"{describe_test(data, int(short[0]))} has {counts[short[0]]} point(s), but the slope "
            "term needs at least 3: drop the experiment or set slope_weight=0"
        )
    interior = 1 + np.flatnonzero((test[:-2] == test[2:]) & with_slope[test[2:]])
    step = radius[interior + 1] - radius[interior - 1]
    # No instrument resolves NumPy's tolerance, a hundred-thousandth of a radius.
    alike = interior[np.isclose(radius[interior + 1], radius[interior - 1], atol=0)]
    if alike.size:
        i = alike[0]
        what = "half the outer diameter" if "outer_diameter" in data else "radius"
        labels = data["row"].values if "row" in data.coords else np.arange(radius.size)
        raise ValueError(
            f"{describe_test(data, int(test[i]))}: {what} repeats at rows {labels[i - 1]} and "
            f"{labels[i + 1]} ({radius[i - 1]:.6g} mm); the slope term needs distinct neighbouring "
            "radii: drop one or set slope_weight=0"
        )
    return interior, 1 / step


def number_of_slopes(data: xr.Dataset) -> int:
    """Return the number of points that have a slope."""
    return len(central_differences(data)[0])


def squared_singular_values(data: xr.Dataset) -> np.ndarray:
    r"""Return the eigenvalues ``s`` of ``D Dᵀ``, one for each slope.

    .. math:: \ln\det(I + β D^T D) = \sum_k \ln(1 + β s_k)
    """
    interior, difference = central_differences(data)
    # Slopes two places apart share a point: sorted so, the matrix is tridiagonal.
    order = np.lexsort((interior, interior % 2))
    interior, difference = interior[order], difference[order]
    shared = np.where(np.diff(interior) == 2, -difference[1:] * difference[:-1], 0.0)
    return eigvalsh_tridiagonal(2 * difference**2, shared) if interior.size else difference


def precision_root(data: xr.Dataset, slope_weight: float) -> tuple[np.ndarray, np.ndarray]:
    """Lower triangular ``B`` with ``BᵀB = I + β DᵀD``: its entries ``B[i, i]`` and ``B[i, i−2]``.

    If errors ``e`` have the precision ``BᵀB``, the entries of ``B e`` are independent and have one
    variance: row ``i`` of ``B`` gives the density of point ``i`` given the points before it. A row
    has no other entries.
    """
    interior, difference = central_differences(data)
    size = data.sizes["obs"]
    link = np.zeros(size + 2)
    link[interior + 1] = slope_weight * difference**2
    # Squared pivots of an elimination from the last point are `own + link`. Without a
    # subtraction they are exact, also where two radii are close.
    own = np.ones(size + 2)
    for i in reversed(range(size)):
        own[i] += link[i + 2] * own[i + 2] / (own[i + 2] + link[i + 2])
    diagonal = np.sqrt(own + link)[:size]
    return diagonal, -link[:size] / diagonal


def half_log_determinant(data: xr.Dataset, slope_weight: float) -> float:
    """Return ``½ ln det(I + β DᵀD)`` for a known ``β``, in a time proportional to the points."""
    return float(np.log(precision_root(data, slope_weight)[0]).sum())
