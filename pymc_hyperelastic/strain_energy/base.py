"""What a strain energy is: its parameters and its equation."""

from abc import ABC, abstractmethod
from dataclasses import dataclass
from inspect import signature
from typing import Any, ClassVar

import pytensor.tensor as pt
from pytensor.gradient import grad
from pytensor.tensor.variable import TensorVariable

__all__ = ["Parameter", "StrainEnergy", "elementwise_derivative"]


@dataclass(frozen=True)
class Parameter:
    """One material parameter: what it is called, measured in, and believed to be beforehand.

    Attributes
    ----------
    name : str
        Name in code; also the name of the random variable.
    symbol : str
        LaTeX symbol, without dollar signs.
    unit : str
        ``"kPa"`` for a modulus, ``""`` for a pure number.
    prior_range : tuple of float
        Ends of the default uniform prior. It is an absolute physical range: it never depends on
        the data, or evidences of two classes could not be compared.
    description : str
        What the parameter means, and where the range comes from.
    """

    name: str
    symbol: str
    unit: str
    prior_range: tuple[float, float]
    description: str


class StrainEnergy(ABC):
    r"""A hyperelastic material, stated by its strain energy.

    A subclass names its :attr:`parameters` and writes :meth:`energy`, the energy ``W`` per unit of
    reference volume as a PyTensor expression of the principal stretches. Nothing else is needed:
    pressure, stiffness, their gradients, models, evidence and classification follow from it.

    Two instances of one class with the same attributes are equal.

    Examples
    --------
    >>> import pymc_hyperelastic as ph
    >>> class NeoHookeanTube(ph.StrainEnergy):
    ...     '''W = μ/2 (I₁ − 3).'''
    ...
    ...     parameters = (ph.Parameter("mu", r"\mu", "kPa", (0.0, 200.0), "shear modulus"),)
    ...
    ...     def energy(self, radial, hoop, axial, *, mu):
    ...         return mu / 2 * (radial**2 + hoop**2 + axial**2 - 3)
    >>> pressure = ph.inflation_pressure(
    ...     NeoHookeanTube(), 1.2, inner_radius=1.0, outer_radius=1.5, mu=10.0
    ... )
    >>> round(float(pressure.eval()), 6)
    1.640095
    """

    parameters: ClassVar[tuple[Parameter, ...]] = ()
    _registry: ClassVar[dict[str, type["StrainEnergy"]]] = {}

    def __init_subclass__(cls, **kwargs: Any) -> None:
        super().__init_subclass__(**kwargs)
        stated = [p.name for p in cls.parameters]
        arguments = signature(cls.energy).parameters.values()
        written = [
            argument.name for argument in arguments if argument.kind is argument.KEYWORD_ONLY
        ]
        if sorted(stated) != sorted(written):
            raise TypeError(
                f"strain energy {cls.__name__}: `parameters` names {stated} but `energy` takes the "
                f"keyword-only arguments {written}; both must list the same names."
            )
        StrainEnergy._registry[cls.__name__] = cls

    @abstractmethod
    def energy(
        self, radial: Any, hoop: Any, axial: Any, **parameters: TensorVariable
    ) -> TensorVariable:
        """Strain energy ``W(λr, λθ, λz)`` in kPa, elementwise in the stretches and parameters."""

    def stress_difference(
        self, log_hoop: TensorVariable, log_axial: TensorVariable, **parameters: TensorVariable
    ) -> TensorVariable:
        r"""Cauchy stress difference ``σθθ − σrr`` in kPa, the wall's response to its stretches.

        .. math:: σ_{θθ} - σ_{rr} = λ_θ \frac{∂\hat W}{∂λ_θ} = \frac{∂\hat W}{∂\ln λ_θ}, \qquad
            \hat W(λ_θ, λ_z) = W(1/(λ_θ λ_z), λ_θ, λ_z)

        It is derived from :meth:`energy`. A class may override it with a closed form where that is
        faster, or keeps digits that the difference of two derivatives loses near zero stress.

        Parameters
        ----------
        log_hoop, log_axial : TensorVariable
            Natural logarithms of the stretches; ``log_hoop`` has the full broadcast shape.
        **parameters : TensorVariable
            The material parameters, by name.
        """
        hoop, axial = pt.exp(log_hoop), pt.exp(log_axial)
        radial = pt.exp(-log_hoop - log_axial)
        return elementwise_derivative(self.energy(radial, hoop, axial, **parameters), log_hoop)

    @property
    def name(self) -> str:
        """Name under which results refer to this strain energy."""
        return type(self).__name__

    @property
    def parameter_names(self) -> tuple[str, ...]:
        """Names of the parameters, in the order of their declaration."""
        return tuple(p.name for p in self.parameters)

    @staticmethod
    def from_name(name: str) -> "StrainEnergy":
        """Strain energy whose class is called `name`: one of the zoo, or one defined by the user.

        Raises
        ------
        ValueError
            If no such class has been defined.
        """
        if name not in StrainEnergy._registry:
            raise ValueError(
                f"no strain energy is called {name!r}; known are {sorted(StrainEnergy._registry)}. "
                "If it is your own, run or import its class first."
            )
        return StrainEnergy._registry[name]()

    def __eq__(self, other: object) -> bool:
        return type(self) is type(other) and vars(self) == vars(other)

    def __hash__(self) -> int:
        return hash((type(self), *sorted(vars(self).items())))

    def __repr__(self) -> str:
        settings = ", ".join(f"{name}={value!r}" for name, value in vars(self).items())
        return f"{self.name}({settings})"


def elementwise_derivative(y: TensorVariable, x: TensorVariable) -> TensorVariable:
    """Derivative of `y` by `x`, where each entry of `y` depends on that of `x` alone."""
    return grad(y.sum(), x, disconnected_inputs="ignore")
