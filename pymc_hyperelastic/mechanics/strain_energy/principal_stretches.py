"""Isotropic strain energies of the principal stretches: Ogden's laws."""

from typing import Any

import pytensor.tensor as pt
from pytensor.tensor.variable import TensorVariable as Tensor

from pymc_hyperelastic.mechanics.strain_energy.base import (
    IsotropicStrainEnergy,
    Parameter,
    check_terms,
)

__all__ = ["Ogden", "OgdenSeries"]

# Value of |a x| below which sinh(a x)/a is replaced by two terms of its series. The terms are exact
# to rounding up to 0.01, and above 0.01 the quotient loses few digits in its derivatives: the
# second one has a relative error of 1e-11.
_SERIES_LIMIT = 0.01


class Ogden(IsotropicStrainEnergy):
    r"""Two-parameter Ogden solid with the powers ``α`` and ``−α`` of the stretches.

    .. math:: W = \frac{2μ}{α^2} \left( \sum_i λ_i^α + λ_i^{-α} - 6 \right)
        = \frac{8μ}{α^2} \sum_i \sinh^2\left(\frac{α}{2} \ln λ_i\right)

    The small-strain shear modulus is ``2μ``. The energy is even in ``α`` and finite at ``α = 0``:
    if the prior admits both signs, the posterior has two mirrored modes.

    Source: Doraiswamy and Srinivasa (see :class:`PowerLawNeoHookean`), after R. W. Ogden,
    Non-linear Elastic Deformations, Dover 1997.

    See Also
    --------
    OgdenSeries, ogden_model

    Examples
    --------
    >>> import pymc_hyperelastic as ph
    >>> radius, tube = [7.5, 8.5], ph.Tube(7.0, 9.0)
    >>> ph.inflation_pressure(ph.Ogden(), radius, tube, mu=30.0, alpha=7.0).eval().round(3)
    array([3.041, 8.489])
    """

    equation = "W = (2μ/α²) (λ_r^α + λ_θ^α + λ_z^α + λ_r^(−α) + λ_θ^(−α) + λ_z^(−α) − 6)"
    parameters = (
        Parameter("mu", r"\mu", "kPa", (0.0, 100.0), "half the small-strain shear modulus"),
        Parameter(
            "alpha", r"\alpha", "", (-40.0, 40.0), "exponent; 5 to 30 in arteries", scale="log"
        ),
    )

    def energy(self, radial: Any, hoop: Any, axial: Any, *, mu: Any, alpha: Any) -> Tensor:
        """Strain energy in kPa, finite at ``α = 0``."""
        terms = [_sinh_ratio(alpha / 2, pt.log(x)) ** 2 for x in (radial, hoop, axial)]
        return 2 * mu * sum(terms)

    def stress_difference(self, log_hoop: Any, log_axial: Any, *, mu: Any, alpha: Any) -> Tensor:
        r"""``(8μ/α) sinh(αγ/2) cosh(αz/2)`` with ``γ = 2 ln λθ + ln λz``, ``z = ln λz``."""
        gamma = 2 * log_hoop + log_axial
        return 4 * mu * _sinh_ratio(alpha / 2, gamma) * pt.cosh(alpha / 2 * log_axial)


class OgdenSeries(IsotropicStrainEnergy):
    r"""Ogden solid with any number of terms.

    .. math:: W = \sum_{p=1}^{P} \frac{μ_p}{α_p}
        \left(λ_r^{α_p} + λ_θ^{α_p} + λ_z^{α_p} - 3\right)

    The small-strain shear modulus is ``½ Σ μp αp``. Both parameters are vectors of `terms` entries;
    in a stable solid ``μp αp > 0``, and negative exponents need a prior of your own. The order of
    the terms has no effect: if all terms have the same prior, the posterior has one mode per order.

    Source: R. W. Ogden, Proceedings of the Royal Society A 326 (1972) 565-584.

    Parameters
    ----------
    terms : int, default 3
        Number of terms.

    Raises
    ------
    ValueError
        If `terms` is not a positive whole number.

    See Also
    --------
    Ogden

    Examples
    --------
    >>> import pymc_hyperelastic as ph
    >>> radius, tube = [7.5, 8.5], ph.Tube(7.0, 9.0)
    >>> parameters = {"mu": [20.0, 5.0, 1.0], "alpha": [2.0, 6.0, 10.0]}
    >>> ph.inflation_pressure(ph.OgdenSeries(), radius, tube, **parameters).eval().round(3)
    array([2.005, 5.223])
    """

    equation = "W = Σ (μ_p/α_p) (λ_r^α_p + λ_θ^α_p + λ_z^α_p − 3)"

    def __init__(self, terms: int = 3) -> None:
        self.terms = check_terms(terms)

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """The two vector parameters."""
        return (
            Parameter("mu", r"\mu", "kPa", (0.0, 100.0), "modulus of each term", self.terms),
            Parameter("alpha", r"\alpha", "", (1.0, 40.0), "exponent of each term", self.terms),
        )

    def energy(self, radial: Any, hoop: Any, axial: Any, *, mu: Any, alpha: Any) -> Tensor:
        """Strain energy in kPa."""
        logs = [pt.log(stretch) for stretch in (radial, hoop, axial)]
        return sum(
            m / a * sum(pt.expm1(a * log) for log in logs) for m, a in zip(mu, alpha, strict=True)
        )

    def stress_difference(self, log_hoop: Any, log_axial: Any, *, mu: Any, alpha: Any) -> Tensor:
        r"""``Σ 2 μp e^{−αp z/2} sinh(αp γ/2)`` with ``γ = 2 ln λθ + ln λz``, ``z = ln λz``."""
        gamma = 2 * log_hoop + log_axial
        return sum(
            2 * m * pt.exp(-a / 2 * log_axial) * pt.sinh(a / 2 * gamma)
            for m, a in zip(mu, alpha, strict=True)
        )


def _sinh_ratio(a: Tensor, x: Tensor) -> Tensor:
    """``sinh(a x)/a``, by its Taylor series near ``a x = 0`` so that derivatives stay exact."""
    y = a * x
    square = y**2
    series = x * (1 + square * (1 / 6 + square / 120))
    # The inner `where` avoids 0/0 in the unused branch.
    ratio = pt.sinh(y) / pt.where(pt.eq(a, 0.0), 1.0, a)
    return pt.where(pt.abs(y) < _SERIES_LIMIT, series, ratio)
