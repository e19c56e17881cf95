"""predict_stress, and predictions of tubes from results of sheets."""

import warnings

import fits
import numpy as np
import pytest
import xarray as xr
from problems import AS_WRITTEN
from sheet_tables import by_hand, joint_by_hand
from tube_posteriors import ROUNDING, fitted_to, result

import pymc_hyperelastic as ph

pytestmark = pytest.mark.compiled  # in both tiers: predictions are compiled for each law

FIBRES = ph.HolzapfelGasserOgden()
DRAWS = {"c": [10.0, 12.0, 8.0], "k1": [20.0, 5.0, 30.0], "k2": [1.0, 2.0, 0.5]}
DRAWS |= {"beta": [35.0, 40.0, 50.0]}
X, Y = np.array([1.0, 1.1, 1.3]), np.array([1.0, 1.2, 0.9])
NAN = np.nan
# A free stretch is found to rounding, which the stress of the stiffening fibres multiplies.
SOLVED = 1e-10


@pytest.fixture(scope="module")
def treloar() -> xr.DataTree:
    """Return a posterior of rubber with its three tests."""
    data = ph.load_dataset("treloar_rubber")
    return fitted_to(data, "NeoHookean", result(mu=[380.0, 400.0]))


@pytest.mark.parametrize("nominal", [False, True])
@pytest.mark.parametrize(("x", "y"), [(X, Y), (X, None), (None, Y)], ids=["both", "x", "y"])
def test_each_draw_is_that_of_sheet_stress(x, y, nominal):
    found = ph.predict_stress(result(**DRAWS), x, y, nominal=nominal, energy=FIBRES)
    assert found["stress_x"].dims == found["stress_y"].dims == ("chain", "draw", "point")
    assert found["stress_x"].attrs["units"] == "kPa"
    assert found.attrs["stress_measure"] == ("nominal" if nominal else "cauchy")
    for draw in range(3):
        at = {name: values[draw] for name, values in DRAWS.items()}
        expected = ph.sheet_stress(FIBRES, x, y, nominal=nominal, **at)
        for axis in "xy":
            stress = getattr(expected, axis).eval(mode=AS_WRITTEN)
            tolerance = ROUNDING if x is not None and y is not None else SOLVED
            np.testing.assert_allclose(found[f"stress_{axis}"][0, draw], stress, rtol=tolerance)


def test_lateral_stretch_of_each_draw_is_returned():
    found = ph.predict_stress(result(**DRAWS), X, energy=FIBRES)
    assert found["stretch_x"].dims == ("point",)
    assert found["stretch_y"].dims == ("chain", "draw", "point")
    for draw in range(3):
        at = {name: values[draw] for name, values in DRAWS.items()}
        expected = ph.free_stretch(FIBRES, X, **at).eval(mode=AS_WRITTEN)
        np.testing.assert_allclose(found["stretch_y"][0, draw], expected, rtol=SOLVED)


def test_missing_stretches_are_free_at_their_points():
    """Data of several tests are predicted in one call, as the data hold them."""
    found = ph.predict_stress(result(**DRAWS), [1.2, 1.2, NAN], [1.1, NAN, 1.1], energy=FIBRES)
    for point, stretches in enumerate([(1.2, 1.1), (1.2, None), (None, 1.1)]):
        alone = ph.predict_stress(result(**DRAWS), *stretches, energy=FIBRES)
        for name in ("stress_x", "stress_y"):
            np.testing.assert_allclose(found[name][..., point], alone[name][..., 0], rtol=SOLVED)


def test_vector_parameters_are_predicted_by_draw():
    law = ph.OgdenSeries(2)
    tree = result(mu=[[12.0, -2.0], [6.0, -1.0]], alpha=[[3.0, -6.0], [3.0, -6.0]])
    found = ph.predict_stress(tree, X, Y, energy=law)["stress_x"]
    np.testing.assert_allclose(found[0, 0], 2 * found[0, 1], rtol=ROUNDING)


