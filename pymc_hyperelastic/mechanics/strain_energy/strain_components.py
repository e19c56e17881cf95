"""Orthotropic strain energies of the hoop and the axial strain of the tube."""

from typing import Any

import pytensor.tensor as pt
from pytensor.tensor.variable import TensorVariable as Tensor

from pymc_hyperelastic.mechanics.strain_energy.base import Parameter, StrainEnergy

__all__ = ["CriscioneType", "FungOrthotropic"]


class CriscioneType(StrainEnergy):
    r"""Criscione-type energy of the one logarithmic strain attribute that inflation changes.

    .. math:: W = a \cosh(b γ_3), \qquad γ_3 = 2 \ln λ_θ + \ln λ_z

    ``W = a`` at rest; the constant has no effect on stress. The energy does not determine the axial
    force. It is even in ``b``: if the prior admits both signs, the posterior has two mirrored
    modes. The pressure equals that of :class:`Ogden` with ``b = α/2`` and
    ``a = (8μ/α²) cosh(½ α ln λz)``, so that evidences of the two laws differ by their priors only.

    Source: Doraiswamy and Srinivasa (see :class:`PowerLawNeoHookean`), after J. C. Criscione,
    Journal of Elasticity 77 (2004) 57-81.

    See Also
    --------
    criscione_model

    Examples
    --------
    >>> import pymc_hyperelastic as ph
    >>> radius, tube = [7.5, 8.5], ph.Tube(7.0, 9.0)
    >>> ph.inflation_pressure(ph.CriscioneType(), radius, tube, a=10.0, b=4.0).eval().round(3)
    array([ 8.174, 24.028])
    """

    equation = "W = a cosh(b γ₃), γ₃ = 2 ln λ_θ + ln λ_z"
    parameters = (
        Parameter("a", "a", "kPa", (0.0, 100.0), "energy; small inflation has the modulus a b²"),
        Parameter("b", "b", "", (-20.0, 20.0), "stiffening; half of Ogden's exponent", scale="log"),
    )

    def energy(self, radial: Any, hoop: Any, axial: Any, *, a: Any, b: Any) -> Tensor:
        """Strain energy in kPa."""
        return a * pt.cosh(b * (2 * pt.log(hoop) + pt.log(axial)))

    def stress_difference(self, log_hoop: Any, log_axial: Any, *, a: Any, b: Any) -> Tensor:
        """``2 a b sinh(b γ₃)``."""
        gamma = 2 * log_hoop + log_axial
        return 2 * a * b * pt.sinh(b * gamma)

    def axial_stress_difference(self, log_hoop: Any, log_axial: Any, *, a: Any, b: Any) -> Tensor:
        """``a b sinh(b γ₃)``."""
        return self.stress_difference(log_hoop, log_axial, a=a, b=b) / 2


class FungOrthotropic(StrainEnergy):
    r"""Fung's exponential of the hoop and the axial Green strain.

    .. math:: W = \frac{c}{2} \left(e^Q - 1\right), \qquad
        Q = a_1 E_θ^2 + a_2 E_z^2 + 2 a_4 E_θ E_z, \qquad E_i = \tfrac12 (λ_i^2 - 1)

    ``Q`` is positive definite, and stress increases with strain in every direction, only if
    ``a4² < a1 a2``.

    Source: Y. C. Fung, K. Fronek and P. Patitucci, American Journal of Physiology 237 (1979)
    H620-H631.

    See Also
    --------
    Demiray, HolzapfelGasserOgden

    Examples
    --------
    >>> import pymc_hyperelastic as ph
    >>> radius, tube = [7.5, 8.5], ph.Tube(7.0, 9.0)
    >>> parameters = {"c": 20.0, "a1": 2.0, "a2": 2.0, "a4": 1.0}
    >>> ph.inflation_pressure(ph.FungOrthotropic(), radius, tube, **parameters).eval().round(3)
    array([0.589, 2.019])
    """

    equation = "W = (c/2) (e^Q − 1), Q = a₁ E_θ² + a₂ E_z² + 2 a₄ E_θ E_z, E_i = (λ_i² − 1)/2"
    parameters = (
        Parameter("c", "c", "kPa", (0.0, 200.0), "modulus; 10 to 50 in rabbit arteries"),
        Parameter("a1", "a_1", "", (0.0, 20.0), "stiffening with hoop strain; about 1"),
        Parameter("a2", "a_2", "", (0.0, 20.0), "stiffening with axial strain; about 1"),
        Parameter("a4", "a_4", "", (0.0, 10.0), "coupling of hoop and axial strain; about 0.1"),
    )

    def energy(
        self, radial: Any, hoop: Any, axial: Any, *, c: Any, a1: Any, a2: Any, a4: Any
    ) -> Tensor:
        """Strain energy in kPa."""
        return c / 2 * pt.expm1(_exponent((hoop**2 - 1) / 2, (axial**2 - 1) / 2, a1, a2, a4))

    def stress_difference(
        self, log_hoop: Any, log_axial: Any, *, c: Any, a1: Any, a2: Any, a4: Any
    ) -> Tensor:
        """``c e^Q (a1 Eθ + a4 Ez) λθ²``."""
        hoop, axial = pt.expm1(2 * log_hoop) / 2, pt.expm1(2 * log_axial) / 2
        growth = c * pt.exp(_exponent(hoop, axial, a1, a2, a4) + 2 * log_hoop)
        return growth * (a1 * hoop + a4 * axial)

    def axial_stress_difference(
        self, log_hoop: Any, log_axial: Any, *, a1: Any, a2: Any, **others: Any
    ) -> Tensor:
        """``c e^Q (a2 Ez + a4 Eθ) λz²``: the two directions and ``a1``, ``a2`` are exchanged."""
        return self.stress_difference(log_axial, log_hoop, a1=a2, a2=a1, **others)


def _exponent(hoop: Any, axial: Any, a1: Any, a2: Any, a4: Any) -> Any:
    """``Q = a1 Eθ² + a2 Ez² + 2 a4 Eθ Ez``."""
    return a1 * hoop**2 + a2 * axial**2 + 2 * a4 * hoop * axial
