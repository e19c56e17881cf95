"""Averages over strain energies, each by its probability."""

from collections.abc import Sequence

import numpy as np
import xarray as xr
from scipy.special import logsumexp, softmax

from pymc_hyperelastic.classes.interface import (
    ClassKind,
    Prediction,
    training_evidence,
)
from pymc_hyperelastic.classes.training import same_training_data
from pymc_hyperelastic.evidence.estimate import Estimate
from pymc_hyperelastic.mechanics.strain_energy import StrainEnergy


def weights_of_laws(trees: Sequence[xr.DataTree], kinds: Sequence[ClassKind]) -> xr.DataArray:
    """Posterior probability of each strain energy, equal beforehand."""
    first = trees[0]
    labels = labels_of([kind.energy for kind in kinds])
    noises = [
        kind.noise_in_words(next(iter(tree.children.values())))
        for kind, tree in zip(kinds, trees, strict=True)
    ]
    evidences = []
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
        evidences.append(training_evidence(tree.children))
    if len(trees) == 1:
        evidences = [0.0]
    return xr.DataArray(softmax(evidences), {"strain_energy": labels}, "strain_energy")


def labels_of(laws: Sequence[StrainEnergy]) -> list[str]:
    """Names of strain energies, with their settings where names are alike."""
    names = [law.name for law in laws]
    return [repr(law) if names.count(law.name) > 1 else law.name for law in laws]


def average(laws: xr.DataArray, predictions: Sequence[Prediction]) -> Prediction:
    """Prediction of several laws together, each by its probability."""
    if len(predictions) == 1:
        return predictions[0]
    with np.errstate(divide="ignore"):
        terms = np.log(laws.values) + [p.log_evidence.value for p in predictions]
    share = softmax(terms)
    errors = [(p.log_evidence.standard_error, p.own_error) for p in predictions]
    error, own = np.sqrt(np.square(share) @ np.square(errors))
    return Prediction(
        Estimate(float(logsumexp(terms)), float(error)),
        float(own),
        "average over strain energies",
        float(np.fmax.reduce([p.pareto_k for p in predictions])),
        *(laws.values @ [(p.p_value, p.p_typical, p.p_fit) for p in predictions]).tolist(),
    )
