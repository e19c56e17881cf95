"""bridge_sampling: evidences from draws of any sampler, against exact ones; warnings."""

import warnings

import numpy as np
import pymc as pm
import pytensor
import pytensor.tensor as pt
import pytest
import xarray as xr
from agreement import CHAINS, DRAWS, SEED, Regression, as_tree, assert_agrees
from evidences import PROBLEMS
from pymc.distributions import transforms
from pytensor.compile.mode import Mode
from tiers import deep, long

import pymc_hyperelastic as ph
from pymc_hyperelastic.evidence.batched import BatchedFunction
from pymc_hyperelastic.evidence.unconstrained import unconstrained_draws

# Root mean square of the actual errors over the stated errors: 1 if stated errors are right. Stated
# errors assume the largest possible correlation of their parts, so that they may be too large.
RIGHT_ERRORS = (0.65, 1.4)
# Rounding of a transform and its inverse, for numbers of order one.
ROUNDING = 1e-7


def by_chain(values):
    """Return independent draws as chains."""
    return np.reshape(values, (CHAINS, -1, *np.shape(values)[1:]))


def bridge(model, tree, **settings):
    """Return the evidence by one normal proposal, unless another kind is given."""
    settings = {"random_seed": SEED, "proposal": "normal"} | settings
    return ph.bridge_sampling(model, tree, **settings)


def assert_doubtful(model, tree, match, **settings):
    """Check that a warning gives the reason, and that the standard error is infinite."""
    with pytest.warns(UserWarning, match=match):
        found = bridge(model, tree, **settings)
    assert found.standard_error == np.inf and np.isfinite(found.value)


@pytest.fixture(scope="module")
def regression():
    return Regression(5)


@pytest.fixture
def tree(regression):
    return regression.draws(np.random.default_rng(SEED))


@pytest.mark.parametrize("proposal", ["normal", "warped", "mixture", "auto"])
def test_evidence_by_each_proposal_equals_the_exact_value(regression, tree, proposal):
    assert_agrees(bridge(regression.model, tree, proposal=proposal), regression.log_evidence, 0.015)


@pytest.mark.parametrize(
    ("dimension", "chains", "draws", "phi", "runs", "proposal"),
    [
        (4, 2, 400, 0.5, 30, "normal"),
        *deep([(10, 2, 1000, 0.0, 100, "auto")]),
        *long([(30, 4, 1000, 0.7, 100, "auto")]),
    ],
)
def test_stated_errors_are_as_large_as_the_actual_errors(
    dimension, chains, draws, phi, runs, proposal
):
    """Draws are independent or autocorrelated, from one chain or several."""
    regression, rng = Regression(dimension), np.random.default_rng(SEED)
    found = []
    for run in range(runs):
        tree = regression.draws(rng, chains, draws, phi)
        found.append(bridge(regression.model, tree, random_seed=run, proposal=proposal))
    value, error = np.transpose(found)
    ratio = (value - regression.log_evidence) / error
    assert RIGHT_ERRORS[0] < np.sqrt(np.mean(ratio**2)) < RIGHT_ERRORS[1]
    assert abs(ratio.mean()) < 4 / np.sqrt(runs)


def test_same_seed_gives_the_same_estimate(regression, tree):
    first, again, other = (bridge(regression.model, tree, random_seed=seed) for seed in (1, 1, 2))
    assert first == again != other


def test_potentials_and_missing_data_are_part_of_the_density():
    with pm.Model() as model:
        x = pm.Normal("x", 0, 1)
        with pytest.warns(pm.exceptions.ImputationWarning):
            pm.Normal("y", x, 1, observed=np.ma.masked_invalid([0.4, np.nan]))
        pm.Potential("p", -(x**2) / 2 + 3)
    # Three normal densities of x with precision 1 each; the missing value integrates to 1.
    rng, exact = np.random.default_rng(SEED), 3 - 0.5 * np.log(2 * np.pi * 3) - 0.4**2 / 3
    x = rng.normal(0.4 / 3, 1 / np.sqrt(3), (CHAINS, DRAWS))
    tree = as_tree(x=x, y_unobserved=rng.normal(x, 1)[..., None])
    assert_agrees(bridge(model, tree), exact, 0.02)


