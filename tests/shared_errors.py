"""Pressures and forces with the errors that they share, written in NumPy without the package.

Laws are of the form ``λ ∂W/∂λ = g(ln λ)``: the integrals are Gauss-Legendre sums in the reference
radius, slopes are complex-step derivatives by the diameter, and covariances are dense.
"""

from dataclasses import dataclass, replace

import numpy as np
import pandas as pd

import pymc_hyperelastic as ph

WALL_ORDER = 64
COMPLEX_STEP = 1e-30
# Tests of the table that may be extension tests: one of all forces but one, and one of all.
EXTENDED = (0, 3)


def neo_hookean(mu):
    return lambda log: mu * np.exp(2 * log)


def ogden(mu, alpha):
    return lambda log: 4 * mu * np.sinh(alpha * log) / alpha


def pressure_and_force(layers, radius, inner, axial, k=1.0):
    """Of a wall of (law, thickness), from the inside out, at (complex) internal radii."""
    node, weight = np.polynomial.legendre.leggauss(WALL_ORDER)
    pressure, force, begin = 0.0, 0.0, inner
    for law, thickness in layers:
        reference = begin + thickness * (node + 1) / 2
        swelling = (reference**2 - inner**2) / (k * axial[:, None])
        current = np.sqrt(radius[:, None] ** 2 + swelling)
        hoop, axially = np.log(k * current / reference), np.log(axial)[:, None]
        radial = law(-hoop - axially)
        of_hoop, of_axial = law(hoop) - radial, law(axially) - radial
        weights = thickness / 2 * weight
        stretch = axial[:, None] * current * np.exp(hoop)
        pressure = pressure + (of_hoop / stretch) @ weights
        force = force + np.pi / (k * axial) * (((2 * of_axial - of_hoop) * reference) @ weights)
        begin = begin + thickness
    return pressure, force


def table(points=(6, 5, 4, 3, 1), seed=1):
    """Made-up points of five tests, some of whose forces were not measured, and none of one."""
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
    return ph.inflation_data(frame, measured=measured, check="ignore", **geometry)


def extended(measured="radius"):
    """The same tests, of which two are extension tests; those of no and of one force are not."""
    frame = table()
    for test in EXTENDED:
        own = frame["experiment"] == test
        frame.loc[own, "axial"] = np.linspace(1.45, 1.1, own.sum())
    frame["outer_diameter"] = 2 * np.sqrt(frame["radius"] ** 2 + 32 / frame["axial"])
    return dataset(frame, measured=measured)


@dataclass
class Dense:
    """The joint normal distribution of all pressures, then of all forces that were measured."""

    data: object
    layers: list
    inner: float = 7.0
    noise: float = 0.4
    force_noise: float = 3.0
    offset: float = 0.0
    diameter: float = 0.0

    def with_noise(self, **values):
        return replace(self, **values)

    @property
    def rows(self):
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
        sd = np.repeat([self.noise, self.force_noise], [points, forces])
        covariance = np.diag(sd**2)
        covariance[points:, points:] += self.offset**2 * (self.test[:, None] == self.test)
        slope = self.curves(1j * COMPLEX_STEP).imag / COMPLEX_STEP
        # The point of each measurement: those of one share the error of its diameter.
        point = np.concatenate([np.arange(points), self.rows])
        shared = point[:, None] == point
        return covariance + self.diameter**2 * np.outer(slope, slope) * shared

    def offsets(self):
        """Mean and standard deviation of each test's offset, given all that was measured."""
        members = np.zeros((self.data.sizes["test"], len(self.values)))
        members[self.test, self.data.sizes["obs"] + np.arange(len(self.rows))] = self.offset**2
        inverse = np.linalg.inv(self.covariance)
        mean = members @ inverse @ (self.values - self.mean)
        return mean, np.sqrt(self.offset**2 - np.diag(members @ inverse @ members.T))
