"""Strain energies against their printed equations, and the base class for laws of a user."""

from functools import cache
from math import radians

import mpmath as mp
import numpy as np
import oracles
import pytensor
import pytensor.tensor as pt
import pytest
import xarray as xr
from problems import AS_WRITTEN, LAWS, entries
from tube_posteriors import fitted_tree

import pymc_hyperelastic as ph
from pymc_hyperelastic.mechanics.integrals import AxialForceIntegral
from pymc_hyperelastic.models.settings import ModelSettings

# Some twenty operations in double precision, and an exponent of 25 times 2 ln(1.9), about 32, which
# multiplies the rounding of its argument.
CLOSED_FORM_TOLERANCE = 1e-13
# An energy is a difference from its value at rest: rounding is relative to its stiffest term, of
# the size of the modulus times e^(alpha strain), and the strains below are 0.1 and more.
ENERGY_TOLERANCE = 1e-12
# The default stress is a difference of two derivatives, which nearly cancel at small strain.
DEFAULT_TOLERANCE = 1e-11
# Adaptive quadrature, and the second derivatives of an energy.
QUADRATURE_TOLERANCE = 1e-9
SECOND_TOLERANCE = 1e-7

# Far from rest; then near rest, where a measured curve starts, and a series replaces sinh(x)/x.
LOG_HOOP = np.log([0.6, 0.8, 1.15, 1.4, 1.9, 1.0, 1.1])
LOG_AXIAL = np.log([1.0, 1.3, 1.0, 1.5, 0.8, 1.9, 1.0])
NEAR_REST = np.array([1e-9, -1e-9, 1.1e-3, 2e-2])


def exact(function, *arrays):
    """Evaluate a function of hundred-digit numbers for each entry of some arrays."""
    with mp.workdps(oracles.DIGITS):
        return np.array([float(function(*map(mp.mpf, row))) for row in zip(*arrays, strict=True)])


@cache
def compiled_material(name):
    """Compile the energy of a law and its two stress differences, as overridden and by default.

    The arguments are the logarithms of hoop and axial stretch and the entries of the parameters.
    """
    energy = LAWS[name].strain_energy
    log_hoop, log_axial, *values = pt.dvectors(2 + len(LAWS[name].entry_names))
    parameters, by_default = energy.join(values), ph.StrainEnergy
    stretches = [pt.exp(x) for x in (-log_hoop - log_axial, log_hoop, log_axial)]
    return pytensor.function(
        [log_hoop, log_axial, *values],
        [
            energy.energy(*stretches, **parameters),
            energy.stress_difference(log_hoop, log_axial, **parameters),
            energy.axial_stress_difference(log_hoop, log_axial, **parameters),
            by_default.stress_difference(energy, log_hoop, log_axial, **parameters),
            by_default.axial_stress_difference(energy, log_hoop, log_axial, **parameters),
        ],
        mode=AS_WRITTEN,
    )


def evaluate(name, parameters, log_hoop, log_axial):
    values = (np.full_like(log_hoop, value) for value in entries(parameters).values())
    return compiled_material(name)(log_hoop, log_axial, *values)


def exact_material(name, parameters, *logs):
    """Return the energy and both stress differences from the energy that the source prints."""
    law = LAWS[name].energy
    exactly = {name: mp.mpf(value) for name, value in entries(parameters).items()}

    def energy(h, z):
        return law(mp.exp(-h - z), mp.exp(h), mp.exp(z), **exactly)

    def hoop_stress(h, z):
        return mp.exp(h) * oracles.hoop_response(law, mp.exp(h), mp.exp(z), exactly)

    def axial_stress(h, z):
        return mp.exp(z) * oracles.axial_response(law, mp.exp(h), mp.exp(z), exactly)

    return [exact(function, *logs) for function in (energy, hoop_stress, axial_stress)]


