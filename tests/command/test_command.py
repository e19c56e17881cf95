"""The command line: from tables to a report, and one message for what is wrong."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import pymc_hyperelastic as ph
from pymc_hyperelastic.command.main import main

MESSY = Path(__file__).parents[1] / "data" / "messy"
FEW = ["--draws", "200", "--chains", "2", "--quiet"]


@pytest.fixture
def run(monkeypatch, capsys):
    """A command in this process: what it printed, or the message with which it ended."""

    def command(*words):
        monkeypatch.setattr(sys, "argv", ["pymc-hyperelastic", *map(str, words)])
        # Warnings are printed as lines there, and stay warnings here.
        monkeypatch.setattr("warnings.showwarning", None)
        try:
            main()
        except SystemExit as end:
            if end.code not in (None, 0):
                raise
        return capsys.readouterr().out

    return command


@pytest.fixture(scope="module")
def table(tmp_path_factory):
    """The simulated sheep aortas as a laboratory would have them, in mmHg."""
    data = ph.load_dataset("simulated_sheep_aorta")
    test = data["test"].values
    frame = pd.DataFrame({"radius [mm]": data["radius"].values})
    frame["pressure [mmHg]"] = data["pressure"].values / ph.mmHg
    for name in ("specimen", "experiment", "group"):
        frame[name] = data[name].values[test]
    for name in ("inner_radius", "outer_radius"):
        frame[f"{name} [mm]"] = data[name].values[test]
    frame["split"] = ["new" if experiment == 3 else "train" for experiment in frame["experiment"]]
    path = tmp_path_factory.mktemp("table") / "aortas.csv"
    frame.to_csv(path, index=False)
    return path


def test_check_says_what_is_understood_and_draws_it(run, table, tmp_path):
    said = run("check", table, "--figure", tmp_path / "curves.png")
    assert "mmHg" in said
    assert "5 specimens" in said or "specimens: 5" in said
    assert (tmp_path / "curves.png").stat().st_size > 10_000


def test_what_is_wrong_is_one_message_with_file_and_line(run, tmp_path):
    with pytest.raises(SystemExit) as ended:
        run("check", MESSY / "text_in_numbers.csv")
    assert str(ended.value).startswith("error: ")
    assert "text_in_numbers.csv, line" in str(ended.value)
    with pytest.raises(SystemExit, match=r"error: .*nothing\.csv"):
        run("check", tmp_path / "nothing.csv")


def test_from_a_table_to_a_report(run, table, tmp_path):
    """Fit, classify, report: each finds what the one before has left in the folder."""
    study = tmp_path / "study"
    pooled = ["--variability", "none", "--noise", "5 mmHg"]
    said = run("fit", table, *pooled, *FEW, "--out", study)
    assert "Ogden, group C1: log evidence" in said
    assert [path.name for path in study.iterdir()] == ["classes-Ogden.nc"]
    said = run("classify", table, "--out", study, "--cores", 1, "--quiet")
    found = pd.read_csv(study / "classified.csv")
    assert found["decision"].tolist() == found["group"].tolist()
    assert "P(C1)" in said
    run("report", study, "--title", "Sheep <aortas>")
    page = (study / "report.html").read_text(encoding="utf-8")
    assert "<h1>Sheep &lt;aortas&gt;</h1>" in page
    assert "SIMULATED" not in page  # nobody said so in the table


# A few draws of so small classes have walls that cannot bear the pressure.
@pytest.mark.filterwarnings("ignore:.*of its specimens have no")
@pytest.mark.deep
def test_groups_are_compared(run, table, tmp_path):
    """Classes with variability, noise unknown, are what is fitted unless something else is said."""
    study = tmp_path / "study"
    run("fit", table, "--draws", "500", "--chains", "1", "--quiet", "--out", study)
    said = run("compare", "--out", study, "--pressure", "100 mmHg")
    assert "log compliance" in said
    run("report", study)
    assert "Differences" in (study / "report.html").read_text(encoding="utf-8")


@pytest.mark.deep
def test_outer_diameters_and_a_stranger(run, table, tmp_path):
    """Outer diameters do in place of radii, and a graft is of neither of the classes."""
    frame = pd.read_csv(table).rename(columns={"radius [mm]": "radius"})
    # Of S3 the third experiment is new, of the others the first two are known.
    frame = frame[(frame["specimen"] == "S3") == (frame["experiment"] == 3)]
    tube = {"inner_radius": 7.0, "outer_radius": 9.0}
    radius = np.linspace(7.02, 7.3, 15)
    pressure = ph.inflation_pressure(ph.Ogden(), radius, mu=500.0, alpha=2.0, **tube).eval()
    graft = {"specimen": "graft", "experiment": 1, "split": "new", "group": "unknown"}
    graft |= {f"{name} [mm]": value for name, value in tube.items()}
    points = {"radius": radius, "pressure [mmHg]": pressure / ph.mmHg}
    frame = pd.concat([frame, pd.DataFrame(graft | points)])
    frame["outer_diameter [mm]"] = 2 * np.sqrt(frame.pop("radius") ** 2 + 9.0**2 - 7.0**2)
    frame.to_csv(tmp_path / "diameters.csv", index=False)
    study = tmp_path / "study"
    run("fit", tmp_path / "diameters.csv", *FEW, "--out", study)
    limits = ["--undecided-below", 0.6, "--none-below", 0.05]
    run("classify", tmp_path / "diameters.csv", *limits, "--out", study, "--cores", 1, "--quiet")
    found = pd.read_csv(study / "classified.csv").set_index("specimen")
    assert found["decision"].to_dict() == {"S3": "C1", "graft": "none of these"}
    assert found["p-value C1"].between(0, 1).all()


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["fit", "FILE", "--noise", "5"], "--noise is '5'; expected a number and its unit"),
        (["fit", "FILE", "--noise", "-1 mmHg"], "--noise is '-1 mmHg'; expected a positive"),
        (["fit", "FILE", "--noise", "1 mm"], "--noise='mm' does not measure pressure"),
        (["classify", "FILE", "--out", "OUT"], "holds no classes: make them with"),
        (["report", "OUT"], "holds no classes: make them with 'pymc-hyperelastic fit'"),
        (["compare", "--out", "OUT"], "holds no classes"),
    ],
)
def test_options_that_are_wrong_are_named(words, message, run, table, tmp_path):
    names = {"FILE": str(table), "OUT": str(tmp_path / "out")}
    with pytest.raises(SystemExit) as ended:
        run(*(names.get(word, word) for word in words))
    assert message in str(ended.value)


def test_no_such_command_is_said_on_stderr():
    done = subprocess.run(
        [sys.executable, "-m", "pymc_hyperelastic", "chekc"], capture_output=True, text=True
    )
    assert done.returncode == 2
    assert "No such command" in done.stderr
    assert "Traceback" not in done.stderr
