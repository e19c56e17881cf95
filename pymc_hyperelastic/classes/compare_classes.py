"""Compare the distributions of two or more groups of specimens.

:func:`compare_classes` computes posteriors of differences, effect sizes and overlaps, and Bayes
factors; :func:`~pymc_hyperelastic.plot_comparison` shows them.
"""

import json
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray
from scipy import stats
from scipy.special import expit, logsumexp

from pymc_hyperelastic.classes.average import error_of_mean, labels_of, laws_of
from pymc_hyperelastic.classes.differences import by_draw, differences, interval, summary
from pymc_hyperelastic.classes.groups import Groups, groups_of, kind_of_groups
from pymc_hyperelastic.classes.hierarchical import HierarchicalClass
from pymc_hyperelastic.classes.interface import FEWEST_DRAWS
from pymc_hyperelastic.classes.joint import Apart
from pymc_hyperelastic.classes.quantities import (
    MOST_LACKING,
    beyond_measured,
    complete_conditions,
    known_quantities,
    unit_of,
)
from pymc_hyperelastic.classes.sensitivity import power_scaling
from pymc_hyperelastic.evidence.checks import check_count, check_fraction
from pymc_hyperelastic.evidence.estimate import Estimate
from pymc_hyperelastic.messages import warn_user
from pymc_hyperelastic.models.class_distribution import ClassDistribution
from pymc_hyperelastic.models.priors import PRIOR_DRAWS, draws_of
from pymc_hyperelastic.models.settings import origin_of
from pymc_hyperelastic.parallel import one_thread
from pymc_hyperelastic.predictions.conditions import Conditions

Array = NDArray[np.float64]
type Classes = xr.DataTree | Mapping[str, xr.DataTree] | Sequence[xr.DataTree]


