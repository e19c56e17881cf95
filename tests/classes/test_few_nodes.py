"""Specimens by curves of few nodes, right for materials like those of the prior, against all."""

import numpy as np
import pandas as pd
import pytest
from tiers import tiers

import pymc_hyperelastic as ph
from pymc_hyperelastic.classes.specimens import SpecimenSampler
from pymc_hyperelastic.classes.variable import Variability
from pymc_hyperelastic.evidence.estimate import Estimate
from pymc_hyperelastic.evidence.importance import Integral
from pymc_hyperelastic.mechanics.empirical import fewer_nodes
from pymc_hyperelastic.mechanics.tube import GEOMETRY
from pymc_hyperelastic.mechanics.wall_nodes import WallNodes
from pymc_hyperelastic.models.forward.collocated import known_tubes
from pymc_hyperelastic.models.forward.divided import Divided

SEED = 20261127  # any would do
# Nats: what may be added to the error of an evidence; this fraction of how deep a draw lies below
# the highest; and how deep it is no longer looked at.
TOLERANCE, OF_DEPTH, DEEP = 0.003, 1e-4, 3000.0
# About the middle of the first coordinate of the draws that are like the data.
MIDDLE = -2.2
NOISE = {"noise_sd": 1.0, "force_noise_sd": 2.0, "force_offset_sd": 3.0}


def protocols(growth=1.0, points=8):
    """Three inflation tests and two extension tests on an aorta.

    Of a small `growth` a part of the walls is shorter around the tube than unloaded.
    """
    tests = [
        {"radius": growth * np.linspace(0.47, 0.62, points), "stretch": stretch}
        for stretch in (1.4, 1.5, 1.6)
    ]
    stretch = np.linspace(1.4, 1.6, points)
    for radius in (0.5, 0.6):
        tests.append({"radius": growth * radius - 0.1 * (stretch - 1.4), "stretch": stretch})
    frame = pd.concat([pd.DataFrame(t).assign(experiment=i) for i, t in enumerate(tests)])
    frame = frame.assign(specimen="A")
    frame["pressure"] = 60 * (frame["radius"] / growth - 0.4)
    frame["axial_force"] = 30 * (frame["stretch"] - 1.2)
    tube = {"inner_radius": 0.45, "outer_radius": 0.57}
    return ph.inflation_data(frame, axial_stretch="stretch", check="ignore", **tube)


def sampler_of(energy, data, **settings):
    return Variability.of_settings(energy, **NOISE | settings).sampler(data)


def quick_of(sampler, data):
    """Target of few nodes, if there is one, and that of all."""
    target = sampler.target(data)
    return sampler._nearby(data, target, np.empty((0, target.dimension))), target


def nodes_of(target):
    """Nodes of a likelihood."""
    shared = {v.name: v.get_value() for v in target._score.shared}
    return sum(value.size for name, value in shared.items() if name.endswith("log_hoop"))


# Pressures alone take half of the time to compile.
NO_FORCES = {"force_noise_sd": None, "force_offset_sd": None}
CASES = [
    ("taut", ph.HolzapfelGasserOgden(), 1.1, NO_FORCES),
    ("slack", ph.FourFiber(), 0.93, {}),
    ("experiments differ", ph.FourFiber(hoop_fibres=False), 1.1, {"experiment_effect": True}),
]


@pytest.mark.parametrize(
    ("energy", "growth", "settings"),
    tiers([case[1:] for case in CASES], lambda case: case == CASES[0][1:]),
    ids=[name for name, *_ in CASES],
)
def test_few_nodes_say_what_all_of_them_say(energy, growth, settings):
    """Likelihoods and errors of draws of the prior that none of the nodes was found by."""
    apart = "experiment_effect" in settings
    # A test by itself needs about as many nodes as all of them.
    data = protocols(growth, points=16 if apart else 8)
    sampler = sampler_of(energy, data, **settings)
    quick, target = quick_of(sampler, data)
    assert isinstance(sampler.forward.way.basis, WallNodes)
    tests = data.sizes["test"] if apart else 1
    assert 5 * tests < nodes_of(quick) < nodes_of(target) / 2
    points = target.draw_prior(2000, np.random.default_rng(SEED))
    exact, found = (of.score(points)[1] for of in (target, quick))
    near = exact > exact.max() - DEEP
    assert near.sum() > 100
    allowed = TOLERANCE + OF_DEPTH * (exact.max() - exact[near])
    assert np.all(np.abs(found[near] - exact[near]) < allowed)
    of_misfits = [of.misfits(of.particles(points[near])) for of in (target, quick)]
    squares = [np.square(errors).sum(axis=1) / 2 for _, errors in of_misfits]
    assert np.all(np.abs(np.subtract(*squares)) < allowed)


