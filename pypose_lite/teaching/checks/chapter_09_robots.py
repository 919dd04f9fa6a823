"""What the answers of lab 9 must do: watchdogs and stops. What logs say: chapter_09_seen."""

import math

import torch

from . import expect
from .exercise import Exercise, Failure

watchdog = Exercise(
    "9.4",
    "A watchdog",
    minutes=15,
    takes="now, motion, asked_at, heard_at, patience",
    points=2,
)
INF, NAN = math.inf, math.nan


def goes_out(answer, *args):
    """The motion that an answer lets out."""
    return expect.tensor("a motion [v, turn]", answer(*args), (2,))


def expects(answer, args, want, hint):
    """Sees to one case."""
    came = goes_out(answer, *args)
    names = "now", "motion", "asked_at", "heard_at", "patience"
    case = ", ".join(f"{name} = {value}" for name, value in zip(names, args))
    wanted = f"{list(want)} for {case}"
    expect.that(expect.near(came, torch.tensor(want)), wanted, f"{came.tolist()}", hint)


@watchdog.must("let a motion out while it and the state are new enough")
def lets_out(answer, given):
    for _ in range(3):
        now, patience = (round(float(x), 2) for x in given.uniform(0.3, 0.9, 2))
        now = 100 + now
        hint = "Both are younger than the patience: compare each age with it, not their sum."
        for first, second in [(0.8, 0.7), (0.7, 0.8)]:
            args = now, (0.4, -0.3), now - first * patience, now - second * patience, patience
            expects(answer, args, (0.4, -0.3), hint)


@watchdog.must("stop when the motion was asked for too long ago")
def stops_without_planner(answer, given):
    args = 50.0, (0.4, 0.1), 49.5, 49.9, 0.4
    expects(answer, args, (0.0, 0.0), "The planner has been silent for longer than the patience.")


@watchdog.must("stop when nothing new was heard of the robot for too long, or ever")
def stops_without_state(answer, given):
    hint = "The planner plans for a robot that may be elsewhere by now."
    expects(answer, (50.0, (0.4, 0.1), 49.9, 49.5, 0.4), (0.0, 0.0), hint)
    expects(answer, (50.0, (0.4, 0.1), 49.9, -INF, 0.4), (0.0, 0.0), hint)


@watchdog.must("stop when a time is not one")
def stops_on_nonsense(answer, given):
    hint = "A comparison with nan is False: ask whether all is well, and not whether it is ill."
    for asked_at, heard_at in [(NAN, 49.9), (49.9, NAN)]:
        expects(answer, (50.0, (0.4, 0.1), asked_at, heard_at, 0.4), (0.0, 0.0), hint)
    hint = "It was asked for in the future: the clock was set back. Such an age means nothing."
    expects(answer, (50.0, (0.4, 0.1), 60.0, 49.9, 0.4), (0.0, 0.0), hint)


@watchdog.must("never let out a number that is none")
def no_nan(answer, given):
    hint = "A planner that divides by zero asks for nan: let zero out instead."
    for motion in [(NAN, 0.1), (0.4, NAN), (INF, 0.1)]:
        try:
            expects(answer, (50.0, motion, 49.9, 49.9, 0.4), (0.0, 0.0), hint)
        except Failure as failure:
            raise Failure("[0.0, 0.0] to go out", failure.came, hint) from None


stopper = Exercise("9.5", "A stop, whatever happens", minutes=15, takes="robot, plan, dt", points=2)


class Mishap(Exception):
    """What a check makes go wrong."""


class CtrlC(KeyboardInterrupt):
    """Somebody presses Ctrl-C."""


class FakeRobot:
    """Notes what it is told, and lets something go wrong at a call."""

    def __init__(self, fails=None, at=0, how=Mishap):
        self.calls, self.fails, self.at, self.how = [], fails, at, how

    def _note(self, name):
        self.calls.append(name)
        if name == self.fails and self.calls.count(name) == self.at:
            raise self.how()

    def pose(self):
        """Where it is."""
        self._note("pose")
        return 0.0, 0.0, 0.0

    def move(self, v, turn):
        """Takes a motion."""
        self._note("move")

    def wait(self, dt):
        """Waits."""
        self._note("wait")

    def stop(self):
        """Stops."""
        self._note("stop")


def planner_of(steps, fails_at=0):
    """A planner that is done after so many steps, or fails."""
    asked = []

    def plan(pose):
        asked.append(pose)
        if len(asked) == fails_at:
            raise Mishap()
        return None if len(asked) > steps else (0.4, 0.0)

    return plan


def walked(answer, robot, plan):
    """Lets an answer walk a robot; returns what it raised, or None."""
    try:
        answer(robot, plan, 0.1)
    except (Mishap, CtrlC) as error:
        return error
    return None


def must_have_stopped(robot, when):
    """Sees to it that the last word was a stop."""
    last = robot.calls[-1] if robot.calls else "nothing"
    hint = "`finally` is reached however the block before it ends."
    if when == "somebody pressed Ctrl-C":
        hint += " KeyboardInterrupt is no Exception: `except Exception` does not see it."
    expect.that(last == "stop", f"a stop as the last call, when {when}", f"{last!r}", hint)


@stopper.must("ask, plan, move and wait in every step, until the plan is None")
def walks(answer, given):
    steps = 3 + int(given.uniform(0, 4))
    robot = FakeRobot()
    walked(answer, robot, planner_of(steps))
    moves = robot.calls.count("move")
    expect.that(moves == steps, f"{steps} moves", f"{moves}", "One for each plan that is not None.")
    cycle = [call for call in robot.calls if call != "stop"][: 3 * steps]
    hint = "In each step: pose, then move, then wait."
    wanted = ["pose", "move", "wait"] * steps
    expect.that(cycle == wanted, "pose, move, wait in turn", ", ".join(cycle[:6]), hint)
    stops = robot.calls.count("stop")
    expect.that(stops > 0, "a stop at the end", "none", "The dog would walk on.")
    early = "stop" in robot.calls[: 3 * steps]
    expect.that(not early, "a stop at the end", "one on the way", "It has to be after the loop.")


@stopper.must("stop the robot when something goes wrong")
def stops(answer, given):
    at = 2 + int(given.uniform(0, 3))
    for name, when in [
        ("pose", "the robot has fallen silent"),
        ("move", "the robot refuses a motion"),
        ("wait", "waiting fails"),
    ]:
        robot = FakeRobot(name, at)
        walked(answer, robot, planner_of(9))
        must_have_stopped(robot, when)
    robot = FakeRobot()
    walked(answer, robot, planner_of(9, fails_at=at))
    must_have_stopped(robot, "the planner raises an error")
    robot = FakeRobot("wait", at, CtrlC)
    walked(answer, robot, planner_of(9))
    must_have_stopped(robot, "somebody pressed Ctrl-C")


@stopper.must("let the error go on to whoever called")
def tells(answer, given):
    for how, what in [(Mishap, "the error"), (CtrlC, "KeyboardInterrupt")]:
        error = walked(answer, FakeRobot("wait", 2, how), planner_of(9))
        hint = "It was swallowed: nobody will know. `finally` alone does not do that."
        expect.that(isinstance(error, how), f"{what} to go on", "none", hint)
