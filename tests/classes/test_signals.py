"""What each measured signal says of pooled classes, against closed forms and plain sums."""

import itertools
from functools import cache
from typing import NamedTuple

import numpy as np
import pandas as pd
import pymc as pm
import pytest
from problems import AS_WRITTEN
from scipy.special import logsumexp, softmax

import pymc_hyperelastic as ph
from pymc_hyperelastic.classes.pooled import ClassPredictive

SEED = 9140
TUBE = {"inner_radius": 7.0, "outer_radius": 9.0}
RADIUS = np.linspace(7.3, 9.0, 9)
SIGNALS = ("pressure", "slope", "force")
SIGMA, SLOPE_WEIGHT, FORCE_SIGMA = 1.5, 0.8, 60.0
WEIGHTS = {
    "pressure": 1 / SIGMA**2,
    "slope": SLOPE_WEIGHT / SIGMA**2,
    "force": 1 / FORCE_SIGMA**2,
}
# Nats, of differences between evidences of some thousand draws each.
TOLERANCE = 0.15
# Of what is the same numbers in another order.
ROUNDING = 1e-9


# --- laws that are linear in their parameters -----------------------------------------------------


class Law(NamedTuple):
    """A law with independent normal priors of one mean and deviation."""

    energy: ph.StrainEnergy
    mean: float
    sd: float

    @property
    def names(self):
        return self.energy.parameter_names

    @property
    def priors(self):
        return {name: pm.Normal.dist(self.mean, self.sd) for name in self.names}


NEO_HOOKEAN = Law(ph.NeoHookean(), 50.0, 15.0)
# Of two laws that are about as probable.
WIDE, MOONEY_RIVLIN = Law(ph.NeoHookean(), 50.0, 600.0), Law(ph.MooneyRivlin(), 12.0, 12.0)


@cache
def columns(law):
    """What one unit of each parameter adds: (parameter, point) of each signal."""
    functions = (ph.inflation_pressure, ph.inflation_stiffness, ph.axial_force)
    each = []
    for one in law.names:
        unit = {name: float(name == one) for name in law.names}
        each.append(
            [f(law.energy, RADIUS, **unit, **TUBE).eval(mode=AS_WRITTEN) for f in functions]
        )
    pressure, slope, force = np.moveaxis(each, 0, 1)
    return {"pressure": pressure, "slope": slope[:, 1:-1], "force": force}


def tubes(specimens, seed, force=True):
    """Data of specimens: the modulus of their pressures, an offset, and the modulus of the force.

    An offset makes pressures those of another modulus, and changes no slope.
    """
    rng, unit = np.random.default_rng(seed), columns(NEO_HOOKEAN)
    tables = []
    for name, (mu, offset, mu_of_force) in specimens.items():
        table = {"specimen": name, "experiment": 1, "radius": RADIUS}
        noise = rng.standard_normal((2, RADIUS.size))
        table["pressure"] = mu * unit["pressure"][0] + offset + 0.2 * noise[0]
        if force:
            table["axial_force"] = mu_of_force * unit["force"][0] + 5.0 * noise[1]
        tables.append(pd.DataFrame(table))
    return ph.inflation_data(pd.concat(tables, ignore_index=True), **TUBE, check="ignore")


# The last class is known least.
TRAINING = {
    "soft": tubes({"A1": (38.0, 0.0, 40.0), "A2": (42.0, 0.0, 40.0)}, 1),
    "stiff": tubes({"B1": (62.0, 0.0, 66.0), "B2": (66.0, 0.0, 66.0)}, 2),
    "middle": tubes({"C1": (50.0, 0.0, 52.0)}, 3),
}
# Signals of the second and the third contradict each other.
NEW = tubes({"N1": (44.0, 0.3, 42.0), "N2": (60.0, -1.5, 60.0), "N3": (45.0, 1.5, 35.0)}, 4)


def fit(law=NEO_HOOKEAN, names=("soft", "stiff"), **settings):
    defaults = {"sigma": SIGMA, "slope_weight": SLOPE_WEIGHT, "force_sigma": FORCE_SIGMA}
    defaults |= {"priors": law.priors, "draws": 1000, "chains": 2}
    defaults |= {"random_seed": SEED, "progressbar": False}
    training = {name: TRAINING[name] for name in names}
    return ph.fit_classes(law.energy, training, **defaults | settings)


