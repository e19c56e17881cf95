"""What a study with so many specimens of each group would find."""

from collections.abc import Mapping, Sequence
from itertools import combinations
from typing import Any, NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import NDArray
from scipy import special, stats

from pymc_hyperelastic.classes.average import labels_of
from pymc_hyperelastic.classes.groups import (
    check_quantities,
    groups_of,
    kind_of_groups,
    specimens_in,
)
from pymc_hyperelastic.classes.normal_groups import (
    Found,
    NormalGroups,
    draw_groups,
    partial_correlations,
)
from pymc_hyperelastic.classes.quantities import place_of, unit_of, values_of
from pymc_hyperelastic.classes.variable import Variability
from pymc_hyperelastic.evidence.checks import check_count, check_fraction
from pymc_hyperelastic.models.class_distribution import ClassDistribution, distributions_of
from pymc_hyperelastic.models.settings import origin_of
from pymc_hyperelastic.models.specimen_draws import log_densities
from pymc_hyperelastic.parallel import one_thread
from pymc_hyperelastic.predictions.measured import warn_user
from pymc_hyperelastic.predictions.members import stored_draws

Array = NDArray[np.float64]

_SIZES = (4, 6, 8, 12, 20, 40)
# By how much wider a normal distribution than its class tells what curves say of a specimen, and
# what they are said to tell at least, as a share of that variance.
_WIDER, _LEAST = 1.5, 0.99
# Share of the tubes that do not bear the pressure that is told.
_TOLD = 0.005


class _Pilot(NamedTuple):
    """What a pilot says of groups, and of how well a specimen becomes known."""

    location: Array
    """(group, draw, coordinate)."""
    root: Array
    """Lower Cholesky factors (group, draw, coordinate, coordinate) of specimens' covariances."""
    errors: list[Array]
    """Of each group the covariances (specimen, coordinate, coordinate) of what is found of one."""
    roots_of_errors: list[Array]
    """Lower Cholesky factors of them."""


