"""Orthotropic strain energies, whose axes are those of the tube."""

from abc import abstractmethod
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
import pytensor.tensor as pt
from pytensor.tensor.variable import TensorVariable as Tensor

from pymc_hyperelastic.mechanics.strain_energy.base import (
    Parameter,
    StrainEnergy,
    first_invariant_excess,
    half_difference,
)
from pymc_hyperelastic.mechanics.tube import first_invariant

__all__ = [
    "CriscioneType",
    "FourFiber",
    "FungOrthotropic",
    "GasserOgdenHolzapfel",
    "HolzapfelGasserOgden",
]

_MATRIX = Parameter(
    "c", "c", "kPa", (0.0, 100.0), "shear modulus of the matrix; 3 to 50 in arteries"
)
_FIBRES = Parameter("k1", "k_1", "kPa", (0.0, 500.0), "modulus of the fibres; 0.5 to 1000")


def _stiffening(name: str, symbol: str, of_what: str) -> Parameter:
    """A stiffening number; of fitted arteries they are from a hundredth to some tens."""
    words = f"stiffening of {of_what}; 0.01 to 100"
    return Parameter(name, symbol, "", (0.0, 50.0), words, typical=(1.0, 2.0))


_STIFFENING = _stiffening("k2", "k_2", "the fibres")


def _fibres(kind: str, sign: str) -> tuple[Parameter, Parameter]:
    """Modulus and stiffening number of one kind of fibres among several."""
    words = f"modulus of the {kind} fibres"
    return (
        Parameter(f"k1_{kind}", f"k_1^{sign}", "kPa", (0.0, 500.0), words),
        _stiffening(f"k2_{kind}", f"k_2^{sign}", f"the {kind} fibres"),
    )


_ANGLE = Parameter(
    "beta",
    r"\beta",
    "deg",
    (0.0, 90.0),
    "angle of the fibres from the circumferential direction",
    scale="logit",
)

_RADIAN = np.pi / 180
_AXIAL = 90.0
# A logarithm of a hoop stretch that no wall reaches.
_NEVER = 10.0


class CriscioneType(StrainEnergy):
    r"""Criscione-type energy of the one logarithmic strain attribute that inflation changes.

    .. math:: W = a \cosh(b γ_3), \qquad γ_3 = 2 \ln λ_θ + \ln λ_z

    ``W = a`` at rest, which no stress feels. The energy says nothing about axial force. It is even
    in ``b``, so posteriors under a prior on both signs have two mirrored modes. Its pressure is
    that of :class:`Ogden` with ``b = α/2`` and ``a = (8μ/α²) cosh(½ α ln λz)``: the two evidences
    can differ only through the prior.

    Source: Doraiswamy and Srinivasa (see :class:`PowerLawNeoHookean`), after Criscione,
    J. Elasticity 77 (2004) 57-81.

    See Also
    --------
    criscione_model

    Examples
    --------
    Pressures (kPa) at two internal radii (mm) of a tube:

    >>> import pymc_hyperelastic as ph
    >>> pressure = ph.inflation_pressure(
    ...     ph.CriscioneType(), [7.5, 8.5], inner_radius=7.0, outer_radius=9.0, a=10.0, b=4.0
    ... )
    >>> pressure.eval().round(3)
    array([ 8.174, 24.028])
    """

    parameters = (
        Parameter(
            "a",
            "a",
            "kPa",
            (0.0, 100.0),
            "energy scale; the small-strain modulus against inflation is proportional to a b²",
        ),
        Parameter(
            "b",
            "b",
            "",
            (-20.0, 20.0),
            "strain stiffening, either sign; half of Ogden's exponent",
            scale="log",
        ),
    )

    def energy(self, radial: Any, hoop: Any, axial: Any, *, a: Any, b: Any) -> Tensor:
        """Strain energy in kPa."""
        return a * pt.cosh(b * (2 * pt.log(hoop) + pt.log(axial)))

    def stress_difference(self, log_hoop: Tensor, log_axial: Tensor, *, a: Any, b: Any) -> Tensor:
        """``2 a b sinh(b γ₃)``."""
        gamma = 2 * log_hoop + log_axial
        return 2 * a * b * pt.sinh(b * gamma)

    def axial_stress_difference(
        self, log_hoop: Tensor, log_axial: Tensor, *, a: Any, b: Any
    ) -> Tensor:
        """``a b sinh(b γ₃)``."""
        return self.stress_difference(log_hoop, log_axial, a=a, b=b) / 2


