"""What the answers of lab 4 must do, continued: a test, tuned and learned noises, the robot."""

from functools import partial

import torch
from torch import Tensor

from ...filters import EKF, nees, nis
from ...systems import DubinsCar
from . import expect, recordings
from .exercise import Exercise
from .recordings import A, B, C, Q, R

is_kalman_filter = Exercise("4.5", "A test for filters", minutes=20, takes="f", points=2)


def kalman(x, P, y, u, *, Q=Q, R=R, sign=1.0, A_P=A, P_factor=1.0, joseph=False):
    """The cart's filter, with room for faults."""
    S = C @ P @ C.mT + R
    K = P @ C.mT @ S.inverse()
    x = x + sign * K @ (y - C @ x)
    rest = torch.eye(2, dtype=torch.float64) - P_factor * K @ C
    P = rest @ P @ rest.mT + K @ R @ K.mT if joseph else rest @ P
    return A @ x + B @ u, A_P @ P @ A_P.mT + Q


def predicted_first(x, P, y, u):
    """Uses the measurement for the state after the step."""
    x, P = A @ x + B @ u, A @ P @ A.mT + Q
    K = P @ C.mT @ (C @ P @ C.mT + R).inverse()
    return x + K @ (y - C @ x), P - K @ C @ P


def mixed_times(x, P, y, u):
    """Compares the measurement with the state before the step, and corrects the one after it."""
    e = y - C @ x
    x, P = A @ x + B @ u, A @ P @ A.mT + Q
    K = P @ C.mT @ (C @ P @ C.mT + R).inverse()
    return x + K @ e, P - K @ C @ P


def by_information(x, P, y, u):
    """The same filter, by informations."""
    after = (P.inverse() + C.mT @ R.inverse() @ C).inverse()
    x = after @ (P.inverse() @ x + C.mT @ R.inverse() @ y)
    return A @ x + B @ u, A @ after @ A.mT + Q


def in_one_gain(x, P, y, u):
    """The same filter, with the gain of the whole step."""
    K = A @ P @ C.mT @ (C @ P @ C.mT + R).inverse()
    return A @ x + B @ u + K @ (y - C @ x), (A - K @ C) @ P @ A.mT + Q


RIGHT = {
    "computes the covariance in the short form": kalman,
    "computes it in Joseph's form": partial(kalman, joseph=True),
    "adds informations": by_information,
    "has one gain for the whole step": in_one_gain,
}
WRONG = {
    "has no Q": partial(kalman, Q=0 * Q),
    "has the wrong sign in the innovation": partial(kalman, sign=-1.0),
    "has A transposed in the covariance": partial(kalman, A_P=A.mT),
    "takes R for twice as large": partial(kalman, R=2 * R),
    "does not make P smaller by the measurement": partial(kalman, P_factor=0.0),
    "forgets the input": lambda x, P, y, u: kalman(x, P, y, 0 * u),
    "does not use the measurement for the mean": partial(kalman, sign=0.0),
    "uses the measurement for the state after the step": predicted_first,
    "compares with the state before the step and corrects the one after it": mixed_times,
}


def verdict(answer, f) -> bool:
    """What a test says of a filter."""
    came = answer(f)
    value = expect.tensor("True or False", came, ())
    return bool(value)


@is_kalman_filter.must("accept filters that compute the same in another way")
def accepts(answer, given):
    for words, f in RIGHT.items():
        hint = "Rounding makes a difference of 1e-16: compare with a tolerance."
        expect.that(verdict(answer, f), f"True of a filter that {words}", "False", hint)


@is_kalman_filter.must("refuse filters with a fault")
def refuses(answer, given):
    for words, f in WRONG.items():
        hint = "Compare mean and covariance, after one step with a P that is not diagonal."
        expect.that(not verdict(answer, f), f"False of a filter that {words}", "True", hint)


tuned = Exercise("4.6", "Tune Q and R", minutes=15, takes="", seconds=60)


def scores(process: float, sensor: float, seed: int) -> tuple[float, float]:
    """The mean NIS and the mean NEES of a filter with these standard deviations."""
    truth, looks, inputs, x = recordings.car_laps(seed)
    eye = torch.eye(4, dtype=torch.float64)
    f = EKF(DubinsCar(recordings.DT), process**2 * eye, sensor**2 * eye)
    P = (0.05**2 * eye).expand(len(x), 4, 4)
    found = []
    for i, u in enumerate(inputs):
        surprise = nis(f.innovation(x, looks[:, i], u, P))
        x, P = f(x, looks[:, i], u, P)
        found.append(torch.stack([surprise, nees(x, P, truth[:, i + 1])]))
    means = torch.stack(found).mean(dim=(0, 2))
    return float(means[0]), float(means[1])


def pair(came, first: str, second: str) -> tuple:
    """Two results, which may come as one tensor, too."""
    if isinstance(came, Tensor) and came.shape == (2,):
        came = came.unbind()
    return expect.parts(came, first, second)


