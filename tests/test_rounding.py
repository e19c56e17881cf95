"""Rounding errors, which differ between computers, change no decision, order or message."""

from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
import xarray as xr
from arviz_stats import summary
from tube_posteriors import result

import pymc_hyperelastic as ph
from pymc_hyperelastic.classes import typicality
from pymc_hyperelastic.classes.classification import _decide
from pymc_hyperelastic.classes.covariates import Covariates
from pymc_hyperelastic.classes.shapley import rivals_of
from pymc_hyperelastic.data import extension, order
from pymc_hyperelastic.data.files.join import joined
from pymc_hyperelastic.design import information, trials
from pymc_hyperelastic.design.planned_tests import PlannedTube, radii_of
from pymc_hyperelastic.evidence.convergence import disagreement
from pymc_hyperelastic.evidence.weights import pareto_shape
from pymc_hyperelastic.plots import fitted_curves, probability
from pymc_hyperelastic.predictions import draws, measured
from pymc_hyperelastic.reports import decisions, diagnosis
from pymc_hyperelastic.reports.page import Page

DIMS = ("specimen", "class_label")
# 2⁻⁵² is the distance from 1 to the next number.
either_way = pytest.mark.parametrize("error", [0.0, 2**-52, -(2**-52)])


@either_way
def test_first_of_equally_probable_classes_is_chosen_despite_rounding(error):
    """Checked are the decision, its limits, the score, the rival, and the words beside the bars."""
    p = xr.DataArray([[0.5 - error / 2, 0.5 + error / 2]], {"class_label": ["a", "b"]}, DIMS)
    columns = {"class_probability": p, "log_evidence": np.log(p), "log_evidence_se": 0 * p}
    columns |= {"pareto_k": 0 * p, "class_verdict": xr.full_like(p, "good", dtype=object)}
    columns["p_value"] = xr.full_like(p, 0.05 * (1 - abs(error)))
    assert _decide(xr.Dataset(columns), np.full(2, 0.5), 0.5, 0.05).values == ["a"]
    scores = ph.score_probabilities(p, ["a"], bins=2)
    assert (scores["correct"].item(), *scores["count"].values[1]) == (True, 1, 0)
    assert rivals_of(np.array([-3.0, 2 * error - 2, -2 * error - 2]))[0] == 1
    shown = xr.Dataset({"class_probability": p, "class_probability_se": 0.1 + 0 * p})
    assert probability._words_of(shown, "specimen") == [(True, "a 0.50 ± 0.10")]


@either_way
def test_order_of_equal_decisions_and_designs_does_not_depend_on_rounding(error):
    """Checked are decisions in a report, designs, and classes of simulated specimens."""
    p = 0.5 + error * np.arange(300)[::-1, None] * [1, -1]
    table = xr.Dataset({"class_probability": (DIMS, p)}, {"specimen": range(300)})
    table = table.assign(decision=("specimen", ["a"] * 300)).assign_coords(class_label=["a", "b"])
    assert decisions._least_clear(table, Page(title=""))["specimen"].values.tolist() == list(
        range(200)
    )
    gain = 0.3 + np.linspace(-0.1, 0.1, 5) + error * np.array([[0], [3], [-3], [5]])
    tried = trials.Specimens({}, np.zeros(5, int), np.log([0.5, 0.5]))
    designs, gains = {name: [] for name in "bcad"}, np.stack([gain, gain])
    planned = information._result(designs, gains, gain + 100, tried, ["A"], "class", None)
    assert planned["design"].values.tolist() == list("bcad")
    assert trials._in_proportion(np.array([1 + error, 1 - error]) / 2, 3).tolist() == [0, 0, 1]


def covariates(values):
    groups, names = {"a": slice(0, 2), "b": slice(2, 5)}, ["A1", "A2", "B1", "B2", "B3"]
    both = xr.Dataset({"x": ("specimen", values)}, {"specimen": names})
    tree = {f"{group}/specimens": both.isel(specimen=own) for group, own in groups.items()}
    return Covariates(xr.DataTree.from_dict(tree), {"x": both["x"].to_series().to_dict()})


def test_covariate_constant_or_collinear_up_to_rounding_is_recognised():
    """0.1 + 0.2 equals 0.3 up to rounding; two values that separate the groups are collinear."""
    with pytest.raises(ValueError, match="'x' is the same for all specimens"):
        covariates([0.3, 0.1 + 0.2, 0.3, 0.3, 0.1 + 0.2])
    with pytest.warns(UserWarning, match="are collinear"):
        covariates(1e6 + np.array([0.1, 0.1, 0.7, 0.7, 0.7]))


