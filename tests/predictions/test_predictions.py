"""Posteriors of curves, properties and stresses are those of each draw, and balance."""

import numpy as np
import oracles
import pytensor.tensor as pt
import pytest
import xarray as xr
from problems import AS_WRITTEN, OGDEN_1972_RUBBER
from scipy.integrate import quad
from scipy.optimize import brentq

import pymc_hyperelastic as ph

# What the package promises of its inverse: some digits less than the pressure it inverts.
INVERSE = 1e-10
# The same quantity by another compiled function, or from another formula of the same digits.
ROUNDING = 1e-12
# Central differences of step h err by h² and by rounding over h: with h = 1e-4 of the pressure.
DIFFERENCE = 1e-6
# An integral over the wall from 40 Gauss points of the stress, which varies smoothly.
QUADRATURE = 1e-11

SHEEP = {"inner_radius": 7.0, "outer_radius": 9.0}
TUBES = {
    "sheep aorta": SHEEP | {"axial_stretch": 1.0, "opening_angle": 0.0},
    "stretched": SHEEP | {"axial_stretch": 1.4, "opening_angle": 0.0},
    "in vivo": {
        "inner_radius": 0.4,
        "outer_radius": 0.52,
        "axial_stretch": 1.5,
        "opening_angle": np.deg2rad(90.0),
    },
    "thick, opened the other way": {
        "inner_radius": 1.0,
        "outer_radius": 2.5,
        "axial_stretch": 0.9,
        "opening_angle": np.deg2rad(-40.0),
    },
}
LAWS = {
    "NeoHookean": (ph.NeoHookean(), {"mu": 20.0}),
    "MooneyRivlin": (ph.MooneyRivlin(), {"c10": 10.0, "c01": 2.0}),
    "Gent": (ph.Gent(), {"mu": 20.0, "limit": 40.0}),
    "Ogden": (ph.Ogden(), {"mu": 6.0, "alpha": 8.0}),
    "steep Ogden": (ph.Ogden(), {"mu": 6.0, "alpha": -25.0}),
    "OgdenSeries": (ph.OgdenSeries(2), {"mu": [12.0, -2.0], "alpha": [3.0, -6.0]}),
    "CriscioneType": (ph.CriscioneType(), {"a": 3.0, "b": 4.0}),
    "fibres": (ph.HolzapfelGasserOgden(), {"c": 10.0, "k1": 30.0, "k2": 2.0, "beta": 40.0}),
}

every_tube = pytest.mark.parametrize("tube", TUBES.values(), ids=TUBES)
every_law = pytest.mark.parametrize(("energy", "parameters"), LAWS.values(), ids=LAWS)


def result(**variables) -> xr.DataTree:
    """A result of one chain: variables by draw, vectors by (draw, entry)."""
    posterior = {
        name: (("chain", "draw", f"{name}_entry")[: np.ndim(values) + 1], [values])
        for name, values in variables.items()
    }
    return xr.DataTree.from_dict({"posterior": xr.Dataset(posterior)})


def one_draw(parameters: dict) -> xr.DataTree:
    return result(**{name: [value] for name, value in parameters.items()})


def radii_of(tube: dict) -> np.ndarray:
    """Radii from a collapsing tube to one that is inflated far."""
    stretch = tube["axial_stretch"] * 2 * np.pi / (2 * np.pi - tube["opening_angle"])
    return tube["inner_radius"] / np.sqrt(stretch) * np.array([0.8, 1.0, 1.01, 1.3, 1.6])


def curve(energy, parameters, radius, tube) -> np.ndarray:
    predicted = ph.predict_pressure(one_draw(parameters), radius, energy=energy, **tube)
    return predicted["pressure"].values[0, 0]


# --- pressure and force at given radii -----------------------------------------------------------


