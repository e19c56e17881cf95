"""Mechanics of the tube: kinematics, strain energies, and integrals over the wall.

It knows no data, no priors and no PyMC model.
"""
