"""Simulate studies of different sizes from a pilot, to choose the number of specimens per group."""

import warnings
from collections.abc import Sequence
from itertools import combinations
from typing import Any, NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import NDArray
from scipy import special, stats

from pymc_hyperelastic.classes.average import labels_of
from pymc_hyperelastic.classes.compare_classes import check_quantities
from pymc_hyperelastic.classes.groups import groups_of, kind_of_groups
from pymc_hyperelastic.classes.hierarchical import HierarchicalClass
from pymc_hyperelastic.classes.quantities import (
    MOST_LACKING,
    complete_conditions,
    unit_of,
    values_of,
)
from pymc_hyperelastic.classes.reference import near_class, one_draw
from pymc_hyperelastic.evidence.checks import check_count, check_fraction
from pymc_hyperelastic.messages import warn_user
from pymc_hyperelastic.models.class_distribution import ClassDistribution, distributions_of
from pymc_hyperelastic.models.settings import origin_of
from pymc_hyperelastic.models.specimen_draws import log_densities
from pymc_hyperelastic.parallel import one_thread
from pymc_hyperelastic.predictions.conditions import Conditions
from pymc_hyperelastic.predictions.members import names_of_specimens, stored_draws

Array = NDArray[np.float64]


class _Pilot(NamedTuple):
    """True distributions of the groups in each simulated study, and estimation errors.

    Each study has one draw of the groups' distributions from the pilot.
    """

    location: Array
    """Locations of the groups, (group, study, coordinate)."""
    covariance: Array
    """Covariances between specimens, (group, study, coordinate, coordinate)."""
    errors: Array
    """Error covariances of the pilot's specimens, (specimen, coordinate, coordinate)."""


class _Known(NamedTuple):
    """Student distributions of a group's location and of a new specimen, in each study."""

    mean: Array
    """Means, (group, size, study, coordinate)."""
    scale: Array
    """Scale matrices of the location, (group, size, study, coordinate, coordinate)."""
    wider: Array
    """Factor from these scale matrices to those of a new specimen, (size,)."""
    freedom: Array
    """Degrees of freedom, (size,)."""


