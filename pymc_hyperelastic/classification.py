"""Fit classes of inflation experiments, and classify new ones by their marginal likelihood."""

import json
import warnings
from collections.abc import Mapping
from typing import Any, Literal

import numpy as np
import xarray as xr
from pymc.progress_bar import create_simple_progress
from scipy.special import softmax

from pymc_hyperelastic.batched import BatchedFunction
from pymc_hyperelastic.data import tests_at
from pymc_hyperelastic.likelihood import check_likelihood, likelihood_inputs
from pymc_hyperelastic.models import inflation_model
from pymc_hyperelastic.predictive import ClassPredictive
from pymc_hyperelastic.results import check_result, inflation_data_of, model_settings_of
from pymc_hyperelastic.rules import rule_for
from pymc_hyperelastic.smc import (
    Estimate,
    log_evidence,
    sample_smc,
    seed_sequence,
)
from pymc_hyperelastic.strain_energy import StrainEnergy

__all__ = ["classify", "fit_classes", "kl_divergence"]


def fit_classes(
    energy: StrainEnergy,
    classes: Mapping[str, xr.Dataset],
    *,
    sigma: Any,
    slope_weight: Any,
    force_sigma: Any = None,
    priors: dict[str, Any] | None = None,
    draws: int = 2000,
    chains: int = 4,
    random_seed: Any = None,
    progressbar: bool = True,
) -> xr.DataTree:
    """Sample the posterior of each class from its training experiments.

    All models are built, and so all input is checked, before the first is sampled.

    Parameters
    ----------
    energy : StrainEnergy
        The material, such as ``ph.Ogden()``.
    classes : dict of str to xarray.Dataset
        Training data of each class by its name.
    sigma, slope_weight, force_sigma, priors
        See :func:`pymc_hyperelastic.inflation_model`; they hold for all classes.
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
    # A Dataset is a mapping too, of its variables.
    if not isinstance(classes, Mapping) or isinstance(classes, xr.Dataset | xr.DataTree):
        raise TypeError(
            'classes must be a dict of names to training data, such as {"C1": data}, not '
            f"{type(classes).__name__}"
        )
    if not classes:
        raise ValueError("classes must be a dict of names to training data; it is {}")
    seed = seed_sequence(random_seed)
    noise = {"sigma": sigma, "slope_weight": slope_weight, "force_sigma": force_sigma}
    models = {}
    for name, data in classes.items():
        if not isinstance(name, str) or not name or "/" in name:
            raise ValueError(f"a class is named by text without '/'; got {name!r}")
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


def classify(
    new_data: xr.Dataset,
    classes: xr.DataTree,
    *,
    by: Literal["test", "specimen"] = "test",
    class_prior: Mapping[str, float] | None = None,
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
    random_seed : int, optional
        The same seed gives the same result.
    progressbar : bool
        Whether to show progress. After an interrupt what is not yet known is NaN.

    Returns
    -------
    xarray.Dataset
        ``class_probability``, ``class_probability_se``, ``log_evidence`` and ``log_evidence_se``,
        each (test, class_label) in the order of the data, or (specimen, class_label). ``method``
        says how the integral was taken: "class draws", the mean likelihood of the class's draws,
        or "adapted draws", importance sampling from a mixture that followed the new data, both
        with a Pareto shape ``pareto_k`` of the weights below 0.5; else "tempering", by SMC from
        the class's draws.

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
    settings = _common_settings(classes)
    names = list(classes.children)
    prior = _class_prior(class_prior, names)
    energy, priors = settings["energy"], settings["priors"]
    noise = {name: value for name, value in settings.items() if name not in ("energy", "priors")}
    check_likelihood(energy, new_data, priors, **noise)
    seed = seed_sequence(random_seed)

    if by == "test":
        units = [[test] for test in range(new_data.sizes["test"])]
    else:
        specimen = new_data["specimen"].values
        units = [np.flatnonzero(specimen == s).tolist() for s in dict.fromkeys(specimen.tolist())]
    with_force = "force_sigma" in noise
    rule = rule_for(energy, new_data, priors, with_force=with_force)
    seeds = seed.generate_state(1 + len(units) * len(names)).tolist()
    rng = np.random.default_rng(seeds.pop())
    shape = len(units), len(names)
    value, error, pareto_k = (np.full(shape, np.nan) for _ in range(3))
    method = np.full(shape, "", dtype=object)
    predictives: list[ClassPredictive] = []
    progress = create_simple_progress(progressbar)
    with progress:
        bar = progress.add_task("Classifying", completed=0, total=len(units))
        try:
            for i, unit in enumerate(units):
                inputs = likelihood_inputs(
                    tests_at(new_data, unit),
                    rule,
                    slope_weight=noise["slope_weight"],
                    with_force=with_force,
                )
                predictives = predictives or [
                    ClassPredictive(classes[name], settings, rule, inputs, rng) for name in names
                ]
                for j, predictive in enumerate(predictives):
                    estimate, method[i, j], pareto_k[i, j] = predictive(inputs, seeds.pop())
                    value[i, j], error[i, j] = estimate
                progress.advance(bar)
        except KeyboardInterrupt:
            warnings.warn("interrupted: experiments not yet classified are NaN", stacklevel=2)

    probability = softmax(value + np.log(prior), axis=1)
    # Delta method: dp_c = p_c Σ_j (δ_cj − p_j) d ln Z_j.
    weight = np.eye(len(names)) - probability[:, None, :]
    probability_error = probability * np.sqrt(np.einsum("icj,ij->ic", weight**2, error**2))
    first = [unit[0] for unit in units]
    labels = ("specimen", "experiment", "group") if by == "test" else ("specimen", "group")
    return xr.Dataset(
        {
            "class_probability": ((by, "class_label"), probability),
            "class_probability_se": ((by, "class_label"), probability_error),
            "log_evidence": ((by, "class_label"), value),
            "log_evidence_se": ((by, "class_label"), error),
            "method": ((by, "class_label"), method.astype(str)),
            "pareto_k": ((by, "class_label"), pareto_k),
        },
        {"class_label": names} | {label: (by, new_data[label].values[first]) for label in labels},
        # What the data are, above all whether they were simulated, stays with the result.
        {key: new_data.attrs[key] for key in ("title", "simulated") if key in new_data.attrs}
        | {
            "strain_energy": energy.name,
            "class_prior": json.dumps(dict(zip(names, prior.tolist(), strict=True))),
        },
    )


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


def _common_settings(classes: xr.DataTree) -> dict[str, Any]:
    """Settings of the classes' model, which has to be one, or evidences cannot be compared."""
    check_result(classes, "ph.fit_classes")
    if not classes.children:
        raise ValueError("classes must be the result of ph.fit_classes; here are no classes")
    first = next(iter(classes.children.values()))
    for name, fitted in classes.children.items():
        if "priors" not in fitted.attrs:
            raise ValueError(
                f"classes must be the result of ph.fit_classes, all of it; {name!r} is no class"
            )
        for key in ("strain_energy", "strain_energy_settings", "priors", "noise"):
            mine, theirs = fitted.attrs.get(key), first.attrs.get(key)
            if mine != theirs:
                raise ValueError(
                    f"class {name!r} was fitted with {key} {mine}, others with {theirs}: evidences "
                    "can only be compared under one strain energy, one prior and one noise"
                )
    return model_settings_of(first)


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
