"""Cards of finite-element codes, read back, have the energy of the posterior's material.

The energies of the codes are written here once more, from their manuals, and evaluated in global
coordinates at points around a tube along the z axis: axes and angles count.
"""

import re
from functools import partial
from math import exp, log
from xml.etree import ElementTree

import fits
import numpy as np
import pytensor.tensor as pt
import pytest
import xarray as xr
from bad_input import assert_refused
from problems import AS_WRITTEN, LAWS
from tube_posteriors import fitted_tree, one_draw, result

import pymc_hyperelastic as ph

# The same energy from numbers of 16 digits, some of them differences of powers.
ROUNDING = 1e-12
SEED = 5
CODES = ("febio", "abaqus")
# The ordinary parameters of each law that the documentation of `material_card` lists.
ORDINARY = {
    name: (law.strain_energy, law.parameters[0][0])
    for name, law in LAWS.items()
    if law.strain_energy.name in ph.material_card.__doc__
}
# Laws without a card, and part of the reason that the error gives.
TWO_DIMENSIONS = dict.fromkeys(["CriscioneType", "FungOrthotropic"], "radial strain")
NO_CARD = {
    "febio": TWO_DIMENSIONS,
    "abaqus": TWO_DIMENSIONS
    | {"FourFiber": "different moduli"}
    | dict.fromkeys(["Demiray", "Gent", "PowerLawNeoHookean"], "user subroutine UHYPER only"),
}
LANGEVIN = (1 / 2, 1 / 20, 11 / 1050, 19 / 7000, 519 / 673750)


def stretched():
    """Stretches (radial, hoop, axial) without change of volume: also such that fibres slacken."""
    rng = np.random.default_rng(SEED)
    plane = np.exp(rng.uniform([-0.25, -0.25], [0.5, 0.4], size=(12, 2)))
    return np.column_stack([1 / plane.prod(axis=1), plane])


def around(stretches):
    """Points of a tube along z, with the right Cauchy-Green tensor in global coordinates there."""
    rng = np.random.default_rng(SEED + 1)
    for stretch, azimuth in zip(stretches, rng.uniform(0, 2 * np.pi, len(stretches)), strict=True):
        radial = np.array([np.cos(azimuth), np.sin(azimuth), 0.0])
        basis = np.column_stack([radial, np.cross([0, 0, 1.0], radial), [0, 0, 1.0]])
        yield radial, basis @ np.diag(stretch**2) @ basis.T


def spread(parameters, draws=4):
    """A posterior of a few draws about parameters, on one chain."""
    rng = np.random.default_rng(SEED + 2)
    return result(
        **{k: np.multiply.outer(rng.uniform(0.9, 1.1, draws), v) for k, v in parameters.items()}
    )


def energies(energy, parameters, stretches):
    """Energies by the package."""
    values = {k: tuple(v) if np.ndim(v) else v for k, v in parameters.items()}
    return energy.energy(*map(pt.as_tensor, stretches.T), **values).eval(mode=AS_WRITTEN)


def invariants(c):
    return np.trace(c), (np.trace(c) ** 2 - np.trace(c @ c)) / 2


def fibres(c, direction, k1, k2, kappa=0.0):
    """``k1/(2 k2) {exp[k2 <E>^2] - 1}`` of a family."""
    strain = kappa * (np.trace(c) - 3) + (1 - 3 * kappa) * (direction @ c @ direction - 1)
    return k1 / (2 * k2) * np.expm1(k2 * max(strain, 0.0) ** 2)


def ogden(c, terms):
    """Of (factor, exponent): ``factor (l1^exponent + ... - 3)``."""
    stretches = np.sqrt(np.linalg.eigvalsh(c))
    return sum(factor * (np.sum(stretches**power) - 3) for factor, power in terms)


# --- FEBio ---------------------------------------------------------------------------------------


def febio_materials(card):
    root = ElementTree.fromstring(card)
    assert (root.tag, root.get("version")) == ("febio_spec", "4.0")
    (section,) = root
    assert section.tag == "Material"
    assert [m.get("id") for m in section] == [str(i + 1) for i in range(len(section))]
    return {m.get("name"): m for m in section}


def vector(element, tag):
    return np.array([float(x) for x in element.find(tag).text.split(",")])


