"""The forward model: what a tube or a sheet of given material shows where it was measured.

Only the modules of this folder know how a wall is integrated.
"""

from pymc_hyperelastic.mechanics.wall import OVERFLOW
from pymc_hyperelastic.models.forward.base import ForwardModel, SymbolicTests
from pymc_hyperelastic.models.forward.choose import Mode
from pymc_hyperelastic.models.forward.joint import forward_model, points_of_part, register_curves
from pymc_hyperelastic.models.forward.model import SymbolicTube, TubeForward, until_accurate
from pymc_hyperelastic.models.forward.numbers import TubeNumbers, numeric_stresses
from pymc_hyperelastic.models.forward.sheets import SymbolicSheets

__all__ = [
    "OVERFLOW",
    "ForwardModel",
    "Mode",
    "SymbolicSheets",
    "SymbolicTests",
    "SymbolicTube",
    "TubeForward",
    "TubeNumbers",
    "forward_model",
    "numeric_stresses",
    "points_of_part",
    "register_curves",
    "until_accurate",
]
