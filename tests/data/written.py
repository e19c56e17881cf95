"""Tables that tests of read_tests write, and the message by which they are refused."""

from pathlib import Path

import pytest
import xarray as xr

import pymc_hyperelastic as ph

HEAD = "specimen,experiment,radius_mm,pressure_kPa"
ROWS = "S1,1,7.2,1.0\nS1,1,8.4,6.5\n"
KPA_10, KPA_45 = 1.33322387415, 5.999507433675  # of as many mmHg
# Conversions are products of a few numbers.
ROUNDING = 1e-12


def write_tables(folder: Path):
    """Return a function that writes tables a.csv, b.csv, ... and reads them."""

    def write(*tables: str, settings=None, toml: str | None = None) -> xr.Dataset:
        paths = [folder / f"{'abc'[i]}.csv" for i in range(len(tables))]
        for path, table in zip(paths, tables, strict=True):
            path.write_text(table, encoding="utf-8")
        if toml is not None:
            (folder / "study.toml").write_text(toml, encoding="utf-8")
            settings = folder / "study.toml"
        return ph.read_tests(paths, settings)

    return write


def message_of(call, *arguments, **settings) -> str:
    """Return the message of the ValueError that a call raises."""
    with pytest.raises(ValueError) as raised:
        call(*arguments, **settings)
    return str(raised.value)