class FungOrthotropic(StrainEnergy):
    r"""Fung's exponential of the hoop and the axial strain.

    .. math:: W = \frac{c}{2} \left(e^Q - 1\right), \qquad
        Q = a_1 E_θ^2 + a_2 E_z^2 + 2 a_4 E_θ E_z, \qquad E_i = \tfrac12 (λ_i^2 - 1)

    Stress grows with strain in every direction only if ``a4² < a1 a2``.

    Source: Y. C. Fung, K. Fronek and P. Patitucci, Pseudoelasticity of arteries and the choice of
    its mathematical expression, American Journal of Physiology 237 (1979) H620-H631.

    See Also
    --------
    Demiray, HolzapfelGasserOgden

    Examples
    --------
    Pressures (kPa) at two internal radii (mm) of a tube:

    >>> import pymc_hyperelastic as ph
    >>> pressure = ph.inflation_pressure(
    ...     ph.FungOrthotropic(),
    ...     [7.5, 8.5],  # mm
    ...     inner_radius=7.0,
    ...     outer_radius=9.0,
    ...     c=20.0,
    ...     a1=2.0,
    ...     a2=2.0,
    ...     a4=1.0,
    ... )
    >>> pressure.eval().round(3)
    array([0.589, 2.019])
    """

    parameters = (
        Parameter("c", "c", "kPa", (0.0, 200.0), "modulus; 10 to 50 in rabbit arteries"),
        Parameter("a1", "a_1", "", (0.0, 20.0), "stiffening against hoop strain; about 1"),
        Parameter("a2", "a_2", "", (0.0, 20.0), "stiffening against axial strain; about 1"),
        Parameter("a4", "a_4", "", (0.0, 10.0), "what the two strains share; about 0.1"),
    )

    def energy(
        self, radial: Any, hoop: Any, axial: Any, *, c: Any, a1: Any, a2: Any, a4: Any
    ) -> Tensor:
        """Strain energy in kPa."""
        strain = (hoop**2 - 1) / 2, (axial**2 - 1) / 2
        return c / 2 * pt.expm1(_quadratic(*strain, a1, a2, a4))

    def stress_difference(
        self, log_hoop: Tensor, log_axial: Tensor, *, c: Any, a1: Any, a2: Any, a4: Any
    ) -> Tensor:
        """``c e^Q (a1 Eθ + a4 Ez) λθ²``."""
        hoop, axial = pt.expm1(2 * log_hoop) / 2, pt.expm1(2 * log_axial) / 2
        growth = c * pt.exp(_quadratic(hoop, axial, a1, a2, a4) + 2 * log_hoop)
        return growth * (a1 * hoop + a4 * axial)

    def axial_stress_difference(
        self, log_hoop: Tensor, log_axial: Tensor, *, a1: Any, a2: Any, **others: Any
    ) -> Tensor:
        """``c e^Q (a2 Ez + a4 Eθ) λz²``: hoop and axial direction change places."""
        return self.stress_difference(log_axial, log_hoop, a1=a2, a2=a1, **others)


def _quadratic(hoop: Any, axial: Any, a1: Any, a2: Any, a4: Any) -> Any:
    """``a1 Eθ² + a2 Ez² + 2 a4 Eθ Ez``."""
    return a1 * hoop**2 + a2 * axial**2 + 2 * a4 * hoop * axial


class _Family(NamedTuple):
    """Fibre families of one kind: how many, their law, and where they run."""

    number: int
    k1: Any
    k2: Any
    angle: Any
    """Degrees from the circumferential direction."""
    dispersion: Any = None
    """``κ``; None for fibres that are perfectly aligned."""