@pytest.mark.parametrize(
    ("predict", "name", "function"),
    [
        (ph.predict_pressure, "pressure", ph.inflation_pressure),
        (ph.predict_pressure, "stiffness", ph.inflation_stiffness),
        (ph.predict_axial_force, "axial_force", ph.axial_force),
    ],
    ids=["pressure", "stiffness", "axial force"],
)
def test_curves_are_those_of_each_draw(predict, name, function):
    """Each draw has the pressure, stiffness and axial force of its parameters."""
    tree = result(mu=[4.0, 6.0, 5.0], alpha=[8.0, 12.0, -3.0])
    tube, radius = TUBES["in vivo"], [0.3, 0.5]
    found = predict(tree, radius, energy=ph.Ogden(), **tube)[name]
    assert found.dims == ("chain", "draw", "radius")
    assert found.attrs["units"] == {"pressure": "kPa", "stiffness": "kPa/mm"}.get(name, "mN")
    for draw in range(3):
        at = {n: float(tree["posterior"][n][0, draw]) for n in ("mu", "alpha")}
        expected = function(ph.Ogden(), radius, **tube, **at).eval(mode=AS_WRITTEN)
        np.testing.assert_allclose(found[0, draw], expected, rtol=ROUNDING)


@pytest.mark.parametrize("predict", [ph.predict_pressure, ph.predict_axial_force])
def test_vector_parameters(predict):
    """The series ``(2μ/α, α), (−2μ/α, −α)`` is the Ogden solid: vectors are read by entry."""
    mu, alpha = np.array([4.0, 6.0, 5.0]), np.array([8.0, 12.0, 3.0])
    signs = np.array([1.0, -1.0])
    series = result(mu=(2 * mu / alpha)[:, None] * signs, alpha=alpha[:, None] * signs)
    tube = TUBES["in vivo"]
    expected = predict(result(mu=mu, alpha=alpha), [0.3, 0.5], energy=ph.Ogden(), **tube)
    found = predict(series, [0.3, 0.5], energy=ph.OgdenSeries(2), **tube)
    xr.testing.assert_allclose(found, expected, rtol=1e-10)  # the series cancels some digits


def test_order_of_dimensions_does_not_matter():
    """A posterior by (draw, chain) gives what one by (chain, draw) gives."""
    tree = result(mu=[4.0, 6.0, 5.0], alpha=[8.0, 12.0, 3.0])
    turned = xr.DataTree.from_dict({"posterior": tree["posterior"].to_dataset().transpose()})
    found, expected = (
        ph.predict_pressure(t, [7.0, 8.0], energy=ph.Ogden(), **SHEEP) for t in (turned, tree)
    )
    xr.testing.assert_identical(found, expected)


# --- the tube of each draw -----------------------------------------------------------------------

INNER, THICKNESS = np.array([6.8, 7.0, 7.2]), np.array([1.9, 2.0, 2.2])
INFERRED = {
    "outer radius": {"outer_radius": INNER + THICKNESS},
    "thickness": {"thickness": THICKNESS},
    # What is cut open is a sector of the ring, and has its area.
    "wall area": {"wall_area": (1 - 0.3 / np.pi) * np.pi * ((INNER + THICKNESS) ** 2 - INNER**2)},
}


@pytest.mark.parametrize("wall", INFERRED.values(), ids=INFERRED)
def test_inferred_geometry_is_that_of_each_draw(wall):
    """Variables named like the geometry are the draw's own tube, in every function."""
    axial, angle = np.array([1.1, 1.2, 1.3]), np.full(3, 0.6)
    tree = result(
        mu=np.full(3, 20.0), inner_radius=INNER, axial_stretch=axial, opening_angle=angle, **wall
    )
    functions = (ph.predict_pressure, ph.predict_axial_force, ph.radius_at_pressure, ph.wall_stress)
    arguments = ([7.5, 8.0], [7.5, 8.0], [1.0, 2.0], [1.0, 2.0])
    for function, argument in zip(functions, arguments, strict=True):
        found = function(tree, argument, energy=ph.NeoHookean())
        for draw in range(3):
            tube = {
                "inner_radius": INNER[draw],
                "outer_radius": INNER[draw] + THICKNESS[draw],
                "axial_stretch": axial[draw],
                "opening_angle": angle[draw],
            }
            alone = function(result(mu=[20.0]), argument, energy=ph.NeoHookean(), **tube)
            for name in alone:
                np.testing.assert_allclose(
                    found[name][:, [draw]], alone[name], rtol=1e-10, atol=1e-12
                )


def fitted_tree(energy: str = "NeoHookean", **variables) -> xr.DataTree:
    """What sampling stores: the posterior, the inflation data and the name of the material."""
    data = ph.select(ph.load_dataset("simulated_sheep_aorta"), specimen="S1", experiment=1)
    tree = result(**variables)
    tree["observed_data"] = xr.DataTree(data[["pressure"]].reset_coords(drop=True))
    tree["constant_data"] = xr.DataTree(data.drop_vars("pressure"))
    tree.attrs["strain_energy"] = energy
    return tree


