"""Isotropic strain energies of the invariants I₁ and I₂ of the right Cauchy-Green tensor."""

from abc import abstractmethod
from typing import Any

import numpy as np
import pytensor.tensor as pt
from pytensor.tensor.variable import TensorVariable as Tensor

from pymc_hyperelastic.mechanics.strain_energy.base import (
    IsotropicStrainEnergy,
    Parameter,
    check_terms,
    elementwise_derivative,
    first_invariant_excess,
    half_difference,
)
from pymc_hyperelastic.mechanics.tube import first_invariant, second_invariant

__all__ = [
    "ArrudaBoyce",
    "Demiray",
    "Gent",
    "LopezPamies",
    "MooneyRivlin",
    "NeoHookean",
    "PowerLawNeoHookean",
    "Yeoh",
]

_RANGE = "; the range covers soft tissue, from loose veins to stiff aortas"


def _modulus(description: str = "small-strain shear modulus") -> Parameter:
    """Return the parameter ``μ``."""
    return Parameter("mu", r"\mu", "kPa", (0.0, 200.0), description + _RANGE)


class _FirstInvariant(IsotropicStrainEnergy):
    """Base class of laws whose energy is a function of ``excess = I₁ − 3`` only."""

    @abstractmethod
    def of_excess(self, excess: Tensor, **parameters: Any) -> Tensor:
        """Return the strain energy ``W`` in kPa."""

    def derivative(self, excess: Tensor, **parameters: Any) -> Tensor:
        """Return ``dW/dI₁`` in kPa."""
        return elementwise_derivative(self.of_excess(excess, **parameters), excess)

    def energy(self, radial: Any, hoop: Any, axial: Any, **parameters: Any) -> Tensor:
        """Return the strain energy in kPa."""
        return self.of_excess(first_invariant(radial, hoop, axial) - 3, **parameters)

    def stress_difference(self, log_hoop: Any, log_axial: Any, **parameters: Any) -> Tensor:
        r"""``4 e^{−z} sinh γ dW/dI₁`` with ``γ = 2 ln λθ + ln λz``, ``z = ln λz``."""
        excess = first_invariant_excess(log_hoop, log_axial)
        return 4 * half_difference(log_hoop, log_axial) * self.derivative(excess, **parameters)


class NeoHookean(_FirstInvariant):
    r"""Neo-Hookean solid: a network of Gaussian chains.

    .. math:: W = \frac{μ}{2} (I_1 - 3)

    ``μ`` is the shear modulus.

    Source: L. R. G. Treloar, Transactions of the Faraday Society 39 (1943) 241-246.

    See Also
    --------
    PowerLawNeoHookean, MooneyRivlin

    Examples
    --------
    >>> import pymc_hyperelastic as ph
    >>> radius, tube = [7.5, 8.5], ph.Tube(7.0, 9.0)
    >>> ph.inflation_pressure(ph.NeoHookean(), radius, tube, mu=40.0).eval().round(3)
    array([1.98 , 4.695])
    """

    equation = "W = (μ/2) (I₁ − 3)"
    parameters = (_modulus(),)

    def of_excess(self, excess: Tensor, *, mu: Any) -> Tensor:
        """``μ/2 (I₁ − 3)``."""
        return mu / 2 * excess


class MooneyRivlin(IsotropicStrainEnergy):
    r"""Mooney-Rivlin solid: linear in both invariants.

    .. math:: W = c_{10} (I_1 - 3) + c_{01} (I_2 - 3)

    The shear modulus is ``2 (c10 + c01)``; in rubber ``c01`` is a tenth of ``c10``.

    Source: M. Mooney, Journal of Applied Physics 11 (1940) 582-592; R. S. Rivlin, Philosophical
    Transactions of the Royal Society A 241 (1948) 379-397.

    See Also
    --------
    NeoHookean, Yeoh

    Examples
    --------
    >>> import pymc_hyperelastic as ph
    >>> radius, tube = [7.5, 8.5], ph.Tube(7.0, 9.0)
    >>> ph.inflation_pressure(ph.MooneyRivlin(), radius, tube, c10=10.0, c01=5.0).eval().round(3)
    array([1.485, 3.521])
    """

    equation = "W = c₁₀ (I₁ − 3) + c₀₁ (I₂ − 3)"
    parameters = (
        Parameter("c10", "c_{10}", "kPa", (0.0, 100.0), "half the modulus of the I₁ term" + _RANGE),
        Parameter("c01", "c_{01}", "kPa", (0.0, 100.0), "half the modulus of the I₂ term"),
    )

    def energy(self, radial: Any, hoop: Any, axial: Any, *, c10: Any, c01: Any) -> Tensor:
        """Strain energy in kPa."""
        first = first_invariant(radial, hoop, axial) - 3
        return c10 * first + c01 * (second_invariant(radial, hoop, axial) - 3)

    def stress_difference(self, log_hoop: Any, log_axial: Any, *, c10: Any, c01: Any) -> Tensor:
        r"""``4 sinh γ (c10 e^{−z} + c01 e^{z})``, ``γ = 2 ln λθ + ln λz``, ``z = ln λz``."""
        gamma = 2 * log_hoop + log_axial
        return 4 * pt.sinh(gamma) * (c10 * pt.exp(-log_axial) + c01 * pt.exp(log_axial))