class _FibreReinforced(StrainEnergy):
    r"""Families of fibres in a neo-Hookean matrix of modulus ``c``.

    .. math:: W = \frac{c}{2} (I_1 - 3)
        + \sum_{\text{families}} \frac{k_1}{2 k_2} \left(e^{k_2 \max(E, 0)^2} - 1\right), \qquad
        E = κ (I_1 - 3) + (1 - 3κ)(λ_θ^2 \cos^2 β + λ_z^2 \sin^2 β - 1)
    """

    @abstractmethod
    def families(self, **parameters: Any) -> Sequence[_Family]:
        """The families, of parameters without ``c``."""

    def energy(self, radial: Any, hoop: Any, axial: Any, *, c: Any, **parameters: Any) -> Tensor:
        """Strain energy in kPa."""
        log_hoop, log_axial = pt.log(hoop), pt.log(axial)
        total = c / 2 * (first_invariant(radial, hoop, axial) - 3)
        for family in self.families(**parameters):
            strain = pt.maximum(_fibre_strain(family, log_hoop, log_axial), 0.0)
            total += family.number * family.k1 / (2 * family.k2) * pt.expm1(family.k2 * strain**2)
        return total

    def stress_difference(
        self, log_hoop: Tensor, log_axial: Tensor, *, c: Any, **parameters: Any
    ) -> Tensor:
        """That of the matrix, and for each family ``k1 E exp(k2 E²) ∂E/∂ln λθ``."""
        stress = 2 * c * half_difference(log_hoop, log_axial)
        for family in self.families(**parameters):
            along = _squared_cosine(family.angle) * pt.exp(2 * log_hoop)
            stress += _fibre_stress(family, log_hoop, log_axial, along, (log_hoop, log_axial))
        return stress

    def axial_stress_difference(
        self, log_hoop: Tensor, log_axial: Tensor, *, c: Any, **parameters: Any
    ) -> Tensor:
        """That of the matrix, and for each family ``k1 E exp(k2 E²) ∂E/∂ln λz``."""
        stress = 2 * c * half_difference(log_axial, log_hoop)
        for family in self.families(**parameters):
            along = _squared_sine(family.angle) * pt.exp(2 * log_axial)
            stress += _fibre_stress(family, log_hoop, log_axial, along, (log_axial, log_hoop))
        return stress

    def kinks(self, log_axial: Tensor, *, c: Any, **parameters: Any) -> list[Tensor]:
        """Where families slacken: ``E = 0``, a quadratic equation in ``λθ²``."""
        axial = pt.exp(2 * log_axial)
        logs = []
        for family in self.families(**parameters):
            if family.angle is _AXIAL:
                continue  # inflation does not stretch it
            cosine, sine = _squared_cosine(family.angle), _squared_sine(family.angle)
            if family.dispersion is None:
                squares = [(1 - axial * sine) / cosine]
            else:
                kappa = family.dispersion
                quadratic = kappa + (1 - 3 * kappa) * cosine
                linear = kappa * (3 - axial) + (1 - 3 * kappa) * (1 - axial * sine)
                discriminant = linear**2 - 4 * quadratic * kappa / axial
                real = (discriminant > 0) & (linear > 0)
                double = linear + pt.sqrt(pt.where(real, discriminant, 1.0))
                squares = [
                    pt.where(real, double / (2 * quadratic), 0.0),
                    pt.where(real, 2 * kappa / (axial * double), 0.0),
                ]
            for square in squares:
                possible = (square > 0) & (square < np.exp(2 * _NEVER))
                logs.append(pt.where(possible, pt.log(pt.where(possible, square, 1.0)) / 2, _NEVER))
        return logs


