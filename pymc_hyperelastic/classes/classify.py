"""Classify new experiments by their marginal likelihood."""

import json
import warnings
from collections.abc import Callable, Mapping, Sequence
from numbers import Real
from typing import Any, Literal

import numpy as np
import xarray as xr
from pymc.progress_bar import create_simple_progress
from scipy.special import softmax

from pymc_hyperelastic.classes.average import average, laws_of
from pymc_hyperelastic.classes.interface import Prediction, Predictor
from pymc_hyperelastic.classes.kinds import kind_of_classes
from pymc_hyperelastic.classes.parts import parts_of, table_of_parts, with_parts
from pymc_hyperelastic.classes.training import check_new
from pymc_hyperelastic.data.inflation import check_inflation_data, describe_test
from pymc_hyperelastic.data.select import tests_at
from pymc_hyperelastic.evidence.diagnosis import VERDICTS, worst_verdict
from pymc_hyperelastic.evidence.estimate import Estimate
from pymc_hyperelastic.evidence.importance import LARGEST_PARETO_K
from pymc_hyperelastic.evidence.smc import seed_sequence

_UNKNOWN = Prediction(Estimate(np.nan, np.nan), np.nan, "", np.nan)
_FAILED = Prediction(Estimate(np.nan, np.inf), np.inf, "failed", np.inf)
# Nats: an evidence that is not to be trusted, and so much lower, would not change a decision.
_FAR_BELOW = 10.0


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
        New inflation data. Measurements from which a class was learned are refused, under whatever
        names: it would always claim them. With variability new specimens are new to the class, and
        other experiments on a specimen of the training data are warned of; without, they are other
        curves of the class's one material.
    classes : xarray.DataTree
        Result of :func:`fit_classes`, perhaps read from a file.
    by : {"test", "specimen"}
        What is classified: each experiment by itself, or all experiments on a specimen together.
    class_prior : dict of str to float, optional
        Probability of each class beforehand; equal when missing.
    average_over : sequence of xarray.DataTree, optional
        The same classes, of the same training data, fitted with other strain energies: what each
        says counts by its posterior probability, which is the product of the evidences of its
        classes. The variable ``strain_energy_probability`` tells it, and
        ``strain_energy_probability_se`` what the errors of these evidences leave open, which all
        errors of the result hold too: if one is infinite, nothing can be judged.
        ``strain_energy_log_evidence`` is what it rests on, and ``strain_energy_class_probability``
        (strain_energy, class_label) what each class would say alone, both with their ``_se``; see
        :func:`~pymc_hyperelastic.plot_law_probability`. The p-value is the mean of the laws'
        p-values by these probabilities. Evidences compare only between classes of the same noise,
        or between classes that all have variability; of these one law may be there twice, with an
        experiment effect and without.
    undecided_below : float, default 0
        Probability that the most probable class must have for a decision.
    none_below : float, default 0
        Where the p-value of every class is below this, the decision is "none of these"; with 0.05
        that happens to one in twenty specimens of the classes themselves. Only for classes with
        variability.
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
        class's distribution, integrated by "specimen draws", or, where these could not be had by
        importance sampling, by "specimen draws by tempering"; ``pareto_k`` is the larger of the
        shapes of the weights by which they were drawn and of those under the class, and from 0.5 on
        the evidence is not to be trusted. ``p_value`` is then the chance that a specimen of
        the class itself looks as strange, by either of two signs that are given beside it.
        ``typical_p_value`` compares its wall with those that the class would bring forth, in
        coordinates in which half as stiff is as far as twice as stiff. ``fit_p_value`` asks whether
        any wall of this law follows its curves to within the noise: with known noise the chance of
        a worse misfit, else that of noise as large in the class. P-values are NaN if the curves
        tell nothing of the wall. The decision is "cannot be judged" where an evidence that might
        change it is not to be trusted, or, with `none_below`, where there is no p-value.
        ``class_verdict`` (class_label)
        says how far the fits of the classes can be trusted, see
        :func:`~pymc_hyperelastic.diagnose_evidence`.

        What drives an answer is in ``log_ratio_part`` (..., class_label, part), in nats: the log
        ratio of the evidences of the class and of its ``rival``, the most probable other class, is
        the sum of these parts. With variability they are "material" (location, spreads and
        correlation of the coordinates), "experiments" (how much those on a specimen differ) and
        "noise" (its size), as far as the classes have them. Without, they are what was measured:
        "pressure", "slope" and "force", as far as the likelihood of the classes has them. Each
        is the mean change of the log evidence ``v`` when the class's part is exchanged for the
        rival's, over all orders in which the ``n`` parts can be exchanged,

        .. math:: φ_j = \sum_{S \not\ni j} \frac{|S|! \, (n - 1 - |S|)!}{n!} \,
            \bigl[v(S) - v(S \cup \{j\})\bigr], \qquad
            \sum_j φ_j = \ln\frac{P(D | C)}{P(D | C_{\mathrm{rival}})}

        and positive where it speaks for the class; NaN where one of these evidences is not to be
        trusted. A signal is exchanged when the rival predicts it, by itself, and the class the
        others: ``v`` is then the sum of the log evidences of the two, each of its own signals.
        Slopes are differences of the same pressures. Beside these they are what they add to the
        likelihood; without them they are taken as numbers by themselves, with the errors that the
        likelihood gives each. What the two tell alike is divided between them. Evidences of some
        signals alone are taken with fewer draws: mostly to a few hundredths of a nat, and a part
        that rests on one with an error above half a nat is NaN. They take half as long again for
        two signals, and twice as long for three; of one signal there are none.

    Warns
    -----
    UserWarning
        If specimens stand in the training data of classes with variability, with other
        measurements; if something cannot be judged; if an interrupt leaves something unknown.

    Raises
    ------
    TypeError, ValueError
        If the data are unsound or were in the training data, `classes` are not fitted classes of
        one model, or `class_prior` is not a probability of each class.

    Examples
    --------
    >>> import pymc_hyperelastic as ph
    >>> data = ph.load_dataset("simulated_sheep_aorta")
    >>> train = {name: ph.select(data, group=name, experiment=[1, 2]) for name in ("C1", "C2")}
    >>> noise = {"sigma": 5 * ph.mmHg, "slope_weight": 3.0}
    >>> settings = {"draws": 500, "chains": 2, "random_seed": 1, "progressbar": False}
    >>> classes = ph.fit_classes(ph.Ogden(), train, **noise, **settings)
    >>> new = ph.select(data, specimen="S4", experiment=3)
    >>> result = ph.classify(new, classes, random_seed=2, progressbar=False)
    >>> result["class_probability"].idxmax("class_label").item()
    'C2'
    >>> parts = result["log_ratio_part"].sel(class_label="C2")
    >>> bool(parts.sum("part") > 0)  # of the log ratio to class C1
    True
    """
    _check_limits(by, undecided_below, none_below)
    if isinstance(average_over, xr.DataTree) or not isinstance(average_over, Sequence):
        raise TypeError(
            "average_over must be a list of results of ph.fit_classes, not "
            f"{type(average_over).__name__}"
        )
    trees = [classes, *average_over]
    kinds = [kind_of_classes(tree) for tree in trees]
    names = list(classes.children)
    prior = _class_prior(class_prior, names)
    laws = laws_of(trees, kinds)
    has_p_value = all(kind.has_p_value for kind in kinds)
    if none_below and not has_p_value:
        raise ValueError(
            "none_below needs classes that say how specimens differ: "
            "ph.fit_classes(..., variability='specimen')"
        )
    with np.errstate(divide="ignore"):
        log_prior = np.log(prior)
    check_inflation_data(new_data)
    units = _units(new_data, by)
    seed = seed_sequence(random_seed)
    seeds = [seed] if len(trees) == 1 else seed.spawn(len(trees))
    predictors = [
        kind.predictor(tree.children, new_data, len(units), own)
        for kind, tree, own in zip(kinds, trees, seeds, strict=True)
    ]
    check_new(new_data, classes.children, any(kind.fresh_specimens for kind in kinds))

    def predict(data: xr.Dataset) -> list[Prediction]:
        of_laws = [predictor(data) for predictor in predictors]
        averaged = average(laws, of_laws, log_prior)
        return with_parts(averaged, laws, of_laws, log_prior)

    predictions = _predict_all(predict, new_data, units, len(names), progressbar)
    result = _tabulate(predictions, prior, by, names)
    result = result.assign(table_of_parts(predictions, by, names, parts_of(laws)))
    if not has_p_value:
        result = result.drop_vars(["p_value", "typical_p_value", "fit_p_value"])
    result["class_verdict"] = (
        "class_label",
        [worst_verdict(tree[name] for tree in trees) for name in names],
    )
    result["decision"] = _decide(result, prior, undecided_below, none_below)
    doubtful = (result["decision"] == "cannot be judged") & (result["method"] != _FAILED.method)
    if unclear := int(doubtful.any("class_label").sum()):
        warnings.warn(
            f"{unclear} of {len(units)} cannot be judged: see class_verdict, log_evidence_se, "
            "pareto_k and p_value",
            stacklevel=2,
        )
    if average_over:
        result = result.assign(laws.as_variables())
    return _labelled(result, new_data, units, by).assign_attrs(
        {
            "strain_energy": ", ".join(laws.labels),
            "class_prior": json.dumps(dict(zip(names, prior.tolist(), strict=True))),
            "undecided_below": float(undecided_below),
            "none_below": float(none_below),
        }
    )


def _check_limits(by: str, undecided_below: float, none_below: float) -> None:
    if by not in ("test", "specimen"):
        raise ValueError(f"by must be 'test' or 'specimen', not {by!r}")
    for limit, bound in (("undecided_below", undecided_below), ("none_below", none_below)):
        if not isinstance(bound, Real) or not 0 <= bound < 1:
            raise ValueError(f"{limit} is {bound!r}; expected a number from 0 to 1")


def _units(data: xr.Dataset, by: str) -> list[list[int]]:
    """Tests that are classified together."""
    if by == "test":
        return [[test] for test in range(data.sizes["test"])]
    specimen = data["specimen"].values
    return [np.flatnonzero(specimen == s).tolist() for s in dict.fromkeys(specimen.tolist())]


def _predict_all(
    predict: Predictor,
    data: xr.Dataset,
    units: Sequence[Sequence[int]],
    classes: int,
    progressbar: bool,
) -> list[list[Prediction]]:
    """Predictions of all units; after an interrupt what is not yet known is NaN."""
    predictions = [[_UNKNOWN] * classes for _ in units]
    progress = create_simple_progress(progressbar)
    with progress:
        bar = progress.add_task("Classifying", completed=0, total=len(units))
        try:
            for i, unit in enumerate(units):
                part = tests_at(data, unit)
                try:
                    predictions[i] = predict(part)
                except (ValueError, ArithmeticError) as error:
                    # One specimen must not end a batch.
                    predictions[i] = [_FAILED] * classes
                    said = f"{describe_test(part, 0)} cannot be judged: {error}"
                    warnings.warn(said, stacklevel=3)
                progress.advance(bar)
        except KeyboardInterrupt:
            warnings.warn("interrupted: experiments not yet classified are NaN", stacklevel=3)
    return predictions


def _tabulate(
    predictions: Sequence[Sequence[Prediction]], prior: np.ndarray, by: str, names: Sequence[str]
) -> xr.Dataset:
    """Predictions as tables, with the probabilities of the classes."""

    def table(value: Callable[[Prediction], Any]) -> np.ndarray:
        return np.array([[value(prediction) for prediction in row] for row in predictions])

    log_evidence = table(lambda p: p.log_evidence.value)
    with np.errstate(divide="ignore"):
        probability = softmax(log_evidence + np.log(prior), axis=1)
    # Delta method: dp_c = p_c Σ_j (δ_cj − p_j) d ln Z_j.
    weight = np.eye(len(names)) - probability[:, None, :]
    own = table(lambda p: p.own_error)
    of_evidences = probability * np.sqrt(np.einsum("icj,ij->ic", weight**2, own**2))
    tables = {
        "class_probability": probability,
        "class_probability_se": np.hypot(of_evidences, table(lambda p: p.probability_error)),
        "log_evidence": log_evidence,
        "log_evidence_se": table(lambda p: p.log_evidence.standard_error),
        "method": table(lambda p: p.method).astype(str),
        "pareto_k": table(lambda p: p.pareto_k),
        "p_value": table(lambda p: p.p_value),
        "typical_p_value": table(lambda p: p.p_typical),
        "fit_p_value": table(lambda p: p.p_fit),
    }
    dims = (by, "class_label")
    return xr.Dataset(
        {name: (dims, values) for name, values in tables.items()}, {"class_label": list(names)}
    )


def _labelled(
    result: xr.Dataset, data: xr.Dataset, units: Sequence[Sequence[int]], by: str
) -> xr.Dataset:
    """The result with names of what was classified, and what the data are said to be."""
    first = [unit[0] for unit in units]
    labels = ("specimen", "experiment", "group") if by == "test" else ("specimen", "group")
    # Above all whether they were simulated.
    kept = {key: data.attrs[key] for key in ("title", "simulated") if key in data.attrs}
    named = {label: (by, data[label].values[first]) for label in labels}
    return result.assign_coords(named).assign_attrs(kept)


def _decide(
    result: xr.Dataset, prior: np.ndarray, undecided_below: float, none_below: float
) -> xr.DataArray:
    """The most probable class, unless a limit says otherwise; empty where nothing is known."""
    probability = result["class_probability"]
    names = result["class_label"].values.tolist()
    decision = np.array([names[j] for j in probability.values.argmax(axis=1)], dtype=object)
    decision[~(probability.values.max(axis=1) >= undecided_below)] = "undecided"
    decision[_in_doubt(result, prior)] = "cannot be judged"
    if "p_value" in result and none_below:
        p_value = result["p_value"].values
        decision[np.isnan(p_value).any(axis=1)] = "cannot be judged"
        decision[(p_value < none_below).all(axis=1)] = "none of these"
    decision[np.isnan(result["log_evidence"].values).any(axis=1)] = "cannot be judged"
    # What failed has an infinite error, and what was not tried has none.
    decision[np.isnan(result["log_evidence_se"].values).any(axis=1)] = ""
    return xr.DataArray(decision.astype(str), dims=probability.dims[:1])


def _in_doubt(result: xr.Dataset, prior: np.ndarray) -> np.ndarray:
    """Where the evidence of the most probable class, or of one near it, is not to be trusted."""
    with np.errstate(divide="ignore"):
        log_posterior = result["log_evidence"].values + np.log(prior)
    doubtful = result["pareto_k"].values >= LARGEST_PARETO_K
    doubtful = doubtful | ~np.isfinite(result["log_evidence_se"].values)
    doubtful = doubtful | (result["class_verdict"].values == VERDICTS[-1])
    near = log_posterior > log_posterior.max(axis=1, keepdims=True) - _FAR_BELOW
    return (doubtful & near).any(axis=1)


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
