"""Coordinates of specimens, and moduli from their stresses."""

from functools import cache

import numpy as np
import pymc as pm
import pytensor
import pytensor.tensor as pt
import pytest
from scipy.optimize import brentq
from scipy.special import expit, logit
from tiers import deep

import pymc_hyperelastic as ph
from pymc_hyperelastic.models.natural_scale import NaturalScale

SEED = 733
# Sums and logarithms of a few numbers of order one; derivatives of energies lose some digits.
ROUNDING, SLOPE = 1e-10, 1e-8
MODE = "FAST_COMPILE"
STRESS = 35.0


class TwoSprings(ph.StrainEnergy):
    """A law that is additive in two moduli and given by its energy alone."""

    parameters = (
        ph.Parameter("k", "k", "kPa", (0.0, 50.0), "of the hoop"),
        ph.Parameter("b", "b", "", (0.0, 6.0), "stiffening"),
        ph.Parameter("c", "c", "kPa", (0.0, 50.0), "of the matrix"),
    )

    def energy(self, radial, hoop, axial, *, k, b, c):
        excess = radial**2 + hoop**2 + axial**2 - 3
        return k * pt.cosh(b * pt.log(hoop)) + c * excess


class Welded(TwoSprings):
    """A law whose stress is no sum over its moduli."""

    def energy(self, radial, hoop, axial, *, k, b, c):
        return pt.sqrt(k * c) * pt.expm1(b * (radial**2 + hoop**2 + axial**2 - 3))


class Shifted(ph.StrainEnergy):
    """A law with a parameter of either sign, and no modulus."""

    parameters = (ph.Parameter("shift", "s", "", (-3.0, 5.0), "of either sign"),)

    def energy(self, radial, hoop, axial, *, shift):
        return pt.exp(shift) * (radial**2 + hoop**2 + axial**2 - 3)


STRAIN, BIAXIAL = "log_reference_strain", "log_biaxial_strain"
LAWS = [ph.Ogden(), ph.OgdenSeries(2), ph.HolzapfelGasserOgden(), TwoSprings(), Welded()]
DEEP = [ph.CriscioneType(), ph.FungOrthotropic(), ph.MooneyRivlin(), ph.Yeoh(), ph.Demiray()]
DEEP += [ph.GasserOgdenHolzapfel(), ph.FourFiber(), ph.PowerLawNeoHookean()]
NAMES = {
    ph.Ogden(): [STRAIN, "log_alpha"],
    TwoSprings(): [BIAXIAL, "log_b", "log_stress_c_over_k"],
    Welded(): [STRAIN, "log_b", "log_c_ratio"],
    Shifted(): ["real_shift"],
}


def test_each_parameter_has_a_named_coordinate():
    assert {energy: NaturalScale(energy).names for energy in NAMES} == NAMES


def draws_of(scale, count=3):
    """Coordinates (coordinate, draw) of ordinary specimens."""
    mean, sd = scale.location_prior
    standard = np.random.default_rng(SEED).standard_normal((len(mean), count))
    return mean[:, None] + 0.5 * sd[:, None] * standard


@cache
def stress_of(energy, biaxial):
    """Derivative of the energy along a path: half of it if both directions are stretched."""
    strain, entries = pt.dscalar(), [pt.dscalar() for _ in energy.entry_names]
    axial = strain if biaxial else pt.zeros_like(strain)
    stretches = (pt.exp(x) for x in (-strain - axial, strain, axial))
    slope = pt.grad(energy.energy(*stretches, **energy.join(entries)), strain)
    slope = slope / 2 if biaxial else slope
    return pytensor.function([strain, *entries], slope, mode=MODE, on_unused_input="ignore")


@pytest.mark.parametrize("energy", [*LAWS, *deep(DEEP)])
def test_moduli_reproduce_the_reference_stress_and_the_stress_ratios(energy):
    """The stress at the reference strain is `STRESS`; other parameters have logs or logits."""
    scale = NaturalScale(energy, STRESS)
    x, biaxial = draws_of(scale), BIAXIAL in scale.names
    parameters = [p for p in energy.parameters for _ in range(p.size or 1)]
    moduli = [i for i, p in enumerate(parameters) if p.unit == "kPa"]
    entries = np.array(np.broadcast_arrays(*energy.split(scale.numbers(list(x)))))
    stress = stress_of(energy, biaxial)
    for coordinates, values in zip(x.T, entries.T, strict=True):
        strain = np.exp(coordinates[moduli[0]])
        ends = strain / 2, strain * 1.5
        root = brentq(lambda e, values=values: stress(e, *values) - STRESS, *ends, xtol=1e-14)
        np.testing.assert_allclose(root, strain, rtol=SLOPE)
        borne = []
        for place in moduli:
            alone = values.copy()
            alone[[i for i in moduli if i != place]] = 0.0
            borne.append(stress(strain, *alone))
        compared = np.array(borne) if biaxial else values[moduli]
        ratios = np.log(compared[1:] / compared[0])
        np.testing.assert_allclose(ratios, coordinates[moduli[1:]], atol=SLOPE)
    for row, value, p in zip(x, entries, parameters, strict=True):
        low, high = p.prior_range
        if p.unit != "kPa" and p.natural_scale == "log":
            np.testing.assert_allclose(np.log(value), row, atol=ROUNDING)
        elif p.natural_scale == "logit":
            np.testing.assert_allclose(logit((value - low) / (high - low)), row, rtol=SLOPE)