@one_thread
def plan_study(
    classes: xr.DataTree,
    quantity: str | Sequence[str],
    specimens: Sequence[int] = _SIZES,
    *,
    pressure: float | None = None,
    pressure_range: tuple[float, float] | None = None,
    pressure_unit: str = "kPa",
    density: float = 1060.0,
    tube: Mapping[str, float] | None = None,
    relevant: float = 0.0,
    prob: float = 0.95,
    studies: int = 100,
    draws: int = 200,
    new_specimens: int = 20,
    random_seed: Any = None,
) -> xr.Dataset:
    r"""Estimate what a study with so many specimens of each group would find, by a pilot.

    The pilot does not know how much groups differ. Each simulated study has a truth of its own, one
    that the pilot holds for possible; its specimens are measured as well as those of the pilot, and
    what :func:`compare_classes` would make of them is found for all numbers of specimens. Shares of
    studies are then *assurances*, not the power at one guess.

    Parameters
    ----------
    classes : xarray.DataTree
        The pilot: result of :func:`fit_classes` with ``variability="specimen"``, of two classes or
        more.
    quantity : str or sequence of str
        What groups are to be compared by, as in :func:`compare_classes`.
    specimens : sequence of int, default (4, 6, 8, 12, 20, 40)
        Specimens of each group.
    pressure, pressure_range, pressure_unit, density, tube : optional
        Where a property is looked at, as in :func:`compare_classes`; one pressure.
    relevant : float, default 0
        Smallest difference that matters, in the unit of the quantity.
    prob : float, default 0.95
        Probability that intervals of a difference hold, with equal tails.
    studies : int, default 100
        Studies that are simulated; the larger ones hold the specimens of the smaller.
    draws : int, default 200
        Draws of the groups' distributions in each.
    new_specimens : int, default 20
        Specimens of each group that each study is then asked to classify.
    random_seed : int or sequence of int, optional
        Seed.

    Returns
    -------
    xarray.Dataset
        By ``specimens``, and of all but the log score by ``comparison``, the second class less the
        first, and ``quantity``:

        ``width``, ``width_se`` : median over studies of the width of the interval of the difference
        of the typical specimens, and its standard error. ``width_interval`` : what `prob` of the
        studies lie between (``bound``: low, high).

        ``decided``, ``decided_se`` : share of studies whose interval lies beyond what is
        `relevant`, on either side. ``wrong`` : share of all studies that do, on the wrong one.

        ``covered`` : share of the intervals that hold the truth; about `prob` if all is well.

        ``log_score``, ``log_score_se`` : mean log score of new specimens, measured alike, by
        classes fitted to so many of each group: ln of the probability of the true class, where all
        are equal beforehand. ``best_log_score`` is that of who knows the true distributions.

        ``study_width``, ``study_difference`` (medians) and ``truth`` : of each study.

    Warns
    -----
    UserWarning
        If materials of some studies do not reach the pressure, or the fit of a class is not to be
        trusted.

    Raises
    ------
    TypeError, ValueError
        If there are fewer than two classes, one of them has one specimen or no variability or has
        priors of its own; if a quantity is unknown or lacks its pressure, or there are fewer than
        two specimens.

    See Also
    --------
    expected_information

    Notes
    -----
    What the curves of one specimen say is taken as a normal distribution of its coordinates; each
    simulated specimen is known as well as one of the pilot of its group. A study's groups then have
    posteriors that are drawn from, thousands at once, under the priors of :func:`fit_classes`: by
    Gibbs' and Metropolis' algorithms. Errors that the pilot infers of each specimen are as large as
    they were there; what tests of one specimen differ by is part of them.

    References
    ----------
    A. O'Hagan, J. W. Stevens and M. J. Campbell, Assurance in clinical trial design, Pharmaceutical
    Statistics 4 (2005) 187–201.

    Examples
    --------
    >>> import pymc_hyperelastic as ph
    >>> pilot = ph.open_result("hierarchical.nc")  # saved from an example of fit_classes
    >>> plan = ph.plan_study(pilot, "log_alpha", (4, 20), studies=20, random_seed=1)
    >>> few, many = plan["width"].squeeze().values
    >>> bool(few > many)
    True
    """
    if not isinstance(classes, xr.DataTree):
        raise TypeError(
            f"classes must be a result of ph.fit_classes, the pilot, not {type(classes).__name__}"
        )
    kind, groups = kind_of_groups(classes), groups_of([classes])
    names = [quantity] if isinstance(quantity, str) else list(quantity)
    check_quantities(names, [kind])
    if kind.priors:
        raise ValueError(
            f"the classes have priors of their own, of {sorted(kind.priors)}; studies are planned "
            "under those of the package: fit the pilot without"
        )
    sizes = _sizes(specimens)
    for name, value, least in (
        ("studies", studies, 10),
        ("draws", draws, 50),
        ("new_specimens", new_specimens, 1),
    ):
        check_count(name, value, least)
    check_fraction("prob", prob)
    if not relevant >= 0:
        raise ValueError(f"relevant is {relevant}; expected a difference, 0 or more")
    where = pressure, pressure_range, pressure_unit, density, dict(tube or {})
    place = place_of(classes, names, *where)
    if len(place.pressure) > 1:
        raise ValueError(f"studies are planned for one pressure; got {place.pressure.tolist()}")
    rng = np.random.default_rng(random_seed)
    pilot = _pilot(kind, classes, studies, rng)
    posterior = _studied(kind, pilot, sizes, draws, rng)

    def difference(location: Array) -> Array:
        """Of typical specimens (comparison, quantity, ...), at (group, ..., coordinate)."""
        coordinates = np.moveaxis(location, -1, 0)
        flat = coordinates.reshape(len(coordinates), 1, -1)
        found = np.stack([*values_of(kind, flat, names, place).values()])
        of_groups = found.reshape(len(names), *coordinates.shape[1:])
        pairs = combinations(range(len(groups)), 2)
        return np.stack([of_groups[:, j] - of_groups[:, i] for i, j in pairs])

    truth, found = difference(pilot.location), difference(posterior.location)
    lacking = np.isnan(found).mean()
    if lacking > _TOLD:
        warn_user(
            f"{lacking:.1%} of the materials that studies hold for possible have no such quantity, "
            "and are left out"
        )
    result = _result(truth, found, relevant, prob)
    result = result.assign(_scores(pilot, posterior, new_specimens, rng))
    labels = [f"{b} − {a}" for a, b in combinations(groups, 2)]
    units = [unit_of(name, kind) or "" for name in names]
    coords = {"specimens": sizes, "comparison": labels, "quantity": names}
    return result.assign_coords(coords | {"unit": ("quantity", units)}).assign_attrs(
        **origin_of(classes),
        strain_energy=labels_of([kind])[0],
        pressure_unit=pressure_unit,
        interval=prob,
        relevant=relevant,
        studies=studies,
    )


