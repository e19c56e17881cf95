"""Strain energies of fibre families in an isotropic matrix, which is mostly neo-Hookean.

The fibres lie in the surface of the tube and carry load in tension only.
"""

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

__all__ = ["FourFiber", "GasserOgdenHolzapfel", "HolzapfelGasserOgden", "HolzapfelOgden"]


def _fibre_parameters(kind: str = "", superscript: str = "") -> tuple[Parameter, Parameter]:
    """Modulus and stiffening parameter of the fibres of one kind, or of the only kind."""
    name, symbol = (f"_{kind}", f"^{superscript}") if kind else ("", "")
    fibres = f"the {kind} fibres" if kind else "the fibres"
    modulus = f"modulus of {fibres}; 0.5 to 1000 in arteries"
    stiffening = f"stiffening of {fibres}; 0.01 to 100 in arteries"
    return (
        Parameter(f"k1{name}", f"k_1{symbol}", "kPa", (0.0, 500.0), modulus),
        Parameter(f"k2{name}", f"k_2{symbol}", "", (0.0, 50.0), stiffening, typical=(1.0, 2.0)),
    )


def _with_matrix(*fibres: Parameter) -> tuple[Parameter, ...]:
    """Parameters of a law: those of the matrix and the fibres, and the angle of the fibres."""
    matrix = "shear modulus of the matrix; 3 to 50 in arteries"
    angle = "angle of the fibres from the circumferential direction"
    return (
        Parameter("c", "c", "kPa", (0.0, 100.0), matrix),
        *fibres,
        Parameter("beta", r"\beta", "deg", (0.0, 90.0), angle, scale="logit"),
    )


class _Family(NamedTuple):
    """Fibre families with equal parameters at the angles ``±angle``."""

    number: int
    """Number of families, 1 or 2."""
    k1: Any
    """Modulus, kPa."""
    k2: Any
    """Stiffening parameter."""
    angle: Any
    """Angle from the circumferential direction, degrees."""
    dispersion: Any = None
    """Dispersion ``κ``; None for perfectly aligned fibres."""
    has_kink: bool = True
    """False for axial fibres, which inflation does not stretch."""

    @property
    def squares(self) -> tuple[Tensor, Tensor]:
        """``cos² β`` and ``sin² β``."""
        # PyTensor would take a Python number for single precision.
        angle = pt.deg2rad(pt.as_tensor(self.angle).astype("float64"))
        return pt.cos(angle) ** 2, pt.sin(angle) ** 2

    def strain(self, log_hoop: Any, log_axial: Any) -> Tensor:
        """Fibre strain ``E``, negative in slack fibres; accurate near 0."""
        cosine, sine = self.squares
        aligned = cosine * pt.expm1(2 * log_hoop) + sine * pt.expm1(2 * log_axial)
        if self.dispersion is None:
            return aligned
        dispersed = first_invariant_excess(log_hoop, log_axial)
        return self.dispersion * dispersed + (1 - 3 * self.dispersion) * aligned

    def stress(self, log_hoop: Any, log_axial: Any, axial: bool) -> Tensor:
        """``k1 E₊ exp(k2 E₊²) ∂E/∂x`` of all families, ``x = ln λθ``, or ``ln λz`` if `axial`."""
        own, other = (log_axial, log_hoop) if axial else (log_hoop, log_axial)
        half_slope = self.squares[int(axial)] * pt.exp(2 * own)
        if self.dispersion is not None:
            kappa = self.dispersion
            half_slope = 2 * kappa * half_difference(own, other) + (1 - 3 * kappa) * half_slope
        strain = pt.maximum(self.strain(log_hoop, log_axial), 0.0)
        return 2 * self.number * self.k1 * strain * pt.exp(self.k2 * strain**2) * half_slope


