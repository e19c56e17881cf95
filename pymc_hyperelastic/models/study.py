"""What a model was made from, as it is stored with its result, from which it can be made again.

Besides the groups of sampling the result of a model of inflation curves has

``observed_data``, ``constant_data`` : (obs), (test)
    The measured pressures, and the rest of the inflation data. Of a generative likelihood, what was
    measured by the names of the observed variables, and all of the data.

and attributes from which the model can be built again. Among them are ``noise``, as JSON, in which
numbers are the paper's ``σ`` and distributions stand by the name by which they were given, and
``noise_in_words``, which says what that is in standard deviations.
"""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
import pymc as pm
import pytensor.tensor as pt
import xarray as xr
from numpy.typing import NDArray

from pymc_hyperelastic.data.inflation import check_inflation_data, describe_test
from pymc_hyperelastic.evidence.results import data_groups
from pymc_hyperelastic.evidence.verdicts import register_checks
from pymc_hyperelastic.files.seal import source_of
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
)
from pymc_hyperelastic.mechanics.layers import Layer, check_energy, check_layers
from pymc_hyperelastic.mechanics.strain_energy import Parameter, StrainEnergy
from pymc_hyperelastic.models.checks import CHECKS_OF_CURVES
from pymc_hyperelastic.models.forward import ForwardModel
from pymc_hyperelastic.models.geometry import Measured, deviation_name
from pymc_hyperelastic.models.observation import Observation
from pymc_hyperelastic.models.observation.noise import (
    NOISE_UNITS,
    in_sigmas,
    noise_in_words,
    sd_of_sigma,
    to_store,
)
from pymc_hyperelastic.models.priors import (
    complete_layers,
    is_inferred,
    prior_from_record,
    prior_to_record,
    priors_from_records,
)
from pymc_hyperelastic.models.residuals import Residuals

Array = NDArray[np.float64]

register_checks(CHECKS_OF_CURVES)

# Draws whose curves are looked at.
_LOOKED_AT = 64
# Relative difference of stresses that are computed in another way, or rounded to six digits.
_FINGERPRINT_ROUNDING = 1e-5