class Yeoh(_FirstInvariant):
    r"""Yeoh solid: a cubic polynomial of the first invariant.

    .. math:: W = c_1 (I_1 - 3) + c_2 (I_1 - 3)^2 + c_3 (I_1 - 3)^3

    The small-strain shear modulus is ``2 c1``.

    Source: O. H. Yeoh, Rubber Chemistry and Technology 66 (1993) 754-771; for arteries with
    ``c3 = 0``, M. L. Raghavan and D. A. Vorp, Journal of Biomechanics 33 (2000) 475-482.

    See Also
    --------
    NeoHookean, MooneyRivlin

    Examples
    --------
    >>> import pymc_hyperelastic as ph
    >>> radius, tube = [7.5, 8.5], ph.Tube(7.0, 9.0)
    >>> ph.inflation_pressure(ph.Yeoh(), radius, tube, c1=10.0, c2=10.0, c3=20.0).eval().round(3)
    array([1.016, 3.003])
    """

    equation = "W = c₁ (I₁ − 3) + c₂ (I₁ − 3)² + c₃ (I₁ − 3)³"
    parameters = (
        Parameter("c1", "c_1", "kPa", (0.0, 300.0), "half the shear modulus; 174 in an aneurysm"),
        Parameter("c2", "c_2", "kPa", (0.0, 3000.0), "stiffening; 1881 in an aneurysm"),
        Parameter("c3", "c_3", "kPa", (0.0, 3000.0), "stiffening at larger strain"),
    )

    def of_excess(self, excess: Tensor, *, c1: Any, c2: Any, c3: Any) -> Tensor:
        """``c1 (I₁ − 3) + c2 (I₁ − 3)² + c3 (I₁ − 3)³``."""
        return excess * (c1 + excess * (c2 + excess * c3))


class Gent(_FirstInvariant):
    r"""Gent solid: chains of limited extensibility.

    .. math:: W = -\frac{μ J_m}{2} \ln\left(1 - \frac{I_1 - 3}{J_m}\right)

    ``μ`` is the small-strain shear modulus, and ``Jm`` 30 to 100 in rubber. Energy and stress are
    infinite for ``I₁ − 3 ≥ Jm``, so that such parameters have zero likelihood.

    Source: A. N. Gent, Rubber Chemistry and Technology 69 (1996) 59-61; for arteries C. O. Horgan
    and G. Saccomandi, Biomechanics and Modeling in Mechanobiology 1 (2003) 251-266.

    See Also
    --------
    ArrudaBoyce, Demiray

    Examples
    --------
    >>> import pymc_hyperelastic as ph
    >>> radius, tube = [7.5, 8.5], ph.Tube(7.0, 9.0)
    >>> ph.inflation_pressure(ph.Gent(), radius, tube, mu=20.0, limit=2.0).eval().round(3)
    array([0.996, 2.478])
    """

    equation = "W = −(μ J_m/2) ln(1 − (I₁ − 3)/J_m)"
    parameters = (
        _modulus(),
        Parameter("limit", "J_m", "", (0.1, 100.0), "limit of I₁ − 3; 0.4 to 2.3 in arteries"),
    )

    def of_excess(self, excess: Tensor, *, mu: Any, limit: Any) -> Tensor:
        """``−(μ Jm/2) ln(1 − (I₁ − 3)/Jm)``, infinite beyond the limit."""
        fraction = excess / limit
        inside = fraction < 1
        # The inner `where` keeps the gradient of the unused branch finite.
        energy = -mu * limit / 2 * pt.log1p(-pt.where(inside, fraction, 0.0))
        return pt.where(inside, energy, np.inf)

    def derivative(self, excess: Tensor, *, mu: Any, limit: Any) -> Tensor:
        """``(μ/2) Jm/(Jm − (I₁ − 3))``, infinite beyond the limit."""
        inside = excess < limit
        return pt.where(inside, mu / 2 * limit / pt.where(inside, limit - excess, 1.0), np.inf)


