"""Averages over strain energies, each by its probability."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray
from scipy.special import log_softmax, logsumexp, softmax

from pymc_hyperelastic.classes.comparable import Fit, check_comparable, likelihood_said
from pymc_hyperelastic.classes.interface import (
    ClassKind,
    Prediction,
    training_evidence,
)
from pymc_hyperelastic.classes.kinds import kind_of_classes
from pymc_hyperelastic.evidence.diagnosis import log_evidence
from pymc_hyperelastic.evidence.estimate import Estimate
from pymc_hyperelastic.mechanics.layers import Layer
from pymc_hyperelastic.mechanics.strain_energy import StrainEnergy
from pymc_hyperelastic.models.settings import law_names_of, wall_of

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
    of_classes: dict[str, list[Estimate]] = field(default_factory=dict)
    """The evidences of each class by itself, by law."""

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
        """Log evidence and probability of each law, and that by each class alone."""
        coords: dict[str, Any] = {"strain_energy": self.labels}
        values, errors = np.transpose(self.evidences)
        variables = {
            "log_evidence": values,
            "log_evidence_se": errors,
            "probability": np.exp(self.log_probability),
            "probability_se": self.probability_error,
        }
        found = {
            f"strain_energy_{name}": xr.DataArray(value, coords, "strain_energy")
            for name, value in variables.items()
        }
        if self.of_classes:
            alone = [Laws(self.labels, self.parts, e) for e in self.of_classes.values()]
            coords |= {"class_label": list(self.of_classes)}
            for name, table in (
                ("", [np.exp(laws.log_probability) for laws in alone]),
                ("_se", [laws.probability_error for laws in alone]),
            ):
                found[f"strain_energy_class_probability{name}"] = xr.DataArray(
                    np.transpose(table), coords, ("strain_energy", "class_label")
                )
        return found


def laws_of(
    trees: Sequence[xr.DataTree],
    kinds: Sequence[ClassKind],
    labels: Sequence[str] | None = None,
    argument: str = "average_over",
) -> Laws:
    """The laws of fitted classes, whose evidences have to compare.

    They are labelled by what they are, unless `labels` are given. The `argument` is that by which
    the classes were given.
    """
    labels = list(labels or labels_of(kinds))
    check_comparable(
        [
            Fit(label, tree.children, likelihood_said(next(iter(tree.children.values()))))
            for label, tree in zip(labels, trees, strict=True)
        ],
        argument,
    )
    evidences = [training_evidence(tree.children) for tree in trees]
    of_classes = {name: [log_evidence(tree[name]) for tree in trees] for name in trees[0].children}
    return Laws(labels, [kind.parts for kind in kinds], evidences, of_classes)


def laws_of_fits(fits: Mapping[str, xr.DataTree] | Sequence[xr.DataTree]) -> Laws:
    """The laws of results: of sampled models, or of classes; a dict names the laws."""
    trees = list(fits.values()) if isinstance(fits, Mapping) else list(fits)
    labels = list(fits) if isinstance(fits, Mapping) else None
    for i, tree in enumerate(trees):
        if not isinstance(tree, xr.DataTree):
            which = f"{labels[i]!r}" if labels else f"number {i}"
            raise TypeError(
                f"fit {which} must be a result of ph.sample_smc or ph.fit_classes, not "
                f"{type(tree).__name__}"
            )
    if not trees:
        raise ValueError("there are no fits: expected results of ph.sample_smc or ph.fit_classes")
    of_classes = [_are_classes(tree) for tree in trees]
    if all(of_classes):
        return laws_of(
            trees, [kind_of_classes(tree, whole=False) for tree in trees], labels, "fits"
        )
    if any(of_classes):
        raise ValueError(
            "some of the fits are classes, results of ph.fit_classes, and some are single results: "
            "their evidences do not compare; of one class take classes['C1']"
        )
    labels = labels or labels_of_results(trees)
    check_comparable(
        [Fit(name, {"": t}, likelihood_said(t)) for name, t in zip(labels, trees, strict=True)],
        "fits",
    )
    return Laws(labels, [], [log_evidence(tree) for tree in trees])


def _are_classes(tree: xr.DataTree) -> bool:
    return "evidence" not in tree.children and any(
        "evidence" in child.children for child in tree.children.values()
    )


def labels_of(kinds: Sequence[ClassKind]) -> list[str]:
    """Names of strain energies; where these are alike, with what else tells the kinds apart."""
    known = []
    for kind in kinds:
        wall = [kind.energy] if isinstance(kind.energy, StrainEnergy) else kind.energy
        laws = [layer.energy if isinstance(layer, Layer) else layer for layer in wall]
        known.append((*_names(laws), kind.in_words))
    return _told_apart(known)


def labels_of_results(trees: Sequence[xr.DataTree]) -> list[str]:
    """Names of the strain energies, or of the layers, of sampled models."""
    known = []
    for i, tree in enumerate(trees):
        if not law_names_of(tree):
            raise ValueError(
                f"fit number {i} does not name its strain energy: give the fits as a dict of names "
                "to results"
            )
        known.append((*_names([layer.energy for layer in wall_of(tree)]), ""))
    return _told_apart(known)


def _names(energies: Sequence[StrainEnergy]) -> tuple[str, str]:
    """What the laws of a wall, from the inside out, are called, and that with their settings."""
    return " in ".join(law.name for law in energies), " in ".join(map(repr, energies))


def _told_apart(known: Sequence[tuple[str, str, str]]) -> list[str]:
    """Labels of laws, of each of which the name, all settings and more words are known."""
    labels: list[str] = []
    for name, settings, words in known:
        alike = [other for other in known if other[0] == name]
        same = [other for other in alike if other[1] == settings]
        label = name if len({other[1] for other in alike}) == 1 else settings
        if len({other[2] for other in same}) > 1 and words:
            label = f"{label} {words}"
        times = sum(other.split(" (")[0] == label for other in labels)
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
    # What has an infinite error may have any share, though it seems to have none.
    with np.errstate(invalid="ignore"):
        error, own = (
            np.linalg.norm(np.where(np.isinf(each), np.inf, share * each), axis=0)
            for each in (errors, own)
        )
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
