"""The example scripts run as a user runs them, and leave what they promise."""

import os
import runpy
import subprocess
import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import xarray as xr
from tiers import deep

import pymc_hyperelastic as ph

EXAMPLES = Path(__file__).parents[1] / "examples"
FEW = ("--draws", "200", "--chains", "2", "--quiet")
ROUNDING = 1e-12  # of sums and products of a few numbers
LAWS = ("PowerLawNeoHookean", "Ogden", "CriscioneType")


def run(script, *arguments, folder):
    return subprocess.run(
        [sys.executable, str(EXAMPLES / script), *map(str, arguments)],
        capture_output=True,
        text=True,
        encoding="utf-8",
        cwd=folder,
        env={**os.environ, "MPLBACKEND": "agg", "PYTHONIOENCODING": "utf-8"},
        check=False,
    )


@pytest.fixture(params=["here", *deep(["in a process of its own"])])
def run_alike(request, monkeypatch, capsys):
    """A script run by this process, which has imported everything already, or as a user runs it."""

    def run_here(script, *arguments, folder):
        monkeypatch.chdir(folder)
        monkeypatch.syspath_prepend(EXAMPLES)
        monkeypatch.setenv("MPLBACKEND", "agg")
        monkeypatch.setattr(sys, "argv", [script, *map(str, arguments)])
        code = 0
        try:
            runpy.run_path(str(EXAMPLES / script), run_name="__main__")
        except SystemExit as end:  # its code is a number, or a message for the user
            code = end.code or 0
            if not isinstance(code, int):
                print(code, file=sys.stderr)
                code = 1
        printed = capsys.readouterr()
        return subprocess.CompletedProcess(script, code, printed.out, printed.err)

    return run_here if request.param == "here" else run


@pytest.mark.deep
@pytest.mark.parametrize(
    ("script", "numbers"),
    [("sheep_aorta.py", "SIMULATED"), ("pulmonary_hypertension.py", "One mean curve a group")],
)
def test_studies_run(script, numbers, tmp_path):
    """A study prints its tables, says what its data are, and leaves figures and files."""
    done = run(script, *FEW, "--out", tmp_path / "out", folder=tmp_path)
    assert done.returncode == 0, done.stderr
    assert numbers in done.stdout
    assert "log evidence" in done.stdout
    figures = {path.name for path in (tmp_path / "out").glob("*.png")}
    assert figures == {"data.png", "class_probability.png"} | {
        f"{law}_{kind}.png" for law in LAWS for kind in ("parameters", "fit")
    }
    for law in LAWS:
        assert xr.load_datatree(tmp_path / "out" / f"{law}_classes.nc").children
        result = xr.load_dataset(tmp_path / "out" / f"{law}_class_probability.nc")
        truth = result["group"].values
        assert (result["class_probability"].idxmax("class_label").values == truth).all()


@pytest.mark.deep
def test_csv_is_classified(tmp_path):
    """The table that comes with the examples gives the right classes, and a report."""
    done = run("classify_csv.py", EXAMPLES / "curves.csv", folder=tmp_path)
    assert done.returncode == 0, done.stderr
    assert "mmHg" in done.stdout
    for specimen, group in {"S1": "C1", "S4": "C2"}.items():
        decisions = [line for line in done.stdout.splitlines() if line.startswith(specimen)]
        assert decisions and group in decisions[-1]
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert "New specimens" in page