@pytest.mark.parametrize("name", LAWS)
def test_energy_and_stresses_equal_the_published_equation(name):
    """Closed forms and default derivatives equal ``∂Ŵ/∂ln λθ`` and ``∂Ŵ/∂ln λz``."""
    for parameters, _ in LAWS[name].parameters:
        energy, *closed, hoop_default, axial_default = evaluate(
            name, parameters, LOG_HOOP, LOG_AXIAL
        )
        stored, *stresses = exact_material(name, parameters, LOG_HOOP, LOG_AXIAL)
        np.testing.assert_allclose(energy, stored, rtol=ENERGY_TOLERANCE, atol=0)
        # One stress difference may vanish where the other does not: rounding is that of both.
        size = np.abs(stresses).sum(axis=0)
        default = hoop_default, axial_default
        assert (np.abs(np.subtract(closed, stresses)) <= CLOSED_FORM_TOLERANCE * size).all()
        assert (np.abs(np.subtract(default, stresses)) <= DEFAULT_TOLERANCE * size).all()


@pytest.mark.parametrize("name", LAWS)
def test_stress_has_small_relative_errors_near_zero_strain(name):
    """The stress is exactly 0 at zero strain."""
    for parameters, _ in LAWS[name].parameters:
        axial = np.zeros(5)
        stress = evaluate(name, parameters, np.append(NEAR_REST, 0.0), axial)[1]
        expected = exact_material(name, parameters, NEAR_REST, axial[:4])[1]
        np.testing.assert_allclose(stress[:4], expected, rtol=CLOSED_FORM_TOLERANCE, atol=0)
        assert stress[4] == 0


# --- fibres ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", [name for name, law in LAWS.items() if law.slackens])
def test_kinks_are_roots_of_the_fibre_strain(name):
    """The expected roots are found by a scan and bisection."""
    law = LAWS[name]
    log_axial, *values = symbols = pt.dvectors(1 + len(law.entry_names))
    kinks = law.strain_energy.kinks(log_axial, **law.strain_energy.join(values))
    function = pytensor.function(symbols, kinks, mode=AS_WRITTEN, on_unused_input="ignore")
    for parameters, _ in law.parameters[:1] + law.parameters[-1:]:
        known = entries(parameters)
        if name == "HolzapfelGasserOgden" and known["beta"] == 90:
            continue  # along the tube: hoop stretch does not change the strain
        for axial in (0.7, 0.95, 1.3, 2.1):
            columns = (np.array([x]) for x in (np.log(axial), *known.values()))
            found = {round(float(x[0]), 10) for x in function(*columns) if abs(x[0]) < 3}
            with mp.workdps(oracles.DIGITS):
                strains = law.switches(mp.mpf(1), mp.mpf(axial), **known)
                roots = [
                    root
                    for i in range(len(strains))
                    for root in oracles.sign_changes(
                        lambda hoop, i=i, axial=axial: law.switches(hoop, axial, **known)[i],
                        mp.exp(-3),
                        mp.exp(3),
                    )
                ]
            assert found == {round(float(mp.log(root)), 10) for root in roots}, axial


def test_law_without_hoop_fibres_equals_four_fibres_of_zero_hoop_modulus():
    three, known = ph.FourFiber(hoop_fibres=False), LAWS["FourFiber"].parameters[0][0]
    assert set(known) - set(three.parameter_names) == {"k1_hoop", "k2_hoop"}
    own = {name: known[name] for name in three.parameter_names}
    for hoop in (0.6, 1.4):
        stretches = np.full(2, np.log(hoop)), np.log([0.8, 1.7])
        for name in ("stress_difference", "axial_stress_difference"):
            expected = getattr(ph.FourFiber(), name)(*stretches, **known | {"k1_hoop": 0.0})
            found = getattr(three, name)(*stretches, **own)
            values = [stress.eval(mode=AS_WRITTEN) for stress in (found, expected)]
            np.testing.assert_array_equal(*values)


# --- energies that a user writes ------------------------------------------------------------------


class TwoFibre(ph.StrainEnergy):
    """Two symmetric fibre families that also carry compression: orthotropic, with a setting."""

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


class Limited(ph.StrainEnergy):
    """Gent's law, as a user may write it: the logarithm is NaN beyond the limit."""

    parameters = (
        ph.Parameter("mu", "mu", "kPa", (0.0, 100.0), "shear modulus"),
        ph.Parameter("limit", "J", "", (0.05, 5.0), "limit of I1 - 3"),
    )

    def energy(self, radial, hoop, axial, *, mu, limit):
        excess = radial**2 + hoop**2 + axial**2 - 3
        return -mu * limit / 2 * pt.log(1 - excess / limit)