@pytest.fixture(scope="module")
def taut():
    data = protocols(1.1)
    return sampler_of(ph.HolzapfelGasserOgden(), data, **NO_FORCES), data


def taken(sampler, data, found, monkeypatch, change):
    """Of which targets an integral is taken, and the rest of the materials they are right for.

    The likelihood of quick targets is changed, of so many points that these were learned from.
    """
    of, learned = [], []
    nearby = sampler._nearby

    def instead(data, target, points):
        quick = nearby(data, target, points)
        score = quick.score

        def changed(x):
            prior, likelihood = score(x)
            return prior, change(x, likelihood, len(points))

        quick.score = changed
        learned.append(points)
        return quick

    def take(one):
        of.append("all" if one._score is sampler._model_for(data).log_likelihood else "few")
        return Integral(Estimate(0.0, 0.0), 0.0, "importance", found)

    monkeypatch.setattr(sampler, "_nearby", instead)
    sampler._integral(data, None, take)
    return of, learned


@pytest.mark.parametrize(
    ("wrong", "tried"),
    [
        (lambda points, height, learned: height, ["few"]),
        # Of what is found; the second time it is learned from.
        (lambda points, height, learned: height + 0.01 * (learned == 0), ["few", "few"]),
        (lambda points, height, learned: height + 0.01, ["few"] * 4 + ["all"]),
        # Of a half, so that it would not be found.
        (lambda points, height, learned: height - 40 * (points[:, 0] > MIDDLE), ["all"]),
        (lambda points, height, learned: np.full_like(height, np.nan), ["all"]),
        (lambda points, height, learned: np.full_like(height, -np.inf), ["all"]),
    ],
    ids=["right", "a little at first", "a little", "a part", "no number", "nothing"],
)
def test_few_nodes_count_if_they_are_right(wrong, tried, taut, monkeypatch):
    """By what was found, and by draws of the prior; else all is done by all nodes."""
    sampler, data = taut
    target = sampler.target(data)
    points = target.draw_prior(4000, np.random.default_rng(SEED))
    points = points[np.argsort(-target.score(points)[1])]
    best = points[points[:, 0] < MIDDLE][:20]
    of, learned = taken(sampler, data, best, monkeypatch, wrong)
    assert of == tried
    if tried == ["few", "few"]:
        np.testing.assert_array_equal(learned[1], best)


def test_nothing_is_unlike_where_nothing_is_possible(taut):
    """Draws of the prior tell then nothing of few nodes, and no warning is said."""
    sampler, data = taut
    quick, target = quick_of(sampler, data)
    points = target.draw_prior(10, np.random.default_rng(SEED))
    impossible = lambda points: (np.zeros(len(points)), np.full(len(points), -np.inf))  # noqa: E731
    target.score = impossible
    assert len(target.roughly_unlike(quick)) and len(target.unlike(quick, points)) == 10
    quick.score = impossible
    assert not len(target.unlike(quick, points))


@pytest.mark.deep
def test_nodes_are_few_or_none():
    """Each test by itself has a few points alone, and needs as many nodes."""
    data = protocols(1.1)
    law = ph.FourFiber(hoop_fibres=False)
    sampler = sampler_of(law, data, experiment_effect=True, **NO_FORCES)
    assert isinstance(sampler.forward.way.basis, WallNodes)
    quick, _ = quick_of(sampler, data)
    assert quick is None


@pytest.mark.deep
def test_slopes_are_scored_by_all_nodes():
    """They are not known by nodes in the walls."""
    data = protocols(0.93)
    sampler = sampler_of(ph.HolzapfelGasserOgden(), data, slope_weight=0.1)
    assert isinstance(sampler.forward.way, Divided)
    quick, _ = quick_of(sampler, data)
    assert quick is None


