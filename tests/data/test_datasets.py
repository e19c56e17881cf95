"""The shipped data are what their sources say, and the simulated ones say that they are."""

import doctest
from importlib.resources import files
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import xarray as xr

from pymc_hyperelastic.data.datasets import list_datasets, load_dataset
from pymc_hyperelastic.data.inflation import check_inflation_data, points_of
from pymc_hyperelastic.data.select import select
from pymc_hyperelastic.data.units import mmHg

SCRIPT = Path(__file__).parents[2] / "docs" / "simulate_sheep_aorta.py"
simulate_sheep_aorta = module_from_spec(spec_from_file_location(SCRIPT.stem, SCRIPT))
simulate_sheep_aorta.__spec__.loader.exec_module(simulate_sheep_aorta)

NAMES = ["murine_pulmonary_artery", "simulated_sheep_aorta"]

# The published outer diameters (µm) at 0, 5, ..., 50 mmHg, and the wall areas (µm²).
OUTER_DIAMETER = {
    "control": [530.4, 581.1, 662.8, 791.1, 966, 1080.3, 1130.1, 1153.7, 1167.6, 1178.1, 1186.7],
    "hypertensive": [523.2, 584.3, 637.4, 691.7, 747.1, 790.5, 821.9, 844.7, 863.7, 877.3, 889.5],
}
WALL_AREA = {"control": 58530.0, "hypertensive": 87048.1}

# Inner radii (µm) at 0, 25 and 50 mmHg, derived elsewhere and given to three decimals.
INNER_RADIUS = {
    "control": [227.377, 522.62, 577.437],
    "hypertensive": [201.808, 358.489, 412.425],
}
THREE_DECIMALS = 5.1e-4  # half a unit of the last decimal, and a rounding

ROUNDING = 1e-14  # a few operations
WALL_AREA_ROUNDING = 1e-12  # a difference of squares that are up to 20 times as large
CONVERGED = 1e-13  # a sum over 64 nodes


def csv(name: str) -> pd.DataFrame:
    return pd.read_csv(str(files("pymc_hyperelastic.data.datasets") / f"{name}.csv"), comment="#")


def test_list():
    """Every dataset is listed with a description of one line."""
    assert sorted(list_datasets()) == NAMES
    assert all(text and "\n" not in text for text in list_datasets().values())


def test_unknown_name():
    """A wrong name raises one error that lists the right ones."""
    with pytest.raises(ValueError, match=r"no dataset 'sheep'; there are .*'murine_pulmonary_art"):
        load_dataset("sheep")


@pytest.mark.parametrize("name", NAMES)
def test_shipped_data_are_sound(name):
    """Each dataset passes the check, says what it is, and has strictly increasing radii."""
    data = load_dataset(name)
    check_inflation_data(data)
    assert all(data.attrs[key] for key in ("title", "description", "source"))
    for i in range(data.sizes["test"]):
        assert np.all(np.diff(data["radius"].values[points_of(data, i)]) > 0)


@pytest.mark.parametrize("name", NAMES)
def test_netcdf_round_trip(name, tmp_path):
    """A dataset that was saved and loaded is identical to the shipped one."""
    data = load_dataset(name)
    data.to_netcdf(tmp_path / "data.nc", engine="h5netcdf")
    loaded = xr.load_dataset(tmp_path / "data.nc", engine="h5netcdf")
    xr.testing.assert_identical(loaded, data)
    assert loaded.attrs["simulated"] == data.attrs["simulated"]


def test_simulated_data_say_so():
    """Nobody can take the simulated data for measurements: file, title and attributes say it."""
    data = load_dataset("simulated_sheep_aorta")
    assert data.attrs["simulated"] == 1
    for key in ("title", "description", "source"):
        assert data.attrs[key].startswith("SIMULATED")
    assert simulate_sheep_aorta.PATH.read_text(encoding="utf-8").startswith("# SIMULATED")
    assert load_dataset("murine_pulmonary_artery").attrs["simulated"] == 0


def test_script_reproduces_the_file():
    """The committed file is exactly what the script writes."""
    assert simulate_sheep_aorta.PATH.read_text(encoding="utf-8") == simulate_sheep_aorta.csv_text()