class HolzapfelGasserOgden(_FibreReinforced):
    r"""Two families of collagen fibres, wound around the tube, in a neo-Hookean matrix.

    .. math:: W = \frac{c}{2} (I_1 - 3) + \frac{k_1}{k_2} \left(e^{k_2 E^2} - 1\right), \qquad
        E = \max(λ_θ^2 \cos^2 β + λ_z^2 \sin^2 β - 1, 0)

    The families run at ``±β`` (degrees) from the circumferential direction and are stretched alike:
    the printed sum over both, of ``k1/(2 k2)`` each, is written once. Fibres carry load in tension
    only. Stress is continuous where they slacken; the stiffness of the material has a jump there,
    at which the wall is divided, so that integrals and gradients stay exact.

    Source: G. A. Holzapfel, T. C. Gasser and R. W. Ogden, A new constitutive framework for arterial
    wall mechanics and a comparative study of material models, Journal of Elasticity 61 (2000) 1-48.

    See Also
    --------
    GasserOgdenHolzapfel, FourFiber

    Examples
    --------
    Pressures (kPa) at two internal radii (mm) of a tube:

    >>> import pymc_hyperelastic as ph
    >>> pressure = ph.inflation_pressure(
    ...     ph.HolzapfelGasserOgden(),
    ...     [7.5, 8.5],  # mm
    ...     inner_radius=7.0,
    ...     outer_radius=9.0,
    ...     c=10.0,
    ...     k1=20.0,
    ...     k2=1.0,
    ...     beta=30.0,
    ... )
    >>> pressure.eval().round(3)
    array([1.821, 5.759])
    """

    parameters = (_MATRIX, _FIBRES, _STIFFENING, _ANGLE)

    def families(self, *, k1: Any, k2: Any, beta: Any) -> Sequence[_Family]:
        """Two, at ``±β``."""
        return [_Family(2, k1, k2, beta)]


class GasserOgdenHolzapfel(_FibreReinforced):
    r"""Two families of dispersed collagen fibres in a neo-Hookean matrix.

    .. math:: W = \frac{c}{2} (I_1 - 3) + \frac{k_1}{k_2} \left(e^{k_2 E^2} - 1\right), \qquad
        E = \max\left(κ (I_1 - 3) + (1 - 3κ)(λ_θ^2 \cos^2 β + λ_z^2 \sin^2 β - 1), 0\right)

    With ``κ = 0`` fibres are aligned, as in :class:`HolzapfelGasserOgden`; with ``κ = 1/3`` they
    run everywhere alike. A family is slack where its mean strain ``E`` is negative: the printed
    condition, that of the mean direction, would make stress jump there.

    Source: T. C. Gasser, R. W. Ogden and G. A. Holzapfel, Hyperelastic modelling of arterial layers
    with distributed collagen fibre orientations, Journal of the Royal Society Interface 3 (2006)
    15-35.

    See Also
    --------
    HolzapfelGasserOgden

    Examples
    --------
    Pressures (kPa) at two internal radii (mm) of a tube:

    >>> import pymc_hyperelastic as ph
    >>> pressure = ph.inflation_pressure(
    ...     ph.GasserOgdenHolzapfel(),
    ...     [7.5, 8.5],  # mm
    ...     inner_radius=7.0,
    ...     outer_radius=9.0,
    ...     c=10.0,
    ...     k1=20.0,
    ...     k2=1.0,
    ...     kappa=0.1,
    ...     beta=30.0,
    ... )
    >>> pressure.eval().round(3)
    array([1.18 , 3.655])
    """

    parameters = (
        _MATRIX,
        _FIBRES,
        _STIFFENING,
        Parameter(
            "kappa",
            r"\kappa",
            "",
            (0.0, 1 / 3),
            "dispersion: 0 aligned, 1/3 everywhere",
            scale="logit",
        ),
        _ANGLE,
    )

    def families(self, *, k1: Any, k2: Any, kappa: Any, beta: Any) -> Sequence[_Family]:
        """Two, at ``±β``."""
        return [_Family(2, k1, k2, beta, kappa)]


