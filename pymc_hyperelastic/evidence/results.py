"""Store a sampled model in ArviZ's schema, in a DataTree that netCDF can hold.

ArviZ calls the schema InferenceData; its container is :class:`xarray.DataTree`. A sampled model
has the groups

``posterior``, ``unconstrained_posterior`` : (chain, draw)
    The variables, and the particles on the scale on which they were moved.
``sample_stats`` : (chain, stage)
    What each stage of tempering did; NaN where a chain had fewer stages.
``evidence``
    Of each chain: ``log_evidence`` and ``log_evidence_se``; ``stages_capped``, the fraction of
    stages whose particles had not forgotten their places; ``ancestor_fraction``, the fraction of
    first particles that have descendants; ``pareto_k``, the Pareto shape of weights; for a class
    with variability the ``method``. Of all chains: ``forward``, the evidence by tempering from the
    prior alone, and ``forward_beta``, 1 unless that was given up; ``at_modes``, the evidence from
    the modes, with the shape ``at_modes_k`` of its weights, and the ``log_masses`` of the modes;
    ``at_bounds``, the log evidence of what lies at bounds of priors; ``unmet``, the share of other
    particles that the reference lacks; and ``at_limit``, the share of the posterior within 1 % of
    each limit of a prior. Models of curves add ``curve_error``, the largest error of the
    posterior's curves, relative to the largest value of each; ``chi_square``, the squared residuals
    of the best curve in variances of the noise; the number of ``points``, by test and signal; and
    those of material ``parameters`` and of ``measured_values``.
``diagnosis`` : (check)
    What :func:`diagnose_evidence` says.
``observed_data``, ``constant_data``
    The observed and constant data of the model, as PyMC's samplers store them; a model with a study
    may store more.
"""

import json
from collections.abc import Mapping
from functools import cache
from importlib.metadata import version
from typing import Any, Protocol

import numpy as np
import pandas as pd
import pymc as pm
import xarray as xr
from arviz_base import dict_to_dataset
from pymc.backends.arviz import (
    coords_and_dims_for_inferencedata,
    find_constants,
    find_observations,
)

from pymc_hyperelastic.evidence.limits import mass_at_limits
from pymc_hyperelastic.evidence.mixture import Array

_PACKAGES = ("pymc-hyperelastic", "pymc", "pytensor", "numpy")


class Study(Protocol):
    """The data and settings from which a model was made."""

    def result_groups(self, model: pm.Model) -> dict[str, xr.Dataset]:
        """Groups that its result has besides those of sampling."""

    @property
    def data(self) -> xr.Dataset:
        """The data from which the model was made."""

    @property
    def physical_ends(self) -> dict[str, tuple[float, float]]:
        """Ends of the physical range of unknowns by name, as far as they have two."""

    def result_attrs(self, model: pm.Model) -> dict[str, str]:
        """Attributes of its result."""

    def diagnostics(
        self, model: pm.Model, posterior: Mapping[str, Array], particles: Array
    ) -> xr.Dataset:
        """Return variables of the group ``evidence``, for the checks that are registered."""


def attach_study(model: pm.Model, study: Study) -> None:
    """Attach a study to a model, as ``model.study``, and to copies of the model.

    PyMC's ``observe``, ``do`` and ``copy`` make a new model, of clones of the variables: these
    carry a tag. For a deterministic its input is cloned.
    """
    model.study = study
    shown = [v.owner.inputs[0] for v in model.deterministics]
    for variable in [*model.named_vars.values(), *shown]:
        variable.tag.study = study


def study_of(model: pm.Model) -> Study | None:
    """Return the study of a model, or of the model of which it is a copy; None without one."""
    tags = (getattr(v.tag, "study", None) for v in model.named_vars.values())
    return next((study for study in tags if study is not None), None)


def data_groups(model: pm.Model) -> dict[str, xr.Dataset]:
    """Observed and constant data of a model, as PyMC's samplers store them."""
    coords, dims = coords_and_dims_for_inferencedata(model)
    data = {"observed_data": find_observations(model), "constant_data": find_constants(model)}
    return {
        group: dict_to_dataset(values, coords=coords, dims=dims, sample_dims=[])
        for group, values in data.items()
        if values
    }


def sampling_tree(
    model: pm.Model,
    posterior: dict[str, Array],
    unconstrained: dict[str, Array],
    stats: list[list[dict[str, float]]],
    settings: dict[str, Any],
    random_seed: Any,
    found: xr.Dataset | None = None,
) -> xr.DataTree:
    """Collect what sampling gave: arrays by (chain, draw), and statistics of each chain's stages.

    `found` holds further variables of the group ``evidence``. The groups of the model's study, see
    :func:`attach_study`, are added.
    """
    coords, dims = coords_and_dims_for_inferencedata(model)
    stages = range(max(map(len, stats)))
    tables = [pd.DataFrame(of_chain, dtype=float) for of_chain in stats]
    padded = {n: np.stack([table.reindex(stages)[n] for table in tables]) for n in tables[0]}
    last = {n: np.array([table[n].iloc[-1] for table in tables]) for n in tables[0]}
    evidence = {
        "log_evidence": last["log_marginal_likelihood"],
        "log_evidence_se": np.sqrt(last["log_evidence_variance"]),
    }
    if "capped" in last:
        evidence["stages_capped"] = np.nanmean(padded["capped"], axis=1)
        evidence["ancestor_fraction"] = last["ancestors"] / settings["_n_draws"]
    if "pareto_k" in last:
        evidence["pareto_k"] = last["pareto_k"]
    study = study_of(model)
    limits = mass_at_limits(model, unconstrained, study.physical_ends if study else None)
    found = (xr.Dataset() if found is None else found).merge(limits)
    tree = xr.DataTree.from_dict(
        (study.result_groups(model) if study else data_groups(model))
        | {
            "posterior": dict_to_dataset(posterior, coords=coords, dims=dims),
            "unconstrained_posterior": dict_to_dataset(unconstrained),
            "sample_stats": dict_to_dataset(padded, sample_dims=["chain", "stage"]),
            "evidence": xr.Dataset(
                {name: ("chain", values) for name, values in evidence.items()},
                {"chain": range(len(stats))},
            ).merge(found),
        }
    )
    tree["sample_stats"].attrs.update(settings)
    tree.attrs["versions"] = _versions()
    tree.attrs["random_seed"] = json.dumps(random_seed)
    tree.attrs |= study.result_attrs(model) if study else {}
    return tree


@cache
def _versions() -> str:
    """Return the versions of the packages that compute results, as JSON."""
    return json.dumps({name: version(name) for name in _PACKAGES})


def thinned_draws(tree: xr.DataTree) -> xr.DataTree:
    """Return a result with at most 1000 draws of its posterior: more change no line of a figure."""
    posterior = tree["posterior"].to_dataset()
    step = -(-posterior.sizes["chain"] * posterior.sizes["draw"] // 1000)
    thinned = tree.copy()
    thinned["posterior"] = xr.DataTree(posterior.isel(draw=slice(None, None, step)))
    return thinned


def check_result(tree: Any, origin: str = "ph.sample_smc, or a class of ph.fit_classes") -> None:
    """Raise TypeError unless `tree` is a DataTree."""
    if not isinstance(tree, xr.DataTree):
        raise TypeError(f"expected the DataTree of {origin}, not {type(tree).__name__}")
