"""PyMC models of inflated tubes: priors, the forward model, likelihoods, populations."""