@pytest.mark.parametrize(
    ("given", "inferred", "outer"),
    [
        ({}, {}, 9.0),
        ({}, {"outer_radius": [8.5]}, 8.5),
        ({}, {"thickness": [1.0]}, 8.0),
        ({}, {"outer_radius": [8.5], "thickness": [1.0]}, 8.5),
        ({"outer_radius": 8.2}, {"thickness": [1.0]}, 8.2),
        ({"outer_radius": 8.2}, {"outer_radius": [8.5]}, 8.2),
    ],
)
def test_keyword_precedes_posterior_precedes_data(given, inferred, outer):
    """The caller's tube comes first, then that of the draw, then that of the data."""
    found = ph.predict_pressure(fitted_tree(mu=[20.0], **inferred), [8.0], **given)
    expected = oracles.neo_hookean_pressure(20.0, 8.0, 7.0, outer)
    np.testing.assert_allclose(found["pressure"].item(), expected, rtol=ROUNDING)


# --- the radius at a pressure --------------------------------------------------------------------


@every_tube
@every_law
def test_radius_is_the_inverse_of_pressure(energy, parameters, tube):
    """Pressures that were predicted at some radii give these radii back, deflated or inflated."""
    radius = radii_of(tube)
    pressure = curve(energy, parameters, radius, tube)
    found = ph.radius_at_pressure(one_draw(parameters), pressure, energy=energy, **tube)["radius"]
    assert found.dims == ("chain", "draw", "pressure")
    np.testing.assert_allclose(found[0, 0], radius, rtol=INVERSE)


@every_tube
def test_radius_against_the_closed_form(tube):
    """The radius of a neo-Hookean tube solves its closed form."""
    geometry = tuple(tube.values())
    tree = result(mu=[20.0, 35.0])
    top = min(oracles.neo_hookean_pressure(20.0, radii_of(tube)[-1], *geometry), 4.0)
    pressure = np.array([0.1, 0.5, 1.0]) * top
    found = ph.radius_at_pressure(tree, pressure, energy=ph.NeoHookean(), **tube)["radius"]
    for draw, mu in enumerate((20.0, 35.0)):
        for p, a in zip(pressure, found[0, draw].values, strict=True):

            def excess(x, mu=mu, p=p):
                return oracles.neo_hookean_pressure(mu, x, *geometry) - p

            expected = brentq(excess, a * 0.9, a * 1.1, xtol=1e-14, rtol=1e-14)
            np.testing.assert_allclose(a, expected, rtol=INVERSE)


def test_radius_at_rest_is_exact():
    """An isotropic tube without opening angle carries nothing at ``A/√λz``."""
    a = ph.radius_at_pressure(result(mu=[20.0]), 0.0, energy=ph.NeoHookean(), **SHEEP)
    assert a["radius"].item() == 7.0


SOFTENING = {"mu": 20.0, "n": 0.3}


def maximum_of_softening() -> tuple[float, float]:
    """Radius and pressure of the maximum, from the curve itself."""
    radius = np.linspace(7.0, 30.0, 200)
    pressure = curve(ph.PowerLawNeoHookean(), SOFTENING, radius, SHEEP)
    i = int(pressure.argmax())
    for _ in range(4):
        radius = np.linspace(radius[max(i - 1, 0)], radius[i + 1], 200)
        pressure = curve(ph.PowerLawNeoHookean(), SOFTENING, radius, SHEEP)
        i = int(pressure.argmax())
    return radius[i], float(pressure[i])


def test_softening_curve_is_inverted_on_its_rising_branch():
    """Up to its maximum pressure a softening tube has the smaller one of two radii."""
    top_radius, top = maximum_of_softening()
    share = np.array([0.1, 0.5, 0.9, 0.999, 1 - 1e-8])
    found = ph.radius_at_pressure(
        one_draw(SOFTENING), share * top, energy=ph.PowerLawNeoHookean(), **SHEEP
    )["radius"][0, 0]
    assert np.all(np.diff(found) > 0)
    assert float(found[-1]) < top_radius
    again = curve(ph.PowerLawNeoHookean(), SOFTENING, found.values, SHEEP)
    np.testing.assert_allclose(again, share * top, rtol=INVERSE)