def classify(data, classes, **settings):
    settings = {"by": "specimen", "random_seed": SEED, "progressbar": False} | settings
    return ph.classify(data, classes, **settings)


# --- the answers by hand --------------------------------------------------------------------------


def measured(data):
    """Pressures, their central differences, and forces of each test."""
    tests = []
    for test in range(data.sizes["test"]):
        at = data["test"].values == test
        pressure, radius = data["pressure"].values[at], data["radius"].values[at]
        slope = (pressure[2:] - pressure[:-2]) / (radius[2:] - radius[:-2])
        tests.append({"pressure": pressure, "slope": slope})
        if "axial_force" in data:
            tests[-1]["force"] = data["axial_force"].values[at]
    return tests


class Gaussian(NamedTuple):
    """``exp(-θᵀPθ/2 + bᵀθ - c/2)``, but for a factor that all classes have."""

    precision: np.ndarray
    linear: np.ndarray
    square: float

    @classmethod
    def prior(cls, law):
        size = len(law.names)
        precision, mean = np.eye(size) / law.sd**2, np.full(size, law.mean)
        return cls(precision, precision @ mean, mean @ precision @ mean)

    def times(self, tests, law, signals):
        """With what these signals of some tests say."""
        p, b, c = self
        for test in tests:
            for name in signals:
                g, y, w = columns(law)[name], test[name], 2 * WEIGHTS[name]
                g, y = g[:, np.isfinite(y)], y[np.isfinite(y)]
                p, b, c = p + w * g @ g.T, b + w * g @ y, c + w * y @ y
        return Gaussian(p, b, c)

    @property
    def log_integral(self):
        peak = self.linear @ np.linalg.solve(self.precision, self.linear)
        return (peak - self.square - np.linalg.slogdet(self.precision)[1]) / 2


def training_evidence(law, signals=SIGNALS):
    """Log evidence of a law, that of both classes together, but for what laws have in common."""
    prior = Gaussian.prior(law)
    posteriors = [prior.times(measured(TRAINING[n]), law, signals) for n in ("soft", "stiff")]
    return sum(posterior.log_integral - prior.log_integral for posterior in posteriors)


def evidence(name, new, law=NEO_HOOKEAN, signals=SIGNALS):
    """Log evidence of some of the signals of new tests, by a class that was fitted to `signals`."""
    of_class = Gaussian.prior(law).times(measured(TRAINING[name]), law, signals)

    def of_signals(some):
        return of_class.times(new, law, some).log_integral - of_class.log_integral

    return of_signals


def shapley(log_ratio, signals=SIGNALS):
    """Mean of what each signal adds to a log ratio, over all orders in which they come."""
    parts, orders = dict.fromkeys(signals, 0.0), [*itertools.permutations(signals)]
    for order in orders:
        for i, name in enumerate(order):
            parts[name] += (log_ratio(order[: i + 1]) - log_ratio(order[:i])) / len(orders)
    return np.array([parts[name] for name in signals])


def expected_parts(result, new, signals=SIGNALS):
    """Parts of each specimen, class by class, against the rival that the result names."""
    expected = []
    for test, rivals in zip(measured(new), result["rival"].values.tolist(), strict=True):
        known = {n: evidence(n, [test], signals=signals) for n in result["class_label"].values}
        expected.append(
            [
                shapley(lambda s, own=own, other=rival: known[own](s) - known[other](s), signals)
                for own, rival in zip(known, rivals, strict=True)
            ]
        )
    return np.array(expected)


def assert_they_add_up(result):
    """The parts of each class and its rival are those of the log ratio that is told."""
    names = result["class_label"].values.tolist()
    for i, rivals in enumerate(result["rival"].values.tolist()):
        value = result["log_evidence"].values[i]
        log_ratio = value - value[[names.index(rival) for rival in rivals]]
        found = result["log_ratio_part"].values[i].sum(axis=-1)
        np.testing.assert_allclose(found, log_ratio, atol=ROUNDING)


# --- closed forms ---------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def classes():
    return fit()


