"""Tests of simulated specimens: what they would say of the class, or of a quantity."""

from collections.abc import Callable
from functools import partial
from typing import NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import NDArray
from scipy import stats
from scipy.special import log_softmax, logsumexp, softmax

from pymc_hyperelastic.classes.quantities import Place, values_of
from pymc_hyperelastic.classes.specimens import SpecimenSampler, fresh_specimens, reference_of
from pymc_hyperelastic.classes.variable import Variability
from pymc_hyperelastic.data.select import specimens_apart, specimens_of
from pymc_hyperelastic.design.few_draws import FewDraws, known_class
from pymc_hyperelastic.design.planned_tests import Design, beside, empty_data, radii_of, words_of
from pymc_hyperelastic.models.class_distribution import distributions_of
from pymc_hyperelastic.models.settings import inflation_data_of
from pymc_hyperelastic.predictions.measured import warn_user

Array = NDArray[np.float64]

# Draws of a class's distribution from which specimens are, and over which their density is
# averaged: by others a specimen from the tail of one would be thought impossible.
_DISTRIBUTIONS = 400
# Share of what a quantity was beforehand in what draws say that it is: they are few.
_AS_BEFORE = 0.02
# Share of specimens that may not bear a design before it is refused.
_MOST_LACKING = 0.2
# Share of specimens that may not bear a design before a warning.
_FEW_LACKING = 0.005
# Specimens by which the density of a quantity is known after a test.
_AFTER = 256
# Digits to which probabilities are rounded before they are compared, so that rounding errors do not
# decide.
_DIGITS = 9


class Specimens(NamedTuple):
    """Specimens of known classes, by the variables of their model, along the first axis."""

    variables: dict[str, Array]
    truth: NDArray[np.intp]
    log_before: Array
    """Log probabilities of the classes before the planned tests."""


class Trial(NamedTuple):
    """What a design tells of specimens; NaN of those that it cannot be done with."""

    gain: Array
    of_half: Array
    """The same by half of the inner draws."""
    effective: Array
    """Effective draws of the class of which there are fewest."""
    materials: list[Array]
    """Coordinates (coordinate, draw) of what a specimen may be after the test, one or none each."""


