"""Models and settings that sample_smc refuses before it samples."""

import numpy as np
import pymc as pm
import pytensor
import pytensor.tensor as pt
import pytest
import xarray as xr
from bad_input import assert_refused, curves, plain_model, table
from bad_input import model as ogden_model

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
        elif kind == "spike and slab":
            parts = [pm.DiracDelta.dist(0.0), pm.HalfNormal.dist(1)]
            x = pm.Mixture("x", [0.5, 0.5], parts, default_transform=None)
            pm.Potential("likelihood", -x)
        elif kind == "censored":
            y = pm.Censored("y", pm.Normal.dist(), lower=0.0, upper=1.0)
            pm.Potential("likelihood", -y)
        elif kind == "hurdle":
            z = pm.HurdleGamma("z", 0.5, alpha=2, beta=1, default_transform=None)
            pm.Potential("likelihood", -z)
        elif kind == "no likelihood":
            pm.Normal("x")
        elif kind == "nothing free":
            pm.Normal("y", observed=1.0)
        elif kind == "zero likelihood":
            x = pm.Uniform("x", 0, 1)
            pm.Potential("likelihood", pm.math.log(-x))
        elif kind == "improper prior":
            x = pm.Flat("x")
            pm.Potential("likelihood", -(x**2))
        elif kind == "slow density":
            slopes = pm.Normal("slopes", size=60)
            mean = pt.dot(np.linspace(0, 1, 60 * 20_000).reshape(20_000, 60), slopes)
            pm.Normal("y", mean, 0.1, observed=np.zeros(20_000))
        elif kind == "minibatch":
            data = pm.Minibatch(np.zeros(20), batch_size=5)
            pm.Normal("y", pm.Normal("x"), observed=data, total_size=20)
        elif kind == "random density":
            draw = np.random.default_rng().normal
            noisy = pytensor.wrap_py([pt.dscalar], [pt.dscalar])(lambda x: np.asarray(draw(x)))
            pm.Potential("likelihood", noisy(pm.Normal("x")))
        elif kind == "too many unknowns":
            pm.Normal("y", pm.Normal("means", size=301), 0.1, observed=np.zeros(301))
    return other


def part_of_a_model() -> pm.Model:
    with pm.Model(), pm.Model(name="part") as part:
        pm.Normal("x")
    return part


TERM, ZEROS = "likelihood", {"x": np.zeros(50)}


def unsampled(kind, *fragments):
    """Return a row about a model that is refused for its kind."""
    return kind, lambda: smc(model_of(kind)), ValueError, fragments


# Each row: a name, a call, the error, and fragments of its message.
BAD_INPUT = [
    unsampled("discrete", "continuous", "discrete: ['count']"),
    unsampled("spike and slab", "priors of ['x']", "positive probability"),
    unsampled("censored", "priors of ['y']", "positive probability"),
    unsampled("hurdle", "priors of ['z']", "positive probability"),
    unsampled("nothing free", "free variables", "none"),
    unsampled("no likelihood", "nothing to temper", "[]"),
    unsampled(
        "zero likelihood",
        "none of 50000 draws",
        "50000 are NaN",
        "unit",
        "pm.Truncated",
        "bridge_s",
    ),
    unsampled("slow density", "60 unknowns", "takes so long", "NUTS", "ph.bridge_sampling"),
    unsampled("too many unknowns", "301 unknowns, more than the 300"),
    unsampled("minibatch", "density of the model is random", "all of its data"),
    unsampled("random density", "density of the model is random", "had another one"),
    ("unknown setting", lambda: smc(cores=2), TypeError, ["'cores' is no setting", "'threshold'"]),
    unsampled("improper prior", "drawn from the prior", "proper"),
    ("data for a model", lambda: smc(xr.Dataset()), TypeError, ["pm.Model", "Dataset"]),
    ("two draws", lambda: smc(draws=2), ValueError, ["draws is 2", "at least 3"]),
    ("half a draw", lambda: smc(draws=99.5), TypeError, ["draws is 99.5", "whole number"]),
    ("no chains", lambda: smc(chains=0), ValueError, ["chains is 0", "at least 1"]),
    ("unknown variable", lambda: smc(var_names=["x", "y"]), ValueError, ["['y']", "['x']"]),
    ("name for names", lambda: smc(var_names="x"), TypeError, ["var_names", "list", "'x'"]),
    ("unknown term", lambda: smc(tempered=["a"]), ValueError, ["['likelihood']", "not ['a']"]),
    ("threshold of one", lambda: smc(threshold=1.0), ValueError, ["threshold", "1.0"]),
    ("no moves", lambda: smc(max_moves=0), ValueError, ["max_moves", "0"]),
    ("forgets nothing", lambda: smc(forget=0.0), ValueError, ["forget", "0.0"]),
    ("text for a seed", lambda: smc(random_seed="lucky"), TypeError, ["random_seed", "'lucky'"]),
    (
        "fewer starts than chains",
        lambda: smc(chains=2, start=[ZEROS]),
        ValueError,
        ["start", "1", "2 chains"],
    ),
    (
        "start without a variable",
        lambda: smc(start=[{"y": 0}]),
        ValueError,
        ["start", "['x']", "['y']"],
    ),
    (
        "modes and tempered terms",
        lambda: smc(tempered=[TERM], from_modes=True),
        ValueError,
        ["start from the prior"],
    ),
    ("part of a model", lambda: smc(part_of_a_model()), ValueError, ["'part'", "`model.root`"]),
    ("no model", lambda: ph.sample_smc(progressbar=False), TypeError, ["no model is given"]),
]


def test_single_precision_is_refused(monkeypatch):
    model = plain_model()
    monkeypatch.setattr(pytensor.config, "floatX", "float32")
    assert_refused(lambda: smc(model), ValueError, ["'float32'", 'floatX = "float64"'])
    assert_refused(lambda: ogden_model(curves()), ValueError, ["'float32'"])


@pytest.mark.parametrize(("call", "error", "fragments"), table(BAD_INPUT))
def test_unsuitable_model_or_setting_is_refused_before_sampling(call, error, fragments):
    assert_refused(call, error, fragments)
