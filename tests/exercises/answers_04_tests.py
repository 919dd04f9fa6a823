"""Answers to lab 4, continued: a test, tuned and learned noises, the robot."""

import torch
from graders import right, wrong

import pypose_lite as pp
from pypose_lite.teaching.checks.recordings import A, B, C, Q, R

# --- 4.5


def step(x, P, y, u):
    K = P @ C.T @ torch.linalg.inv(C @ P @ C.T + R)
    return A @ (x + K @ (y - C @ x)) + B @ u, A @ (P - K @ C @ P) @ A.T + Q


def one_try():
    g = torch.Generator().manual_seed(3)
    root = torch.randn(2, 2, generator=g, dtype=torch.float64)
    numbers = torch.randn(4, generator=g, dtype=torch.float64)
    return numbers[:2], 0.1 * (root @ root.T + torch.eye(2)), numbers[2:3], numbers[3:]


@right("4.5")
def against_one_step(f):
    given = one_try()
    return all(torch.allclose(a, b, atol=1e-9) for a, b in zip(f(*given), step(*given)))


@right("4.5")
def against_the_library(f):
    cart = pp.LTI(A, B, C, torch.zeros(1, 1, dtype=torch.float64))
    ekf = pp.EKF(cart, Q, R)
    x, P, y, u = one_try()
    for _ in range(5):
        mine, library = f(x, P, y, u), ekf(x, y, u, P)
        if max((a - b).abs().max() for a, b in zip(mine, library)) > 1e-8:
            return False
        x, P = library
    return True


@right("4.5")
def as_a_tensor(f):
    given = one_try()
    return (f(*given)[0] - step(*given)[0]).abs().max() + (
        f(*given)[1] - step(*given)[1]
    ).abs().max() < 1e-9


@wrong("4.5", "False of a filter that has no Q")
def the_mean_alone(f):
    given = one_try()
    return torch.allclose(f(*given)[0], step(*given)[0], atol=1e-9)


@wrong("4.5", "False of a filter that")
def accepts_all(f):
    return True


@wrong("4.5", "compare with a tolerance")
def to_the_last_bit(f):
    given = one_try()
    mine = step(*given)
    return all(bool((a == b).all()) for a, b in zip(f(*given), mine))


@wrong("4.5", "forgets the input")
def without_an_input(f):
    x, P, y, u = one_try()
    given = x, P, y, 0 * u
    return all(torch.allclose(a, b, atol=1e-9) for a, b in zip(f(*given), step(*given)))


@wrong("4.5", "False of a filter that has the wrong sign")
def the_covariance_alone(f):
    given = one_try()
    return torch.allclose(f(*given)[1], step(*given)[1], atol=1e-9)


@wrong("4.5", "True or False")
def returns_nothing(f):
    against_one_step(f)


# --- 4.6

right("4.6", "the noise as it is")((0.02, 0.11))
right("4.6", "nearly")((0.021, 0.112))
wrong("4.6", "R is too small", "too sure of the sensor")((0.02, 0.08))
wrong("4.6", "R is too large", "of the infinity")((0.005, 0.163))
wrong("4.6", "Q is too small", "too sure of the motion")((0.012, 0.113))
wrong("4.6", "Q is too large", "a loose motion")((0.03, 0.108))
wrong("4.6", "two positive numbers", "a negative one")((-0.02, 0.11))
wrong("4.6", "2 results", "one number")((0.02,))

# --- 4.7


def loss_of(y, process, sensor, log_term=1.0):
    Qw, Rv = process**2, sensor**2
    x, P, total = torch.zeros(len(y), dtype=y.dtype), Qw, 0
    for yi in y.T:
        S = P + Rv
        e = yi - x
        total = total + (e**2 / S).mean() + log_term * torch.log(S)
        x, P = x + P / S * e, (1 - P / S) * P + Qw
    return total


