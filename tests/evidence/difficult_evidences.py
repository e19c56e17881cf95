"""Models for which a sampler can be wrong without a warning, with exact evidences.

There are five kinds: regimes of the prior, periodic variables, mass where numbers are rounded to a
bound, random variables that cannot be drawn in batches, and models that need great effort. Each
evidence is a closed form, a sum or a quadrature in NumPy and SciPy alone; a comment says which.
"""

from functools import partial

import numpy as np
import pymc as pm
import pytensor.tensor as pt
from evidences import (
    THREE_CLUSTERS,
    Problem,
    label_switching,
    linear_evidence,
    log_integral,
    log_scale,
)
from pymc.distributions.transforms import circular, ordered
from scipy import stats
from scipy.special import gammaln, i0e, ive, log_ndtr, logsumexp

# --- regimes of the prior ------------------------------------------------------------------------


def dead_or_alive():
    """An instrument works, with small noise, or is dead: every prior draw that works is poor."""
    rng, noise, dead = np.random.default_rng(4), 0.1, 1.5
    design = rng.normal(size=(12, 5))
    y = design @ np.full(5, 0.8) + noise * rng.normal(size=12)

    def variables():
        works, slope = pm.Normal("works", 0, 1) > 0, pm.Normal("slope", 0, 1, shape=5)
        mean = pt.switch(works, pt.dot(design, slope), 0.0)
        pm.Normal("y", mean, pt.switch(works, noise, dead), observed=y)

    # Closed form, normal, of each half.
    parts = linear_evidence(y, design, noise), stats.norm.logpdf(y, 0, dead).sum()
    exact = float(np.log(0.5) + np.logaddexp(*parts))
    return Problem("dead_or_alive", 6, variables, lambda: exact)


def peak_or_constant(name, mean, height):
    """A narrow peak on one half of the prior, and a constant on the other."""
    mean, sd = np.array(mean), 0.1

    def variables():
        half, x = pm.Normal("half", 0, 1), pm.Normal("x", 0, 1, shape=len(mean))
        peak = pm.logp(pm.Normal.dist(mean, sd), x).sum()
        pm.Potential("likelihood", pt.switch(half > 0, peak, height))

    # Closed form, normal.
    peak = stats.norm.logpdf(mean, 0, np.hypot(1, sd)).sum()
    exact = float(np.log(0.5) + np.logaddexp(peak, height))
    return Problem(name, 1 + len(mean), variables, lambda: exact)


def peak_beside_constant():
    """Peak and constant as in `peak_or_constant`; a coordinate of the peak selects the half."""
    mean, sd, height = np.array([0.9, 0.5, -0.7, 0.8, -1.1]), 0.1, -9.0

    def variables():
        x = pm.Normal("x", 0, 1, shape=5)
        peak = pm.logp(pm.Normal.dist(mean, sd), x).sum()
        pm.Potential("likelihood", pt.switch(x[0] > 0, peak, height))

    # Closed form, normal; the tail of the peak in the other half is beyond nine sds.
    peak = stats.norm.logpdf(mean, 0, np.hypot(1, sd)).sum()
    exact = float(np.logaddexp(peak, np.log(0.5) + height))
    return Problem("peak_beside_constant", 5, variables, lambda: exact)


def rare_regime():
    """A twentieth of the prior has small noise, and nearly all of the posterior."""
    rng, share, noise = np.random.default_rng(61), 0.05, np.array([0.05, 2.0])
    design = rng.normal(size=(10, 4))
    y = design @ [0.6, -1.2, 0.9, 0.4] + noise[0] * rng.normal(size=10)

    def variables():
        precise = pm.Uniform("precise", 0, 1) < share
        slope = pm.Normal("slope", 0, 1, shape=4)
        pm.Normal("y", pt.dot(design, slope), pt.switch(precise, *noise), observed=y)

    # Closed form, normal, of each regime.
    exact = logsumexp(np.log([share, 1 - share]) + [linear_evidence(y, design, s) for s in noise])
    return Problem("rare_regime", 5, variables, lambda: float(exact))


