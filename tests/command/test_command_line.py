"""The command line: from tables to a report, and one message for each mistake."""

import errno
import re
import runpy
import shutil
import sys
from importlib.metadata import version
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import xarray as xr
from interrupts import interrupt
from pytensor.configdefaults import _filter_compiledir

import pymc_hyperelastic as ph
from pymc_hyperelastic.classes import pooled
from pymc_hyperelastic.command import commands
from pymc_hyperelastic.command.main import main
from pymc_hyperelastic.command.sizes import likelihood_of_options, size_of

MESSY = Path(__file__).parents[1] / "data" / "messy"


@pytest.fixture
def run(monkeypatch, capsys):
    """Return a function that runs a command in this process and returns its output."""

    def command(*words):
        monkeypatch.setattr(sys, "argv", ["pymc-hyperelastic", *map(str, words)])
        # The command prints warnings as lines; here they stay warnings.
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
    """The simulated sheep aortas in a table of a laboratory, with pressures in mmHg."""
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


def test_check_prints_how_files_were_read_and_draws_the_curves(run, table, tmp_path):
    printed = run("check", table, "--figure", tmp_path / "curves.png")
    assert "mmHg" in printed
    assert (tmp_path / "curves.png").stat().st_size > 10_000


# NeoHookean does not fit these arteries, and their specimens differ.
MISFIT = pytest.mark.filterwarnings("ignore:.*the best curve is further from the data")


@MISFIT
def test_fit_classify_and_report_work_in_one_folder(run, table, tmp_path):
    study = tmp_path / "study"
    settings = ["--variability", "none", "--pressure-sd", "5 mmHg", "--law", "NeoHookean"]
    printed = run(
        "fit", table, *settings, "--draws", "100", "--chains", "1", "--quiet", "--out", study
    )
    classes = ph.open_result(study / "classes-NeoHookean.nc")
    assert f"NeoHookean, group C1: log evidence {ph.log_evidence(classes['C1'])}" in printed
    # Fits use the rows that are marked "train".
    train = ph.select(ph.load_dataset("simulated_sheep_aorta"), group="C1", experiment=[1, 2])
    assert classes["C1"]["observed_data"]["pressure"].size == train.sizes["obs"]
    printed = run("classify", table, "--out", study, "--cores", 1, "--quiet")
    found = pd.read_csv(study / "classified.csv")
    assert found["specimen"].tolist() == ["S1", "S2", "S3", "S4", "S5"]
    assert found["decision"].tolist() == found["group"].tolist()
    result = ph.open_result(study / "classified")
    np.testing.assert_allclose(found["P(C2)"], result["class_probability"].sel(class_label="C2"))
    assert "P(C1)" in printed
    # Another fit replaces the first one only with --overwrite.
    fit = ["fit", table, *settings, "--chains", "1", "--quiet", "--out", study, "--draws"]
    with pytest.raises(SystemExit, match=r"draws is 100 there and 120 here.*--overwrite"):
        run(*fit, "120")
    run(*fit, "120", "--overwrite")
    run("report", "--out", study, "--title", "Sheep <aortas>")
    page = (study / "report.html").read_text(encoding="utf-8")
    assert "<h1>Sheep &lt;aortas&gt;</h1>" in page and "New specimens" in page
    assert "the decisions were made with other classes than Classes on this page" in page
    with pytest.raises(
        SystemExit, match=r"holds other work: classes, 1, C1 are not the same; .*--overwrite"
    ):
        run("classify", table, "--out", study, "--cores", 1, "--quiet")
    shutil.rmtree(study / "classes-NeoHookean")
    with pytest.raises(SystemExit, match=r"NeoHookean\.nc exists already: replace it with --over"):
        run(*fit, "120")


@MISFIT
def test_interrupted_fit_exits_with_130_and_keeps_the_old_result(
    run, table, tmp_path, monkeypatch, capsys
):
    interrupt(monkeypatch, pooled, "run_smc", call=2)
    before = tmp_path / "classes-NeoHookean.nc"
    before.write_text("a complete result")
    law = ["--variability", "none", "--law", "NeoHookean", "--law", "Ogden"]
    rest = ["--quiet", "--overwrite", "--out", tmp_path]
    with pytest.raises(SystemExit) as ended:
        run("fit", table, *law, "--draws", "100", "--chains", "1", *rest)
    assert ended.value.code == 130 and "repeat the command to continue" in capsys.readouterr().err
    assert list(tmp_path.glob("*.nc")) == [before] and before.read_text() == "a complete result"
    assert (tmp_path / "classes-NeoHookean" / "class-0.nc").exists()


