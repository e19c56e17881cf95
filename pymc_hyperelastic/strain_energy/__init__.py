"""The zoo of strain energies, and the base class from which a user's own derives."""

from pymc_hyperelastic.strain_energy.base import Parameter, StrainEnergy
from pymc_hyperelastic.strain_energy.isotropic import Ogden, PowerLawNeoHookean
from pymc_hyperelastic.strain_energy.orthotropic import CriscioneType

__all__ = ["CriscioneType", "Ogden", "Parameter", "PowerLawNeoHookean", "StrainEnergy"]