# A model without data has the evidence 1, and its posterior is the prior.


def bounded():
    pm.Gamma("positive", 0.5, 2.0, shape=3)
    pm.Dirichlet("simplex", np.array([1.0, 2.0, 0.5]))
    pm.ZeroSumNormal("zero_sum", 2.0, shape=(2, 3))


def circles_and_bounds_that_depend_on_others():
    a = pm.Uniform("a", -1, 4)
    pm.Uniform("b", a, a + pt.exp(a))
    pm.VonMises("angle", [0.0, 2.8], [0.3, 2.0])


def two_modes():
    pm.NormalMixture("x", w=[0.3, 0.7], mu=[-4.0, 4.0], sigma=[1.0, 0.5], shape=2)


def prior_draws(model, count=CHAINS * DRAWS):
    drawn = pm.draw(model.free_RVs, count, random_seed=SEED, mode=Mode("py", "fast_compile"))
    return as_tree(**{v.name: by_chain(x) for v, x in zip(model.free_RVs, drawn, strict=True)})


@pytest.mark.parametrize(
    "prior", [circles_and_bounds_that_depend_on_others, two_modes, *deep([bounded])]
)
def test_evidence_without_data_is_one(prior):
    with pm.Model() as model:
        prior()
    assert_agrees(bridge(model, prior_draws(model), proposal="auto"), 0.0, 0.1)


def test_unconstrained_draws_are_recovered_from_constrained_ones():
    """Each transform of PyMC is inverted."""
    with pm.Model() as model:
        bounded()
        circles_and_bounds_that_depend_on_others()
        pm.LKJCholeskyCov("factor", n=3, eta=2.0, sd_dist=pm.Exponential.dist(1.0))
        pm.Normal("up", [0.0, 1.0, 2.0], transform=transforms.ordered, initval=[0, 1, 2])
    stored = model.replace_rvs_by_values(model.free_RVs)
    constrain = BatchedFunction.of_model(model, stored)
    moved = np.random.default_rng(SEED).normal(size=(20, constrain.dimension))
    draws = {v.name: by_chain(x) for v, x in zip(model.free_RVs, constrain(moved), strict=True)}
    found, names = unconstrained_draws(model, as_tree(**draws))
    np.testing.assert_allclose(found, by_chain(moved), rtol=ROUNDING, atol=ROUNDING)
    assert names.count("simplex") == 2 and names.count("factor") == 6


def test_draws_rounded_to_a_bound_are_refused_without_unconstrained_draws():
    with pm.Model() as model:
        pm.Beta("x", 2, 2)
    tree = prior_draws(model)
    logit = np.log(tree["posterior"]["x"] / (1 - tree["posterior"]["x"]))
    tree["posterior"]["x"][1, 7] = 1.0
    tree["posterior"]["x"][2, 3] = 0.0
    with pytest.raises(ValueError, match=r"2 of 2000 draws of 'x', the first of them draw 7 of ch"):
        bridge(model, tree)
    tree["unconstrained_posterior"] = xr.DataTree(logit.to_dataset(name="x_logodds__"))
    assert_agrees(bridge(model, tree), 0.0, 0.02)


def test_chains_that_visit_modes_in_different_shares_warn():
    """The true share of the right mode is 0.7."""
    rng, shape = np.random.default_rng(SEED), (CHAINS, DRAWS)
    with pm.Model() as model:
        pm.NormalMixture("x", w=[0.3, 0.7], mu=[-4.0, 4.0], sigma=[1.0, 0.5])
    right = rng.random(shape) < np.reshape([0.2, 0.9, 0.7, 0.5], (-1, 1))
    x = np.where(right, rng.normal(4, 0.5, shape), rng.normal(-4, 1.0, shape))
    assert_doubtful(model, as_tree(x=x), r"the chains disagree \(R-hat \d+\.\d\d of x\)")