@pytest.mark.deep
def test_cohort_runs(tmp_path):
    """Few specimens already show that the pooled scheme is surer than it may be."""
    few = ("--train", "8", "--new", "20", "--other", "8", "--quiet")
    done = run("simulated_cohort.py", *few, "--out", tmp_path / "out", folder=tmp_path)
    assert done.returncode == 0, done.stderr
    assert "SIMULATED: 20 new specimens" in done.stdout
    names = {path.name for path in (tmp_path / "out").iterdir()}
    assert {"curves.png", "class_probability.png", "reliability.png"} < names
    for row in ("true", "variability", "pooled", "neither class", "softer"):
        assert f"\n{row} " in done.stdout
    for scheme in ("variability", "pooled"):
        classes = xr.load_datatree(tmp_path / "out" / f"{scheme}_classes.nc")
        assert list(classes.children) == ["A", "B"]
    known, learned, pooled = (
        xr.load_dataset(tmp_path / "out" / f"{scheme}_new.nc")["class_probability"]
        for scheme in ("true", "variability", "pooled")
    )
    assert abs(learned - known).mean() < abs(pooled - known).mean()
    scores = pd.read_csv(tmp_path / "out" / "scores.csv", index_col=0)["log score"]
    assert np.log(0.5) < scores["true"] < 0
    assert scores["variability"] > scores["true"] - 0.5
    assert scores["pooled"] < scores["variability"] - 10
    flagged = pd.read_csv(tmp_path / "out" / "none_of_these.csv", index_col="kind")
    assert flagged.loc["neither class", "share"] > flagged.loc[["A", "B"], "share"].max()


@pytest.mark.parametrize(
    "script", ["leave_one_animal_out.py", "seven_protocols.py", "three_axial_stretches.py"]
)
def test_study_of_missing_data_says_how_to_call(run_alike, script, tmp_path, monkeypatch):
    """A study whose data are not part of the package ends well without them."""
    monkeypatch.delenv("MURINE_ELASTASE", raising=False)
    done = run_alike(script, folder=tmp_path)
    assert done.returncode == 0, done.stderr
    assert "usage:" in done.stdout and "murine_elastase_pd.csv" in done.stdout
    assert not list(tmp_path.iterdir())


def test_cut_ring_keeps_its_middle_line(tmp_path, monkeypatch):
    """The murine tables give sectors as thick as the rings were, with middle lines as long."""
    monkeypatch.syspath_prepend(EXAMPLES)
    import murine_tables

    rings = {"outer_diameter_unloaded_mm": [4.6, 5.2], "thickness_unloaded_mm": [0.8, 0.7]}
    rings |= {"opening_angle_deg": [74.0, 20.0], "group": ["control", "elastase"]}
    rings |= {"specimen": ["S1", "S2"], "animal": ["M1", "M1"]}
    points = pd.DataFrame({"pressure_mmHg": [2.0, 5.0, 9.0], "outer_diameter_um": [5e3, 6e3, 7e3]})
    points = points.assign(test="test1", axial_stretch=1.2)
    points = pd.concat([points.assign(specimen=name) for name in rings["specimen"]])
    pd.DataFrame(rings).to_csv(tmp_path / "murine_elastase_geometry.csv", index=False)
    points.to_csv(tmp_path / "murine_elastase_pd.csv", index=False)
    data, _ = murine_tables.read(tmp_path)
    assert data["group"].values.tolist() == rings["group"]
    inner, outer = data["inner_radius"].values, data["outer_radius"].values
    thickness = np.array(rings["thickness_unloaded_mm"])
    sector = 2 * np.pi - data["opening_angle"].values
    middle_line = np.pi * (np.array(rings["outer_diameter_unloaded_mm"]) - thickness)
    np.testing.assert_allclose(sector, 2 * np.pi - 2 * np.radians([74.0, 20.0]), rtol=ROUNDING)
    np.testing.assert_allclose(outer - inner, thickness, rtol=ROUNDING)
    np.testing.assert_allclose(sector * (inner + outer) / 2, middle_line, rtol=ROUNDING)
    # Below 3.5 mmHg the wall is unfolding.
    np.testing.assert_allclose(data["pressure"] / ph.mmHg, [5, 9, 5, 9], rtol=ROUNDING)
    np.testing.assert_allclose(data["outer_diameter"], [6, 7, 6, 7], rtol=ROUNDING)
