"""Curves, forces and slopes of every integrator against independent quadrature of the wall."""

from dataclasses import replace
from functools import cache

import numpy as np
import pandas as pd
import pymc as pm
import pytensor
import pytensor.tensor as pt
import pytest
from problems import AS_WRITTEN
from shared_errors import curves_and_slopes, fibres, neo_hookean, ogden
from tables import SECTOR
from tiers import deep

import pymc_hyperelastic as ph
from pymc_hyperelastic.data.inflation import at_points
from pymc_hyperelastic.evidence.batched import BatchedFunction
from pymc_hyperelastic.models.forward import forward_model
from pymc_hyperelastic.models.forward.choose import possible_in_tests
from pymc_hyperelastic.models.forward.integrator import compared_points
from pymc_hyperelastic.models.forward.tube_variables import WallVariables
from pymc_hyperelastic.models.priors import complete_priors

SEED = 20261123
# Relative to the largest value of a curve: constant matrices are chosen to be exact to 1e-9.
CURVE_TOLERANCE = 1e-9
# Relative error of slopes, which are not considered when nodes are chosen.
SLOPE_TOLERANCE = 1e-8
# 1/mm. Stiff axial fibres bear a force that hardly depends on the radius, so that its slope is
# known to the rounding of the force, divided by the hundredth of a millimetre over which it varies.
SHORTEST = 100.0
# Nodes are chosen for materials whose pressures are below this multiple of the measured ones.
BEYOND = 10
WITH_FORCE = ph.Gaussian(pressure_sd=0.3, force_sd=1.0)
NAMES = ("pressure", "stiffness", "axial_force", "slope of pressure", "slope of axial_force")


def stiff_fibres(c, k1, k2, beta):
    return fibres(c, (beta, k1, k2), (-beta, k1, k2))


def four_fibres(c, k1_axial, k2_axial, k1_hoop, k2_hoop, k1_diagonal, k2_diagonal, beta):
    diagonal = (k1_diagonal, k2_diagonal)
    # The angle is slightly below 90 degrees, where the tangent is infinite.
    families = (90 - 1e-7, k1_axial, k2_axial), (0, k1_hoop, k2_hoop)
    return fibres(c, *families, (beta, *diagonal), (-beta, *diagonal))


LAWS = {
    "Ogden": (ph.Ogden(), ogden),
    "HolzapfelGasserOgden": (ph.HolzapfelGasserOgden(), stiff_fibres),
    "FourFiber": (ph.FourFiber(), four_fibres),
}
RANGES = {"c": (1.0, 40.0), "k1": (0.0, 50.0), "k2": (0.0, 2.0), "mu": (0.1, 20.0)}
RANGES |= {"alpha": (1.0, 6.0), "beta": (20.0, 50.0)}
OPENED = {"inner_radius": 1.0, "outer_radius": 1.3, "opening_angle": 2.3}
MOUSE = {"inner_radius": 0.38, "outer_radius": 0.48, "opening_angle": 0.0}


def dataset(tests, tube):
    """Data of tests (radius, stretch), with pressures and forces of the usual size."""
    frames = [pd.DataFrame({"experiment": i, **test}) for i, test in enumerate(tests)]
    frame = pd.concat(frames, ignore_index=True)
    frame = frame.assign(specimen=frame.get("specimen", "S"))
    frame["angle"] = frame.get("angle", pd.Series(np.nan, frame.index)).fillna(
        tube["opening_angle"]
    )
    frame["pressure"] = 40 * (frame["radius"] / tube["inner_radius"] - 0.5)
    frame["axial_force"] = 60 * (frame["stretch"] - 0.5)
    tube = tube | {"opening_angle": "angle", "axial_stretch": "stretch"}
    return ph.inflation_data(frame, ph.Tube(**tube, **SECTOR), check="ignore")


def opened_tube():
    """Inflation tests and an extension test in which the inner part of the wall is shortened.

    In a last test, without opening angle, it is the outer part.
    """
    extended = np.linspace(1.1, 1.25, 7)
    tests = [{"radius": np.linspace(0.55, 0.68, 5), "stretch": s} for s in (1.1, 1.25)]
    tests.append({"radius": 0.75 - 0.12 * extended, "stretch": extended})
    tests.append({"radius": np.linspace(1.01, 1.06, 4), "stretch": 1.25, "angle": 0.0})
    return dataset(tests, OPENED)


def mouse_aortas(specimens=1, points=6, growth=1.0):
    """Return three inflation tests and four extension tests of each specimen."""
    tests = []
    for specimen in range(specimens):
        size = growth * (1 + 0.05 * specimen)
        for stretch in (1.5, 1.6, 1.7):
            radius = size * np.linspace(0.42, 0.62, points)
            tests.append({"radius": radius, "stretch": stretch, "specimen": specimen})
        for radius in (0.45, 0.5, 0.55, 0.6):
            stretch = np.linspace(1.4, 1.7, points)
            radius = size * radius - 0.1 * (stretch - 1.4)
            tests.append({"radius": radius, "stretch": stretch, "specimen": specimen})
    return dataset(tests, MOUSE)


