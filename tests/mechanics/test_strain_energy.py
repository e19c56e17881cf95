"""The zoo of strain energies, and what the base class gives to an energy that a user writes."""

from functools import cache

import mpmath as mp
import numpy as np
import oracles
import pytensor
import pytensor.tensor as pt
import pytest
from problems import AS_WRITTEN, LAWS, entries

import pymc_hyperelastic as ph

# Some twenty operations in double precision, and an exponent of 25 times 2 ln(1.9), about 32,
# through which the rounding of its argument enters multiplied.
CLOSED_FORM_TOLERANCE = 1e-13
# An energy is a difference from its value at rest: rounding is relative to its stiffest term, which
# is of the size of the modulus times e^(alpha strain), and the strains below are 0.1 and more.
ENERGY_TOLERANCE = 1e-12
# The gradient of an energy is a difference of two derivatives, which nearly cancel at small strain.
DEFAULT_TOLERANCE = 1e-11
# Tubes of the energies that only these tests know: see tests/mechanics/test_pressure.py.
PRESSURE_TOLERANCE = 1e-9
STIFFNESS_TOLERANCE = 1e-7
# Over twice this step in ln(hoop stretch) a smooth slope changes by far less than by this part.
KINK_STEP = 1e-6
KINK_JUMP = 1e-2

HOOP = np.array([0.6, 0.8, 1.15, 1.4, 1.9, 1.0, 1.1])
AXIAL = np.array([1.0, 1.3, 1.0, 1.5, 0.8, 1.9, 1.0])


def exact(function, *arrays):
    """Evaluate a function of hundred-digit numbers for each entry of some arrays."""
    with mp.workdps(oracles.DIGITS):
        return np.array([float(function(*map(mp.mpf, row))) for row in zip(*arrays, strict=True)])


@cache
def compiled_material(name):
    """Energy of a law, its two stress differences, and both by default, of arrays.

    The arguments are hoop and axial stretch and the entries of the parameters.
    """
    energy = LAWS[name].strain_energy
    hoop, axial, *values = pt.dvectors(2 + len(LAWS[name].entry_names))
    parameters = energy.join(values)
    log_hoop, log_axial = pt.log(hoop), pt.log(axial)
    return pytensor.function(
        [hoop, axial, *values],
        [
            energy.energy(1 / (hoop * axial), hoop, axial, **parameters),
            energy.stress_difference(log_hoop, log_axial, **parameters),
            energy.axial_stress_difference(log_hoop, log_axial, **parameters),
            ph.StrainEnergy.stress_difference(energy, log_hoop, log_axial, **parameters),
            ph.StrainEnergy.axial_stress_difference(energy, log_hoop, log_axial, **parameters),
        ],
        mode=AS_WRITTEN,
    )


MATERIALS = [
    pytest.param(name, parameters, id=f"{name}-{parameters}")
    for name, law in LAWS.items()
    for parameters, _ in law.parameters
]


def evaluate(name, parameters, hoop, axial):
    values = (np.full_like(hoop, value) for value in entries(parameters).values())
    return compiled_material(name)(hoop, axial, *values)


def exactly(parameters):
    return {name: mp.mpf(value) for name, value in entries(parameters).items()}


@pytest.mark.parametrize(("name", "parameters"), MATERIALS)
def test_energy_is_the_papers(name, parameters):
    """Each law's energy is its source's equation, with the limit at an exponent of 0."""
    energy, *_ = evaluate(name, parameters, HOOP, AXIAL)
    expected = exact(
        lambda hoop, axial: LAWS[name].energy(
            1 / (hoop * axial), hoop, axial, **exactly(parameters)
        ),
        HOOP,
        AXIAL,
    )
    np.testing.assert_allclose(energy, expected, rtol=ENERGY_TOLERANCE, atol=0)


@pytest.mark.parametrize(("name", "parameters"), MATERIALS)
def test_stress_differences_are_the_derivatives_of_the_energy(name, parameters):
    """The closed forms are ``∂Ŵ/∂ln λθ`` and ``∂Ŵ/∂ln λz``, and so are the defaults."""
    _, hoop_closed, axial_closed, hoop_default, axial_default = evaluate(
        name, parameters, HOOP, AXIAL
    )
    around = exact(
        lambda hoop, axial: (
            hoop * oracles.hoop_response(LAWS[name].energy, hoop, axial, exactly(parameters))
        ),
        HOOP,
        AXIAL,
    )
    along = exact(
        lambda hoop, axial: (
            axial * oracles.axial_response(LAWS[name].energy, hoop, axial, exactly(parameters))
        ),
        HOOP,
        AXIAL,
    )
    for closed, default, expected in (
        (hoop_closed, hoop_default, around),
        (axial_closed, axial_default, along),
    ):
        # One stress difference may vanish where the other does not: rounding is that of both.
        size = np.abs(around) + np.abs(along)
        assert (np.abs(closed - expected) <= CLOSED_FORM_TOLERANCE * size).all()
        assert (np.abs(default - expected) <= DEFAULT_TOLERANCE * size).all()