def febio_axes(axes, radial):
    """Cylindrical axes: FEBio User's Manual, mat_axis, "cylindrical"; x turned to the radius."""
    assert axes.get("type") == "cylindrical"
    axis, reference = vector(axes, "axis"), vector(axes, "vector")
    turn = np.column_stack([radial, np.cross(axis, radial), axis])
    first = turn @ reference
    second = turn @ [0, 1, 0]
    second = turn @ [0, 0, 1] if abs(second @ first) > 0.99 else second
    third = np.cross(first, second)
    return np.column_stack([first, np.cross(third, first), third])


def febio_numbers(element):
    return {e.tag: float(e.text) for e in element if not len(e) and e.tag not in ("W", "fiber")}


def febio_energy(material, radial, c, axes=None):
    """FEBio User's Manual, chapter Materials, "Uncoupled materials", at J = 1."""
    v, kind = febio_numbers(material), material.get("type")
    first, second = invariants(c)
    if kind == "Mooney-Rivlin":
        return v["c1"] * (first - 3) + v["c2"] * (second - 3)
    if kind == "Yeoh":
        return sum(v[f"c{i}"] * (first - 3) ** i for i in (1, 2, 3))
    if kind == "Ogden":
        count = (len(v) - 1) // 2
        return ogden(c, [(v[f"c{i}"] / v[f"m{i}"] ** 2, v[f"m{i}"]) for i in range(1, count + 1)])
    if kind == "Holzapfel-Gasser-Ogden":
        axes = febio_axes(material.find("mat_axis"), radial)
        gamma = np.deg2rad(v["gamma"])
        families = (axes @ [np.cos(gamma), sign * np.sin(gamma), 0] for sign in (1, -1))
        tense = sum(fibres(c, a, v["k1"], v["k2"], v["kappa"]) for a in families)
        return v["c"] / 2 * (first - 3) + tense
    if kind == "uncoupled solid mixture":
        axes = febio_axes(material.find("mat_axis"), radial)
        return sum(febio_energy(solid, radial, c, axes) for solid in material.iter("solid"))
    if kind == "fiber-exp-pow-uncoupled":
        assert material.find("fiber").get("type") == "vector"
        strain = max((a := axes @ vector(material, "fiber")) @ c @ a - 1, 0.0)
        return v["ksi"] / (v["alpha"] * v["beta"]) * np.expm1(v["alpha"] * strain ** v["beta"])
    assert kind == "uncoupled hyperelastic"
    return febio_expression(material.find("W").text, first)


def febio_expression(text, first):
    """A mathematical expression: what every version of FEBio reads of one, in 512 characters."""
    assert len(text) < 512
    words = re.findall(r"[A-Za-z_]\w*", text)
    assert set(words) <= {"I1", "exp", "ln"}, "numbers have no exponent of ten"
    assert re.fullmatch(r"[-+*/^().\w]+", text)
    return eval(text.replace("^", "**"), {"exp": exp, "ln": log, "I1": first})


# --- Abaqus --------------------------------------------------------------------------------------


def abaqus_options(card):
    """Keyword lines with their parameters, and the numbers below them."""
    options = []
    for line in card.splitlines():
        assert len(line) <= 256 and line.isascii() and line
        if line.startswith("**"):
            continue
        if line.startswith("*"):
            keyword, *rest = (part.strip() for part in line[1:].split(","))
            options.append((keyword, dict([*part.split("="), ""][:2] for part in rest), []))
            continue
        fields = [field.strip() for field in line.split(",")]
        assert len(fields) <= 8
        assert all(0 < len(field) <= 20 for field in fields)
        options[-1][2].append([float(field) for field in fields])
    return options


def abaqus_materials(card):
    """Return the option and the orientation of each material."""
    options, materials, axes, name = abaqus_options(card), {}, {}, None
    for option in options:
        if option[0] == "ORIENTATION":
            axes[option[1]["NAME"]] = option
        elif option[0] == "MATERIAL":
            name = option[1]["NAME"]
        else:
            materials[name] = option, axes.get(f"{name}_axes")
    return materials


