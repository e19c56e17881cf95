"""Settings that are stored with results: law, priors, likelihood and sampler."""

from dataclasses import dataclass
from typing import Any

import numpy as np
import pymc as pm
import xarray as xr

from pymc_hyperelastic.classes.variable import Variability
from pymc_hyperelastic.evidence.stored import read_draws, reading
from pymc_hyperelastic.models.likelihoods import Likelihood
from pymc_hyperelastic.models.likelihoods.errors import SD_OF_SIGMA, SIZES
from pymc_hyperelastic.models.priors import is_inferred, prior_to_record
from pymc_hyperelastic.models.settings import NamedLayer, model_settings_of
from pymc_hyperelastic.plots.style import fitted_classes
from pymc_hyperelastic.predictions.members import specimens_differ
from pymc_hyperelastic.reports.blocks import in_words, plural, short
from pymc_hyperelastic.reports.laws import (
    distribution_in_words,
    equation_of,
    units_of,
    wall_in_words,
)


@dataclass(frozen=True)
class Settings:
    """How a result was made, as far as it says so."""

    wall: list[NamedLayer]
    variability: Variability | None
    differ: bool
    """True if each specimen has parameters of its own."""
    likelihood: Likelihood | None
    """None if the result does not state it."""
    likelihood_in_words: str
    priors: dict[str, str]
    """By the name of the variable."""
    draws: int
    chains: int
    seed: str

    @property
    def law(self) -> str:
        """Name of the strain energy, or of those of the layers."""
        names = [layer.energy.name for layer in self.wall]
        return in_words(names) if names else "a strain energy that is not named"


def settings_of(tree: xr.DataTree) -> Settings:
    """Settings of a sampled model, or of fitted classes, which have all the same."""
    first = next(iter(fitted_classes(tree).values()))
    posterior = read_draws(first, "posterior")
    stored = model_settings_of(first)
    likelihood = stored.make_likelihood() if stored else None
    kind: Variability | None = None
    if stored and stored.variability == Variability.variability:
        with reading(first):
            kind = Variability.from_settings(stored)
        priors = priors_of_class(kind)
    else:
        records = dict(stored.priors or {}) if stored else {}
        for name, prior in (likelihood.unknowns if likelihood else {}).items():
            records[name] = prior_to_record(name, prior)
        units = units_of(first)
        priors = {n: distribution_in_words(r, units.get(n, "")) for n, r in records.items()}
    return Settings(
        wall_in_words(first),
        kind,
        specimens_differ(first),
        likelihood,
        first.attrs.get("likelihood_in_words", ""),
        priors,
        posterior.sizes["draw"],
        posterior.sizes["chain"],
        tree.attrs.get("random_seed", ""),
    )


def priors_of_class(kind: Variability) -> dict[str, str]:
    """Priors of all that is unknown of a class, as its model has them, coordinate by coordinate."""
    names = kind.scale.names
    with pm.Model(coords={"coordinate": names, "coordinate_2": names}, model=None) as model:
        kind.register_class()
    priors = {}
    for variable in model.free_RVs:
        if variable.name == "correlation_unit":
            priors["the correlations"] = "the determinant of their matrix"
            continue
        distribution, parameters, *size = prior_to_record(variable.name, variable)
        if not size:
            record = [distribution, parameters]
            unit = SIZES[variable.name].unit if variable.name in SIZES else ""
            priors[variable.name] = distribution_in_words(record, unit)
            continue
        of_each = np.broadcast_arrays(*parameters, np.empty(size))[:-1]
        for i, name in enumerate(names):
            record = [distribution, [float(values[i]) for values in of_each]]
            priors[f"{variable.name}[{name}]"] = distribution_in_words(record)
    return priors


def size_in_words(likelihood: Likelihood, name: str) -> str:
    """Return how large an error is, or how much slopes count, in words.

    >>> import pymc_hyperelastic as ph
    >>> size_in_words(ph.SlopeAugmented(sigma=2.0, slope_weight=1.0), "sigma")
    'a standard deviation of 1.414 kPa'
    """
    value, unit = likelihood.sizes[name], likelihood.units[name]
    what = "a weight" if name == "slope_weight" else "a standard deviation"
    if is_inferred(value):
        times = " times √2" if name in SD_OF_SIGMA else ""
        prior = distribution_in_words(prior_to_record(name, value), unit)
        return f"{what}{times} that was inferred, with the prior {prior}"
    size = getattr(likelihood.errors(), SD_OF_SIGMA.get(name, name))
    return f"{what} of {short(float(size))} {unit}"