@pytest.mark.parametrize(("name", "parameters"), MATERIALS)
def test_stress_difference_keeps_its_digits_near_zero_stress(name, parameters):
    """Where a measured curve starts, stress is relatively exact and not only absolutely."""
    hoop = np.array([1 + 1e-9, 1 - 1e-9, 1.0])
    log_hoop = np.log1p(hoop - 1)
    energy = LAWS[name].strain_energy
    symbol = pt.dvector()
    by_name = energy.join(list(entries(parameters).values()))
    stress = energy.stress_difference(symbol, pt.zeros(1), **by_name).eval(
        {symbol: log_hoop}, mode=AS_WRITTEN
    )
    expected = exact(
        lambda logarithm: (
            oracles.hoop_response(
                LAWS[name].energy, mp.exp(logarithm), mp.mpf(1), exactly(parameters)
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
        (ph.NeoHookean(), {"mu": 20.0}, 20.0),
        (ph.MooneyRivlin(), {"c10": 10.0, "c01": 2.0}, 24.0),
        (ph.Yeoh(), {"c1": 10.0, "c2": 15.0, "c3": 5.0}, 20.0),
        (ph.Gent(), {"mu": 15.0, "limit": 0.4}, 15.0),
        (ph.Demiray(), {"mu": 20.0, "b": 10.0}, 20.0),
        (ph.OgdenSeries(2), {"mu": (6.0, -1.0), "alpha": (8.0, -4.0)}, 26.0),
        (ph.PowerLawNeoHookean(), {"mu": 20.0, "n": 0.3}, 20.0),
        (ph.PowerLawNeoHookean(), {"mu": 20.0, "n": 30.0}, 20.0),
        (ph.Ogden(), {"mu": 6.0, "alpha": 0.0}, 12.0),
        (ph.Ogden(), {"mu": 6.0, "alpha": 25.0}, 12.0),
    ],
)
def test_small_strain_shear_modulus(energy, parameters, modulus):
    """In pure shear by ``e`` the stress difference is ``4 G e``, with each docstring's ``G``."""
    strain = pt.dscalar()
    stress = energy.stress_difference(strain, pt.zeros(()), **parameters)
    slope = pytensor.grad(stress, strain).eval({strain: 0.0}, mode=AS_WRITTEN)
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


class Carroll(ph.StrainEnergy):
    """Carroll's rubber: ``W = a (I₁ − 3) + b (I₁⁴ − 81) + c (√I₂ − √3)``.

    Source: M. M. Carroll, J. Elasticity 103 (2011) 173-187.
    """

    parameters = (
        ph.Parameter("a", "a", "kPa", (0.0, 200.0), "first modulus"),
        ph.Parameter("b", "b", "kPa", (0.0, 1.0), "second modulus, of large strain"),
        ph.Parameter("c", "c", "kPa", (0.0, 200.0), "third modulus"),
    )

    def energy(self, radial, hoop, axial, *, a, b, c):
        first = radial**2 + hoop**2 + axial**2
        second = (radial * hoop) ** 2 + (hoop * axial) ** 2 + (axial * radial) ** 2
        return a * (first - 3) + b * (first**4 - 81) + c * (pt.sqrt(second) - 3**0.5)


def carroll_energy(l1, l2, l3, *, a, b, c):
    first = l1**2 + l2**2 + l3**2
    second = l1**-2 + l2**-2 + l3**-2
    return a * (first - 3) + b * (first**4 - 81) + c * (mp.sqrt(second) - mp.sqrt(3))


class TwoFibre(ph.StrainEnergy):
    """Two symmetric fibre families that carry compression too: orthotropic, with a setting.

    ``W = c/2 (I₁ − 3) + k1/k2 {exp[k2 (I₄ − 1)²] − 1}``, ``I₄ = λθ² cos²β + λz² sin²β``.
    After Holzapfel, Gasser and Ogden, J. Elasticity 61 (2000) 1-48.
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
    "isotropic": (Carroll(), carroll_energy, {"a": 15.0, "b": 0.02, "c": 7.0}),
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
        mode=AS_WRITTEN,
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
    assert len({TwoFibre(), TwoFibre(0.7), TwoFibre(0.5), Carroll()}) == 3


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
    assert ph.StrainEnergy.from_name("Carroll") == Carroll()
    assert ph.StrainEnergy.from_name("OgdenSeries", terms=2) == ph.OgdenSeries(2)
    assert ph.OgdenSeries(2) != ph.OgdenSeries(3)
    assert {"Carroll", "Gent", "OgdenSeries"} <= set(ph.list_strain_energies())
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
        assert parameter.unit in ("kPa", "deg", "")


@pytest.mark.parametrize("terms", [0, -1, 2.0, True, "two"])
def test_number_of_terms_is_a_whole_one(terms):
    """A series has at least one term."""
    with pytest.raises(ValueError, match=f"terms is {terms!r}"):
        ph.OgdenSeries(terms)


def test_vectors_are_taken_apart_and_put_together():
    """A vector parameter is a list of entries to an integral, and a tuple of them to the energy."""
    energy = ph.OgdenSeries(2)
    assert [p.size for p in energy.parameters] == [2, 2]
    split = energy.split({"alpha": [3.0, 4.0], "mu": [1.0, 2.0]})
    assert split == [1.0, 2.0, 3.0, 4.0]
    assert energy.join(split) == {"mu": (1.0, 2.0), "alpha": (3.0, 4.0)}
    batch = energy.split({"mu": np.ones((5, 2)), "alpha": pt.dmatrix()})
    assert [np.ndim(entry) for entry in batch[:2]] == [1, 1]
    assert [entry.ndim for entry in batch[2:]] == [1, 1]


def test_a_law_that_says_where_fibres_slacken_is_right():
    """Stress of a fibre law has another slope on either side of each place that it names."""
    hoop = pt.dvector()
    for name, law in LAWS.items():
        parameters = law.strain_energy.join(list(entries(law.parameters[0][0]).values()))
        log_axial = pt.constant(np.log([0.9]))
        kinks = law.strain_energy.kinks(log_axial, **parameters)
        assert bool(kinks) == law.slackens
        if not kinks:
            continue
        stress = law.strain_energy.stress_difference(hoop, log_axial, **parameters)
        slope = pytensor.function([hoop], pytensor.grad(stress.sum(), hoop), mode=AS_WRITTEN)
        places = np.concatenate([np.asarray(kink.eval(mode=AS_WRITTEN)) for kink in kinks])
        near = places[np.abs(places) < 0.5]
        assert near.size
        for place in near:
            below, above = slope([place - KINK_STEP]), slope([place + KINK_STEP])
            assert abs(above - below) > KINK_JUMP * abs(below)


def test_a_shortened_law_is_the_law_where_walls_are_shorter_around():
    """What it leaves out is nil there, in stress and in axial stress."""
    hoop, axial = np.log(np.meshgrid([0.6, 0.9, 1.0], [0.8, 1.0, 1.7]))
    for law in LAWS.values():
        whole = law.strain_energy
        parameters = whole.join(list(entries(law.parameters[0][0]).values()))
        for name in ("stress_difference", "axial_stress_difference"):
            of_both = [
                getattr(energy, name)(pt.constant(hoop), pt.constant(axial), **parameters)
                for energy in (whole, whole.shortened)
            ]
            np.testing.assert_array_equal(*(stress.eval(mode=AS_WRITTEN) for stress in of_both))


def test_four_families_without_hoop_fibres_are_those_of_no_hoop_modulus():
    """The law of three families is another way to state four, of which one bears nothing."""
    hoop, axial = (pt.constant(np.log(x)) for x in np.meshgrid([0.9, 1.4], [0.8, 1.7]))
    four, three = ph.FourFiber(), ph.FourFiber(hoop_fibres=False)
    known = dict(LAWS["FourFiber"].parameters[0][0]) | {"k1_hoop": 0.0}
    fewer = {name: known[name] for name in three.parameter_names}
    assert set(known) - set(fewer) == {"k1_hoop", "k2_hoop"}
    for name in ("stress_difference", "axial_stress_difference"):
        expected = getattr(four, name)(hoop, axial, **known).eval(mode=AS_WRITTEN)
        found = getattr(three, name)(hoop, axial, **fewer).eval(mode=AS_WRITTEN)
        np.testing.assert_array_equal(found, expected)
    assert ph.StrainEnergy.from_name("FourFiber", hoop_fibres=False) == three != four
    with pytest.raises(ValueError, match=r"hoop_fibres is 0; expected True or False"):
        ph.FourFiber(hoop_fibres=0)


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
