"""Find the kind of class for arguments of a user, or for fitted classes."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import xarray as xr

from pymc_hyperelastic.classes.hierarchical import HierarchicalClass
from pymc_hyperelastic.classes.interface import ClassKind
from pymc_hyperelastic.classes.pooled import PooledClass
from pymc_hyperelastic.evidence.diagnosis import log_evidence
from pymc_hyperelastic.evidence.results import check_result
from pymc_hyperelastic.evidence.stored import reading
from pymc_hyperelastic.mechanics.layers import Layer
from pymc_hyperelastic.mechanics.strain_energy import StrainEnergy
from pymc_hyperelastic.messages import warn_user
from pymc_hyperelastic.models.likelihoods import Likelihood
from pymc_hyperelastic.models.settings import ModelSettings, law_names_of, model_settings_of

#: Attribute of fitted classes: JSON of the reasons why others were not fitted, by class name.
MISSING = "missing_classes"
# Kinds of classes by their names in stored settings.
_KINDS: dict[str, type[PooledClass] | type[HierarchicalClass]] = {
    kind.stored_as: kind for kind in (PooledClass, HierarchicalClass)
}


def kind_of_settings(
    energy: StrainEnergy | Sequence[Layer],
    likelihood: Likelihood | Any,
    priors: Mapping[str, Any] | None,
    variability: Any,
) -> ClassKind:
    """Return the kind of class for arguments of :func:`~pymc_hyperelastic.fit_classes`."""
    if variability is None:
        return PooledClass.of_settings(energy, likelihood, priors)
    return HierarchicalClass.of_settings(energy, likelihood, priors, variability)


def kind_of_classes(classes: xr.DataTree, *, whole: bool = True) -> ClassKind:
    """Return the kind of fitted classes, with their settings.

    Parameters
    ----------
    classes : xarray.DataTree
        Fitted classes.
    whole : bool
        If True, check draws and data too. A caller that reads only evidences does not need them.

    Raises
    ------
    ValueError
        If the classes have different settings, so that their evidences cannot be compared, or if
        a class is damaged.
    """
    check_result(classes, "ph.fit_classes")
    if not classes.children:
        raise ValueError("classes must be the result of ph.fit_classes; it holds no classes")
    settings = {name: _settings_of(name, fitted) for name, fitted in classes.children.items()}
    first = next(iter(settings.values()))
    for name, of_class in settings.items():
        for key, value in vars(of_class).items():
            other = getattr(first, key)
            if value != other:
                raise ValueError(
                    f"class {name!r} was fitted with {key} {value}, others with {other}: evidences "
                    "can only be compared under one strain energy, one prior and one likelihood"
                )
    with reading(next(iter(classes.children.values())), ""):
        kind = _KINDS[first.variability].from_settings(first)
    for fitted in classes.children.values() if whole else ():
        kind.check_stored(fitted)
    return kind


def _settings_of(name: str, fitted: xr.DataTree) -> ModelSettings:
    settings = model_settings_of(fitted)
    if settings is None or settings.priors is None or settings.likelihood is None:
        raise ValueError(
            f"classes must be the whole result of ph.fit_classes; {name!r} is no class: its "
            "settings, priors or likelihood are missing"
        )
    if settings.variability not in _KINDS:
        raise ValueError(
            f"class {name!r} has the variability {settings.variability!r}; expected one of "
            f"{[*_KINDS]}"
        )
    return settings


def kind_of_variable_classes(classes: xr.DataTree, why: str) -> HierarchicalClass:
    """Return the kind of fitted classes with variability.

    Raises
    ------
    ValueError
        If the classes have no variability. The message begins with the reason, `why`.

    Warns
    -----
    UserWarning
        If the evidence of a class has no finite error: its distribution is then unreliable too.
    """
    kind = kind_of_classes(classes)
    if not isinstance(kind, HierarchicalClass):
        raise ValueError(f"{why}: fit the classes with variability='specimen'")
    for name, fitted in classes.children.items():
        if not np.isfinite(log_evidence(fitted).standard_error):
            laws = " in ".join(law_names_of(fitted))
            warn_user(
                f"the fit of class {name!r} ({laws}) is not to be trusted, and neither are results "
                "that are computed from it: see ph.diagnose_evidence"
            )
    return kind
