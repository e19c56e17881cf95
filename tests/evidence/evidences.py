"""A table of models that have nothing to do with tubes, with their exact evidences.

Each is an ordinary PyMC model under proper priors. Its evidence is a closed form, a sum or a
quadrature in NumPy and SciPy alone; a comment says which, and cites the model's source. Scales,
weights and data are unequal on purpose, so that a method that works only for standard normal
densities fails.

An evidence is the density of the observed data with all its constants; if the model has a
`pm.Potential`, it is the prior mean of the exponential of that potential.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from itertools import pairwise, product

import numpy as np
import pymc as pm
import pytensor.tensor as pt
from scipy import optimize, stats
from scipy.linalg import block_diag
from scipy.special import logsumexp, wofz

# Two successive refinements of a quadrature have to agree to this; the finer one is far closer.
QUADRATURE_TOLERANCE = 1e-5
# Nodes of one panel; panels are doubled until the quadrature settles, or has too many nodes.
ORDER, MOST_NODES = 8, 1_000_000


@dataclass(frozen=True)
class Problem:
    """A model and its exact log evidence."""

    name: str
    unknowns: int  # scalars on the unconstrained scale
    variables: Callable[[], None]  # adds the variables to the model in context
    log_evidence: Callable[[], float]

    def model(self) -> pm.Model:
        with pm.Model() as model:
            self.variables()
        return model


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


def regression(name, coefficients, rows, noise, seed, *, known_noise=False):
    """Regression with known or unknown noise; small noise is far below that of the prior."""
    columns, scale, y = regression_data(coefficients, rows, noise, seed)

    def variables():
        slope = pm.Normal("slope", 0, scale)
        sigma = noise if known_noise else pm.HalfNormal("sigma", 1)
        pm.Normal("y", pt.dot(columns, slope), sigma, observed=y)

    def log_density(t):
        return linear_evidence(y, columns * scale, np.exp(t)) + log_scale(stats.halfnorm)(t)

    def log_evidence():
        if known_noise:
            return float(linear_evidence(y, columns * scale, noise))
        return log_integral(log_density, (-12, 4))

    # Closed form, normal; 1-D quadrature of it over the log noise.
    return Problem(name, coefficients + (not known_noise), variables, log_evidence)


def conjugate_regression():
    """Coefficients whose prior scales with the noise."""
    columns, scale, y = regression_data(5, 25, 0.7, seed=6)
    shape, rate = 3.0, 2.0

    def variables():
        variance = pm.InverseGamma("variance", shape, rate)
        slope = pm.Normal("slope", 0, scale * pt.sqrt(variance))
        pm.Normal("y", pt.dot(columns, slope), pt.sqrt(variance), observed=y)

    # Closed form, normal-inverse-gamma.
    covariance = np.eye(len(y)) + (columns * scale) @ (columns * scale).T
    marginal = stats.multivariate_t(shape=rate / shape * covariance, df=2 * shape)
    exact = float(marginal.logpdf(y))
    return Problem("conjugate_regression", 6, variables, lambda: exact)


# --- waves ---------------------------------------------------------------------------------------


def waves(time, frequency):
    """Sine and cosine, the columns of a design for each of a stack of frequencies."""
    phase = 2 * np.pi * np.asarray(frequency)[..., None] * time
    return np.stack([np.sin(phase), np.cos(phase)], axis=-1)


def sine_frequency():
    """Frequency of a sine with a small unknown noise: one narrow mode in a wide prior."""
    rng = np.random.default_rng(7)
    time = np.sort(rng.uniform(0, 10, 40))
    low, high, truth, scale = 0.1, 5.0, 1.7, 2.0
    y = waves(time, truth) @ [1.3, -0.7] + 0.05 * rng.normal(size=40)

    def variables():
        frequency = pm.Uniform("frequency", low, high)
        amplitude = pm.Normal("amplitude", 0, scale, shape=2)
        sigma = pm.HalfNormal("sigma", 1)
        phase = 2 * np.pi * frequency * time
        wave = amplitude[0] * pt.sin(phase) + amplitude[1] * pt.cos(phase)
        pm.Normal("y", wave, sigma, observed=y)

    def log_density(frequency):
        t, weight = legendre(-6, 3, 16)
        fit = linear_evidence(y, scale * waves(time, frequency[:, None]), np.exp(t))
        log_mass = fit + log_scale(stats.halfnorm)(t) + np.log(weight)
        return logsumexp(log_mass, axis=-1) - np.log(high - low)

    def log_evidence():
        parts = pairwise([low, truth - 0.02, truth + 0.02, high])
        return float(logsumexp([log_integral(log_density, part) for part in parts]))

    # 2-D quadrature over frequency and log noise, amplitudes in closed form; several modes.
    return Problem("sine_frequency", 4, variables, log_evidence)


def periodogram():
    """Frequency of a sine weaker than the noise: several peaks of comparable mass."""
    rng = np.random.default_rng(10)
    time = np.sort(rng.uniform(0, 10, 25))
    low, high, scale = 0.05, 3.0, np.array([1.0, 0.7])
    y = waves(time, 1.2) @ [0.45, 0.45] + rng.normal(size=25)

    def variables():
        frequency = pm.Uniform("frequency", low, high)
        amplitude = pm.Normal("amplitude", 0, scale)
        phase = 2 * np.pi * frequency * time
        wave = amplitude[0] * pt.sin(phase) + amplitude[1] * pt.cos(phase)
        pm.Normal("y", wave, 1.0, observed=y)

    def log_density(frequency):
        return linear_evidence(y, scale * waves(time, frequency), 1.0) - np.log(high - low)

    # 1-D quadrature over the frequency, amplitudes in closed form; several modes.
    return Problem("periodogram", 3, variables, lambda: log_integral(log_density, (low, high)))


# --- modes ---------------------------------------------------------------------------------------


def normal_peaks(name, weight, mean, sd, prior_sd):
    """A potential of several normal peaks, (peak, unknown), under a normal prior."""
    weight, mean, sd = np.array(weight), np.array(mean), np.array(sd)

    def variables():
        x = pm.Normal("x", 0, prior_sd)
        peaks = pm.logp(pm.Normal.dist(mean, sd), x).sum(axis=-1)
        pm.Potential("peaks", pt.logsumexp(np.log(weight) + peaks))

    # Closed form, the potential is a mixture of normals; several modes.
    marginal = stats.norm(0, np.sqrt(np.square(prior_sd) + sd**2))
    exact = float(logsumexp(np.log(weight) + marginal.logpdf(mean).sum(axis=-1)))
    return Problem(name, mean.shape[-1], variables, lambda: exact)


# One peak is ten times narrower than the other in each of four unknowns.
WIDE = np.array([1.0, 1.5, 0.8, 1.2])
NARROW_AND_WIDE = [0.6, 0.4], [[2.0, -1.5, 1.0, 2.5], [-2.0, 1.0, 0.5, -1.5]], [WIDE / 10, WIDE]
# Three peaks in the plane, of unequal weight, width and distance.
CENTRES, WIDTHS = [[-6.0, 2.0], [4.0, -3.0], [7.0, 6.0]], [[0.3, 0.5], [0.15, 0.4], [0.6, 0.2]]
THREE_PEAKS = [0.6, 0.3, 0.1], CENTRES, WIDTHS
TWO_CLUSTERS = [-1.9, -1.2, -2.3, -0.4, -1.5, -2.8, 1.6, 2.4, 1.1, 0.3, -2.0]
THREE_CLUSTERS = [-3.1, -2.6, -3.4, 0.2, 0.9, 4.4, 3.9, 4.1, 4.9]


def label_switching(name, weight, sd, y):
    """Means of the components of a mixture, under the same prior for each component."""
    weight, y, prior_sd = np.array(weight), np.array(y), 4.0

    def variables():
        mean = pm.Normal("mean", 0, prior_sd, shape=len(weight))
        pm.NormalMixture("y", weight, mean, sigma=sd, observed=y)

    def log_evidence():
        label = np.array(list(product(range(len(weight)), repeat=len(y))))
        total = np.log(weight)[label].sum(axis=1) - len(y) / 2 * np.log(2 * np.pi * sd**2)
        for component in range(len(weight)):
            member = label == component
            precision = member.sum(axis=1) / sd**2
            explained = ((member * y).sum(axis=1) / sd**2) ** 2 / (precision + prior_sd**-2)
            misfit = (member * y**2).sum(axis=1) / sd**2
            total -= (np.log1p(prior_sd**2 * precision) + misfit - explained) / 2
        return float(logsumexp(total))

    # Sum over all allocations of the data to components; several modes.
    return Problem(name, len(weight), variables, log_evidence)


def spike_and_slab():
    """Eight coefficients, each nearly zero or of any size; orthonormal columns."""
    columns = np.linalg.qr(np.random.default_rng(11).normal(size=(12, 8)))[0]
    projection = np.array([3.0, -1.2, 0.3, -0.25, 0.1, -0.05, 0.02, 0.35])
    weight, sd, noise = np.array([0.7, 0.3]), np.array([0.05, 2.0]), 0.1
    y = columns @ projection

    def variables():
        slope = pm.NormalMixture("slope", weight, np.zeros(2), sigma=sd, shape=8)
        pm.Normal("y", pt.dot(columns, slope), noise, observed=y)

    # Closed form, each projection of the data is a mixture of two normals; several modes.
    marginal = stats.norm.logpdf(projection[:, None], 0, np.sqrt(sd**2 + noise**2))
    residual = -(len(y) - 8) / 2 * np.log(2 * np.pi * noise**2)
    exact = float(residual + logsumexp(np.log(weight) + marginal, axis=1).sum())
    return Problem("spike_and_slab", 8, variables, lambda: exact)


def two_locations():
    """Location of heavy-tailed data in two clusters."""
    y = np.array([-0.2, 0.1, 0.15, 0.4, 0.05, 9.3, 10.2, 9.9, 10.6, 10.0])

    def variables():
        location = pm.Normal("location", 3, 10)
        spread = pm.HalfNormal("spread", 0.5)
        pm.StudentT("y", nu=2, mu=location, sigma=spread, observed=y)

    def log_density(location):
        t, weight = legendre(-7, 1.5, 8)
        log_mass = log_scale(stats.halfnorm(scale=0.5))(t) + np.log(weight)
        for value in y:
            log_mass = log_mass + stats.t.logpdf(value, 2, location[:, None], np.exp(t))
        return logsumexp(log_mass, axis=1) + stats.norm.logpdf(location, 3, 10)

    # 2-D quadrature over location and log spread; several modes.
    return Problem("two_locations", 2, variables, lambda: log_integral(log_density, (-30, 40)))


def two_decays():
    """Sum of two exponentials, which can be exchanged."""
    time = np.array([0.1, 0.3, 0.5, 0.8, 1.2, 1.7, 2.3, 3.0, 4.0, 5.5])
    noise, scale = 0.05, 2.0
    error = np.random.default_rng(41).normal(size=10)
    y = 1.5 * np.exp(-0.4 * time) + 2.5 * np.exp(-2.5 * time) + noise * error

    def variables():
        rate = pm.LogNormal("rate", 0, 1, shape=2)
        amplitude = pm.Normal("amplitude", 0, scale, shape=2)
        decay = (amplitude * pt.exp(-rate * time[:, None])).sum(axis=1)
        pm.Normal("y", decay, noise, observed=y)

    def log_density(first, second):
        rate = np.exp(np.stack(np.broadcast_arrays(first, second), axis=-1))
        design = scale * np.exp(-rate[..., None, :] * time[:, None])
        prior = stats.norm.logpdf(first) + stats.norm.logpdf(second)
        return linear_evidence(y, design, noise) + prior

    # 2-D quadrature over log rates, amplitudes in closed form; several modes.
    log_evidence = partial(log_integral, log_density, (-4, 5), (-4, 5), panels=16)
    return Problem("two_decays", 4, variables, log_evidence)


def shells():
    """Two circular ridges of unequal radius, width and weight in the plane."""
    centre = np.array([[-2.5, 0.5], [3.0, -1.0]])
    radius, width, weight = np.array([2.5, 1.2]), np.array([0.05, 0.15]), np.array([0.3, 0.7])

    def variables():
        x = pm.Uniform("x", -6, [6.0, 7.0])
        distance = pt.sqrt(((x - centre) ** 2).sum(axis=1))
        ridges = pm.logp(pm.Normal.dist(radius, width), distance)
        pm.Potential("shells", pt.logsumexp(np.log(weight) + ridges))

    # Closed form: two pi times the mean radius of the cross-section of each ridge;
    # F. Feroz et al., MNRAS 398 (2009) 1601-1614; several modes.
    mean_radius = radius * stats.norm.cdf(radius / width)
    mean_radius += width * stats.norm.pdf(radius / width)
    exact = float(np.log(weight @ (2 * np.pi * mean_radius) / (12 * 13)))
    return Problem("shells", 2, variables, lambda: exact)


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
    """Effects of coaching in eight schools, which hardly differ."""

    def variables():
        mu = pm.Normal("mu", 0, 5)
        tau = pm.HalfCauchy("tau", 5)
        if centred:
            effect = pm.Normal("effect", mu, tau, shape=8)
        else:
            effect = mu + tau * pm.Normal("standard", 0, 1, shape=8)
        pm.Normal("y", effect, SCHOOLS_SD, observed=SCHOOLS)

    def log_density(t):
        variance = SCHOOLS_SD**2 + np.exp(2 * t)[:, None]
        prior = log_scale(stats.halfcauchy(scale=5))(t)
        return common_mean_evidence(SCHOOLS, variance, prior_sd=5) + prior

    # 1-D quadrature over log tau of the closed form; D. B. Rubin, J. Educ. Stat. 6 (1981) 377-401.
    log_evidence = partial(log_integral, log_density, (-25, 12))
    return Problem(
        "eight_schools" if centred else "eight_schools_noncentred", 10, variables, log_evidence
    )


def groups(count, seed):
    """Group means of a normal population, each measured with its own noise."""
    rng = np.random.default_rng(seed)
    noise = rng.uniform(0.3, 2.0, count) / np.sqrt(rng.integers(1, 9, count))
    y = 3.0 + 0.8 * rng.normal(size=count) + noise * rng.normal(size=count)

    def variables():
        mu = pm.Normal("mu", 0, 10)
        tau = pm.HalfNormal("tau", 3)
        group = pm.Normal("group", mu, tau, shape=count)
        pm.Normal("y", group, noise, observed=y)

    def log_density(t):
        prior = log_scale(stats.halfnorm(scale=3))(t)
        return common_mean_evidence(y, noise**2 + np.exp(2 * t)[:, None], prior_sd=10) + prior

    # 1-D quadrature over the log spread of the closed form.
    log_evidence = partial(log_integral, log_density, (-20, 3))
    return Problem(f"groups_{count + 2}", count + 2, variables, log_evidence)


def funnel(unknowns, noise, seed):
    """Neal's funnel with a measurement of each ordinate."""
    rng = np.random.default_rng(seed)
    y = np.exp(-0.5) * rng.normal(size=unknowns - 1) + noise * rng.normal(size=unknowns - 1)

    def variables():
        v = pm.Normal("v", 0, 3)
        x = pm.Normal("x", 0, pt.exp(v / 2), shape=unknowns - 1)
        pm.Normal("y", x, noise, observed=y)

    def log_density(v):
        total = np.sqrt(np.exp(v) + noise**2)[:, None]
        return stats.norm.logpdf(y, 0, total).sum(axis=-1) + stats.norm.logpdf(v, 0, 3)

    # 1-D quadrature over v; R. M. Neal, Ann. Statist. 31 (2003) 705-767.
    log_evidence = partial(log_integral, log_density, (-30, 30))
    return Problem(f"funnel_{unknowns}", unknowns, variables, log_evidence)