def descended(y, log_term=1.0):
    log = torch.zeros(2, dtype=y.dtype, requires_grad=True)
    optimizer = torch.optim.Adam([log], lr=0.1)
    for _ in range(80):
        optimizer.zero_grad()
        loss_of(y, *log.exp(), log_term).backward()
        optimizer.step()
    return log.detach().exp()


@right("4.7")
def downhill(y):
    return descended(y)


@right("4.7")
def by_moments(y):
    """The differences of neighbours have the variance q2 + 2 r2 and the covariance -r2."""
    d = y.diff(dim=1)
    r2 = -(d[:, 1:] * d[:, :-1]).mean()
    return (d.square().mean() - 2 * r2).clamp(min=1e-6).sqrt(), r2.sqrt()


@right("4.7")
def by_a_grid(y):
    grid = torch.exp(torch.linspace(-1.7, 0.6, 24, dtype=y.dtype))
    with torch.no_grad():
        pairs = [(float(loss_of(y, q, r)), q, r) for q in grid for r in grid]
    return min(pairs, key=lambda pair: pair[0])[1:]


@wrong("4.7", "These are the variances")
def variances(y):
    return descended(y) ** 2


@wrong("4.7", "in the wrong order")
def the_other_order(y):
    return descended(y).flip(0)


@wrong("4.7", "Without log S")
def without_the_logarithm(y):
    return descended(y, log_term=0.0) * 1.0


@wrong("4.7", "Expected about 0.5 and 1")
def spread_of_the_measurements(y):
    return y.diff(dim=1).std(), y.std()


@wrong("4.7", "2 results")
def one_of_them(y):
    return descended(y)[:1].tolist()


# --- 4.8


def walk_filter(y, u, process=0.01, sensor=0.1, keep_corrected=True):
    eye = torch.eye(4, dtype=torch.float64)
    f = pp.EKF(pp.DubinsCar(0.1), process**2 * eye, sensor**2 * eye)
    x, P, found = y[0], 0.01 * eye, []
    for yi, ui in zip(y, u):
        x, P = f.update(x, yi, ui, P)
        corrected = x
        x, P = f.predict(x, ui, P)
        found.append(corrected if keep_corrected else x)
    return torch.stack(found)


@right("4.8")
def by_the_ekf(y, u):
    return walk_filter(y, u)


@right("4.8")
def by_the_ukf(y, u):
    eye = torch.eye(4, dtype=torch.float64)
    f = pp.UKF(pp.DubinsCar(0.1), 0.005**2 * eye, 0.1**2 * eye)
    x, P, found = y[0], 0.01 * eye, []
    for yi, ui in zip(y, u):
        x, P = f.update(x, yi, ui, P)
        found.append(x)
        x, P = f.predict(x, ui, P)
    return torch.stack(found)


@wrong("4.8", "nearly the measurements themselves")
def the_measurements(y, u):
    return y.clone()


@wrong("4.8", "nearly the measurements themselves")
def believes_every_pose(y, u):
    return walk_filter(y, u, process=0.1, sensor=0.005)


@wrong("4.8", "may use y[0] to y[i]")
def a_smoother(y, u):
    eye = torch.eye(4, dtype=torch.float64)
    f = pp.EKF(pp.DubinsCar(0.1), 0.01**2 * eye, 0.1**2 * eye)
    xs, Ps = [y[0]], [0.01 * eye]
    for yi, ui in zip(y, u):
        x, P = f(xs[-1], yi, ui, Ps[-1])
        xs.append(x)
        Ps.append(P)
    return pp.filters.smooth(f, torch.stack(xs), torch.stack(Ps), y, u)[0][:-1]


@wrong("4.8", "mean error below")
def commands_alone(y, u):
    car, found = pp.DubinsCar(0.1), [y[0]]
    for ui in u[:-1]:
        found.append(car.transition(found[-1], ui))
    return torch.stack(found)


@wrong("4.8", "of shape (80, 4)")
def one_estimate_too_many(y, u):
    return torch.cat([walk_filter(y, u), y[-1:]])
