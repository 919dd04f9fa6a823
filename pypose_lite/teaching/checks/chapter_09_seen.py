"""What the answers of lab 9 must do: find in a log what a robot has."""

import torch

from ... import go1
from . import expect
from .exercise import Exercise, Failure
from .robot_logs import KINDS, pulses, recorded_pulses, walk_log
from .words import kind

finder = Exercise(
    "9.6", "What does this robot have?", minutes=20, takes="log", points=3, seconds=60.0
)
SIGNS = {
    "healthy": "Its speed follows what it is told within half a second, to the end of 6 s.",
    "deaf": "It is told to walk, and its speed stays near 0.",
    "frozen": "It walked, and then no new state came: the log ends before its time.",
    "lossy": "Many states did not come: the ages are not those of 50 states a second.",
    "late": "All comes, and the speed follows too late: shift it against what was told.",
}


@finder.must("say one of the five words")
def says_a_word(answer, given):
    came = answer(walk_log("healthy", 9))
    wanted = f"one of {', '.join(map(repr, SIGNS))}"
    if not isinstance(came, str):
        raise Failure(wanted, kind(came))
    expect.that(came in SIGNS, wanted, repr(came))


@finder.must("find what each robot has, on walks that you have not seen")
def finds(answer, given):
    for k in range(3):
        for name in KINDS:
            came = answer(walk_log(name, 10 * given.seed + 4 + k))
            if not isinstance(came, str):
                raise Failure(f"{name!r}", kind(came))
            expect.that(
                came == name, f"{name!r} for a robot that is {name}", repr(came), SIGNS[name]
            )


identifier = Exercise(
    "9.7", "Lag and delay of a stranger", minutes=20, takes="t, seen, told", points=3, seconds=60.0
)


def a_log(given, lag, delay):
    """Times, speeds seen and told (N, 2) of legs with a lag and a delay, and noise of sensors."""
    t = 0.02 * torch.arange(500, dtype=torch.float64)
    levels = given.uniform(-1, 1, 10, 2)
    late = t - delay
    told, v, seen = levels[(t // 1).long()], torch.zeros(2, dtype=torch.float64), []
    for k in range(len(t)):  # in steps of 1 ms: another route than the chapter's sum
        for small in range(20):
            at = float(late[k]) - 0.02 + 0.001 * (small + 1)
            u = levels[int(at)] if at > 0 else levels[0] * 0
            v = v + 0.001 / lag * (u - v)
        seen.append(v)
    told = torch.cat([torch.zeros(1, 2, dtype=torch.float64), told[1:]])
    return t, torch.stack(seen) + 0.01 * given.randn(500, 2), told


@identifier.must("find both, to 0.02 s")
def finds_both(answer, given):
    for lag, delay in [(0.15, 0.1), (0.35, 0.06), (0.1, 0.24)]:
        lag, delay = lag + float(given.uniform(-0.03, 0.03)), delay + float(given.uniform(0, 0.04))
        came = answer(*a_log(given, lag, delay))
        if isinstance(came, torch.Tensor) and came.shape == (2,):
            came = came.tolist()
        came = expect.parts(came, "lag", "delay")
        numbers = [float(expect.tensor(name, x, ())) for name, x in zip(("lag", "delay"), came)]
        both = f"lag {lag:.3f} s, delay {delay:.3f} s"
        near = [abs(a - b) < 0.02 for a, b in zip(numbers, (lag, delay))]
        hint = "Is the misfit least there? Begin at several first guesses, or try a grid first."
        if all(abs(a - b) < 0.02 for a, b in zip(numbers, (delay, lag))):
            hint = "They are exchanged."
        elif abs(sum(numbers) - lag - delay) < 0.04:
            hint = "Their sum is right: fit both at once, the shape tells them apart."
        elif near[0]:
            hint = "The lag is right. The delay is in seconds, there and back."
        came = f"lag {numbers[0]:.3f} s, delay {numbers[1]:.3f} s"
        expect.that(all(near), both, came, hint)


dead = Exercise(
    "9.8", "The dead band of a dog with legs", minutes=15, takes="log", points=2, seconds=60.0
)
CROSSES = {0.05: 0.08, 0.15: 0.18, 0.2: 0.22, 0.3: 0.33}  # dead bands between two of the pulses


def bands_near(answer, log, low, high):
    """Sees to it that an answer lies between the last speed not followed and the first followed."""
    came = float(expect.tensor("the dead band", answer(log), ()))
    hint = "Which of the speeds that it was told does it follow by a third? Look at each pulse."
    if came > high:
        hint = "It follows slower ones: compare what is seen with what is told, pulse by pulse."
    elif came < low:
        hint = "This one it does not follow. Leave the beginning of a pulse out: it is late."
    wanted = f"a speed between {low:.2f} and {high:.2f} m/s"
    expect.that(low - 0.01 <= came <= high + 0.01, wanted, f"{came:.3f}", hint)


@dead.must("find it, whatever it is")
def finds_dead_band(answer, given):
    for low, band in [*CROSSES.items()][given.seed % 2 :: 2]:
        numbers = go1.Numbers(dead_band=band, lag=0.1 + float(given.uniform(0, 0.1)))
        log = pulses(go1.Simulation(seed=given.seed, numbers=numbers))
        bands_near(answer, log, low, low + 0.05)


@dead.must("find none where there is none")
def finds_none(answer, given):
    bands_near(answer, pulses(go1.Simulation(seed=given.seed)), 0.0, 0.05)


@dead.must("find that of the dog with legs")
def finds_that_of_legs(answer, given):
    bands_near(answer, recorded_pulses(), 0.15, 0.2)