@dataclass(frozen=True)
class Study:
    """What a model of inflation curves was made from."""

    energy: StrainEnergy | Sequence[Layer]
    data: xr.Dataset
    priors: dict[str, Any]
    observation: Observation | None = None
    """None of a population, whose specimens have errors of their own."""
    geometry: dict[str, Any] = field(default_factory=dict)
    rising: bool = False
    reference_stress: float | None = None
    """Of a population, see :class:`NaturalScale`."""
    forward: ForwardModel | None = None
    """Curves of the model."""

    @property
    def likelihood(self) -> str:
        """How the data enter the model."""
        return self.observation.likelihood if self.observation else "population"

    def groups(self) -> dict[str, xr.Dataset]:
        """The inflation data, divided as ArviZ does."""
        return {
            "observed_data": self.data[["pressure"]].reset_coords(drop=True),
            "constant_data": self.data.drop_vars("pressure"),
        }

    def result_groups(self, model: pm.Model) -> dict[str, xr.Dataset]:
        """The inflation data with what the observed variables hold now: it may have been replaced.

        PyMC's functions look for the names of variables among the observed data, and may replace
        that group; all data of the study are therefore in the other one.
        """
        groups = self._measured(model)
        # What was inferred, and has been observed or set since.
        for group, held in data_groups(model).items():
            fixed = [name for name in held.data_vars if name in self._fixed(model)]
            groups[group] = groups[group].merge(held[fixed])
        return groups

    def diagnostics(
        self, model: pm.Model, posterior: Mapping[str, Array], particles: Array
    ) -> xr.Dataset:
        """Return what is stored with the evidence: the error of curves, and their residuals."""
        error = self.curve_error(posterior)
        found = xr.Dataset({"curve_error": error} if np.isfinite(error) else {})
        return found.merge(Residuals(model, self).of(self.data, particles))

    def curve_error(self, posterior: Mapping[str, Array]) -> float:
        """Largest error of curves of the posterior, relative to the largest value of each.

        Of a few of the draws, by (chain, draw); NaN where it is not known, as of layers.
        """
        if self.forward is None or not isinstance(self.energy, StrainEnergy):
            return np.nan
        draws = {}
        for p in self.energy.parameters:
            if p.name not in posterior:
                return np.nan
            # Those of a population are by specimen as well.
            entries = () if p.size is None else (p.size,)
            values = posterior[p.name].reshape(-1, *entries)
            draws[p.name] = values[:: -(-len(values) // _LOOKED_AT)]
        return float(self.forward.errors(self.data, draws).max())

    def residuals(self, model: pm.Model) -> dict[str, Any]:
        """Differences of curves from what was measured, in standard deviations of the noise.

        An error of the radius shifts the pressure by the slope of the curve, to first order. Forces
        are left out where radii have errors: their slopes are no variables of the model.
        """
        seen = self.observation
        if seen is None or self.forward is None:
            return {}
        known = {name: model[name] if is_inferred(v) else v for name, v in seen.noise.items()}
        sigmas = in_sigmas(known)
        pressure_sd, radius_sd = sd_of_sigma(sigmas["sigma"]), None
        if seen.error_in == "radius":
            pressure_sd, radius_sd = 0.0, pressure_sd
        elif seen.diameter_noise_sd is not None:
            radius_sd = sigmas["diameter_noise_sd"] / 2
        if radius_sd is not None:
            pressure_sd = pt.sqrt(pressure_sd**2 + (radius_sd * model["stiffness"]) ** 2)
        # What is shared is replaced with the data.
        shared = self.forward.share("measured", _measurements_of)
        found = {"pressure": (model["pressure"] - shared["pressure"]) / pressure_sd}
        if "force_sigma" in sigmas and radius_sd is None:
            force_sd = sd_of_sigma(sigmas["force_sigma"])
            found["axial_force"] = (model["axial_force"] - shared["axial_force"]) / force_sd
        return found

    def chi_squares(self, data: xr.Dataset, residuals: Mapping[str, Array]) -> xr.Dataset:
        """Squared residuals and numbers of points by test and signal, of the best of some draws.

        Of forces with an offset, the best one of each test is subtracted.
        """
        test, count = data["test"].values, data.sizes["test"]
        offsets = self.observation is not None and self.observation.force_offset_sd is not None
        members = (test == np.arange(count)[:, None]).astype(float)
        squares, points = {}, {}
        for signal, of_draws in residuals.items():
            own = members * np.isfinite(data[signal].values)
            points[signal] = own.sum(axis=1)
            squares[signal] = np.square(of_draws) @ own.T
            if signal == "axial_force" and offsets:
                squares[signal] -= (of_draws @ own.T) ** 2 / points[signal].clip(1)
                points[signal] = (points[signal] - 1).clip(0)
        best = int(np.argmin(sum(value.sum(axis=1) for value in squares.values())))
        labels = {"test": [describe_test(data, i) for i in range(count)], "signal": [*squares]}
        tables = {"chi_square": {k: v[best] for k, v in squares.items()}, "points": points}
        return xr.Dataset(
            {k: (("test", "signal"), np.stack([*v.values()], axis=1)) for k, v in tables.items()},
            labels,
        )

    def _fixed(self, model: pm.Model) -> set[str]:
        """Unknowns of the study that are no free variables of a model that was made of its own."""
        noise = self.observation.noise if self.observation else {}
        unknowns = {*self.priors, *(k for k, v in noise.items() if is_inferred(v))}
        for name, value in self.geometry.items():
            unknowns.add(deviation_name(name) if isinstance(value, Measured) else name)
        return unknowns - {rv.name for rv in model.free_RVs}

    def _measured(self, model: pm.Model) -> dict[str, xr.Dataset]:
        """The inflation data, with those that observed variables hold."""
        if self.likelihood == "paper":
            return self.groups()
        data, observed = self.data.copy(), {}
        for name in map(str, self.data.data_vars):
            if f"{name}_data" in model.named_vars:
                values = model[f"{name}_data"].get_value()
                observed[f"measured_{name}"] = model.named_vars_to_dims[f"{name}_data"], values
                column = data[name].values.astype(float)
                column[np.isfinite(column)] = values
                data[name] = data[name].copy(data=column)
        return {"observed_data": xr.Dataset(observed), "constant_data": data}

    def attrs(self) -> dict[str, str]:
        """All that is needed to build the model again, as text."""
        if not isinstance(self.energy, StrainEnergy) or self.geometry:
            raise ValueError(
                "layers, or a geometry that is inferred, do not make a class whose specimens are "
                "alike: take variability='specimen', or sample them by themselves, "
                "ph.sample_smc(ph.inflation_model(...)), and predict from the result"
            )
        observed, stress = self.observation, self.reference_stress
        if self.rising or (observed and observed.error_in != "pressure"):
            raise ValueError("a class has its error in the pressure, and its prior as it is given")
        noise = observed.noise if observed else {}
        records = noise_records(noise)
        units = {name: NOISE_UNITS[name] for name in records}
        units |= {p.name: p.unit for p in self.energy.parameters}
        priors = {name: prior_to_record(name, prior) for name, prior in self.priors.items()}
        return strain_energy_attrs(self.energy) | {
            "units": json.dumps(units),
            "priors": json.dumps(priors),
            "noise": json.dumps(records),
            "noise_in_words": noise_in_words(noise),
            **({} if self.likelihood == "paper" else {"likelihood": self.likelihood}),
            **({} if observed else {"reference_stress": json.dumps(stress)}),
        }

    def result_attrs(self, model: pm.Model) -> dict[str, str]:
        """What a result of sampling says of the model: all, or of what cannot be stored its law."""
        try:
            if self._fixed(model):
                raise ValueError("the model has been changed since, and is not that of its priors")
            return self.attrs()
        except ValueError:
            # Sampling a model with a prior of one's own is fine; it cannot serve as a stored class,
            # which `fit_classes` checks before it samples.
            law = self.energy
        observed, said = self.observation, {}
        if observed:
            said["noise_in_words"] = noise_in_words(observed.noise, observed.error_in)
        try:
            if isinstance(law, StrainEnergy):
                return said | strain_energy_attrs(law)
            return said | layers_attrs(named_layers(law))
        except ValueError:  # settings of a law that are no text
            return said | ({"strain_energy": law.name} if isinstance(law, StrainEnergy) else {})


def _measurements_of(data: xr.Dataset) -> dict[str, Array]:
    """Pressures and forces of all points; a force that was not measured is 0."""
    signals = [name for name in ("pressure", "axial_force") if name in data]
    return {name: np.nan_to_num(data[name].values.astype(float)) for name in signals}


def inflation_data_of(tree: xr.DataTree) -> xr.Dataset:
    """Inflation data with which the model was fitted; ValueError if they are not sound."""
    data = read_group(tree, "constant_data")
    with reading(tree):
        if "pressure" not in data and "observed_data" in tree.children:
            data = xr.merge([tree["observed_data"].to_dataset(), data])
        check_inflation_data(data)
    return data


def holds_inflation_data(tree: xr.DataTree) -> bool:
    """Whether a result is of inflation data, and not of a model of something else."""
    if "constant_data" not in tree.children:
        return False
    # A model of a user's own may have one of these; data that lack one are damaged.
    names = {"inner_radius", "outer_radius", "specimen", "experiment"}
    return len(names & set(tree["constant_data"].to_dataset().variables)) > 1


def origin_of(classes: xr.DataTree) -> dict[str, Any]:
    """Attributes of what follows from classes: what their data are called, and if simulated."""
    attrs = [read_group(fitted, "constant_data").attrs for fitted in classes.children.values()]
    titles = dict.fromkeys(str(a["title"]) for a in attrs if is_said(a.get("title")))
    simulated = int(any(is_said(a.get("simulated")) for a in attrs))
    return {"title": ", ".join(titles), "simulated": simulated}


def model_settings_of(tree: xr.DataTree) -> dict[str, Any]:
    """Settings of :func:`pymc_hyperelastic.inflation_model`, but for the data."""
    if "priors" not in tree.attrs:
        raise ValueError("this result does not say from which model it came; see ph.fit_classes")
    energy = strain_energy_of(tree)
    with reading(tree):
        noise = noise_from_records(read_dict(tree, "noise"))
        priors = priors_from_records(read_dict(tree, "priors"))
    settings = {"energy": energy, "priors": priors, **noise}
    likelihood = read_text(tree, "likelihood", None)
    return settings | ({} if likelihood is None else {"likelihood": likelihood})


def values_of_parameter(tree: xr.DataTree, parameter: Parameter) -> xr.DataArray:
    """Draws of a material parameter, of all its entries; ValueError if there are no such."""
    name, size = parameter.name, parameter.size
    values = read_numbers(tree, "posterior", name, None)
    entries = [values.sizes[dim] for dim in values.dims if dim not in ("chain", "draw")]
    if not {"chain", "draw"} <= set(values.dims) or entries != ([] if size is None else [size]):
        raise damaged(
            tree,
            f"{name!r} of 'posterior' has the dimensions {dict(values.sizes)}; expected chain, draw"
            + ("" if size is None else f" and {size} entries"),
        )
    return values


def noise_records(noise: Mapping[str, Any]) -> dict[str, Any]:
    """What is said of the errors as numbers, those of ``σ``, and as records of distributions."""
    return {
        name: prior_to_record(name, value) if is_inferred(value) else float(value)
        for name, value in to_store(noise).items()
    }


def noise_from_records(records: Mapping[str, Any]) -> dict[str, Any]:
    """What :func:`noise_records` stored; ValueError if it is something else."""
    strangers = [name for name in records if name not in NOISE_UNITS]
    if strangers:
        raise ValueError(f"{strangers[0]!r} is no error; of these there are {list(NOISE_UNITS)}")
    return {
        name: float(value) if is_number(value) else prior_from_record(value, name)
        for name, value in records.items()
    }


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
    names = {v for v in (layer.values["thickness"] for layer in layers) if isinstance(v, str)}
    priors = {name: prior_to_record(name, distributions[name]) for name in sorted(names)}
    return layers_attrs(layers) | {"thickness_priors": json.dumps(priors)}


def stated_wall_of(tree: xr.DataTree) -> StrainEnergy | list[Layer]:
    """The material of a class, or its layers as they were given: what is missing is inferred."""
    if "thickness_priors" not in tree.attrs:
        return strain_energy_of(tree)
    with reading(tree):
        # One distribution in two layers is one thickness of both.
        priors = priors_from_records(read_dict(tree, "thickness_priors"))

    def stated(layer: NamedLayer) -> Layer:
        thickness, numbers = layer.values["thickness"], layer.values.items()
        if isinstance(thickness, str) and thickness not in priors:
            raise damaged(tree, f"its attribute 'thickness_priors' lacks {thickness!r}")
        known = {n: v for n, v in numbers if n != "thickness" and not isinstance(v, str)}
        return Layer(layer.energy, priors.get(thickness, thickness), **known)

    layers = wall_of(tree)
    with reading(tree):
        return [stated(layer) for layer in layers]


def strain_energy_of(tree: xr.DataTree) -> StrainEnergy:
    """Strain energy of a result that names it."""
    if "strain_energy" not in tree.attrs:
        raise ValueError(
            "the result does not name its strain energy: give it as energy=ph.Ogden(), or the "
            "layers of the model as energy=[ph.Layer(...), ...]"
        )
    name, settings = read_text(tree, "strain_energy"), read_json(tree, "strain_energy_settings", {})
    fingerprint = read_json(tree, "strain_energy_fingerprint", [])
    return _strain_energy(tree, name, settings, fingerprint)


def _strain_energy(
    tree: xr.DataTree, name: Any, settings: dict[str, Any], fingerprint: list[Any]
) -> StrainEnergy:
    """Strain energy of this name, if its formula has the stresses of the `fingerprint`."""
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


def _same_stresses(stored: list[Any], found: Sequence[float]) -> bool:
    try:
        return np.allclose(stored, found, rtol=_FINGERPRINT_ROUNDING, atol=0, equal_nan=True)
    except (TypeError, ValueError):  # not numbers, or not as many
        return False


class NamedLayer(NamedTuple):
    """A material, and by which names, or as which numbers, a posterior holds what it needs."""

    energy: StrainEnergy
    values: dict[str, Any]
    """Of the parameters, and of the thickness if it is a layer: names of variables, or numbers."""


def named_layers(wall: StrainEnergy | Sequence[Layer]) -> list[NamedLayer]:
    """The layers of a wall, from the inside out, with the names that their variables have."""
    if not isinstance(wall, Sequence):
        check_energy(wall)
        return [NamedLayer(wall, {name: name for name in wall.parameter_names})]
    check_layers(wall)
    layers, distributions = complete_layers(wall)
    names = {prior: name for name, prior in distributions.items()}
    return [
        NamedLayer(
            layer.energy,
            {
                name: names[value] if is_inferred(value) else np.asarray(value, float).tolist()
                for name, value in {"thickness": layer.thickness, **layer.parameters}.items()
            },
        )
        for layer in layers
    ]


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
    """What the laws of a result are called, from the inside out; nothing if it does not tell."""
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
    try:
        settings = json.loads(record.get("strain_energy_settings", "{}"))
        fingerprint = json.loads(record.get("strain_energy_fingerprint", "[]"))
    except (TypeError, ValueError, RecursionError):
        settings = fingerprint = None
    if not isinstance(settings, dict):
        raise damaged(tree, f"a layer has the settings {shown(record['strain_energy_settings'])}")
    energy = _strain_energy(tree, record["strain_energy"], settings, fingerprint)
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
        raise damaged(tree, f"it does not tell its {name}")
    stress = settings[name]
    if stress is not None and not (is_number(stress) and 0 < stress < np.inf):
        raise damaged(tree, f"its {name} is {shown(stress)}; expected a number of kPa, or null")
    return stress