class _FibreReinforced(StrainEnergy):
    r"""Base class of laws with families of fibres in a neo-Hookean matrix of shear modulus ``c``.

    .. math:: W = \frac{c}{2} (I_1 - 3)
        + \sum_{\text{families}} \frac{k_1}{2 k_2} \left(e^{k_2 E_+^2} - 1\right), \quad
        E_+ = \max(E, 0), \quad E = κ (I_1 - 3) + (1 - 3κ)(λ_θ^2 \cos^2 β + λ_z^2 \sin^2 β - 1)
    """

    @abstractmethod
    def families(self, **parameters: Any) -> Sequence[_Family]:
        """Fibre families for all parameters except ``c``."""

    def energy(self, radial: Any, hoop: Any, axial: Any, *, c: Any, **parameters: Any) -> Tensor:
        """Strain energy in kPa."""
        log_hoop, log_axial = pt.log(hoop), pt.log(axial)
        total = c / 2 * (first_invariant(radial, hoop, axial) - 3)
        for family in self.families(**parameters):
            strain = pt.maximum(family.strain(log_hoop, log_axial), 0.0)
            total += family.number * family.k1 / (2 * family.k2) * pt.expm1(family.k2 * strain**2)
        return total

    def stress_difference(
        self, log_hoop: Any, log_axial: Any, *, c: Any, **parameters: Any
    ) -> Tensor:
        """``c (λθ² − λr²)``, and for each family ``k1 E₊ exp(k2 E₊²) ∂E/∂ln λθ``."""
        families = self.families(**parameters)
        fibres = sum(family.stress(log_hoop, log_axial, axial=False) for family in families)
        return 2 * c * half_difference(log_hoop, log_axial) + fibres

    def axial_stress_difference(
        self, log_hoop: Any, log_axial: Any, *, c: Any, **parameters: Any
    ) -> Tensor:
        """``c (λz² − λr²)``, and for each family ``k1 E₊ exp(k2 E₊²) ∂E/∂ln λz``."""
        families = self.families(**parameters)
        fibres = sum(family.stress(log_hoop, log_axial, axial=True) for family in families)
        return 2 * c * half_difference(log_axial, log_hoop) + fibres

    def kinks(self, log_axial: Tensor, *, c: Any, **parameters: Any) -> list[Tensor]:
        """Values of ``ln λθ`` at which a family becomes slack.

        They are the roots of ``E = 0``, a linear equation in ``λθ²`` for aligned fibres and a
        quadratic one for dispersed fibres.
        """
        axial = pt.exp(2 * log_axial)
        squares: list[Tensor] = []
        for family in self.families(**parameters):
            if not family.has_kink:
                continue
            cosine, sine = family.squares
            if family.dispersion is None:
                squares.append((1 - axial * sine) / cosine)
                continue
            kappa = family.dispersion
            quadratic = kappa + (1 - 3 * kappa) * cosine
            linear = kappa * (3 - axial) + (1 - 3 * kappa) * (1 - axial * sine)
            discriminant = linear**2 - 4 * quadratic * kappa / axial
            real = (discriminant > 0) & (linear > 0)
            double = linear + pt.sqrt(pt.where(real, discriminant, 1.0))
            squares.append(pt.where(real, double / (2 * quadratic), 0.0))
            squares.append(pt.where(real, 2 * kappa / (axial * double), 0.0))
        kinks = []
        for square in squares:
            exists = square > 0
            # The inner `where` keeps the gradient of the unused branch finite.
            log = pt.log(pt.where(exists, square, 1.0)) / 2
            kinks.append(pt.where(exists, log, np.inf))
        return kinks


