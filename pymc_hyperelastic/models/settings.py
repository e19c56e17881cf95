"""The model of a result: one record of its settings, and its inflation data.

The record is JSON in the attribute ``model_settings``. It is checked when a result is opened, or
when a function reads it. The inflation data are in the group ``constant_data``, measured pressures
perhaps in ``observed_data``.
"""

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
import xarray as xr
from pytensor.tensor.variable import TensorVariable

from pymc_hyperelastic.data.inflation import check_data
from pymc_hyperelastic.evidence.stored import (
    from_json,
    is_said,
    parsed_json,
    read_group,
    reading,
    source_of,
)
from pymc_hyperelastic.mechanics.layers import Layer, check_energy, check_layers
from pymc_hyperelastic.mechanics.strain_energy import StrainEnergy
from pymc_hyperelastic.messages import shown
from pymc_hyperelastic.models.geometry import MeasuredValue, check_geometry
from pymc_hyperelastic.models.likelihoods import Likelihood
from pymc_hyperelastic.models.priors import (
    complete_layers,
    is_inferred,
    prior_to_record,
    priors_from_records,
)

#: Attribute of a result that holds the record.
SETTINGS = "model_settings"
# Version of the record. A change of its fields needs another one.
_FORMAT = 2
#: Version that wrote results without this record.
OLDER_VERSION = "pymc_hyperelastic 0.1"
# Attributes of results that were written before there was a record.
_OLDER_ATTRS = {"strain_energy_fingerprint", "variability_settings", "layers", "priors"}


class NamedLayer(NamedTuple):
    """A material with the names of its variables in a posterior, or their numbers."""

    energy: StrainEnergy
    values: dict[str, Any]
    """Names of variables, or numbers, of the parameters, and of the thickness of a layer."""

    @property
    def units(self) -> dict[str, str]:
        """Units of the variables, by name."""
        units = {p.name: p.unit for p in self.energy.parameters} | {"thickness": "mm"}
        return {v: units[name] for name, v in self.values.items() if isinstance(v, str)}


@dataclass(frozen=True)
class LayerSettings:
    """A material, or a layer of a wall."""

    strain_energy: str
    settings: dict[str, Any]
    """Arguments of the strain energy."""
    fingerprint: list[float]
    """Stresses by which another formula of the same name is noticed, kPa."""
    values: dict[str, str | float | list[float]]
    """See :class:`NamedLayer`."""

    def named(self) -> NamedLayer:
        """Return the layer with its strain energy; ValueError if its stresses are others now."""
        energy = StrainEnergy.from_name(self.strain_energy, **self.settings)
        then, now = self.fingerprint, energy.fingerprint
        # Fingerprints have six digits.
        if len(then) != len(now) or not np.allclose(then, now, atol=0, equal_nan=True):
            raise ValueError(
                f"it was computed with a strain energy {energy.name!r} of another formula than the "
                f"{energy.name!r} that is defined now ({type(energy).__module__}): at the same "
                f"stretches its stresses are {shown(then)} kPa, not {shown([*now])} "
                "kPa. Define the class as it was, or compute the result again"
            )
        needed = {*energy.parameter_names, *({"thickness"} & self.values.keys())}
        if set(self.values) != needed:
            raise ValueError(
                f"a layer of {energy.name} has the values {shown(self.values)}; expected {needed}"
            )
        sizes = {p.name: p.size for p in energy.parameters} | {"thickness": None}
        for name, value in self.values.items():
            size = len(value) if isinstance(value, list) else None
            if not isinstance(value, str) and size != sizes[name]:
                raise ValueError(
                    f"{name} of a layer has the values {shown(value)}; expected {sizes[name]} "
                    "numbers in a list, or without a size one number"
                )
        return NamedLayer(energy, self.values)


