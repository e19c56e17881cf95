"""Tubes whose answers others have published, each with its source.

A case is a tube; its readings are what the source says of it. Pressure is in the unit of the
moduli, length in that of the radii, whichever the source has. A reading carries the half unit of
the last printed digit of the radius and of the value, or what the source says of its own accuracy.
Where a source has printed curves only, no reading is made up: the case is in the table with its
parameters, and its answers are computed in another way.
"""

from collections.abc import Mapping
from dataclasses import dataclass


@dataclass(frozen=True)
class Layer:
    """A layer of the wall: name of its law, thickness, parameters."""

    law: str
    thickness: float
    parameters: Mapping[str, float | tuple[float, ...]]


@dataclass(frozen=True)
class Reading:
    """A published number at one internal radius."""

    quantity: str
    """``pressure``, or a stress at the inner or outer surface: see `tests.test_published`."""
    internal_radius: float
    value: float
    radius_error: float = 0.0
    value_error: float = 0.0
    why: str = ""


@dataclass(frozen=True)
class Published:
    """A tube, who published it, and what was published."""

    name: str
    source: str
    layers: tuple[Layer, ...]
    inner_radius: float
    axial_stretch: float = 1.0
    opening_angle: float = 0.0
    """Degrees."""
    readings: tuple[Reading, ...] = ()


# --- thick cylinders in plane strain -------------------------------------------------------------

_SOLIDS4FOAM = (
    "solids4foam, tutorial hyperelasticity/cylindricalPressureVessel, tables of the analytical "
    "solution analytical_10e6-Pa and analytical_100e6-Pa, github.com/solids4foam/solids4foam; "
    "E = 1000 MPa and ν = 1/2, so μ = E/3; m and Pa"
)
_SSNV112 = (
    "code_aster, Manuel de validation V6.04.112, SSNV112: hollow cylinder, incompressible, large "
    "deformations, reference values of ssnv112a.comm; E = 200000 MPa and ν = 1/2, so μ = E/3; m "
    "and MPa"
)
_VM56 = (
    "ANSYS Mechanical APDL Verification Manual, VM56: hyperelastic thick cylinder under internal "
    "pressure, after J. T. Oden, Finite elements of nonlinear continua, McGraw-Hill 1972, pp. "
    "325-331; in and psi"
)

CYLINDERS = (
    Published(
        "neo-Hookean cylinder of solids4foam",
        _SOLIDS4FOAM,
        (Layer("NeoHookean", 8.0, {"mu": 1e9 / 3}),),
        inner_radius=8.0,
        readings=(
            Reading("pressure", 8.1645428945, 1e7, 5e-11),
            Reading("hoop stress inside", 8.1645428945, 1.715310133e7, 5e-11, 5e-3),
            Reading("axial stress inside", 8.1645428945, 3.300181145e6, 5e-11, 5e-4),
            Reading("pressure", 10.252601910, 1e8, 5e-10),
            Reading("hoop stress inside", 10.252601910, 2.445276753e8, 5e-10, 5e-2),
            Reading("axial stress inside", 10.252601910, 3.038264452e7, 5e-10, 5e-3),
            Reading("hoop stress outside", 10.252601910, 9.966399596e7, 5e-10, 5e-3),
            Reading("axial stress outside", 10.252601910, 4.612773826e7, 5e-10, 5e-3),
        ),
    ),
    Published(
        "neo-Hookean cylinder of code_aster",
        _SSNV112,
        (Layer("NeoHookean", 0.1, {"mu": 200000 / 3}),),
        inner_radius=0.1,
        readings=(
            Reading(
                "pressure",
                0.10006,
                59.9955,
                value_error=0.02 * 59.9955,
                why="the manual allows itself 2 %; the exact pressure is 59.9505, and the printed "
                "number misses it by 0.07 % where the printed stress difference does not",
            ),
            Reading("stress difference inside", 0.10006, 159.9521, value_error=5e-5),
            Reading("hoop stress outside", 0.10006, 2 * 20.003, value_error=2 * 5e-4),
        ),
    ),
    Published(
        "Mooney-Rivlin cylinder of Oden",
        _VM56,
        (Layer("MooneyRivlin", 11.625, {"c10": 80.0, "c01": 20.0}),),
        inner_radius=7.0,
        readings=(
            Reading(
                "pressure",
                7.0 + 7.18,
                150.0,
                radius_error=5e-4 * 7.18,
                why="the manual states the displacement 7.180 and agreement with it as a ratio of "
                "three decimals, 1.000; the exact displacement is 7.1819",
            ),
        ),
    ),
)

