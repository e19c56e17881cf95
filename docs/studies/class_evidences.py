"""Compare evidences of classes, for many seeds, with exact values computed without the package.

``python class_evidences.py --seeds 100 --out class_evidences.json`` fits the two classes of the
simulated sheep aortas with three strain energies, pooled and with variability. For each it prints
the mean error of the log evidence with its standard error, and how often the truth lies within two
stated errors.

The exact values are computed by quadrature. For pooled classes this is the quadrature of
``tests/exact.py``. For classes with variability, the likelihood of each specimen is tabulated over
its two coordinates; this is exact, because the log likelihood is a parabola in the modulus. The
integral over the five unknowns of the class is computed by importance sampling, whose error is
printed too.
"""

import argparse
import json
import sys
from itertools import product
from pathlib import Path

import numpy as np
from numpy.polynomial.legendre import leggauss
from scipy import stats
from scipy.special import logsumexp

sys.path.append(str(Path(__file__).parents[2] / "tests"))
from exact import RESPONSES, curves_of, log_evidence_2d, parabola

import pymc_hyperelastic as ph

SIGMA, SLOPE_WEIGHT = 5 * ph.mmHg, 3.0
LAWS = {
    "PowerLawNeoHookean": ph.PowerLawNeoHookean(),
    "Ogden": ph.Ogden(),
    "CriscioneType": ph.CriscioneType(),
}
GROUPS = ("C1", "C2")
# Documented priors of a class, see `population_model`: the reference stress (kPa), then medians and
# standard deviations of the logarithms.
REFERENCE_STRESS = 20.0
STRAIN = (0.2, 0.7)
SHAPE_SD = 1.2
SPREAD = (0.4, 0.7)
# Points whose log likelihood is this many nats below the largest one are left out of a table.
NEGLIGIBLE = 20.0
# Number of Gauss-Legendre nodes in a panel.
ORDER = 12
# Smallest number of panels in an interval.
PANELS = 2
# Largest width of a panel, small because a class may be narrow.
WIDTH = 0.2
# Largest distance of a specimen from the prior mean, in prior standard deviations of the location.
REACH = 25.0
# Above this coordinate of the shape, curves no longer change: the power law is then an exponential.
LIMIT = 12.0
# Number of points of all specimens times number of distributions of a class, for one exact value.
WORK = 3e9
# Number of distributions of a class that are evaluated together.
BLOCK = 50


def panels(low, high, width=WIDTH):
    """Return nodes and weights of a composite Gauss-Legendre rule."""
    node, weight = leggauss(ORDER)
    count = max(PANELS, int(np.ceil((high - low) / width)))
    edges = np.linspace(low, high, count + 1)
    half = np.diff(edges)[:, None] / 2
    return (edges[:-1, None] + half * (node + 1)).ravel(), (half * weight).ravel()


def log_modulus_of_strain(law, log_strain, exponent):
    """Return the log modulus for which the stress at this hoop strain is the reference stress."""
    hoop = np.exp(np.exp(log_strain))
    return np.log(REFERENCE_STRESS) - np.log(hoop * RESPONSES[law](hoop, 1.0, exponent))


def log_strain_of_modulus(law, log_modulus, exponent):
    """Invert `log_modulus_of_strain` by bisection: the modulus falls as the strain grows."""
    low, high = np.full_like(log_modulus, -25.0), np.full_like(log_modulus, 3.0)
    for _ in range(80):
        middle = (low + high) / 2
        with np.errstate(over="ignore"):
            above = log_modulus_of_strain(law, middle, exponent) > log_modulus
        low, high = np.where(above, middle, low), np.where(above, high, middle)
    return (low + high) / 2


