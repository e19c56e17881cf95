"""Radii that repeat have no slopes between them, which errors name row by row."""

import numpy as np
import pytest
from tables import build, curve

import pymc_hyperelastic as ph
from pymc_hyperelastic.models.likelihoods.slopes import (
    compressed_spectrum,
    half_log_determinant,
    precision_root,
)

PLACE = "specimen 'S1', experiment 1"
RADIUS = curve()["radius"].to_numpy()
# Digits of the log determinant that remain where the nearest radii differ by 1e-5 mm.
NEARLY_SINGULAR = 1e-4


@pytest.mark.parametrize("step", [0.0, 1e-15, 1e-9])
@pytest.mark.parametrize("points", [3, 9])
def test_slopes_between_equal_radii_are_refused_unless_their_weight_is_0(step, points):
    radius = RADIUS[:points].copy()
    radius[1], radius[2] = radius[0] + step / 2, radius[0] + step
    data = build(curve().iloc[:points].assign(radius=radius))
    for function in (ph.balanced_slope_weight, compressed_spectrum):
        with pytest.raises(ValueError, match=rf"{PLACE}: radius repeats at rows 0 and 2"):
            function(data)
    with pytest.raises(ValueError, match="slope_weight=0"):
        ph.ogden_model(data, ph.SlopeAugmented(1.0, 1.0))
    ph.ogden_model(data, ph.SlopeAugmented(1.0, slope_weight=0))


def test_slope_weight_at_which_the_determinant_would_be_rounding_is_refused():
    radius = RADIUS.copy()
    radius[4] = radius[3] + 1e-5
    radius[5] = radius[3] + 2e-5
    data = build(curve(radius=radius))
    weight = ph.balanced_slope_weight(data)
    spectrum, count = compressed_spectrum(data)
    exact = 0.5 * np.sum(count * np.log1p(weight * spectrum))
    np.testing.assert_allclose(half_log_determinant(data, weight), exact, rtol=NEARLY_SINGULAR)
    for function in (half_log_determinant, precision_root):
        with pytest.raises(ValueError, match=rf"{PLACE}: the radii of rows 3 and 5 are 2e-05 mm"):
            function(data, 1e6)
