"""Classes of sheets, alone and together with tubes."""

import numpy as np
import pandas as pd
import pymc as pm
import pytest

import pymc_hyperelastic as ph

LAW = ph.Ogden()
TUBE = ph.Tube(1.0, 1.3, axial_stretch=1.2)
STRESS_SD, PRESSURE_SD = 2.0, 0.3  # kPa
PRIORS = {"mu": pm.Uniform.dist(5, 60), "alpha": pm.Uniform.dist(2, 12)}
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

    def log_evidence(data):
        model = ph.material_model(LAW, data, errors, priors=PRIORS)
        return ph.log_evidence(ph.sample_smc(model, draws=1000, chains=2, **QUIET)).value

    for name, data in groups.items():
        exact = log_evidence(ph.combine_tests(data, new)) - log_evidence(data)
        assert float(found.sel({"class_label": name})) == pytest.approx(exact, abs=0.1)


@pytest.mark.parametrize("with_tube", [False, True], ids=["sheets", "sheets and tubes"])
def test_classes_whose_specimens_differ_are_fitted_to_sheets_and_told_apart(with_tube):
    """Median and spread of the moduli are those of the specimens; new ones find their class."""
    moduli = {"soft": 15.0, "stiff": 40.0}
    groups = {
        name: group(name, mu, 5, spread=0.2, with_tube=with_tube, seed=4)
        for name, mu in moduli.items()
    }
    classes = ph.fit_classes(
        LAW, groups, likelihood(with_tube), draws=300, variability="specimen", **QUIET
    )
    new = [
        group(f"new {name}", mu, 2, spread=0.1, with_tube=with_tube, seed=5)
        for name, mu in moduli.items()
    ]
    found = ph.classify(ph.combine_tests(*new), classes, by="specimen", random_seed=1)
    probability = found["class_probability"]
    assert float(probability.sel({"class_label": "soft"})[:2].min()) > 0.9
    assert float(probability.sel({"class_label": "stiff"})[2:].min()) > 0.9
    compared = ph.compare_classes(classes, ["log mu"], random_seed=1)
    typical = compared["difference"].sel(statistic="typical").squeeze().item()
    assert typical == pytest.approx(np.log(40 / 15), abs=0.4)


def test_property_of_a_tube_needs_a_tube_where_classes_hold_sheets_alone():
    """A circumferential stress at a pressure has no meaning without radii."""
    groups = {
        "soft": group("soft", 15.0, 2, spread=0.2),
        "stiff": group("stiff", 40.0, 2, spread=0.2),
    }
    classes = ph.fit_classes(
        LAW, groups, likelihood(False), draws=100, variability="specimen", **QUIET
    )
    with pytest.raises(ValueError, match=r"inner_radius \(unknown\).*state the tube"):
        ph.compare_classes(classes, ["log radius"], at=2.0, random_seed=1)
    at = ph.Conditions(2.0, tube=TUBE)
    compared = ph.compare_classes(classes, ["log radius"], at=at, random_seed=1)
    assert float(compared["difference"].sel(statistic="typical").squeeze()) < 0
