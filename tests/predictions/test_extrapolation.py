"""Predictions beyond the measured range are marked as extrapolated (`predictions/measured.py`)."""

import warnings

import numpy as np
import pandas as pd
import pytest
import xarray as xr
from problems import AS_WRITTEN
from tube_posteriors import AT_PRESSURES, AT_RADII, SHEEP, ask, fitted_to, result

import pymc_hyperelastic as ph

MU = 20.0
RADIUS = np.linspace(7.2, 8.8, 9)


def pressure_of(radius, mu=MU, **tube):
    law = ph.inflation_pressure(ph.NeoHookean(), radius, ph.Tube(**SHEEP | tube), mu=mu)
    return law.eval(mode=AS_WRITTEN)


def data_of(*tubes) -> xr.Dataset:
    """Return data of neo-Hookean tubes, stated by differences from the sheep aorta, and radii."""
    tables = []
    for number, (tube, radius) in enumerate(tubes, start=1):
        labels = {"specimen": f"S{number}", "experiment": 1, **SHEEP, "axial_stretch": 1.0, **tube}
        points = {"radius": radius, "pressure": pressure_of(radius, **tube)}
        tables.append(pd.DataFrame(labels | points))
    columns = ph.Tube("inner_radius", "outer_radius", axial_stretch="axial_stretch")
    return ph.inflation_data(pd.concat(tables, ignore_index=True), columns)


def fitted(data=None, **variables) -> xr.DataTree:
    """Return a fitted result with draws around the true modulus."""
    data = data_of(({}, RADIUS)) if data is None else data
    return fitted_to(data, "NeoHookean", result(mu=[0.9 * MU, MU, 1.1 * MU], **variables))


