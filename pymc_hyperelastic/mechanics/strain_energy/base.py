"""Base class of all strain energies, their parameters, and their registry.

Kinematics and notation follow G. A. Holzapfel, Nonlinear Solid Mechanics, Wiley 2000, chapter 6.
"""

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from inspect import isabstract, signature
from itertools import islice
from typing import Any, ClassVar, Literal

import numpy as np
import pytensor.tensor as pt
from pytensor import function
from pytensor.gradient import grad
from pytensor.graph.basic import Variable
from pytensor.tensor.variable import TensorVariable as Tensor

from pymc_hyperelastic.messages import shown
from pymc_hyperelastic.parallel import one_thread

__all__ = ["Parameter", "StrainEnergy", "list_strain_energies"]


@dataclass(frozen=True)
class Parameter:
    """One material parameter: its name, unit and default priors.

    Attributes
    ----------
    name : str
        Name in code, and of the random variable in a model.
    symbol : str
        LaTeX symbol, without dollar signs.
    unit : str
        ``"kPa"`` for a modulus, ``""`` for a dimensionless parameter, ``"deg"`` for an angle.
    prior_range : tuple of float
        Bounds of the default uniform prior, in `unit`. It is a fixed physical range: if it depended
        on the data, the evidences of two classes could not be compared.
    description : str
        Meaning of the parameter, and published values that support the range.
    size : int, optional
        Number of entries of a vector parameter; by default the parameter is a scalar.
    scale : {"log", "logit", "real"}, optional
        Transformation after which the specimens of a class are normally distributed: the logarithm,
        the logit between the bounds of `prior_range`, or none. By default "log" if `prior_range`
        has no negative values, else "real". Use "log" for a parameter whose sign has no effect; the
        specimens of a class then have positive values.
    typical : tuple of float, optional
        Median over tissues of a dimensionless parameter on the scale "log", and standard deviation
        of its logarithm: the prior of a class's location. By default a sixth of the upper bound of
        `prior_range`, and 1.2.

    See Also
    --------
    StrainEnergy

    Examples
    --------
    >>> import pymc_hyperelastic as ph
    >>> stiffening = ph.Parameter("b", "b", "", (0.0, 20.0), "stiffening exponent")
    >>> stiffening.natural_scale
    'log'
    """

    name: str
    symbol: str
    unit: str
    prior_range: tuple[float, float]
    description: str
    size: int | None = None
    scale: Literal["log", "logit", "real"] | None = None
    typical: tuple[float, float] | None = None

    @property
    def natural_scale(self) -> str:
        """The attribute `scale`, or its default."""
        return self.scale or ("log" if self.prior_range[0] >= 0 else "real")


