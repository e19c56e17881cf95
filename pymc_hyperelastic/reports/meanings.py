"""Meanings of unknowns and diagnostic numbers in words, for tables and sentences of a report."""

import re

from pymc_hyperelastic.evidence.importance import LARGEST_PARETO_K
from pymc_hyperelastic.models.class_distribution import SPREAD_OF_NOISE
from pymc_hyperelastic.models.likelihoods.errors import SD_OF_SIGMA, SIZES
from pymc_hyperelastic.models.settings import NamedLayer
from pymc_hyperelastic.quantities import IN_RESULTS, IN_TABLES

# Explanations of numbers, for the notes of tables.
PARETO_K = (
    "Pareto k measures how far a result depends on a few draws with large weights: below "
    f"{LARGEST_PARETO_K} it does not."
)
NATS = (
    "The log evidence is the logarithm of the probability density of the data under a law and its "
    "priors; a difference of 1 nat is a ratio of 2.7."
)
# Unknowns of a class that have one value per coordinate, and what these values are.
_OF_COORDINATES = {
    "location": "mean over the specimens",
    "spread": "standard deviation between specimens",
    "experiment_spread": "standard deviation between experiments on one specimen",
}
# Coordinates of specimens: the pattern of the name, and words. "{stress}" is the reference stress.
_COORDINATES = {
    r"log_reference_strain(_\d+)?": "log of the strain (circumferential, or along x) at {stress}",
    r"log_biaxial_strain(_\d+)?": "log of the equibiaxial strain at {stress}",
    r"log_stress_(.+)_over_(.+)": r"log of the stress due to \1 over that due to \2",
    r"log_(.+)_ratio": r"log of \1 over the first modulus",
    r"log_(.+)": r"log of \1",
    r"logit_(.+)": r"logit of \1 between its limits",
    r"real_(.+)": r"\1",
}


def meaning_of(name: str, wall: list[NamedLayer], stress: float | None = None) -> str:
    """Return what an unknown means; an empty text if that is not known.

    The `wall` names the parameters of the material, and `stress` is the reference stress, kPa.

    >>> meaning_of("spread[log_b]", [])
    'standard deviation between specimens of the log of b'
    >>> meaning_of("pressure_sd", [])
    'standard deviation of the errors of pressures'
    """
    if name.startswith("|"):
        return f"absolute value of {name.strip('|')}"
    base, _, entry = name.removesuffix("]").partition("[")
    if base in _OF_COORDINATES and entry:
        words = coordinate_in_words(entry, stress)
        return f"{_OF_COORDINATES[base]} of {'the ' * words.startswith('log')}{words}"
    if base in SIZES:
        factor = "√2 × the " if base in SD_OF_SIGMA else ""
        kind = "weight" if base == "slope_weight" else "standard deviation"
        return f"{factor}{kind} of the {SIZES[base].of_what}"
    if base.endswith("_deviation"):
        measure = base.removesuffix("_deviation").replace("_", " ")
        return f"error of the measured {measure}, in standard deviations"
    if base in SPREAD_OF_NOISE.values():
        return "standard deviation between specimens of the log of the measurement error"
    if base == "effect_spread":
        return "standard deviation between specimens of the log of the experiment_spread"
    for number, layer in enumerate(wall, start=1):
        for p in layer.energy.parameters:
            if layer.values.get(p.name) == base:
                of = f" of layer {number}, from inside" if len(wall) > 1 else ""
                return p.description.partition(";")[0] + of
    for table in (IN_TABLES, IN_RESULTS):
        if base in table:
            return table[base].long_name
    return ""


def coordinate_in_words(name: str, stress: float | None = None) -> str:
    """Return what a coordinate of a specimen means.

    >>> coordinate_in_words("log_reference_strain", 20.0)
    'log of the strain (circumferential, or along x) at a stress of 20 kPa'
    """
    at = "the reference stress" if stress is None else f"a stress of {stress:.4g} kPa"
    for pattern, words in _COORDINATES.items():
        if re.fullmatch(pattern, name):
            return re.sub(pattern, words, name).format(stress=at)
    return name


def quantity_in_words(name: str) -> str:
    """Return the words of a quantity by which groups are compared.

    >>> quantity_in_words("log axial_stress"), quantity_in_words("mu")
    ('log of mean axial Cauchy stress', 'mu')
    """
    base = name.removeprefix("log ")
    log = "log of " if base != name else ""
    if base in IN_RESULTS:
        return log + IN_RESULTS[base].long_name
    return log + coordinate_in_words(base)
