"""Recorded numbers of the package have not changed, see record.py."""

import pytest
import record

RECORDED = record.read()


@pytest.mark.deep
@pytest.mark.parametrize("case", record.CASES)
def test_numbers_equal_the_recorded_numbers(case):
    """Deterministic numbers up to rounding, sampled numbers up to Monte Carlo error."""
    found = record.entry(case, RECORDED[case])
    assert not record.differences(case, RECORDED[case], found)


def test_every_case_is_recorded():
    """Each case has a record, and each record a case."""
    assert set(RECORDED) == set(record.CASES)
