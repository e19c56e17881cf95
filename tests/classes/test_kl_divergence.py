"""Kullback-Leibler divergence of two classes, against quadrature."""

import exact
import fits
import numpy as np
import pytest
from pooled_classes import NAMES, NOISE, STANDARD_ERRORS, exact_posterior, training_curves

import pymc_hyperelastic as ph


@pytest.mark.parametrize(("first", "second"), [NAMES, NAMES[::-1]])
def test_divergence_is_that_of_quadrature(first, second):
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
