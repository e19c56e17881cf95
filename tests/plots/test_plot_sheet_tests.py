"""plot_sheet_tests, and plot_fit of sheets: every stress, its curve and its residual."""

import fits
import numpy as np
import pandas as pd
import pytest
import xarray as xr
from figures import elements, legend_texts, points_of, texts
from sheet_tables import by_hand, joint_by_hand
from tube_posteriors import result

import pymc_hyperelastic as ph

LAW = ph.HolzapfelGasserOgden()
DRAWS = {"c": [10.0, 12.0, 8.0], "k1": [20.0, 5.0, 30.0], "k2": [1.0, 2.0, 0.5]}
DRAWS |= {"beta": [35.0, 40.0, 50.0]}
SD = 0.5
# Curves of the figure and of the predictions are the same numbers.
ROUNDING = 1e-9
SKIN = ph.load_dataset("porcine_skin")


def fitted(data, law=LAW, draws=DRAWS, **sd) -> xr.DataTree:
    """Return a result of `sample_smc` with these draws."""
    model = ph.material_model(law, data, ph.Gaussian(**sd or {"stress_sd": SD}))
    study = model.study
    groups = {n: xr.DataTree(group) for n, group in study.result_groups(model).items()}
    tree = result(**draws).assign(groups)
    tree.attrs = study.result_attrs(model)
    return tree


def sorted_points(x, y):
    points = np.stack([x, y])[:, np.isfinite(y)]
    return points[:, np.lexsort(points)]


@pytest.mark.parametrize(
    ("group_by", "panels"), [("experiment", 3), ("specimen", 1), ("group", 1), (None, 1)]
)
def test_every_measured_stress_is_drawn_once(group_by, panels):
    data = ph.select(SKIN, experiment=["mostly x", "mostly y", "equibiaxial"])
    figure = ph.plot_sheet_tests(data, group_by=group_by, stress_unit="MPa", backend="none")
    assert figure.viz["plot"].size == panels
    x = np.concatenate([data["stretch_x"], data["stretch_y"]])
    y = np.concatenate([data["stress_x"], data["stress_y"]]) / 1000
    np.testing.assert_allclose(points_of(figure), sorted_points(x, y), rtol=ROUNDING)
    assert set(texts(figure, "ylabel")) == {"Cauchy stress (MPa)"}


def test_axes_and_tests_in_a_panel_look_different():
    figure = ph.plot_sheet_tests(SKIN, backend="none")
    assert texts(figure, "title") == ["mostly y", "mostly x", "equibiaxial", "strip x", "strip y"]
    assert len({e["color"] for e in elements(figure, "line")}) == 2
    assert legend_texts(ph.plot_sheet_tests(SKIN)) == ["stress along x", "stress along y"]
    together = legend_texts(ph.plot_sheet_tests(SKIN, group_by=None))
    assert together[2:] == [f"experiment {name}" for name in texts(figure, "title")]
    figure = ph.plot_sheet_tests(SKIN, group_by=None, backend="none")
    assert len({e["marker"] for e in elements(figure, "scatter")}) == 5


def test_stress_along_a_held_axis_is_shown_over_the_other_stretch():
    data = ph.select(ph.load_dataset("treloar_rubber"), experiment="pure shear")
    data["stress_y"] = data["stress_x"] / 2
    figure = ph.plot_sheet_tests(data, backend="none")
    x, y = (data[name].values for name in ("stretch_x", "stress_x"))
    expected = sorted_points(np.tile(x, 2), np.append(y, y / 2))
    np.testing.assert_array_equal(points_of(figure), expected)