class StrainEnergy(ABC):
    r"""A hyperelastic material, defined by its strain energy.

    A subclass states its :attr:`parameters` and implements :meth:`energy`: the energy ``W`` per
    reference volume, as a PyTensor expression of the principal stretches. Pressure, stiffness,
    axial force, gradients, models, evidence and classification follow from ``W``. A vector
    parameter is passed as a tuple of its entries.

    The attributes of an instance are settings of the law: numbers, text, or tuples of them. Two
    instances of one class with equal attributes are equal.

    **Names.** A result stores the name of the class, the attributes of the instance, and its
    :attr:`fingerprint`. The names of the package's own laws are reserved: a subclass elsewhere that
    takes one raises TypeError. If two of your own classes have one name, it refers to the class
    that was defined last, and results of the other class are refused when they are read.

    See Also
    --------
    Parameter, list_strain_energies

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
    >>> tube = ph.Tube(1.0, 1.5)
    >>> round(float(ph.inflation_pressure(NeoHookeanTube(), 1.2, tube, mu=10.0).eval()), 6)
    1.640095
    """

    parameters: ClassVar[tuple[Parameter, ...]] = ()
    equation: ClassVar[str] = ""
    """The energy as text, such as ``"W = (μ/2) (I₁ − 3)"``, for reports; optional."""
    _registry: ClassVar[dict[str, type["StrainEnergy"]]] = {}

    def __init_subclass__(cls, **kwargs: Any) -> None:
        super().__init_subclass__(**kwargs)
        if isabstract(cls):
            return
        if not isinstance(cls.parameters, property):  # a property depends on the instance
            cls._check_parameters()
        taken = StrainEnergy._registry.get(cls.__name__)
        if taken and _is_built_in(taken) and not _is_built_in(cls):
            raise TypeError(
                f"the name {cls.__name__} is reserved: a strain energy {cls.__name__} is part of "
                "the package, and results refer to it by this name. Rename your class"
            )
        StrainEnergy._registry[cls.__name__] = cls

    @classmethod
    def _check_parameters(cls) -> None:
        """Raise TypeError unless :attr:`parameters` and :meth:`energy` have the same names."""
        if wrong := [p for p in cls.parameters if not isinstance(p, Parameter)]:
            raise TypeError(
                f"strain energy {cls.__name__}: `parameters` holds {shown(wrong[0])}; expected a "
                'ph.Parameter, such as ph.Parameter("c", "c", "kPa", (0, 100), "modulus")'
            )
        stated = [p.name for p in cls.parameters]
        arguments = signature(cls.energy).parameters.values()
        keywords = [a.name for a in arguments if a.kind is a.KEYWORD_ONLY]
        takes_any = any(a.kind is a.VAR_KEYWORD for a in arguments)
        if sorted(stated) != sorted(keywords) and not takes_any:
            raise TypeError(
                f"strain energy {cls.__name__}: `parameters` has the names {stated}, but `energy` "
                f"has the keyword-only arguments {keywords}. Use the same names in both"
            )

    @abstractmethod
    def energy(self, radial: Any, hoop: Any, axial: Any, **parameters: Tensor) -> Tensor:
        """Return the energy ``W(λr, λθ, λz)`` in kPa, elementwise in stretches and parameters."""

    def stress_difference(self, log_hoop: Any, log_axial: Any, **parameters: Any) -> Tensor:
        r"""Cauchy stress difference ``σθθ − σrr`` in kPa.

        .. math:: σ_{θθ} - σ_{rr} = λ_θ \frac{∂\hat W}{∂λ_θ} = \frac{∂\hat W}{∂\ln λ_θ}, \qquad
            \hat W(λ_θ, λ_z) = W(1/(λ_θ λ_z), λ_θ, λ_z)

        The default differentiates :meth:`energy`. It is not finite if the energy is not: no stress
        brings the material to such stretches. Override it with a closed form if that is faster or
        more accurate: near zero stress the derivative is a small difference of large numbers.
        The first arguments are natural logarithms of the stretches; ``log_hoop`` has the full
        broadcast shape.
        """
        energy = self.reduced_energy(log_hoop, log_axial, **parameters)
        return _derivative_where_finite(energy, log_hoop)

    def axial_stress_difference(self, log_hoop: Any, log_axial: Any, **parameters: Any) -> Tensor:
        r"""Cauchy stress difference ``σzz − σrr = ∂Ŵ/∂ln λz`` in kPa, needed for the axial force.

        The default differentiates :meth:`energy`. Arguments are those of
        :meth:`stress_difference`.
        """
        # The derivative is elementwise: each entry of the energy needs its own axial stretch.
        log_axial = log_axial + pt.zeros_like(log_hoop)
        energy = self.reduced_energy(log_hoop, log_axial, **parameters)
        return _derivative_where_finite(energy, log_axial)

    def reduced_energy(self, log_hoop: Any, log_axial: Any, **parameters: Any) -> Tensor:
        """Energy ``Ŵ(λθ, λz) = W(1/(λθ λz), λθ, λz)`` of the incompressible solid, kPa."""
        hoop, axial = pt.exp(log_hoop), pt.exp(log_axial)
        energy = self.energy(pt.exp(-log_hoop - log_axial), hoop, axial, **parameters)
        if not isinstance(energy, Variable):
            raise TypeError(
                f"`energy` of {self.name} gave {energy!r}; expected a PyTensor expression of the "
                "stretches. Check that the method ends with `return`"
            )
        return energy

    def kinks(self, log_axial: Tensor, **parameters: Tensor) -> Sequence[Tensor]:
        """Values of ``ln λθ`` at which the stress is not smooth; empty by default.

        Quadrature of the wall is split there. Laws have kinks if their fibres carry load in tension
        only. The value is NaN, or beyond any wall, for materials without a kink.
        """
        return ()

    @property
    def fingerprint(self) -> tuple[float, ...]:
        """Stresses in kPa at fixed stretches and parameters, which identify the formula.

        The values are ``σθθ − σrr`` and ``σzz − σrr`` at three pairs of stretches, rounded to six
        digits. A result stores them: a law of the same name with another formula is recognised.
        """
        return _fingerprint(self)

    def split(self, parameters: Mapping[str, Any]) -> list[Any]:
        """List all entries of all parameters, in order; those of a vector are on its last axis.

        Raise TypeError if a parameter is missing or unknown, or a vector has a wrong length.
        """
        if set(parameters) != set(self.parameter_names):
            raise TypeError(
                f"{self.name} has the parameters {list(self.parameter_names)}, but "
                f"{sorted(parameters)} were given"
            )
        entries: list[Any] = []
        for p in self.parameters:
            value = parameters[p.name]
            if p.size is None or (isinstance(value, tuple) and len(value) == p.size):
                entries += [value] if p.size is None else value  # `join` returns tuples
                continue
            value = value if isinstance(value, Variable) else np.asarray(value, float)
            shape = value.type.shape if isinstance(value, Variable) else value.shape
            if shape[-1:] not in ((p.size,), (None,)):
                raise TypeError(
                    f"parameter {p.name!r} of {self!r} has the shape {shape}; expected {p.size} "
                    "entries along the last axis"
                )
            entries += [value[..., i] for i in range(p.size)]
        return entries

    def join(self, entries: Sequence[Any]) -> dict[str, Any]:
        """Return the parameters by name from the list of :meth:`split`, vectors as tuples."""
        rest = iter(entries)
        return {
            p.name: next(rest) if p.size is None else tuple(islice(rest, p.size))
            for p in self.parameters
        }

    @property
    def name(self) -> str:
        """Name of the class, by which results refer to this strain energy."""
        return type(self).__name__

    @property
    def parameter_names(self) -> tuple[str, ...]:
        """Names of the parameters, in the order of their declaration."""
        return tuple(p.name for p in self.parameters)

    @property
    def entry_names(self) -> tuple[str, ...]:
        """Names of all entries of all parameters, such as ``mu[0]``, in the order of `split`."""
        return tuple(
            name
            for p in self.parameters
            for name in ([p.name] if p.size is None else [f"{p.name}[{i}]" for i in range(p.size)])
        )

    @staticmethod
    def from_name(name: str, **settings: Any) -> "StrainEnergy":
        """Return an instance of the class called `name`, built in or defined by the user.

        Raise ValueError if no class has this name, or the class does not accept these settings.
        """
        if not isinstance(name, str) or name not in StrainEnergy._registry:
            raise ValueError(
                f"no strain energy is called {name!r}; expected one of "
                f"{sorted(StrainEnergy._registry)}. Run or import its class first if it is yours"
            )
        law = StrainEnergy._registry[name]
        accepted = signature(law).parameters
        unknown = sorted(set(settings) - set(accepted))
        if unknown and not any(s.kind is s.VAR_KEYWORD for s in accepted.values()):
            raise ValueError(
                f"{name} has the settings {list(accepted)}, but {unknown} were given as well"
            )
        # Files store tuples as lists.
        return law(**{n: tuple(v) if isinstance(v, list) else v for n, v in settings.items()})

    def __eq__(self, other: object) -> bool:
        return type(self) is type(other) and vars(self) == vars(other)

    def __hash__(self) -> int:
        try:
            return hash((type(self), *sorted(vars(self).items())))
        except TypeError:
            raise TypeError(
                f"an attribute of {self!r} is not hashable; use tuples instead of lists and arrays"
            ) from None

    def __repr__(self) -> str:
        settings = ", ".join(f"{name}={value!r}" for name, value in vars(self).items())
        return f"{self.name}({settings})"


