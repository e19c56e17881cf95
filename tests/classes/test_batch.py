"""One specimen, or class, that cannot be sampled does not end what others are worth."""

import numpy as np
import pytest
from variable_classes import TRAINING, classify, curves, fit

import pymc_hyperelastic as ph
from pymc_hyperelastic.classes import specimens
from pymc_hyperelastic.classes.specimens import SpecimenSampler
from pymc_hyperelastic.evidence import integral
from pymc_hyperelastic.evidence.importance import Integral


@pytest.fixture(scope="module")
def new_data():
    return curves({"N1": [42.0], "N2": [90.0], "N3": [45.0]}, 3)


@pytest.fixture(scope="module")
def classes():
    return fit()


def fail_for(monkeypatch, name, error):
    """Let the sampling of one specimen end in an error."""
    sample = SpecimenSampler.__call__

    def failing(self, data, rng):
        if name in data["specimen"].values:
            raise error
        return sample(self, data, rng)

    monkeypatch.setattr(SpecimenSampler, "__call__", failing)


@pytest.mark.parametrize(
    "error",
    [np.linalg.LinAlgError("Matrix is not positive definite"), OverflowError("too large")],
)
def test_the_others_are_classified(monkeypatch, classes, new_data, error):
    """The one that cannot be sampled is named, and cannot be judged."""
    alone = classify(new_data, classes)
    fail_for(monkeypatch, "N2", error)
    with pytest.warns(UserWarning, match=rf"specimen 'N2', .* cannot be judged: {error}"):
        found = classify(new_data, classes)
    assert found["decision"].values.tolist() == ["soft", "cannot be judged", "soft"]
    assert np.isnan(found["class_probability"].values[1]).all()
    assert np.isinf(found["log_evidence_se"].values[1]).all()
    first = found["class_probability"].values[0]
    np.testing.assert_array_equal(first, alone["class_probability"].values[0])


def test_the_other_class_is_fitted(monkeypatch):
    """A training specimen is not left out in silence: its class is not fitted."""
    fail_for(monkeypatch, "B2", np.linalg.LinAlgError("singular"))
    with pytest.warns(UserWarning, match="class 'stiff' cannot be fitted: specimen 'B2'"):
        classes = fit()
    assert list(classes.children) == ["soft"]
    with pytest.raises(ValueError, match="class 'stiff' cannot be fitted: specimen 'B2'"):
        fit(training={"stiff": TRAINING["stiff"]})


def without_importance(monkeypatch):
    """All that importance sampling finds is not known."""

    def unknown(sample):
        def sampled(*args, **settings):
            found = sample(*args, **settings)
            return Integral(found.log_value, np.inf, "importance", found.particles)

        return sampled

    for module, name in (
        (integral, "by_curvature"),
        (integral, "by_importance"),
        (specimens, "by_importance"),
    ):
        monkeypatch.setattr(module, name, unknown(getattr(module, name)))


def test_a_specimen_that_takes_too_long_is_given_up(monkeypatch):
    """Its evidence is not known, and says so; so does that of its class."""
    without_importance(monkeypatch)
    monkeypatch.setattr(integral, "_MOST_EFFORT", 0)
    with pytest.warns(UserWarning, match="was given up after long"):
        classes = fit(training={"soft": TRAINING["soft"]})
    of_specimens = classes["soft"]["specimens"]
    assert np.isinf(of_specimens["standard_error"].values).all()
    assert np.isinf(ph.log_evidence(classes["soft"]).standard_error)


def test_tempering_within_the_limit_is_not_given_up(monkeypatch):
    """The limit is far above what an ordinary specimen takes."""
    without_importance(monkeypatch)
    found = specimens.integrate
    efforts = []

    def integrate(target, size, rng):
        before = target.effort
        result = found(target, size, rng)
        efforts.append(target.effort - before)
        return result

    monkeypatch.setattr(specimens, "integrate", integrate)
    fit(training={"soft": TRAINING["soft"]})
    assert 0 < max(efforts) < integral._MOST_EFFORT / 20
