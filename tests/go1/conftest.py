import pytest
from go1_helpers import Watched


@pytest.fixture
def watch():
    """A factory of watched robots, closed at the end."""
    watched = []

    def make(**options):
        watched.append(Watched(**options))
        return watched[-1]

    yield make
    for one in watched:
        one.robot.close()
