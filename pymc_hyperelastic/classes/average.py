"""Bayesian model averaging of classes over strain energies.

Strain energies are weighted with their posterior probabilities, which follow from the evidences of
the training data: evidences are comparable if the data and the likelihood are the same.
Classification, comparison and the plot of these probabilities use them.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import NDArray
from scipy.special import log_softmax, logsumexp, softmax

from pymc_hyperelastic.classes.interface import (
    DRAWS,
    ClassKind,
    Prediction,
    training_evidence,
)
from pymc_hyperelastic.classes.kinds import kind_of_classes
from pymc_hyperelastic.evidence.diagnosis import log_evidence
from pymc_hyperelastic.evidence.estimate import Estimate
from pymc_hyperelastic.messages import warn_user
from pymc_hyperelastic.models.settings import (
    NamedLayer,
    holds_inflation_data,
    inflation_data_of,
    law_names_of,
    model_settings_of,
    named_layers,
    wall_of,
)
from pymc_hyperelastic.predictions.members import SEED

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Laws:
    r"""Posterior probabilities of strain energies ``k`` with equal prior probabilities.

    .. math:: P_k = \frac{Z_k}{\sum_j Z_j}

    Probabilities near 0 or 1 are not linear in the log evidences. Standard errors of functions of
    ``P_k`` are therefore root mean square deviations over random draws of the log evidences within
    their standard errors. If a standard error is infinite, so are those of all these functions.
    """

    labels: list[str]
    parts: list[tuple[str, ...]]
    """For each strain energy, the parts into which a log ratio of evidences can be divided."""
    evidences: list[Estimate]
    """Log evidence of all training data under each strain energy."""
    of_classes: dict[str, list[Estimate]] = field(default_factory=dict)
    """Log evidences of each class alone under each strain energy."""

    @cached_property
    def log_probability(self) -> Array:
        """Logarithm of the probability of each strain energy."""
        if len(self.labels) == 1:
            return np.zeros(1)
        return log_softmax([evidence.value for evidence in self.evidences])

    @cached_property
    def drawn(self) -> Array | None:
        """Draws of the log probabilities, shape (draw, law); None if an error is not finite."""
        values, errors = np.transpose(self.evidences)
        if len(self.labels) == 1:
            return np.zeros((1, 1))
        if not np.isfinite(errors).all():
            return None
        noise = np.random.default_rng(SEED).standard_normal((DRAWS, len(values)))
        return log_softmax(values + errors * noise, axis=1)

    @cached_property
    def probability_error(self) -> Array:
        """Standard error of each probability; NaN for an unknown probability."""
        probability = np.exp(self.log_probability)
        if self.drawn is None:
            return np.where(np.isnan(probability), np.nan, np.inf)
        return _error(np.exp(self.drawn), probability)

    def as_variables(self) -> dict[str, xr.DataArray]:
        """Return log evidences and probabilities of all strain energies as variables of a result.

        If classes are known, this includes the probabilities given each class alone.
        """
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
    """Return the strain energies of fitted classes; raise unless their evidences are comparable.

    Default labels are the names of the strain energies. `argument` is the name of the user's
    argument, for messages.
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
    """Return the strain energies of results of `sample_smc` or `fit_classes`.

    The keys of a dict are the labels.
    """
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
        raise ValueError("fits is empty: expected results of ph.sample_smc or ph.fit_classes")
    of_classes = [_are_classes(tree) for tree in trees]
    if all(of_classes):
        return laws_of(
            trees, [kind_of_classes(tree, whole=False) for tree in trees], labels, "fits"
        )
    if any(of_classes):
        raise ValueError(
            "fits holds both results of ph.fit_classes and single results, whose evidences do not "
            "compare; to use a single class, give classes['C1']"
        )
    labels = labels or labels_of_results(trees)
    check_comparable(
        [Fit(name, {"": t}, likelihood_said(t)) for name, t in zip(labels, trees, strict=True)],
        "fits",
    )
    return Laws(labels, [], [log_evidence(tree) for tree in trees])


def _are_classes(tree: xr.DataTree) -> bool:
    """Return True for a result of `fit_classes`, whose children hold the evidences."""
    return "evidence" not in tree.children and any(
        "evidence" in child.children for child in tree.children.values()
    )


def labels_of(kinds: Sequence[ClassKind]) -> list[str]:
    """Return unique labels of strain energies; equal names are extended by settings."""
    descriptions = []
    for kind in kinds:
        descriptions.append((*_names(named_layers(kind.energy)), kind.in_words))
    return _unique_labels(descriptions)


def labels_of_results(trees: Sequence[xr.DataTree]) -> list[str]:
    """Return unique labels of the strain energies, or of the layers, of sampled models."""
    descriptions = []
    for i, tree in enumerate(trees):
        if not law_names_of(tree):
            raise ValueError(
                f"fit number {i} does not name its strain energy: give the fits as a dict of names "
                "to results"
            )
        descriptions.append((*_names(wall_of(tree)), ""))
    return _unique_labels(descriptions)


def _names(layers: Sequence[NamedLayer]) -> tuple[str, str]:
    """Return a label of the layers, from the inside out, without and with their settings."""
    laws = [layer.energy for layer in layers]
    return " in ".join(law.name for law in laws), " in ".join(map(repr, laws))


