"""plot_law_probability: evidences and probabilities of strain energies."""

import numpy as np
import pytest
import xarray as xr
from figures import DATA, fitted, legend_texts
from scipy.special import softmax

import pymc_hyperelastic as ph
from pymc_hyperelastic.classes.average import laws_of_fits
from pymc_hyperelastic.models.settings import ModelSettings

LIKELIHOOD, OTHER = ph.Gaussian(1.0), ph.Gaussian(2.0)
OBSERVED = ph.Gaussian(1.0, observed=True)
# Log evidence and its standard error of each law.
LAWS = {
    "Ogden": (-120.0, 0.05),
    "Yeoh": (-121.1, 0.1),
    "OgdenSeries(terms=3)": (-310.4, 0.3),
    "Gent": (-120.6, 0.4),
    "ArrudaBoyce": (-1180.0, 0.01),
    "FourFiber": (-119.7, 0.3),
}
# Relative error of a standard error computed from two thousand draws, three times its own error.
OF_DRAWS = 0.06


def fit(value, error=0.1, data=DATA, likelihood=LIKELIHOOD):
    """Return a sampled model of one chain with this log evidence."""
    evidence = {"log_evidence": ("chain", [value]), "log_evidence_se": ("chain", [error])}
    tree = fitted(data).assign({"evidence": xr.DataTree(xr.Dataset(evidence))})
    tree.attrs = ModelSettings.of(ph.Ogden(), {}, likelihood).attrs()
    return tree


def classes(**values):
    """Return fitted classes with these log evidences and standard errors."""
    fits = {name: fit(*value, ph.select(DATA, group=name)) for name, value in values.items()}
    return xr.DataTree.from_dict(fits)


def plotted(evidences):
    """Plot fits of several laws."""
    fits = {law: fit(*evidence) for law, evidence in evidences.items()}
    return ph.plot_law_probability(fits, backend="none")


def numbers(figure, panel):
    """Return the numbers in a panel by law."""
    found = figure.viz["number"]["law"].sel(panel=panel)
    laws = found["strain_energy"].values.tolist()
    return {law: number["string"] for law, number in zip(laws, found.values, strict=True)}


def drawn(figure, name):
    """Return the elements of a visual that have finite positions."""
    elements = [e for e in figure.viz[name]["law"].values.ravel() if isinstance(e, dict)]
    return [e for e in elements if np.isfinite(e["x"]).all()]


def test_bars_are_probabilities_and_points_are_differences_of_evidences():
    figure = plotted(LAWS)
    order = sorted(LAWS, key=lambda law: -LAWS[law][0])
    assert [*numbers(figure, "probability")] == order
    best, its_error = LAWS[order[0]]
    chances = softmax([LAWS[law][0] for law in order])
    for row, (law, chance) in enumerate(zip(order, chances, strict=True)):
        value, error = LAWS[law]
        bar = figure.get_viz("bar", panel="probability", strain_energy=law)
        np.testing.assert_allclose(bar["x"], [0, chance])
        np.testing.assert_allclose(bar["y"], -row)
        point, line = (
            figure.get_viz(name, panel="log_evidence", strain_energy=law)["x"]
            for name in ("points", "error")
        )
        np.testing.assert_allclose(point, value - best)
        error = np.hypot(error, its_error) if row else 0.0
        np.testing.assert_allclose(line, [value - best - error, value - best + error], atol=1e-9)
    written = numbers(figure, "log_evidence")
    assert written["FourFiber"] == "0.00" and written["Gent"] == "−0.90 ± 0.50"
    assert numbers(figure, "probability")["ArrudaBoyce"] == "<0.001"
    # The result of classify, which holds the same numbers, gives the same figure.
    fits = {law: fit(*evidence) for law, evidence in LAWS.items()}
    result = xr.Dataset(laws_of_fits(fits).as_variables(), attrs={"simulated": 1})
    other = ph.plot_law_probability(result, backend="none")
    for panel in ("probability", "log_evidence"):
        assert numbers(other, panel) == numbers(figure, panel)


def test_height_of_rows_follows_from_the_longest_name():
    def height(name):
        fits = {name: fit(-120.0), "Ogden": fit(-121.0)}
        return ph.plot_law_probability(fits).get_viz("figure").get_size_inches()[1]

    # Three lines of 26 letters at most, each 0.17 inches high, in two rows.
    assert height("a long name " * 6) - height("Yeoh") == pytest.approx(2 * 2 * 0.17)


def test_error_of_a_probability_stays_between_0_and_1():
    figure = plotted({"one": (-50.0, 0.03), "two": (-51.0, 30.0)})
    line = figure.get_viz("error", panel="probability", strain_energy="one")["x"]
    assert np.all((line >= 0) & (line <= 1)) and np.ptp(line) > 0.4


