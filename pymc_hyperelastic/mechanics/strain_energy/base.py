"""What a strain energy is: its parameters and its equation."""

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from inspect import isabstract, signature
from itertools import islice
from typing import Any, ClassVar, Literal

import numpy as np
import pytensor.tensor as pt
from pytensor import function
from pytensor.gradient import grad
from pytensor.graph.basic import Variable
from pytensor.tensor.variable import TensorVariable as Tensor

from pymc_hyperelastic.parallel import one_thread

# Hoop and axial stretches at which stresses tell one formula from another: tension, both, and
# compression along the hoop. They are small, so that the stresses of steep laws are finite.
_FINGERPRINT_STRETCHES = ((1.1, 1.05), (1.2, 1.1), (0.95, 1.02))


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
    size : int, optional
        Number of entries of a vector, such as one modulus a term; a scalar when missing.
    scale : {"log", "logit", "real"}, optional
        Where specimens of one kind are spread normally: in the logarithm, in the logit between the
        ends of `prior_range`, or in the parameter itself. When missing, "log" if `prior_range`
        holds no negative numbers, else "real". A parameter whose sign makes no difference is
        positive on "log".
    typical : tuple of float, optional
        Of a pure number on "log": its median over tissues, and the standard deviation of its
        logarithm. From it classes whose specimens differ have the prior of their location. When
        missing, a sixth of the upper end of `prior_range`, and 1.2.

    See Also
    --------
    StrainEnergy

    Examples
    --------
    >>> import pymc_hyperelastic as ph
    >>> stiffening = ph.Parameter("b", "b", "", (0.0, 20.0), "how soon the wall stiffens")
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
        """The scale, with its default filled in."""
        return self.scale or ("log" if self.prior_range[0] >= 0 else "real")


class StrainEnergy(ABC):
    r"""A hyperelastic material, stated by its strain energy.

    A subclass names its :attr:`parameters` and writes :meth:`energy`, the energy ``W`` per unit of
    reference volume as a PyTensor expression of the principal stretches. Nothing else is needed:
    pressure, stiffness, axial force, their gradients, models, evidence and classification follow
    from it. A vector parameter comes as a tuple of its entries.

    Two instances of one class with the same attributes are equal.

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
        if isabstract(cls):
            return
        if not isinstance(cls.parameters, property):  # else known only of an instance
            cls._check_parameters()
        known = StrainEnergy._registry.get(cls.__name__)
        if known and _is_of_the_zoo(known) and not _is_of_the_zoo(cls):
            raise TypeError(
                f"a strain energy {cls.__name__} is part of the package, and results refer to it "
                "by this name: give your class another one"
            )
        StrainEnergy._registry[cls.__name__] = cls

    @classmethod
    def _check_parameters(cls) -> None:
        """Raise TypeError unless :attr:`parameters` and :meth:`energy` name the same."""
        stated = [p.name for p in cls.parameters]
        arguments = signature(cls.energy).parameters.values()
        written = [
            argument.name for argument in arguments if argument.kind is argument.KEYWORD_ONLY
        ]
        takes_any = any(argument.kind is argument.VAR_KEYWORD for argument in arguments)
        if sorted(stated) != sorted(written) and not takes_any:
            raise TypeError(
                f"strain energy {cls.__name__}: `parameters` names {stated} but `energy` takes the "
                f"keyword-only arguments {written}; both must list the same names."
            )

    @abstractmethod
    def energy(self, radial: Any, hoop: Any, axial: Any, **parameters: Tensor) -> Tensor:
        """Strain energy ``W(λr, λθ, λz)`` in kPa, elementwise in the stretches and parameters."""

    def stress_difference(
        self, log_hoop: Tensor, log_axial: Tensor, **parameters: Tensor
    ) -> Tensor:
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
        return elementwise_derivative(
            self._reduced_energy(log_hoop, log_axial, **parameters), log_hoop
        )

    def axial_stress_difference(
        self, log_hoop: Tensor, log_axial: Tensor, **parameters: Tensor
    ) -> Tensor:
        r"""Cauchy stress difference ``σzz − σrr = ∂Ŵ/∂ln λz`` in kPa, which axial force feels.

        Like :meth:`stress_difference`, whose arguments it takes, it is derived from :meth:`energy`,
        or overridden.
        """
        # Along a wall the axial stretch may be given once, but the stress differs: each entry of
        # the energy needs one of its own to be differentiated by.
        log_axial = log_axial + pt.zeros_like(log_hoop)
        return elementwise_derivative(
            self._reduced_energy(log_hoop, log_axial, **parameters), log_axial
        )

    def _reduced_energy(self, log_hoop: Tensor, log_axial: Tensor, **parameters: Tensor) -> Tensor:
        """``Ŵ(λθ, λz) = W(1/(λθ λz), λθ, λz)`` of an incompressible solid."""
        hoop, axial = pt.exp(log_hoop), pt.exp(log_axial)
        energy = self.energy(pt.exp(-log_hoop - log_axial), hoop, axial, **parameters)
        if not isinstance(energy, Variable):
            raise TypeError(
                f"`energy` of {self.name} gave {energy!r}; expected an expression of the "
                "stretches: does it end with `return`?"
            )
        return energy

    def kinks(self, log_axial: Tensor, **parameters: Tensor) -> Sequence[Tensor]:
        """Values of ``ln λθ`` at which the stress is not smooth, or NaN where there is none.

        The wall is integrated piece by piece between them: fibres that carry load in tension only
        have such a point. None by default.
        """
        return ()

    @property
    def fingerprint(self) -> tuple[float, ...]:
        """Stresses in kPa at fixed stretches and parameters, by which the formula is recognised.

        They are ``σθθ − σrr`` and ``σzz − σrr`` at three pairs of stretches, rounded to six digits,
        with each parameter inside its prior range. Two laws with other
        formulas have other stresses there, whatever they are called.
        """
        return _fingerprint(self)

    def split(self, parameters: Mapping[str, Any]) -> list[Any]:
        """All entries of all parameters as one list, in the order of :attr:`parameters`.

        The last axis of a vector parameter is that of its entries.

        Raises
        ------
        TypeError
            If `parameters` are not those of this strain energy, or a vector has another length.
        """
        if set(parameters) != set(self.parameter_names):
            raise TypeError(
                f"{self.name} has the parameters {list(self.parameter_names)}, but "
                f"{sorted(parameters)} were given"
            )
        entries = []
        for p in self.parameters:
            value = parameters[p.name]
            if p.size is None:
                entries.append(value)
                continue
            if isinstance(value, tuple) and len(value) == p.size:  # as `join` gives it
                entries += value
                continue
            value = value if isinstance(value, Variable) else np.asarray(value, float)
            length = (value.type.shape if isinstance(value, Variable) else value.shape)[-1:]
            if length != (p.size,) and length != (None,):
                raise TypeError(
                    f"parameter {p.name!r} of {self!r} has {p.size} entries along its last axis; "
                    f"this has the shape {getattr(value, 'type', value).shape}"
                )
            entries += [value[..., i] for i in range(p.size)]
        return entries

    def join(self, entries: Sequence[Any]) -> dict[str, Any]:
        """Parameters by name from the list of :meth:`split`, vectors as tuples."""
        rest = iter(entries)
        return {
            p.name: next(rest) if p.size is None else tuple(islice(rest, p.size))
            for p in self.parameters
        }

    @property
    def name(self) -> str:
        """Name under which results refer to this strain energy."""
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
        """Strain energy whose class is called `name`: one of the zoo, or one defined by the user.

        Raises
        ------
        ValueError
            If no such class has been defined, or it has no such settings.
        """
        if not isinstance(name, str) or name not in StrainEnergy._registry:
            raise ValueError(
                f"no strain energy is called {name!r}; known are {sorted(StrainEnergy._registry)}. "
                "If it is your own, run or import its class first."
            )
        law = StrainEnergy._registry[name]
        known = signature(law).parameters.values()
        strangers = sorted(set(settings) - {setting.name for setting in known})
        if strangers and not any(s.kind is s.VAR_KEYWORD for s in known):
            raise ValueError(
                f"{name} has the settings {[s.name for s in known]}, but {strangers} were given"
            )
        return law(**settings)

    def __eq__(self, other: object) -> bool:
        return type(self) is type(other) and vars(self) == vars(other)

    def __hash__(self) -> int:
        return hash((type(self), *sorted(vars(self).items())))

    def __repr__(self) -> str:
        settings = ", ".join(f"{name}={value!r}" for name, value in vars(self).items())
        return f"{self.name}({settings})"


def list_strain_energies() -> list[str]:
    """Names of all strain energies: those of the zoo, and those that the user has defined.

    Each is the name of a class, and :meth:`StrainEnergy.from_name` makes one.

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