def abaqus_energy(material, radial, c):
    """Abaqus Analysis User's Guide, "Hyperelastic behavior ..." and "Anisotropic ...", at J = 1."""
    (keyword, settings, lines), orientation = material
    v = [x for line in lines for x in line]
    first, second = invariants(c)
    if keyword == "ANISOTROPIC HYPERELASTIC":
        assert {"HOLZAPFEL", "LOCAL DIRECTIONS"} == set(settings)
        c10, _, k1, k2, kappa = v
        families = abaqus_directions(orientation, radial, int(settings["LOCAL DIRECTIONS"]))
        return c10 * (first - 3) + sum(fibres(c, a, k1, k2, kappa) for a in families)
    assert keyword == "HYPERELASTIC"
    (model,) = settings.keys() - {"N"}
    if model in ("NEO HOOKE", "MOONEY-RIVLIN"):
        c10, *c01 = v[:-1]
        assert len(c01) == (model == "MOONEY-RIVLIN")
        return c10 * (first - 3) + sum(c01) * (second - 3)
    if model == "YEOH":
        assert v[4:] == [0, 0]
        return sum(v[i] * (first - 3) ** (i + 1) for i in range(3))
    if model == "ARRUDA-BOYCE":
        mu, lock, _ = v
        terms = enumerate(LANGEVIN, start=1)
        return mu * sum(a / lock ** (2 * i - 2) * (first**i - 3**i) for i, a in terms)
    assert model == "OGDEN"
    count = int(settings["N"])
    assert len(v) == 3 * count and not any(v[2 * count + 1 :])
    pairs = zip(v[: 2 * count : 2], v[1 : 2 * count : 2], strict=True)
    return ogden(c, [(2 * mu / alpha**2, alpha) for mu, alpha in pairs])


def abaqus_directions(orientation, radial, count):
    """Abaqus Keywords Guide, *ORIENTATION, SYSTEM=CYLINDRICAL: 1 radial, 2 around, 3 along."""
    _, settings, (points, turned, *directions) = orientation
    assert settings["SYSTEM"] == "CYLINDRICAL"
    assert turned[1] == 0
    assert count == int(settings["LOCAL DIRECTIONS"]) == len(directions)
    axis = np.subtract(points[3:], points[:3])
    axes = np.column_stack([radial, np.cross(axis, radial), axis])
    return [axes @ direction / np.linalg.norm(direction) for direction in directions]


READ = {"febio": (febio_materials, febio_energy), "abaqus": (abaqus_materials, abaqus_energy)}


def read(card, code):
    return READ[code][0](card)


def energy_in_code(card, code, name, stretches):
    material = read(card, code)[name]
    return [READ[code][1](material, radial, c) for radial, c in around(stretches)]


# Index of D1 among the numbers of a model; in Ogden's law it depends on the number of terms.
PLACE_OF_D1 = {"NEO HOOKE": 1, "MOONEY-RIVLIN": 2, "YEOH": 3, "ARRUDA-BOYCE": 2, "HOLZAPFEL": 1}


def bulk_modulus(card, code):
    material = read(card, code)["wall"]
    if code == "febio":
        return float(material.find("k").text)
    (_, settings, lines), _ = material
    model = next(iter(settings))
    place = 2 * int(settings["N"]) if model == "OGDEN" else PLACE_OF_D1[model]
    return 2 / [x for line in lines for x in line][place]


# --- energies ------------------------------------------------------------------------------------


@pytest.mark.parametrize("code", CODES)
@pytest.mark.parametrize("law", ORDINARY)
def test_energy_by_the_formula_of_the_code_equals_the_energy_of_the_law(law, code):
    energy, parameters = ORDINARY[law]
    tree, stretches = spread(parameters), stretched()
    if energy.name in NO_CARD[code]:
        label = {"febio": "FEBio", "abaqus": "Abaqus"}
        (other,) = set(CODES) - {code}
        elsewhere = "none for any code" if energy.name in NO_CARD[other] else label[other]
        expected = [energy.name, f"no card for {label[code]}", "has NeoHookean", elsewhere]
        expected.append(NO_CARD[code][energy.name])
        assert_refused(lambda: ph.material_card(tree, code, energy=energy), ValueError, expected)
        return
    card = ph.material_card(tree, code, energy=energy, draws=4)
    assert list(read(card, code)) == ["wall", *(f"wall_draw_{i}" for i in (1, 2, 3, 4))]
    for draw in range(4):
        drawn = {name: tree["posterior"][name].values[0, draw] for name in parameters}
        expected = energies(energy, drawn, stretches)
        found = energy_in_code(card, code, f"wall_draw_{draw + 1}", stretches)
        np.testing.assert_allclose(found, expected, rtol=ROUNDING)