def _unique_labels(descriptions: Sequence[tuple[str, str, str]]) -> list[str]:
    """Return unique labels from the name, the settings and further words about each entry.

    Settings and words are added only where names are equal; then entries are numbered.
    """
    labels: list[str] = []
    for name, settings, words in descriptions:
        same_name = [other for other in descriptions if other[0] == name]
        same_settings = [other for other in same_name if other[1] == settings]
        label = name if len({other[1] for other in same_name}) == 1 else settings
        if len({other[2] for other in same_settings}) > 1 and words:
            label = f"{label} {words}"
        times = sum(other.split(" (")[0] == label for other in labels)
        labels.append(f"{label} ({times + 1})" if times else label)
    return labels


def average(
    laws: Laws, predictions: Sequence[Sequence[Prediction]], log_prior: Array
) -> list[Prediction]:
    """Return the prediction of each class, averaged over strain energies with their probabilities.

    `predictions` has the order (law, class); `log_prior` holds log prior probabilities of classes.
    """
    if len(predictions) == 1:
        return [*predictions[0]]
    known = [[(*p.log_evidence, p.own_error) for p in of_law] for of_law in predictions]
    values, errors, own = np.moveaxis(np.array(known), -1, 0)
    terms = laws.log_probability[:, None] + values
    evidence, share = logsumexp(terms, axis=0), softmax(terms, axis=0)
    error, own = (error_of_mean(share, each) for each in (errors, own))
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


def error_of_mean(share: Array, errors: Array) -> Array:
    """Return the error of a mean evidence from those of its terms and their shares, along axis 0.

    An evidence with an infinite error may be of any size, even where its estimate is negligible:
    the error of the mean is then infinite.
    """
    with np.errstate(invalid="ignore"):  # 0 · inf
        return np.linalg.norm(np.where(np.isinf(errors), np.inf, share * errors), axis=0)


def _error(drawn: Array, stated: Array) -> Array:
    """Return the root mean square deviation of draws, along axis 0, from the estimate."""
    return np.sqrt(np.mean((drawn - stated) ** 2, axis=0))


class Fit(NamedTuple):
    """Fitted results of one strain energy."""

    label: str
    fitted: Mapping[str, xr.DataTree]
    """Results by class; a single result has the name ``""``."""
    likelihood: str | None
    """The likelihood in words; None if the result does not state it."""


def likelihood_said(tree: xr.DataTree) -> str | None:
    """Return the likelihood of one result in words; None if the result does not state it."""
    settings = model_settings_of(tree)
    likelihood = None if settings is None else settings.make_likelihood()
    if settings is None or likelihood is None:
        return None
    if settings.variability == "none":
        return f"the likelihood {likelihood!r}"
    # Errors belong to each specimen and may differ between laws; the signals may not.
    forces = " and forces" if likelihood.with_force else ""
    return f"variability={settings.variability!r}, of pressures{forces}"


def check_comparable(fits: Sequence[Fit], argument: str) -> None:
    """Raise ValueError, naming the difference, unless the evidences of the fits are comparable.

    Warn about fits that do not record their data or likelihood. `argument` is the name of the
    user's argument, for messages.
    """
    first = fits[0]
    for fit in fits:
        if list(fit.fitted) != list(first.fitted):
            raise ValueError(
                f"{argument} holds {fit.label} with the classes {list(fit.fitted)}, but "
                f"{first.label} has the classes {list(first.fitted)}: give results with the same "
                "classes"
            )
        if None not in (fit.likelihood, first.likelihood) and fit.likelihood != first.likelihood:
            raise ValueError(
                f"{argument} holds {fit.label} with {fit.likelihood}, but {first.label} has "
                f"{first.likelihood}: their evidences do not compare"
            )
        for name, tree in fit.fitted.items():
            data = [_data_of(t) for t in (tree, first.fitted[name])]
            differs = _what_differs(*data) if data[0] is not None and data[1] is not None else ""
            if differs:
                of = f"class {name!r} has other training data" if name else "there are other data"
                raise ValueError(
                    f"{of} under {fit.label} than under {first.label} ({differs}): their evidences "
                    "do not compare"
                )
    _warn_of_unknown(fits, argument)


def _warn_of_unknown(fits: Sequence[Fit], argument: str) -> None:
    """Warn about fits that do not record their data or likelihood."""
    if len(fits) == 1:
        return
    for fit in fits:
        recorded = {
            "from which inflation data": all(_data_of(t) is not None for t in fit.fitted.values()),
            "with which likelihood": fit.likelihood is not None,
        }
        unknown = " and ".join(what for what, is_recorded in recorded.items() if not is_recorded)
        if unknown:
            warn_user(
                f"{argument}: {fit.label} does not say {unknown} it was made; evidences compare "
                "only for the same data and likelihood: check that all fits have the same"
            )


def _data_of(tree: xr.DataTree) -> xr.Dataset | None:
    """Return the inflation data of a result; None if the model has other data."""
    return inflation_data_of(tree) if holds_inflation_data(tree) else None


def _what_differs(one: xr.Dataset, other: xr.Dataset) -> str:
    """Describe how two sets of inflation data differ; return an empty string if they are equal."""
    if one.equals(other):
        return ""
    for dim, things in (("test", "tests"), ("obs", "points")):
        if one.sizes[dim] != other.sizes[dim]:
            return f"{one.sizes[dim]} {things}, not {other.sizes[dim]}"
    names = dict.fromkeys([*one.variables, *other.variables])
    equal = {
        n for n in names if n in one and n in other and one[n].variable.equals(other[n].variable)
    }
    return "in " + ", ".join(str(name) for name in names if name not in equal)
