"""Read and write what a result holds of its model: strain energy, priors, likelihood and data.

The inflation data are in ``constant_data``, measured pressures perhaps in ``observed_data``.
"""

import json
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import xarray as xr

from pymc_hyperelastic.data.inflation import check_inflation_data
from pymc_hyperelastic.files.stored import (
    damaged,
    is_number,
    is_said,
    read_dict,
    read_group,
    read_json,
    read_numbers,
    read_text,
    reading,
    shown,
    source_of,
)
from pymc_hyperelastic.mechanics.layers import Layer, check_energy, check_layers
from pymc_hyperelastic.mechanics.strain_energy import Parameter, StrainEnergy
from pymc_hyperelastic.models.likelihoods import Likelihood
from pymc_hyperelastic.models.priors import (
    complete_layers,
    is_inferred,
    prior_to_record,
    priors_from_records,
)


def inflation_data_of(tree: xr.DataTree) -> xr.Dataset:
    """Inflation data with which the model was fitted; ValueError if they are not sound."""
    data = read_group(tree, "constant_data")
    with reading(tree):
        if "pressure" not in data and "observed_data" in tree.children:
            data = xr.merge([tree["observed_data"].to_dataset(), data])
        check_inflation_data(data)
    return data


def holds_inflation_data(tree: xr.DataTree) -> bool:
    """Return True if a result holds inflation data, and is no result of another model."""
    if "constant_data" not in tree.children:
        return False
    # A model of a user's own may have one of these; data that lack one are damaged.
    names = {"inner_radius", "outer_radius", "specimen", "experiment"}
    return len(names & set(tree["constant_data"].to_dataset().variables)) > 1


def origin_of(classes: xr.DataTree) -> dict[str, Any]:
    """Return the title of the data of classes, and 1 if they are simulated, as attributes."""
    attrs = [read_group(fitted, "constant_data").attrs for fitted in classes.children.values()]
    titles = dict.fromkeys(str(a["title"]) for a in attrs if is_said(a.get("title")))
    simulated = int(any(is_said(a.get("simulated")) for a in attrs))
    return {"title": ", ".join(titles), "simulated": simulated}


def model_settings_of(tree: xr.DataTree) -> dict[str, Any]:
    """Return the arguments of :func:`pymc_hyperelastic.inflation_model` except the data."""
    if "priors" not in tree.attrs:
        raise ValueError("this result does not say from which model it came; see ph.fit_classes")
    likelihood = likelihood_of(tree)
    if likelihood is None:
        raise damaged(tree, "its attribute 'likelihood' is missing")
    energy = strain_energy_of(tree)
    with reading(tree):
        priors = priors_from_records(read_dict(tree, "priors"))
    return {"energy": energy, "likelihood": likelihood, "priors": priors}


def values_of_parameter(tree: xr.DataTree, parameter: Parameter) -> xr.DataArray:
    """Return the draws of all entries of a material parameter; ValueError if there are none."""
    name, size = parameter.name, parameter.size
    values = read_numbers(tree, "posterior", name, None)
    entries = [values.sizes[dim] for dim in values.dims if dim not in ("chain", "draw")]
    if not {"chain", "draw"} <= set(values.dims) or entries != ([] if size is None else [size]):
        expected = "chain, draw" + ("" if size is None else f" and {size} entries")
        found = f"{name!r} of 'posterior' has the dimensions {dict(values.sizes)}"
        raise damaged(tree, f"{found}; expected {expected}")
    return values


def likelihood_attrs(likelihood: Likelihood) -> dict[str, str]:
    """Return a likelihood as text, from which :func:`likelihood_of` makes it again."""
    return {
        "likelihood": json.dumps(likelihood.to_record()),
        "likelihood_in_words": likelihood.in_words,
    }


def likelihood_of(tree: xr.DataTree) -> Likelihood | None:
    """Return the likelihood that a result names; None if it names none."""
    if "likelihood" not in tree.attrs:
        return None
    with reading(tree):
        return Likelihood.from_record(read_json(tree, "likelihood", {}))


def strain_energy_attrs(energy: StrainEnergy) -> dict[str, str]:
    """Strain energy as text, from which :func:`strain_energy_of` makes it again."""
    try:
        settings = json.dumps(vars(energy))
    except TypeError as error:
        raise ValueError(f"{energy!r} cannot be stored with results: {error}") from None
    return {
        "strain_energy": energy.name,
        "strain_energy_settings": settings,
        "strain_energy_fingerprint": json.dumps(energy.fingerprint),
    }


def wall_attrs(wall: StrainEnergy | Sequence[Layer]) -> dict[str, str]:
    """A material or layers as text, from which :func:`stated_wall_of` makes them again."""
    if isinstance(wall, StrainEnergy):
        return strain_energy_attrs(wall)
    layers, (_, distributions) = named_layers(wall), complete_layers(wall)
    names = {layer.values["thickness"] for layer in layers} & distributions.keys()
    priors = {name: prior_to_record(name, distributions[name]) for name in sorted(names)}
    return layers_attrs(layers) | {"thickness_priors": json.dumps(priors)}


