"""What is stored, and under which names: ArviZ's schema, in a DataTree that netCDF can hold.

ArviZ calls the schema InferenceData; its container is :class:`xarray.DataTree`. A sampled model
has the groups

``posterior``, ``unconstrained_posterior`` : (chain, draw)
    The variables, and the particles on the scale on which they were moved.
``sample_stats`` : (chain, stage)
    What each stage of tempering did; NaN where a chain had fewer stages.
``evidence`` : (chain)
    ``log_evidence`` and ``log_evidence_se`` of each chain.
``observed_data``, ``constant_data`` : (obs), (test)
    The measured pressures, and the rest of the inflation data. Of a generative likelihood, what was
    measured by the names of the observed variables, and all of the data.

and attributes from which the model can be built again.
"""

import json
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cache
from importlib.metadata import version
from typing import Any

import numpy as np
import pymc as pm
import xarray as xr
from arviz_base import dict_to_dataset
from numpy.typing import NDArray
from pymc.backends.arviz import coords_and_dims_for_inferencedata

from pymc_hyperelastic.mechanics.layers import Layer
from pymc_hyperelastic.mechanics.strain_energy import StrainEnergy
from pymc_hyperelastic.models.priors import is_inferred, prior_from_record, prior_to_record

__all__ = [
    "Study",
    "check_result",
    "inflation_data_of",
    "model_settings_of",
    "sampling_tree",
    "strain_energy_attrs",
    "strain_energy_of",
]

Array = NDArray[np.float64]

_PACKAGES = ("pymc-hyperelastic", "pymc", "pytensor", "numpy")


@dataclass(frozen=True)
class Study:
    """What a model of inflation curves was made from."""

    energy: StrainEnergy | Sequence[Layer]
    data: xr.Dataset
    priors: dict[str, Any]
    noise: dict[str, Any]
    geometry: dict[str, Any] = field(default_factory=dict)
    error_in: str = "pressure"
    rising: bool = False
    likelihood: str = "paper"

    def groups(self) -> dict[str, xr.Dataset]:
        """The inflation data, divided as ArviZ does."""
        return {
            "observed_data": self.data[["pressure"]].reset_coords(drop=True),
            "constant_data": self.data.drop_vars("pressure"),
        }

    def attrs(self) -> dict[str, str]:
        """All that is needed to build the model again, as text.

        Raises
        ------
        ValueError
            If a prior, or a setting of the strain energy, cannot be written down.
        """
        if not isinstance(self.energy, StrainEnergy) or self.geometry:
            raise ValueError("layers, or a geometry that is inferred, do not make a class")
        if self.error_in != "pressure" or self.rising:
            raise ValueError("a class has its error in the pressure, and its prior as it is given")
        of_noise = {"sigma": "kPa", "slope_weight": "mm2", "force_sigma": "mN"}
        units = {name: of_noise[name] for name in self.noise}
        units |= {p.name: p.unit for p in self.energy.parameters}
        priors = {name: prior_to_record(name, prior) for name, prior in self.priors.items()}
        noise = {
            name: prior_to_record(name, value) if is_inferred(value) else float(value)
            for name, value in self.noise.items()
        }
        return strain_energy_attrs(self.energy) | {
            "units": json.dumps(units),
            "priors": json.dumps(priors),
            "noise": json.dumps(noise),
            **({} if self.likelihood == "paper" else {"likelihood": self.likelihood}),
        }


