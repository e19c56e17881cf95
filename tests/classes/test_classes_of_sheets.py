"""Classes of sheets, alone and together with tubes."""

import numpy as np
import pandas as pd
import pymc as pm
import pytest
import two_parameters

import pymc_hyperelastic as ph
from pymc_hyperelastic.classes.hierarchical import HierarchicalClass

LAW = ph.Ogden()
TUBE = ph.Tube(1.0, 1.3, axial_stretch=1.2)
STRESS_SD, PRESSURE_SD = 2.0, 0.3  # kPa
BOUNDS = {"mu": (5, 60), "alpha": (2, 12)}
PRIORS = {name: pm.Uniform.dist(*ends) for name, ends in BOUNDS.items()}
# Moduli of groups whose specimens differ, kPa.
MODULI = {"soft": 15.0, "stiff": 40.0}
QUIET = {"progressbar": False, "random_seed": 1}


def specimen(name, mu, *, with_tube=False, rng):
    """Return a strip and a square of one specimen, and perhaps an inflated ring of it."""
    material, stretch = {"mu": mu, "alpha": 6.0}, np.linspace(1.05, 1.3, 6)
    frames = []
    for kind, other in (("uniaxial", None), ("equibiaxial", stretch)):
        stress = ph.sheet_stress(LAW, stretch, other, **material).x.eval()
        noise = STRESS_SD * rng.standard_normal(stress.size)
        frame = {"specimen": name, "experiment": kind, "kind": kind, "stretch": stretch}
        frames.append(pd.DataFrame(frame | {"stress": stress + noise}))
    table = pd.concat(frames, ignore_index=True)
    data = ph.sheet_data(table, stress="cauchy", kind="kind", check="ignore")
    if not with_tube:
        return data
    radius = np.linspace(1.05, 1.4, 6)
    pressure = ph.inflation_pressure(LAW, radius, TUBE, **material).eval()
    pressure = pressure + PRESSURE_SD * rng.standard_normal(radius.size)
    frame = {"specimen": name, "experiment": "tube", "radius": radius, "pressure": pressure}
    return ph.combine_tests(ph.inflation_data(pd.DataFrame(frame), TUBE, check="ignore"), data)


def group(name, mu, count, *, spread, with_tube=False, seed=1):
    """Return specimens whose moduli have a log-normal distribution."""
    rng = np.random.default_rng(seed)
    moduli = mu * np.exp(spread * rng.standard_normal(count))
    parts = [
        specimen(f"{name}{i}", own, with_tube=with_tube, rng=rng) for i, own in enumerate(moduli)
    ]
    data = ph.combine_tests(*parts)
    return data.assign_coords(group=("test", [name] * data.sizes["test"]))


def likelihood(with_tube):
    return ph.Gaussian(stress_sd=STRESS_SD, pressure_sd=PRESSURE_SD if with_tube else None)


def part_of(data, *, tubes):
    """Return the tests of tubes, or of sheets, with the name of their kind in the specimen's."""
    kind = "tube" if tubes else "sheet"
    own = ph.select(data, stress_measure="" if tubes else "cauchy")
    names = [f"{name} ({kind})" for name in own["specimen"].values.tolist()]
    return own.assign_coords(specimen=("test", names))


def evidence(data, errors):
    """Return the log evidence of one material for all data."""
    model = ph.material_model(LAW, data, errors, priors=PRIORS)
    return two_parameters.log_evidence(model, BOUNDS)


def fitted(groups, with_tube):
    """Fit classes whose specimens differ."""
    errors = likelihood(with_tube)
    return ph.fit_classes(LAW, groups, errors, draws=200, variability="specimen", **QUIET)


@pytest.fixture(scope="module")
def of_sheets():
    """Classes of sheets alone."""
    groups = {name: group(name, mu, 4, spread=0.2, seed=4) for name, mu in MODULI.items()}
    return fitted(groups, with_tube=False)


@pytest.fixture(scope="module")
def of_both():
    """Classes of sheets and tubes; two specimens of one class have sheets alone."""
    groups = {
        name: group(name, mu, 4, spread=0.2, with_tube=True, seed=4) for name, mu in MODULI.items()
    }
    strips = part_of(group("more", 15.0, 2, spread=0.2, with_tube=True, seed=6), tubes=False)
    strips = strips.assign_coords(group=("test", ["soft"] * strips.sizes["test"]))
    return fitted(groups | {"soft": ph.combine_tests(groups["soft"], strips)}, with_tube=True)


@pytest.mark.parametrize("with_tube", [False, True], ids=["sheets", "sheets and tubes"])
def test_probability_of_pooled_classes_follows_from_evidences_of_joined_data(with_tube):
    """``ln p(new | class) = ln Z(class and new) - ln Z(class)``: three models, no class."""
    groups = {
        name: group(name, mu, 2, spread=0.0, with_tube=with_tube, seed=seed)
        for name, mu, seed in (("soft", 20.0, 1), ("stiff", 21.0, 2))
    }
    new = group("new", 20.2, 1, spread=0.0, with_tube=with_tube, seed=3)
    errors = likelihood(with_tube)
    classes = ph.fit_classes(LAW, groups, errors, draws=1000, priors=PRIORS, **QUIET)
    found = ph.classify(new, classes, by="specimen", random_seed=1)["log_evidence"].squeeze()
    for name, data in groups.items():
        exact = evidence(ph.combine_tests(data, new), errors) - evidence(data, errors)
        assert float(found.sel({"class_label": name})) == pytest.approx(exact, abs=0.1)