def random_walk():
    """States of a random walk with unknown sds of steps and noise."""
    rng = np.random.default_rng(29)
    y = 4 + np.cumsum(0.3 * rng.normal(size=35)) + 0.8 * rng.normal(size=35)

    def variables():
        step = pm.HalfNormal("step", 1)
        noise = pm.HalfNormal("noise", 2)
        start = pm.Normal.dist(0, 5)
        state = pm.GaussianRandomWalk("state", sigma=step, init_dist=start, steps=34)
        pm.Normal("y", state, noise, observed=y)

    def log_density(log_step, log_noise):
        """Predict each measurement from the earlier ones (Kalman's filter)."""
        step2, noise2 = np.exp(2 * log_step), np.exp(2 * log_noise)
        mean, variance = 0.0, 25.0
        total = log_scale(stats.halfnorm)(log_step) + log_scale(stats.halfnorm(scale=2))(log_noise)
        for value in y:
            predicted = variance + noise2
            total = total + stats.norm.logpdf(value, mean, np.sqrt(predicted))
            mean = mean + variance / predicted * (value - mean)
            variance = variance * noise2 / predicted + step2
        return total

    # 2-D quadrature over log scales of Kalman's recursion.
    log_evidence = partial(log_integral, log_density, (-16, 2.2), (-16, 3), panels=11)
    return Problem("random_walk", 37, variables, log_evidence)


