"""Write posteriors as material cards of finite-element codes."""

from pymc_hyperelastic.predictions.cards.card import material_card

__all__ = ["material_card"]