def _sizes(given: Any) -> list[int]:
    sizes = np.atleast_1d(np.asarray(given))
    if sizes.ndim > 1 or not np.issubdtype(sizes.dtype, np.integer) or not (sizes >= 2).all():
        raise ValueError(f"specimens must be whole numbers, each 2 or more; got {given!r}")
    return sorted(set(sizes.tolist()))


def _pilot(kind: Variability, classes: xr.DataTree, studies: int, rng: Any) -> _Pilot:
    """Truths of so many studies."""
    location, root, errors = [], [], []
    for fitted in classes.children.values():
        distributions = distributions_of(fitted)
        count = len(distributions.location[0])
        chosen = distributions.at(rng.choice(count, size=studies, replace=studies > count))
        location.append(np.asarray(chosen.location)[..., 0].T)
        root.append(np.linalg.cholesky(chosen.covariance()))
        of_each = [_error(stored_draws(fitted, n), distributions) for n in specimens_in(fitted)]
        errors.append(np.stack(of_each))
    return _Pilot(np.stack(location), np.stack(root), errors, [*map(np.linalg.cholesky, errors)])


def _error(draws: Any, distributions: ClassDistribution) -> Array:
    r"""Covariance of what is found of a specimen.

    Under a normal distribution with the covariance ``F``, far wider than the curves leave it, a
    specimen is found with the covariance ``C``; by its curves alone that is ``(C⁻¹ − F⁻¹)⁻¹``.
    """
    covariance = distributions.covariance().mean(axis=0)
    location = np.asarray(distributions.location)[..., 0]
    wide = _WIDER**2 * (covariance + np.cov(location).reshape(covariance.shape))
    within = np.zeros_like(covariance)
    if distributions.experiment_spread is not None:
        within = np.diag(distributions.variance_of_tests().mean(axis=0)) / draws.tests
    middle = location.mean(axis=1)[:, None, None]
    around = ClassDistribution(middle, (), ()).with_covariance(wide[None], middle)
    weights = special.softmax(draws.log_weight + log_densities(draws, around)[0])
    known = np.cov(draws.centre, aweights=weights, ddof=0).reshape(covariance.shape)
    root = np.linalg.cholesky(wide)
    inverse = np.linalg.inv(root)
    shares, directions = np.linalg.eigh(inverse @ known @ inverse.T)
    shares = shares.clip(0, _LEAST)
    of_curves = (directions * (shares / (1 - shares))) @ directions.T
    return root @ of_curves @ root.T + within


def _studied(
    kind: Variability, pilot: _Pilot, sizes: Sequence[int], draws: int, rng: Any
) -> NormalGroups:
    """Posteriors (group, size, study, draw, ...) of all groups."""
    groups, studies, dimension = pilot.location.shape
    found = []
    most = max(map(len, pilot.errors))
    for location, root, errors, roots in zip(*pilot, strict=True):
        z = location[:, None] + rng.standard_normal((studies, sizes[-1], dimension)) @ root.mT
        kind_of_error = rng.integers(len(errors), size=z.shape[:2])
        noise = rng.standard_normal((*z.shape, 1))
        x = z + (roots[kind_of_error] @ noise)[..., 0]
        # Groups of all pilots have errors of as many kinds, of which some may not occur.
        kinds = errors[np.arange(most) % len(errors)]
        found += [
            Found(x[s, :n], kind_of_error[s, :n], kinds) for n in sizes for s in range(studies)
        ]

    def repeated(values: Array) -> Array:
        """One of each group and study, for all sizes."""
        by_size = np.repeat(values[:, None], len(sizes), axis=1)
        return by_size.reshape(groups * len(sizes) * studies, *values.shape[2:])

    flat = pilot.root.reshape(-1, dimension, dimension)
    spreads = np.log(np.linalg.norm(pilot.root, axis=-1))
    partial = partial_correlations(flat).reshape(groups, studies, -1)
    start = repeated(spreads), repeated(partial)
    posterior = draw_groups(kind.scale, found, start, draws, rng)
    apart = groups, len(sizes), studies
    return NormalGroups(*(values.reshape(*apart, *values.shape[1:]) for values in posterior))


