"""Kullback-Leibler divergence of two classes, against quadrature."""

import exact
import fits
import numpy as np
import pytest
from pooled_classes import NAMES, NOISE, STANDARD_ERRORS, exact_posterior, training_curves

import pymc_hyperelastic as ph
from pymc_hyperelastic.classes.pooled import PooledClass


@pytest.mark.parametrize(("first", "second"), [NAMES, NAMES[::-1]])
def test_divergence_equals_quadrature(first, second):
    """The mean of the log ratio of two posteriors over the nodes of the first."""
    fitted = exact_posterior(first)
    exponent, row = np.unique(fitted.exponent, return_inverse=True)
    log_ratio = 0.0
    for sign, name in ((1, first), (-1, second)):
        terms = exact.parabola(training_curves(name), "Ogden", exponent, **NOISE)
        top, curvature, peak = (x[row] for x in terms)
        log_density = top - curvature * (fitted.modulus - peak) ** 2
        log_ratio += sign * (log_density - exact_posterior(name).log_evidence)
    truth = fitted.mean(log_ratio)
    value, error = ph.kl_divergence(fits.fit("pooled"), first, second)
    assert abs(value - truth) < STANDARD_ERRORS * error
    assert error < 0.05 * truth


def test_divergence_of_a_class_from_itself_is_zero_without_error():
    assert ph.kl_divergence(fits.fit("pooled"), "C1", "C1") == (0.0, 0.0)


def test_error_follows_from_the_effective_sample_size(monkeypatch):
    """Each draw is repeated ten times in succession."""
    classes = fits.fit("pooled")
    count = classes["C1"]["posterior"].sizes["chain"] * classes["C1"]["posterior"].sizes["draw"]
    drawn = np.random.default_rng(1).standard_normal(count // 10)
    monkeypatch.setattr(
        PooledClass, "log_density", lambda _, tree, __: np.repeat(drawn, 10) * (tree.name == "C1")
    )
    error = ph.kl_divergence(classes, "C1", "C2").standard_error
    of_evidences = [ph.log_evidence(classes[name]).standard_error for name in ("C1", "C2")]
    expected = np.sqrt(np.var(drawn) / drawn.size + np.sum(np.square(of_evidences)))
    assert error == pytest.approx(expected, rel=0.1)
