"""A table of models that have nothing to do with tubes, with evidences that are known otherwise.

Each is an ordinary PyMC model under proper priors. Its evidence comes from a closed form, a sum or
a quadrature over what no formula integrates, in NumPy and SciPy alone; test_evidences.py confirms
each one a second time from PyMC's own density. Scales, weights and data are unequal on purpose:
what holds for a standard normal density only is not worth holding.

An evidence is the density of the observed data with all its constants; where a model has a
`pm.Potential`, of which the source speaks, it is the prior's mean of that potential's exponential.
"""

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from typing import Literal

import numpy as np
import pymc as pm
import pytensor.tensor as pt
from scipy import stats
from scipy.special import logsumexp, wofz

# Two successive refinements of a quadrature have to agree to this.
QUADRATURE_TOLERANCE = 1e-8
# Nodes of one panel; panels are doubled until the quadrature settles, or has too many nodes.
ORDER, MOST_NODES = 8, 500_000


@dataclass(frozen=True)
class Problem:
    """A model and its exact log evidence."""

    name: str
    unknowns: int  # scalars on the unconstrained scale
    model: Callable[[], pm.Model]
    log_evidence: Callable[[], float]
    source: str  # how the value is had, and where the model is from
    modes: Literal["one", "several"] = "one"


# --- integrals -----------------------------------------------------------------------------------


def log_integral(log_density, *ranges, panels=8):
    """Logarithm of the integral of ``exp(log_density)`` over a box; the density broadcasts."""
    previous = np.inf
    while True:
        rules = [legendre(*range_, panels) for range_ in ranges]
        nodes = np.meshgrid(*(node for node, _ in rules), indexing="ij", sparse=True)
        weights = np.meshgrid(*(np.log(weight) for _, weight in rules), indexing="ij", sparse=True)
        value = float(logsumexp(log_density(*nodes) + sum(weights)))
        if abs(value - previous) < QUADRATURE_TOLERANCE:
            return value
        panels, previous = 2 * panels, value
        if (ORDER * panels) ** len(ranges) > MOST_NODES:
            raise ArithmeticError(f"quadrature does not settle at {value}")


def legendre(low, high, panels):
    """Nodes and weights of the composite Gauss-Legendre rule."""
    node, weight = np.polynomial.legendre.leggauss(ORDER)
    edges = np.linspace(low, high, panels + 1)
    width = (high - low) / panels
    return (edges[:-1, None] + width * (node + 1) / 2).ravel(), np.tile(width * weight / 2, panels)


def log_scale(prior):
    """Log density of the logarithm of a variable that has this prior."""
    return lambda t: prior.logpdf(np.exp(t)) + t


def log_normal(y, covariance):
    """Log density of `y` under a normal of mean zero, for each of a stack of covariances."""
    factor = np.linalg.cholesky(covariance)
    white = np.linalg.solve(factor, np.asarray(y)[:, None])[..., 0]
    log_det = np.log(np.diagonal(factor, axis1=-2, axis2=-1)).sum(axis=-1)
    return -(white**2).sum(axis=-1) / 2 - log_det - len(y) / 2 * np.log(2 * np.pi)


def linear_evidence(y, design, noise):
    """Log density of ``y = design x + noise e`` with standard normal ``x`` and ``e``.

    Stacks of designs and noises broadcast. Along the left singular vectors the data are
    independent, with variances ``d^2 + noise^2``, and with ``noise^2`` in all other directions.
    """
    left, d, _ = np.linalg.svd(design, full_matrices=False)
    along = (y[:, None] * left).sum(axis=-2)
    rest = ((y - (left * along[..., None, :]).sum(axis=-1)) ** 2).sum(axis=-1)
    noise2 = np.asarray(noise) ** 2
    variance = d**2 + noise2[..., None]
    others = len(y) - d.shape[-1]
    return -0.5 * (
        (np.log(2 * np.pi * variance) + along**2 / variance).sum(axis=-1)
        + others * np.log(2 * np.pi * noise2)
        + rest / noise2
    )


# --- linear regression ---------------------------------------------------------------------------


