"""Splines and plans inside torch's transforms, and inside the functions of a `System`."""

import pytest
import torch

import pypose_lite as pp
from pypose_lite import infinity, splines

F64 = torch.float64
W = infinity.waypoints().double()
CURVE = splines.planner.path(W)
UNEVEN = splines.cubic_spline(W[:6, :2], times=[0, 0.55, 2.1, 2.5, 3, 16])
INDEX = torch.tensor([1, 4, 9, 16])
CARS = W[INDEX - 1] + 0.1 * torch.randn(4, 4, generator=torch.Generator().manual_seed(0), dtype=F64)


def close(a, b, atol=1e-11):
    torch.testing.assert_close(a, b, atol=atol, rtol=1e-11)


def walk(p, s):
    """The points at distances s of a curve through p."""
    curve = splines.hermite(p)
    return curve(splines.parameter_at(curve, s))


POINTS = torch.stack([W[i : i + 5, :2] for i in range(4)])
FAR = torch.tensor([[0.1, 1.0], [0.5, 2.2], [0.1, 1.3], [0.2, 0.3]], dtype=F64)
LATE = torch.tensor([[0, 1, 2, 4, 5.0]], dtype=F64) + torch.rand(4, 5, dtype=F64) / 3
FUNCTIONS = {
    "times": (lambda h: splines.cubic_spline(POINTS[0], h).sample(0.25, 1), LATE),
    "closed": (lambda p: pp.chspline(torch.cat([p, p[:1]]), 0.25, ends="periodic"), POINTS),
    "point": (lambda s: CURVE(s), FAR),
    "one point": (lambda s: CURVE(s), FAR[:, 0]),
    "velocity": (lambda s: UNEVEN(s, 1), FAR),
    "arc length": (lambda p: splines.arc_length(splines.hermite(p)), POINTS),
    "evenly spaced": (lambda p: splines.evenly_spaced(splines.hermite(p), 7), POINTS),
    "parameter": (lambda s: splines.parameter_at(CURVE, s), FAR),
    "walk": (walk, POINTS, FAR),
    "natural": (lambda p, s: splines.cubic_spline(p, [0, 1, 2.1, 4, 5])(s, 2), POINTS, FAR),
    "chspline": (lambda p: pp.chspline(p, 0.25), POINTS),
    "bspline": (lambda p: pp.bspline(p, 0.25, True), POINTS),
    "plan": (lambda x, i: pp.local_plan(x, W, i, 0.2, 9), CARS, INDEX),
    "poses": (
        lambda xi: pp.chspline(pp.se3(xi).Exp(), 0.5).tensor(),
        torch.randn(4, 5, 6, generator=torch.Generator().manual_seed(1), dtype=F64),
    ),
}
each = pytest.mark.parametrize("f, args", [(f, a) for f, *a in FUNCTIONS.values()], ids=FUNCTIONS)


@each
def test_vmap_equals_the_stack_of_single_calls(f, args):
    close(torch.vmap(f)(*args), torch.stack([f(*row) for row in zip(*args)]))


@each
def test_jacobians_of_transforms_equal_central_differences(f, args):
    first, *rest = (a[1] for a in args)
    h, eye = 1e-6, torch.eye(first.numel(), dtype=F64).reshape(-1, *first.shape)
    sides = [[f(first + side * e, *rest) for e in eye] for side in (h, -h)]
    differences = (torch.stack(sides[0], -1) - torch.stack(sides[1], -1)) / (2 * h)
    ours = torch.func.jacrev(f)(first, *rest)
    close(ours.reshape(differences.shape), differences, atol=1e-6)
    close(torch.func.jacfwd(f)(first, *rest), ours, atol=1e-9)
    total = torch.func.grad(lambda x: f(x, *rest).sum())(first)
    close(total.flatten(), differences.flatten(0, -2).sum(0), atol=2e-6)


def test_the_gradient_of_a_batch_is_that_of_its_members():
    gradient = torch.func.grad(lambda p, s: walk(p, s).square().sum())
    close(torch.vmap(gradient)(POINTS, FAR), torch.stack([*map(gradient, POINTS, FAR)]))


def test_a_cusp_is_measured_inside_vmap_too():
    p = torch.tensor([[0, 0], [3, 0], [-2, 0.01], [1, 0]], dtype=F64)
    many = torch.stack([p, 2 * p])
    lengths = torch.vmap(lambda p: splines.arc_length(splines.hermite(p)))(many)
    close(lengths, splines.arc_length(splines.hermite(many)))


def test_numbers_are_looked_at_inside_grad():
    with pytest.raises(ValueError, match="t: expected parameters in"):
        torch.func.grad(lambda s: CURVE(s).sum())(torch.tensor([17.0], dtype=F64))
    with pytest.raises(ValueError, match="times: expected increasing numbers"):
        torch.func.grad(lambda t: splines.hermite(POINTS[0], times=t)(1.0).sum())(-W[:5, 0])


class OnRails(pp.System):
    """A wagon that is seen where its rails are; it counts how often it is asked."""

    calls = 0

    def state_transition(self, state, input, t=None):
        self.calls += 1
        place, speed = state
        return torch.stack([place + 0.1 * speed, speed + 0.1 * input[0]])

    def observation(self, state, input, t=None):
        self.calls += 1
        return torch.cat([CURVE(state[0]), UNEVEN(state[:1], 1)[0]])


class Follower(pp.System):
    """A car that is pulled towards its local plan."""

    calls = 0

    def state_transition(self, state, input, t=None):
        self.calls += 1
        plan = pp.local_plan(state, W, 3, 0.2, 2)
        return state + input[0] * (plan[1] - state)

    def observation(self, state, input, t=None):
        return state


@pytest.mark.parametrize("system, x, m", [(OnRails(), FAR, 1), (Follower(), CARS, 1)])
def test_a_system_with_a_curve_in_it_is_mapped_and_not_looped_over(system, x, m):
    u = torch.full((4, m), 0.3, dtype=F64)
    system.calls = 0
    y = torch.cat([system.transition(x, u), system.observe(x, u)], -1)
    assert system.calls <= 2
    singles = [torch.cat([system.transition(*r), system.observe(*r)]) for r in zip(x, u)]
    close(y, torch.stack(singles))
    close(system.linearize(x, u).A[2], system.linearize(x[2], u[2]).A)
    close(system.linearize(x, u).C[2], system.linearize(x[2], u[2]).C)
