"""Results that are damaged: one error says what is wrong, or what is said of them is sound."""

import re
import warnings
from functools import cache, partial

import numpy as np
import pymc as pm
import pytest
import variable_classes
import xarray as xr
from bad_input import curves, fitted, model

import pymc_hyperelastic as ph

# Python's own words, which tell a user nothing.
BARE = re.compile(
    r"subscriptable|NoneType|could not convert|not iterable|zip\(\)|broadcast|empty sequence|"
    r"invalid literal|truth value|unexpected keyword|unhashable|unsupported operand|out of bounds|"
    r"not supported between|must be real number|positional argument|has no attribute|"
    r"object is not|need at least one|zero-size|conflicting sizes|ufunc|setting an array|"
    r"not enough values|too many values|shape mismatch|same kind|is not a valid dim|singular"
)
PROBABILITY_SUM = 1e-9
DESIGNS = {"one": {"radius": 8.0, "points": 1}}
FEW = {"specimens": 10, "draws": 32, "random_seed": 1}
TUBE = {"inner_radius": 7.0, "outer_radius": 9.0, "axial_stretch": 1.0, "opening_angle": 0.0}


@cache
def results() -> dict[str, xr.DataTree | xr.Dataset]:
    """Small results of every kind."""
    few = {"draws": 100, "progressbar": False, "random_seed": 1}
    variable = variable_classes.fit(draws=100, chains=1)
    # With all that a class may hold: several coordinates, noise of each specimen, experiments.
    noise = {"sigma": None, "noise_sd": pm.HalfNormal.dist(0.5), "experiment_effect": True}
    full = variable_classes.fit(ph.Demiray(), draws=100, chains=1, **noise)
    wall = [ph.Layer(ph.NeoHookean(), pm.LogNormal.dist(0, 0.2)), ph.Layer(ph.Demiray(), 1.0)]
    training = {name: unknown_wall(data) for name, data in variable_classes.TRAINING.items()}
    layered = variable_classes.fit(wall, training, draws=100, chains=1)
    compare = partial(ph.compare_classes, variable, bayes_factor=False, draws=100, random_seed=1)
    return {
        "full": full,
        "layered": layered,
        "compared": compare("mu"),
        "compared over pressures": compare("compliance", pressure=[1.0, 2.0]),
        "told": ph.expected_information(variable, DESIGNS, **FEW),
        "scored": ph.score_probabilities(
            ph.classify(new_curves(), fitted(), random_seed=1, progressbar=False), ["C1"]
        ),
        "pooled": fitted(),
        "variable": variable,
        "sampled": ph.sample_smc(model(), chains=2, **few),
        "classified": ph.classify(new_curves(), fitted(), random_seed=1, progressbar=False),
    }


def new_curves() -> xr.Dataset:
    return curves([7.3, 7.7, 8.1, 8.5])


def new_specimen() -> xr.Dataset:
    return variable_classes.curves({"N1": [40.0]}, 7)


def unknown_wall(data: xr.Dataset) -> xr.Dataset:
    """The data of tubes whose layers state the wall."""
    return data.assign(outer_radius=data["outer_radius"] * np.nan)


def tube(tree) -> dict[str, float]:
    layered = any("layers" in node.attrs for node in (tree, *tree.children.values()))
    return {name: value for name, value in TUBE.items() if not layered or name != "outer_radius"}


def one(tree):
    """A class of a tree of classes, or a sampled model as it is."""
    return tree if "posterior" in tree.children else next(iter(tree.children.values()), tree)


