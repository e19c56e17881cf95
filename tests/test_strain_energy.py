"""The zoo of strain energies, and what the base class gives to an energy that a user writes."""

from functools import cache

import mpmath as mp
import numpy as np
import oracles
import pytensor
import pytensor.tensor as pt
import pytest
from problems import LAWS

import pymc_hyperelastic as ph

# These graphs are evaluated once; what counts is the time to compile them.
FAST = "FAST_COMPILE"

# Some twenty operations in double precision, and an exponent of 25 times 2 ln(1.9), about 32,
# through which the rounding of its argument enters multiplied.
CLOSED_FORM_TOLERANCE = 1e-13
# An energy is a difference from its value at rest: rounding is relative to its stiffest term, which
# is of the size of the modulus times e^(alpha strain), and the strains below are 0.1 and more.
ENERGY_TOLERANCE = 1e-12
# The gradient of an energy is a difference of two derivatives, which nearly cancel at small strain.
DEFAULT_TOLERANCE = 1e-11
# Tubes of the energies that only these tests know: see tests/test_pressure.py.
PRESSURE_TOLERANCE = 1e-9
STIFFNESS_TOLERANCE = 1e-7

HOOP = np.array([0.6, 0.8, 1.15, 1.4, 1.9, 1.0, 1.1])
AXIAL = np.array([1.0, 1.3, 1.0, 1.5, 0.8, 1.9, 1.0])


def exact(function, *arrays):
    """Evaluate a function of hundred-digit numbers for each entry of some arrays."""
    with mp.workdps(oracles.DIGITS):
        return np.array([float(function(*map(mp.mpf, row))) for row in zip(*arrays, strict=True)])


@cache
def compiled_material(name):
    """Energy and the two stress differences of a law: (hoop, axial, parameters) -> 3 arrays."""
    energy = LAWS[name].strain_energy
    hoop, axial, *values = pt.dvectors(2 + len(energy.parameters))
    parameters = dict(zip(energy.parameter_names, values, strict=True))
    log_hoop, log_axial = pt.log(hoop), pt.log(axial)
    return pytensor.function(
        [hoop, axial, *values],
        [
            energy.energy(1 / (hoop * axial), hoop, axial, **parameters),
            energy.stress_difference(log_hoop, log_axial, **parameters),
            ph.StrainEnergy.stress_difference(energy, log_hoop, log_axial, **parameters),
        ],
        mode=FAST,
    )


MATERIALS = [
    pytest.param(name, parameters, id=f"{name}-{parameters}")
    for name, law in LAWS.items()
    for parameters, _ in law.parameters
]


def evaluate(name, parameters, hoop, axial):
    values = (np.full_like(hoop, value) for value in parameters.values())
    return compiled_material(name)(hoop, axial, *values)


@pytest.mark.parametrize(("name", "parameters"), MATERIALS)
def test_energy_is_the_papers(name, parameters):
    """Each law's energy is the paper's equation, with the limit at an exponent of 0."""
    energy, _, _ = evaluate(name, parameters, HOOP, AXIAL)
    expected = exact(
        lambda hoop, axial: LAWS[name].energy(
            1 / (hoop * axial), hoop, axial, **{k: mp.mpf(v) for k, v in parameters.items()}
        ),
        HOOP,
        AXIAL,
    )
    np.testing.assert_allclose(energy, expected, rtol=ENERGY_TOLERANCE, atol=0)


@pytest.mark.parametrize(("name", "parameters"), MATERIALS)
def test_stress_difference_is_the_derivative_of_the_energy(name, parameters):
    """The closed form is ``∂Ŵ/∂ln λθ`` of the same energy, and so is the base class's default."""
    _, closed, default = evaluate(name, parameters, HOOP, AXIAL)
    expected = exact(
        lambda hoop, axial: (
            hoop
            * oracles.hoop_response(
                LAWS[name].energy, hoop, axial, {k: mp.mpf(v) for k, v in parameters.items()}
            )
        ),
        HOOP,
        AXIAL,
    )
    np.testing.assert_allclose(closed, expected, rtol=CLOSED_FORM_TOLERANCE, atol=0)
    np.testing.assert_allclose(default, expected, rtol=DEFAULT_TOLERANCE, atol=0)