def test_pressure_that_is_not_reached():
    """It is NaN, a warning counts the draws, and an error says it if there is no other."""
    _, top = maximum_of_softening()
    tree = result(mu=[20.0, 40.0, 10.0], n=[0.3, 0.3, 0.3])
    settings = {"energy": ph.PowerLawNeoHookean(), **SHEEP}
    with pytest.warns(UserWarning, match=r"of 3 draws 1 do not reach .* kPa, 2 do not") as caught:
        found = ph.radius_at_pressure(tree, [0.1, 0.9 * top, 1.1 * top], **settings)["radius"][0]
    assert caught[0].filename == __file__
    np.testing.assert_array_equal(
        np.isnan(found), [[False, False, True], [False] * 3, [False, True, True]]
    )
    with pytest.raises(ValueError, match="no draw reaches a pressure of 100, 200 kPa"):
        ph.radius_at_pressure(tree, [100.0, 200.0], **settings)
    with pytest.warns(UserWarning, match="2 do not reach"):
        properties = ph.tube_properties(tree, [1.1 * top], **settings)
    with pytest.warns(UserWarning, match="2 do not reach"):
        stress = ph.wall_stress(tree, [1.1 * top], **settings)
    for values in (*properties.values(), *stress.values()):
        np.testing.assert_array_equal(
            np.isnan(values[0]).any(axis=(1, 2)[: values.ndim - 2]), [True, False, True]
        )


def test_pressure_beyond_an_asymptote_is_not_reached():
    """A neo-Hookean tube carries ``μ k/λz ln(B/A)`` when it is infinitely wide, and no more."""
    limit = 20.0 * np.log(9 / 7)
    settings = {"energy": ph.NeoHookean(), **SHEEP}
    with pytest.warns(UserWarning, match="1 do not reach"):
        found = ph.radius_at_pressure(result(mu=[20.0]), [0.999 * limit, limit], **settings)
    assert np.isfinite(found["radius"][0, 0, 0])


def test_second_rising_branch_is_not_taken():
    """Rubber's pressure rises, falls and rises again: beyond the first maximum is no radius."""
    tube = {"inner_radius": 1.0, "outer_radius": 1.05}
    energy = ph.OgdenSeries(3)
    radius = np.linspace(1.0, 8.0, 1000)
    pressure = curve(energy, OGDEN_1972_RUBBER, radius, tube)
    top = int(np.argmax(np.diff(pressure) < 0))
    assert pressure.max() > 1.2 * pressure[top] > 1.2 * pressure[top + 50], "it is no such curve"
    with pytest.warns(UserWarning, match="1 do not reach"):
        found = ph.radius_at_pressure(
            one_draw(OGDEN_1972_RUBBER),
            float(pressure[top]) * np.array([0.99, 1.1]),
            energy=energy,
            **tube,
        )["radius"][0, 0]
    assert found[0] < radius[top]
    assert np.isnan(found[1])


def test_stresses_that_overflow_are_beyond_the_radius():
    """Gent's solid ends at a radius: pressures of any size are reached before, without warning."""
    tree = result(mu=[20.0], limit=[0.5])
    found = ph.radius_at_pressure(tree, [1.0, 10.0, 1000.0], energy=ph.Gent(), **SHEEP)["radius"][
        0, 0
    ]
    assert np.all(np.diff(found) > 0)
    back = curve(ph.Gent(), {"mu": 20.0, "limit": 0.5}, found.values, SHEEP)
    np.testing.assert_allclose(back, [1.0, 10.0, 1000.0], rtol=1e-6)  # ill-conditioned near the end


# --- elastic properties --------------------------------------------------------------------------


