"""The posterior and the evidence of each specimen of a cohort."""

import warnings

import fits
import numpy as np
import pandas as pd
import pymc as pm
import pytest
import xarray as xr
from simulated_work import cohort

import pymc_hyperelastic as ph
from pymc_hyperelastic.data.representatives import representatives

# The noise of the stored fits.
LIKELIHOOD = ph.SlopeAugmented(sigma=5 * ph.mmHg, slope_weight=3.0)
QUIET = {"progressbar": False, "random_seed": 3}
# A correct standard error is exceeded threefold once in 370 runs; seeds are fixed.
STANDARD_ERRORS = 3
# Errors of medians of some 500 draws, as shares of the standard deviation: four standard errors.
MEDIAN_ERROR = 4 * 1.25 / np.sqrt(500)
# Relative differences between sums of the same terms in another order.
ROUNDING = 1e-6
STUDY = ph.load_dataset("simulated_sheep_aorta")


def serial(folder):
    """Return a store whose parts this process computes."""
    return ph.Store(folder, cores=1)


@pytest.fixture(scope="module")
def fitted(tmp_path_factory):
    store = tmp_path_factory.mktemp("fitted") / "store"
    some = ph.select(STUDY, specimen=["S1", "S4"])
    settings = QUIET | {"at": ph.Conditions([80, 120], pressure_unit="mmHg")}
    return ph.fit_cohort(ph.Ogden(), some, LIKELIHOOD, serial(store), **settings)


def test_property_beyond_the_measured_pressures_marks_a_fit_as_doubtful(tmp_path):
    at = ph.Conditions([300], pressure_unit="mmHg")
    one = ph.select(STUDY, specimen="S1")
    with pytest.warns(UserWarning, match="1 of 1 have a doubtful fit.*S1: .*measured"):
        ph.fit_cohort(ph.Ogden(), one, LIKELIHOOD, serial(tmp_path), at=at, **QUIET)
    (said,) = ph.open_result(tmp_path)["evidence"]["doubtful"].values.tolist()
    assert "measured" in said


def test_each_specimen_has_flags_of_its_own_measured_range(tmp_path):
    """The curves of S1 are cut at low pressures; those of S4 are whole."""
    low = STUDY["pressure"] < 60 * ph.mmHg
    first = STUDY["specimen"][STUDY["test"]].drop_vars("test", errors="ignore") == "S1"
    cut = STUDY.isel(obs=np.flatnonzero((low | ~first).values))
    some = ph.select(cut, specimen=["S1", "S4"], experiment=1)
    at = ph.Conditions([50, 100], pressure_range=(80, 100), pressure_unit="mmHg")
    with pytest.warns(UserWarning, match="2 of 2 have a doubtful fit.*S1: .*extrapolated"):
        found = ph.fit_cohort(ph.Ogden(), some, LIKELIHOOD, serial(tmp_path), at=at, **QUIET)
    properties = found["properties"]
    assert properties["extrapolated"].values.tolist() == [[False, True], [False, False]]
    assert properties["range_extrapolated"].values.tolist() == [True, False]


def test_specimens_without_forces_are_refused_in_any_order(tmp_path):
    """The likelihood has an error of forces, which one of two specimens lacks."""
    radius = np.linspace(7.2, 9.0, 8)
    curves = [
        curve(ph.NeoHookean(), radius, ph.Tube(7, 9), mu=30.0).eval()
        for curve in (ph.inflation_pressure, ph.axial_force)
    ]
    frame = {"experiment": 1, "radius": radius, "pressure": curves[0]}
    tables = [
        pd.DataFrame({"specimen": name, "axial_force": force} | frame)
        for name, force in (("A", curves[1]), ("B", np.nan))
    ]
    for i, order in enumerate((tables, tables[::-1])):
        data = ph.inflation_data(pd.concat(order), ph.Tube(7, 9), check="ignore")
        errors, store = ph.Gaussian(0.5, force_sd=50.0), serial(tmp_path / str(i))
        with pytest.warns(UserWarning, match="1 of 2 failed.* B: .*hold no axial forces"):
            found = ph.fit_cohort(ph.NeoHookean(), data, errors, store, **QUIET)
        assert found["evidence"]["error"].sel(specimen="A").item() == ""


