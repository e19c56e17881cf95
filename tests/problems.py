"""A table of inflated tubes with known answers, and the materials that they are made of.

A new strain energy needs one row in `LAWS`: an instance of its class, its energy as its source
prints it in the arithmetic of `mpmath`, and sets of parameters. The tests inflate it in every tube
of `TUBES` with the first set of parameters, and in the hard tubes with all other sets, and compare
pressure, stiffness, axial force and gradients with adaptive quadrature.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from math import radians

import mpmath as mp
import oracles
from pytensor.compile.mode import Mode
from pytensor.graph.rewriting.db import RewriteDatabaseQuery

import pymc_hyperelastic as ph

# Evaluates a graph without simplifying it, for graphs that are evaluated a few times: to simplify a
# graph takes ten times as long. The second tier evaluates simplified and compiled graphs.
AS_WRITTEN = Mode("py", RewriteDatabaseQuery(include=["minimum_compile", "merge"]))

# Parameters of a material by name; vectors are tuples.
Parameters = Mapping[str, float | tuple[float, ...]]


def entries(parameters: Parameters) -> dict[str, float]:
    """Return all entries by name; those of a vector ``mu`` are ``mu_0``, ``mu_1`` and so on."""
    flat = {}
    for name, value in parameters.items():
        if isinstance(value, tuple):
            flat |= {f"{name}_{i}": x for i, x in enumerate(value)}
        else:
            flat[name] = value
    return flat


@dataclass(frozen=True)
class Law:
    """A strain energy, the same energy for the oracles, and sets of parameters with reasons."""

    strain_energy: ph.StrainEnergy
    energy: oracles.Energy  # its keyword arguments are the entries of the parameters
    parameters: tuple[tuple[Parameters, str], ...]  # the first set is the ordinary one
    switches: oracles.Switches = oracles.no_switches  # strains of fibres that may slacken

    @property
    def slackens(self) -> bool:
        """Return True for laws with fibres, whose stress has a kink where they slacken."""
        return self.switches is not oracles.no_switches

    @property
    def entry_names(self) -> list[str]:
        """Names of all entries of the parameters, in the order of the integrals' inputs."""
        return list(entries(self.parameters[0][0]))

    def exact(self, inputs: Mapping[str, float], *by: str, **settings) -> float:
        """Return the pressure of a tube, or its derivative by the named inputs."""
        return oracles.tube_derivative(self.energy, inputs, *by, switches=self.switches, **settings)


# --- materials -----------------------------------------------------------------------------------


def first(l1, l2, l3):
    """``I1 - 3``."""
    return l1**2 + l2**2 + l3**2 - 3


def second(l1, l2, l3):
    """``I2 - 3``."""
    return (l1 * l2) ** 2 + (l2 * l3) ** 2 + (l3 * l1) ** 2 - 3


@cache
def squared_cosine(degrees):
    """Square of the cosine, in a hundred digits; the oracles need it thousands of times."""
    return mp.cos(degrees * mp.pi / 180) ** 2


def fibre_strain(hoop, axial, beta):
    """``I4 - 1`` of fibres at `beta` degrees from the circumferential direction."""
    along = squared_cosine(beta)
    return along * (hoop**2 - 1) + (1 - along) * (axial**2 - 1)


def fibres(strain, k1, k2):
    """``k1/(2 k2) {exp(k2 E^2) - 1}`` of one family, in tension only."""
    return k1 / (2 * k2) * (mp.exp(k2 * max(strain, 0) ** 2) - 1)


LAWS = {}
LAWS["NeoHookean"] = Law(
    ph.NeoHookean(),
    # W = mu/2 (I1 - 3)
    lambda l1, l2, l3, *, mu: mu / 2 * first(l1, l2, l3),
    (({"mu": 20.0}, "its one parameter is a factor"),),
)
LAWS["MooneyRivlin"] = Law(
    ph.MooneyRivlin(),
    # W = c10 (I1 - 3) + c01 (I2 - 3)
    lambda l1, l2, l3, *, c10, c01: c10 * first(l1, l2, l3) + c01 * second(l1, l2, l3),
    (
        ({"c10": 10.0, "c01": 1.5}, "rubber, with a small part of the second invariant"),
        ({"c10": 0.0, "c01": 10.0}, "end of the prior: the second invariant alone"),
    ),
)


