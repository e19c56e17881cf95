"""Parts of the signals in the log ratio of classes, against Gaussian integrals over the modulus."""

import itertools

import numpy as np
import pandas as pd
import pymc as pm
import pytest
import variable_classes
from problems import AS_WRITTEN
from tiers import deep
from variable_classes import TUBE, classify, explain

import pymc_hyperelastic as ph
from pymc_hyperelastic.classes.pooled import PooledClass
from pymc_hyperelastic.classes.shapley import shapley

RADIUS = np.linspace(7.3, 9.0, 9)
SIGNALS = ("pressure", "slope", "force")
SIGMA, SLOPE_WEIGHT, FORCE_SIGMA = 1.5, 0.8, 60.0
WEIGHTS = (2 / SIGMA**2, 2 * SLOPE_WEIGHT / SIGMA**2, 2 / FORCE_SIGMA**2)
# Mean and standard deviation of the modulus.
PRIOR = (50.0, 15.0)
# Nats, of differences between evidences of some thousand draws each.
TOLERANCE = 0.15
FUNCTIONS = (ph.inflation_pressure, ph.inflation_stiffness, ph.axial_force)
UNIT = [
    f(ph.NeoHookean(), RADIUS, ph.Tube(**TUBE), mu=1.0).eval(mode=AS_WRITTEN) for f in FUNCTIONS
]
UNIT[1] = UNIT[1][1:-1]


def tubes(specimens, seed):
    """Data of specimens: modulus of the pressures, an offset, and modulus of the force."""
    rng, tables = np.random.default_rng(seed), []
    for name, (mu, offset, mu_of_force) in specimens.items():
        noise = rng.standard_normal((2, RADIUS.size))
        table = {"specimen": name, "experiment": 1, "radius": RADIUS}
        table["pressure"] = mu * UNIT[0] + offset + 0.2 * noise[0]
        table["axial_force"] = mu_of_force * UNIT[2] + 5.0 * noise[1]
        tables.append(pd.DataFrame(table))
    return ph.inflation_data(pd.concat(tables, ignore_index=True), ph.Tube(**TUBE), check="ignore")


# The class with one specimen has the widest posterior.
TRAINING = {
    "soft": tubes({"A1": (38.0, 0.0, 40.0), "A2": (42.0, 0.0, 40.0)}, 1),
    "stiff": tubes({"B1": (62.0, 0.0, 66.0), "B2": (66.0, 0.0, 66.0)}, 2),
    "middle": tubes({"C1": (50.0, 0.0, 52.0)}, 3),
}
# Signals of the first two specimens contradict each other; the third lacks forces.
NEW = tubes({"N1": (60.0, -1.5, 60.0), "N2": (45.0, 1.5, 35.0), "N3": (44.0, 0.3, 42.0)}, 4)
NEW["axial_force"][NEW["test"].values == 2] = np.nan


def fit(names=("soft", "stiff"), **settings):
    defaults = {"likelihood": ph.SlopeAugmented(SIGMA, SLOPE_WEIGHT, force_sigma=FORCE_SIGMA)}
    defaults |= {"priors": {"mu": pm.Normal.dist(*PRIOR)}, "draws": 1000, "variability": None}
    training = {name: TRAINING[name] for name in names}
    return variable_classes.fit(training=training, **defaults | settings)


def measured(data):
    """Pressures, their central differences, and forces of each test."""
    names = "pressure", "radius", "axial_force"
    for test in range(data.sizes["test"]):
        p, r, f = (data[name].values[data["test"].values == test] for name in names)
        yield p, (p[2:] - p[:-2]) / (r[2:] - r[:-2]), f


def log_integral(tests):
    """Log of prior times likelihood, integrated over the modulus; tests with the signals used."""
    mean, sd = PRIOR
    p, b, c = sd**-2, mean * sd**-2, mean**2 * sd**-2
    for test, signals in tests:
        for name, y, g, w in zip(SIGNALS, test, UNIT, WEIGHTS, strict=True):
            if name in signals:
                g, y = g[np.isfinite(y)], y[np.isfinite(y)]
                p, b, c = p + w * g @ g, b + w * g @ y, c + w * y @ y
    return (b**2 / p - c - np.log(p)) / 2


def evidence(name, test, signals):
    """Log evidence of some signals of a test under a class."""
    training = [(known, SIGNALS) for known in measured(TRAINING[name])]
    return log_integral([*training, (test, signals)]) - log_integral(training)


def expected_parts(own, rival, test):
    """Return Shapley values; test_explain compares them with means over all orders."""
    used = [list(itertools.compress(SIGNALS, on)) for on in itertools.product((1, 0), repeat=3)]
    ratios = [evidence(own, test, some) - evidence(rival, test, some) for some in used]
    return shapley(np.reshape(ratios, (2, 2, 2)))


@pytest.fixture(scope="module")
def classes():
    return fit(names=TRAINING)


@pytest.fixture(scope="module")
def result(classes):
    return explain(NEW, classes)


def test_parts_of_signals_equal_closed_forms(result):
    """Each of three classes against its most probable rival; missing forces have no part."""
    assert result["part"].values.tolist() == [*SIGNALS]
    names, rivals = result["class_label"].values, result["rival"].values
    assert len({*map(tuple, rivals)}) > 1
    found = result["log_ratio_part"]
    for i, test in enumerate(measured(NEW)):
        expected = [expected_parts(*both, test) for both in zip(names, rivals[i], strict=True)]
        np.testing.assert_allclose(found[i], expected, atol=TOLERANCE)
    assert np.abs(found).max() > 1
    np.testing.assert_array_equal(found.sel(part="force")[2], 0)


@pytest.mark.parametrize("settings", [{}, *deep([{"variability": "specimen", "priors": None}])])
def test_specimen_without_forces_is_classified_alone_as_beside_others(settings):
    """It may have a column of forces without a number, or none."""
    classes = fit(**{"draws": 200} | settings)
    without = ph.select(NEW, specimen="N3")
    found = [classify(data, classes) for data in (NEW, without, without.drop_vars("axial_force"))]
    beside, *alone = (result["log_evidence"].sel(specimen="N3").values for result in found)
    for evidence in alone:
        np.testing.assert_allclose(evidence, beside, rtol=0, atol=TOLERANCE)


def test_part_of_the_only_signal_equals_the_log_ratio():
    classes = fit(likelihood=SIGMA / np.sqrt(2))
    new = ph.select(NEW, specimen="N3")
    found = explain(new, classes)
    assert found["part"].values.tolist() == ["pressure"]
    (log_ratio,) = -np.diff(classify(new, classes)["log_evidence"][0])
    np.testing.assert_allclose(found["log_ratio_part"][0, :, 0], [log_ratio, -log_ratio])


def test_explain_refuses_a_single_class(classes):
    alone = classes.copy()
    del alone["stiff"], alone["middle"]
    with pytest.raises(ValueError, match="classes holds only 'soft'"):
        explain(NEW, alone)


def test_parts_that_cannot_be_computed_are_nan(classes, monkeypatch):
    predictive = PooledClass.predictive

    def without_forces(self, fitted, forward, rng, signals=None):
        if "force" not in (signals or SIGNALS):
            raise ValueError("none of the particles is possible")
        return predictive(self, fitted, forward, rng, signals)

    monkeypatch.setattr(PooledClass, "predictive", without_forces)
    found = explain(ph.select(NEW, specimen=["N1"]), classes)
    assert np.isnan(found["log_ratio_part"]).all()
    assert (found["rival"] != "").all()
