"""Fit classes of inflation experiments, and classify new ones by their marginal likelihood."""

import json
import warnings
from collections.abc import Callable, Mapping, Sequence
from numbers import Real
from typing import Any, Literal, NamedTuple

import numpy as np
import xarray as xr
from pymc.progress_bar import create_simple_progress
from scipy.special import logsumexp, softmax

from pymc_hyperelastic.classes.pooled import ClassPredictive
from pymc_hyperelastic.classes.variable import (
    SpecimenPredictive,
    Variability,
    fit_distribution,
    sample_specimens,
)
from pymc_hyperelastic.data.inflation import check_inflation_data, tests_at
from pymc_hyperelastic.evidence.batched import BatchedFunction
from pymc_hyperelastic.evidence.checks import check_count
from pymc_hyperelastic.evidence.smc import (
    Estimate,
    log_evidence,
    sample_smc,
    seed_sequence,
)
from pymc_hyperelastic.mechanics.strain_energy import StrainEnergy
from pymc_hyperelastic.models.inflation import inflation_model
from pymc_hyperelastic.models.likelihood import check_likelihood, likelihood_inputs
from pymc_hyperelastic.models.results import (
    Study,
    check_result,
    inflation_data_of,
    model_settings_of,
    strain_energy_of,
)
from pymc_hyperelastic.models.rules import rule_for

__all__ = [
    "check_classes",
    "check_variability",
    "classify",
    "fit_classes",
    "kl_divergence",
    "labels_of",
]


def fit_classes(
    energy: StrainEnergy,
    classes: Mapping[str, xr.Dataset],
    *,
    sigma: Any,
    slope_weight: Any,
    force_sigma: Any = None,
    priors: dict[str, Any] | None = None,
    variability: Literal["none", "specimen"] = "none",
    experiment_effect: bool = False,
    reference_stress: float = 20.0,
    draws: int = 2000,
    chains: int = 4,
    random_seed: Any = None,
    progressbar: bool = True,
) -> xr.DataTree:
    """Sample the posterior of each class from its training experiments.

    All models are built, and so all input is checked, before the first is sampled.

    Without variability, as in the paper, all specimens of a class share one set of parameters. The
    posterior shrinks to a point as data grow, however different the specimens are, and a new one
    that differs from them as they do from each other is classified with a certainty that it does
    not deserve. With ``variability="specimen"`` each has its own, drawn from a distribution of the
    class that is learned: see :func:`~pymc_hyperelastic.population_model`. Every specimen is then
    sampled once, by itself, and integrated out.

    Parameters
    ----------
    energy : StrainEnergy
        The material, such as ``ph.Ogden()``.
    classes : dict of str to xarray.Dataset
        Training data of each class by its name.
    sigma, slope_weight, force_sigma, priors
        See :func:`pymc_hyperelastic.inflation_model`; they hold for all classes. With variability
        `slope_weight` is 0, `force_sigma` is not given, and `sigma` and `priors` are those of
        :func:`~pymc_hyperelastic.population_model`.
    variability : {"none", "specimen"}
        Whether specimens of a class differ.
    experiment_effect, reference_stress
        See :func:`~pymc_hyperelastic.population_model`; only with variability.
    draws, chains, random_seed, progressbar
        See :func:`pymc_hyperelastic.sample_smc`. After an interrupt the classes already fitted are
        returned.

    Returns
    -------
    xarray.DataTree
        One child a class, each with posterior, evidence, training data and settings. It can be
        saved with ``classes.to_netcdf(path)`` and read with ``xarray.open_datatree(path)``.

    Raises
    ------
    TypeError, ValueError
        If there are no classes, or anything is wrong with the data, priors or numbers.

    Examples
    --------
    >>> import pymc_hyperelastic as ph
    >>> data = ph.load_dataset("simulated_sheep_aorta")
    >>> classes = ph.fit_classes(
    ...     ph.Ogden(),
    ...     {name: ph.select(data, group=name, experiment=[1, 2]) for name in ("C1", "C2")},
    ...     sigma=5 * ph.mmHg,
    ...     slope_weight=3.0,
    ...     draws=500,
    ...     chains=2,
    ...     random_seed=1,
    ...     progressbar=False,
    ... )
    >>> list(classes.children)
    ['C1', 'C2']
    """
    check_classes(classes)
    check_variability(variability, experiment_effect, reference_stress)
    seed = seed_sequence(random_seed)
    if variability == "specimen":
        if slope_weight != 0 or force_sigma is not None:
            raise ValueError(
                "with variability='specimen' pressures alone are compared: expected slope_weight=0 "
                f"and no force_sigma; got {slope_weight} and {force_sigma}"
            )
        settings = Variability(energy, sigma, experiment_effect, reference_stress, priors)
        return _fit_distributions(settings, classes, draws, chains, seed, progressbar)
    noise = {"sigma": sigma, "slope_weight": slope_weight, "force_sigma": force_sigma}
    models = {}
    for name, data in classes.items():
        try:
            models[name] = inflation_model(energy, data, priors=priors, **noise)
            models[name].study.attrs()
        except (TypeError, ValueError) as error:
            raise type(error)(f"class {name!r}: {error}") from error

    parameters = [rv.name for rv in next(iter(models.values())).free_RVs]
    fitted = {}
    for (name, model), class_seed in zip(
        models.items(), seed.generate_state(len(models)).tolist(), strict=True
    ):
        try:
            fitted[name] = sample_smc(
                model, draws, chains, class_seed, progressbar, var_names=parameters
            )
        except KeyboardInterrupt:
            if not fitted:
                raise
            warnings.warn(f"interrupted: only {list(fitted)} are fitted", stacklevel=2)
            break
        except ValueError as error:
            raise ValueError(f"class {name!r}: {error}") from error
    tree = xr.DataTree.from_dict({})
    for name, result in fitted.items():
        tree[name] = result
    tree.attrs["random_seed"] = json.dumps(seed.entropy)
    return tree


