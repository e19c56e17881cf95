"""Whether groups differ: in what, by how much, and how sure that is."""

import json
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pymc as pm
import xarray as xr
from numpy.typing import NDArray
from scipy import stats
from scipy.special import expit, logsumexp

from pymc_hyperelastic.classes.average import Laws, labels_of, laws_of
from pymc_hyperelastic.classes.differences import by_draw, differences, interval, summary
from pymc_hyperelastic.classes.groups import Groups, groups_of, kind_of_groups
from pymc_hyperelastic.classes.joint import Apart
from pymc_hyperelastic.classes.quantities import (
    Place,
    known_quantities,
    place_of,
    unit_of,
)
from pymc_hyperelastic.classes.sensitivity import power_scaling
from pymc_hyperelastic.classes.variable import Variability
from pymc_hyperelastic.evidence.checks import check_count, check_fraction
from pymc_hyperelastic.evidence.estimate import Estimate
from pymc_hyperelastic.models.class_distribution import ClassDistribution
from pymc_hyperelastic.models.settings import origin_of
from pymc_hyperelastic.parallel import one_thread
from pymc_hyperelastic.predictions.measured import warn_user

Array = NDArray[np.float64]
type Classes = xr.DataTree | Mapping[str, xr.DataTree] | Sequence[xr.DataTree]

# Standard deviation of the difference of logarithms of spreads where it is asked whether groups
# differ at all, for a difference of locations of one spread.
_LOG_SPREAD = 0.5
# Draws of a prior.
_PRIOR = 4000
# Share of specimens without a quantity from which on there is a warning.
_FEW_LACKING = 0.005


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
    by_law = [
        Groups(kind, tree, groups, pair, covariates)
        for kind, tree in zip(kinds, trees, strict=True)
    ]
    count = min(draws, *(_size(tree[g]) for tree in trees for g in groups))
    seeds = np.random.SeedSequence(random_seed).spawn(2 * len(by_law) + 1)
    found = [
        of_law.by_draw(count, specimens, seed)
        for of_law, seed in zip(by_law, seeds[1::2], strict=True)
    ]
    of_laws = [by_draw(*each, names, place) for each in zip(by_law, found, strict=True)]
    chosen = np.random.default_rng(seeds[0]).choice(
        len(of_laws), size=count, p=np.exp(laws.log_probability)
    )
    at = {
        "law": xr.DataArray(chosen, dims="draw"),
        "draw": xr.DataArray(np.arange(count), dims="draw"),
    }
    result = summary(xr.concat(of_laws, "law").isel(at), prob)
    likely = int(np.argmax(laws.log_probability))
    alone = summary(of_laws[likely], prob) if len(of_laws) > 1 else result
    log_prior, log_likelihood = found[likely].powers
    scaling = power_scaling(differences(alone), log_prior, log_likelihood)
    result = result.assign(scaling)
    if bayes_factor:
        apart = Apart(effect_prior, effect_prior * _LOG_SPREAD)
        factors = [
            of_law.bayes_factors(apart, count, seed)
            for of_law, seed in zip(by_law, seeds[2::2], strict=True)
        ]
        result = result.assign(_averaged(factors, laws))
    _warn_of_lacking(result)
    result = result.assign(_spreads(by_law[likely].kind, found[likely].distributions, prob))
    if by_law[0].covariates.names:
        result = result.assign(_effects(by_law[likely], found[likely].effects, prob))
    return _described(result, by_law, place, labels_of(kinds), prob)


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
            if share > _FEW_LACKING:
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
        "coordinate_spread_interval": interval(values, prob),
        "prior_coordinate_spread": beforehand.median("draw"),
        "prior_coordinate_spread_interval": interval(beforehand, prob),
    }
    return xr.Dataset(found, {"group": [*distributions], "coordinate": kind.scale.names})


def _effects(groups: Groups, effects: Array | None, prob: float) -> xr.Dataset:
    """What one unit of each covariate does to the coordinates."""
    covariates = groups.covariates
    dims = "covariate", "coordinate", "draw"
    values = xr.DataArray(np.asarray(effects) / covariates.scale[:, None, None], dims=dims)
    coords = {"covariate": covariates.names, "coordinate": groups.kind.scale.names}
    found = {
        "covariate_effect": values.median("draw"),
        "covariate_effect_sd": values.std("draw", ddof=1),
        "covariate_effect_interval": interval(values, prob),
    }
    return xr.Dataset(found, coords)


def _described(
    result: xr.Dataset, by_law: Sequence[Groups], place: Place, laws: Sequence[str], prob: float
) -> xr.Dataset:
    """The result with its units, and in words what it is of."""
    kind, count = by_law[0].kind, result.sizes["quantity"] * result.sizes["comparison"]
    units = [unit_of(name, kind) or "" for name in result["quantity"].values.tolist()]
    result = result.drop_vars("has_ratio").assign_coords(unit=("quantity", units))
    if result.sizes["pressure"] == 1:
        result = result.squeeze("pressure")
    return result.assign_attrs(
        **origin_of(by_law[0].tree),
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