def _is_of_the_zoo(law: type[StrainEnergy]) -> bool:
    return law.__module__.startswith(f"{__name__.rpartition('.')[0]}.")


@cache
@one_thread
def _fingerprint(law: StrainEnergy) -> tuple[float, ...]:
    hoop, axial = np.log(_FINGERPRINT_STRETCHES).T
    entries: list[Tensor] = []
    for p in law.parameters:
        low, high = p.prior_range
        for _ in range(p.size or 1):
            # No two parameters at the same share of their ranges: a swap of two shows.
            share = 0.3 + 0.4 / (2 + len(entries))
            entries.append(pt.constant(low + share * (high - low), dtype="float64"))
    log_hoop, log_axial = pt.constant(hoop), pt.constant(axial)
    parameters = law.join(entries)
    stresses = [
        law.stress_difference(log_hoop, log_axial, **parameters),
        law.axial_stress_difference(log_hoop, log_axial, **parameters),
    ]
    values = function([], stresses, mode="FAST_COMPILE")()
    return tuple(float(f"{value:.6g}") for value in np.ravel(values))


def elementwise_derivative(y: Tensor, x: Tensor) -> Tensor:
    """Derivative of `y` by `x`, where each entry of `y` depends on that of `x` alone."""
    return grad(y.sum(), x, disconnected_inputs="ignore")


def half_difference(log_hoop: Tensor, log_axial: Tensor) -> Tensor:
    """``½ (λθ² − λr²) = e^{−z} sinh γ`` with ``γ = 2 ln λθ + ln λz``, ``z = ln λz``."""
    return pt.exp(-log_axial) * pt.sinh(2 * log_hoop + log_axial)


def first_invariant_excess(log_hoop: Tensor, log_axial: Tensor) -> Tensor:
    """``I₁ − 3 = 4 e^{−z} sinh²(γ/2) + 2 e^{−z} + e^{2z} − 3``, with its digits near 0."""
    across = 4 * pt.exp(-log_axial) * pt.sinh(log_hoop + log_axial / 2) ** 2
    return across + 2 * pt.expm1(-log_axial) + pt.expm1(2 * log_axial)
