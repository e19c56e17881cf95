"""Integrals over known tubes as constant matrices (`mechanics/collocation.py`), and their nodes."""

import numpy as np
import pytensor
import pytensor.tensor as pt
import pytest
from problems import AS_WRITTEN
from pytensor.graph.replace import vectorize_graph
from pytensor.graph.traversal import ancestors
from pytensor.tensor.blockwise import Blockwise

import pymc_hyperelastic as ph
from pymc_hyperelastic.mechanics import collocation, interpolation
from pymc_hyperelastic.mechanics.integrals import AxialForceIntegral
from pymc_hyperelastic.mechanics.interpolation import KnownTubes, groups_by
from pymc_hyperelastic.mechanics.selected_nodes import SelectedNodes

# Coefficients of the response below 1e-14 of the largest are omitted.
CURVE_TOLERANCE, SLOPE_TOLERANCE = 1e-11, 1e-9
# Rounding error between two formulas for the same number.
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


def by_quadrature(energy, tubes, entries):
    """Return pressure, stiffness, force and its slope by quadrature, and the measured slope."""
    inputs = [pt.as_tensor_variable(np.asarray(x)) for x in (*tubes[:5], *entries)]
    integrals = ph.PressureIntegral, AxialForceIntegral
    outputs = [output for kind in integrals for output in kind(strain_energy=energy)(*inputs)]
    pressure, stiffness, force, slope = pytensor.function([], outputs, mode=AS_WRITTEN)()
    names = ("pressure", "stiffness", "slope", "force", "force_slope")
    values = pressure, stiffness, stiffness * tubes.growth, force, slope
    return dict(zip(names, values, strict=True))


def collocated(op, matrices, *entries):
    """Apply an integral to the matrices of its outputs."""
    constants = (matrices["log_hoop"], matrices["log_axial"], *matrices["of_outputs"])
    return op(*(pt.as_tensor_variable(x) for x in constants), *entries, return_list=True)


