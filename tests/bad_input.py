"""Wrong input, and a check that a call refuses it before a sampler starts."""

from functools import cache

import numpy as np
import pandas as pd
import pymc as pm
import pytest
import xarray as xr

import pymc_hyperelastic as ph

OGDEN = ph.Ogden()
TUBE = {"inner_radius": 7.0, "outer_radius": 9.0}
SLOPES = ph.SlopeAugmented(sigma=1.0, slope_weight=1.0)
PLACE = "specimen 'S2', experiment 3"
"""Specimen and experiment of `curves`, as error messages name them."""


def table(rows):
    """Return parameters for pytest from rows of (name, call, error, fragments of the message)."""
    return [pytest.param(*row[1:], id=row[0]) for row in rows]


def assert_refused(call, error, fragments) -> None:
    """Check that the call raises the error with these fragments, before a sampler starts."""
    with pytest.MonkeyPatch.context() as patch:
        begun = "sampling began before the input was checked"
        patch.setattr(ph.BatchedSMC, "update_beta_and_weights", lambda kernel: pytest.fail(begun))
        with pytest.raises(error) as raised:
            call()
    message = str(raised.value)
    assert not [fragment for fragment in fragments if fragment not in message], message


def curves(
    radius=(7.2, 7.6, 8.0, 8.4), pressure=(2.0, 4.0, 7.0, 12.0), forces=None, **geometry
) -> xr.Dataset:
    """One test of specimen S2, experiment 3, whose rows are labelled from 41."""
    frame = pd.DataFrame({"specimen": "S2", "experiment": 3, "radius": radius})
    frame["pressure"] = pressure
    if forces is not None:
        frame["axial_force"] = forces
    frame.index += 41
    return ph.inflation_data(frame, ph.Tube(**TUBE | geometry))


def with_nan() -> xr.Dataset:
    data = curves()
    data["pressure"][2] = np.nan
    return data


def two_tubes() -> xr.Dataset:
    """Two specimens of different inner radius."""
    frame = pd.DataFrame({"specimen": ["S1"] * 3 + ["S2"] * 3, "experiment": 1})
    frame["radius"] = [7.2, 7.6, 8.0] * 2
    frame["pressure"] = [2.1, 4.1, 7.1, 1.9, 3.9, 6.9]
    frame["A"] = [7.0] * 3 + [6.5] * 3
    return ph.inflation_data(frame, ph.Tube(inner_radius="A", outer_radius=9.0))


def model(data=None, energy=OGDEN, likelihood=SLOPES, **settings) -> pm.Model:
    data = curves() if data is None else data
    return ph.inflation_model(energy, data, likelihood, **settings)


def potential(parameters=None, energy=OGDEN, name="curves", likelihood=SLOPES, **settings) -> None:
    """Add a likelihood to another model."""
    with pm.Model():
        mu = pm.Uniform("mu", 0, 50)
        parameters = {"mu": mu, "alpha": 6.0} if parameters is None else parameters
        ph.inflation_likelihood(name, energy, curves(), likelihood, parameters, **settings)


def plain_model() -> pm.Model:
    """Return a small model that compiles quickly."""
    with pm.Model() as plain:
        x = pm.Normal("x")
        pm.Potential("likelihood", -(x**2))
    return plain


def fit(groups=None, energy=OGDEN, likelihood=SLOPES, **settings) -> xr.DataTree:
    groups = {"C1": curves(), "C2": curves()} if groups is None else groups
    few = {"draws": 50, "chains": 1, "progressbar": False}
    return ph.fit_classes(energy, groups, likelihood, **{**few, **settings})


@cache
def fitted() -> xr.DataTree:
    """Return two fitted classes."""
    with pytest.warns(UserWarning, match="the fit is doubtful"):  # one material in two tubes
        return fit({"C1": curves(), "C2": two_tubes()}, random_seed=1)
