"""Orthotropic strain energies, whose axes are those of the tube."""

from typing import Any

import pytensor.tensor as pt
from pytensor.tensor.variable import TensorVariable

from pymc_hyperelastic.strain_energy.base import Parameter, StrainEnergy

__all__ = ["CriscioneType"]


class CriscioneType(StrainEnergy):
    r"""Criscione-type energy of the one logarithmic strain attribute that inflation changes.

    .. math:: W = a \cosh(b γ_3), \qquad γ_3 = 2 \ln λ_θ + \ln λ_z

    ``W = a`` at rest, which no stress feels. The energy says nothing about axial force. It is even
    in ``b``, so posteriors under a prior on both signs have two mirrored modes. Its pressure is
    that of :class:`Ogden` with ``b = α/2`` and ``a = (8μ/α²) cosh(½ α ln λz)``: the two evidences
    can differ only through the prior.

    Source: Doraiswamy and Srinivasa (see :class:`PowerLawNeoHookean`), after Criscione,
    J. Elasticity 77 (2004) 57-81.
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
            "b", "b", "", (-20.0, 20.0), "strain stiffening, either sign; half of Ogden's exponent"
        ),
    )

    def energy(self, radial: Any, hoop: Any, axial: Any, *, a: Any, b: Any) -> TensorVariable:
        """Strain energy in kPa."""
        return a * pt.cosh(b * (2 * pt.log(hoop) + pt.log(axial)))

    def stress_difference(
        self, log_hoop: TensorVariable, log_axial: TensorVariable, *, a: Any, b: Any
    ) -> TensorVariable:
        """``2 a b sinh(b γ₃)``."""
        gamma = 2 * log_hoop + log_axial
        return 2 * a * b * pt.sinh(b * gamma)
