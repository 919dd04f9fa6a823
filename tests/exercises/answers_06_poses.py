"""Answers to lab 6, as students give them: rotations and poses."""

import math

import torch
from graders import right, wrong

from pypose_lite import lie

# --- 6.4


@right("6.4")
def by_the_library(phi):
    return lie.so3_exp(phi)


@right("6.4")
def by_a_series_alone(phi):
    square = (phi * phi).sum(-1, keepdim=True)
    factor, w, term = 0.0, 0.0, torch.ones_like(square)
    for k in range(10):
        w = w + term / math.factorial(2 * k)
        factor = factor + term / math.factorial(2 * k + 1) / 2
        term = -term * square / 4
    return torch.cat([factor * phi, w], -1)


@right("6.4")
def with_two_cases(phi):
    square = (phi * phi).sum(-1, keepdim=True)
    small = square < 1e-6
    theta = torch.sqrt(torch.where(small, torch.ones_like(square), square))
    sinc = torch.where(small, 1 - square / 24, (theta / 2).sin() / (theta / 2))
    w = torch.where(small, 1 - square / 8, (theta / 2).cos())
    return torch.cat([phi * sinc / 2, w], -1)


def plain(phi, half=0.5, sign=1.0):
    theta = phi.norm(dim=-1, keepdim=True)
    return torch.cat([sign * (half * theta).sin() / theta * phi, (half * theta).cos()], -1)


@wrong("6.4", "At 0 the fraction")
def without_a_case(phi):
    return plain(phi)


@wrong("6.4", "no gradient at 0")
def where_after_the_division(phi):
    theta = phi.norm(dim=-1, keepdim=True)
    factor = torch.where(theta < 1e-4, 0.5, (theta / 2).sin() / theta)
    return torch.cat([factor * phi, (theta / 2).cos()], -1)


@wrong("6.4", "The angle is not halved")
def whole_angle(phi):
    return plain(phi, half=1.0)


@wrong("6.4", "It turns the other way")
def the_conjugate(phi):
    return plain(phi, sign=-1.0)


@wrong("6.4", "the cosine comes last")
def w_first(phi):
    return lie.so3_exp(phi).roll(1, -1)


@wrong("6.4", "The vector part is")
def without_dividing_by_the_angle(phi):
    theta = phi.norm(dim=-1, keepdim=True)
    return torch.cat([(theta / 2).sin() * phi, (theta / 2).cos()], -1)


@wrong("6.4", "the series is")
def one_where_it_is_half(phi):
    square = (phi * phi).sum(-1, keepdim=True)
    small = square < 1e-5
    theta = torch.where(small, 1.0, square).sqrt()
    factor = torch.where(small, 1.0, (theta / 2).sin() / theta)
    return torch.cat([factor * phi, torch.where(small, 1.0, (theta / 2).cos())], -1)


@wrong("6.4", "cut the graph")
def without_a_graph(phi):
    return lie.so3_exp(phi.detach())


@wrong("6.4", "of shape (5, 4)")
def unbatched(phi):
    return lie.so3_exp(phi.reshape(-1, 3)[0])


# --- 6.5


@right("6.5")
def of_the_library(T):
    return lie.se2_log(T)


@right("6.5")
def by_a_linear_system(T):
    theta = math.atan2(T[3], T[2])
    if abs(theta) < 1e-6:
        return torch.tensor([*(T[:2] + theta / 2 * torch.tensor([T[1], -T[0]])).tolist(), theta])
    a, b = math.sin(theta) / theta, (1 - math.cos(theta)) / theta
    v = torch.linalg.solve(torch.tensor([[a, -b], [b, a]]), T[:2])
    return torch.tensor([*v.tolist(), theta])


@right("6.5")
def in_complex_numbers(T):
    x, y, c, s = T.tolist()
    theta = math.atan2(s, c)
    factor = math.sin(theta / 2) / (theta / 2) if theta else 1.0
    v = complex(x, y) * complex(math.cos(theta / 2), -math.sin(theta / 2)) / factor
    return [v.real, v.imag, theta]


