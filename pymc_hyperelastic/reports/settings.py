"""How a fit was made: a table of its settings, and sentences on its methods for an article."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
import pymc as pm
import xarray as xr

from pymc_hyperelastic.classes.hierarchical import HierarchicalClass
from pymc_hyperelastic.data.inflation import extension_tests
from pymc_hyperelastic.data.select import specimens_of
from pymc_hyperelastic.data.sheets import tubes_of
from pymc_hyperelastic.data.variables import sheet_tests
from pymc_hyperelastic.evidence.stored import damaged, read_draws, read_json, reading
from pymc_hyperelastic.mechanics.strain_energy import StrainEnergy
from pymc_hyperelastic.messages import shown
from pymc_hyperelastic.models.likelihoods import Likelihood
from pymc_hyperelastic.models.likelihoods.errors import SIZES
from pymc_hyperelastic.models.priors import prior_from_record, prior_to_record
from pymc_hyperelastic.models.settings import (
    ModelSettings,
    NamedLayer,
    holds_inflation_data,
    inflation_data_of,
    model_settings_of,
    wall_of,
)
from pymc_hyperelastic.plots.style import fitted_classes
from pymc_hyperelastic.predictions.members import specimens_differ
from pymc_hyperelastic.reports.meanings import coordinate_in_words, meaning_of
from pymc_hyperelastic.reports.page import Page, listed, plural
from pymc_hyperelastic.rounding import short

# Methods by which specimens are integrated, as an article names them.
_METHODS = {"importance": "importance sampling", "bridge": "bridge sampling"}


@dataclass(frozen=True)
class Settings:
    """How a result was made, as far as the result says."""

    wall: list[NamedLayer]
    hierarchical: HierarchicalClass | None
    differ: bool
    """True if each specimen has parameters of its own."""
    likelihood: str
    priors: dict[str, str]
    """By the name of the variable."""
    draws: int
    chains: int
    seed: str


def settings_of(tree: xr.DataTree) -> Settings:
    """Return the settings of a sampled model, or of fitted classes, which all have the same."""
    first = next(iter(fitted_classes(tree).values()))
    posterior = read_draws(first, "posterior")
    stored = model_settings_of(first)
    hierarchical: HierarchicalClass | None = None
    if stored and stored.variability == HierarchicalClass.stored_as:
        with reading(first):
            hierarchical = HierarchicalClass.from_settings(stored)
    likelihood = stored.make_likelihood() if stored else None
    return Settings(
        known_wall(first),
        hierarchical,
        specimens_differ(first),
        likelihood.in_words if likelihood else "",
        priors_of_class(hierarchical) if hierarchical else _priors_of(first, stored, likelihood),
        posterior.sizes["draw"],
        posterior.sizes["chain"],
        tree.attrs.get("random_seed", ""),
    )


def known_wall(tree: xr.DataTree) -> list[NamedLayer]:
    """Return the layers of the wall, from the inside out; none if a law is unknown."""
    try:
        return wall_of(tree)
    except ValueError:
        return []


def reference_stress_of(tree: xr.DataTree) -> float | None:
    """Return the stress at which the specimens of a class are compared, kPa, if there is one."""
    stored = model_settings_of(tree)
    return stored.reference_stress if stored else None


def uses_forces(tree: xr.DataTree) -> bool:
    """Return False if the likelihood of a result is known not to include axial forces."""
    stored = model_settings_of(tree)
    known = stored.likelihood if stored else None
    return known is None or bool({"force_sd", "force_sigma"} & known.keys())


def _priors_of(
    tree: xr.DataTree, stored: ModelSettings | None, likelihood: Likelihood | None
) -> dict[str, str]:
    units = units_of(tree)
    priors = stored.make_priors() if stored else {}
    if likelihood:
        priors |= likelihood.unknowns
    return {
        name: distribution_in_words(prior_to_record(name, prior), units.get(name, ""))
        for name, prior in priors.items()
    }


def priors_of_class(kind: HierarchicalClass) -> dict[str, str]:
    """Return the priors of all unknowns of a class, coordinate by coordinate."""
    names = kind.scale.names
    with pm.Model(coords={"coordinate": names, "coordinate_2": names}, model=None) as model:
        kind.register_class()
    priors = {}
    for variable in model.free_RVs:
        if variable.name == "correlation_unit":
            words = "LKJ(2) (density proportional to the determinant of their matrix)"
            priors["the correlations"] = words
            continue
        distribution, parameters, *size = prior_to_record(variable.name, variable)
        if not size:
            unit = SIZES[variable.name].unit if variable.name in SIZES else ""
            record = [distribution, parameters]
            priors[variable.name] = distribution_in_words(record, unit)
            continue
        table = np.broadcast_arrays(*parameters, np.empty(size))[:-1]
        for name, *values in zip(names, *table, strict=True):
            record = [distribution, [float(value) for value in values]]
            priors[f"{variable.name}[{name}]"] = distribution_in_words(record)
    return priors


def distribution_in_words(record: Any, unit: str = "") -> str:
    """Return the text of a record of :func:`prior_to_record`; ValueError if it is no such record.

    >>> distribution_in_words(["Uniform", [0.0, 100.0]], "kPa")
    'Uniform(0, 100) kPa'
    """
    prior_from_record(record)
    name, parameters, *size = record
    text = f"{name}({', '.join(map(_number, parameters))}) {unit}".rstrip()
    return f"{text}, {size[0]} of them" if size else text


def _number(value: Any) -> str:
    return f"[{', '.join(map(_number, value))}]" if isinstance(value, list) else short(value)


def units_of(tree: xr.DataTree) -> dict[str, str]:
    """Return the units of the variables of a result, as far as it says."""
    stated: Mapping[str, str] = read_json(tree, "units", {})
    if not all(isinstance(unit, str) for unit in stated.values()):
        raise damaged(tree, f"its attribute 'units' is {shown(stated)}; expected the unit of each")
    units = {p.name: p.unit for layer in known_wall(tree) for p in layer.energy.parameters}
    units |= {name: size.unit for name, size in SIZES.items()} | dict(stated)
    return {name: unit.replace("mm2", "mm²") for name, unit in units.items()}


def show_settings(result: xr.DataTree, page: Page) -> None:
    """Add a table of the settings."""
    settings = settings_of(result)
    rows: list[tuple[str, Any]] = []
    for number, layer in enumerate(settings.wall, start=1):
        where = f" of layer {number}, from inside" if len(settings.wall) > 1 else ""
        own = ", ".join(f"{name} = {value}" for name, value in vars(layer.energy).items())
        rows.append((f"strain energy{where}", layer.energy.name + (f" ({own})" if own else "")))
        rows.append((f"equation{where}", layer.energy.equation or "not stated"))
        for p in layer.energy.parameters:
            value = layer.values.get(p.name)
            fixed = f"; given as {short(value)}" if isinstance(value, float) else ""
            unit = f" ({p.unit})" if p.unit else ""
            rows.append((f"{p.name}{unit}{where}", p.description + fixed))
    if kind := settings.hierarchical:
        rows += [
            ("variability", "each specimen has parameters of its own"),
            ("normally distributed between specimens", "; ".join(_coordinates(kind))),
            (
                "experiments on a specimen",
                "differ by a random effect"
                if kind.variability.experiment_effect
                else "share its parameters",
            ),
        ]
        for name, error in kind.geometry.items():
            rows.append((f"error of the measured {name.replace('_', ' ')}", str(error)))
    rows += [(f"prior of {name}", prior) for name, prior in settings.priors.items()]
    rows += [
        ("likelihood", settings.likelihood),
        ("draws per chain", settings.draws),
        ("chains", settings.chains),
        ("random seed", settings.seed),
    ]
    known = [row for row in rows if row[1] != ""]
    page.table("Settings", pd.DataFrame(known, columns=["setting", "value"], dtype=object))


def add_methods(result: xr.DataTree, page: Page) -> None:
    """Add sentences on the data, the model and the sampling to the methods."""
    settings = settings_of(result)
    trees = fitted_classes(result)
    data = {
        name: inflation_data_of(tree) for name, tree in trees.items() if holds_inflation_data(tree)
    }
    specimens = {name: len(specimens_of(d)[0]) for name, d in data.items()}
    if data:
        page.methods.append(_data_sentence(data, specimens))
        if any("axial_force" in d for d in data.values()):
            page.methods.append("Axial forces were measured too.")
            if not all(map(uses_forces, trees.values())):
                page.methods.append("The likelihood does not include them.")
    several = max(specimens.values(), default=1) > 1
    page.methods += _model_sentences(settings, several, _what(data.values()))
    page.methods.append(_sampling_sentence(settings, trees.values()))


def _data_sentence(data: Mapping[str, xr.Dataset], specimens: Mapping[str, int]) -> str:
    in_each = listed([f"{count} in {name}" for name, count in specimens.items()])
    tubes = [of for d in data.values() if (of := tubes_of(d)) is not None]
    kinds = ["inflation"] if tubes else []
    kinds += ["extension"] if any(extension_tests(of).any() for of in tubes) else []
    curves = f"{' and '.join(kinds)} curves" if tubes else ""
    if any(sheet_tests(d).any() for d in data.values()):
        curves = " and ".join(filter(None, [curves, "stresses of sheets"]))
    simulated = any(d.attrs.get("simulated") for d in data.values())
    tests, points = (sum(d.sizes[dim] for d in data.values()) for dim in ("test", "obs"))
    return (
        f"The {'simulated ' if simulated else ''}{curves} "
        f"of {plural(sum(specimens.values()), 'specimen')}"
        f"{f' ({in_each})' if len(data) > 1 else ''} were analysed: "
        f"{plural(tests, 'test')} with {plural(points, 'point')}."
    )


def _what(data: Iterable[xr.Dataset]) -> str:
    """Describe the modelled specimens: tubes, sheets, or both."""
    sheets = [sheet_tests(d) for d in data]
    if sheets and all(of.all() for of in sheets):
        return "Each sheet was modelled as a thin, incompressible, hyperelastic sheet"
    tube = "Each vessel was modelled as a thick-walled, incompressible, hyperelastic tube"
    joint = any(of.any() for of in sheets)
    return f"{tube}, and each sheet as a thin sheet of the same material," if joint else tube


def _model_sentences(settings: Settings, several: bool, tube: str) -> list[str]:
    """Describe the model of one specimen, or of `several`."""
    if not settings.wall:
        return ["The result does not say which model was fitted."]
    laws = [law_in_words(layer.energy) for layer in settings.wall]
    if len(laws) > 1:
        layers = plural(len(laws), "layer")
        sentences = [f"{tube} of {layers} with, from the inside out, {'; '.join(laws)}."]
    else:
        sentences = [f"{tube} with {laws[0]}."]
    if kind := settings.hierarchical:
        sentences.append(
            "The parameters of each specimen were drawn from the distribution of its class, a "
            f"normal distribution of {listed(_coordinates(kind))}."
        )
        if kind.variability.experiment_effect:
            sentences.append("Experiments on a specimen differed by a random effect.")
    elif settings.differ:
        sentences.append("Each specimen had parameters of its own, drawn from one distribution.")
    elif several:
        sentences.append("All specimens of a class shared one set of parameters.")
    if settings.likelihood:
        sentences.append(f"Measurement errors were normal: {settings.likelihood}.")
    if settings.priors:
        named = {_named(name, settings): prior for name, prior in settings.priors.items()}
        priors = [f"{prior} for {name}" for name, prior in named.items()]
        start = "The prior was" if len(priors) == 1 else "Priors were"
        sentences.append(f"{start} {', '.join(priors)}.")
    return sentences


def _named(name: str, settings: Settings) -> str:
    """Return what an unknown of a class means, or the name of a parameter."""
    if not settings.hierarchical:
        return name
    stress = settings.hierarchical.variability.reference_stress
    meaning = meaning_of(name, settings.wall, stress)
    return f"the {meaning}" if meaning else name


def _coordinates(kind: HierarchicalClass) -> list[str]:
    """Return the coordinates that are normally distributed between specimens, in words."""
    stress = kind.variability.reference_stress
    return [f"the {coordinate_in_words(name, stress)}" for name in kind.scale.names]


def law_in_words(energy: StrainEnergy) -> str:
    """Name a strain energy with its equation.

    >>> import pymc_hyperelastic as ph
    >>> law_in_words(ph.Demiray())
    'the strain energy Demiray, W = (μ/(2 b)) (e^(b (I₁ − 3)) − 1)'
    """
    return f"the strain energy {energy.name}" + (f", {energy.equation}" if energy.equation else "")


def _sampling_sentence(settings: Settings, trees: Iterable[xr.DataTree]) -> str:
    draws = f"{plural(settings.chains, 'independent chain')} of {plural(settings.draws, 'draw')}"
    if settings.hierarchical:
        tables = [tree["specimens"]["method"] for tree in trees if "specimens" in tree.children]
        methods = sorted({str(method) for table in tables for method in table.values})
        by = listed([_METHODS.get(method, method) for method in methods])
        return (
            f"The parameters of each specimen were integrated out{f' by {by}' if by else ''}, and "
            f"the posterior of the distribution of each class was sampled in {draws}, which also "
            "gives its evidence."
        )
    if all("evidence" in tree.children for tree in trees):
        return (
            f"Posteriors were sampled by sequential Monte Carlo in {draws}, which also gives the "
            "evidence and its standard error."
        )
    return f"Posteriors were sampled in {draws}."
