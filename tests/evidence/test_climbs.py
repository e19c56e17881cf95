"""Climbs to summits, many at a time, against summits that are known."""

import numpy as np
import pytest
from scipy.optimize import least_squares, minimize

from pymc_hyperelastic.evidence.climbs import climb_together
from pymc_hyperelastic.evidence.target import Rise, by_differences, differences

SEED = 20261124  # any would do
# A climb ends a twentieth of an sd from its summit: so many nats, in some variables.
NATS = 0.01


def errors_of(points):
    """Standard errors of a narrow valley that is bent, as Rosenbrock's, in six variables."""
    x, y = points[:, ::2], points[:, 1::2]
    return np.concatenate([20 * (y - x**2), 2 * (1 - x), points / 10], axis=1)


def height_of(points):
    return -np.square(errors_of(points)).sum(axis=1) / 2


def valley(width, *, known):
    """The same as a density, whose curvature is known by Gauss and Newton, or not at all."""

    def score(points):
        return height_of(points), np.zeros(len(points))

    def slope(points):
        around, change = differences(points, width)
        errors = errors_of(around.reshape(-1, 6)).reshape(*around.shape[:2], -1)
        of_errors = change(errors)
        return by_differences(score, width)(points)._replace(
            curvature=of_errors @ of_errors.transpose(0, 2, 1)
        )

    return slope if known else by_differences(score, width)


@pytest.mark.parametrize("known", [True, False])
def test_all_climbs_find_the_end_of_a_bent_valley(known):
    """From both ends of it and from its walls, as SciPy's least squares finds it."""
    rng = np.random.default_rng(SEED)
    starts = rng.normal(0, 1, (8, 6))
    exact = least_squares(lambda x: errors_of(x[None])[0], np.ones(6), xtol=1e-12)
    found = climb_together(lambda width: valley(width, known=known), starts, np.ones(6))
    np.testing.assert_allclose(found.heights, height_of(exact.x[None])[0], atol=NATS)
    np.testing.assert_allclose(found.heights, height_of(found.points))
    sds = np.sqrt(np.diagonal(np.linalg.inv(exact.jac.T @ exact.jac + np.eye(6))))
    if known:
        np.testing.assert_allclose(found.widths, np.broadcast_to(sds, (8, 6)), rtol=0.02)


def log_student(points):
    """A density whose curvature is not positive away from its summit."""
    return -2 * np.log1p(np.square(points - 3).sum(axis=1) / 4)


def test_slopes_that_rise_are_climbed():
    """Far from the summit of a heavy tail the curvature has the wrong sign: SciPy's summit."""

    def score(points):
        return log_student(points), np.zeros(len(points))

    starts = np.array([[-9.0, 4.0, 0.0], [30.0, 20.0, -40.0], [3.0, 3.0, 3.0]])
    found = climb_together(lambda width: by_differences(score, width), starts, np.ones(3))
    exact = minimize(lambda x: -log_student(x[None])[0], np.zeros(3)).x
    np.testing.assert_allclose(found.points, np.tile(exact, (3, 1)), atol=0.1)


def test_climbs_do_not_depend_on_each_other():
    """One by one they end where they do together, to the last digit."""
    starts = np.random.default_rng(SEED).normal(0, 1, (3, 6))
    together = climb_together(lambda width: valley(width, known=True), starts, np.ones(6))
    alone = [climb_together(lambda w: valley(w, known=True), x[None], np.ones(6)) for x in starts]
    np.testing.assert_allclose(together.points, [x.points[0] for x in alone], rtol=1e-9)


def test_scales_of_variables_do_not_matter():
    """The same climb where variables are measured in other units."""
    units = 10.0 ** np.arange(-3, 3)
    starts = np.random.default_rng(SEED).normal(0, 1, (2, 6))

    def rescaled(width):
        slope = valley(width / units, known=True)

        def of_points(points):
            height, slopes, curvature = slope(points / units)
            return Rise(height, slopes / units, curvature / np.outer(units, units))

        return of_points

    plain = climb_together(lambda width: valley(width, known=True), starts, np.ones(6))
    scaled = climb_together(rescaled, starts * units, units)
    np.testing.assert_allclose(scaled.heights, plain.heights, atol=NATS)
    np.testing.assert_allclose(scaled.widths / units, plain.widths, rtol=0.02)


def test_what_is_impossible_is_not_climbed_from():
    """The others climb on, and steps into what is impossible are made shorter."""

    def score(points):
        x = points[:, 0]
        with np.errstate(invalid="ignore", divide="ignore"):
            return np.where(x > 0, np.log(x) - 5 * x, -np.inf), np.zeros(len(x))

    starts = np.array([[-1.0], [2.0], [1e-3]])
    found = climb_together(lambda width: by_differences(score, width), starts, np.ones(1))
    assert found.heights[0] == -np.inf and found.points[0] == -1.0
    np.testing.assert_allclose(found.points[1:], 0.2, atol=0.02)
