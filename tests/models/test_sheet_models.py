"""Models of sheets alone, and of sheets and tubes together."""

import numpy as np
import pandas as pd
import pymc as pm
import pytest
import two_parameters
import xarray as xr
from scipy import stats

import pymc_hyperelastic as ph
from pymc_hyperelastic.models.priors import complete_priors

LAW = ph.HolzapfelGasserOgden()
TISSUE = {"c": 10.0, "k1": 20.0, "k2": 1.0, "beta": 35.0}
# Directions that are pulled, by kind of test: stretches along x and y, None where it is free.
KINDS = {
    "uniaxial_x": lambda stretch: (stretch, None),
    "uniaxial_y": lambda stretch: (None, stretch),
    "equibiaxial": lambda stretch: (stretch, stretch),
    "pure_shear": lambda stretch: (stretch, np.ones_like(stretch)),
    "biaxial": lambda stretch: (stretch, stretch**0.5),
}
NOISE = 2.0  # kPa
TUBE = ph.Tube(1.0, 1.3, axial_stretch=1.2)


def stresses(law, kind, stretch, parameters, nominal=False):
    """Return stresses along x and y; NaN in a free direction."""
    given = KINDS[kind](stretch)
    found = ph.sheet_stress(law, *given, nominal=nominal, **parameters)
    return [
        np.full_like(stretch, np.nan) if pulled is None else stress.eval()
        for pulled, stress in zip(given, found, strict=True)
    ]


def sheets(
    law, parameters, kinds=tuple(KINDS), *, stress="cauchy", specimen="S1", seed=1, points=6
):
    """Return tests of a sheet of all kinds, with independent errors of its stresses."""
    rng, stretch, rows = np.random.default_rng(seed), np.linspace(1.05, 1.3, points), []
    for kind in kinds:
        x, y = KINDS[kind](stretch)
        of_x, of_y = stresses(law, kind, stretch, parameters, stress == "nominal")
        frame = pd.DataFrame(
            {
                "stretch_x": np.nan if x is None else x,
                "stretch_y": np.nan if y is None else y,
                "stress_x": of_x + NOISE * rng.standard_normal(points),
                "stress_y": of_y + NOISE * rng.standard_normal(points),
            }
        )
        rows.append(frame.assign(specimen=specimen, experiment=kind))
    return ph.sheet_data(pd.concat(rows, ignore_index=True), stress=stress, check="ignore")


def tubes(law, parameters, *, specimen="S1", seed=1, points=6, noise=0.3):
    """Return an inflation test of a tube with independent errors of its pressures, kPa."""
    radius = np.linspace(1.05, 1.4, points)
    pressure = ph.inflation_pressure(law, radius, TUBE, **parameters).eval()
    pressure = pressure + noise * np.random.default_rng(seed).standard_normal(points)
    frame = {"specimen": specimen, "experiment": "tube", "radius": radius, "pressure": pressure}
    return ph.inflation_data(pd.DataFrame(frame), TUBE, check="ignore")


def log_density_at(model, values):
    """Return the log density of the data of a model at parameters, by the model itself."""
    inputs = {model[name]: np.asarray(value, float) for name, value in values.items()}
    potentials = sum(float(p.eval(inputs)) for p in model.potentials)
    if not model.observed_RVs:
        return potentials
    point = {
        model.rvs_to_values[model[name]].name: model.rvs_to_transforms[model[name]]
        .forward(np.asarray(value, float), *model[name].owner.inputs)
        .eval()
        for name, value in values.items()
    }
    return float(model.compile_logp(vars=model.observed_RVs)(point))


