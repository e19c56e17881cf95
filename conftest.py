"""What holds for all tests: how they are compiled, and how long one may take."""

import gc
from collections.abc import Generator
from contextlib import nullcontext

import pytensor
import pytest

# Seconds. Tests are made to take less than half of it on two idle cores, so that a computer half
# as fast, or a busy one, passes too.
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


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(
    item: pytest.Item, call: pytest.CallInfo
) -> Generator[None, pytest.TestReport, pytest.TestReport]:
    """Fail a test that took too long, with the fixtures that it was the first to need."""
    report = yield
    limit = item.config.getoption("longest_test")
    before = item.stash.get(_spent, 0.0)
    item.stash[_spent] = spent = before + call.duration
    # What takes long to set up is told with the test for which it was.
    too_long = limit < spent and (call.when == "call" or before <= limit)
    if limit and too_long and call.when != "setup" and report.passed and _is_quick(item):
        report.outcome = "failed"
        report.longrepr = (
            f"took {spent:.1f} s with its fixtures, and a test may take {limit:g} s: make it "
            "faster, mark it deep, or raise --longest-test on a slow computer"
        )
    return report