class Demiray(_FirstInvariant):
    r"""Demiray solid: the isotropic form of Fung's exponential.

    .. math:: W = \frac{μ}{2 b} \left(e^{b (I_1 - 3)} - 1\right)

    ``μ`` is the small-strain shear modulus.

    Source: H. Demiray, Journal of Biomechanics 5 (1972) 309-311.

    See Also
    --------
    Gent, FungOrthotropic

    Examples
    --------
    >>> import pymc_hyperelastic as ph
    >>> radius, tube = [7.5, 8.5], ph.Tube(7.0, 9.0)
    >>> ph.inflation_pressure(ph.Demiray(), radius, tube, mu=20.0, b=2.0).eval().round(3)
    array([1.016, 2.898])
    """

    equation = "W = (μ/(2 b)) (e^(b (I₁ − 3)) − 1)"
    parameters = (
        _modulus(),
        Parameter("b", "b", "", (0.0, 20.0), "stiffening exponent; about 0.5 to 10 in arteries"),
    )

    def of_excess(self, excess: Tensor, *, mu: Any, b: Any) -> Tensor:
        """``μ/(2 b) (exp(b (I₁ − 3)) − 1)``."""
        return mu / (2 * b) * pt.expm1(b * excess)

    def derivative(self, excess: Tensor, *, mu: Any, b: Any) -> Tensor:
        """``(μ/2) exp(b (I₁ − 3))``, finite at ``b = 0``."""
        return mu / 2 * pt.exp(b * excess)


class ArrudaBoyce(_FirstInvariant):
    r"""Arruda-Boyce solid: chains of finite length along the eight diagonals of a cube.

    .. math:: W = μ \sum_{i=1}^5 \frac{C_i}{λ_m^{2i-2}} \left(I_1^i - 3^i\right), \qquad
        C = \tfrac12, \tfrac{1}{20}, \tfrac{11}{1050}, \tfrac{19}{7000}, \tfrac{519}{673750}

    ``μ`` is the rubbery modulus, and ``λm`` the chain stretch at full extension. The small-strain
    shear modulus is ``2 dW/dI₁`` at ``I₁ = 3``, which exceeds ``μ``.

    Source: E. M. Arruda and M. C. Boyce, Journal of the Mechanics and Physics of Solids 41 (1993)
    389-412.

    See Also
    --------
    Gent

    Examples
    --------
    >>> import pymc_hyperelastic as ph
    >>> radius, tube = [7.5, 8.5], ph.Tube(7.0, 9.0)
    >>> ph.inflation_pressure(ph.ArrudaBoyce(), radius, tube, mu=20.0, lock=1.5).eval().round(3)
    array([1.443, 3.476])
    """

    equation = (
        "W = μ Σ C_i/λ_m^(2i−2) (I₁^i − 3^i), i = 1 to 5, "
        "C = 1/2, 1/20, 11/1050, 19/7000, 519/673750"
    )
    parameters = (
        _modulus("rubbery modulus of the chain network"),
        Parameter(
            "lock", r"\lambda_m", "", (1.0, 10.0), "stretch of an extended chain; 2 to 5 in rubber"
        ),
    )

    # Coefficients C_i of the series of the inverse Langevin function.
    coefficients = (1 / 2, 1 / 20, 11 / 1050, 19 / 7000, 519 / 673750)

    def of_excess(self, excess: Tensor, *, mu: Any, lock: Any) -> Tensor:
        """``μ Σ C_i/λm^{2i−2} (I₁^i − 3^i)``."""
        first, terms = excess + 3, enumerate(self.coefficients, start=1)
        return mu * sum(c / lock ** (2 * i - 2) * (first**i - 3**i) for i, c in terms)


