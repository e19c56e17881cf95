"""Parts of tables that tests of read_tests write, and the message of a refused call."""

import pytest

HEAD = "specimen,experiment,radius_mm,pressure_kPa"
ROWS = "S1,1,7.2,1.0\nS1,1,8.4,6.5\n"
KPA_10, KPA_45 = 1.33322387415, 5.999507433675  # kPa: 10 and 45 mmHg
# Conversions are products of a few numbers.
ROUNDING = 1e-12


def message_of(call, *arguments, **settings) -> str:
    """Return the message of the ValueError that a call raises."""
    with pytest.raises(ValueError) as raised:
        call(*arguments, **settings)
    return str(raised.value)
