"""Natural coordinates: stresses that the materials bear, held against the slope of their energy."""

from functools import cache

import numpy as np
import pymc as pm
import pytensor
import pytensor.tensor as pt
import pytest
from pytensor.graph.traversal import applys_between
from scipy.optimize import brentq
from scipy.special import expit, logit

import pymc_hyperelastic as ph
from pymc_hyperelastic.models.natural_scale import NaturalScale, check_moduli

SEED = 733
# Sums and logarithms of a few numbers of order one.
ROUNDING = 1e-10
# Slopes of energies lose some digits of small strains.
SLOPE = 1e-8
# Compiled sooner than the time that C or Numba would save.
MODE = "FAST_COMPILE"
STRESS = 35.0


def zoo():
    """The laws of the package: other tests define laws of their own."""
    names = [name for name in ph.list_strain_energies() if name in ph.strain_energy.__all__]
    return [*(ph.StrainEnergy.from_name(name) for name in names), ph.OgdenSeries(1)]


class TwoSprings(ph.StrainEnergy):
    """A law of the user, additive in two moduli and given by its energy alone."""

    parameters = (
        ph.Parameter("k", "k", "kPa", (0.0, 50.0), "of the hoop"),
        ph.Parameter("b", "b", "", (0.0, 6.0), "stiffening"),
        ph.Parameter("c", "c", "kPa", (0.0, 50.0), "of the matrix"),
    )

    def energy(self, radial, hoop, axial, *, k, b, c):
        excess = radial**2 + hoop**2 + axial**2 - 3
        return k * pt.cosh(b * pt.log(hoop)) + c * excess


class Welded(TwoSprings):
    """A law in which the moduli work as one: their stresses do not add up."""

    def energy(self, radial, hoop, axial, *, k, b, c):
        excess = radial**2 + hoop**2 + axial**2 - 3
        return pt.sqrt(k * c) * pt.expm1(b * excess)


class Torn(TwoSprings):
    """A law whose second modulus bears nothing where both directions are stretched alike."""

    def energy(self, radial, hoop, axial, *, k, b, c):
        shear = pt.log(hoop) - pt.log(axial)
        return k * pt.cosh(b * pt.log(hoop)) + c * shear**2


class Shifted(ph.StrainEnergy):
    """A law with a parameter of either sign, and no modulus."""

    parameters = (ph.Parameter("shift", "s", "", (-3.0, 5.0), "of either sign"),)

    def energy(self, radial, hoop, axial, *, shift):
        return pt.exp(shift) * (radial**2 + hoop**2 + axial**2 - 3)


NAMES = {
    ph.NeoHookean(): ["log_reference_strain"],
    ph.Ogden(): ["log_reference_strain", "log_alpha"],
    ph.PowerLawNeoHookean(): ["log_reference_strain", "log_n"],
    ph.CriscioneType(): ["log_reference_strain", "log_b"],
    ph.FungOrthotropic(): ["log_reference_strain", "log_a1", "log_a2", "log_a4"],
    ph.MooneyRivlin(): ["log_biaxial_strain", "log_stress_c01_over_c10"],
    ph.OgdenSeries(2): [
        "log_biaxial_strain",
        "log_stress_mu[1]_over_mu[0]",
        "log_alpha[0]",
        "log_alpha[1]",
    ],
    ph.HolzapfelGasserOgden(): [
        "log_biaxial_strain",
        "log_stress_k1_over_c",
        "log_k2",
        "logit_beta",
    ],
    TwoSprings(): ["log_biaxial_strain", "log_b", "log_stress_c_over_k"],
    Welded(): ["log_reference_strain", "log_b", "log_c_ratio"],
    Torn(): ["log_reference_strain", "log_b", "log_c_ratio"],
    Shifted(): ["real_shift"],
}


@pytest.mark.parametrize("energy", NAMES, ids=lambda e: e.name)
def test_names_of_coordinates(energy):
    """One coordinate a parameter; moduli give way to a strain and to stresses, or to ratios."""
    assert NaturalScale(energy).names == NAMES[energy]


