"""The examples run as notebooks and write the files that they announce.

``make docs`` runs some of them in full, the main study among them. Here these are marked `long`.
"""

import runpy
import shutil
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import xarray as xr
from tiers import long

EXAMPLES = Path(__file__).parents[1] / "examples"
LAWS = ("PowerLawNeoHookean", "Ogden", "CriscioneType")
# No cell has a time limit, and a slow computer may take long to start a kernel and to print.
LIMITS = {"timeout": None, "startup_timeout": 3600, "iopub_timeout": 600}
# Examples that need no external table, and replacements of lines that shorten them.
SMALL = {
    "classify_csv": {},
    "inflation_and_strip": {"CHAINS = 800, 2": "CHAINS = 100, 2"},
    "pulmonary_hypertension": {"CHAINS = 2000, 4": "CHAINS = 200, 2"},
    "rubber": {"CHAINS = 300, 2": "CHAINS = 100, 2"},
    "sheep_aorta": {"CHAINS = 2000, 4": "CHAINS = 200, 2"},
    "simulated_aortas": {"TRAIN, NEW = 8, 200": "TRAIN, NEW = 3, 2"},
    "simulated_cohort": {"OTHER = 40, 500, 200": "OTHER = 8, 20, 8"},
    "skin": {"CHAINS = 300, 2": "CHAINS = 100, 2"},
    "unloaded_radius": {
        "CHAINS = 300, 2": "CHAINS = 100, 2",
        "    ph.CriscioneType(): {},\n": "",
        '    ph.HolzapfelGasserOgden(): {"k2": pm.Uniform.dist(0, 5)},\n': "",
    },
}
# The heading before which a notebook is cut: the fits below it take a quarter of an hour.
UNTIL = {"simulated_aortas": "Learn the classes"}
ELSEWHERE = {
    path.stem for path in EXAMPLES.glob("*.py") if "murine_tables" in path.read_text("utf-8")
}


def run(name, folder):
    """Run the notebook of an example from top to bottom, and return its printed text."""
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
    nbclient.NotebookClient(read, resources={"metadata": {"path": folder}}, **LIMITS).execute()
    outputs = [output for cell in read.cells for output in cell.get("outputs", [])]
    return "".join(output.text for output in outputs if output.get("name") == "stdout")


def test_every_example_is_run_or_needs_tables_from_elsewhere():
    assert SMALL.keys() | ELSEWHERE | {"murine_tables"} == {
        path.stem for path in EXAMPLES.glob("*.py")
    }


@pytest.mark.parametrize("study", long(["sheep_aorta", "pulmonary_hypertension"]))
def test_study_prints_its_tables_and_writes_its_figures_and_results(study, tmp_path):
    printed = run(study, tmp_path)
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


@pytest.mark.long
@pytest.mark.deep
def test_specimens_of_the_shipped_table_are_classified_and_reported(tmp_path):
    printed = run("classify_csv", tmp_path)
    for specimen, group in {"S1": "C1", "S4": "C2"}.items():
        decisions = [line for line in printed.splitlines() if line.startswith(specimen)]
        assert decisions and group in decisions[-1]
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert "New specimens" in page


@pytest.mark.long
@pytest.mark.deep
def test_pooled_classes_of_the_cohort_are_overconfident(tmp_path):
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
def test_study_of_the_unloaded_radius_compares_laws_and_writes_its_figures(tmp_path):
    printed = run("unloaded_radius", tmp_path)
    assert all(f"{law} " in printed for law in LAWS[:2])
    names = {path.name for path in (tmp_path / "results" / "unloaded_radius").glob("*.png")}
    assert names == {"left_out.png", "radius.png", "evidence.png"}


@pytest.mark.deep
def test_true_model_of_the_simulated_aortas_finds_the_group_of_a_specimen(tmp_path):
    run("simulated_aortas", tmp_path)
    known = xr.load_dataset(tmp_path / "results" / "simulated_aortas" / "true_new.nc")
    best = known["class_probability"].idxmax("class_label").values.tolist()
    assert best == ["control", "treated"]


@pytest.mark.long
@pytest.mark.deep
@pytest.mark.parametrize(
    ("study", "figures", "words"),
    [
        ("rubber", {"predictions.png"}, ["LopezPamies", "equibiaxial: predicted"]),
        ("skin", {"left_out.png"}, ["HolzapfelGasserOgden", "without strip y"]),
        ("inflation_and_strip", {"tests.png", "intervals.png"}, ["SIMULATED", "both / strip"]),
    ],
)
def test_study_of_sheets_prints_its_tables_and_writes_its_figures(study, figures, words, tmp_path):
    printed = run(study, tmp_path)
    assert "log evidence" in printed
    assert all(word in printed for word in words)
    assert {path.name for path in (tmp_path / "results" / study).iterdir()} == figures


@pytest.mark.parametrize("study", sorted(ELSEWHERE))
def test_study_without_its_data_is_refused_with_the_missing_tables(study, tmp_path, monkeypatch):
    monkeypatch.delenv("MURINE_ELASTASE", raising=False)
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(EXAMPLES)
    monkeypatch.setenv("MPLBACKEND", "agg")
    with pytest.raises(FileNotFoundError, match=r"(?s)MURINE_ELASTASE.*murine_elastase_pd\.csv"):
        runpy.run_path(str(EXAMPLES / f"{study}.py"), run_name="__main__")