def regression_data(coefficients, rows, noise, seed):
    """Correlated columns of unequal size, prior sds of the coefficients, and measurements."""
    rng = np.random.default_rng(seed)
    columns = rng.normal(size=(rows, coefficients)) + 2 * rng.normal(size=(rows, 1))
    columns *= np.geomspace(0.5, 2, coefficients)
    scale = np.linspace(1, 3, coefficients)
    y = columns @ (scale * rng.normal(size=coefficients)) + noise * rng.normal(size=rows)
    return columns, scale, y


def regression(coefficients, rows, noise, seed):
    """Regression with known noise."""
    columns, scale, y = regression_data(coefficients, rows, noise, seed)

    def model():
        with pm.Model() as model:
            slope = pm.Normal("slope", 0, scale)
            pm.Normal("y", pt.dot(columns, slope), noise, observed=y)
        return model

    return Problem(
        f"regression_{coefficients}",
        coefficients,
        model,
        lambda: float(linear_evidence(y, columns * scale, noise)),
        "closed form, normal",
    )


def regression_unknown_noise(name, coefficients, rows, noise, seed):
    """Regression whose noise is unknown; where it is small, far below the prior's noise."""
    columns, scale, y = regression_data(coefficients, rows, noise, seed)

    def model():
        with pm.Model() as model:
            slope = pm.Normal("slope", 0, scale)
            sigma = pm.HalfNormal("sigma", 1)
            pm.Normal("y", pt.dot(columns, slope), sigma, observed=y)
        return model

    def log_density(t):
        prior = log_scale(stats.halfnorm)(t)
        return linear_evidence(y, columns * scale, np.exp(t)) + prior

    return Problem(
        name,
        coefficients + 1,
        model,
        lambda: log_integral(log_density, (-12, 4)),
        "1-D quadrature over the log noise of the closed form",
    )


def conjugate_regression():
    """Coefficients whose prior scales with the noise."""
    columns, scale, y = regression_data(5, 25, 0.7, seed=6)
    shape, rate = 3.0, 2.0

    def model():
        with pm.Model() as model:
            variance = pm.InverseGamma("variance", shape, rate)
            slope = pm.Normal("slope", 0, scale * pt.sqrt(variance))
            pm.Normal("y", pt.dot(columns, slope), pt.sqrt(variance), observed=y)
        return model

    def log_evidence():
        covariance = np.eye(len(y)) + (columns * scale) @ (columns * scale).T
        marginal = stats.multivariate_t(shape=rate / shape * covariance, df=2 * shape)
        return float(marginal.logpdf(y))

    return Problem(
        "conjugate_regression", 6, model, log_evidence, "closed form, normal-inverse-gamma"
    )


# --- waves ---------------------------------------------------------------------------------------


def waves(time, frequency):
    """Sine and cosine, the columns of a design for each of a stack of frequencies."""
    phase = 2 * np.pi * np.asarray(frequency)[..., None] * time
    return np.stack([np.sin(phase), np.cos(phase)], axis=-1)


def sine_frequency():
    """Frequency of a sine with a small unknown noise: one needle in a broad range."""
    rng = np.random.default_rng(7)
    time = np.sort(rng.uniform(0, 10, 40))
    low, high, truth, scale = 0.1, 5.0, 1.7, 2.0
    y = waves(time, truth) @ [1.3, -0.7] + 0.05 * rng.normal(size=40)

    def model():
        with pm.Model() as model:
            frequency = pm.Uniform("frequency", low, high)
            amplitude = pm.Normal("amplitude", 0, scale, shape=2)
            sigma = pm.HalfNormal("sigma", 1)
            phase = 2 * np.pi * frequency * time
            wave = amplitude[0] * pt.sin(phase) + amplitude[1] * pt.cos(phase)
            pm.Normal("y", wave, sigma, observed=y)
        return model

    def log_density(frequency):
        t, weight = legendre(-6, 3, 24)
        fit = linear_evidence(y, scale * waves(time, frequency[:, None]), np.exp(t))
        log_mass = fit + log_scale(stats.halfnorm)(t) + np.log(weight)
        return logsumexp(log_mass, axis=-1) - np.log(high - low)

    def log_evidence():
        parts = pairwise([low, truth - 0.02, truth + 0.02, high])
        return float(logsumexp([log_integral(log_density, part) for part in parts]))

    return Problem(
        "sine_frequency",
        4,
        model,
        log_evidence,
        "2-D quadrature over frequency and log noise, amplitudes in closed form",
        "several",
    )