class IsotropicStrainEnergy(StrainEnergy):
    """Base class of laws whose energy is symmetric in the three principal stretches."""

    def axial_stress_difference(self, log_hoop: Any, log_axial: Any, **parameters: Any) -> Tensor:
        """``σzz − σrr``: :meth:`stress_difference` with hoop and axial stretch exchanged."""
        return self.stress_difference(log_axial, log_hoop, **parameters)


def list_strain_energies() -> list[str]:
    """Names of all strain energies, built in and defined by the user.

    :meth:`StrainEnergy.from_name` returns the law of a name.

    See Also
    --------
    StrainEnergy

    Examples
    --------
    >>> import pymc_hyperelastic as ph
    >>> "HolzapfelGasserOgden" in ph.list_strain_energies()
    True
    """
    return list(StrainEnergy._registry)


def _is_built_in(law: type[StrainEnergy]) -> bool:
    return law.__module__.startswith(f"{__name__.rpartition('.')[0]}.")


@lru_cache
@one_thread
def _fingerprint(law: StrainEnergy) -> tuple[float, ...]:
    # Two hoop stretches in tension and one in compression: none so large that a law overflows.
    log_hoop, log_axial = map(pt.constant, np.log([[1.1, 1.2, 0.95], [1.05, 1.1, 1.02]]))
    ranges = [p.prior_range for p in law.parameters for _ in range(p.size or 1)]
    low, high = np.reshape(ranges, (-1, 2)).T
    # Between 0.3 and 0.5 of the range, different for each entry, so that exchanging two parameters
    # changes the stresses.
    fractions = 0.3 + 0.4 / (2 + np.arange(len(low)))
    parameters = law.join([pt.constant(x) for x in low + fractions * (high - low)])
    stresses = [
        law.stress_difference(log_hoop, log_axial, **parameters),
        law.axial_stress_difference(log_hoop, log_axial, **parameters),
    ]
    values = function([], stresses, mode="FAST_COMPILE")()
    return tuple(float(f"{value:.6g}") for value in np.ravel(values))