class Forbidding(Limited):
    """The same with an infinite energy beyond the limit, whose derivative is zero."""

    def energy(self, radial, hoop, axial, *, mu, limit):
        excess = radial**2 + hoop**2 + axial**2 - 3
        inside = excess < limit
        energy = -mu * limit / 2 * pt.log(1 - pt.where(inside, excess, 0.0) / limit)
        return pt.where(inside, energy, np.inf)


@pytest.mark.parametrize("law", [Limited(), Forbidding()], ids=lambda law: law.name)
def test_stress_is_not_finite_where_the_energy_of_a_user_is_not(law):
    """Stress and radius are those of the law of the package wherever the energy is finite."""
    stretches, known = (np.log([1.1, 1.3]), np.log([1.05, 1.2])), {"mu": 20.0, "limit": 0.5}
    for name in ("stress_difference", "axial_stress_difference"):
        logs = map(pt.as_tensor, stretches)
        within, beyond = getattr(law, name)(*logs, **known).eval()
        expected = getattr(ph.Gent(), name)(*stretches, **known).eval()[0]
        np.testing.assert_allclose(within, expected, rtol=DEFAULT_TOLERANCE)
        assert not np.isfinite(beyond)
    posterior = xr.Dataset({name: (("chain", "draw"), [[value]]) for name, value in known.items()})
    result = xr.DataTree.from_dict({"posterior": posterior})
    at = ph.Conditions([5.0, 20.0], tube=ph.Tube(1.0, 1.3))
    found, expected = (ph.radius_at_pressure(result, at, energy=e) for e in (law, ph.Gent()))
    np.testing.assert_allclose(found["radius"], expected["radius"], rtol=QUADRATURE_TOLERANCE)


def two_fibre_energy(l1, l2, l3, *, c, k1, k2):
    beta = mp.mpf(TwoFibre().fibre_angle)
    fourth = l2**2 * mp.cos(beta) ** 2 + l3**2 * mp.sin(beta) ** 2
    matrix = c / 2 * (l1**2 + l2**2 + l3**2 - 3)
    return matrix + k1 / k2 * (mp.exp(k2 * (fourth - 1) ** 2) - 1)


def test_law_of_a_user_gives_pressure_force_and_gradients_from_its_energy():
    """The reference values are adaptive quadratures of the same energy."""
    parameters = {"c": 10.0, "k1": 8.0, "k2": 0.6}
    point = dict(zip(oracles.GEOMETRY, (0.48, 0.4, 0.52, 1.4, radians(70)), strict=True))
    point |= parameters
    inputs = pt.dvectors(len(point))
    pressure, stiffness = ph.PressureIntegral(strain_energy=TwoFibre())(*inputs)
    force, _ = AxialForceIntegral(strain_energy=TwoFibre())(*inputs)
    gradient = pt.stack(pytensor.grad(pressure.sum(), inputs))
    function = pytensor.function(inputs, [pressure, stiffness, force, gradient], mode=AS_WRITTEN)
    *found, gradient = function(*(np.array([x]) for x in point.values()))

    def derivative(*by, **settings):
        return oracles.tube_derivative(two_fibre_energy, point, *by, **settings)

    expected = [derivative(), derivative("internal_radius")]
    expected += [derivative(quantity=oracles.layered_force)]
    np.testing.assert_allclose(np.ravel(found), expected, rtol=QUADRATURE_TOLERANCE)
    expected = [derivative(name) for name in point]
    np.testing.assert_allclose(gradient[:, 0], expected, rtol=SECOND_TOLERANCE)


def test_instances_with_equal_settings_are_equal_and_found_by_name():
    assert len({ph.Ogden(), ph.Ogden(), ph.CriscioneType(), ph.OgdenSeries(2)}) == 3
    assert len({TwoFibre(), TwoFibre(0.7), TwoFibre(0.5)}) == 2
    assert TwoFibre() != TwoFibre(0.5) and TwoFibre() == TwoFibre(fibre_angle=0.7)
    assert repr(TwoFibre(fibre_angle=0.5)) == "TwoFibre(fibre_angle=0.5)"
    assert ph.OgdenSeries(2).entry_names == ("mu[0]", "mu[1]", "alpha[0]", "alpha[1]")
    assert ph.StrainEnergy.from_name("TwoFibre", fibre_angle=0.5) == TwoFibre(0.5)
    assert ph.StrainEnergy.from_name("OgdenSeries", terms=2) == ph.OgdenSeries(2)
    # A file gives a tuple back as a list.
    pair = ph.StrainEnergy.from_name("TwoFibre", fibre_angle=[0.5, 0.7])
    assert pair == TwoFibre((0.5, 0.7)) and hash(pair) == hash(TwoFibre((0.5, 0.7)))
    with pytest.raises(
        TypeError, match=r"TwoFibre\(fibre_angle=\[0.5\]\) is not hashable; use tuples"
    ):
        hash(TwoFibre([0.5]))
    assert {"TwoFibre", "Gent", "OgdenSeries"} <= set(ph.list_strain_energies())