class HolzapfelGasserOgden(_FibreReinforced):
    r"""Two families of collagen fibres, helices around the tube, in a neo-Hookean matrix.

    .. math:: W = \frac{c}{2} (I_1 - 3) + \frac{k_1}{k_2} \left(e^{k_2 E^2} - 1\right), \qquad
        E = \max(λ_θ^2 \cos^2 β + λ_z^2 \sin^2 β - 1, 0)

    The families have the angles ``±β`` (degrees) from the circumferential direction and equal
    strain; each has the factor ``k1/(2 k2)``. Fibres carry load in tension only. At the stretch
    where they become slack, stress is continuous and the stiffness has a jump. Quadrature of the
    wall is split there.

    Source: G. A. Holzapfel, T. C. Gasser and R. W. Ogden, Journal of Elasticity 61 (2000) 1-48.

    See Also
    --------
    GasserOgdenHolzapfel, FourFiber

    Examples
    --------
    >>> import pymc_hyperelastic as ph
    >>> radius, tube = [7.5, 8.5], ph.Tube(7.0, 9.0)
    >>> parameters = {"c": 10.0, "k1": 20.0, "k2": 1.0, "beta": 30.0}
    >>> ph.inflation_pressure(ph.HolzapfelGasserOgden(), radius, tube, **parameters).eval().round(3)
    array([1.821, 5.759])
    """

    equation = (
        "W = (c/2) (I₁ − 3) + (k₁/k₂) (e^(k₂ E²) − 1), E = max(λ_θ² cos² β + λ_z² sin² β − 1, 0)"
    )
    parameters = _with_matrix(*_fibre_parameters())

    def families(self, *, k1: Any, k2: Any, beta: Any) -> Sequence[_Family]:
        """Two aligned families at ``±β``."""
        return [_Family(2, k1, k2, beta)]


class GasserOgdenHolzapfel(_FibreReinforced):
    r"""Two families of dispersed collagen fibres in a neo-Hookean matrix.

    .. math:: W = \frac{c}{2} (I_1 - 3) + \frac{k_1}{k_2} \left(e^{k_2 E^2} - 1\right), \qquad
        E = \max\left(κ (I_1 - 3) + (1 - 3κ)(λ_θ^2 \cos^2 β + λ_z^2 \sin^2 β - 1), 0\right)

    Fibres are aligned for ``κ = 0``, as in :class:`HolzapfelGasserOgden`, and distributed uniformly
    over all directions for ``κ = 1/3``. A family is slack if its mean strain ``E`` is negative.
    This differs from the printed condition on the strain of the mean direction, with which the
    stress would have a jump.

    Source: T. C. Gasser, R. W. Ogden and G. A. Holzapfel, Journal of the Royal Society Interface 3
    (2006) 15-35.

    See Also
    --------
    HolzapfelGasserOgden

    Examples
    --------
    >>> import pymc_hyperelastic as ph
    >>> radius, tube = [7.5, 8.5], ph.Tube(7.0, 9.0)
    >>> parameters = {"c": 10.0, "k1": 20.0, "k2": 1.0, "kappa": 0.1, "beta": 30.0}
    >>> ph.inflation_pressure(ph.GasserOgdenHolzapfel(), radius, tube, **parameters).eval().round(3)
    array([1.18 , 3.655])
    """

    equation = (
        "W = (c/2) (I₁ − 3) + (k₁/k₂) (e^(k₂ E²) − 1), "
        "E = max(κ (I₁ − 3) + (1 − 3κ) (λ_θ² cos² β + λ_z² sin² β − 1), 0)"
    )
    parameters = _with_matrix(
        *_fibre_parameters(),
        Parameter("kappa", r"\kappa", "", (0.0, 1 / 3), "dispersion; 1/3: uniform", scale="logit"),
    )

    def families(self, *, k1: Any, k2: Any, kappa: Any, beta: Any) -> Sequence[_Family]:
        """Two dispersed families with mean angles ``±β``."""
        return [_Family(2, k1, k2, beta, kappa)]


