"""Models and settings that sample_smc refuses before it samples."""

import numpy as np
import pymc as pm
import pytensor.tensor as pt
import pytest
import xarray as xr
from bad_input import assert_refused, plain_model, table

import pymc_hyperelastic as ph


def smc(model=None, **settings) -> xr.DataTree:
    model = plain_model() if model is None else model
    return ph.sample_smc(model, **{"draws": 50, "chains": 1, "progressbar": False, **settings})


def model_of(kind: str) -> pm.Model:
    """Return a model that SMC cannot sample."""
    with pm.Model() as other:
        if kind == "discrete":
            count = pm.Poisson("count", 3)
            pm.Potential("likelihood", -count)
        elif kind == "no likelihood":
            pm.Normal("x")
        elif kind == "nothing free":
            pm.Normal("y", observed=1.0)
        elif kind == "impossible":
            x = pm.Uniform("x", 0, 1)
            pm.Potential("likelihood", pm.math.log(-x))
        elif kind == "flat":
            x = pm.Flat("x")
            pm.Potential("likelihood", -(x**2))
        elif kind == "costly":
            slopes = pm.Normal("slopes", size=60)
            mean = pt.dot(np.linspace(0, 1, 60 * 20_000).reshape(20_000, 60), slopes)
            pm.Normal("y", mean, 0.1, observed=np.zeros(20_000))
    return other


def part_of_a_model() -> pm.Model:
    with pm.Model(), pm.Model(name="part") as part:
        pm.Normal("x")
    return part


# Each row: a name, a call, the error, and fragments of its message.
BAD_INPUT = [
    ("data for a model", lambda: smc(xr.Dataset()), TypeError, ["pm.Model", "Dataset"]),
    ("no draws", lambda: smc(draws=0), ValueError, ["draws is 0", "at least"]),
    ("one draw", lambda: smc(draws=1), ValueError, ["draws is 1", "at least"]),
    ("negative draws", lambda: smc(draws=-5), ValueError, ["draws is -5", "at least"]),
    ("half a draw", lambda: smc(draws=99.5), TypeError, ["draws is 99.5", "whole number"]),
    ("no chains", lambda: smc(chains=0), ValueError, ["chains is 0", "at least 1"]),
    ("half a chain", lambda: smc(chains=1.5), TypeError, ["chains is 1.5", "whole number"]),
    (
        "discrete variables",
        lambda: smc(model_of("discrete")),
        ValueError,
        ["continuous", "discrete: ['count']"],
    ),
    ("nothing free", lambda: smc(model_of("nothing free")), ValueError, ["free variables", "none"]),
    (
        "no likelihood",
        lambda: smc(model_of("no likelihood")),
        ValueError,
        ["nothing to temper", "[]"],
    ),
    (
        "impossible everywhere",
        lambda: smc(model_of("impossible")),
        ValueError,
        ["none of 50000 draws", "finite likelihood", "50000 are NaN", "prior", "unit"],
    ),
    (
        "many unknowns and a slow density",
        lambda: smc(model_of("costly")),
        ValueError,
        ["60 unknowns", "takes so long", "NUTS", "ph.log_evidence_by_bridge"],
    ),
    (
        "prior that cannot be drawn",
        lambda: smc(model_of("flat")),
        ValueError,
        ["drawn from the prior", "proper"],
    ),
    (
        "unknown variable to keep",
        lambda: smc(var_names=["x", "y"]),
        ValueError,
        ["no variables ['y']", "['x']"],
    ),
    ("name for names", lambda: smc(var_names="x"), TypeError, ["var_names", "list", "'x'"]),
    (
        "unknown term to temper",
        lambda: smc(tempered=["new"]),
        ValueError,
        ["['likelihood']", "not ['new']"],
    ),
    ("threshold of one", lambda: smc(threshold=1.0), ValueError, ["threshold", "1.0"]),
    ("negative threshold", lambda: smc(threshold=-0.5), ValueError, ["threshold", "-0.5"]),
    ("no moves", lambda: smc(max_moves=0), ValueError, ["max_moves", "0"]),
    ("forgets too much", lambda: smc(forget=1.5), ValueError, ["forget", "1.5"]),
    ("text for a seed", lambda: smc(random_seed="lucky"), TypeError, ["random_seed", "'lucky'"]),
    ("negative seed", lambda: smc(random_seed=-1), ValueError, ["random_seed", "-1"]),
    (
        "start of too few chains",
        lambda: smc(chains=2, start=[{"x": np.zeros(50)}]),
        ValueError,
        ["start", "1", "2 chains"],
    ),
    (
        "start of another variable",
        lambda: smc(start=[{"y": np.zeros(50)}]),
        ValueError,
        ["start", "['x']", "['y']"],
    ),
    (
        "modes, but not all terms tempered",
        lambda: smc(tempered=["likelihood"], from_modes=True),
        ValueError,
        ["from_modes is for particles that start from the prior"],
    ),
    ("part of a model", lambda: smc(part_of_a_model()), ValueError, ["'part'", "`model.root`"]),
    ("no model", lambda: ph.sample_smc(progressbar=False), TypeError, ["no model is given"]),
]


@pytest.mark.parametrize(("call", "error", "fragments"), table(BAD_INPUT))
def test_bad_model_or_setting_is_refused(call, error, fragments):
    assert_refused(call, error, fragments)
