"""The local plan: on the circles, merging, evenly spaced, and each car at its own waypoint."""

import math

import pytest
import torch
from torch.autograd import gradcheck

from pypose_lite.infinity import SimulatedCar, controller, drive
from pypose_lite.lie import se2_compose, se2_exp
from pypose_lite.splines.planner import local_plan, path
from pypose_lite.utils import ReduceToBason

F64 = torch.float64


def infinity(s):
    """The reference after s metres: right circle counter-clockwise, then the left one clockwise."""
    second = s >= 2 * math.pi
    side = torch.where(second, -1.0, 1.0).to(s)
    angle = math.pi + s  # on the right circle, seen from its centre
    i, j = side * (1 + angle.cos()), angle.sin()
    return torch.stack([i, j, -side * angle.sin(), angle.cos()], -1)


def close(a, b, atol=1e-12):
    torch.testing.assert_close(a, torch.as_tensor(b, dtype=a.dtype), atol=atol, rtol=0)


@pytest.fixture
def waypoints():
    return infinity(torch.arange(17, dtype=F64) * math.pi / 4)


@pytest.fixture
def cars(waypoints):
    """Five cars near the path, with shifted places and headings, and their next waypoints."""
    index = torch.tensor([1, 4, 8, 9, 16])
    shift = 0.1 * torch.randn(5, 4, generator=torch.Generator().manual_seed(0), dtype=F64)
    s = (index - 0.6) * math.pi / 4
    return infinity(s) + shift, index


def off_circles(x):
    right, left = (((x[..., 0] - c) ** 2 + x[..., 1] ** 2).sqrt() - 1 for c in (1, -1))
    return torch.minimum(right.abs(), left.abs())


def test_from_a_waypoint_the_plan_is_the_infinity_itself(waypoints):
    plan = local_plan(waypoints[0], waypoints, torch.tensor(1), spacing=0.1, count=120)
    assert off_circles(plan).max() < 5e-6
    close(plan, infinity(0.1 * torch.arange(120, dtype=F64)), atol=5e-4)


def test_a_shifted_plan_has_merged_at_the_next_waypoint(waypoints):
    """Exactly: the later segments are the same numbers."""
    shifted = waypoints[2] + torch.tensor([0.2, -0.1, 0.1, 0.1], dtype=F64)
    blue, red = path(waypoints[2:]), path(torch.cat([shifted[None], waypoints[3:]]))
    t = torch.linspace(1, 14, 200, dtype=F64)
    close(red(t), blue(t), atol=0)
    before = torch.linspace(0, 0.9, 9, dtype=F64)
    assert (red(before) - blue(before)).norm(dim=-1).min() > 0.005
    plan = local_plan(shifted, waypoints, torch.tensor(3), spacing=0.05, count=40)
    assert off_circles(plan)[0] > 0.05 and off_circles(plan)[-20:].max() < 5e-6


def test_the_plan_begins_with_the_car(waypoints, cars):
    x, index = cars
    plan = local_plan(x, waypoints, index)
    close(plan[:, 0, :2], x[:, :2])
    close(plan[:, 0, 2:], x[:, 2:] / x[:, 2:].norm(dim=-1, keepdim=True))
    close(plan[..., 2:].norm(dim=-1), torch.ones(5, 20))


def test_only_the_direction_of_an_estimated_heading_counts(waypoints, cars):
    x, index = cars
    scale = torch.tensor([1, 1, 0.7, 0.7], dtype=F64)
    close(local_plan(x * scale, waypoints, index), local_plan(x, waypoints, index), atol=1e-10)


def test_the_plan_passes_every_waypoint_in_its_direction(waypoints, cars):
    x, index = cars
    curve = path(torch.cat([x[0, None], waypoints[index[0] :]]))
    t = torch.arange(1, curve.segments, dtype=F64)
    for at in (t, t - 1e-12):  # from the right and from the left
        velocity = curve(at, derivative=1)
        close(curve(at), waypoints[index[0] : -1, :2], atol=1e-10)
        direction = velocity / velocity.norm(dim=-1, keepdim=True)
        close(direction, waypoints[index[0] : -1, 2:], atol=1e-10)


def test_the_states_are_equally_far_apart_and_head_along_the_path(waypoints, cars):
    x, index = cars
    fine = local_plan(x[:4], waypoints, index[:4], spacing=0.001, count=1001)
    step = fine[:, 1:, :2] - fine[:, :-1, :2]
    close(step.norm(dim=-1), torch.full((4, 1000), 0.001), atol=1e-7)
    middle = fine[:, 1:, 2:] + fine[:, :-1, 2:]
    close(step / 0.001, middle / middle.norm(dim=-1, keepdim=True), atol=5e-4)
    close(local_plan(x[:4], waypoints, index[:4], 0.1, 11), fine[:, ::100], atol=1e-9)


