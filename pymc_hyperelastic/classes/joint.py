"""Joint model of the distributions of several groups, with covariates or pairs of specimens.

:func:`~pymc_hyperelastic.compare_classes` uses its posteriors for estimates, and its evidences for
Bayes factors.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
import pymc as pm
import pytensor.tensor as pt
import xarray as xr
from numpy.typing import NDArray
from pytensor.compile.sharedvalue import SharedVariable
from scipy import linalg

from pymc_hyperelastic.classes.distribution import (
    DISTRIBUTIONS,
    DRAW_COUNTS,
    fit_enough,
    shared_draws,
)
from pymc_hyperelastic.classes.specimen_evidence import variance_of_shares
from pymc_hyperelastic.evidence.batched import without_traces
from pymc_hyperelastic.evidence.diagnosis import with_diagnosis
from pymc_hyperelastic.evidence.kernel import BatchedSMC
from pymc_hyperelastic.models.class_distribution import (
    ClassDistribution,
    correlation_factor,
    distributions_of,
    factor_of,
    some_of_posterior,
)
from pymc_hyperelastic.models.population import Population
from pymc_hyperelastic.models.specimen_draws import (
    SpecimenDraws,
    log_densities,
    log_density,
)

Array = NDArray[np.float64]

# Seed of the choice of a specimen's draws: fixed, so that every call returns the same draws.
_SEED = 1


class Apart(NamedTuple):
    """Prior standard deviations of differences between two groups."""

    location: float
    """Prior standard deviation of the difference of locations, in units of the common spread."""
    log_spread: float
    """Prior standard deviation of the difference of the logarithms of spreads."""


class Unit(NamedTuple):
    """Weighted draws of one specimen, or of the mean and the change of a pair of specimens."""

    parts: tuple[SpecimenDraws, ...]
    """Draws of the specimen, or of the mean and of the change of a pair."""
    log_weight: Array
    """Logarithms of the importance weights, shape (draw)."""
    standard_error: float
    """Standard error of the logarithm of the sum of the weights."""

    def first(self, count: int) -> "Unit":
        """Return the first `count` draws, with weights scaled to represent all draws."""
        correction = np.log(len(self.log_weight) / count)
        parts = tuple(part.first(count) for part in self.parts)
        return Unit(parts, self.log_weight[:count] + correction, self.standard_error)


def unit_of_specimen(draws: SpecimenDraws, covariates: Array) -> Unit:
    """Return the draws of a specimen, with its covariates, as a unit."""
    part = replace(draws, covariates=covariates)
    return Unit((part,), draws.log_weight, draws.standard_error)


def unit_of_pair(first: SpecimenDraws, second: SpecimenDraws, covariates: Array) -> Unit:
    """Return draws of the mean of two specimens of an animal, and of the change between them.

    The draws of the two specimens are independent, and are combined one by one. `covariates` has
    the shape (specimen, covariate), with the rows in the order of the specimens.
    """
    count = min(len(first.log_weight), len(second.log_weight))
    first, second = first.first(count), second.first(count)
    middle = replace(
        first,
        centre=(first.centre + second.centre) / 2,
        covariates=covariates.mean(axis=0),
    )
    change = replace(
        second, centre=second.centre - first.centre, covariates=covariates[1] - covariates[0]
    )
    log_weight = first.log_weight + second.log_weight + np.log(count)
    return Unit(
        (middle, change), log_weight, float(np.hypot(first.standard_error, second.standard_error))
    )


def draws_given(
    unit: Unit, distributions: Sequence[ClassDistribution], count: int = 1
) -> tuple[Array, ...]:
    r"""Return coordinates (coordinate, draw) of the parts of a unit, given their distributions.

    For each draw ``φ`` of the distributions, the weighted draw ``x_i`` of the unit is chosen with
    probability ``∝ w_i p(x_i | φ)``. If the distributions have a single draw, `count` draws are
    chosen under it. Equal arguments give equal draws.

    With an experiment effect, the coordinates of a specimen are the means over its tests.
    """
    pairs = zip(unit.parts, distributions, strict=True)
    log_weight = unit.log_weight + sum(log_densities(part, of_part) for part, of_part in pairs)
    log_weight = np.broadcast_to(log_weight, (max(count, len(log_weight)), log_weight.shape[1]))
    # Gumbel-max trick: the argmax of log weights plus Gumbel noise is a categorical draw.
    noise = np.random.default_rng(_SEED).gumbel(size=log_weight.shape)
    chosen = (log_weight + noise).argmax(axis=1)
    return tuple(part.centre[:, chosen] for part in unit.parts)


@dataclass(frozen=True)
class Joint:
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
    population : Population
        Settings of the classes.
    groups : sequence of str
        Names of the groups; a single name if all specimens have one distribution.
    apart : Apart or None
        Prior of the differences between groups; None for groups without differences.
    covariates : sequence of str
        Names of the covariates.
    paired : bool
        If True, each unit is a pair of specimens of one animal.
    """

    population: Population
    groups: Sequence[str]
    apart: Apart | None
    covariates: Sequence[str] = ()
    paired: bool = False

    def fit(
        self,
        units: Mapping[str, Mapping[str, Unit]],
        draws: int,
        chains: int,
        seed: np.random.SeedSequence,
    ) -> xr.DataTree:
        """Return posterior and evidence for units, given by names of groups and of units."""
        model, first = _JointModel(self), (_flat(units), int(DRAW_COUNTS[0]), None)
        return with_diagnosis(fit_enough(model, first, draws, chains, seed))

    def kernel(self, units: Mapping[str, Mapping[str, Unit]], count: int) -> BatchedSMC:
        """Return a kernel whose log densities use `count` draws of each unit."""
        draws = {key: unit.first(count) for key, unit in _flat(units).items()}
        return _JointModel(self).kernel(draws, 1)

    @property
    def contrasts(self) -> Array:
        """Coefficients ``c`` of the differences, shape (group, contrast)."""
        if self.apart is None or self.paired:
            return np.zeros((len(self.groups), 0))
        return linalg.helmert(len(self.groups)).T / np.sqrt(2)

    @without_traces
    def model(self, shared: Mapping[str, Sequence[Mapping[str, SharedVariable]]]) -> pm.Model:
        """Return the PyMC model of the distributions, with units integrated out by their draws."""
        names = self.population.scale.names
        with pm.Model(coords={"coordinate": names, "coordinate_2": names}, model=None) as model:
            of_groups = self._register()
            for group, parts in shared.items():
                terms = parts[0]["log_weight"]
                for inputs, distribution in zip(parts, of_groups[group], strict=True):
                    draws = dict(inputs) | {
                        "tests": pt.specify_broadcastable(inputs["tests"], 1),
                    }
                    terms = terms + log_density(pt, draws, distribution)
                pm.Potential(f"units_{group}", pt.sum(pt.logsumexp(terms, axis=-1)))
        return model

    def _register(self) -> dict[str, tuple[ClassDistribution, ...]]:
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
        contrasts = self.contrasts
        if self.apart is None:
            return {group: (common,) for group in self.groups}
        shape = contrasts.shape[1], size
        difference = pm.Normal("difference", 0, self.apart.location, shape=shape)
        spread_difference = pm.Normal("spread_difference", 0, self.apart.log_spread, shape=shape)
        return {
            group: (_shifted(common, row @ difference, pt.exp(row @ spread_difference)),)
            for group, row in zip(self.groups, contrasts, strict=True)
        }

    def distributions(
        self, tree: xr.DataTree, count: int
    ) -> dict[str, tuple[ClassDistribution, ...]]:
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
        contrasts = self.contrasts
        if not contrasts.shape[1]:
            return {group: (common,) for group in self.groups}
        of_contrasts = columns("difference"), columns("spread_difference")
        found: dict[str, tuple[ClassDistribution, ...]] = {}
        for group, row in zip(self.groups, contrasts, strict=True):
            shift, log_factor = (np.einsum("k,kcsi->csi", row, values) for values in of_contrasts)
            found[group] = (_shifted(common, shift, np.exp(log_factor)),)
        return found


