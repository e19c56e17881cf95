"""The pressure integral: its numbers, in closed form and by adaptive quadrature."""

from itertools import product

import numpy as np
import oracles
import pytensor
import pytensor.tensor as pt
import pytest
from pressures import (
    FIBRE_LAWS,
    SLACKENING,
    compiled_response,
    has_stiffness,
    in_python,
    problems_of,
    response,
)
from problems import AS_WRITTEN, LAWS, OGDEN_1972_RUBBER, PROBLEMS, entries

import pymc_hyperelastic as ph
from pymc_hyperelastic import PressureIntegral, inflation_pressure

# What the package promises against adaptive quadrature.
PRESSURE_TOLERANCE = 1e-9
STIFFNESS_TOLERANCE = 1e-7
# At zero pressure a relative error has no meaning. There the pressure may be what a relative error
# of 1e-12 of the radius makes of it, a thousandth of what the table's A(1 + 1e-9) resolves; the
# oracle itself, differences of step 1e-15, tells pressures below 1e-25 of that scale not from 0.
ZERO_PRESSURE_RADIUS_ERROR = 1e-12
ORACLE_RESOLUTION = 1e-25
# Two formulas for one integral with the same nodes: rounding, with exponents up to 60.
IDENTITY_TOLERANCE = 1e-12
# Promised accuracy of the rule of default order: anywhere, and where measured curves lie (a >= A).
QUADRATURE_TOLERANCE = 1e-10
QUADRATURE_TOLERANCE_INFLATED = 1e-12
# At the end of their priors and the largest strains these laws have pressures of e^500 moduli.
# Their promise is for those up to a thousand, a hundred times what holds a tube in a body.
EXPONENTIAL = ("Demiray", "FungOrthotropic", *(name for name in LAWS if LAWS[name].slackens))
LARGEST_PRESSURE = 1e3
# Where the corners of the promise are not those of the prior.
CORNERS = {
    # Stress has a pole where I1 - 3, which is 10 in the widest tube, reaches the limit.
    ("Gent", "limit"): (15.0, 100.0),
    # Dispersed fibres are stretched across a wall that is compressed, by a factor of 1/0.6 here.
    ("GasserOgdenHolzapfel", "k2"): (0.0, 2.0),
}


def test_table_covers_what_is_promised():
    """At least 64 problems reach every end of the documented range, for every law."""
    zoo = {name for name in ph.strain_energy.__all__ if name in ph.list_strain_energies()}
    assert zoo == {law.strain_energy.name for law in LAWS.values()}
    assert len(PROBLEMS) >= 64
    assert len({problem.name for problem in PROBLEMS}) == len(PROBLEMS)
    for law in LAWS:
        table = problems_of(law)
        growth = {p.internal_radius / p.inner_radius for p in table}
        assert {1.0, 1 + 1e-9, 1 - 1e-9, 1.7} <= {round(g, 12) for g in growth}
        assert min(growth) <= 0.6
        assert {0.8, 1.0, 1.9} <= {p.axial_stretch for p in table}
        assert {0.0, 160.0} <= {p.opening_angle for p in table}
        assert {1.05, 2.5} <= {round(p.outer_radius / p.inner_radius, 12) for p in table}
    special = {0.0, 1e-12, -1e-12, 25.0, -25.0}
    assert special <= {p.parameters["alpha"] for p in problems_of("Ogden")}
    assert special | {20.0} <= {p.parameters["b"] for p in problems_of("CriscioneType")}
    assert {0.3, 1.0, 30.0} <= {p.parameters["n"] for p in problems_of("PowerLawNeoHookean")}


@pytest.mark.parametrize("law", FIBRE_LAWS)
def test_table_has_walls_in_which_fibres_slacken(law):
    """Each fibre law has such walls; of dispersed or of four families in two places."""
    places = {
        p.name: len(oracles.slackening_radii(LAWS[law].energy, p.inputs, LAWS[law].switches))
        for p in problems_of(law)
    }
    for tube in SLACKENING:
        first = next(name for name in places if name.endswith(f", {tube}"))
        assert places[first] >= 1
    if law == "HolzapfelGasserOgden":
        assert any(n and name.endswith("slackening, stretched") for name, n in places.items())
    else:
        assert max(places.values()) == 2


