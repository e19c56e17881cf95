"""Evidence of a material with two parameters, by a fixed rule over both."""

from collections.abc import Mapping

import numpy as np
import pymc as pm
from scipy.special import logit, logsumexp

from pymc_hyperelastic.evidence.target import Target

# The likelihood is negligible elsewhere: centre and half width.
PLACES = {"mu": (20.0, 12.0), "alpha": (6.5, 4.5)}  # kPa, and without unit
# Nodes along each parameter: the posterior is a ridge, which is 0.1 wide at some moduli.
ORDER = 300


def log_evidence(model: pm.Model, bounds: Mapping[str, tuple[float, float]]) -> float:
    """Integrate the likelihood over uniform priors within the bounds."""
    node, weight = np.polynomial.legendre.leggauss(ORDER)
    columns, log_weights = [], []
    for variable in model.free_RVs:
        (low, high), (centre, half) = bounds[variable.name], PLACES[variable.name]
        columns.append(logit((centre + half * node - low) / (high - low)))
        log_weights.append(np.log(half * weight / (high - low)))
    points = np.stack(np.meshgrid(*columns, indexing="ij"), axis=-1).reshape(-1, 2)
    log_likelihood = Target(model).score(points)[1]
    return float(logsumexp(log_likelihood + np.add.outer(*log_weights).ravel()))
