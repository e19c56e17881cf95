"""Classification of new data by fitted classes, compiled once for any number of specimens.

:func:`~pymc_hyperelastic.classify` and :func:`~pymc_hyperelastic.explain_classification` use
:class:`Classification`.
"""

import json
from collections.abc import Callable, Mapping, Sequence
from numbers import Real
from typing import Any

import numpy as np
import xarray as xr
from scipy.special import softmax

from pymc_hyperelastic.classes.average import average, laws_of
from pymc_hyperelastic.classes.interface import NEGLIGIBLE, Prediction
from pymc_hyperelastic.classes.kinds import MISSING, kind_of_classes
from pymc_hyperelastic.classes.shapley import log_ratio_parts, parts_of, rivals_of
from pymc_hyperelastic.classes.training import check_new
from pymc_hyperelastic.data.inflation import describe_test
from pymc_hyperelastic.data.select import labels_of_units, tests_at, units_of, warn_of_repeats
from pymc_hyperelastic.evidence.checks import no_progress
from pymc_hyperelastic.evidence.diagnosis import worst_verdict
from pymc_hyperelastic.evidence.estimate import Estimate
from pymc_hyperelastic.evidence.importance import LARGEST_PARETO_K
from pymc_hyperelastic.evidence.smc import seed_of, seed_sequence
from pymc_hyperelastic.evidence.stored import read_json
from pymc_hyperelastic.evidence.verdicts import VERDICTS
from pymc_hyperelastic.io.checksum import digests_of
from pymc_hyperelastic.messages import warn_user
from pymc_hyperelastic.rounding import DIGITS

# Prediction for data not yet classified, as after an interrupt.
_UNKNOWN = Prediction(Estimate(np.nan, np.nan), np.nan, "", np.nan)
# Prediction for data whose computation raised an error.
_FAILED = Prediction(Estimate(np.nan, np.inf), np.inf, "failed", np.inf)
# Decision for rows with an unreliable evidence or p-value that could change it.
_UNJUDGED = "cannot be judged"
#: Attribute of decisions: checksums of the classes by which they were made, as JSON.
CLASSES = "classes"


