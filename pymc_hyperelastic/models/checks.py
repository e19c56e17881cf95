"""Checks of results of curves: their error, the residuals of the best one, and enough data."""

import numpy as np
import xarray as xr
from scipy.stats import chi2

from pymc_hyperelastic.evidence.diagnosis import checks_of_limits
from pymc_hyperelastic.evidence.verdicts import BAD, DOUBTFUL, GOOD, Check, ModelChecks

# Largest error of a curve, relative to its largest value: with errors of a hundredth of that a log
# density of a hundred points is right to a thousandth.
LARGEST_CURVE_ERROR = 1e-6
# Probability of residuals of a right model that are larger, among all tests and signals of a study.
_CHANCE = 2e-3


def checks_of_curves(tree: xr.DataTree, evidence: xr.Dataset) -> list[Check]:
    """Check the residuals of the best curve, the number of values, and the error of curves."""
    checks = []
    if "chi_square" in evidence:
        checks.append(check_of_residuals(evidence["chi_square"], evidence["points"]))
    checks += _checks_of_parameters(evidence)
    if "curve_error" in evidence:
        error = float(evidence["curve_error"])
        words = (
            f"curves err by {error:.0e} of their largest value: the posterior is where priors "
            "hardly expect the material, and curves were not made exact there; give wider priors, "
            "or mode='quadrature'"
        )
        verdict = GOOD if error <= LARGEST_CURVE_ERROR else BAD
        checks.append(Check("curves", error, LARGEST_CURVE_ERROR, verdict, words))
    return checks


def doubts_of_fit(evidence: xr.Dataset) -> str:
    """Return the reasons to doubt the fit of a model to its data; empty without any."""
    checks = checks_of_limits(evidence)
    if "chi_square" in evidence:
        checks.append(check_of_residuals(evidence["chi_square"], evidence["points"]))
    checks += _checks_of_parameters(evidence)
    return "; ".join(check.words for check in checks if check.verdict != GOOD)


def check_of_residuals(squares: xr.DataArray, freedom: xr.DataArray) -> Check:
    """Compare the residuals of each test, or specimen, with the noise."""
    # Bonferroni's correction; without points there is no chance, and the least is of another test.
    chances = chi2.sf(squares, freedom) * int((freedom.values > 0).sum())
    chances = np.where(np.isfinite(chances), chances, 1.0).clip(0, 1)
    at = np.unravel_index(int(np.argmin(chances)), chances.shape)
    chance, more = float(chances[at]), int((chances < _CHANCE).sum()) - 1
    labels = [str(squares[dim].values[i]) for dim, i in zip(squares.dims, at, strict=True)]
    where = ", ".join(labels) if "test" in squares.dims else f"specimen {labels[0]!r}"
    words = (
        f"the best curve is further from the data than the noise explains in {where}"
        f"{f' and in {more} more' if more > 0 else ''}: the squared residuals are "
        f"{float(squares.values[at]):.3g} variances of the noise, and about "
        f"{float(freedom.values[at]):.3g} are expected. The law does not fit, the prior excludes "
        "better curves, the noise is larger, specimens that share one material differ, or "
        "something is wrong with the data"
    )
    verdict = DOUBTFUL if chance < _CHANCE else GOOD
    return Check("residuals", chance, _CHANCE, verdict, words)


def _checks_of_parameters(evidence: xr.Dataset) -> list[Check]:
    """Compare the number of material parameters with that of measured values."""
    if "parameters" not in evidence:
        return []
    parameters, values = (int(evidence[name]) for name in ("parameters", "measured_values"))
    words = (
        f"the model has {parameters} material parameters, and the data hold fewer measured values, "
        f"{values}: they cannot determine all parameters, and the prior decides. Measure more "
        "points, or take a law with fewer parameters"
    )
    verdict = GOOD if parameters <= values else DOUBTFUL
    return [Check("parameters", parameters, values, verdict, words)]


CHECKS_OF_CURVES = ModelChecks(
    checks_of_curves,
    variables={
        **dict.fromkeys(("curve_error", "parameters", "measured_values"), ()),
        **dict.fromkeys(("chi_square", "points"), ("test", "signal")),
    },
    together={
        "points": "chi_square",
        "chi_square": "points",
        "parameters": "measured_values",
        "measured_values": "parameters",
    },
    about_fit=("residuals", "parameters"),
)