@cache
def slope_of(energy, biaxial):
    """Stress along a path, from the energy alone: of both directions, or of the hoop's."""
    strain, entries = pt.dscalar(), [pt.dscalar() for _ in energy.entry_names]
    axial = strain if biaxial else pt.zeros_like(strain)
    stretches = (pt.exp(x) for x in (-strain - axial, strain, axial))
    slope = pt.grad(energy.energy(*stretches, **energy.join(entries)), strain)
    slope = slope / 2 if biaxial else slope
    return pytensor.function([strain, *entries], slope, mode=MODE, on_unused_input="ignore")


def is_biaxial(scale):
    return "log_biaxial_strain" in scale.names


def draws_of(scale, count=3):
    """Coordinates (coordinate, draw) of ordinary specimens."""
    mean, sd = scale.location_prior
    rng = np.random.default_rng(SEED)
    return mean[:, None] + 0.5 * sd[:, None] * rng.standard_normal((len(mean), count))


@pytest.mark.parametrize("energy", [*zoo(), TwoSprings(), Welded(), Torn()], ids=repr)
def test_moduli_bear_the_reference_stress_in_the_ratios_asked_for(energy):
    """The strain is the root of the energy's slope; each modulus alone bears what is its own."""
    scale = NaturalScale(energy, STRESS)
    x, biaxial = draws_of(scale), is_biaxial(scale)
    parameters = [p for p in energy.parameters for _ in range(p.size or 1)]
    moduli = [i for i, p in enumerate(parameters) if p.unit == "kPa"]
    entries = np.array(np.broadcast_arrays(*energy.split(scale.numbers(list(x)))))
    slope = slope_of(energy, biaxial)
    for coordinates, values in zip(x.T, entries.T, strict=True):
        strain = np.exp(coordinates[moduli[0]])
        root = brentq(lambda e: slope(e, *values) - STRESS, strain / 2, strain * 1.5, xtol=1e-14)
        np.testing.assert_allclose(root, strain, rtol=SLOPE)
        borne = []
        for place in moduli:
            alone = values.copy()
            alone[[i for i in moduli if i != place]] = 0.0
            borne.append(slope(strain, *alone))
        compared = np.array(borne) if biaxial else values[moduli]
        ratios = np.log(compared[1:] / compared[0])
        np.testing.assert_allclose(ratios, coordinates[moduli[1:]], atol=SLOPE)


def test_moduli_are_written_down_without_what_cancels():
    """Each specimen's model holds them: of the derivatives of four families it was 2000 nodes."""
    scale = NaturalScale(ph.FourFiber())
    x = [pt.vector(name) for name in scale.names]
    assert len([*applys_between(x, scale.parameters(x).values())]) < 300


@pytest.mark.parametrize("energy", [*zoo(), TwoSprings()], ids=repr)
def test_other_parameters_have_their_own_scale(energy):
    """Logarithms of positive ones, logits of those between two ends."""
    scale = NaturalScale(energy, STRESS)
    x = draws_of(scale)
    values = energy.split(scale.numbers(list(x)))
    parameters = [p for p in energy.parameters for _ in range(p.size or 1)]
    for row, value, p in zip(x, values, parameters, strict=True):
        low, high = p.prior_range
        if p.unit != "kPa" and p.natural_scale == "log":
            np.testing.assert_allclose(np.log(value), row, atol=ROUNDING)
        elif p.natural_scale == "logit":
            np.testing.assert_allclose(logit((value - low) / (high - low)), row, rtol=1e-8)


def test_a_law_of_one_modulus_is_what_it_was():
    """Ogden's modulus by its own formula: one law, one stress."""
    strain, alpha = np.array([0.1, 0.3]), np.array([4.0, 9.0])
    mu = NaturalScale(ph.Ogden(), 20.0).numbers([np.log(strain), np.log(alpha)])["mu"]
    np.testing.assert_allclose(mu, 20 * alpha / (8 * np.sinh(alpha * strain)), rtol=1e-14)


