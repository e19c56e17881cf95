"""Isotropic strain energies."""

from abc import abstractmethod
from typing import Any

import numpy as np
import pytensor.tensor as pt
from pytensor.tensor.variable import TensorVariable as Tensor

from pymc_hyperelastic.mechanics.strain_energy.base import (
    Parameter,
    StrainEnergy,
    first_invariant_excess,
    half_difference,
)
from pymc_hyperelastic.mechanics.tube import first_invariant, second_invariant

__all__ = [
    "ArrudaBoyce",
    "Demiray",
    "Gent",
    "MooneyRivlin",
    "NeoHookean",
    "Ogden",
    "OgdenSeries",
    "PowerLawNeoHookean",
    "Yeoh",
]

_MODULUS_RANGE = "; the range spans soft tissue, from a loose vein to a stiffened aorta"


class _Isotropic(StrainEnergy):
    """An energy in which the three stretches play the same part."""

    def axial_stress_difference(
        self, log_hoop: Tensor, log_axial: Tensor, **parameters: Tensor
    ) -> Tensor:
        """``σzz − σrr``: hoop and axial direction change places."""
        return self.stress_difference(log_axial, log_hoop, **parameters)


class _FirstInvariant(_Isotropic):
    """An energy of the first invariant alone, known by its derivative."""

    @abstractmethod
    def derivative(self, excess: Tensor, **parameters: Any) -> Tensor:
        """``dW/dI₁`` in kPa at the excess ``I₁ − 3``."""

    def stress_difference(self, log_hoop: Tensor, log_axial: Tensor, **parameters: Any) -> Tensor:
        r"""``4 e^{−z} sinh γ dW/dI₁`` with ``γ = 2 ln λθ + ln λz``, ``z = ln λz``."""
        excess = first_invariant_excess(log_hoop, log_axial)
        return 4 * half_difference(log_hoop, log_axial) * self.derivative(excess, **parameters)


class NeoHookean(_FirstInvariant):
    r"""Neo-Hookean solid, a network of ideal chains.

    .. math:: W = \frac{μ}{2} (I_1 - 3)

    ``μ`` is the shear modulus.

    Source: L. R. G. Treloar, The elasticity of a network of long-chain molecules II, Transactions
    of the Faraday Society 39 (1943) 241-246.

    See Also
    --------
    PowerLawNeoHookean, MooneyRivlin

    Examples
    --------
    Pressures (kPa) at two internal radii (mm) of a tube:

    >>> import pymc_hyperelastic as ph
    >>> pressure = ph.inflation_pressure(
    ...     ph.NeoHookean(), [7.5, 8.5], inner_radius=7.0, outer_radius=9.0, mu=40.0
    ... )
    >>> pressure.eval().round(3)
    array([1.98 , 4.695])
    """

    parameters = (Parameter("mu", r"\mu", "kPa", (0.0, 200.0), "shear modulus" + _MODULUS_RANGE),)

    def energy(self, radial: Any, hoop: Any, axial: Any, *, mu: Any) -> Tensor:
        """Strain energy in kPa."""
        return mu / 2 * (first_invariant(radial, hoop, axial) - 3)

    def derivative(self, excess: Tensor, *, mu: Any) -> Tensor:
        """``μ/2``."""
        return mu / 2


class MooneyRivlin(_Isotropic):
    r"""Mooney-Rivlin solid, linear in both invariants.

    .. math:: W = c_{10} (I_1 - 3) + c_{01} (I_2 - 3)

    The shear modulus is ``2 (c10 + c01)``.

    Source: R. S. Rivlin, Large elastic deformations of isotropic materials IV, Philosophical
    Transactions of the Royal Society A 241 (1948) 379-397.

    See Also
    --------
    NeoHookean, Yeoh

    Examples
    --------
    Pressures (kPa) at two internal radii (mm) of a tube:

    >>> import pymc_hyperelastic as ph
    >>> pressure = ph.inflation_pressure(
    ...     ph.MooneyRivlin(),
    ...     [7.5, 8.5],  # mm
    ...     inner_radius=7.0,
    ...     outer_radius=9.0,
    ...     c10=10.0,
    ...     c01=5.0,
    ... )
    >>> pressure.eval().round(3)
    array([1.485, 3.521])
    """

    parameters = (
        Parameter("c10", "c_{10}", "kPa", (0.0, 100.0), "half a shear modulus" + _MODULUS_RANGE),
        Parameter(
            "c01",
            "c_{01}",
            "kPa",
            (0.0, 100.0),
            "half a shear modulus, of the second invariant; a tenth of c10 in rubber",
        ),
    )

    def energy(self, radial: Any, hoop: Any, axial: Any, *, c10: Any, c01: Any) -> Tensor:
        """Strain energy in kPa."""
        first = first_invariant(radial, hoop, axial) - 3
        return c10 * first + c01 * (second_invariant(radial, hoop, axial) - 3)

    def stress_difference(
        self, log_hoop: Tensor, log_axial: Tensor, *, c10: Any, c01: Any
    ) -> Tensor:
        r"""``4 sinh γ (c10 e^{−z} + c01 e^{z})``, ``γ = 2 ln λθ + ln λz``, ``z = ln λz``."""
        gamma = 2 * log_hoop + log_axial
        return 4 * pt.sinh(gamma) * (c10 * pt.exp(-log_axial) + c01 * pt.exp(log_axial))


