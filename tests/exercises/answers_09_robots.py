"""Answers to lab 9 on watchdogs, stops and logs, as students give them."""

import contextlib
import math

import torch
from graders import right, wrong
from scipy.optimize import minimize

# --- 9.4


@right("9.4")
def chained(now, motion, asked_at, heard_at, patience):
    fresh = 0 <= now - asked_at < patience and 0 <= now - heard_at < patience
    return motion if fresh and all(map(math.isfinite, motion)) else (0.0, 0.0)


@right("9.4")
def with_returns(now, motion, asked_at, heard_at, patience):
    stop = [0, 0]
    if not (asked_at <= now <= asked_at + patience):
        return stop
    if not (heard_at <= now <= heard_at + patience):
        return stop
    if any(math.isnan(u) or math.isinf(u) for u in motion):
        return stop
    return list(motion)


@right("9.4")
def in_tensors(now, motion, asked_at, heard_at, patience):
    motion = torch.tensor(motion, dtype=torch.float32)
    ages = now - torch.tensor([asked_at, heard_at])
    well = ((ages >= 0) & (ages < patience)).all() and motion.isfinite().all()
    return motion if well else torch.zeros(2)


@wrong("9.4", "The planner has been silent")
def without_the_planner(now, motion, asked_at, heard_at, patience):
    return chained(now, motion, now, heard_at, patience)


@wrong("9.4", "may be elsewhere")
def without_the_state(now, motion, asked_at, heard_at, patience):
    return chained(now, motion, asked_at, now, patience)


@wrong("9.4", "not their sum")
def the_sum_of_ages(now, motion, asked_at, heard_at, patience):
    age = 2 * now - asked_at - heard_at
    return motion if age < patience else (0.0, 0.0)


@wrong("9.4", "A comparison with nan is False")
def asks_whether_it_is_ill(now, motion, asked_at, heard_at, patience):
    ill = now - asked_at > patience or now - heard_at > patience
    return (0.0, 0.0) if ill else motion


@wrong("9.4", "the clock was set back")
def from_the_future(now, motion, asked_at, heard_at, patience):
    fresh = now - asked_at < patience and now - heard_at < patience
    return motion if fresh and all(map(math.isfinite, motion)) else (0.0, 0.0)


@wrong("9.4", "A planner that divides by zero")
def lets_nan_out(now, motion, asked_at, heard_at, patience):
    fresh = 0 <= now - asked_at < patience and 0 <= now - heard_at < patience
    return motion if fresh else (0.0, 0.0)


@wrong("9.4", "A function without `return`")
def returns_nothing_to_stop(now, motion, asked_at, heard_at, patience):
    if 0 <= now - asked_at < patience and 0 <= now - heard_at < patience:
        return motion
    return None


# --- 9.5


@right("9.5")
def with_finally(robot, plan, dt):
    try:
        motion = plan(robot.pose())
        while motion is not None:
            robot.move(*motion)
            robot.wait(dt)
            motion = plan(robot.pose())
    finally:
        robot.stop()


@right("9.5")
def with_an_exit_stack(robot, plan, dt):
    with contextlib.ExitStack() as stack:
        stack.callback(robot.stop)
        while True:
            motion = plan(robot.pose())
            if motion is None:
                break
            robot.move(motion[0], motion[1])
            robot.wait(dt)


@right("9.5")
def catches_all_and_raises_again(robot, plan, dt):
    try:
        while (motion := plan(robot.pose())) is not None:
            robot.move(*motion)
            robot.wait(dt)
    except BaseException:
        robot.stop()
        raise
    robot.stop()


@wrong("9.5", "The dog would walk on")
def never_stops(robot, plan, dt):
    while (motion := plan(robot.pose())) is not None:
        robot.move(*motion)
        robot.wait(dt)


@wrong("9.5", "`finally` is reached however")
def stops_only_at_the_end(robot, plan, dt):
    never_stops(robot, plan, dt)
    robot.stop()


@wrong("9.5", "KeyboardInterrupt is no Exception")
def catches_exceptions_alone(robot, plan, dt):
    try:
        never_stops(robot, plan, dt)
    except Exception:
        robot.stop()
        raise
    robot.stop()


@wrong("9.5", "It was swallowed")
def swallows(robot, plan, dt):
    try:
        never_stops(robot, plan, dt)
    except BaseException:
        pass
    robot.stop()


@wrong("9.5", "It was swallowed")
def returns_from_finally(robot, plan, dt):
    with contextlib.suppress(BaseException):
        never_stops(robot, plan, dt)
    robot.stop()


@wrong("9.5", "It has to be after the loop")
def stops_in_every_step(robot, plan, dt):
    while (motion := plan(robot.pose())) is not None:
        try:
            robot.move(*motion)
            robot.wait(dt)
        finally:
            robot.stop()


@wrong("9.5", "In each step: pose, then move, then wait")
def waits_first(robot, plan, dt):
    try:
        while (motion := plan(robot.pose())) is not None:
            robot.wait(dt)
            robot.move(*motion)
    finally:
        robot.stop()


@wrong("9.5", "moves")
def moves_once(robot, plan, dt):
    try:
        robot.move(*plan(robot.pose()))
        robot.wait(dt)
    finally:
        robot.stop()


# --- 9.6


@right("9.6")
def by_shifting(log):
    def misfit(rows):
        return (log.seen[rows:] - log.told[:-rows]).square().mean()

    if log.seen.max() < 0.1:
        return "deaf"
    if log.t[-1] < 5.5:
        return "frozen"
    if len(log.t) < 200:
        return "lossy"
    return "late" if misfit(18) < misfit(5) else "healthy"


