"""Exact evidences and posteriors of inflation curves, which use nothing of the package.

The slope-augmented likelihood is written anew in NumPy: pressures by Gauss-Legendre quadrature in
the reference radius, stiffnesses as complex-step derivatives of these pressures, and the normaliser
from the determinant of a dense precision matrix. Only the layout of the inflation Dataset is
shared.

All three laws are proportional to their first parameter, a modulus. Given the second one, an
exponent, the log-likelihood is therefore a parabola in the modulus, and the two-dimensional
integrals of an evidence cost one row of responses for each value of the exponent.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import xarray as xr
from scipy.special import logsumexp

# Nodes through the wall. In R the hoop stretch varies as a low power, and exponents reach 40: with
# this order B/A = 2.5 is exact to rounding.
WALL_ORDER = 64
# A derivative by a complex step has no error of cancellation, so that the step may be this small.
COMPLEX_STEP = 1e-30
# The integration ends where the density has fallen by this many nats: exp(-60) = 1e-26.
NEGLIGIBLE = 60.0
# Two successive refinements have to agree on the log evidence to this.
QUADRATURE_TOLERANCE = 1e-8
# Points by which modes are sought over the exponent's whole range, and points of each zoom.
SCAN_POINTS, ZOOM_POINTS, ZOOMS = 241, 25, 5


# --- the three laws: dW^/dl_theta per unit of modulus, with W^(l, l_z) = W(1/(l l_z), l, l_z) -----


def power_law_response(hoop, axial, n):
    """``(1/2) [1 + (I1 - 3)/n]^(n - 1) dI1/dl``."""
    first_invariant = (hoop * axial) ** -2 + hoop**2 + axial**2
    derivative = 2 * hoop - 2 / (hoop**3 * axial**2)
    return derivative / 2 * (1 + (first_invariant - 3) / n) ** (n - 1)


def ogden_response(hoop, axial, alpha):
    """``(2/(alpha l)) (l^alpha - l^-alpha - l_r^alpha + l_r^-alpha)``, ``l_r = 1/(l l_z)``."""
    radial = 1 / (hoop * axial)
    safe = np.where(alpha == 0, 1.0, alpha)
    powers = (np.sinh(safe * np.log(hoop)) - np.sinh(safe * np.log(radial))) / safe
    return 4 / hoop * np.where(alpha == 0, np.log(hoop) - np.log(radial), powers)


def criscione_response(hoop, axial, b):
    """``(2 b/l) sinh(b g3)``, ``g3 = 2 ln l + ln l_z``."""
    return 2 * b / hoop * np.sinh(b * (2 * np.log(hoop) + np.log(axial)))


RESPONSES = {
    "PowerLawNeoHookean": power_law_response,
    "Ogden": ogden_response,
    "CriscioneType": criscione_response,
}


# --- one inflation experiment ---------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Curve:
    """Measured points of one experiment and its tube."""

    radius: np.ndarray
    pressure: np.ndarray
    inner_radius: float
    outer_radius: float
    axial_stretch: float = 1.0
    opening_angle: float = 0.0

    def differences(self) -> np.ndarray:
        """``D``: central differences at the interior points, as a dense matrix."""
        size = len(self.radius)
        matrix = np.zeros((max(size - 2, 0), size))
        for row in range(size - 2):
            step = self.radius[row + 2] - self.radius[row]
            matrix[row, row], matrix[row, row + 2] = -1 / step, 1 / step
        return matrix

    def responses(self, law: str, exponent) -> tuple[np.ndarray, np.ndarray]:
        """Pressure and stiffness per unit of modulus, each (exponent, point)."""
        node, weight = np.polynomial.legendre.leggauss(WALL_ORDER)
        half = (self.outer_radius - self.inner_radius) / 2
        reference = self.inner_radius + half * (node + 1)
        k = 2 * np.pi / (2 * np.pi - self.opening_angle)
        internal = self.radius[:, None] + 1j * COMPLEX_STEP
        swelling = (reference**2 - self.inner_radius**2) / (k * self.axial_stretch)
        current = np.sqrt(internal**2 + swelling)
        exponent = np.atleast_1d(exponent).astype(float)[:, None, None]
        response = RESPONSES[law](k * current / reference, self.axial_stretch, exponent)
        pressure = (response / (self.axial_stretch * current)) @ (half * weight)
        return pressure.real, pressure.imag / COMPLEX_STEP


def curves_of(data: xr.Dataset) -> list[Curve]:
    """Experiments of an inflation Dataset."""
    names = ("inner_radius", "outer_radius", "axial_stretch", "opening_angle")
    return [
        Curve(
            data["radius"].values[data["test"].values == test],
            data["pressure"].values[data["test"].values == test],
            *(float(data[name].values[test]) for name in names),
        )
        for test in range(data.sizes["test"])
    ]


# --- the likelihood -------------------------------------------------------------------------------


def log_normaliser(curves: Sequence[Curve], sigma: float, slope_weight: float) -> float:
    """Half the log determinant of precision over ``2 pi``; precision ``(2/s^2)(I + b D^T D)``."""
    total = 0.0
    for curve in curves:
        difference = curve.differences()
        gram = np.eye(len(curve.radius)) + slope_weight * difference.T @ difference
        total += np.linalg.slogdet(2 / sigma**2 * gram / (2 * np.pi))[1] / 2
    return total


def log_likelihood(
    curves: Sequence[Curve], law: str, modulus, exponent, *, sigma: float, slope_weight: float
) -> np.ndarray:
    """Log density of all pressures, at each pair of a modulus and an exponent."""
    modulus, exponent = np.broadcast_arrays(np.atleast_1d(modulus), np.atleast_1d(exponent))
    misfit = np.zeros(modulus.shape)
    for curve in curves:
        pressure, stiffness = curve.responses(law, exponent)
        misfit += ((modulus[:, None] * pressure - curve.pressure) ** 2).sum(axis=1)
        if slope_weight:
            slope = curve.differences() @ curve.pressure
            error = modulus[:, None] * stiffness[:, 1:-1] - slope
            misfit += slope_weight * (error**2).sum(axis=1)
    return log_normaliser(curves, sigma, slope_weight) - misfit / sigma**2


def parabola(curves, law, exponent, *, sigma, slope_weight):
    """Log-likelihood in the modulus ``m``, ``top - curvature (m - peak)^2``, by exponent."""
    terms = np.zeros((3, len(exponent)))
    for curve in curves:
        terms += _squares(curve, law, slope_weight, tuple(exponent))
    constant, linear, curvature = terms / sigma**2
    with np.errstate(divide="ignore", invalid="ignore"):
        peak = np.where(curvature > 0, linear / curvature, 0.0)
    # The misfit of the best modulus. This difference loses digits only for a perfect fit.
    top = log_normaliser(curves, sigma, slope_weight) - (constant - linear * peak)
    return top, curvature, peak


@lru_cache(maxsize=4096)
def _squares(curve: Curve, law: str, slope_weight: float, exponent: tuple[float, ...]):
    """``|y|^2``, ``y.q`` and ``|q|^2`` over pressures and weighted slopes, for each exponent."""
    pressure, stiffness = curve.responses(law, np.array(exponent))
    slope = curve.differences() @ curve.pressure
    model = np.concatenate([pressure, np.sqrt(slope_weight) * stiffness[:, 1:-1]], axis=1)
    measured = np.concatenate([curve.pressure, np.sqrt(slope_weight) * slope])
    return np.array(
        [np.full(len(model), measured @ measured), model @ measured, (model**2).sum(axis=1)]
    )


# --- evidence and posterior by quadrature ---------------------------------------------------------

Box = tuple[tuple[float, float], tuple[float, float]]
"""Ranges of the modulus and of the exponent."""


@dataclass(frozen=True, eq=False)
class Posterior:
    """A posterior as quadrature nodes: integrals over it are sums."""

    log_evidence: float
    modulus: np.ndarray
    exponent: np.ndarray
    weight: np.ndarray
    """Posterior probability of each node; they add up to one."""

    def mean(self, values: np.ndarray) -> float:
        return float(self.weight @ values)

    def sd(self, values: np.ndarray) -> float:
        return float(np.sqrt(self.weight @ (values - self.mean(values)) ** 2))


def posterior(
    curves: Sequence[Curve],
    law: str,
    *,
    sigma: float,
    slope_weight: float,
    box: Box,
) -> Posterior:
    """Posterior and evidence under a uniform prior on a box."""
    log_area = sum(np.log(high - low) for low, high in box)

    def rows(exponent, panels=4):
        """Nodes of the modulus and log (density times weight) there, a row for each exponent."""
        top, curvature, peak = parabola(
            curves, law, exponent, sigma=sigma, slope_weight=slope_weight
        )
        best = np.clip(peak, *box[0])
        # The density falls by c (|m - peak|^2 - |best - peak|^2): solved for a fall to nothing.
        with np.errstate(divide="ignore"):
            reach = np.sqrt((best - peak) ** 2 + NEGLIGIBLE / curvature)
        low, high = np.clip(peak - reach, *box[0]), np.clip(peak + reach, *box[0])
        node, weight = _panels(low, high, panels)
        fall = curvature[:, None] * (node - peak[:, None]) ** 2
        return node, top[:, None] - fall - log_area + np.log(weight)

    def marginal(exponent):
        return logsumexp(rows(np.asarray(exponent, float))[1], axis=1)

    windows = _windows(marginal, *box[1])
    panels, previous = 4, np.inf
    while True:
        columns = [_panels(*(np.array([x]) for x in window), panels) for window in windows]
        exponent = np.concatenate([node[0] for node, _ in columns])
        weight = np.concatenate([weight[0] for _, weight in columns])
        modulus, log_mass = rows(exponent, panels)
        log_mass = log_mass + np.log(weight)[:, None]
        log_evidence = float(logsumexp(log_mass))
        if abs(log_evidence - previous) < QUADRATURE_TOLERANCE:
            return Posterior(
                log_evidence,
                modulus.ravel(),
                np.broadcast_to(exponent[:, None], modulus.shape).ravel(),
                np.exp(log_mass - log_evidence).ravel(),
            )
        if panels > 256:
            raise ArithmeticError(f"quadrature does not settle: {previous}, then {log_evidence}")
        panels, previous = 2 * panels, log_evidence


def log_evidence_2d(data: xr.Dataset, law: str, **settings) -> float:
    """Exact log evidence of inflation data; settings are those of `posterior`."""
    return posterior(curves_of(data), law, **settings).log_evidence


def _panels(low: np.ndarray, high: np.ndarray, panels: int, order: int = 12):
    """Composite Gauss-Legendre rule on each interval: nodes and weights, (interval, node)."""
    node, weight = np.polynomial.legendre.leggauss(order)
    node = ((node + 1) / 2 + np.arange(panels)[:, None]).ravel() / panels
    width = (high - low)[:, None]
    return low[:, None] + width * node, width * np.tile(weight, panels) / (2 * panels)


def _windows(log_density, low: float, high: float) -> list[tuple[float, float]]:
    """Intervals outside which a density on ``(low, high)`` is negligible; every mode is found.

    Modes narrower than the spacing of the scan are found too, since their logarithm falls slowly.
    """
    grid = np.linspace(low, high, SCAN_POINTS)
    values = log_density(grid)
    padded = np.concatenate([[-np.inf], values, [-np.inf]])
    modes = []
    for i in np.flatnonzero((padded[1:-1] >= padded[:-2]) & (padded[1:-1] >= padded[2:])):
        left, right = grid[max(i - 1, 0)], grid[min(i + 1, SCAN_POINTS - 1)]
        for _ in range(ZOOMS):
            fine = np.linspace(left, right, ZOOM_POINTS)
            height = log_density(fine)
            j = int(np.argmax(height))
            left, right = fine[max(j - 1, 0)], fine[min(j + 1, ZOOM_POINTS - 1)]
        modes.append((float(height[j]), float(fine[j])))
    floor = max(height for height, _ in modes) - NEGLIGIBLE
    windows: list[tuple[float, float]] = []
    for _, mode in sorted((place, place) for height, place in modes if height > floor):
        ends = [_crossing(log_density, floor, mode, end) for end in (low, high)]
        if windows and ends[0] <= windows[-1][1]:
            windows[-1] = (windows[-1][0], max(ends[1], windows[-1][1]))
        else:
            windows.append((ends[0], ends[1]))
    return windows


def _crossing(log_density, floor: float, inside: float, end: float) -> float:
    """Place between a mode and the end of the range beyond which the density is negligible."""
    distance = np.geomspace(1e-5, 1, 101) * (end - inside)
    below = np.flatnonzero(log_density(inside + distance) < floor)
    return float(inside + distance[below[0]]) if below.size else float(end)