class Classification:
    """Classifier of new data by fitted classes, checked and compiled once.

    The result for an experiment or specimen depends on its measurements, the classes, the seed and
    the data `like`, but not on other data that are classified.

    Parameters
    ----------
    classes, by, class_prior, average_over, undecided_below, none_below, random_seed
        See :func:`classify`.
    like : xarray.Dataset
        Valid inflation data whose ranges of radii, stretches and geometry cover those of all data
        to be classified.
    """

    def __init__(
        self,
        classes: xr.DataTree,
        like: xr.Dataset,
        *,
        by: str,
        class_prior: Mapping[str, float] | None,
        average_over: Sequence[xr.DataTree],
        random_seed: Any,
        undecided_below: float = 0.0,
        none_below: float = 0.0,
    ) -> None:
        _check_limits(by, undecided_below, none_below)
        if isinstance(average_over, xr.DataTree) or not isinstance(average_over, Sequence):
            raise TypeError(
                "average_over must be a list of results of ph.fit_classes, not "
                f"{type(average_over).__name__}"
            )
        self.by, self.trees = by, [classes, *average_over]
        kinds = [kind_of_classes(tree) for tree in self.trees]
        self._identity = [digests_of(tree.children) for tree in self.trees]
        self.names = list(classes.children)
        if class_prior is None:
            for tree in self.trees:
                _check_complete(tree)
        self._prior = class_prior_of(class_prior, self.names)
        with np.errstate(divide="ignore"):
            self._log_prior = np.log(self._prior)
        self._laws = laws_of(self.trees, kinds)
        self._has_p_value = all(kind.has_p_value for kind in kinds)
        self._limits = {"undecided_below": undecided_below, "none_below": none_below}
        if none_below and not self._has_p_value:
            raise ValueError(
                "none_below needs p-values, and so classes with variability: fit them with "
                "ph.fit_classes(..., variability='specimen')"
            )
        self._fresh_specimens = any(kind.fresh_specimens for kind in kinds)
        seed = seed_sequence(random_seed)
        self._entropy, self._seeds = seed.entropy, seed.spawn(len(kinds))
        self._predictors = [
            kind.predictor(tree.children, like, seed)
            for kind, tree, seed in zip(kinds, self.trees, self._seeds, strict=True)
        ]

    def check_new(self, data: xr.Dataset) -> None:
        """Raise for data in the training data, or warn about other data of their specimens."""
        check_new(data, self.trees[0].children, self._fresh_specimens)
        if self.by == "specimen":
            warn_of_repeats(data)

    def manifest(self) -> dict[str, Any]:
        """Return all inputs besides the data on which the results depend, for a store."""
        return {
            "class_prior": self._prior.tolist(),
            **self._limits,
            "classes": self._identity,
            "random_seed": self._entropy,
        }

    def of(
        self,
        data: xr.Dataset,
        advance: Callable[[], None] = no_progress,
        *,
        interruptible: bool = False,
    ) -> xr.Dataset:
        """Return the result of :func:`classify`; `advance` is called after each row.

        If `interruptible` is True, an interrupt leaves NaN for rows that are not yet computed.
        """
        units, classes = units_of(data, self.by), len(self.names)
        predictions, errors = [[_UNKNOWN] * classes for _ in units], [""] * len(units)
        try:
            for i, (label, unit) in enumerate(units.items()):
                part = tests_at(data, unit)
                try:
                    predictions[i] = self._predict(part, label)[0]
                except (ValueError, ArithmeticError) as error:
                    # One specimen must not end a batch.
                    predictions[i], errors[i] = [_FAILED] * classes, str(error)
                advance()
        except KeyboardInterrupt:
            if not interruptible:
                raise
            warn_user("interrupted: experiments not yet classified are NaN")
        result = tabulate(predictions, self._prior, self.by, self.names)
        result["error"] = (self.by, errors)
        if not self._has_p_value:
            result = result.drop_vars(["p_value", "typical_p_value", "fit_p_value"])
        verdicts = [worst_verdict(tree[name] for tree in self.trees) for name in self.names]
        result["class_verdict"] = ("class_label", verdicts)
        result["decision"] = _decide(result, self._prior, **self._limits)
        if len(self.trees) > 1:
            result = result.assign(self._laws.as_variables())
        return _labelled(result, data, self.by).assign_attrs(
            {
                "strain_energy": ", ".join(self._laws.labels),
                CLASSES: json.dumps(self._identity),
                "class_prior": json.dumps(dict(zip(self.names, self._prior.tolist(), strict=True))),
                **{name: float(bound) for name, bound in self._limits.items()},
            }
        )

    def explanation(
        self, data: xr.Dataset, advance: Callable[[], None] = no_progress
    ) -> xr.Dataset:
        """Return the result of :func:`explain_classification` for these data."""
        parts, units, classes = parts_of(self._laws), units_of(data, self.by), len(self.names)
        rivals = np.full((len(units), classes), "", dtype=object)
        values = np.full((len(units), classes, len(parts)), np.nan)
        for i, (label, unit) in enumerate(units.items()):
            part = tests_at(data, unit)
            try:
                averaged, of_laws = self._predict(part, label)
                evidence = np.array([p.log_evidence.value for p in averaged])
                for own, rival in enumerate(rivals_of(evidence + self._log_prior)):
                    rivals[i, own] = self.names[rival]
                    values[i, own] = log_ratio_parts(self._laws, of_laws, own, rival)
            except (ValueError, ArithmeticError) as error:
                # One specimen must not end a batch.
                message = f"{describe_test(part, 0)} cannot be judged: {error}"
                warn_user(message)
            advance()
        variables = {
            "rival": ((self.by, "class_label"), rivals.astype(str)),
            "log_ratio_part": ((self.by, "class_label", "part"), values),
        }
        found = xr.Dataset(variables, {"class_label": self.names, "part": parts})
        return _labelled(found, data, self.by)

    def _predict(
        self, data: xr.Dataset, label: str
    ) -> tuple[list[Prediction], list[list[Prediction]]]:
        """Return predictions for one unit: averaged over strain energies, and for each of them."""
        of_laws = [
            predictor(data, seed_of(seed, label))
            for predictor, seed in zip(self._predictors, self._seeds, strict=True)
        ]
        # Hybrids refer to large arrays, which need not be kept.
        averaged = average(self._laws, of_laws, self._log_prior)
        return [p._replace(hybrids=None) for p in averaged], of_laws


def _check_complete(classes: xr.DataTree) -> None:
    """Raise ValueError if a class was not fitted: its probability would go to the others."""
    for name, why in read_json(classes, MISSING, {}).items():
        if name not in classes.children:
            raise ValueError(
                f"class {name!r} was not fitted ({why}), and has no probability: fit it, or, if "
                f"only {list(classes.children)} are possible, give class_prior for these"
            )