def test_the_plan_ends_with_the_last_waypoint(waypoints, cars):
    x, index = cars
    plan = local_plan(x[-1], waypoints, index[-1], spacing=0.2, count=30)
    close(plan[10:], waypoints[-1].expand(20, 4), atol=1e-9)
    there = local_plan(waypoints[-1], waypoints, torch.tensor(16), count=3)
    close(there, waypoints[-1].expand(3, 4))


def test_a_car_on_its_next_waypoint_goes_on_to_the_one_after(waypoints):
    x = waypoints[3].requires_grad_()
    plan = local_plan(x, waypoints.detach(), torch.tensor(3))
    close(plan.detach(), local_plan(waypoints[3].detach(), waypoints.detach(), torch.tensor(4)))
    plan.sum().backward()
    assert x.grad.isfinite().all()


def test_a_batch_equals_the_stack_of_single_cars(waypoints, cars):
    x, index = cars
    singles = torch.stack([local_plan(a, waypoints, i) for a, i in zip(x, index, strict=True)])
    close(local_plan(x, waypoints, index), singles)
    close(local_plan(x[:, None], waypoints, index[:, None]), singles[:, None])
    own = waypoints + torch.arange(5)[:, None, None]
    close(
        local_plan(x[0], own, index),
        torch.stack([local_plan(x[0], w, i) for w, i in zip(own, index)]),
    )
    one = local_plan(x, waypoints, 8)
    close(one, local_plan(x, waypoints, torch.full((5,), 8)))


def test_the_plan_moves_with_the_frame(waypoints, cars):
    x, index = cars
    T = se2_exp(torch.tensor([0.5, -2.0, 1.2], dtype=F64))
    moved = local_plan(se2_compose(T, x), se2_compose(T, waypoints), index)
    close(moved, se2_compose(T, local_plan(x, waypoints, index)), atol=1e-10)


def test_a_lap_that_aims_at_its_plan_strays_less_and_steers_more_calmly(waypoints):
    def ahead(x, goal):
        return local_plan(x, waypoints, goal, spacing=0.3, count=2)[..., 1, :]

    mpc = controller(T=5, dtype=F64)
    mpc.stepper = ReduceToBason(steps=3)
    beside = waypoints[0] + torch.tensor([[0.0, 0, 0, 0], [0.3, 0.1, 0, 0]], dtype=F64)
    hops = drive(mpc, SimulatedCar(x_init=waypoints[:1]), steps=60)
    planned = drive(mpc, SimulatedCar(x_init=beside), aim=ahead, steps=90)
    assert hops.finished.all() and planned.finished.all()
    later = [off_circles(run.x[:, :-1])[run.running & (run.goal > 2)] for run in (hops, planned)]
    assert later[1].max() < 0.06 < later[0].max()
    change = [run.u[0, : run.steps[0]].diff(dim=0).square().mean() for run in (hops, planned)]
    assert change[1] < 0.05 * change[0]


def test_gradients_agree_with_finite_differences(waypoints, cars):
    x, index = cars[0][:3].requires_grad_(), cars[1][:3]
    waypoints = waypoints.requires_grad_()
    assert gradcheck(lambda x, w: local_plan(x, w, index, 0.3, 5), (x, waypoints), fast_mode=True)


def test_float32_plans_are_right(waypoints, cars):
    x, index = cars
    plan = local_plan(x.float(), waypoints.float(), index)
    assert plan.dtype == torch.float32
    close(plan.double(), local_plan(x, waypoints, index), atol=2e-5)


@pytest.mark.parametrize(
    "change, words",
    [
        ({"index": torch.tensor(17)}, "index: expected whole numbers from 0 to 16, got 17"),
        ({"index": torch.tensor(-1)}, "index: expected whole numbers from 0 to 16, got -1"),
        ({"index": 1.0}, "index: expected whole numbers"),
        ({"x": torch.zeros(2, 4, dtype=F64), "index": torch.ones(3).long()}, "index: its batch"),
        ({"x": torch.zeros(3, dtype=F64)}, r"x: expected \(\.\.\., n=4\), got \(3,\)"),
        ({"x": torch.zeros(4)}, "x: expected torch.float64"),
        ({"spacing": 0.0}, "spacing, count: expected both > 0, got 0.0 and 20"),
        ({"count": 0}, "spacing, count: expected both > 0, got 0.1 and 0"),
        ({"spacing": math.nan}, "spacing, count"),
    ],
)
def test_what_does_not_fit_is_named(waypoints, change, words):
    fitting = {"x": waypoints[0], "waypoints": waypoints, "index": torch.tensor(1)}
    with pytest.raises(ValueError, match=words):
        local_plan(**{**fitting, **change})
