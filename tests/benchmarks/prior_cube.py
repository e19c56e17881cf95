"""Priors of PyMC models as maps of the unit cube, which is what nested samplers ask for.

Variables are taken in the order of the model, each by its inverse distribution function given its
parents. What has no such function, as a mixture, is refused.
"""

import numpy as np
import pymc as pm
import pytensor
import pytensor.tensor as pt
from pymc.model.transform.conditioning import remove_value_transforms
from pytensor.graph.replace import clone_replace


def on_cube(model):
    """Log likelihood as a function of independent uniform variables, and their number."""
    natural = remove_value_transforms(model)
    u, used, values = pt.vector("u"), 0, {}
    for rv in natural.free_RVs:
        value, size = from_uniform(rv, u[used:])
        # Parents come first: their values are known.
        values[rv] = clone_replace(value, values)
        used += size
    logp = natural.logp([*natural.observed_RVs, *natural.potentials])
    at = {natural.rvs_to_values[rv]: value for rv, value in values.items()}
    # Values have known shapes, which parts of a vector have not.
    logp = clone_replace(logp, {v: v.type.filter_variable(value) for v, value in at.items()})
    return pytensor.function([u], logp, trust_input=True), used


def from_uniform(rv, u):
    """Value of a variable at the beginning of a vector of uniform ones, and how many it takes."""
    parameters, shape = rv.owner.op.dist_params(rv.owner), tuple(rv.shape.eval())
    size = int(np.prod(shape))
    match type(rv.owner.op).__name__:
        case "DirichletRV":
            alpha = parameters[0]
            later = pt.cumsum(alpha[::-1])[::-1][1:]
            part = pm.icdf(pm.Beta.dist(alpha[:-1], later), u[: size - 1])
            left = pt.concatenate([[1.0], pt.cumprod(1 - part)])
            return left * pt.concatenate([part, [1.0]]), size - 1
        case "RandomWalkRV":
            first, step = pm.icdf(parameters[0], u[:1]), pm.icdf(parameters[1], u[1:size])
            return pt.cumsum(pt.concatenate([first, step])), size
        case "_LKJCholeskyCovRV":  # of two variables
            eta, sd = parameters[1], pm.icdf(parameters[2], u[:2])
            z = 2 * pm.icdf(pm.Beta.dist(eta, eta), u[2]) - 1
            return pt.stack([sd[0], z * sd[1], pt.sqrt(1 - z**2) * sd[1]]), size
    return pm.icdf(rv, u[:size].reshape(shape)), size
