"""How the wall is integrated in a model: by which rule, of how many nodes, in how many parts."""

import numpy as np
import pandas as pd
import pymc as pm
import pytensor
import pytensor.tensor as pt
import pytest
from tables import SECTOR

import pymc_hyperelastic as ph
from pymc_hyperelastic.evidence import batched
from pymc_hyperelastic.evidence.batched import BatchedFunction
from pymc_hyperelastic.mechanics.tube import inferred_geometry
from pymc_hyperelastic.mechanics.wall import gauss_legendre
from pymc_hyperelastic.models.forward import rules
from pymc_hyperelastic.models.forward.collocated import Collocated
from pymc_hyperelastic.models.forward.direct import Direct, WallVariables
from pymc_hyperelastic.models.forward.divided import Divided
from pymc_hyperelastic.models.forward.rules import HIGHEST_ORDER, _least_order, way_to_integrate
from pymc_hyperelastic.models.observation import Observation
from pymc_hyperelastic.models.priors import complete_priors

# Sums of squares of pressures that are right to about 1e-11.
LIKELIHOOD_TOLERANCE = 1e-9
# The same sums, of arrays of other lengths.
ROUNDING = 1e-13

NOISE = {"sigma": 1.0, "slope_weight": 1.0}
OBSERVATION = Observation(**NOISE)
FIBRES = {
    "c": pm.Uniform.dist(1, 5),
    "k1": pm.Uniform.dist(1, 4),
    "k2": pm.Uniform.dist(0.3, 1),
    "beta": pm.Uniform.dist(20, 40),
}


# Below the unloaded radius of 1 mm the hoop stretch is below 1, as that of fibres.
SLACK = (0.9, 0.97, 1.05, 1.1, 1.2)


def curve(radius=(1.1, 1.15, 1.2, 1.25, 1.3), *, outer_radius=1.4, **geometry):
    """One test of a tube of inner radius 1 mm."""
    frame = pd.DataFrame({"specimen": "S", "experiment": 1, "radius": radius})
    frame["pressure"] = 10 * (frame["radius"] - 1)
    frame["axial_force"] = 20.0
    tube = {"inner_radius": 1.0, "outer_radius": outer_radius, **geometry}
    return ph.inflation_data(frame, **tube, **SECTOR, check="ignore")


def way(energy, data, priors, geometry=None, *, mode="auto", with_force=False):
    """How the wall is integrated."""
    settings = {"mode": mode, "with_force": with_force, "known_radii": True, "by_test": False}
    return way_to_integrate(WallVariables(energy, priors, geometry or {}), data, **settings)


@pytest.mark.parametrize("with_force", [False, True], ids=["pressure", "force"])
@pytest.mark.parametrize(
    "energy", [ph.Ogden(), ph.PowerLawNeoHookean(), ph.OgdenSeries(terms=1)], ids=repr
)
def test_smooth_laws_are_collocated(energy, with_force):
    """Over the default priors, constant matrices are right to rounding, and so they are chosen."""
    priors = complete_priors(energy)
    chosen = way(energy, curve(), priors, with_force=with_force)
    assert isinstance(chosen, Collocated)
    assert chosen == way(energy, curve(), priors, mode="collocation", with_force=with_force)
    assert way(energy, curve(), priors, mode="quadrature") == Direct(32)


def test_walls_are_divided_where_fibres_may_slacken():
    """Taut all over the data the law is smooth; where fibres slacken in them it has a kink."""
    energy = ph.HolzapfelGasserOgden()
    assert isinstance(way(energy, curve(), FIBRES), Collocated)
    slack = curve(SLACK)
    assert isinstance(way(energy, slack, FIBRES), Divided)
    assert way(energy, slack, FIBRES) == way(energy, slack, FIBRES, mode="collocation")
    # Whether there are kinks also depends on the angles that the prior allows.
    across = curve(axial_stretch=1.5, opening_angle=-1.0)
    along = FIBRES | {"beta": pm.Uniform.dist(60, 80)}
    assert isinstance(way(energy, across, along), Collocated)


def test_rule_is_the_same_each_time():
    """It is found by random draws, but always the same ones."""
    energy, priors = ph.HolzapfelGasserOgden(), FIBRES
    geometry = inferred_geometry({"inner_radius": pm.Uniform.dist(0.9, 1.1)})
    ways = {way(energy, curve(), priors, geometry) for _ in range(2)}
    assert len(ways) == 1


CASES = {
    "unknown radius": (ph.Ogden(), {}, {"inner_radius": pm.Uniform.dist(0.9, 1.05)}),
    "thick wall": (ph.Ogden(), {"outer_radius": 2.5}, {"inner_radius": pm.Uniform.dist(0.9, 1.05)}),
    "slack fibres": (ph.HolzapfelGasserOgden(), {"radius": SLACK}, {}),
}


