"""The shipped datasets agree with their sources, and simulated data are labelled as simulated."""

import io
from importlib.resources import files
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import xarray as xr

from pymc_hyperelastic.data.datasets import list_datasets, load_dataset
from pymc_hyperelastic.data.inflation import check_data
from pymc_hyperelastic.data.select import select
from pymc_hyperelastic.data.units import mmHg

SCRIPT = Path(__file__).parents[2] / "docs" / "simulate_sheep_aorta.py"
simulate_sheep_aorta = module_from_spec(spec_from_file_location(SCRIPT.stem, SCRIPT))
simulate_sheep_aorta.__spec__.loader.exec_module(simulate_sheep_aorta)

NAMES = [
    "human_myocardium",
    "murine_pulmonary_artery",
    "porcine_skin",
    "simulated_sheep_aorta",
    "treloar_rubber",
]

# The published outer diameters (µm) at 0, 5, ..., 50 mmHg, and the wall areas (µm²).
OUTER_DIAMETER = {
    "control": [530.4, 581.1, 662.8, 791.1, 966, 1080.3, 1130.1, 1153.7, 1167.6, 1178.1, 1186.7],
    "hypertensive": [523.2, 584.3, 637.4, 691.7, 747.1, 790.5, 821.9, 844.7, 863.7, 877.3, 889.5],
}
WALL_AREA = {"control": 58530.0, "hypertensive": 87048.1}

ROUNDING = 1e-14  # a few operations
WALL_AREA_ROUNDING = 1e-12  # a difference of squares that are up to 20 times as large
# Units of the last decimals of the file: another mathematical library may round the other way.
LAST_DECIMAL = {"radius_mm": 1.01e-3, "pressure_mmHg": 0.101}
GEOMETRY = ("inner_radius", "outer_radius", "axial_stretch", "opening_angle")
SHIPPED = files("pymc_hyperelastic.data.datasets") / "simulated_sheep_aorta.csv"


def test_unknown_dataset_is_refused_with_the_known_names():
    assert sorted(list_datasets()) == NAMES
    with pytest.raises(ValueError, match=r"no dataset 'sheep'; there are .*'murine_pulmonary_art"):
        load_dataset("sheep")


@pytest.mark.parametrize("name", NAMES)
def test_shipped_data_are_valid_and_survive_a_file(name, tmp_path):
    data = load_dataset(name)
    check_data(data)
    texts = [data.attrs[key] for key in ("title", "description", "source")]
    simulated = name.startswith("simulated")
    assert data.attrs["simulated"] == simulated
    assert all(text and text.startswith("SIMULATED") == simulated for text in texts)
    data.to_netcdf(tmp_path / "data.nc", engine="h5netcdf")
    loaded = xr.load_dataset(tmp_path / "data.nc", engine="h5netcdf")
    xr.testing.assert_identical(loaded, data)


def test_script_reproduces_the_numbers_of_the_simulated_study():
    written = pd.read_csv(io.StringIO(simulate_sheep_aorta.csv_text()), comment="#")
    shipped = pd.read_csv(str(SHIPPED), comment="#")
    data = load_dataset("simulated_sheep_aorta")
    np.testing.assert_allclose(data["pressure"], shipped["pressure_mmHg"] * mmHg, rtol=ROUNDING)
    for name in shipped.columns:
        if name in LAST_DECIMAL:
            np.testing.assert_allclose(shipped[name], written[name], atol=LAST_DECIMAL[name])
        else:
            assert shipped[name].tolist() == written[name].tolist()


def test_simulated_study_has_five_specimens_of_three_experiments_of_20_points():
    data = load_dataset("simulated_sheep_aorta")
    assert dict(data.sizes) == {"obs": 300, "test": 15}
    for group, specimens in {"C1": ["S1", "S2", "S3"], "C2": ["S4", "S5"]}.items():
        chosen = select(data, group=group)
        assert chosen["specimen"].values.tolist() == list(np.repeat(specimens, 3))
        assert chosen["experiment"].values.tolist() == [1, 2, 3] * len(specimens)


