"""The figure of strain energies shows what their evidences say, and refuses those that differ."""

import itertools

import matplotlib as mpl
import numpy as np
import pytest
import xarray as xr
from scipy.special import softmax

import pymc_hyperelastic as ph

mpl.use("Agg")

DATA = ph.load_dataset("simulated_sheep_aorta")
NOISE = '{"sigma": 1.0, "slope_weight": 0.0}'
NAMES = [
    "Ogden",
    "HolzapfelGasserOgden with experiment effect",
    "OgdenSeries(terms=3) with experiment effect",
    "PowerLawNeoHookean",
    "GasserOgdenHolzapfel with experiment effect (2)",
    "a law of one's own with a very long name that nobody else would choose",
    "ArrudaBoyce",
    "FourFiber",
]
VALUES = [-120.0, -121.1, -310.4, -120.6, -125.0, -122.3, -1180.0, -119.7]
ERRORS = [0.05, 0.1, 0.3, 0.4, 0.02, 0.2, 0.01, 0.3]
# Of a standard error that is a root mean square over two thousand draws.
OF_DRAWS = 0.06


@pytest.fixture(autouse=True)
def closed():
    yield
    mpl.pyplot.close("all")


def fit(value, error=0.1, data=DATA, **attrs):
    """What is told of a sampled model, of one chain."""
    tree = xr.DataTree.from_dict(
        {
            "evidence": xr.Dataset(
                {"log_evidence": ("chain", [value]), "log_evidence_se": ("chain", [error])}
            ),
            "observed_data": data[["pressure"]].reset_coords(drop=True),
            "constant_data": data.drop_vars("pressure"),
        }
    )
    tree.attrs = {"noise": NOISE, "priors": "{}", "strain_energy": "Ogden"} | attrs
    return tree


def classes(values, law="Ogden", noise=NOISE):
    """Fitted classes of these log evidences, by name."""
    tree = xr.DataTree.from_dict({})
    for name, (value, error) in values.items():
        data = ph.select(DATA, group=name)
        tree[name] = fit(value, error, data, strain_energy=law, noise=noise)
    return tree


def laws(count=8, **errors):
    """So many laws, of which some have these errors."""
    names = NAMES[:count]
    known = dict(zip(names, ERRORS, strict=False)) | errors
    return {name: fit(value, known[name]) for name, value in zip(names, VALUES, strict=False)}


def texts(figure, panel):
    numbers = figure.viz["number"]["law"].sel(panel=panel)
    return {
        law: numbers.sel(strain_energy=law).item()["string"]
        for law in numbers["strain_energy"].values.tolist()
    }


def drawn(figure, name):
    """Elements of a visual, but for those of which nothing is known."""
    elements = [e for e in figure.viz[name]["law"].values.ravel() if isinstance(e, dict)]
    return [e for e in elements if np.isfinite(e["x"]).all()]


# --- what is shown --------------------------------------------------------------------------------


def test_probabilities_and_differences_are_those_of_the_evidences():
    """Bars end at the probabilities, points stand at differences; errors are of both evidences."""
    figure = ph.plot_law_probability(laws(), backend="none")
    order = np.argsort(VALUES)[::-1]
    assert [*texts(figure, "probability")] == [NAMES[i] for i in order]
    chances = softmax(VALUES)
    for row, i in enumerate(order):
        where = {"strain_energy": NAMES[i]}
        bar = figure.get_viz("bar", panel="probability", **where)
        np.testing.assert_allclose(bar["x"], [0, chances[i]])
        np.testing.assert_allclose(bar["y"], -row)
        point = figure.get_viz("points", panel="log_evidence", **where)
        np.testing.assert_allclose(point["x"], VALUES[i] - VALUES[7])
        line = figure.get_viz("error", panel="log_evidence", **where)
        error = np.hypot(ERRORS[i], ERRORS[7]) if i != 7 else 0.0
        np.testing.assert_allclose(np.diff(line["x"]), 2 * error, atol=1e-9)
        np.testing.assert_allclose(np.mean(line["x"]), VALUES[i] - VALUES[7])
    written = texts(figure, "log_evidence")
    assert written["FourFiber"] == "0.00" and written["PowerLawNeoHookean"] == "−0.90 ± 0.50"
    assert texts(figure, "probability")["ArrudaBoyce"] == "<0.001"