def periodogram():
    """Frequency of a sine weaker than the noise: several peaks of comparable mass."""
    rng = np.random.default_rng(11)
    time = np.sort(rng.uniform(0, 10, 25))
    low, high, scale = 0.05, 3.0, np.array([1.0, 0.7])
    y = waves(time, 1.2) @ [0.5, 0.5] + rng.normal(size=25)

    def model():
        with pm.Model() as model:
            frequency = pm.Uniform("frequency", low, high)
            amplitude = pm.Normal("amplitude", 0, scale)
            phase = 2 * np.pi * frequency * time
            wave = amplitude[0] * pt.sin(phase) + amplitude[1] * pt.cos(phase)
            pm.Normal("y", wave, 1.0, observed=y)
        return model

    def log_density(frequency):
        return linear_evidence(y, scale * waves(time, frequency), 1.0) - np.log(high - low)

    return Problem(
        "periodogram",
        3,
        model,
        lambda: log_integral(log_density, (low, high)),
        "1-D quadrature over the frequency, amplitudes in closed form",
        "several",
    )


# --- modes ---------------------------------------------------------------------------------------


def normal_peaks(name, weight, mean, sd, prior_sd):
    """A potential of several normal peaks, (peak, unknown), under a normal prior."""
    weight, mean, sd = np.array(weight), np.array(mean), np.array(sd)

    def model():
        with pm.Model() as model:
            x = pm.Normal("x", 0, prior_sd)
            peaks = pm.logp(pm.Normal.dist(mean, sd), x).sum(axis=-1)
            pm.Potential("peaks", pt.logsumexp(np.log(weight) + peaks))
        return model

    def log_evidence():
        marginal = stats.norm(0, np.sqrt(np.square(prior_sd) + sd**2))
        return float(logsumexp(np.log(weight) + marginal.logpdf(mean).sum(axis=-1)))

    source = "closed form, the potential is a mixture of normals"
    return Problem(name, mean.shape[-1], model, log_evidence, source, "several")


def narrow_and_wide():
    """One peak fifty times narrower than the other in each of four unknowns."""
    wide = np.array([1.0, 1.5, 0.8, 1.2])
    mean = [[2.0, -1.5, 1.0, 2.5], [-2.0, 1.0, 0.5, -1.5]]
    return normal_peaks(
        "narrow_and_wide", [0.6, 0.4], mean, [wide / 50, wide], [3.0, 4.0, 2.0, 5.0]
    )


def three_peaks():
    """Three peaks in the plane, of unequal weight, width and distance."""
    mean = [[-6.0, 2.0], [4.0, -3.0], [7.0, 6.0]]
    sd = [[0.3, 0.5], [0.15, 0.4], [0.6, 0.2]]
    return normal_peaks("three_peaks", [0.6, 0.3, 0.1], mean, sd, [8.0, 10.0])


# --- hierarchies ---------------------------------------------------------------------------------

SCHOOLS = np.array([28.0, 8.0, -3.0, 7.0, -1.0, 1.0, 18.0, 12.0])
SCHOOLS_SD = np.array([15.0, 10.0, 16.0, 11.0, 9.0, 11.0, 10.0, 18.0])


def common_mean_evidence(y, variance, prior_sd):
    """Log density of measurements that share an unknown mean with a normal prior around 0.

    One rank is added to a diagonal covariance. Stacks of variances broadcast.
    """
    precision = (1 / variance).sum(axis=-1)
    misfit = (y**2 / variance).sum(axis=-1)
    explained = (y / variance).sum(axis=-1) ** 2 / (precision + prior_sd**-2)
    log_det = np.log(2 * np.pi * variance).sum(axis=-1) + np.log1p(prior_sd**2 * precision)
    return -0.5 * (log_det + misfit - explained)