def priors_of(energy):
    ranges = {name: RANGES[name.split("_")[0]] for name in energy.parameter_names}
    return complete_priors(energy, {n: pm.Uniform.dist(*ends) for n, ends in ranges.items()})


def materials_of(energy, count, shares=(0.0, 0.5)):
    """Materials from the lower part of each range, beyond which tubes are too stiff for data."""
    share = np.random.default_rng(SEED).uniform(*shares, (len(energy.parameter_names), count))
    ends = np.array([RANGES[name.split("_")[0]] for name in energy.parameter_names])
    values = ends[:, :1] + np.ptp(ends, axis=1)[:, None] * share
    return dict(zip(energy.parameter_names, values, strict=True))


def curves_of(forward, materials):
    """Curves (material, point) of materials by a forward model."""
    with pm.Model() as model:
        shape = (forward.data.sizes["test"],) if forward.by_test else ()
        tube = forward.with_variables({name: pm.Flat(name, shape=shape) for name in materials})
        outputs = [*tube.curves().values(), *tube.slopes().values()]
    outputs = model.replace_rvs_by_values(outputs)
    function = BatchedFunction.of_model(model, outputs, {"mode": AS_WRITTEN})
    values = [np.reshape(v, (len(v), -1)) for v in materials.values()]
    repeats = shape[0] if shape else 1
    return function(np.concatenate([np.repeat(v, repeats, axis=1) for v in values], axis=1))


def opening_factor(angle):
    return 2 * np.pi / (2 * np.pi - angle)


def exact_curves(law, data, materials):
    """Curves (material, point) of materials by independent quadrature."""
    inner, outer = (float(data[name][0]) for name in ("inner_radius", "outer_radius"))
    axial, curves = at_points(data, "axial_stretch"), []
    for values in zip(*materials.values(), strict=True):
        layers = [(law(**dict(zip(materials, values, strict=True))), outer - inner)]
        radius, k = data["radius"].values, opening_factor(at_points(data, "opening_angle"))
        curves.append(curves_and_slopes(layers, radius, inner, axial, k))
    pressure, stiffness, force, force_slope = np.swapaxes(curves, 0, 1)
    # Internal radii were measured: slopes refer to the internal radius.
    return [pressure, stiffness, force, stiffness, force_slope]


def assert_exact(forward, law, materials, tolerance=CURVE_TOLERANCE):
    data = forward.data
    exact = exact_curves(law, data, materials)
    possible = np.abs(exact[0]).max(axis=1) < BEYOND * np.abs(data["pressure"].values).max()
    assert possible.sum() >= 8
    scales = [np.abs(curve).max(axis=1, keepdims=True) for curve in exact]
    scales[-1] = np.hypot(scales[-1], SHORTEST * scales[2])
    looser = SLOPE_TOLERANCE / CURVE_TOLERANCE
    found = curves_of(forward, materials)
    for name, curve, expected, scale in zip(NAMES, found, exact, scales, strict=True):
        error = np.abs((curve - expected) / scale)[possible].max()
        allowed = tolerance * (1 if name in ("pressure", "axial_force") else looser)
        assert error <= allowed, (name, error)


@pytest.mark.parametrize(
    ("law", "mode"),
    [
        ("HolzapfelGasserOgden", "auto"),
        *deep([("HolzapfelGasserOgden", "quadrature"), ("FourFiber", "auto")]),
    ],
)
def test_curves_of_slack_and_of_taut_fibres_are_exact(law, mode):
    energy, exact = LAWS[law]
    forward = WITH_FORCE.forward_model(energy, opened_tube(), priors_of(energy), mode=mode)
    assert_exact(forward, exact, materials_of(energy, 20))


@cache
def on_a_grid(law):
    """Forward model of one law for inflation and extension tests of one specimen or of three."""
    energy, _ = LAWS[law]
    data = mouse_aortas({"FourFiber": 2, "Ogden": 3}.get(law, 1))
    return WITH_FORCE.forward_model(energy, data, priors_of(energy), mode="collocation")


@pytest.mark.parametrize("law", ["HolzapfelGasserOgden", *deep(["Ogden", "FourFiber"])])
def test_curves_of_inflation_and_extension_tests_are_exact(law):
    """For the data of the model, and for other data that replace them.

    Tubes that are larger by a twentieth have stretches beyond those of the model: two digits less.
    """
    energy, exact = LAWS[law]
    forward, materials = on_a_grid(law), materials_of(energy, 20)
    assert_exact(forward, exact, materials)
    other = ph.select(mouse_aortas(points=5), experiment=1)
    assert_exact(forward.with_data(other), exact, materials)
    if law == "HolzapfelGasserOgden":
        larger = forward.with_data(mouse_aortas(growth=1.08))
        assert_exact(larger, exact, materials, tolerance=1e-6)