class PowerLawNeoHookean(_FirstInvariant):
    r"""Power-law neo-Hookean solid: a power of the neo-Hookean energy, which stiffens it.

    .. math:: W = \frac{μ}{2} \left\{ \left[1 + \frac{I_1 - 3}{n}\right]^n - 1 \right\}

    ``μ`` is the small-strain shear modulus. For ``n = 1`` the solid is neo-Hookean; for
    ``n → ∞`` the energy tends to the exponential ``μ/2 (exp(I₁ − 3) − 1)``.

    Source: Doraiswamy and Srinivasa, "A Bayesian approach to accounting for variability in
    mechanical properties in biomaterials", after Raghavan and Vorp, J. Biomech. 33 (2000) 475-482.

    See Also
    --------
    NeoHookean, power_law_neo_hookean_model

    Examples
    --------
    >>> import pymc_hyperelastic as ph
    >>> radius, tube = [7.5, 8.5], ph.Tube(7.0, 9.0)
    >>> ph.inflation_pressure(ph.PowerLawNeoHookean(), radius, tube, mu=20.0, n=3.0).eval().round(3)
    array([0.998, 2.514])
    """

    equation = "W = (μ/2) ((1 + (I₁ − 3)/n)^n − 1)"
    parameters = (
        _modulus(),
        Parameter("n", "n", "", (0.3, 30.0), "exponent; softens below 1, exponential at 30"),
    )

    def of_excess(self, excess: Tensor, *, mu: Any, n: Any) -> Tensor:
        """``(μ/2) {[1 + (I₁ − 3)/n]^n − 1}``."""
        return mu / 2 * ((1 + excess / n) ** n - 1)

    def derivative(self, excess: Tensor, *, mu: Any, n: Any) -> Tensor:
        """``(μ/2) [1 + (I₁ − 3)/n]^{n−1}``."""
        # A sampler may round a positive n to 0, where the gradient would be 0 · ∞. Divided by a
        # tiny number, the stress vanishes, as in the limit.
        divisor = pt.where(pt.eq(n, 0.0), np.sqrt(np.finfo(float).tiny), n)
        return mu / 2 * pt.exp((n - 1) * pt.log1p(excess / divisor))


class LopezPamies(_FirstInvariant):
    r"""Lopez-Pamies solid: powers of the first invariant.

    .. math:: W = \sum_{p=1}^{P} \frac{3^{1-α_p}}{2 α_p} μ_p \left(I_1^{α_p} - 3^{α_p}\right)

    The small-strain shear modulus is ``Σ μp``. A term with ``αp = 1`` is neo-Hookean. In rubber the
    first exponent is about 1, and the second one, about 4, describes the stiffening. The order of
    the terms has no effect: if all terms have the same prior, the posterior has one mode per order.

    Source: O. Lopez-Pamies, Comptes Rendus Mecanique 338 (2010) 3-11.

    Parameters
    ----------
    terms : int, default 2
        Number of terms.

    Raises
    ------
    ValueError
        If `terms` is not a positive whole number.

    See Also
    --------
    OgdenSeries, Gent

    Examples
    --------
    >>> import pymc_hyperelastic as ph
    >>> radius, tube = [7.5, 8.5], ph.Tube(7.0, 9.0)
    >>> parameters = {"mu": [20.0, 1.0], "alpha": [1.0, 8.0]}
    >>> ph.inflation_pressure(ph.LopezPamies(), radius, tube, **parameters).eval().round(3)
    array([1.041, 2.497])
    """

    equation = "W = Σ (3^(1−α_p)/(2 α_p)) μ_p (I₁^α_p − 3^α_p)"

    def __init__(self, terms: int = 2) -> None:
        self.terms = check_terms(terms)

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """The two vector parameters."""
        exponent = (
            "exponent of each term; 1 and 4 in rubber; the force of a sheet that is pulled falls "
            "below 0.5; (α − 1)/3 is the exponent b of Demiray's law at small strain"
        )
        return (
            Parameter("mu", r"\mu", "kPa", (0.0, 100.0), "modulus of each term", self.terms),
            Parameter("alpha", r"\alpha", "", (0.5, 40.0), exponent, self.terms),
        )

    def of_excess(self, excess: Tensor, *, mu: Any, alpha: Any) -> Tensor:
        """``Σ 3 μp/(2 αp) [(I₁/3)^αp − 1]``."""
        log = pt.log1p(excess / 3)
        return sum(3 * m / (2 * a) * pt.expm1(a * log) for m, a in zip(mu, alpha, strict=True))

    def derivative(self, excess: Tensor, *, mu: Any, alpha: Any) -> Tensor:
        """``Σ (μp/2) (I₁/3)^(αp − 1)``."""
        log = pt.log1p(excess / 3)
        return sum(m / 2 * pt.exp((a - 1) * log) for m, a in zip(mu, alpha, strict=True))
