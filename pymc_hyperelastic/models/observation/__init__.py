"""What was measured of a tube, with which error, and how that enters a model."""

from pymc_hyperelastic.models.observation.likelihood import inflation_likelihood
from pymc_hyperelastic.models.observation.observation import Observation
from pymc_hyperelastic.models.observation.slopes import balanced_slope_weight

__all__ = ["Observation", "balanced_slope_weight", "inflation_likelihood"]