@one_thread
def plan_study(
    classes: xr.DataTree,
    quantity: str | Sequence[str],
    specimens: Sequence[int] = (4, 6, 8, 12, 20, 40),
    *,
    at: Conditions | float | None = None,
    relevant: float = 0.0,
    ci_prob: float = 0.95,
    studies: int = 100,
    draws: int = 200,
    new_specimens: int = 20,
    random_seed: Any = None,
) -> xr.Dataset:
    r"""Estimate from a pilot what studies with different numbers of specimens would find.

    The pilot leaves the difference of the groups uncertain. Each simulated study therefore draws
    true distributions of the groups from the pilot's posterior. It measures specimens as accurately
    as the pilot, and compares groups like :func:`compare_classes`, for all numbers of specimens.
    Fractions of studies are then *assurances* [1]_, not the power at one assumed difference.

    Parameters
    ----------
    classes : xarray.DataTree
        The pilot: result of :func:`fit_classes` with ``variability="specimen"``, of two classes or
        more.
    quantity : str or sequence of str
        Quantities by which groups are compared, as in :func:`compare_classes`.
    specimens : sequence of int, default (4, 6, 8, 12, 20, 40)
        Numbers of specimens per group.
    at : Conditions, or pressure in kPa, optional
        Conditions for which properties are computed, as in :func:`compare_classes`; only one
        pressure.
    relevant : float, default 0
        Smallest difference that matters, in the unit of the quantity.
    ci_prob : float, default 0.95
        Probability of the equal-tailed intervals of a difference.
    studies : int, default 100
        Number of simulated studies of each size. A study contains the specimens of the same study
        of the next smaller size.
    draws : int, default 200
        Posterior draws of the groups' locations in each study.
    new_specimens : int, default 20
        Number of new specimens per group that each study classifies.
    random_seed : int or sequence of int, optional
        Seed.

    Returns
    -------
    xarray.Dataset
        Variables with the dimension ``specimens``. Except for the log scores they also have the
        dimensions ``quantity`` and ``comparison``, the second class minus the first:

        ``width``, ``width_se`` : median over studies of the width of the interval of the difference
        of the typical specimens, and its standard error. ``width_interval`` : central interval that
        contains the widths of a fraction `ci_prob` of the studies (``bound``: low, high).

        ``decided``, ``decided_se`` : fraction of studies whose interval lies entirely above
        `relevant` or below ``-relevant``, and its standard error. ``wrong``, ``wrong_se`` :
        fraction of all studies that decide for the wrong sign. ``covered``, ``covered_se`` :
        fraction of intervals that contain the true difference; about `ci_prob` if calibrated.

        ``log_score``, ``log_score_se`` : mean log probability of the true class of new specimens,
        measured as in the pilot, by classes with this number of specimens and equal prior
        probabilities (nats), and its standard error. ``best_log_score`` : mean log score if the
        true distributions are known.

        ``study_width``, ``study_difference`` (medians) and ``truth`` : values of each ``study``.

    Warns
    -----
    UserWarning
        If some simulated materials do not reach the pressure, or the fit of a class is not
        reliable.

    Raises
    ------
    TypeError, ValueError
        If there are fewer than two classes, a class has only one specimen, no variability or
        user-defined priors, a quantity is unknown or lacks its pressure, or a number of specimens
        is below two.

    See Also
    --------
    expected_information

    Notes
    -----
    The likelihood of one specimen's curves is approximated by a normal distribution of its
    coordinates, with the covariance of a specimen of the pilot, including differences between its
    tests. The estimated coordinates then vary around the location of their group, with the sum of
    the covariances of specimens and estimation errors. The prior is conjugate, normal-inverse
    Wishart: the log density of the logarithm of each spread has the same mode and curvature as in
    :func:`fit_classes`. The location and a new specimen then have Student distributions [2]_.

    References
    ----------
    .. [1] A. O'Hagan, J. W. Stevens and M. J. Campbell, Assurance in clinical trial design,
       Pharmaceutical Statistics 4 (2005) 187–201.
    .. [2] A. Gelman, J. B. Carlin, H. S. Stern, D. B. Dunson, A. Vehtari and D. B. Rubin, Bayesian
       Data Analysis, 3rd edition, CRC Press 2013, section 3.6.

    Examples
    --------
    >>> import pymc_hyperelastic as ph
    >>> pilot = ph.open_result("hierarchical.nc")  # saved from an example of fit_classes
    >>> plan = ph.plan_study(pilot, "log_alpha", (4, 20), studies=20, random_seed=1)
    >>> few, many = plan["width"].squeeze().values
    >>> bool(few > many)
    True
    """
    kind, groups = kind_of_groups(classes), groups_of([classes])
    names = [quantity] if isinstance(quantity, str) else list(quantity)
    check_quantities(names, [kind])
    if kind.priors:
        raise ValueError(
            f"the classes were fitted with user-defined priors, of {sorted(kind.priors)}; "
            "plan_study supports the default priors only: fit the pilot without priors"
        )
    sizes = _sizes(specimens)
    check_count("studies", studies, 10)
    check_count("draws", draws, 50)
    check_count("new_specimens", new_specimens, 1)
    check_fraction("ci_prob", ci_prob)
    if not relevant >= 0:
        raise ValueError(f"relevant is {relevant}; expected a difference, 0 or more")
    at = complete_conditions(classes, names, at, one_pressure=True)
    rng = np.random.default_rng(random_seed)
    pilot = _pilot(kind, classes, studies, rng)
    posteriors = _studied(kind, pilot, sizes, rng)

    def difference(location: Array) -> Array:
        """Return differences of typical specimens, from (group, ..., coordinate) locations."""
        coordinates = np.moveaxis(location, -1, 0)
        flat = coordinates.reshape(len(coordinates), 1, -1)
        found = np.stack([*values_of(kind, flat, names, at).values()])
        of_groups = found.reshape(len(names), *coordinates.shape[1:])
        pairs = combinations(range(len(groups)), 2)
        return np.stack([of_groups[:, j] - of_groups[:, i] for i, j in pairs])

    truth, found = difference(pilot.location), difference(_locations(posteriors, draws, rng))
    lacking = np.isnan(found).mean()
    if lacking > MOST_LACKING:
        warn_user(
            f"{lacking:.1%} of the simulated materials do not have the quantity, such as a radius "
            "at this pressure, and are left out"
        )
    scores = _scores(pilot, posteriors, new_specimens, rng)
    result = _result(truth, found, relevant, ci_prob).assign(scores)
    coords = {
        "specimens": sizes,
        "comparison": [f"{b} − {a}" for a, b in combinations(groups, 2)],
        "quantity": names,
        "unit": ("quantity", [unit_of(name, kind) or "" for name in names]),
    }
    return result.assign_coords(coords).assign_attrs(
        **origin_of(classes),
        strain_energy=labels_of([kind])[0],
        pressure_unit=at.pressure_unit,
        interval=ci_prob,
        relevant=relevant,
        studies=studies,
    )


