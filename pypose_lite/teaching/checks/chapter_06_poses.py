"""What the answers of lab 6 must do: rotations and poses."""

import math

import torch

from . import expect
from .exercise import Exercise

exponential = Exercise(
    "6.4", "From a rotation vector to a quaternion", minutes=15, takes="phi", points=2
)


def hat(phi):
    """The matrix of the cross product."""
    x, y, z = phi.tolist()
    return torch.tensor([[0, -z, y], [z, 0, -x], [-y, x, 0]])


def rotation(q):
    """The matrix of a unit quaternion x, y, z, w, entry by entry."""
    x, y, z, w = q.unbind(-1)
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    return torch.stack([torch.stack(row, -1) for row in rows], -2)


@exponential.must("return quaternions (..., 4) of length 1")
def shape_and_length(answer, given):
    for shape in [(3,), (5, 3), (2, 4, 3)]:
        q = expect.tensor("q", answer(given.randn(*shape)), (*shape[:-1], 4))
        norm = q.norm(dim=-1).detach()
        hint = "The vector part is sin(theta/2) / theta times phi, the last number cos(theta/2)."
        expect.close("|q|", norm, torch.ones_like(norm), hint, tolerance=1e-5)


@exponential.must("be the exponential of the hat of phi")
def of_the_hat(answer, given):
    for phi in given.randn(4, 3):
        q = expect.tensor("q", answer(phi), (4,)).detach()
        want = torch.matrix_exp(hat(phi))
        mistakes = {
            "The angle is not halved: q has half the angle of the rotation.": torch.matrix_exp(
                hat(2 * phi)
            ),
            "It turns the other way: look at the sign of the vector part.": want.mT,
            "It is halved once too often.": torch.matrix_exp(hat(phi / 2)),
        }
        hint = "Compare with torch.linalg.matrix_exp of the hat, for phi about one axis."
        if expect.near(rotation(q.roll(-1)), want, 1e-5):
            hint = "The order is x, y, z, w: the cosine comes last."
        expect.close("the rotation", rotation(q), want, hint, mistakes, 1e-5)


@exponential.must("be right at angle 0 and near it")
def near_zero(answer, given):
    for size in (0.0, 1e-12, 1e-7, 1e-4, 3e-3):
        phi = size * torch.tensor([0.6, 0.0, -0.8])
        q = answer(phi)
        finite = isinstance(q, torch.Tensor) and q.isfinite().all()
        hint = "At 0 the fraction sin(theta/2) / theta is 0/0: its limit is 1/2."
        if isinstance(q, torch.Tensor):
            expect.that(finite, f"numbers for an angle of {size:g}", "nan or inf", hint)
        q = expect.tensor("q", q, (4,)).detach()
        want = torch.cat([math.sin(size / 2) * torch.tensor([0.6, 0, -0.8]), torch.ones(1)])
        want[3] = math.cos(size / 2)
        hint = f"This is for an angle of {size:g}: the series is 1/2 - theta^2/48 + ..."
        expect.close("q", q * q[3].sign(), want, hint, tolerance=1e-8)


@exponential.must("have a gradient at any angle, 0 included")
def gradient_at_zero(answer, given):
    weights = given.randn(4)
    for phi in (given.randn(3), torch.zeros(3), 1e-6 * given.randn(3), 0.02 * given.randn(3)):
        x = phi.clone().requires_grad_()
        value = answer(x)
        if isinstance(value, torch.Tensor) and value.requires_grad:
            (slope,) = torch.autograd.grad((value * weights).sum(), x)
            hint = "Both branches of torch.where need numbers that they can take, and the norm has "
            expect.that(
                slope.isfinite().all(),
                f"a gradient at phi = {phi.tolist()}",
                "nan",
                f"{hint}no gradient at 0.",
            )
        expect.gradient(lambda z: (answer(z) * weights).sum(), phi, "q")


logarithm = Exercise("6.5", "The logarithm of a pose", minutes=10, takes="T")


def driven(xi):
    """Where a constant twist leads, by the exponential of its matrix."""
    x, y, theta = xi.tolist()
    matrix = torch.matrix_exp(torch.tensor([[0, -theta, x], [theta, 0, y], [0, 0, 0]]))
    return torch.stack([matrix[0, 2], matrix[1, 2], matrix[0, 0], matrix[1, 0]])


def mistaken(T, xi):
    """What usual mistakes give for a pose, by their hints."""
    theta = xi[2]

    def turned(angle):
        c, s = angle.cos(), angle.sin()
        return torch.stack([c * T[0] - s * T[1], s * T[0] + c * T[1]])

    factor = torch.sinc(theta / 2 / math.pi)
    found = {
        "The chord has to be turned back by theta/2.": T[:2] / factor,
        "This is the chord itself: turn it back, and make it longer.": T[:2],
        "It is turned the wrong way: turn it back by theta/2.": turned(theta / 2) / factor,
        "It is turned back, but the chord is shorter than the arc: divide by the factor.": turned(
            -theta / 2
        ),
        "Divide by the factor: it was multiplied in.": turned(-theta / 2) * factor,
        "Turn back by half the angle.": turned(-theta) / factor,
    }
    return {hint: torch.cat([v, xi[2:]]) for hint, v in found.items()}


