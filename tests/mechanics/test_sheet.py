"""Stresses of flat sheets, and the free lateral stretch of uniaxial tests."""

import mpmath as mp
import numpy as np
import oracles
import pytensor
import pytensor.tensor as pt
import pytest
from problems import AS_WRITTEN, LAWS, entries
from pytensor.gradient import verify_grad
from tiers import deep

import pymc_hyperelastic as ph

# Two formulas for one stress, in double precision.
ROUNDING = 1e-12
# Central differences of the energy in a hundred digits are exact; the rest is rounding of the
# package, and of exponents up to 60.
DIFFERENCE_TOLERANCE = 1e-8
# Newton's method ends with a step below this, relative to the stretch.
STRETCH_TOLERANCE = 1e-8

FIBRES = {"c": 10.0, "k1": 20.0, "k2": 1.0, "beta": 30.0}
# Stretches (x, y) of the usual tests; None stands for a free direction.
TESTS = {
    "uniaxial along x": (1.25, None),
    "uniaxial along y": (None, 1.25),
    "compressed along x": (0.85, None),
    "equibiaxial": (1.2, 1.2),
    "pure shear": (1.3, 1.0),
    "planar biaxial": (1.2, 1.1),
}
# Derivatives of the energy by the stretch of one, in stresses of an isotropic solid.
PRINCIPAL_TERMS = {
    "NeoHookean": (ph.NeoHookean(), {"mu": 30.0}, lambda s: 30.0 * s**2),
    "Ogden": (
        ph.Ogden(),
        {"mu": 5.0, "alpha": 3.5},
        lambda s: 2 * 5.0 / 3.5 * (s**3.5 - s**-3.5),
    ),
    "OgdenSeries": (
        ph.OgdenSeries(2),
        {"mu": (6.0, 0.5), "alpha": (1.3, 5.0)},
        lambda s: 6.0 * s**1.3 + 0.5 * s**5.0,
    ),
    # c01 (I2 - 3) is c01 (sum 1/s^2 - 3) in an incompressible solid.
    "MooneyRivlin": (ph.MooneyRivlin(), {"c10": 9.0, "c01": 2.0}, lambda s: 18 * s**2 - 4 / s**2),
}


def evaluate(*outputs):
    """Evaluate outputs without simplifying them."""
    return pytensor.function([], list(outputs), mode=AS_WRITTEN)()


@pytest.mark.parametrize("law", PRINCIPAL_TERMS)
@pytest.mark.parametrize("test", TESTS)
def test_stress_of_an_isotropic_sheet_equals_the_closed_form(law, test):
    """``σx = λx W1(λx) − λz W1(λz)`` with the stretch ``λz = 1/(λx λy)`` of the thickness."""
    energy, parameters, term = PRINCIPAL_TERMS[law]
    x, y = (1 / np.sqrt(s) if t is None else t for s, t in zip(TESTS[test][::-1], TESTS[test]))
    expected = term(x) - term(1 / (x * y)), term(y) - term(1 / (x * y))
    expected = [0.0 if t is None else e for t, e in zip(TESTS[test], expected, strict=True)]
    found = evaluate(*ph.sheet_stress(energy, *TESTS[test], **parameters))
    np.testing.assert_allclose(found, expected, rtol=ROUNDING, atol=0)
    nominal = evaluate(*ph.sheet_stress(energy, *TESTS[test], nominal=True, **parameters))
    np.testing.assert_allclose(nominal, np.divide(expected, [x, y]), rtol=ROUNDING, atol=0)


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("test", TESTS)
def test_stress_equals_the_derivative_of_the_energy(law, test):
    """Differentiate the energy of each law, as its source prints it, in a hundred digits."""
    parameters, _ = LAWS[law].parameters[0]
    exact = {name: mp.mpf(value) for name, value in entries(parameters).items()}
    energy, (given_x, given_y) = LAWS[law].energy, TESTS[test]
    with mp.workdps(oracles.DIGITS):
        responses = oracles.hoop_response, oracles.axial_response
        if given_y is None:
            x = mp.mpf(given_x)
            y = _root(lambda y: responses[1](energy, x, y, exact), given_x)
        elif given_x is None:
            y = mp.mpf(given_y)
            x = _root(lambda x: responses[0](energy, x, y, exact), given_y)
        else:
            x, y = mp.mpf(given_x), mp.mpf(given_y)
        nominal = [float(response(energy, x, y, exact)) for response in responses]
    found = evaluate(
        *ph.sheet_stress(LAWS[law].strain_energy, given_x, given_y, nominal=True, **parameters)
    )
    # The Criscione-type energy has no uniaxial stress: its only strain then stays 0.
    scale = max(*map(abs, nominal), 1e-6)
    np.testing.assert_allclose(found, nominal, rtol=0, atol=DIFFERENCE_TOLERANCE * scale)


def _root(stress, stretch):
    """Lateral stretch without stress, by bisection around that of an isotropic sheet."""
    low, high = mp.mpf(stretch) ** -0.5 / 1.4, mp.mpf(stretch) ** -0.5 * 1.4
    assert stress(low) < 0 < stress(high)
    for _ in range(60):
        middle = (low + high) / 2
        low, high = (middle, high) if stress(middle) < 0 else (low, middle)
    return (low + high) / 2