def check_classes(classes: Any) -> None:
    """Raise unless `classes` are data by the name of a class."""
    # A Dataset is a mapping too, of its variables.
    if not isinstance(classes, Mapping) or isinstance(classes, xr.Dataset | xr.DataTree):
        raise TypeError(
            'classes must be a dict of names to training data, such as {"C1": data}, not '
            f"{type(classes).__name__}"
        )
    if not classes:
        raise ValueError("classes must be a dict of names to training data; it is {}")
    for name in classes:
        if not isinstance(name, str) or not name or "/" in name:
            raise ValueError(f"a class is named by text without '/'; got {name!r}")


def check_variability(variability: Any, experiment_effect: Any, reference_stress: Any) -> None:
    """Raise unless specimens differ, or else nothing is said of how they do."""
    if variability not in ("none", "specimen"):
        raise ValueError(f"variability must be 'none' or 'specimen', not {variability!r}")
    if variability == "specimen":
        return
    # Defaults as in the signatures.
    for name, value, default in (
        ("experiment_effect", experiment_effect, False),
        ("reference_stress", reference_stress, 20.0),
    ):
        if value != default:
            raise ValueError(f"{name} is {value!r}: it is used only with variability='specimen'")


def _fit_distributions(
    settings: Variability,
    classes: Mapping[str, xr.Dataset],
    draws: int,
    chains: int,
    seed: np.random.SeedSequence,
    progressbar: bool,
) -> xr.DataTree:
    """Fit the distribution of every class, of specimens that are sampled once."""
    check_count("draws", draws, 100)
    check_count("chains", chains, 1)
    settings.check_classes(classes)
    attrs = settings.attrs()
    tree = xr.DataTree.from_dict({})
    progress = create_simple_progress(progressbar)
    with progress:
        bar = progress.add_task("Fitting classes", completed=0, total=2 * len(classes))
        try:
            for (name, data), own in zip(classes.items(), seed.spawn(len(classes)), strict=True):
                specimens = sample_specimens(
                    settings.sampler(data), data, np.random.default_rng(own)
                )
                progress.advance(bar)
                fitted = fit_distribution(settings, specimens, draws, chains, own)
                for group, dataset in Study(settings.energy, data, {}, {}).groups().items():
                    fitted[group] = dataset
                tree[name] = fitted
                progress.advance(bar)
        except KeyboardInterrupt:
            if not tree.children:
                raise
            warnings.warn(f"interrupted: only {list(tree.children)} are fitted", stacklevel=3)
    tree.attrs |= attrs | {"random_seed": json.dumps(seed.entropy)}
    return tree