def test_evidence_of_a_specimen_equals_quadrature(fitted):
    one = ph.select(STUDY, specimen="S4")
    exact = ph.log_evidence_by_quadrature(ph.inflation_model(ph.Ogden(), one, LIKELIHOOD))
    evidence = fitted["evidence"].sel(specimen="S4")
    error = np.hypot(evidence["log_evidence_se"].item(), exact.standard_error)
    # Errors of interpolated curves change the evidence by less than 0.001 nats.
    assert abs(evidence["log_evidence"].item() - exact.value) < STANDARD_ERRORS * error + 1e-3
    assert evidence["error"].item() == ""
    assert evidence["log_evidence_se"].item() < 0.05
    assert fitted.attrs == {"title": STUDY.title, "simulated": 1, "law": "Ogden"}


def test_posterior_and_properties_of_a_specimen_equal_a_sampled_model(fitted):
    tree = fits.fit("sampled")
    for name in ("mu", "alpha"):
        # The posterior of Ogden's law has two mirrored modes.
        own = abs(fitted["posterior"][name].sel(specimen="S1"))
        other = abs(tree["posterior"][name])
        assert abs(own.median() - other.median()) < MEDIAN_ERROR * other.std()
        assert own.std().item() == pytest.approx(other.std().item(), rel=0.2)
    ours = fitted["properties"]["compliance"].sel(specimen="S1")
    own = fitted["posterior"].to_dataset().sel(specimen="S1", drop=True)[["mu", "alpha"]]
    tree["posterior"] = xr.DataTree(own.load())
    in_mmhg = ph.Conditions([80, 120], pressure_unit="mmHg")
    there = ph.tube_properties(tree, in_mmhg)["compliance"]
    assert ours["interval"].values.tolist() == ["2.5 %", "50 %", "97.5 %"]
    expected = there.quantile([0.025, 0.5, 0.975], ["chain", "draw"])
    np.testing.assert_allclose(ours.transpose("interval", ...), expected, rtol=ROUNDING)
    assert ours["pressure"].values.tolist() == [80, 120]
    assert ours["pressure"].attrs["units"] == "mmHg"


def test_noise_of_each_test_is_inferred_and_a_changed_likelihood_refused(tmp_path):
    unknown = pm.HalfNormal.dist(1.0)
    settings = QUIET | {"draws": 50, "by": "test"}
    one = ph.select(STUDY, specimen="S1", experiment=[1, 2])
    ph.fit_cohort(ph.Ogden(), one, unknown, serial(tmp_path / "store"), **settings)
    found = ph.open_result(tmp_path / "store")["posterior"]["pressure_sd"]
    assert found.sizes == {"chain": 1, "draw": 50, "test": 2}
    # The simulated errors of pressures are of the order of 1 mmHg.
    assert (abs(np.log(found.median("draw") / ph.mmHg)) < 1.5).all()
    with pytest.raises(ValueError, match=r"holds other work: .*likelihood, name is 'Gaussian'"):
        ph.fit_cohort(ph.Ogden(), one, LIKELIHOOD, serial(tmp_path / "store"), **settings)