MODULUS, MATRIX, FIBRES = (0.0, 200.0), (0.0, 100.0), (0.0, 500.0)
STIFFENING, ANGLE = (0.0, 50.0), (0.0, 90.0)
HOLZAPFEL = {"c": MATRIX, "k1": FIBRES, "k2": STIFFENING, "beta": ANGLE}
FOUR_KINDS = ("axial", "hoop", "diagonal")
PRIOR_RANGES = {
    "NeoHookean": {"mu": MODULUS},
    "MooneyRivlin": {"c10": MATRIX, "c01": MATRIX},
    "Yeoh": {"c1": (0.0, 300.0), "c2": (0.0, 3000.0), "c3": (0.0, 3000.0)},
    "ArrudaBoyce": {"mu": MODULUS, "lock": (1.0, 10.0)},
    "Gent": {"mu": MODULUS, "limit": (0.1, 100.0)},
    "Demiray": {"mu": MODULUS, "b": (0.0, 20.0)},
    "PowerLawNeoHookean": {"mu": MODULUS, "n": (0.3, 30.0)},
    "Ogden": {"mu": MATRIX, "alpha": (-40.0, 40.0)},
    "OgdenSeries": {"mu": MATRIX, "alpha": (1.0, 40.0)},
    "CriscioneType": {"a": MATRIX, "b": (-20.0, 20.0)},
    "FungOrthotropic": {"c": MODULUS, "a1": (0.0, 20.0), "a2": (0.0, 20.0), "a4": (0.0, 10.0)},
    "HolzapfelGasserOgden": HOLZAPFEL,
    "GasserOgdenHolzapfel": HOLZAPFEL | {"kappa": (0.0, 1 / 3)},
    "FourFiber": {"c": MATRIX, "beta": ANGLE}
    | {f"k1_{kind}": FIBRES for kind in FOUR_KINDS}
    | {f"k2_{kind}": STIFFENING for kind in FOUR_KINDS},
}


def test_default_priors_have_the_documented_ranges():
    """Evidences depend on these ranges: a change makes them incomparable with earlier ones."""
    for law in LAWS.values():
        energy = law.strain_energy
        ranges = {p.name: p.prior_range for p in energy.parameters}
        # Laws that are newer than this table have no earlier evidences.
        assert ranges == PRIOR_RANGES.get(energy.name, ranges)
        for p in energy.parameters:
            assert p.symbol and p.description and energy.__doc__ and p.unit in ("kPa", "deg", "")
            assert (p.natural_scale == "logit") == (p.name in ("beta", "kappa"))
            assert p.natural_scale in ("log", "logit")
            assert p.typical == ((1.0, 2.0) if p.name.startswith("k2") else None)
    assert ph.Parameter("x", "x", "", (-1.0, 1.0), "of either sign").natural_scale == "real"


def test_vector_parameters_are_split_into_entries_and_joined_again():
    energy = ph.OgdenSeries(2)
    split = energy.split({"alpha": [3.0, 4.0], "mu": [1.0, 2.0]})
    assert split == [1.0, 2.0, 3.0, 4.0]
    assert energy.join(split) == {"mu": (1.0, 2.0), "alpha": (3.0, 4.0)}
    assert energy.split(energy.join(split)) == split
    batch = energy.split({"mu": np.ones((5, 2)), "alpha": pt.dmatrix()})
    assert [np.ndim(entry) for entry in batch[:2]] == [1, 1]
    assert [entry.ndim for entry in batch[2:]] == [1, 1]