def test_pooled_classes_take_specimens_with_tests_of_one_kind():
    """The evidence of a new tube, or sheet, follows from evidences of joined data."""
    both = group("soft", 20.0, 2, spread=0.0, with_tube=True)
    trained = ph.combine_tests(
        both, part_of(group("soft x", 20.0, 1, spread=0, with_tube=True), tubes=True)
    )
    other = group("stiff", 22.0, 1, spread=0.0, with_tube=True, seed=2)
    new = group("new", 20.2, 1, spread=0.0, with_tube=True, seed=3)
    parts = [part_of(new, tubes=True), part_of(new, tubes=False)]
    errors = likelihood(with_tube=True)
    classes = ph.fit_classes(
        LAW, {"soft": trained, "stiff": other}, errors, draws=1000, priors=PRIORS, **QUIET
    )
    found = ph.classify(ph.combine_tests(*parts), classes, by="specimen", random_seed=1)
    of_class = evidence(trained, errors)
    for i, part in enumerate(parts):
        exact = evidence(ph.combine_tests(trained, part), errors) - of_class
        value = found["log_evidence"].sel(class_label="soft").values[i]
        assert value == pytest.approx(exact, abs=0.1)


@pytest.mark.parametrize("with_tube", [False, True], ids=["sheets", "sheets and tubes"])
def test_classes_whose_specimens_differ_are_told_apart(with_tube, request):
    """New specimens of a class find it."""
    classes = request.getfixturevalue("of_both" if with_tube else "of_sheets")
    new = [
        group(f"new {name}", mu, 2, spread=0.1, with_tube=with_tube, seed=5)
        for name, mu in MODULI.items()
    ]
    found = ph.classify(ph.combine_tests(*new), classes, by="specimen", random_seed=1)
    probability = found["class_probability"]
    assert float(probability.sel({"class_label": "soft"})[:2].min()) > 0.9
    assert float(probability.sel({"class_label": "stiff"})[2:].min()) > 0.9


def test_classes_whose_specimens_differ_take_specimens_with_tests_of_one_kind(of_both):
    """Each new test finds the class of its material, by itself and as part of a specimen."""
    new = [
        group(name, mu, 1, spread=0.1, with_tube=True, seed=5)
        for name, mu in zip("ab", MODULI.values(), strict=True)
    ]
    found = ph.classify(ph.combine_tests(*new), of_both, by="test", random_seed=1)
    of_soft = found["class_probability"].sel(class_label="soft").values
    assert of_soft[:3].min() > 0.9
    assert of_soft[3:].max() < 0.1


def test_difference_of_classes_of_sheets(of_sheets):
    """Moduli differ by a factor of 40/15; a radius at a pressure has no meaning without a tube."""
    with pytest.raises(ValueError, match=r"inner_radius \(unknown\).*state the tube"):
        ph.compare_classes(of_sheets, ["log radius"], at=2.0, random_seed=1)
    at = ph.Conditions(2.0, tube=TUBE)
    compared = ph.compare_classes(of_sheets, ["log mu", "log radius"], at=at, random_seed=1)
    of_moduli, of_radius = compared["difference"].sel(statistic="typical").values.ravel()
    assert of_moduli == pytest.approx(np.log(40 / 15), abs=0.4)
    assert of_radius < 0


def test_specimen_with_tests_of_one_kind_is_sampled_as_by_a_model_of_that_kind():
    """Errors of the other kind change nothing: draws and weights are the same numbers."""
    data = group("S", 20.0, 1, spread=0.0, with_tube=True)
    joint = HierarchicalClass.of_settings(LAW, likelihood(True), None, "specimen").sampler(data)
    for tubes in (True, False):
        part = part_of(data, tubes=tubes)
        own = ph.Gaussian(pressure_sd=PRESSURE_SD) if tubes else likelihood(False)
        alone = HierarchicalClass.of_settings(LAW, own, None, "specimen").sampler(part)
        found, expected = (s(part, np.random.default_rng(1)) for s in (joint, alone))
        np.testing.assert_allclose(found.points, expected.points, rtol=1e-6)
        np.testing.assert_allclose(found.log_weight, expected.log_weight, rtol=1e-6)
        assert found.misfit == pytest.approx(expected.misfit)


def test_cohort_holds_specimens_with_tests_of_one_kind(tmp_path):
    """The evidence in each row is that of a model of this specimen alone."""
    data = group("S", 20.0, 1, spread=0.0, with_tube=True)
    parts = [data, part_of(data, tubes=True), part_of(data, tubes=False)]
    store = ph.Store(tmp_path / "store")
    found = ph.fit_cohort(
        LAW, ph.combine_tests(*parts), likelihood(True), priors=PRIORS, store=store, **QUIET
    )
    for i, part in enumerate(parts):
        own = {"pressure_sd": PRESSURE_SD} if i < 2 else {}
        own |= {"stress_sd": STRESS_SD} if i != 1 else {}
        alone = evidence(part, ph.Gaussian(**own))
        row = found["evidence"].to_dataset().isel(specimen=i)
        assert row["error"].item() == ""
        assert row["log_evidence"].item() == pytest.approx(alone, abs=0.1)
