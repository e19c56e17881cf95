"""The examples run as their readers run them, in Jupyter, and leave what they promise."""

import runpy
import shutil
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import xarray as xr
from tiers import long

import pymc_hyperelastic as ph

EXAMPLES = Path(__file__).parents[1] / "examples"
ROUNDING = 1e-12  # of sums and products of a few numbers
LAWS = ("PowerLawNeoHookean", "Ogden", "CriscioneType")
# Examples that need no table from elsewhere, and what takes less time in place of some lines.
SMALL = {
    "classify_csv": {},
    "pulmonary_hypertension": {"CHAINS = 2000, 4": "CHAINS = 200, 2"},
    "sheep_aorta": {"CHAINS = 2000, 4": "CHAINS = 200, 2"},
    "simulated_aortas": {"TRAIN, NEW = 8, 200": "TRAIN, NEW = 3, 2"},
    "simulated_cohort": {"OTHER = 40, 500, 200": "OTHER = 8, 20, 8"},
    "unloaded_radius": {
        "CHAINS = 300, 2": "CHAINS = 100, 2",
        "    ph.CriscioneType(): {},\n": "",
        '    ph.HolzapfelGasserOgden(): {"k2": pm.Uniform.dist(0, 5)},\n': "",
    },
}
# The heading at which one ends whose fits take a quarter of an hour, however small they are.
UNTIL = {"simulated_aortas": "Learn the classes"}
ELSEWHERE = {
    path.stem for path in EXAMPLES.glob("*.py") if "murine_tables" in path.read_text("utf-8")
}


def run(name, folder):
    """Run the notebook of an example from top to bottom, and return what it prints."""
    nbformat, nbclient = pytest.importorskip("nbformat"), pytest.importorskip("nbclient")
    notebook = pytest.importorskip("sphinx_gallery.notebook")
    shutil.copytree(EXAMPLES, folder, dirs_exist_ok=True, ignore=shutil.ignore_patterns("results"))
    script = folder / f"{name}.py"
    source = script.read_text(encoding="utf-8")
    for lines, smaller in SMALL[name].items():
        assert source.count(lines) == 1
        source = source.replace(lines, smaller)
    script.write_text(source, encoding="utf-8")
    notebook.python_to_jupyter_cli([str(script)])
    read = nbformat.read(script.with_suffix(".ipynb"), as_version=4)
    headings = [cell.source.startswith(f"## {UNTIL.get(name)}") for cell in read.cells]
    read.cells = read.cells[: headings.index(True) if name in UNTIL else None]
    nbclient.NotebookClient(read, resources={"metadata": {"path": folder}}).execute()
    outputs = [output for cell in read.cells for output in cell.get("outputs", [])]
    return "".join(output.text for output in outputs if output.get("name") == "stdout")


def test_every_example_is_run():
    """An example is run as a notebook, or needs tables from elsewhere."""
    assert SMALL.keys() | ELSEWHERE | {"murine_tables"} == {
        path.stem for path in EXAMPLES.glob("*.py")
    }


@pytest.mark.deep
@pytest.mark.parametrize(
    ("study", "words"),
    [
        ("sheep_aorta", "SIMULATED"),
        *long([("pulmonary_hypertension", "One mean curve a group")]),
    ],
)
def test_studies_run(study, words, tmp_path):
    """A study prints its tables, says what its data are, and leaves figures and files."""
    printed = run(study, tmp_path)
    assert words in printed
    assert "log evidence" in printed
    out = tmp_path / "results" / study
    figures = {path.name for path in out.glob("*.png")}
    assert figures == {"data.png", "class_probability.png"} | {
        f"{law}_{kind}.png" for law in LAWS for kind in ("parameters", "fit")
    }
    for law in LAWS:
        assert xr.load_datatree(out / f"{law}_classes.nc").children
        result = xr.load_dataset(out / f"{law}_class_probability.nc")
        truth = result["group"].values
        assert (result["class_probability"].idxmax("class_label").values == truth).all()


@pytest.mark.deep
def test_csv_is_classified(tmp_path):
    """The table that comes with the examples gives the right classes, and a report."""
    printed = run("classify_csv", tmp_path)
    assert "mmHg" in printed
    for specimen, group in {"S1": "C1", "S4": "C2"}.items():
        decisions = [line for line in printed.splitlines() if line.startswith(specimen)]
        assert decisions and group in decisions[-1]
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert "New specimens" in page


@pytest.mark.deep
def test_cohort_runs(tmp_path):
    """Few specimens already show that the pooled scheme is surer than it may be."""
    printed = run("simulated_cohort", tmp_path)
    assert "SIMULATED: 20 new specimens" in printed
    out = tmp_path / "results" / "simulated_cohort"
    names = {path.name for path in out.iterdir()}
    assert {"curves.png", "class_probability.png", "reliability.png"} < names
    for row in ("true", "variability", "pooled", "neither class", "softer"):
        assert f"\n{row} " in printed
    for scheme in ("variability", "pooled"):
        classes = xr.load_datatree(out / f"{scheme}_classes.nc")
        assert list(classes.children) == ["A", "B"]
    known, learned, pooled = (
        xr.load_dataset(out / f"{scheme}_new.nc")["class_probability"]
        for scheme in ("true", "variability", "pooled")
    )
    assert abs(learned - known).mean() < abs(pooled - known).mean()
    scores = pd.read_csv(out / "scores.csv", index_col=0)["log score"]
    assert np.log(0.5) < scores["true"] < 0
    assert scores["variability"] > scores["true"] - 0.5
    assert scores["pooled"] < scores["variability"] - 10
    flagged = pd.read_csv(out / "none_of_these.csv", index_col="kind")
    assert flagged.loc["neither class", "share"] > flagged.loc[["A", "B"], "share"].max()


@pytest.mark.long
@pytest.mark.deep
def test_unloaded_radius_is_found(tmp_path):
    """Laws are compared, and the study ends with its figures."""
    printed = run("unloaded_radius", tmp_path)
    assert all(f"{law} " in printed for law in LAWS[:2])
    names = {path.name for path in (tmp_path / "results" / "unloaded_radius").glob("*.png")}
    assert names == {"left_out.png", "radius.png", "evidence.png"}


@pytest.mark.deep
def test_true_probabilities_of_simulated_aortas_are_known(tmp_path):
    """The true model, to which what is learned is compared, tells the group of a specimen."""
    run("simulated_aortas", tmp_path)
    known = xr.load_dataset(tmp_path / "results" / "simulated_aortas" / "true_new.nc")
    best = known["class_probability"].idxmax("class_label").values.tolist()
    assert best == ["control", "treated"]


@pytest.mark.parametrize("study", sorted(ELSEWHERE))
def test_study_of_missing_data_says_what_it_needs(study, tmp_path, monkeypatch):
    """A study whose data are not part of the package names the tables and where they belong."""
    monkeypatch.delenv("MURINE_ELASTASE", raising=False)
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(EXAMPLES)
    monkeypatch.setenv("MPLBACKEND", "agg")
    with pytest.raises(FileNotFoundError, match=r"(?s)MURINE_ELASTASE.*murine_elastase_pd\.csv"):
        runpy.run_path(str(EXAMPLES / f"{study}.py"), run_name="__main__")


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
