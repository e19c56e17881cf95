"""The zoo of strain energies, and the base class from which a user's own derives."""

from pymc_hyperelastic.mechanics.strain_energy import isotropic, orthotropic
from pymc_hyperelastic.mechanics.strain_energy.base import (
    Parameter,
    StrainEnergy,
    list_strain_energies,
)
from pymc_hyperelastic.mechanics.strain_energy.isotropic import *  # noqa: F403
from pymc_hyperelastic.mechanics.strain_energy.orthotropic import *  # noqa: F403

# A law is exported from the one file in which it stands.
__all__ = [
    "Parameter",
    "StrainEnergy",
    "list_strain_energies",
    *isotropic.__all__,
    *orthotropic.__all__,
]
