"""plot_law_probability: evidences and probabilities of strain energies."""

import numpy as np
import pytest
import xarray as xr
from figures import DATA, fitted, legend_texts
from scipy.special import softmax

import pymc_hyperelastic as ph
from pymc_hyperelastic.classes.average import laws_of_fits

NOISE = '{"sigma": 1.0, "slope_weight": 0.0}'
NAMES = ["Ogden", "Yeoh", "OgdenSeries(terms=3)", "Gent", "ArrudaBoyce", "FourFiber"]
VALUES = [-120.0, -121.1, -310.4, -120.6, -1180.0, -119.7]
ERRORS = [0.05, 0.1, 0.3, 0.4, 0.01, 0.3]
# Relative error of a standard error computed from two thousand draws, three times its own error.
OF_DRAWS = 0.06


def fit(value, error=0.1, data=DATA, **attrs):
    """Return a sampled model of one chain with this log evidence."""
    evidence = {"log_evidence": ("chain", [value]), "log_evidence_se": ("chain", [error])}
    tree = fitted(data)
    tree["evidence"] = xr.DataTree(xr.Dataset(evidence))
    tree.attrs = {"noise": NOISE, "priors": "{}", "strain_energy": "Ogden"} | attrs
    return tree


def classes(**values):
    """Return fitted classes with these log evidences and standard errors."""
    fits = {name: fit(*value, ph.select(DATA, group=name)) for name, value in values.items()}
    return xr.DataTree.from_dict(fits)


def laws(count=6, errors=ERRORS):
    """Return fits of several laws."""
    return {name: fit(VALUES[i], errors[i]) for i, name in enumerate(NAMES[:count])}


def numbers(figure, panel):
    found = figure.viz["number"]["law"].sel(panel=panel)
    return {
        law: found.sel(strain_energy=law).item()["string"]
        for law in found["strain_energy"].values.tolist()
    }


def drawn(figure, name):
    """Return the elements of a visual that have finite positions."""
    elements = [e for e in figure.viz[name]["law"].values.ravel() if isinstance(e, dict)]
    return [e for e in elements if np.isfinite(e["x"]).all()]


def test_bars_are_probabilities_and_points_are_differences_of_evidences():
    figure = ph.plot_law_probability(laws(), backend="none")
    order = np.argsort(VALUES)[::-1]
    assert [*numbers(figure, "probability")] == [NAMES[i] for i in order]
    chances = softmax(VALUES)
    for row, i in enumerate(order):
        where = {"strain_energy": NAMES[i]}
        bar = figure.get_viz("bar", panel="probability", **where)
        np.testing.assert_allclose(bar["x"], [0, chances[i]])
        np.testing.assert_allclose(bar["y"], -row)
        point = figure.get_viz("points", panel="log_evidence", **where)
        np.testing.assert_allclose(point["x"], VALUES[i] - VALUES[5])
        line = figure.get_viz("error", panel="log_evidence", **where)
        error = np.hypot(ERRORS[i], ERRORS[5]) if i != 5 else 0.0
        np.testing.assert_allclose(np.diff(line["x"]), 2 * error, atol=1e-9)
        np.testing.assert_allclose(np.mean(line["x"]), VALUES[i] - VALUES[5])
    # The result of classify, which holds the same numbers, gives the same figure.
    result = xr.Dataset(laws_of_fits(laws()).as_variables(), attrs={"simulated": 1})
    other = ph.plot_law_probability(result, backend="none")
    for panel in ("probability", "log_evidence"):
        assert numbers(other, panel) == numbers(figure, panel)
    written = numbers(figure, "log_evidence")
    assert written["FourFiber"] == "0.00" and written["Gent"] == "−0.90 ± 0.50"
    assert numbers(figure, "probability")["ArrudaBoyce"] == "<0.001"