def classify(
    new_data: xr.Dataset,
    classes: xr.DataTree,
    *,
    by: Literal["test", "specimen"] = "test",
    class_prior: Mapping[str, float] | None = None,
    average_over: Sequence[xr.DataTree] = (),
    undecided_below: float = 0.0,
    none_below: float = 0.0,
    random_seed: Any = None,
    progressbar: bool = True,
) -> xr.Dataset:
    r"""Probability of each class for new experiments.

    .. math:: P(C | D) = \frac{P(D | C) P(C)}{\sum_{C'} P(D | C') P(C')}, \qquad
        P(D | C) = \int P(D | θ) P(θ | C) \, dθ

    ``P(θ | C)`` is the class's posterior: nothing is fitted again. The integral is taken in the
    cheapest of three ways that can be trusted, see the variable ``method``.

    Parameters
    ----------
    new_data : xarray.Dataset
        New inflation data; they must not be among the training data.
    classes : xarray.DataTree
        Result of :func:`fit_classes`, perhaps read from a file.
    by : {"test", "specimen"}
        What is classified: each experiment by itself, or all experiments on a specimen together.
    class_prior : dict of str to float, optional
        Probability of each class beforehand; equal when missing.
    average_over : sequence of xarray.DataTree, optional
        The same classes, of the same training data, fitted with other strain energies: what each
        says counts by its posterior probability, which is the product of the evidences of its
        classes. The variable ``strain_energy_probability`` tells it. The p-value is the mean of the
        laws' p-values by these probabilities. Evidences compare only between classes of the same
        noise, or between classes that all have variability.
    undecided_below : float, default 0
        Probability that the most probable class must have for a decision.
    none_below : float, default 0
        Where the predictive p-value of every class is below this, the decision is "none of these";
        with 0.05 that happens to one in twenty specimens of the classes themselves. Only for
        classes with variability.
    random_seed : int, optional
        The same seed gives the same result.
    progressbar : bool
        Whether to show progress. After an interrupt what is not yet known is NaN.

    Returns
    -------
    xarray.Dataset
        ``decision``, the most probable class unless one of the limits above says otherwise, and
        ``class_probability``, ``class_probability_se``, ``log_evidence`` and ``log_evidence_se``,
        each (test, class_label) in the order of the data, or (specimen, class_label). ``method``
        says how the integral was taken: "class draws", the mean likelihood of the class's draws,
        or "adapted draws", importance sampling from a mixture that followed the new data, both
        with a Pareto shape ``pareto_k`` of the weights below 0.5; else "tempering", by SMC from
        the class's draws. With variability the parameters of a specimen are a fresh draw from the
        class's distribution, integrated by "specimen draws": with a ``pareto_k`` above 0.7 the
        evidence is not to be trusted. ``p_value`` is then the share of the specimens that the class
        would bring forth, measured at the same radii, that are as far from all its others as this
        one is, or further: far by their curves, whatever the noise. It is NaN if the class brings
        forth no tubes that could be inflated to these radii.

    Raises
    ------
    TypeError, ValueError
        If the data are unsound, `classes` are not fitted classes of one model, or `class_prior` is
        not a probability of each class.

    Examples
    --------
    >>> import pymc_hyperelastic as ph
    >>> data = ph.load_dataset("simulated_sheep_aorta")
    >>> classes = ph.fit_classes(
    ...     ph.Ogden(),
    ...     {name: ph.select(data, group=name, experiment=[1, 2]) for name in ("C1", "C2")},
    ...     sigma=5 * ph.mmHg,
    ...     slope_weight=3.0,
    ...     draws=500,
    ...     chains=2,
    ...     random_seed=1,
    ...     progressbar=False,
    ... )
    >>> new = ph.select(data, specimen="S4", experiment=3)
    >>> result = ph.classify(new, classes, random_seed=2, progressbar=False)
    >>> result["class_probability"].idxmax("class_label").item()
    'C2'
    """
    if by not in ("test", "specimen"):
        raise ValueError(f"by must be 'test' or 'specimen', not {by!r}")
    for limit, bound in (("undecided_below", undecided_below), ("none_below", none_below)):
        if not isinstance(bound, Real) or not 0 <= bound < 1:
            raise ValueError(f"{limit} is {bound!r}; expected a number from 0 to 1")
    if isinstance(average_over, xr.DataTree) or not isinstance(average_over, Sequence):
        raise TypeError(
            "average_over must be a list of results of ph.fit_classes, not "
            f"{type(average_over).__name__}"
        )
    trees = [classes, *average_over]
    settings = [_common_settings(tree) for tree in trees]
    names = list(classes.children)
    prior = _class_prior(class_prior, names)
    laws = _weights_of_laws(trees)
    variable = all(isinstance(of_law, Variability) for of_law in settings)
    if none_below and not variable:
        raise ValueError(
            "none_below needs classes that say how specimens differ: "
            "ph.fit_classes(..., variability='specimen')"
        )
    check_inflation_data(new_data)
    if by == "test":
        units = [[test] for test in range(new_data.sizes["test"])]
    else:
        specimen = new_data["specimen"].values
        units = [np.flatnonzero(specimen == s).tolist() for s in dict.fromkeys(specimen.tolist())]
    seed = seed_sequence(random_seed)
    seeds = [seed] if len(trees) == 1 else seed.spawn(len(trees))
    predictors = [
        (_population_predictor if isinstance(of_law, Variability) else _pooled_predictor)(
            new_data, tree, of_law, len(units), own
        )
        for tree, of_law, own in zip(trees, settings, seeds, strict=True)
    ]

    def predict(data: xr.Dataset) -> list[_Prediction]:
        of_laws = [predictor(data) for predictor in predictors]
        return [_average(laws, of_class) for of_class in zip(*of_laws, strict=True)]

    unknown = _Prediction(Estimate(np.nan, np.nan), np.nan, "", np.nan, np.nan)
    predictions = [[unknown] * len(names) for _ in units]
    progress = create_simple_progress(progressbar)
    with progress:
        bar = progress.add_task("Classifying", completed=0, total=len(units))
        try:
            for i, unit in enumerate(units):
                predictions[i] = predict(tests_at(new_data, unit))
                progress.advance(bar)
        except KeyboardInterrupt:
            warnings.warn("interrupted: experiments not yet classified are NaN", stacklevel=2)

    def table(value: Callable[[_Prediction], Any]) -> np.ndarray:
        return np.array([[value(prediction) for prediction in row] for row in predictions])

    log_evidence = table(lambda p: p.log_evidence.value)
    with np.errstate(divide="ignore"):
        probability = softmax(log_evidence + np.log(prior), axis=1)
    # Delta method: dp_c = p_c Σ_j (δ_cj − p_j) d ln Z_j.
    weight = np.eye(len(names)) - probability[:, None, :]
    own = table(lambda p: p.own_error)
    probability_error = probability * np.sqrt(np.einsum("icj,ij->ic", weight**2, own**2))
    p_value = table(lambda p: p.p_value)
    decision = np.array([names[j] for j in probability.argmax(axis=1)], dtype=object)
    decision[~(probability.max(axis=1) >= undecided_below)] = "undecided"
    decision[(p_value < none_below).all(axis=1)] = "none of these"
    decision[np.isnan(log_evidence).any(axis=1)] = ""
    of_population = {"p_value": ((by, "class_label"), p_value)} if variable else {}
    first = [unit[0] for unit in units]
    labels = ("specimen", "experiment", "group") if by == "test" else ("specimen", "group")
    return xr.Dataset(
        {
            "class_probability": ((by, "class_label"), probability),
            "class_probability_se": ((by, "class_label"), probability_error),
            "log_evidence": ((by, "class_label"), log_evidence),
            "log_evidence_se": (
                (by, "class_label"),
                table(lambda p: p.log_evidence.standard_error),
            ),
            "method": ((by, "class_label"), table(lambda p: p.method).astype(str)),
            "pareto_k": ((by, "class_label"), table(lambda p: p.pareto_k)),
            **of_population,
            "decision": (by, decision.astype(str)),
            **({"strain_energy_probability": laws} if average_over else {}),
        },
        {"class_label": names} | {label: (by, new_data[label].values[first]) for label in labels},
        # What the data are, above all whether they were simulated, stays with the result.
        {key: new_data.attrs[key] for key in ("title", "simulated") if key in new_data.attrs}
        | {
            "strain_energy": ", ".join(laws["strain_energy"].values.tolist()),
            "class_prior": json.dumps(dict(zip(names, prior.tolist(), strict=True))),
        },
    )