def noise_sentences(settings: Settings) -> list[str]:
    """Return the errors of the likelihood, as sentences of an article."""
    likelihood = settings.likelihood
    if likelihood is None:
        words = settings.likelihood_in_words
        return [f"Errors were taken as normal ({words})."] if words else []
    sentences = []
    for name, value in likelihood.sizes.items():
        size = size_in_words(likelihood, name)
        if name == "slope_weight":
            if is_inferred(value) or value:
                sentences.append(f"Slopes of the curves counted too, with {size}.")
        elif name == "force_offset_sd":
            words = f"Each test had an offset of the force transducer, normal with {size}."
            sentences.append(words)
        else:
            own = " in each specimen" if settings.variability and is_inferred(value) else ""
            of_what = SIZES[name].of_what.capitalize()
            sentences.append(f"{of_what} were taken as normal{own}, with {size}.")
    return sentences


def settings_rows(settings: Settings) -> list[list[Any]]:
    """Return the settings as rows of a table."""
    rows: list[list[Any]] = []
    for number, layer in enumerate(settings.wall, start=1):
        of = f" of layer {number}, from inside" if len(settings.wall) > 1 else ""
        own = ", ".join(f"{name} = {value}" for name, value in vars(layer.energy).items())
        rows.append([f"strain energy{of}", f"{layer.energy.name}{f' ({own})' if own else ''}"])
        rows.append([f"its equation{of}", equation_of(layer.energy)])
        for p in layer.energy.parameters:
            unit = f" ({p.unit})" if p.unit else ""
            value = layer.values.get(p.name)
            fixed = f"; given as {short(value)}" if isinstance(value, float) else ""
            rows.append([f"{p.name}{unit}{of}", p.description + fixed])
    if kind := settings.variability:
        rows.append(["variability", "each specimen has parameters of its own"])
        rows.append(["coordinates of specimens", ", ".join(kind.scale.names)])
        stress = kind.reference_stress
        rows.append(["reference stress (kPa)", "none" if stress is None else float(stress)])
        differ = "differ by an effect" if kind.experiment_effect else "share its parameters"
        rows.append(["experiments on a specimen", differ])
        for name, error in kind.geometry.items():
            rows.append([f"error of the measured {name.replace('_', ' ')}", str(error)])
    rows += [[f"prior of {name}", prior] for name, prior in settings.priors.items()]
    words = settings.likelihood_in_words
    rows += [["likelihood", words]] if words else []
    rows += [["draws of a chain", settings.draws], ["chains", settings.chains]]
    rows += [["random seed", settings.seed]] if settings.seed else []
    return rows


def model_sentences(settings: Settings, several: bool) -> list[str]:
    """Describe the model of one specimen, or of `several`, in sentences of an article."""
    energies = [layer.energy for layer in settings.wall]
    laws = [f"{e.name}, {equation_of(e).rstrip('.')}" for e in energies]
    tube = "Each vessel was modelled as a thick-walled, incompressible, hyperelastic tube"
    if len(laws) > 1:
        sentences = [
            f"{tube} of {plural(len(laws), 'layer')}, from the inside out of the strain energies "
            f"{'; '.join(laws)}."
        ]
    elif laws:
        sentences = [f"{tube} with the strain energy {laws[0]}."]
    else:
        return ["The result does not say which model it is of."]
    if kind := settings.variability:
        names = kind.scale.names
        place = "the coordinate" if len(names) == 1 else "the coordinates"
        sentences.append(
            "Specimens of a class differed: the parameters of each were a draw from a normal "
            f"distribution of its class, over {place} {in_words(names)}"
            + (
                f" (reference stress {short(kind.reference_stress)} kPa)."
                if kind.reference_stress is not None
                else "."
            )
        )
        if kind.experiment_effect:
            sentences.append("Experiments on a specimen differed by a random effect.")
    elif settings.differ:
        sentences.append("Each specimen had parameters of its own, drawn from one distribution.")
    elif several:
        sentences.append("All specimens that were fitted together shared one set of parameters.")
    sentences += noise_sentences(settings)
    if settings.priors:
        priors = [f"{prior} for {name}" for name, prior in settings.priors.items()]
        word = "The prior was" if len(priors) == 1 else "Priors were"
        sentences.append(f"{word} {in_words(priors)}.")
    return sentences