def sampling_tree(
    model: pm.Model,
    posterior: dict[str, Array],
    unconstrained: dict[str, Array],
    stats: list[dict[str, list]],
    settings: dict[str, Any],
    random_seed: Any,
) -> xr.DataTree:
    """Collect what sampling gave: arrays by (chain, draw), and one dict of stages a chain."""
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
    study = getattr(model, "study", None)
    tree = xr.DataTree.from_dict(
        (_current_groups(model, study) if study else {})
        | {
            "posterior": dict_to_dataset(posterior, coords=coords, dims=dims),
            "unconstrained_posterior": dict_to_dataset(unconstrained),
            "sample_stats": dict_to_dataset(padded, sample_dims=["chain", "stage"]),
            "evidence": dict_to_dataset(evidence, sample_dims=["chain"]),
        }
    )
    # A list of one does not come back from netCDF as a list.
    del tree["evidence"].attrs["sample_dims"]
    tree["sample_stats"].attrs.update(settings)
    tree.attrs["versions"] = _versions()
    tree.attrs["random_seed"] = json.dumps(random_seed)
    if study:
        try:
            tree.attrs |= study.attrs()
        except ValueError:
            # Sampling a model with a prior of one's own is fine; it cannot serve as a stored class,
            # which `fit_classes` checks before it samples.
            if isinstance(study.energy, StrainEnergy):
                tree.attrs["strain_energy"] = study.energy.name
    return tree


def _current_groups(model: pm.Model, study: Study) -> dict[str, xr.Dataset]:
    """The inflation data with what the observed variables hold now: it may have been replaced.

    PyMC's functions look for the names of variables among the observed data, and may replace that
    group; all data of the study are therefore in the other one.
    """
    if study.likelihood == "paper":
        return study.groups()
    data, observed = study.data.copy(), {}
    for name in ("pressure", "axial_force"):
        if f"{name}_data" in model.named_vars:
            values = model[f"{name}_data"].get_value()
            observed[f"measured_{name}"] = model.named_vars_to_dims[f"{name}_data"], values
            column = data[name].values.astype(float)
            column[np.isfinite(column)] = values
            data[name] = data[name].copy(data=column)
    return {"observed_data": xr.Dataset(observed), "constant_data": data}


@cache
def _versions() -> str:
    return json.dumps({name: version(name) for name in _PACKAGES})


def check_result(tree: Any, origin: str = "ph.sample_smc, or a class of ph.fit_classes") -> None:
    """Raise TypeError unless `tree` is a DataTree."""
    if not isinstance(tree, xr.DataTree):
        raise TypeError(f"expected the DataTree of {origin}, not {type(tree).__name__}")


def inflation_data_of(tree: xr.DataTree) -> xr.Dataset:
    """Inflation data with which the model was fitted."""
    data = tree["constant_data"].to_dataset()
    if "pressure" in data:
        return data
    return xr.merge([tree["observed_data"].to_dataset(), data])


def model_settings_of(tree: xr.DataTree) -> dict[str, Any]:
    """Settings of :func:`pymc_hyperelastic.inflation_model`, but for the data.

    Raises
    ------
    ValueError
        If the tree is not a fitted class, or its strain energy is not defined here.
    """
    if "priors" not in tree.attrs:
        raise ValueError("this result does not say from which model it came; see ph.fit_classes")
    noise = {
        name: value if isinstance(value, float) else prior_from_record(value)
        for name, value in json.loads(tree.attrs["noise"]).items()
    }
    priors = {
        name: prior_from_record(record) for name, record in json.loads(tree.attrs["priors"]).items()
    }
    settings = {"energy": strain_energy_of(tree), "priors": priors, **noise}
    if "likelihood" in tree.attrs:
        settings["likelihood"] = tree.attrs["likelihood"]
    return settings


def strain_energy_attrs(energy: StrainEnergy) -> dict[str, str]:
    """Strain energy as text, from which :func:`strain_energy_of` makes it again.

    Raises
    ------
    ValueError
        If a setting of it cannot be written down.
    """
    try:
        settings = json.dumps(vars(energy))
    except TypeError as error:
        raise ValueError(f"{energy!r} cannot be stored with results: {error}") from None
    return {"strain_energy": energy.name, "strain_energy_settings": settings}


def strain_energy_of(tree: xr.DataTree) -> StrainEnergy:
    """Strain energy of a result that names it.

    Raises
    ------
    ValueError
        If it is not named, or not defined here.
    """
    if "strain_energy" not in tree.attrs:
        raise ValueError("the result does not name its strain energy: give it as energy=ph.Ogden()")
    settings = json.loads(tree.attrs.get("strain_energy_settings", "{}"))
    return StrainEnergy.from_name(tree.attrs["strain_energy"], **settings)