@pytest.mark.parametrize("stress", ["cauchy", "nominal"])
@pytest.mark.parametrize("kind", KINDS)
def test_log_likelihood_is_the_normal_density_of_the_measured_stresses(kind, stress):
    """Each measured stress has an independent normal error, also of an anisotropic sheet."""
    data = sheets(LAW, TISSUE, [kind], stress=stress)
    model = ph.material_model(LAW, data, ph.Gaussian(stress_sd=NOISE))
    parameters = TISSUE | {"c": 12.0, "beta": 30.0}
    stretch = np.linspace(1.05, 1.3, 6)
    expected = stresses(LAW, kind, stretch, parameters, stress == "nominal")
    measured = data["stress_x"].values, data["stress_y"].values
    exact = sum(
        np.nansum(stats.norm.logpdf(y, mean, NOISE))
        for y, mean in zip(measured, expected, strict=True)
    )
    assert log_density_at(model, parameters) == pytest.approx(exact, rel=1e-10)


def test_an_error_of_stretches_shifts_both_stresses_along_the_curves():
    """The covariance of a point is that of the finite differences of its stresses."""
    data, stretch_sd = sheets(LAW, TISSUE, ["uniaxial_x", "biaxial"], points=3), 0.01
    likelihood = ph.Gaussian(stress_sd=NOISE, stretch_sd=stretch_sd)
    exact, step = 0.0, 1e-6
    changes = step * np.array([[0, 0], [1, 0], [-1, 0], [0, 1], [0, -1]])
    for test in range(data.sizes["test"]):
        own = data.isel(obs=data["test"].values == test)
        given = [own[f"stretch_{axis}"].values for axis in "xy"]
        moved = [
            None if np.isnan(stretch).all() else (stretch[:, None] + change).ravel()
            for stretch, change in zip(given, changes.T, strict=True)
        ]
        both = np.stack([s.eval() for s in ph.sheet_stress(LAW, *moved, **TISSUE)], axis=-1)
        measured = np.stack([own["stress_x"].values, own["stress_y"].values], axis=-1)
        for value, at in zip(measured, both.reshape(-1, len(changes), 2), strict=True):
            slopes, there = (at[1::2] - at[2::2]) / (2 * step), np.isfinite(value)
            covariance = NOISE**2 * np.eye(2) + stretch_sd**2 * slopes.T @ slopes
            density = stats.multivariate_normal(at[0, there], covariance[there][:, there])
            exact += density.logpdf(value[there])
    for observed in (False, True):
        declared = ph.Gaussian(stress_sd=NOISE, stretch_sd=stretch_sd, observed=observed)
        model = ph.material_model(LAW, data, declared)
        assert log_density_at(model, TISSUE) == pytest.approx(exact, rel=1e-6)
    assert likelihood.in_words == "Gaussian: stress_sd = 2 kPa, stretch_sd = 0.01"


@pytest.mark.parametrize("kind", KINDS)
def test_evidence_of_a_linear_law_equals_its_closed_form(kind):
    """Stresses are linear in the modulus: its evidence is a multivariate normal density."""
    law, mean, sd = ph.NeoHookean(), 30.0, 3.0
    data = sheets(law, {"mu": 28.0}, [kind])
    prior = {"mu": pm.Normal.dist(mean, sd)}
    model = ph.material_model(law, data, ph.Gaussian(stress_sd=NOISE), priors=prior)
    result = ph.sample_smc(model, draws=500, chains=2, random_seed=1, progressbar=False)
    of_one = np.concatenate(stresses(law, kind, np.linspace(1.05, 1.3, 6), {"mu": 1.0}))
    measured = np.concatenate([data["stress_x"].values, data["stress_y"].values])
    there = np.isfinite(measured)
    gain = of_one[there]
    covariance = NOISE**2 * np.eye(gain.size) + sd**2 * np.outer(gain, gain)
    exact = stats.multivariate_normal(mean * gain, covariance).logpdf(measured[there])
    value, error = ph.log_evidence(result)
    assert abs(value - exact) < max(4 * error, 0.02)


def joint_data():
    """Return a tube and a strip of one specimen."""
    parameters = {"mu": 20.0, "alpha": 6.0}
    strip = sheets(ph.Ogden(), parameters, ["uniaxial_x", "equibiaxial"])
    return ph.combine_tests(tubes(ph.Ogden(), parameters), strip)