def eight_schools(centred):
    """Effects of coaching, of which the data say how little they differ."""

    def model():
        with pm.Model() as model:
            mu = pm.Normal("mu", 0, 5)
            tau = pm.HalfCauchy("tau", 5)
            if centred:
                effect = pm.Normal("effect", mu, tau, shape=8)
            else:
                effect = mu + tau * pm.Normal("standard", 0, 1, shape=8)
            pm.Normal("y", effect, SCHOOLS_SD, observed=SCHOOLS)
        return model

    def log_density(t):
        variance = SCHOOLS_SD**2 + np.exp(2 * t)[:, None]
        prior = log_scale(stats.halfcauchy(scale=5))(t)
        return common_mean_evidence(SCHOOLS, variance, prior_sd=5) + prior

    return Problem(
        "eight_schools" if centred else "eight_schools_noncentred",
        10,
        model,
        lambda: log_integral(log_density, (-25, 12)),
        "1-D quadrature over log tau of the closed form; D. B. Rubin, J. Educ. Stat. 6 (1981) 377-401",
    )


def groups(count, seed):
    """Group means of a normal population, each measured with a noise of its own."""
    rng = np.random.default_rng(seed)
    noise = rng.uniform(0.3, 2.0, count) / np.sqrt(rng.integers(1, 9, count))
    y = 3.0 + 0.8 * rng.normal(size=count) + noise * rng.normal(size=count)

    def model():
        with pm.Model() as model:
            mu = pm.Normal("mu", 0, 10)
            tau = pm.HalfNormal("tau", 3)
            group = pm.Normal("group", mu, tau, shape=count)
            pm.Normal("y", group, noise, observed=y)
        return model

    def log_density(t):
        prior = log_scale(stats.halfnorm(scale=3))(t)
        return common_mean_evidence(y, noise**2 + np.exp(2 * t)[:, None], prior_sd=10) + prior

    return Problem(
        f"groups_{count + 2}",
        count + 2,
        model,
        lambda: log_integral(log_density, (-20, 3)),
        "1-D quadrature over the log spread of the closed form",
    )


def funnel(unknowns, noise, seed):
    """Neal's funnel, of which each ordinate is measured."""
    rng = np.random.default_rng(seed)
    y = np.exp(-0.5) * rng.normal(size=unknowns - 1) + noise * rng.normal(size=unknowns - 1)

    def model():
        with pm.Model() as model:
            v = pm.Normal("v", 0, 3)
            x = pm.Normal("x", 0, pt.exp(v / 2), shape=unknowns - 1)
            pm.Normal("y", x, noise, observed=y)
        return model

    def log_density(v):
        total = np.sqrt(np.exp(v) + noise**2)[:, None]
        return stats.norm.logpdf(y, 0, total).sum(axis=-1) + stats.norm.logpdf(v, 0, 3)

    return Problem(
        f"funnel_{unknowns}",
        unknowns,
        model,
        lambda: log_integral(log_density, (-30, 30)),
        "1-D quadrature over v; R. M. Neal, Ann. Statist. 31 (2003) 705-767",
    )


def random_walk():
    """States of a random walk, with the sizes of steps and of noise both unknown."""
    rng = np.random.default_rng(29)
    y = 4 + np.cumsum(0.3 * rng.normal(size=35)) + 0.8 * rng.normal(size=35)

    def model():
        with pm.Model() as model:
            step = pm.HalfNormal("step", 1)
            noise = pm.HalfNormal("noise", 2)
            start = pm.Normal.dist(0, 5)
            state = pm.GaussianRandomWalk("state", sigma=step, init_dist=start, steps=34)
            pm.Normal("y", state, noise, observed=y)
        return model

    def log_density(log_step, log_noise):
        """One measurement after the other, each predicted from those before (Kalman's filter)."""
        step2, noise2 = np.exp(2 * log_step), np.exp(2 * log_noise)
        mean, variance = 0.0, 25.0
        total = log_scale(stats.halfnorm)(log_step) + log_scale(stats.halfnorm(scale=2))(log_noise)
        for value in y:
            predicted = variance + noise2
            total = total + stats.norm.logpdf(value, mean, np.sqrt(predicted))
            mean = mean + variance / predicted * (value - mean)
            variance = variance * noise2 / predicted + step2
        return total

    return Problem(
        "random_walk",
        37,
        model,
        lambda: log_integral(log_density, (-16, 2.2), (-16, 3), panels=11),
        "2-D quadrature over log scales of Kalman's recursion",
    )