# Tubes of the first tier: the ordinary material in all that a formula may stumble over, the others
# in the one that has everything a little.
EVERY_MATERIAL = "in vivo"
ORDINARY_MATERIAL = (EVERY_MATERIAL, "at rest", "just inflated", "deflated far", "slackening")


def is_first(problem):
    ordinary = problem.parameters == LAWS[problem.law].parameters[0][0]
    chosen = ORDINARY_MATERIAL if ordinary else (EVERY_MATERIAL,)
    return problem.name.endswith(tuple(f", {tube}" for tube in chosen))


CASES = [
    pytest.param(
        problem, index, id=problem.name, marks=() if is_first(problem) else pytest.mark.deep
    )
    for law in LAWS
    for index, problem in enumerate(problems_of(law))
]


@in_python
@pytest.mark.parametrize(("problem", "index"), CASES)
def test_problem_agrees_with_adaptive_quadrature(problem, index, mode):
    """Pressure and stiffness have a small relative error, also where pressure is all but zero."""
    exact_pressure, exact_stiffness = problem.exact(), problem.exact("internal_radius")
    scale = abs(exact_stiffness) * problem.inner_radius
    # Where all fibres slacken the oracle's difference errs by its step, and not by the square.
    at_zero = abs(exact_pressure) <= ORACLE_RESOLUTION * scale or not has_stiffness(problem)
    allowed = (
        ZERO_PRESSURE_RADIUS_ERROR * scale if at_zero else PRESSURE_TOLERANCE * abs(exact_pressure)
    )
    values = response(problem.law, mode)
    assert abs(values.pressure[index] - exact_pressure) <= allowed
    if has_stiffness(problem):
        assert abs(values.stiffness[index] - exact_stiffness) <= STIFFNESS_TOLERANCE * abs(
            exact_stiffness
        )


@in_python
def test_tube_at_rest_carries_exactly_no_pressure(mode):
    """At a = A, without axial stretch or cut, the pressure is 0 and not merely small."""
    for law in LAWS:
        at_rest = [problem.name.endswith("at rest") for problem in problems_of(law)]
        assert sum(at_rest) == 1
        assert (response(law, mode).pressure[at_rest] == 0).all()


@in_python
def test_neo_hookean_tube_has_its_closed_form(mode):
    """With n = 1 the pressure is the textbook's, with axial stretch and opening angle too."""
    table = problems_of("PowerLawNeoHookean")
    chosen = [i for i, problem in enumerate(table) if problem.parameters["n"] == 1]
    assert len(chosen) > 4
    exact = [
        oracles.neo_hookean_pressure(table[i].parameters["mu"], *list(table[i].inputs.values())[:5])
        for i in chosen
    ]
    np.testing.assert_allclose(
        response("PowerLawNeoHookean", mode).pressure[chosen],
        exact,
        rtol=PRESSURE_TOLERANCE,
        atol=0,
    )
    exact = [
        oracles.neo_hookean_pressure(p.parameters["mu"], *list(p.inputs.values())[:5])
        for p in problems_of("NeoHookean")
    ]
    rounding = ZERO_PRESSURE_RADIUS_ERROR * np.abs(response("NeoHookean", mode).stiffness)
    difference = np.abs(response("NeoHookean", mode).pressure - exact)
    assert (difference <= PRESSURE_TOLERANCE * np.abs(exact) + rounding).all()


