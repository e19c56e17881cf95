"""Whether groups differ: in what, by how much, and how sure that is."""

import json
import warnings
from collections.abc import Mapping, Sequence
from itertools import combinations
from typing import Any, NamedTuple

import numpy as np
import pymc as pm
import xarray as xr
from numpy.typing import NDArray
from scipy import stats
from scipy.special import expit, logsumexp

from pymc_hyperelastic.classes.average import Laws, labels_of, laws_of
from pymc_hyperelastic.classes.covariates import Covariates, pairs_of
from pymc_hyperelastic.classes.distribution import ClassModel
from pymc_hyperelastic.classes.joint import Apart, Joint, Unit, unit_of_pair, unit_of_specimen
from pymc_hyperelastic.classes.kinds import kind_of_variable_classes
from pymc_hyperelastic.classes.quantities import (
    Place,
    is_logarithm,
    known_quantities,
    place_of,
    standard_specimens,
    unit_of,
    values_of,
)
from pymc_hyperelastic.classes.sensitivity import log_prior_and_likelihood, power_scaling
from pymc_hyperelastic.classes.variable import Variability
from pymc_hyperelastic.evidence.checks import check_count, check_fraction
from pymc_hyperelastic.evidence.diagnosis import log_evidence
from pymc_hyperelastic.evidence.estimate import Estimate
from pymc_hyperelastic.models.class_distribution import ClassDistribution, distributions_of
from pymc_hyperelastic.models.settings import origin_of
from pymc_hyperelastic.models.specimen_draws import density_of_each
from pymc_hyperelastic.parallel import one_thread
from pymc_hyperelastic.predictions.measured import warn_user
from pymc_hyperelastic.predictions.members import names_of_specimens, stored_draws

Array = NDArray[np.float64]
type Classes = xr.DataTree | Mapping[str, xr.DataTree] | Sequence[xr.DataTree]

STATISTICS = ["typical", "mean", "spread"]
# How far groups are apart beforehand where differences are estimated: anywhere.
_ANY = Apart(location=3.0, log_spread=1.0)
# Standard deviation of the difference of logarithms of spreads where it is asked whether groups
# differ at all, for a difference of locations of one spread.
_LOG_SPREAD = 0.5
# Points of a grid on which distributions of a quantity over specimens are compared, and how far it
# reaches beyond them, in their widths; the least width, as a share of a quantity.
_GRID, _BEYOND, _SMALLEST = 128, 4.0, 1e-9
# Draws of a prior.
_PRIOR = 4000
# Shares of specimens without a quantity from which on that is told.
_TOLD = 0.005
# Draws of a specimen by which the likelihood of its class is known well enough to be raised to
# powers near 1.
_SOME = 512


class _Groups(NamedTuple):
    """Draws of the distributions of groups."""

    distributions: dict[str, ClassDistribution]
    """Of each group by itself."""
    coordinates: dict[str, Array]
    """Of specimens (coordinate, draw, specimen), the first of which is the typical one."""
    powers: Array
    """Log prior and log likelihood (2, draw)."""
    effects: Array | None = None
    """Of one standard deviation of each covariate (covariate, coordinate, draw)."""