@pytest.mark.parametrize("code", CODES)
@pytest.mark.parametrize("law", ["MooneyRivlin", "ArrudaBoyce", "GasserOgdenHolzapfel"])
def test_megapascal_card_has_moduli_divided_by_1000(law, code):
    energy, parameters = ORDINARY[law]
    tree, stretches = one_draw(parameters), stretched()
    card = ph.material_card(tree, code, energy=energy, unit="MPa", bulk_modulus=25.0)
    found = energy_in_code(card, code, "wall", stretches)
    expected = energies(energy, parameters, stretches) / 1e3
    np.testing.assert_allclose(found, expected, rtol=ROUNDING)
    assert " MPa" in card and "mm, N, t" in card and " kPa" not in card
    np.testing.assert_allclose(bulk_modulus(card, code), 25.0, rtol=ROUNDING)


# Stiffness at rest of walls with fibres: c + 4 k1 of the stiffest family.
WITH_FIBRES = {
    "HolzapfelGasserOgden": lambda v: v["c"] + 4 * v["k1"],
    "GasserOgdenHolzapfel": lambda v: v["c"] + 4 * v["k1"],
    "FourFiber": lambda v: v["c"] + 4 * max(v["k1_axial"], v["k1_hoop"], v["k1_diagonal"]),
}


@pytest.mark.parametrize("code", CODES)
def test_bulk_modulus_is_1000_times_the_stiffness_at_rest(code):
    """The shear modulus ``μ`` follows from ``W = 2 μ ln²λ`` of a small pure shear ``λ, 1/λ, 1``."""
    shear = np.array([[np.exp(-1e-3), np.exp(1e-3), 1.0]])
    for law, (energy, parameters) in ORDINARY.items():
        if energy.name in NO_CARD[code]:
            continue
        card = ph.material_card(one_draw(parameters), code, energy=energy)
        if law in WITH_FIBRES:
            stiffness = WITH_FIBRES[law](parameters)
        else:
            stiffness = energies(energy, parameters, shear)[0] / (2 * 1e-3**2)
        # The next term of the energy is smaller by about a hundred squares of the strain.
        np.testing.assert_allclose(bulk_modulus(card, code), 1e3 * stiffness, rtol=1e-3)


# --- numbers -------------------------------------------------------------------------------------


def test_numbers_on_a_card_keep_their_digits():
    c10 = 10.0 ** np.random.default_rng(SEED + 3).uniform(-8, 8, 300)
    c01 = -c10 / 3
    settings = {"energy": ph.MooneyRivlin(), "draws": 300}
    febio, abaqus = (
        read(ph.material_card(result(c10=c10, c01=c01), code, **settings), code) for code in CODES
    )
    for i in range(300):
        name, expected = f"wall_draw_{i + 1}", [c10[i], c01[i]]
        numbers = febio_numbers(febio[name])
        assert [numbers["c1"], numbers["c2"]] == expected
        found = abaqus[name][0][2][0][:2]
        np.testing.assert_allclose(found, expected, rtol=1e-13)
        # Numbers from 0.01 on keep all digits, also with a sign from 0.1 on.
        assert found[0] == c10[i] or c10[i] < 0.01
        assert found[1] == c01[i] or c01[i] > -0.1


def test_further_draws_are_evenly_spaced_along_chains():
    mu = np.arange(12.0).reshape(2, 6) + 1
    posterior = xr.Dataset({"mu": (("chain", "draw"), mu)}, {"chain": [0, 3], "draw": np.arange(6)})
    tree = xr.DataTree.from_dict({"posterior": posterior})
    card = ph.material_card(tree, "febio", energy=ph.NeoHookean(), draws=3)
    found = [2 * febio_numbers(m)["c1"] for m in febio_materials(card).values()][1:]
    assert found == [3.0, 7.0, 11.0]
    for words in ("chain 0, draw 2", "chain 3, draw 0", "chain 3, draw 4", "3 of the 12 draws"):
        assert words in card


# --- which material ------------------------------------------------------------------------------


def drawn_numbers(energy, draws, **settings):
    """Return the numbers of the material that stands for these draws, and the words of the card."""
    card = ph.material_card(result(**draws), "febio", energy=energy, **settings)
    return febio_numbers(febio_materials(card)["wall"]), " ".join(card.split())