class Yeoh(_FirstInvariant):
    r"""Yeoh solid, a cubic of the first invariant.

    .. math:: W = c_1 (I_1 - 3) + c_2 (I_1 - 3)^2 + c_3 (I_1 - 3)^3

    The small-strain shear modulus is ``2 c1``.

    Source: O. H. Yeoh, Some forms of the strain energy function for rubber, Rubber Chemistry and
    Technology 66 (1993) 754-771; for arteries with ``c3 = 0``, M. L. Raghavan and D. A. Vorp,
    Journal of Biomechanics 33 (2000) 475-482.

    See Also
    --------
    NeoHookean, MooneyRivlin

    Examples
    --------
    Pressures (kPa) at two internal radii (mm) of a tube:

    >>> import pymc_hyperelastic as ph
    >>> pressure = ph.inflation_pressure(
    ...     ph.Yeoh(),
    ...     [7.5, 8.5],  # mm
    ...     inner_radius=7.0,
    ...     outer_radius=9.0,
    ...     c1=10.0,
    ...     c2=10.0,
    ...     c3=20.0,
    ... )
    >>> pressure.eval().round(3)
    array([1.016, 3.003])
    """

    parameters = (
        Parameter(
            "c1",
            "c_1",
            "kPa",
            (0.0, 300.0),
            "half the small-strain shear modulus; 174 in an aortic aneurysm",
        ),
        Parameter("c2", "c_2", "kPa", (0.0, 3000.0), "stiffening; 1881 in an aortic aneurysm"),
        Parameter("c3", "c_3", "kPa", (0.0, 3000.0), "stiffening at larger strain"),
    )

    def energy(self, radial: Any, hoop: Any, axial: Any, *, c1: Any, c2: Any, c3: Any) -> Tensor:
        """Strain energy in kPa."""
        excess = first_invariant(radial, hoop, axial) - 3
        return excess * (c1 + excess * (c2 + excess * c3))

    def derivative(self, excess: Tensor, *, c1: Any, c2: Any, c3: Any) -> Tensor:
        """``c1 + 2 c2 (I₁ − 3) + 3 c3 (I₁ − 3)²``."""
        return c1 + excess * (2 * c2 + excess * (3 * c3))


class Gent(_FirstInvariant):
    r"""Gent solid, whose chains reach an end.

    .. math:: W = -\frac{μ J_m}{2} \ln\left(1 - \frac{I_1 - 3}{J_m}\right)

    ``μ`` is the small-strain shear modulus. Where ``I₁ − 3`` reaches ``Jm`` stress is infinite:
    such parameters are impossible there.

    Source: A. N. Gent, A new constitutive relation for rubber, Rubber Chemistry and Technology 69
    (1996) 59-61; for arteries C. O. Horgan and G. Saccomandi, Biomechanics and Modeling in
    Mechanobiology 1 (2003) 251-266.

    See Also
    --------
    ArrudaBoyce, Demiray

    Examples
    --------
    Pressures (kPa) at two internal radii (mm) of a tube:

    >>> import pymc_hyperelastic as ph
    >>> pressure = ph.inflation_pressure(
    ...     ph.Gent(), [7.5, 8.5], inner_radius=7.0, outer_radius=9.0, mu=20.0, limit=2.0
    ... )
    >>> pressure.eval().round(3)
    array([0.996, 2.478])
    """

    parameters = (
        Parameter("mu", r"\mu", "kPa", (0.0, 200.0), "small-strain shear modulus" + _MODULUS_RANGE),
        Parameter(
            "limit",
            "J_m",
            "",
            (0.1, 100.0),
            "largest I₁ − 3; 0.4 to 2.3 in arteries, 30 to 100 in rubber",
        ),
    )

    def energy(self, radial: Any, hoop: Any, axial: Any, *, mu: Any, limit: Any) -> Tensor:
        """Strain energy in kPa."""
        fraction = (first_invariant(radial, hoop, axial) - 3) / limit
        inside = fraction < 1
        return pt.where(
            inside, -mu * limit / 2 * pt.log1p(-pt.where(inside, fraction, 0.0)), np.inf
        )

    def derivative(self, excess: Tensor, *, mu: Any, limit: Any) -> Tensor:
        """``(μ/2) Jm/(Jm − (I₁ − 3))``."""
        inside = excess < limit
        return pt.where(inside, mu / 2 * limit / pt.where(inside, limit - excess, 1.0), np.inf)