def test_errors_of_probabilities_are_those_of_the_evidences():
    r"""Of two laws that hardly err, ``dP_1 = P_1 P_2 d(L_1 - L_2)``; none leaves the axis."""
    two = {"one": fit(-50.0, 0.03), "two": fit(-51.0, 0.04)}
    figure = ph.plot_law_probability(two, backend="none")
    chance = softmax([-50.0, -51.0])
    line = figure.get_viz("error", panel="probability", strain_energy="two")["x"]
    np.testing.assert_allclose(np.diff(line) / 2, chance.prod() * 0.05, rtol=OF_DRAWS)
    np.testing.assert_allclose(np.mean(line), chance[1])
    two["two"] = fit(-51.0, 30.0)
    figure = ph.plot_law_probability(two, backend="none")
    for law in two:
        line = figure.get_viz("error", panel="probability", strain_energy=law)["x"]
        assert np.all((line >= 0) & (line <= 1)) and np.ptp(line) > 0.4


def test_an_infinite_error_is_said_in_words():
    """One evidence that is not known leaves every probability unknown, and other differences."""
    names = NAMES[:4]
    figure = ph.plot_law_probability(laws(4, **{names[0]: np.inf}), backend="none")
    assert set(texts(figure, "probability").values()) == {"cannot be judged"}
    written = texts(figure, "log_evidence")
    assert [*written] == [names[3], names[1], names[2], names[0]]
    assert written.pop(names[0]) == "cannot be judged"
    assert [*written.values()] == ["0.00", "−0.50 ± 0.41", "−189.80 ± 0.50"]
    assert len(drawn(figure, "points")) == 3 and not drawn(figure, "bar")
    colours = {e["string"]: e["color"] for e in figure.viz["number"]["law"].values.ravel()}
    assert colours["cannot be judged"] != colours["0.00"]


@pytest.mark.parametrize("value", [np.nan, -120.0])
def test_a_figure_in_which_nothing_is_known_says_so(value):
    """Laws are still named, and axes still say what they would hold."""
    figure = ph.plot_law_probability({n: fit(value, np.inf) for n in NAMES[:2]})
    left, right = figure.viz["plot"].values.ravel()
    assert [t.get_text().replace("\n", " ") for t in left.get_yticklabels()] == NAMES[:2]
    assert left.get_xlabel() == "probability" and "nats" in right.get_xlabel()
    assert [t.get_text() for axes in (left, right) for t in axes.texts] == ["cannot be judged"] * 4


def test_classes_are_shown_one_by_one():
    """Markers tell what each class says; bars what all do, each with parameters of its own."""
    fits = {
        "Ogden": classes({"C1": (-50.0, 0.1), "C2": (-60.0, 0.2)}),
        "Gent": classes({"C1": (-50.5, 0.3), "C2": (-58.0, np.inf)}, "Gent"),
        "Yeoh": classes({"C1": (-52.0, 0.1), "C2": (-59.0, 0.1)}, "Yeoh"),
    }
    figure = ph.plot_law_probability(fits, backend="none")
    chance = dict(zip(fits, softmax([-50.0, -50.5, -52.0]), strict=True))
    for law in fits:
        marker = figure.get_viz("class_points", strain_energy=law, class_label="C1")
        np.testing.assert_allclose(marker["x"], chance[law])
    # The error of one evidence of the second class is infinite.
    assert len(drawn(figure, "class_points")) == 3
    known = {name: tree for name, tree in fits.items() if name != "Gent"}
    figure = ph.plot_law_probability(known, backend="none")
    bar = figure.get_viz("bar", panel="probability", strain_energy="Yeoh")
    np.testing.assert_allclose(bar["x"][-1], softmax([-110.0, -111.0])[1])
    legend = ph.plot_law_probability(known).get_viz("figure").legends[0]
    shown = [t.get_text() for t in legend.get_texts()]
    assert shown == ["by all classes", "by class C1", "by class C2"]


