"""What is stored of a sampled model: ArviZ's schema, in a DataTree that netCDF can hold.

ArviZ calls the schema InferenceData; its container is :class:`xarray.DataTree`. A sampled model
has the groups

``posterior``, ``unconstrained_posterior`` : (chain, draw)
    The variables, and the particles on the scale on which they were moved.
``sample_stats`` : (chain, stage)
    What each stage of tempering did; NaN where a chain had fewer stages.
``evidence`` : (chain)
    ``log_evidence`` and ``log_evidence_se`` of each chain, and what tells how far they can be
    trusted: the fraction of stages at which ``moves`` were not enough and of ``ancestors`` that are
    left; the Pareto shape of weights (``pareto_k``); the evidence by tempering from the prior alone
    (``forward``) and from the modes (``at_modes``, with the shape ``at_modes_k`` of its weights),
    and the ``log_masses`` of these. Where chains were integrated, in classes with variability,
    the ``method`` of each.
``diagnosis`` : (check)
    What :func:`diagnose_evidence` says.
"""

import json
from functools import cache
from importlib.metadata import version
from typing import Any, Protocol

import numpy as np
import pymc as pm
import xarray as xr
from arviz_base import dict_to_dataset
from pymc.backends.arviz import coords_and_dims_for_inferencedata

from pymc_hyperelastic.evidence.mixture import Array

_PACKAGES = ("pymc-hyperelastic", "pymc", "pytensor", "numpy")


class Study(Protocol):
    """What a model was made from."""

    def result_groups(self, model: pm.Model) -> dict[str, xr.Dataset]:
        """Groups that its result has besides those of sampling."""

    def result_attrs(self) -> dict[str, str]:
        """Attributes of its result."""


def sampling_tree(
    model: pm.Model,
    posterior: dict[str, Array],
    unconstrained: dict[str, Array],
    stats: list[dict[str, list]],
    settings: dict[str, Any],
    random_seed: Any,
    found: xr.Dataset | None = None,
) -> xr.DataTree:
    """Collect what sampling gave: arrays by (chain, draw), and one dict of stages a chain.

    `found` is what is known of the evidence beforehand. A model that says what it was made from,
    as :class:`Study` in ``model.study``, has that in its result too.
    """
    coords, dims = coords_and_dims_for_inferencedata(model)
    stages = max(len(chain["beta"]) for chain in stats)
    padded = {name: np.full((len(stats), stages), np.nan) for name in stats[0]}
    for name, values in padded.items():
        for row, chain in zip(values, stats, strict=True):
            row[: len(chain[name])] = chain[name]
    evidence = {
        "log_evidence": np.array([chain["log_marginal_likelihood"][-1] for chain in stats]),
        "log_evidence_se": np.sqrt([chain["log_evidence_variance"][-1] for chain in stats]),
    }
    if "moves" in stats[0]:
        still = [np.mean(np.array(chain["moves"]) >= settings["max_moves"]) for chain in stats]
        evidence["moves"] = np.array(still)
        alive = [chain["ancestors"][-1] for chain in stats]
        evidence["ancestors"] = np.array(alive) / settings["_n_draws"]
    if "pareto_k" in stats[0]:
        evidence["pareto_k"] = np.array([chain["pareto_k"][-1] for chain in stats])
    study: Study | None = getattr(model, "study", None)
    tree = xr.DataTree.from_dict(
        (study.result_groups(model) if study else {})
        | {
            "posterior": dict_to_dataset(posterior, coords=coords, dims=dims),
            "unconstrained_posterior": dict_to_dataset(unconstrained),
            "sample_stats": dict_to_dataset(padded, sample_dims=["chain", "stage"]),
            "evidence": dict_to_dataset(evidence, sample_dims=["chain"]).assign(found or {}),
        }
    )
    # A list of one does not come back from netCDF as a list.
    del tree["evidence"].attrs["sample_dims"]
    tree["sample_stats"].attrs.update(settings)
    tree.attrs["versions"] = _versions()
    tree.attrs["random_seed"] = json.dumps(random_seed)
    if study:
        tree.attrs |= study.result_attrs()
    return tree


@cache
def _versions() -> str:
    return json.dumps({name: version(name) for name in _PACKAGES})


def check_result(tree: Any, origin: str = "ph.sample_smc, or a class of ph.fit_classes") -> None:
    """Raise TypeError unless `tree` is a DataTree."""
    if not isinstance(tree, xr.DataTree):
        raise TypeError(f"expected the DataTree of {origin}, not {type(tree).__name__}")
