"""A function that writes tables and reads them with read_tests."""

import pytest
import xarray as xr

import pymc_hyperelastic as ph


@pytest.fixture
def written(tmp_path):
    """Return a function that writes tables a.csv, b.csv, ... and reads them."""

    def write(*tables: str, settings=None, toml: str | None = None) -> xr.Dataset:
        paths = [tmp_path / f"{'abc'[i]}.csv" for i in range(len(tables))]
        for path, table in zip(paths, tables, strict=True):
            path.write_text(table, encoding="utf-8")
        if toml is not None:
            settings = tmp_path / "study.toml"
            settings.write_text(toml, encoding="utf-8")
        return ph.read_tests(paths, settings)

    return write
