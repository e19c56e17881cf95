"""Priors: documented defaults, registration in a model, and records in a file."""

import json

import numpy as np
import pymc as pm
import pytest

import pymc_hyperelastic as ph
from pymc_hyperelastic.models.priors import (
    complete_layers,
    complete_priors,
    prior_from_record,
    prior_to_record,
    register_prior,
)

# Both sides are one expression in double precision, of terms of about 1 to 100.
SAME_DENSITY = 1e-12

# Distributions and points in their support. PyTensor stores small whole numbers and 0.5 in less
# than double precision, which must not reach the density.
DISTRIBUTIONS = {
    "normal by precision": (lambda: pm.Normal.dist(0, tau=3), [-4.0, 0.7, 11.0]),
    "gamma by moments": (lambda: pm.Gamma.dist(mu=10, sigma=3), [0.1, 7.0, 60.0]),
    "beta": (lambda: pm.Beta.dist(2, 3), [0.1, 0.7, 0.99]),
    "half-Student": (lambda: pm.HalfStudentT.dist(3, 2), [0.1, 0.7, 60.0]),
    "triangular": (lambda: pm.Triangular.dist(lower=0, upper=3, c=1), [0.1, 1.7, 2.9]),
    "one range": (lambda: pm.Uniform.dist(0, 50, shape=3), [[0.7, 2.5, 6.0]]),
    "a normal for each": (lambda: pm.Normal.dist([0.5, 3, 8], [1, 2, 3]), [[0.7, 2.5, 6.0]]),
    "one rate": (lambda: pm.Gamma.dist([1, 2, 3], 0.1), [[0.7, 2.5, 6.0]]),
}


def log_densities(prior, points):
    """Log densities of the random variable that a prior becomes in a model."""
    with pm.Model():
        variable = register_prior("x", prior)
    return [pm.logp(variable, np.array(x)).eval(mode="FAST_COMPILE") for x in points]


def test_default_priors_are_uniform_over_the_documented_range():
    given = pm.HalfNormal.dist(3)
    priors = complete_priors(ph.Ogden(), {"alpha": given})
    assert list(priors) == ["mu", "alpha"] and priors["alpha"] is given
    assert prior_to_record("mu", priors["mu"]) == ["Uniform", [0.0, 100.0]]
    series = ph.OgdenSeries(terms=3)
    records = {name: prior_to_record(name, p) for name, p in complete_priors(series).items()}
    for p in series.parameters:
        assert [*np.ravel(records[p.name][1]), *records[p.name][2:]] == [*p.prior_range, 3]


@pytest.mark.parametrize("name", DISTRIBUTIONS)
def test_prior_restored_from_its_record_has_the_same_density(name):
    make, points = DISTRIBUTIONS[name]
    record = prior_to_record("x", make())
    again = prior_from_record(json.loads(json.dumps(record)))
    assert prior_to_record("x", again) == record and again.type.shape == make().type.shape
    expected = log_densities(make(), points)
    assert np.isfinite(expected).all()
    np.testing.assert_allclose(log_densities(again, points), expected, rtol=0, atol=SAME_DENSITY)


def test_registered_priors_are_evaluated_in_double_precision():
    for prior, x, expected in (
        (pm.Uniform.dist(0, 50), 7.0, -np.log(50)),
        (pm.Exponential.dist(3), 0.7, np.log(3) - 2.1),
        (pm.Gamma.dist(2, 3), 0.7, 2 * np.log(3) + np.log(0.7) - 2.1),
        (pm.HalfNormal.dist(1.5), 0.7, np.log(2 / np.pi) / 2 - np.log(1.5) - 0.49 / 4.5),
    ):
        np.testing.assert_allclose(log_densities(prior, [x]), [expected], rtol=0, atol=SAME_DENSITY)


def test_prior_that_cannot_be_stored_can_still_be_registered():
    """Distributions of distributions, and of matrices, cannot be read from a record."""
    prior = pm.Truncated.dist(pm.HalfNormal.dist(2), upper=3)
    for refused in (prior, pm.LKJCorr.dist(n=2, eta=2)):
        with pytest.raises(ValueError, match=r"prior of 'mu' cannot be stored"):
            prior_to_record("mu", refused)
    with pm.Model() as model:
        register_prior("mu", prior)
    assert [rv.name for rv in model.free_RVs] == ["mu"]


@pytest.mark.parametrize("prior", [pm.Uniform.dist(0, 1), pm.HalfCauchy.dist(1)])
def test_one_distribution_makes_independent_variables(prior):
    """In one model or in two: a copy is registered, and the distribution keeps no name."""
    with pm.Model():
        both = [register_prior(name, prior) for name in ("mu", "alpha")]
    with pm.Model() as other:
        assert register_prior("mu", prior) in other.free_RVs
    draws = pm.draw(both, draws=3, random_seed=1, mode="FAST_COMPILE")
    assert not np.any(draws[0] == draws[1])
    assert prior.name is None


def test_distributions_of_layers_are_numbered_unless_shared():
    shared, thickness = pm.Gamma.dist(2, 0.1), pm.LogNormal.dist(-1, 0.3)
    layers = [
        ph.Layer(ph.Demiray(), 0.2, mu=shared),
        ph.Layer(ph.Demiray(), thickness, mu=shared, b=2.0),
    ]
    filled, distributions = complete_layers(layers)
    assert list(distributions) == ["mu", "b_1", "thickness_2"]
    assert distributions["mu"] is shared and filled[1].parameters["b"] == 2.0
    low, high = next(p.prior_range for p in ph.Demiray().parameters if p.name == "b")
    assert prior_to_record("b", distributions["b_1"]) == ["Uniform", [low, high]]
