"""What the answers of lab 6 must do: an order, waypoints for a car, a track for the robot."""

import math

import torch

from ... import go1, infinity, splines
from ...utils import ReduceToBason
from . import expect
from .exercise import Exercise

which_order = Exercise("6.7", "Which order is it?", 15, takes="make", points=2, seconds=20)


def lines(p):
    """Straight lines through the points."""
    return splines.hermite_segments(p, p.diff(dim=0), p.diff(dim=0))


def forward(p):
    """A Hermite spline whose tangents are differences to the next point: of order 2."""
    leg = p.diff(dim=0)
    return splines.hermite(p, torch.cat([leg, leg[-1:]]))


def fourth(p):
    """A Hermite spline whose tangents are five-point differences: of order 4."""
    ahead, behind = p[2:] - p[:-2], p[4:] - p[:-4]
    inner = 2 / 3 * ahead[1:-1] - behind / 12
    m = torch.cat([ahead[:1] / 2, ahead[:1] / 2, inner, ahead[-1:] / 2, ahead[-1:] / 2])
    return splines.hermite(p, m)


def measured(answer, make, want):
    """Holds an answer to the order of one spline."""
    came = expect.tensor("the order", answer(make), ()).item()
    hint = "Compare N with 2 N points: log2 of the ratio of the largest errors."
    if abs(came + want) < 0.3:
        hint = "Its sign is wrong: the larger error belongs to fewer points."
    elif abs(came - 2**want) < 2 ** (want - 1):
        hint = "This is the ratio of the errors: take its logarithm to the base 2."
    elif abs(came - want * math.log10(2)) < 0.1:
        hint = "The logarithm has to be the one to the base 2."
    elif want == 3 and abs(came - 4) < 0.3:
        hint = "A circle makes a gift to this spline: measure on another curve."
    elif want > 2 and abs(came - 2) < 0.4:
        hint = "Stay away from the ends, where the tangents are one-sided. (Is it log2?)"
    elif abs(came) > 8 or came == 0:
        hint = "The points themselves are passed exactly: compare between them."
    expect.that(abs(came - want) < 0.35, f"{want} for a spline of that order", f"{came:.3g}", hint)


@which_order.must("find 3 for the Catmull-Rom spline")
def of_catmull_rom(answer, given):
    measured(answer, splines.hermite, 3)


@which_order.must("find 4 where it is 4")
def of_natural(answer, given):
    measured(answer, splines.cubic_spline, 4)
    measured(answer, fourth, 4)


@which_order.must("find 2 for straight lines, and for tangents that look ahead only")
def of_others(answer, given):
    measured(answer, lines, 2)
    measured(answer, forward, 2)


gentler = Exercise(
    "6.8", "Waypoints that a car can follow", 20, takes="p", points=3, seconds=90, random=True
)


def sharpest(p):
    """The largest absolute curvature of chspline through points, at 201 places of each piece."""
    pieces = splines.hermite(p).spread()
    u = torch.linspace(0, 1, 201)
    return splines.curvature(pieces.local(u, 1), pieces.local(u, 2)).abs().max().item()


def some_points(given):
    """The infinity's waypoints, and the same turned, displaced and a little disturbed."""
    p = infinity.waypoints()[:, :2]
    angle = given.uniform(-1, 1, 1)
    c, s = angle.cos(), angle.sin()
    turn = torch.stack([torch.cat([c, -s]), torch.cat([s, c])])
    return [p, p @ turn.mT + given.randn(2) + 0.01 * given.randn(17, 2)]


@gentler.must("return as many points, each at most 0.1 m from its own")
def near_enough(answer, given):
    p = some_points(given)[0]
    moved = expect.tensor("the points", answer(p), (17, 2)).detach()
    farthest = (moved - p).norm(dim=-1).max().item()
    hint = "0.1 z / sqrt(1 + |z|^2) is shorter than 0.1, whatever z is."
    expect.that(farthest <= 0.1 + 1e-6, "moves of at most 0.1 m", f"one of {farthest:.3f} m", hint)


@gentler.must("make the curvature less than 2 everywhere")
def bends_less(answer, given):
    for p in some_points(given):
        before = sharpest(p)
        moved = expect.tensor("the points", answer(p), (17, 2)).detach()
        farthest = (moved - p).norm(dim=-1).max().item()
        expect.that(farthest <= 0.1 + 1e-6, "moves of at most 0.1 m", f"one of {farthest:.3f} m")
        after = sharpest(moved)
        hint = "It is smaller than before: make more steps, or larger ones."
        if after > before - 1e-9:
            hint = "It is not smaller than before: go downhill, against the gradient."
        elif after < 2.05:
            hint = "Almost. Does the loss look at both ends of each piece?"
        got = f"{after:.3f} (it was {before:.3f})"
        expect.that(after < 2, "a curvature below 2 1/m", got, hint)