@one_thread
def compare_classes(
    classes: Classes,
    quantity: str | Sequence[str],
    *,
    at: Conditions | Any = None,
    pair: Any = None,
    covariates: Any = None,
    effect_prior: float | None = 1.0,
    draws: int = 1000,
    specimens: int = 32,
    ci_prob: float = 0.95,
    random_seed: Any = None,
) -> xr.Dataset:
    r"""Compare a quantity between groups of specimens, with its uncertainty.

    Each posterior draw of a class's distribution defines a *typical* specimen, with the mean
    coordinates, and a population of specimens around it. Groups are compared by three statistics of
    a quantity: its value for the typical specimen, and its *mean* and *spread* (standard deviation)
    over the population. The mean equals the value of the typical specimen only for quantities that
    are linear in the normally distributed coordinates.

    All properties are computed for one common tube, so that differences are due to the materials.

    Parameters
    ----------
    classes : xarray.DataTree, or several of them
        Result of :func:`fit_classes` with ``variability="specimen"``. Several results, each with
        its own strain energy, are averaged with the posterior probabilities of the strain energies.
    quantity : str or sequence of str
        Coordinates of the specimens, such as ``"log_alpha"``; parameters of the material, such as
        ``"mu"``, or ``"mu[0]"`` for an entry of a vector; or properties of
        :func:`tube_properties`, such as ``"compliance"`` or ``"in_vivo_axial_stretch"``. The prefix
        ``"log "`` takes the logarithm, as in ``"log compliance"``: its difference is the logarithm
        of a ratio.
    at : Conditions, or array_like of pressures in kPa, optional
        Conditions for which properties are computed. Several pressures give curves. Properties that
        depend on two pressures, ``"stored_energy_change"`` and ``"in_vivo_axial_stretch"``, need a
        ``pressure_range``. A measure of the tube that is not stated is the median over the
        specimens of all classes. Parameters of the material need no conditions.
    pair : str or dict, optional
        The animal of each specimen, for two groups of the same animals, such as before and after a
        treatment. Either the name of a variable of the data with one value per test, or a dict from
        specimens to animals.
    covariates : str, sequence of str, dict or pandas.DataFrame, optional
        Covariates such as age, sex or batch: names of variables of the data with one value per
        test, or values by name and specimen. Each covariate has a linear effect on all coordinates,
        which is the same in all groups. Values that are not numbers are categories. Groups are
        compared at the mean of each covariate over all specimens.
    effect_prior : float or None, default 1
        Prior standard deviation, under the alternative of the Bayes factor, of the difference of
        two groups in each coordinate, in units of the spread between specimens. None: compute no
        Bayes factors, which take as long as fitting the distributions of all groups twice.
    draws : int, default 1000
        Number of posterior draws of the groups' distributions, at most that of the classes.
    specimens : int, default 32
        Number of specimens that represent the population of each draw, a Latin hypercube sample.
    ci_prob : float, default 0.95
        Probability of the equal-tailed credible intervals.
    random_seed : int or sequence of int, optional
        Seed of the random numbers.

    Returns
    -------
    xarray.Dataset
        A ``comparison`` is ``second − first`` of two classes; a ``statistic`` is ``"typical"``,
        ``"mean"`` or ``"spread"``. A variable with a posterior holds the posterior median; the
        variable with the suffix ``_sd`` holds the posterior standard deviation, and that with
        ``_interval`` the ends of the credible interval (``bound``: low, high). With several
        pressures, variables of quantities also have the dimension ``pressure``, in the unit
        of `at`.

        ``value`` : the statistic of each group, (statistic, group, quantity).

        ``specimen_value`` : the quantity of each measured specimen, (quantity, specimen), given
        its own curves and its group; with an experiment effect, by the means of the coordinates
        of its tests. ``specimen_group`` is its group, and with `pair` ``animal`` its animal.

        ``difference``, ``ratio`` : (statistic, comparison, quantity). The ratio is NaN for
        logarithms and for values that are not positive.

        ``probability_of_rise``, ``probability_of_direction`` : posterior probability that the
        difference is positive, and of its more probable sign.

        ``effect_size`` : difference of the typical specimens, in units of the root mean square of
        the spreads of the two groups.

        ``overlap`` : :math:`\int \min(f, g)` of the densities ``f`` and ``g`` of the quantity in
        the two populations; 1 if the densities are equal. ``best_accuracy`` is the largest
        probability of assigning a new specimen to the right group by this quantity if both groups
        are equally probable: one minus half of the overlap.

        ``overlap_of_specimens`` : overlap of the joint densities of all coordinates.

        ``log_bayes_factor``, ``log_bayes_factor_se`` : log Bayes factor of two different
        distributions against one common distribution, for each comparison, and its standard error;
        ``probability_of_difference`` is the posterior probability for equal prior odds. They
        concern all coordinates together, not a quantity.

        ``prior_sensitivity``, ``likelihood_sensitivity`` : change of the difference as the prior or
        the likelihood is raised to a power near 1 [1]_. A prior sensitivity above 0.05 shows that
        the prior influences the difference; a likelihood sensitivity below 0.05 shows that the data
        hardly do.

        ``coordinate_spread``, ``prior_coordinate_spread`` : posterior and prior of the standard
        deviation of the specimens of a group in each ``coordinate``, each with its interval. If
        posterior and prior are similar, the specimens are too few to determine the spread. With
        several strain energies, that of the most probable one.

        ``lacking`` : fraction of the specimens of a group without the quantity, because they do not
        reach the pressure. These specimens are left out of the other variables.

        ``extrapolated`` : True at a pressure beyond all that were measured on tubes of a group.

        ``draws`` : posterior draws of ``value``.

        With `pair`, also ``effect_size_of_change``, the difference in units of the spread of
        changes between animals (``spread_of_change``), and ``share_rising``, the fraction of
        animals in which the quantity rises. With `covariates`, also ``covariate_effect``
        (covariate, coordinate), the change of a coordinate per unit of the covariate.

        The attributes hold the tube (``tube``), the number of differences (``compared``) and a
        sentence about multiple comparisons (``words``): intervals are not corrected for them.

    Warns
    -----
    UserWarning
        If some specimens lack a quantity, a pressure is beyond all that were measured on the tubes
        of a group, groups and covariates are collinear, or the fit of a class is not to be trusted.

    Raises
    ------
    TypeError, ValueError
        If there are fewer than two classes, a class has a single specimen or no variability, a
        quantity is unknown, a property is given no pressure, an animal lacks a specimen in one of
        the groups, or a specimen lacks a covariate.

    See Also
    --------
    fit_classes, plot_comparison

    Notes
    -----
    Without covariates and pairs, *estimates* use the distributions that :func:`fit_classes` has
    fitted to each group. With covariates, and for the Bayes factor, a joint model of all groups is
    fitted. For two groups with a common location ``m``, common spreads ``s`` and a common
    correlation matrix, it is

    .. math:: m_g = m ± \tfrac12 s \circ δ, \qquad \ln s_g = \ln s ± \tfrac12 τ, \qquad
        δ \sim N(0, a^2), \quad τ \sim N(0, b^2).

    Estimates use ``a = 3`` and ``b = 1``, a weakly informative prior. The Bayes factor compares
    ``a = effect_prior``, ``b = a/2`` with the hypothesis ``δ = 0``, ``τ = 0``. A wider prior would
    favour this hypothesis whenever the difference is small compared with the prior.

    For *pairs*, the mean of the two specimens of an animal and the change between them are
    independent, with the distributions ``N(m, Σ)`` and ``N(s ∘ δ, Ω)``.

    References
    ----------
    .. [1] N. Kallioinen, T. Paananen, P.-C. Bürkner and A. Vehtari, Detecting and diagnosing prior
       and likelihood sensitivity with power-scaling, Statistics and Computing 34 (2024) 57.

    Examples
    --------
    >>> import pymc_hyperelastic as ph
    >>> classes = ph.open_result("hierarchical.nc")  # saved from an example of fit_classes
    >>> result = ph.compare_classes(classes, "log_alpha", effect_prior=None, random_seed=1)
    >>> result["comparison"].values.tolist()
    ['C2 − C1']
    """
    trees = _fits(classes)
    kinds = [kind_of_groups(tree) for tree in trees]
    groups = groups_of(trees)
    names = [quantity] if isinstance(quantity, str) else list(quantity)
    check_quantities(names, kinds)
    check_count("draws", draws, FEWEST_DRAWS)
    check_count("specimens", specimens, 2)
    check_fraction("ci_prob", ci_prob)
    laws = laws_of(trees, kinds, argument="classes")
    at = complete_conditions(trees[0], names, at)
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
    of_laws = [by_draw(*each, names, at) for each in zip(by_law, found, strict=True)]
    chosen = np.random.default_rng(seeds[0]).choice(
        len(of_laws), size=count, p=np.exp(laws.log_probability)
    )
    places = {
        "law": xr.DataArray(chosen, dims="draw"),
        "draw": xr.DataArray(np.arange(count), dims="draw"),
    }
    result = summary(xr.concat(of_laws, "law").isel(places), ci_prob)
    likely = int(np.argmax(laws.log_probability))
    alone = summary(of_laws[likely], ci_prob) if len(of_laws) > 1 else result
    log_prior, log_likelihood = found[likely].powers
    result = result.assign(power_scaling(differences(alone), log_prior, log_likelihood))
    if effect_prior is not None:
        # If locations of two groups typically differ by one spread, their spreads typically differ
        # by a factor of exp(0.5) = 1.6.
        apart = Apart(effect_prior, effect_prior / 2)
        evidences = [
            of_law.evidences(apart, count, seed)
            for of_law, seed in zip(by_law, seeds[2::2], strict=True)
        ]
        result = result.assign(_bayes_factors(evidences))
    _warn_of_lacking(result)
    result = result.assign(_spreads(by_law[likely].kind, found[likely].distributions, ci_prob))
    if by_law[0].covariates.names:
        result = result.assign(_effects(by_law[likely], found[likely].effects, ci_prob))
    flags = xr.zeros_like(result["lacking"], bool)
    for (group, name), beyond in beyond_measured(trees[0], names, at).items():
        flags.loc[{"group": group, "quantity": name}] = beyond.points
    result = result.assign(extrapolated=flags)
    return _described(result, by_law, at, labels_of(kinds), ci_prob)