@pytest.mark.parametrize(
    ("law", "growth"),
    tiers(
        [("FourFiber", 0.93), ("HolzapfelGasserOgden", 0.93), ("Ogden", 1.1)],
        lambda case: case[0] == "HolzapfelGasserOgden",
    ),
)
def test_all_nodes_say_what_quadrature_says(law, growth):
    """Pressures and forces of walls with and without slack parts, by the functions of the package.

    Data in which no fibre is slack were there first.
    """
    energy, data = getattr(ph, law)(), protocols(growth)
    way = sampler_of(energy, protocols(1.1)).forward.way
    materials = {
        "FourFiber": [13.0, 3.0, 0.05, 1.0, 0.1, 3.8, 0.4, 39.0],
        "HolzapfelGasserOgden": [15.0, 5.0, 0.4, 39.0],
        "Ogden": [20.0, 3.0],
    }[law]
    tubes = known_tubes(data)
    own = [np.array([value, 1.1 * value]) for value in materials]
    found = way.basis.curves(energy, tubes, own, with_force=True)
    tube = {name: getattr(tubes, name) for name in GEOMETRY}
    for i, factor in enumerate((1.0, 1.1)):
        given = energy.join([factor * value for value in materials])
        exact = [
            f(energy, tubes.radius, **tube, **given)
            for f in (ph.inflation_pressure, ph.axial_force)
        ]
        for curves, of_package in zip(found, exact, strict=True):
            curve = of_package.eval()
            assert np.abs(curves[i] - curve).max() < 1e-10 * np.abs(curve).max()


def of_angles(beta, sampler, data):
    """Of which nodes the curves were by which materials with such an angle were found."""
    taken = []

    def take(sampler):
        target = sampler.target(data)
        points = target.draw_prior(50, np.random.default_rng(SEED))
        points[:, sampler.scale.names.index("logit_beta")] = np.log(beta / (90 - beta))
        taken.append(sampler.forward.way)
        return Integral(Estimate(0.0, 0.0), 0.0, "importance", points), target

    found, _ = sampler._by_right_curves(data, take)
    return [isinstance(getattr(way, "basis", None), WallNodes) for way in taken], found


@pytest.mark.deep
def test_fibres_that_slacken_between_nodes():
    """Their curves are wrong by more than is let pass, and made right."""
    data = protocols(0.93)
    sampler = sampler_of(ph.HolzapfelGasserOgden(), data)
    by_nodes, found = of_angles(39.0, sampler, data)
    assert by_nodes == [True] and np.isfinite(found.log_value.standard_error)
    by_nodes, found = of_angles(5.0, sampler, data)
    assert by_nodes[0] and not any(by_nodes[1:]) and len(by_nodes) > 1
    assert np.isfinite(found.log_value.standard_error)


@pytest.mark.deep
def test_specimens_with_many_points():
    """Matrices of all nodes would be too large: nodes are those that the law asks for."""
    few, many = protocols(1.1), protocols(1.1, points=100)
    sampler = sampler_of(ph.HolzapfelGasserOgden(), few)
    assert sampler.forward.takes(few) and not sampler.forward.takes(many)
    by_nodes, _ = of_angles(39.0, sampler, many)
    assert by_nodes == [False]
    assert not sampler._models  # nothing was made of these data


def test_few_nodes_are_not_looked_for_where_there_are_few():
    """Of a law whose curves have a handful, nothing is drawn."""
    data = ph.select(protocols(1.1), experiment=[0])
    sampler = sampler_of(ph.Ogden(), data)
    assert isinstance(sampler, SpecimenSampler)
    quick, _ = quick_of(sampler, data)
    assert quick is None
    forward, shared = sampler._model_for(data).forward, set(sampler.target(data)._score.shared)
    assert not forward.nearby(lambda: pytest.fail("drawn"), shared)


def test_of_responses_that_all_overflow_no_node_is_left_out():
    """Nothing is learned of them; of others, even a few, it is."""
    places = np.log([1.2, 1.3, 1.4]), np.log([1.5, 1.5, 1.6])
    law, count = ph.HolzapfelGasserOgden(), 4

    def nodes_of_materials(k2):
        values = {"c": 10.0, "k1": 5.0, "k2": k2, "beta": 40.0}
        entries = [np.full(count, v) for v in law.split(values)]
        return fewer_nodes(law, places, entries, with_force=True)

    nodes, weights = nodes_of_materials(1e6)
    np.testing.assert_array_equal(nodes, [0, 1, 2])
    np.testing.assert_array_equal(weights, np.eye(3))
    nodes, weights = nodes_of_materials(0.4)
    assert len(nodes) == 2  # one material has two responses
    np.testing.assert_allclose(weights[:, nodes], np.eye(2), atol=1e-12)
