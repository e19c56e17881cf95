"""Moduli of a law from the stress that they bear in a state of reference."""

from collections.abc import Sequence
from functools import lru_cache
from typing import Any

import numpy as np
import pytensor
import pytensor.tensor as pt
from pytensor.graph.fg import FrozenFunctionGraph
from pytensor.graph.rewriting.utils import rewrite_graph
from pytensor.tensor.type import TensorType
from pytensor.tensor.variable import TensorVariable as Tensor

from pymc_hyperelastic.mechanics.strain_energy.base import StrainEnergy, elementwise_derivative

# A modulus that would bear so many times its own size is taken for 0: numbers are at their end.
_LARGEST_STRESS = np.float64(1e150)
# A strain at which no material bears so much.
_SMALL_STRAIN = 1e-6
# Materials by which it is known whether a law is additive, and what rounding leaves of stresses.
_TRIED, _ROUNDING = 20, 1e-8


def moduli_by_ratio(
    energy: StrainEnergy,
    entries: Sequence[Any],
    places: Sequence[int],
    strain: Tensor,
    log_ratios: Sequence[Tensor],
    stress: float,
) -> list[Tensor]:
    r"""Moduli in given ratios to the first that bear ``σθθ − σrr = stress`` at a hoop strain.

    There is no axial strain. `entries` are those of the law's parameters, `places` those of its
    moduli among them, and `log_ratios` the logarithms of all moduli but the first, over the first.
    Stress must be proportional to all moduli together.
    """
    moduli = [pt.ones_like(strain), *(pt.exp(x) for x in log_ratios)]
    parameters = energy.join(_with(entries, places, moduli))
    unit = energy.stress_difference(strain, pt.zeros_like(strain), **parameters)
    return [modulus * stress / unit for modulus in moduli]


def moduli_by_stress(
    energy: StrainEnergy,
    entries: Sequence[Any],
    places: Sequence[int],
    strain: Tensor,
    log_ratios: Sequence[Tensor],
    stress: float,
) -> list[Tensor]:
    r"""Moduli that bear given ratios of a stress ``T₀`` at an equibiaxial strain ``e``.

    With the stress ``t_i`` of a modulus of 1 kPa, see :func:`biaxial_stress`, they are

    .. math:: θ_i = \frac{T_i}{t_i(e)}, \qquad \sum_i T_i = T_0, \quad \ln\frac{T_i}{T_1} = x_i,

    if stress is their sum. Arguments are those of :func:`moduli_by_ratio`, `log_ratios` the
    ``x_i`` of all but the first. A modulus of which even the smallest number would bear more is 0.
    """
    log_ratios = [pt.zeros_like(strain), *log_ratios]
    moduli = []
    for place, x in zip(places, log_ratios, strict=True):
        bears = _stress_of(energy, entries, places, place, strain) < _LARGEST_STRESS
        # Else the gradient of what overflows would be 0 * inf.
        bearable = pt.where(bears, strain, _SMALL_STRAIN)
        unit = _stress_of(energy, entries, places, place, bearable)
        borne = stress / sum(pt.exp(other - x) for other in log_ratios)
        moduli.append(pt.where(bears, borne / unit, 0.0))
    return moduli


def biaxial_stress(energy: StrainEnergy, strain: Tensor, entries: Sequence[Any]) -> Tensor:
    r"""Mean of ``σθθ − σrr`` and ``σzz − σrr`` at the equibiaxial strain ``ln λθ = ln λz = e``.

    It is half of the slope of the stored energy, :math:`\tfrac12 \, d\hat W(e, e)/de`.
    """
    # Two variables: a derivative by one must not be that by both.
    stretches, parameters = (strain.copy(), strain.copy()), energy.join(entries)
    hoop = energy.stress_difference(*stretches, **parameters)
    return (hoop + energy.axial_stress_difference(*stretches, **parameters)) / 2


@lru_cache
def has_additive_stress(energy: StrainEnergy) -> bool:
    """Whether stress is a sum over the moduli, to which each adds its own, in tension a pull.

    Moduli that bear a stress in given ratios if it is so, must bear it: in numbers, for several
    materials of the law at small strains.
    """
    parameters = [p for p in energy.parameters for _ in range(p.size or 1)]
    places = [i for i, p in enumerate(parameters) if p.unit == "kPa" and p.natural_scale == "log"]
    rng = np.random.default_rng(1)
    strain = pt.constant(rng.uniform(0.02, 0.2, _TRIED))
    entries: list[Any] = []
    for p in parameters:
        low, high = p.prior_range
        entries.append(pt.constant(low + (high - low) * rng.uniform(0.05, 0.5, _TRIED)))
    log_ratios = [pt.constant(rng.standard_normal(_TRIED)) for _ in places[1:]]
    moduli = moduli_by_stress(energy, entries, places, strain, log_ratios, 1.0)
    stress = biaxial_stress(energy, strain, _with(entries, places, moduli))
    stress, *moduli = pytensor.function([], [stress, *moduli], mode="FAST_COMPILE")()
    known = np.isfinite(stress)
    positive = all((modulus[known] > 0).all() for modulus in moduli)
    return bool(known.any() and positive and np.allclose(stress[known], 1, atol=_ROUNDING, rtol=0))


def _stress_of(
    energy: StrainEnergy, entries: Sequence[Any], places: Sequence[int], place: int, strain: Tensor
) -> Tensor:
    """What the modulus of one place adds to the biaxial stress, by kPa."""
    entries = _with(entries, places, [pt.ones_like(strain) for _ in places])
    given = [strain, *map(pt.as_tensor_variable, entries)]
    graph = _stress_of_symbols(energy, place, tuple(x.type for x in given))
    (stress,) = graph.bind(dict(zip(graph.inputs, given, strict=True)))
    return stress


@lru_cache
def _stress_of_symbols(
    energy: StrainEnergy, place: int, types: tuple[TensorType, ...]
) -> FrozenFunctionGraph:
    """The same of symbols: it is copied far sooner than made, and most of it cancels."""
    strain, *entries = symbols = [of_type() for of_type in types]
    stress = elementwise_derivative(biaxial_stress(energy, strain, entries), entries[place])
    # A copy is simplified: what a law holds of its own stays as it is.
    return FrozenFunctionGraph.from_io(symbols, [rewrite_graph(stress, clone=True)])


def _with(entries: Sequence[Any], places: Sequence[int], values: Sequence[Any]) -> list[Any]:
    """The entries with others in some places."""
    others = dict(zip(places, values, strict=True))
    return [others.get(place, entry) for place, entry in enumerate(entries)]
