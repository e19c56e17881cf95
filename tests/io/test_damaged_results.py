"""Damaged results are refused with the name of the damaged part, or give the same numbers."""

import json
import re
import warnings
from collections.abc import Callable, Iterator
from dataclasses import asdict
from functools import cache

import fits
import numpy as np
import pymc as pm
import pytensor
import pytest
import variable_classes
import xarray as xr
from tiers import deep

import pymc_hyperelastic as ph
from pymc_hyperelastic.models.priors import prior_from_record
from pymc_hyperelastic.models.settings import SETTINGS, ModelSettings
from pymc_hyperelastic.reports.settings import settings_of

# Words of errors that Python or NumPy raise themselves, and that do not help a user.
PYTHON_ERRORS = re.compile(
    r"subscriptable|NoneType|could not convert|not iterable|zip\(\)|broadcast|unhashable|ufunc|"
    r"invalid literal|truth value|unexpected keyword|unsupported operand|out of bounds|singular|"
    r"not supported between|must be real number|positional argument|has no attribute|same kind|"
    r"object is not|need at least one|zero-size|conflicting sizes|shape mismatch|too many values"
)
TUBE = ph.Tube(7.0, 9.0, axial_stretch=1.0, opening_angle=0.0)
AT = ph.Conditions([2.0], tube=TUBE)
FEW = {"specimens": 10, "draws": 64, "random_seed": 1}
Groups = dict[str, xr.Dataset]


def classify(tree: xr.DataTree) -> xr.Dataset:
    if "stiff" in tree.children:
        return variable_classes.classify(variable_classes.curves({"N1": [40.0]}, 7), tree)
    data = ph.select(ph.load_dataset("simulated_sheep_aorta"), specimen="S1", experiment=3)
    return ph.classify(data, tree, random_seed=1, progressbar=False)


def compare(tree: xr.DataTree) -> xr.Dataset:
    settings = {"effect_prior": None, "draws": 100, "random_seed": 1}
    return ph.compare_classes(tree, "compliance", at=[1.0, 2.0], **settings)


def inform(tree: xr.DataTree) -> xr.Dataset:
    return ph.expected_information(tree, {"one": {"radius": 8.0, "points": 1}}, **FEW)


@cache
def result(kind: str) -> xr.DataTree:
    return fits.fit("neo_hookean_classes" if kind == "variable" else kind)


def one(tree: xr.DataTree) -> xr.DataTree:
    """Return the first class of classes, or a sampled model as it is."""
    groups = {"posterior", "evidence", "constant_data"}
    return tree if groups & set(tree.children) else next(iter(tree.children.values()), tree)


CALLS_OF_ONE_CLASS = {
    "log_evidence": lambda tree: ph.log_evidence(one(tree)),
    "diagnose_evidence": lambda tree: ph.diagnose_evidence(one(tree)),
    "predict_pressure": lambda tree: ph.predict_pressure(one(tree), [8.0, 8.5], tube=TUBE),
    "radius_at_pressure": lambda tree: ph.radius_at_pressure(one(tree), AT),
    "tube_properties": lambda tree: ph.tube_properties(one(tree), AT),
    "wall_stress": lambda tree: ph.wall_stress(one(tree), AT),
    "is_admissible": lambda tree: ph.is_admissible(one(tree), [8.0], tube=TUBE),
    "material_card": lambda tree: ph.material_card(one(tree), "febio"),
}
OF_CLASSES = {
    "pooled": {
        "classify": classify,
        "kl_divergence": lambda tree: ph.kl_divergence(tree, "C1", "C2"),
    },
    "variable": {
        "classify": classify,
        "compare_classes": compare,
        "expected_information": inform,
        "plan_study": lambda tree: ph.plan_study(
            tree, "compliance", (4,), at=2.0, studies=10, draws=50, random_seed=1
        ),
        "of a specimen": lambda tree: ph.predict_pressure(one(tree), [8.0], specimen="A1"),
    },
    "sampled": {},
}  # fmt: skip
CALLS = {kind: CALLS_OF_ONE_CLASS | own for kind, own in OF_CLASSES.items()}