@pytest.mark.parametrize("group", ["control", "hypertensive"])
def test_murine_data_equal_published_diameters_and_wall_areas(group):
    data = select(load_dataset("murine_pulmonary_artery"), group=group)
    readings = np.arange(0, 55, 5) * mmHg
    np.testing.assert_allclose(data["pressure"], readings, rtol=ROUNDING)
    radius, diameter = data["radius"].values * 1e3, np.array(OUTER_DIAMETER[group])
    area = np.pi * ((diameter / 2) ** 2 - radius**2)
    np.testing.assert_allclose(area, WALL_AREA[group], rtol=WALL_AREA_ROUNDING)
    # The first reading defines the unloaded tube.
    tube = [data[name].item() for name in GEOMETRY]
    expected = [radius[0] / 1e3, diameter[0] / 2000, 1.0, 0.0]
    np.testing.assert_allclose(tube, expected, rtol=ROUNDING)


def csv(name: str) -> pd.DataFrame:
    return pd.read_csv(str(files("pymc_hyperelastic.data.datasets") / f"{name}.csv"), comment="#")


def test_rubber_has_treloars_three_tests_of_nominal_stress():
    data, frame = load_dataset("treloar_rubber"), csv("treloar_rubber")
    assert np.bincount(data["test"]).tolist() == [24, 16, 13]
    assert data["experiment"].values.tolist() == ["uniaxial", "equibiaxial", "pure shear"]
    assert {*data["stress_measure"].values} == {"nominal"}
    np.testing.assert_array_equal(data["stretch_x"], frame["stretch"])
    np.testing.assert_allclose(data["stress_x"], 1e3 * frame["nominal_stress_MPa"], rtol=ROUNDING)
    across = [select(data, None, name)["stretch_y"].values for name in data["experiment"].values]
    assert np.isnan(across[0]).all() and (across[2] == 1).all()
    np.testing.assert_array_equal(across[1], select(data, None, "equibiaxial")["stretch_x"])
    assert np.isnan(data["stress_y"]).all()
    # The best known numbers: a stretch of 7.6 at 6.3 MPa.
    last = select(data, None, "uniaxial").isel(obs=-1)
    assert (last["stretch_x"].item(), round(last["stress_x"].item())) == (7.6, 6318)


def test_skin_has_15_points_of_each_protocol_evenly_along_the_larger_stretch():
    data, frame = load_dataset("porcine_skin"), csv("porcine_skin")
    assert np.bincount(data["test"]).tolist() == [15] * 5
    assert {*data["stress_measure"].values} == {"cauchy"}
    np.testing.assert_allclose(data["stress_y"], 1e3 * frame["cauchy_stress_y_MPa"], rtol=ROUNDING)
    np.testing.assert_array_equal(data["stretch_x"], frame["stretch_x"])
    ends = {"mostly y": "y", "mostly x": "x", "equibiaxial": "x", "strip x": "x", "strip y": "y"}
    assert data["experiment"].values.tolist() == [*ends]
    for name, axis in ends.items():
        own = select(data, None, name)
        along = own[f"stretch_{axis}"].values
        even = np.linspace(1, along[-1], 15)
        np.testing.assert_allclose(along, even, atol=0.06 * (along[-1] - 1))
        if name.startswith("strip"):
            assert (own[f"stretch_{'y' if axis == 'x' else 'x'}"] == 1).all()
    assert "thinned" in data.attrs["source"] and "thinned" in data.attrs["description"]


def test_myocardium_has_five_ratios_of_strains_with_fibres_along_x():
    data, frame = load_dataset("human_myocardium"), csv("human_myocardium")
    assert np.bincount(data["test"]).tolist() == [11] * 5
    assert data["experiment"].values.tolist() == ["1:1", "1:0.75", "0.75:1", "1:0.5", "0.5:1"]
    assert {*data["stress_measure"].values} == {"nominal"}
    for axis, direction in (("x", "fibre"), ("y", "cross_fibre")):
        column = frame[f"nominal_stress_{direction}_kPa"]
        np.testing.assert_allclose(data[f"stress_{axis}"], column, rtol=ROUNDING)
    for name in data["experiment"].values:
        last = select(data, None, name).isel(obs=-1)
        strains = [last[f"stretch_{axis}"].item() - 1 for axis in "xy"]
        ratio = [float(part) for part in name.split(":")]
        np.testing.assert_allclose(strains, [0.1 * part for part in ratio], rtol=1e-12)
    # Fibres are stiffer along than across.
    last = select(data, None, "1:1").isel(obs=-1)
    assert last["stress_x"] > 1.5 * last["stress_y"]
