"""What planned tests are expected to tell: of the class of a specimen, or of what it is like."""

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any, NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import NDArray
from scipy import stats
from scipy.special import log_softmax, logsumexp, softmax

from pymc_hyperelastic.classes.average import labels_of
from pymc_hyperelastic.classes.designs import (
    Design,
    as_design,
    beside,
    empty_data,
    radii_of,
    words_of,
)
from pymc_hyperelastic.classes.few_draws import FewDraws, known_class
from pymc_hyperelastic.classes.kinds import kind_of_variable_classes
from pymc_hyperelastic.classes.quantities import Place, known_quantities, place_of, values_of
from pymc_hyperelastic.classes.specimens import SpecimenSampler, fresh_specimens, reference_of
from pymc_hyperelastic.classes.variable import Variability
from pymc_hyperelastic.data.select import specimens_apart, specimens_of
from pymc_hyperelastic.evidence.checks import check_count
from pymc_hyperelastic.models.class_distribution import distributions_of
from pymc_hyperelastic.models.settings import inflation_data_of, origin_of
from pymc_hyperelastic.parallel import one_thread
from pymc_hyperelastic.predictions.measured import warn_user

Array = NDArray[np.float64]

# Draws of a class's distribution from which specimens are, and over which their density is
# averaged: by others a specimen from the tail of one would be thought impossible.
_DISTRIBUTIONS = 400
# Share of what a quantity was beforehand in what draws say that it is: they are few.
_AS_BEFORE = 0.02
# Share of specimens that may not bear a design before it is refused, and before that is told.
_MOST_LACKING, _TOLD = 0.2, 0.005
# Effective draws by which a class is known of a specimen; share of them without that is told.
_ENOUGH, _MOST_UNSURE = 20, 0.05
# Change by half of the inner draws that is told, in nats and in its standard errors.
_BIASED, _ERRORS = 0.02, 3.0
# Specimens by which the density of a quantity is known, without and with a test.
_BEFORE, _AFTER = 2000, 256
# Digits to which information, in nats, and probabilities are rounded before they are compared, so
# that rounding errors do not decide.
_DIGITS = 9


class _Specimens(NamedTuple):
    """Specimens of known classes, by the variables of their model, along the first axis."""

    variables: dict[str, Array]
    truth: NDArray[np.intp]
    log_before: Array
    """Log probabilities of the classes before the planned tests."""


class _Trial(NamedTuple):
    """What a design tells of specimens; NaN of those that it cannot be done with."""

    gain: Array
    of_half: Array
    """The same by half of the inner draws."""
    effective: Array
    """Effective draws of the class of which there are fewest."""
    materials: list[Array]
    """Coordinates (coordinate, draw) of what a specimen may be after the test, one or none each."""


