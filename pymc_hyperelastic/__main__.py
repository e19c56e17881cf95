"""The command ``python -m pymc_hyperelastic``."""

from pymc_hyperelastic.command.main import main

main()