class Simulation:
    """Classes, the tests that a specimen has already had, and where a quantity is looked at."""

    def __init__(
        self,
        kind: Variability,
        classes: xr.DataTree,
        place: Place,
        given: xr.Dataset | None,
        log_prior: Array,
        draws: int,
    ) -> None:
        self._kind, self._place, self._given, self._draws = kind, place, given, draws
        self._log_prior = log_prior
        self._classes = [distributions_of(f, _DISTRIBUTIONS) for f in classes.children.values()]
        # That of a wall of layers follows from their thicknesses.
        self._tube: dict[str, float] = {"outer_radius": np.nan, **place.tube}
        self._sds = {n: _sd_of(n, measured.sd, classes) for n, measured in kind.geometry.items()}
        if given is None:
            return
        if kind.experiment_effect:
            raise ValueError(
                "given: classes with experiment_effect do not tell how further tests of a specimen "
                "would be; leave given out"
            )
        kind.check(given)
        names = specimens_of(given)[0]
        if len(names) > 1:
            raise ValueError(f"given must hold tests of one specimen; it has {names}")
        for name in ("inner_radius", "outer_radius", "opening_angle"):
            self._tube[name] = float(given[name].values[0])

    def specimens(self, count: int, tests: int, seed: np.random.SeedSequence) -> Specimens:
        """Specimens of every class, in proportion to its probability."""
        rng = np.random.default_rng(seed)
        if self._given is not None:
            return self._like_given(count, rng)
        truth = _in_proportion(np.exp(self._log_prior), count)
        fresh: dict[str, Array] = {}
        for k, distributions in enumerate(self._classes):
            chosen = rng.integers(len(distributions.location[0]), size=count)
            found = fresh_specimens(self._kind, distributions.at(chosen), tests, rng)
            for name, values in found.items():
                fresh.setdefault(name, np.empty_like(values))
                fresh[name][truth == k] = values[truth == k]
        return Specimens(fresh, truth, self._log_prior)

    def _like_given(self, count: int, rng: np.random.Generator) -> Specimens:
        """Specimens that had the tests which are given, as far as these tell."""
        sampler, draw = self._inner(self._given)
        drawn = draw(self._given, None, 10 * self._draws, rng)
        terms = drawn.log_terms
        log_before = log_softmax(self._log_prior + logsumexp(terms, axis=1))
        truth = _in_proportion(np.exp(log_before), count)
        chosen = np.empty(count, int)
        for k in range(len(terms)):
            weights = np.exp(terms[k] - logsumexp(terms[k]))
            chosen[truth == k] = rng.choice(len(weights), size=np.sum(truth == k), p=weights)
        return Specimens(sampler.variables_of(drawn.points[chosen]), truth, log_before)

    def trial(self, name: str, design: Design, tried: Specimens, rng: np.random.Generator) -> Trial:
        """A design, with every specimen."""
        kind, count, tests = self._kind, len(tried.truth), len(design)
        own = {n: v[:, :tests] for n, v in tried.variables.items()}
        radii = radii_of(kind, design, own, self._tube, self._sds)
        there = np.isfinite(radii).all(axis=1)
        _check_borne(name, design, radii)
        planned = empty_data(kind, design, self._tube, self._sds)
        force = np.concatenate([np.full(len(t.held), t.force) for t in design])
        blank = _measured(planned, radii[there][0], np.ones(len(force)), np.ones(len(force)), force)
        sampler, draw = self._inner(beside(self._given, blank))
        seed = int(rng.integers(2**32))
        simulate = sampler.simulator(beside(self._given, blank), seed)
        gains, materials = np.full((2, count), np.nan), [np.empty((0, 0))] * count
        effective = np.full(count, np.nan)
        for i in np.flatnonzero(there):
            specimen = {n: v[i] for n, v in own.items()}
            blank = blank.assign(radius=("obs", radii[i]))
            found = simulate(beside(self._given, blank), specimen)
            # Those of the given tests come first, and are as they were.
            new = {n: v[-len(force) :] for n, v in found.items() if n != "measured_axial_force"}
            of_forces = np.full(len(force), np.nan)
            if force.any():
                of_forces[force] = found["measured_axial_force"][-int(force.sum()) :]
            data = _measured(blank, radii[i], new["measured_pressure"], of_forces, force)
            start = sampler.points_of({n: v[i : i + 1] for n, v in own.items()})
            drawn = draw(beside(self._given, data), start, self._draws, rng)
            effective[i] = drawn.effective.min()
            for j, step in enumerate((1, 2)):
                gains[j, i] = self._gain(drawn.log_terms[:, ::step], tried, int(i))
            log_weight = logsumexp(drawn.log_terms + self._log_prior[:, None], axis=0)
            chosen = rng.permutation(_in_proportion(softmax(log_weight), _AFTER))
            materials[i] = sampler.draws_at(drawn.points[chosen]).centre
        return Trial(gains[0], gains[1], effective, materials)

    def _gain(self, terms: Array, tried: Specimens, i: int) -> float:
        """Log probability of the true class after the test, less that before."""
        log_evidence = logsumexp(terms, axis=1) - np.log(terms.shape[1])
        after = log_softmax(self._log_prior + log_evidence)
        return float((after - tried.log_before)[tried.truth[i]])

    def _inner(self, data: xr.Dataset) -> tuple[SpecimenSampler, Callable[..., FewDraws]]:
        """What understands specimens with as many tests, and what draws of them."""
        own = bool(self._kind.experiment_effect)
        forward = self._kind.forward_model(data, by_test=own, mode="quadrature")
        sampler = SpecimenSampler(self._kind, forward, reference_of(self._kind))
        size = data.sizes["test"], len(self._kind.geometry)
        classes = [known_class(distributions, *size) for distributions in self._classes]
        return sampler, partial(FewDraws, sampler, classes, self._log_prior)

    def quantity_gains(self, name: str, tried: Specimens, before: Specimens, trial: Trial) -> Array:
        """Log density of the true value of a quantity after the test, less that before."""

        def values(coordinates: Array) -> Array:
            """Of (coordinate, specimen, draw)."""
            return values_of(self._kind, coordinates, [name], self._place)[name][0]

        scale = self._kind.scale.names
        truth = values(np.stack([tried.variables[n][:, :1] for n in scale]))[:, 0]
        known = values(np.stack([before.variables[n][:, :1] for n in scale]))[:, 0]
        there = np.flatnonzero(np.isfinite(trial.gain) & np.isfinite(truth))
        after = values(np.stack([trial.materials[i] for i in there], axis=1))
        known = known[np.isfinite(known)]
        if min(np.nanmin(after), known.min()) > 0:
            truth, known, after = np.log(truth), np.log(known), np.log(after)
        gains = np.full((2, len(truth)), np.nan)
        for j, step in enumerate((1, 2)):
            for i, of_one in zip(there, after, strict=True):
                some = of_one[np.isfinite(of_one)][::step]
                before_test, after_test = (_log_density(x, truth[i]) for x in (known, some))
                mixed = np.log(_AS_BEFORE) + before_test, np.log1p(-_AS_BEFORE) + after_test
                gains[j, i] = np.logaddexp(*mixed) - before_test
        return gains


def _sd_of(name: str, given: float | None, classes: xr.DataTree) -> float:
    """Standard deviation of a measure of the tube: as given, else the median of the specimens'."""
    if given is not None:
        return given
    parts = [
        part[f"{name}_sd"].values[0]
        for fitted in classes.children.values()
        for part in specimens_apart(inflation_data_of(fitted)).values()
    ]
    return float(np.median(parts))


def _in_proportion(chance: Array, count: int) -> NDArray[np.intp]:
    """Numbers of classes, as many of each as its probability wants."""
    ends, places = np.cumsum(chance).round(_DIGITS), (np.arange(count) + 0.5) / count
    return np.searchsorted(ends, places.round(_DIGITS)).clip(max=len(chance) - 1)


def _measured(
    planned: xr.Dataset, radius: Array, pressure: Array, force: Array, with_force: Array
) -> xr.Dataset:
    """Data with what was measured; forces are missing where none are."""
    values = {"radius": ("obs", radius), "pressure": ("obs", pressure)}
    if "axial_force" in planned:
        values["axial_force"] = "obs", np.where(with_force, force, np.nan)
    return planned.assign(values)


def _check_borne(name: str, design: Design, radii: Array) -> None:
    """Raise, or warn, if specimens do not bear a design."""
    lacking = 1 - np.isfinite(radii).all(axis=1).mean()
    words = f"design {name!r} ({words_of(design)}): {lacking:.1%} of the specimens cannot do that"
    if lacking > _MOST_LACKING:
        raise ValueError(f"{words}: it is outside what the tube can bear")
    if lacking > _FEW_LACKING:
        warn_user(f"{words}, and are left out")


def _log_density(draws: Array, at: float) -> float:
    """Log density by draws: a sum of normal ones, with the variance of the draws."""
    width = 1.06 * len(np.unique(draws)) ** -0.2
    mean, sd = draws.mean(), draws.std()
    x = mean + (draws - mean) / np.hypot(1, width)
    scale = width * sd / np.hypot(1, width)
    return float(logsumexp(stats.norm.logpdf(at, x, scale)) - np.log(len(draws)))