def quietly(function, tree, points, **tube) -> list[bool]:
    """Return the mark of extrapolation, without warnings."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return ask(function, tree, points, tube)["extrapolated"].values.tolist()


@pytest.mark.parametrize("function", AT_RADII)
def test_radii_beyond_the_data_are_marked_with_a_warning(function):
    asked = [6.9, RADIUS[0], 8.0, RADIUS[-1], 9.5]
    with pytest.warns(UserWarning, match=r"2 of 5 points .*6.9 to 9.5 mm.*7.2 to 8.8 mm") as caught:
        found = function(fitted(), asked)
    assert caught[0].filename == __file__
    assert found["extrapolated"].dims == ("radius",)
    assert found["extrapolated"].values.tolist() == [True, False, False, False, True]


@pytest.mark.parametrize("function", AT_PRESSURES)
def test_pressures_beyond_the_data_are_marked_with_a_warning(function):
    tree = fitted()
    top = float(tree["constant_data"]["pressure"].max())
    message = rf"1 of 3 points .*pressure {1.1 * top:.4g} kPa .* mmHg\), measured .* to {top:.4g}"
    with pytest.warns(UserWarning, match=message) as caught:
        found = function(tree, [top / 2, top, 1.1 * top])
    assert caught[0].filename == __file__
    assert found["extrapolated"].dims == ("pressure",)
    assert found["extrapolated"].values.tolist() == [False, False, True]


def test_range_of_a_tube_of_another_size_is_compared_by_stretch():
    tube = {name: 2 * value for name, value in SHEEP.items()}
    ends = RADIUS[[0, -1]]
    asked = 2 * np.concatenate([ends * [0.99, 1.01], ends])
    found = quietly(ph.predict_pressure, fitted(), asked, **tube)
    assert found == [True, True, False, False]
    # It has the same pressures.
    asked = pressure_of(ends, mu=MU) * [0.99, 1.01]
    found = quietly(ph.tube_properties, fitted(), [*asked, *pressure_of(RADIUS[[1, -2]])], **tube)
    assert found == [True, True, False, False]


def test_measured_pressure_is_extrapolated_in_a_thinner_tube():
    top = pressure_of(RADIUS[-1])
    with pytest.warns(UserWarning, match="hoop stretch .* at axial stretch 1, measured"):
        found = ph.tube_properties(fitted(), ph.Conditions([0.9 * top], tube=ph.Tube(7.0, 8.2)))
    assert found["extrapolated"].values.tolist() == [True]


def test_axial_stretches_between_measured_ones_are_not_extrapolated():
    ends = {1.0: 8.8, 1.4: 8.0}
    data = data_of(*(({"axial_stretch": s}, np.linspace(7.0, end, 5)) for s, end in ends.items()))
    tree = fitted(data)
    for axial, end in {**ends, 1.2: 8.4}.items():
        asked = [end - 0.01, end + 0.01]
        assert quietly(ph.predict_pressure, tree, asked, axial_stretch=axial) == [False, True]
    for axial in (0.9, 1.5):
        with pytest.warns(UserWarning, match=f"axial stretch {axial}, measured 1 to 1.4"):
            found = ph.predict_pressure(tree, [8.0], tube=ph.Tube(axial_stretch=axial))
        assert found["extrapolated"].all()


def test_extrapolation_warning_names_the_class():
    classes = xr.DataTree.from_dict({"soft": fitted(), "stiff": fitted()})
    with pytest.warns(UserWarning, match="^class 'stiff': 1 of 1 points is extrapolated"):
        ph.predict_pressure(classes["stiff"], [9.5])


def test_ambiguous_axial_stretch_is_refused_with_the_measured_stretches():
    data = data_of(*(({"axial_stretch": s}, RADIUS) for s in (1.0, 1.25)))
    data = data.assign_coords(specimen=("test", ["S1", "S1"]), experiment=("test", [1, 2]))
    with pytest.raises(
        ValueError, match=r"axial_stretch \(1, 1.25\).*ph.Tube\(axial_stretch=1\)"
    ) as raised:
        ph.tube_properties(fitted(data), [1.0])
    assert "specimen" not in str(raised.value).replace("specimens", "")


def test_inferred_geometry_defines_the_measured_range():
    data = data_of(({}, RADIUS))
    unknown = data.assign({n: np.nan * data[n] for n in ("inner_radius", "outer_radius")})
    tree = fitted(unknown, inner_radius=[6.9, 7.0, 7.2], thickness=[1.9, 2.0, 2.2])
    assert quietly(ph.predict_pressure, tree, [7.1, *RADIUS, 9.0]) == [True, *[False] * 9, True]
    top = float(data["pressure"].max())
    assert quietly(ph.tube_properties, tree, [top, 1.01 * top]) == [False, True]
    # The known measures are half as large.
    half = {"inner_radius": 3.5, "outer_radius": 4.5}
    assert quietly(ph.predict_pressure, tree, RADIUS[[0, -1]] / 2, **half) == [False, False]


def test_range_of_outer_diameters_is_converted_with_the_median_tube():
    frame = pd.DataFrame({"specimen": "S1", "experiment": 1, "outer_diameter": [18.4, 19.0, 20.0]})
    frame["pressure"] = [1.0, 2.0, 4.0]
    inferred = {"inner_radius": [7.0, 7.0, 7.1], "outer_radius": [8.9, 9.0, 9.1]}
    data = ph.inflation_data(frame, ph.Tube(), measured="outer_diameter")
    tree = fitted(data, **inferred)
    ends = np.sqrt(np.array([9.2, 10.0]) ** 2 - (81 - 49))
    asked = [ends[0] - 0.01, *ends, ends[1] + 0.01]
    assert quietly(ph.predict_pressure, tree, asked) == [True, False, False, True]


def test_pressure_that_most_draws_do_not_reach_is_extrapolated():
    tree = fitted(data_of(({}, RADIUS), ({"outer_radius": 9.5}, RADIUS)))
    found = quietly(ph.radius_at_pressure, tree, [1.0, 60.0], outer_radius=8.0)
    assert found == [False, True]
