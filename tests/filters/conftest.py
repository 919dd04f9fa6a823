"""Everything here is float64, unless a test says otherwise."""

import pytest


@pytest.fixture(autouse=True)
def _float64(float64):
    pass