JOINT = ph.Gaussian(pressure_sd=0.3, stress_sd=NOISE)
BOUNDS = {"mu": (5, 50), "alpha": (2, 12)}
PRIORS = {name: pm.Uniform.dist(*ends) for name, ends in BOUNDS.items()}


def test_joint_likelihood_is_the_sum_of_both_kinds():
    """Tests of tubes and of sheets share the parameters only, in any order."""
    both, values = joint_data(), {"mu": 22.0, "alpha": 5.5}
    alone = [
        ph.select(both, experiment=names) for names in (["tube"], ["uniaxial_x", "equibiaxial"])
    ]
    parts = [
        log_density_at(ph.material_model(ph.Ogden(), data, error, priors=PRIORS), values)
        for data, error in zip(
            (ph.combine_tests(tubes(ph.Ogden(), {"mu": 20.0, "alpha": 6.0})), alone[1]),
            (ph.Gaussian(0.3), ph.Gaussian(stress_sd=NOISE)),
            strict=True,
        )
    ]
    for order in (both, ph.combine_tests(alone[1], alone[0])):
        for observed in (False, True):
            likelihood = ph.Gaussian(pressure_sd=0.3, stress_sd=NOISE, observed=observed)
            model = ph.material_model(ph.Ogden(), order, likelihood, priors=PRIORS)
            assert log_density_at(model, values) == pytest.approx(sum(parts), rel=1e-10)


def test_joint_evidence_equals_quadrature_of_two_parameters():
    """The evidence of a joint model is the integral of its likelihood over the prior."""
    data = joint_data()
    model = ph.material_model(ph.Ogden(), data, JOINT, priors=PRIORS)
    exact = two_parameters.log_evidence(model, BOUNDS)
    result = ph.sample_smc(model, draws=1000, chains=2, random_seed=1, progressbar=False)
    value, error = ph.log_evidence(result)
    assert abs(value - exact) < max(4 * error, 0.02)
    sizes = result["posterior"].sizes
    assert (sizes["tube_obs"], sizes["sheet_obs"]) == (6, 12)


def test_joint_result_is_read_from_its_file(tmp_path):
    """The data of a joint result, its model and its checks survive a file."""
    data = joint_data()
    model = ph.material_model(ph.Ogden(), data, JOINT, priors=PRIORS)
    result = ph.sample_smc(model, draws=100, chains=1, random_seed=1, progressbar=False)
    result.to_netcdf(tmp_path / "joint.nc")
    read = ph.open_result(tmp_path / "joint.nc")
    for group in ("observed_data", "constant_data", "posterior"):
        xr.testing.assert_equal(read[group].to_dataset(), result[group].to_dataset())
    assert set(read["evidence"]["signal"].values) >= {"pressure", "stress_x"}


@pytest.mark.parametrize(
    ("likelihood", "message"),
    [
        (ph.Gaussian(0.3), "the data hold tests of sheets, and the likelihood"),
        (ph.Gaussian(stress_sd=NOISE), "the data hold tests of tubes, and the likelihood"),
    ],
)
def test_joint_data_need_errors_of_both_kinds(likelihood, message):
    """A likelihood that leaves out a kind of test is refused."""
    with pytest.raises(ValueError, match=message):
        ph.material_model(ph.Ogden(), joint_data(), likelihood)


def test_errors_of_tests_that_the_data_lack_are_refused():
    """Data without sheets need no error of stresses."""
    with pytest.raises(ValueError, match=r"states the errors of tests of sheets.*hold none"):
        ph.material_model(ph.Ogden(), tubes(ph.Ogden(), {"mu": 20.0, "alpha": 6.0}), JOINT)


def test_an_error_of_pressures_alone_is_answered_with_the_error_that_sheets_need():
    """A bare number is an error of pressures, which sheets do not have."""
    data = sheets(ph.Ogden(), {"mu": 20.0, "alpha": 6.0}, ["equibiaxial"])
    for likelihood in (NOISE, ph.SlopeAugmented(sigma=NOISE, slope_weight=1.0)):
        with pytest.raises(ValueError, match=r"tests of sheets.*give ph.Gaussian\(stress_sd="):
            ph.material_model(ph.Ogden(), data, likelihood)


