"""The forward model: what a tube of given material and geometry shows where it was measured.

Only the modules of this folder know how a wall is integrated.
"""

from pymc_hyperelastic.mechanics.wall import OVERFLOW
from pymc_hyperelastic.models.forward.choose import Mode
from pymc_hyperelastic.models.forward.model import ForwardModel, SymbolicTube, until_accurate
from pymc_hyperelastic.models.forward.numbers import TubeNumbers

__all__ = ["OVERFLOW", "ForwardModel", "Mode", "SymbolicTube", "TubeNumbers", "until_accurate"]