class _Prediction(NamedTuple):
    """Log evidence of new data under a class; without what all classes share, its own error."""

    log_evidence: Estimate
    own_error: float
    method: str
    pareto_k: float
    p_value: float


def _weights_of_laws(trees: Sequence[xr.DataTree]) -> xr.DataArray:
    """Posterior probability of each strain energy, equal beforehand."""
    first = trees[0]
    labels = labels_of([strain_energy_of(next(iter(tree.children.values()))) for tree in trees])
    evidences = []
    for tree, label in zip(trees, labels, strict=True):
        if list(tree.children) != list(first.children):
            raise ValueError(
                f"average_over holds the classes {list(tree.children)}, not "
                f"{list(first.children)} as the others"
            )
        if _noise_of(tree) != _noise_of(first):
            raise ValueError(
                f"average_over holds {label} with {_noise_of(tree)}, but {labels[0]} has "
                f"{_noise_of(first)}: their evidences do not compare"
            )
        for name, fitted in tree.children.items():
            if not inflation_data_of(fitted).identical(inflation_data_of(first[name])):
                raise ValueError(
                    f"class {name!r} has other training data under {label} than under "
                    f"{labels[0]}: their evidences do not compare"
                )
        evidences.append(sum(log_evidence(fitted).value for fitted in tree.children.values()))
    if len(trees) == 1:
        evidences = [0.0]
    return xr.DataArray(softmax(evidences), {"strain_energy": labels}, "strain_energy")