def test_results_of_classify_are_shown_as_the_fits_are():
    """What `classify` stores of the laws is what the figure makes of the fits themselves."""
    energies = (ph.NeoHookean(), ph.MooneyRivlin())
    training = {name: ph.select(DATA, group=name, experiment=1) for name in ("C1", "C2")}
    settings = {"noise_sd": 15 * ph.mmHg, "slope_weight": 0.0, "draws": 300, "chains": 2}
    settings |= {"random_seed": 1, "progressbar": False}
    fits = [ph.fit_classes(energy, training, **settings) for energy in energies]
    new = ph.select(DATA, specimen="S4", experiment=3)
    result = ph.classify(new, fits[0], average_over=fits[1:], random_seed=1, progressbar=False)
    evidence = np.array([[ph.log_evidence(tree[name]) for name in training] for tree in fits])
    total = evidence[..., 0].sum(axis=1)
    np.testing.assert_allclose(result["strain_energy_log_evidence"], total)
    errors = np.linalg.norm(evidence[..., 1], axis=1)
    np.testing.assert_allclose(result["strain_energy_log_evidence_se"], errors)
    alone = softmax(evidence[..., 0], axis=0)
    np.testing.assert_allclose(result["strain_energy_class_probability"], alone)
    for i in range(2):
        p, s = alone[:, i], evidence[:, i, 1]
        found = result["strain_energy_class_probability_se"].values[:, i]
        np.testing.assert_allclose(found, p.prod() * np.hypot(*s), rtol=3 * OF_DRAWS, atol=1e-12)
    figures = [ph.plot_law_probability(x, backend="none") for x in (result, fits)]
    for panel in ("probability", "log_evidence"):
        assert texts(figures[0], panel) == texts(figures[1], panel)
    assert "SIMULATED" in figures[0].get_viz("figure_title")["string"]


def test_laws_of_a_list_are_named_by_what_they_are():
    """By settings where one law is there with several, and by a number at last."""
    series = [
        fit(-50.0, strain_energy="OgdenSeries", strain_energy_settings=f'{{"terms": {terms}}}')
        for terms in (1, 2, 2)
    ]
    figure = ph.plot_law_probability([fit(-49.0), *series], backend="none")
    labels = ["Ogden", "OgdenSeries(terms=1)", "OgdenSeries(terms=2)", "OgdenSeries(terms=2) (2)"]
    assert [*texts(figure, "probability")] == labels


def test_visuals_can_be_set_and_left_out():
    """As in every figure."""
    visuals = {"bar": {"color": "k"}, "number": False}
    figure = ph.plot_law_probability(laws(2), backend="none", visuals=visuals)
    assert "number" not in figure.viz.children
    where = {"panel": "probability", "strain_energy": "Ogden"}
    assert figure.get_viz("bar", **where)["color"] == "k"
    with pytest.raises(ValueError, match="no visual is called 'dots'"):
        ph.plot_law_probability(laws(2), visuals={"dots": False})


# --- what can be read -----------------------------------------------------------------------------


def of_classes(count):
    """So many laws with long names, of two classes."""
    pairs = zip(NAMES[:count], VALUES, strict=False)
    return {n: classes({"C1": (v, 0.1), "C2": (v / 2, 0.2)}) for n, v in pairs}


@pytest.mark.parametrize("fits", [laws(1), laws(2), laws(8), of_classes(1), of_classes(8)])
def test_every_word_can_be_read(fits):
    """Names, numbers and labels are inside the figure, and none lies over another or a panel."""
    figure = ph.plot_law_probability(fits)
    canvas = figure.get_viz("figure")
    canvas.canvas.draw()
    assert canvas.get_size_inches()[0] < 10  # of a page, letters would be too small
    panels = figure.viz["plot"].values.ravel()
    words = [t for axes in panels for t in (*axes.texts, axes.xaxis.label)]
    words += [t for t in panels[0].get_yticklabels() if t.get_text()]
    words += [t for legend in canvas.legends for t in legend.get_texts()]
    assert len(words) >= 3 * len(fits) + 2
    boxes = [word.get_window_extent() for word in words]
    for box in boxes:
        assert box.x0 >= 0 and box.y0 >= 0
        assert box.x1 <= canvas.bbox.x1 and box.y1 <= canvas.bbox.y1
    frames = [axes.get_window_extent() for axes in panels]
    for one, other in itertools.combinations([*boxes, *frames], 2):
        assert not one.overlaps(other)
    for axes, frame in zip(panels, frames, strict=True):
        assert frame.width > 1.5 * canvas.dpi
        low, high = axes.get_ylim()
        assert low < 1 - len(fits) and high > 0