class Demiray(_FirstInvariant):
    r"""Demiray solid, the isotropic form of Fung's exponential.

    .. math:: W = \frac{μ}{2 b} \left(e^{b (I_1 - 3)} - 1\right)

    ``μ`` is the small-strain shear modulus.

    Source: H. Demiray, A note on the elasticity of soft biological tissues, Journal of Biomechanics
    5 (1972) 309-311.

    See Also
    --------
    Gent, FungOrthotropic

    Examples
    --------
    Pressures (kPa) at two internal radii (mm) of a tube:

    >>> import pymc_hyperelastic as ph
    >>> pressure = ph.inflation_pressure(
    ...     ph.Demiray(), [7.5, 8.5], inner_radius=7.0, outer_radius=9.0, mu=20.0, b=2.0
    ... )
    >>> pressure.eval().round(3)
    array([1.016, 2.898])
    """

    parameters = (
        Parameter("mu", r"\mu", "kPa", (0.0, 200.0), "small-strain shear modulus" + _MODULUS_RANGE),
        Parameter("b", "b", "", (0.0, 20.0), "stiffening exponent; about 0.5 to 10 in arteries"),
    )

    def energy(self, radial: Any, hoop: Any, axial: Any, *, mu: Any, b: Any) -> Tensor:
        """Strain energy in kPa."""
        return mu / (2 * b) * pt.expm1(b * (first_invariant(radial, hoop, axial) - 3))

    def derivative(self, excess: Tensor, *, mu: Any, b: Any) -> Tensor:
        """``(μ/2) exp(b (I₁ − 3))``."""
        return mu / 2 * pt.exp(b * excess)


class ArrudaBoyce(_FirstInvariant):
    r"""Arruda-Boyce solid, chains of finite length along eight diagonals.

    .. math:: W = μ \sum_{i=1}^5 \frac{C_i}{λ_m^{2i-2}} \left(I_1^i - 3^i\right), \qquad
        C = \tfrac12, \tfrac{1}{20}, \tfrac{11}{1050}, \tfrac{19}{7000}, \tfrac{519}{673750}

    ``μ`` is the shear modulus of the network, and ``λm`` the stretch at which its chains are taut;
    the small-strain shear modulus is larger by the series at ``I₁ = 3``.

    Source: E. M. Arruda and M. C. Boyce, A three-dimensional constitutive model for the large
    stretch behavior of rubber elastic materials, Journal of the Mechanics and Physics of Solids 41
    (1993) 389-412.

    See Also
    --------
    Gent

    Examples
    --------
    Pressures (kPa) at two internal radii (mm) of a tube:

    >>> import pymc_hyperelastic as ph
    >>> pressure = ph.inflation_pressure(
    ...     ph.ArrudaBoyce(), [7.5, 8.5], inner_radius=7.0, outer_radius=9.0, mu=20.0, lock=1.5
    ... )
    >>> pressure.eval().round(3)
    array([1.443, 3.476])
    """

    parameters = (
        Parameter("mu", r"\mu", "kPa", (0.0, 200.0), "modulus of the network" + _MODULUS_RANGE),
        Parameter(
            "lock", r"\lambda_m", "", (1.0, 10.0), "stretch of taut chains; 2 to 5 in rubber"
        ),
    )

    def energy(self, radial: Any, hoop: Any, axial: Any, *, mu: Any, lock: Any) -> Tensor:
        """Strain energy in kPa."""
        first = first_invariant(radial, hoop, axial)
        terms = enumerate(_LANGEVIN, start=1)
        return mu * sum(c / lock ** (2 * i - 2) * (first**i - 3**i) for i, c in terms)

    def derivative(self, excess: Tensor, *, mu: Any, lock: Any) -> Tensor:
        """``μ Σ i C_i (I₁/λm²)^{i−1}``."""
        relative = (excess + 3) / lock**2
        terms = enumerate(_LANGEVIN, start=1)
        return mu * sum(i * c * relative ** (i - 1) for i, c in terms)