def test_a_law_without_modulus_keeps_its_parameters():
    """A parameter of either sign is its own coordinate, its prior as wide as its range."""
    scale = NaturalScale(Shifted())
    x = np.array([-1.0, 2.0])
    np.testing.assert_array_equal(scale.parameters([pt.as_tensor(x)])["shift"].eval(mode=MODE), x)
    mean, sd = scale.location_prior
    assert (mean.tolist(), sd.tolist()) == ([1.0], [2.0])
    np.testing.assert_allclose(scale.spread_prior[0], np.log(8 / 20))


def test_priors_are_those_of_the_documentation():
    """Medians of the location: 0.2, equal stresses, what the law calls typical, the middle."""
    scale = NaturalScale(ph.HolzapfelGasserOgden())
    mean, sd = scale.location_prior
    np.testing.assert_allclose(mean[:3], np.log([0.2, 1.0, 1.0]))
    np.testing.assert_allclose(expit(mean[3]), 0.5)
    assert sd.tolist() == [0.7, 2.0, 2.0, 1.5]
    np.testing.assert_allclose(np.exp(scale.spread_prior[0]), [0.4, 0.8, 0.4, 0.4])
    # Without that it is a sixth of the largest value.
    mean, sd = NaturalScale(ph.Ogden()).location_prior
    np.testing.assert_allclose([mean[1], sd[1]], [np.log(40 / 6), 1.2])
    np.testing.assert_allclose(NaturalScale(Welded()).location_prior[0][2], 0.0)


# Of HGO: fibres that no float can break, fibres along the tube and around it, no strain, no share.
EXTREME = {
    "overflow": [np.log(2.0), 0.0, np.log(50.0), 0.0],
    "on the edge": [np.log(1.0), 0.0, np.log(8.7), 0.0],
    "axial": [-1.5, 0.0, 1.0, 40.0],
    "hoop": [-1.5, 0.0, 1.0, -40.0],
    "no strain": [-30.0, 0.0, 1.0, 0.0],
    "no fibres": [-1.5, -60.0, 1.0, 0.0],
    "no matrix": [-1.5, 60.0, 1.0, 0.0],
}


@cache
def materials_with_slopes():
    x = [pt.dscalar() for _ in range(4)]
    parameters = NaturalScale(ph.HolzapfelGasserOgden(), STRESS).parameters(x)
    moduli = [parameters["c"], parameters["k1"]]
    slopes = [pt.stack(pt.grad(m, x, disconnected_inputs="ignore")) for m in moduli]
    return pytensor.function(x, [*moduli, *slopes], mode=MODE)


@pytest.mark.parametrize("x", EXTREME.values(), ids=EXTREME)
def test_moduli_and_their_slopes_are_finite(x):
    """Where exponentials overflow, at the ends of angles and strains, and where one bears all."""
    with np.errstate(over="ignore"):
        c, k1, *slopes = materials_with_slopes()(*x)
    assert np.isfinite(slopes).all() and c >= 0 and k1 >= 0
    strain = np.exp(x[0])
    of_matrix = c * (np.expm1(2 * strain) - np.expm1(-4 * strain))
    np.testing.assert_allclose(of_matrix, STRESS * expit(-x[1]), rtol=SLOPE)


# --- layers ---------------------------------------------------------------------------------------


def media():
    return ph.Layer(ph.HolzapfelGasserOgden(), 0.3, beta=30.0)


