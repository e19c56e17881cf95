"""Every number of the package that was recorded is still the same, see record.py."""

import cases
import pytest
import record

import pymc_hyperelastic as ph

RECORDED = record.read()


@pytest.mark.deep
@pytest.mark.parametrize("case", record.CASES)
def test_numbers_are_the_recorded_ones(case):
    """Deterministic numbers up to rounding, sampled numbers up to Monte Carlo error."""
    found = record.entry(case, RECORDED[case])
    assert not record.differences(case, RECORDED[case], found)


def test_every_case_is_recorded_and_every_law_has_one():
    """No number is without its case, and no law of the package without numbers."""
    assert set(RECORDED) == set(record.CASES)
    laws = {name for name in ph.list_strain_energies() if hasattr(ph, name)}
    assert laws == {name.split("(")[0] for name in cases.LAWS}