def several_laws(name, share, seed):
    """One of several laws with common coefficients, and small unknown noise."""
    rng, share, scale = np.random.default_rng(seed), np.array(share), np.array([1.0, 2.0, 0.5])
    x = np.linspace(0.1, 2, 12)
    designs = [
        np.stack([x**power, np.sin(power * x), np.ones(12)], axis=1)
        for power in range(1, 1 + len(share))
    ]
    y = designs[-1] @ [0.9, -1.5, 0.4] + 0.03 * rng.normal(size=12)

    def variables():
        place = pm.Uniform("place", 0, 1)
        slope = pm.Normal("slope", 0, scale)
        noise = pm.HalfNormal("noise", 1)
        mean = pt.dot(designs[-1], slope)
        for design, end in reversed([*zip(designs[:-1], np.cumsum(share), strict=False)]):
            mean = pt.switch(place < end, pt.dot(design, slope), mean)
        pm.Normal("y", mean, noise, observed=y)

    def log_evidence():
        parts = [
            log_integral(
                lambda t, d=design: (
                    linear_evidence(y, d * scale, np.exp(t)) + log_scale(stats.halfnorm)(t)
                ),
                (-12, 4),
            )
            for design in designs
        ]
        return float(logsumexp(np.log(share) + parts))

    # 1-D quadrature over the log noise for each law, coefficients in closed form.
    return Problem(name, 5, variables, log_evidence)


def blocked_sensor():
    """A rare regime has no other unknowns, and predicts the data accurately."""
    design = np.random.default_rng(62).normal(size=(8, 6))
    y, late = np.full(8, 5.0) + 0.01 * design[:, 0], 3.0

    def variables():
        blocked = pm.Exponential("time", 1.0) > late
        slope = pm.Normal("slope", 0, 1, shape=6)
        mean = pt.switch(blocked, 5.0, pt.dot(design, slope))
        pm.Normal("y", mean, pt.switch(blocked, 0.02, 1.0), observed=y)

    # Closed form, normal, of each regime.
    parts = stats.norm.logpdf(y, 5, 0.02).sum() - late, linear_evidence(y, design, 1.0)
    exact = float(np.logaddexp(parts[0], parts[1] + np.log1p(-np.exp(-late))))
    return Problem("blocked_sensor", 7, variables, lambda: exact)


# --- periodic variables --------------------------------------------------------------------------


def log_i0(kappa):
    return np.log(i0e(kappa)) + kappa


def angles(name, shape=()):
    """Add angles that are uniform on the circle."""
    return pm.Uniform(name, -np.pi, np.pi, shape=shape, default_transform=circular)


def angle():
    """One angle, one measurement of its cosine."""

    def variables():
        pm.Normal("y", pt.cos(pm.VonMises("angle", 0.0, 0.3)), 1.0, observed=0.7)

    def log_density(t):
        return stats.vonmises.logpdf(t, 0.3) + stats.norm.logpdf(0.7, np.cos(t))

    # 1-D quadrature.
    return Problem("angle", 1, variables, lambda: log_integral(log_density, (-np.pi, np.pi)))


def angle_at_the_end():
    """The mode is at the end of the period."""
    place, kappa, prior = 3.1, 15.0, 0.5

    def variables():
        pm.Potential("likelihood", kappa * pt.cos(pm.VonMises("angle", -2.5, prior) - place))

    # Closed form, the product of two von Mises densities.
    total = abs(prior * np.exp(-2.5j) + kappa * np.exp(1j * place))
    exact = float(log_i0(total) - log_i0(prior))
    return Problem("angle_at_the_end", 1, variables, lambda: exact)


def folded_angles():
    """Two angles of two and three equal modes, which lie across the ends of the period."""

    def variables():
        t = angles("angle", 2)
        pm.Potential("likelihood", 12 * pt.cos(2 * (t[0] - 1.5)) + 9 * pt.cos(3 * (t[1] - 1.0)))

    # Closed form, Bessel functions; several modes.
    exact = float(log_i0(12.0) + log_i0(9.0))
    return Problem("folded_angles", 2, variables, lambda: exact)


