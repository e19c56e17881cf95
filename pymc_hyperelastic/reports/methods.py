"""The methods of a study in sentences, to be pasted into an article."""

from collections.abc import Mapping

import xarray as xr

from pymc_hyperelastic.data.inflation import extension_tests
from pymc_hyperelastic.data.select import specimens_of
from pymc_hyperelastic.models.settings import inflation_data_of
from pymc_hyperelastic.reports.blocks import Found, in_words, plural
from pymc_hyperelastic.reports.fits import by_name, has_data
from pymc_hyperelastic.reports.settings import Settings, model_sentences, settings_of

# How specimens are integrated, as an article says it.
_INTEGRATED = {"importance": "importance sampling", "bridge": "bridge sampling"}


def fit_sentences(found: Found) -> list[str]:
    """What was fitted, to which data and how, as sentences of an article."""
    settings = settings_of(found.result)
    trees = {name: tree for name, tree in by_name(found).items() if has_data(tree)}
    data = {name: inflation_data_of(tree) for name, tree in trees.items()}
    specimens = {name: len(specimens_of(d)[0]) for name, d in data.items()}
    modelled = model_sentences(settings, several=max(specimens.values(), default=1) > 1)
    return [*_data_sentences(data, specimens), *modelled, *_sampling(found, settings)]


def _data_sentences(data: Mapping[str, xr.Dataset], specimens: Mapping[str, int]) -> list[str]:
    if not data:
        return []
    of = ""
    if len(data) > 1:
        told = in_words([f"{count} in {name}" for name, count in specimens.items()])
        of = f" ({told})"
    extended = any(extension_tests(d).any() for d in data.values())
    simulated = any(d.attrs.get("simulated") for d in data.values())
    curves = "inflation and extension curves" if extended else "inflation curves"
    tests, points = (sum(d.sizes[dim] for d in data.values()) for dim in ("test", "obs"))
    forces = ""
    if any("axial_force" in d for d in data.values()):
        forces = " Axial forces were measured too."
    return [
        f"The {'simulated ' if simulated else ''}{curves} of "
        f"{plural(sum(specimens.values()), 'specimen')}{of} were analysed: "
        f"{plural(tests, 'experiment')} with {plural(points, 'point')}.{forces}"
    ]


def _sampling(found: Found, settings: Settings) -> list[str]:
    trees = list(by_name(found).values())
    chains = plural(settings.chains, "independent chain")
    each = "" if settings.chains == 1 else " each"
    draws = f"{chains} of {plural(settings.draws, 'draw')}{each}"
    if settings.variability:
        stored = (tree["specimens"].data_vars for tree in trees if "specimens" in tree.children)
        methods = {str(m) for own in stored for m in own["method"].values}
        told = in_words([_INTEGRATED.get(method, method) for method in sorted(methods)])
        by = f" by {told}" if told else ""
        return [
            f"The parameters of each specimen were integrated{by}, and the posterior of the "
            f"distribution of each class was sampled in {draws}, with its evidence."
        ]
    if all("evidence" in tree.children for tree in trees):
        return [
            f"Posteriors were sampled by sequential Monte Carlo in {draws}, which also gives the "
            "evidence and its standard error."
        ]
    return [f"Posteriors were sampled in {draws}."]