@pytest.mark.parametrize("law", ["Ogden", *deep(["FourFiber"])])
def test_curves_with_separate_parameters_for_each_test_are_exact(law):
    energy, exact = LAWS[law]
    settings = {"by_test": True, "mode": "collocation"}
    forward = WITH_FORCE.forward_model(energy, mouse_aortas(3), priors_of(energy), **settings)
    assert_exact(forward.with_data(mouse_aortas(points=5)), exact, materials_of(energy, 15))


# Fibres that are slack at first and then stiffen strongly.
FAR = {"c": [10.0, 12.0], "k1": [1e-6, 1e-5], "k2": [9.0, 7.0], "beta": [40.0, 35.0]}


def test_errors_of_materials_far_from_the_priors_are_stated_and_refined_away():
    forward, far = on_a_grid("HolzapfelGasserOgden"), {n: np.array(v) for n, v in FAR.items()}
    data, curves = forward.data, exact_curves(stiff_fibres, forward.data, far)

    def errors(forward):
        both = zip(curves_of(forward, far)[:3:2], curves[:3:2], strict=True)
        return np.max([np.abs(a - b).max(1) / np.abs(b).max(1) for a, b in both], axis=0)

    stated = forward.errors(data, far)
    assert stated.max() > 1e-6
    # The stated errors are relative to curves of groups of tests, which differ in size.
    np.testing.assert_allclose(np.log(stated / errors(forward)), 0, atol=np.log(3))
    right = forward.refined(data, far)
    assert right.errors(data, far).max() < 1e-8 and errors(right).max() < 1e-8


# --- integrators that choose the order of quadrature ---------------------------------------------


def test_layers_in_which_fibres_slacken_are_exact():
    data = opened_tube().assign(outer_radius=("test", np.full(4, np.nan)))
    values = {"c": 3.0, "k1": 8.0, "k2": 0.8, "beta": 29.0}
    wall = [
        ph.Layer(ph.HolzapfelGasserOgden(), 0.2, **values),
        ph.Layer(ph.NeoHookean(), 0.1, mu=12.0),
    ]
    tube = WITH_FORCE.forward_model(wall, data, {}).with_variables({})
    outputs = [*tube.curves().values(), *tube.slopes().values()]
    found = pytensor.function([], outputs, mode=AS_WRITTEN)()
    layers = [(stiff_fibres(**values), 0.2), (neo_hookean(12.0), 0.1)]
    axial, k = at_points(data, "axial_stretch"), opening_factor(at_points(data, "opening_angle"))
    exact = curves_and_slopes(layers, data["radius"].values, 1.0, axial, k)
    for curve, expected in zip(found, [*exact[:3], exact[1], exact[3]], strict=True):
        np.testing.assert_allclose(curve, expected, atol=CURVE_TOLERANCE * np.abs(expected).max())


class Recruited(ph.StrainEnergy):
    """Fibres that are wavy up to a hoop stretch of 1.05, a kink that the law may state."""

    parameters = (ph.Parameter("mu", r"\mu", "kPa", (0.0, 50.0), "modulus"),)

    def __init__(self, stated):
        self.stated = stated

    def energy(self, radial, hoop, axial, *, mu):
        taut = pt.maximum(hoop - 1.05, 0.0)
        return mu * (radial**2 + hoop**2 + axial**2 - 3 + taut**2)

    def kinks(self, log_axial, *, mu):
        return [pt.log(1.05) + pt.zeros_like(log_axial + mu)] if self.stated else []


@pytest.mark.parametrize("energy", [Recruited(True), Recruited(False), ph.HolzapfelGasserOgden()])
def test_laws_with_kinks_at_any_stretch_refuse_collocation(energy):
    """Cases: a law of a user, and fibres in a tube that is compressed along its axis."""
    stretch = 0.8 if energy.name == "HolzapfelGasserOgden" else 1.2
    data = dataset([{"radius": np.linspace(0.55, 0.68, 5), "stretch": stretch}], OPENED)
    with pytest.raises(ValueError, match=rf"{energy.name}.*mode='quadrature'"):
        WITH_FORCE.forward_model(energy, data, complete_priors(energy), mode="collocation")