def test_default_draw_lies_on_the_ridge_of_a_bent_posterior():
    """On the ridge ``c10 c01 = 16`` the default is a draw of it, where the mean is far from it."""
    c10 = np.exp(np.linspace(np.log(1.0), np.log(16.0), 41))
    draws = {"c10": c10, "c01": 16 / c10}
    chosen, _ = drawn_numbers(ph.MooneyRivlin(), draws)
    # The mean of the logarithm.
    np.testing.assert_allclose([chosen["c1"], chosen["c2"]], [4, 4], rtol=ROUNDING)
    mean, _ = drawn_numbers(ph.MooneyRivlin(), draws, point="mean")
    assert mean["c1"] == c10.mean()
    assert mean["c1"] * mean["c2"] > 25
    median, _ = drawn_numbers(ph.MooneyRivlin(), draws, point="median")
    np.testing.assert_allclose(median["c1"], 4, rtol=ROUNDING)


# Draws of c1, c2 and c3 of Yeoh's law, and the index of the draw that is expected.
NEAREST = {
    "one nearest draw": ([3.0, 8.0, 5.0, 4.0], [2.0, 0.5, 1.2, 1.5], [7.0, 6.0, 7.0, 9.0], 2),
    "two draws": ([30.0, 20.0], [2.0, 3.0], [7.0, 6.0], 0),
    "three equally near draws": ([2.0, 1.0, 1.0], [1.0, 2.0, 1.0], [1.0, 1.0, 2.0], 0),
    "a constant parameter": ([3.0, 4.0, 5.0], [0.1, 0.1, 0.1], [7.0, 6.5, 6.0], 1),
    "two parameters in proportion": ([3.0, 4.0, 5.0], [6.0, 8.0, 10.0], [7.0, 6.0, 7.0], 1),
}


@pytest.mark.parametrize(("c1", "c2", "c3", "expected"), NEAREST.values(), ids=NEAREST)
def test_chosen_draw_does_not_depend_on_rounding_errors(c1, c2, c3, expected):
    """Relative errors of 1e-14 in the draws do not change which draw the card holds."""
    draws, rng = np.array([c1, c2, c3]), np.random.default_rng(SEED)
    for error in [0.0] + [1e-14] * 20:
        rounded = draws * (1 + error * rng.uniform(-1, 1, draws.shape))
        numbers = dict(zip(("c1", "c2", "c3"), rounded, strict=True))
        found, said = drawn_numbers(ph.Yeoh(), numbers)
        np.testing.assert_allclose([found[name] for name in numbers], rounded[:, expected])
        assert "the draw of the posterior nearest its mean (in logarithms" in said
        assert f"the first of equally near draws): chain 0, draw {expected}" in said


@pytest.mark.parametrize("point", ["draw", "mean", "median"])
def test_sign_of_ogdens_exponent_does_not_change_the_card(point):
    draws = {"mu": [5.0] * 5, "alpha": [7.0, -8.0, 9.0, -7.5, 8.5]}
    found, _ = drawn_numbers(ph.Ogden(), draws, point=point)
    assert abs(found["m1"]) == 8.0 and found["m2"] == -found["m1"]


# --- of whom -------------------------------------------------------------------------------------


@pytest.mark.parametrize("code", CODES)
def test_layers_become_materials_from_the_inside_out(code):
    layers = [ph.Layer(ph.NeoHookean(), 0.3), ph.Layer(ph.HolzapfelGasserOgden(), 0.2, beta=60.0)]
    drawn = {"mu_1": [20.0, 30.0, 40.0], "c_2": [2.0, 3.0, 4.0]}
    drawn |= {"k1_2": [5.0, 6.0, 7.0], "k2_2": [1.0, 1.5, 2.0]}
    card = ph.material_card(result(**drawn), code, energy=layers, draws=1)
    assert list(read(card, code)) == ["layer_1", "layer_2", "layer_1_draw_1", "layer_2_draw_1"]
    outer = {"c": 3.0, "k1": 6.0, "k2": 1.5, "beta": 60.0}
    expected = [energies(ph.NeoHookean(), {"mu": 30.0}, stretched())]
    expected.append(energies(ph.HolzapfelGasserOgden(), outer, stretched()))
    for name in read(card, code):
        found = energy_in_code(card, code, name, stretched())
        np.testing.assert_allclose(found, expected["layer_2" in name], rtol=ROUNDING)
    said = " ".join(card.replace("**", " ").split())
    assert "layer 2 of 2 from the inside, 0.2 mm thick" in said


