"""Simulate planned tests of specimens, and compute the information about class or quantity.

:func:`~pymc_hyperelastic.expected_information` runs a :class:`Simulation` for each design.
"""

from collections.abc import Callable
from functools import partial
from typing import NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import NDArray
from scipy import stats
from scipy.special import log_softmax, logsumexp, softmax

from pymc_hyperelastic.classes.hierarchical import HierarchicalClass
from pymc_hyperelastic.classes.interface import NEGLIGIBLE
from pymc_hyperelastic.classes.quantities import MOST_LACKING, values_of
from pymc_hyperelastic.classes.reference import fresh_specimens, reference_of
from pymc_hyperelastic.classes.specimens import SpecimenSampler
from pymc_hyperelastic.data.select import specimens_of
from pymc_hyperelastic.design.few_draws import FewDraws, known_class
from pymc_hyperelastic.design.planned_tests import (
    Design,
    data_of,
    radii_of,
    with_measured,
    with_radii,
    words_of,
)
from pymc_hyperelastic.evidence.importance import LARGEST_ERROR
from pymc_hyperelastic.messages import warn_user
from pymc_hyperelastic.models.class_distribution import distributions_of
from pymc_hyperelastic.predictions.conditions import Conditions
from pymc_hyperelastic.rounding import DIGITS

Array = NDArray[np.float64]

# Fraction of specimens that cannot bear a design above which it is refused.
_TOO_MANY_LACKING = 0.2


class Specimens(NamedTuple):
    """Simulated specimens and their true classes."""

    variables: dict[str, Array]
    """Values of the model's variables by name, the specimens along the first axis."""
    truth: NDArray[np.intp]
    """Index of the true class of each specimen."""
    log_before: Array
    """Log probabilities of the classes before the planned tests."""

    @property
    def weights(self) -> Array:
        """Weight of each specimen in a mean: those of a class share its probability."""
        counts = np.bincount(self.truth, minlength=len(self.log_before))
        return (np.exp(self.log_before) / np.maximum(counts, 1))[self.truth]


class Trial(NamedTuple):
    """Results of one design; NaN for specimens that cannot bear its tests."""

    gains: Array
    """Information about the class, nats, (2, specimen): with all inner draws, and with half."""
    effective: Array
    """Smallest number of effective draws of any class, (specimen,)."""
    materials: list[Array]
    """Posterior draws of each specimen's coordinates, (coordinate, draw); empty if not tested."""