# --- the carotid artery of Holzapfel, Gasser and Ogden -------------------------------------------

_HGO = (
    "G. A. Holzapfel, T. C. Gasser and R. W. Ogden, A new constitutive framework for arterial wall "
    "mechanics and a comparative study of material models, Journal of Elasticity 61 (2000) 1-48, "
    "section 5; mm and kPa. Pressure, axial force and stresses are published as curves only"
)
MEDIA = Layer("HolzapfelGasserOgden", 0.26, {"c": 3.0, "k1": 2.3632, "k2": 0.8393, "beta": 29.0})
ADVENTITIA = Layer(
    "HolzapfelGasserOgden", 0.13, {"c": 0.3, "k1": 0.5620, "k2": 0.7112, "beta": 62.0}
)
PHYSIOLOGICAL_PRESSURE = 13.33
"""kPa, at the axial stretch 1.7."""

CAROTID = tuple(
    Published(
        f"carotid artery, opening angle {angle:g}, axial stretch {stretch}",
        _HGO,
        (MEDIA, ADVENTITIA),
        inner_radius=radius,
        axial_stretch=stretch,
        opening_angle=angle,
    )
    for angle, radius in ((160.0, 1.43), (0.0, 0.71))
    for stretch in (1.5, 1.7, 1.9)
)
"""With residual stress, and without: the same artery taken for free of stress when it is closed."""

CAROTID_DIGITS = {
    # (opening angle, axial stretch): internal radius (mm) and axial force (mN) at 13.33 kPa
    (160.0, 1.5): (1.3126427057, -23.440438607),
    (160.0, 1.7): (1.2743468236, 16.666262936),
    (160.0, 1.9): (1.2060627459, 191.29000967),
    (0.0, 1.5): (1.2238902925, -19.950865181),
    (0.0, 1.7): (1.1892884524, 13.265021637),
    (0.0, 1.9): (1.1339647564, 155.01332048),
}
"""Not published: digits of the energy integral of `tests.test_published`, for the record."""

# --- Ogden's rubber ------------------------------------------------------------------------------

_OGDEN = (
    "rubber: R. W. Ogden, Proceedings of the Royal Society A 326 (1972) 565-584, three terms, in "
    "kgf/cm²; its tubes: D. M. Haughton and R. W. Ogden, Journal of the Mechanics and Physics of "
    "Solids 27 (1979) 179-212 and 489-512. Pressure and axial force are published as curves only; "
    "a thin and a thick wall are taken here, A = 1"
)
OGDEN_RUBBER = {"mu": (6.3, 0.012, -0.1), "alpha": (1.3, 5.0, -2.0)}

RUBBER_TUBES = tuple(
    Published(
        f"tube of Ogden's rubber, A/B = {ratio}, axial stretch {stretch}",
        _OGDEN,
        (Layer("OgdenSeries", 1 / ratio - 1, OGDEN_RUBBER),),
        inner_radius=1.0,
        axial_stretch=stretch,
    )
    for ratio in (0.85, 0.5)
    for stretch in (1.0, 1.5)
)


# --- pymecht -------------------------------------------------------------------------------------

_PYMECHT = (
    "pymecht 1.1.2 (pypi.org/project/pymecht) with numpy 2.5.5 and scipy 1.18.1: pressure of "
    "TubeInflation.disp_controlled and LayeredTube.disp_controlled; axial force from its "
    "cauchy_stress, 2π ∫ σzz r dr − π a² p by Romberg's rule; all digits are those that "
    "tests/benchmarks/bench_pymecht.py --values prints"
)