track = Exercise("6.9", "Smooth a track for the robot", 15, takes="points", points=3, seconds=120)


def recording(given):
    """Noisy places around the infinity, 0.1 m apart."""
    s = torch.linspace(0, infinity.LENGTH, 126)
    return infinity.reference(s)[:, :2] + 0.05 * given.randn(126, 2)


def track_of(answer, points):
    """The states that an answer returns."""
    came = expect.tensor("the track", answer(points)).detach()
    shape = came.ndim == 2 and came.shape[1] == 4 and len(came) > 10
    hint = "A state is [i, j, cos, sin]: the heading belongs to it."
    expect.that(shape, "states of shape (M, 4)", f"shape {tuple(came.shape)}", hint)
    return came


@track.must("lead from the first point to the last, in steps of 0.02 to 0.2 m")
def whole_track(answer, given):
    points = recording(given)
    states = track_of(answer, points)
    ends = (states[[0, -1], :2] - points[[0, -1]]).norm(dim=-1).max().item()
    hint = "Does the curve begin where the recording begins?"
    expect.that(ends <= 0.2, "ends within 0.2 m of the recording's", f"{ends:.3f} m", hint)
    gaps = states[:, :2].diff(dim=0).norm(dim=-1)
    low, high = gaps.min().item(), gaps.max().item()
    hint = "splines.evenly_spaced gives parameters at equal distances."
    fits = low >= 0.02 and high <= 0.2
    expect.that(fits, "gaps of 0.02 to 0.2 m", f"{low:.3f} to {high:.3f} m", hint)


@track.must("be smooth: the heading turns by at most 5 rad a metre")
def smooth(answer, given):
    states = track_of(answer, recording(given))
    gaps = states[:, :2].diff(dim=0).norm(dim=-1)
    heading = states[:, 2:] / states[:, 2:].norm(dim=-1, keepdim=True).clamp(min=1e-9)
    turns = (heading[1:] * heading[:-1]).sum(-1).clamp(-1, 1).acos()
    most = (turns / gaps).max().item()
    hint = "The curve follows the noise: let fewer points steer it than were measured."
    expect.that(most <= 5, "at most 5 rad a metre", f"{most:.2f}", hint)


@track.must("have headings of length 1 that are the directions of travel")
def headings(answer, given):
    states = track_of(answer, recording(given))
    norm = states[:, 2:].norm(dim=-1)
    hint = "Divide the velocity by its length; splines.heading does."
    worst = norm[(norm - 1).abs().argmax()].item()
    expect.that(abs(worst - 1) < 1e-3, "headings of length 1", f"one of {worst:.3f}", hint)
    way = states[:, :2].diff(dim=0)
    way = way / way.norm(dim=-1, keepdim=True)
    middle = states[1:, 2:] + states[:-1, 2:]
    along = (way * middle / middle.norm(dim=-1, keepdim=True).clamp(min=1e-9)).sum(-1)
    worst = along.clamp(-1, 1).acos().max().rad2deg().item()
    hint = "The direction is that of the velocity, [cos, sin] in this order."
    expect.that(worst < 8, "headings along the track", f"one {worst:.0f} degrees off it", hint)


@track.must("be within 0.035 m of the circles on average")
def near_circles(answer, given):
    tracks = [track_of(answer, recording(given)) for _ in range(4)]
    error = torch.cat([infinity.tracking_error(states) for states in tracks]).mean().item()
    hint = "Too much smoothing cuts the curve, too little leaves the noise in it."
    expect.that(error <= 0.035, "a mean of at most 0.035 m", f"{error:.4f} m", hint)


def along(states):
    """What to aim at: the third state after the one that is nearest."""
    place = 0

    def aim(x, goal):
        nonlocal place
        window = states[place : place + 10, :2]
        place += int((window - x[:2]).norm(dim=-1).argmin())
        return states[min(place + 3, len(states) - 1)]

    return aim


@track.must("be a track that the simulated dog walks, 0.06 m from the circles on average")
def walked(answer, given):
    states = track_of(answer, recording(given))
    planner = infinity.controller()
    planner.stepper = ReduceToBason(steps=3)
    bounds = {"u_lower": torch.tensor([0.0, -1.5]), "u_upper": torch.tensor([1.2, 1.5])}
    with go1.connect("sim", start=(0.0, 0.0, -math.pi / 2)) as robot:
        world = infinity.RealRobot(robot, 0.1)
        aim = along(states)
        walk = infinity.drive(planner, world, aim=aim, tolerance=0.2, steps=250, **bounds)
    reached = int(walk.goal.max()) - 1 + int(walk.finished)
    expect.that(walk.finished, "all 16 waypoints within 25 s, to 0.2 m", f"{reached} of them")
    error = infinity.tracking_error(walk.x).mean().item()
    expect.that(error < 0.06, "a mean error below 0.06 m", f"{error:.3f} m")