# --- heavy tails ---------------------------------------------------------------------------------


def horseshoe():
    """Ten coefficients, two of them large, under the horseshoe; orthonormal columns."""
    rng = np.random.default_rng(24)
    columns = np.linalg.qr(rng.normal(size=(15, 10)))[0]
    noise, spread = 0.5, 0.3
    truth = np.array([6.0, -3.0, 0.5, 0, 0, 0, 0, 0, 0, 0])
    y = columns @ truth + noise * rng.normal(size=15)

    def variables():
        tau = pm.HalfCauchy("tau", spread)
        local = pm.HalfCauchy("local", 1, shape=10)
        standard = pm.Normal("standard", 0, 1, shape=10)
        pm.Normal("y", pt.dot(columns, standard * local * tau), noise, observed=y)

    def log_density(t):
        """Each projection of the data depends on one coefficient only."""
        u, log_weight = legendre(-30, 20, 64)
        log_weight = np.log(log_weight) + log_scale(stats.halfcauchy)(u)
        total = np.sqrt(np.exp(2 * (t[:, None, None] + u)) + noise**2)
        parts = stats.norm.logpdf((columns.T @ y)[:, None], 0, total) + log_weight
        return logsumexp(parts, axis=-1).sum(axis=-1) + log_scale(stats.halfcauchy(scale=spread))(t)

    rest = y - columns @ (columns.T @ y)
    residual = -5 / 2 * np.log(2 * np.pi * noise**2) - rest @ rest / (2 * noise**2)

    def log_evidence():
        return residual + log_integral(log_density, (-25, 12))

    # 1-D quadrature over log tau of products of 1-D quadratures over the log local scales;
    # C. M. Carvalho, N. G. Polson and J. G. Scott, Biometrika 97 (2010) 465-480.
    return Problem("horseshoe", 21, variables, log_evidence)