class Simulation:
    """Simulate tests of specimens of the classes, after the `given` tests if there are any.

    A quantity is computed under the conditions `at`.
    """

    def __init__(
        self,
        kind: HierarchicalClass,
        classes: xr.DataTree,
        at: Conditions,
        given: xr.Dataset | None,
        log_prior: Array,
        draws: int,
    ) -> None:
        self._kind, self._at, self._given, self._draws = kind, at, given, draws
        self._log_prior = log_prior
        # Draws before the planned tests, which all trials share.
        self.many = 10 * draws
        # Specimens are simulated from the draws over which their density is averaged. Otherwise a
        # specimen from the tail of one of them could have a density of almost 0.
        self._classes = [distributions_of(fitted) for fitted in classes.children.values()]

    def specimens(
        self, count: int, tests: int, seed: np.random.SeedSequence, *, rare: bool = True
    ) -> Specimens:
        """Draw specimens of the classes.

        They are in proportion to the probabilities of the classes; with `rare`, more of improbable
        classes, of which a proportion would be too few, or none.
        """
        rng = np.random.default_rng(seed)
        if self._given is not None:
            return self._like_given(count, rng, rare)
        truth = _truths(np.exp(self._log_prior), count, rare)
        fresh: dict[str, Array] = {}
        for k, distributions in enumerate(self._classes):
            chosen = rng.integers(len(distributions.location[0]), size=count)
            found = fresh_specimens(self._kind, distributions.at(chosen), tests, rng)
            for name, values in found.items():
                fresh.setdefault(name, np.empty_like(values))
                fresh[name][truth == k] = values[truth == k]
        return Specimens(fresh, truth, self._log_prior)

    def _like_given(self, count: int, rng: np.random.Generator, rare: bool) -> Specimens:
        """Draw specimens from the posterior given the earlier tests."""
        sampler, draw = self._inner(self._given)
        drawn = draw(self._given, None, self.many, rng)
        terms = drawn.log_terms
        log_before = log_softmax(self._log_prior + logsumexp(terms, axis=1))
        truth = _truths(np.exp(log_before), count, rare)
        chosen = np.empty(count, int)
        for k in np.unique(truth):
            weights = np.exp(terms[k] - logsumexp(terms[k]))
            chosen[truth == k] = rng.choice(len(weights), size=np.sum(truth == k), p=weights)
        return Specimens(sampler.variables_of(drawn.points[chosen]), truth, log_before)

    def trial(self, name: str, design: Design, tried: Specimens, rng: np.random.Generator) -> Trial:
        """Simulate the tests of a design on each specimen, and return the information."""
        kind, count, tests = self._kind, len(tried.truth), len(design)
        variables = {n: v[:, :tests] for n, v in tried.variables.items()}
        radii = radii_of(kind, design, variables)
        possible = np.isfinite(radii).all(axis=1)
        _check_borne(name, design, radii)
        blank = with_radii(data_of(kind, self._given, design), radii[possible][0])
        sampler, draw = self._inner(blank)
        simulate = sampler.simulator(blank, int(rng.integers(2**32)))
        gains, materials = np.full((2, count), np.nan), [np.empty((0, 0))] * count
        effective = np.full(count, np.nan)
        for i in np.flatnonzero(possible):
            data = with_radii(blank, radii[i])
            drawn_values = simulate(data, {n: v[i] for n, v in variables.items()})
            data = with_measured(data, drawn_values, radii.shape[1])
            start = sampler.points_of({n: v[i : i + 1] for n, v in variables.items()})
            drawn = draw(data, start, self._draws, rng)
            effective[i] = drawn.effective.min()
            for j, step in enumerate((1, 2)):
                gains[j, i] = self._gain(drawn.log_terms[:, ::step], tried, int(i))
            log_weight = logsumexp(drawn.log_terms + self._log_prior[:, None], axis=0)
            chosen = rng.permutation(_in_proportion(softmax(log_weight), self._draws))
            materials[i] = sampler.draws_at(drawn.points[chosen]).centre
        return Trial(gains, effective, materials)

    def _gain(self, terms: Array, tried: Specimens, i: int) -> float:
        """Return the log probability of the true class after the test, minus that before."""
        log_evidence = logsumexp(terms, axis=1) - np.log(terms.shape[1])
        after = log_softmax(self._log_prior + log_evidence)
        return float((after - tried.log_before)[tried.truth[i]])

    def _inner(self, data: xr.Dataset) -> tuple[SpecimenSampler, Callable[..., FewDraws]]:
        """Return a sampler for specimens with tests like `data`, and a function that draws them."""
        by_test = self._kind.variability.experiment_effect
        forward = self._kind.forward_model(data, by_test=by_test, mode="quadrature")
        sampler = SpecimenSampler(self._kind, forward, reference_of(self._kind))
        size = data.sizes["test"], len(self._kind.geometry)
        classes = [known_class(distributions, *size) for distributions in self._classes]
        return sampler, partial(FewDraws, sampler, classes, self._log_prior)

    def quantity(self, name: str, specimens: Specimens) -> Array:
        """Return a quantity of specimens, (specimen,)."""
        of_first = [specimens.variables[n][:, :1] for n in self._kind.scale.names]
        return self._values(name, np.stack(of_first))[:, 0]

    def _values(self, name: str, coordinates: Array) -> Array:
        """Return a quantity, (specimen, draw), at (coordinate, specimen, draw)."""
        return values_of(self._kind, coordinates, [name], self._at)[name][0]

    def quantity_gains(self, name: str, tried: Specimens, prior: Array, trial: Trial) -> Array:
        """Return the gain in log density of a quantity's true value, (2, specimen), nats.

        `prior` has the quantity of specimens before the tests. The first row of the result uses all
        draws after the test, the second one half of them.

        The density before the test has a small weight in that after it, because the kernel density
        of few draws is almost 0 in its tails. The weight lowers the information by at most the
        error in nats that counts as accurate.
        """
        truth = self.quantity(name, tried)
        possible = np.flatnonzero(np.isfinite(trial.gains[0]) & np.isfinite(truth))
        after = self._values(name, np.stack([trial.materials[i] for i in possible], axis=1))
        prior = prior[np.isfinite(prior)]
        if min(np.nanmin(after), prior.min()) > 0:
            truth, prior, after = np.log(truth), np.log(prior), np.log(after)
        gains = np.full((2, len(truth)), np.nan)
        for j, step in enumerate((1, 2)):
            for i, of_one in zip(possible, after, strict=True):
                posterior = of_one[np.isfinite(of_one)][::step]
                before_test, after_test = (_log_density(x, truth[i]) for x in (prior, posterior))
                mixed = np.log(LARGEST_ERROR) + before_test, np.log1p(-LARGEST_ERROR) + after_test
                gains[j, i] = np.logaddexp(*mixed) - before_test
        return gains