def stated_wall_of(tree: xr.DataTree) -> StrainEnergy | list[Layer]:
    """Return the material of a class, or its layers as the user stated them."""
    if "thickness_priors" not in tree.attrs:
        return strain_energy_of(tree)
    layers = wall_of(tree)
    with reading(tree):
        # One distribution in two layers is one thickness of both.
        priors = priors_from_records(read_dict(tree, "thickness_priors"))
        stated = []
        for energy, values in layers:
            thickness = values["thickness"]
            if isinstance(thickness, str) and thickness not in priors:
                raise damaged(tree, f"its attribute 'thickness_priors' lacks {thickness!r}")
            numbers = {n: v for n, v in values.items() if not isinstance(v, str)}
            numbers["thickness"] = priors.get(thickness, thickness)
            stated.append(Layer(energy, **numbers))
    return stated


def strain_energy_of(tree: xr.DataTree) -> StrainEnergy:
    """Strain energy of a result that names it; ValueError if its stresses are others now."""
    if "strain_energy" not in tree.attrs:
        raise ValueError(
            "the result does not name its strain energy: give it as energy=ph.Ogden(), or the "
            "layers of the model as energy=[ph.Layer(...), ...]"
        )
    name, settings = read_text(tree, "strain_energy"), read_json(tree, "strain_energy_settings", {})
    fingerprint = read_json(tree, "strain_energy_fingerprint", [])
    # A law of the user's own that is not defined here is no damage.
    with reading(tree, ""):
        energy = StrainEnergy.from_name(name, **settings)
    # A result of an earlier version has no fingerprint.
    if fingerprint and not _same_stresses(fingerprint, energy.fingerprint):
        raise ValueError(
            f"the result{source_of(tree)} was computed with a strain energy {name!r} of another "
            f"formula than the {name!r} that is defined now ({type(energy).__module__}): at the "
            f"same stretches its stresses are {shown(fingerprint)} kPa, not "
            f"{shown(list(energy.fingerprint))} kPa. Define the class as it was, or compute the "
            "result again"
        )
    return energy


def _same_stresses(stored: Any, found: Sequence[float]) -> bool:
    """Compare stresses to five digits: fingerprints have six."""
    try:
        return np.allclose(stored, found, atol=0, equal_nan=True)
    except (TypeError, ValueError):  # not numbers, or not as many
        return False


class NamedLayer(NamedTuple):
    """A material with the names of its variables in a posterior, or their numbers."""

    energy: StrainEnergy
    values: dict[str, Any]
    """Names of variables, or numbers, of the parameters, and of the thickness of a layer."""


def named_layers(wall: StrainEnergy | Sequence[Layer]) -> list[NamedLayer]:
    """The layers of a wall, from the inside out, with the names that their variables have."""
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


def layers_attrs(layers: Sequence[NamedLayer]) -> dict[str, str]:
    """Layers as text, from which :func:`wall_of` makes them again."""
    units: dict[str, str] = {}
    for layer in layers:
        of_layer = {p.name: p.unit for p in layer.energy.parameters} | {"thickness": "mm"}
        units |= {v: of_layer[name] for name, v in layer.values.items() if isinstance(v, str)}
    records = [strain_energy_attrs(layer.energy) | {"values": layer.values} for layer in layers]
    return {"layers": json.dumps(records), "units": json.dumps(units)}


def wall_of(tree: xr.DataTree) -> list[NamedLayer]:
    """The wall of a result that names its material, or its layers."""
    if "layers" not in tree.attrs:
        return named_layers(strain_energy_of(tree))
    return [_layer_of(tree, record) for record in _layer_records(tree)]


def law_names_of(tree: xr.DataTree) -> list[str]:
    """Return the names of the laws of a result, from the inside out; empty if it states none."""
    if "layers" in tree.attrs:
        return [record["strain_energy"] for record in _layer_records(tree)]
    name = read_text(tree, "strain_energy", None)
    return [] if name is None else [name]


def _layer_records(tree: xr.DataTree) -> list[dict[str, Any]]:
    records = read_json(tree, "layers", [])
    for record in records:
        if not isinstance(record, dict) or not isinstance(record.get("strain_energy"), str):
            raise damaged(tree, f"its attribute 'layers' holds {shown(record)}; expected layers")
    if not records:
        raise damaged(tree, "its attribute 'layers' holds no layers")
    return records


def _layer_of(tree: xr.DataTree, record: dict[str, Any]) -> NamedLayer:
    """A layer of a record of :func:`layers_attrs`."""
    stated = xr.DataTree(xr.Dataset(attrs=record), name=tree.name)
    stated.encoding = tree.root.encoding
    energy = strain_energy_of(stated)
    values = record.get("values")
    needed = {"thickness", *energy.parameter_names}
    if not isinstance(values, dict) or set(values) != needed:
        raise damaged(
            tree, f"a layer of {energy.name} has the values {shown(values)}; expected {needed}"
        )
    for name, value in values.items():
        entries = value if isinstance(value, list) else [value]
        if not isinstance(value, str) and not all(is_number(x) for x in entries):
            raise damaged(tree, f"{name} of a layer is {shown(value)}; expected a name or numbers")
    return NamedLayer(energy, values)


def reference_stress_of(tree: xr.DataTree, settings: Mapping[str, Any], name: str) -> float | None:
    """The stress at which the specimens of a class are compared, among settings of this name."""
    if name not in settings:
        raise damaged(tree, f"its {name} is missing")
    stress = settings[name]
    if stress is not None and not (is_number(stress) and 0 < stress < np.inf):
        raise damaged(tree, f"its {name} is {shown(stress)}; expected a number of kPa, or null")
    return stress