# Series of the inverse Langevin function.
_LANGEVIN = (1 / 2, 1 / 20, 11 / 1050, 19 / 7000, 519 / 673750)


class PowerLawNeoHookean(_FirstInvariant):
    r"""Power-law neo-Hookean solid: the neo-Hookean energy, raised to a power that stiffens it.

    .. math:: W = \frac{μ}{2} \left\{ \left[1 + \frac{I_1 - 3}{n}\right]^n - 1 \right\}

    ``μ`` is the small-strain shear modulus; ``n = 1`` is the neo-Hookean solid, and as ``n`` grows
    the energy tends to the exponential ``μ/2 (exp(I₁ − 3) − 1)``.

    Source: Doraiswamy and Srinivasa, "A Bayesian approach to accounting for variability in
    mechanical properties in biomaterials", after Raghavan and Vorp, J. Biomech. 33 (2000) 475-482.

    See Also
    --------
    NeoHookean, power_law_neo_hookean_model

    Examples
    --------
    Pressures (kPa) at two internal radii (mm) of a tube:

    >>> import pymc_hyperelastic as ph
    >>> pressure = ph.inflation_pressure(
    ...     ph.PowerLawNeoHookean(),
    ...     [7.5, 8.5],  # mm
    ...     inner_radius=7.0,
    ...     outer_radius=9.0,
    ...     mu=20.0,
    ...     n=3.0,
    ... )
    >>> pressure.eval().round(3)
    array([0.998, 2.514])
    """

    parameters = (
        Parameter("mu", r"\mu", "kPa", (0.0, 200.0), "small-strain shear modulus" + _MODULUS_RANGE),
        Parameter(
            "n",
            "n",
            "",
            (0.3, 30.0),
            "stiffening exponent: softening below 1, nearly the exponential limit at 30",
        ),
    )

    def energy(self, radial: Any, hoop: Any, axial: Any, *, mu: Any, n: Any) -> Tensor:
        """Strain energy in kPa."""
        return mu / 2 * ((1 + (first_invariant(radial, hoop, axial) - 3) / n) ** n - 1)

    def derivative(self, excess: Tensor, *, mu: Any, n: Any) -> Tensor:
        """``(μ/2) [1 + (I₁ − 3)/n]^{n−1}``."""
        return mu / 2 * pt.exp((n - 1) * pt.log1p(excess / n))


class Ogden(_Isotropic):
    r"""Two-parameter Ogden solid, with the powers ``α`` and ``−α`` of the stretches.

    .. math:: W = \frac{2μ}{α^2} \left( \sum_i λ_i^α + λ_i^{-α} - 6 \right)
        = \frac{8μ}{α^2} \sum_i \sinh^2\left(\frac{α}{2} \ln λ_i\right)

    The small-strain shear modulus is ``2μ``. The energy is even in ``α`` and finite at ``α = 0``:
    posteriors under a prior on both signs have two mirrored modes.

    Source: Doraiswamy and Srinivasa (see :class:`PowerLawNeoHookean`), after Ogden, "Non-linear
    elastic deformations", Dover 1997.

    See Also
    --------
    OgdenSeries, ogden_model

    Examples
    --------
    Pressures (kPa) at two internal radii (mm) of a tube:

    >>> import pymc_hyperelastic as ph
    >>> pressure = ph.inflation_pressure(
    ...     ph.Ogden(), [7.5, 8.5], inner_radius=7.0, outer_radius=9.0, mu=30.0, alpha=7.0
    ... )
    >>> pressure.eval().round(3)
    array([3.041, 8.489])
    """

    parameters = (
        Parameter(
            "mu",
            r"\mu",
            "kPa",
            (0.0, 100.0),
            "half the small-strain shear modulus" + _MODULUS_RANGE,
        ),
        Parameter(
            "alpha",
            r"\alpha",
            "",
            (-40.0, 40.0),
            "exponent of the stretches, either sign; rubber has about 2, arteries 5 to 30",
            scale="log",
        ),
    )

    def energy(self, radial: Any, hoop: Any, axial: Any, *, mu: Any, alpha: Any) -> Tensor:
        """Strain energy in kPa, finite at ``α = 0``."""

        def term(stretch: Any) -> Tensor:
            strain = pt.log(stretch)
            return _sinh_ratio(alpha / 2, strain) ** 2

        return 2 * mu * (term(radial) + term(hoop) + term(axial))

    def stress_difference(
        self, log_hoop: Tensor, log_axial: Tensor, *, mu: Any, alpha: Any
    ) -> Tensor:
        r"""``(8μ/α) sinh(αγ/2) cosh(αz/2)`` with ``γ = 2 ln λθ + ln λz``, ``z = ln λz``."""
        gamma = 2 * log_hoop + log_axial
        return 4 * mu * _sinh_ratio(alpha / 2, gamma) * pt.cosh(alpha / 2 * log_axial)


