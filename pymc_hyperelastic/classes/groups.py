"""Distributions of groups of specimens under one strain energy, and Bayes factors between groups.

Groups are fitted separately, jointly with covariates, or as pairs of specimens of the same animals.
:func:`~pymc_hyperelastic.compare_classes` compares the draws.
"""

from collections.abc import Sequence
from itertools import combinations
from typing import Any, NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from pymc_hyperelastic.classes.covariates import Covariates, pairs_of
from pymc_hyperelastic.classes.distribution import ClassModel, Distributions, Units
from pymc_hyperelastic.classes.hierarchical import HierarchicalClass
from pymc_hyperelastic.classes.joint import Apart, Joint, draws_given, unit_of_pair
from pymc_hyperelastic.classes.kinds import kind_of_variable_classes
from pymc_hyperelastic.classes.quantities import standard_specimens
from pymc_hyperelastic.classes.sensitivity import log_prior_and_likelihood
from pymc_hyperelastic.classes.specimen_evidence import Unit, unit_of_specimen
from pymc_hyperelastic.evidence.diagnosis import log_evidence
from pymc_hyperelastic.evidence.estimate import Estimate
from pymc_hyperelastic.models.class_distribution import ClassDistribution, distributions_of
from pymc_hyperelastic.predictions.members import names_of_specimens, stored_draws

Array = NDArray[np.float64]

# Weakly informative prior of differences between groups, for estimates: three spreads between
# specimens is more than groups usually differ.
_WEAK_PRIOR = Apart(location=3.0, log_spread=1.0)


class GroupDraws(NamedTuple):
    """Posterior draws of the distributions of groups, and coordinates of specimens."""

    distributions: dict[str, ClassDistribution]
    """Distribution of each group."""
    coordinates: dict[str, Array]
    """Coordinates of specimens by group, shape (coordinate, draw, specimen); the first specimen is
    the typical one."""
    powers: Array
    """Log prior and log likelihood of each draw, shape (2, draw)."""
    measured: dict[str, Array]
    """Coordinates of the measured specimens by group, shape (coordinate, draw, specimen)."""
    effects: Array | None = None
    """Change of coordinates per standard deviation of each covariate, shape (covariate, coordinate,
    draw)."""


