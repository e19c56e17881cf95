"""Fitted classes that most tests of this folder read."""

import fits
import pytest


@pytest.fixture(scope="module")
def classes():
    """Return classes of neo-Hookean specimens; tests do not change them."""
    return fits.fit("neo_hookean_classes")
