"""Tubes that were measured with an error: of each specimen its own."""

import numpy as np
import pandas as pd
import pymc as pm
import pytest
import xarray as xr

import pymc_hyperelastic as ph
from pymc_hyperelastic.mechanics.tube import opened_sector

RING = {"inner_radius": 0.5, "outer_radius": 0.6}
ANGLE = 1.1
NOISE = {"noise_sd": 0.4, "force_noise_sd": 2.0, "slope_weight": 0.0}
# Log densities of one model and another that states the same tube in numbers.
TOLERANCE = 1e-9


def table():
    """Two specimens, the second of a thicker wall, with two tests each."""
    rows = [
        {"specimen": name, "experiment": test, "radius": r, "outer": outer, "pressure": 60 * r - 25}
        | {"axial_force": 20.0 + r, "outer_diameter": 2 * r + 0.2, "stretch": 1.3 + 0.1 * test}
        for name, outer in (("S1", 0.6), ("S2", 0.63))
        for test in (0, 1)
        for r in (0.55, 0.6, 0.66, 0.7)
    ]
    return pd.DataFrame(rows)


def data_of(measured="radius", **settings):
    known = {"inner_radius": RING["inner_radius"], "outer_radius": "outer"}
    known |= {"axial_stretch": "stretch", "opening_angle": ANGLE, "radii_of": "ring"}
    known |= {"opening_angle_convention": "whole", "check": "ignore"}
    return ph.inflation_data(table(), measured=measured, **known | settings)


def log_density(model, **point):
    start = model.initial_point() | {k: np.asarray(v, float) for k, v in point.items()}
    return float(model.compile_logp(sum=True)(start))


def changed(data, name, z, sd):
    """The data with a measure that is so many standard deviations away, by hand."""
    of_test = np.repeat(z, 2)
    inner, outer, angle = (
        data[k].values for k in ("inner_radius", "outer_radius", "opening_angle")
    )
    if name == "thickness":
        h = outer - inner
        return data.assign(outer_radius=("test", inner + h * np.exp(of_test * sd / h)))
    if name == "inner_radius":
        return data.assign(inner_radius=("test", inner * np.exp(of_test * sd / inner)))
    if name == "wall_area":
        k = 2 * np.pi / (2 * np.pi - angle)
        area = np.pi * (outer**2 - inner**2) / k
        square = inner**2 + k / np.pi * area * np.exp(of_test * sd / area)
        return data.assign(outer_radius=("test", np.sqrt(square)))
    ring = np.array([0.6, 0.6, 0.63, 0.63])
    other = angle + of_test * sd
    sector = opened_sector(RING["inner_radius"], ring, opening_angle=other)
    names = ("inner_radius", "outer_radius", "opening_angle")
    values = zip(names, (*sector, other), strict=True)
    return data.assign({name: ("test", value) for name, value in values})


def as_measured(data):
    """The same with internal radii that belong to the outer diameters."""
    if "outer_diameter" not in data:
        return data
    k = 2 * np.pi / (2 * np.pi - data["opening_angle"].values)
    excess = (data["outer_radius"].values ** 2 - data["inner_radius"].values ** 2) / k
    at_points = (excess / data["axial_stretch"].values)[data["test"].values]
    radius = np.sqrt((data["outer_diameter"].values / 2) ** 2 - at_points)
    return data.assign(radius=("obs", radius))


@pytest.mark.parametrize("measured", ["radius", "outer_diameter"])
@pytest.mark.parametrize(
    ("name", "sd"),
    [("thickness", 0.02), ("wall_area", 0.03), ("opening_angle", 0.2), ("inner_radius", 0.01)],
)
def test_a_deviation_is_another_tube(name, sd, measured):
    """The likelihood is that of data whose tube is the other one; the prior is standard normal."""
    data = data_of(measured)
    model = ph.inflation_model(
        ph.HolzapfelGasserOgden(),
        data,
        **NOISE,
        geometry={name: ph.Measured(sd)},
        mode="quadrature",
    )
    z = np.array([0.7, -1.2])
    other = as_measured(changed(data, name, z, sd))
    expected = log_density(
        ph.inflation_model(ph.HolzapfelGasserOgden(), other, **NOISE, mode="quadrature")
    )
    expected += float(pm.logp(pm.Normal.dist(), z).sum().eval())
    assert log_density(model, **{f"{name}_deviation": z}) == pytest.approx(expected, rel=TOLERANCE)


