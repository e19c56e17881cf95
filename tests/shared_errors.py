"""Pressures, forces and the errors that they share, computed in NumPy without the package.

Walls are integrated by Gauss-Legendre quadrature in the reference radius, divided where fibres
slacken. Slopes are complex-step derivatives, and covariance matrices are dense.
"""

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
import pymc as pm
import xarray as xr
from scipy import stats

import pymc_hyperelastic as ph

WALL_ORDER = 64
COMPLEX_STEP = 1e-30
# The tests of `table` that `extended` turns into extension tests: one lacks a force, one has all.
EXTENDED = (0, 3)


class Law(NamedTuple):
    """A material: ``σθθ − σrr`` and ``σzz − σrr`` as functions of ``ln λθ`` and ``ln λz``."""

    stresses: Callable[[Any, Any], tuple[Any, Any]]
    kinks: Callable[[Any], list] = lambda axial: []
    """Values of ``λθ²`` at an axial stretch where the stress is not smooth."""


def separable(response):
    """Law with an energy ``Σ w(ln λ)`` whose derivative ``w'`` is the response."""

    def stresses(log_hoop, log_axial):
        radial = response(-log_hoop - log_axial)
        return response(log_hoop) - radial, response(log_axial) - radial

    return Law(stresses)


def neo_hookean(mu):
    return separable(lambda log: mu * np.exp(2 * log))


def ogden(mu, alpha):
    return separable(lambda log: 4 * mu * np.sinh(alpha * log) / alpha)


def fibres(c, *families):
    """Neo-Hookean matrix with fibres (angle in degrees, k1, k2) that bear tension only."""

    def stresses(log_hoop, log_axial):
        hoop, axial = np.exp(2 * log_hoop), np.exp(2 * log_axial)
        radial = 1 / (hoop * axial)
        around, along = c * (hoop - radial), c * (axial - radial)
        for angle, k1, k2 in families:
            cosine, sine = np.cos(np.deg2rad(angle)) ** 2, np.sin(np.deg2rad(angle)) ** 2
            strain = cosine * (hoop - 1) + sine * (axial - 1)
            strain = np.where(strain.real > 0, strain, 0.0)
            pull = 2 * k1 * strain * np.exp(k2 * strain**2)
            around, along = around + pull * cosine * hoop, along + pull * sine * axial
        return around, along

    def kinks(axial):
        tangents = {round(abs(angle), 9): np.tan(np.deg2rad(angle)) for angle, *_ in families}
        return [1 - tangent**2 * (axial**2 - 1) for tangent in tangents.values()]

    return Law(stresses, kinks)


def pressure_and_force(layers, radius, inner, axial, k=1.0):
    """Pressure and axial force of layers (law, thickness), from inside out, at complex radii."""
    node, weight = np.polynomial.legendre.leggauss(WALL_ORDER)
    radius, axial, k = (np.reshape(x, (-1, 1)) for x in (radius, axial, k))
    pressure, force, begin = 0.0, 0.0, inner
    for law, thickness in layers:
        # Reference radii at which the squared hoop stretch has the values of the kinks.
        unloaded = k * (k * radius.real**2 - inner**2 / axial)
        with np.errstate(divide="ignore", invalid="ignore"):
            squares = [unloaded / (kink - k / axial) for kink in law.kinks(axial)]
        places = [np.sqrt(np.where(s > 0, s, 0.0)).clip(begin, begin + thickness) for s in squares]
        ends = [np.full(radius.shape, float(end)) for end in (begin, begin + thickness)]
        bounds = np.sort(np.concatenate([ends[0], *places, ends[1]], axis=1), axis=1)
        for low, high in pairwise(bounds.T[:, :, None]):
            reference = low + (high - low) * (node + 1) / 2
            current = np.sqrt(radius**2 + (reference**2 - inner**2) / (k * axial))
            log_hoop = np.log(k * current / reference)
            around, along = law.stresses(log_hoop, np.log(axial) + 0 * log_hoop)
            weights = (high - low) / 2 * weight
            pressure = pressure + (around / (axial * current * np.exp(log_hoop)) * weights).sum(1)
            of_force = np.pi / (k * axial) * (2 * along - around) * reference
            force = force + (of_force * weights).sum(1)
        begin = begin + thickness
    return pressure, force


def curves_and_slopes(layers, radius, inner, axial, k=1.0):
    """Pressure, its derivative by the radius, force, and its derivative by the radius."""
    both = pressure_and_force(layers, np.asarray(radius) + 1j * COMPLEX_STEP, inner, axial, k)
    return [part for x in both for part in (x.real, x.imag / COMPLEX_STEP)]


def paper_log_density(place, pressure, values, sigma, slope_weight):
    """The paper's log density of pressures at the places where they were measured.

    The imaginary part of the model's pressures is their slope times the complex step.
    """
    count, width = len(place), place[2:] - place[:-2]
    difference, interior = np.zeros((count - 2, count)), np.arange(count - 2)
    difference[interior, interior], difference[interior, interior + 2] = -1 / width, 1 / width
    misfit = np.sum((pressure.real - values) ** 2)
    lack = (pressure.imag / COMPLEX_STEP)[1:-1] - difference @ values
    misfit += slope_weight * np.sum(lack**2)
    gram = np.eye(count) + slope_weight * difference.T @ difference
    return np.linalg.slogdet(gram / (np.pi * sigma**2))[1] / 2 - misfit / sigma**2


