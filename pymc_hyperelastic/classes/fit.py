"""Fit classes of inflation experiments: the public function ``fit_classes``."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any, Literal

import numpy as np
import xarray as xr

from pymc_hyperelastic.classes.interface import Groups
from pymc_hyperelastic.classes.kinds import MISSING, kind_of_settings
from pymc_hyperelastic.classes.training import warn_of_copies
from pymc_hyperelastic.data.labels import forbidden_character
from pymc_hyperelastic.evidence.diagnosis import warn_of_evidence
from pymc_hyperelastic.evidence.keeping import remembering, seed_kept
from pymc_hyperelastic.io.checksum import digests_of
from pymc_hyperelastic.mechanics.layers import Layer
from pymc_hyperelastic.mechanics.strain_energy import StrainEnergy
from pymc_hyperelastic.messages import warn_user
from pymc_hyperelastic.models.likelihoods import Likelihood
from pymc_hyperelastic.models.variability import Variability
from pymc_hyperelastic.parallel import one_thread


@one_thread
def fit_classes(
    energy: StrainEnergy | Sequence[Layer],
    groups: Mapping[str, xr.Dataset],
    likelihood: Likelihood | Any,
    *,
    priors: dict[str, Any] | None = None,
    variability: Variability | Literal["specimen"] | None = None,
    draws: int = 2000,
    chains: int = 4,
    random_seed: Any = None,
    progressbar: bool = True,
    store: str | Path | None = None,
) -> xr.DataTree:
    """Sample the posterior of one class for each group of training experiments.

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
    groups : dict of str to xarray.Dataset
        Training data by the name of the group, which is also that of its class.
    likelihood : Gaussian, SlopeAugmented, float or distribution
        The measured quantities and their errors, which all classes share, see
        :class:`~pymc_hyperelastic.Gaussian` and :class:`~pymc_hyperelastic.SlopeAugmented`. A
        number or a distribution alone is the standard deviation of a pressure, kPa.
    priors : dict of str to distribution, optional
        Priors of the material parameters, see :func:`pymc_hyperelastic.inflation_model`. With
        variability, priors of the class distribution, and measures of the tube that have an error,
        see :func:`~pymc_hyperelastic.population_model`.
    variability : Variability or "specimen", optional
        How the specimens of a class differ; ``"specimen"`` is short for ``ph.Variability()``. By
        default all specimens of a class share one material.
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

        Save it with :func:`save_result`, and read it with :func:`open_result`.

    Raises
    ------
    TypeError, ValueError
        If there are no groups, if data, priors or numbers are invalid, or if no class can be
        fitted.

    Warns
    -----
    UserWarning
        If an evidence is doubtful, if a specimen was given up because its sampling did not converge
        or its curves are inaccurate, or if a class cannot be fitted. The other classes are fitted.
        If two specimens have the same measurements, as if one had been copied.

    See Also
    --------
    Variability, classify, compare_classes

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
    check_groups(groups)
    kind = kind_of_settings(energy, likelihood, priors, variability)
    seed = seed_kept(random_seed, store)
    # This checks the arguments, before a store is made: the store of a refused call would refuse
    # the corrected one. `remember` is called only when the first class is sampled.
    fits = kind.fit(groups, draws, chains, seed, progressbar, lambda *part: remember(*part))
    remember = remembering(
        store,
        lambda: manifest_of(
            "fit_classes",
            groups,
            seed,
            settings=asdict(kind.settings()),
            draws=draws,
            chains=chains,
        ),
    )
    tree = xr.DataTree.from_dict({})
    failed: dict[str, Exception] = {}
    try:
        for name, fitted in fits:
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
        name: str(failed.get(name, "interrupted")) for name in groups if name not in tree.children
    }
    for name, why in missing.items():
        message = f"class {name!r} is not fitted: {why}"
        if not tree.children:
            raise ValueError(message) from failed[name]
        # Keep the classes that were fitted.
        warn_user(message)
    warn_of_copies({name: groups[name] for name in tree.children})
    tree.attrs |= kind.settings().attrs() | {"random_seed": json.dumps(seed.entropy)}
    if missing:
        tree.attrs[MISSING] = json.dumps(missing)
    return tree


def manifest_of(
    work: str, groups: Groups, seed: np.random.SeedSequence, **settings: Any
) -> dict[str, Any]:
    """Return everything that the result of a function depends on, for the manifest of a store.

    `work` is the name of the function, and `settings` are all that change its numbers.
    """
    return {"work": work, **settings, "random_seed": seed.entropy, "data": digests_of(groups)}


def check_groups(groups: Any) -> None:
    """Raise unless `groups` is a dict of data by group name, with names that can be stored."""
    # A Dataset or DataTree is a Mapping too.
    if not isinstance(groups, Mapping) or isinstance(groups, xr.Dataset | xr.DataTree):
        raise TypeError(
            'groups must be a dict of training data by group name, such as {"C1": data}, not '
            f"{type(groups).__name__}"
        )
    if not groups:
        raise ValueError("groups is {}; expected a dict of training data by group name")
    for name in groups:
        if not isinstance(name, str) or not name or "/" in name or name in (".", ".."):
            raise ValueError(
                f"the name of a group is {name!r}; expected text that is not empty, has no '/', "
                "and is not '.' or '..'"
            )
        if found := forbidden_character(name):
            raise ValueError(
                f"the name of the group {name!r} has the character {found!a}, which cannot be "
                "written to a file: remove it"
            )