@pytest.mark.parametrize(("name", "parameters"), MATERIALS)
def test_stress_difference_keeps_its_digits_near_zero_stress(name, parameters):
    """Where a measured curve starts, stress is relatively exact and not only absolutely."""
    hoop = np.array([1 + 1e-9, 1 - 1e-9, 1.0])
    log_hoop = np.log1p(hoop - 1)
    energy = LAWS[name].strain_energy
    symbol = pt.dvector()
    stress = energy.stress_difference(symbol, pt.zeros(1), **parameters).eval(
        {symbol: log_hoop}, mode=FAST
    )
    expected = exact(
        lambda logarithm: (
            oracles.hoop_response(
                LAWS[name].energy,
                mp.exp(logarithm),
                mp.mpf(1),
                {k: mp.mpf(v) for k, v in parameters.items()},
            )
            * mp.exp(logarithm)
        ),
        log_hoop[:2],
    )
    np.testing.assert_allclose(stress[:2], expected, rtol=CLOSED_FORM_TOLERANCE, atol=0)
    assert stress[2] == 0


@pytest.mark.parametrize(
    ("energy", "parameters", "modulus"),
    [
        (ph.PowerLawNeoHookean(), {"mu": 20.0, "n": 0.3}, 20.0),
        (ph.PowerLawNeoHookean(), {"mu": 20.0, "n": 30.0}, 20.0),
        (ph.Ogden(), {"mu": 6.0, "alpha": 0.0}, 12.0),
        (ph.Ogden(), {"mu": 6.0, "alpha": 25.0}, 12.0),
    ],
)
def test_small_strain_shear_modulus(energy, parameters, modulus):
    """In pure shear by ``e`` the stress difference is ``4 G e``: G is mu, and Ogden's is 2 mu."""
    strain = pt.dscalar()
    stress = energy.stress_difference(strain, pt.zeros(()), **parameters)
    slope = pytensor.grad(stress, strain).eval({strain: 0.0}, mode=FAST)
    np.testing.assert_allclose(slope / 4, modulus, rtol=CLOSED_FORM_TOLERANCE)


@pytest.mark.parametrize(("name", "exponent"), [("Ogden", "alpha"), ("CriscioneType", "b")])
def test_energy_is_even_in_the_exponent(name, exponent):
    """Either sign of the exponent is the same material: posteriors have two mirrored modes."""
    ordinary = LAWS[name].parameters[0][0]
    mirrored = {**ordinary, exponent: -ordinary[exponent]}
    for one, other in zip(
        evaluate(name, ordinary, HOOP, AXIAL), evaluate(name, mirrored, HOOP, AXIAL), strict=True
    ):
        np.testing.assert_array_equal(one, other)


# --- energies that a user writes -----------------------------------------------------------------


class Gent(ph.StrainEnergy):
    """Gent's rubber, whose chains reach an end: ``W = −(μ Jm/2) ln(1 − (I₁ − 3)/Jm)``.

    Source: A. N. Gent, Rubber Chem. Technol. 69 (1996) 59-61.
    """

    parameters = (
        ph.Parameter("mu", r"\mu", "kPa", (0.0, 200.0), "shear modulus"),
        ph.Parameter("limit", "J_m", "", (10.0, 100.0), "largest I₁ − 3"),
    )

    def energy(self, radial, hoop, axial, *, mu, limit):
        first = radial**2 + hoop**2 + axial**2
        return -mu * limit / 2 * pt.log1p(-(first - 3) / limit)


def gent_energy(l1, l2, l3, *, mu, limit):
    return -mu * limit / 2 * mp.log(1 - (l1**2 + l2**2 + l3**2 - 3) / limit)