OF_ALL = {
    "log_evidence": lambda tree: ph.log_evidence(one(tree)),
    "diagnose_evidence": lambda tree: ph.diagnose_evidence(one(tree)),
    "predict_pressure": lambda tree: ph.predict_pressure(one(tree), [8.0, 8.5], **tube(tree)),
    "of the data's tube": lambda tree: ph.predict_pressure(one(tree), [8.0, 8.5]),
    "radius_at_pressure": lambda tree: ph.radius_at_pressure(one(tree), [2.0], **tube(tree)),
    "tube_properties": lambda tree: ph.tube_properties(one(tree), [2.0], **tube(tree)),
    "wall_stress": lambda tree: ph.wall_stress(one(tree), [2.0], **tube(tree)),
    "admissible": lambda tree: ph.admissible(one(tree), [8.0], **tube(tree)),
    "material_card": lambda tree: ph.material_card(one(tree), "febio"),
    "force_offsets": lambda tree: ph.force_offsets(one(tree)),
    "plot_parameter_density": lambda tree: ph.plot_parameter_density(tree, backend="none"),
    "plot_pressure_fit": lambda tree: ph.plot_pressure_fit(tree, backend="none"),
    "plot_axial_force": lambda tree: ph.plot_axial_force(tree, backend="none"),
    "plot_elastic_properties": lambda tree: ph.plot_elastic_properties(
        tree, [10.0, 20.0], tube=tube(tree), backend="none"
    ),
    "plot_wall_stress": lambda tree: ph.plot_wall_stress(
        tree, [10.0], tube=tube(tree), backend="none"
    ),
}
CALLS = {
    "pooled": OF_ALL
    | {
        "classify": lambda tree: ph.classify(new_curves(), tree, random_seed=1, progressbar=False),
        "kl_divergence": lambda tree: ph.kl_divergence(tree, *[*tree.children, "", ""][:2]),
        "plot_law_probability": lambda tree: ph.plot_law_probability([tree], backend="none"),
    },
    "variable": OF_ALL
    | {
        "classify": lambda tree: variable_classes.classify(new_specimen(), tree),
        "compare_classes": lambda tree: ph.compare_classes(
            tree, "compliance", pressure=2.0, bayes_factor=False, draws=100, random_seed=1
        ),
        "expected_information": lambda tree: ph.expected_information(tree, DESIGNS, **FEW),
        "plan_study": lambda tree: ph.plan_study(
            tree, "compliance", (4,), pressure=2.0, studies=10, draws=50, random_seed=1
        ),
        "of a specimen": lambda tree: ph.predict_pressure(one(tree), [8.0], specimen="A1"),
    },
    "sampled": OF_ALL
    | {"plot_law_probability": lambda tree: ph.plot_law_probability([tree], backend="none")},
    "classified": {
        "plot_class_probability": lambda result: ph.plot_class_probability(result, backend="none"),
        "score_probabilities": lambda result: ph.score_probabilities(result, ["C1"]),
    },
    "compared": {"plot_comparison": lambda table: ph.plot_comparison(table, backend="none")},
    "told": {"plot_information": lambda table: ph.plot_information(table, backend="none")},
    "scored": {"plot_reliability": lambda table: ph.plot_reliability(table, backend="none")},
}
CALLS |= {
    "full": CALLS["variable"],
    "layered": CALLS["variable"]
    | {"classify": lambda tree: variable_classes.classify(unknown_wall(new_specimen()), tree)},
    "compared over pressures": CALLS["compared"],
}


def refused(call, result) -> str:
    """The words in which a call refuses a result; nothing if what it says is sound."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            said = call(result)
        except (TypeError, ValueError) as error:
            message = str(error)
            assert message and not BARE.search(message), message
            return message
    assert_sound(said)
    return ""


def assert_sound(said) -> None:
    """What is said is known, or says itself that it is not."""
    if isinstance(said, xr.Dataset) and "class_probability" in said:
        probability = said["class_probability"].values
        known = said["decision"].values != "cannot be judged"
        assert np.isfinite(probability[known]).all()
        np.testing.assert_allclose(probability[known].sum(axis=1), 1, atol=PROBABILITY_SUM)
    if isinstance(said, xr.Dataset):
        for name in {"pressure", "stiffness", "sigma_tt"} & set(map(str, said.data_vars)):
            assert np.isfinite(said[name].values).all(), name