def test_materials_above_ten_times_the_measured_pressures_are_excluded():
    """In each of two tests: the pressures of a neo-Hookean tube are proportional to its modulus."""
    tests = [{"radius": np.linspace(1.1, r, 5), "stretch": np.full(5, 1.2)} for r in (1.3, 1.5)]
    data = dataset(tests, OPENED)
    radius = data["radius"].values.reshape(2, -1)[:, [0, -1]]
    tube = ph.Tube(**OPENED, axial_stretch=1.2)
    unit = ph.inflation_pressure(ph.NeoHookean(), radius, tube, mu=1.0).eval(mode=AS_WRITTEN)
    largest = BEYOND * np.abs(data["pressure"].values).max() / np.abs(unit).max(axis=1)
    moduli = np.ravel(np.outer(largest, [0.99, 1.01]))
    found = possible_in_tests(WallVariables(ph.NeoHookean(), {"mu": moduli}, {}), data)
    np.testing.assert_array_equal(found, moduli < largest[:, None])


def test_stated_errors_of_layered_walls_equal_the_errors_of_their_order():
    """Independent quadrature gives the errors of two nodes; the refined order has small errors."""
    data = opened_tube().assign(outer_radius=("test", np.full(4, np.nan)))
    priors = {"mu": pm.Uniform.dist(5.0, 20.0), "thickness": pm.Uniform.dist(0.1, 0.2)}
    wall = [
        ph.Layer(ph.Ogden(), priors["thickness"], mu=10.0, alpha=6.0),
        ph.Layer(ph.NeoHookean(), 0.1, mu=priors["mu"]),
    ]
    forward = forward_model(wall, data, priors)
    values = {"mu": np.array([6.0, 18.0]), "thickness": np.array([0.12, 0.19])}
    assert forward.errors(data, values).max() < 1e-10
    forward.integrator = replace(forward.integrator, order=2)
    axial, k = at_points(data, "axial_stretch"), opening_factor(at_points(data, "opening_angle"))
    points, expected = compared_points(data), []
    for mu, thickness in zip(*values.values(), strict=True):
        layers = [(ogden(10.0, 6.0), thickness), (neo_hookean(mu), 0.1)]
        exact = curves_and_slopes(layers, data["radius"].values, 1.0, axial, k)[:2]
        given = [ph.Layer(ph.Ogden(), thickness, mu=10.0, alpha=6.0)]
        given.append(ph.Layer(ph.NeoHookean(), 0.1, mu=mu))
        names = ("inner_radius", "axial_stretch", "opening_angle")
        tube = ph.Tube(**{name: at_points(data, name) for name in names})
        functions = ph.inflation_pressure, ph.inflation_stiffness
        few = [f(given, data["radius"].values, tube, order=2).eval() for f in functions]
        each = zip(few, exact, strict=True)
        errors = [np.abs(a - b)[points].max() / np.abs(b[points]).max() for a, b in each]
        expected.append(max(errors))
    np.testing.assert_allclose(forward.errors(data, values), expected, rtol=1e-3)
    # The refined rule is compared with a finer one, and not with itself.
    assert 0 < forward.refined(data, values).errors(data, values).max() < 1e-10


def test_curve_error_of_layers_with_vector_parameters_is_small():
    """The posterior of a vector parameter has an additional axis."""
    data = opened_tube().assign(outer_radius=("test", np.full(4, np.nan)))
    wall = [ph.Layer(ph.OgdenSeries(2), 0.2), ph.Layer(ph.NeoHookean(), 0.1, mu=5.0)]
    study = ph.inflation_model(wall, data, 0.5).study
    posterior = {"mu_1": np.full((1, 3, 2), 6.0), "alpha_1": np.full((1, 3, 2), 4.0)}
    assert study.curve_error(posterior) < 1e-8


def test_stated_errors_of_unknown_tubes_equal_errors_of_given_tubes():
    """Without a given tube the error is unknown and stated as infinite."""
    data = dataset([{"radius": np.linspace(1.1, 1.5, 5), "stretch": 1.2}], OPENED)
    data = data.assign(inner_radius=("test", [np.nan]))
    geometry = {"inner_radius": pm.Uniform.dist(0.8, 1.2)}
    forward = forward_model(ph.Ogden(), data, complete_priors(ph.Ogden()), geometry)
    forward.integrator = replace(forward.integrator, order=4)
    materials, radii = {"mu": np.array([6.0, 9.0]), "alpha": np.array([8.0, 3.0])}, [0.9, 1.1]
    assert np.isinf(forward.errors(data, materials)).all()
    found = forward.errors(data, materials, {"inner_radius": np.array(radii)})
    for number, radius in enumerate(radii):
        given = data.assign(inner_radius=("test", [radius]))
        own = {name: values[[number]] for name, values in materials.items()}
        fixed = forward_model(ph.Ogden(), given, complete_priors(ph.Ogden()), mode="quadrature")
        fixed.integrator = replace(fixed.integrator, order=4)
        np.testing.assert_allclose(found[number], fixed.errors(given, own), rtol=1e-9)
    assert (found > 1e-12).all()