@one_thread
def compare_classes(
    classes: Classes,
    quantity: str | Sequence[str],
    *,
    pressure: Any = None,
    pressure_range: Any = None,
    pressure_unit: str = "kPa",
    density: float = 1060.0,
    tube: Mapping[str, float] | None = None,
    pair: Any = None,
    covariates: Any = None,
    effect_prior: float = 1.0,
    bayes_factor: bool = True,
    draws: int = 1000,
    specimens: int = 32,
    prob: float = 0.95,
    random_seed: Any = None,
) -> xr.Dataset:
    r"""Compare groups of specimens: in what they differ, by how much, and how sure that is.

    Each draw of a class's distribution has a *typical* specimen, the one in the middle, and other
    specimens around it. A quantity of the first, its *mean* over the others and its *spread*, their
    standard deviation, are what groups are compared by: where a quantity is no linear function of
    the coordinates in which specimens are spread normally, the mean is not that of the typical one.

    Differences are those of materials: all are looked at in one tube.

    Parameters
    ----------
    classes : xarray.DataTree, or several of them
        Result of :func:`fit_classes` with ``variability="specimen"``. Several results, of one
        strain energy each, are averaged by the probability that the data give these.
    quantity : str or sequence of str
        Coordinates of the specimens, such as ``"log_alpha"``; parameters of the material, such as
        ``"mu"``, or ``"mu[0]"`` of a vector; or properties of :func:`tube_properties`, from
        ``"compliance"`` to ``"in_vivo_axial_stretch"``. ``"log compliance"`` is the logarithm of
        one, whose difference is that of a ratio.
    pressure : array_like, optional
        Internal pressures of the properties, in `pressure_unit`. Several give curves.
    pressure_range : pair of float, optional
        Diastolic and systolic pressure, for ``"stored_energy_change"`` and
        ``"in_vivo_axial_stretch"``.
    pressure_unit : str, default "kPa"
        Unit of both.
    density : float, default 1060
        Density of the fluid within, kg/m³, for ``"pulse_wave_velocity"``.
    tube : dict of str to float, optional
        ``inner_radius``, ``outer_radius`` (mm), ``axial_stretch`` and ``opening_angle`` (rad) of
        the tube. What is left out is the median of all specimens that were measured.
    pair : str or dict, optional
        Which animal a specimen is of, by the name of a variable of the data by test, or as a dict
        from specimens to animals: two groups are then the same animals, before and after.
    covariates : sequence of str, dict or pandas.DataFrame, optional
        Age, sex, batch: names of variables of the data by test, or values by name and specimen.
        Each moves all coordinates linearly, by as much in all groups; what is not a number is a
        category. Groups are compared at the mean of all.
    effect_prior : float, default 1
        For the Bayes factor: standard deviation of the difference of two groups in each coordinate,
        in units of the spread between specimens, if there is a difference.
    bayes_factor : bool, default True
        Whether it is wanted; it takes as long as fitting the distributions of all groups twice.
    draws : int, default 1000
        Draws of the groups' distributions, no more than the classes have.
    specimens : int, default 32
        Specimens of each draw, evenly spread in probability.
    prob : float, default 0.95
        Probability that intervals hold, with equal tails.
    random_seed : int or sequence of int, optional
        Seed.

    Returns
    -------
    xarray.Dataset
        A ``comparison`` is ``second − first`` of two classes; a ``statistic`` is ``"typical"``,
        ``"mean"`` or ``"spread"``. Where a quantity has a posterior its median has the name of the
        quantity, its standard deviation ends in ``_sd``, and the ends of its interval
        (``bound``: low, high) in ``_interval``.

        ``value`` : of each group, (statistic, group, quantity).

        ``difference``, ``ratio`` : (statistic, comparison, quantity). Logarithms have no ratio.

        ``probability_of_rise``, ``probability_of_direction`` : that the difference is positive, and
        that it has the sign that is more probable.

        ``effect_size`` : difference of the typical specimens, in units of the spread between
        specimens, the root of the mean of both variances.

        ``overlap`` : :math:`\int \min(f, g)` of the distributions of the quantity over specimens;
        1 if they are one. ``best_accuracy`` is what a single new specimen can tell at best by it,
        if both groups are equally probable: :math:`1 - \tfrac12` of the overlap.

        ``overlap_of_specimens`` : the same of the specimens with all their coordinates.

        ``log_bayes_factor``, ``log_bayes_factor_se`` : logarithm of the evidence of a difference
        against that of one distribution, by comparison, and its standard error;
        ``probability_of_difference`` if both are as probable beforehand. It is about the whole
        distribution, not about a quantity.

        ``prior_sensitivity``, ``likelihood_sensitivity`` : how much the difference changes as prior
        or likelihood are raised to a power near 1 [1]_. Where the first is above 0.05 the prior has
        a say, and where the second is below that, the data have little.

        ``coordinate_spread``, ``prior_coordinate_spread`` : how far specimens of a group differ in
        each ``coordinate``, a standard deviation, with its interval; and the same beforehand. Where
        both are alike few specimens have told little of it. Of several strain energies that of the
        most probable one.

        ``lacking`` : share of the specimens of a group that have no such quantity, as they do not
        reach the pressure; they are left out of it.

        ``draws`` : draws of the values.

        Of pairs also ``effect_size_of_change``, in units of the spread of changes between animals
        (``spread_of_change``), and ``share_rising``, of animals in which the quantity rises. With
        covariates also ``covariate_effect`` (covariate, coordinate), of one unit of each.

        In its attributes are the tube, and in ``words`` how many differences were looked at: each
        is judged by itself, and nothing is corrected for their number.

    Warns
    -----
    UserWarning
        If some specimens lack a quantity, groups and covariates cannot be told apart, or the fit of
        a class is not to be trusted.

    Raises
    ------
    TypeError, ValueError
        If there are fewer than two classes, one of them has one specimen or no variability, a
        quantity is unknown, a property lacks its pressure, an animal its other half, or a specimen
        a covariate.

    See Also
    --------
    fit_classes, plot_comparison

    Notes
    -----
    *Estimates* of groups by themselves rest on the distributions that :func:`fit_classes` has
    fitted. With covariates, and for the Bayes factor, one model holds all groups: with the
    location ``m``, the spreads ``s`` and the correlation of all,

    .. math:: m_g = m ± \tfrac12 s \circ δ, \qquad \ln s_g = \ln s ± \tfrac12 τ, \qquad
        δ \sim N(0, a^2), \quad τ \sim N(0, b^2).

    Estimates take ``a = 3`` and ``b = 1``, which says hardly anything; the Bayes factor asks
    whether there is a difference of about ``a = effect_prior``, ``b = a/2``, against none. With a
    wide prior it would speak for none whenever a difference is smaller than nearly all that were
    expected.

    Of *pairs* the middle of both halves and the change are independent, with distributions of
    their own: ``N(m, Σ)`` and ``N(s ∘ δ, Ω)``.

    References
    ----------
    .. [1] N. Kallioinen, T. Paananen, P.-C. Bürkner and A. Vehtari, Detecting and diagnosing prior
       and likelihood sensitivity with power-scaling, Statistics and Computing 34 (2024) 57.

    Examples
    --------
    >>> import pymc_hyperelastic as ph
    >>> classes = ph.open_result("hierarchical.nc")  # saved from an example of fit_classes
    >>> result = ph.compare_classes(classes, "log_alpha", bayes_factor=False, random_seed=1)
    >>> result["comparison"].values.tolist()
    ['C2 − C1']
    """
    trees = _fits(classes)
    kinds = [kind_of_groups(tree) for tree in trees]
    groups = groups_of(trees)
    names = [quantity] if isinstance(quantity, str) else list(quantity)
    check_quantities(names, kinds)
    check_count("draws", draws, 100)
    check_count("specimens", specimens, 2)
    check_fraction("prob", prob)
    laws = laws_of(trees, kinds, argument="classes")
    where = pressure, pressure_range, pressure_unit, density, dict(tube or {})
    place = place_of(trees[0], names, *where)
    studies = [
        _Study(kind, tree, groups, pair, covariates)
        for kind, tree in zip(kinds, trees, strict=True)
    ]
    count = min(draws, *(_size(tree[g]) for tree in trees for g in groups))
    seeds = np.random.SeedSequence(random_seed).spawn(2 * len(studies) + 1)
    found = [
        study.groups_by_draw(count, specimens, seed)
        for study, seed in zip(studies, seeds[1::2], strict=True)
    ]
    of_laws = [_by_draw(*each, names, place) for each in zip(studies, found, strict=True)]
    chosen = np.random.default_rng(seeds[0]).choice(
        len(of_laws), size=count, p=np.exp(laws.log_probability)
    )
    at = {
        "law": xr.DataArray(chosen, dims="draw"),
        "draw": xr.DataArray(np.arange(count), dims="draw"),
    }
    result = _summary(xr.concat(of_laws, "law").isel(at), prob)
    likely = int(np.argmax(laws.log_probability))
    alone = _summary(of_laws[likely], prob) if len(of_laws) > 1 else result
    log_prior, log_likelihood = found[likely].powers
    scaling = power_scaling(_differences(alone), log_prior, log_likelihood)
    result = result.assign(scaling)
    if bayes_factor:
        apart = Apart(effect_prior, effect_prior * _LOG_SPREAD)
        factors = [
            study.bayes_factors(apart, count, seed)
            for study, seed in zip(studies, seeds[2::2], strict=True)
        ]
        result = result.assign(_averaged(factors, laws))
    _warn_of_lacking(result)
    result = result.assign(_spreads(studies[likely].kind, found[likely].distributions, prob))
    if studies[0].covariates.names:
        result = result.assign(_effects(studies[likely], found[likely].effects, prob))
    return _described(result, studies, place, labels_of(kinds), prob)


