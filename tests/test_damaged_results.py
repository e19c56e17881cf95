"""Results that are damaged: one error says what is wrong, or what is said of them is sound."""

import json
import re
import warnings
from functools import cache

import numpy as np
import pymc as pm
import pytensor
import pytest
import variable_classes
import xarray as xr
from anything import cases
from bad_input import curves, fitted, model
from damage import damaged, groups_of, together
from hypothesis import assume, given
from hypothesis.strategies import randoms

import pymc_hyperelastic as ph
from pymc_hyperelastic.models.class_distribution import distributions_of
from pymc_hyperelastic.models.priors import prior_from_record

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


def classified() -> xr.Dataset:
    return ph.classify(new_curves(), result("pooled"), random_seed=1, progressbar=False)


def full() -> xr.DataTree:
    """Classes with all that they may hold: several coordinates, noise, experiments that differ."""
    noise = {"sigma": None, "noise_sd": pm.HalfNormal.dist(0.5), "experiment_effect": True}
    return variable_classes.fit(ph.Demiray(), draws=100, chains=1, **noise)


def layered() -> xr.DataTree:
    wall = [ph.Layer(ph.NeoHookean(), pm.LogNormal.dist(0, 0.2)), ph.Layer(ph.Demiray(), 1.0)]
    training = {name: unknown_wall(data) for name, data in variable_classes.TRAINING.items()}
    return variable_classes.fit(wall, training, draws=100, chains=1)


def compared(quantity: str, **settings) -> xr.Dataset:
    settings |= {"bayes_factor": False, "draws": 100, "random_seed": 1}
    return ph.compare_classes(result("variable"), quantity, **settings)


def sampled() -> xr.DataTree:
    return ph.sample_smc(model(), draws=100, chains=2, random_seed=1, progressbar=False)


# Small results of every kind.
MAKE = {
    "pooled": fitted,
    "variable": lambda: variable_classes.fit(draws=100, chains=1),
    "full": full,
    "layered": layered,
    "sampled": sampled,
    "classified": classified,
    "compared": lambda: compared("mu"),
    "compared over pressures": lambda: compared("compliance", pressure=[1.0, 2.0]),
    "told": lambda: ph.expected_information(result("variable"), DESIGNS, **FEW),
    "scored": lambda: ph.score_probabilities(result("classified"), ["C1"]),
}


