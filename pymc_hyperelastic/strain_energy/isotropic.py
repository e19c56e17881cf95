"""Isotropic strain energies."""

from typing import Any

import pytensor.tensor as pt
from pytensor.tensor.variable import TensorVariable

from pymc_hyperelastic.strain_energy.base import Parameter, StrainEnergy
from pymc_hyperelastic.tube import first_invariant

__all__ = ["Ogden", "PowerLawNeoHookean"]

_MODULUS_RANGE = "; the range spans soft tissue, from a loose vein to a stiffened aorta"


class PowerLawNeoHookean(StrainEnergy):
    r"""Power-law neo-Hookean solid: the neo-Hookean energy, raised to a power that stiffens it.

    .. math:: W = \frac{μ}{2} \left\{ \left[1 + \frac{I_1 - 3}{n}\right]^n - 1 \right\}

    ``μ`` is the small-strain shear modulus; ``n = 1`` is the neo-Hookean solid, and as ``n`` grows
    the energy tends to the exponential ``μ/2 (exp(I₁ − 3) − 1)``.

    Source: Doraiswamy and Srinivasa, "A Bayesian approach to accounting for variability in
    mechanical properties in biomaterials", after Raghavan and Vorp, J. Biomech. 33 (2000) 475-482.
    """

    parameters = (
        Parameter(
            "mu",
            r"\mu",
            "kPa",
            (0.0, 200.0),
            "small-strain shear modulus" + _MODULUS_RANGE,
        ),
        Parameter(
            "n",
            "n",
            "",
            (0.3, 30.0),
            "stiffening exponent: softening below 1, nearly the exponential limit at 30",
        ),
    )

    def energy(self, radial: Any, hoop: Any, axial: Any, *, mu: Any, n: Any) -> TensorVariable:
        """Strain energy in kPa."""
        return mu / 2 * ((1 + (first_invariant(radial, hoop, axial) - 3) / n) ** n - 1)

    def stress_difference(
        self, log_hoop: TensorVariable, log_axial: TensorVariable, *, mu: Any, n: Any
    ) -> TensorVariable:
        r"""``2 μ e^{−z} sinh γ [1 + (I₁ − 3)/n]^{n−1}``, ``γ = 2 ln λθ + ln λz``, ``z = ln λz``."""
        gamma = 2 * log_hoop + log_axial
        shrink = pt.exp(-log_axial)
        excess = 4 * shrink * pt.sinh(gamma / 2) ** 2 + (2 * shrink + shrink**-2 - 3)
        return 2 * mu * shrink * pt.sinh(gamma) * pt.exp((n - 1) * pt.log1p(excess / n))


class Ogden(StrainEnergy):
    r"""Two-parameter Ogden solid, with the powers ``α`` and ``−α`` of the stretches.

    .. math:: W = \frac{2μ}{α^2} \left( \sum_i λ_i^α + λ_i^{-α} - 6 \right)
        = \frac{8μ}{α^2} \sum_i \sinh^2\left(\frac{α}{2} \ln λ_i\right)

    The small-strain shear modulus is ``2μ``. The energy is even in ``α`` and finite at ``α = 0``:
    posteriors under a prior on both signs have two mirrored modes.

    Source: Doraiswamy and Srinivasa (see :class:`PowerLawNeoHookean`), after Ogden, "Non-linear
    elastic deformations", Dover 1997.
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
        ),
    )

    def energy(self, radial: Any, hoop: Any, axial: Any, *, mu: Any, alpha: Any) -> TensorVariable:
        """Strain energy in kPa, finite at ``α = 0``."""

        def term(stretch: Any) -> TensorVariable:
            strain = pt.log(stretch)
            return _sinh_ratio(alpha / 2, strain) ** 2

        return 2 * mu * (term(radial) + term(hoop) + term(axial))

    def stress_difference(
        self, log_hoop: TensorVariable, log_axial: TensorVariable, *, mu: Any, alpha: Any
    ) -> TensorVariable:
        r"""``(8μ/α) sinh(αγ/2) cosh(αz/2)`` with ``γ = 2 ln λθ + ln λz``, ``z = ln λz``."""
        gamma = 2 * log_hoop + log_axial
        return 4 * mu * _sinh_ratio(alpha / 2, gamma) * pt.cosh(alpha / 2 * log_axial)


def _sinh_ratio(a: TensorVariable, x: TensorVariable) -> TensorVariable:
    """``sinh(a x)/a``, with its Taylor series near ``a x = 0`` so that derivatives stay exact."""
    # Two terms are exact to rounding up to 0.01. Beyond, the quotient's derivatives have lost few
    # digits to cancellation: the second is right to 1e-11.
    y = a * x
    near, square = pt.abs(y) < 0.01, y**2
    series = x * (1 + square * (1 / 6 + square / 120))
    return pt.where(near, series, pt.sinh(y) / pt.where(pt.eq(a, 0.0), 1.0, a))