def check_terms(terms: Any) -> int:
    """Return the number of terms of a series; raise ValueError unless it is at least 1."""
    if not isinstance(terms, int) or isinstance(terms, bool) or terms < 1:
        raise ValueError(f"terms is {terms!r}; expected a whole number, at least 1")
    return terms


def elementwise_derivative(y: Tensor, x: Tensor) -> Tensor:
    """Derivative ``∂y/∂x`` where each entry of `y` depends on the same entry of `x` only."""
    return grad(y.sum(), x, disconnected_inputs="ignore")


def _derivative_where_finite(energy: Tensor, x: Tensor) -> Tensor:
    """Derivative of the energy; not a finite number where the energy is not.

    The formula of a derivative may be finite where the energy is not: that of ``ln x`` is ``1/x``.
    """
    slope = elementwise_derivative(energy, x)
    return pt.where(pt.isfinite(energy) | pt.isinf(slope), slope, np.nan)


def half_difference(log_hoop: Any, log_axial: Any) -> Tensor:
    """``½ (λθ² − λr²) = e^{−z} sinh γ`` with ``γ = 2 ln λθ + ln λz``, ``z = ln λz``."""
    return pt.exp(-log_axial) * pt.sinh(2 * log_hoop + log_axial)


def first_invariant_excess(log_hoop: Any, log_axial: Any) -> Tensor:
    """``I₁ − 3 = 4 e^{−z} sinh²(γ/2) + 2 e^{−z} + e^{2z} − 3``, accurate near 0."""
    across = 4 * pt.exp(-log_axial) * pt.sinh(log_hoop + log_axial / 2) ** 2
    return across + 2 * pt.expm1(-log_axial) + pt.expm1(2 * log_axial)