@dataclass(frozen=True)
class ModelSettings:
    """All that is needed to build a model again, besides its data, in types of JSON."""

    layers: list[LayerSettings]
    """From the inside out. A tube of one material is one layer without a thickness."""
    priors: dict[str, list[Any]] | None = None
    """Records of distributions. None if only the wall could be stored."""
    likelihood: dict[str, Any] | None = None
    """None if each specimen has its own, or it could not be stored."""
    thickness_priors: dict[str, list[Any]] = field(default_factory=dict)
    variability: str = "none"
    experiment_effect: bool = False
    reference_stress: float | None = None
    """Stress at which specimens that differ are compared, kPa."""
    geometry_sd: dict[str, float | None] = field(default_factory=dict)
    """Standard errors of the measures of tubes; None if the data state them."""

    @classmethod
    def of(
        cls,
        wall: StrainEnergy | Sequence[Layer],
        priors: Mapping[str, TensorVariable] | None = None,
        likelihood: Likelihood | None = None,
        geometry: Mapping[str, MeasuredValue] | None = None,
        **others: Any,
    ) -> "ModelSettings":
        """Return the record of a model; ValueError if something cannot be stored."""
        layers = [_layer_settings(layer) for layer in named_layers(wall)]
        thickness = {}
        if priors is not None and not isinstance(wall, StrainEnergy):
            _, distributions = complete_layers(wall)
            names = [layer.values["thickness"] for layer in layers]
            thickness = {n: prior_to_record(n, p) for n, p in distributions.items() if n in names}
        return cls(
            layers,
            None if priors is None else {n: prior_to_record(n, p) for n, p in priors.items()},
            likelihood.to_record() if likelihood else None,
            thickness,
            geometry_sd={name: measure.sd for name, measure in (geometry or {}).items()},
            **others,
        )

    def __post_init__(self) -> None:
        """Refuse values that no model has."""
        if not self.layers:
            raise ValueError("it holds no layers")
        values = [layer.values for layer in self.layers]
        unlayered = len(values) == 1 and all(name == value for name, value in values[0].items())
        if not (all("thickness" in v for v in values) if self.layered else unlayered):
            raise ValueError(
                f"its layers have the values {shown(values)}; expected a thickness in each, or one "
                "material with the names of its parameters"
            )
        if self.reference_stress is not None and not 0 < self.reference_stress < np.inf:
            stress = self.reference_stress
            raise ValueError(f"its reference_stress is {stress}; expected a number of kPa, or null")

    @property
    def layered(self) -> bool:
        """True if the wall was given as layers."""
        return "thickness" in self.layers[0].values

    @property
    def laws(self) -> list[str]:
        """Names of the strain energies, from the inside out."""
        return [layer.strain_energy for layer in self.layers]

    def make_priors(self) -> dict[str, TensorVariable]:
        """Return the distributions of the priors."""
        return priors_from_records(self.priors or {})

    def make_likelihood(self) -> Likelihood | None:
        """Return the likelihood, if there is one."""
        return None if self.likelihood is None else Likelihood.from_record(self.likelihood)

    def make_geometry(self) -> dict[str, MeasuredValue]:
        """Return the measures of a tube that have an error."""
        return check_geometry({name: MeasuredValue(sd) for name, sd in self.geometry_sd.items()})

    def make_wall(self) -> StrainEnergy | list[Layer]:
        """Return the material, or the layers as the user stated them."""
        named = [layer.named() for layer in self.layers]
        if not self.layered:
            return named[0].energy
        # One distribution in two layers is one thickness of both.
        priors = priors_from_records(self.thickness_priors)
        stated = []
        for energy, values in named:
            thickness = values["thickness"]
            if isinstance(thickness, str) and thickness not in priors:
                raise ValueError(f"its thickness_priors lack {thickness!r}")
            numbers = {n: v for n, v in values.items() if not isinstance(v, str)}
            numbers["thickness"] = priors.get(thickness, thickness)
            stated.append(Layer(energy, **numbers))
        return stated

    def attrs(self) -> dict[str, str]:
        """Return the record as an attribute of a result, and others that users and plots read."""
        units: dict[str, str] = {}
        for layer in map(LayerSettings.named, self.layers):
            units |= layer.units
        attrs = {SETTINGS: json.dumps({"format": _FORMAT} | asdict(self))}
        if not self.layered:
            attrs["strain_energy"] = self.laws[0]
        if likelihood := self.make_likelihood():
            units |= likelihood.units
            attrs["likelihood_in_words"] = likelihood.in_words
        return attrs | {"units": json.dumps(units)}


def _layer_settings(layer: NamedLayer) -> LayerSettings:
    energy = layer.energy
    try:
        settings = json.loads(json.dumps(vars(energy)))
    except TypeError as error:
        raise ValueError(f"{energy!r} cannot be stored with results: {error}") from None
    return LayerSettings(energy.name, settings, [*energy.fingerprint], layer.values)