def labels_of(laws: Sequence[StrainEnergy]) -> list[str]:
    """Names of strain energies, with their settings where names are alike."""
    names = [law.name for law in laws]
    return [repr(law) if names.count(law.name) > 1 else law.name for law in laws]


def _noise_of(classes: xr.DataTree) -> str:
    """How measurements differ from curves, in words: evidences compare where that is the same."""
    attrs = next(iter(classes.children.values())).attrs
    if "variability_settings" in attrs:
        # Noise is then a part of the model, as are the specimens, and may differ as these may.
        return "variability='specimen'"
    return f"the noise {attrs['noise']} of all specimens"


def _average(laws: xr.DataArray, predictions: Sequence[_Prediction]) -> _Prediction:
    """Prediction of several laws together, each by its probability."""
    if len(predictions) == 1:
        return predictions[0]
    with np.errstate(divide="ignore"):
        terms = np.log(laws.values) + [p.log_evidence.value for p in predictions]
    share = softmax(terms)
    errors = [(p.log_evidence.standard_error, p.own_error) for p in predictions]
    error, own = np.sqrt(np.square(share) @ np.square(errors))
    return _Prediction(
        Estimate(float(logsumexp(terms)), float(error)),
        float(own),
        "average over strain energies",
        max(p.pareto_k for p in predictions),
        float(laws.values @ [p.p_value for p in predictions]),
    )


def _pooled_predictor(
    new_data: xr.Dataset,
    classes: xr.DataTree,
    settings: dict[str, Any],
    count: int,
    seed: np.random.SeedSequence,
) -> Callable[[xr.Dataset], list[_Prediction]]:
    """Predictions of classes whose specimens share one set of parameters."""
    energy, priors = settings["energy"], settings["priors"]
    noise = {name: value for name, value in settings.items() if name not in ("energy", "priors")}
    check_likelihood(energy, new_data, priors, **noise)
    with_force = "force_sigma" in noise
    rule = rule_for(energy, new_data, priors, with_force=with_force)
    seeds = seed.generate_state(1 + count * len(classes.children)).tolist()
    rng = np.random.default_rng(seeds.pop())
    predictives: list[ClassPredictive] = []

    def predict(data: xr.Dataset) -> list[_Prediction]:
        inputs = likelihood_inputs(
            data, rule, slope_weight=noise["slope_weight"], with_force=with_force
        )
        if not predictives:
            predictives.extend(
                ClassPredictive(fitted, settings, rule, inputs, rng)
                for fitted in classes.children.values()
            )
        predictions = []
        for predictive in predictives:
            estimate, method, pareto_k = predictive(inputs, seeds.pop())
            error = estimate.standard_error
            predictions.append(_Prediction(estimate, error, method, pareto_k, np.nan))
        return predictions

    return predict


def _population_predictor(
    new_data: xr.Dataset,
    classes: xr.DataTree,
    settings: Variability,
    count: int,
    seed: np.random.SeedSequence,
) -> Callable[[xr.Dataset], list[_Prediction]]:
    """Predictions of classes whose specimens differ."""
    settings.check(new_data)
    sampler = settings.sampler(new_data)
    predictive = SpecimenPredictive(settings, dict(classes.children), sampler)
    seeds = iter(seed.spawn(count))

    def predict(data: xr.Dataset) -> list[_Prediction]:
        rng = np.random.default_rng(next(seeds))
        return [
            _Prediction(
                evidence.log_evidence,
                evidence.own_error,
                "specimen draws",
                evidence.pareto_k,
                p_value,
            )
            for evidence, p_value in predictive(data, rng)
        ]

    return predict