def tabulate(curves, law, shape_mean):
    """Return points ``(ln e, ln exponent)`` and log weights of an integral times the likelihood."""

    @np.errstate(all="ignore")  # pressures overflow for large exponents
    def profile(x):
        top, *others = parabola(
            curves, law, np.exp(np.minimum(x, LIMIT)), sigma=SIGMA, slope_weight=0.0
        )
        return np.where(np.isfinite(top), top, -np.inf), *others

    low, high = shape_mean - REACH * SHAPE_SD, shape_mean + REACH * SHAPE_SD
    scan = np.linspace(low, high, 4001)
    top = profile(scan)[0]
    inside = scan[top > top.max() - NEGLIGIBLE]
    low, high = max(inside[0] - 0.01, low), min(inside[-1] + 0.01, high)
    rules = [panels(low, min(high, LIMIT))]
    if high > LIMIT:
        rules.append(panels(LIMIT, high, width=1.0))
    shapes = [np.concatenate(x) for x in zip(*rules, strict=True)]
    top, curvature, peak = profile(shapes[0])
    reach = np.sqrt(NEGLIGIBLE / curvature)
    # A large modulus corresponds to a small strain.
    ends = [
        log_strain_of_modulus(law, np.log(m), np.exp(np.minimum(shapes[0], LIMIT)))
        for m in (peak + reach, np.maximum(peak - reach, 1e-3 * peak))
    ]
    points, log_mass = [], []
    for row, (shape, weight) in enumerate(zip(*shapes, strict=True)):
        strain, strain_weight = panels(ends[0][row], ends[1][row])
        modulus = np.exp(log_modulus_of_strain(law, strain, np.exp(min(shape, LIMIT))))
        misfit = top[row] - curvature[row] * (modulus - peak[row]) ** 2
        points.append(np.column_stack([strain, np.full_like(strain, shape)]))
        log_mass.append(misfit + np.log(weight * strain_weight))
    points, log_mass = np.concatenate(points), np.concatenate(log_mass)
    keep = log_mass > log_mass.max() - NEGLIGIBLE
    return points[keep], log_mass[keep]


def class_log_prior(theta, shape_mean):
    """Return the log prior density of ``(m_1, m_2, ln tau_1, ln tau_2, atanh rho)``."""
    location = stats.norm([np.log(STRAIN[0]), shape_mean], [STRAIN[1], SHAPE_SD])
    spread = stats.norm(np.log(SPREAD[0]), SPREAD[1])
    squared = np.tanh(theta[:, 4]) ** 2
    # The correlation is 2 Beta(2, 2) - 1, whose density is 3/4 (1 - rho^2).
    correlation = np.log(0.75) + 2 * np.log1p(-squared)
    return (
        location.logpdf(theta[:, :2]).sum(axis=1)
        + spread.logpdf(theta[:, 2:4]).sum(axis=1)
        + correlation
    )


def log_likelihood(theta, specimens):
    """Return the log product of the specimens' integrals, for each distribution of a class."""
    total = np.zeros(len(theta))
    for points, log_mass in specimens:
        squares = np.stack([np.ones(len(points)), *points.T, *(points**2).T, points.prod(axis=1)])
        for block in range(0, len(theta), BLOCK):
            m, tau = theta[block : block + BLOCK, :2].T, np.exp(theta[block : block + BLOCK, 2:4].T)
            rho = np.tanh(theta[block : block + BLOCK, 4])
            scale = 1 / (1 - rho**2)
            a, b, c = scale / tau[0] ** 2, scale / tau[1] ** 2, scale * rho / tau[0] / tau[1]
            constant = -(a * m[0] ** 2 + b * m[1] ** 2) / 2 + c * m[0] * m[1]
            constant -= np.log(2 * np.pi * tau[0] * tau[1]) - np.log(scale) / 2
            linear = a * m[0] - c * m[1], b * m[1] - c * m[0]
            rows = np.stack([constant, *linear, -a / 2, -b / 2, c], axis=1)
            total[block : block + BLOCK] += logsumexp(rows @ squares + log_mass, axis=1)
    return total


