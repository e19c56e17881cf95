"""Checks of results of classes: residuals of specimens, and the error of their draws."""

import numpy as np
import xarray as xr

from pymc_hyperelastic.evidence.verdicts import BAD, GOOD, Check, ModelChecks
from pymc_hyperelastic.models.checks import check_of_residuals


def checks_of_specimens(tree: xr.DataTree, evidence: xr.Dataset) -> list[Check]:
    """Compare the residuals of each specimen with the noise, and the error of its draws."""
    checks = []
    # A noise that is inferred for each specimen explains its residuals.
    if "specimens" in tree.children and not tree["specimens"].sizes.get("noise", 1):
        fits = tree["specimens"].to_dataset()
        checks.append(check_of_residuals(fits["misfit"], fits["freedom"]))
    if "specimens_se" in evidence:
        error = float(evidence["specimens_se"])
        words = (
            "what is known of a specimen may be wrong: it was given up after long, or its curves "
            "are wrong where its material is"
        )
        verdict = GOOD if error < np.inf else BAD
        checks.append(Check("specimens", error, np.inf, verdict, words))
    return checks


CHECKS_OF_SPECIMENS = ModelChecks(
    checks_of_specimens,
    variables={"specimens_se": ()},
    together={"specimens_se": "specimens"},
    with_advice=("specimens",),
)