def test_card_states_the_typical_or_the_named_specimen_and_its_modulus():
    tree = fits.fit("neo_hookean_classes")["soft"]
    names = {None: "the typical specimen", "A1": "specimen 'A1'", "A3": "specimen 'A3'"}
    moduli = {}
    for specimen, words in names.items():
        card = ph.material_card(tree, "febio", specimen=specimen)
        assert f"Posterior of {words}, class 'soft'" in " ".join(card.split())
        moduli[specimen] = 2 * febio_numbers(febio_materials(card)["wall"])["c1"]
    assert abs(moduli["A1"] - 30) < 3 and abs(moduli["A3"] - 50) < 5
    assert moduli["A1"] < moduli[None] < moduli["A3"]


@pytest.mark.parametrize("code", CODES)
def test_names_with_control_characters_stay_within_their_comment(code):
    name = "A--\n*STEP -->é\x01" + "x" * 600
    tree = fitted_tree(mu=[20.0, 21.0])
    tree.name = name
    tree["constant_data"].attrs["title"] = name
    card = ph.material_card(tree, code)
    assert card.isascii()
    assert list(read(card, code)) == ["wall"]
    assert "*STEP" not in [line.strip()[:5] for line in card.splitlines()]
    if code == "febio":
        for comment in re.findall("<!--(.*?)-->", card, flags=re.DOTALL):
            assert "--" not in comment


# --- wrong input ---------------------------------------------------------------------------------

NEO = ph.NeoHookean(), {"mu": 20.0}
GOH = ph.GasserOgdenHolzapfel()
FIBRES = {"c": 3.0, "k1": 2.0, "k2": 1.0, "kappa": 0.1, "beta": 30.0}
SEVEN_TERMS = {"mu": [1.0] * 7, "alpha": [2.0] * 7}
# A law with its parameters, settings, and parts of the message.
REFUSED = {
    "code": (*NEO, {"code": "ansys"}, ["code is 'ansys'", "['febio', 'abaqus']"]),
    "unit": (*NEO, {"unit": "psi"}, ["unit is 'psi'", "['kPa', 'MPa']"]),
    "point": (*NEO, {"point": "mode"}, ["point is 'mode'", "'draw', 'mean', 'median'"]),
    "draws": (*NEO, {"draws": 2}, ["draws is 2", "has 1"]),
    "bulk modulus": (*NEO, {"bulk_modulus": -1.0}, ["positive number in kPa", "-1.0"]),
    "soft volume": (*NEO, {"bulk_modulus": 30.0}, ["is 30, less than 10 times", "another unit"]),
    "no stiffness": (ph.OgdenSeries(1), {"mu": [6.0], "alpha": [-2.0]}, {}, ["shear modulus -6"]),
    "dispersion": (GOH, FIBRES | {"kappa": 0.4}, {}, ["kappa is 0.4", "0.333333"]),
    "0/0": (GOH, FIBRES | {"k2": 0.0}, {}, ["k2 is 0", "divides"]),
    "limit of Ogden's law": (ph.Ogden(), {"mu": 6.0, "alpha": 0.0}, {}, ["exponent", "is 0"]),
    "too many terms": (ph.OgdenSeries(7), SEVEN_TERMS, {}, ["at most 6 terms", "7"]),
}


@pytest.mark.parametrize("code", CODES)
@pytest.mark.parametrize(
    ("energy", "parameters", "settings", "fragments"), REFUSED.values(), ids=REFUSED
)
def test_wrong_settings_and_unsuitable_parameters_are_refused(
    energy, parameters, settings, fragments, code
):
    settings = {"code": code, "energy": energy} | settings
    card = partial(ph.material_card, one_draw(parameters), **settings)
    assert_refused(card, ValueError, fragments)


def test_law_of_a_user_is_refused(monkeypatch):
    monkeypatch.setattr(ph.StrainEnergy, "_registry", {**ph.StrainEnergy._registry})

    class Softer(ph.NeoHookean):
        def energy(self, radial, hoop, axial, *, mu):
            return super().energy(radial, hoop, axial, mu=mu / 2)

    card = partial(ph.material_card, one_draw({"mu": 20.0}), "febio", energy=Softer())
    assert_refused(card, ValueError, ["Softer", "NeoHookean"])
