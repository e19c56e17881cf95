"""The distributions of several groups at once: covariates, pairs, and whether they are one."""

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

from pymc_hyperelastic.classes.distribution import fit_enough
from pymc_hyperelastic.classes.specimen_evidence import variance_of_shares
from pymc_hyperelastic.classes.specimens import shared_draws
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

# Draws that stand for a unit at first, and distributions by which it is known how many are needed.
_AT_FIRST, _DISTRIBUTIONS = 256, 200


class Apart(NamedTuple):
    """How far apart groups are beforehand: standard deviations of differences between two."""

    location: float
    """Of the location, in spreads."""
    log_spread: float


class Unit(NamedTuple):
    """Draws of what is one specimen, or a pair of them, in one or two parts."""

    parts: tuple[SpecimenDraws, ...]
    log_weight: Array
    standard_error: float

    def first(self, count: int) -> "Unit":
        """So many of the draws, in place of all."""
        lost = np.log(len(self.log_weight) / count)
        parts = tuple(part.first(count) for part in self.parts)
        return Unit(parts, self.log_weight[:count] + lost, self.standard_error)


def unit_of_specimen(draws: SpecimenDraws, covariates: Array) -> Unit:
    """A specimen with its covariates."""
    own = replace(draws, covariates=covariates)
    return Unit((own,), draws.log_weight, draws.standard_error)