def _result(truth: Array, found: Array, relevant: float, prob: float) -> xr.Dataset:
    """What studies find of differences (comparison, quantity, size, study, draw)."""
    tail = (1 - prob) / 2
    low, middle, high = np.nanquantile(found, [tail, 0.5, 1 - tail], axis=-1)
    dims = "comparison", "quantity", "specimens", "study"
    truth = np.broadcast_to(truth[:, :, None], low.shape)
    above, below = low > relevant, high < -relevant
    each = xr.Dataset(
        {
            "study_width": (dims, high - low),
            "study_difference": (dims, middle),
            "decided": (dims, (above | below).astype(float)),
            "wrong": (dims, ((above & (truth < 0)) | (below & (truth > 0))).astype(float)),
            "covered": (dims, ((low <= truth) & (truth <= high)).astype(float)),
            "truth": (("comparison", "quantity", "study"), truth[:, :, 0]),
        }
    )
    count = truth.shape[-1]
    width = each["study_width"]
    shares = each[["decided", "wrong", "covered"]].mean("study")
    ends = width.quantile([tail, 1 - tail], "study").rename(quantile="bound")
    # Of a median, by the order statistics a standard error away from the middle.
    half = 0.5 / np.sqrt(count)
    around = width.quantile([0.5 - half, 0.5 + half], "study")
    return shares.assign(
        decided_se=np.sqrt((shares["decided"] * (1 - shares["decided"])).clip(1 / count) / count),
        width=width.median("study"),
        width_se=around.diff("quantile").squeeze("quantile", drop=True) / 2,
        width_interval=ends.assign_coords(bound=["low", "high"]),
        **{name: each[name] for name in ("study_width", "study_difference", "truth")},
    )


def _scores(pilot: _Pilot, posterior: NormalGroups, count: int, rng: Any) -> xr.Dataset:
    """Log scores of new specimens, by groups as they are known and as they are."""
    groups, studies, dimension = pilot.location.shape
    # All new specimens of a study are known as well as one of the pilot, of either group.
    errors, roots = np.concatenate(pilot.errors), np.concatenate(pilot.roots_of_errors)
    kind = rng.integers(len(errors), size=studies)
    shape = groups, studies, count, dimension
    new = pilot.location[:, :, None] + rng.standard_normal(shape) @ pilot.root.mT
    new += rng.standard_normal(shape) @ roots[kind].mT
    x = np.concatenate([*new], axis=1)  # (study, specimen, coordinate)
    truth = np.repeat(np.arange(groups), count)

    def score(location: Array, root: Array) -> Array:
        """Mean log score of each study, by draws (group, study, draw, ...)."""
        whitening = np.linalg.inv(np.linalg.cholesky(root @ root.mT + errors[kind, None]))
        centred = x[None, :, None] - location[:, :, :, None]
        squares = ((centred @ whitening.mT) ** 2).sum(axis=-1)
        log_volume = np.log(np.diagonal(whitening, axis1=-2, axis2=-1)).sum(axis=-1)
        log_p = special.logsumexp(log_volume[..., None] - squares / 2, axis=2)
        chance = special.log_softmax(log_p, axis=0)
        return chance[truth, :, np.arange(len(truth))].mean(axis=0)

    of_sizes = np.stack(
        [
            score(posterior.location[:, i], posterior.root[:, i])
            for i in range(posterior.location.shape[1])
        ]
    )
    best = score(pilot.location[:, :, None], pilot.root[:, :, None])
    return xr.Dataset(
        {
            "log_score": ("specimens", of_sizes.mean(axis=1)),
            "log_score_se": ("specimens", stats.sem(of_sizes, axis=1)),
            "best_log_score": best.mean(),
        }
    )
