"""Priors are fixed physical ranges, survive being written down, and keep double precision."""

import json

import numpy as np
import pymc as pm
import pytest

import pymc_hyperelastic as ph
from pymc_hyperelastic.models.priors import (
    complete_priors,
    prior_from_record,
    prior_to_record,
    register_prior,
)

# Both sides are the same expression in double precision, of terms of about 1 to 100.
SAME_DENSITY = 1e-12

ENERGIES = [ph.PowerLawNeoHookean(), ph.Ogden(), ph.CriscioneType()]

# Constructor, and points inside the support at which densities are compared. Small whole numbers
# and 0.5 are on purpose: PyTensor keeps them in less than double precision.
STORABLE = {
    "uniform": (lambda: pm.Uniform.dist(0, 50), [0.1, 7.0, 49.9]),
    "uniform, narrow": (lambda: pm.Uniform.dist(0.1, 0.7), [0.2, 0.6]),
    "normal": (lambda: pm.Normal.dist(0.5, 3), [-4.0, 0.7, 11.0]),
    "normal by precision": (lambda: pm.Normal.dist(0, tau=3), [-4.0, 0.7, 11.0]),
    "half-normal": (lambda: pm.HalfNormal.dist(1.5), [0.1, 0.7, 6.0]),
    "gamma": (lambda: pm.Gamma.dist(2, 3), [0.1, 0.7, 6.0]),
    "gamma by moments": (lambda: pm.Gamma.dist(mu=10, sigma=3), [0.1, 7.0, 60.0]),
    "exponential": (lambda: pm.Exponential.dist(3), [0.1, 0.7, 6.0]),
    "log-normal": (lambda: pm.LogNormal.dist(2, 0.3), [0.1, 7.0, 60.0]),
    "truncated normal": (lambda: pm.TruncatedNormal.dist(5, 3, lower=0), [0.1, 7.0, 16.0]),
    "beta": (lambda: pm.Beta.dist(2, 3), [0.1, 0.7, 0.99]),
    "student": (lambda: pm.StudentT.dist(3, mu=1, sigma=2), [-4.0, 0.7, 11.0]),
    "half-Cauchy": (lambda: pm.HalfCauchy.dist(3), [0.1, 0.7, 60.0]),
    "half-Student": (lambda: pm.HalfStudentT.dist(3, 2), [0.1, 0.7, 60.0]),
    "inverse gamma": (lambda: pm.InverseGamma.dist(3, 2), [0.1, 0.7, 6.0]),
    "Weibull": (lambda: pm.Weibull.dist(3, 2), [0.1, 0.7, 4.0]),
    "triangular": (lambda: pm.Triangular.dist(lower=0, upper=3, c=1), [0.1, 1.7, 2.9]),
}


def log_densities(prior, points) -> np.ndarray:
    return np.array([pm.logp(prior, np.float64(x)).eval(mode="FAST_COMPILE") for x in points])


def registered(prior):
    """The random variable that `prior` becomes in a model."""
    with pm.Model():
        return register_prior("x", prior)


@pytest.mark.parametrize("energy", ENERGIES, ids=lambda energy: energy.name)
def test_default_is_the_documented_range(energy):
    """The default prior of every parameter is uniform over the range that the material states."""
    priors = complete_priors(energy)
    assert list(priors) == list(energy.parameter_names)
    for parameter in energy.parameters:
        record = prior_to_record(parameter.name, priors[parameter.name])
        assert record == ["Uniform", [float(end) for end in parameter.prior_range]]


def test_default_knows_nothing_of_the_data():
    """Two classes have one prior: it does not depend on data, noise or the other priors."""
    data = ph.load_dataset("simulated_sheep_aorta")
    one = ph.ogden_model(ph.select(data, specimen="S1"), sigma=1.0, slope_weight=0)
    other = ph.ogden_model(
        ph.select(data, specimen="S5"),
        sigma=pm.HalfNormal.dist(2),
        slope_weight=3.0,
        priors={"alpha": pm.Uniform.dist(0, 40)},
    )
    assert prior_to_record("mu", one["mu"]) == prior_to_record("mu", other["mu"])


def test_given_priors_replace_the_defaults():
    """A given prior is taken as it is, and the order stays that of the material."""
    given = pm.HalfNormal.dist(3)
    priors = complete_priors(ph.Ogden(), {"alpha": given})
    assert list(priors) == ["mu", "alpha"]
    assert priors["alpha"] is given


@pytest.mark.parametrize("name", STORABLE)
def test_record_round_trip(name):
    """A prior that was written down and read, as JSON, has the density that it had."""
    make, points = STORABLE[name]
    record = prior_to_record("x", make())
    again = prior_from_record(json.loads(json.dumps(record)))
    assert prior_to_record("x", again) == record
    expected = log_densities(registered(make()), points)
    assert np.isfinite(expected).all()
    np.testing.assert_allclose(
        log_densities(registered(again), points), expected, rtol=0, atol=SAME_DENSITY
    )


@pytest.mark.parametrize("terms", [1, 3])
def test_default_of_a_vector_is_a_vector(terms):
    """Every entry has the range that the material states, and the record says how many."""
    energy = ph.OgdenSeries(terms=terms)
    priors = complete_priors(energy)
    for parameter in energy.parameters:
        assert priors[parameter.name].type.shape == (terms,)
        record = prior_to_record(parameter.name, priors[parameter.name])
        assert [record[0], *np.ravel(record[1]), *record[2:]] == [
            "Uniform",
            *parameter.prior_range,
            terms,
        ]