@one_thread
def expected_information(
    classes: xr.DataTree,
    designs: Mapping[str, Any],
    *,
    about: str = "class",
    given: xr.Dataset | None = None,
    pressure: float | None = None,
    pressure_range: tuple[float, float] | None = None,
    pressure_unit: str = "kPa",
    tube: Mapping[str, float] | None = None,
    class_prior: Mapping[str, float] | None = None,
    stop_below: float | None = None,
    specimens: int = 200,
    draws: int = 256,
    random_seed: Any = None,
) -> xr.Dataset:
    r"""Estimate what planned tests of a new specimen are expected to tell, before they are run.

    Specimens are drawn from the classes, and measured in every design as the classes say that it is
    measured, with errors. Of each it is known to which class it belongs, and found how much more
    probable a laboratory would hold that after the test than before.

    Parameters
    ----------
    classes : xarray.DataTree
        Result of :func:`fit_classes` with ``variability="specimen"``.
    designs : dict
        Planned tests by a name of their own. A test is a dict with

        ``"pressure"`` or ``"radius"``: a number, which is held, or a pair, ``(low, high)``, over
        which it rises; an internal pressure in `pressure_unit` or an internal radius in mm.

        ``"axial_stretch"``: one number, or a pair if the tube is extended while pressure or radius
        are held; 1 if left out.

        ``"points"``: how many are measured, evenly spaced; 20 if left out.

        ``"force"``: whether the axial force is measured as well; if left out, whether it was of the
        specimens of the classes.

        Several tests of one specimen are a list of such dicts.
    about : str, default "class"
        What the tests should tell of: the class, or a quantity of the specimen itself as
        :func:`compare_classes` knows them, such as ``"alpha"`` or ``"compliance"``.
    given : xarray.Dataset, optional
        Tests that the specimen has had already. What is expected is what further ones add.
    pressure, pressure_range : optional
        Where a property is looked at, in `pressure_unit`, as in :func:`compare_classes`.
    pressure_unit : str, default "kPa"
        Unit of these, and of the pressures of the designs.
    tube : dict of str to float, optional
        ``inner_radius``, ``outer_radius`` (mm) and ``opening_angle`` (rad) of the new specimen.
        What is left out is as it was `given`, or the median of the specimens of the classes. A
        property is looked at in this tube, at its ``axial_stretch``.
    class_prior : dict of str to float, optional
        Probabilities of the classes beforehand; all equal if left out.
    stop_below : float, optional
        Say whether any design may be expected to tell more than so many nats.
    specimens : int, default 200
        Specimens that are simulated, the same for all designs.
    draws : int, default 256
        Inner draws for each specimen and class.
    random_seed : int or sequence of int, optional
        Seed.

    Returns
    -------
    xarray.Dataset
        By ``design``, the one that tells most first. All but shares are in nats.

        ``information``, ``information_se`` : what is expected, and its standard error.

        ``difference``, ``difference_se`` : to the first design, specimen by specimen: they are the
        same in all designs, so that a difference is known better than by the errors of both.

        ``change_by_half``, ``change_by_half_se`` : how much larger `information` is than with half
        of the inner draws. A mean of logarithms of means is biased, by about twice as much with
        half of them: what is left is as large as this.

        ``gain`` (design, specimen) : of each simulated specimen; NaN where it cannot be tested so.

        ``lacking`` : share of these. ``unsure`` : share of the specimens of which less than 20
        inner draws of some class that matters are effective.

        ``tests`` : what is done in each design, in words.

        Attributes: ``entropy``, of the class before the tests, which is the most that can be told
        of it; with `stop_below` also ``stop``, 0 or 1, and ``words``.

    Warns
    -----
    UserWarning
        If more inner draws are needed, some specimens cannot bear a design, or the fit of a class
        is not to be trusted.

    Raises
    ------
    TypeError, ValueError
        If classes have no variability, a design is none, more than a fifth of the specimens
        cannot bear it, or it measures a force whose error the classes do not know; if a quantity is
        unknown or lacks its pressure, or `given` is not of one specimen.

    See Also
    --------
    plan_study, plot_information

    Notes
    -----
    Of the class ``k``, with data ``y``,

    .. math:: I = E\left[\ln \frac{P(k \mid y)}{P(k)}\right]
        = E\left[\ln \frac{Z_k(y)}{\sum_l P(l) Z_l(y)}\right], \qquad
        Z_k(y) = \int p(y \mid x) \, p_k(x) \, dx,

    the mutual information of class and data [1]_. An evidence ``Z`` is a mean over inner draws by
    importance, of specimens ``x`` near the best one of each class; ``p_k`` is averaged over what
    the class's distribution may be. It is the expected rise of the log score of
    :func:`score_probabilities` as well.

    Of a quantity ``q`` it is :math:`E[\ln p(q \mid y) - \ln p(q)]`, with the densities of normal
    kernels over the draws; that is of its logarithm where all are positive, for which the
    information is the same. Densities of kernels are somewhat too wide, and the information is
    somewhat too small: compare designs by it.

    A class fitted with ``experiment_effect=True`` lets each test of a specimen have a material of
    its own; a quantity is then that of the specimen, around which these are.

    References
    ----------
    .. [1] D. V. Lindley, On a measure of the information provided by an experiment, The Annals of
       Mathematical Statistics 27 (1956) 986–1005; K. Chaloner and I. Verdinelli, Bayesian
       experimental design: a review, Statistical Science 10 (1995) 273–304.

    Examples
    --------
    >>> import pymc_hyperelastic as ph
    >>> classes = ph.open_result("hierarchical.nc")  # saved from an example of fit_classes
    >>> designs = {"one point": {"pressure": 20, "points": 1}, "curve": {"pressure": (10, 140)}}
    >>> found = ph.expected_information(
    ...     classes,
    ...     designs,
    ...     about="alpha",
    ...     pressure_unit="mmHg",
    ...     specimens=20,
    ...     draws=64,
    ...     random_seed=1,
    ... )
    >>> found["design"].values.tolist()
    ['curve', 'one point']
    """
    kind = _kind(classes)
    names = list(classes.children)
    check_count("specimens", specimens, 10)
    check_count("draws", draws, 32)
    if not isinstance(designs, Mapping) or not designs:
        raise ValueError("designs must be a dict from names to planned tests, and hold one or more")
    if about != "class" and about not in known_quantities(kind):
        raise ValueError(f"about is {about!r}; expected 'class' or one of {known_quantities(kind)}")
    planned = {str(n): as_design(str(n), d, kind, pressure_unit) for n, d in designs.items()}
    wanted = [] if about == "class" else [about]
    where = pressure, pressure_range, pressure_unit, 1060.0, dict(tube or {})
    place = place_of(classes, wanted, *where)
    log_prior = _log_prior(names, class_prior)
    study = _Study(kind, classes, place, given, log_prior, draws)
    seeds = np.random.SeedSequence(random_seed).spawn(3)
    tried = study.specimens(specimens, max(map(len, planned.values())), seeds[0])
    trials = {}
    for name, design in planned.items():
        trials[name] = study.tried(name, design, tried, np.random.default_rng(seeds[1]))
    gains = np.stack([[t.gain, t.of_half] for t in trials.values()], axis=1)
    if about != "class":
        before = study.specimens(_BEFORE, 1, seeds[2])
        gains = np.stack(
            [study.quantity_gains(about, tried, before, t) for t in trials.values()], axis=1
        )
    effective = np.stack([t.effective for t in trials.values()])
    result = _result(planned, gains, effective, tried, names, about, stop_below)
    return result.assign_attrs(strain_energy=labels_of([kind])[0], **origin_of(classes))


