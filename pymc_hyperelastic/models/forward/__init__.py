"""The forward model: what a tube of given material and geometry shows where it was measured.

*How* its wall is integrated is decided here alone, and nobody else knows.
"""

from pymc_hyperelastic.models.forward.model import ForwardModel, SymbolicTube
from pymc_hyperelastic.models.forward.numbers import LayerNumbers, TubeNumbers
from pymc_hyperelastic.models.forward.rules import Mode

__all__ = ["ForwardModel", "LayerNumbers", "Mode", "SymbolicTube", "TubeNumbers"]