@pytest.mark.parametrize("seed", [1, *deep([2, 3])])
def test_lateral_stress_vanishes_for_materials_of_the_default_priors(seed):
    """In 99 of 100 sheets with a free lateral stretch it is found, and the stress is then 0."""
    law, rng = ph.HolzapfelGasserOgden(), np.random.default_rng(seed)
    low, high = np.transpose([p.prior_range for p in law.parameters])
    values = low + (high - low) * rng.random((400, len(low)))
    stretch = rng.uniform(0.8, 1.3, 400)
    parameters = dict(zip(law.parameter_names, values.T, strict=True))
    with np.errstate(over="ignore", invalid="ignore"):
        lateral = evaluate(ph.free_stretch(law, stretch, **parameters))[0]
        # Beyond these stretches a sheet of these materials is a thread, or a curtain.
        ends = [evaluate(ph.sheet_stress(law, stretch, s, **parameters).y)[0] for s in (0.1, 10)]
        found = np.isfinite(lateral)
        own = {name: value[found] for name, value in parameters.items()}
        nearby = [(1 + sign * STRETCH_TOLERANCE) * lateral[found] for sign in (-1, 1)]
        below, above = (
            evaluate(ph.sheet_stress(law, stretch[found], s, **own).y)[0] for s in nearby
        )
    exists = (ends[0] < 0) & (ends[1] > 0)
    assert exists.mean() > 0.9
    assert (found & exists).sum() > 0.99 * exists.sum()
    assert ((below < 0) & (above > 0)).all()


def test_sheet_pulled_along_y_is_the_sheet_pulled_along_x_turned_by_a_right_angle():
    """Fibres are measured from the x axis."""
    law, turned = ph.HolzapfelGasserOgden(), FIBRES | {"beta": 60.0}
    along_x = evaluate(ph.free_stretch(law, 1.3, **FIBRES), ph.sheet_stress(law, 1.3, **FIBRES).x)
    along_y = evaluate(
        ph.free_stretch(law, 1.3, along="y", **turned), ph.sheet_stress(law, None, 1.3, **turned).y
    )
    np.testing.assert_allclose(along_x, along_y, rtol=ROUNDING)


def test_material_that_no_lateral_stretch_relieves_has_no_stress():
    """``a4² > a1 a2``: the energy is not convex, and pulling along x pushes y at every stretch."""
    parameters = {"c": 50.0, "a1": 5.0, "a2": 1.2, "a4": 3.2}
    law = ph.FungOrthotropic()
    stress, lateral = evaluate(
        ph.sheet_stress(law, [1.05, 1.6], **parameters).x,
        ph.free_stretch(law, [1.05, 1.6], **parameters),
    )
    np.testing.assert_array_equal(np.isnan(stress), [False, True])
    np.testing.assert_array_equal(np.isnan(lateral), [False, True])


@pytest.mark.parametrize("along", ["x", "y"])
def test_gradient_through_the_free_stretch_is_that_of_the_solution(along):
    """By the stretch and by all parameters, for two sheets at once."""
    law = ph.HolzapfelGasserOgden()

    def stress(stretch, *values):
        parameters = dict(zip(FIBRES, values, strict=True))
        both = (stretch, None) if along == "x" else (None, stretch)
        return getattr(ph.sheet_stress(law, *both, **parameters), along)

    point = [np.array([1.1, 1.3]), *(np.array([v, 0.9 * v]) for v in FIBRES.values())]
    verify_grad(stress, point, rng=np.random.default_rng(1), mode=AS_WRITTEN)


@pytest.mark.parametrize("mode", deep(["NUMBA", "CVM", "JAX"]))
def test_backends_agree_on_stress_and_gradient(mode):
    """Numba, C and JAX give the values of the graph as it is written."""
    if mode == "JAX":
        pytest.importorskip("jax")
    law, stretch, values = ph.HolzapfelGasserOgden(), pt.dvector(), pt.dscalars(4)
    parameters = dict(zip(FIBRES, values, strict=True))
    uniaxial = ph.sheet_stress(law, stretch, **parameters).x
    biaxial = ph.sheet_stress(law, stretch, 1.1, nominal=True, **parameters).y
    gradient = pytensor.grad((uniaxial + biaxial).sum(), [stretch, *values])
    outputs = [uniaxial, biaxial, *gradient]
    point = [np.array([0.9, 1.1, 1.3]), *FIBRES.values()]
    expected = pytensor.function([stretch, *values], outputs, mode=AS_WRITTEN)(*point)
    found = pytensor.function([stretch, *values], outputs, mode=mode)(*point)
    for own, other in zip(found, expected, strict=True):
        np.testing.assert_allclose(own, other, rtol=1e-10)


@pytest.mark.parametrize(
    ("arguments", "error", "message"),
    [
        ((ph.Ogden, 1.2), TypeError, "call the class"),
        ((ph.NeoHookean(), None), TypeError, "both stretches are None"),
        ((ph.NeoHookean(), [1.2, -0.1]), ValueError, "stretch_x must be positive"),
        ((ph.NeoHookean(), 1.2, "fast"), TypeError, "stretch_y is 'fast'"),
    ],
)
def test_impossible_sheets_are_refused(arguments, error, message):
    with pytest.raises(error, match=message):
        ph.sheet_stress(*arguments, mu=1.0)


def test_unknown_axis_and_missing_parameter_are_refused():
    with pytest.raises(ValueError, match="along is 'z'; expected 'x' or 'y'"):
        ph.free_stretch(ph.NeoHookean(), 1.2, along="z", mu=1.0)
    with pytest.raises(TypeError, match=r"NeoHookean has the parameters \['mu'\]"):
        ph.sheet_stress(ph.NeoHookean(), 1.2)
