"""Units are converted at the door, and nothing wrong passes it."""

import subprocess
import sys

import numpy as np
import pytest

from pymc_hyperelastic.data import units
from pymc_hyperelastic.data.units import INTERNAL_UNITS, mmHg, to_internal

# Conversion factors are products of a few exact numbers: a few roundings at most.
ROUNDING = 1e-14


@pytest.mark.parametrize(
    ("value", "unit", "quantity", "expected"),
    [
        (100.0, "mmHg", "pressure", 13.3322387415),
        (2.5, "kPa", "pressure", 2.5),
        (2500.0, "Pa", "pressure", 2.5),
        (0.002, "MPa", "pressure", 2.0),
        (227.377, "um", "length", 0.227377),
        (227.377, "µm", "length", 0.227377),
        (1.0, "inch", "length", 25.4),
        (90.0, "deg", "angle", np.pi / 2),
        (0.3, "rad", "angle", 0.3),
    ],
)
def test_known_conversions(value, unit, quantity, expected):
    """A value keeps its meaning when its unit changes."""
    np.testing.assert_allclose(to_internal(value, unit, quantity), expected, rtol=ROUNDING)


@pytest.mark.parametrize(("quantity", "unit"), INTERNAL_UNITS.items())
def test_internal_units_change_nothing(quantity, unit):
    """Values that are in kPa, mm or rad already keep every bit, and their shape."""
    values = np.array([[0.1, 1 / 3], [np.pi, -7.3]])
    np.testing.assert_array_equal(to_internal(values, unit, quantity), values)


def test_mmhg_is_the_registry_s():
    """``sigma=5 * ph.mmHg`` means what ``pressure_unit="mmHg"`` means."""
    np.testing.assert_allclose(to_internal(1.0, "mmHg", "pressure"), mmHg, rtol=ROUNDING)


@pytest.mark.parametrize(
    ("unit", "quantity", "complaint"),
    [
        ("mmhg", "pressure", "not a known unit"),
        ("5 kPa", "pressure", "not a known unit"),
        ("kPa(", "pressure", "not a known unit"),
        (None, "length", "not a known unit"),
        (3, "length", "not a known unit"),
        ("mm", "pressure", "does not measure pressure"),
        ("kPa", "length", "does not measure length"),
        ("mm**2", "length", "does not measure length"),
        ("mm", "angle", "does not measure angle"),
        # To pint these two have the dimension of an angle: none.
        ("percent", "angle", "does not measure angle"),
        ("", "angle", "does not measure angle"),
    ],
)
def test_wrong_units_are_named(unit, quantity, complaint):
    """An unknown or unfit unit raises one error with keyword, unit and examples of good ones."""
    with pytest.raises(ValueError, match=complaint) as error:
        to_internal(1.0, unit, quantity, keyword="some_unit")
    assert f"some_unit={unit!r}" in str(error.value)
    assert f"{INTERNAL_UNITS[quantity]!r}" in str(error.value)


def test_keyword_defaults_to_the_quantity():
    """Without a keyword the error names the argument that most callers have."""
    with pytest.raises(ValueError, match="pressure_unit='furlong'"):
        to_internal(1.0, "furlong", "pressure")


def test_pint_is_not_imported_before_it_is_needed():
    """Importing the module stays fast: the registry is built at the first conversion."""
    # The file by itself, so that what else the package imports does not count.
    code = (
        f"import runpy, sys; names = runpy.run_path({units.__file__!r});"
        "assert 'pint' not in sys.modules;"
        "names['to_internal'](1.0, 'mmHg', 'pressure'); assert 'pint' in sys.modules"
    )
    subprocess.run([sys.executable, "-c", code], check=True)
