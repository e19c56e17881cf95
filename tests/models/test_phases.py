"""Phases and cycles of a specimen that are fitted together are doubted, and only these."""

import numpy as np
import pandas as pd
import pytest
from tables import build, curve

import pymc_hyperelastic as ph

BOTH = "specimen 'S1' has the phases 'loading', 'unloading', .*ph.select\\(data, phase='loading'\\)"
LIKELIHOOD = ph.Gaussian(pressure_sd=0.5)
SETTINGS = {"draws": 50, "progressbar": False, "random_seed": 1}


def tube_with_phases():
    """Return the loading and the unloading of one tube."""
    radius, pressure = np.linspace(7.2, 9.4, 12), np.linspace(1.0, 17.0, 12)
    up = curve(radius, pressure, phase="loading")
    down = curve(radius[-2::-1] + 0.05, pressure[-2::-1] - 0.5, phase="unloading")
    return build(pd.concat([up, down], ignore_index=True))


def sheet_with_phases():
    """Return the loading and the unloading of one strip."""
    stretch = np.linspace(1.05, 1.3, 6)
    up = pd.DataFrame({"specimen": "S1", "experiment": 1, "stretch": stretch, "phase": "loading"})
    up["stress"] = 30 * (stretch - stretch**-2)
    down = up.iloc[::-1].assign(phase="unloading", stress=0.9 * up["stress"])
    return ph.sheet_data(pd.concat([up, down]), kind="uniaxial", stress="nominal")


def test_building_and_selecting_data_with_phases_gives_no_warning():
    """A warning would be an error here; the same for one phase in all tests of a model."""
    data = tube_with_phases()
    ph.inflation_model(ph.NeoHookean(), ph.select(data, phase="unloading"), LIKELIHOOD)
    equal = data.assign_coords(phase=("test", ["up", "up"]), experiment=("test", [1, 2]))
    ph.inflation_model(ph.NeoHookean(), equal, LIKELIHOOD)


def test_different_phases_of_different_specimens_give_no_warning():
    data = tube_with_phases().assign_coords(specimen=("test", ["S1", "S2"]))
    ph.inflation_model(ph.NeoHookean(), data, LIKELIHOOD)


@pytest.mark.parametrize("model", [ph.inflation_model, ph.population_model])
def test_model_of_loading_and_unloading_warns_and_names_the_specimen(model):
    with pytest.warns(UserWarning, match=BOTH):
        model(ph.NeoHookean(), tube_with_phases(), LIKELIHOOD)


def test_model_of_sheets_warns_about_loading_and_unloading():
    with pytest.warns(UserWarning, match=BOTH):
        ph.material_model(ph.NeoHookean(), sheet_with_phases(), ph.Gaussian(stress_sd=1.0))


def test_cohort_warns_about_phases_only_if_they_share_one_material(tmp_path):
    data = tube_with_phases()
    wide = ph.Gaussian(pressure_sd=20.0)  # so that both curves fit
    by_test = ph.Store(tmp_path / "test", cores=1)
    ph.fit_cohort(ph.NeoHookean(), data, wide, by_test, by="test", **SETTINGS)
    by_specimen = ph.Store(tmp_path / "specimen", cores=1)
    with pytest.warns(UserWarning, match=BOTH):
        ph.fit_cohort(ph.NeoHookean(), data, wide, by_specimen, **SETTINGS)


def test_model_of_several_cycles_of_an_experiment_warns_and_names_the_last():
    radius, pressure = np.linspace(7.2, 9.4, 12), np.linspace(1.0, 17.0, 12)
    cycles = [curve(radius, pressure + 0.1 * i, cycle=i, experiment=1) for i in (1, 2)]
    frame = pd.concat([*cycles, curve(radius, pressure, cycle=1, experiment=2)], ignore_index=True)
    ph.inflation_model(ph.NeoHookean(), build(frame), LIKELIHOOD)
    data = build(frame, cycles="all")
    said = r"specimen 'S1', experiment 1 has the cycles 1, 2, .*ph.select\(data, cycle=2\)"
    with pytest.warns(UserWarning, match=said) as warned:
        ph.inflation_model(ph.NeoHookean(), data, LIKELIHOOD)
    assert len(warned) == 1
    ph.inflation_model(ph.NeoHookean(), ph.select(data, cycle=1), LIKELIHOOD)