def test_draws_without_a_lateral_stretch_are_nan():
    """A negative modulus is a sheet that is unstable at every stretch."""
    tree = result(c=[10.0, -10.0], k1=[20.0, -20.0], k2=[1.0, 1.0], beta=[35.0, 35.0])
    with pytest.warns(UserWarning, match=r"of 2 draws 1 have no lateral stretch .* stretch 1.3"):
        found = ph.predict_stress(tree, [1.3], energy=FIBRES)
    np.testing.assert_array_equal(np.isnan(found["stress_x"][0, :, 0]), [False, True])


# --- measured range -------------------------------------------------------------------------------


def extrapolated(tree, *stretches) -> list[bool]:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return ph.predict_stress(tree, *stretches)["extrapolated"].values.tolist()


def test_measured_points_and_those_between_are_not_extrapolated(treloar):
    data = treloar["constant_data"].to_dataset()
    assert not any(extrapolated(treloar, data["stretch_x"], data["stretch_y"]))
    assert not any(extrapolated(treloar, np.linspace(1.0, 7.6, 50)))
    assert not any(extrapolated(treloar, *[np.linspace(1.0, 4.4, 50)] * 2))


def test_points_outside_the_measured_stretches_are_extrapolated(treloar):
    assert extrapolated(treloar, [7.0, 8.0]) == [False, True]
    assert extrapolated(treloar, [4.0, 5.0], [4.0, 5.0]) == [False, True]
    with pytest.warns(UserWarning, match="1 of 1 points is extrapolated: stretch along x 9"):
        ph.predict_stress(treloar, 9.0)


def test_isotropic_sheet_is_measured_along_both_axes_by_a_test_along_one(treloar):
    assert extrapolated(treloar, None, [7.0, 8.0]) == [False, True]
    data = ph.select(treloar["constant_data"].to_dataset(), experiment="uniaxial")
    tree = fitted_to(data, "HolzapfelGasserOgden", result(**DRAWS))
    assert extrapolated(tree, [1.0, 1.3]) == [False, False]
    assert extrapolated(tree, None, [1.0, 1.3]) == [False, True]


# --- results of tubes, and of both ----------------------------------------------------------------


def of_tubes() -> xr.DataTree:
    data = ph.select(ph.load_dataset("simulated_sheep_aorta"), specimen="S4")
    return fitted_to(data, "NeoHookean", result(mu=[20.0, 30.0]))


def test_strip_of_a_vessel_is_predicted_from_its_inflation_tests():
    found = ph.predict_stress(of_tubes(), 1.0, [1.0, 1.05])
    np.testing.assert_allclose(
        found["stress_y"][0, :, 1], [mu * (1.05**2 - 1.05**-2) for mu in (20.0, 30.0)]
    )
    assert extrapolated(of_tubes(), [1.05, 1.2], 1.0) == [False, False]
    assert extrapolated(of_tubes(), [3.0], 1.0) == [True]


def test_joint_result_predicts_both_kinds():
    tree = fitted_to(joint_by_hand(), "NeoHookean", result(mu=[20.0, 30.0]))
    alone = of_tubes()
    pressure = ph.predict_pressure(tree, [7.5, 8.0], specimen="S4")
    expected = ph.predict_pressure(alone, [7.5, 8.0])
    np.testing.assert_array_equal(pressure["pressure"], expected["pressure"])
    np.testing.assert_array_equal(
        ph.tube_properties(tree, 3.0, specimen="S4")["radius"],
        ph.tube_properties(alone, 3.0)["radius"],
    )
    stress = ph.predict_stress(tree, [1.1, 1.3])
    assert not stress["extrapolated"].any()
    np.testing.assert_allclose(
        stress["stress_x"][0, 0], 20.0 * (stress["stretch_x"] ** 2 - 1 / stress["stretch_x"])
    )


def test_force_offsets_of_a_joint_result_are_those_of_its_tubes():
    names = [f"test {i}" for i in range(2)]
    dims, draws = ("chain", "draw", "tube_test"), np.ones((1, 3, 2))
    offsets = {n: (dims, draws) for n in ("force_offset_mean", "force_offset_error")}
    tree = xr.DataTree.from_dict({"posterior": xr.Dataset(offsets, {"tube_test": names})})
    found = ph.force_offsets(tree)["force_offset"]
    assert found.dims == ("chain", "draw", "test")
    assert found["test"].values.tolist() == names


