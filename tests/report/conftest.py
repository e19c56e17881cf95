"""Reports that are written and read again."""

import matplotlib as mpl
import pytest
from pages import Page

import pymc_hyperelastic as ph

mpl.use("Agg")


@pytest.fixture
def write(tmp_path):
    """Write a report, and read it."""

    def written(result, **settings):
        return Page(ph.report(result, tmp_path / "report.html", **settings))

    return written
