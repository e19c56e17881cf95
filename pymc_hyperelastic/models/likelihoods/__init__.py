"""Likelihoods: which quantities were measured, with which errors, and how they enter a model."""

from pymc_hyperelastic.models.likelihoods.base import OFFSET_VARIABLES, Likelihood
from pymc_hyperelastic.models.likelihoods.gaussian import Gaussian, as_likelihood
from pymc_hyperelastic.models.likelihoods.potential import inflation_likelihood
from pymc_hyperelastic.models.likelihoods.slope_augmented import SlopeAugmented
from pymc_hyperelastic.models.likelihoods.slopes import balanced_slope_weight

__all__ = [
    "OFFSET_VARIABLES",
    "Gaussian",
    "Likelihood",
    "SlopeAugmented",
    "as_likelihood",
    "balanced_slope_weight",
    "inflation_likelihood",
]