def test_layers_and_rising_pressures_are_for_tubes():
    """A sheet is one material, and its stresses are no pressures."""
    data = sheets(ph.Ogden(), {"mu": 20.0, "alpha": 6.0}, ["equibiaxial"])
    likelihood = ph.Gaussian(stress_sd=NOISE)
    with pytest.raises(ValueError, match="one material"):
        ph.material_model([ph.Layer(ph.Ogden(), 0.3)], data, likelihood)
    with pytest.raises(ValueError, match="rising=True is about the pressures of tubes"):
        ph.material_model(ph.Ogden(), data, likelihood, rising=True)
    with pytest.raises(ValueError, match="'thickness', a measure of a tube"):
        prior = {"thickness": ph.MeasuredValue(0.1)}
        ph.material_model(ph.Ogden(), data, likelihood, priors=prior)


def test_stretch_sd_needs_stress_sd():
    """An error of stretches stands beside one of stresses."""
    with pytest.raises(ValueError, match="stretch_sd is given without stress_sd"):
        ph.Gaussian(0.3, stretch_sd=0.01)


@pytest.mark.parametrize("measure", ["cauchy", "nominal"])
def test_uncertain_thickness_and_gauge_length_scale_stresses_and_strains(measure):
    """The true measures are the measured ones times a factor of each specimen.

    A measured Cauchy stress is the nominal stress times the measured stretch.
    """
    data = sheets(LAW, TISSUE, ["biaxial"], stress=measure)
    sds = {"sheet_thickness": 0.1, "gauge_length": 0.05}
    priors = {name: ph.MeasuredValue(sd) for name, sd in sds.items()}
    model = ph.material_model(LAW, data, ph.Gaussian(stress_sd=NOISE), priors=priors)
    z = {"sheet_thickness": 1.5, "gauge_length": -0.8}
    values = TISSUE | {f"{name}_deviation": [value] for name, value in z.items()}
    factor = {name: np.exp(sds[name] * value) for name, value in z.items()}
    stretch = [1 + (data[f"stretch_{axis}"].values - 1) / factor["gauge_length"] for axis in "xy"]
    expected = ph.sheet_stress(LAW, *stretch, nominal=True, **TISSUE)
    exact = 0.0
    for axis, mean in zip("xy", expected, strict=True):
        by = data[f"stretch_{axis}"].values if measure == "cauchy" else 1.0
        mean = factor["sheet_thickness"] * mean.eval() * by
        exact += stats.norm.logpdf(data[f"stress_{axis}"].values, mean, NOISE).sum()
    assert log_density_at(model, values) == pytest.approx(exact, rel=1e-10)
    for name, value in z.items():
        ratio = model[name].eval({model[f"{name}_deviation"]: [value]})
        assert ratio == pytest.approx(factor[name])


def test_joint_model_takes_errors_of_tubes_and_of_sheets():
    """The thickness of the tube and that of the sheet are errors of their own."""
    priors = PRIORS | {
        "thickness": ph.MeasuredValue(0.01),
        "sheet_thickness": ph.MeasuredValue(0.1),
    }
    model = ph.material_model(ph.Ogden(), joint_data(), JOINT, priors=priors)
    of_specimen = {"thickness_deviation", "sheet_thickness_deviation"}
    assert of_specimen <= {rv.name for rv in model.free_RVs}
    values = {"mu": 20.0, "alpha": 6.0} | {name: [0.0] for name in of_specimen}
    without = ph.material_model(ph.Ogden(), joint_data(), JOINT, priors=PRIORS)
    exact = log_density_at(without, {"mu": 20.0, "alpha": 6.0})
    assert log_density_at(model, values) == pytest.approx(exact, rel=1e-8)
    for name in of_specimen:
        assert log_density_at(model, values | {name: [1.0]}) != pytest.approx(exact, rel=1e-4)


