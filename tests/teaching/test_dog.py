import matplotlib.pyplot as plt
import numpy as np
import pytest
import torch

from pypose_lite.teaching.dog import BODY, FEET, from_above

STATES = torch.tensor([[0.0, 0.0, 1.0, 0.0], [0.0, 1.0, 0.0, 1.0], [2.0, 1.0, 0.0, 1.0]])


@pytest.fixture
def ax():
    figure, ax = plt.subplots()
    yield ax
    plt.close(figure)


def test_the_dog_is_where_the_last_state_is_and_looks_its_way(ax):
    from_above(ax)(STATES)
    [body] = ax.patches
    corners = torch.tensor(body.get_xy())[: len(BODY)]
    # it looks up the page, along j: what is forward is j, what is left is -i
    expected = torch.stack([2.0 - BODY[:, 1], 1.0 + BODY[:, 0]], -1)
    assert torch.allclose(corners.float(), expected)


def test_its_way_is_all_states_before(ax):
    from_above(ax)(STATES)
    assert ax.lines[0].get_xydata().tolist() == STATES[:, :2].tolist()


def test_a_dog_that_has_not_walked_stands_on_its_feet(ax):
    from_above(ax)(STATES[:1])
    feet = torch.tensor(np.asarray(ax.collections[0].get_offsets()))
    assert torch.allclose(feet.float(), FEET)


def test_a_walking_dog_lifts_its_feet_crosswise(ax):
    from_above(ax)(torch.tensor([[0.0, 0.0, 1.0, 0.0], [0.05, 0.0, 1.0, 0.0]]))
    feet = torch.tensor(np.asarray(ax.collections[0].get_offsets())).float()
    moved = (feet - FEET - torch.tensor([0.05, 0.0]))[:, 0]
    assert moved[0] == pytest.approx(moved[3].item()) and moved[0] == pytest.approx(-moved[1])
    assert moved.abs().min() > 0.01


def test_states_of_another_size_are_refused(ax):
    with pytest.raises(ValueError, match="n=4"):
        from_above(ax)(torch.zeros(3, 3))