class OgdenSeries(_Isotropic):
    r"""Ogden solid with any number of terms.

    .. math:: W = \sum_{p=1}^{P} \frac{μ_p}{α_p}
        \left(λ_r^{α_p} + λ_θ^{α_p} + λ_z^{α_p} - 3\right)

    The small-strain shear modulus is ``½ Σ μp αp``. Terms may change places: with equal priors for
    all the posterior has a mode for each order. Both parameters are vectors of `terms` entries.

    Source: R. W. Ogden, Large deformation isotropic elasticity: on the correlation of theory and
    experiment for incompressible rubberlike solids, Proceedings of the Royal Society A 326 (1972)
    565-584.

    Parameters
    ----------
    terms : int, default 3
        Number of terms.

    See Also
    --------
    Ogden

    Examples
    --------
    Pressures (kPa) at two internal radii (mm) of a tube:

    >>> import pymc_hyperelastic as ph
    >>> pressure = ph.inflation_pressure(
    ...     ph.OgdenSeries(),
    ...     [7.5, 8.5],  # mm
    ...     inner_radius=7.0,
    ...     outer_radius=9.0,
    ...     mu=[20.0, 5.0, 1.0],
    ...     alpha=[2.0, 6.0, 10.0],
    ... )
    >>> pressure.eval().round(3)
    array([2.005, 5.223])
    """

    def __init__(self, terms: int = 3) -> None:
        if not isinstance(terms, int) or isinstance(terms, bool) or terms < 1:
            raise ValueError(f"terms is {terms!r}; expected a whole number, at least 1")
        self.terms = terms

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """The two vectors."""
        return (
            Parameter(
                "mu",
                r"\mu",
                "kPa",
                (0.0, 100.0),
                "modulus of each term; of the sign of its exponent in a stable solid",
                size=self.terms,
            ),
            Parameter(
                "alpha",
                r"\alpha",
                "",
                (1.0, 40.0),
                "exponent of each term; give a prior of negative ones for such terms as rubber's "
                "third",
                size=self.terms,
            ),
        )

    def energy(self, radial: Any, hoop: Any, axial: Any, *, mu: Any, alpha: Any) -> Tensor:
        """Strain energy in kPa."""
        logs = [pt.log(stretch) for stretch in (radial, hoop, axial)]
        return sum(
            m / a * sum(pt.expm1(a * log) for log in logs) for m, a in zip(mu, alpha, strict=True)
        )

    def stress_difference(
        self, log_hoop: Tensor, log_axial: Tensor, *, mu: Any, alpha: Any
    ) -> Tensor:
        r"""``Σ 2 μp e^{−αp z/2} sinh(αp γ/2)`` with ``γ = 2 ln λθ + ln λz``, ``z = ln λz``."""
        gamma = 2 * log_hoop + log_axial
        return sum(
            2 * m * pt.exp(-a / 2 * log_axial) * pt.sinh(a / 2 * gamma)
            for m, a in zip(mu, alpha, strict=True)
        )


def _sinh_ratio(a: Tensor, x: Tensor) -> Tensor:
    """``sinh(a x)/a``, with its Taylor series near ``a x = 0`` so that derivatives stay exact."""
    # Two terms are exact to rounding up to 0.01. Beyond, the quotient's derivatives have lost few
    # digits to cancellation: the second is right to 1e-11.
    y = a * x
    near, square = pt.abs(y) < 0.01, y**2
    series = x * (1 + square * (1 / 6 + square / 120))
    return pt.where(near, series, pt.sinh(y) / pt.where(pt.eq(a, 0.0), 1.0, a))