def ring_of_angles(name, kappa):
    """Angles on a ring, each coupled to the next; the whole ring can turn."""
    kappa = np.array(kappa)

    def variables():
        t = angles("angle", len(kappa))
        pm.Potential("coupling", (kappa * pt.cos(t - pt.roll(t, 1))).sum())

    # Sum over the orders of the Fourier series of each coupling.
    order = np.arange(-200, 201)
    exact = float(logsumexp(np.log(ive(order[:, None], kappa) + 1e-300).sum(axis=1)) + kappa.sum())
    return Problem(name, len(kappa), variables, lambda: exact)


def phase():
    """Amplitude and phase of a wave."""
    time, noise, scale = np.linspace(0, 3, 14), 0.2, 1.5
    y = 1.1 * np.cos(2 * time + 2.9) + noise * np.random.default_rng(63).normal(size=14)

    def variables():
        amplitude = pm.Weibull("amplitude", 2, scale * np.sqrt(2))
        pm.Normal("y", amplitude * pt.cos(2 * time + angles("phase")), noise, observed=y)

    # Closed form, normal: the amplitudes of cosine and sine are independent.
    design = scale * np.stack([np.cos(2 * time), np.sin(2 * time)], axis=1)
    exact = float(linear_evidence(y, design, noise))
    return Problem("phase", 2, variables, lambda: exact)


def directions():
    """Mean and concentration of directions around the end of the period."""
    y = np.array([3.0, -2.9, 2.6, -3.1, 2.8, -2.4, 3.1, 2.2])
    pull = np.exp(1j * y).sum()

    def variables():
        mean = pm.VonMises("mean", 0.0, 0.5)
        concentration = pm.Gamma("concentration", 2, 0.2)
        pm.VonMises("y", mean, concentration, observed=y)

    def log_density(t):
        kappa = np.exp(t)
        total = log_i0(np.abs(0.5 + kappa * pull)) - log_i0(0.5)
        total = total - len(y) * (np.log(2 * np.pi) + log_i0(kappa))
        return total + log_scale(stats.gamma(2, scale=5))(t)

    # 1-D quadrature over the log concentration, the mean in closed form.
    return Problem("directions", 2, variables, lambda: log_integral(log_density, (-12, 7)))


def arm():
    """Two joints of an arm whose end was measured: two solutions, one across the end."""
    lengths, end, noise = (1.0, 0.8), (-1.4, 0.2), 0.05

    def variables():
        t = angles("joint", 2)
        for function, place in zip((pt.cos, pt.sin), end, strict=True):
            reached = lengths[0] * function(t[0]) + lengths[1] * function(t[0] + t[1])
            pm.Normal(f"end_{function}", reached, noise, observed=place)

    def log_density(first, second):
        total = -2 * np.log(2 * np.pi)
        for function, place in zip((np.cos, np.sin), end, strict=True):
            reached = lengths[0] * function(first) + lengths[1] * function(first + second)
            total = total + stats.norm.logpdf(place, reached, noise)
        return total

    # 2-D quadrature; several modes.
    circle = (-np.pi, np.pi)
    log_evidence = partial(log_integral, log_density, circle, circle, panels=16)
    return Problem("arm", 2, variables, log_evidence)


# --- mass at bounds ------------------------------------------------------------------------------


def proportion(name, shapes, trials, successes):
    """A probability that is nearly 0 or 1 under the prior."""

    def variables():
        pm.Binomial("y", trials, pm.Beta("p", *shapes), observed=successes)

    # Closed form, beta-binomial.
    exact = float(stats.betabinom.logpmf(successes, trials, *shapes))
    return Problem(name, 1, variables, lambda: exact)


def rates(name, shape, events):
    """Rates under a gamma prior with nearly all of its mass at zero."""
    events = np.array(events)

    def variables():
        pm.Poisson("y", pm.Gamma("rate", shape, 1.0, shape=len(events)), observed=events)

    # Closed form, negative binomial.
    exact = float(stats.nbinom.logpmf(events, shape, 0.5).sum())
    return Problem(name, len(events), variables, lambda: exact)


