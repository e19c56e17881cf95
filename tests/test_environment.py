"""The package works without a home, a compiler or a locale, in any folder, and in processes."""

import os
import subprocess
import sys

import pytest

import pymc_hyperelastic as ph

ROWS = "S1,1,7.2,1.0,7,9\nS1,1,7.8,3.5,7,9\nS1,1,8.4,6.5,7,9\n"
TABLE = f"specimen,experiment,radius_mm,pressure_kPa,inner_radius_mm,outer_radius_mm\n{ROWS}"
SCRIPT = """
import sys
from pathlib import Path
import multiprocessing
import pymc_hyperelastic as ph


def evidence(table):
    data = ph.read_tests(table)
    ph.report(data, table.with_name("report.html"))
    model = ph.inflation_model(ph.NeoHookean(), data, 0.5)
    tree = ph.sample_smc(model, 100, 1, random_seed=1, progressbar=False)
    ph.save_result(tree, table.with_name("fit.nc"))
    return ph.log_evidence(ph.open_result(table.with_name("fit.nc"))).value


if __name__ == "__main__":
    table, method = Path(sys.argv[1]), sys.argv[2]
    if method == "none":
        print(evidence(table))
    else:
        with multiprocessing.get_context(method).Pool(1) as pool:
            print(pool.map(evidence, [table])[0])
"""


def evidence_of_script(folder, method, environment):
    """Return the evidence of a table in a folder of an odd name, computed by another process."""
    odd = folder / "ü #1 % [a] 'b'"
    odd.mkdir()
    (odd / "µ.csv").write_text(TABLE, encoding="utf-8")
    (folder / "script.py").write_text(SCRIPT, encoding="utf-8")
    command = [sys.executable, folder / "script.py", odd / "µ.csv", method]
    done = subprocess.run(command, env=environment, cwd=folder, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert "data:image" in (odd / "report.html").read_text(encoding="utf-8")
    return float(done.stdout), odd / "µ.csv"


def expected(table):
    model = ph.inflation_model(ph.NeoHookean(), ph.read_tests(table), 0.5)
    return ph.log_evidence(ph.sample_smc(model, 100, 1, random_seed=1, progressbar=False)).value


def test_package_works_without_home_compiler_and_locale(tmp_path):
    environment = {name: os.environ[name] for name in ("PATH", "PYTHONPATH") if name in os.environ}
    environment["LC_ALL"] = "C"
    environment["PYTENSOR_FLAGS"] = f"cxx=,base_compiledir={tmp_path / 'compiled'}"
    found, table = evidence_of_script(tmp_path, "none", environment)
    assert found == pytest.approx(expected(table))


@pytest.mark.deep
@pytest.mark.parametrize("method", ["spawn", "fork", "forkserver"])
def test_processes_of_every_start_method_give_the_same_evidence(method, tmp_path):
    found, table = evidence_of_script(tmp_path, method, None)
    assert found == pytest.approx(expected(table))