def noises(answer) -> tuple[float, float]:
    """The two standard deviations of an answer."""
    values = pair(answer, "process", "sensor")
    process, sensor = (float(expect.tensor("a standard deviation", v, ())) for v in values)
    hint = "A standard deviation is positive."
    expect.that(process > 0 and sensor > 0, "two positive numbers", f"{process}, {sensor}", hint)
    return process, sensor


@tuned.must("be two positive standard deviations")
def positive(answer, given):
    noises(answer)


@tuned.must("make the mean NIS lie between 3.6 and 4.4 on recordings that were not seen")
def right_nis(answer, given):
    value, _ = scores(*noises(answer), seed=5)
    more = "The filter is too sure of its sensor: R is too small."
    less = "The filter is too modest: R is too large."
    hint = more if value > 4 else less
    expect.that(3.6 < value < 4.4, "a mean NIS between 3.6 and 4.4", f"{value:.2f}", hint)


@tuned.must("make the mean NEES lie between 3.4 and 4.6 on recordings that were not seen")
def right_nees(answer, given):
    _, value = scores(*noises(answer), seed=5)
    hint = "Q is too small." if value > 4 else "Q is too large: the filter is too modest."
    expect.that(3.4 < value < 4.6, "a mean NEES between 3.4 and 4.6", f"{value:.2f}", hint)


learn_noise = Exercise("4.7", "Learn the noise", minutes=25, takes="y", points=2, seconds=90)


def learned(answer, seed: int, process: float, sensor: float) -> tuple[float, float]:
    """What an answer learns from recordings with these deviations."""
    y = recordings.walks(seed, process, sensor)
    values = pair(answer(y), "the deviation of w", "that of v")
    first, second = (float(expect.tensor("a standard deviation", v, ())) for v in values)
    return first, second


def within(came: float, want: float) -> bool:
    """Whether a deviation is right to within 20 %."""
    return abs(came - want) <= 0.2 * want


@learn_noise.must("return two numbers")
def two_numbers(answer, given):
    learned(answer, 1, 0.5, 1.0)


@learn_noise.must("find both standard deviations to within 20 %")
def both(answer, given):
    for seed, process, sensor in [(2, 0.5, 1.0), (3, 1.5, 0.6), (4, 0.3, 0.8)]:
        found = learned(answer, seed, process, sensor)
        hint = "Look at the loss: is log S in it, and S = P + R?"
        if within(found[0], process**2) and within(found[1], sensor**2):
            hint = "These are the variances: return their roots."
        elif within(found[0], sensor) and within(found[1], process):
            hint = "They are in the wrong order: first that of w, then that of v."
        elif found[0] > 20 * process or found[1] > 20 * sensor:
            hint = "Without log S the loss becomes smaller and smaller as S grows."
        fits = within(found[0], process) and within(found[1], sensor)
        want = f"about {process:g} and {sensor:g}"
        expect.that(fits, want, f"{found[0]:.3g} and {found[1]:.3g}", hint)


filter_walk = Exercise("4.8", "A walk of the dog", minutes=15, takes="y, u", seconds=60)


def position_error(estimates: Tensor, x: Tensor) -> float:
    """The mean distance of estimated positions from the true ones."""
    return float((estimates - x)[:, :2].norm(dim=-1).mean())


def walked(answer, seed: int) -> tuple[Tensor, Tensor, Tensor]:
    """The states of a walk, the measurements, and what an answer makes of them."""
    x, y, u = recordings.dog_walk(seed)
    return x, y, expect.tensor("the estimates", answer(y, u), (len(y), 4))


@filter_walk.must("return an estimate for each measurement")
def estimates_of_all(answer, given):
    walked(answer, 1)


@filter_walk.must("be less than half as far off as the measurements, on walks not seen")
def half_the_error(answer, given):
    walks = [walked(answer, seed) for seed in (2, 3, 5, 6)]
    raw = sum(position_error(y, x) for x, y, _ in walks) / len(walks)
    found = sum(position_error(came, x) for x, _, came in walks) / len(walks)
    hint = "Is R that of the poses, and Q small? Correct first, and keep that estimate."
    if all(position_error(came, y) < 0.02 for _, y, came in walks):
        hint = "These are nearly the measurements themselves: R is too small, or Q too large."
    want = f"a mean error below {raw / 2:.3f} m"
    expect.that(found < raw / 2, want, f"{found:.3f} m", hint)


@filter_walk.must("use no measurement of a later step")
def causal(answer, given):
    x, y, u = recordings.dog_walk(4)
    came = expect.tensor("the estimates", answer(y, u), (len(y), 4))
    later = y.clone()
    later[50:, :2] += 1.0
    again = expect.tensor("the estimates", answer(later, u), (len(y), 4))
    same = bool((came[:50] - again[:50]).abs().max() < 1e-9)
    hint = "The estimate of step i may use y[0] to y[i]."
    expect.that(same, "the same first 50 estimates, whatever comes later", "others", hint)