@every_tube
@pytest.mark.parametrize("law", ["Ogden", "OgdenSeries", "fibres"])
def test_properties_are_slopes_of_the_curves(law, tube):
    """Each property by its definition, from differences of radii at neighbouring pressures."""
    energy, parameters = LAWS[law]
    tree = one_draw(parameters)
    pressure = curve(energy, parameters, radii_of(tube)[3:4], tube) * [0.3, 1.0]
    step = 1e-4 * pressure
    found = ph.tube_properties(tree, pressure, energy=energy, density=1050.0, **tube)
    below, above = (
        ph.tube_properties(tree, pressure + sign * step, energy=energy, **tube).drop_vars(
            "pressure"
        )
        for sign in (-1, 1)
    )

    def slope(of):
        return (of(above) - of(below)).values / (2 * step)

    a, b = found["radius"].values, found["outer_radius"].values
    k = 2 * np.pi / (2 * np.pi - tube["opening_angle"])
    wall = np.pi * (tube["outer_radius"] ** 2 - tube["inner_radius"] ** 2) / k
    np.testing.assert_allclose(np.pi * (b**2 - a**2) * tube["axial_stretch"], wall, rtol=1e-10)
    area, growth = np.pi * a**2, slope(lambda x: np.pi * x["radius"] ** 2)
    expected = {
        "stiffness": 1 / slope(lambda x: x["radius"]),
        "compliance": growth,
        "distensibility": growth / area,
        "peterson_modulus": 1 / slope(lambda x: np.log(2 * x["radius"])),
        "incremental_modulus": 2
        * (1 - 0.5**2)
        * a**2
        * b
        / (b**2 - a**2)
        / slope(lambda x: x["outer_radius"]),
        # In SI units: m², m²/Pa, kg/m³.
        "pulse_wave_velocity": np.sqrt(area * 1e-6 / (1050.0 * growth * 1e-6 / 1e3)),
    }
    for name, values in expected.items():
        np.testing.assert_allclose(found[name], values, rtol=DIFFERENCE, err_msg=name)


@pytest.mark.parametrize("outer_radius", [7.01, 9.0, 30.0])
def test_incremental_modulus_at_rest_is_youngs(outer_radius):
    """Bergel's formula is exact for the linear tube, of any thickness: ``E = 3μ``."""
    settings = {"energy": ph.NeoHookean(), "inner_radius": 7.0, "outer_radius": outer_radius}
    found = ph.tube_properties(result(mu=[20.0, 30.0]), 0.0, **settings)["incremental_modulus"]
    np.testing.assert_allclose(found[0, :, 0], [60.0, 90.0], rtol=1e-10)


def test_pulse_wave_of_a_thin_tube():
    """It tends to Moens and Korteweg's ``√(E h/(2 ρ a (1 − ν²)))`` as the wall gets thin."""
    thickness = 7e-6
    settings = {"energy": ph.NeoHookean(), "inner_radius": 7.0, "outer_radius": 7.0 + thickness}
    found = ph.tube_properties(result(mu=[2e7]), 0.0, **settings)["pulse_wave_velocity"].item()
    youngs = 3 * 2e10  # Pa
    expected = np.sqrt(youngs * thickness / (2 * 1060 * 7.0 * 0.75))
    np.testing.assert_allclose(found, expected, rtol=1e-5)


def test_pulse_wave_velocity_is_that_of_the_slope():
    """The speed is ``√(a (dp/da)/(2ρ))`` of the predicted slope, in m/s, for any density."""
    tree, tube = result(mu=[20.0]), {"inner_radius": 7.0, "outer_radius": 9.0}
    settings = {"energy": ph.NeoHookean(), **tube}
    radius = ph.radius_at_pressure(tree, [1.0, 2.0], **settings)["radius"].values.ravel()
    slope = ph.predict_pressure(tree, radius, **settings)["stiffness"].values.ravel()
    speed = ph.pulse_wave_velocity(tree, [1.0, 2.0], density=1000.0, **settings)
    np.testing.assert_allclose(
        speed["pulse_wave_velocity"].values.ravel(),
        np.sqrt(radius * 1e-3 * slope * 1e6 / 2000),
        rtol=1e-10,
    )


def test_properties_say_what_they_are():
    """Every variable and coordinate has its unit."""
    found = ph.tube_properties(result(mu=[20.0]), [1.0], energy=ph.NeoHookean(), **SHEEP)
    units = {name: found[name].attrs["units"] for name in (*found, "pressure")}
    assert units == {
        "radius": "mm",
        "outer_radius": "mm",
        "stiffness": "kPa/mm",
        "compliance": "mm2/kPa",
        "distensibility": "1/kPa",
        "peterson_modulus": "kPa",
        "incremental_modulus": "kPa",
        "pulse_wave_velocity": "m/s",
        "pressure": "kPa",
    }


# --- stresses through the wall -------------------------------------------------------------------