def variant(angle=-0.5, power=-1):
    def log(T):
        theta = torch.atan2(T[3], T[2])
        c, s = (angle * theta).cos(), (angle * theta).sin()
        v = torch.stack([c * T[0] - s * T[1], s * T[0] + c * T[1]])
        v = v * torch.sinc(theta / 2 / math.pi) ** power
        return torch.cat([v, theta[None]])

    return log


wrong("6.5", "This is the chord itself", "the chord")(variant(0.0, 0))
wrong("6.5", "has to be turned back by theta/2", "not turned")(variant(0.0))
wrong("6.5", "turned the wrong way", "turned on")(variant(0.5))
wrong("6.5", "the chord is shorter than the arc", "not made longer")(variant(power=0))
wrong("6.5", "Divide by the factor", "made shorter")(variant(power=1))
wrong("6.5", "Turn back by half the angle", "turned back by all of it")(variant(-1.0))


@wrong("6.5", "The angle has lost its sign")
def by_acos(T):
    return torch.cat([lie.se2_log(T)[:2], torch.acos(T[2:3].clamp(-1, 1))])


@wrong("6.5", "Sine and cosine are interchanged")
def atan2_of_cosine_and_sine(T):
    return torch.cat([lie.se2_log(T)[:2], torch.atan2(T[2], T[3])[None]])


@wrong("6.5", "nan or inf")
def zero_over_zero(T):
    theta = torch.atan2(T[3], T[2])
    c, s = (theta / 2).cos(), (theta / 2).sin()
    v = torch.stack([c * T[0] + s * T[1], c * T[1] - s * T[0]]) * (theta / 2) / s
    return torch.cat([v, theta[None]])


# --- 6.6


def of(q0, q1, u, step):
    return lie.so3_compose(q0, lie.so3_exp(u * step))


@right("6.6")
def seen_from_the_world(q0, q1, u):
    turn = lie.so3_log(lie.so3_compose(q1, lie.so3_inverse(q0)))
    return lie.so3_compose(lie.so3_exp(u * turn), q0)


@right("6.6")
def slerp_by_its_formula(q0, q1, u):
    cosine = (q0 * q1).sum()
    q1, cosine = (q1, cosine) if cosine > 0 else (-q1, -cosine)
    angle = torch.acos(cosine.clamp(max=1))
    if angle < 1e-8:
        return q0
    return (((1 - u) * angle).sin() * q0 + (u * angle).sin() * q1) / angle.sin()


@right("6.6")
def with_both_mended(q0, q1, u):
    turn = lie.so3_compose(lie.so3_inverse(q0), q1)
    turn = -turn if turn[3] < 0 else turn
    angle = 2 * torch.acos(turn[3].clamp(-1, 1))
    return of(q0, q1, u, angle * turn[:3] / turn[:3].norm())


@wrong("6.6", "multiplied from the left")
def as_it_was(q0, q1, u):
    turn = lie.so3_compose(q1, lie.so3_inverse(q0))
    angle = 2 * torch.acos(turn[3].clamp(-1, 1))
    return of(q0, q1, u, angle * turn[:3] / turn[:3].norm())


@wrong("6.6", "multiplied from the left")
def only_the_sign_mended(q0, q1, u):
    return of(q0, q1, u, lie.so3_log(lie.so3_compose(q1, lie.so3_inverse(q0))))


@wrong("6.6", "q and -q are the same rotation")
def only_the_side_mended(q0, q1, u):
    turn = lie.so3_compose(lie.so3_inverse(q0), q1)
    angle = 2 * torch.acos(turn[3].clamp(-1, 1))
    return of(q0, q1, u, angle * turn[:3] / turn[:3].norm())


@wrong("6.6", "is slow at both ends")
def mean_of_the_numbers(q0, q1, u):
    q1 = q1 * (q0 @ q1).sign()
    q = (1 - u) * q0 + u * q1
    return q / q.norm()


@wrong("6.6", "length 1")
def not_of_length_1(q0, q1, u):
    q1 = q1 * (q0 @ q1).sign()
    return (1 - u) * q0 + u * q1


@wrong("6.6", "nothing is turned yet")
def the_other_way_round(q0, q1, u):
    return seen_from_the_world(q1, q0, u)