def test_error_of_a_probability_follows_from_the_errors_of_evidences():
    two = {"one": fit(-50.0, 0.03), "two": fit(-51.0, 0.04)}
    figure = ph.plot_law_probability(two, backend="none")
    chance = softmax([-50.0, -51.0])
    line = figure.get_viz("error", panel="probability", strain_energy="two")["x"]
    np.testing.assert_allclose(np.diff(line) / 2, chance.prod() * 0.05, rtol=OF_DRAWS)
    np.testing.assert_allclose(np.mean(line), chance[1])
    two["two"] = fit(-51.0, 30.0)
    figure = ph.plot_law_probability(two, backend="none")
    line = figure.get_viz("error", panel="probability", strain_energy="one")["x"]
    assert np.all((line >= 0) & (line <= 1)) and np.ptp(line) > 0.4


def test_infinite_error_is_written_as_cannot_be_judged():
    names = NAMES[:4]
    figure = ph.plot_law_probability(laws(4, [np.inf, *ERRORS[1:]]), backend="none")
    assert set(numbers(figure, "probability").values()) == {"cannot be judged"}
    written = numbers(figure, "log_evidence")
    assert [*written] == [names[3], names[1], names[2], names[0]]
    assert written.pop(names[0]) == "cannot be judged"
    assert [*written.values()] == ["0.00", "−0.50 ± 0.41", "−189.80 ± 0.50"]
    assert len(drawn(figure, "points")) == 3 and not drawn(figure, "bar")
    colours = {e["string"]: e["color"] for e in figure.viz["number"]["law"].values.ravel()}
    assert colours["cannot be judged"] != colours["0.00"]


def test_each_class_has_a_marker():
    fits = {
        "Ogden": classes(C1=(-50.0, 0.1), C2=(-60.0, 0.2)),
        "Gent": classes(C1=(-50.5, 0.3), C2=(-58.0, np.inf)),
        "Yeoh": classes(C1=(-52.0, 0.1), C2=(-59.0, 0.1)),
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
    marker, line = (
        figure.get_viz(name, strain_energy="Yeoh", class_label="C2")["x"]
        for name in ("class_points", "class_error")
    )
    chance = softmax([-60.0, -59.0])
    np.testing.assert_allclose([marker.item(), np.mean(line)], chance[1])
    error = chance.prod() * np.hypot(0.2, 0.1)
    # To first order in the errors, whose squares are about 5 %.
    np.testing.assert_allclose(np.diff(line) / 2, error, rtol=OF_DRAWS + 0.05)
    shown = legend_texts(ph.plot_law_probability(known))
    assert shown == ["by all classes", "by class C1", "by class C2"]


OTHER_TUBE = DATA.copy(deep=True)
C1, C2 = (-50.0, 0.1), (-60.0, 0.1)
BOTH, OTHER_CURVE = classes(C1=C1, C2=C2), classes(C1=C1, C2=C2)
OTHER_TUBE["outer_radius"][0] += 0.1
OTHER_CURVE["C2"]["observed_data"]["pressure"].values[3] += 1.0


@pytest.mark.parametrize(
    ("first", "other", "message"),
    [
        (fit(-50.0), fit(-50.0, data=OTHER_TUBE), r"than under A \(in outer_radius\): .*not comp"),
        (fit(-50.0), fit(-50.0, noise='{"sigma": 2.0}'), r"B with the noise .*2\.0.*A has the"),
        (fit(-50.0), fit(-50.0, likelihood="generative"), "likelihood 'generative', but A"),
        (BOTH, classes(C1=C1), r"the classes \['C1'\], not \['C1', 'C2'\]"),
        (BOTH, OTHER_CURVE, r"class 'C2' has other training .* B .* A \(in pressure\)"),
    ],
)
def test_evidences_of_other_data_or_noise_are_refused(first, other, message):
    with pytest.raises(ValueError, match=message):
        ph.plot_law_probability({"A": first, "B": other})


def test_wrong_input_is_refused():
    with pytest.raises(TypeError, match="one fit is no comparison"):
        ph.plot_law_probability(fit(-50.0))
    with pytest.raises(ValueError, match=r"lacks 'strain_energy_log_evidence'; .*average_over"):
        ph.plot_law_probability(DATA)
    unknown = fit(-50.0)
    del unknown.attrs["noise"]
    with pytest.warns(UserWarning, match="fits: B does not say with which noise it was made"):
        ph.plot_law_probability({"A": fit(-51.0), "B": unknown}, backend="none")