@pytest.mark.parametrize(
    "make",
    [
        lambda: pm.Uniform.dist(0, 50, shape=3),
        lambda: pm.Normal.dist([0.5, 3, 8], [1, 2, 3]),
        lambda: pm.HalfStudentT.dist(3, 2, shape=3),
        lambda: pm.Gamma.dist([1, 2, 3], 0.1),
    ],
    ids=["one range", "a normal each", "half-Student", "one rate"],
)
def test_record_of_a_vector_round_trip(make):
    """A vector prior that was written down and read has its size, and the density of each entry."""
    record = prior_to_record("x", make())
    again = prior_from_record(json.loads(json.dumps(record)))
    assert again.type.shape == make().type.shape == (3,)
    assert prior_to_record("x", again) == record
    point = np.array([0.7, 2.5, 6.0])
    found, expected = (
        pm.logp(registered(prior), point).eval(mode="FAST_COMPILE") for prior in (again, make())
    )
    assert expected.shape == (3,) and np.isfinite(expected).all()
    np.testing.assert_allclose(found, expected, rtol=0, atol=SAME_DENSITY)


@pytest.mark.parametrize(
    ("prior", "x", "expected"),
    [
        # Written with logarithms of NumPy, and numbers that need all digits.
        (lambda: pm.Uniform.dist(0, 50), 7.0, -np.log(50)),
        (lambda: pm.Exponential.dist(3), 0.7, np.log(3) - 2.1),
        (lambda: pm.Gamma.dist(2, 3), 0.7, 2 * np.log(3) + np.log(0.7) - 2.1),
        (lambda: pm.HalfNormal.dist(1.5), 0.7, np.log(2 / np.pi) / 2 - np.log(1.5) - 0.49 / 4.5),
    ],
    ids=["uniform", "exponential", "gamma", "half-normal"],
)
def test_whole_numbers_keep_double_precision(prior, x, expected):
    """Stated by numbers such as 3 or 1.5, a density still has all its digits."""
    np.testing.assert_allclose(
        log_densities(registered(prior()), [x]), expected, rtol=0, atol=SAME_DENSITY
    )


@pytest.mark.parametrize(
    "prior",
    [
        lambda: pm.CustomDist.dist(1.0, logp=lambda x, m: -((x - m) ** 2)),
        lambda: pm.Truncated.dist(pm.HalfNormal.dist(2), upper=3),
        lambda: pm.Mixture.dist([0.5, 0.5], [pm.Normal.dist(-3, 1), pm.Normal.dist(3, 1)]),
        lambda: pm.Interpolated.dist(np.array([0.0, 1.0, 2.0]), np.array([0.0, 1.0, 0.0])),
        lambda: pm.Normal.dist(pm.HalfNormal.dist(2), 1),
    ],
    ids=["custom", "truncated", "mixture", "interpolated", "hierarchical"],
)
def test_what_cannot_be_stored_says_so(prior):
    """A prior that a few numbers do not state is refused by name, before anything is sampled."""
    with pytest.raises(ValueError, match=r"prior of 'mu' cannot be stored"):
        prior_to_record("mu", prior())


@pytest.mark.parametrize(
    "prior",
    [
        lambda: pm.Truncated.dist(pm.HalfNormal.dist(2), upper=3),
        lambda: pm.Mixture.dist([0.5, 0.5], [pm.Normal.dist(-3, 1), pm.Normal.dist(3, 1)]),
        lambda: pm.CustomDist.dist(1.0, logp=lambda x, m: -((x - m) ** 2)),
        lambda: pm.Flat.dist(),
    ],
    ids=["truncated", "mixture", "custom", "flat"],
)
def test_what_cannot_be_stored_can_be_a_prior(prior):
    """Any scalar distribution of PyMC makes a model, even one that cannot be drawn from."""
    data = ph.select(ph.load_dataset("simulated_sheep_aorta"), specimen="S1", experiment=1)
    model = ph.ogden_model(data, sigma=1.0, slope_weight=0, priors={"mu": prior()})
    assert [rv.name for rv in model.free_RVs] == ["mu", "alpha"]


@pytest.mark.parametrize(
    "prior",
    [lambda: pm.Uniform.dist(0, 1), lambda: pm.HalfCauchy.dist(1)],
    ids=["uniform", "half-Cauchy"],
)
def test_one_distribution_for_two_parameters(prior):
    """One distribution object given twice makes two independent random variables."""
    shared = prior()
    with pm.Model():
        both = [register_prior(name, shared) for name in ("mu", "alpha")]
    draws = pm.draw(both, draws=3, random_seed=1, mode="FAST_COMPILE")
    assert not np.any(draws[0] == draws[1])
    assert shared.name is None


def test_one_distribution_for_two_models():
    """A dict of priors can be used again: the first model does not take hold of it."""
    data = ph.select(ph.load_dataset("simulated_sheep_aorta"), specimen="S1", experiment=1)
    priors = {"mu": pm.Gamma.dist(2, 3), "alpha": pm.Uniform.dist(0, 20)}
    settings = {"sigma": 1.0, "slope_weight": 0, "priors": priors}
    models = [ph.ogden_model(data, **settings) for _ in range(2)]
    point = models[0].initial_point()
    values = [float(model.compile_logp(mode="FAST_COMPILE")(point)) for model in models]
    assert values[0] == values[1]
    assert models[0]["mu"] is not models[1]["mu"]