def unit_of_pair(first: SpecimenDraws, second: SpecimenDraws, covariates: Array) -> Unit:
    """The same animal twice: the middle of both, and the change from the first to the second.

    `covariates` are those of the first and of the second. Draws of both are independent, and
    joined one by one.
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


@dataclass(frozen=True)
class Joint:
    r"""Model of the distributions of several groups.

    With a location ``m``, spreads ``s`` and a correlation that are common to all, group ``g`` has

    .. math:: m_g = m + s \circ \sum_k c_{gk} δ_k, \qquad
        \ln s_g = \ln s + \sum_k c_{gk} τ_k, \qquad δ_k \sim N(0, a^2), \; τ_k \sim N(0, b^2),

    by contrasts ``c`` for which every two groups differ by ``a`` spreads, and by ``b`` in their
    logarithm. Effects of covariates are common to all.

    Of pairs the middle of both and the change are independent, each with a distribution of its own;
    the location of the change is ``s ∘ δ``.

    Attributes
    ----------
    population : Population
        Settings of the classes.
    groups : sequence of str
        Names of the groups; one if all are the same.
    apart : Apart or None
        None if they are the same.
    covariates : sequence of str
    paired : bool
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
        """Posterior and evidence, of units by the name of the group, and their own."""
        model, known = _JointModel(self), (_flat(units), _AT_FIRST, None)
        return with_diagnosis(fit_enough(model, known, draws, chains, seed))

    def kernel(self, units: Mapping[str, Mapping[str, Unit]], count: int) -> BatchedSMC:
        """The model by so many draws of each unit, for its densities."""
        few = {key: unit.first(count) for key, unit in _flat(units).items()}
        return _JointModel(self).kernel(few, 1)

    @property
    def contrasts(self) -> Array:
        """Of each group, (group, contrast)."""
        if self.apart is None or self.paired:
            return np.zeros((len(self.groups), 0))
        return linalg.helmert(len(self.groups)).T / np.sqrt(2)

    @without_traces
    def model(self, shared: Mapping[str, Sequence[Mapping[str, SharedVariable]]]) -> pm.Model:
        """PyMC model of the distributions, all units integrated out by their draws."""
        names = self.population.scale.names
        with pm.Model(coords={"coordinate": names, "coordinate_2": names}, model=None) as model:
            of_groups = self._register()
            for group, parts in shared.items():
                terms = parts[0]["log_weight"]
                for inputs, distribution in zip(parts, of_groups[group], strict=True):
                    known = dict(inputs) | {
                        "tests": pt.specify_broadcastable(inputs["tests"], 1),
                    }
                    terms = terms + log_density(pt, known, distribution)
                pm.Potential(f"units_{group}", pt.sum(pt.logsumexp(terms, axis=-1)))
        return model

    def _register(self) -> dict[str, tuple[ClassDistribution, ...]]:
        """Variables of the distributions of the parts of units, by group."""
        size, count = len(self.population.scale.names), len(self.covariates)
        common = self.population.register_class()
        logs, sd_of_logs = self.population.scale.spread_prior
        if count:
            standard = pm.Normal("effects", shape=(count, size))
            common = replace(common, effects=[np.exp(logs) * standard[k] for k in range(count)])
        if self.paired:
            moved: Any = np.zeros(size)
            if self.apart:
                moved = pm.Normal("difference", 0, self.apart.location, shape=size)
            change = replace(
                common,
                location=common.spread * moved,
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
            group: (_moved(common, row @ difference, pt.exp(row @ spread_difference)),)
            for group, row in zip(self.groups, contrasts, strict=True)
        }

    def distributions(
        self, tree: xr.DataTree, count: int
    ) -> dict[str, tuple[ClassDistribution, ...]]:
        """Draws of the same, so many at most."""
        posterior, common = some_of_posterior(tree, count), distributions_of(tree, count)
        location, spread = np.asarray(common.location), np.asarray(common.spread)

        def columns(name: str) -> Array:
            """By (..., coordinate, sample, 1)."""
            values = posterior[name].transpose("sample", ...).values
            return np.moveaxis(values, 0, -1)[..., None]

        if self.covariates:
            scale = np.exp(self.population.scale.spread_prior[0])[:, None, None]
            common = replace(common, effects=[*(scale * columns("effects"))])
        if self.paired:
            moved = columns("difference") if self.apart else np.zeros_like(location)
            change = replace(
                common,
                location=spread * moved,
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
            step, grown = (np.einsum("k,kcsi->csi", row, values) for values in of_contrasts)
            found[group] = (_moved(common, step, np.exp(grown)),)
        return found


def _moved(common: ClassDistribution, step: Any, grown: Any) -> ClassDistribution:
    """A group's own distribution, so many spreads away, with spreads so many times as large."""
    return replace(
        common, location=common.location + common.spread * step, spread=common.spread * grown
    )


class _JointModel:
    """What a fit asks of its model; the draws that stand for units may be replaced."""

    def __init__(self, joint: Joint) -> None:
        self._joint = joint
        self._made: dict[int, tuple[dict[str, list[dict[str, SharedVariable]]], BatchedSMC]] = {}

    def kernel(self, draws: Mapping[tuple[str, str], Unit], count: int) -> BatchedSMC:
        """Sampler of so many particles, of draws that stand for the units from now on."""
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

    def variances(
        self, tree: xr.DataTree, draws: Mapping[tuple[str, str], Unit], size: int
    ) -> dict[tuple[str, str], float]:
        """What so many draws of each unit leave open of the evidence."""
        distributions = self._joint.distributions(tree, _DISTRIBUTIONS)
        found = {}
        for key, unit in draws.items():
            terms = unit.log_weight
            for part, distribution in zip(unit.parts, distributions[key[0]], strict=True):
                terms = terms + log_densities(part, distribution)
            found[key] = variance_of_shares(terms, unit.standard_error, size)
        return found


def _flat(units: Mapping[str, Mapping[str, Unit]]) -> dict[tuple[str, str], Unit]:
    return {(group, name): unit for group, own in units.items() for name, unit in own.items()}


def _shared_parts(units: Sequence[Unit]) -> list[dict[str, SharedVariable]]:
    """Draws of the parts of units; their weights are those of the first."""
    parts = [shared_draws(own) for own in zip(*(unit.parts for unit in units), strict=True)]
    parts[0]["log_weight"].set_value(np.stack([unit.log_weight for unit in units]))
    return parts