def test_three_signals_have_the_parts_of_closed_forms(classes, tmp_path):
    """A linear law with a normal prior: evidences of all subsets are Gaussian integrals."""
    result = classify(NEW, classes)
    assert result["part"].values.tolist() == [*SIGNALS]
    assert_they_add_up(result)
    expected = expected_parts(result, NEW)
    np.testing.assert_allclose(result["log_ratio_part"], expected, atol=TOLERANCE)
    # The slopes of the second say what its pressures deny, and forces of the third likewise.
    soft = result["log_ratio_part"].sel(class_label="soft").values
    assert soft[1, 0] > 1 > -1 > soft[1, 1]
    assert soft[2, 0] < -1 < 1 < soft[2, 2]
    result.to_netcdf(tmp_path / "result.nc")


@pytest.mark.parametrize(
    ("settings", "signals"),
    [({"force_sigma": None}, SIGNALS[:2]), ({"slope_weight": 0.0}, SIGNALS[::2])],
)
def test_two_signals_have_the_parts_of_closed_forms(settings, signals):
    """Whichever are there, by the names that they have, by test as by specimen."""
    result = classify(NEW, fit(**settings))
    assert result["part"].values.tolist() == [*signals]
    assert_they_add_up(result)
    expected = expected_parts(result, NEW, signals)
    np.testing.assert_allclose(result["log_ratio_part"], expected, atol=TOLERANCE)
    assert np.abs(expected).max() > 1


def test_each_of_three_classes_is_held_against_its_rival():
    """Classes that are known unlike well, and rivals that are not each other's."""
    new = NEW.isel(test=[0, 1], obs=NEW["test"].values < 2)
    result = classify(new, fit(names=TRAINING))
    assert len({tuple(row) for row in result["rival"].values.tolist()}) > 1
    assert_they_add_up(result)
    expected = expected_parts(result, new)
    np.testing.assert_allclose(result["log_ratio_part"], expected, atol=TOLERANCE)


def test_averages_over_laws_have_the_parts_of_averaged_evidences():
    """Two linear laws, each by its evidence; the class's signals and the rival's by one law."""
    both = (WIDE, MOONEY_RIVLIN)
    first, second = (fit(law, draws=500) for law in both)
    result = classify(NEW, first, average_over=[second])
    weights = softmax([training_evidence(law) for law in both])
    assert weights.min() > 0.05  # or the average would be of one
    np.testing.assert_allclose(result["strain_energy_probability"], weights, atol=0.05)
    assert_they_add_up(result)
    weights = result["strain_energy_probability"].values
    for i, test in enumerate(measured(NEW)):
        known = [[evidence(name, [test], law) for name in ("soft", "stiff")] for law in both]

        def told_by_the_class(signals, known=known):
            others = [s for s in SIGNALS if s not in signals]
            hybrids = [own(signals) + rival(others) for own, rival in known]
            return logsumexp(hybrids, b=weights)

        found = result["log_ratio_part"].sel(class_label="soft").values[i]
        np.testing.assert_allclose(found, shapley(told_by_the_class), atol=TOLERANCE)


# --- noise that is not known ----------------------------------------------------------------------


def log_likelihoods(data, mu, sigma, slope_weight):
    """Of pressures, of slopes, and of both, at each draw: written down with dense matrices."""
    (test,), unit = measured(data), columns(NEO_HOOKEAN)
    misfit = {
        name: np.sum((np.outer(mu, unit[name][0]) - test[name]) ** 2, axis=1)
        for name in ("pressure", "slope")
    }
    points, interior = len(RADIUS), len(RADIUS) - 2
    rows = np.zeros((interior, points))
    for i, step in enumerate(RADIUS[2:] - RADIUS[:-2]):
        rows[i, i], rows[i, i + 2] = -1 / step, 1 / step
    precision = np.eye(points) + slope_weight[:, None, None] * (rows.T @ rows)
    log_determinant = np.linalg.slogdet(precision)[1]
    pressure = -misfit["pressure"] / sigma**2 - points / 2 * np.log(np.pi * sigma**2)
    slope = -slope_weight * misfit["slope"] / sigma**2
    alone = slope - interior / 2 * np.log(np.pi * sigma**2 / slope_weight)
    both = pressure + slope + log_determinant / 2
    return {("pressure",): pressure, ("slope",): alone, ("pressure", "slope"): both, (): 0 * mu}


