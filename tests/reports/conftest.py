"""Reports that are written and read again."""

import matplotlib as mpl
import pytest
from report_pages import Page

import pymc_hyperelastic as ph
from pymc_hyperelastic.reports.page import Page as Making

mpl.use("Agg")


@pytest.fixture
def write(tmp_path):
    """Write a report, and read it."""

    def written(result, **settings):
        return Page(ph.report(result, tmp_path / "report.html", **settings))

    return written


@pytest.fixture
def write_words(write, monkeypatch):
    """Write a report without its figures, which take most of the time, and read it."""
    monkeypatch.setattr(Making, "figure", lambda *_, **__: None)
    return write