class Groups:
    """Groups of specimens under one strain energy, separate, paired or with covariates."""

    def __init__(
        self,
        kind: HierarchicalClass,
        tree: xr.DataTree,
        groups: Sequence[str],
        pair: Any,
        covariates: Any,
    ) -> None:
        self.kind, self.groups, self.tree = kind, list(groups), tree
        self.covariates = Covariates(tree, covariates)
        self.pairs = pairs_of(tree, pair) if pair is not None else []
        if self.pairs and kind.variability.experiment_effect:
            raise ValueError(
                "classes with an experiment effect cannot be compared in pairs: fit the classes "
                "with variability='specimen', or leave out pair"
            )

    @property
    def comparisons(self) -> list[tuple[str, str]]:
        """All pairs of groups."""
        return list(combinations(self.groups, 2))

    def by_draw(self, count: int, specimens: int, seed: np.random.SeedSequence) -> GroupDraws:
        """Return `count` posterior draws of all groups, with `specimens` specimens per draw."""
        size = len(self.kind.scale.names)
        if self.pairs:
            animals = {"pairs": self._paired_units()}
            of_parts, powers = self._fitted_jointly(animals, count, seed)
            middle, change = of_parts["pairs"]
            standard, units = standard_specimens(2 * size, specimens), [*animals["pairs"].values()]
            return _of_pairs(self.groups, middle, change, standard, powers, units)
        standard, units_of_groups = standard_specimens(size, specimens), self._units(self.groups)
        if self.covariates.names:
            of_parts, powers = self._fitted_jointly(units_of_groups, count, seed)
            distributions = {group: own for group, (own,) in of_parts.items()}
            effects = np.array(next(iter(distributions.values())).effects)[..., 0]
        else:
            distributions = {g: distributions_of(self.tree[g], count) for g in self.groups}
            effects, model = None, ClassModel(self.kind)
            powers = np.sum(
                [
                    log_prior_and_likelihood(model.kernel({"class": own}, 1), self.tree[g], count)
                    for g, own in units_of_groups.items()
                ],
                axis=0,
            )
        measured = {
            g: np.stack([draws_given(u, [d])[0] for u in units_of_groups[g].values()], axis=-1)
            for g, d in distributions.items()
        }
        distributions = {g: d.without_effects() for g, d in distributions.items()}
        coordinates = {g: d.coordinates(standard.T) for g, d in distributions.items()}
        return GroupDraws(distributions, coordinates, powers, measured, effects)

    def names(self) -> dict[str, list[str]]:
        """Return the names of the measured specimens of each group, in the order of their draws."""
        if self.pairs:
            _, *by_group = zip(*self.pairs, strict=True)
            return dict(zip(self.groups, map(list, by_group), strict=True))
        return {group: names_of_specimens(self.tree[group]) for group in self.groups}

    def _fitted_jointly(
        self, units: Units, count: int, seed: np.random.SeedSequence
    ) -> tuple[Distributions, Array]:
        """Return joint posterior draws of all distributions, with log prior and log likelihood."""
        joint = self._joint([*units], _WEAK_PRIOR)
        fitted = joint.fit(units, count, 1, seed)
        powers = log_prior_and_likelihood(joint.kernel(units, 1), fitted, count)
        return joint.distributions(fitted, count), powers

    def evidences(
        self, apart: Apart, count: int, seed: np.random.SeedSequence
    ) -> list[tuple[Estimate, Estimate]]:
        """Return log evidences of a difference and of none, for each comparison."""
        found = []
        seeds = seed.spawn(len(self.comparisons))
        for pair, seed_of_pair in zip(self.comparisons, seeds, strict=True):
            if self.pairs:
                different = same = {"pairs": self._paired_units()}
            else:
                different = self._units(pair)
                same = {"all": {f"{g}: {n}": u for g in pair for n, u in different[g].items()}}
            first, second = seed_of_pair.spawn(2)
            with_difference = self._joint([*different], apart).fit(different, count, 1, first)
            without = self._joint([*same], None).fit(same, count, 1, second)
            found.append((log_evidence(with_difference), log_evidence(without)))
        return found

    def _joint(self, groups: Sequence[str], apart: Apart | None) -> Joint:
        return Joint(self.kind, groups, apart, self.covariates.names, bool(self.pairs))

    def _units(self, groups: Sequence[str]) -> dict[str, dict[str, Unit]]:
        return {
            group: {
                name: unit_of_specimen(self._draws(group, name), self.covariates.of(group, name))
                for name in names_of_specimens(self.tree[group])
            }
            for group in groups
        }

    def _paired_units(self) -> dict[str, Unit]:
        units = {}
        for animal, *names in self.pairs:
            both = list(zip(self.groups, names, strict=True))
            covariates = np.stack([self.covariates.of(*place) for place in both])
            first, second = (self._draws(*place) for place in both)
            units[str(animal)] = unit_of_pair(first, second, covariates)
        return units

    def _draws(self, group: str, name: str) -> Any:
        return stored_draws(self.tree[group], name)


def _of_pairs(
    groups: Sequence[str],
    middle: ClassDistribution,
    change: ClassDistribution,
    standard: Array,
    powers: Array,
    animals: Sequence[Unit],
) -> GroupDraws:
    """Return draws of both groups from those of the mean and the change of each animal.

    Specimens with the same index belong to the same animal.
    """
    size = middle.size
    effects = np.array(middle.effects)[..., 0] if len(middle.effects) else None
    of_middle = middle.coordinates(standard[:, :size].T)
    of_change = change.coordinates(standard[:, size:].T)
    both = [draws_given(animal, [middle, change]) for animal in animals]
    middle, change = middle.without_effects(), change.without_effects()
    covariance = middle.covariance() + change.covariance() / 4
    coordinates, measured, distributions = {}, {}, {}
    for group, half in zip(groups, (-0.5, 0.5), strict=True):
        coordinates[group] = of_middle + half * of_change
        measured[group] = np.stack([mean + half * whole for mean, whole in both], axis=-1)
        location = middle.location + half * np.asarray(change.location)
        distributions[group] = middle.with_covariance(covariance, location)
    return GroupDraws(distributions, coordinates, powers, measured, effects)


def kind_of_groups(tree: xr.DataTree) -> HierarchicalClass:
    """Return the kind of the classes; ValueError unless it models variability of specimens."""
    return kind_of_variable_classes(
        tree, "groups are compared by the distributions of their specimens"
    )


def groups_of(trees: Sequence[xr.DataTree]) -> list[str]:
    """Return the names of the groups; ValueError unless there are two, of two specimens each."""
    groups = list(trees[0].children)
    if len(groups) < 2:
        raise ValueError(f"a comparison needs at least two classes; got {groups}")
    for tree in trees:
        for name in groups:
            specimens = names_of_specimens(tree[name])
            if len(specimens) < 2:
                raise ValueError(
                    f"class {name!r} has one specimen, {specimens[0]!r}: a comparison needs "
                    "at least two, to estimate the spread between specimens"
                )
    return groups