def test_noise_that_is_inferred_is_that_of_each_class():
    """Against mean likelihoods of the stored draws; slopes alone are a density of slopes."""
    unknown = {"sigma": pm.LogNormal.dist(0.0, 1.0), "slope_weight": pm.LogNormal.dist(0.0, 1.0)}
    rng = np.random.default_rng(SEED)
    loud = TRAINING["stiff"].copy()
    loud["pressure"] = loud["pressure"] + 1.0 * rng.standard_normal(loud.sizes["obs"])
    settings = {"random_seed": SEED, "progressbar": False, "draws": 6000, "chains": 2}
    classes = ph.fit_classes(
        ph.NeoHookean(),
        {"quiet": TRAINING["middle"], "loud": loud},
        priors=NEO_HOOKEAN.priors,
        **unknown,
        **settings,
    )
    new = tubes({"N": (55.0, 0.3, 0.0)}, 5, force=False)
    result = classify(new, classes)
    known = {}
    for name, fitted in classes.children.items():
        draws = [fitted["posterior"][v].values.ravel() for v in ("mu", "sigma", "slope_weight")]
        each = log_likelihoods(new, *draws)
        known[name] = {s: logsumexp(v) - np.log(v.size) for s, v in each.items()}
        weights = softmax(each["pressure", "slope"])
        assert 1 / np.sum(weights**2) > 200, name  # or the draws would tell little
    order = {frozenset(s): s for s in known["quiet"]}

    def log_ratio(signals):
        some = order[frozenset(signals)]
        return known["quiet"][some] - known["loud"][some]

    found = result["log_ratio_part"].sel(class_label="quiet").values[0]
    np.testing.assert_allclose(found, shapley(log_ratio, SIGNALS[:2]), atol=TOLERANCE)
    assert_they_add_up(result)


# --- what is not there, and what cannot be told ---------------------------------------------------


def test_one_signal_is_never_divided(monkeypatch):
    """Its part is the log ratio, and no evidence but that of all is asked for."""
    monkeypatch.delattr(ClassPredictive, "log_evidence_of")
    result = classify(NEW, fit(slope_weight=0.0, force_sigma=None))
    assert result["part"].values.tolist() == ["pressure"]
    assert_they_add_up(result)


def test_forces_that_were_not_measured_say_nothing(classes):
    """The part of a specimen without forces is nothing at all; that of the next one is not."""
    force = NEW["axial_force"].where(NEW["test"] != 1)
    new = NEW.assign(axial_force=force.assign_attrs(NEW["axial_force"].attrs))
    result = classify(new, classes)
    assert np.all(result["log_ratio_part"].sel(part="force").values[1] == 0)
    np.testing.assert_allclose(
        result["log_ratio_part"], expected_parts(result, new), atol=TOLERANCE
    )
    assert_they_add_up(result)


def test_signals_that_cannot_be_told_apart_cost_no_answer(classes, monkeypatch):
    """Where one evidence of a signal alone is not to be had, no part is told, and all else is."""
    expected = classify(NEW, classes)

    def failing(self, effort, rng):
        raise ValueError("none of the particles is possible")

    with monkeypatch.context() as patch:
        original = ClassPredictive._predict

        def without_forces(self, effort, rng):
            if self._switches["force"].get_value() == 0:
                return failing(self, effort, rng)
            return original(self, effort, rng)

        patch.setattr(ClassPredictive, "_predict", without_forces)
        result = classify(NEW, classes)
    assert np.isnan(result["log_ratio_part"]).all()
    for name in ("log_evidence", "log_evidence_se", "class_probability", "decision", "rival"):
        np.testing.assert_array_equal(result[name], expected[name])


def test_evidences_of_all_signals_stay_what_they_are(classes, monkeypatch):
    """What is asked for beside does not change the answers to those that come after."""
    expected = classify(NEW, classes)
    monkeypatch.setattr(ClassPredictive, "log_evidence_of", lambda *_: 0.0)
    result = classify(NEW, classes)
    for name in ("log_evidence", "log_evidence_se", "class_probability", "method"):
        np.testing.assert_array_equal(result[name], expected[name])