MU = ph.Parameter("mu", r"\mu", "kPa", (0.0, 1.0), "shear modulus")
WRONG_ENERGIES = {
    r"\['mu'\].*\['nu'\]": lambda self, radial, hoop, axial, *, nu: nu * hoop,
    r"\['mu'\].*\['mu', 'n'\]": lambda self, radial, hoop, axial, *, mu, n: mu * hoop**n,
    r"\['mu'\].*arguments \[\]": lambda self, radial, hoop, axial, mu: mu * hoop,
}


@pytest.mark.parametrize(("message", "energy"), WRONG_ENERGIES.items())
def test_class_whose_energy_has_other_parameters_is_refused(message, energy):
    with pytest.raises(TypeError, match=f"Refused.*{message}"):
        type("Refused", (ph.StrainEnergy,), {"parameters": (MU,), "energy": energy})
    with pytest.raises(ValueError, match=r"'Refused'.*'Ogden'"):
        ph.StrainEnergy.from_name("Refused")


@pytest.mark.parametrize(
    ("make", "error", "message"),
    [
        *[
            (lambda terms=terms: ph.OgdenSeries(terms), ValueError, f"terms is {terms!r}; expected")
            for terms in (0, 2.0, True)
        ],
        (lambda: ph.FourFiber(hoop_fibres=0), ValueError, "hoop_fibres is 0; expected True or"),
        (lambda: ph.StrainEnergy.from_name("Ogden", n=2), ValueError, r"settings \[\].*\['n'\]"),
        (lambda: type("Empty", (ph.StrainEnergy,), {})(), TypeError, "energy"),
        (lambda: ph.OgdenSeries(2).split({"mu": [1.0]}), TypeError, r"'alpha'\], but \['mu'\]"),
    ],
)
def test_wrong_settings_of_laws_are_refused(make, error, message):
    with pytest.raises(error, match=message):
        make()


def test_result_is_refused_if_its_law_was_redefined_with_another_formula(monkeypatch):
    """If two classes of a user have the same name, the name means the class defined last."""
    monkeypatch.setattr(ph.StrainEnergy, "_registry", {**ph.StrainEnergy._registry})

    def mine(power):
        class Mine(ph.StrainEnergy):
            parameters = (ph.Parameter("mu", "m", "kPa", (0.0, 200.0), "modulus"),)

            def energy(self, radial, hoop, axial, *, mu):
                return mu / 2 * (radial**power + hoop**power + axial**power - 3)

        return Mine()

    neo_hookean = mine(2)
    # A fingerprint has six digits; the difference of two derivatives loses some of 16.
    np.testing.assert_allclose(neo_hookean.fingerprint, ph.NeoHookean().fingerprint, rtol=1e-5)
    tree = fitted_tree(mu=[20.0])
    tree.attrs |= ModelSettings.of(neo_hookean).attrs()
    same = ph.predict_pressure(tree, [8.0])
    assert mine(2).fingerprint == neo_hookean.fingerprint
    assert ph.predict_pressure(tree, [8.0]).equals(same)
    other = mine(4)
    assert ph.StrainEnergy.from_name("Mine") == other
    with pytest.raises(ValueError, match="'Mine' of another formula than the 'Mine' that is"):
        ph.predict_pressure(tree, [8.0])


def test_law_whose_parameters_are_tuples_is_refused_with_an_example():
    with pytest.raises(TypeError, match=r"strain energy Odd: .*\('c', .*such as ph\.Parameter\("):
        type("Odd", (ph.NeoHookean,), {"parameters": [("c", "kPa")], "__module__": __name__})


@pytest.mark.parametrize("name", sorted({law.strain_energy.name for law in LAWS.values()}))
def test_names_of_built_in_laws_are_reserved(name):
    """A class of a user with such a name is refused, and the name keeps its law."""
    with pytest.raises(TypeError, match=f"the name {name} is reserved.*part of the package"):
        type(name, (ph.NeoHookean,), {"__module__": __name__})
    assert type(ph.StrainEnergy.from_name(name)) is getattr(ph, name)


def test_energy_function_without_return_is_refused(monkeypatch):
    monkeypatch.setattr(ph.StrainEnergy, "_registry", {**ph.StrainEnergy._registry})

    class Forgotten(ph.NeoHookean):
        def energy(self, radial, hoop, axial, *, mu):
            mu * hoop

        stress_difference = ph.StrainEnergy.stress_difference

    with pytest.raises(TypeError, match=r"`energy` of Forgotten gave None; .* with `return`"):
        Forgotten().fingerprint