class _Study:
    """Groups of specimens under one law: by themselves, in pairs, or with covariates."""

    def __init__(
        self,
        kind: Variability,
        tree: xr.DataTree,
        groups: Sequence[str],
        pair: Any,
        covariates: Any,
    ) -> None:
        self.kind, self.groups, self.tree = kind, list(groups), tree
        self.covariates = Covariates(tree, covariates)
        self.pairs = pairs_of(tree, pair) if pair is not None else []
        if self.pairs and kind.experiment_effect:
            raise ValueError(
                "pairs are compared of classes without experiment_effect: fit them without"
            )

    @property
    def comparisons(self) -> list[tuple[str, str]]:
        """Pairs of groups."""
        return list(combinations(self.groups, 2))

    def groups_by_draw(self, count: int, specimens: int, seed: np.random.SeedSequence) -> _Groups:
        """Draws of the distributions of all groups, with so many specimens of each."""
        size = len(self.kind.scale.names)
        if self.pairs:
            joint, units = self._joint(["pairs"], _ANY), {"pairs": self._paired_units()}
            fitted = joint.fit(units, count, 1, seed)
            middle, change = joint.distributions(fitted, count)["pairs"]
            powers = log_prior_and_likelihood(joint.kernel(units, _SOME), fitted, count)
            standard = standard_specimens(2 * size, specimens)
            return _of_pairs(self.groups, middle, change, standard, powers)
        standard = standard_specimens(size, specimens)
        if self.covariates.names:
            joint, units = self._joint(self.groups, _ANY), self._units(self.groups)
            fitted = joint.fit(units, count, 1, seed)
            powers = log_prior_and_likelihood(joint.kernel(units, _SOME), fitted, count)
            distributions = {g: d for g, (d,) in joint.distributions(fitted, count).items()}
            effects = np.array(next(iter(distributions.values())).effects)[..., 0]
            distributions = {g: d.without_effects() for g, d in distributions.items()}
        else:
            distributions = {g: distributions_of(self.tree[g], count) for g in self.groups}
            effects = None
            powers = np.sum([self._powers(group, count) for group in self.groups], axis=0)
        coordinates = {g: d.coordinates(standard.T) for g, d in distributions.items()}
        return _Groups(distributions, coordinates, powers, effects)

    def _powers(self, group: str, count: int) -> Array:
        """Log prior and log likelihood of draws of one group's distribution."""
        fitted = self.tree[group]
        few = {n: self._draws(group, n).first(_SOME) for n in specimens_in(fitted)}
        return log_prior_and_likelihood(ClassModel(self.kind).kernel(few, 1), fitted, count)

    def bayes_factors(
        self, apart: Apart, count: int, seed: np.random.SeedSequence
    ) -> list[Estimate]:
        """Logarithms of the evidence of a difference against that of none, by comparison."""
        found = []
        for pair, own in zip(self.comparisons, seed.spawn(len(self.comparisons)), strict=True):
            if self.pairs:
                units = {"pairs": self._paired_units()}
                both = [
                    ({"pairs": units["pairs"]}, self._joint(["pairs"], a)) for a in (apart, None)
                ]
            else:
                units = self._units(pair)
                together = {"all": {f"{g}: {n}": u for g in pair for n, u in units[g].items()}}
                both = [
                    (units, self._joint(pair, apart)),
                    (together, self._joint(["all"], None)),
                ]
            evidences = [
                log_evidence(joint.fit(known, count, 1, its))
                for (known, joint), its in zip(both, own.spawn(2), strict=True)
            ]
            (value, error), (of_none, error_of_none) = evidences
            found.append(Estimate(value - of_none, float(np.hypot(error, error_of_none))))
        return found

    def _joint(self, groups: Sequence[str], apart: Apart | None) -> Joint:
        return Joint(self.kind, groups, apart, self.covariates.names, bool(self.pairs))

    def _units(self, groups: Sequence[str]) -> dict[str, dict[str, Unit]]:
        return {
            group: {
                name: unit_of_specimen(self._draws(group, name), self.covariates.of(group, name))
                for name in specimens_in(self.tree[group])
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
) -> _Groups:
    """Both groups of pairs; a specimen of one and of the other are of the same animal."""
    size = middle.size
    effects = np.array(middle.effects)[..., 0] if len(middle.effects) else None
    of_middle = middle.coordinates(standard[:, :size].T)
    of_change = change.coordinates(standard[:, size:].T)
    coordinates = {
        g: of_middle + sign * of_change / 2 for g, sign in zip(groups, (-1, 1), strict=True)
    }
    middle, change = middle.without_effects(), change.without_effects()
    covariance = middle.covariance() + change.covariance() / 4
    distributions = {
        g: middle.with_covariance(
            covariance, middle.location + sign * np.asarray(change.location) / 2
        )
        for g, sign in zip(groups, (-1, 1), strict=True)
    }
    return _Groups(distributions, coordinates, powers, effects)


def _fits(classes: Classes) -> list[xr.DataTree]:
    """Fitted classes, of each strain energy."""
    if isinstance(classes, xr.DataTree):
        return [classes]
    trees = list(classes.values() if isinstance(classes, Mapping) else classes)
    for tree in trees:
        if not isinstance(tree, xr.DataTree):
            raise TypeError(
                "classes must be a result of ph.fit_classes, or several of them, of one strain "
                f"energy each; here is {type(tree).__name__}"
            )
    if not trees:
        raise ValueError("there are no classes: expected a result of ph.fit_classes")
    return trees


def kind_of_groups(tree: xr.DataTree) -> Variability:
    """The kind of classes, whose specimens have to differ."""
    return kind_of_variable_classes(
        tree, "groups are compared by the distributions of their specimens"
    )


def groups_of(trees: Sequence[xr.DataTree]) -> list[str]:
    """Names of the groups: two or more, of two specimens or more."""
    groups = list(trees[0].children)
    if len(groups) < 2:
        raise ValueError(f"two classes or more can be compared; here is {groups}")
    for tree in trees:
        for name in groups:
            specimens = specimens_in(tree[name])
            if len(specimens) < 2:
                raise ValueError(
                    f"class {name!r} has one specimen, {specimens[0]!r}: how far its specimens "
                    "differ is not known, and nothing can be said of a difference"
                )
    return groups


def specimens_in(fitted: xr.DataTree) -> list[str]:
    """Names of the specimens of a class."""
    return names_of_specimens(fitted)


def check_quantities(names: Sequence[str], kinds: Sequence[Variability]) -> None:
    """Raise unless these are quantities of all of the kinds."""
    if not names or len(set(names)) < len(names):
        raise ValueError(f"quantity must be one or several different names; got {list(names)}")
    for kind in kinds:
        known = known_quantities(kind)
        for name in names:
            if name not in known and unit_of(name, kind) is None:
                raise ValueError(
                    f"no quantity is called {name!r}; of {labels_of([kind])[0]} there are {known}, "
                    "and the logarithm of each, as 'log compliance'"
                )


def _size(fitted: xr.DataTree) -> int:
    posterior = fitted["posterior"]
    return int(posterior.sizes["chain"] * posterior.sizes["draw"])


def _by_draw(study: _Study, found: _Groups, names: Sequence[str], place: Place) -> xr.Dataset:
    """All that is compared, by draw of the distributions of the groups."""
    groups, kind = study.groups, study.kind
    values = np.stack(
        [np.stack([*values_of(kind, found.coordinates[g], names, place).values()]) for g in groups]
    )  # (group, quantity, pressure, draw, specimen)
    typical, others = values[..., 0], values[..., 1:]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # all specimens may lack it
        statistics = [typical, np.nanmean(others, axis=-1), np.nanstd(others, axis=-1)]
    places = list(combinations(range(len(groups)), 2))
    of_comparison = "comparison", "quantity", "pressure", "draw"
    result = xr.Dataset(
        {
            "draws": (("statistic", "group", "quantity", "pressure", "draw"), np.stack(statistics)),
            "lacking": (
                ("group", "quantity", "pressure", "draw"),
                np.isnan(others).mean(axis=-1),
            ),
            "overlap": (of_comparison, np.stack([_overlap(others[[*p]]) for p in places])),
            "overlap_of_specimens": (
                ("comparison", "draw"),
                np.stack(
                    [
                        _overlap_of_specimens(
                            [found.coordinates[groups[k]] for k in p],
                            [found.distributions[groups[k]] for k in p],
                        )
                        for p in places
                    ]
                ),
            ),
        },
        {
            "statistic": STATISTICS,
            "group": groups,
            "quantity": list(names),
            "pressure": place.pressure,
            "has_ratio": ("quantity", [not is_logarithm(n, kind) for n in names]),
            "comparison": [f"{b} − {a}" for a, b in study.comparisons],
            "first": ("comparison", [a for a, _ in study.comparisons]),
            "second": ("comparison", [b for _, b in study.comparisons]),
        },
    )
    if study.pairs:
        change = others[1] - others[0]
        for name, value in {
            "spread_of_change": np.nanstd(change, axis=-1),
            "share_rising": (change > 0).mean(axis=-1),
        }.items():
            result[name] = of_comparison, value[None]
    return result


def _overlap(both: Array) -> Array:
    r"""Overlap ``∫ min(f, g)`` of two distributions of a quantity, by specimens (2, ..., specimen).

    Their densities are sums of normal ones around the specimens, of which Silverman says how wide
    they are. Specimens are drawn together, so that the variance stays what it was. Those without
    the quantity are alike in that.
    """
    if np.nanmin(both) > 0:
        both = np.log(both)
    count = both.shape[-1]
    width = 1.06 * count**-0.2
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # all of them may lack it
        mean, sd = (f(both, axis=-1, keepdims=True) for f in (np.nanmean, np.nanstd))
        sd = np.maximum(sd, _SMALLEST * np.abs(mean))
        x, width = mean + (both - mean) / np.hypot(1, width), width * sd / np.hypot(1, width)
        low = np.nanmin(x - _BEYOND * width, axis=(0, -1))
        high = np.nanmax(x + _BEYOND * width, axis=(0, -1))
        grid = np.linspace(low, high, _GRID)
        density = [
            np.nansum(stats.norm.pdf(grid[..., None], x[k], width[k]), axis=-1) / count
            for k in range(2)
        ]
    shared = np.minimum(*density).sum(axis=0) * (grid[1] - grid[0])
    return np.nan_to_num(shared) + np.isnan(both).mean(axis=-1).min(axis=0)


def _overlap_of_specimens(
    coordinates: Sequence[Array], distributions: Sequence[ClassDistribution]
) -> Array:
    """Overlap of the two distributions of specimens themselves, by draw.

    It is the mean of ``min(1, g/f)`` over specimens of ``f``, and the other way round.
    """
    found = []
    for own, other in ((0, 1), (1, 0)):
        x = coordinates[own][..., 1:]
        ratio = density_of_each(x, distributions[other]) - density_of_each(x, distributions[own])
        found.append(np.exp(np.minimum(ratio, 0.0)).mean(axis=-1))
    return np.mean(found, axis=0)


def _summary(by_draw: xr.Dataset, prob: float) -> xr.Dataset:
    """What the draws say of each group, and of each pair of them."""
    draws = by_draw["draws"]
    first, second = _both(by_draw)
    difference = second - first
    typical = difference.sel(statistic="typical", drop=True)
    with np.errstate(invalid="ignore", divide="ignore"):
        ratio = (second / first).where((first > 0) & (second > 0) & by_draw["has_ratio"])
        spreads = xr.concat([first, second], "of").sel(statistic="spread", drop=True)
        effect = typical / np.sqrt((spreads**2).mean("of"))
        found = {
            "value": draws,
            "difference": difference,
            "ratio": ratio,
            "effect_size": effect,
            "overlap": by_draw["overlap"],
            "overlap_of_specimens": by_draw["overlap_of_specimens"],
        }
        if "spread_of_change" in by_draw:
            found["effect_size_of_change"] = typical / by_draw["spread_of_change"]
            found |= {name: by_draw[name] for name in ("spread_of_change", "share_rising")}
    result = xr.Dataset()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # what is not there has no median
        for name, values in found.items():
            result[name] = values.median("draw")
            result[f"{name}_sd"] = values.std("draw", ddof=1)
            result[f"{name}_interval"] = _interval(values, prob)
    rises = ((difference > 0) + (difference == 0) / 2).where(difference.notnull())
    positive = rises.mean("draw")
    result["probability_of_rise"] = positive
    result["probability_of_direction"] = np.maximum(positive, 1 - positive)
    result["best_accuracy"] = 1 - result["overlap"] / 2
    result["lacking"] = by_draw["lacking"].mean("draw")
    return result.assign(draws=draws)


def _both(result: xr.Dataset) -> tuple[xr.DataArray, xr.DataArray]:
    """Draws of the first and of the second group of each comparison."""
    first, second = (
        result["draws"].sel(group=result[name].drop_vars(["first", "second"])).drop_vars("group")
        for name in ("first", "second")
    )
    return first, second


def _differences(result: xr.Dataset) -> xr.DataArray:
    first, second = _both(result)
    return second - first


def _interval(values: xr.DataArray, prob: float) -> xr.DataArray:
    """Ends of an interval with equal tails."""
    ends = values.quantile([(1 - prob) / 2, (1 + prob) / 2], "draw").rename(quantile="bound")
    return ends.assign_coords(bound=["low", "high"]).transpose(..., "bound")


def _averaged(factors: Sequence[Sequence[Estimate]], laws: Laws) -> dict[str, Any]:
    """Bayes factors of all laws together.

    If both hypotheses have the same laws to choose from, equally probable beforehand, what is known
    of the laws is known under a difference, and the evidences of none follow by the factors.
    """
    values, errors = np.moveaxis(np.array(factors), -1, 0)
    log_none = laws.log_probability[:, None] - values
    log_factor = -logsumexp(log_none, axis=0)
    share = np.exp(log_none + log_factor)
    with np.errstate(invalid="ignore"):
        error = np.linalg.norm(np.where(np.isinf(errors), np.inf, share * errors), axis=0)
    return {
        "log_bayes_factor": ("comparison", log_factor),
        "log_bayes_factor_se": ("comparison", error),
        "probability_of_difference": ("comparison", expit(log_factor)),
    }


def _warn_of_lacking(result: xr.Dataset) -> None:
    lacking = result["lacking"].max("pressure")
    for group in lacking["group"].values:
        for name in lacking["quantity"].values:
            share = float(lacking.sel(group=group, quantity=name))
            if share > _TOLD:
                warn_user(
                    f"class {str(group)!r}: {share:.1%} of its specimens have no {name} there, and "
                    "what is said is that of the others"
                )


def _spreads(
    kind: Variability, distributions: Mapping[str, ClassDistribution], prob: float
) -> xr.Dataset:
    """How far specimens differ in each coordinate, and what was expected of that beforehand."""
    spread = np.stack([np.asarray(d.spread)[..., 0] for d in distributions.values()])
    values = xr.DataArray(spread, dims=("group", "coordinate", "draw"))
    prior = kind.priors.get("spread") if kind.priors else None
    if prior is None:
        logs, sd = kind.scale.spread_prior
        drawn = np.exp(logs[:, None] + sd * stats.norm.ppf((np.arange(_PRIOR) + 0.5) / _PRIOR))
    else:
        drawn = pm.draw(prior, draws=_PRIOR, random_seed=1, mode="FAST_COMPILE")
        drawn = np.broadcast_to(drawn.reshape(_PRIOR, -1), (_PRIOR, spread.shape[1])).T
    beforehand = xr.DataArray(drawn, dims=("coordinate", "draw"))
    found = {
        "coordinate_spread": values.median("draw"),
        "coordinate_spread_interval": _interval(values, prob),
        "prior_coordinate_spread": beforehand.median("draw"),
        "prior_coordinate_spread_interval": _interval(beforehand, prob),
    }
    return xr.Dataset(found, {"group": [*distributions], "coordinate": kind.scale.names})


def _effects(study: _Study, effects: Array | None, prob: float) -> xr.Dataset:
    """What one unit of each covariate does to the coordinates."""
    covariates = study.covariates
    dims = "covariate", "coordinate", "draw"
    values = xr.DataArray(np.asarray(effects) / covariates.scale[:, None, None], dims=dims)
    coords = {"covariate": covariates.names, "coordinate": study.kind.scale.names}
    found = {
        "covariate_effect": values.median("draw"),
        "covariate_effect_sd": values.std("draw", ddof=1),
        "covariate_effect_interval": _interval(values, prob),
    }
    return xr.Dataset(found, coords)


def _described(
    result: xr.Dataset, studies: Sequence[_Study], place: Place, laws: Sequence[str], prob: float
) -> xr.Dataset:
    """The result with its units, and in words what it is of."""
    kind, count = studies[0].kind, result.sizes["quantity"] * result.sizes["comparison"]
    units = [unit_of(name, kind) or "" for name in result["quantity"].values.tolist()]
    result = result.drop_vars("has_ratio").assign_coords(unit=("quantity", units))
    if result.sizes["pressure"] == 1:
        result = result.squeeze("pressure")
    return result.assign_attrs(
        **origin_of(studies[0].tree),
        strain_energy=", ".join(laws),
        tube=json.dumps(place.tube),
        pressure_unit=place.pressure_unit,
        interval=prob,
        compared=count,
        words=(
            f"{count} differences were looked at, each by itself, and nothing is corrected for "
            f"that: if there are none, {count * (1 - prob):.2g} of them are expected beyond their "
            f"{100 * prob:.3g} % intervals"
        ),
    )