def test_errors_of_a_sheet_are_relative_standard_deviations():
    """A distribution, a missing number and a measure of the other kind are refused."""
    data, likelihood = sheets(LAW, TISSUE, ["biaxial"]), ph.Gaussian(stress_sd=NOISE)
    with pytest.raises(ValueError, match="an error of 100 % or more: its sd is relative"):
        ph.material_model(LAW, data, likelihood, priors={"sheet_thickness": ph.MeasuredValue(20.0)})
    for prior in (ph.MeasuredValue(), pm.Normal.dist(1.0, 0.1)):
        with pytest.raises(TypeError, match=r"'sheet_thickness'.*expected its relative standard"):
            ph.material_model(LAW, data, likelihood, priors={"sheet_thickness": prior})
    tube = tubes(ph.Ogden(), {"mu": 20.0, "alpha": 6.0})
    with pytest.raises(ValueError, match="'gauge_length', a measure of a sheet"):
        ph.material_model(ph.Ogden(), tube, 0.3, priors={"gauge_length": ph.MeasuredValue(0.1)})


@pytest.mark.deep
@pytest.mark.long
@pytest.mark.parametrize("joint", [False, True], ids=["sheet", "sheet and tube"])
def test_posteriors_of_sheets_pass_simulation_based_calibration(joint):
    """Ranks of the true parameters among posterior draws are uniform."""
    law, parameters = ph.Ogden(), {"mu": 20.0, "alpha": 6.0}
    data = joint_data() if joint else sheets(law, parameters, ["uniaxial_y", "equibiaxial"])
    sizes = {"stress_sd": pm.LogNormal.dist(np.log(NOISE), 0.3)}
    sizes |= {"pressure_sd": 0.3} if joint else {}
    model = ph.material_model(law, data, ph.Gaussian(**sizes, observed=True), priors=PRIORS)
    found = ph.simulation_based_calibration(
        model, simulations=200, draws=500, random_seed=1, progressbar=False
    )
    assert found["p_value"].min() > 0.001


@pytest.mark.parametrize(
    ("law", "kinds"),
    [
        (ph.OgdenSeries(terms=2), ("uniaxial_x", "equibiaxial", "pure_shear")),
        (LAW, ("equibiaxial", "pure_shear", "biaxial")),
    ],
    ids=["OgdenSeries", "HolzapfelGasserOgden"],
)
def test_misfits_of_many_points_equal_those_of_all_points(law, kinds):
    """With many points the squared misfits come from responses at a few nodes."""
    if law is LAW:
        parameters, priors = TISSUE, {"k2": pm.Uniform.dist(0, 3)}
    else:
        parameters = {"mu": [10.0, 1.0], "alpha": [2.0, 6.0]}
        priors = {"alpha": pm.Uniform.dist(1, 8, shape=2)}
    data = sheets(law, parameters, kinds, stress="nominal", points=100)
    likelihood = ph.Gaussian(stress_sd=NOISE)
    forward = likelihood.forward_model(law, data, complete_priors(law, priors))
    assert forward.table is not None
    by_nodes = likelihood.log_likelihood(forward.with_variables(parameters)).eval()
    inputs = forward.share("misfits", forward.table.arrays)
    assert inputs["log_x"].get_value().size < 60
    every = forward.refined(data, parameters)
    assert every.table is None
    exact = likelihood.log_likelihood(every.with_variables(parameters)).eval()
    assert by_nodes == pytest.approx(exact, rel=1e-9)
    # One test in place of all.
    fewer = ph.select(data, experiment=kinds[1])
    forward.set_data(fewer)
    every = every.with_data(fewer)
    changed = likelihood.log_likelihood(forward.with_variables(parameters)).eval()
    assert changed == pytest.approx(
        likelihood.log_likelihood(every.with_variables(parameters)).eval(), 1e-9
    )


def test_a_free_direction_of_an_anisotropic_sheet_is_computed_at_every_point():
    """Its stretch depends on the material, so that no constant matrix gives its stress."""
    data = sheets(LAW, TISSUE, ["uniaxial_x"], points=300)
    forward = ph.Gaussian(stress_sd=NOISE).forward_model(LAW, data, complete_priors(LAW))
    assert forward.table is None