def cauchy_sum():
    """Large sum of six Cauchy variables: any one of them may be large."""
    scale = np.array([0.1, 0.2, 0.3, 0.5, 0.8, 1.0])
    noise, y = 0.2, 10.0

    def variables():
        x = pm.Cauchy("x", 0, scale)
        pm.Normal("y", x.sum(), noise, observed=y)

    # Closed form, Voigt profile; several modes.
    z = (y + 1j * scale.sum()) / (noise * np.sqrt(2))
    exact = float(np.log(wofz(z).real / (noise * np.sqrt(2 * np.pi))))
    return Problem("cauchy_sum", 6, variables, lambda: exact)


# --- ridges, shells and bends --------------------------------------------------------------------


def correlated_normal(unknowns, seed):
    """Means measured with highly correlated errors: wide in one direction only."""
    rng = np.random.default_rng(seed)
    scale = np.geomspace(5.0, 0.5, unknowns)
    sd = np.geomspace(0.2, 2.0, unknowns)
    covariance = (0.05 * np.eye(unknowns) + 0.95) * sd[:, None] * sd
    error = np.linalg.cholesky(covariance) @ rng.normal(size=unknowns)
    y = 1.0 + scale * rng.normal(size=unknowns) + error

    def variables():
        x = pm.Normal("x", 1.0, scale)
        pm.MvNormal("y", x, cov=covariance, observed=y)

    # Closed form, normal.
    mean = np.ones(unknowns)
    exact = float(stats.multivariate_normal(mean, covariance + np.diag(scale**2)).logpdf(y))
    return Problem(f"correlated_normal_{unknowns}", unknowns, variables, lambda: exact)


