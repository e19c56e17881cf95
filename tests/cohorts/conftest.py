"""Specimens by which it is seen how a cohort is done."""

import pytest
from chores import cohort


@pytest.fixture(scope="session")
def data():
    return cohort()