@logarithm.must("find the angle, with its sign")
def angle_of_pose(answer, given):
    for theta in (0.7, -0.7, 2.5, -2.5):
        xi = torch.cat([given.randn(2), torch.tensor([theta])])
        came = expect.tensor("the twist", answer(driven(xi)), (3,))
        mistakes = {
            "The angle has lost its sign: atan2 of sine and cosine keeps it.": abs(theta),
            "Sine and cosine are interchanged.": math.pi / 2 - theta,
            "The angle has the wrong sign.": -theta,
            "This is half of the angle.": theta / 2,
        }
        hint = "torch.atan2(sine, cosine); the sine is the last number of T."
        expect.close("theta", came[2], theta, hint, mistakes, 1e-5)


@logarithm.must("find the twist that leads to the pose")
def twist_of_pose(answer, given):
    for _ in range(5):
        xi = torch.cat([given.randn(2), given.uniform(-3, 3, 1)])
        T = driven(xi)
        hint = "Undo the two things that the exponential did to the chord."
        expect.close("the twist", answer(T), xi, hint, mistaken(T, xi), 1e-5)


@logarithm.must("be right without a turn, and for half a turn")
def straight(answer, given):
    for theta in (0.0, 1e-9, math.pi - 1e-3):
        xi = torch.tensor([1.5, -0.5, theta])
        hint = f"This is for a turn of {theta:g}."
        expect.close("the twist", answer(driven(xi)), xi, hint, mistaken(driven(xi), xi), 1e-5)


interpolation = Exercise(
    "6.6", "A robot that turns the long way round", minutes=15, takes="q0, q1, u", points=2
)


def unit(given, *shape):
    """Random quaternions of length 1, with w > 0."""
    q = given.randn(*shape, 4)
    q = q / q.norm(dim=-1, keepdim=True)
    return q * q[..., 3:].sign()


def turned_between(a, b):
    """The angle between two rotations, rad."""
    return 2 * torch.acos((a * b).sum().abs().clamp(max=1))


def rotations(answer, q0, q1, shares):
    """What an answer gives for several shares."""
    return [expect.tensor("q", answer(q0, q1, torch.tensor(u)), (4,)).detach() for u in shares]


def neighbours(given):
    """Two rotations that are less than 160 degrees apart."""
    while True:
        q0, q1 = unit(given), unit(given)
        if 0.7 < turned_between(q0, q1) < 2.8:
            return q0, q1 * (q0 @ q1).sign()


@interpolation.must("start at q0 and arrive at q1, for turns about different axes")
def arrives(answer, given):
    for _ in range(3):
        q0, q1 = neighbours(given)
        start, end = rotations(answer, q0, q1, (0.0, 1.0))
        hint = "For u = 0 nothing is turned yet."
        expect.close("the first rotation", rotation(start), rotation(q0), hint, tolerance=1e-5)
        off = turned_between(end, q1).rad2deg().item()
        hint = "A turn seen from the world is multiplied from the left, one seen from the body "
        hint += "from the right."
        same = expect.near(rotation(end), rotation(q1), 1e-5)
        expect.that(same, "the rotation q1 for u = 1", f"one {off:.3g} degrees away", hint)


@interpolation.must("take the shorter way, whatever the signs of the quaternions")
def shorter_way(answer, given):
    for sign in (1, -1):
        q0, q1 = neighbours(given)
        (middle,) = rotations(answer, q0, sign * q1, (0.5,))
        norm = middle.norm().item()
        expect.that(abs(norm - 1) < 1e-5, "quaternions of length 1", f"one of length {norm:.4g}")
        whole = turned_between(q0, q1)
        half = turned_between(q0, middle)
        hint = "q and -q are the same rotation: where the turn's w is negative, take -turn."
        angles = f"{whole.rad2deg() / 2:.4g} degrees for u = 1/2"
        expect.that((half - whole / 2).abs() < 1e-5, angles, f"{half.rad2deg():.4g}", hint)


@interpolation.must("turn at a constant rate")
def constant_rate(answer, given):
    q0, q1 = neighbours(given)
    shares = (0.1, 0.25, 0.6, 0.9)
    whole = turned_between(q0, q1)
    came = torch.stack([turned_between(q0, q) for q in rotations(answer, q0, q1, shares)])
    hint = "The mean of the numbers, scaled to length 1, is slow at both ends. Scale the angle."
    expect.close("the angles from q0", came, whole * torch.tensor(shares), hint, tolerance=1e-5)