def saturated(name, sd, y):
    """A scale over hundreds of orders of magnitude; the likelihood is constant at both ends."""

    def variables():
        scale = pm.LogNormal("scale", 0, sd)
        pm.Normal("y", 1 / (1 + 1 / scale), 0.5, observed=y)

    def log_density(t):
        return stats.norm.logpdf(t, 0, sd) + stats.norm.logpdf(y, stats.logistic.cdf(t), 0.5)

    def log_evidence():
        ends = stats.norm.logcdf(-40, 0, sd) + stats.norm.logpdf(y, [0, 1], 0.5)
        return float(logsumexp([*ends, log_integral(log_density, (-40, 40))]))

    # 1-D quadrature over the log scale; the likelihood is constant beyond.
    return Problem(name, 1, variables, log_evidence)


def vague_variance():
    """A vague inverse gamma prior of a variance."""
    y, small = np.array([0.3, -1.2, 2.1, 0.4, -0.8, 1.6]), 0.01

    def variables():
        pm.Normal("y", 0, pt.sqrt(pm.InverseGamma("variance", small, small)), observed=y)

    # Closed form, multivariate t.
    exact = float(stats.multivariate_t(shape=np.eye(6), df=2 * small).logpdf(y))
    return Problem("vague_variance", 1, variables, lambda: exact)


def sparse_shares(alpha):
    """Shares of four categories, of which the prior expects one to have nearly all."""
    alpha, counts = np.full(4, alpha), np.array([7, 0, 3, 0])

    def variables():
        pm.Multinomial("y", n=10, p=pm.Dirichlet("share", alpha), observed=counts)

    # Closed form, Dirichlet-multinomial.
    exact = float(stats.dirichlet_multinomial.logpmf(counts, alpha, 10))
    return Problem("sparse_shares", 3, variables, lambda: exact)


def several_proportions():
    """Three probabilities, at both bounds and between."""
    successes = np.array([0, 6, 2])

    def variables():
        pm.Binomial("y", 6, pm.Beta("p", 0.05, 0.05, shape=3), observed=successes)

    # Closed form, beta-binomial.
    exact = float(stats.betabinom.logpmf(successes, 6, 0.05, 0.05).sum())
    return Problem("several_proportions", 3, variables, lambda: exact)


# --- random variables that cannot be drawn in batches --------------------------------------------


def custom_uniform():
    """A user's function that draws with one parameter."""

    def draw(width, rng=None, size=None):
        return width * rng.uniform(-1, 1, size=size)

    def logp(value, width):
        return pt.switch(pt.abs(value) < width, -pt.log(2 * width), -np.inf)

    def variables():
        x = pm.CustomDist("x", 4.0, logp=logp, random=draw)
        pm.Normal("y", x, 0.5, observed=1.0)

    # Closed form, normal probabilities.
    exact = float(np.log((stats.norm.cdf(6) - stats.norm.cdf(-10)) / 8))
    return Problem("custom_uniform", 1, variables, lambda: exact)


def custom_laplace():
    """A user's function whose parameter is random."""
    y, noise = np.array([1.2, -0.3]), 0.3

    def draw(scale, rng=None, size=None):
        return rng.laplace(0, scale, size=size)

    def logp(value, scale):
        return -pt.log(2 * scale) - pt.abs(value) / scale

    def variables():
        scale = pm.HalfNormal("scale", 1)
        x = pm.CustomDist("x", scale, logp=logp, random=draw, shape=2)
        pm.Normal("y", x, noise, observed=y)

    def log_density(t):
        b, total = np.exp(t)[:, None], log_scale(stats.halfnorm)(t)
        one = -y / b + log_ndtr(y / noise - noise / b)
        other = y / b + log_ndtr(-y / noise - noise / b)
        each = np.logaddexp(one, other) + noise**2 / (2 * b**2) - np.log(2 * b)
        return total + each.sum(axis=1)

    # 1-D quadrature over the log scale; the sum of a Laplace and a normal variable in closed form.
    return Problem("custom_laplace", 3, variables, lambda: log_integral(log_density, (-7, 2.5)))