def ridge_sum():
    """A weighted sum of four unknowns, measured with a thousandth of their prior sds."""
    scale, weight = np.array([1.0, 2.0, 0.5, 3.0]), np.array([1.0, -0.5, 2.0, 0.7])
    noise, y = 0.001, 5.0

    def variables():
        x = pm.Normal("x", 0, scale)
        pm.Normal("y", (weight * x).sum(), noise, observed=y)

    # Closed form, normal.
    exact = float(stats.norm.logpdf(y, 0, np.hypot(noise, np.linalg.norm(weight * scale))))
    return Problem("ridge_sum", 4, variables, lambda: exact)


def ridge_product():
    """A product of two unknowns plus a third one, measured accurately: a thin bent sheet."""
    first_sd, second_sd, offset_sd, noise, y = 3.0, 1.0, 0.5, 0.02, 3.0

    def variables():
        first = pm.HalfNormal("first", first_sd)
        second = pm.HalfNormal("second", second_sd)
        offset = pm.Normal("offset", 0, offset_sd)
        pm.Normal("y", first * second + offset, noise, observed=y)

    def log_density(t):
        """Given the first unknown, the model is linear; the prior of its slope is half-normal."""
        slope = np.exp(t) * second_sd
        error = np.hypot(noise, offset_sd)
        total = np.hypot(error, slope)
        half = np.log(2) + stats.norm.logcdf(slope / error * y / total)
        return stats.norm.logpdf(y, 0, total) + half + log_scale(stats.halfnorm(scale=first_sd))(t)

    # 1-D quadrature over the log of one factor, the others in closed form.
    return Problem("ridge_product", 3, variables, lambda: log_integral(log_density, (-20, 4)))


def banana(unknowns):
    """Rosenbrock's valley ``x2 = x1^2`` and unknowns that are measured directly."""
    others = unknowns - 2
    scale, sd = np.linspace(1, 4, others), np.geomspace(0.05, 2, others)
    truth = np.linspace(-2, 3, others)

    def variables():
        first = pm.Normal("first", 0, 2)
        second = pm.Normal("second", 1, 5)
        pm.Normal("position", first, 0.7, observed=1.0)
        pm.Normal("valley", second - first**2, 0.1, observed=0.5)
        if others:
            x = pm.Normal("x", 0, scale)
            pm.Normal("y", x, sd, observed=truth)

    def log_density(first):
        valley = stats.norm.logpdf(0.5, 1 - first**2, np.hypot(5, 0.1))
        return stats.norm.logpdf(first, 0, 2) + stats.norm.logpdf(1, first, 0.7) + valley

    plain = stats.norm.logpdf(truth, 0, np.hypot(scale, sd)).sum()

    def log_evidence():
        return plain + log_integral(log_density, (-15, 15))

    # 1-D quadrature over x1, the others in closed form.
    return Problem(f"banana_{unknowns}", unknowns, variables, log_evidence)


