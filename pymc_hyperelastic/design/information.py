"""Estimate the expected information of planned tests about a specimen's class or properties.

It is the mutual information of Bayesian experimental design (Lindley 1956).
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from pymc_hyperelastic.classes.average import labels_of
from pymc_hyperelastic.classes.classification import class_prior_of
from pymc_hyperelastic.classes.kinds import kind_of_variable_classes
from pymc_hyperelastic.classes.quantities import complete_conditions, known_quantities
from pymc_hyperelastic.design.planned_tests import Defaults, Design, as_design, words_of
from pymc_hyperelastic.design.trials import Simulation, Specimens, check_given
from pymc_hyperelastic.evidence.checks import check_count
from pymc_hyperelastic.evidence.convergence import FEWEST_EFFECTIVE
from pymc_hyperelastic.evidence.estimate import Estimate
from pymc_hyperelastic.evidence.importance import LARGEST_ERROR
from pymc_hyperelastic.messages import warn_user
from pymc_hyperelastic.models.settings import origin_of
from pymc_hyperelastic.parallel import one_thread
from pymc_hyperelastic.predictions.conditions import Conditions
from pymc_hyperelastic.rounding import DIGITS

Array = NDArray[np.float64]

#: Fraction of specimens with fewer effective draws above which there is a warning.
MOST_UNSURE = 0.05


@one_thread
def expected_information(
    classes: xr.DataTree,
    designs: Mapping[str, Any],
    *,
    about: str = "class",
    given: xr.Dataset | None = None,
    at: Conditions | float | None = None,
    class_prior: Mapping[str, float] | None = None,
    stop_below: float | None = None,
    specimens: int = 200,
    draws: int = 256,
    random_seed: Any = None,
) -> xr.Dataset:
    r"""Estimate the expected information of planned tests of a new specimen.

    Specimens are drawn from the classes, and their tests are simulated for each design, with the
    measurement errors of the classes. The information is the mean increase of the log probability
    of the true class from before to after the tests.

    Parameters
    ----------
    classes : xarray.DataTree
        Result of :func:`fit_classes` with ``variability="specimen"``.
    designs : dict
        Planned tests, by names that the user chooses. A test of a tube is a dict with

        ``"pressure"`` or ``"radius"``: internal pressure, or internal radius in mm. A number is
        held constant; a pair ``(low, high)`` is the range of an increasing one.

        ``"pressure_unit"``: unit of the pressure; ``"kPa"`` by default.

        ``"axial_stretch"``: a number, or a pair if the tube is extended at a held pressure or
        radius; by default the median of the specimens of the classes.

        ``"points"``: number of measured points, evenly spaced; 20 by default.

        ``"force"``: True if the axial force is measured; by default, True if it was measured in the
        classes.

        ``"tube"``: a :class:`Tube` with the radii and the opening angle of the unloaded tube. By
        default, and where a measure is not stated, they are those in `given`, or the medians of the
        specimens of the classes.

        A test of a sheet is a dict with

        ``"stretch_x"``, ``"stretch_y"``: stretch along each axis. A number is held constant; a pair
        has the first and the last stretch. Both pairs run together. If one of the two is missing,
        the sheet is free along this axis. The stresses along all other axes are measured.

        ``"points"``: number of measured points, as for tubes.

        ``"stress_measure"``: ``"cauchy"`` or ``"nominal"``, which is required if the classes hold
        both.

        Give a list of such dicts for several tests of one specimen, of tubes, of sheets or of both.
    about : str, default "class"
        Subject of the information: the class, or a quantity of the specimen as in
        :func:`compare_classes`, such as ``"alpha"`` or ``"compliance"``.
    given : xarray.Dataset, optional
        Earlier tests of the specimen. The information is then that of the planned tests given the
        earlier ones.
    at : Conditions, or pressure in kPa, optional
        Conditions for which a property is computed, as in :func:`compare_classes`; only one
        pressure.
    class_prior : dict of str to float, optional
        Prior probabilities of the classes; equal by default.
    stop_below : float, optional
        Limit in nats. The result then states whether any design may be expected to give more
        information.
    specimens : int, default 200
        Number of simulated specimens, which are the same for all designs.
    draws : int, default 256
        Number of inner draws for each specimen and class.
    random_seed : int or sequence of int, optional
        Seed.

    Returns
    -------
    xarray.Dataset
        Variables with the dimension ``design``, sorted by decreasing information, in nats except
        for fractions:

        ``information``, ``information_se`` : expected information and its standard error.

        ``difference``, ``difference_se`` : information minus that of the first design, and its
        standard error. All designs have the same specimens, so that the error of a difference is
        smaller than those of the two designs suggest.

        ``change_by_half``, ``change_by_half_se`` : information minus that with half of the inner
        draws, and its standard error. The estimate has a bias that is about inversely proportional
        to the number of draws; the remaining bias is therefore about as large as this change.

        ``gain`` (design, specimen) : information for each simulated specimen; NaN if the specimen
        cannot bear the tests. ``weight`` (specimen) : weight of the specimen in the mean. Classes
        are simulated also if they are improbable, and their specimens have small weights.

        ``lacking`` : fraction of specimens that cannot bear the tests. ``unsure`` : fraction of
        specimens with fewer than 40 effective inner draws for some class that is not negligible.

        ``tests`` : description of the tests of each design.

        Attributes: ``entropy`` of the class before the tests, which is the largest possible
        information about the class; ``words`` with the best design or, with `stop_below`, whether
        any design may give more; with `stop_below` also ``stop`` (0 or 1).

    Warns
    -----
    UserWarning
        If more inner draws are needed, some specimens cannot bear a design, or the fit of a class
        is not reliable.

    Raises
    ------
    TypeError, ValueError
        If the classes have no variability, a design is invalid, more than a fifth of the specimens
        cannot bear it, or it measures a force or is of a sheet although the classes have no error
        of forces or of stresses; if a quantity is unknown or lacks its pressure, or `given` has
        several specimens.

    See Also
    --------
    plan_study, plot_information

    Notes
    -----
    For the class ``k`` and data ``y``,

    .. math:: I = E\left[\ln \frac{P(k \mid y)}{P(k)}\right]
        = E\left[\ln \frac{Z_k(y)}{\sum_l P(l) Z_l(y)}\right], \qquad
        Z_k(y) = \int p(y \mid x) \, p_k(x) \, dx,

    is the mutual information of class and data [1]_. Each evidence ``Z_k`` is estimated by
    importance sampling, with inner draws of specimens ``x`` near the best one of each class; the
    density ``p_k`` is averaged over the posterior of the class's distribution. The information is
    also the expected increase of the log score of :func:`score_probabilities`.

    For a quantity ``q`` the information is :math:`E[\ln p(q \mid y) - \ln p(q)]`, with kernel
    density estimates. If all values are positive, the densities are those of ``ln q``, for which
    the information is the same. Kernel densities are somewhat too wide, so that the information is
    somewhat too small: use it to compare designs.

    In classes fitted with an experiment effect the material varies between the tests of a
    specimen; a quantity then belongs to the specimen's mean coordinates.

    References
    ----------
    .. [1] D. V. Lindley, On a measure of the information provided by an experiment, The Annals of
       Mathematical Statistics 27 (1956) 986–1005; K. Chaloner and I. Verdinelli, Bayesian
       experimental design: a review, Statistical Science 10 (1995) 273–304.

    Examples
    --------
    >>> import pymc_hyperelastic as ph
    >>> classes = ph.open_result("hierarchical.nc")  # saved from an example of fit_classes
    >>> designs = {
    ...     "one point": {"pressure": 20, "pressure_unit": "mmHg", "points": 1},
    ...     "curve": {"pressure": (10, 140), "pressure_unit": "mmHg"},
    ... }
    >>> found = ph.expected_information(
    ...     classes, designs, about="alpha", specimens=20, draws=64, random_seed=2
    ... )
    >>> found["design"].values.tolist()
    ['curve', 'one point']
    """
    why = "expected_information needs classes whose specimens differ"
    kind = kind_of_variable_classes(classes, why)
    names = list(classes.children)
    check_count("specimens", specimens, 10)
    check_count("draws", draws, 32)
    if not isinstance(designs, Mapping) or not designs:
        raise ValueError("designs must be a dict from names to planned tests, with at least one")
    if about != "class" and about not in known_quantities(kind):
        raise ValueError(f"about is {about!r}; expected 'class' or one of {known_quantities(kind)}")
    if given is not None:
        check_given(kind, given)
    defaults = Defaults.of(kind, classes, given)
    planned = {str(n): as_design(str(n), d, defaults) for n, d in designs.items()}
    quantities = [] if about == "class" else [about]
    at = complete_conditions(classes, quantities, at, one_pressure=True)
    prior = class_prior_of(class_prior, names)
    if not (prior > 0).all():
        raise ValueError(f"class_prior must be positive for each class; got {class_prior}")
    simulation = Simulation(kind, classes, at, given, np.log(prior), draws)
    seeds = np.random.SeedSequence(random_seed).spawn(3)
    if about != "class":
        # Before the trials, which take minutes: a quantity may lack the tube that it needs.
        of_prior = simulation.specimens(simulation.many, 1, seeds[2], rare=False)
        before = simulation.quantity(about, of_prior)
    tried = simulation.specimens(specimens, max(map(len, planned.values())), seeds[0])
    trials = [
        simulation.trial(name, design, tried, np.random.default_rng(seeds[1]))
        for name, design in planned.items()
    ]
    gains = [
        trial.gains if about == "class" else simulation.quantity_gains(about, tried, before, trial)
        for trial in trials
    ]
    effective = np.stack([trial.effective for trial in trials])
    result = _result(planned, np.stack(gains, axis=1), effective, tried, names, about, stop_below)
    return result.assign_attrs(strain_energy=labels_of([kind])[0], **origin_of(classes))


def _result(
    planned: Mapping[str, Design],
    gains: Array,
    effective: Array,
    tried: Specimens,
    names: Sequence[str],
    about: str,
    stop_below: float | None,
) -> xr.Dataset:
    """Summarise gains (nats) over specimens, with warnings, and sort the designs.

    `gains` has the shape (2, design, specimen), with all and with half of the inner draws;
    `effective` has the effective draws, (design, specimen).
    """
    gain, of_half = gains
    counted = np.isfinite(gain)
    information, error = _mean_and_error(gain, tried)
    best = int(np.nanargmax(information.round(DIGITS)))
    difference, difference_se = _mean_and_error(gain - gain[best], tried)
    change, change_se = _mean_and_error(gain - of_half, tried)
    unsure = np.sum(effective < FEWEST_EFFECTIVE, axis=1) / counted.sum(axis=1)
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
            "lacking": (dims, 1 - counted @ tried.weights / tried.weights.sum()),
            "gain": ((dims, "specimen"), gain),
            "weight": ("specimen", tried.weights),
        },
        {
            "design": list(planned),
            "tests": (dims, [words_of(d) for d in planned.values()]),
            "true_class": ("specimen", [names[k] for k in tried.truth]),
        },
    )
    for name, share in zip(planned, unsure, strict=True):
        if share > MOST_UNSURE:
            warn_user(
                f"design {name!r}: {share:.0%} of the specimens have fewer than {FEWEST_EFFECTIVE} "
                "effective draws, so that their information is unreliable: increase draws"
            )
    for name, moved, its_error in zip(planned, change, change_se, strict=True):
        if abs(moved) > max(LARGEST_ERROR, 3 * its_error):  # neither small, nor by chance
            warn_user(
                f"design {name!r}: the information changes by {moved:.3f} nats if half of the "
                "draws are left out, and is at best as accurate as that: increase draws"
            )
    # A stable sort keeps equally informative designs in the order of the argument.
    order = np.argsort(-information.round(DIGITS), kind="stable")
    result = result.isel(design=order)
    before = np.exp(tried.log_before)
    entropy = float(-np.sum(before * tried.log_before))
    verdict = _verdict([*planned], information, error, stop_below)
    return result.assign_attrs(about=about, entropy=entropy, **verdict)


def _verdict(
    names: Sequence[str], information: Array, error: Array, stop_below: float | None
) -> dict[str, Any]:
    """Return attributes on the best design, or on whether a design may give more than a limit."""
    if stop_below is None:
        best = int(np.nanargmax(information.round(DIGITS)))
        value = Estimate(information[best], error[best])
        return {"words": f"{names[best]!r} is expected to give the most information, {value} nats"}
    upper = information + 2 * error
    most = int(np.nanargmax(upper.round(DIGITS)))
    stop = int(upper[most] < stop_below)
    words = (
        f"no design is expected to give more than {stop_below:g} nats of information: stop"
        if stop
        else f"{names[most]!r} may give more than {stop_below:g} nats of information"
    )
    return {"stop": stop, "words": words}


def _mean_and_error(values: Array, tried: Specimens) -> tuple[Array, Array]:
    """Return the mean over specimens without NaN, and its standard error.

    The number of specimens of each class is fixed, so that only differences within a class count.
    The error is infinite if a class has a single value.
    """
    known, weights = np.isfinite(values), tried.weights
    values, variance = np.where(known, values, 0.0), np.zeros(len(values))
    for k in np.unique(tried.truth):
        own = tried.truth == k
        count = known[:, own].sum(axis=1)
        middle = values[:, own].sum(axis=1) / np.maximum(count, 1)
        squares = ((values[:, own] - middle[:, None]) ** 2).sum(axis=1, where=known[:, own])
        of_class = squares * count / np.maximum(count - 1, 1) * weights[own][0] ** 2
        variance += np.where(count == 1, np.inf, of_class)
    total = known @ weights
    return values @ weights / total, np.sqrt(variance) / total