def test_planned_radius_equal_to_the_unloaded_radius_gives_nan():
    """In 40 tubes the pressure at the unloaded radius is 0 up to rounding errors."""
    scale = SimpleNamespace(names=["mu"], numbers=lambda coordinates: {"mu": coordinates[0]})
    settings = {"geometry": {}, "energy": ph.NeoHookean(), "variability": ph.Variability()}
    kind = SimpleNamespace(scale=scale, **settings)
    for inner in np.linspace(5.0, 9.0, 40):
        tube = {"inner_radius": inner, "outer_radius": inner + 2, "opening_angle": 0.0}
        test = PlannedTube("radius", np.array([inner / 1.3**0.5]), np.array([1.3]), False, tube, "")
        assert np.isnan(radii_of(kind, [test], {"mu": np.array([[30.0]])})).all()


def test_sign_of_eigenvectors_does_not_change_a_p_value(monkeypatch):
    """The sign of eigenvectors depends on the linear algebra library."""
    normal, eigh, found = np.random.default_rng(1).standard_normal((3, 2, 400)), np.linalg.eigh, []
    for signs in ([1, 1], [1, -1]):
        monkeypatch.setattr(np.linalg, "eigh", lambda a, s=signs: (eigh(a)[0], eigh(a)[1] * s))
        coordinates = 0.3 * normal[0] + 1, normal[1], normal[2]
        found.append(typicality._share_as_far(*coordinates, np.random.default_rng(2)))
    assert found[0] == found[1]


def test_first_of_equally_disagreeing_unknowns_is_named():
    """The second unknown is the negative of the first one and disagrees as much."""
    for seed in range(10):
        rng = np.random.default_rng(seed)
        x = rng.normal([[0.0], [1.0]], 1.0, (2, 100))
        (words,) = disagreement(["x", "y"], np.stack([x, -x], axis=2), rng.normal(size=(2, 100)))
        assert "of x)" in words


def test_numbers_equal_up_to_rounding_have_no_pareto_tail_and_no_rhat_warning():
    """Weights whose logarithms near -1e4 differ by 1e-12, and draws that differ by 1e-16."""
    rng = np.random.default_rng(1)
    assert pareto_shape(-1e4 + 1e-12 * rng.standard_normal(4000)) == -np.inf
    page, draws = Page(title=""), 0.3 * (1 + 2**-52 * np.repeat([[0], [1]], 100, axis=1))
    posterior = xr.Dataset({"mu": (("chain", "draw"), draws)})
    diagnosis._check_convergence("Fit", posterior, summary(posterior, round_to="none"), page)
    assert not page.notices


def test_stress_at_an_interface_is_the_stress_of_the_inner_layer():
    """The position of the interface is rounded differently in each draw of the inner radius."""
    layers = [ph.Layer(ph.NeoHookean(), 0.5), ph.Layer(ph.NeoHookean(), 0.3, mu=1.0)]
    tree = result(mu_1=np.full(60, 100.0), inner_radius=np.linspace(3.0, 9.0, 60))
    stress = ph.wall_stress(tree, 0.5, points=[0.62, 0.625, 0.63], energy=layers)
    # The outer layer is a hundred times softer, so that its hoop stress is far smaller.
    np.testing.assert_allclose(*stress["sigma_tt"].values[0, :, 0, :2].T, rtol=0.05)


@pytest.mark.parametrize("unit", [1.0, 1 / 3, ph.mmHg, 7.5006])
def test_pressure_drop_of_a_tenth_of_the_range_is_no_turn_in_any_unit(unit):
    """The pressure drops by 10 of 100 mmHg, also in other units."""
    assert order._turns(unit * np.array([0.0, 50.0, 40.0, 100.0, 90.0])) == 0


def test_lengths_equal_up_to_rounding_of_units_agree():
    """6.9 mm and 0.0069 m, which is 6.8999999999999995 mm."""
    points = pd.DataFrame({"specimen": "S1", "experiment": 1, "pressure": [1.0, 2.0]})
    points = points.assign(radius=[7.0, 7.5], inner_radius=[6.9, 0.0069 * 1000])
    tubes = pd.DataFrame({"specimen": ["S1"], "inner_radius": [0.0069 * 1000]})
    joined(points, [tubes])  # refuses a table that does not agree with the points
    data = ph.inflation_data(points, ph.Tube(inner_radius="inner_radius", outer_radius=8.0))
    assert data["inner_radius"].item() == 6.9


@either_way
def test_stretches_equal_up_to_rounding_belong_to_one_tube(error):
    """The two stretches define one tube, and one point of the hull of all stretches."""
    stretch = np.array([1.2, 1.2 + error])
    data = ph.select(ph.load_dataset("simulated_sheep_aorta"), specimen="S1", experiment=[1, 2])
    data = data.assign(axial_stretch=("test", stretch))
    assert draws._common_geometry(data)["axial_stretch"] == 1.2
    assert fitted_curves.tubes_of(data).tolist() == [0, 0]
    assert measured.upper_hull(
        np.full(2, 1.2), np.append(stretch, 1.5), np.arange(3.0)
    ).tolist() == [1, 1]
    assert not extension.clearly_extended(np.array([*stretch, 1.2, 1.5]))