# --- evidences that do not compare ----------------------------------------------------------------


def less(**changes):
    data = DATA.copy(deep=True)
    for name, value in changes.items():
        data[name][0] += value
    return data


@pytest.mark.parametrize(
    ("other", "message"),
    [
        (fit(-50.0, data=less(pressure=0.1)), r"under B than under A \(in pressure\): .*not comp"),
        (fit(-50.0, data=less(outer_radius=0.1)), r"under B than under A \(in outer_radius\)"),
        (
            fit(-50.0, data=ph.select(DATA, specimen="S1")),
            r"under B than under A \(3 tests, not 15\)",
        ),
        (
            fit(-50.0, noise='{"sigma": 2.0}'),
            r"fits holds B with the noise .*2\.0.*A has the noise",
        ),
        (fit(-50.0, likelihood="generative"), "B with the noise .* likelihood 'generative', but A"),
        (fit(-50.0, variability="specimen"), "B with variability='specimen', of pressures, but A"),
        (classes({"C1": (-50.0, 0.1)}), r"some of the fits are classes.*take classes\['C1'\]"),
    ],
)
def test_evidences_that_do_not_compare_are_refused(other, message):
    """Each error names both laws, and what differs."""
    with pytest.raises(ValueError, match=message):
        ph.plot_law_probability({"A": fit(-50.0), "B": other})


def test_classes_that_do_not_compare_are_refused():
    """As `classify` does: by their names, their noise and their data."""
    both = {"C1": (-50.0, 0.1), "C2": (-60.0, 0.1)}
    first = classes(both)
    with pytest.raises(ValueError, match=r"fits holds the classes \['C1'\], not \['C1', 'C2'\]"):
        ph.plot_law_probability([first, classes({"C1": both["C1"]})])
    with pytest.raises(ValueError, match=r"fits holds B with the noise .* but A has the noise"):
        other = classes(both, noise='{"sigma": 2.0, "slope_weight": 0.0}')
        ph.plot_law_probability({"A": first, "B": other})
    other = classes(both)
    other["C2"]["observed_data"]["pressure"].values[3] += 1.0
    with pytest.raises(
        ValueError, match=r"class 'C2' has other training .* B .* A \(in pressure\)"
    ):
        ph.plot_law_probability({"A": first, "B": other})


@pytest.mark.parametrize("group", ["noise", "constant_data"])
def test_what_does_not_say_how_it_was_made_is_warned_of(group):
    """Nothing is known against it, and nothing for it."""
    stranger = fit(-50.0)
    if group == "noise":
        del stranger.attrs["noise"]
    else:
        del stranger["constant_data"]
    words = "with which noise" if group == "noise" else "from which inflation data"
    with pytest.warns(UserWarning, match=f"fits: B does not say {words} it was made"):
        ph.plot_law_probability({"A": fit(-51.0), "B": stranger}, backend="none")
    ph.plot_law_probability({"B": stranger}, backend="none")


@pytest.mark.parametrize(
    ("result", "error", "message"),
    [
        (fit(-50.0), TypeError, "one fit is no comparison"),
        ({"A": DATA}, TypeError, "fit 'A' must be a result .* not Dataset"),
        ([3], TypeError, "fit number 0 must be a result"),
        ([], ValueError, "there are no fits"),
        ({}, ValueError, "there are no fits"),
        (3, TypeError, "not int"),
        (DATA, ValueError, r"lacks 'strain_energy_log_evidence'; .*average_over"),
        ({"A": xr.DataTree()}, ValueError, "the result has no evidence"),
    ],
)
def test_what_is_no_comparison_is_refused(result, error, message):
    """One error each, which says what was expected."""
    with pytest.raises(error, match=message):
        ph.plot_law_probability(result)


def test_a_list_of_laws_without_names_is_refused():
    """A dict names them."""
    nameless = fit(-50.0)
    del nameless.attrs["strain_energy"]
    with pytest.raises(ValueError, match="fit number 1 does not name its strain energy"):
        ph.plot_law_probability([fit(-50.0), nameless])
    ph.plot_law_probability({"A": fit(-50.0), "B": nameless}, backend="none")