def test_two_deviations_belong_to_one_tube():
    """The ring opens by another angle, and has another thickness."""
    data = data_of(geometry_sd={"thickness": 0.02, "opening_angle": 0.2})
    geometry = {"thickness": ph.Measured(), "opening_angle": ph.Measured()}
    z, y = np.array([0.7, -1.2]), np.array([-0.4, 0.3])
    other = changed(changed(data, "opening_angle", y, 0.2), "thickness", z, 0.02)
    settings = NOISE | {"mode": "quadrature"}
    model = ph.inflation_model(ph.Ogden(), data, **settings, geometry=geometry)
    expected = log_density(ph.inflation_model(ph.Ogden(), other, **settings))
    expected += float(pm.logp(pm.Normal.dist(), np.concatenate([z, y])).sum().eval())
    point = {"thickness_deviation": z, "opening_angle_deviation": y}
    assert log_density(model, **point) == pytest.approx(expected, rel=TOLERANCE)
    names = ["inner_radius", "outer_radius", "thickness", "opening_angle"]
    outputs = model.replace_rvs_by_values([model[name] for name in names])
    function = model.compile_fn(outputs, inputs=model.value_vars, on_unused_input="ignore")
    tube = dict(zip(names, function(model.initial_point() | point), strict=True))
    for name in ("inner_radius", "outer_radius", "opening_angle"):
        np.testing.assert_allclose(tube[name], other[name].values[::2])
    np.testing.assert_allclose(tube["thickness"], tube["outer_radius"] - tube["inner_radius"])


def test_gradients_by_deviations():
    """Against differences."""
    data = data_of("outer_diameter")
    geometry = {"thickness": ph.Measured(0.02), "opening_angle": ph.Measured(0.2)}
    model = ph.inflation_model(ph.Ogden(), data, **NOISE, geometry=geometry)
    gradient = model.compile_dlogp()
    logp, start = model.compile_logp(), model.initial_point()
    start["thickness_deviation"] = np.array([0.5, -0.3])
    names = [v.name for v in model.value_vars]
    ends = np.cumsum([np.size(start[name]) for name in names])[:-1]
    parts = dict(zip(names, np.split(gradient(start), ends), strict=True))
    for name in ("thickness_deviation", "opening_angle_deviation"):
        for i in range(2):
            step = np.zeros(2)
            step[i] = 1e-5
            up, down = (logp(start | {name: start[name] + s * step}) for s in (1, -1))
            assert parts[name][i] == pytest.approx((up - down) / 2e-5, rel=1e-5, abs=1e-6)


def test_errors_of_a_table_are_in_its_units():
    """Degrees of Fung's angle are half of those of the whole one; a wall of a ring is its area."""
    frame = table().assign(h_sd=np.repeat([20.0, 30.0], 8))
    lengths = ["radius", "outer", "outer_diameter"]
    frame[lengths] *= 1000
    data = ph.inflation_data(
        frame,
        inner_radius=500.0,
        outer_radius="outer",
        opening_angle=np.rad2deg(ANGLE) / 2,
        opening_angle_convention="fung",
        radii_of="ring",
        geometry_sd={"thickness": "h_sd", "opening_angle": 5.0, "wall_area": 1e4},
        axial_stretch="stretch",
        radius_unit="um",
        angle_unit="deg",
        check="ignore",
    )
    np.testing.assert_allclose(data["thickness_sd"], [0.02, 0.02, 0.03, 0.03])
    np.testing.assert_allclose(data["opening_angle_sd"], np.deg2rad(10.0))
    np.testing.assert_allclose(data["wall_area_sd"], 0.01)
    assert data["wall_area_sd"].attrs["units"] == "mm2"
    np.testing.assert_allclose(data["inner_radius"], data_of()["inner_radius"])
    kept = ph.select(data, specimen="S2")
    np.testing.assert_allclose(kept["thickness_sd"], 0.03)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        (
            {"geometry_sd": {"thickness": -0.1}},
            "'S1', experiment 0: the error of thickness is -0.1",
        ),
        ({"geometry_sd": {"thickness": "nothing"}}, "the frame has no such column"),
        ({"geometry_sd": {"length": 0.1}}, "geometry_sd holds 'length'; expected some of"),
        ({"geometry_sd": {"inner_radius": 0.1}}, "the radii are those of the ring"),
        ({"geometry_sd": 0.1}, "geometry_sd must be a dict"),
        ({"geometry_sd": {"thickness": "pressure"}}, "is 11.0, but 8.0 in the first row"),
    ],
)
def test_errors_that_are_none(given, message):
    with pytest.raises((TypeError, ValueError), match=message):
        data_of(**given)