def refusal(call: Callable[[xr.DataTree], object], damaged: xr.DataTree) -> str:
    """Return the message by which a call refuses a result, or nothing if it does not."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            call(damaged)
        except (TypeError, ValueError) as error:
            assert str(error) and not PYTHON_ERRORS.search(str(error)), error
            return str(error)
    return ""


def groups_of(whole: xr.DataTree) -> Groups:
    """Return the groups by path."""
    return {n.relative_to(whole): n.to_dataset(inherit=False) for n in whole.subtree}


def altered(kind: str, change: Callable[[Groups], None]) -> xr.DataTree:
    groups = groups_of(result(kind))
    change(groups)
    return xr.DataTree.from_dict({"/" if path == "." else path: g for path, g in groups.items()})


def attribute(name: str, value=None, only: str | None = None):
    """Replace an attribute in all groups that have it, or in one; None leaves it out."""

    def change(groups):
        for path, data in groups.items():
            if name in data.attrs and only in (None, path):
                del data.attrs[name]
                if value is not None:
                    data.attrs[name] = value

    return change


def within(*place, value):
    """Replace something in the settings of the model."""

    def change(groups):
        for data in groups.values():
            if SETTINGS in data.attrs:
                whole = part = json.loads(data.attrs[SETTINGS])
                for key in place[:-1]:
                    part = part[key]
                part[place[-1]] = value
                data.attrs[SETTINGS] = json.dumps(whole)

    return change


def layered(damage: Callable[[Groups], None]):
    """Make the material of classes two layers, and damage them."""
    layers = [ph.Layer(ph.NeoHookean(), pm.LogNormal.dist()), ph.Layer(ph.Demiray(), 0.8, b=0.5)]
    record = asdict(ModelSettings.of(layers, {}))
    wall = {name: record[name] for name in ("layers", "thickness_priors")}

    def change(groups):
        for data in groups.values():
            if SETTINGS in data.attrs:
                data.attrs[SETTINGS] = json.dumps(json.loads(data.attrs[SETTINGS]) | wall)
        damage(groups)

    return change


def group(path: str, alter: Callable[[xr.Dataset], xr.Dataset | None]):
    """Replace a group by what a function makes of it; None leaves it out."""

    def change(groups):
        groups[path] = alter(groups[path])
        if groups[path] is None:
            del groups[path]

    return change


def gone(data):
    return None


def holding(name: str, value):
    """Replace the first number of a variable."""

    def alter(data):
        values = data[name].values.copy()
        values.flat[0] = value
        return data.assign({name: (data[name].dims, values)})

    return alter


def texts(name: str):
    return lambda data: data.assign({name: (data[name].dims, data[name].values.astype(str))})


BLAME = "it was not written by pymc_hyperelastic, or is damaged"
# A kind of result, its damage, a call, and a regular expression of the message.
DAMAGE = {
    "attribute cut off": ("pooled", attribute(SETTINGS, "{"), "classify", "settings is no JSON"),
    "settings are a number": (
        "pooled", attribute(SETTINGS, 1.5), "classify", "model_settings is 1.5; expected",
    ),
    "settings nested too deeply": (
        "pooled", attribute(SETTINGS, "[" * 100_000), "classify", "model_settings is no J",
    ),
    "settings of an older format": (
        "pooled", attribute(SETTINGS, "{}"), "classify", "have the format None; expected 2",
    ),
    "negative noise": ("pooled", within("likelihood", "sigma", value=-1), "classify", "sigma.*-1"),
    "no noise": ("pooled", within("likelihood", value=None), "classify", "'C1' is no class"),
    "no priors": ("pooled", within("priors", value={}), "classify", "priors lack.*'mu'"),
    "unknown law": (
        "pooled", within("layers", 0, "strain_energy", value="Own"), "classify", "'Own'.*import",
    ),
    "unknown entry": ("pooled", within("weight", value=1), "classify", "unknown entries .'weight'"),
    "unknown variability": (
        "variable", within("variability", value="cloud"), "classify", "'cloud'.*'specimen'",
    ),
    "no posterior": ("sampled", group("posterior", gone), "predict_pressure", "no posterior"),
    "NaN": (
        "sampled", group("posterior", holding("mu", np.nan)), "tube_properties",
        "1 of 1000 numbers of 'mu'.*NaN",
    ),
    "geometry of text": (
        "sampled", group("constant_data", texts("inner_radius")), "tube_properties",
        "'inner_radius' must hold numbers.*<U",
    ),
    "negative spread": (
        "variable", group("stiff/posterior", holding("spread", -1.0)), "compare_classes",
        "class 'stiff'.*'spread'.*not positive",
    ),
    "unknown verdict": (
        "sampled", attribute("verdict", "splendid"), "log_evidence", "'splendid'.*'doubtful'",
    ),
    "experiment effect is a number": (
        "variable", within("experiment_effect", value=1), "classify", "is 1; expected t",
    ),
    "negative reference stress": (
        "variable", within("reference_stress", value=-1), "classify", "is -1; expected a",
    ),
    "error is a list": (
        "variable", within("likelihood", "pressure_sd", value=[]), "classify", "is .]; exp",
    ),
    "geometry error is text": (
        "variable", within("geometry_sd", value={"thickness": "a"}), "classify",
        "geometry_sd.thickness is 'a'; expected a number or null",
    ),
    "no layer": ("variable", layered(within("layers", value=[])), "classify", "holds no layers"),
    "layers are no list": (
        "variable", layered(within("layers", value={})), "classify", "expected a JSON li",
    ),
    "layer is a number": (
        "variable", layered(within("layers", 0, value=3)), "classify", "is 3; expected",
    ),
    "invalid law of a layer": (
        "variable", layered(within("layers", 0, "settings", value="[")), "classify",
        r"layers\[0\].settings is '\['; expected a JSON object",
    ),
    "layer without thickness": (
        "variable", layered(within("layers", 1, "values", value={})), "classify",
        "its layers have the values .*{}.; expected a thickness in each",
    ),
    "layer without parameters": (
        "variable", layered(within("layers", 1, "values", value={"thickness": 1.0})), "classify",
        "a layer of Demiray has the values {'thickness': 1.0}; expected ",
    ),
    "parameter of a layer is a list": (
        "variable", layered(within("layers", 1, "values", "b", value=[])), "classify",
        r"b of a layer has the values \[\]; expected",
    ),
    "material has a fixed parameter": (
        "pooled", within("layers", 0, "values", "mu", value=2.0), "classify",
        "its layers have the values .*2.0.*; expected a thickness in each, or one material",
    ),
    "parameter of a layer is null": (
        "variable", layered(within("layers", 1, "values", "b", value=None)), "classify",
        r"layers\[1\].values.b is None; expected text or a number or a JSON list",
    ),
    "thickness without prior": (
        "variable", layered(within("thickness_priors", value={})), "classify",
        "thickness_priors lack 'thickness_1'",
    ),
}  # fmt: skip


@pytest.mark.parametrize("kind, change, call, message", DAMAGE.values(), ids=DAMAGE)
def test_damaged_part_of_a_result_is_refused_with_what_was_expected(kind, change, call, message):
    found = refusal(CALLS[kind][call], altered(kind, change))
    assert re.search(message, found, re.DOTALL), found or "it was accepted"


def test_refusal_of_a_result_from_a_file_names_the_file(tmp_path):
    ph.save_result(result("pooled"), tmp_path / "classes.nc")
    classes = ph.open_result(tmp_path / "classes.nc")
    for fitted_class in classes.children.values():
        fitted_class.attrs[SETTINGS] = "[]"
    assert refusal(classify, classes) == (
        f"class 'C1' of {tmp_path / 'classes.nc'}: its model_settings is []; expected a JSON "
        f"object; {BLAME}"
    )


def test_open_result_refuses_wrong_settings(tmp_path):
    ph.save_result(altered("pooled", within("likelihood", "sigma", value=-1)), tmp_path / "bad.nc")
    with pytest.raises(ValueError, match=r"the result of .*bad\.nc: .*sigma is -1"):
        ph.open_result(tmp_path / "bad.nc")


def test_result_without_stored_settings_is_refused_with_the_version_it_needs():
    older = altered("pooled", attribute(SETTINGS))
    for fitted_class in older.children.values():
        fitted_class.attrs["priors"] = "{}"
    assert "an older format: it needs pymc_hyperelastic 0.1" in refusal(classify, older)


@pytest.mark.parametrize(
    "change, message",
    [
        (
            within("priors", "mu", value=["logp", [0.0, 1.0]]),
            "the prior of 'mu' is ['logp', [0.0, 1.0]]; expected [name",
        ),
        (
            within("priors", "mu", value=["Nothing", [0.0]]),
            "the prior of 'mu' is ['Nothing', [0.0]]; expected [name",
        ),
        (within("likelihood", "weight", value=1.0), "the argument 'weight'; expected one of"),
        (within("likelihood", "units", value=[]), "has the units []; expected {'sigma': 'kPa'"),
        (within("likelihood", "name", value=["os"]), "expected a record with a name of"),
        (within("likelihood", "sigma", value=["os.system", [1.0]]), "[1.0]]; expected [name"),
        (within("likelihood", "observed", value=1), "observed is 1; expected True or False"),
        (attribute("units", '{"mu": [1]}'), "'units' is {'mu': [1]}; expected the unit of each"),
    ],
)
def test_names_of_distributions_in_settings_are_not_imported(change, message):
    found = refusal(settings_of, altered("pooled", change))
    assert message in found and found.startswith("class 'C1'") and len(found) < 2000, found


UNIFORM = ["Uniform", [0.0, 1.0]]


def test_prior_records_with_unknown_names_or_parameters_are_refused():
    limits, parameters = [0.0, 1.0], ([0.0], "01", [0.0, "1"], [0.0, np.nan], [0.0, [1.0, 2.0]])
    sizes = [*UNIFORM, 0], [*UNIFORM, 2, 2], [*UNIFORM, True]
    names = ("os.system", "Mixture", ["Uniform"])
    records = [["Uniform", p] for p in parameters] + [[name, limits] for name in names]
    for record in ("Uniform", *records, *sizes, ["Uniform", [0.0, [1.0, 2.0, 3.0]], 2]):
        with pytest.raises(ValueError) as refused:
            prior_from_record(record, "mu")
        assert f"'mu' is {record!r}; expected [name, parameters], or [name" in str(refused.value)
    shape = prior_from_record([*UNIFORM, 2], "mu").type.shape
    assert shape == (2,)


CARD_COMMENT = re.compile("<!--.*?-->", re.DOTALL)
# Free text about the data, which nothing can check.
FREE_TEXT = {"title", "description", "source", "simulated"}
# Words that name a part of a result besides its own name.
OTHER_NAMES = {
    "observed_data": ["pressure"],
    "constant_data": ["inner_radius", "test"],
    SETTINGS: ["reference_stress", "class"],
    "strain_energy": ["strain energy"],
    "settings": ["strain energy"],
    "fingerprint": ["another formula"],
    "values": ["layer", "posterior lacks"],
    "reference_stress": ["coordinates"],
    "format": ["an older format"],
    "priors": ["reference_stress"],
}
# Results of older versions have no misfits of their specimens, by which fits are judged.
MAY_DIFFER = {"fit_p_value"}
# The first tier tries every ninth damage, and by the quick calls only.
EVERY = 9


def places(record: object, above: tuple = ()) -> Iterator[tuple]:
    """Yield the place of each entry of a record, and of entries of its entries."""
    entries = record.items() if isinstance(record, dict) else enumerate(record)
    for name, value in entries:
        yield (*above, name)
        if isinstance(value, dict | list):
            yield from places(value, (*above, name))


def damages(kind: str) -> Iterator[tuple[str, list[str], Callable[[Groups], None]]]:
    """Yield each damage of the first class: its description, names of the part, and the change."""
    first = {"sampled": ".", "pooled": "C1", "variable": "soft"}[kind]
    for path, data in groups_of(result(kind)).items():
        # A diagnosis is shown as it is stored.
        own = path.split("/")[-1]
        if own == "diagnosis" or (first != "." and path.split("/")[0] not in (".", first)):
            continue
        for name in sorted(set(data.attrs) - FREE_TEXT):
            for value in (None, "{", -1.5):
                yield f"attribute {path} {name} {value}", [name], attribute(name, value, path)
        for place in places(json.loads(data.attrs.get(SETTINGS, "{}"))):
            for value in (None, [], {}, "{", -1.5):
                # Another number in a prior makes another prior, which nothing contradicts.
                if value == -1.5 and place[0] == "priors" and len(place) > 2:
                    continue
                change = within(*place, value=value)
                yield f"settings {path} {place} {value}", [*map(str, place)], change
        if path in (".", first):
            continue
        changes = [("no", path, gone), ("empty", path, lambda d: xr.Dataset(attrs=d.attrs))]
        for name in map(str, data.data_vars):
            changes += [("no", name, lambda d, name=name: d.drop_vars(name))]
            changes += [("dates", name, dates(name))]
            if data[name].dtype.kind in "fi":
                changes += [("text", name, texts(name))]
            if data[name].dtype.kind == "f" and data[name].size:
                changes += [("NaN", name, holding(name, np.nan))]
        for dim in map(str, data.sizes):
            changes += [("none of", dim, lambda d, dim=dim: d.isel({dim: []}))]
            changes += [("renamed", dim, renamed(dim))]
        for what, name, change in changes:
            yield f"{what} {name} in {path}", [own, name], group(path, change)


def dates(name: str):
    day = np.datetime64("2020-01-01", "ns")
    return lambda data: data.assign({name: (data[name].dims, np.full(data[name].shape, day))})


def renamed(dim: str):
    return lambda data: data.drop_vars(dim, errors="ignore").rename_dims({dim: "stranger"})


def same_numbers(found, expected) -> bool:
    """Return whether no number is another one; fewer numbers, NaN or an infinite error may be."""
    if isinstance(found, xr.Dataset):
        pairs = [(found[n].values, expected[n].values) for n in {*found.data_vars} - MAY_DIFFER]
        return all(np.all((a == b) | (a != a)) for a, b in pairs)
    if isinstance(found, str):  # comments of a card describe the data
        return CARD_COMMENT.sub("", found) == CARD_COMMENT.sub("", expected)
    errors = (expected.standard_error, np.inf)
    return found.value == expected.value and found.standard_error in errors


@pytest.mark.parametrize(
    "kind, every", [*((kind, EVERY) for kind in CALLS), *deep((kind, 1) for kind in CALLS)]
)
# Nearly every case makes a model of its own, which is evaluated a few times.
@pytensor.config.change_flags(mode="FAST_COMPILE", traceback__limit=0)
def test_every_systematic_damage_is_refused_with_its_part_or_changes_no_number(kind, every):
    """Consecutive damages are tested with different calls."""
    calls = list((CALLS[kind] if every == 1 else CALLS_OF_ONE_CLASS).items())
    refused, wrong = 0, []
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        whole = altered(kind, lambda groups: None)
        expected = {name: call(whole) for name, call in calls}
        for i, (what, names, change) in enumerate(list(damages(kind))[::every]):
            name, call = calls[i % len(calls)]
            names = [*names, *(other for n in names for other in OTHER_NAMES.get(n, []))]
            try:
                damaged = altered(kind, change)
            except ValueError:  # groups that do not fit together make no tree
                continue
            try:
                found = call(damaged)
            except (TypeError, ValueError) as error:
                refused += 1
                if PYTHON_ERRORS.search(str(error)) or not any(
                    part in str(error) for part in names
                ):
                    wrong.append(f"{name}, {what}: {error}")
            else:
                if not same_numbers(found, expected[name]):
                    wrong.append(f"{name}, {what}: other numbers")
    assert not wrong, "\n".join(wrong)
    assert refused, "no damage was refused: the search is broken"