def test_default_priors_equal_the_documented_priors():
    mean, sd = NaturalScale(ph.HolzapfelGasserOgden()).location_prior
    np.testing.assert_allclose(mean, [np.log(0.2), 0.0, 0.0, 0.0])
    assert sd.tolist() == [0.7, 2.0, 2.0, 1.5]
    logs, sd = NaturalScale(ph.HolzapfelGasserOgden()).spread_prior
    np.testing.assert_allclose([*np.exp(logs), sd], [0.4, 0.8, 0.4, 0.4, 0.7])
    mean, sd = NaturalScale(ph.Ogden()).location_prior
    np.testing.assert_allclose([mean[1], sd[1]], [np.log(40 / 6), 1.2])
    mean, sd = NaturalScale(Welded()).location_prior
    np.testing.assert_allclose([mean[2], sd[2]], [0.0, 1.5])
    scale = NaturalScale(Shifted())
    values = [*scale.location_prior[0], *scale.location_prior[1], *np.exp(scale.spread_prior[0])]
    np.testing.assert_allclose(values, [1.0, 2.0, 8 / 20])
    assert scale.numbers([np.array([-1.0, 2.0])])["shift"].tolist() == [-1.0, 2.0]
    # Without a reference stress the coordinate of a modulus is its logarithm.
    without = NaturalScale(ph.NeoHookean(), None)
    high = ph.NeoHookean().parameters[0].prior_range[1]
    assert without.names == ["log_mu"]
    np.testing.assert_allclose(np.ravel(without.location_prior), [np.log(high / 20), 2.0])


# Coordinates of the Holzapfel law with overflow, and at ends of angles, strains and ratios.
EXTREME = {
    "edge of overflow": [0.0, 0.0, np.log(8.7), 0.0],
    "axial fibres": [-1.5, 0.0, 1.0, 40.0],
    "hoop fibres": [-1.5, 0.0, 1.0, -40.0],
    "no strain": [-30.0, 0.0, 1.0, 0.0],
    "no fibres": [-1.5, -60.0, 1.0, 0.0],
    "no matrix": [-1.5, 60.0, 1.0, 0.0],
}


def test_moduli_and_their_gradients_are_finite_in_extreme_materials():
    x = [pt.dscalar() for _ in range(4)]
    parameters = NaturalScale(ph.HolzapfelGasserOgden(), STRESS).parameters(x)
    moduli = [parameters["c"], parameters["k1"]]
    slopes = [pt.stack(pt.grad(m, x, disconnected_inputs="ignore")) for m in moduli]
    function = pytensor.function(x, [*moduli, *slopes], mode=MODE)
    for name, point in EXTREME.items():
        with np.errstate(over="ignore"):
            c, k1, *slopes = function(*point)
        assert np.isfinite(slopes).all() and c >= 0 and k1 >= 0, name
        strain = np.exp(point[0])
        of_matrix = c * (np.expm1(2 * strain) - np.expm1(-4 * strain))
        np.testing.assert_allclose(of_matrix, STRESS * expit(-point[1]), rtol=SLOPE, err_msg=name)


def test_prior_of_a_thickness_with_draws_that_are_not_positive_is_refused():
    """A prior whose draws are NaN is refused too, although no comparison with NaN is true."""
    for mean, sd in ((0.3, 1.0), (np.nan, 1.0)):
        layer = ph.Layer(ph.NeoHookean(), pm.Normal.dist(mean, sd))
        with pytest.raises(ValueError, match=r"'thickness_1' has draws such as.*positive numbers"):
            _ = NaturalScale([layer]).names


# --- layers ---------------------------------------------------------------------------------------


def test_layers_have_the_coordinates_of_their_laws():
    """Fixed parameters have no coordinate, and thicknesses come last."""
    layers = [
        ph.Layer(ph.HolzapfelGasserOgden(), 0.3, beta=30.0),
        ph.Layer(ph.Demiray(), pm.LogNormal.dist(-1.5, 0.3)),
        ph.Layer(ph.OgdenSeries(2), 0.1, alpha=[3.0, 9.0]),
        ph.Layer(ph.HolzapfelGasserOgden(), 0.3, c=12.0),
    ]
    scale = NaturalScale(layers, STRESS)
    assert scale.names == [
        *("log_biaxial_strain_1", "log_stress_k1_1_over_c_1", "log_k2_1"),
        *("log_reference_strain_2", "log_b_2"),
        *("log_biaxial_strain_3", "log_stress_mu_3[1]_over_mu_3[0]"),
        *("log_k1_4", "log_k2_4", "logit_beta_4", "log_thickness_2"),
    ]
    mean, sd = scale.location_prior
    np.testing.assert_allclose((mean[-1], sd[-1]), (-1.5, 0.3), atol=0.02)
    np.testing.assert_allclose(np.exp(scale.spread_prior[0])[-5:], [0.8, 0.4, 0.4, 0.4, 0.15])
    x = draws_of(scale)
    values = scale.numbers(list(x))
    np.testing.assert_allclose(np.log(values["thickness_2"]), x[-1], atol=ROUNDING)
    alone = NaturalScale(ph.HolzapfelGasserOgden(), STRESS)
    expected = alone.numbers([*x[:3], np.full(3, logit(30 / 90))])
    for name in ("c", "k1", "k2"):
        np.testing.assert_allclose(values[f"{name}_1"], expected[name], rtol=ROUNDING)
    thickness = pm.LogNormal.dist(-1.5, 0.3)
    shared = NaturalScale([ph.Layer(ph.NeoHookean(), thickness)] * 2)
    assert shared.names[2:] == ["log_thickness"]
