"""Averages over strain energies, each by its probability."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import xarray as xr
from numpy.typing import NDArray
from scipy.special import log_softmax, logsumexp, softmax

from pymc_hyperelastic.classes.interface import (
    ClassKind,
    Prediction,
    training_evidence,
)
from pymc_hyperelastic.classes.training import same_training_data
from pymc_hyperelastic.evidence.estimate import Estimate

Array = NDArray[np.float64]

# Draws of the laws' log evidences, within their errors: those of what follows are then known to 2%.
_DRAWS, _SEED = 2000, 1


@dataclass(frozen=True)
class Laws:
    r"""Strain energies ``k`` with their posterior probabilities, equal beforehand.

    .. math:: P_k = \frac{Z_k}{\sum_j Z_j}

    The log evidences have standard errors, and a probability near 0 or 1 does not follow them in
    proportion: errors of what depends on the ``P_k`` are therefore root mean squares over draws of
    the log evidences. If one of these is not known at all, nothing is of what depends on it.
    """

    labels: list[str]
    parts: list[tuple[str, ...]]
    """Parts of a class that can be told apart, by law."""
    evidences: list[Estimate]

    @cached_property
    def log_probability(self) -> Array:
        """Logarithm of the probability of each law."""
        if len(self.labels) == 1:
            return np.zeros(1)
        return log_softmax([evidence.value for evidence in self.evidences])

    @cached_property
    def drawn(self) -> Array | None:
        """Draws of the same (draw, law); none where a law's evidence is not known."""
        values, errors = np.transpose(self.evidences)
        if len(self.labels) == 1:
            return np.zeros((1, 1))
        if not np.isfinite(errors).all():
            return None
        noise = np.random.default_rng(_SEED).standard_normal((_DRAWS, len(values)))
        return log_softmax(values + errors * noise, axis=1)

    @cached_property
    def probability_error(self) -> Array:
        """Standard error of the probability of each law; NaN where evidences are still unknown."""
        probability = np.exp(self.log_probability)
        if self.drawn is None:
            return np.where(np.isnan(probability), np.nan, np.inf)
        return _error(np.exp(self.drawn), probability)

    def as_variables(self) -> dict[str, xr.DataArray]:
        """Probability of each law, and its standard error."""
        coords = {"strain_energy": self.labels}
        values = {"": np.exp(self.log_probability), "_se": self.probability_error}
        return {
            f"strain_energy_probability{name}": xr.DataArray(value, coords, "strain_energy")
            for name, value in values.items()
        }


def laws_of(trees: Sequence[xr.DataTree], kinds: Sequence[ClassKind]) -> Laws:
    """The laws of fitted classes, whose evidences have to compare."""
    first = trees[0]
    labels = labels_of(kinds)
    noises = [
        kind.noise_in_words(next(iter(tree.children.values())))
        for kind, tree in zip(kinds, trees, strict=True)
    ]
    for tree, label, noise in zip(trees, labels, noises, strict=True):
        if list(tree.children) != list(first.children):
            raise ValueError(
                f"average_over holds the classes {list(tree.children)}, not "
                f"{list(first.children)} as the others"
            )
        if noise != noises[0]:
            raise ValueError(
                f"average_over holds {label} with {noise}, but {labels[0]} has {noises[0]}: their "
                "evidences do not compare"
            )
        for name, fitted in tree.children.items():
            if not same_training_data(fitted, first[name]):
                raise ValueError(
                    f"class {name!r} has other training data under {label} than under "
                    f"{labels[0]}: their evidences do not compare"
                )
    evidences = [training_evidence(tree.children) for tree in trees]
    return Laws(labels, [kind.parts for kind in kinds], evidences)


def labels_of(kinds: Sequence[ClassKind]) -> list[str]:
    """Names of strain energies; where these are alike, with what else tells the kinds apart."""
    labels: list[str] = []
    for kind in kinds:
        alike = [other for other in kinds if other.energy.name == kind.energy.name]
        laws = {repr(other.energy) for other in alike}
        same = [other for other in alike if repr(other.energy) == repr(kind.energy)]
        label = kind.energy.name if len(laws) == 1 else repr(kind.energy)
        if len({other.in_words for other in same}) > 1 and kind.in_words:
            label = f"{label} {kind.in_words}"
        times = sum(known.split(" (")[0] == label for known in labels)
        labels.append(f"{label} ({times + 1})" if times else label)
    return labels


def average(
    laws: Laws, predictions: Sequence[Sequence[Prediction]], log_prior: Array
) -> list[Prediction]:
    """Prediction of each class by several laws together, each by its probability.

    `predictions` are those of every class, by law, and `log_prior` is that of the classes.
    """
    if len(predictions) == 1:
        return [*predictions[0]]
    values = np.array([[p.log_evidence.value for p in of_law] for of_law in predictions])
    terms = laws.log_probability[:, None] + values
    evidence, share = logsumexp(terms, axis=0), softmax(terms, axis=0)
    errors = np.array([[p.log_evidence.standard_error for p in of_law] for of_law in predictions])
    own = np.array([[p.own_error for p in of_law] for of_law in predictions])
    error, own = (np.linalg.norm(share * each, axis=0) for each in (errors, own))
    of_laws = of_probability = np.full(len(evidence), np.inf)
    if laws.drawn is not None:
        drawn = logsumexp(laws.drawn[:, :, None] + values, axis=1)
        of_laws = _error(drawn, evidence)
        chance = softmax(drawn + log_prior, axis=1)
        of_probability = _error(chance, softmax(evidence + log_prior))
    weights = np.exp(laws.log_probability)
    averaged = []
    for i, of_class in enumerate(zip(*predictions, strict=True)):
        p_values = weights @ [(p.p_value, p.p_typical, p.p_fit) for p in of_class]
        p_value, p_typical, p_fit = p_values.tolist()
        averaged.append(
            Prediction(
                Estimate(float(evidence[i]), float(np.hypot(error[i], of_laws[i]))),
                float(own[i]),
                "average over strain energies",
                float(np.fmax.reduce([p.pareto_k for p in of_class])),
                p_value,
                p_typical,
                p_fit,
                probability_error=float(of_probability[i]),
            )
        )
    return averaged


def _error(drawn: Array, stated: Array) -> Array:
    """Root mean square of what draws, along the first axis, differ by from what is stated."""
    return np.sqrt(np.mean((drawn - stated) ** 2, axis=0))
