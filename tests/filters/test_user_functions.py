"""What users write for a filter, and is none: differences, means, sensors, numbers of particles."""

import numpy as np
import pytest
import torch
from filter_helpers import Still

from pypose_lite.filters import PF, UKF


@pytest.mark.parametrize("given", [[0], 3, "angles", torch.zeros(2)])
def test_what_is_no_function_is_refused_by_name(given):
    got = f"expected a function, got {type(given).__name__}"
    for name in ("residual", "residual_x"):
        with pytest.raises(ValueError, match=f"{name}: {got}"):
            UKF(Still(), **{name: given})
    with pytest.raises(ValueError, match=f"mean_x: {got}"):
        UKF(Still(), residual_x=torch.sub, mean_x=given)
    with pytest.raises(ValueError, match=f"g: {got}"):
        one = torch.eye(2)
        UKF(Still(), one).update(torch.zeros(2), torch.zeros(1), None, one, one[:1, :1], g=given)


WRONG = {
    "a number": (lambda a, b: a.sum(), r"\(\)"),
    "a longer vector": (
        lambda a, b: torch.cat([a, a], -1).flatten()[:3],
        r"\(3,\)",
    ),
    "a list": (lambda a, b: [0.0, 0.0], "list"),
    "nothing": (lambda a, b: None, "NoneType"),
}


@pytest.mark.parametrize("lead", [(), (3,)])
@pytest.mark.parametrize("name", ["residual", "residual_x", "mean_x"])
@pytest.mark.parametrize("wrong", WRONG)
def test_differences_and_means_of_another_shape_are_refused_by_name(lead, name, wrong):
    function, got = WRONG[wrong]
    given = {"residual_x": torch.sub} if name == "mean_x" else {}
    one, zero = torch.eye(2), torch.zeros(*lead, 2)
    ukf = UKF(Still(), one, one, **given, **{name: function})
    with pytest.raises(ValueError, match=rf"{name}: expected a tensor \(2,\).*, got {got}"):
        ukf(zero, zero, zero, one)


def test_a_mean_that_returns_all_its_points_is_refused():
    one, zero = torch.eye(2), torch.zeros(2)
    ukf = UKF(Still(), one, one, residual_x=torch.sub, mean_x=lambda points, w: points)
    with pytest.raises(ValueError, match=r"mean_x: expected a tensor \(2,\).*, got \(5, 2\)"):
        ukf(zero, zero, zero, one)


@pytest.mark.parametrize("particles", [0, -1, 2.5, "many", None])
def test_a_number_of_particles_that_is_none_is_refused(particles):
    with pytest.raises(ValueError, match="particles: expected at least 1, got"):
        PF(Still(), particles=particles)
    assert PF(Still(), particles=np.int64(3)).particles == 3