def are_of_classes(decisions: xr.Dataset, trees: Sequence[xr.DataTree]) -> bool:
    """Return True if decisions were made by some of these classes, or do not record the classes."""
    digests = [digests_of(tree.children) for tree in trees]
    return all(made_with in digests for made_with in read_json(decisions, CLASSES, []))


def in_doubt(result: xr.Dataset) -> list[bool]:
    """Return True for rows whose evidences are unreliable; False for rows with an error."""
    if "decision" not in result:
        return [False] * len(result["error"])
    doubtful = result["decision"].values == _UNJUDGED
    return (doubtful & (result["error"].values == "")).tolist()


def _check_limits(by: str, undecided_below: float, none_below: float) -> None:
    if by not in ("test", "specimen"):
        raise ValueError(f"by must be 'test' or 'specimen', not {by!r}")
    for limit, bound in (("undecided_below", undecided_below), ("none_below", none_below)):
        if not isinstance(bound, Real) or not 0 <= bound < 1:
            raise ValueError(f"{limit} is {bound!r}; expected a number from 0 to 1, excluding 1")


def tabulate(
    predictions: Sequence[Sequence[Prediction]], prior: np.ndarray, by: str, names: Sequence[str]
) -> xr.Dataset:
    """Return predictions, by row and class, as tables with the probabilities of the classes."""

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


def _labelled(result: xr.Dataset, data: xr.Dataset, by: str) -> xr.Dataset:
    """Return the result with names of its rows, and attributes of the data."""
    # A result must show whether its data were simulated.
    kept = {key: data.attrs[key] for key in ("title", "simulated") if key in data.attrs}
    return result.assign_coords(labels_of_units(data, by)).assign_attrs(kept)


def _decide(
    result: xr.Dataset, prior: np.ndarray, undecided_below: float, none_below: float
) -> xr.DataArray:
    """Return the decision of each row; an empty string for rows that were not computed.

    The first one of several equally probable classes is chosen.
    """
    probability = result["class_probability"].values.round(DIGITS)
    names = result["class_label"].values.tolist()
    decision = np.array([names[j] for j in probability.argmax(axis=1)], dtype=object)
    decision[~(probability.max(axis=1) >= undecided_below)] = "undecided"
    decision[is_unreliable(result, prior)] = _UNJUDGED
    if "p_value" in result and none_below:
        p_value = result["p_value"].values.round(DIGITS)
        decision[np.isnan(p_value).any(axis=1)] = _UNJUDGED
        decision[(p_value < none_below).all(axis=1)] = "none of these"
    decision[np.isnan(result["log_evidence"].values).any(axis=1)] = _UNJUDGED
    # The error is infinite for rows that failed, and NaN for rows that were not computed.
    decision[np.isnan(result["log_evidence_se"].values).any(axis=1)] = ""
    return xr.DataArray(decision.astype(str), dims=result["class_probability"].dims[:1])


def is_unreliable(result: xr.Dataset, prior: np.ndarray) -> np.ndarray:
    """Return True for rows with an unreliable evidence that could change the decision."""
    with np.errstate(divide="ignore"):
        log_posterior = result["log_evidence"].values + np.log(prior)
    doubtful = result["pareto_k"].values >= LARGEST_PARETO_K
    doubtful = doubtful | ~np.isfinite(result["log_evidence_se"].values)
    doubtful = doubtful | (result["class_verdict"].values == VERDICTS[-1])
    near = log_posterior > log_posterior.max(axis=1, keepdims=True) + np.log(NEGLIGIBLE)
    return (doubtful & near).any(axis=1)


def class_prior_of(class_prior: Mapping[str, float] | None, names: list[str]) -> np.ndarray:
    """Return the prior probabilities in the order of the classes; raise unless they are valid."""
    if class_prior is None:
        return np.full(len(names), 1 / len(names))
    if not isinstance(class_prior, Mapping):
        raise TypeError(
            f"class_prior must be a dict from names of classes to numbers, not {class_prior!r}"
        )
    if set(class_prior) != set(names):
        raise ValueError(f"class_prior names {sorted(class_prior)}, but the classes are {names}")
    try:
        prior = np.array([class_prior[name] for name in names], float)
    except (TypeError, ValueError):
        prior = np.array([np.nan])
    if not np.all(prior >= 0) or not np.isclose(prior.sum(), 1):
        raise ValueError(f"class_prior must hold probabilities that add up to 1; got {class_prior}")
    return prior
