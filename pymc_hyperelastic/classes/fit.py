"""Fit classes of inflation experiments: the public function ``fit_classes``."""

import json
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any, Literal

import numpy as np
import xarray as xr

from pymc_hyperelastic.classes.interface import ClassKind, Data
from pymc_hyperelastic.classes.kinds import MISSING, kind_of_settings
from pymc_hyperelastic.data.labels import forbidden_character
from pymc_hyperelastic.evidence.diagnosis import warn_of_evidence
from pymc_hyperelastic.evidence.keeping import remembering, seed_kept
from pymc_hyperelastic.io.checksum import digests_of
from pymc_hyperelastic.mechanics.layers import Layer
from pymc_hyperelastic.mechanics.strain_energy import StrainEnergy
from pymc_hyperelastic.messages import PACKAGE
from pymc_hyperelastic.models.geometry import MeasuredValue
from pymc_hyperelastic.models.likelihoods import Likelihood
from pymc_hyperelastic.parallel import one_thread


@one_thread
def fit_classes(
    energy: StrainEnergy | Sequence[Layer],
    classes: Mapping[str, xr.Dataset],
    likelihood: Likelihood | Any,
    *,
    priors: dict[str, Any] | None = None,
    geometry: Mapping[str, MeasuredValue] | None = None,
    variability: Literal["none", "specimen"] = "none",
    experiment_effect: bool = False,
    reference_stress: float | None = 20.0,
    draws: int = 2000,
    chains: int = 4,
    random_seed: Any = None,
    progressbar: bool = True,
    store: str | Path | None = None,
) -> xr.DataTree:
    """Sample the posterior of each class from its training experiments.

    All models are built, and so all input is checked, before the first class is sampled.

    Without variability, as in the paper, all specimens of a class share one set of parameters. The
    posterior contracts to a point as the data grow, however different the specimens are. A new
    specimen that differs from them as they differ from each other is then classified with too much
    certainty. With ``variability="specimen"`` each specimen has its own parameters, drawn from a
    class distribution that is inferred, see :func:`~pymc_hyperelastic.population_model`. Each
    specimen is then sampled separately, and its parameters are integrated out.

    Parameters
    ----------
    energy : StrainEnergy or list of Layer
        The strain energy, such as ``ph.Ogden()``. With variability it may be the list of layers of
        the wall from the inside out, see :func:`~pymc_hyperelastic.population_model`.
    classes : dict of str to xarray.Dataset
        Training data of each class by its name.
    likelihood : Gaussian, SlopeAugmented, float or distribution
        The measured quantities and their errors, which all classes share, see
        :class:`~pymc_hyperelastic.Gaussian` and :class:`~pymc_hyperelastic.SlopeAugmented`. A
        number or a distribution alone is the standard deviation of a pressure, kPa.
    priors : dict of str to distribution, optional
        Priors of the material parameters, see :func:`pymc_hyperelastic.inflation_model`. With
        variability, priors of the class distribution, see
        :func:`~pymc_hyperelastic.population_model`.
    geometry : dict of str to MeasuredValue, optional
        Measures of the tube that have an error, which differs between specimens, see
        :func:`~pymc_hyperelastic.population_model`; only with variability.
    variability : {"none", "specimen"}
        Whether the specimens of a class have different parameters (``"specimen"``).
    experiment_effect, reference_stress
        See :func:`~pymc_hyperelastic.population_model`; only with variability.
    draws, chains, random_seed, progressbar
        See :func:`pymc_hyperelastic.sample_smc`. After an interrupt the classes already fitted are
        returned.
    store : str or Path, optional
        A folder in which intermediate results are kept: classes or, with variability, the draws of
        each specimen, which take most of the time. After an interrupt or a crash the same call
        continues from there.

    Returns
    -------
    xarray.DataTree
        One child for each class, with its posterior, evidence, training data and settings. The
        attribute ``likelihood_in_words`` describes the errors. If some classes could not be fitted,
        the attribute ``missing_classes`` gives their names and the reasons.

        With variability each child also has the group ``specimens``, the draws of its specimens.
        The variable ``method`` of ``specimens`` and ``evidence`` is the method of each integral:
        "importance", "tempering" or, for a class distribution with more than 24 unknowns, "bridge".
        The variable ``pareto_k`` is the Pareto shape of the importance weights, NaN for the other
        methods.

        Save it with ``classes.to_netcdf(path)``, and read it with ``xarray.open_datatree(path)``.

    Raises
    ------
    TypeError, ValueError
        If there are no classes, if data, priors or numbers are invalid, or if no class can be
        fitted.

    Warns
    -----
    UserWarning
        If an evidence is doubtful, if a specimen was given up because its sampling did not converge
        or its curves are inaccurate, or if a class cannot be fitted. The other classes are fitted.

    See Also
    --------
    classify, compare_classes

    Examples
    --------
    >>> import pymc_hyperelastic as ph
    >>> data = ph.load_dataset("simulated_sheep_aorta")
    >>> train = {name: ph.select(data, group=name, experiment=[1, 2]) for name in ("C1", "C2")}
    >>> settings = {"draws": 500, "random_seed": 1, "progressbar": False}

    Classes whose specimens share one material:

    >>> likelihood = ph.SlopeAugmented(sigma=5 * ph.mmHg, slope_weight=3.0)
    >>> pooled = ph.fit_classes(ph.Ogden(), train, likelihood, chains=2, **settings)
    >>> ph.save_result(pooled, "pooled.nc")

    Classes whose specimens differ:

    >>> likelihood = ph.Gaussian(pressure_sd=5 * ph.mmHg)
    >>> settings |= {"chains": 1, "variability": "specimen"}
    >>> hierarchical = ph.fit_classes(ph.Ogden(), train, likelihood, **settings)
    >>> ph.save_result(hierarchical, "hierarchical.nc")
    >>> list(hierarchical.children)
    ['C1', 'C2']
    """
    check_classes(classes)
    kind = kind_of_settings(
        variability,
        energy,
        likelihood,
        priors=priors,
        geometry=geometry,
        experiment_effect=experiment_effect,
        reference_stress=reference_stress,
    )
    seed = seed_kept(random_seed, store)
    remember = remembering(store, lambda: _manifest(kind, classes, seed, draws, chains))
    tree = xr.DataTree.from_dict({})
    failed: dict[str, Exception] = {}
    try:
        for name, fitted in kind.fit(classes, draws, chains, seed, progressbar, remember):
            if isinstance(fitted, Exception):
                failed[name] = fitted
                continue
            warn_of_evidence(fitted, f"class {name!r}: ")
            tree[name] = fitted
    except KeyboardInterrupt:
        # With a store the same call continues, so the interrupt is raised.
        if not tree.children or store is not None:
            raise
    missing = {
        name: str(failed.get(name, "interrupted")) for name in classes if name not in tree.children
    }
    for name, why in missing.items():
        message = f"class {name!r} is not fitted: {why}"
        if not tree.children:
            raise ValueError(message) from failed[name]
        # Keep the classes that were fitted.
        warnings.warn(message, skip_file_prefixes=(PACKAGE,))
    tree.attrs |= kind.settings().attrs() | {"random_seed": json.dumps(seed.entropy)}
    if missing:
        tree.attrs[MISSING] = json.dumps(missing)
    return tree


