"""Integrals over known tubes as constant matrices: `mechanics/collocation.py` and its nodes."""

import numpy as np
import pytensor
import pytensor.tensor as pt
import pytest
from problems import AS_WRITTEN
from pytensor.graph.replace import vectorize_graph
from pytensor.graph.traversal import ancestors
from pytensor.tensor.blockwise import Blockwise

import pymc_hyperelastic as ph
from pymc_hyperelastic.mechanics import collocation, empirical, interpolation, wall_nodes
from pymc_hyperelastic.mechanics.axial_force import AxialForceIntegral, AxialForceSlope
from pymc_hyperelastic.mechanics.known_tubes import KnownTubes

# Coefficients of the response are left out below 1e-14 of the largest.
CURVE_TOLERANCE, SLOPE_TOLERANCE = 1e-11, 1e-9
# Two formulas for one number: rounding.
ROUNDING = 1e-12
OGDEN, HGO = ph.Ogden(), ph.HolzapfelGasserOgden()
MATERIALS = {OGDEN: (6.0, 8.0), HGO: (3.0, 2.3, 0.8, 29.0)}
SEED = 20261129  # any would do


def tubes_of(points=7, stretches=(1.1, 1.5)):
    """Return inflated tubes at each axial stretch, from compressed walls to far inflated ones."""
    radius = np.tile(np.linspace(0.8, 1.5, points), len(stretches))
    full = np.ones_like(radius)
    axial = np.repeat(stretches, points)
    return KnownTubes(radius, full, 1.4 * full, axial, 0.6 * full, growth=0.7 * full)


def direct(energy, tubes, entries):
    """Return pressure, stiffness, force and its slope by quadrature, and the measured slope."""
    inputs = [pt.as_tensor_variable(np.asarray(x)) for x in (*tubes[:5], *entries)]
    outputs = [*ph.PressureIntegral(strain_energy=energy)(*inputs)]
    outputs += [op(strain_energy=energy)(*inputs) for op in (AxialForceIntegral, AxialForceSlope)]
    pressure, stiffness, force, slope = pytensor.function([], outputs, mode=AS_WRITTEN)()
    share = tubes.share
    names = ("pressure", "stiffness", "slope", "force", "force_slope")
    values = pressure, stiffness * share, stiffness * share * tubes.growth, force, slope * share
    return dict(zip(names, values, strict=True))


def collocated(op, matrices, *entries):
    """Apply an integral to the matrices of its outputs."""
    constants = (matrices["log_hoop"], matrices["log_axial"], *matrices["of_outputs"])
    return op(*(pt.as_tensor_variable(x) for x in constants), *entries, return_list=True)