@pytest.mark.parametrize(("specimen", "mu"), [(None, 38.0), ("A1", 30.0), ("A3", 50.0)])
def test_specimens_of_a_class_of_tubes_have_their_own_stresses(specimen, mu):
    """The name selects a measured specimen; without it the typical one is predicted."""
    tree = fits.fit("neo_hookean_classes")["soft"]
    found = ph.predict_stress(tree, 1.1, 1.0, specimen=specimen)
    moduli = found["stress_x"].values / (1.1**2 - 1.1**-2)
    assert abs(moduli.mean() - mu) < 4 * moduli.std()
    assert found.attrs["specimen"] == (specimen or "typical")


def test_specimen_names_the_sheet():
    tree = fitted_to(joint_by_hand(), "NeoHookean", result(mu=[20.0, 30.0]))
    assert ph.predict_stress(tree, 1.1, specimen="S1").attrs["specimen"] == "S1"
    with pytest.raises(ValueError, match="no specimen 'S9'"):
        ph.predict_stress(tree, 1.1, specimen="S9")


@pytest.mark.parametrize(
    ("function", "points"),
    [
        (ph.predict_pressure, [8.0]),
        (ph.predict_axial_force, [8.0]),
        (ph.radius_at_pressure, [2.0]),
        (ph.tube_properties, [2.0]),
        (ph.wall_stress, [2.0]),
        (ph.is_admissible, None),
    ],
)
def test_functions_of_tubes_need_a_tube(treloar, function, points):
    message = r"the result holds no tube, only tests of sheets: state a tube, .*ph.Tube\(inner"
    with pytest.raises(ValueError, match=message):
        function(treloar, points)


def test_stated_tube_is_inflated_from_a_result_of_sheets(treloar):
    found = ph.predict_pressure(treloar, [8.0], tube=ph.Tube(7.0, 9.0))
    without_data = result(mu=[380.0, 400.0])
    expected = ph.predict_pressure(
        without_data, [8.0], tube=ph.Tube(7.0, 9.0), energy=ph.NeoHookean()
    )
    xr.testing.assert_identical(found, expected)
    with pytest.raises(ValueError, match="specimen 'S1' of the result holds no tube"):
        ph.predict_pressure(
            fitted_to(joint_by_hand(), "NeoHookean", result(mu=[20.0])), [8.0], specimen="S1"
        )


# --- refused --------------------------------------------------------------------------------------

REFUSED = [
    ((None, None), TypeError, "both stretches are None"),
    (([1.0, -2.0],), ValueError, "stretch_x must be a list of positive stretches"),
    ((1.0, "wide"), ValueError, "stretch_y must be a list of positive stretches"),
    (([1.0, np.inf],), ValueError, "stretch_x must be finite"),
    (([1.0, 2.0], [1.0, 2.0, 3.0]), ValueError, "2 stretches along x and 3 along y"),
    (([1.0, NAN],), ValueError, "both stretches of point 1 are NaN"),
]


@pytest.mark.parametrize(("stretches", "error", "message"), REFUSED)
def test_impossible_stretches_are_refused(stretches, error, message):
    with pytest.raises(error, match=message):
        ph.predict_stress(result(mu=[20.0]), *stretches, energy=ph.NeoHookean())


def test_walls_of_layers_are_refused():
    layers = [ph.Layer(ph.NeoHookean(), 1.0), ph.Layer(ph.NeoHookean(), 1.0)]
    with pytest.raises(ValueError, match=r"wall of layers, and a sheet is of one material"):
        ph.predict_stress(result(mu_1=[20.0], mu_2=[30.0]), 1.1, energy=layers)


def test_data_by_hand_are_within_the_measured_range():
    tree = fitted_to(by_hand(), "HolzapfelGasserOgden", result(**DRAWS))
    data = by_hand()
    assert not any(extrapolated(tree, data["stretch_x"], data["stretch_y"]))