def _shifted(common: ClassDistribution, shift: Any, factor: Any) -> ClassDistribution:
    """Shift the location by `shift` times the spread, and multiply the spread by `factor`."""
    return replace(
        common, location=common.location + common.spread * shift, spread=common.spread * factor
    )


class _JointModel:
    """Model for `fit_enough`, compiled once for each number of draws per unit."""

    def __init__(self, joint: Joint) -> None:
        self._joint = joint
        # Shared draws by group, and the kernel, for each number of draws.
        self._made: dict[int, tuple[dict[str, list[dict[str, SharedVariable]]], BatchedSMC]] = {}

    def kernel(self, draws: Mapping[tuple[str, str], Unit], count: int) -> BatchedSMC:
        """Return a kernel of `count` particles for these draws of each unit."""
        groups: dict[str, list[Unit]] = {}
        for (group, _), unit in draws.items():
            groups.setdefault(group, []).append(unit)
        size = len(next(iter(draws.values())).log_weight)
        if size not in self._made:
            shared = {group: _shared_parts(units) for group, units in groups.items()}
            self._made[size] = shared, BatchedSMC(model=self._joint.model(shared))
        kernel = self._made[size][1]
        kernel.draws = count
        return kernel

    def variances(self, tree: xr.DataTree, draws: Mapping[tuple[str, str], Unit]) -> Array:
        """Return the variance of the log evidence for each number of draws in `DRAW_COUNTS`."""
        distributions = self._joint.distributions(tree, DISTRIBUTIONS)
        variances = np.zeros(len(DRAW_COUNTS))
        for key, unit in draws.items():
            terms = unit.log_weight
            for part, distribution in zip(unit.parts, distributions[key[0]], strict=True):
                terms = terms + log_densities(part, distribution)
            variances += variance_of_shares(terms, unit.standard_error, DRAW_COUNTS)
        return variances


def _flat(units: Mapping[str, Mapping[str, Unit]]) -> dict[tuple[str, str], Unit]:
    """Return the units by (group, name)."""
    return {
        (group, name): unit for group, of_group in units.items() for name, unit in of_group.items()
    }


def _shared_parts(units: Sequence[Unit]) -> list[dict[str, SharedVariable]]:
    """Return shared variables of the draws of each part; the first part holds the weights."""
    parts = [
        shared_draws(of_units) for of_units in zip(*(unit.parts for unit in units), strict=True)
    ]
    parts[0]["log_weight"].set_value(np.stack([unit.log_weight for unit in units]))
    return parts