def test_layers_have_the_coordinates_of_their_laws():
    """With the number of the layer; numbers are none, and an inferred thickness comes last."""
    layers = [
        media(),
        ph.Layer(ph.Demiray(), pm.LogNormal.dist(-1.5, 0.3)),
        ph.Layer(ph.OgdenSeries(2), 0.1, alpha=[3.0, 9.0]),
    ]
    scale = NaturalScale(layers, STRESS)
    assert scale.names == [
        "log_biaxial_strain_1",
        "log_stress_k1_1_over_c_1",
        "log_k2_1",
        "log_reference_strain_2",
        "log_b_2",
        "log_biaxial_strain_3",
        "log_stress_mu_3[1]_over_mu_3[0]",
        "log_thickness_2",
    ]
    mean, sd = scale.location_prior
    np.testing.assert_allclose((mean[-1], sd[-1]), (-1.5, 0.3), atol=0.02)
    np.testing.assert_allclose(np.exp(scale.spread_prior[0])[-3:], [0.4, 0.8, 0.15])
    x = draws_of(scale)
    values = scale.numbers(list(x))
    assert list(values) == ["c_1", "k1_1", "k2_1", "mu_2", "b_2", "mu_3", "thickness_2"]
    np.testing.assert_allclose(np.log(values["thickness_2"]), x[-1], atol=ROUNDING)
    # Each layer is what its law is by itself.
    alone = NaturalScale(ph.HolzapfelGasserOgden(), STRESS).numbers(
        [*x[:3], np.full(3, logit(30 / 90))]
    )
    for name in ("c", "k1", "k2"):
        np.testing.assert_allclose(values[f"{name}_1"], alone[name], rtol=ROUNDING)
    alone = NaturalScale(ph.OgdenSeries(2), STRESS).numbers(
        [*x[5:7], *np.log([[3.0] * 3, [9.0] * 3])]
    )
    np.testing.assert_allclose(values["mu_3"], alone["mu"], rtol=ROUNDING)


def test_beside_a_known_modulus_there_are_logarithms():
    """A modulus that is a number leaves no stress to be chosen."""
    scale = NaturalScale([ph.Layer(ph.HolzapfelGasserOgden(), 0.3, c=12.0)])
    assert scale.names == ["log_k1_1", "log_k2_1", "logit_beta_1"]
    np.testing.assert_allclose(np.exp(scale.location_prior[0][0]), 500 / 20)


def test_a_wall_of_layers_has_the_pressure_of_its_numbers():
    """Layers with variables in place of what is inferred, against those that are written out."""
    layers = [media(), ph.Layer(ph.OgdenSeries(2), pm.Uniform.dist(0.1, 0.2), alpha=[3.0, 9.0])]
    scale = NaturalScale(layers, STRESS)
    x = draws_of(scale, 1)[:, 0]
    wall = scale.wall_of(scale.parameters([pt.as_tensor(v) for v in x]))
    found = ph.inflation_pressure(wall, 1.6, inner_radius=1.4).eval(mode=MODE)
    values = {name: v.tolist() for name, v in scale.numbers(list(x)).items()}
    inner = {name: values[f"{name}_1"] for name in ("c", "k1", "k2")}
    written = [
        ph.Layer(ph.HolzapfelGasserOgden(), 0.3, beta=30.0, **inner),
        ph.Layer(ph.OgdenSeries(2), values["thickness_2"], mu=values["mu_2"], alpha=[3.0, 9.0]),
    ]
    expected = ph.inflation_pressure(written, 1.6, inner_radius=1.4).eval(mode=MODE)
    np.testing.assert_allclose(found, expected, rtol=ROUNDING)


def test_one_thickness_of_two_layers_is_one_coordinate():
    thickness = pm.LogNormal.dist(-1.5, 0.3)
    layers = [ph.Layer(ph.NeoHookean(), thickness), ph.Layer(ph.NeoHookean(), thickness)]
    scale = NaturalScale(layers)
    assert scale.names == ["log_reference_strain_1", "log_reference_strain_2", "log_thickness"]


def test_what_a_class_cannot_take_is_named():
    """Priors of layers, thicknesses of either sign, moduli of either sign."""
    given = ph.Layer(ph.Demiray(), 0.2, b=pm.Uniform.dist(0, 5))
    with pytest.raises(TypeError, match="layer 2 has a distribution for 'b'"):
        NaturalScale([media(), given]).names
    thin = ph.Layer(ph.Demiray(), pm.Normal.dist(0.1, 1.0))
    with pytest.raises(ValueError, match="the prior of 'thickness_1' holds numbers such as -"):
        NaturalScale([thin]).names

    class OfEitherSign(TwoSprings):
        parameters = (*TwoSprings.parameters[:2], ph.Parameter("c", "c", "kPa", (-9.0, 9.0), ""))

        def energy(self, radial, hoop, axial, *, k, b, c):
            return k * hoop + c * axial + b

    with pytest.raises(ValueError, match=r"'c' of OfEitherSign .*'real'"):
        check_moduli([media(), ph.Layer(OfEitherSign(), 0.1)])