def _sizes(given: Any) -> list[int]:
    sizes = np.atleast_1d(np.asarray(given))
    if sizes.ndim > 1 or not np.issubdtype(sizes.dtype, np.integer) or not (sizes >= 2).all():
        raise ValueError(f"specimens must be whole numbers, each 2 or more; got {given!r}")
    return sorted(set(sizes.tolist()))


def _pilot(kind: HierarchicalClass, classes: xr.DataTree, studies: int, rng: Any) -> _Pilot:
    """Draw the true distributions of each study, and compute the estimation errors of the pilot."""
    location, covariance, errors = [], [], []
    for fitted in classes.children.values():
        distributions = distributions_of(fitted)
        count = len(distributions.location[0])
        chosen = distributions.at(rng.choice(count, size=studies, replace=studies > count))
        location.append(np.asarray(chosen.location)[..., 0].T)
        covariance.append(chosen.covariance())
        specimens = [stored_draws(fitted, name) for name in names_of_specimens(fitted)]
        errors += [_error(draws, distributions) for draws in specimens]
    return _Pilot(np.stack(location), np.stack(covariance), np.stack(errors))


def _error(draws: Any, distributions: ClassDistribution) -> Array:
    r"""Return the covariance of the estimation error of a specimen's coordinates.

    For a normal prior with the covariance ``F``, wider than the class, the posterior has the
    covariance ``C``; that of the likelihood is ``(C⁻¹ − F⁻¹)⁻¹``. Differences between the tests of
    the specimen add to it.

    A ratio of variances that is estimated from ``n`` draws has the standard error ``(2/n)^(1/2)``.
    Ratios of ``C`` to ``F`` are therefore bounded below 1, which keeps the covariance finite where
    the curves have no information.
    """
    d = distributions
    around = one_draw(near_class(ClassDistribution(d.location, d.spread, d.factor)))
    (wide,) = around.covariance()
    within = np.zeros_like(wide)
    if d.experiment_spread is not None:
        within = np.diag(d.variance_of_tests().mean(axis=0)) / draws.tests
    weights = special.softmax(draws.log_weight + log_densities(draws, around)[0])
    posterior = np.cov(draws.centre, aweights=weights, ddof=0).reshape(wide.shape)
    root = np.linalg.cholesky(wide)
    inverse = np.linalg.inv(root)
    ratios, directions = np.linalg.eigh(inverse @ posterior @ inverse.T)
    ratios = ratios.clip(0, 1 - np.sqrt(2 / len(weights)))
    of_curves = (directions * (ratios / (1 - ratios))) @ directions.T
    return root @ of_curves @ root.T + within


def _studied(kind: HierarchicalClass, pilot: _Pilot, sizes: Sequence[int], rng: Any) -> _Known:
    """Return the posteriors of the groups in studies of these sizes."""
    specimens = _found(pilot, sizes[-1], rng)[0]
    mean, spread = kind.scale.location_prior[0], np.exp(kind.scale.spread_prior[0])
    # Conjugate prior: `weight` is the number of specimens to which the prior of the location is
    # equivalent. `freedom` gives the density of the logarithm of a spread the curvature of the
    # default prior, and `scatter` gives it the mode.
    weight = np.mean((spread / kind.scale.location_prior[1]) ** 2)
    freedom = 1 / (2 * kind.scale.spread_prior[1] ** 2)
    scatter = freedom * np.diag(spread**2 + pilot.errors.mean(axis=0).diagonal())
    middles, scales = [], []
    for n in sizes:
        x = specimens[:, :, :n]
        found = x.mean(axis=2)
        centred = x - found[:, :, None]
        off = found - mean
        total = scatter + centred.mT @ centred
        total = total + weight * n / (weight + n) * off[..., None] * off[..., None, :]
        middles.append((weight * mean + n * found) / (weight + n))
        scales.append(total / ((weight + n) * (freedom + n)))
    counts = np.array(sizes)
    middle, scale = (np.stack(of_sizes, axis=1) for of_sizes in (middles, scales))
    return _Known(middle, scale, weight + counts + 1, freedom + counts)


def _found(pilot: _Pilot, count: int, rng: Any) -> tuple[Array, Array]:
    """Return estimates (group, study, specimen, coordinate), and their error covariances."""
    groups, studies, dimension = pilot.location.shape
    noise = rng.standard_normal((2, groups, studies, count, dimension))
    errors = pilot.errors[rng.integers(len(pilot.errors), size=noise.shape[1:4])]
    roots = np.linalg.cholesky(pilot.covariance), np.linalg.cholesky(errors)
    x = pilot.location[:, :, None] + noise[0] @ roots[0].mT
    return x + (roots[1] @ noise[1][..., None])[..., 0], errors