def wall_integral(integrand: xr.DataArray, stress: xr.Dataset, tube: dict, weight: np.ndarray):
    """``∫ integrand dr`` through the wall, of stresses at the nodes of a rule on [0, 1]."""
    thickness = tube["outer_radius"] - tube["inner_radius"]
    reference = tube["inner_radius"] + thickness * stress["position"]
    k = 2 * np.pi / (2 * np.pi - tube["opening_angle"])
    along = reference / (k * tube["axial_stretch"] * stress["current_radius"])
    return (integrand * along * weight).sum("position").values[0, 0] * thickness


@every_tube
@every_law
def test_stresses_balance_pressure_and_force(energy, parameters, tube):
    """Hoop stress balances the pressure, axial stress the axial force; radial is that on the faces.

    ``∫ σθθ dr = p a`` and ``∫ σzz 2π r dr = F + π a² p``: three results that share no formula.
    """
    node, weight = np.polynomial.legendre.leggauss(40)
    tree = one_draw(parameters)
    if law_has_slack_fibres(energy, tube):
        # The stress has a kink, at which no one rule for the whole wall is exact.
        node, weight = np.linspace(-1, 1, 20001), np.full(20001, 1e-4)
        weight[[0, -1]] /= 2
    pressure = curve(energy, parameters, radii_of(tube)[3:], tube)
    stress = ph.wall_stress(tree, pressure, points=(1 + node) / 2, energy=energy, **tube)
    a = ph.radius_at_pressure(tree, pressure, energy=energy, **tube)["radius"].values[0, 0]
    hoop = wall_integral(stress["sigma_tt"], stress, tube, weight / 2)
    tolerance = QUADRATURE if len(node) == 40 else 1e-6
    np.testing.assert_allclose(hoop, pressure * a, rtol=tolerance)
    axial = wall_integral(
        stress["sigma_zz"] * 2 * np.pi * stress["current_radius"], stress, tube, weight / 2
    )
    force = ph.predict_axial_force(tree, a, energy=energy, **tube)["axial_force"].values[0, 0]
    np.testing.assert_allclose(axial, force + np.pi * a**2 * pressure, rtol=tolerance)
    faces = ph.wall_stress(tree, pressure, points=2, energy=energy, **tube)["sigma_rr"][0, 0]
    scale = np.abs(stress["sigma_tt"]).max().item()
    np.testing.assert_allclose(faces[:, 0], -pressure, rtol=1e-10)
    np.testing.assert_allclose(faces[:, 1], 0.0, atol=1e-14 * scale)


def law_has_slack_fibres(energy, tube) -> bool:
    return isinstance(energy, ph.HolzapfelGasserOgden) and tube["axial_stretch"] < 1


@every_tube
def test_stresses_are_in_equilibrium_at_each_circle(tube):
    """``dσrr/dr = (σθθ − σrr)/r``, by differences between neighbouring circles."""
    position = np.linspace(0.0, 1.0, 2001)
    energy, parameters = LAWS["Ogden"]
    pressure = curve(energy, parameters, radii_of(tube)[3:4], tube)
    stress = ph.wall_stress(one_draw(parameters), pressure, points=position, energy=energy, **tube)
    r, radial, hoop = (
        stress[name].values[0, 0, 0] for name in ("current_radius", "sigma_rr", "sigma_tt")
    )
    slope = (radial[2:] - radial[:-2]) / (r[2:] - r[:-2])
    expected = (hoop - radial)[1:-1] / r[1:-1]
    np.testing.assert_allclose(slope, expected, atol=1e-5 * np.abs(expected).max(), rtol=0)


