"""Predict curves, elastic properties and stresses of a tube from a posterior."""