# Some draws of these small classes have walls that cannot bear the pressure.
@pytest.mark.filterwarnings("ignore:.*of its specimens have no")
@pytest.mark.deep
def test_compare_command_stores_and_reports_differences_of_groups(run, table, tmp_path):
    """By default specimens of a class differ, and the noise is inferred."""
    study = tmp_path / "study"
    run("fit", table, "--draws", "200", "--chains", "1", "--quiet", "--out", study)
    between = ["--pressure-range", "80-120 mmHg", "--quantity", "stored_energy_change"]
    printed = run("compare", "--out", study, *between, "--quantity", "log compliance")
    assert "log compliance" in printed
    assert "those at 100 mmHg, with the pressure range 80-120 mmHg." in printed
    found = ph.open_result(study / "comparison-groups.nc")
    assert found["pressure"].item() == pytest.approx(100 * ph.mmHg)
    run("report", "--out", study)
    assert "Differences" in (study / "report.html").read_text(encoding="utf-8")


@pytest.mark.deep
def test_compare_command_compares_parameters_of_sheets(run, tmp_path):
    """Sheets have no pressures, and so no properties at a pressure; the report names no tube."""
    stretch, rng = np.linspace(1.05, 1.3, 6), np.random.default_rng(1)
    rows = []
    for group, mu in (("soft", 15.0), ("stiff", 60.0)):
        for number in range(3):
            own = mu * np.exp(0.1 * rng.standard_normal()) * (stretch - stretch**-2)
            rows.append(
                pd.DataFrame(
                    {
                        "specimen": f"{group} {number}",
                        "group": group,
                        "experiment": 1,
                        "stretch": stretch,
                        "nominal stress [kPa]": own + 0.2 * rng.standard_normal(6),
                        "kind": "uniaxial",
                    }
                )
            )
    table, study = tmp_path / "strips.csv", tmp_path / "study"
    pd.concat(rows).to_csv(table, index=False)
    fit = ["--law", "NeoHookean", "--stress-sd", "0.2 kPa", "--draws", "500", "--chains", "1"]
    run("fit", table, *fit, "--quiet", "--out", study)
    printed = run("compare", "--out", study)
    found = ph.open_result(study / "comparison-groups.nc")
    assert found["quantity"].values.tolist() == ["mu"]
    typical = found.sel(statistic="typical").squeeze()
    difference, (low, high) = typical["difference"].item(), typical["difference_interval"].values
    first = next(line for line in printed.splitlines() if "typical" in line)
    *shown, probability = [float(number) for number in re.findall(r"[\d.]+", first)]
    rounding = 0.05 * (high - low)
    np.testing.assert_allclose(shown, [difference, low, high], rtol=0, atol=rounding)
    rises = typical["probability_of_rise"].item()
    assert probability == pytest.approx(rises, abs=2e-3)  # 1 is printed as >0.999
    assert "kPa" in first and "pressure" not in printed
    assert difference == pytest.approx(60 - 15, abs=20)
    run("report", "--out", study)
    page = (study / "report.html").read_text(encoding="utf-8")
    assert "Differences" in page and "one tube" not in page


def test_likelihood_is_read_from_the_settings_file(run, table, tmp_path):
    settings = tmp_path / "study.toml"
    settings.write_text('[likelihood]\npressure_sd = "5"\n')
    with pytest.raises(SystemExit, match=r"likelihood\.pressure_sd is '5'; expected a number"):
        run("fit", table, settings)