@every_tube
def test_stresses_of_the_neo_hookean_tube(tube):
    """``σi − σj = μ (λi² − λj²)`` with stretches from the wall map, and ``σrr`` by quadrature."""
    mu, inner, outer, axial, angle = 20.0, *tube.values()
    k = 2 * np.pi / (2 * np.pi - angle)
    tree = result(mu=[mu])
    a = radii_of(tube)[3]
    pressure = oracles.neo_hookean_pressure(mu, a, *tube.values())
    stress = ph.wall_stress(tree, pressure, points=5, energy=ph.NeoHookean(), **tube).squeeze()

    def stretches(reference):
        r = np.sqrt(a**2 + (reference**2 - inner**2) / (k * axial))
        hoop = k * r / reference
        return r, 1 / (hoop * axial), hoop

    def integrand(reference):
        r, radial, hoop = stretches(reference)
        return mu * (hoop**2 - radial**2) / (hoop * axial * r)

    for i, share in enumerate((0.0, 0.25, 0.5, 0.75, 1.0)):
        reference = inner + share * (outer - inner)
        r, radial, hoop = stretches(reference)
        sigma_rr = -quad(integrand, reference, outer, epsabs=1e-13, epsrel=1e-13)[0]
        at = {name: stress[name].values[i] for name in (*stress, "current_radius")}
        scale = {"rtol": 1e-9, "atol": 1e-12}
        np.testing.assert_allclose(at["current_radius"], r, rtol=1e-10)
        np.testing.assert_allclose(at["sigma_rr"], sigma_rr, **scale)
        np.testing.assert_allclose(at["sigma_tt"], sigma_rr + mu * (hoop**2 - radial**2), **scale)
        np.testing.assert_allclose(at["sigma_zz"], sigma_rr + mu * (axial**2 - radial**2), **scale)


@every_law
def test_stress_differences_are_slopes_of_the_energy(energy, parameters):
    """``σθθ − σrr = ∂Ŵ/∂ln λθ`` and ``σzz − σrr = ∂Ŵ/∂ln λz``, by differences of the energy."""
    tube = TUBES["in vivo"]
    pressure = curve(energy, parameters, [0.45], tube)
    stress = ph.wall_stress(
        one_draw(parameters), pressure, points=3, energy=energy, **tube
    ).squeeze()
    a = ph.radius_at_pressure(one_draw(parameters), pressure, energy=energy, **tube)[
        "radius"
    ].item()
    reference = np.linspace(0.4, 0.52, 3)
    r = np.sqrt(a**2 + (reference**2 - 0.4**2) / (4 / 3 * 1.5))
    log_hoop, log_axial = np.log(4 / 3 * r / reference), np.full(3, np.log(1.5))
    vectors = energy.join(energy.split(parameters))

    def reduced(hoop, axial):
        stretches = (pt.as_tensor(np.exp(x)) for x in (-hoop - axial, hoop, axial))
        return energy.energy(*stretches, **vectors).eval(mode=AS_WRITTEN)

    h = 1e-5
    hoop = (reduced(log_hoop + h, log_axial) - reduced(log_hoop - h, log_axial)) / (2 * h)
    axial = (reduced(log_hoop, log_axial + h) - reduced(log_hoop, log_axial - h)) / (2 * h)
    np.testing.assert_allclose(stress["sigma_tt"] - stress["sigma_rr"], hoop, rtol=DIFFERENCE)
    np.testing.assert_allclose(stress["sigma_zz"] - stress["sigma_rr"], axial, rtol=DIFFERENCE)


def test_mean_hoop_stress_of_a_thin_wall_is_laplaces():
    """Through a thin wall the hoop stress hardly varies: it is ``p a/h``."""
    tube = {"inner_radius": 7.0, "outer_radius": 7.0007}
    stress = ph.wall_stress(result(mu=[2e5]), 3.0, energy=ph.NeoHookean(), **tube).squeeze()
    r = stress["current_radius"].values
    np.testing.assert_allclose(stress["sigma_tt"], 3.0 * r[0] / (r[-1] - r[0]), rtol=1e-3)


def test_places_in_the_wall():
    """A number of circles, or their places; labelled, with the current radius as a coordinate."""
    settings = {"energy": ph.NeoHookean(), **SHEEP}
    few = ph.wall_stress(result(mu=[20.0, 30.0]), [1.0, 2.0], points=3, **settings)
    assert few["sigma_rr"].dims == ("chain", "draw", "pressure", "position")
    assert few.coords["position"].values.tolist() == [0.0, 0.5, 1.0]
    assert few.coords["current_radius"].dims == few["sigma_rr"].dims
    assert {few[name].attrs["units"] for name in few} == {"kPa"}
    middle = ph.wall_stress(result(mu=[20.0, 30.0]), [1.0, 2.0], points=[0.5], **settings)
    xr.testing.assert_allclose(middle, few.sel(position=[0.5]), rtol=ROUNDING)


# --- admissibility -------------------------------------------------------------------------------