def _fits(classes: Classes) -> list[xr.DataTree]:
    """Return the results of `fit_classes`, one for each strain energy, as a list."""
    if isinstance(classes, xr.DataTree):
        return [classes]
    trees = list(classes.values() if isinstance(classes, Mapping) else classes)
    for tree in trees:
        if not isinstance(tree, xr.DataTree):
            raise TypeError(
                "classes must be a result of ph.fit_classes or a list of such results, one for "
                f"each strain energy; got {type(tree).__name__}"
            )
    if not trees:
        raise ValueError("classes is empty: expected a result of ph.fit_classes")
    return trees


def check_quantities(names: Sequence[str], kinds: Sequence[HierarchicalClass]) -> None:
    """Raise unless the names are distinct quantities of classes of every kind."""
    if not names or len(set(names)) < len(names):
        raise ValueError(f"quantity must be one or several different names; got {list(names)}")
    for kind in kinds:
        for name in names:
            if unit_of(name, kind) is None:
                raise ValueError(
                    f"no quantity is called {name!r}; {labels_of([kind])[0]} has the quantities "
                    f"{known_quantities(kind)} and the logarithm of each, such as 'log compliance'"
                )


def _size(fitted: xr.DataTree) -> int:
    """Return the number of posterior draws in all chains."""
    posterior = fitted["posterior"]
    return int(posterior.sizes["chain"] * posterior.sizes["draw"])


