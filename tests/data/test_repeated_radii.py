"""Repeated radii have no slopes between them; errors name the rows."""

import mpmath as mp
import numpy as np
import pytest
from tables import build, curve

import pymc_hyperelastic as ph
from pymc_hyperelastic.models.likelihoods.slopes import (
    central_differences,
    half_log_determinant,
    squared_singular_values,
)

PLACE = "specimen 'S1', experiment 1"
RADIUS = curve()["radius"].to_numpy()


@pytest.mark.parametrize("step", [0.0, 1e-15, 1e-9])
@pytest.mark.parametrize("points", [3, 9])
def test_slopes_between_equal_radii_are_refused_unless_slope_weight_is_0(step, points):
    radius = RADIUS[:points].copy()
    radius[1], radius[2] = radius[0] + step / 2, radius[0] + step
    data = build(curve().iloc[:points].assign(radius=radius))
    for function in (ph.balanced_slope_weight, squared_singular_values):
        with pytest.raises(ValueError, match=rf"{PLACE}: radius repeats at rows 0 and 2"):
            function(data)
    with pytest.raises(ValueError, match="slope_weight=0"):
        ph.ogden_model(data, ph.SlopeAugmented(1.0, 1.0))
    ph.ogden_model(data, ph.SlopeAugmented(1.0, slope_weight=0))


@pytest.mark.parametrize("weight", [3.0, 1e6, 1e12])
def test_determinant_of_the_precision_is_exact_if_radii_nearly_repeat(weight):
    radius = RADIUS.copy()
    radius[4] = radius[3] + 5e-5
    radius[5] = radius[3] + 1e-4
    data = build(curve(radius=radius))
    interior, difference = central_differences(data)
    with mp.workdps(60):
        matrix = mp.eye(len(radius))
        for i, d in zip(interior.tolist(), difference, strict=True):
            row = mp.zeros(1, len(radius))
            row[i + 1], row[i - 1] = mp.mpf(d), -mp.mpf(d)
            matrix += mp.mpf(weight) * row.T * row
        expected = float(mp.log(mp.det(matrix)) / 2)
    assert half_log_determinant(data, weight) == pytest.approx(expected, rel=1e-12)
    if weight < 1e3:
        logs = np.log1p(weight * squared_singular_values(data))
        assert logs.sum() / 2 == pytest.approx(expected, rel=1e-6)