def test_store_refuses_a_law_of_the_same_name_with_another_formula(tmp_path, monkeypatch):
    """The class of a user has the same name, and its parameters the same priors."""
    monkeypatch.setattr(ph.StrainEnergy, "_registry", {**ph.StrainEnergy._registry})

    def mine(power):
        class Mine(ph.StrainEnergy):
            parameters = (ph.Parameter("mu", "m", "kPa", (0.0, 200.0), "modulus"),)

            def energy(self, radial, hoop, axial, *, mu):
                return mu / 2 * (radial**power + hoop**power + axial**power - 3)

        return Mine()

    one = ph.select(STUDY, specimen="S1", experiment=1)
    settings = QUIET | {"draws": 50}
    ph.fit_cohort(mine(2), one, 5.0, serial(tmp_path), **settings)
    with pytest.raises(ValueError, match="layers, 1 has another formula there than here"):
        ph.fit_cohort(mine(4), one, 5.0, serial(tmp_path), **settings)


def test_wrong_settings_are_refused(tmp_path):
    for settings, message in (
        ({"by": "animal"}, "by must be 'specimen' or 'test', not 'animal'"),
        ({"at": ph.Conditions()}, "at states no pressure"),
    ):
        with pytest.raises(ValueError, match=message):
            ph.fit_cohort(ph.Ogden(), STUDY, LIKELIHOOD, tmp_path / "store", **QUIET | settings)


def test_representatives_include_the_extremes_of_a_large_cohort():
    assert representatives(STUDY) is STUDY
    data = cohort(150)
    pressure, test = data["pressure"].values, data["test"].values
    # The evenly spaced tests do not include tests 4 and 7.
    pressure[test == 4] *= 100.0
    pressure[test == 7] -= 1000.0
    found = representatives(data)
    assert 200 <= found.sizes["test"] < 210
    for name in ("pressure", "radius"):
        for extreme in (np.min, np.max):
            assert extreme(found[name]) == extreme(data[name])


def test_representatives_of_sheets_include_extremes_and_each_free_direction():
    stretch = np.linspace(1.1, 1.3, 3)
    frame = pd.concat(
        [
            pd.DataFrame(
                {
                    "specimen": str(i),
                    "experiment": 1,
                    "stretch_x": np.nan if i == 4 else stretch,
                    "stretch_y": np.nan if i == 7 else stretch,
                    "stress_x": np.nan if i == 4 else 10 * stretch * (100 if i == 11 else 1),
                    "stress_y": np.nan if i == 7 else 10 * stretch,
                }
            )
            for i in range(450)
        ]
    )
    sheets = ph.sheet_data(frame, stress="cauchy", check="ignore")
    for data in (sheets, ph.combine_tests(cohort(150), sheets)):
        found = representatives(data)
        assert 200 <= found.sizes["test"] < 220
        for name in ("stretch_x", "stretch_y", "stress_x"):
            for extreme in (np.nanmin, np.nanmax):
                assert extreme(found[name]) == extreme(data[name])
        of_sheets = ph.select(found, stress_measure="cauchy")
        assert of_sheets["stretch_x"].isnull().any()
        assert of_sheets["stretch_y"].isnull().any()


def test_properties_of_sheets_need_a_stated_tube(tmp_path):
    """The error comes before any sampling; with a stated tube the properties are those of it."""
    strip = {"specimen": "S", "experiment": 1, "stretch": [1.1, 1.2, 1.3], "stress": [5, 10, 15.0]}
    sheets = ph.sheet_data(pd.DataFrame(strip), stress="nominal", kind="uniaxial")
    law, errors, store = ph.NeoHookean(), ph.Gaussian(stress_sd=1.0), serial(tmp_path)
    for data in (sheets, ph.combine_tests(cohort(2), sheets)):
        with pytest.raises(ValueError, match=r"specimen 'S' holds no tube.*leave `at` away"):
            ph.fit_cohort(law, data, errors, store, at=2.0, **QUIET)
    assert not list(tmp_path.iterdir())
    at = ph.Conditions(2.0, tube=ph.Tube(1.0, 1.3))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # three invented points are no good fit
        found = ph.fit_cohort(law, sheets, errors, store, at=at, **QUIET)
    assert float(found["properties"]["radius"].sel(interval="50 %").squeeze()) > 1.0


