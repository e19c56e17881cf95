"""Settings of all tests: how they are compiled, and the folder where docstring examples run."""

import gc
import re
import shutil
from collections import Counter
from collections.abc import Generator
from contextlib import nullcontext

import fits
import pytensor
import pytest
import xarray as xr

import pymc_hyperelastic as ph

# Letters of a list or dict that is shown in the name of a parametrised case.
_LONGEST_ID = 80


def pytest_addoption(parser: pytest.Parser) -> None:
    """Add the options of this project."""
    parser.addoption(
        "--compiled",
        action="store_true",
        help="compile every test as users do, not only tests marked deep",
    )
    parser.addoption(
        "--times-per-file",
        action="store_true",
        help="print the total time of each file of tests, the slowest first",
    )


@pytest.fixture(scope="module")
def classes() -> xr.DataTree:
    """Return fitted classes of neo-Hookean specimens, which tests must not change."""
    return fits.fit("neo_hookean_classes")


def pytest_make_parametrize_id(val: object, argname: str) -> str | None:
    """Name parametrised cases by their values, where pytest would use a bare or numbered name."""
    if isinstance(val, float):
        return f"{argname}={val:.6g}"
    if val is None or isinstance(val, bool | int):
        return f"{argname}={val}"
    if isinstance(val, ph.StrainEnergy):
        return repr(val)
    if isinstance(val, dict | list | tuple):
        text = f"{argname}={val}"
        return text if _is_plain(val) and len(text) < _LONGEST_ID else None
    return argname if getattr(val, "__name__", None) == "<lambda>" else None


def _is_plain(val: object) -> bool:
    """Return True for text, numbers, None, and for lists and dicts of these."""
    if isinstance(val, dict):
        return all(_is_plain(entry) for entry in (*val, *val.values()))
    if isinstance(val, list | tuple):
        return all(_is_plain(entry) for entry in val)
    return type(val) in (str, int, float, bool, type(None))


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Ignore warnings of doubtful fits in docstring examples, whose laws may not fit their data."""
    for item in items:
        if isinstance(item, pytest.DoctestItem):
            item.add_marker(pytest.mark.filterwarnings("ignore:.*the fit is doubtful"))


def pytest_collection_finish() -> None:
    """Exclude imported modules from garbage collection, which would inspect them repeatedly."""
    gc.collect()
    gc.freeze()


@pytest.hookimpl(wrapper=True)
def pytest_runtest_protocol(item: pytest.Item) -> Generator[None, object, object]:
    """Evaluate the graphs of first-tier tests in Python.

    A test evaluates a graph a few times, and numba takes longer to compile it. Without a limit of
    0, PyTensor would also record where each variable was made, which takes a fifth of the time.
    """
    compiled = item.get_closest_marker("deep") or item.config.getoption("compiled")
    in_python = pytensor.config.change_flags(mode="FAST_COMPILE", traceback__limit=0)
    with nullcontext() if compiled else in_python:
        return (yield)


def pytest_terminal_summary(
    terminalreporter: pytest.TerminalReporter, config: pytest.Config
) -> None:
    """Print the time that the tests of each file took, with their fixtures."""
    if not config.getoption("times_per_file"):
        return
    seconds = Counter()
    for reports in terminalreporter.stats.values():
        for report in reports:
            if isinstance(report, pytest.TestReport):
                seconds[report.location[0]] += report.duration
    terminalreporter.section("seconds per file")
    for path, total in seconds.most_common():
        terminalreporter.line(f"{total:7.1f}  {path}")


@pytest.fixture(autouse=True)
def _folder_of_docstring_examples(request: pytest.FixtureRequest) -> None:
    """Run each docstring example in an empty folder that holds the stored fits it opens."""
    if isinstance(request.node, pytest.DoctestItem):
        folder = request.getfixturevalue("tmp_path")
        request.getfixturevalue("monkeypatch").chdir(folder)
        source = "".join(example.source for example in request.node.dtest.examples)
        for name in re.findall(r'open_result\("(\w+)\.nc"\)', source):
            if name in fits.FITS:
                shutil.copy(fits.stored(name), folder)