def _manifest(
    kind: ClassKind, classes: Data, seed: np.random.SeedSequence, draws: int, chains: int
) -> dict[str, Any]:
    """Return everything that fitted classes depend on, for the manifest of a store."""
    return {
        "work": "fit_classes",
        "settings": asdict(kind.settings()),
        "draws": draws,
        "chains": chains,
        "random_seed": seed.entropy,
        "data": digests_of(classes),
    }


def check_classes(classes: Any) -> None:
    """Raise unless `classes` is a dict of data by class name, with names that can be stored."""
    # A Dataset or DataTree is a Mapping too.
    if not isinstance(classes, Mapping) or isinstance(classes, xr.Dataset | xr.DataTree):
        raise TypeError(
            'classes must be a dict of training data by class name, such as {"C1": data}, not '
            f"{type(classes).__name__}"
        )
    if not classes:
        raise ValueError("classes is {}; expected a dict of training data by class name")
    for name in classes:
        if not isinstance(name, str) or not name or "/" in name or name in (".", ".."):
            raise ValueError(
                f"the name of a class is {name!r}; expected text that is not empty, has no '/', "
                "and is not '.' or '..'"
            )
        if found := forbidden_character(name):
            raise ValueError(
                f"the name of the class {name!r} has the character {found!a}, which cannot be "
                "written to a file: remove it"
            )
