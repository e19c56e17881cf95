"""Coordinates of a specimen, in which the specimens of a class are spread normally."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytensor
import pytensor.tensor as pt
from numpy.typing import NDArray
from pytensor.tensor.variable import TensorVariable

from pymc_hyperelastic.mechanics.strain_energy.base import Parameter, StrainEnergy

Array = NDArray[np.float64]

# Priors of a class, each as the median and the standard deviation of a logarithm.
_REFERENCE_STRAIN = (0.2, 0.7)
SPREAD = (0.4, 0.7)
# Of a shape parameter: its median as a fraction of the upper end of its range.
_SHAPE = (1 / 6, 1.2)
_RATIO_SD, _LOGIT_SD = 1.5, 1.5
# The range of a parameter on "real", in prior standard deviations and in spreads.
_REAL_SD, _REAL_SPREAD = 4.0, 20.0


@dataclass(frozen=True)
class NaturalScale:
    r"""Coordinates of a specimen, in which the specimens of a class are spread normally.

    One stands in place of each parameter: the logarithm of a positive one, the logit of one between
    two ends, see :class:`~pymc_hyperelastic.Parameter`. A modulus at rest is hardly known from a
    curve that stiffens, and lies with the stiffening on a thin ridge. In place of the first modulus
    stands therefore the hoop strain :math:`e = \ln λ_θ` at which the wall's stress has a
    physiological size,

    .. math:: T(e, \ln λ_z = 0) = T_0, \qquad x_1 = \ln e,

    and in place of any other modulus the logarithm of its ratio to the first. Stress is
    proportional to the moduli together, so that they follow in closed form.

    Attributes
    ----------
    energy : StrainEnergy
        The material.
    reference_stress : float
        ``T₀ = σθθ − σrr``, kPa.
    """

    energy: StrainEnergy
    reference_stress: float = 20.0

    @property
    def _entries(self) -> list[tuple[str, Parameter]]:
        sized = [p for p in self.energy.parameters for _ in range(p.size or 1)]
        return list(zip(self.energy.entry_names, sized, strict=True))

    @property
    def _moduli(self) -> list[int]:
        """Places of the moduli among the entries."""
        return [
            i
            for i, (_, p) in enumerate(self._entries)
            if p.unit == "kPa" and p.natural_scale == "log"
        ]

    @property
    def names(self) -> list[str]:
        """Names of the coordinates, such as ``log_alpha``."""
        names = [f"{p.natural_scale}_{name}" for name, p in self._entries]
        for place in self._moduli[1:]:
            names[place] += "_ratio"
        if self._moduli:
            names[self._moduli[0]] = "log_reference_strain"
        return names

    @property
    def location_prior(self) -> tuple[Array, Array]:
        """Mean and standard deviation of the normal prior of a class's location."""
        first = self._moduli[0] if self._moduli else None
        moments = []
        for i, (_, p) in enumerate(self._entries):
            low, high = p.prior_range
            if i == first:
                moments.append((np.log(_REFERENCE_STRAIN[0]), _REFERENCE_STRAIN[1]))
            elif i in self._moduli:
                largest = self._entries[self._moduli[0]][1].prior_range[1]
                moments.append((np.log(high / largest), _RATIO_SD))
            elif p.natural_scale == "log":
                moments.append((np.log(high * _SHAPE[0]), _SHAPE[1]))
            elif p.natural_scale == "logit":
                moments.append((0.0, _LOGIT_SD))
            else:
                moments.append(((low + high) / 2, (high - low) / _REAL_SD))
        mean, sd = np.array(moments).T
        return mean, sd

    @property
    def spread_prior(self) -> tuple[Array, float]:
        """Mean and standard deviation of the logarithm of a class's spread."""
        median = [
            (p.prior_range[1] - p.prior_range[0]) / _REAL_SPREAD
            if p.natural_scale == "real"
            else SPREAD[0]
            for _, p in self._entries
        ]
        return np.log(median), SPREAD[1]

    def parameters(self, coordinates: Sequence[TensorVariable]) -> dict[str, Any]:
        """Material parameters by name, as the strain energy takes them."""
        entries: list[Any] = []
        for x, (_, p) in zip(coordinates, self._entries, strict=True):
            low, high = p.prior_range
            if p.natural_scale == "log":
                entries.append(pt.exp(x))
            elif p.natural_scale == "logit":
                entries.append(low + (high - low) * pt.sigmoid(x))
            else:
                entries.append(x)
        if self._moduli:
            first = self._moduli[0]
            strain = entries[first]
            entries[first] = pt.ones_like(strain)
            unit = self.energy.stress_difference(
                strain, pt.zeros_like(strain), **self.energy.join(entries)
            )
            for place in self._moduli:
                entries[place] = entries[place] * self.reference_stress / unit
        return self.energy.join(entries)

    def numbers(self, coordinates: Sequence[Array]) -> dict[str, Array]:
        """Material parameters of coordinates in numbers; entries of vectors along a last axis."""
        parameters = self.parameters([pt.constant(x) for x in coordinates])
        symbols = [
            pt.stack(value, axis=-1) if isinstance(value, tuple) else value
            for value in parameters.values()
        ]
        values = pytensor.function([], symbols, mode="FAST_COMPILE")()
        return dict(zip(parameters, values, strict=True))


def check_moduli(energy: StrainEnergy) -> None:
    """Raise if stress at the reference strain is more than what the positive moduli make of it."""
    scales = {p.name: p.natural_scale for p in energy.parameters if p.unit == "kPa"}
    others = [name for name, scale in scales.items() if scale != "log"]
    if "log" in scales.values() and others:
        raise ValueError(
            f"the parameter {others[0]!r} of {energy.name} is a modulus on the scale "
            f"{scales[others[0]]!r}, but population models need moduli that are positive, on the "
            "scale 'log': give it a prior_range above zero"
        )