def _bayes_factors(
    evidences: Sequence[Sequence[tuple[Estimate, Estimate]]],
) -> dict[str, Any]:
    """Return the Bayes factor of each comparison from evidences by law, comparison and hypothesis.

    That of a hypothesis is the mean over strain energies, which are equally probable before.
    """
    values, errors = np.moveaxis(np.array(evidences), -1, 0)
    log_evidence = logsumexp(values, axis=0)
    errors = error_of_mean(np.exp(values - log_evidence), errors)
    log_factor = log_evidence[:, 0] - log_evidence[:, 1]
    return {
        "log_bayes_factor": ("comparison", log_factor),
        "log_bayes_factor_se": ("comparison", np.hypot(*errors.T)),
        "probability_of_difference": ("comparison", expit(log_factor)),
    }


def _warn_of_lacking(result: xr.Dataset) -> None:
    """Warn for each group and quantity that too many specimens lack."""
    lacking = result["lacking"].max("pressure").transpose("group", "quantity")
    for (group, name), share in lacking.to_series().items():
        if share > MOST_LACKING:
            warn_user(
                f"class {group!r}: {share:.1%} of its specimens have no {name} there; "
                "results are those of the other specimens"
            )


def _spreads(
    kind: HierarchicalClass, distributions: Mapping[str, ClassDistribution], ci_prob: float
) -> xr.Dataset:
    """Return posterior and prior of the spread between specimens in each coordinate."""
    spread = np.stack([np.asarray(d.spread)[..., 0] for d in distributions.values()])
    values = xr.DataArray(spread, dims=("group", "coordinate", "draw"))
    prior = kind.priors.get("spread") if kind.priors else None
    if prior is None:
        logs, sd = kind.scale.spread_prior
        normal = stats.norm.ppf((np.arange(PRIOR_DRAWS) + 0.5) / PRIOR_DRAWS)
        drawn = np.exp(logs[:, None] + sd * normal)
    else:
        (drawn,) = draws_of([prior], PRIOR_DRAWS)
        drawn = np.broadcast_to(drawn.reshape(PRIOR_DRAWS, -1), (PRIOR_DRAWS, spread.shape[1])).T
    expected = xr.DataArray(drawn, dims=("coordinate", "draw"))
    found = {
        "coordinate_spread": values.median("draw"),
        "coordinate_spread_interval": interval(values, ci_prob),
        "prior_coordinate_spread": expected.median("draw"),
        "prior_coordinate_spread_interval": interval(expected, ci_prob),
    }
    return xr.Dataset(found, {"group": [*distributions], "coordinate": kind.scale.names})


def _effects(groups: Groups, effects: Array | None, ci_prob: float) -> xr.Dataset:
    """Return the posterior change of each coordinate per unit of each covariate."""
    covariates = groups.covariates
    dims = "covariate", "coordinate", "draw"
    values = xr.DataArray(np.asarray(effects) / covariates.scale[:, None, None], dims=dims)
    coords = {"covariate": covariates.names, "coordinate": groups.kind.scale.names}
    found = {
        "covariate_effect": values.median("draw"),
        "covariate_effect_sd": values.std("draw", ddof=1),
        "covariate_effect_interval": interval(values, ci_prob),
    }
    return xr.Dataset(found, coords)


def _described(
    result: xr.Dataset,
    by_law: Sequence[Groups],
    at: Conditions,
    laws: Sequence[str],
    ci_prob: float,
) -> xr.Dataset:
    """Return the result with units, and attributes that describe it."""
    kind, count = by_law[0].kind, result.sizes["quantity"] * result.sizes["comparison"]
    units = [unit_of(name, kind) or "" for name in result["quantity"].values.tolist()]
    result = result.drop_vars("has_ratio").assign_coords(unit=("quantity", units))
    if result.sizes["pressure"] == 1:
        result = result.squeeze("pressure")
    return result.assign_attrs(
        **origin_of(by_law[0].tree),
        strain_energy=", ".join(laws),
        tube=json.dumps(at.geometry()),
        pressure_unit=at.pressure_unit,
        interval=ci_prob,
        compared=count,
        words=(
            f"differences compared, without a correction for multiple comparisons: {count}. If no "
            f"groups differ, {count * (1 - ci_prob):.2g} of their {100 * ci_prob:.3g} % intervals "
            "are expected to exclude 0"
        ),
    )