def test_draws_of_another_posterior_warn(regression):
    """The location of the draws differs, or their width by a tenth."""
    rng = np.random.default_rng(SEED)
    other = Regression(5, shift=0.3).draws(rng)
    match = "not distributed as the posterior"
    assert_doubtful(regression.model, other, match)
    wide = regression.draws(rng, draws=1000, width=1.1)
    assert_doubtful(regression.model, wide, match)


def test_constant_or_short_chains_warn(regression, tree):
    """Waves of whole periods have an R-hat of 1, but few effective draws."""
    tree["posterior"]["slope"][0] = tree["posterior"]["slope"].values[0, 0]
    assert_doubtful(regression.model, tree, "the chains disagree")
    phase = 2 * np.pi * np.arange(500)[:, None] * np.arange(1, 6) / 250
    waves = np.sqrt(2) * np.cos(np.stack([phase, phase + 1]))
    tree = as_tree(slope=regression.mean + waves @ regression.factor.T)
    assert_doubtful(regression.model, tree, r"the chains are too short \(\d\d effective draws of ")


def test_more_than_one_divergence_in_a_thousand_draws_warns(regression, tree):
    diverging = np.zeros((CHAINS, DRAWS), bool)
    diverging[0, :2] = True
    tree["sample_stats"] = xr.DataTree(xr.Dataset({"diverging": (("chain", "draw"), diverging)}))
    assert np.isfinite(bridge(regression.model, tree).standard_error)
    tree["sample_stats"]["diverging"][1, 0] = True
    assert_doubtful(regression.model, tree, "3 of 2000 transitions diverged")


def test_proposal_without_a_draw_of_positive_density_warns():
    """The posterior is a ridge that is too thin for any draw of a proposal."""
    rng = np.random.default_rng(SEED)
    with pm.Model() as model:
        x = pm.Normal("x", 0, 1, shape=2)
        on_ridge = pt.abs(pt.sum(x**2) - 1) < 1e-9
        pm.Potential("ridge", pt.switch(on_ridge, 0.0, -np.inf))
    angle = rng.uniform(0, 2 * np.pi, (CHAINS, DRAWS))
    tree = as_tree(x=np.stack([np.cos(angle), np.sin(angle)], axis=-1))
    with pytest.warns(UserWarning, match="hardly overlap"):
        assert bridge(model, tree).standard_error == np.inf


def test_estimate_does_not_depend_on_chains_thinning_or_precision(regression, tree):
    rng = np.random.default_rng(SEED)
    for draws in (
        regression.draws(rng, chains=1, draws=1000),
        regression.draws(rng, draws=3000, phi=0.7).isel(draw=slice(None, None, 5)),
        regression.draws(rng, chains=20, draws=10),
    ):
        assert_agrees(bridge(regression.model, draws), regression.log_evidence, 0.06)
    single = tree.map_over_datasets(lambda group: group.astype("float32"))
    found = [bridge(regression.model, draws).value for draws in (tree, single)]
    assert found[0] == pytest.approx(found[1], abs=1e-4)


def test_estimate_does_not_depend_on_the_order_of_dimensions(regression, tree):
    slope = tree["posterior"]["slope"].rename(slope_0="column")
    other = xr.DataTree.from_dict({"posterior": slope.transpose().to_dataset()})
    assert bridge(regression.model, other) == bridge(regression.model, tree)


def constant(tree, chain, begin, end, value=0.3):
    """Return draws in which one coefficient of a chain is constant for some time."""
    tree["posterior"]["slope"][chain, begin:end, 1] = value
    return tree