@right("9.6")
def by_the_first_second(log):
    lossy = log.age.mean() > 0.03
    if bool((log.seen < 0.15).all()):
        return "deaf"
    if lossy:
        return "lossy"
    if log.t.max() < 5.5:
        return "frozen"
    begins = log.t[log.told > 0.05][0]
    follows = log.t[log.seen > log.told.max() * 0.3][0]
    return "late" if follows - begins > 0.28 else "healthy"


@wrong("9.6", "one of 'healthy'")
def a_sentence(log):
    return "it is well"


@wrong("9.6", "stays near 0")
def never_deaf(log):
    found = by_shifting(log)
    return "healthy" if found == "deaf" else found


@wrong("9.6", "the log ends before its time")
def never_frozen(log):
    found = by_shifting(log)
    return "healthy" if found == "frozen" else found


@wrong("9.6", "the ages are not those of 50 states a second")
def never_lossy(log):
    found = by_shifting(log)
    return "healthy" if found == "lossy" else found


@wrong("9.6", "shift it against what was told")
def never_late(log):
    found = by_shifting(log)
    return "healthy" if found == "late" else found


@wrong("9.6", "Its speed follows")
def always_late(log):
    found = by_shifting(log)
    return "late" if found == "healthy" else found


@wrong("9.6", "stays near 0")
def the_end_of_the_log_first(log):
    return "frozen" if log.t[-1] < 5.5 else by_shifting(log)


# --- 9.7


def model(t, told, lag, delay):
    since = (t[:, None] - delay - t[1:]).clamp(min=0)
    return told[0] + (1 - torch.exp(-since / lag)) @ told.diff(dim=0)


@right("9.7")
def on_two_grids(t, seen, told):
    def best(lags, delays):
        pairs = [(lag, delay) for lag in lags for delay in delays]
        return min(pairs, key=lambda p: float((model(t, told, *p) - seen).square().mean()))

    lag, delay = best(torch.linspace(0.04, 0.42, 20), torch.linspace(0, 0.32, 17))
    near = torch.linspace(-0.015, 0.015, 7)
    return best(lag + near, (delay + near).clamp(min=0))


@right("9.7")
def by_scipy(t, seen, told):
    def misfit(z):
        return float((model(t, told, *abs(z)) - seen).square().mean())

    found = minimize(misfit, [0.2, 0.15], method="Nelder-Mead", options={"maxfev": 150})
    return abs(found.x[0]), abs(found.x[1])


@right("9.7")
def by_gradient(t, seen, told):
    z = torch.tensor([0.2, 0.15]).double().log().requires_grad_()
    optimizer = torch.optim.LBFGS([z], max_iter=20, line_search_fn="strong_wolfe")

    def evaluate():
        loss = (model(t, told, *z.exp()) - seen).square().mean()
        (z.grad,) = torch.autograd.grad(loss, z)
        return loss

    optimizer.step(evaluate)
    return z.exp()


@wrong("9.7", "They are exchanged")
def exchanged(t, seen, told):
    return on_two_grids(t, seen, told)[::-1]


@wrong("9.7", "fit both at once")
def delay_alone(t, seen, told):
    lag, delay = on_two_grids(t, seen, told)
    return 0.02, lag + delay - 0.02


@wrong("9.7", "there and back")
def half_of_the_delay(t, seen, told):
    lag, delay = on_two_grids(t, seen, told)
    return lag, delay / 2


@wrong("9.7", "there and back")
def in_milliseconds(t, seen, told):
    lag, delay = on_two_grids(t, seen, told)
    return lag, 1000 * delay


@wrong("9.7", "Is the misfit least there")
def the_chapters(t, seen, told):
    return 0.5, 0.2


@wrong("9.7", "2 results")
def lag_alone(t, seen, told):
    return on_two_grids(t, seen, told)[0]


# --- 9.8


@right("9.8")
def by_speeds(log):
    ignored = [0.0]
    for speed in log.told.unique():
        seen = log.seen[log.told == speed]
        if speed > 0 and seen[len(seen) // 2 :].mean() < speed / 3:
            ignored.append(speed.item())
    return max(ignored)


@right("9.8")
def the_smallest_that_is_followed(log):
    followed = []
    for speed in sorted(set(log.told.tolist()) - {0.0}):
        seen = log.seen[log.told == speed]
        if float(seen[-25:].mean()) > speed / 3:
            followed.append(speed)
    return min(followed)


@right("9.8")
def in_the_middle_between_them(log):
    return (by_speeds(log) + the_smallest_that_is_followed(log)) / 2


@wrong("9.8", "It follows slower ones")
def the_largest_told(log):
    return log.told.max()


@wrong("9.8", "It follows slower ones")
def as_fast_as_it_ever_was(log):
    return log.seen.max()


@wrong("9.8", "This one it does not follow")
def the_smallest_told(log):
    return log.told[log.told > 0].min() / 2


@wrong("9.8", "This one it does not follow")
def the_smallest_seen(log):
    return log.seen[log.told > 0].abs().min()


@wrong("9.8", "It follows slower ones")
def only_what_it_follows_wholly(log):
    ignored = [0.0]
    for speed in log.told.unique():
        if speed > 0 and log.seen[log.told == speed].mean() < 0.95 * speed:
            ignored.append(speed.item())
    return max(ignored)


@wrong("9.8", "the dead band as a single number")
def which_speeds(log):
    return log.told.unique()
