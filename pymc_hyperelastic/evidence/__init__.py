"""Sampling and evidence of any PyMC model with continuous variables; it knows nothing of tubes."""
