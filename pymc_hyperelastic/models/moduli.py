"""Moduli of a law, computed from the stress that each modulus contributes at a reference strain.

:class:`~pymc_hyperelastic.models.natural_scale.NaturalScale` describes specimens by a reference
strain and stress ratios instead of moduli; the functions here convert them to moduli. The choice of
wall integrators asks :func:`has_additive_stress`. The page Variability derives the equations.
"""

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

from pymc_hyperelastic.mechanics.interpolation import SMALL_STRAIN
from pymc_hyperelastic.mechanics.strain_energy.base import StrainEnergy, elementwise_derivative
from pymc_hyperelastic.models.priors import FEW_DRAWS


def moduli_by_ratio(
    energy: StrainEnergy,
    entries: Sequence[Any],
    indices: Sequence[int],
    strain: Tensor,
    log_ratios: Sequence[Tensor],
    stress: float,
) -> list[Tensor]:
    """Entries with moduli of given ratios, and ``σθθ − σrr = stress`` at a hoop strain ``ln λθ``.

    The axial strain is 0, and `stress` is in kPa. `indices` are those of the moduli in `entries`,
    the entries of all parameters, and `log_ratios` the logarithms of all moduli but the first,
    divided by the first. The stress of the law must be proportional to all moduli together.
    """
    moduli = [pt.ones_like(strain), *(pt.exp(x) for x in log_ratios)]
    parameters = energy.join(_replaced(entries, indices, moduli))
    unit = energy.stress_difference(strain, pt.zeros_like(strain), **parameters)
    return _replaced(entries, indices, [modulus * stress / unit for modulus in moduli])


def moduli_by_stress(
    energy: StrainEnergy,
    entries: Sequence[Any],
    indices: Sequence[int],
    strain: Tensor,
    log_ratios: Sequence[Tensor],
    stress: float,
) -> list[Tensor]:
    """Entries with moduli whose stresses have given ratios, and the sum ``T₀`` at a strain ``e``.

    See :class:`~pymc_hyperelastic.models.natural_scale.NaturalScale` for the equation. The stress
    of the law must be the sum of the stresses ``t_i`` of its moduli, see
    :func:`has_additive_stress`. A modulus is 0 if the square of ``t_i`` overflows. Parameters are
    those of :func:`moduli_by_ratio`. The equibiaxial `strain` is ``e``, and `log_ratios` are
    ``x_i``, ``i > 1``.
    """
    log_ratios = [pt.zeros_like(strain), *log_ratios]
    moduli = []
    for index, x in zip(indices, log_ratios, strict=True):
        # Gradients hold products of such stresses.
        finite = pt.isfinite(pt.square(_unit_stress(energy, entries, indices, index, strain)))
        # Without a strain of its own the unused branch would have the gradient 0 · inf.
        safe = pt.where(finite, strain, SMALL_STRAIN)
        unit = _unit_stress(energy, entries, indices, index, safe)
        contribution = stress / sum(pt.exp(other - x) for other in log_ratios)
        moduli.append(pt.where(finite, contribution / unit, 0.0))
    return _replaced(entries, indices, moduli)


def biaxial_stress(energy: StrainEnergy, strain: Tensor, entries: Sequence[Any]) -> Tensor:
    r"""Mean of ``σθθ − σrr`` and ``σzz − σrr`` in kPa at the equibiaxial strain ``e``.

    The state is ``ln λθ = ln λz = e``. The mean is :math:`\tfrac12 \, d\hat W(e, e)/de`.
    """
    # Two copies, because the derivative by one stretch must not include the other.
    stretches, parameters = (strain.copy(), strain.copy()), energy.join(entries)
    hoop = energy.stress_difference(*stretches, **parameters)
    return (hoop + energy.axial_stress_difference(*stretches, **parameters)) / 2


@lru_cache(maxsize=128)
def has_additive_stress(energy: StrainEnergy) -> bool:
    """Return True if the biaxial stress is a sum of one tensile stress per modulus.

    The test is numerical: only of an additive law do the moduli of :func:`moduli_by_stress` have
    the given stress, in random materials.
    """
    parameters = [p for p in energy.parameters for _ in range(p.size or 1)]
    indices = [i for i, p in enumerate(parameters) if p.unit == "kPa" and p.natural_scale == "log"]
    rng = np.random.default_rng(1)
    # Small strains, and parameters in the lower half of their ranges: few stresses overflow.
    strain = pt.constant(rng.uniform(0.02, 0.2, FEW_DRAWS))
    fractions = rng.uniform(0.05, 0.5, (len(parameters), FEW_DRAWS))
    low, high = np.transpose([p.prior_range for p in parameters])[..., None]
    entries: list[Any] = [*map(pt.constant, low + (high - low) * fractions)]
    log_ratios = [pt.constant(rng.standard_normal(FEW_DRAWS)) for _ in indices[1:]]
    entries = moduli_by_stress(energy, entries, indices, strain, log_ratios, 1.0)
    outputs = [biaxial_stress(energy, strain, entries), *(entries[i] for i in indices)]
    stress, *moduli = pytensor.function([], outputs, mode="FAST_COMPILE")()
    finite = np.isfinite(stress)
    positive = all((modulus[finite] > 0).all() for modulus in moduli)
    # Derivatives of energies are accurate to about 1e-10, and laws that are not additive differ by
    # far more than NumPy's tolerance of 1e-5.
    additive = np.allclose(stress[finite], 1)
    return bool(finite.any() and positive and additive)


def _unit_stress(
    energy: StrainEnergy, entries: Sequence[Any], indices: Sequence[int], index: int, strain: Tensor
) -> Tensor:
    """Biaxial stress of the modulus at `index`, divided by the modulus."""
    entries = _replaced(entries, indices, [pt.ones_like(strain) for _ in indices])
    given = [strain, *map(pt.as_tensor_variable, entries)]
    graph = _unit_stress_graph(energy, index, tuple(x.type for x in given))
    (stress,) = graph.bind(dict(zip(graph.inputs, given, strict=True)))
    return stress


@lru_cache(maxsize=128)
def _unit_stress_graph(
    energy: StrainEnergy, index: int, types: tuple[TensorType, ...]
) -> FrozenFunctionGraph:
    """Graph of :func:`_unit_stress`, simplified once, because copying it is faster."""
    strain, *entries = symbols = [of_type() for of_type in types]
    stress = elementwise_derivative(biaxial_stress(energy, strain, entries), entries[index])
    # Rewrite a clone: variables that belong to the law must not change.
    return FrozenFunctionGraph.from_io(symbols, [rewrite_graph(stress, clone=True)])


def _replaced(entries: Sequence[Any], indices: Sequence[int], values: Sequence[Any]) -> list[Any]:
    """Return the entries with new values at some indices."""
    new = dict(zip(indices, values, strict=True))
    return [new.get(i, entry) for i, entry in enumerate(entries)]