def assert_curves_are_exact(basis, groups, energy, tubes, tolerance=CURVE_TOLERANCE):
    """Compare curves of all points by constant matrices with those by quadrature."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(collocation, "_CHUNK", 5)  # points are taken in parts
        matrices, place = collocation.curve_matrices(tubes, groups, basis)
    expected = direct(energy, tubes, MATERIALS[energy])
    for kind, names in (
        (collocation.CollocatedPressureIntegral, ("pressure", "stiffness")),
        (collocation.CollocatedAxialForce, ("force",)),
        (collocation.CollocatedAxialForce, ("force_slope",)),
    ):
        own = matrices | {"of_outputs": [matrices[f"{name}_matrix"] for name in names]}
        for name, output in zip(
            names, collocated(kind(strain_energy=energy), own, *MATERIALS[energy]), strict=True
        ):
            found = output.eval(mode=AS_WRITTEN).ravel()[place]
            loss = 1 if name in ("pressure", "force") else SLOPE_TOLERANCE / CURVE_TOLERANCE
            scale = np.abs(expected[name]).max()
            assert np.abs(found - expected[name]).max() <= loss * tolerance * scale, name


@pytest.mark.parametrize("varied", [False, True], ids=["groups of one stretch", "a grid"])
def test_curves_by_chebyshev_nodes_equal_quadrature(varied):
    """The walls are layers, which move 0.8 times as much as the inner surface of the whole wall."""
    tubes = tubes_of()._replace(share=np.full(14, 0.8))
    points = np.arange(len(tubes.radius))
    key = np.zeros(len(points)) if varied else tubes.axial_stretch
    groups = interpolation.groups_by(tubes, key, points, varied=varied)
    assert [list(g.points) for g in groups] == (
        [[*points]] if varied else [[*points[:7]], [*points[7:]]]
    )
    entries = [np.array([x]) for x in MATERIALS[OGDEN]]
    needed = interpolation.nodes_needed(OGDEN, groups, entries, with_force=True)
    assert needed.axial > 4 if varied else needed.axial == 1
    assert_curves_are_exact(needed, groups, OGDEN, tubes)
    settings = {"with_force": True}
    errors = interpolation.curve_errors(OGDEN, needed, tubes, groups, entries, **settings)
    assert errors.shape == (1,) and errors[0] < CURVE_TOLERANCE
    fewer = needed._replace(hoop=needed.hoop - 6)
    (error,) = interpolation.curve_errors(OGDEN, fewer, tubes, groups, entries, **settings)
    assert 1e-12 < error < 1e-5
    # Fibres that slacken within a wall need too many nodes.
    entries = [np.array([x]) for x in MATERIALS[HGO]]
    assert interpolation.nodes_needed(HGO, groups, entries) is None


class Polynomial:
    """A law whose response is a polynomial: of degree 3 in ``ln λθ``, and of 2 in ``ln λz``."""

    entry_names = ("mu",)

    def join(self, entries):
        return {"mu": entries[0]}

    def stress_difference(self, log_hoop, log_axial, *, mu):
        return mu * (log_hoop**3 + log_axial**2)


def test_a_polynomial_needs_one_node_more_than_its_degree():
    groups = [interpolation.Group(np.arange(3), (0.2, 0.3), (0.4, 0.1))]
    needed = interpolation.nodes_needed(Polynomial(), groups, [np.array([2.0])], tolerance=1e-12)
    assert needed == interpolation.Nodes(4, 3)


def test_error_of_curves_is_relative_to_the_largest_value():
    """That of a force is relative to the thrust of the pressure, if that is larger."""
    tubes, few = tubes_of(stretches=(1.0,)), interpolation.Nodes(5)
    groups = interpolation.groups_by(tubes, np.zeros(7), np.arange(7), varied=False)
    matrices, place = collocation.curve_matrices(tubes, groups, few)
    exact, errors = direct(OGDEN, tubes, MATERIALS[OGDEN]), {}
    for name, kind in (("pressure", "PressureIntegral"), ("force", "AxialForce")):
        op = getattr(collocation, f"Collocated{kind}")(strain_energy=OGDEN)
        own = matrices | {"of_outputs": [matrices[f"{name}_matrix"]] * (2 - (name == "force"))}
        found = collocated(op, own, *MATERIALS[OGDEN])[0].eval(mode=AS_WRITTEN).ravel()[place]
        errors[name] = np.abs(found - exact[name]).max()
    pressure = np.abs(exact["pressure"]).max()
    thrust = np.pi * tubes.radius.max() ** 2 * pressure
    assert np.abs(exact["force"]).max() < thrust
    of_pressure, of_force = errors["pressure"] / pressure, errors["force"] / thrust
    entries = [np.array([x]) for x in MATERIALS[OGDEN]]
    for with_force, expected in ((False, of_pressure), (True, max(of_pressure, of_force))):
        settings = {"with_force": with_force}
        (error,) = interpolation.curve_errors(OGDEN, few, tubes, groups, entries, **settings)
        np.testing.assert_allclose(error, expected, rtol=1e-6)
    assert list(interpolation.evenly(9, 3)) == [0, 4, 8] and len(interpolation.evenly(3, 60)) == 3


def test_compressed_matrices_have_the_squared_misfit_of_all_points(monkeypatch):
    """``|M g − y|² = |R g − c|² + ρ²`` for each kind of measurement, with missing values."""
    monkeypatch.setattr(collocation, "_CHUNK", 15)  # points are taken in parts
    tubes = tubes_of(points=40)
    groups = interpolation.groups_by(tubes, tubes.axial_stretch, np.arange(80), varied=False)
    rng = np.random.default_rng(SEED)
    targets = {name: rng.normal(20, 9, 80) for name in ("pressure", "slope", "force")}
    targets["slope"][[3, 50]] = np.nan
    needed = interpolation.nodes_needed(OGDEN, groups, [np.array([3.0, 9.0]), np.array([5.0, 9.0])])
    compressed = collocation.collocate(tubes, groups, needed, targets)
    for entries in ((3.0, 5.0), (7.0, 8.0)):
        exact = direct(OGDEN, tubes, entries)
        for name, target in targets.items():
            kind = "AxialForce" if name == "force" else "PressureIntegral"
            op = getattr(collocation, f"Collocated{kind}")(strain_energy=OGDEN)
            matrix = compressed[f"{name}_matrix"]
            assert matrix.shape[1] == needed.hoop
            own = compressed | {"of_outputs": [matrix] * (1 if name == "force" else 2)}
            found = collocated(op, own, *entries)[0].eval(mode=AS_WRITTEN)
            misfit = np.sum((found - compressed[f"{name}_target"]) ** 2)
            misfit += compressed[f"{name}_residual"]
            np.testing.assert_allclose(misfit, np.nansum((exact[name] - target) ** 2), rtol=1e-9)


@pytest.mark.parametrize("per_group", [False, True])
def test_gradient_and_batches_of_collocated_curves(per_group):
    """Gradients equal difference quotients; a batch of parameters equals a loop, without one."""
    tubes = tubes_of()
    groups = interpolation.groups_by(tubes, tubes.axial_stretch, np.arange(14), varied=False)
    matrices, _ = collocation.curve_matrices(tubes, groups, interpolation.Nodes(20))
    matrices |= {"of_outputs": [matrices["pressure_matrix"], matrices["stiffness_matrix"]]}
    kind, of_batch = (pt.dvector, pt.dmatrix) if per_group else (pt.dscalar, pt.dvector)
    parameters, symbols = [kind(), kind()], [of_batch(), of_batch()]
    op = collocation.CollocatedPressureIntegral(strain_energy=OGDEN, per_group=per_group)
    pressure, stiffness = collocated(op, matrices, *parameters)
    cost = (pressure**2 + stiffness**3).sum()
    outputs = [cost, *pytensor.grad(cost, parameters)]
    single = pytensor.function(parameters, outputs, mode=AS_WRITTEN)
    mu = np.array([[6.0, 7.0], [8.0, 5.0], [3.0, 9.0]] if per_group else [6.0, 8.0, 3.0])
    batch = [mu, np.full(mu.shape, 7.5)]
    first, step = [x[0] for x in batch], 1e-5
    for i, gradient in enumerate(single(*first)[1:]):
        ends = ([x * (1 + h * (i == j)) for j, x in enumerate(first)] for h in (step, -step))
        above, below = (single(*end)[0] for end in ends)
        expected = (above - below) / (2 * step)
        np.testing.assert_allclose(np.sum(gradient * first[i]), expected, rtol=1e-7)
    vectorised = vectorize_graph(outputs, dict(zip(parameters, symbols, strict=True)))
    nodes = [v.owner.op for v in ancestors(vectorised) if v.owner is not None]
    assert any(isinstance(node, collocation.CollocatedGradient) for node in nodes)
    assert not any(isinstance(node, Blockwise) for node in nodes)
    together = pytensor.function(symbols, vectorised, mode=AS_WRITTEN)(*batch)
    rows = zip(*(single(*row) for row in zip(*batch, strict=True)), strict=True)
    for found, expected in zip(together, rows, strict=True):
        np.testing.assert_allclose(found, np.stack(expected), rtol=ROUNDING)


def draw_materials(count=150):
    """Return a function that draws materials of fibres, other ones at each call."""
    rng = np.random.default_rng(SEED)
    ends = [(1.0, 10.0), (0.5, 5.0), (0.1, 2.0), (20.0, 45.0)]
    return lambda: [rng.uniform(*of_entry, count) for of_entry in ends]


def test_curves_by_empirical_nodes_equal_quadrature():
    """The nodes are few, although both stretches vary; they serve other materials, too."""
    tubes = tubes_of(stretches=(1.3, 1.5, 1.7)).divided()[0]
    groups = interpolation.groups_by(tubes, np.zeros(21), np.arange(21), varied=True)
    nodes = empirical.empirical_nodes(HGO, tubes, groups, draw_materials(), with_force=True)
    assert len(nodes.interpolation(tubes, groups[0]).places[0]) < 150
    assert_curves_are_exact(nodes, groups, HGO, tubes, tolerance=empirical.TOLERANCE)


def test_few_places_determine_the_responses_at_all():
    """Responses of other materials are the weighted sums of those at the nodes."""
    places = np.random.default_rng(SEED).uniform(0.0, 0.5, (2, 300))
    nodes, weights = empirical.fewer_nodes(HGO, tuple(places), draw_materials()(), with_force=True)
    assert len(nodes) < 60 and weights.shape == (len(nodes), 300)
    others = [x.reshape(-1, 1) for x in draw_materials(170)()]
    for force in (False, True):
        function = interpolation.response_function(HGO, force)
        (response,) = function(*(x[None] for x in places), *others)
        error = np.abs(response[:, nodes] @ weights - response).max(axis=1)
        assert (error < 1e-6 * np.abs(response).max(axis=1)).all()


def test_nodes_in_walls_are_exact_for_walls_divided_where_fibres_slacken():
    """The curves, and the matrices of the responses at the nodes, are those of quadrature."""
    energy = ph.FourFiber()
    entries = (10.0, 8.0, 0.05, 6.0, 0.1, 0.0, 0.5, 40.0)  # only hoop fibres slacken
    tubes = tubes_of(points=20, stretches=(1.2, 1.4))
    exact = direct(energy, tubes, entries)
    materials = [np.array([x]) for x in entries]
    errors = []
    for divided in (True, False):
        nodes = wall_nodes.WallNodes(24, divided)
        pressure, force = nodes.curves(energy, tubes, materials, with_force=True)
        found = {"pressure": pressure[0], "force": force[0]}
        errors.append([np.abs(found[n] - exact[n]).max() / np.abs(exact[n]).max() for n in found])
        points = np.array([4, 1, 30])
        own = nodes.interpolation(tubes, interpolation.Group(points, (0.0, 0.0), (0.0, 0.0)))
        matrices = own.matrices(tubes, points)
        for number, name in enumerate(found):
            function = interpolation.response_function(energy, bool(number))
            (response,) = function(*(x[None] for x in own.places), *(v[:, None] for v in materials))
            curve = matrices[name] @ response[0]
            np.testing.assert_allclose(curve, found[name][points], rtol=1e-10, atol=1e-12)
        assert np.isnan(matrices["slope"]).all()
    assert max(errors[0]) < CURVE_TOLERANCE < 1e-7 < max(errors[1])
