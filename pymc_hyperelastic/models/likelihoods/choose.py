"""The likelihood that an argument or a stored record means."""

from numbers import Real
from typing import Any

from pytensor.graph.basic import Variable

from pymc_hyperelastic.files.stored import shown
from pymc_hyperelastic.models.likelihoods.base import Likelihood
from pymc_hyperelastic.models.likelihoods.gaussian import Gaussian
from pymc_hyperelastic.models.likelihoods.slope_augmented import SlopeAugmented

LIKELIHOODS: dict[str, type[Likelihood]] = {"Gaussian": Gaussian, "SlopeAugmented": SlopeAugmented}


def as_likelihood(likelihood: Any) -> Likelihood:
    """Return the likelihood that an argument means.

    Parameters
    ----------
    likelihood : Likelihood, float or distribution
        A number or a distribution is the standard deviation of a pressure, kPa.

    Raises
    ------
    TypeError
        If it is something else.

    Examples
    --------
    >>> as_likelihood(0.5)
    Gaussian(pressure_sd=0.5)
    """
    if isinstance(likelihood, Likelihood):
        return likelihood
    if isinstance(likelihood, Real | Variable) and not isinstance(likelihood, bool):
        return Gaussian(pressure_sd=likelihood)
    raise TypeError(
        f"likelihood is {likelihood!r}; expected ph.Gaussian(pressure_sd=2 * ph.mmHg), "
        "ph.SlopeAugmented(sigma=5 * ph.mmHg, slope_weight=1.0), or the standard deviation of a "
        "pressure in kPa, a number or a distribution"
    )


def likelihood_from_record(record: Any) -> Likelihood:
    """Return the likelihood that :meth:`Likelihood.to_record` wrote.

    Raises
    ------
    ValueError
        If it is no such record.
    """
    name = record.get("name") if isinstance(record, dict) else None
    if not isinstance(name, str) or name not in LIKELIHOODS:
        raise ValueError(
            f"the likelihood is {shown(record)}; expected a record with a name of "
            f"{list(LIKELIHOODS)}"
        )
    return LIKELIHOODS[name].from_record(record)
