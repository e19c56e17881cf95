"""Models that cannot be: one error says where and what was expected."""

import numpy as np
import pandas as pd
import pymc as pm
import pytest
from bad_input import (
    NOISE,
    OGDEN,
    PLACE,
    assert_refused,
    curves,
    likelihood,
    model,
    table,
    with_nan,
)

import pymc_hyperelastic as ph


def registered() -> object:
    """A random variable that belongs to a model."""
    with pm.Model():
        return pm.Uniform("stiffness", 0, 50)


# Each row: what is wrong, a call that does it, the error, and fragments that its message must hold.
BAD_INPUT = [
    # Models.
    (
        "class for a model's strain energy",
        lambda: model(energy=ph.Ogden),
        TypeError,
        ["ph.Ogden()", "call the class"],
    ),
    (
        "frame for a model's data",
        lambda: model(pd.DataFrame({"radius": [1.0]})),
        TypeError,
        ["inflation_data(", "DataFrame"],
    ),
    (
        "data altered",
        lambda: model(with_nan()),
        ValueError,
        [PLACE, "row 43", "pressure is nan kPa"],
    ),
    ("no error", lambda: model(sigma=0), ValueError, ["sigma is 0", "positive", "kPa"]),
    ("negative error", lambda: model(sigma=-1.0), ValueError, ["sigma is -1.0", "positive"]),
    ("nan error", lambda: model(sigma=np.nan), ValueError, ["sigma is nan", "positive", "kPa"]),
    ("infinite error", lambda: model(sigma=np.inf), ValueError, ["sigma is inf", "positive"]),
    (
        "error with a unit",
        lambda: model(sigma="5 mmHg"),
        TypeError,
        ["sigma is '5 mmHg'", "5 * ph.mmHg", "distribution"],
    ),
    ("truth for an error", lambda: model(sigma=True), TypeError, ["sigma is True", "kPa"]),
    ("no number for an error", lambda: model(sigma=None), TypeError, ["sigma is None", "kPa"]),
    (
        "an error a test",
        lambda: model(sigma=pm.HalfNormal.dist(shape=3)),
        TypeError,
        ["sigma", "1 dimension", "scalar"],
    ),
    (
        "negative slope weight",
        lambda: model(slope_weight=-0.5),
        ValueError,
        ["slope_weight is -0.5", "mm²", "0 to leave the slopes out"],
    ),
    (
        "nan slope weight",
        lambda: model(slope_weight=np.nan),
        ValueError,
        ["slope_weight is nan", "mm²"],
    ),
    (
        "text slope weight",
        lambda: model(slope_weight="balanced"),
        TypeError,
        ["slope_weight is 'balanced'", "mm²"],
    ),
    (
        "truth for a slope weight",
        lambda: model(slope_weight=True),
        TypeError,
        ["slope_weight is True", "mm²"],
    ),
    (
        "too few points for a slope",
        lambda: model(curves([7.2, 7.6], [2.0, 4.0])),
        ValueError,
        [PLACE, "2 point(s)", "at least 3", "slope_weight=0"],
    ),
    (
        "repeated radius",
        lambda: model(curves([7.2, 7.84, 8.0, 7.84])),
        ValueError,
        [PLACE, "rows 42 and 44", "7.84 mm", "drop one or set slope_weight=0"],
    ),
    (
        "repeated radius for an inferred slope weight",
        lambda: model(curves([7.2, 7.84, 8.0, 7.84]), slope_weight=pm.HalfNormal.dist()),
        ValueError,
        [PLACE, "rows 42 and 44", "7.84 mm"],
    ),
    (
        "prior of an unknown parameter",
        lambda: model(priors={"n": pm.Uniform.dist(0, 5)}),
        ValueError,
        ["'n'", "Ogden", "['mu', 'alpha']"],
    ),
    (
        "number for a prior",
        lambda: model(priors={"mu": 6.0}),
        TypeError,
        ["'mu' is 6.0", "pm.Uniform.dist(0, 50)"],
    ),
    (
        "range for a prior",
        lambda: model(priors={"mu": (0, 50)}),
        TypeError,
        ["'mu' is (0, 50)", "pm.Uniform.dist(0, 50)"],
    ),
    (
        "class for a prior",
        lambda: model(priors={"mu": pm.Uniform}),
        TypeError,
        ["'mu'", "pm.Uniform.dist(0, 50)"],
    ),
    (
        "vector prior",
        lambda: model(priors={"mu": pm.Uniform.dist(0, [20, 50])}),
        TypeError,
        ["'mu'", "shape (2,)", "scalar"],
    ),
    (
        "prior of another model",
        lambda: model(priors={"mu": registered()}),
        TypeError,
        ["'mu'", "'stiffness'", "pm.Uniform.dist(0, 50)", "ph.inflation_likelihood"],
    ),
    (
        "prior that depends on another model",
        lambda: model(priors={"mu": pm.Normal.dist(registered(), 1)}),
        TypeError,
        ["'mu'", "'stiffness'", "ph.inflation_likelihood"],
    ),
    (
        "prior stated by a distribution",
        lambda: model(priors={"mu": pm.Normal.dist(pm.HalfNormal.dist(), 1)}),
        TypeError,
        ["'mu'", "halfnormal", "ph.inflation_likelihood"],
    ),
    (
        "expression for a prior",
        lambda: model(priors={"mu": 2 * pm.Uniform.dist(0, 25)}),
        TypeError,
        ["'mu'", "pm.Uniform.dist(0, 50)"],
    ),
    (
        "list of priors",
        lambda: model(priors=[pm.Uniform.dist(0, 50)]),
        TypeError,
        ["priors", "dict", '{"mu": pm.Uniform.dist(0, 50)}'],
    ),
    (
        "unknown mode",
        lambda: model(mode="fast"),
        ValueError,
        ["mode is 'fast'", "'collocation'", "'quadrature'"],
    ),
    (
        "constant pressure has no balance",
        lambda: ph.balanced_slope_weight(curves(pressure=[5.0] * 4)),
        ValueError,
        ["all slopes", "zero"],
    ),
    (
        "balance of a frame",
        lambda: ph.balanced_slope_weight(pd.DataFrame()),
        TypeError,
        ["inflation_data(", "DataFrame"],
    ),
    # The likelihood in a model of one's own.
    (
        "likelihood outside a model",
        lambda: ph.inflation_likelihood(
            "curves", OGDEN, curves(), {"mu": 6.0, "alpha": 8.0}, **NOISE
        ),
        TypeError,
        ["with pm.Model():"],
    ),
    (
        "likelihood lacks a parameter",
        lambda: likelihood({"mu": 6.0}),
        TypeError,
        ["Ogden", "['mu', 'alpha']", "['mu'] were given"],
    ),
    (
        "likelihood of a list of parameters",
        lambda: likelihood(["mu", "alpha"]),
        TypeError,
        ["parameters", "dict", "['mu', 'alpha']"],
    ),
    (
        "likelihood of a vector",
        lambda: likelihood({"mu": np.array([6.0, 7.0]), "alpha": 6.0}),
        TypeError,
        ["'mu'", "1 dimension", "scalar"],
    ),
    (
        "likelihood of text",
        lambda: likelihood({"mu": "stiff", "alpha": 6.0}),
        TypeError,
        ["'mu' is 'stiff'", "random variable", "number"],
    ),
    (
        "likelihood of a class",
        lambda: likelihood(energy=ph.Ogden),
        TypeError,
        ["ph.Ogden()", "call the class"],
    ),
    (
        "likelihood with a vector of errors",
        lambda: likelihood(sigma=pm.HalfNormal.dist(shape=2)),
        TypeError,
        ["sigma", "1 dimension", "scalar"],
    ),
    (
        "likelihood's name is taken",
        lambda: likelihood(name="mu"),
        ValueError,
        ["mu", "already"],
    ),
    (
        "likelihood of nan",
        lambda: likelihood({"mu": np.nan, "alpha": 6.0}),
        ValueError,
        ["'mu' is nan", "finite"],
    ),
]


@pytest.mark.parametrize(("call", "error", "fragments"), table(BAD_INPUT))
def test_bad_input(call, error, fragments):
    """Each kind of bad input raises one error that names the place and what was expected."""
    assert_refused(call, error, fragments)