def assert_curves_are_exact(basis, groups, energy, tubes, tolerance=CURVE_TOLERANCE):
    """Compare curves of all points by constant matrices with those by quadrature."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(collocation, "PIECE", 60)  # points are taken in parts
        matrices, place = collocation.curve_matrices(tubes, groups, basis)
    expected = by_quadrature(energy, tubes, MATERIALS[energy])
    for force, names in ((False, ("pressure", "stiffness")), (True, ("force", "force_slope"))):
        own = matrices | {"of_outputs": [matrices[f"{name}_matrix"] for name in names]}
        op = collocation.CollocatedIntegral(strain_energy=energy, force=force)
        for name, output in zip(names, collocated(op, own, *MATERIALS[energy]), strict=True):
            found = output.eval(mode=AS_WRITTEN).ravel()[place]
            loss = 1 if name in ("pressure", "force") else SLOPE_TOLERANCE / CURVE_TOLERANCE
            scale = np.abs(expected[name]).max()
            assert np.abs(found - expected[name]).max() <= loss * tolerance * scale, name


def test_curves_by_chebyshev_nodes_equal_quadrature():
    tubes = tubes_of().at(np.arange(12))
    groups = groups_by(tubes, tubes.axial_stretch)
    assert [list(g.points) for g in groups] == [[*range(7)], [*range(7, 12)]]
    entries = [np.array([x]) for x in MATERIALS[OGDEN]]
    needed = interpolation.nodes_needed(OGDEN, tubes, groups, entries, with_force=True)
    assert 8 < needed < 40
    assert_curves_are_exact(interpolation.ChebyshevNodes(needed), groups, OGDEN, tubes)
    with pytest.raises(AssertionError, match="pressure"):
        fewer = interpolation.ChebyshevNodes(needed - 6)
        assert_curves_are_exact(fewer, groups, OGDEN, tubes, tolerance=1e-12)
    # Fibres that slacken within a wall need too many nodes.
    entries = [np.array([x]) for x in MATERIALS[HGO]]
    assert interpolation.nodes_needed(HGO, tubes, groups, entries) is None


class Polynomial:
    """A law whose response is a polynomial of degree 3 in ``ln λθ``."""

    entry_names = ("mu",)

    def join(self, entries):
        return {"mu": entries[0]}

    def stress_difference(self, log_hoop, log_axial, *, mu):
        return mu * (log_hoop**3 + log_axial)


def test_polynomial_response_needs_one_node_more_than_its_degree():
    tubes = tubes_of()
    groups, entries = groups_by(tubes, tubes.axial_stretch), [np.array([2.0])]
    assert interpolation.nodes_needed(Polynomial(), tubes, groups, entries, tolerance=1e-12) == 4


def test_evenly_spaced_indices_include_both_ends():
    assert list(interpolation.evenly(9, 3)) == [0, 4, 8] and len(interpolation.evenly(3, 60)) == 3


def test_compressed_matrices_give_the_squared_misfit_of_all_points():
    """``|M g − y|² = |R g − c|² + ρ²`` for each kind of measurement, with missing values."""
    tubes = tubes_of(points=40)
    groups = groups_by(tubes, tubes.axial_stretch)
    rng = np.random.default_rng(SEED)
    targets = {name: rng.normal(20, 9, 80) for name in ("pressure", "slope", "force")}
    targets["slope"][[3, 50]] = np.nan
    entries = [np.array([3.0, 9.0]), np.array([5.0, 9.0])]
    needed = interpolation.nodes_needed(OGDEN, tubes, groups, entries)
    basis = interpolation.ChebyshevNodes(needed)
    curves, _ = collocation.curve_matrices(tubes, groups, basis)
    compressed = collocation.collocate(tubes, groups, curves, targets)
    for entries in ((3.0, 5.0), (7.0, 8.0)):
        exact = by_quadrature(OGDEN, tubes, entries)
        for name, target in targets.items():
            op = collocation.CollocatedIntegral(strain_energy=OGDEN, force=name == "force")
            matrix = compressed[f"{name}_matrix"]
            assert matrix.shape[1] == needed
            own = compressed | {"of_outputs": [matrix]}
            found = collocated(op, own, *entries)[0].eval(mode=AS_WRITTEN)
            misfit = np.sum((found - compressed[f"{name}_target"]) ** 2)
            misfit += compressed[f"{name}_residual"]
            np.testing.assert_allclose(misfit, np.nansum((exact[name] - target) ** 2), rtol=1e-9)


@pytest.mark.parametrize("per_group", [False, True])
def test_collocated_curves_have_exact_gradients_and_batches_without_a_loop(per_group):
    """Gradients equal difference quotients; a vectorised batch equals single evaluations."""
    tubes = tubes_of()
    groups = groups_by(tubes, tubes.axial_stretch)
    matrices, _ = collocation.curve_matrices(tubes, groups, interpolation.ChebyshevNodes(20))
    matrices |= {"of_outputs": [matrices["pressure_matrix"], matrices["stiffness_matrix"]]}
    kind, of_batch = (pt.dvector, pt.dmatrix) if per_group else (pt.dscalar, pt.dvector)
    parameters, symbols = [kind(), kind()], [of_batch(), of_batch()]
    op = collocation.CollocatedIntegral(strain_energy=OGDEN, force=False)
    entries = [x[:, None] for x in parameters] if per_group else parameters
    pressure, stiffness = collocated(op, matrices, *entries)
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
    loops = [node for node in nodes if isinstance(node, Blockwise) and node.name != "Matmul"]
    assert not loops
    together = pytensor.function(symbols, vectorised, mode=AS_WRITTEN)(*batch)
    rows = zip(*(single(*row) for row in zip(*batch, strict=True)), strict=True)
    for found, expected in zip(together, rows, strict=True):
        np.testing.assert_allclose(found, np.stack(expected), rtol=ROUNDING)


def draw_materials(count=150):
    """Return a function that draws materials of fibres, other ones at each call."""
    rng = np.random.default_rng(SEED)
    ends = [(1.0, 10.0), (0.5, 5.0), (0.1, 2.0), (20.0, 45.0)]
    return lambda: [rng.uniform(*of_entry, count) for of_entry in ends]


@pytest.mark.parametrize("one_by_one", [True, False], ids=["single moduli", "materials"])
def test_curves_and_slopes_by_selected_nodes_equal_quadrature(one_by_one):
    """The nodes are few, although both stretches vary; other materials are exact too."""
    tubes = tubes_of(stretches=(1.3, 1.5, 1.7))
    tubes = tubes.at(np.flatnonzero(tubes.log_hoop[1] > 0))  # fibres are taut
    groups = groups_by(tubes, np.zeros(len(tubes.radius)))
    empty = SelectedNodes(HGO, one_by_one, tolerance=3e-12, with_force=True)
    basis = empty.with_materials(tubes, draw_materials()())
    assert len(basis.interpolation(tubes, groups[0]).places[0]) < 150
    assert_curves_are_exact(basis, groups, HGO, tubes, tolerance=1e-9)


def test_nodes_added_for_other_materials_make_their_curves_exact():
    """Curves of stiffer fibres, with two more of the materials, become exact."""
    tubes = tubes_of(stretches=(1.3, 1.5))
    tubes = tubes.at(np.flatnonzero(tubes.log_hoop[1] > 0))
    groups = groups_by(tubes, np.zeros(len(tubes.radius)))
    some = [values[:3] for values in draw_materials()()]
    basis = SelectedNodes(HGO, True, tolerance=3e-12, with_force=True)
    basis = basis.with_materials(tubes, some)
    with pytest.raises(AssertionError, match="pressure"):
        assert_curves_are_exact(basis, groups, HGO, tubes, tolerance=1e-9)
    own = [np.array([x, 1.01 * x]) for x in MATERIALS[HGO]]
    basis = basis.with_materials(tubes, own)
    assert_curves_are_exact(basis, groups, HGO, tubes, tolerance=1e-9)


def test_quadrature_is_exact_only_if_split_where_hoop_fibres_slacken():
    """Quadrature over the whole wall has a kink at ``λθ = 1`` and is not exact."""
    energy = ph.FourFiber()
    entries = (10.0, 8.0, 0.05, 6.0, 0.1, 0.0, 0.5, 40.0)  # only hoop fibres slacken
    tubes = tubes_of(points=20, stretches=(1.2, 1.4))
    exact = by_quadrature(energy, tubes, entries)
    columns = [np.array([[x]]) for x in entries]
    errors = []
    for split in (True, False):
        rule, log_axial = tubes.quadrature(split=split)
        places = rule.log_hoop.reshape(1, -1), log_axial.reshape(1, -1)
        for name, weight in (("pressure", rule.pressure_weight), ("force", rule.force_weight)):
            function = interpolation.response_function(energy, name == "force")
            (response,) = function(*places, *columns)
            curve = (response.reshape(weight.shape) * weight).sum(axis=1)
            errors.append(np.abs(curve - exact[name]).max() / np.abs(exact[name]).max())
    assert max(errors[:2]) < CURVE_TOLERANCE < 1e-7 < max(errors[2:])
