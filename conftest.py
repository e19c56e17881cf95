"""What holds for all tests: how they are compiled, and how long one may take."""

import gc
import os
from collections.abc import Generator
from contextlib import nullcontext

import pytensor
import pytest

# Seconds of the processor, whatever else the computer does. Tests are made to take less than 7, so
# that a slower computer passes too.
LONGEST_TEST = 10.0

_spent = pytest.StashKey[float]()


def pytest_addoption(parser: pytest.Parser) -> None:
    """Let the command line say how."""
    parser.addoption(
        "--longest-test",
        type=float,
        default=LONGEST_TEST,
        metavar="SECONDS",
        help="fail a test that takes longer and is not marked deep; 0 for no limit "
        f"(default: {LONGEST_TEST:g})",
    )
    parser.addoption(
        "--compiled",
        action="store_true",
        help="run tests that are not marked deep as those that are: compiled as users have it, "
        "for as long as it takes",
    )


def pytest_collection_finish() -> None:
    """Spare the garbage collector what was imported: it would look through it again and again."""
    gc.collect()
    gc.freeze()


def _is_quick(item: pytest.Item) -> bool:
    """Whether a test runs as one of the first tier."""
    return not (item.get_closest_marker("deep") or item.config.getoption("compiled"))


@pytest.hookimpl(wrapper=True)
def pytest_runtest_protocol(item: pytest.Item) -> Generator[None, object, object]:
    """Run a test in Python: what it evaluates a few times takes longer to compile for numba.

    Where in the code each variable was made, which PyTensor notes for its error messages, would
    take a fifth of the time.
    """
    in_python = pytensor.config.change_flags(mode="FAST_COMPILE", traceback__limit=0)
    with in_python if _is_quick(item) else nullcontext():
        return (yield)


def _timed(item: pytest.Item) -> Generator[None, object, object]:
    """Add the time that a phase of a test takes."""
    start = _processor_time()
    try:
        return (yield)
    finally:
        item.stash[_spent] = item.stash.get(_spent, 0.0) + _processor_time() - start


def _processor_time() -> float:
    """Seconds that this process and those that it started have had, in the system too."""
    return sum(os.times()[:4])


# What a test is the first to need is set up with it.
pytest_runtest_setup = pytest.hookimpl(wrapper=True)(_timed)
pytest_runtest_call = pytest.hookimpl(wrapper=True)(_timed)


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(
    item: pytest.Item, call: pytest.CallInfo
) -> Generator[None, pytest.TestReport, pytest.TestReport]:
    """Fail a test that took too long, with the fixtures that it was the first to need."""
    report = yield
    limit, spent = item.config.getoption("longest_test"), item.stash.get(_spent, 0.0)
    if limit and call.when == "call" and limit < spent and report.passed and _is_quick(item):
        report.outcome = "failed"
        report.longrepr = (
            f"took {spent:.1f} s of the processor with its fixtures, and a test may take {limit:g} "
            "s: make it faster, mark it deep, or raise --longest-test on a slow computer"
        )
    return report


@pytest.fixture(autouse=True)
def _examples_leave_nothing(request: pytest.FixtureRequest) -> None:
    """Run examples of docstrings, which may write files, in a folder of their own."""
    if isinstance(request.node, pytest.DoctestItem):
        folder = request.getfixturevalue("tmp_path")
        request.getfixturevalue("monkeypatch").chdir(folder)
