"""plot_specimens: specimens by themselves, with their class, and the class."""

import fits
import numpy as np
import pytest
from figures import elements, texts
from variable_classes import GRID, TRAINING, log_likelihoods, modulus

import pymc_hyperelastic as ph
from pymc_hyperelastic.classes.kinds import kind_of_classes

X = "log_reference_strain"
# Errors of quantiles of weighted draws, relative to the width of their interval.
OF_DRAWS = 0.15


@pytest.fixture(scope="module")
def classes():
    return fits.fit("neo_hookean_classes")


@pytest.fixture(scope="module")
def figure(classes):
    return ph.plot_specimens(classes, X, backend="none")


def quantiles(density, probs):
    cumulative = np.cumsum(density) / density.sum()
    return np.interp(probs, cumulative, GRID)


def test_specimens_by_themselves_have_the_posterior_of_the_wide_reference(classes, figure):
    reference = kind_of_classes(classes).reference
    mean, sd = float(reference.location[0]), float(reference.spread[0])
    prior = np.exp(-(((GRID - mean) / sd) ** 2) / 2)
    for group, data in TRAINING.items():
        for name in dict.fromkeys(data["specimen"].values):
            likelihood = log_likelihoods(ph.select(data, specimen=name)).sum(axis=0)
            density = prior * np.exp(likelihood - likelihood.max())
            low, high = quantiles(density, [0.025, 0.975])
            line = figure.get_viz("alone_interval", specimen=name, class_label=group)
            np.testing.assert_allclose(line["x"], [low, high], atol=OF_DRAWS * (high - low))


def test_classes_pull_their_specimens_together(figure):
    for group, data in TRAINING.items():
        places = [
            [
                float(np.ravel(figure.get_viz(visual, specimen=name, class_label=group)["x"])[0])
                for name in dict.fromkeys(data["specimen"].values)
            ]
            for visual in ("alone", "specimens")
        ]
        alone, own = map(np.ptp, places)
        assert own < alone


def test_the_band_holds_new_specimens_and_a_row_the_typical_one(classes, figure):
    for group in TRAINING:
        posterior = classes[group]["posterior"].to_dataset()
        location = posterior["location"].values.ravel()
        point = figure.get_viz("typical", class_label=group)
        assert np.ravel(point["x"])[0] == pytest.approx(np.median(location))
        band = figure.get_viz("new", class_label=group)
        total = np.hypot(posterior["spread"].values.ravel(), location.std())
        width = np.ptp(np.ravel(band["x"]))
        assert width == pytest.approx(3.92 * np.sqrt((total**2).mean()), rel=0.3)


def test_rows_are_ordered_by_class_and_named(figure):
    (ticks,) = elements(figure, "yticks")
    rows = ["A1", "A2", "A3", "typical soft", "B1", "B2", "B3", "typical stiff"]
    assert list(ticks["labels"]) == rows
    assert (np.diff(ticks["ticks"]) < 0).all()
    assert texts(figure, "xlabel") == ["log reference strain"]


def test_a_single_class_and_a_parameter_can_be_shown(classes, figure):
    own = ph.plot_specimens(classes["soft"], "mu", backend="none")
    assert texts(own, "xlabel") == [r"$\mu$ (kPa)"]
    for name in ("A1", "A2", "A3"):
        (x,) = np.ravel(figure.get_viz("specimens", specimen=name, class_label="soft")["x"])
        (mu,) = np.ravel(own.get_viz("specimens", specimen=name, class_label="soft")["x"])
        assert mu == pytest.approx(modulus(x), rel=1e-3)


def test_classes_without_variability_are_refused():
    with pytest.raises(ValueError, match="fit the classes with variability='specimen'"):
        ph.plot_specimens(fits.fit("pooled"), "mu")
