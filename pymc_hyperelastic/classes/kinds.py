"""The kinds of classes that there are, and which of them is meant."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import xarray as xr

from pymc_hyperelastic.classes.interface import ClassKind
from pymc_hyperelastic.classes.pooled import Pooled
from pymc_hyperelastic.classes.variable import Variability
from pymc_hyperelastic.evidence.diagnosis import log_evidence
from pymc_hyperelastic.evidence.results import check_result
from pymc_hyperelastic.files.stored import read_text
from pymc_hyperelastic.mechanics.layers import Layer
from pymc_hyperelastic.mechanics.strain_energy import StrainEnergy
from pymc_hyperelastic.models.likelihoods import Likelihood
from pymc_hyperelastic.predictions.measured import warn_user

# Attributes that say of what material a class is.
_MATERIAL = (
    "strain_energy",
    "strain_energy_settings",
    "strain_energy_fingerprint",
    "layers",
    "thickness_priors",
)
_KINDS: dict[str, type[ClassKind]] = {kind.variability: kind for kind in (Pooled, Variability)}


def kind_of_settings(
    variability: Any,
    energy: StrainEnergy | Sequence[Layer],
    likelihood: Likelihood | Any,
    **settings: Any,
) -> ClassKind:
    """The kind of class that :func:`~pymc_hyperelastic.fit_classes` is asked for."""
    if variability not in _KINDS:
        names = " or ".join(map(repr, _KINDS))
        raise ValueError(f"variability must be {names}, not {variability!r}")
    return _KINDS[variability].of_settings(energy, likelihood, **settings)


def kind_of_classes(classes: xr.DataTree, *, whole: bool = True) -> ClassKind:
    """Kind and settings of fitted classes: they have to be one, or evidences do not compare.

    Who reads evidences alone does not need them `whole`, with draws and data.
    """
    check_result(classes, "ph.fit_classes")
    if not classes.children:
        raise ValueError("classes must be the result of ph.fit_classes; here are no classes")
    first = next(iter(classes.children.values()))
    variability = read_text(first, "variability", Pooled.variability)
    if variability not in _KINDS:
        raise ValueError(
            f"classes of the variability {variability!r} are not known here; known are "
            f"{list(_KINDS)}"
        )
    kind = _KINDS[variability]
    stored = {name for known in _KINDS.values() for name in known.common_attrs}
    for name, fitted in classes.children.items():
        if not stored & set(fitted.attrs):
            raise ValueError(
                f"classes must be the result of ph.fit_classes, all of it; {name!r} is no class"
            )
        for key in (*_MATERIAL, *kind.common_attrs):
            # All classes have the common ones, and only layers their own.
            missing = () if key in kind.common_attrs else (None,)
            mine, theirs = (read_text(tree, key, *missing) for tree in (fitted, first))
            if mine != theirs:
                raise ValueError(
                    f"class {name!r} was fitted with {key} {mine}, others with {theirs}: evidences "
                    "can only be compared under one strain energy, one prior and one likelihood"
                )
    found = kind.of_tree(first)
    for fitted in classes.children.values() if whole else ():
        found.check_stored(fitted)
    return found


def kind_of_variable_classes(classes: xr.DataTree, why: str) -> Variability:
    """The kind of classes whose specimens differ; ValueError, with the reason, for any other.

    Warns of a class without a sound evidence: its distribution is no sounder.
    """
    kind = kind_of_classes(classes)
    if not isinstance(kind, Variability):
        raise ValueError(f"{why}: fit the classes with variability='specimen'")
    for name, fitted in classes.children.items():
        if not np.isfinite(log_evidence(fitted).standard_error):
            law = read_text(fitted, "strain_energy", "layers")
            warn_user(
                f"the fit of class {name!r} ({law}) is not to be trusted, nor is what follows from "
                "it: see ph.diagnose_evidence"
            )
    return kind