class FourFiber(_FibreReinforced):
    r"""Four families of fibres: axial, circumferential, and two diagonal ones.

    .. math:: W = \frac{c}{2} (I_1 - 3)
        + \sum_{i=1}^4 \frac{k_1^i}{2 k_2^i} \left(e^{k_2^i E_i^2} - 1\right), \qquad
        E_i = \max(λ_θ^2 \cos^2 β_i + λ_z^2 \sin^2 β_i - 1, 0)

    with ``βi`` of 90°, 0 and ``±β``; the diagonal families are alike. Fibres carry load in tension
    only. Where the source prints ``c1/(4 c2)``, ``c1 = 2 k1``.

    In some vessels, the mouse's ascending aorta among them, fits leave hoop fibres without a
    modulus. Nothing is then told of their stiffening, and little of how small their modulus is:
    without them the wall is stated better, and its posterior found several times as fast.

    Source: S. Baek, R. L. Gleason, K. R. Rajagopal and J. D. Humphrey, Theory of small on large:
    potential utility in computations of fluid-solid interactions in arteries, Computer Methods in
    Applied Mechanics and Engineering 196 (2007) 3070-3078.

    Parameters
    ----------
    hoop_fibres : bool, default True
        Whether there are circumferential fibres; without them ``k1_hoop`` and ``k2_hoop`` are no
        parameters.

    Raises
    ------
    ValueError
        If `hoop_fibres` is neither True nor False.

    See Also
    --------
    HolzapfelGasserOgden

    Examples
    --------
    Pressures (kPa) at two internal radii (mm) of a tube:

    >>> import pymc_hyperelastic as ph
    >>> pressure = ph.inflation_pressure(
    ...     ph.FourFiber(),
    ...     [7.5, 8.5],  # mm
    ...     inner_radius=7.0,
    ...     outer_radius=9.0,
    ...     c=10.0,
    ...     k1_axial=5.0,
    ...     k2_axial=0.5,
    ...     k1_hoop=5.0,
    ...     k2_hoop=0.5,
    ...     k1_diagonal=10.0,
    ...     k2_diagonal=0.5,
    ...     beta=40.0,
    ... )
    >>> pressure.eval().round(3)
    array([1.193, 3.508])

    Without hoop fibres:

    >>> ph.FourFiber(hoop_fibres=False).parameter_names
    ('c', 'k1_axial', 'k2_axial', 'k1_diagonal', 'k2_diagonal', 'beta')
    """

    def __init__(self, hoop_fibres: bool = True) -> None:
        if not isinstance(hoop_fibres, bool):
            raise ValueError(f"hoop_fibres is {hoop_fibres!r}; expected True or False")
        self.hoop_fibres = hoop_fibres

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """Those of the matrix and of all families."""
        return (
            _MATRIX,
            *_fibres("axial", "z"),
            *(_fibres("hoop", r"\theta") if self.hoop_fibres else ()),
            *_fibres("diagonal", "d"),
            _ANGLE,
        )

    def families(
        self,
        *,
        k1_axial: Any,
        k2_axial: Any,
        k1_hoop: Any = None,
        k2_hoop: Any = None,
        k1_diagonal: Any,
        k2_diagonal: Any,
        beta: Any,
    ) -> Sequence[_Family]:
        """Four, the diagonal ones at ``±β``; or three."""
        hoop = [_Family(1, k1_hoop, k2_hoop, 0.0)] if self.hoop_fibres else []
        return [
            _Family(1, k1_axial, k2_axial, _AXIAL),
            *hoop,
            _Family(2, k1_diagonal, k2_diagonal, beta),
        ]


def _squared_cosine(angle: Any) -> Tensor:
    return pt.cos(angle * _RADIAN) ** 2


def _squared_sine(angle: Any) -> Tensor:
    return pt.sin(angle * _RADIAN) ** 2


def _fibre_strain(family: _Family, log_hoop: Tensor, log_axial: Tensor) -> Tensor:
    """``E``, with all its digits near zero."""
    aligned = _squared_cosine(family.angle) * pt.expm1(2 * log_hoop)
    aligned += _squared_sine(family.angle) * pt.expm1(2 * log_axial)
    if family.dispersion is None:
        return aligned
    dispersed = first_invariant_excess(log_hoop, log_axial)
    return family.dispersion * dispersed + (1 - 3 * family.dispersion) * aligned


def _fibre_stress(
    family: _Family,
    log_hoop: Tensor,
    log_axial: Tensor,
    along: Tensor,
    stretched: tuple[Tensor, Tensor],
) -> Tensor:
    """``k1 E exp(k2 E²) ∂E``, where ``2 along`` is what aligned fibres have for ``∂E``."""
    strain = pt.maximum(_fibre_strain(family, log_hoop, log_axial), 0.0)
    if family.dispersion is not None:
        kappa = family.dispersion
        along = 2 * kappa * half_difference(*stretched) + (1 - 3 * kappa) * along
    return 2 * family.number * family.k1 * strain * pt.exp(family.k2 * strain**2) * along