def table(points=(6, 5, 4, 3, 1), seed=1):
    """Invented readings of five tests. One force is missing, or all of a test, or all but one."""
    rng = np.random.default_rng(seed)
    frames = []
    for test, count in enumerate(points):
        axial = (1.0, 1.2, 1.2, 1.1, 1.4)[test % 5]
        frame = pd.DataFrame({"radius": np.sort(rng.uniform(7.2, 8.8, count)), "axial": axial})
        frame["outer_diameter"] = 2 * np.sqrt(frame["radius"] ** 2 + 32 / axial)
        frame["pressure"] = np.linspace(2.0, 14.0, count) + rng.normal(0, 0.5, count)
        frame["axial_force"] = 300 * axial**3 - 250 + 20 * test + rng.normal(0, 5.0, count)
        frames.append(frame.assign(specimen="S", experiment=test))
    frames[0].loc[2, "axial_force"] = np.nan
    for frame in frames[1:2]:
        frame["axial_force"] = np.nan
    for frame in frames[2:3]:
        frame.loc[1:, "axial_force"] = np.nan
    return pd.concat(frames, ignore_index=True)


def dataset(frame=None, measured="radius", **geometry):
    frame = table() if frame is None else frame
    geometry = {"inner_radius": 7.0, "outer_radius": 9.0, "axial_stretch": "axial"} | geometry
    return ph.inflation_data(frame, ph.Tube(**geometry), measured=measured, check="ignore")


def extended(measured="radius"):
    """Data of `table` in which the axial stretch varies within two tests."""
    frame = table()
    for test in EXTENDED:
        own = frame["experiment"] == test
        frame.loc[own, "axial"] = np.linspace(1.45, 1.1, own.sum())
    frame["outer_diameter"] = 2 * np.sqrt(frame["radius"] ** 2 + 32 / frame["axial"])
    return dataset(frame, measured=measured)


@dataclass
class Dense:
    """The joint normal distribution of all pressures, then of all measured forces."""

    data: object
    layers: list
    inner: float = 7.0
    pressure_sd: Any = 0.4
    force_sd: Any = 3.0
    force_offset_sd: float = 0.0
    diameter_sd: Any = 0.0

    @property
    def rows(self):
        """Points at which a force was measured."""
        return np.flatnonzero(np.isfinite(self.data["axial_force"].values))

    @property
    def test(self):
        """The test of each force."""
        return self.data["test"].values[self.rows]

    @property
    def values(self):
        force = self.data["axial_force"].values[self.rows]
        return np.concatenate([self.data["pressure"].values, force])

    def curves(self, shift=0.0):
        """Pressures and measured forces where diameters are larger by a (complex) shift."""
        axial = self.data["axial_stretch"].values
        if self.data["axial_stretch"].dims == ("test",):
            axial = axial[self.data["test"].values]
        if "outer_diameter" in self.data:
            thickness = sum(thickness for _, thickness in self.layers)
            area = (self.inner + thickness) ** 2 - self.inner**2
            radius = (self.data["outer_diameter"].values + shift) / 2
            radius = np.sqrt(radius**2 - area / axial)
        else:
            radius = self.data["radius"].values + shift / 2
        pressure, force = pressure_and_force(self.layers, radius, self.inner, axial)
        return np.concatenate([pressure, force[self.rows]])

    @property
    def mean(self):
        return self.curves()

    @property
    def covariance(self):
        points, forces = self.data.sizes["obs"], len(self.rows)
        sd = np.repeat([self.pressure_sd, self.force_sd], [points, forces])
        covariance = np.diag(sd**2)
        same_test = self.test[:, None] == self.test
        covariance[points:, points:] += self.force_offset_sd**2 * same_test
        slope = self.curves(1j * COMPLEX_STEP).imag / COMPLEX_STEP
        # Pressure and force of one point share the error of its diameter.
        point = np.concatenate([np.arange(points), self.rows])
        same_point = point[:, None] == point
        return covariance + self.diameter_sd**2 * np.outer(slope, slope) * same_point

    def log_density(self, rows=slice(None)):
        """Log density of some of the measurements, by default of all."""
        normal = stats.multivariate_normal(self.mean[rows], self.covariance[rows, rows])
        return normal.logpdf(self.values[rows])

    def offsets(self):
        """Mean and standard deviation of each test's offset, given all measurements."""
        members = np.zeros((self.data.sizes["test"], len(self.values)))
        own = self.data.sizes["obs"] + np.arange(len(self.rows))
        members[self.test, own] = self.force_offset_sd**2
        inverse = np.linalg.inv(self.covariance)
        mean = members @ inverse @ (self.values - self.mean)
        return mean, np.sqrt(self.force_offset_sd**2 - np.diag(members @ inverse @ members.T))


def assert_predicted(model, point, mean, covariance, draws, seed):
    """Check draws of all measurements: whitened, they are independent and standard normal.

    The largest of 1000 numbers exceeds 5 standard errors once in 1700 seeds.
    """
    posterior = {name: (("chain", "draw"), np.full((1, draws), v)) for name, v in point.items()}
    with model:
        tree = pm.sample_posterior_predictive(
            xr.DataTree.from_dict({"posterior": xr.Dataset(posterior)}),
            random_seed=seed,
            progressbar=False,
            compile_kwargs={"mode": "FAST_COMPILE"},
        )
    predicted = tree["posterior_predictive"]
    drawn = np.concatenate([predicted[rv.name].values[0] for rv in model.observed_RVs], axis=1)
    white = np.linalg.solve(np.linalg.cholesky(covariance), (drawn - mean).T)
    assert np.abs(white.mean(axis=1)).max() < 5 / np.sqrt(draws)
    excess = np.cov(white) - np.eye(len(white))
    assert np.abs(np.diag(excess)).max() < 5 * np.sqrt(2 / draws)
    assert np.abs(excess - np.diag(np.diag(excess))).max() < 5 / np.sqrt(draws)
