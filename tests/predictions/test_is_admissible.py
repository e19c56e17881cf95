"""is_admissible: which draws behave as solids do."""

import numpy as np
import pytest
from tube_posteriors import (
    LAWS,
    SHEEP,
    SOFTENING,
    fitted_tree,
    maximum_of_softening,
    one_draw,
    result,
)

import pymc_hyperelastic as ph

TUBE = ph.Tube(**SHEEP)

pytestmark = pytest.mark.compiled  # in both tiers: predictions are compiled for each law


def test_negative_modulus_is_not_admissible():
    found = ph.is_admissible(
        result(mu=[20.0, -1.0, 5.0]), [6.0, 7.0, 9.0], energy=ph.NeoHookean(), tube=TUBE
    )
    for name in ("pressure_rises", "baker_ericksen"):
        assert found[name].dims == ("chain", "draw")
        assert found[name].values.tolist() == [[True, False, True]]
        assert found[name].attrs["fraction"] == 2 / 3
    assert found.attrs["summary"] == (
        "From 6 to 9 mm, of 3 draws: pressure rises in 66.7 %, Baker-Ericksen holds in 66.7 %."
    )


def test_softening_tube_violates_rising_pressure_but_not_baker_ericksen():
    top, _ = maximum_of_softening()
    softening = {"energy": ph.PowerLawNeoHookean(), "tube": TUBE}
    found = ph.is_admissible(one_draw(SOFTENING), np.linspace(7, 1.1 * top, 50), **softening)
    assert not found["pressure_rises"].item()
    assert found["baker_ericksen"].item()
    below = ph.is_admissible(one_draw(SOFTENING), [7, 0.9 * top], **softening)
    assert below["pressure_rises"].item()


@pytest.mark.parametrize("axial", [0.8, 1.0, 1.3])
def test_baker_ericksen_of_mooney_rivlin_equals_its_closed_form(axial):
    """``c10 + λk² c01 > 0`` for each of the three stretches, at each position in the wall."""
    ratio = np.linspace(-1.2, 0.2, 300)
    radius = np.linspace(6.5, 9.0, 7)
    tube = ph.Tube(**SHEEP, axial_stretch=axial)
    tree = result(c10=np.full(300, 10.0), c01=10 * ratio)
    found = ph.is_admissible(tree, radius, energy=ph.MooneyRivlin(), tube=tube)["baker_ericksen"][0]
    reference = np.linspace(7.0, 9.0, 11)
    r = np.sqrt(radius[:, None] ** 2 + (reference**2 - 49) / axial)
    hoop = r / reference
    largest = max(np.max(hoop), np.max(1 / (hoop * axial)), axial)
    np.testing.assert_array_equal(found, 1 + largest**2 * ratio > 0)


def test_material_beyond_its_largest_stretch_is_not_admissible():
    found = ph.is_admissible(
        result(mu=[20.0, 20.0], limit=[0.05, 5.0]), [7.0, 9.0], energy=ph.Gent(), tube=TUBE
    )
    for name in ("pressure_rises", "baker_ericksen"):
        assert found[name].values.tolist() == [[False, True]]


def test_anisotropic_laws_have_no_baker_ericksen_variable():
    energy, parameters = LAWS["fibres"]
    found = ph.is_admissible(one_draw(parameters), [7.0, 8.0], energy=energy, tube=TUBE)
    assert list(found) == ["pressure_rises"]
    assert "Baker" not in found.attrs["summary"]


def test_default_radii_cover_the_range_of_the_data():
    tree = fitted_tree(mu=[20.0, 30.0])
    radius = tree["constant_data"]["radius"]
    expected = f"From {radius.min():g} to {radius.max():g} mm"
    assert ph.is_admissible(tree).attrs["summary"].startswith(expected)