@pytest.mark.deep
def test_processes_and_batches_do_not_change_numbers(tmp_path):
    new, found = ph.select(STUDY, experiment=3), []
    for number, ways in enumerate(({"cores": 1}, {"cores": 2, "batch_size": 2})):
        store = ph.Store(tmp_path / f"{number}", **ways)
        cohort = ph.fit_cohort(ph.Ogden(), new, LIKELIHOOD, store, **QUIET)
        found.append(cohort["evidence"].to_dataset().load())
    one, other = found
    assert (one["error"] == "").all()
    for name in ("log_evidence", "log_evidence_se"):
        np.testing.assert_allclose(other[name], one[name], rtol=ROUNDING, atol=ROUNDING)


@pytest.mark.deep
def test_fit_classes_and_cross_validate_resume_from_their_stores(tmp_path, monkeypatch):
    """No stored specimen is sampled again."""
    groups = {name: ph.select(STUDY, group=name) for name in ("C1", "C2")}
    settings = {"draws": 200, "random_seed": 1, "progressbar": False}
    settings |= {"likelihood": 3 * ph.mmHg, "variability": "specimen"}

    def results():
        store = tmp_path / "classes"
        classes = ph.fit_classes(ph.Ogden(), groups, **settings, chains=1, store=store)
        scores = ph.cross_validate(ph.Ogden(), groups, **settings, store=tmp_path / "scores")
        return [*(classes[name]["posterior"].to_dataset() for name in groups), scores]

    def never(*_, **__):
        raise AssertionError("a specimen was sampled again")

    first = results()
    monkeypatch.setattr("pymc_hyperelastic.classes.specimens.SpecimenSampler.__call__", never)
    assert all(a.equals(b) for a, b in zip(results(), first, strict=True))


def test_doubtful_fit_gives_a_warning_and_is_stored(tmp_path):
    """One of two walls is stiffer than its prior allows."""
    radius = np.linspace(2.55, 2.7, 8)
    tube = ph.Tube(inner_radius=2.5, outer_radius=3.0)
    unit = ph.inflation_pressure(ph.NeoHookean(), radius, tube, mu=1.0)
    points = {"experiment": 1, "radius": radius}
    pressure = unit.eval(mode="FAST_COMPILE")
    frames = [
        pd.DataFrame({"specimen": name, **points, "pressure": mu * pressure})
        for name, mu in {"soft": 50.0, "stiff": 600.0}.items()
    ]
    data = ph.inflation_data(pd.concat(frames, ignore_index=True), tube)
    settings = {"random_seed": 1, "progressbar": False}
    with pytest.warns(UserWarning, match=r"1 of 2 have a doubtful fit.* is stiff: .*limit 200"):
        ph.fit_cohort(ph.NeoHookean(), data, 0.5, serial(tmp_path), **settings)
    soft, stiff = ph.open_result(tmp_path)["evidence"]["doubtful"].values.tolist()
    assert soft == "" and "the squared residuals are" in stiff


def test_specimens_with_an_unknown_radius_are_fitted(tmp_path):
    """The inner radius has a prior, and is missing in the data."""
    data = ph.select(STUDY, specimen="S1", experiment=1)
    inner = float(data["inner_radius"][0])
    data = data.assign(inner_radius=data["inner_radius"] * np.nan)
    priors = {"inner_radius": pm.Uniform.dist(0.9 * inner, 1.05 * inner)}
    priors["mu"] = pm.Uniform.dist(1.0, 200.0)
    ph.fit_cohort(ph.NeoHookean(), data, 5.0, serial(tmp_path / "store"), priors=priors, **QUIET)
    found = ph.open_result(tmp_path / "store")
    assert found["evidence"]["error"].values.tolist() == [""]
    radius = found["posterior"]["inner_radius"].values
    assert ((0.9 * inner < radius) & (radius < 1.05 * inner)).all()
