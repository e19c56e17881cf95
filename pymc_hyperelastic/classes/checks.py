"""Checks of fitted classes: residuals of the specimens, and the error due to their draws.

``diagnose_evidence`` runs them.
"""

import numpy as np
import xarray as xr

from pymc_hyperelastic.evidence.verdicts import BAD, GOOD, Check, ModelChecks
from pymc_hyperelastic.models.checks import check_of_residuals


def checks_of_specimens(tree: xr.DataTree, evidence: xr.Dataset) -> list[Check]:
    """Check the residuals of each specimen, and the error that the draws of all specimens cause."""
    checks = []
    # Residuals are not compared with a noise that is inferred from them.
    if "specimens" in tree.children and not tree["specimens"].sizes.get("noise", 1):
        fits = tree["specimens"].to_dataset()
        checks.append(check_of_residuals(fits["misfit"], fits["freedom"]))
    if "specimens_se" in evidence:
        error = float(evidence["specimens_se"])
        words = (
            "the draws of a specimen may be wrong: it was given up, because its sampling did not "
            "converge or its curves are inaccurate for its material"
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
