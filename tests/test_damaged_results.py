"""Results that are damaged: one error says what is wrong, or what is said of them is sound."""

import re
import warnings
from functools import cache

import numpy as np
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
TUBE = {"inner_radius": 7.0, "outer_radius": 9.0, "axial_stretch": 1.0, "opening_angle": 0.0}


@cache
def results() -> dict[str, xr.DataTree | xr.Dataset]:
    """Small results of every kind."""
    few = {"draws": 100, "progressbar": False, "random_seed": 1}
    variable = variable_classes.fit(draws=100, chains=1)
    return {
        "pooled": fitted(),
        "variable": variable,
        "sampled": ph.sample_smc(model(), chains=2, **few),
        "classified": ph.classify(new_curves(), fitted(), random_seed=1, progressbar=False),
    }


def new_curves() -> xr.Dataset:
    return curves([7.3, 7.7, 8.1, 8.5])


def new_specimen() -> xr.Dataset:
    return variable_classes.curves({"N1": [40.0]}, 7)


def one(tree):
    """A class of a tree of classes, or a sampled model as it is."""
    return tree if "posterior" in tree.children else next(iter(tree.children.values()), tree)


DESIGNS = {"one": {"radius": 8.0, "points": 1}}
OF_ALL = {
    "log_evidence": lambda tree: ph.log_evidence(one(tree)),
    "diagnose_evidence": lambda tree: ph.diagnose_evidence(one(tree)),
    "predict_pressure": lambda tree: ph.predict_pressure(one(tree), [8.0, 8.5], **TUBE),
    "of the data's tube": lambda tree: ph.predict_pressure(one(tree), [8.0, 8.5]),
    "radius_at_pressure": lambda tree: ph.radius_at_pressure(one(tree), [2.0], **TUBE),
    "tube_properties": lambda tree: ph.tube_properties(one(tree), [2.0], **TUBE),
    "wall_stress": lambda tree: ph.wall_stress(one(tree), [2.0], **TUBE),
    "admissible": lambda tree: ph.admissible(one(tree), [8.0], **TUBE),
    "material_card": lambda tree: ph.material_card(one(tree), "febio"),
    "force_offsets": lambda tree: ph.force_offsets(one(tree)),
    "plot_parameter_density": lambda tree: ph.plot_parameter_density(tree, backend="none"),
    "plot_pressure_fit": lambda tree: ph.plot_pressure_fit(tree, backend="none"),
    "plot_axial_force": lambda tree: ph.plot_axial_force(tree, backend="none"),
    "plot_elastic_properties": lambda tree: ph.plot_elastic_properties(
        tree, [10.0, 20.0], tube=TUBE, backend="none"
    ),
    "plot_wall_stress": lambda tree: ph.plot_wall_stress(tree, [10.0], tube=TUBE, backend="none"),
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
            tree, ["mu", "compliance"], pressure=2.0, bayes_factor=False, draws=100, random_seed=1
        ),
        "expected_information": lambda tree: ph.expected_information(
            tree, DESIGNS, specimens=10, draws=32, random_seed=1
        ),
        "plan_study": lambda tree: ph.plan_study(
            tree, "mu", (4,), studies=10, draws=50, random_seed=1
        ),
        "of a specimen": lambda tree: ph.predict_pressure(one(tree), [8.0], specimen="A1"),
    },
    "sampled": OF_ALL
    | {"plot_law_probability": lambda tree: ph.plot_law_probability([tree], backend="none")},
    "classified": {
        "plot_class_probability": lambda result: ph.plot_class_probability(result, backend="none"),
        "score_probabilities": lambda result: ph.score_probabilities(result, ["C1"]),
    },
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
