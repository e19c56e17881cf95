"""What planned tests are expected to tell: of the class of a specimen, or of what it is like."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray
from scipy.special import log_softmax

from pymc_hyperelastic.classes.average import labels_of
from pymc_hyperelastic.classes.kinds import kind_of_variable_classes
from pymc_hyperelastic.classes.quantities import known_quantities, place_of
from pymc_hyperelastic.classes.variable import Variability
from pymc_hyperelastic.design.planned_tests import Design, as_design, words_of
from pymc_hyperelastic.design.trials import Simulation, Specimens
from pymc_hyperelastic.evidence.checks import check_count
from pymc_hyperelastic.models.settings import origin_of
from pymc_hyperelastic.parallel import one_thread
from pymc_hyperelastic.predictions.measured import warn_user

Array = NDArray[np.float64]

# Effective draws by which a class is known of a specimen.
_ENOUGH = 20
# Share of specimens with fewer effective draws from which on there is a warning.
_MOST_UNSURE = 0.05
# Change with half of the inner draws from which on there is a warning, in nats.
_BIASED = 0.02
# The same in its standard errors.
_ERRORS = 3.0
# Specimens by which the density of a quantity is known before a test.
_BEFORE = 2000
# Digits to which information, in nats, and probabilities are rounded before they are compared, so
# that rounding errors do not decide.
_DIGITS = 9


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
    simulation = Simulation(kind, classes, place, given, log_prior, draws)
    seeds = np.random.SeedSequence(random_seed).spawn(3)
    tried = simulation.specimens(specimens, max(map(len, planned.values())), seeds[0])
    trials = {}
    for name, design in planned.items():
        trials[name] = simulation.trial(name, design, tried, np.random.default_rng(seeds[1]))
    gains = np.stack([[t.gain, t.of_half] for t in trials.values()], axis=1)
    if about != "class":
        before = simulation.specimens(_BEFORE, 1, seeds[2])
        gains = np.stack(
            [simulation.quantity_gains(about, tried, before, t) for t in trials.values()], axis=1
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


def _result(
    planned: Mapping[str, Design],
    gains: Array,
    effective: Array,
    tried: Specimens,
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