def test_each_figure_shows_its_kind_of_tests():
    data, sheets = joint_by_hand(), by_hand()
    found, alone = (ph.plot_sheet_tests(d, backend="none") for d in (data, sheets))
    np.testing.assert_array_equal(points_of(found), points_of(alone))
    assert texts(found, "ylabel") == ["nominal or Cauchy stress (kPa)"]
    tubes = ph.plot_inflation(data, backend="none")
    count = int(np.isfinite(data["radius"]).sum())
    assert points_of(tubes).shape[1] == count
    with pytest.raises(ValueError, match=r"hold no tubes: .* plot_sheet_tests"):
        ph.plot_inflation(sheets)
    with pytest.raises(ValueError, match=r"hold no tests of sheets: .* ph.plot_inflation"):
        ph.plot_sheet_tests(ph.load_dataset("simulated_sheep_aorta"))
    with pytest.raises(ValueError, match="group_by must be one of experiment"):
        ph.plot_sheet_tests(sheets, group_by="axial_stretch")


def test_only_some_of_many_panels_are_drawn_and_the_title_counts_them():
    data = ph.combine_tests(
        *(by_hand(experiment=[f"a{i}", f"b{i}"], specimen=["S1", "S1"]) for i in range(15))
    )
    figure = ph.plot_sheet_tests(data, backend="none")
    assert figure.viz["plot"].size == 24
    assert figure.get_viz("figure_title")["string"] == "24 of 30 experiments"
    fit = ph.plot_fit(fitted(data), backend="none", specimens=None)
    assert fit.get_viz("figure_title")["string"].endswith("24 of 30 tests")


# --- fits -----------------------------------------------------------------------------------------


def test_fit_has_a_panel_with_data_and_curve_of_each_test():
    tree = fitted(SKIN)
    figure = ph.plot_fit(tree, backend="none", ci_prob=0.5)
    assert texts(figure, "title") == SKIN["experiment"].values.tolist()
    expected = ph.plot_sheet_tests(SKIN, backend="none")
    np.testing.assert_array_equal(points_of(figure), points_of(expected))
    ends = ph.predict_stress(tree, SKIN["stretch_x"], SKIN["stretch_y"])
    for axis, at in (("x", 0), ("y", 1)):
        curve = elements(figure, "line")[at]  # of the first test
        own = np.flatnonzero(SKIN["test"].values == 0)
        median = ends[f"stress_{axis}"].median(["chain", "draw"]).values[own]
        drawn = np.interp(SKIN[f"stretch_{axis}"].values[own][-1], curve["x"], curve["y"])
        np.testing.assert_allclose(drawn, median[-1], rtol=ROUNDING)


@pytest.mark.parametrize("stretch_sd", [None, 0.01])
def test_residuals_are_in_standard_deviations_of_the_noise(stretch_sd):
    data = ph.select(by_hand(), experiment="uniaxial")
    noise = {"stress_sd": SD} | ({"stretch_sd": stretch_sd} if stretch_sd else {})
    tree = fitted(data, ph.NeoHookean(), {"mu": [20.0, 22.0, 25.0]}, **noise)
    figure = ph.plot_fit(tree, residuals=True, backend="none")
    x, measured = data["stretch_x"].values, data["stress_x"].values
    variance = SD**2
    if stretch_sd:
        # P = μ (λ − λ⁻²), here at the median modulus.
        variance = variance + (stretch_sd * 22.0 * (1 + 2 * x**-3)) ** 2
    expected = (measured - 22.0 * (x - x**-2)) / np.sqrt(variance)
    np.testing.assert_allclose(points_of(figure, "residual"), sorted_points(x, expected), rtol=1e-6)


def test_curves_are_those_of_the_measured_thickness_and_gauge_length():
    """The curve passes where the stress is measured, not where it truly is."""
    data, mu, thickness, length = ph.select(by_hand(), experiment="uniaxial"), 20.0, 1.2, 0.9
    draws = {"mu": [mu], "sheet_thickness": [thickness], "gauge_length": [length]}
    figure = ph.plot_fit(fitted(data, ph.NeoHookean(), draws), residuals=True, backend="none")
    x, measured = data["stretch_x"].values, data["stress_x"].values
    true = 1 + (x - 1) / length
    expected = (measured - thickness * mu * (true - true**-2)) / SD
    np.testing.assert_allclose(
        points_of(figure, "residual"), sorted_points(x, expected), rtol=ROUNDING
    )
    curve = elements(figure, "line")[0]
    np.testing.assert_allclose(
        curve["y"][-1], thickness * mu * (true - true**-2)[-1], rtol=ROUNDING
    )


