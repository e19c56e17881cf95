"""Joint model of the distributions of several groups, with covariates or pairs of specimens.

:func:`~pymc_hyperelastic.compare_classes` uses its posteriors for estimates, and its evidences for
Bayes factors.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
import pymc as pm
import pytensor.tensor as pt
import xarray as xr
from numpy.typing import NDArray
from scipy import linalg

from pymc_hyperelastic.classes.distribution import (
    ClassModel,
    Distributions,
    Units,
    fit_enough,
)
from pymc_hyperelastic.classes.specimen_evidence import Unit
from pymc_hyperelastic.evidence.diagnosis import with_diagnosis
from pymc_hyperelastic.models.class_distribution import (
    ClassDistribution,
    correlation_factor,
    distributions_of,
    factor_of,
    some_of_posterior,
)
from pymc_hyperelastic.models.specimen_draws import SpecimenDraws
from pymc_hyperelastic.predictions.members import SEED

Array = NDArray[np.float64]


class Apart(NamedTuple):
    """Prior standard deviations of differences between two groups."""

    location: float
    """Prior standard deviation of the difference of locations, in units of the common spread."""
    log_spread: float
    """Prior standard deviation of the difference of the logarithms of spreads."""


def unit_of_pair(first: SpecimenDraws, second: SpecimenDraws, covariates: Array) -> Unit:
    """Return draws of the mean of two specimens of an animal, and of the change between them.

    The draws of the two specimens are independent, and are combined one by one. `covariates` has
    the shape (specimen, covariate), with the rows in the order of the specimens.
    """
    count = min(len(first.log_weight), len(second.log_weight))
    first, second = first.first(count), second.first(count)
    mean, difference = (first.centre + second.centre) / 2, second.centre - first.centre
    middle = replace(first, centre=mean, covariates=covariates.mean(axis=0))
    change = replace(second, centre=difference, covariates=covariates[1] - covariates[0])
    log_weight = first.log_weight + second.log_weight + np.log(count)
    error = float(np.hypot(first.standard_error, second.standard_error))
    return Unit((middle, change), log_weight, error)


def draws_given(
    unit: Unit, distributions: Sequence[ClassDistribution], count: int = 1
) -> tuple[Array, ...]:
    r"""Return coordinates (coordinate, draw) of the parts of a unit, given their distributions.

    For each draw ``φ`` of the distributions, the weighted draw ``x_i`` of the unit is chosen with
    probability ``∝ w_i p(x_i | φ)``. If the distributions have a single draw, `count` draws are
    chosen under it. Equal arguments give equal draws.

    With an experiment effect, the coordinates of a specimen are the means over its tests.
    """
    log_weight = unit.log_terms(distributions)
    log_weight = np.broadcast_to(log_weight, (max(count, len(log_weight)), log_weight.shape[1]))
    # Gumbel-max trick: the argmax of log weights plus Gumbel noise is a categorical draw.
    noise = np.random.default_rng(SEED).gumbel(size=log_weight.shape)
    chosen = (log_weight + noise).argmax(axis=1)
    return tuple(part.centre[:, chosen] for part in unit.parts)


@dataclass(frozen=True)
class Joint(ClassModel):
    r"""Model of the distributions of several groups.

    With a location ``m``, spreads ``s`` and a correlation matrix common to all groups, group ``g``
    has

    .. math:: m_g = m + s \circ \sum_k c_{gk} δ_k, \qquad
        \ln s_g = \ln s + \sum_k c_{gk} τ_k, \qquad δ_k \sim N(0, a^2), \; τ_k \sim N(0, b^2),

    with contrasts ``c`` such that differences between any two groups have the prior standard
    deviation ``a`` in units of ``s`` for the location, and ``b`` for the logarithm of the spread.
    Effects of covariates are common to all groups.

    For pairs, the mean of the two specimens and the change between them are independent, with
    separate distributions; the location of the change is ``s ∘ δ``.

    Attributes
    ----------
    groups : sequence of str
        Names of the groups; a single name if all specimens have one distribution.
    apart : Apart or None
        Prior of the differences between groups; None for groups without differences.
    covariates : sequence of str
        Names of the covariates.
    paired : bool
        If True, each unit is a pair of specimens of one animal.
    """

    groups: Sequence[str]
    apart: Apart | None
    covariates: Sequence[str] = ()
    paired: bool = False

    def fit(
        self, units: Units, draws: int, chains: int, seed: np.random.SeedSequence
    ) -> xr.DataTree:
        """Return posterior and evidence for units, given by names of groups and of units."""
        return with_diagnosis(fit_enough(self, units, draws, chains, seed))

    @property
    def contrasts(self) -> Array:
        """Coefficients ``c`` of the differences, shape (group, contrast)."""
        return linalg.helmert(len(self.groups)).T / np.sqrt(2)

    def register(self) -> Distributions:
        """Register the model's variables; return the distributions of the parts, by group."""
        size, count = len(self.population.scale.names), len(self.covariates)
        common = self.population.register_class()
        logs, sd_of_logs = self.population.scale.spread_prior
        if count:
            standard = pm.Normal("effects", shape=(count, size))
            common = replace(common, effects=[np.exp(logs) * standard[k] for k in range(count)])
        if self.paired:
            difference: Any = np.zeros(size)
            if self.apart:
                difference = pm.Normal("difference", 0, self.apart.location, shape=size)
            change = replace(
                common,
                location=common.spread * difference,
                spread=pm.LogNormal("change_spread", logs, sd_of_logs, shape=size),
                factor=correlation_factor(size, "change_"),
            )
            return {"pairs": (common, change)}
        if self.apart is None:
            return {group: (common,) for group in self.groups}
        shape = len(self.groups) - 1, size
        difference = pm.Normal("difference", 0, self.apart.location, shape=shape)
        spread_difference = pm.Normal("spread_difference", 0, self.apart.log_spread, shape=shape)
        return {
            group: (_shifted(common, row @ difference, pt.exp(row @ spread_difference)),)
            for group, row in zip(self.groups, self.contrasts, strict=True)
        }

    def distributions(self, tree: xr.DataTree, count: int) -> Distributions:
        """Return at most `count` posterior draws of the distributions of the parts, by group."""
        posterior, common = some_of_posterior(tree, count), distributions_of(tree, count)
        location, spread = np.asarray(common.location), np.asarray(common.spread)

        def columns(name: str) -> Array:
            """Return draws of a variable, shape (..., coordinate, sample, 1)."""
            values = posterior[name].transpose("sample", ...).values
            return np.moveaxis(values, 0, -1)[..., None]

        if self.covariates:
            # The model's effects are in units of the prior median of the spread.
            scale = np.exp(self.population.scale.spread_prior[0])[:, None, None]
            common = replace(common, effects=[*(scale * columns("effects"))])
        if self.paired:
            difference = columns("difference") if self.apart else np.zeros_like(location)
            change = replace(
                common,
                location=spread * difference,
                spread=columns("change_spread"),
                factor=factor_of(posterior, "change_correlation"),
            )
            return {"pairs": (common, change)}
        if self.apart is None:
            return {group: (common,) for group in self.groups}
        of_contrasts = columns("difference"), columns("spread_difference")
        found: Distributions = {}
        for group, row in zip(self.groups, self.contrasts, strict=True):
            shift, log_factor = (np.einsum("k,kcsi->csi", row, values) for values in of_contrasts)
            found[group] = (_shifted(common, shift, np.exp(log_factor)),)
        return found


def _shifted(common: ClassDistribution, shift: Any, factor: Any) -> ClassDistribution:
    """Shift the location by `shift` times the spread, and multiply the spread by `factor`."""
    return replace(
        common, location=common.location + common.spread * shift, spread=common.spread * factor
    )
