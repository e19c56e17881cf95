"""Strain energies: the base class :class:`StrainEnergy`, and one module per family of laws.

A new law is one class in the module of its family, with its name in that module's ``__all__``.
"""

from pymc_hyperelastic.mechanics.strain_energy import (
    base,
    fibres,
    invariants,
    principal_stretches,
    strain_components,
)
from pymc_hyperelastic.mechanics.strain_energy.base import *  # noqa: F403
from pymc_hyperelastic.mechanics.strain_energy.fibres import *  # noqa: F403
from pymc_hyperelastic.mechanics.strain_energy.invariants import *  # noqa: F403
from pymc_hyperelastic.mechanics.strain_energy.principal_stretches import *  # noqa: F403
from pymc_hyperelastic.mechanics.strain_energy.strain_components import *  # noqa: F403

__all__ = [
    *base.__all__,
    *invariants.__all__,
    *principal_stretches.__all__,
    *strain_components.__all__,
    *fibres.__all__,
]