def test_script_s_examples():
    """The examples in the script's docstrings, which pytest does not collect from there."""
    assert doctest.testmod(simulate_sheep_aorta) == (0, 3)


def test_simulated_study_has_the_paper_s_layout():
    """Five specimens in two groups, three experiments of 20 points each, mmHg in the file."""
    data = load_dataset("simulated_sheep_aorta")
    assert dict(data.sizes) == {"obs": 300, "test": 15}
    for group, specimens in {"C1": ["S1", "S2", "S3"], "C2": ["S4", "S5"]}.items():
        chosen = select(data, group=group)
        assert chosen["specimen"].values.tolist() == list(np.repeat(specimens, 3))
        assert chosen["experiment"].values.tolist() == [1, 2, 3] * len(specimens)
    readings = csv("simulated_sheep_aorta")["pressure_mmHg"]
    np.testing.assert_allclose(data["pressure"], readings * mmHg, rtol=ROUNDING)


def test_simulated_groups_are_visibly_different():
    """At 9 mm each C2 curve lies above each C1 curve, by more than the specimens of C1 spread."""
    data = load_dataset("simulated_sheep_aorta")
    at_9mm = {"C1": [], "C2": []}
    for i, group in enumerate(data["group"].values.tolist()):
        points = data.isel(obs=points_of(data, i))
        at_9mm[group].append(np.interp(9.0, points["radius"], points["pressure"]))
    gap = min(at_9mm["C2"]) - max(at_9mm["C1"])
    assert gap > np.ptp(at_9mm["C1"]) > 0


def test_simulation_s_integral_is_converged():
    """A neo-Hookean tube, the fibres' stiffness being zero, has its closed-form pressure."""
    c, a = 40.0, np.array([6.5, 7.0, 8.4, 10.0])
    inner, outer = simulate_sheep_aorta.INNER_RADIUS, simulate_sheep_aorta.OUTER_RADIUS
    b2 = a**2 + outer**2 - inner**2
    logarithms = np.log(b2 / a**2) / 2 - np.log(outer / inner)
    exact = c * ((a**2 - inner**2) * (1 / a**2 - 1 / b2) / 2 - logarithms)
    computed = simulate_sheep_aorta.pressure(a, c=c, k1=0.0, k2=1.0) * mmHg
    np.testing.assert_allclose(computed, exact, rtol=CONVERGED, atol=CONVERGED)


@pytest.mark.parametrize("group", ["control", "hypertensive"])
def test_murine_figures_are_the_published_ones(group):
    """The file carries over the published figures without a change."""
    frame = csv("murine_pulmonary_artery").query("group == @group")
    assert frame["pressure_mmHg"].tolist() == list(range(0, 55, 5))
    assert frame["outer_diameter_um"].tolist() == OUTER_DIAMETER[group]
    assert frame["wall_area_um2"].unique().tolist() == [WALL_AREA[group]]


@pytest.mark.parametrize("group", ["control", "hypertensive"])
def test_murine_reference_is_the_stretched_unpressurised_tube(group):
    """The curve starts at the reference tube, and the wall keeps its measured area throughout."""
    data = select(load_dataset("murine_pulmonary_artery"), group=group)
    radius, inner, outer = (
        data[name].values for name in ("radius", "inner_radius", "outer_radius")
    )
    np.testing.assert_allclose(radius[[0, 5, 10]] * 1e3, INNER_RADIUS[group], atol=THREE_DECIMALS)
    np.testing.assert_allclose(radius[0], inner[0], rtol=ROUNDING)
    np.testing.assert_allclose(outer, OUTER_DIAMETER[group][0] / 2000, rtol=ROUNDING)
    area = np.pi * ((np.array(OUTER_DIAMETER[group]) / 2) ** 2 - (radius * 1e3) ** 2)
    np.testing.assert_allclose(area, WALL_AREA[group], rtol=WALL_AREA_ROUNDING)
    assert data["axial_stretch"].item() == 1.0
    assert data["opening_angle"].item() == 0.0