def yeoh_energy(l1, l2, l3, *, c1, c2, c3):
    """``W = c1 (I1 - 3) + c2 (I1 - 3)^2 + c3 (I1 - 3)^3``."""
    excess = first(l1, l2, l3)
    return c1 * excess + c2 * excess**2 + c3 * excess**3


LAWS["Yeoh"] = Law(
    ph.Yeoh(),
    yeoh_energy,
    (
        ({"c1": 10.0, "c2": 15.0, "c3": 5.0}, "a stiffening artery"),
        ({"c1": 1.0, "c2": 0.0, "c3": 1000.0}, "end of the prior: soft, then very steep"),
    ),
)


def arruda_boyce_energy(l1, l2, l3, *, mu, lock):
    """``W = mu sum C_i/lock^(2i-2) (I1^i - 3^i)``, five terms of the inverse Langevin function."""
    first_invariant = first(l1, l2, l3) + 3
    printed = (1, 2), (1, 20), (11, 1050), (19, 7000), (519, 673750)
    return mu * sum(
        mp.mpf(a) / b / lock ** (2 * i - 2) * (first_invariant**i - 3**i)
        for i, (a, b) in enumerate(printed, start=1)
    )


def lopez_pamies_energy(l1, l2, l3, **entries):
    """``W = sum 3^(1 - alpha_p)/(2 alpha_p) mu_p (I1^alpha_p - 3^alpha_p)``."""
    first_invariant = first(l1, l2, l3) + 3
    terms = [(entries[f"mu_{p}"], entries[f"alpha_{p}"]) for p in range(len(entries) // 2)]
    return sum(
        mp.mpf(3) ** (1 - a) / (2 * a) * mu * (first_invariant**a - mp.mpf(3) ** a)
        for mu, a in terms
    )


LOPEZ_PAMIES_RUBBER = {"mu": (269.9, 0.01771), "alpha": (1.08, 4.40)}
"""Vulcanised rubber of Treloar.

Source: O. Lopez-Pamies, "A new I1-based hyperelastic model for rubber elastic materials", Comptes
Rendus Mecanique 338 (2010) 3-11, as stated in the documentation of FElupe
(github.com/adtzlr/felupe,
src/felupe/constitution/tensortrax/models/hyperelastic/_lopez_pamies.py).
"""

LAWS["LopezPamies(terms=1)"] = Law(
    ph.LopezPamies(terms=1),
    lopez_pamies_energy,
    (
        ({"mu": (20.0,), "alpha": (1.0,)}, "the neo-Hookean solid, which has a closed form"),
        ({"mu": (20.0,), "alpha": (0.5,)}, "end of the prior: softens"),
    ),
)
LAWS["LopezPamies(terms=2)"] = Law(
    ph.LopezPamies(),
    lopez_pamies_energy,
    (
        ({"mu": (20.0, 1.0), "alpha": (1.0, 8.0)}, "a stiffening artery"),
        (LOPEZ_PAMIES_RUBBER, "the rubber for which the series was made"),
        ({"mu": (0.0, 1.0), "alpha": (1.0, 40.0)}, "end of the prior: steep"),
    ),
)
LAWS["ArrudaBoyce"] = Law(
    ph.ArrudaBoyce(),
    arruda_boyce_energy,
    (
        ({"mu": 20.0, "lock": 3.0}, "rubber"),
        ({"mu": 20.0, "lock": 1.0}, "end of the prior: chains taut from the start"),
    ),
)
LAWS["Gent"] = Law(
    ph.Gent(),
    # W = -mu Jm/2 ln(1 - (I1 - 3)/Jm)
    lambda l1, l2, l3, *, mu, limit: -mu * limit / 2 * mp.log(1 - first(l1, l2, l3) / limit),
    (
        ({"mu": 15.0, "limit": 60.0}, "rubber"),
        ({"mu": 15.0, "limit": 15.0}, "the extreme tube is two thirds on the way to the end"),
    ),
)
LAWS["Demiray"] = Law(
    ph.Demiray(),
    # W = mu/(2 b) {exp[b (I1 - 3)] - 1}
    lambda l1, l2, l3, *, mu, b: mu / (2 * b) * (mp.exp(b * first(l1, l2, l3)) - 1),
    (
        ({"mu": 20.0, "b": 1.0}, "an artery"),
        ({"mu": 20.0, "b": 1e-12}, "almost 0, where the energy reads 0/0: neo-Hookean"),
        ({"mu": 3.0, "b": 5.0}, "steep: pressures of e^50 mu in the extreme tube"),
    ),
)
LAWS["PowerLawNeoHookean"] = Law(
    ph.PowerLawNeoHookean(),
    # W = (mu/2) {[1 + (I1 - 3)/n]^n - 1}
    lambda l1, l2, l3, *, mu, n: mu / 2 * ((1 + first(l1, l2, l3) / n) ** n - 1),
    (
        ({"mu": 20.0, "n": 4.0}, "a stiffening artery"),
        ({"mu": 20.0, "n": 1.0}, "the neo-Hookean solid, which has a closed form"),
        ({"mu": 20.0, "n": 0.3}, "end of the prior: softens, with a falling pressure"),
        ({"mu": 20.0, "n": 30.0}, "end of the prior: almost exponential"),
    ),
)


def ogden_energy(l1, l2, l3, *, mu, alpha):
    """``W = (2 mu/alpha^2) (sum of l^alpha + l^-alpha, minus 6)``; ``2 mu sum ln^2 l`` at 0."""
    if alpha == 0:
        return 2 * mu * (mp.log(l1) ** 2 + mp.log(l2) ** 2 + mp.log(l3) ** 2)
    powers = sum(stretch**alpha + 1 / stretch**alpha for stretch in (l1, l2, l3))
    return 2 * mu / alpha**2 * (powers - 6)


LAWS["Ogden"] = Law(
    ph.Ogden(),
    ogden_energy,
    (
        ({"mu": 6.0, "alpha": 8.0}, "an artery"),
        ({"mu": 6.0, "alpha": 0.0}, "the limit of an energy that reads 0/0"),
        ({"mu": 6.0, "alpha": 1e-12}, "almost 0: the printed energy cancels to nothing"),
        ({"mu": 6.0, "alpha": 0.3}, "the series of sinh(x)/x ends within the wall"),
        ({"mu": 6.0, "alpha": 25.0}, "steep"),
        ({"mu": 6.0, "alpha": -25.0}, "steep; the energy is even"),
    ),
)


def ogden_series_energy(l1, l2, l3, **entries):
    """``W = sum mu_p/alpha_p (l1^alpha_p + l2^alpha_p + l3^alpha_p - 3)``."""
    terms = [(entries[f"mu_{p}"], entries[f"alpha_{p}"]) for p in range(len(entries) // 2)]
    return sum(mu / alpha * (l1**alpha + l2**alpha + l3**alpha - 3) for mu, alpha in terms)


KILOPASCAL_PER_KGF_CM2 = 98.0665
OGDEN_1972_RUBBER = {
    "mu": tuple(KILOPASCAL_PER_KGF_CM2 * mu for mu in (6.3, 0.012, -0.1)),
    "alpha": (1.3, 5.0, -2.0),
}
"""Vulcanised rubber, whose moduli are printed in kgf/cm^2.

Source: R. W. Ogden, "Large deformation isotropic elasticity: on the correlation of theory and
experiment for incompressible rubberlike solids", Proc. R. Soc. Lond. A 326 (1972) 565-584.
"""

LAWS["OgdenSeries(terms=1)"] = Law(
    ph.OgdenSeries(terms=1),
    ogden_series_energy,
    (
        ({"mu": (6.0,), "alpha": (8.0,)}, "an artery"),
        ({"mu": (6.0,), "alpha": (40.0,)}, "end of the prior"),
    ),
)
LAWS["OgdenSeries(terms=2)"] = Law(
    ph.OgdenSeries(terms=2),
    ogden_series_energy,
    (({"mu": (20.0, -3.0), "alpha": (2.0, -2.0)}, "the Mooney-Rivlin solid"),),
)
LAWS["OgdenSeries(terms=3)"] = Law(
    ph.OgdenSeries(terms=3),
    ogden_series_energy,
    ((OGDEN_1972_RUBBER, "the rubber for which the series was made"),),
)
LAWS["CriscioneType"] = Law(
    ph.CriscioneType(),
    # W = a cosh(b g3), g3 = 2 ln(l_theta) + ln(l_z)
    lambda l1, l2, l3, *, a, b: a * mp.cosh(b * (2 * mp.log(l2) + mp.log(l3))),
    (
        ({"a": 3.0, "b": 4.0}, "an artery"),
        ({"a": 3.0, "b": 0.0}, "no stress at all"),
        ({"a": 3.0, "b": 1e-12}, "almost no stress"),
        ({"a": 3.0, "b": 20.0}, "end of the prior"),
        ({"a": 3.0, "b": -20.0}, "end of the prior; the energy is even"),
    ),
)


def fung_orthotropic_energy(l1, l2, l3, *, c, a1, a2, a4):
    """``W = c/2 (e^Q - 1)``, ``Q = a1 Et^2 + a2 Ez^2 + 2 a4 Et Ez``, ``E = (l^2 - 1)/2``."""
    hoop, axial = (l2**2 - 1) / 2, (l3**2 - 1) / 2
    return c / 2 * (mp.exp(a1 * hoop**2 + a2 * axial**2 + 2 * a4 * hoop * axial) - 1)


LAWS["FungOrthotropic"] = Law(
    ph.FungOrthotropic(),
    fung_orthotropic_energy,
    (
        ({"c": 25.0, "a1": 1.0, "a2": 0.5, "a4": 0.1}, "an artery"),
        ({"c": 10.0, "a1": 0.3, "a2": 2.0, "a4": 0.7}, "stiffer along, much shared"),
    ),
)


def holzapfel_energy(l1, l2, l3, *, c, k1, k2, beta):
    """``W = c/2 (I1 - 3) + k1/(2 k2) sum over +-beta of {exp[k2 (I4 - 1)^2] - 1}``."""
    families = (fibres(fibre_strain(l2, l3, angle), k1, k2) for angle in (beta, -beta))
    return c / 2 * first(l1, l2, l3) + sum(families)


LAWS["HolzapfelGasserOgden"] = Law(
    ph.HolzapfelGasserOgden(),
    holzapfel_energy,
    (
        (
            {"c": 3.0, "k1": 2.3632, "k2": 0.8393, "beta": 29.0},
            "media of a rabbit's carotid artery, of the source",
        ),
        (
            {"c": 3.0, "k1": 5.0, "k2": 1e-12, "beta": 0.0},
            "around the tube, slack below a hoop stretch of 1; the energy reads 0/0 at k2 = 0",
        ),
        ({"c": 3.0, "k1": 5.0, "k2": 1.0, "beta": 90.0}, "along the tube: without effect"),
    ),
    switches=lambda hoop, axial, *, c, k1, k2, beta: (fibre_strain(hoop, axial, beta),),
)


def dispersed_strain(hoop, axial, kappa, beta):
    """``kappa (I1 - 3) + (1 - 3 kappa) (I4 - 1)``."""
    everywhere = first(1 / (hoop * axial), hoop, axial)
    return kappa * everywhere + (1 - 3 * kappa) * fibre_strain(hoop, axial, beta)


def gasser_energy(l1, l2, l3, *, c, k1, k2, kappa, beta):
    """``W = c/2 (I1 - 3) + k1/(2 k2) sum over +-beta of {exp[k2 E^2] - 1}``, of that strain."""
    strains = (
        kappa * first(l1, l2, l3) + (1 - 3 * kappa) * fibre_strain(l2, l3, angle)
        for angle in (beta, -beta)
    )
    return c / 2 * first(l1, l2, l3) + sum(fibres(strain, k1, k2) for strain in strains)


LAWS["GasserOgdenHolzapfel"] = Law(
    ph.GasserOgdenHolzapfel(),
    gasser_energy,
    (
        ({"c": 3.0, "k1": 4.0, "k2": 0.5, "kappa": 0.1, "beta": 29.0}, "an artery"),
        (
            {"c": 3.0, "k1": 4.0, "k2": 0.5, "kappa": 1 / 3, "beta": 29.0},
            "isotropic, never slack: the two places where others slacken are one",
        ),
        (
            {"c": 7.64, "k1": 20.0, "k2": 0.5, "kappa": 0.226, "beta": 60.0},
            "a strain that inflation first lowers and then raises: slack between two places",
        ),
    ),
    switches=lambda hoop, axial, *, c, k1, k2, kappa, beta: (
        dispersed_strain(hoop, axial, kappa, beta),
    ),
)


def four_fiber_energy(
    l1, l2, l3, *, c, k1_axial, k2_axial, k1_hoop, k2_hoop, k1_diagonal, k2_diagonal, beta
):
    """``W = c/2 (I1 - 3) + sum over 90, 0, beta, -beta of k1/(2 k2) {exp[k2 (I4 - 1)^2] - 1}``."""
    families = (
        (90, k1_axial, k2_axial),
        (0, k1_hoop, k2_hoop),
        (beta, k1_diagonal, k2_diagonal),
        (-beta, k1_diagonal, k2_diagonal),
    )
    total = sum(fibres(fibre_strain(l2, l3, angle), k1, k2) for angle, k1, k2 in families)
    return c / 2 * first(l1, l2, l3) + total


LAWS["FourFiber"] = Law(
    ph.FourFiber(),
    four_fiber_energy,
    (
        (
            {"c": 10.0, "k1_axial": 8.0, "k2_axial": 0.05, "k1_hoop": 6.0, "k2_hoop": 0.1}
            | {"k1_diagonal": 1.0, "k2_diagonal": 0.5, "beta": 40.0},
            "an artery",
        ),
        (
            {"c": 10.0, "k1_axial": 0.0, "k2_axial": 1.0, "k1_hoop": 6.0, "k2_hoop": 1e-12}
            | {"k1_diagonal": 3.0, "k2_diagonal": 1e-12, "beta": 0.0},
            "all fibres around the tube: they slacken in one place",
        ),
    ),
    switches=lambda hoop, axial, *, beta, **others: (
        fibre_strain(hoop, axial, 0),
        fibre_strain(hoop, axial, beta),
    ),
)


def holzapfel_ogden_energy(l1, l2, l3, *, a, b, a_fibre, b_fibre, a_cross, b_cross):
    """``a/(2 b) {exp[b (I1 - 3)] - 1}``, and two terms ``a/(2 b) {exp[b (I4 - 1)^2] - 1}``."""
    matrix = a / (2 * b) * (mp.exp(b * first(l1, l2, l3)) - 1)
    families = fibres(l2**2 - 1, a_fibre, b_fibre) + fibres(l3**2 - 1, a_cross, b_cross)
    return matrix + families


LAWS["HolzapfelOgden"] = Law(
    ph.HolzapfelOgden(),
    holzapfel_ogden_energy,
    (
        (
            {"a": 2.28, "b": 0.5, "a_fibre": 1.685, "b_fibre": 0.4}
            | {"a_cross": 0.9, "b_cross": 0.3},
            "moduli of a heart, of the source; its exponents are for stretches below 1.2",
        ),
        (
            {"a": 2.28, "b": 1e-12, "a_fibre": 1.685, "b_fibre": 1e-12}
            | {"a_cross": 0.0, "b_cross": 1.0},
            "fibres along x alone; the energy reads 0/0 at b = 0",
        ),
    ),
    switches=lambda hoop, axial, **parameters: (fibre_strain(hoop, axial, 0),),
)


@dataclass(frozen=True)
class Tube:
    """Geometry of an inflated tube (mm, degrees) and the reason why it is in the table."""

    name: str
    internal_radius: float
    inner_radius: float
    outer_radius: float
    axial_stretch: float
    opening_angle: float
    why: str
    hard: bool = False  # taken with every set of parameters, not only with the ordinary one


TUBES = (
    Tube("at rest", 7.0, 7.0, 9.0, 1.0, 0.0, "zero pressure exactly"),
    Tube("just inflated", 7.0 * (1 + 1e-9), 7.0, 9.0, 1.0, 0.0, "0/0 in many forms", hard=True),
    Tube("just deflated", 7.0 * (1 - 1e-9), 7.0, 9.0, 1.0, 0.0, "0/0 from below", hard=True),
    Tube("inflated", 8.4, 7.0, 9.0, 1.0, 0.0, "a sheep aorta at work, a = 1.2 A"),
    Tube("inflated far", 11.9, 7.0, 9.0, 1.0, 0.0, "a = 1.7 A"),
    Tube("deflated", 5.6, 7.0, 9.0, 1.0, 0.0, "a = 0.8 A, pressure outside"),
    Tube("deflated far", 4.2, 7.0, 17.5, 1.0, 0.0, "a = 0.6 A in the thickest wall", hard=True),
    Tube("thin", 0.52, 0.4, 0.42, 1.0, 0.0, "B/A = 1.05, a mouse's vessel"),
    Tube("thick", 1.7, 1.0, 2.5, 1.0, 0.0, "B/A = 2.5, a = 1.7 A", hard=True),
    Tube("stretched", 0.5, 0.4, 0.5, 1.9, 0.0, "axial stretch 1.9"),
    Tube("stretched, unpressurised", 7.0, 7.0, 9.0, 1.3, 0.0, "axial stretch at a = A"),
    Tube("shortened", 8.0, 7.0, 9.0, 0.8, 0.0, "axial stretch 0.8"),
    Tube("shortened, deflated", 6.0, 7.0, 12.0, 0.8, 0.0, "axial stretch 0.8 with a < A"),
    Tube("opened", 0.36, 0.4, 0.55, 1.0, 60.0, "opening angle 60 degrees with a < A"),
    Tube("opened wide", 3.2, 3.0, 4.0, 1.0, 160.0, "opening angle 160 degrees"),
    Tube("in vivo", 0.48, 0.4, 0.52, 1.5, 90.0, "axial stretch and residual stress", hard=True),
    Tube("extreme", 1.7, 1.0, 2.5, 1.9, 160.0, "every end at once", hard=True),
    Tube("extreme, shortened", 1.7, 1.0, 2.5, 0.8, 160.0, "every end, the other axial one"),
    Tube("slackening", 0.6, 1.0, 2.5, 1.0, 60.0, "hoop stretch 1 within the wall", hard=True),
    Tube("slackening, stretched", 0.6, 1.0, 2.5, 1.9, 160.0, "the same, stretched", hard=True),
    Tube("slackening, shortened", 0.7, 1.0, 2.0, 0.9, 60.0, "axial stretch 0.9", hard=True),
)


# Exact answers by problem, quantity and derivative.
_answers: dict[tuple, float] = {}


@dataclass(frozen=True)
class Problem:
    """One tube of one material; the exact answer comes from `oracles`."""

    name: str
    law: str
    tube: str
    parameters: Parameters
    internal_radius: float
    inner_radius: float
    outer_radius: float
    axial_stretch: float
    opening_angle: float  # degrees

    @property
    def ordinary(self) -> bool:
        """Return True if the parameters are the first set of the law."""
        return self.parameters == LAWS[self.law].parameters[0][0]

    @property
    def inputs(self) -> dict[str, float]:
        """Inputs of the integrals in their order, the angle in radians, the entries last."""
        geometry = {name: getattr(self, name) for name in oracles.GEOMETRY}
        return {
            **geometry,
            "opening_angle": radians(self.opening_angle),
            **entries(self.parameters),
        }

    def exact(self, *by: str, **settings) -> float:
        """Return the pressure, or its derivative by the named inputs; each is computed once."""
        key = (self.name, by, *settings.items())
        if key not in _answers:
            _answers[key] = LAWS[self.law].exact(self.inputs, *by, **settings)
        return _answers[key]


def _problem(law: str, tube: Tube, parameters: Parameters) -> Problem:
    values = ", ".join(f"{name} = {value:g}" for name, value in entries(parameters).items())
    return Problem(
        f"{law}, {values}, {tube.name}",
        law,
        tube.name,
        parameters,
        *(getattr(tube, name) for name in oracles.GEOMETRY),
    )


PROBLEMS = tuple(
    _problem(name, tube, parameters)
    for name, law in LAWS.items()
    for i, (parameters, _) in enumerate(law.parameters)
    for tube in TUBES
    if i == 0 or tube.hard
)