class TwoFibre(ph.StrainEnergy):
    """Two symmetric fibre families in a neo-Hookean matrix: orthotropic, with a setting.

    ``W = c/2 (I₁ − 3) + k1/k2 {exp[k2 (I₄ − 1)²] − 1}``, ``I₄ = λθ² cos²β + λz² sin²β``.
    Source: Holzapfel, Gasser and Ogden, J. Elasticity 61 (2000) 1-48.
    """

    parameters = (
        ph.Parameter("c", "c", "kPa", (0.0, 100.0), "shear modulus of the matrix"),
        ph.Parameter("k1", "k_1", "kPa", (0.0, 100.0), "modulus of the fibres"),
        ph.Parameter("k2", "k_2", "", (0.01, 10.0), "stiffening of the fibres"),
    )

    def __init__(self, fibre_angle=0.7):
        self.fibre_angle = fibre_angle

    def energy(self, radial, hoop, axial, *, c, k1, k2):
        cosine, sine = np.cos(self.fibre_angle), np.sin(self.fibre_angle)
        fourth = (hoop * cosine) ** 2 + (axial * sine) ** 2
        matrix = c / 2 * (radial**2 + hoop**2 + axial**2 - 3)
        return matrix + k1 / k2 * pt.expm1(k2 * (fourth - 1) ** 2)


def two_fibre_energy(l1, l2, l3, *, c, k1, k2):
    beta = mp.mpf(TwoFibre().fibre_angle)
    fourth = l2**2 * mp.cos(beta) ** 2 + l3**2 * mp.sin(beta) ** 2
    matrix = c / 2 * (l1**2 + l2**2 + l3**2 - 3)
    return matrix + k1 / k2 * (mp.exp(k2 * (fourth - 1) ** 2) - 1)


USER_ENERGIES = {
    "isotropic": (Gent(), gent_energy, {"mu": 15.0, "limit": 60.0}),
    "orthotropic": (TwoFibre(), two_fibre_energy, {"c": 10.0, "k1": 8.0, "k2": 0.6}),
}
USER_TUBES = (  # internal, inner and outer radius (mm), axial stretch, opening angle (rad)
    (8.4, 7.0, 9.0, 1.0, 0.0),
    (5.9, 7.0, 9.0, 0.9, 0.0),
    (0.48, 0.4, 0.52, 1.4, 1.2),
)


@pytest.mark.parametrize("kind", USER_ENERGIES)
def test_an_energy_is_all_that_a_material_needs(kind):
    """Pressure, stiffness and both gradients follow from a user's ``energy`` alone, correctly."""
    energy, oracle, parameters = USER_ENERGIES[kind]
    names = [*oracles.GEOMETRY, *parameters]
    inputs = pt.dvectors(len(names))
    pressure, stiffness = ph.PressureIntegral(strain_energy=energy)(*inputs)
    value_and_gradient = pytensor.function(
        inputs,
        [
            pressure,
            stiffness,
            pt.stack(pytensor.grad(pressure.sum(), inputs)),
            pt.stack(pytensor.grad(stiffness.sum(), inputs)),
        ],
        mode=FAST,
    )
    points = [dict(zip(names, (*tube, *parameters.values()), strict=True)) for tube in USER_TUBES]
    columns = [np.array([point[name] for point in points]) for name in names]
    p, s, p_gradient, s_gradient = value_and_gradient(*columns)

    def exact(*by, tubes=slice(None)):
        return [oracles.tube_derivative(oracle, point, *by) for point in points[tubes]]

    np.testing.assert_allclose(p, exact(), rtol=PRESSURE_TOLERANCE, atol=0)
    np.testing.assert_allclose(s, exact("internal_radius"), rtol=STIFFNESS_TOLERANCE, atol=0)
    # The last tube is stretched, opened and inflated at once: no gradient vanishes there.
    last = slice(-1, None)
    for i, name in enumerate(names):
        np.testing.assert_allclose(
            p_gradient[i, last],
            exact(name, tubes=last),
            rtol=STIFFNESS_TOLERANCE,
            atol=0,
            err_msg=name,
        )
        np.testing.assert_allclose(
            s_gradient[i, last],
            exact("internal_radius", name, tubes=last),
            rtol=STIFFNESS_TOLERANCE,
            atol=0,
            err_msg=name,
        )


