"""Settings of all benchmarks: one core, and the machine and versions in the file of results."""

import os
from importlib.metadata import version
from pathlib import Path

import pytest

PACKAGES = ("pymc-hyperelastic", "pymc", "pytensor", "numpy", "numba", "jax", "dynesty")


def pytest_collection_modifyitems(items):
    """Mark benchmarks as deep: they are compiled as users compile."""
    for item in items:
        if Path(__file__).parent in item.path.parents:
            item.add_marker(pytest.mark.deep)


# Optional, since the test suite runs without the plugin and this file is loaded even so.
@pytest.hookimpl(optionalhook=True)
def pytest_benchmark_update_machine_info(config, machine_info):
    machine_info["versions"] = {name: version(name) for name in PACKAGES}
    machine_info["cores"] = os.cpu_count()


@pytest.fixture(scope="session", autouse=True)
def one_core():
    """Pin this process and its children to one core: some peers would use all cores."""
    # Only Linux can.
    if not hasattr(os, "sched_setaffinity"):
        yield
        return
    cores = os.sched_getaffinity(0)
    os.sched_setaffinity(0, {max(cores)})
    yield
    os.sched_setaffinity(0, cores)