def custom_vector():
    """A user's function that draws a vector."""
    mean, y = np.array([0.5, -1.0, 2.0]), np.array([1.0, -1.5, 1.2])
    covariance = np.array([[1.0, 0.8, -0.3], [0.8, 1.5, 0.2], [-0.3, 0.2, 0.7]])

    def draw(mean, covariance, rng=None, size=None):
        return rng.multivariate_normal(mean, covariance, size=size)

    def logp(value, mean, covariance):
        return pm.logp(pm.MvNormal.dist(mean, covariance), value)

    def variables():
        own = {"logp": logp, "random": draw, "signature": "(n),(n,n)->(n)"}
        x = pm.CustomDist("x", mean, covariance, **own)
        pm.Normal("y", x, 0.2, observed=y)

    # Closed form, normal.
    total = covariance + 0.04 * np.eye(3)
    exact = float(stats.multivariate_normal(mean, total).logpdf(y))
    return Problem("custom_vector", 3, variables, lambda: exact)


def custom_expression():
    """A distribution that is given as an expression of another one."""

    def variables():
        mean = pm.Normal("mean", 0, 1)
        x = pm.CustomDist(
            "x", mean, dist=lambda mean, size: pt.exp(pm.Normal.dist(mean, 0.7, size=size))
        )
        pm.Normal("y", x, 0.4, observed=2.5)

    def log_density(t):
        return stats.norm.logpdf(t, 0, np.hypot(1, 0.7)) + stats.norm.logpdf(2.5, np.exp(t), 0.4)

    # 1-D quadrature over the logarithm; the mean in closed form.
    return Problem("custom_expression", 2, variables, lambda: log_integral(log_density, (-12, 6)))


def mixed_prior():
    """A prior that is a mixture of two distributions."""
    y, noise = np.array([-1.5, 3.0, 0.2]), 0.5

    def variables():
        parts = [pm.Normal.dist(-2, 0.3), pm.StudentT.dist(3, mu=2, sigma=1)]
        x = pm.Mixture("x", [0.4, 0.6], parts, shape=3)
        pm.Normal("y", x, noise, observed=y)

    def log_density(x, value):
        prior = np.log(0.4) + stats.norm.logpdf(x, -2, 0.3), np.log(0.6) + stats.t.logpdf(x, 3, 2)
        return np.logaddexp(*prior) + stats.norm.logpdf(value, x, noise)

    def log_evidence():
        return sum(log_integral(partial(log_density, value=value), (-10, 15)) for value in y)

    # 1-D quadratures.
    return Problem("mixed_prior", 3, variables, log_evidence)


def truncated_prior():
    """A prior that is truncated to its tail."""
    y, noise = np.array([1.2, 4.0]), 0.5

    def variables():
        x = pm.Truncated("x", pm.Normal.dist(0, 2), lower=1.0, shape=2)
        pm.Normal("y", x, noise, observed=y)

    # Closed form, normal probabilities.
    total = np.hypot(2, noise)
    mean, sd = y * 4 / total**2, 2 * noise / total
    parts = stats.norm.logpdf(y, 0, total) + stats.norm.logsf(1, mean, sd)
    exact = float((parts - stats.norm.logsf(1, 0, 2)).sum())
    return Problem("truncated_prior", 2, variables, lambda: exact)


def ordered_means():
    """Means of a mixture in order: most draws of the prior are impossible."""
    sd, prior_sd = 0.5, 4.0

    def variables():
        mean = pm.Normal("mean", 0, prior_sd, shape=3, transform=ordered)
        pm.NormalMixture("y", np.full(3, 1 / 3), mean, sigma=sd, observed=THREE_CLUSTERS)

    # One of six equal parts of the sum over all allocations.
    whole = label_switching("", np.full(3, 1 / 3), sd, THREE_CLUSTERS)
    return Problem("ordered_means", 3, variables, lambda: whole.log_evidence() - np.log(6))


# --- great effort --------------------------------------------------------------------------------