def strips(thickness, rng, *, with_tube):
    """Return strips, and perhaps tubes, of one material; the thickness of a strip has an error."""
    tube, stretch, radius = ph.Tube(1.0, 1.3), np.linspace(1.05, 1.3, 6), np.linspace(1.05, 1.4, 6)
    pressure = ph.inflation_pressure(ph.NeoHookean(), radius, tube, mu=20.0).eval()
    parts = []
    for i, factor in enumerate(thickness):
        stress = factor * 20.0 * (stretch - stretch**-2) + SD * rng.standard_normal(6)
        frame = {"specimen": f"S{i}", "experiment": "strip", "stretch": stretch, "stress": stress}
        parts.append(ph.sheet_data(pd.DataFrame(frame), stress="nominal", kind="uniaxial"))
        if with_tube:
            frame |= {"experiment": "tube", "radius": radius}
            frame["pressure"] = pressure + 0.2 * rng.standard_normal(6)
            parts.append(ph.inflation_data(pd.DataFrame(frame), tube, check="ignore"))
    return ph.combine_tests(*parts)


@pytest.mark.parametrize("with_tube", [False, True], ids=["strips", "strips and tubes"])
def test_curves_of_a_class_pass_through_data_with_an_error_of_the_thickness(with_tube):
    """A strip comes before the tube of the same specimen, whose thickness has an error, too."""
    data = strips([1.4, 0.7, 1.1], np.random.default_rng(1), with_tube=with_tube)
    measures = {"sheet_thickness": ph.MeasuredValue(sd=0.3)}
    if with_tube:
        measures["thickness"] = ph.MeasuredValue(sd=0.01)
    classes = ph.fit_classes(
        ph.NeoHookean(),
        {"S": data},
        ph.Gaussian(stress_sd=SD, pressure_sd=0.2 if with_tube else None),
        priors=measures,
        variability="specimen",
        draws=100,
        random_seed=1,
        progressbar=False,
    )
    for signal in ("stress", "pressure") if with_tube else ("stress",):
        figure = ph.plot_fit(classes, signal=signal, residuals=True, backend="none")
        residual = points_of(figure, "residual")[1]
        # Without the factor residuals would be up to 30; of 18 normal numbers none is beyond 5.
        assert residual.size == 18 and np.abs(residual).max() < 5


def test_fit_of_a_joint_result_shows_each_kind_of_tests():
    tree = fitted(
        joint_by_hand(),
        ph.NeoHookean(),
        {"mu": [20.0, 22.0]},
        pressure_sd=0.5,
        stress_sd=SD,
    )
    figure = ph.plot_fit(tree, backend="none", residuals=True)
    assert texts(figure, "ylabel")[0] == "pressure (kPa)"
    assert texts(figure, "title") == ["S4"]
    figure = ph.plot_fit(tree, signal="stress", backend="none", residuals=True)
    assert texts(figure, "title") == ["biaxial", "uniaxial"]
    with pytest.raises(ValueError, match="no tests of sheets: give one of"):
        ph.plot_fit(fits.fit("sampled"), signal="stress")
    with pytest.raises(ValueError, match=r"no inflation tests: give one of \['stress'\]"):
        ph.plot_fit(fitted(by_hand()), signal="pressure")


def test_lateral_stress_of_other_data_is_predicted():
    """Data to which the result was not fitted are dashed beyond its own."""
    tree = fitted(ph.select(SKIN, experiment="equibiaxial"))
    figure = ph.plot_fit(tree, ph.select(SKIN, experiment="strip x"), backend="none")
    assert {e["linestyle"] for e in elements(figure, "line")} >= {"--"}