def shell():
    """Distance of a point in ten dimensions from the origin: a thin shell, heavier on one side."""
    mean = np.linspace(-0.4, 1.0, 10)
    width, y = 0.05, 4.0

    def variables():
        x = pm.Normal("x", mean, 1.5)
        pm.Normal("y", pt.sqrt((x**2).sum()), width, observed=y)

    def log_density(radius):
        square = (radius / 1.5) ** 2
        prior = stats.ncx2.logpdf(square, 10, mean @ mean / 1.5**2) + np.log(2 * radius / 1.5**2)
        return prior + stats.norm.logpdf(y, radius, width)

    # 1-D quadrature over the radius, a noncentral chi.
    log_evidence = partial(log_integral, log_density, (y - 10 * width, y + 10 * width))
    return Problem("shell_10", 10, variables, log_evidence)


def far_from_the_prior():
    """Data tens of prior standard deviations away from the prior mean."""
    y, noise = np.array([20.0, -14.0, 9.0]), np.array([0.5, 0.3, 0.2])

    def variables():
        x = pm.Normal("x", 0, 1, shape=3)
        pm.Normal("y", x, noise, observed=y)

    # Closed form, normal.
    exact = float(stats.norm.logpdf(y, 0, np.hypot(1, noise)).sum())
    return Problem("far_from_the_prior", 3, variables, lambda: exact)


def edges():
    """Three bounded unknowns whose data favour values at the bounds."""

    def variables():
        fraction = pm.Uniform("fraction", 0, 1)
        pm.Normal("fraction_seen", fraction, 0.1, observed=1.4)
        size = pm.HalfNormal("size", 2)
        pm.Normal("size_seen", size, 0.5, observed=-1.5)
        chance = pm.Beta("chance", 1, 3)
        pm.Binomial("failures", n=40, p=chance, observed=0)

    # Closed form, normal and beta integrals.
    fraction = np.log(stats.norm.cdf(1, 1.4, 0.1) - stats.norm.cdf(0, 1.4, 0.1))
    total = np.hypot(2, 0.5)
    size = stats.norm.logpdf(-1.5, 0, total)
    size += np.log(2) + stats.norm.logcdf(-1.5 * 2 / (0.5 * total))
    exact = float(fraction + size + np.log(3 / 43))
    return Problem("edges", 3, variables, lambda: exact)


def half_space():
    """A cut that leaves one prior draw in 250 possible, and a potential tilted along the cut."""
    direction, tilt, least = np.array([1, 0.5, -0.2, 0, 0, 0]), 0.7, 3.0

    def variables():
        x = pm.Normal("x", size=6)
        pm.Potential("cut", pt.switch(pt.dot(direction, x) > least, tilt * x[3], -np.inf))

    # Closed form, normal tail.
    exact = float(stats.norm.logsf(least, 0, np.linalg.norm(direction)) + tilt**2 / 2)
    return Problem("half_space", 6, variables, lambda: exact)


# --- counts and classes --------------------------------------------------------------------------


def logistic_evidence(design, success, prior_sd):
    """Log probability of successes, by a quadrature around the mode in units of its curvature."""
    signed = np.where(success, 1.0, -1.0)[:, None] * design
    columns = design.shape[1]

    def log_density(*slopes):
        total = sum(stats.norm.logpdf(slope, 0, prior_sd) for slope in slopes)
        for row in signed:
            margin = sum(x * slope for x, slope in zip(row, slopes, strict=True))
            total = total - np.logaddexp(0, -margin)
        return total

    mode = optimize.minimize(lambda slopes: -log_density(*slopes), np.zeros(columns)).x
    weight = stats.logistic.pdf(signed @ mode)[:, None]
    precision = signed.T @ (weight * signed) + np.eye(columns) / prior_sd**2
    unit = np.linalg.inv(np.linalg.cholesky(precision)).T

    def standard(*z):
        z = np.broadcast_arrays(*z)
        return log_density(*(mode + np.stack(z, axis=-1) @ unit.T).transpose(-1, *range(columns)))

    ends = (-9, 9)
    return log_integral(standard, *[ends] * columns, panels=2) + np.linalg.slogdet(unit)[1]


def logistic_data(rows, coefficients, seed):
    """Unequal columns, and successes that depend on them."""
    rng = np.random.default_rng(seed)
    design = rng.normal(size=(rows, coefficients)) * np.linspace(1, 2, coefficients) + 0.3
    chance = stats.logistic.cdf(design @ np.linspace(1, -0.8, coefficients))
    return design, rng.random(rows) < chance


def logistic():
    """Logistic regression on two columns and a constant."""
    design, success = logistic_data(30, 3, seed=26)
    design[:, 0] = 1.0

    def variables():
        slope = pm.Normal("slope", 0, 1.5, shape=3)
        pm.Bernoulli("y", logit_p=pt.dot(design, slope), observed=success.astype(int))

    # 3-D quadrature over the coefficients.
    return Problem("logistic_3", 3, variables, lambda: logistic_evidence(design, success, 1.5))