def test_ogdens_rubber_agrees_with_the_stretch_integral():
    """The three-term law of 1972 obeys the textbook's other integral."""
    radius = np.array([1.01, 1.2, 1.7, 2.5])
    rubber = LAWS["OgdenSeries(terms=3)"]

    def energy(*stretches):
        return rubber.energy(*stretches, **entries(OGDEN_1972_RUBBER))

    for outer, axial in ((1.5, 1.0), (2.5, 1.0), (2.0, 1.3)):
        pressure = inflation_pressure(
            ph.OgdenSeries(),
            radius,
            inner_radius=1.0,
            outer_radius=outer,
            axial_stretch=axial,
            **OGDEN_1972_RUBBER,
        )
        exact = [oracles.pressure_by_stretch_integral(energy, a, 1.0, outer, axial) for a in radius]
        np.testing.assert_allclose(
            pressure.eval(mode=AS_WRITTEN), exact, rtol=PRESSURE_TOLERANCE, atol=0
        )


ONE_MATERIAL = {
    "the neo-Hookean solid, by the second invariant's modulus": (
        (ph.MooneyRivlin(), {"c10": 10.0, "c01": 0.0}),
        (ph.NeoHookean(), {"mu": 20.0}),
    ),
    "the neo-Hookean solid, by the exponent of the power law": (
        (ph.PowerLawNeoHookean(), {"mu": 20.0, "n": 1.0}),
        (ph.NeoHookean(), {"mu": 20.0}),
    ),
    "the neo-Hookean solid, by the exponent of the exponential": (
        (ph.Demiray(), {"mu": 20.0, "b": 0.0}),
        (ph.NeoHookean(), {"mu": 20.0}),
    ),
    "the neo-Hookean solid, by the first coefficient": (
        (ph.Yeoh(), {"c1": 10.0, "c2": 0.0, "c3": 0.0}),
        (ph.NeoHookean(), {"mu": 20.0}),
    ),
    "the neo-Hookean solid, by fibres along the tube": (
        (ph.HolzapfelGasserOgden(), {"c": 20.0, "k1": 5.0, "k2": 1.0, "beta": 90.0}),
        (ph.NeoHookean(), {"mu": 20.0}),
    ),
    "the Mooney-Rivlin solid": (
        (ph.OgdenSeries(2), {"mu": [20.0, -3.0], "alpha": [2.0, -2.0]}),
        (ph.MooneyRivlin(), {"c10": 10.0, "c01": 1.5}),
    ),
    "Ogden's two powers": (
        (ph.OgdenSeries(2), {"mu": [1.5, -1.5], "alpha": [8.0, -8.0]}),
        (ph.Ogden(), {"mu": 6.0, "alpha": 8.0}),
    ),
    "aligned fibres": (
        (
            ph.GasserOgdenHolzapfel(),
            {"c": 3.0, "k1": 4.0, "k2": 0.5, "kappa": 0.0, "beta": 29.0},
        ),
        (ph.HolzapfelGasserOgden(), {"c": 3.0, "k1": 4.0, "k2": 0.5, "beta": 29.0}),
    ),
    "two families of four": (
        (
            ph.FourFiber(),
            {
                "c": 3.0,
                "k1_axial": 7.0,  # inflation does not feel it
                "k2_axial": 0.5,
                "k1_hoop": 0.0,
                "k2_hoop": 0.5,
                "k1_diagonal": 4.0,
                "k2_diagonal": 0.5,
                "beta": 29.0,
            },
        ),
        (ph.HolzapfelGasserOgden(), {"c": 3.0, "k1": 4.0, "k2": 0.5, "beta": 29.0}),
    ),
}


@pytest.mark.parametrize("pair", ONE_MATERIAL.values(), ids=ONE_MATERIAL)
def test_laws_contain_one_another(pair):
    """A law whose parameters make it another is inflated by the same pressures."""
    tubes = [p.inputs for p in problems_of("NeoHookean") if not p.name.endswith("at rest")]
    geometry = {name: np.array([tube[name] for tube in tubes]) for name in oracles.GEOMETRY}
    radius = geometry.pop("internal_radius")
    (one, parameters), (other, others) = pair
    value = inflation_pressure(one, radius, **geometry, **parameters).eval(mode=AS_WRITTEN)
    expected = inflation_pressure(other, radius, **geometry, **others).eval(mode=AS_WRITTEN)
    np.testing.assert_allclose(value, expected, rtol=IDENTITY_TOLERANCE, atol=0)


