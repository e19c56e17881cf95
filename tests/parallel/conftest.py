"""Data that all tests of cohorts share."""

import pytest
from simulated_work import SimulatedWork, cohort, computed


@pytest.fixture(scope="session")
def data():
    return cohort()


@pytest.fixture(scope="session")
def undisturbed(data, tmp_path_factory):
    """Return the result of work in one process, without failures."""
    return computed(SimulatedWork(), data, tmp_path_factory.mktemp("undisturbed") / "store")