def class_evidence(data, law):
    """Return the log evidence of a class with variability, and its standard error."""
    rng = np.random.default_rng(1)
    shape_mean = np.log(LAWS[law].parameters[1].prior_range[1] / 6)
    specimens = [
        tabulate(curves_of(ph.select(data, specimen=name)), law, shape_mean)
        for name in dict.fromkeys(data["specimen"].values.tolist())
    ]
    mean = np.array([np.log(STRAIN[0]), shape_mean, *2 * [np.log(SPREAD[0])], 0.0])
    covariance = np.diag(np.square([STRAIN[1], SHAPE_SD, SPREAD[1], SPREAD[1], 0.6]))
    # Heavy-tailed proposals; each is fitted to the weighted draws of the one before.
    last = int(WORK / sum(len(log_mass) for _, log_mass in specimens))
    for draws in (4000, 8000, 8000, last):
        proposal = stats.multivariate_t(mean, covariance, df=6, seed=rng)
        theta = proposal.rvs(draws)
        # A correlation may be rounded to one, where the prior density is zero.
        with np.errstate(all="ignore"):
            log_weight = class_log_prior(theta, shape_mean) + log_likelihood(theta, specimens)
        log_weight = np.nan_to_num(log_weight - proposal.logpdf(theta), nan=-np.inf, neginf=-np.inf)
        weight = np.exp(log_weight - logsumexp(log_weight))
        mean = weight @ theta
        covariance = 1.2 * np.cov(theta.T, aweights=weight)
    return float(logsumexp(log_weight) - np.log(draws)), float(np.sqrt(weight @ weight - 1 / draws))


def pooled_evidence(data, law):
    """Return the log evidence of a pooled class, by quadrature."""
    box = [p.prior_range for p in LAWS[law].parameters]
    return log_evidence_2d(data, law, sigma=SIGMA, slope_weight=SLOPE_WEIGHT, box=box), 0.0


TRUTHS = {"alike": pooled_evidence, "differ": class_evidence}
SLOPE_WEIGHTS = {"alike": SLOPE_WEIGHT, "differ": 0.0}
VARIABILITY = {"alike": {}, "differ": {"variability": "specimen"}}


def fit(law, data, seed, kind):
    """Return the log evidence from the package, and its stated error."""
    likelihood = ph.SlopeAugmented(SIGMA, SLOPE_WEIGHTS[kind])
    settings = {"random_seed": seed, "progressbar": False} | VARIABILITY[kind]
    fitted = ph.fit_classes(LAWS[law], {"all": data}, likelihood, **settings)
    return tuple(float(x) for x in ph.log_evidence(fitted["all"]))


def summary(truth, error_of_truth, found):
    """Return one line with the true errors and the stated errors of the evidences."""
    errors, stated = found[:, 0] - truth, found[:, 1]
    return (
        f"truth {truth:.4f} +- {error_of_truth:.4f}, mean error "
        f"{errors.mean():+.4f} +- {errors.std() / np.sqrt(len(errors)):.4f}, rms "
        f"{np.sqrt(np.mean(errors**2)):.4f}, stated {stated.mean():.4f}, within two "
        f"{np.mean(np.abs(errors) < 2 * stated):.0%}"
    )


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, default=100)
    parser.add_argument("--first-seed", type=int, default=1)
    parser.add_argument("--laws", nargs="+", default=list(LAWS))
    parser.add_argument("--only", choices=["alike", "differ"])
    parser.add_argument("--out", type=Path)
    arguments = parser.parse_args()
    data, runs = ph.load_dataset("simulated_sheep_aorta"), []
    seeds = range(arguments.first_seed, arguments.first_seed + arguments.seeds)
    kinds = [arguments.only] if arguments.only else ["alike", "differ"]
    for law, group, kind in product(arguments.laws, GROUPS, kinds):
        part = ph.select(data, group=group)
        truth, own = TRUTHS[kind](part, law)
        found = np.array([fit(law, part, seed, kind) for seed in seeds])
        print(f"{law:18} {group}, specimens {kind}:", summary(truth, own, found), flush=True)
        runs.append(
            {"law": law, "group": group, "specimens": kind, "truth": truth, "error_of_truth": own}
            | {"log_evidence": found[:, 0].tolist(), "standard_error": found[:, 1].tolist()}
        )
        if arguments.out:
            arguments.out.write_text(json.dumps(runs, indent=1))


if __name__ == "__main__":
    main()