def named_layers(wall: StrainEnergy | Sequence[Layer]) -> list[NamedLayer]:
    """Return the layers of a wall, from the inside out, with the names of their variables."""
    if not isinstance(wall, Sequence):
        check_energy(wall)
        return [NamedLayer(wall, {name: name for name in wall.parameter_names})]
    check_layers(wall)
    layers, distributions = complete_layers(wall)
    names = {prior: name for name, prior in distributions.items()}

    def name_or_number(value: Any) -> Any:
        return names[value] if is_inferred(value) else np.asarray(value, float).tolist()

    named = []
    for layer in layers:
        values = {"thickness": layer.thickness, **layer.parameters}
        named.append(NamedLayer(layer.energy, {k: name_or_number(v) for k, v in values.items()}))
    return named


@lru_cache(maxsize=64)  # the classes of some studies
def _decoded(text: str) -> ModelSettings:
    """Return the record that a text holds; ValueError if it is unsound."""
    place = f"its {SETTINGS}"
    record = from_json(dict[str, Any], parsed_json(text, place), place)
    if (version := record.pop("format", None)) != _FORMAT:
        raise ValueError(f"{place} have the format {shown(version)}; expected {_FORMAT}")
    settings = from_json(ModelSettings, record, place)
    for make in (settings.make_priors, settings.make_likelihood, settings.make_geometry):
        make()
    priors_from_records(settings.thickness_priors)
    return settings


def model_settings_of(tree: xr.DataTree) -> ModelSettings | None:
    """Return the settings of the model of a result; None if the result holds none.

    ValueError names the damaged entry, or the version that an older result needs.
    """
    if SETTINGS not in tree.attrs:
        if not _OLDER_ATTRS & set(tree.attrs):
            return None
        raise ValueError(
            f"the result{source_of(tree)} was written in an older format: it needs {OLDER_VERSION}"
        )
    with reading(tree):
        return _decoded(from_json(str, tree.attrs[SETTINGS], f"its {SETTINGS}"))


def wall_of(tree: xr.DataTree) -> list[NamedLayer]:
    """Return the layers of a result that states its material, or the name of its material."""
    settings, name = model_settings_of(tree), tree.attrs.get("strain_energy")
    if settings is None and name is None:
        raise ValueError(
            "the result does not name its strain energy: give it as energy=ph.Ogden(), or the "
            "layers of the model as energy=[ph.Layer(...), ...]"
        )
    # A law of the user's own that is not defined here is no damage.
    with reading(tree, ""):
        if settings is None:
            return named_layers(StrainEnergy.from_name(name))
        return [layer.named() for layer in settings.layers]


def law_names_of(tree: xr.DataTree) -> list[str]:
    """Return the names of the laws of a result, from the inside out; empty if it states none."""
    if settings := model_settings_of(tree):
        return settings.laws
    name = tree.attrs.get("strain_energy")
    return [name] if isinstance(name, str) and name else []


def has_layers(tree: xr.DataTree) -> bool:
    """Return True if the wall of a result was given as layers."""
    settings = model_settings_of(tree)
    return settings is not None and settings.layered


def inflation_data_of(tree: xr.DataTree) -> xr.Dataset:
    """Return the inflation data of a fit; ValueError if they are not sound."""
    data = read_group(tree, "constant_data")
    with reading(tree):
        if not {"pressure", "stress_x"} & set(data) and "observed_data" in tree.children:
            data = xr.merge([tree["observed_data"].to_dataset(), data])
        check_data(data)
    return data


def holds_inflation_data(tree: xr.DataTree) -> bool:
    """Return True if a result holds inflation data, and is no result of another model."""
    if "constant_data" not in tree.children:
        return False
    # A model of a user's own may have one of these; data that lack one are damaged.
    names = {"inner_radius", "outer_radius", "stretch_x", "specimen", "experiment"}
    return len(names & set(tree["constant_data"].to_dataset().variables)) > 1


def origin_of(classes: xr.DataTree) -> dict[str, Any]:
    """Return the title of the data of classes, and 1 if they are simulated, as attributes."""
    attrs = [read_group(fitted, "constant_data").attrs for fitted in classes.children.values()]
    titles = dict.fromkeys(str(a["title"]) for a in attrs if is_said(a.get("title")))
    simulated = int(any(is_said(a.get("simulated")) for a in attrs))
    return {"title": ", ".join(titles), "simulated": simulated}