class FourFiber(_FibreReinforced):
    r"""Four families of fibres, axial, circumferential and two diagonal, in a neo-Hookean matrix.

    .. math:: W = \frac{c}{2} (I_1 - 3)
        + \sum_{i=1}^4 \frac{k_1^i}{2 k_2^i} \left(e^{k_2^i E_i^2} - 1\right), \qquad
        E_i = \max(λ_θ^2 \cos^2 β_i + λ_z^2 \sin^2 β_i - 1, 0)

    The angles ``βi`` are 90°, 0 and ``±β``; both diagonal families have the same parameters. Fibres
    carry load in tension only. The source prints the factor ``c1/(4 c2)``, with ``c1 = 2 k1``.

    In some vessels, such as the ascending aorta of mice, the modulus of the hoop fibres is nearly
    0, and the data do not determine their stiffening. With ``hoop_fibres=False`` sampling is then
    several times as fast.

    Source: S. Baek, R. L. Gleason, K. R. Rajagopal and J. D. Humphrey, Computer Methods in Applied
    Mechanics and Engineering 196 (2007) 3070-3078.

    Parameters
    ----------
    hoop_fibres : bool, default True
        If False, omit the circumferential fibres and their parameters ``k1_hoop``, ``k2_hoop``.

    Raises
    ------
    ValueError
        If `hoop_fibres` is not a bool.

    See Also
    --------
    HolzapfelGasserOgden

    Examples
    --------
    >>> import pymc_hyperelastic as ph
    >>> radius, tube = [7.5, 8.5], ph.Tube(7.0, 9.0)
    >>> parameters = {"c": 10.0, "k1_axial": 5.0, "k2_axial": 0.5, "k1_hoop": 5.0}
    >>> parameters |= {"k2_hoop": 0.5, "k1_diagonal": 10.0, "k2_diagonal": 0.5, "beta": 40.0}
    >>> ph.inflation_pressure(ph.FourFiber(), radius, tube, **parameters).eval().round(3)
    array([1.193, 3.508])

    Without hoop fibres:

    >>> ph.FourFiber(hoop_fibres=False).parameter_names
    ('c', 'k1_axial', 'k2_axial', 'k1_diagonal', 'k2_diagonal', 'beta')
    """

    equation = (
        "W = (c/2) (I₁ − 3) + Σ (k₁ⁱ/(2 k₂ⁱ)) (e^(k₂ⁱ E_i²) − 1), "
        "E_i = max(λ_θ² cos² β_i + λ_z² sin² β_i − 1, 0), i = 1 to 4"
    )

    def __init__(self, hoop_fibres: bool = True) -> None:
        if not isinstance(hoop_fibres, bool):
            raise ValueError(f"hoop_fibres is {hoop_fibres!r}; expected True or False")
        self.hoop_fibres = hoop_fibres

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """Parameters of the matrix and of all families."""
        return _with_matrix(
            *_fibre_parameters("axial", "z"),
            *(_fibre_parameters("hoop", r"\theta") if self.hoop_fibres else ()),
            *_fibre_parameters("diagonal", "d"),
        )

    def families(self, *, beta: Any, **moduli: Any) -> Sequence[_Family]:
        """Axial fibres, hoop fibres if the law has them, and two diagonal families at ``±β``."""
        families = []
        for kind, number, angle in (("axial", 1, 90.0), ("hoop", 1, 0.0), ("diagonal", 2, beta)):
            if f"k1_{kind}" in moduli:
                own = moduli[f"k1_{kind}"], moduli[f"k2_{kind}"]
                families.append(_Family(number, *own, angle, has_kink=kind != "axial"))
        return families


