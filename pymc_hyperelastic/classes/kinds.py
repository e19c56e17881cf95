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
from pymc_hyperelastic.evidence.stored import reading
from pymc_hyperelastic.mechanics.layers import Layer
from pymc_hyperelastic.mechanics.strain_energy import StrainEnergy
from pymc_hyperelastic.models.likelihoods import Likelihood
from pymc_hyperelastic.models.settings import ModelSettings, law_names_of, model_settings_of
from pymc_hyperelastic.predictions.measured import warn_user

#: Attribute of fitted classes: those that could not be fitted, and why, as JSON.
MISSING = "missing_classes"
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
    settings = {name: _settings_of(name, fitted) for name, fitted in classes.children.items()}
    first = next(iter(settings.values()))
    for name, own in settings.items():
        for key, mine in vars(own).items():
            theirs = getattr(first, key)
            if mine != theirs:
                raise ValueError(
                    f"class {name!r} was fitted with {key} {mine}, others with {theirs}: evidences "
                    "can only be compared under one strain energy, one prior and one likelihood"
                )
    with reading(next(iter(classes.children.values())), ""):
        found = _KINDS[first.variability].from_settings(first)
    for fitted in classes.children.values() if whole else ():
        found.check_stored(fitted)
    return found


def _settings_of(name: str, fitted: xr.DataTree) -> ModelSettings:
    settings = model_settings_of(fitted)
    if settings is None or settings.priors is None or settings.likelihood is None:
        raise ValueError(
            f"classes must be the result of ph.fit_classes, all of it; {name!r} is no class"
        )
    if settings.variability not in _KINDS:
        raise ValueError(
            f"class {name!r} has the variability {settings.variability!r}; known are {[*_KINDS]}"
        )
    return settings


def kind_of_variable_classes(classes: xr.DataTree, why: str) -> Variability:
    """The kind of classes whose specimens differ; ValueError, with the reason, for any other.

    Warns of a class without a sound evidence: its distribution is no sounder.
    """
    kind = kind_of_classes(classes)
    if not isinstance(kind, Variability):
        raise ValueError(f"{why}: fit the classes with variability='specimen'")
    for name, fitted in classes.children.items():
        if not np.isfinite(log_evidence(fitted).standard_error):
            laws = " in ".join(law_names_of(fitted))
            warn_user(
                f"the fit of class {name!r} ({laws}) is not to be trusted, nor is what follows "
                "from it: see ph.diagnose_evidence"
            )
    return kind