@dataclass(frozen=True)
class Computed:
    """A tube that pymecht has inflated: internal radius, pressure and axial force, row by row."""

    tube: Published
    rows: tuple[tuple[float, float, float], ...]


def _aorta(
    law: str, parameters: Mapping[str, float], *rows: tuple[float, float, float]
) -> Computed:
    tube = Published(
        f"{law} tube of pymecht",
        _PYMECHT,
        (Layer(law, 2.0, parameters),),
        inner_radius=7.0,
        axial_stretch=1.2,
        opening_angle=60.0,
    )
    return Computed(tube, rows)


PYMECHT = (
    _aorta(
        "NeoHookean",
        {"mu": 20.0},
        (7.0, 3.09123693607216, 713.413801367985),
        (8.0, 3.79472699168376, 549.285289930613),
        (9.0, 4.20968973091244, 334.397949209678),
    ),
    _aorta(
        "MooneyRivlin",
        {"c10": 8.0, "c01": 2.0},
        (7.0, 3.36326578644651, 750.400751766264),
        (8.0, 4.12866296695193, 666.36695391033),
        (9.0, 4.58014242723273, 556.344635461212),
    ),
    _aorta(
        "Yeoh",
        {"c1": 10.0, "c2": 5.0, "c3": 2.0},
        (7.0, 4.20404168620828, 963.644041856875),
        (8.0, 6.56478442908667, 931.240955698741),
        (9.0, 9.77427900618111, 736.890149861112),
    ),
    _aorta(
        "Gent",
        {"mu": 20.0, "limit": 2.3},
        (7.0, 3.56285733496285, 819.46852073901),
        (8.0, 4.98827153903764, 713.42823287652),
        (9.0, 6.80029453699233, 518.158669115039),
    ),
    _aorta(
        "Demiray",
        {"mu": 20.0, "b": 2.0},
        (7.0, 5.68849044347356, 1295.06092512467),
        (8.0, 11.4645042378012, 1590.38129865403),
        (9.0, 24.5355145177303, 1725.19348927188),
    ),
    _aorta(
        "HolzapfelGasserOgden",
        {"c": 10.0, "k1": 20.0, "k2": 1.5, "beta": 40.0},
        (7.0, 7.23896928767219, 888.774016058691),
        (8.0, 13.8030667080121, 803.409100647387),
        (9.0, 30.2646425618701, -163.097277033086),
    ),
    _aorta(
        "GasserOgdenHolzapfel",
        {"c": 10.0, "k1": 20.0, "k2": 1.5, "kappa": 0.1, "beta": 40.0},
        (7.0, 4.81101431480596, 718.935435269367),
        (8.0, 8.29912531743942, 655.821789599941),
        (9.0, 15.1984416363984, 210.774008433984),
    ),
    _aorta(
        "FourFiber",
        {
            "c": 10.0,
            "k1_axial": 15.0,
            "k2_axial": 0.5,
            "k1_hoop": 12.0,
            "k2_hoop": 0.8,
            "k1_diagonal": 6.0,
            "k2_diagonal": 1.2,
            "beta": 40.0,
        },
        (7.0, 5.48808813214272, 1549.74718899643),
        (8.0, 11.4195268023649, 439.675886680947),
        (9.0, 27.4268046749856, -3600.19560408546),
    ),
    Computed(
        Published(
            "two-layer carotid artery of pymecht",
            _PYMECHT,
            (MEDIA, ADVENTITIA),
            inner_radius=1.43,
            axial_stretch=1.7,
            opening_angle=160.0,
        ),
        (
            (0.8, 1.34626704818922, 22.9104210585059),
            (1.05, 3.37199520678579, 26.8787454168468),
            (1.3, 16.4975560621339, 10.2737812816723),
        ),
    ),
)