class HolzapfelOgden(_FibreReinforced):
    r"""Myocardium in its plane: fibres and cross-fibres in an exponential matrix.

    .. math:: W = \frac{a}{2 b} \left(e^{b (I_1 - 3)} - 1\right)
        + \frac{a_f}{2 b_f} \left(e^{b_f E_θ^2} - 1\right)
        + \frac{a_n}{2 b_n} \left(e^{b_n E_z^2} - 1\right), \qquad E_i = \max(λ_i^2 - 1, 0)

    The muscle fibres have the hoop direction of a tube, and the x direction of a sheet. The second
    family is perpendicular to them, axial in a tube and along y in a sheet: the sheet or the normal
    direction of the source, depending on which of the two is in the plane. The term of the source
    with the shear of fibres and sheets is zero, because the stretches are along the fibres and
    perpendicular to them. Fibres carry load in tension only. The shear modulus of the matrix is
    ``a``.

    Source: G. A. Holzapfel and R. W. Ogden, Philosophical Transactions of the Royal Society A 367
    (2009) 3445-3475.

    See Also
    --------
    FourFiber, Demiray

    Examples
    --------
    Human myocardium under equal stretches has a larger stress along the fibres:

    >>> import pymc_hyperelastic as ph
    >>> parameters = {"a": 0.96, "b": 5.46, "a_fibre": 3.36, "b_fibre": 23.7}
    >>> parameters |= {"a_cross": 2.06, "b_cross": 17.0}
    >>> stress = ph.sheet_stress(ph.HolzapfelOgden(), 1.1, 1.1, nominal=True, **parameters)
    >>> round(float(stress.x.eval()), 2), round(float(stress.y.eval()), 2)
    (5.22, 2.82)

    A tube of a softer material:

    >>> soft = {"a": 10.0, "b": 0.5, "a_fibre": 10.0, "b_fibre": 1.0}
    >>> soft |= {"a_cross": 5.0, "b_cross": 1.0}
    >>> tube = ph.Tube(7.0, 9.0)
    >>> ph.inflation_pressure(ph.HolzapfelOgden(), [7.5, 8.5], tube, **soft).eval().round(3)
    array([1.091, 3.412])
    """

    equation = (
        "W = (a/(2 b)) (e^(b (I₁ − 3)) − 1) + (a_f/(2 b_f)) (e^(b_f E_θ²) − 1) "
        "+ (a_n/(2 b_n)) (e^(b_n E_z²) − 1), E_i = max(λ_i² − 1, 0)"
    )
    parameters = (
        Parameter("a", "a", "kPa", (0.0, 20.0), "modulus of the matrix; 0.06 to 2.3 in hearts"),
        Parameter("b", "b", "", (0.0, 50.0), "stiffening of the matrix; 5 to 10 in hearts"),
        Parameter("a_fibre", "a_f", "kPa", (0.0, 100.0), "fibre modulus; 2 to 18 in hearts"),
        Parameter("b_fibre", "b_f", "", (0.0, 100.0), "fibre stiffening; 16 to 24 in hearts"),
        Parameter("a_cross", "a_n", "kPa", (0.0, 100.0), "cross-fibre modulus; 2 in hearts"),
        Parameter("b_cross", "b_n", "", (0.0, 100.0), "cross-fibre stiffening; 11 to 17 in hearts"),
    )

    def families(
        self, *, a_fibre: Any, b_fibre: Any, a_cross: Any, b_cross: Any
    ) -> Sequence[_Family]:
        """Fibres along the hoop direction, and a family along the axial direction."""
        return [
            _Family(1, a_fibre, b_fibre, 0.0),
            _Family(1, a_cross, b_cross, 90.0, has_kink=False),
        ]

    def energy(
        self, radial: Any, hoop: Any, axial: Any, *, a: Any, b: Any, **fibres: Any
    ) -> Tensor:
        """Strain energy in kPa."""
        matrix = a / (2 * b) * pt.expm1(b * (first_invariant(radial, hoop, axial) - 3))
        return matrix + super().energy(radial, hoop, axial, c=0.0, **fibres)

    def stress_difference(
        self, log_hoop: Any, log_axial: Any, *, a: Any, b: Any, **fibres: Any
    ) -> Tensor:
        """Stress of a neo-Hookean matrix of the modulus ``a e^(b (I₁ − 3))``, and of the fibres."""
        modulus = a * pt.exp(b * first_invariant_excess(log_hoop, log_axial))
        return super().stress_difference(log_hoop, log_axial, c=modulus, **fibres)

    def axial_stress_difference(
        self, log_hoop: Any, log_axial: Any, *, a: Any, b: Any, **fibres: Any
    ) -> Tensor:
        """:meth:`stress_difference` for ``λz``."""
        modulus = a * pt.exp(b * first_invariant_excess(log_hoop, log_axial))
        return super().axial_stress_difference(log_hoop, log_axial, c=modulus, **fibres)

    def kinks(self, log_axial: Tensor, *, a: Any, b: Any, **fibres: Any) -> list[Tensor]:
        """Zero, where the fibres of the hoop direction become slack."""
        return super().kinks(log_axial, c=a, **fibres)