def test_sizes_of_errors_are_converted_to_internal_units():
    assert size_of("--pressure-sd", "2 mmHg", "pressure") == pytest.approx(2 * ph.mmHg)
    assert size_of("--diameter-sd", " 5e1 um ", "length") == pytest.approx(0.05)
    data = ph.load_dataset("simulated_sheep_aorta")
    sizes = {"force_sd": "0.5 mN", "diameter_sd": "5 um", "sigma": None}
    found = likelihood_of_options(sizes, {}, data)
    assert found.force_sd == 0.5 and found.diameter_sd == pytest.approx(0.005)
    assert found.pressure_sd.owner.op.name == "halfnormal"
    assert likelihood_of_options({}, {"pressure_sd": "1 kPa"}, data) == ph.Gaussian(1.0)
    found = likelihood_of_options({"sigma": "1 kPa"}, {}, data)
    assert found == ph.SlopeAugmented(1.0, ph.balanced_slope_weight(data))
    stated = {"sigma": "9 kPa", "force_sigma": "2 mN", "slope_weight": 0.5}
    found = likelihood_of_options({"sigma": "1 kPa", "slope_weight": None}, stated, data)
    assert found == ph.SlopeAugmented(1.0, 0.5, force_sigma=2.0)
    for table, message in (
        ({"noise": "1 kPa"}, "likelihood.noise is not known; expected some of"),
        ({"sigma": 1.0}, "likelihood.sigma is 1.0; expected a number and its unit"),
        (
            {"sigma": "1 kPa", "diameter_sd": "5 um"},
            "likelihood.diameter_sd and likelihood.sigma are",
        ),
    ):
        with pytest.raises(ValueError, match=message):
            likelihood_of_options({}, table, data)


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["check", MESSY / "text_in_numbers.csv"], "text_in_numbers.csv, line"),
        (["check", "nothing.csv"], "nothing.csv"),
        (["fit", "FILE", "--pressure-sd", "5"], "--pressure-sd is '5'; expected a number and"),
        (["fit", "FILE", "--pressure-sd", "0 mmHg"], "is '0 mmHg'; expected a positive"),
        (["fit", "FILE", "--pressure-sd", "1 mm"], "--pressure-sd='mm' does not measure pressure"),
        (
            ["fit", "FILE", "--slope-weight", "1"],
            "--slope-weight is given, but it belongs to",
        ),
        (
            ["fit", "FILE", "--force-sigma", "1 mN"],
            "--force-sigma is given, but it belongs to",
        ),
        (
            ["fit", "FILE", "--sigma", "1 kPa", "--diameter-sd", "5 um"],
            "--diameter-sd and --sigma are given, of which one excludes",
        ),
        (
            ["fit", "FILE", "--variability", "none", "--experiment-effect"],
            "--experiment-effect needs --variability specimen",
        ),
        (["classify", "FILE", "--out", "OUT"], "holds no classes: make them with"),
        (["report", "--out", "OUT"], "holds no classes: make them with 'pymc-hyperelastic fit'"),
        (["compare", "--out", "OUT"], "holds no classes"),
        (
            ["report", "--out", "OUT", "--page", "thesis.nc"],
            "--page is 'thesis.nc'; expected a file",
        ),
        (["check", "FILE", "--figure", "."], "--figure is '.'; expected a file"),
    ],
)
def test_wrong_input_ends_with_one_message_that_names_it(words, message, run, table, tmp_path):
    names = {"FILE": table, "OUT": tmp_path / "out"}
    with pytest.raises(SystemExit) as ended:
        run(*(names.get(word, word) for word in words))
    assert str(ended.value).startswith("error: ")
    assert message in str(ended.value)


def test_closed_pipe_ends_the_command_without_a_message(run, table, tmp_path, monkeypatch, capsys):
    def closed(*_, **__):
        raise BrokenPipeError(errno.EPIPE, "Broken pipe")

    monkeypatch.setattr("typer.echo", closed)
    monkeypatch.setattr("sys.stdout", sys.stdout)  # Typer replaces it
    monkeypatch.setattr("sys.stderr", sys.stderr)
    with pytest.raises(SystemExit) as ended:
        run("check", table, "--figure", tmp_path / "curves.png")
    assert ended.value.code == 1 and not capsys.readouterr().err


def test_cache_folder_that_cannot_be_written_is_reported_with_what_to_set(
    run, table, tmp_path, monkeypatch
):
    def read(*_):
        return _filter_compiledir(table / ".pytensor")  # the table is no folder

    monkeypatch.setattr("pymc_hyperelastic.command.commands.read_tests", read)
    with pytest.raises(SystemExit, match="export PYTENSOR_FLAGS=base_compiledir=/a/folder"):
        run("check", table)


def test_python_m_runs_the_command(monkeypatch, capsys):
    monkeypatch.setattr(sys, "argv", ["pymc-hyperelastic", "--help"])
    monkeypatch.setattr("warnings.showwarning", None)
    runpy.run_module("pymc_hyperelastic", run_name="__main__")
    assert "classify" in capsys.readouterr().out


def test_unknown_command_is_reported_on_stderr(run, capsys):
    with pytest.raises(SystemExit) as ended:
        run("chekc")
    assert ended.value.code == 2
    assert "No such command" in capsys.readouterr().err


def test_version_option_prints_the_package_version(run):
    assert run("--version") == f"pymc-hyperelastic {version('pymc-hyperelastic')}\n"


def test_text_that_a_spreadsheet_would_evaluate_is_quoted(run, table, tmp_path, monkeypatch):
    names = ["=1+1", "-A", "+A", "@A", "S1"]
    decisions = xr.Dataset(
        {
            "decision": ("specimen", ["-a", "b", "b", "b", "b"]),
            "class_probability": (("specimen", "class_label"), np.tile([0.25, 0.75], (5, 1))),
            "class_probability_se": (("specimen", "class_label"), np.tile(-0.5, (5, 2))),
            "error": ("specimen", ["", "=no", "", "", ""]),
        },
        {"specimen": names, "class_label": ["-a", "b"]},
    )
    monkeypatch.setattr(commands, "classes_of", lambda study: [xr.DataTree()])
    monkeypatch.setattr(commands, "classify_new", lambda *given, **settings: decisions)
    run("classify", table, "--out", tmp_path)
    found = pd.read_csv(tmp_path / "classified.csv", keep_default_na=False)
    assert found["specimen"].tolist() == ["'=1+1", "'-A", "'+A", "'@A", "S1"]
    assert found["decision"].tolist()[0] == "'-a" and found["error"].tolist()[1] == "'=no"
    assert found["P(-a)"].tolist() == [0.25] * 5 and found["± -a"].tolist() == [-0.5] * 5