def logistic_blocks():
    """Logistic regression in which each row has two of six columns: three regressions in one."""
    blocks = [logistic_data(rows, 2, seed) for rows, seed in ((12, 1), (20, 2), (40, 3))]
    design = block_diag(*(design for design, _ in blocks))
    success = np.concatenate([success for _, success in blocks])

    def variables():
        even = pm.Normal("even", 0, 1.5, shape=3)
        odd = pm.Normal("odd", 0, 1.5, shape=3)
        logit = pt.dot(design[:, ::2], even) + pt.dot(design[:, 1::2], odd)
        pm.Bernoulli("y", logit_p=logit, observed=success.astype(int))

    def log_evidence():
        return sum(logistic_evidence(design, success, 1.5) for design, success in blocks)

    # 2-D quadratures over each pair of coefficients.
    return Problem("logistic_6", 6, variables, log_evidence)


def category_shares():
    """Shares of six categories; one of them was never seen."""
    alpha = np.array([0.5, 1.0, 2.0, 3.0, 0.8, 5.0])
    counts = np.array([0, 3, 10, 1, 25, 4])

    def variables():
        share = pm.Dirichlet("share", alpha)
        pm.Multinomial("y", n=counts.sum(), p=share, observed=counts)

    # Closed form, Dirichlet-multinomial.
    exact = float(stats.dirichlet_multinomial.logpmf(counts, alpha, counts.sum()))
    return Problem("category_shares", 5, variables, lambda: exact)


def pumps():
    """Failures of ten pumps whose rates have a gamma density with unknown parameters."""
    time = np.array([94.3, 15.7, 62.9, 126.0, 5.24, 31.4, 1.05, 1.05, 2.1, 10.5])
    failures = np.array([5, 1, 5, 14, 3, 19, 1, 1, 4, 22])

    def variables():
        shape = pm.Exponential("shape", 1)
        inverse_scale = pm.Gamma("inverse_scale", 0.1, 1)
        rate = pm.Gamma("rate", shape, inverse_scale, shape=10)
        pm.Poisson("y", time * rate, observed=failures)

    def log_density(a, b):
        prior = log_scale(stats.expon)(a) + log_scale(stats.gamma(0.1))(b)
        shape, inverse_scale = np.exp(a), np.exp(b)
        chance = [inverse_scale / (inverse_scale + t) for t in time]
        counted = zip(failures, chance, strict=True)
        return prior + sum(stats.nbinom.logpmf(y, shape, p) for y, p in counted)

    # 2-D quadrature over logs of the gamma's parameters, rates in closed form;
    # E. I. George, U. E. Makov and A. F. M. Smith, Scand. J. Stat. 20 (1993) 147-156.
    return Problem("pumps", 12, variables, lambda: log_integral(log_density, (-8, 5), (-25, 4)))


# --- scales and shapes ---------------------------------------------------------------------------


def many_observations():
    """Mean and sd of a hundred thousand data: a very narrow posterior."""
    y = np.random.default_rng(33).normal(3.0, 2.0, size=100_000)

    def variables():
        mu = pm.Normal("mu", 0, 10)
        sigma = pm.HalfNormal("sigma", 5)
        pm.Normal("y", mu, sigma, observed=y)

    def log_density(t):
        design = np.full((len(y), 1), 10.0)
        return linear_evidence(y, design, np.exp(t)) + log_scale(stats.halfnorm(scale=5))(t)

    # 1-D quadrature over the log sd, the mean in closed form.
    log_evidence = partial(log_integral, log_density, (np.log(2) - 0.05, np.log(2) + 0.05))
    return Problem("many_observations", 2, variables, log_evidence)


def lifetimes():
    """Weibull's shape and scale from four lifetimes."""
    y = np.array([0.3, 1.1, 2.7, 8.0])

    def variables():
        shape = pm.Gamma("shape", 2, 1)
        scale = pm.LogNormal("scale", 1, 2)
        pm.Weibull("y", shape, scale, observed=y)

    def log_density(a, b):
        prior = log_scale(stats.gamma(2))(a) + stats.norm.logpdf(b, 1, 2)
        data = (stats.weibull_min.logpdf(value, np.exp(a), scale=np.exp(b)) for value in y)
        return prior + sum(data)

    # 2-D quadrature over the logs of shape and scale.
    log_evidence = partial(log_integral, log_density, (-9, 3.5), (-15, 20), panels=16)
    return Problem("lifetimes", 2, variables, log_evidence)