def _kind(classes: Any) -> Variability:
    if not isinstance(classes, xr.DataTree):
        raise TypeError(
            f"classes must be a result of ph.fit_classes, of one law, not {type(classes).__name__}"
        )
    return kind_of_variable_classes(
        classes, "what a test tells of a new specimen is known of classes whose specimens differ"
    )


def _log_prior(names: Sequence[str], given: Mapping[str, float] | None) -> Array:
    if given is None:
        return np.full(len(names), -np.log(len(names)))
    if set(given) != set(names) or not all(given[n] > 0 for n in names):
        raise ValueError(
            f"class_prior must hold a positive number for each of {list(names)}; got {dict(given)}"
        )
    return log_softmax(np.log([given[n] for n in names]))


class _Study:
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

    def specimens(self, count: int, tests: int, seed: np.random.SeedSequence) -> _Specimens:
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
        return _Specimens(fresh, truth, self._log_prior)

    def _like_given(self, count: int, rng: np.random.Generator) -> _Specimens:
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
        return _Specimens(sampler.variables_of(drawn.points[chosen]), truth, log_before)

    def tried(
        self, name: str, design: Design, tried: _Specimens, rng: np.random.Generator
    ) -> _Trial:
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
        return _Trial(gains[0], gains[1], effective, materials)

    def _gain(self, terms: Array, tried: _Specimens, i: int) -> float:
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

    def quantity_gains(
        self, name: str, tried: _Specimens, before: _Specimens, trial: _Trial
    ) -> Array:
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
    if lacking > _TOLD:
        warn_user(f"{words}, and are left out")


def _log_density(draws: Array, at: float) -> float:
    """Log density by draws: a sum of normal ones, with the variance of the draws."""
    width = 1.06 * len(np.unique(draws)) ** -0.2
    mean, sd = draws.mean(), draws.std()
    x = mean + (draws - mean) / np.hypot(1, width)
    scale = width * sd / np.hypot(1, width)
    return float(logsumexp(stats.norm.logpdf(at, x, scale)) - np.log(len(draws)))


def _result(
    planned: Mapping[str, Design],
    gains: Array,
    effective: Array,
    tried: _Specimens,
    names: Sequence[str],
    about: str,
    stop_below: float | None,
) -> xr.Dataset:
    """Means over specimens, and what follows from them."""
    gain, of_half = gains
    counted = np.isfinite(gain)
    information, error = _mean_and_error(gain)
    best = int(np.nanargmax(information.round(_DIGITS)))
    difference, difference_se = _mean_and_error(gain - gain[best])
    change, change_se = _mean_and_error(gain - of_half)
    unsure = np.sum(effective < _ENOUGH, axis=1) / counted.sum(axis=1)
    dims = "design"
    result = xr.Dataset(
        {
            "information": (dims, information),
            "information_se": (dims, error),
            "difference": (dims, difference),
            "difference_se": (dims, difference_se),
            "change_by_half": (dims, change),
            "change_by_half_se": (dims, change_se),
            "unsure": (dims, unsure),
            "lacking": (dims, 1 - counted.mean(axis=1)),
            "gain": ((dims, "specimen"), gain),
        },
        {
            "design": list(planned),
            "tests": (dims, [words_of(d) for d in planned.values()]),
            "true_class": ("specimen", [names[k] for k in tried.truth]),
        },
    )
    for name, share in zip(planned, unsure, strict=True):
        if share > _MOST_UNSURE:
            warn_user(
                f"design {name!r}: of {share:.0%} of the specimens less than {_ENOUGH} draws are "
                "effective, and what it tells of these is not known: give more draws"
            )
    for name, moved, its_error in zip(planned, change, change_se, strict=True):
        if abs(moved) > max(_BIASED, _ERRORS * its_error):
            warn_user(
                f"design {name!r}: what it tells changes by {moved:.3f} nats if half of the draws "
                "are left away, and is not known better: give more draws"
            )
    # Equally informative designs stay in the order of the argument.
    order = np.argsort(-information.round(_DIGITS), kind="stable")
    result = result.isel(design=order)
    before = np.exp(tried.log_before)
    entropy = float(-np.sum(before * tried.log_before))
    attrs: dict[str, Any] = {"about": about, "entropy": entropy}
    if stop_below is not None:
        most = int(np.nanargmax((information + 2 * error).round(_DIGITS)))
        attrs["stop"] = int(information[most] + 2 * error[most] < stop_below)
        attrs["words"] = (
            f"no design is expected to tell more than {stop_below:g} nats: stop"
            if attrs["stop"]
            else f"{list(planned)[most]!r} may tell more than {stop_below:g} nats"
        )
    return result.assign_attrs(attrs)


def _mean_and_error(values: Array) -> tuple[Array, Array]:
    """Mean over specimens, and its standard error."""
    count = np.isfinite(values).sum(axis=1)
    return np.nanmean(values, axis=1), np.nanstd(values, axis=1, ddof=1) / np.sqrt(count)