@pytest.mark.parametrize(
    ("geometry", "message"),
    [
        ({"thickness": ph.Measured()}, "the data hold no thickness_sd: give ph.inflation_data"),
        ({"wall": ph.Measured(0.1)}, "a prior is given for 'wall'"),
        ({"thickness": ph.Measured(0.1), "wall_area": ph.Measured(0.1)}, "state the same"),
        ({"thickness": pm.LogNormal.dist()}, "or ph.Measured"),
        ({"thickness": 0.1}, "expected a distribution"),
    ],
)
def test_tubes_that_are_not_stated(geometry, message):
    with pytest.raises((TypeError, ValueError), match=message):
        ph.inflation_model(ph.Ogden(), data_of(), **NOISE, geometry=geometry)


@pytest.mark.parametrize("sd", [-0.1, 0.0, np.nan, np.inf, True, "h"])
def test_an_error_is_a_positive_number(sd):
    with pytest.raises((TypeError, ValueError), match="expected a standard deviation"):
        ph.Measured(sd)


def test_specimens_of_a_class_have_tubes_of_their_own():
    """A prior that all share is refused; what was measured is registered of each."""
    noise = {name: NOISE[name] for name in ("noise_sd", "force_noise_sd")}
    prior = {"inner_radius": pm.Uniform.dist(0.4, 0.6)}
    with pytest.raises(TypeError, match="where specimens differ, expected"):
        ph.population_model(ph.Ogden(), data_of(), **noise, geometry=prior)
    thickness = {"thickness": ph.Measured(0.01)}
    with pytest.raises(ValueError, match="only with variability='specimen'"):
        ph.fit_classes(
            ph.Ogden(), {"a": data_of()}, noise_sd=0.4, slope_weight=0, geometry=thickness
        )
    model = ph.population_model(ph.Ogden(), data_of(), **noise, geometry=thickness)
    assert model.named_vars_to_dims["thickness_deviation"] == ("specimen",)
    assert {"measured_pressure", "measured_axial_force"} == {v.name for v in model.observed_RVs}


def test_predictions_are_of_the_tube_of_each_draw():
    """The current outer radius of a specimen follows from its thickness; of several, none's."""
    data = ph.select(data_of(geometry_sd={"thickness": 0.02}), specimen="S1")
    model = ph.inflation_model(
        ph.NeoHookean(), data, noise_sd=0.4, slope_weight=0, geometry={"thickness": ph.Measured()}
    )
    with model:
        tree = ph.sample_smc(draws=200, chains=1, random_seed=1, progressbar=False)
    found = ph.tube_properties(
        tree, [11.0], pressure_unit="kPa", axial_stretch=1.35, check="ignore"
    )
    inner = float(data["inner_radius"][0])
    outer = inner + tree["posterior"]["thickness"].isel(specimen=0, drop=True)
    k = 2 * np.pi / (2 * np.pi - ANGLE)
    expected = np.sqrt(found["radius"] ** 2 + (outer**2 - inner**2) / (k * 1.35))
    xr.testing.assert_allclose(found["outer_radius"].drop_attrs(), expected.drop_attrs())
    assert float(outer.std()) > 0