def test_law_with_an_infinite_error_cannot_be_judged():
    four = {law: LAWS[law] for law in ("Ogden", "Yeoh", "OgdenSeries(terms=3)", "Gent")}
    figure = plotted(four | {"Ogden": (-120.0, np.inf)})
    assert set(numbers(figure, "probability").values()) == {"cannot be judged"}
    assert [*numbers(figure, "log_evidence").items()] == [
        ("Gent", "0.00"),
        ("Yeoh", "−0.50 ± 0.41"),
        ("OgdenSeries(terms=3)", "−189.80 ± 0.50"),
        ("Ogden", "cannot be judged"),
    ]
    assert len(drawn(figure, "points")) == 3 and not drawn(figure, "bar")
    colours = {e["string"]: e["color"] for e in figure.viz["number"]["law"].values.ravel()}
    assert colours["cannot be judged"] != colours["0.00"]


def test_each_class_has_a_marker_for_its_own_evidence():
    fits = {
        "Ogden": classes(C1=(-50.0, 0.1), C2=(-60.0, 0.2)),
        "Yeoh": classes(C1=(-52.0, 0.1), C2=(-59.0, 0.1)),
    }
    figure = ph.plot_law_probability(fits, backend="none")
    # Visuals, the panel or class, log evidences of both laws, and all their errors.
    shown = [
        (("bar", "error"), {"panel": "probability"}, [-110, -111], [0.1, 0.2, 0.1, 0.1]),
        (("class_points", "class_error"), {"class_label": "C1"}, [-50, -52], [0.1, 0.1]),
        (("class_points", "class_error"), {"class_label": "C2"}, [-60, -59], [0.2, 0.1]),
    ]
    for visuals, where, evidences, errors in shown:
        place, line = (figure.get_viz(v, strain_energy="Yeoh", **where)["x"] for v in visuals)
        chance = softmax(evidences)
        np.testing.assert_allclose([place.ravel()[-1], np.mean(line)], chance[1])
        # To first order in the errors, whose squares are about 5 %.
        error = chance.prod() * np.linalg.norm(errors)
        np.testing.assert_allclose(np.diff(line) / 2, error, rtol=OF_DRAWS + 0.05)
    shown = legend_texts(ph.plot_law_probability(fits))
    assert shown == ["by all classes", "by class C1", "by class C2"]
    # The error of one evidence of the second class is infinite.
    fits["Gent"] = classes(C1=(-50.5, 0.3), C2=(-58.0, np.inf))
    assert len(drawn(ph.plot_law_probability(fits, backend="none"), "class_points")) == 3


OTHER_TUBE = DATA.assign(outer_radius=DATA["outer_radius"] + 0.1)
BOTH = classes(C1=(-50.0, 0.1), C2=(-60.0, 0.1))
OTHER_CURVE = BOTH.copy(deep=True)
OTHER_CURVE["C2"]["observed_data"]["pressure"].values[3] += 1.0


@pytest.mark.parametrize(
    ("first", "other", "message"),
    [
        (fit(-50.0), fit(-50.0, data=OTHER_TUBE), r"than under A \(in outer_radius\): .*not comp"),
        (
            fit(-50.0),
            fit(-50.0, likelihood=OTHER),
            r"B with the likelihood Gaussian.*2\.0.*A has the",
        ),
        (fit(-50.0), fit(-50.0, likelihood=OBSERVED), r"observed=True\), but A"),
        (
            BOTH,
            BOTH.filter(lambda node: "C2" not in node.path),
            r"B with the classes \['C1'\], but A has the classes \['C1', 'C2'\]",
        ),
        (BOTH, OTHER_CURVE, r"class 'C2' has other training .* B .* A \(in pressure\)"),
    ],
)
def test_evidences_of_other_data_or_noise_are_refused(first, other, message):
    with pytest.raises(ValueError, match=message):
        ph.plot_law_probability({"A": first, "B": other})


def test_single_fit_or_missing_evidence_is_refused():
    with pytest.raises(TypeError, match="one fit is no comparison"):
        ph.plot_law_probability(fit(-50.0))
    with pytest.raises(ValueError, match=r"lacks 'strain_energy_log_evidence'; .*average_over"):
        ph.plot_law_probability(DATA)
    unknown = fit(-50.0, likelihood=None)
    with pytest.warns(UserWarning, match="fits: B does not say with which likelihood it was made"):
        ph.plot_law_probability({"A": fit(-51.0), "B": unknown}, backend="none")
