"""PyMC models of inflated tubes: priors, the forward model, what was observed, populations."""