def _truths(chance: Array, count: int, rare: bool) -> NDArray[np.intp]:
    """Return true classes of specimens: with `rare` half of them in proportion, half equally often.

    An improbable class may have most of the information: a test that finds it gains much.
    """
    if rare:
        possible = chance > NEGLIGIBLE
        chance = (chance + possible / possible.sum()) / 2
    return _in_proportion(chance / chance.sum(), count)


def _in_proportion(chance: Array, count: int) -> NDArray[np.intp]:
    """Return `count` indices of classes, in proportion to their probabilities `chance`."""
    ends, places = np.cumsum(chance).round(DIGITS), (np.arange(count) + 0.5) / count
    return np.searchsorted(ends, places.round(DIGITS)).clip(max=len(chance) - 1)


def check_given(kind: HierarchicalClass, given: xr.Dataset) -> None:
    """Raise unless these may be earlier tests of a specimen of the classes."""
    if kind.variability.experiment_effect:
        raise ValueError(
            "given: earlier tests are not supported for classes with experiment_effect, in "
            "which the material varies between tests: leave given out"
        )
    kind.check(given, partial=True)
    names = specimens_of(given)[0]
    if len(names) > 1:
        raise ValueError(f"given must hold tests of one specimen; it has {names}")


def _check_borne(name: str, design: Design, radii: Array) -> None:
    """Raise if many specimens cannot bear a design, and warn if some cannot."""
    lacking = 1 - np.isfinite(radii).all(axis=1).mean()
    words = f"design {name!r} ({words_of(design)}): {lacking:.1%} of the specimens cannot bear it"
    if lacking > _TOO_MANY_LACKING:
        raise ValueError(f"{words}: choose a smaller range of pressures, radii or stretches")
    if lacking > MOST_LACKING:
        warn_user(f"{words}, and are left out")


def _log_density(draws: Array, at: float) -> float:
    """Return the log of a normal kernel density of draws, scaled to the variance of the draws."""
    width = 1.06 * len(np.unique(draws)) ** -0.2
    mean, sd = draws.mean(), draws.std()
    x = mean + (draws - mean) / np.hypot(1, width)
    scale = width * sd / np.hypot(1, width)
    return float(logsumexp(stats.norm.logpdf(at, x, scale)) - np.log(len(draws)))