REFUSED = [
    (lambda tree: tree["posterior"].to_dataset(), r"expected the DataTree of pm\.sample, .* Data"),
    (lambda tree: xr.DataTree.from_dict({"prior": tree["posterior"]}), r"no posterior.*\['prior'"),
    (
        lambda tree: as_tree(slopes=tree["posterior"]["slope"].values),
        r"lacks \['slope'\], free variables .* \['slopes'\]",
    ),
    (lambda tree: tree.isel(slope_0=slice(4)), r"the shape \(4,\), the model's \(5,\)"),
    (lambda tree: tree.isel(chain=0), r"'slope' has the dimensions \('draw', 'slope_0'\)"),
    (
        lambda tree: tree.isel(draw=slice(49)),
        r"4 chain\(s\) of 49 draws are too few for 5 unkn.*200",
    ),
    (
        lambda tree: constant(tree, 2, 5, 6, np.nan),
        r"1 of 2000 draws of 'slope', .* draw 5 of chain 2, are not finite",
    ),
    (lambda tree: constant(tree.isel(chain=[0]), 0, 0, 250), r"chain 0 stands .* in \['slope'\], "),
    (lambda tree: constant(tree.isel(chain=[0, 1]), 1, 250, 500), r"chain 1 stands still for half"),
    (lambda tree: constant(tree, slice(None), 0, 500), r"all draws of \['slope'\] are the same"),
]


@pytest.mark.parametrize(("change", "message"), REFUSED)
def test_unusable_draws_are_refused(regression, tree, change, message):
    with pytest.raises((TypeError, ValueError), match=message):
        bridge(regression.model, change(tree))


def test_draws_with_a_density_of_zero_are_refused():
    with pm.Model() as model:
        x = pm.Normal("x", 0, 1)
        pm.Uniform("y", x, x + 1, observed=0.5)
    x = np.random.default_rng(SEED).uniform(-0.4, 0.4, (CHAINS, DRAWS))
    x[1, 3:5] = 0.6
    match = r"2 of 2000 draws, the first of them draw 3 of chain 1, have a density of zero"
    with pytest.raises(ValueError, match=match):
        bridge(model, as_tree(x=x))


def test_model_with_a_random_density_is_refused():
    """A likelihood that is estimated by simulation, and one of a minibatch."""
    rng = np.random.default_rng(SEED)
    noisy = pytensor.wrap_py([pt.dscalar], [pt.dscalar])(lambda x: np.asarray(rng.normal(-(x**2))))
    with pm.Model() as simulated:
        pm.Potential("likelihood", noisy(pm.Normal("x")))
    with pm.Model() as some_data:
        part = pm.Minibatch(np.zeros(20), batch_size=5)
        pm.Normal("y", pm.Normal("x"), observed=part, total_size=20)
    draws = as_tree(x=rng.normal(size=(CHAINS, DRAWS)))
    for model in (simulated, some_data):
        with pytest.raises(ValueError, match="the density of the model is random"):
            bridge(model, draws)


def test_too_few_draws_for_the_number_of_unknowns_are_refused():
    many = Regression(200)
    tree = many.draws(np.random.default_rng(SEED), chains=2, draws=201)
    with pytest.raises(ValueError, match=r"of 201 draws are too few for 200 .* must be 404 draws"):
        bridge(many.model, tree)


def test_wrong_models_and_settings_are_refused(regression, tree):
    with pytest.raises(TypeError, match=r"expected a pm\.Model, not str"):
        bridge("model", tree)
    with pytest.raises(ValueError, match="proposal is 'cauchy'; expected one of"):
        bridge(regression.model, tree, proposal="cauchy")
    with pytest.raises(ValueError, match="proposal_draws is 10; expected at least 200"):
        bridge(regression.model, tree, proposal_draws=10)
    with pm.Model() as model:
        pm.Poisson("count", 3)
    with pytest.raises(ValueError, match=r"here are discrete: \['count'\]"):
        bridge(model, as_tree(count=np.ones((2, 500))))


@pytest.mark.deep
@pytest.mark.parametrize("sampler", ["pymc", "nutpie"])
def test_evidence_from_nuts_is_exact_and_divergences_warn(sampler):
    """A noncentred hierarchy has no divergences; a centred hierarchy has some."""
    settings = {"chains": 4, "random_seed": SEED, "progressbar": False, "nuts_sampler": sampler}
    problem = PROBLEMS["eight_schools_noncentred"]
    with problem.model() as model:
        tree = pm.sample(cores=1, target_accept=0.95, **settings)
    assert_agrees(bridge(model, tree), problem.log_evidence(), 0.02)
    with PROBLEMS["eight_schools"].model() as model, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        tree = pm.sample(cores=1, **settings)
    assert_doubtful(model, tree, "transitions diverged|the chains disagree")
