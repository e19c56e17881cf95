"""Units are converted to kPa, mm, mN and rad, or refused."""

import numpy as np
import pytest

from pymc_hyperelastic.data.units import mmHg, to_internal
from pymc_hyperelastic.quantities import UNITS

# Conversion factors are products of a few exact numbers: a few roundings at most.
ROUNDING = 1e-14


@pytest.mark.parametrize(
    ("value", "unit", "quantity", "expected"),
    [
        (100.0, "mmHg", "pressure", 13.3322387415),
        (1.0, "mmHg", "pressure", mmHg),
        (0.002, "MPa", "pressure", 2.0),
        (227.377, "µm", "length", 0.227377),
        (1.0, "gram_force", "force", 9.80665),
        (90.0, "deg", "angle", np.pi / 2),
    ],
)
def test_values_are_converted_to_internal_units(value, unit, quantity, expected):
    np.testing.assert_allclose(to_internal(value, unit, quantity), expected, rtol=ROUNDING)


def test_values_in_internal_units_stay_unchanged_to_the_last_bit():
    values = np.array([[0.1, 1 / 3], [np.pi, -7.3]])
    for dimension in ("pressure", "length", "force", "angle"):
        unit = UNITS[dimension][0]
        np.testing.assert_array_equal(to_internal(values, unit, dimension), values)


@pytest.mark.parametrize(
    ("unit", "quantity", "complaint"),
    [
        ("mmhg", "pressure", "not a known unit"),
        ("g", "force", "write gf for grams of force, or convert to mN"),
        ("gramm", "force", "write gf for grams of force"),
        ("5 kPa", "pressure", "not a known unit"),
        ("mm**2", "length", "does not measure length"),
        # In pint a pixel is 1/96 inch.
        ("px", "length", "is a unit of length that is not used"),
        ("point", "length", "is a unit of length that is not used"),
        # In pint a per cent and an angle have the same dimension: none.
        ("percent", "angle", "does not measure angle"),
    ],
)
def test_unsuitable_unit_is_refused_with_its_keyword_and_examples(unit, quantity, complaint):
    with pytest.raises(ValueError, match=complaint) as error:
        to_internal(1.0, unit, quantity, keyword="some_unit")
    assert f"some_unit={unit!r}" in str(error.value)
    assert UNITS[quantity][0] in str(error.value)
    with pytest.raises(ValueError, match=f"{quantity}_unit="):
        to_internal(1.0, unit, quantity)
