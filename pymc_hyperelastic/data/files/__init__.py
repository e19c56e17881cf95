"""Tables of laboratories as they are: reading files, and the meaning of their columns."""

from pymc_hyperelastic.data.files.read import read_tests

__all__ = ["read_tests"]