def kl_divergence(classes: xr.DataTree, first: str, second: str) -> Estimate:
    r"""Kullback-Leibler divergence of the posterior of one class from that of another, in nats.

    .. math:: KL = \int P(θ | C_1) \ln \frac{P(θ | C_1)}{P(θ | C_2)} \, dθ

    Both densities are known with their normalisers, the evidences, so that the integral is a mean
    over the particles of the first class; no density is estimated.

    Parameters
    ----------
    classes : xarray.DataTree
        Result of :func:`fit_classes`.
    first, second : str
        Names of the classes. The divergence is not symmetric.

    Returns
    -------
    Estimate
        The pair (value, standard error).

    Raises
    ------
    ValueError
        If a class is unknown or the classes are not of one model.

    Examples
    --------
    >>> import pymc_hyperelastic as ph
    >>> data = ph.load_dataset("simulated_sheep_aorta")
    >>> classes = ph.fit_classes(
    ...     ph.Ogden(),
    ...     {name: ph.select(data, group=name, experiment=[1, 2]) for name in ("C1", "C2")},
    ...     sigma=5 * ph.mmHg,
    ...     slope_weight=3.0,
    ...     draws=500,
    ...     chains=2,
    ...     random_seed=1,
    ...     progressbar=False,
    ... )
    >>> ph.kl_divergence(classes, "C1", "C2").value > 100
    True
    """
    settings = _common_settings(classes)
    if isinstance(settings, Variability):
        raise ValueError("the divergence is that of classes without variability")
    for name in (first, second):
        if name not in classes.children:
            raise ValueError(f"there is no class {name!r}; there are {list(classes.children)}")
    particles = classes[first]["unconstrained_posterior"].to_dataset()
    log_posteriors, variance = [], 0.0
    for name in (first, second):
        model = inflation_model(data=inflation_data_of(classes[name]), **settings)
        values = [particles[v.name].values.ravel() for v in model.value_vars]
        log_joint = BatchedFunction.of_model(model, [model.logp()])
        evidence = log_evidence(classes[name])
        log_posteriors.append(log_joint(np.stack(values, axis=1))[0] - evidence.value)
        variance += evidence.standard_error**2
    difference = log_posteriors[0] - log_posteriors[1]
    variance += np.var(difference) / difference.size
    if first == second:
        variance = 0.0
    return Estimate(float(np.mean(difference)), float(np.sqrt(variance)))


def _common_settings(classes: xr.DataTree) -> Any:
    """Settings of the classes' model, which has to be one, or evidences cannot be compared."""
    check_result(classes, "ph.fit_classes")
    if not classes.children:
        raise ValueError("classes must be the result of ph.fit_classes; here are no classes")
    first = next(iter(classes.children.values()))
    variable = "variability_settings" in first.attrs
    if variable:
        keys = ["variability_settings"]
    else:
        keys = ["priors", "noise"]
    for name, fitted in classes.children.items():
        if not {"priors", "variability_settings"} & set(fitted.attrs):
            raise ValueError(
                f"classes must be the result of ph.fit_classes, all of it; {name!r} is no class"
            )
        if "likelihood" in fitted.attrs:
            raise ValueError(
                f"class {name!r} has the likelihood {fitted.attrs['likelihood']!r}: classes come "
                "from ph.fit_classes"
            )
        for key in ("strain_energy", "strain_energy_settings", *keys):
            mine, theirs = fitted.attrs.get(key), first.attrs.get(key)
            if mine != theirs:
                raise ValueError(
                    f"class {name!r} was fitted with {key} {mine}, others with {theirs}: evidences "
                    "can only be compared under one strain energy, one prior and one noise"
                )
    return Variability.of_tree(first) if variable else model_settings_of(first)


def _class_prior(class_prior: Mapping[str, float] | None, names: list[str]) -> np.ndarray:
    if class_prior is None:
        return np.full(len(names), 1 / len(names))
    if not isinstance(class_prior, Mapping):
        raise TypeError(f"class_prior must be a dict of names to numbers, not {class_prior!r}")
    if set(class_prior) != set(names):
        raise ValueError(f"class_prior names {sorted(class_prior)}, but the classes are {names}")
    try:
        prior = np.array([class_prior[name] for name in names], float)
    except (TypeError, ValueError):
        prior = np.array([np.nan])
    if not np.all(prior >= 0) or not np.isclose(prior.sum(), 1):
        raise ValueError(f"class_prior must hold probabilities that add up to 1; got {class_prior}")
    return prior