def test_admissible_neo_hookean():
    """Pressure and stresses of a positive modulus behave; those of a negative one do not."""
    found = ph.admissible(
        result(mu=[20.0, -1.0, 5.0]), [6.0, 7.0, 9.0], energy=ph.NeoHookean(), **SHEEP
    )
    for name in ("pressure_rises", "baker_ericksen"):
        assert found[name].dims == ("chain", "draw")
        assert found[name].values.tolist() == [[True, False, True]]
        assert found[name].attrs["fraction"] == 2 / 3
    assert found.attrs["summary"] == (
        "From 6 to 9 mm, of 3 draws: pressure rises in 66.7 %, Baker-Ericksen holds in 66.7 %."
    )


def test_conditions_are_independent():
    """A softening tube breaks one condition, a negative second modulus the other."""
    top, _ = maximum_of_softening()
    softening = {"energy": ph.PowerLawNeoHookean(), **SHEEP}
    found = ph.admissible(one_draw(SOFTENING), np.linspace(7, 1.1 * top, 50), **softening)
    assert not found["pressure_rises"].item()
    assert found["baker_ericksen"].item()
    assert ph.admissible(one_draw(SOFTENING), [7, 0.9 * top], **softening)["pressure_rises"].item()
    # Baker and Ericksen ask of Mooney and Rivlin that c10 + λk² c01 > 0 in each direction k: of the
    # pair of hoop and radius 20 − 12 λz² is positive, of axis and radius 20 − 12 λθ² no longer.
    tree = result(c10=[20.0, 20.0], c01=[-12.0, 2.0])
    found = ph.admissible(tree, np.linspace(7.0, 10.0, 20), energy=ph.MooneyRivlin(), **SHEEP)
    assert found["pressure_rises"].values.tolist() == [[True, True]]
    assert found["baker_ericksen"].values.tolist() == [[False, True]]


@pytest.mark.parametrize("axial", [0.8, 1.0, 1.3])
def test_baker_ericksen_of_mooney_rivlin_against_its_closed_form(axial):
    """``c10 + λk² c01 > 0`` for each of the three stretches, at each circle that is looked at."""
    ratio = np.linspace(-1.2, 0.2, 300)
    radius = np.linspace(6.5, 9.0, 7)
    tube = SHEEP | {"axial_stretch": axial}
    tree = result(c10=np.full(300, 10.0), c01=10 * ratio)
    found = ph.admissible(tree, radius, energy=ph.MooneyRivlin(), **tube)["baker_ericksen"][0]
    reference = np.linspace(7.0, 9.0, 11)
    r = np.sqrt(radius[:, None] ** 2 + (reference**2 - 49) / axial)
    hoop = r / reference
    largest = max(np.max(hoop), np.max(1 / (hoop * axial)), axial)
    np.testing.assert_array_equal(found, 1 + largest**2 * ratio > 0)


def test_material_at_its_end_is_not_admissible():
    """Gent's solid beyond its largest stretch has an infinite stress."""
    found = ph.admissible(
        result(mu=[20.0, 20.0], limit=[0.05, 5.0]), [7.0, 9.0], energy=ph.Gent(), **SHEEP
    )
    for name in ("pressure_rises", "baker_ericksen"):
        assert found[name].values.tolist() == [[False, True]]


def test_fibres_are_not_held_to_baker_ericksen():
    """The inequalities are those of isotropic solids: for others there is no such variable."""
    energy, parameters = LAWS["fibres"]
    found = ph.admissible(one_draw(parameters), [7.0, 8.0], energy=energy, **SHEEP)
    assert list(found) == ["pressure_rises"]
    assert "Baker" not in found.attrs["summary"]


def test_admissible_over_the_data():
    """Without radii it is the range of the data, and with them the tube of the data."""
    tree = fitted_tree(mu=[20.0, 30.0])
    measured = tree["constant_data"]["radius"].values
    found = ph.admissible(tree)
    assert found.attrs["summary"].startswith(f"From {measured.min():g} to {measured.max():g} mm")
    assert found["pressure_rises"].all()


# --- errors --------------------------------------------------------------------------------------

TREE = result(mu=[20.0])
NEO = {"energy": ph.NeoHookean(), **SHEEP}
ERRORS = {
    "layers": (
        lambda: ph.radius_at_pressure(
            TREE, 1.0, energy=[ph.Layer(ph.NeoHookean(), 1.0, mu=2.0)], inner_radius=7.0
        ),
        TypeError,
        "wall of one material",
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
