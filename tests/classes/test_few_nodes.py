"""Curves by few nodes, chosen for materials of the prior, against curves by all nodes."""

import numpy as np
import pandas as pd
import pytest

import pymc_hyperelastic as ph
from pymc_hyperelastic.classes.variable import Variability
from pymc_hyperelastic.evidence.estimate import Estimate
from pymc_hyperelastic.evidence.importance import Integral
from pymc_hyperelastic.mechanics.wall_nodes import WallNodes

SEED = 20261127
# Nats: the largest error of a log likelihood, and its growth with the depth below the best draw.
TOLERANCE, OF_DEPTH = 0.003, 1e-4
# Nats: depth from which draws are not compared.
DEEP = 3000.0
# About the median of the first coordinate of the posterior.
MIDDLE = -2.2


def protocols(growth=1.1):
    """Three inflation and two extension tests; with a small `growth` some fibres are slack."""
    tests = [{"radius": growth * np.linspace(0.47, 0.62, 8), "stretch": s} for s in (1.4, 1.5, 1.6)]
    stretch = np.linspace(1.4, 1.6, 8)
    for radius in (0.5, 0.6):
        tests.append({"radius": growth * radius - 0.1 * (stretch - 1.4), "stretch": stretch})
    frame = pd.concat([pd.DataFrame(t).assign(experiment=i) for i, t in enumerate(tests)])
    frame = frame.assign(specimen="A", pressure=60 * (frame["radius"] / growth - 0.4))
    frame["axial_force"] = 30 * (frame["stretch"] - 1.2)
    tube = {"inner_radius": 0.45, "outer_radius": 0.57}
    return ph.inflation_data(frame, axial_stretch="stretch", check="ignore", **tube)


def sampler_of(data):
    return Variability.of_settings(ph.HolzapfelGasserOgden(), noise_sd=1.0).sampler(data)


@pytest.fixture(scope="module")
def taut():
    data = protocols()
    return sampler_of(data), data


def nodes_of(target):
    """Number of nodes of a likelihood."""
    return sum(
        v.get_value().size for v in target.log_likelihood.shared if v.name.endswith("log_hoop")
    )


def test_few_nodes_give_the_likelihood_of_all(taut):
    """At draws of the prior that were not used to choose the nodes."""
    sampler, data = taut
    target = sampler.target(data)
    quick = sampler._nearby(data, target, np.empty((0, target.dimension)))
    assert isinstance(sampler.forward.way.basis, WallNodes)
    assert 5 < nodes_of(quick) < nodes_of(target) / 2
    points = target.draw_prior(2000, np.random.default_rng(SEED))
    exact, found = (one.score(points)[1] for one in (target, quick))
    near = exact > exact.max() - DEEP
    assert near.sum() > 100
    allowed = TOLERANCE + OF_DEPTH * (exact.max() - exact[near])
    # One draw in some thousand may have a slack fibre that no draw had to which nodes were fitted.
    assert np.mean(np.abs(found[near] - exact[near]) < allowed) > 0.998
    misfits = [one.misfits(one.particles(points[near])) for one in (target, quick)]
    squares = [np.square(errors).sum(axis=1) / 2 for _, errors in misfits]
    assert np.mean(np.abs(np.subtract(*squares)) < allowed) > 0.998


@pytest.mark.parametrize(
    ("wrong", "tried"),
    [
        (lambda points, height, learned: height, ["few"]),
        # Wrong at particles that were found; the second time nodes are chosen for these.
        (lambda points, height, learned: height + 0.0031 * (learned == 0), ["few", "few"]),
        (lambda points, height, learned: height + 0.0029 * (learned == 0), ["few"]),
        (lambda points, height, learned: height + 0.01, ["few"] * 4 + ["all"]),
        # Wrong for half of the prior, so that no particle would be found there.
        (lambda points, height, learned: height - 40 * (points[:, 0] > MIDDLE), ["all"]),
        (lambda points, height, learned: np.full_like(height, np.nan), ["all"]),
    ],
    ids=["right", "wrong at first", "nearly right", "wrong", "wrong in half", "NaN"],
)
def test_few_nodes_are_used_if_they_are_right(wrong, tried, taut, monkeypatch):
    """To 0.003 nats at the particles that are found, and roughly at draws of the prior."""
    (sampler, data), targets, learned = taut, [], []
    nearby, all_nodes = sampler._nearby, sampler._model_for(data).log_likelihood
    points = sampler.target(data).draw_prior(4000, np.random.default_rng(SEED))
    points = points[np.argsort(-sampler.target(data).score(points)[1])]
    best = points[points[:, 0] < MIDDLE][:20]
    # The likelihood of all nodes, changed, stands for that of few nodes.
    exact = sampler.target(data).score

    def instead(data, target, points):
        quick = nearby(data, target, points)

        def changed(x):
            prior, likelihood = exact(x)
            return prior, wrong(x, likelihood, len(points))

        quick.score = changed
        learned.append(points)
        return quick

    def take(target):
        targets.append("all" if target.log_likelihood is all_nodes else "few")
        return Integral(Estimate(0.0, 0.0), 0.0, "importance", best)

    monkeypatch.setattr(sampler, "_nearby", instead)
    sampler._integral(data, None, take)
    assert targets == tried
    if tried == ["few", "few"]:
        np.testing.assert_array_equal(learned[1], best)


@pytest.mark.deep
def test_curves_of_fibres_that_slacken_between_nodes_are_improved():
    """Other nodes are used if the error of the curves is larger than allowed."""
    data, angle, ways = protocols(0.93), np.log(5.0 / (90 - 5.0)), []
    sampler = sampler_of(data)

    def take(sampler):
        target = sampler.target(data)
        points = target.draw_prior(50, np.random.default_rng(SEED))
        points[:, sampler.scale.names.index("logit_beta")] = angle
        ways.append(isinstance(getattr(sampler.forward.way, "basis", None), WallNodes))
        return Integral(Estimate(0.0, 0.0), 0.0, "importance", points), target

    found, _ = sampler._by_right_curves(data, take)
    assert ways[0] and len(ways) > 1 and not any(ways[1:])
    assert np.isfinite(found.log_value.standard_error)
