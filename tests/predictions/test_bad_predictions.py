"""What cannot be predicted says why."""

import numpy as np
import pytest
import xarray as xr
from drawn import SHEEP, result

import pymc_hyperelastic as ph

TREE = result(mu=[20.0])
NEO = {"energy": ph.NeoHookean(), **SHEEP}
ERRORS = {
    "layers of which nothing is inferred": (
        lambda: ph.radius_at_pressure(
            TREE, 1.0, energy=[ph.Layer(ph.NeoHookean(), 1.0, mu=2.0)], inner_radius=7.0
        ),
        ValueError,
        "nothing is taken from the posterior",
    ),
    "no tube": (
        lambda: ph.wall_stress(TREE, 1.0, energy=ph.NeoHookean()),
        ValueError,
        "inner_radius=...",
    ),
    "tube in text": (
        lambda: ph.tube_properties(TREE, 1.0, energy=ph.NeoHookean(), inner_radius="7 mm"),
        TypeError,
        "inner_radius is '7 mm'",
    ),
    "no result": (lambda: ph.predict_axial_force({}, 8.0, **NEO), TypeError, "DataTree"),
    "no posterior": (
        lambda: ph.radius_at_pressure(xr.DataTree(), 1.0, **NEO),
        ValueError,
        "no posterior",
    ),
    "no parameter": (
        lambda: ph.radius_at_pressure(result(nu=[1.0]), 1.0, **NEO),
        ValueError,
        r"lacks \['mu'\]",
    ),
    "many parameters": (
        lambda: ph.predict_pressure(result(mu=[[20.0, 30.0]]), 8.0, **NEO),
        ValueError,
        "'mu' of the posterior has the dimensions .*'mu_entry'.*select one",
    ),
    "short vector": (
        lambda: ph.predict_pressure(
            result(mu=[[2.0, 3.0]], alpha=[[2.0, 3.0]]), 8.0, energy=ph.OgdenSeries(3), **SHEEP
        ),
        TypeError,
        "'mu' of OgdenSeries.* has 3 entries",
    ),
    "scalar for a vector": (
        lambda: ph.predict_pressure(
            result(mu=[2.0], alpha=[2.0]), 8.0, energy=ph.OgdenSeries(3), **SHEEP
        ),
        ValueError,
        "its 3 entries",
    ),
    "many tubes": (
        lambda: ph.predict_pressure(
            result(mu=[20.0], inner_radius=[[7.0, 8.0]]),
            8.0,
            energy=ph.NeoHookean(),
            outer_radius=9.0,
        ),
        ValueError,
        "'inner_radius' of the posterior has the dimensions",
    ),
    "negative wall": (
        lambda: ph.predict_pressure(
            result(mu=[20.0], thickness=[-1.0]), 8.0, energy=ph.NeoHookean(), inner_radius=7.0
        ),
        ValueError,
        "thickness must be positive",
    ),
    "pressure in text": (
        lambda: ph.radius_at_pressure(TREE, "high", **NEO),
        ValueError,
        "pressure must be a list of pressures in kPa; got 'high'",
    ),
    "unknown pressure": (
        lambda: ph.tube_properties(TREE, [np.nan], **NEO),
        ValueError,
        "got .nan.",
    ),
    "no pressure": (lambda: ph.wall_stress(TREE, [], **NEO), ValueError, "pressure must be"),
    "density": (lambda: ph.tube_properties(TREE, 1.0, density=0, **NEO), ValueError, "density.*0"),
    "place outside": (
        lambda: ph.wall_stress(TREE, 1.0, points=[0.5, 1.5], **NEO),
        ValueError,
        "points must be places in the wall, from 0 to 1",
    ),
    "no places": (lambda: ph.wall_stress(TREE, 1.0, points=-3, **NEO), ValueError, "from 0 to 1"),
    "radius": (lambda: ph.admissible(TREE, [0.0], **NEO), ValueError, "positive radii in mm"),
    "nowhere": (lambda: ph.admissible(TREE, **NEO), ValueError, "internal_radius=..."),
}


@pytest.mark.parametrize(("call", "error", "message"), ERRORS.values(), ids=ERRORS)
def test_errors_say_what_to_do(call, error, message):
    """What cannot be calculated says why, and what is expected."""
    with pytest.raises(error, match=message):
        call()