# --- heavy tails ---------------------------------------------------------------------------------


def horseshoe():
    """Ten coefficients, two of them large, under the horseshoe; orthonormal columns."""
    rng = np.random.default_rng(24)
    columns = np.linalg.qr(rng.normal(size=(15, 10)))[0]
    noise, spread = 0.5, 0.3
    truth = np.array([6.0, -3.0, 0.5, 0, 0, 0, 0, 0, 0, 0])
    y = columns @ truth + noise * rng.normal(size=15)

    def model():
        with pm.Model() as model:
            tau = pm.HalfCauchy("tau", spread)
            local = pm.HalfCauchy("local", 1, shape=10)
            standard = pm.Normal("standard", 0, 1, shape=10)
            pm.Normal("y", pt.dot(columns, standard * local * tau), noise, observed=y)
        return model

    def log_density(t):
        """Each projection of the data is a matter of its own coefficient alone."""
        u, log_weight = legendre(-30, 20, 64)
        log_weight = np.log(log_weight) + log_scale(stats.halfcauchy)(u)
        total = np.sqrt(np.exp(2 * (t[:, None, None] + u)) + noise**2)
        parts = stats.norm.logpdf((columns.T @ y)[:, None], 0, total) + log_weight
        return logsumexp(parts, axis=-1).sum(axis=-1) + log_scale(stats.halfcauchy(scale=spread))(t)

    rest = y - columns @ (columns.T @ y)
    residual = -5 / 2 * np.log(2 * np.pi * noise**2) - rest @ rest / (2 * noise**2)
    return Problem(
        "horseshoe",
        21,
        model,
        lambda: residual + log_integral(log_density, (-25, 12)),
        "1-D quadrature over log tau of products of 1-D quadratures over the log local scales; "
        "C. M. Carvalho, N. G. Polson and J. G. Scott, Biometrika 97 (2010) 465-480",
    )


def cauchy_sum():
    """Which of six Cauchy variables made their sum as large as it is?"""
    scale = np.array([0.1, 0.2, 0.3, 0.5, 0.8, 1.0])
    noise, y = 0.2, 10.0

    def model():
        with pm.Model() as model:
            x = pm.Cauchy("x", 0, scale)
            pm.Normal("y", x.sum(), noise, observed=y)
        return model

    def log_evidence():
        z = (y + 1j * scale.sum()) / (noise * np.sqrt(2))
        return float(np.log(wofz(z).real / (noise * np.sqrt(2 * np.pi))))

    return Problem("cauchy_sum", 6, model, log_evidence, "closed form, Voigt profile", "several")


PROBLEMS = {
    problem.name: problem
    for problem in (
        regression(3, rows=12, noise=0.3, seed=1),
        regression(10, rows=30, noise=0.3, seed=2),
        regression_unknown_noise("regression_10_small_noise", 10, rows=30, noise=0.01, seed=3),
        regression_unknown_noise("regression_20_small_noise", 20, rows=50, noise=0.01, seed=4),
        regression_unknown_noise("regression_50", 50, rows=80, noise=0.5, seed=5),
        conjugate_regression(),
        sine_frequency(),
        periodogram(),
        narrow_and_wide(),
        three_peaks(),
        eight_schools(centred=True),
        eight_schools(centred=False),
        groups(98, seed=36),
        groups(998, seed=37),
        funnel(4, noise=0.5, seed=20),
        funnel(10, noise=0.1, seed=21),
        random_walk(),
        horseshoe(),
        cauchy_sum(),
    )
}
"""All problems by name."""
