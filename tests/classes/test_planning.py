"""Plans of studies: posteriors of many groups against grids and against the model of a class."""

import numpy as np
import pymc as pm
import pytest
import xarray as xr
from scipy import stats
from variable_classes import NAMES, TRAINING, fit

import pymc_hyperelastic as ph
from pymc_hyperelastic.classes.joint import Joint, unit_of_specimen
from pymc_hyperelastic.classes.normal_groups import Found, draw_groups, partial_correlations
from pymc_hyperelastic.classes.planning import _error
from pymc_hyperelastic.classes.variable import Variability
from pymc_hyperelastic.models.class_distribution import distributions_of
from pymc_hyperelastic.models.specimen_draws import SpecimenDraws
from pymc_hyperelastic.predictions.members import stored_draws

SEED = 915
X = "log_reference_strain"


def kind_of(energy):
    return Variability.of_settings(energy, sigma=1.0)


def drawn(scale, groups, draws=1000):
    """Draws of one group after the other, many times, which start from priors' middles."""
    size, count = len(scale.names), len(groups)
    logs = np.tile(scale.spread_prior[0], (count, 1))
    start = logs, np.zeros((count, size * (size - 1) // 2))
    return draw_groups(scale, groups, start, draws, np.random.default_rng(SEED))


def test_partial_correlations_are_those_of_the_factor():
    """A vine of three: of the first with the others, and of these given it."""
    a, b, c = 0.5, -0.3, 0.4
    root = np.array(
        [[1, 0, 0], [a, np.sqrt(1 - a**2), 0], [b, c * np.sqrt(1 - b**2), 0]], dtype=float
    )
    root[2, 2] = np.sqrt(1 - root[2] @ root[2])
    spread = np.array([0.1, 3.0, 2.0])
    np.testing.assert_allclose(partial_correlations((spread[:, None] * root)[None]), [[a, b, c]])


@pytest.mark.parametrize("size", [2, 6, 30])
def test_one_coordinate(size):
    """Against a grid of spreads, given which the location is normal; errors of two kinds."""
    scale = kind_of(ph.NeoHookean()).scale
    (mean,), (sd,) = scale.location_prior
    rng = np.random.default_rng(SEED)
    errors = np.array([0.1, 0.6])
    kind = np.arange(size) % 2
    x = mean + 0.3 * rng.standard_normal(size) + errors[kind] * rng.standard_normal(size)
    group = Found(x[:, None], kind, np.square(errors)[:, None, None])
    # As many groups as there are chains; one more of another size.
    other = Found(np.full((3, 1), mean), np.zeros(3, int), group.errors)
    found = drawn(scale, [group] * 8 + [other])
    (logs,), sd_of_logs = scale.spread_prior
    grid = logs + sd_of_logs * np.linspace(-6, 6, 2001)
    variance = np.exp(2 * grid)[:, None] + errors[kind] ** 2
    precision = sd**-2 + np.sum(1 / variance, axis=1)
    middle = (mean / sd**2 + np.sum(x / variance, axis=1)) / precision
    log_p = stats.norm.logpdf(grid, logs, sd_of_logs) + np.sum(
        stats.norm.logpdf(x, mean, np.sqrt(variance)), axis=1
    )
    # Of all x at once: what they have in common is the location.
    log_p += (precision * (middle - mean) ** 2 - np.log(precision)) / 2
    weights = np.exp(log_p - log_p.max())
    weights /= weights.sum()
    location = weights @ middle
    of_location = np.sqrt(weights @ (1 / precision + (middle - location) ** 2))
    of_logs = np.sqrt(weights @ grid**2 - (weights @ grid) ** 2)
    draws, log_spread = found.location[:8, :, 0], np.log(found.root[:8, :, 0, 0])
    # Eight chains tell the errors of means and standard deviations.
    for values, expected, spread in (
        (draws, location, of_location),
        (log_spread, weights @ grid, of_logs),
    ):
        assert abs(values.mean() - expected) < 0.06 * spread
        assert values.std() == pytest.approx(spread, rel=0.06)


def known(rng, place, root):
    """Draws of a specimen that is known with a normal error, from a wider distribution."""
    count, size = 2000, len(place)
    x = place + 2 * rng.standard_normal((count, size)) @ root.T
    covariance = root @ root.T
    log_weight = stats.multivariate_normal.logpdf(x, place, covariance)
    log_weight -= stats.multivariate_normal.logpdf(x, place, 4 * covariance)
    none = np.empty((0, count))
    draws = x.T, np.zeros((size, count)), none, log_weight - np.log(count)
    return SpecimenDraws(*draws, 1, 0.0, x, none)


@pytest.mark.deep
@pytest.mark.parametrize("energy", [ph.Ogden(), ph.Yeoh()], ids=lambda e: e.name)
def test_several_coordinates(energy):
    """As the PyMC model of the class has it, of draws of the same specimens."""
    kind = kind_of(energy)
    mean, size = kind.scale.location_prior[0], len(kind.scale.names)
    rng = np.random.default_rng(SEED)
    root = np.linalg.cholesky(0.08 * (np.eye(size) + 1.5))
    of_errors = 0.2 * np.stack([np.tri(size), np.tri(size) * np.linspace(0.5, 1.5, size)])
    which = np.arange(7) % 2
    x = mean + rng.standard_normal((7, size)) @ root.T
    units = {
        f"{i}": unit_of_specimen(known(rng, x[i], of_errors[k]), np.empty(0))
        for i, k in enumerate(which)
    }
    joint = Joint(kind, ["all"], None, [])
    tree = joint.fit({"all": units}, 8000, 1, np.random.SeedSequence(SEED))
    expected = distributions_of(tree, 8000)
    group = Found(x, which, of_errors @ of_errors.mT)
    found = drawn(kind.scale, [group] * 8, 2000)
    location = np.asarray(expected.location)[..., 0]
    spread = np.log(np.asarray(expected.spread)[..., 0])
    ours = np.log(np.linalg.norm(found.root, axis=-1))
    partial = np.arctanh(partial_correlations(found.root.reshape(-1, size, size)))
    theirs = np.arctanh(partial_correlations(np.linalg.cholesky(expected.covariance())))
    for a, b in (
        (found.location.reshape(-1, size).T, location),
        (ours.reshape(-1, size).T, spread),
        (partial.T, theirs.T),
    ):
        np.testing.assert_allclose(a.mean(axis=1), b.mean(axis=1), atol=0.1 * b.std(axis=1).min())
        np.testing.assert_allclose(a.std(axis=1), b.std(axis=1), rtol=0.1)


@pytest.fixture(scope="module")
def pilot():
    return fit(draws=1000, chains=1)


def plan(pilot, quantity=X, specimens=(4, 12), **settings):
    settings = {"studies": 200, "random_seed": SEED} | settings
    return ph.plan_study(pilot, quantity, specimens, **settings)


def test_what_curves_say_of_a_specimen(pilot):
    """By least squares: the pressure is linear in the modulus."""
    fitted = pilot["stiff"]
    draws = stored_draws(fitted, "B1")
    error = _error(draws, distributions_of(fitted))
    weights = np.exp(draws.log_weight - draws.log_weight.max())
    assert error[0, 0] == pytest.approx(np.cov(draws.centre, aweights=weights), rel=0.1)


def test_intervals_hold_the_truth(pilot):
    found = plan(pilot, [X, "log mu"], studies=300).squeeze("comparison")
    # Binomial errors.
    assert (abs(found["covered"] - 0.95) < 3 * np.sqrt(0.95 * 0.05 / 300)).all()
    few, many = (found.sel(specimens=n) for n in (4, 12))
    assert (few["width"] > 1.3 * many["width"]).all()
    assert (few["decided"] < many["decided"]).all()
    assert few["log_score"] < many["log_score"] < found["best_log_score"] + 0.01
    assert (found["wrong"] < 0.025).all()


def test_many_specimens(pilot):
    """The difference is then that of two means."""
    places = {"soft": (-1.5, 0.25), "stiff": (-2.0, 0.4)}
    exact = pilot.copy(deep=True)
    for name, (location, spread) in places.items():
        posterior = exact[name]["posterior"].to_dataset()
        values = {"location": location, "spread": spread}
        changed = {n: xr.full_like(posterior[n], v) for n, v in values.items()}
        exact[name]["posterior"] = xr.DataTree(posterior.assign(changed))
        del exact[name].attrs["checksum"]
    found = plan(exact, specimens=300, studies=50, relevant=0.3).squeeze()
    width = 2 * stats.norm.ppf(0.975) * np.sqrt((0.25**2 + 0.4**2) / 300)
    assert found["width"].item() == pytest.approx(width, rel=0.06)
    np.testing.assert_allclose(found["truth"], -0.5)
    assert found["decided"] == 1
    assert found["wrong"] == 0
    # By quadrature.
    x = np.linspace(-5, 1, 4001)
    p = np.array([stats.norm.pdf(x, *place) for place in places.values()])
    score = np.sum(p * np.log(p / p.sum(axis=0))) * (x[1] - x[0]) / 2
    error = found["log_score_se"].item()
    assert abs(found["best_log_score"].item() - score) < 4 * error
    assert abs(found["log_score"].item() - score) < 4 * error + 0.01
    assert (plan(exact, specimens=300, studies=50, relevant=0.6)["decided"] == 0).all()


def test_tests_whose_materials_differ():
    """They are part of what is not known of a specimen."""
    fitted = fit(draws=200, chains=1, experiment_effect=True)
    alike = fitted.copy(deep=True)
    for tree in alike.children.values():
        posterior = tree["posterior"].to_dataset()
        same = {n: posterior[n] * 1e-3 for n in ("experiment_spread", "effect_spread")}
        tree["posterior"] = xr.DataTree(posterior.assign(same))
        del tree.attrs["checksum"]
    few = plan(fitted, studies=50)["width"], plan(alike, studies=50)["width"]
    assert (few[0] > few[1]).all()


def test_a_seed_tells_all(pilot, tmp_path):
    once, again = (plan(pilot, studies=10, draws=50) for _ in range(2))
    xr.testing.assert_identical(once, again)
    once.to_netcdf(tmp_path / "plan.nc")
    xr.testing.assert_allclose(xr.load_dataset(tmp_path / "plan.nc"), once)


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"quantity": "strength"}, "no quantity is called 'strength'"),
        ({"quantity": "compliance"}, "compliance is that of a tube at a pressure"),
        ({"quantity": "compliance", "pressure": [1, 2]}, r"for one pressure; got \[1.0, 2.0\]"),
        ({"specimens": (1, 4)}, r"whole numbers, each 2 or more; got \(1, 4\)"),
        ({"specimens": (4.5,)}, r"whole numbers, each 2 or more; got \(4.5,\)"),
        ({"relevant": -1.0}, "relevant is -1.0; expected a difference, 0 or more"),
        ({"studies": 2}, "studies is 2; expected at least 10"),
    ],
)
def test_what_cannot_be_planned(pilot, settings, message):
    with pytest.raises(ValueError, match=message):
        plan(pilot, **settings)


def test_pilots_that_are_none(pilot):
    with pytest.raises(TypeError, match=r"classes must be a result of ph.fit_classes, the pilot"):
        plan([pilot])
    one = {
        name: ph.select(TRAINING[name], specimen=[f"{x}1"])
        for name, x in zip(NAMES, "AB", strict=True)
    }
    with pytest.raises(ValueError, match="class 'soft' has one specimen, 'A1'"):
        plan(fit(training=one, draws=100))
    own = {"spread": pm.LogNormal.dist(-1.0, 0.5, shape=1)}
    with pytest.raises(ValueError, match=r"priors of their own, of \['spread'\]"):
        plan(fit(priors=own, draws=100))