@pytest.mark.parametrize("name", CASES)
def test_chosen_order_is_exact(name):
    """Likelihoods of the order that was chosen are those of order 64, where they are not nil."""
    energy, tube, unknown = CASES[name]
    data = curve(**tube)
    priors = {"mu": pm.Uniform.dist(1, 20), "alpha": pm.Uniform.dist(1, 10)}
    priors = FIBRES if name == "slack fibres" else priors
    forward = OBSERVATION.forward_model(energy, data, priors, unknown)
    chosen = forward.way
    direct = chosen.slack if isinstance(chosen, Divided) else chosen
    assert isinstance(direct, Direct) and direct.order <= 64
    functions = []
    for other in (chosen, Direct(64)):
        with pm.Model() as model:
            parameters, geometry = (
                {
                    k: pm.Uniform(k, *(x.eval() for x in v.owner.op.dist_params(v.owner)))
                    for k, v in distributions.items()
                }
                for distributions in (priors, unknown)
            )
            same = forward.with_data(data)
            same.way = other
            pm.Potential("curves", OBSERVATION.log_likelihood(same.tube(parameters, geometry)))
        functions.append(
            BatchedFunction.of_model(model, model.replace_rvs_by_values(model.potentials))
        )
    points = np.random.default_rng(1).uniform(-3, 3, (30, functions[0].dimension))
    (found,), (expected,) = (function(points) for function in functions)
    assert np.all(np.isfinite(expected))
    np.testing.assert_allclose(found, expected, rtol=LIKELIHOOD_TOLERANCE)


def test_thin_walls_take_fewer_nodes():
    """The order is no more than what the wall needs."""
    priors = {"mu": pm.Uniform.dist(1, 20), "alpha": pm.Uniform.dist(1, 10)}
    orders = [
        way(
            ph.Ogden(),
            curve(outer_radius=outer),
            priors,
            {"inner_radius": pm.Uniform.dist(0.95, 1.02)},
        ).order
        for outer in (1.1, 3.0)
    ]
    assert orders[0] < orders[1]
    assert orders[0] <= 16


def test_thin_parts_are_held_to_the_whole():
    """Their own curves may be no more than what rounding leaves of the others."""
    data, thin = curve(), 1e-7

    def part(order):
        node, weight = gauss_legendre(order)
        rounding = 1e-16 * np.sin(order)  # as good as random
        return [np.full((1, 5), thin * weight @ np.exp(node) + rounding)]

    assert _least_order(part, data) == HIGHEST_ORDER
    assert _least_order(part, data, [np.ones((1, 5))]) == 6


def test_parts_are_the_whole(monkeypatch):
    """Particles that need much memory are scored a few at a time, to the same numbers."""
    model = ph.ogden_model(curve(), **NOISE, mode="quadrature")
    outputs = [model.logp(), *model.replace_rvs_by_values([model["likelihood"]])]
    function = BatchedFunction.of_model(model, outputs)
    particles = np.random.default_rng(2).normal(size=(101, 2))
    needed = function._bytes_per_particle
    assert needed >= 5 * 32 * 8  # one number at each node of each point, at least
    assert needed == 1 << (needed.bit_length() - 1)

    calls = []

    def counted(points, *shared):
        calls.append(len(points))
        return function.function(points, *shared)

    counting = BatchedFunction(counted, function.shared, function.dimension)
    assert counting._bytes_per_particle == needed
    calls.clear()
    monkeypatch.setattr(batched, "_CACHED_BYTES", 1000 * needed)
    whole = counting(particles)
    assert calls == [101]
    monkeypatch.setattr(batched, "_FEWEST_TOGETHER", 1)
    for at_once, expected in ((25, [25, 25, 25, 25, 1]), (0, [1] * 101)):
        calls.clear()
        monkeypatch.setattr(batched, "_CACHED_BYTES", at_once * needed)
        parts = counting(particles)
        assert calls == expected
        for part, all_at_once in zip(parts, whole, strict=True):
            assert part.shape == (101,)
            np.testing.assert_allclose(part, all_at_once, rtol=ROUNDING)


def test_draws_are_remembered(monkeypatch):
    """Those of equal distributions are drawn once; of what may change they are drawn anew."""
    asked = []
    monkeypatch.setattr(rules, "_known_draws", {})
    monkeypatch.setattr(rules, "_drawn_anew", lambda given, *_: asked.append(given) or [1.0])
    for width in (1.0, 1.0, 2.0):
        rules._drawn([pt.exp(pm.Normal.dist(0.0, width))], 10, 1)
    assert len(asked) == 2
    changed = pytensor.shared(1.0)
    for value in (1.0, 2.0):
        changed.set_value(value)
        rules._drawn([pm.Normal.dist(0.0, changed)], 10, 1)
    assert len(asked) == 4