def gaussian_process():
    """Length, amplitude and noise of a smooth function."""
    rng = np.random.default_rng(28)
    place = np.sort(rng.uniform(0, 6, 15))
    y = 1.5 * np.sin(1.3 * place) + 0.3 * rng.normal(size=15)
    square = (place[:, None] - place) ** 2

    def variables():
        length = pm.InverseGamma("length", 4, 4)
        amplitude = pm.HalfNormal("amplitude", 2)
        noise = pm.HalfNormal("noise", 1)
        signal = amplitude**2 * pt.exp(-square / (2 * length**2))
        pm.MvNormal("y", np.zeros(15), cov=signal + noise**2 * np.eye(15), observed=y)

    def log_density(log_length, log_amplitude, log_noise):
        """The eigenvectors of the covariance depend on the length only."""
        correlation = np.exp(-square / (2 * np.exp(2 * log_length)[..., None, None]))
        eigenvalue, vector = np.linalg.eigh(correlation)
        along = (y[:, None] * vector).sum(axis=-2)
        variance = np.exp(2 * log_amplitude)[..., None] * eigenvalue
        variance = variance + np.exp(2 * log_noise)[..., None]
        total = log_scale(stats.invgamma(4, scale=4))(log_length)
        total = total + log_scale(stats.halfnorm(scale=2))(log_amplitude)
        total = total + log_scale(stats.halfnorm)(log_noise)
        return total - (np.log(2 * np.pi * variance) + along**2 / variance).sum(axis=-1) / 2

    # 3-D quadrature over the logs.
    log_evidence = partial(log_integral, log_density, (-1.5, 3), (-3, 2.3), (-4, 1.5), panels=3)
    return Problem("gaussian_process", 3, variables, log_evidence)


def correlation():
    """Scales and correlation of pairs, under the prior of Lewandowski, Kurowicka and Joe."""
    rng = np.random.default_rng(31)
    truth = np.array([[4.0, -1.2], [-1.2, 0.64]])
    y = rng.normal(size=(12, 2)) @ np.linalg.cholesky(truth).T
    scatter = y.T @ y
    spread = stats.expon(scale=2.0)

    def variables():
        sd = pm.Exponential.dist(0.5, size=2)
        factor, _, _ = pm.LKJCholeskyCov("factor", eta=2, n=2, sd_dist=sd)
        pm.MvNormal("y", np.zeros(2), chol=factor, observed=y)

    def log_density(first, second, z):
        rho = np.tanh(z)
        open_ = np.log1p(-(rho**2))
        white = scatter[0, 0] * np.exp(-2 * first) + scatter[1, 1] * np.exp(-2 * second)
        white = white - 2 * rho * scatter[0, 1] * np.exp(-first - second)
        log_det = 2 * (first + second) + open_ + 2 * np.log(2 * np.pi)
        prior = log_scale(spread)(first) + log_scale(spread)(second)
        lkj = np.log(3 / 4) + 2 * open_  # (1 - rho^2)^(eta - 1) by rho, and 1 - rho^2 for z
        return prior + lkj - 12 / 2 * log_det - white * np.exp(-open_) / 2

    # 3-D quadrature over log sds and the correlation's Fisher transform.
    log_evidence = partial(log_integral, log_density, (-0.8, 2.8), (-1.8, 2), (-3.5, 1.8), panels=2)
    return Problem("correlation", 3, variables, log_evidence)


PROBLEMS = {
    problem.name: problem
    for problem in (
        regression("regression_3", 3, rows=12, noise=0.3, seed=1, known_noise=True),
        regression("regression_10", 10, rows=30, noise=0.3, seed=2, known_noise=True),
        regression("regression_10_small_noise", 10, rows=30, noise=0.01, seed=3),
        regression("regression_20_small_noise", 20, rows=50, noise=0.01, seed=4),
        regression("regression_50", 50, rows=80, noise=0.5, seed=5),
        conjugate_regression(),
        sine_frequency(),
        periodogram(),
        normal_peaks("narrow_and_wide", *NARROW_AND_WIDE, prior_sd=[3.0, 4.0, 2.0, 5.0]),
        normal_peaks("three_peaks", *THREE_PEAKS, prior_sd=[8.0, 10.0]),
        label_switching("label_switching_2", [0.65, 0.35], 0.8, TWO_CLUSTERS),
        label_switching("label_switching_3", [1 / 3, 1 / 3, 1 / 3], 0.5, THREE_CLUSTERS),
        spike_and_slab(),
        two_locations(),
        two_decays(),
        shells(),
        eight_schools(centred=True),
        eight_schools(centred=False),
        groups(98, seed=36),
        groups(998, seed=37),
        funnel(4, noise=0.5, seed=20),
        funnel(10, noise=0.1, seed=21),
        random_walk(),
        horseshoe(),
        cauchy_sum(),
        correlated_normal(10, seed=12),
        correlated_normal(30, seed=13),
        correlated_normal(50, seed=14),
        ridge_sum(),
        ridge_product(),
        banana(2),
        banana(8),
        shell(),
        far_from_the_prior(),
        edges(),
        half_space(),
        logistic(),
        logistic_blocks(),
        category_shares(),
        pumps(),
        many_observations(),
        lifetimes(),
        gaussian_process(),
        correlation(),
    )
}
"""All problems by name."""