def _locations(posteriors: _Known, draws: int, rng: Any) -> Array:
    """Draw locations of the groups, (group, size, study, draw, coordinate)."""
    freedom = posteriors.freedom[:, None, None]
    noise = rng.standard_normal((*posteriors.mean.shape[:3], draws, posteriors.mean.shape[-1]))
    noise *= np.sqrt(freedom / rng.chisquare(freedom, noise.shape[:-1]))[..., None]
    return posteriors.mean[..., None, :] + noise @ np.linalg.cholesky(posteriors.scale).mT


def _result(truth: Array, found: Array, relevant: float, ci_prob: float) -> xr.Dataset:
    """Summarise draws of differences, (comparison, quantity, size, study, draw), over studies."""
    tail = (1 - ci_prob) / 2
    # Linear interpolation between few draws makes intervals too narrow: by 3 % for 200 draws.
    with warnings.catch_warnings(action="ignore", category=RuntimeWarning):  # all may be NaN
        ends = np.nanquantile(found, [tail, 0.5, 1 - tail], -1, method="median_unbiased")
    low, middle, high = ends
    truth = np.broadcast_to(truth[:, :, None], low.shape)
    above, below = low > relevant, high < -relevant
    decisions = {
        "decided": above | below,
        "wrong": (above & (truth < 0)) | (below & (truth > 0)),
        "covered": (low <= truth) & (truth <= high),
    }
    dims = "comparison", "quantity", "specimens", "study"
    # Studies in which a typical specimen lacks the quantity are left out.
    known = np.isfinite(low + truth)
    each = xr.Dataset({name: (dims, np.where(known, v, np.nan)) for name, v in decisions.items()})
    shares, count = each.mean("study"), each["decided"].count("study")
    errors = np.sqrt((shares * (1 - shares)).clip(1 / count) / count)
    width = xr.DataArray(high - low, dims=dims)
    between = width.quantile([tail, 1 - tail], "study").rename(quantile="bound")
    # Standard error of the median, from the order statistics one standard error from the middle.
    half = 0.5 / np.sqrt(width.sizes["study"])
    around = width.quantile([0.5 - half, 0.5 + half], "study")
    return shares.assign(
        width=width.median("study"),
        width_se=around.diff("quantile").squeeze("quantile", drop=True) / 2,
        width_interval=between.assign_coords(bound=["low", "high"]),
        **{f"{name}_se": error for name, error in errors.items()},
        study_width=width,
        study_difference=(dims, middle),
        truth=(("comparison", "quantity", "study"), truth[:, :, 0]),
    )


def _scores(pilot: _Pilot, posteriors: _Known, count: int, rng: Any) -> xr.Dataset:
    """Return log scores of `count` new specimens per group, by posteriors and by the truth."""
    x, errors = _found(pilot, count, rng)
    groups = np.arange(len(x))

    def score(log_density: Array) -> Array:
        """Return the mean log score of each study, from (class, group, study, specimen)."""
        return special.log_softmax(log_density, axis=0)[groups, groups].mean(axis=(0, 2))

    def squares(mean: Array, scale: Array) -> tuple[Array, Array]:
        """Return squared Mahalanobis distances from a mean, and half the log determinant."""
        root = np.linalg.cholesky(scale)
        whitened = np.linalg.solve(root, (x - mean)[..., None])[..., 0]
        log_volume = np.log(np.diagonal(root, axis1=-2, axis2=-1)).sum(axis=-1)
        return (whitened**2).sum(axis=-1), log_volume

    dimension, by_size = x.shape[-1], []
    for i, (wider, freedom) in enumerate(zip(posteriors.wider, posteriors.freedom, strict=True)):
        log_density = []
        for mean, scale in zip(posteriors.mean[:, i], posteriors.scale[:, i], strict=True):
            square, log_volume = squares(mean[:, None], wider * scale[:, None])
            # Student log density, without the constants that all classes share.
            log_density.append(-np.log1p(square / freedom) * (freedom + dimension) / 2 - log_volume)
        by_size.append(score(np.stack(log_density)))
    truth = [
        squares(pilot.location[g][:, None], pilot.covariance[g][:, None] + errors) for g in groups
    ]
    best = score(np.stack([-r / 2 - v for r, v in truth]))
    return xr.Dataset(
        {
            "log_score": ("specimens", np.mean(by_size, axis=1)),
            "log_score_se": ("specimens", stats.sem(by_size, axis=1)),
            "best_log_score": best.mean(),
        }
    )