@in_python
def test_ogden_and_criscione_type_are_one_pressure_model(mode):
    """``b = α/2`` and ``a = (8μ/α²) cosh(½ α ln λz)`` give the same pressures and stiffnesses."""
    tubes = problems_of("Ogden")
    tubes = [problem for problem in tubes if abs(problem.parameters["alpha"]) > 1]
    inputs = {name: np.array([p.inputs[name] for p in tubes]) for name in tubes[0].inputs}
    mu, alpha = inputs["mu"], inputs["alpha"]
    mapped = {
        **inputs,
        "a": 8 * mu / alpha**2 * np.cosh(alpha / 2 * np.log(inputs["axial_stretch"])),
        "b": alpha / 2,
    }
    values = compiled_response("CriscioneType", mode)(
        *(mapped[name] for name in (*oracles.GEOMETRY, "a", "b")), 1.0, 0.0
    )
    chosen = [abs(p.parameters["alpha"]) > 1 for p in problems_of("Ogden")]
    ogden = response("Ogden", mode)
    np.testing.assert_allclose(values[0], ogden.pressure[chosen], rtol=IDENTITY_TOLERANCE, atol=0)
    np.testing.assert_allclose(values[1], ogden.stiffness[chosen], rtol=IDENTITY_TOLERANCE, atol=0)


@pytest.mark.parametrize("law", LAWS)
def test_default_order_suffices_over_the_documented_range(law):
    """At every corner of the documented range the rule of order 32 says what one of 200 says.

    The errors are relative to the pressure and to the stiffness themselves, which is more than to
    the integral of the modulus; the corners are those of the geometry and of the default priors, as
    far as pressures of exponential laws are such as a tube may have.
    """
    energy = LAWS[law].strain_energy
    inputs = pt.dvectors(5 + len(LAWS[law].entry_names))
    function = pytensor.function(
        inputs,
        [
            *PressureIntegral(strain_energy=energy)(*inputs),
            *PressureIntegral(strain_energy=energy, order=200)(*inputs),
        ],
        mode=AS_WRITTEN,
    )
    geometry = [
        (0.6, 0.8, 1.0, 1.3, 1.7),
        (1.0,),
        (1.05, 2.5),
        (0.8, 1.0, 1.9),
        (0.0, np.deg2rad(160)),
    ]
    # A modulus is a factor; from 0 to 1 it is all the same.
    priors = []
    for p in energy.parameters:
        ends = (1.0,) if p.unit == "kPa" else CORNERS.get((energy.name, p.name), p.prior_range)
        priors += [ends] * (p.size or 1)
    corners = np.array(list(product(*geometry, *priors))).T
    if law in EXPONENTIAL:
        with np.errstate(over="ignore", invalid="ignore"):
            better_pressure = function(*corners)[2]
        corners = corners[:, np.abs(better_pressure) <= LARGEST_PRESSURE]
    assert set(corners[0]) == set(geometry[0])
    pressure, stiffness, better_pressure, better_stiffness = function(*corners)
    allowed = np.where(corners[0] >= 1, QUADRATURE_TOLERANCE_INFLATED, QUADRATURE_TOLERANCE)
    assert (abs(pressure - better_pressure) <= allowed * abs(better_pressure)).all()
    assert (abs(stiffness - better_stiffness) <= allowed * abs(better_stiffness)).all()


def test_an_op_is_built_once_and_as_it_is_asked_for():
    """Inputs of the same types share one Op, unless it was given other settings."""
    tube = (8.0, 7.0, 9.0, 1.0, 0.0, 10.0)

    def built(**settings):
        pressure, _ = PressureIntegral(strain_energy=ph.NeoHookean(), **settings)(*tube)
        return pressure.owner.op

    assert built() is built()
    assert built(order=12).order == 12
    named = built(name="artery", inline=False)
    assert named.name == "artery" and not named.is_inline
    assert built().is_inline
