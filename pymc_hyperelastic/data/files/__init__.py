"""Tables of laboratories as they are: text files, what their columns are, and what they lack."""

from pymc_hyperelastic.data.files.read import read_tests

__all__ = ["read_tests"]