@cache
def result(kind: str) -> xr.DataTree | xr.Dataset:
    """A result of a kind, made once; of how sure it is with so few draws nothing is asked."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return MAKE[kind]()


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
    known = {"posterior", "evidence", "constant_data"}
    return tree if known & set(tree.children) else next(iter(tree.children.values()), tree)


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
    # At a pressure a draw that does not reach it has none, which is warned of.
    if isinstance(said, xr.Dataset) and "radius" in said.dims and "stiffness" in said:
        # Powers of a million overflow, of which nothing is known but that they do.
        overflows = np.isinf(said["pressure"].values)
        assert not np.isnan(said["pressure"].values).any()
        assert (np.isfinite(said["stiffness"].values) | overflows).all()


# --- what is wrong with a file is said -----------------------------------------------------------


def altered(kind: str, change) -> xr.DataTree | xr.Dataset:
    """A result without checksums whose groups a function has changed."""
    groups = groups_of(result(kind))
    change(groups)
    return together(groups, isinstance(result(kind), xr.Dataset))


def attribute(name: str, value=None, only: str | None = None):
    """Replace an attribute wherever it is, or in one group; None leaves it out."""

    def change(groups):
        for path, data in groups.items():
            if name in data.attrs and only in (None, path):
                del data.attrs[name]
                if value is not None:
                    data.attrs[name] = value

    return change


def within(name: str, *place, value):
    """Replace something in the JSON of an attribute."""

    def change(groups):
        for data in groups.values():
            if name in data.attrs:
                whole = said = json.loads(data.attrs[name])
                for key in place[:-1]:
                    said = said[key]
                said[place[-1]] = value
                data.attrs[name] = json.dumps(whole)

    return change


def group(path: str, alter):
    """Replace a group by what a function makes of it; None leaves it out."""

    def change(groups):
        groups[path] = alter(groups[path])
        if groups[path] is None:
            del groups[path]

    return change


def holding(name: str, value):
    """A variable of which the first number is another one."""

    def alter(data):
        values = data[name].values.copy()
        values.flat[0] = value
        return data.assign({name: (data[name].dims, values)})

    return alter


def texts(name: str):
    return lambda data: data.assign({name: (data[name].dims, data[name].values.astype(str))})


def none_along(dim: str):
    return lambda data: data.isel({dim: []})


def lacking(name: str):
    return lambda data: data.drop_vars(name)


ENDING = "it was not written by pymc_hyperelastic, or is damaged"
SETTINGS = "variability_settings"
# Each row: what is wrong, a kind of result, how it comes about, a call, and what its error holds.
DAMAGE = [
    # Attributes.
    ("no noise", "pooled", attribute("noise"), "classify", ["class 'C1'", "'noise' is missing"]),
    (
        "no noise of one class",
        "pooled",
        attribute("noise", None, "C2"),
        "classify",
        ["class 'C2'", "'noise' is missing", ENDING],
    ),
    ("null for noise", "pooled", attribute("noise", "null"), "classify", ["'noise'", "None"]),
    ("half of an attribute", "pooled", attribute("priors", "{"), "classify", ["'priors'", "JSON"]),
    ("deep brackets", "pooled", attribute("priors", "[" * 10**5), "classify", ["'priors'", "JSON"]),
    ("number for text", "pooled", attribute("noise", 3), "kl_divergence", ["'noise'", "3", "text"]),
    ("stranger among errors", "pooled", within("noise", "x", value=1), "classify", ["'x'"]),
    ("negative noise", "pooled", within("noise", "sigma", value=-1), "classify", ["sigma", "-1"]),
    (
        "number beyond all",
        "pooled",
        within("noise", "sigma", value=10**400),
        "classify",
        ["prior of 'sigma'", "expected [name"],
    ),
    (
        "prior that is a function of PyMC",
        "pooled",
        within("priors", "mu", value=["sample", [1]]),
        "classify",
        ["class 'C1'", "'mu'", "'sample'", "'Uniform'"],
    ),
    (
        "prior with one parameter",
        "pooled",
        within("priors", "mu", 1, value=[1]),
        "classify",
        ["'mu'", "[1]", "a list of 2"],
    ),
    (
        "prior of text",
        "pooled",
        within("priors", "mu", 1, value=["a", 1]),
        "classify",
        ["'mu'", "'a'", "number"],
    ),
    (
        "prior of NaN",
        "pooled",
        within("priors", "mu", 1, value=[float("nan"), 1]),
        "classify",
        ["'mu'", "nan"],
    ),
    (
        "prior of half a size",
        "pooled",
        within("priors", "mu", value=["Uniform", [0, 1], 0.5]),
        "classify",
        ["'mu'", "size", "0.5"],
    ),
    ("prior left out", "pooled", attribute("priors", "{}"), "classify", ["'priors' lacks", "'mu'"]),
    ("unknown law", "pooled", attribute("strain_energy", "Own"), "classify", ["'Own'", "import"]),
    (
        "unknown setting of a law",
        "pooled",
        attribute("strain_energy_settings", '{"terms": 3}'),
        "predict_pressure",
        ["Ogden", "['terms'] were given"],
    ),
    (
        "list for settings of a law",
        "pooled",
        attribute("strain_energy_settings", "[]"),
        "predict_pressure",
        ["'strain_energy_settings'", "JSON object"],
    ),
    (
        "unknown variability",
        "variable",
        attribute("variability", "cloud"),
        "classify",
        ["'cloud'", "'specimen'"],
    ),
    (
        "no settings",
        "variable",
        attribute(SETTINGS, "{}"),
        "classify",
        ["class 'soft'", "experiment_effect"],
    ),
    (
        "text for yes or no",
        "variable",
        within(SETTINGS, "experiment_effect", value="no"),
        "classify",
        ["experiment_effect", "'no'", "true or false"],
    ),
    (
        "text for a stress",
        "variable",
        within(SETTINGS, "reference_stress", value="20"),
        "predict_pressure",
        ["reference_stress", "'20'", "kPa"],
    ),
    (
        "list for priors of a class",
        "variable",
        within(SETTINGS, "priors", value=[1]),
        "compare_classes",
        ["class 'soft'", "priors", "[1]"],
    ),
    (
        "error of an unknown measure",
        "variable",
        within(SETTINGS, "geometry_sd", value={"weight": 1.0}),
        "classify",
        ["'weight'", "inner_radius"],
    ),
    ("units in a list", "sampled", attribute("units", "[1]"), "plot_parameter_density", ["units"]),
    # Groups.
    ("no posterior", "pooled", group("C1/posterior", lambda _: None), "classify", ["'posterior'"]),
    (
        "no posterior of a sampled model",
        "sampled",
        group("posterior", lambda _: None),
        "predict_pressure",
        ["no posterior", "'evidence'"],
    ),
    (
        "empty posterior",
        "sampled",
        group("posterior", lambda _: xr.Dataset()),
        "radius_at_pressure",
        ["'posterior' is empty"],
    ),
    ("no draws", "sampled", group("posterior", none_along("draw")), "wall_stress", ["'draw'"]),
    (
        "NaN among draws",
        "sampled",
        group("posterior", holding("mu", np.nan)),
        "tube_properties",
        ["1 of 200 numbers of 'mu'", "NaN"],
    ),
    ("draws of text", "sampled", group("posterior", texts("mu")), "admissible", ["'mu'", "<U"]),
    (
        "NaN in a class",
        "pooled",
        group("C2/posterior", holding("alpha", np.inf)),
        "classify",
        ["class 'C2'", "'alpha'", "infinite"],
    ),
    (
        "no inflation data",
        "pooled",
        group("C1/constant_data", lambda _: None),
        "classify",
        ["class 'C1'", "no group 'constant_data'"],
    ),
    (
        "no pressures",
        "sampled",
        group("observed_data", lambda _: None),
        "predict_pressure",
        ["inflation data lack 'pressure'"],
    ),
    (
        "no specimens",
        "variable",
        group("soft/constant_data", lacking("specimen")),
        "expected_information",
        ["class 'soft'", "lack 'specimen'"],
    ),
    (
        "no particles of one class",
        "pooled",
        group("C2/unconstrained_posterior", lacking("mu_interval__")),
        "classify",
        ["class 'C2'", "'mu_interval__'", "missing"],
    ),
    (
        "no spread of one class",
        "variable",
        group("stiff/posterior", lacking("spread")),
        "classify",
        ["class 'stiff'", "'spread'", "missing"],
    ),
    (
        "negative spread",
        "variable",
        group("stiff/posterior", holding("spread", -1.0)),
        "compare_classes",
        ["class 'stiff'", "'spread'", "not positive"],
    ),
    (
        "no draws of specimens",
        "variable",
        group("soft/specimens", lambda _: None),
        "plan_study",
        ["class 'soft'", "'specimens'"],
    ),
    (
        "specimens without weights",
        "variable",
        group("soft/specimens", lacking("log_weight")),
        "of a specimen",
        ["'log_weight'", "'A1'", "missing"],
    ),
    (
        "evidence of text",
        "sampled",
        group("evidence", texts("log_evidence")),
        "log_evidence",
        ["'log_evidence'", "expected numbers"],
    ),
    (
        "evidence without errors",
        "sampled",
        group("evidence", lacking("log_evidence_se")),
        "diagnose_evidence",
        ["'log_evidence_se'", "missing"],
    ),
    (
        "strange verdict",
        "sampled",
        attribute("verdict", "splendid"),
        "log_evidence",
        ["'splendid'", "'doubtful'"],
    ),
    # Figures of results.
    (
        "probabilities of text",
        "classified",
        group(".", texts("class_probability")),
        "plot_class_probability",
        ["'class_probability'", "expected numbers"],
    ),
    (
        "probabilities of nobody",
        "classified",
        group(".", lambda table: table.isel(test=0)),
        "plot_class_probability",
        ["'class_probability'", "dimensions", "class_label"],
    ),
    (
        "text for a limit",
        "classified",
        attribute("none_below", "low"),
        "plot_class_probability",
        ["'none_below'", "'low'", "number"],
    ),
    # Found by damage at random.
    (
        "numbers in letters among the data",
        "sampled",
        group("constant_data", texts("inner_radius")),
        "tube_properties",
        ["'inner_radius' must hold numbers", "<U"],
    ),
    (
        "pressures in letters",
        "compared over pressures",
        group(".", lambda table: table.assign_coords(pressure=["low", "high"])),
        "plot_comparison",
        ["'pressure'", "expected numbers"],
    ),
    (
        "one bound",
        "compared",
        group(".", lambda table: table.isel(bound=[0])),
        "plot_comparison",
        ["'effect_size_interval'", "two bounds"],
    ),
    (
        "designs without names",
        "told",
        group(".", lacking("design")),
        "plot_information",
        ["lacks 'design'"],
    ),
    (
        "designs along another dimension",
        "told",
        group(".", lambda table: table.drop_vars("design").rename_dims(design="stranger")),
        "plot_information",
        ["the result lacks 'design'"],
    ),
]


@pytest.mark.parametrize(
    ("kind", "change", "call", "fragments"), [pytest.param(*row[1:], id=row[0]) for row in DAMAGE]
)
def test_what_is_wrong_is_said(kind, change, call, fragments):
    """One error names the class, what is wrong and what was expected."""
    message = refused(CALLS[kind][call], altered(kind, change))
    assert message, "it was accepted"
    assert not [fragment for fragment in fragments if fragment not in message], message


def test_the_file_is_named(tmp_path):
    """Of a result that was read from a file, an error says from which."""
    ph.save_result(result("pooled"), tmp_path / "classes.nc")
    classes = ph.open_result(tmp_path / "classes.nc")
    for fitted_class in classes.children.values():
        del fitted_class.attrs["checksum"], fitted_class.attrs["noise"]
    assert refused(CALLS["pooled"]["classify"], classes) == (
        f"class 'C1' of {tmp_path / 'classes.nc'}: its attribute 'noise' is missing; {ENDING}"
    )


@pytest.mark.parametrize("name", ["sample", "os.system", "__class__", "math.np", "Mixture", "CAR"])
def test_names_in_a_file_are_looked_up_in_a_table(name):
    """A name that is no distribution that is stored is nothing, whatever PyMC calls so."""
    with pytest.raises(ValueError, match="is no distribution that is stored with results"):
        prior_from_record([name, [0.0, 1.0]], "mu")


def test_labels_that_are_no_text_are_written_as_text():
    """A file may have made something else of them."""
    table = result("told").assign_coords(design=[3])
    assert ph.plot_information(table, backend="none").viz["points"]["information"].size


def test_correlations_that_are_missing_are_named():
    """Of a class of two coordinates, where nothing else asks for them before they are used."""
    of_class = ("chain", "draw", "coordinate")
    names = {"coordinate": ["a", "b"]}
    posterior = xr.Dataset(
        {n: (of_class, np.ones((1, 9, 2))) for n in ("location", "spread")}, names
    )
    with pytest.raises(ValueError, match="the variable 'correlation' of 'posterior' is missing"):
        distributions_of(xr.DataTree.from_dict({"posterior": posterior}))


def test_without_checksum_older_files_are_read():
    """What is sound is read, though nothing vouches for it."""
    for kind, call in (
        ("pooled", "classify"),
        ("variable", "classify"),
        ("sampled", "wall_stress"),
    ):
        assert not refused(CALLS[kind][call], altered(kind, lambda groups: None))


# --- anything may be wrong -----------------------------------------------------------------------

# Damaged results of each kind; each is given to so many functions.
CASES, AT_ONCE = 8, 3


@pytest.mark.deep
@pytest.mark.parametrize("kind", CALLS)
# Nearly every case makes a model of its own, which is evaluated a few times.
@pytensor.config.change_flags(mode="FAST_COMPILE", traceback__limit=0)
def test_whatever_is_damaged(kind):
    """An error that says what is wrong, or a sound result."""
    whole, single = groups_of(result(kind)), isinstance(result(kind), xr.Dataset)

    @cases(CASES)
    @given(randoms())
    def try_it(random):
        try:
            damaged_result = together(damaged(whole, random), single)
        except ValueError:  # groups that do not fit together make no tree
            assume(False)
        for name in random.sample(sorted(CALLS[kind]), min(AT_ONCE, len(CALLS[kind]))):
            refused(CALLS[kind][name], damaged_result)

    try_it()