def test_strain_energies_are_values():
    """Two instances of a class are equal, with one hash, when their settings are."""
    assert ph.Ogden() == ph.Ogden()
    assert hash(ph.Ogden()) == hash(ph.Ogden())
    assert ph.Ogden() != ph.CriscioneType()
    assert TwoFibre() == TwoFibre(fibre_angle=0.7)
    assert hash(TwoFibre()) == hash(TwoFibre(fibre_angle=0.7))
    assert TwoFibre() != TwoFibre(fibre_angle=0.5)
    assert len({TwoFibre(), TwoFibre(0.7), TwoFibre(0.5), Gent()}) == 3


def test_strain_energies_show_what_they_are():
    """The representation is the call that makes the object; the name is what results refer to."""
    assert repr(ph.Ogden()) == "Ogden()"
    assert repr(TwoFibre(fibre_angle=0.5)) == "TwoFibre(fibre_angle=0.5)"
    assert ph.PowerLawNeoHookean().name == "PowerLawNeoHookean"
    assert ph.PowerLawNeoHookean().parameter_names == ("mu", "n")
    assert ph.Ogden().parameter_names == ("mu", "alpha")
    assert ph.CriscioneType().parameter_names == ("a", "b")


def test_strain_energies_are_found_by_name():
    """A saved result names its class: the zoo's and a user's are found, others are listed."""
    assert ph.StrainEnergy.from_name("Ogden") == ph.Ogden()
    assert ph.StrainEnergy.from_name("Gent") == Gent()
    with pytest.raises(ValueError, match=r"'Ogdon'.*'Ogden'"):
        ph.StrainEnergy.from_name("Ogdon")


@pytest.mark.parametrize("law", LAWS.values(), ids=LAWS.keys())
def test_parameters_are_documented(law):
    """Each parameter has a symbol, a unit, a meaning and a proper default prior."""
    assert law.strain_energy.__doc__
    for parameter in law.strain_energy.parameters:
        low, high = parameter.prior_range
        assert np.isfinite([low, high]).all()
        assert low < high
        assert parameter.symbol
        assert parameter.description
        assert parameter.unit in ("kPa", "")


MU = ph.Parameter("mu", r"\mu", "kPa", (0.0, 1.0), "shear modulus")


def test_misspelt_parameter_is_refused_at_the_class():
    """A class whose declared and written parameters differ never comes into being."""
    with pytest.raises(TypeError, match=r"Misspelt.*\['mu'\].*\['nu'\]"):

        class Misspelt(ph.StrainEnergy):
            parameters = (MU,)

            def energy(self, radial, hoop, axial, *, nu):
                return nu * hoop


def test_undeclared_parameter_is_refused_at_the_class():
    """An energy that takes more than is declared would have no prior for it."""
    with pytest.raises(TypeError, match=r"Undeclared.*\['mu'\].*\['mu', 'n'\]"):

        class Undeclared(ph.StrainEnergy):
            parameters = (MU,)

            def energy(self, radial, hoop, axial, *, mu, n):
                return mu * hoop**n


def test_positional_parameter_is_refused_at_the_class():
    """Parameters are keywords: positions would depend on the order of their declaration."""
    with pytest.raises(TypeError, match=r"Positional.*keyword-only arguments \[\]"):

        class Positional(ph.StrainEnergy):
            parameters = (MU,)

            def energy(self, radial, hoop, axial, mu):
                return mu * hoop


def test_refused_class_is_not_registered():
    """A class that was refused cannot be found by its name either."""
    test_misspelt_parameter_is_refused_at_the_class()
    with pytest.raises(ValueError, match="Misspelt"):
        ph.StrainEnergy.from_name("Misspelt")


def test_energy_must_be_written():
    """A material without an energy cannot be made."""

    class Nothing(ph.StrainEnergy):
        """It has no parameters and no energy."""

    with pytest.raises(TypeError, match="energy"):
        Nothing()