def change_points(count):
    """Steps of unknown size at unknown times: the density is flat in times, but for jumps."""
    rng, size, noise, scale = np.random.default_rng(51), 30, 0.4, np.array([2.0] + count * [1.5])
    time = np.arange(1.0, size + 1)
    truth = np.linspace(0, size, count + 2)[1:-1]
    y = 1 + (time[:, None] > truth) @ np.resize([1.6, -2.2, 1.2], count)
    y = y + noise * rng.normal(size=size)

    def variables():
        when = pm.Uniform("when", 0, size, shape=count)
        level = pm.Normal("level", 0, scale)
        later = pt.cast(time[:, None] > when, "float64")
        pm.Normal("y", level[0] + pt.dot(later, level[1:]), noise, observed=y)

    def log_evidence():
        """Each time lies in one interval between data; all intervals have the same prior."""
        later = time[:, None] > np.arange(size) + 0.5
        intervals = np.indices(count * (size,)).reshape(count, -1)
        intervals = intervals[:, (np.diff(intervals, axis=0) >= 0).all(axis=0)]
        orders = [
            gammaln(count + 1) - gammaln(np.bincount(which) + 1).sum() for which in intervals.T
        ]
        levels = np.concatenate([np.ones((size, intervals.shape[1], 1)), later[:, intervals.T]], 2)
        known = linear_evidence(y, levels.transpose(1, 0, 2) * scale, noise)
        return float(logsumexp(known + orders) - count * np.log(size))

    # Sum over the intervals, levels in closed form; a mode for each order of the times.
    return Problem(f"change_points_{count}", 2 * count + 1, variables, log_evidence)


def product_of_modes(unknowns):
    """Each unknown has two modes of unequal mass: 2^n modes."""
    weight = np.stack([np.linspace(0.3, 0.6, unknowns), np.linspace(0.7, 0.4, unknowns)])
    mean, sd = np.array([[-2.0], [1.5]]), np.array([[0.3], [0.5]])

    def variables():
        x = pm.Normal("x", 0, 2, shape=unknowns)
        peaks = pt.log(weight) + pm.logp(pm.Normal.dist(mean, sd), x)
        pm.Potential("peaks", pt.sum(pt.logsumexp(peaks, axis=0)))

    # Closed form, each factor is a mixture of normals; several modes.
    factors = np.log(weight) + stats.norm.logpdf(mean, 0, np.hypot(2, sd))
    exact = float(logsumexp(factors, axis=0).sum())
    return Problem(f"modes_{2**unknowns}", unknowns, variables, lambda: exact)


def four_labels():
    """Means of a mixture of four components: 24 equal modes."""
    y = [-5.0, -4.6, -1.1, -0.8, 2.0, 2.3, 6.1, 5.8]
    return label_switching("label_switching_4", np.full(4, 0.25), 0.4, y)


DIFFICULT = {
    kind: {problem.name: problem for problem in problems}
    for kind, problems in {
        "regimes": (
            dead_or_alive(),
            peak_or_constant("peak_or_constant", [0.8, 0.9, 0.7, 0.8, 0.9], -9.0),
            peak_or_constant("peak_or_higher_constant", [0.8, 0.9, -0.7, 0.9, -1.0], -8.0),
            peak_beside_constant(),
            rare_regime(),
            several_laws("two_laws", [0.7, 0.3], seed=64),
            several_laws("three_laws", [0.5, 0.3, 0.2], seed=65),
            blocked_sensor(),
        ),
        "periodic variables": (
            angle(),
            angle_at_the_end(),
            folded_angles(),
            ring_of_angles("ring_of_angles", [2.0, 1.5, 2.5, 1.0, 2.0, 3.0]),
            ring_of_angles("stiff_ring_of_angles", [15.0, 20.0, 25.0, 20.0]),
            phase(),
            directions(),
            arm(),
        ),
        "mass at bounds": (
            proportion("sure_proportion", (0.001, 0.001), 5, 5),
            proportion("rare_proportion", (0.01, 1.0), 5, 5),
            proportion("unseen_proportion", (0.01, 1.0), 5, 0),
            several_proportions(),
            rates("rate", 0.01, [3]),
            rates("unseen_rates", 0.01, [0, 0, 4]),
            saturated("vast_scale", 500.0, 0.8),
            saturated("wide_scale", 50.0, 0.1),
            vague_variance(),
            sparse_shares(0.05),
        ),
        "draws one by one": (
            custom_uniform(),
            custom_laplace(),
            custom_vector(),
            custom_expression(),
            mixed_prior(),
            truncated_prior(),
            ordered_means(),
        ),
        "great effort": (
            change_points(1),
            change_points(2),
            change_points(3),
            product_of_modes(5),
            product_of_modes(8),
            four_labels(),
            rates("many_rates", 0.01, np.resize([0, 3, 0, 1, 8], 20)),
        ),
    }.items()
}
"""All problems by kind and name."""
