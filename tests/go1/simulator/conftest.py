"""Dogs with legs, where their parts are installed: `make` does that."""

import pytest


@pytest.fixture
def legged():
    """A factory of bodies with legs that are at rest."""
    from pypose_lite.go1.simulator.body import Numbers
    from pypose_lite.go1.simulator.floor import Floor
    from pypose_lite.go1.simulator.legs.dog import LeggedDog

    def make(seed=0, numbers=None, **floor):
        return LeggedDog(numbers or Numbers(), seed, floor=Floor(**floor))

    return make
