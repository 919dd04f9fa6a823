"""What the answers of lab 3 must do."""

import math

import torch

from ... import go1, infinity
from ...control import MPC
from ...systems import DubinsCar
from ...utils import ReduceToBason
from . import expect
from .exercise import Exercise
from .planning import ALPHAS, by_cases, driven, least_cost, searched, with_slope


def chapter_Q():
    """The weights of the chapter."""
    return torch.diag(torch.tensor([1, 1, 0.3, 0.3, 0.01, 0.01]))


warm_start = Exercise("3.1", "A warm start", minutes=5, takes="u")


@warm_start.must("return as many inputs as it was given")
def shape_of_guess(answer, given):
    for T, m in [(5, 2), (1, 1), (3, 4)]:
        expect.tensor("the guess", answer(given.randn(T, m)), (T, m))


@warm_start.must("move every input one step earlier, and repeat the last one")
def moved_on(answer, given):
    T, m = given.size(6), given.size(2)
    u = given.randn(T, m)
    zero = torch.zeros(1, m)
    mistakes = {
        "The input that was just used has come back at the end.": u.roll(-1, 0),
        "The inputs moved one step later: the first one has been used, leave it out.": u.roll(1, 0),
        "The first input is there twice, and the last one is lost.": torch.cat([u[:1], u[:-1]]),
        "The new last input is zero: repeat the one before it.": torch.cat([u[1:], zero]),
        "Nothing has moved.": u,
    }
    rows = [u[min(t + 1, T - 1)] for t in range(T)]
    hint = "Input t of the guess is input t + 1 of the plan, as far as there is one."
    expect.close("the guess", answer(u), torch.stack(rows), hint, mistakes)


line_search = Exercise("3.2", "A line search", minutes=10, takes="cost_after, cost_now, alphas")


@line_search.must("return the step length with the least cost")
def cheapest(answer, given):
    for best in (1, 2, 3, 0):
        costs = [2.6, 2.5, 2.0, 2.8]
        costs[best] = 1.7
        came = searched(answer, costs, 4.0)
        hint = "Do not stop at the first length that helps: look at all of them."
        if came == max(zip(costs, ALPHAS))[1]:
            hint = "This is the length with the largest cost."
        elif came == best or came == costs[best]:
            hint = "Return the length itself, not its place in the list, nor its cost."
        elif came == 0:
            hint = "Here a step does help."
        expect.that(
            came == ALPHAS[best],
            f"{ALPHAS[best]}, of the costs {dict(zip(ALPHAS, costs))}",
            f"{came:g}",
            hint,
        )


@line_search.must("return 0.0 where no step costs less than the plan without a change")
def stays(answer, given):
    for costs in ([5.0, 4.5, 4.2, 4.1], [4.0, 4.0, 4.0, 4.0]):
        came = searched(answer, costs, 4.0)
        hint = "The cost must never rise, nor stay as it is: compare with cost_now, too."
        expect.that(came == 0, f"0.0, of the costs {costs} with cost_now = 4.0", f"{came:g}", hint)


@line_search.must("never take a step whose cost is not a number, or infinite")
def not_a_number(answer, given):
    nan, inf = math.nan, math.inf
    hint = "Every comparison with nan is false: write it so that false means: not this step."
    for costs, best in [([nan, nan, 3.0, 3.5], 0.2), ([3.0, nan, 3.5, nan], 0.8)]:
        came = searched(answer, costs, 4.0)
        expect.that(came == best, f"{best}, of the costs {costs}", f"{came:g}", hint)
    for costs in ([nan] * 4, [inf, nan, inf, inf]):
        came = searched(answer, costs, 4.0)
        expect.that(came == 0, f"0.0, of the costs {costs}", f"{came:g}", hint)


backward = Exercise("3.3", "A recursion with a fault", minutes=20, takes="A, B, Q, q", points=2)


def horizon(given, T=4, n=3, m=2):
    """A, B, Q and q of some plan."""
    return given.randn(T, n, n), given.randn(T, n, m), given.positive(n + m), given.randn(T, n + m)


def run_backward(answer, problem):
    """The gains k and K of an answer, of the right shapes."""
    T, n, m = problem[1].shape
    k, K = expect.parts(answer(*problem), "k", "K")
    return expect.tensor("k", k, (T, m)), expect.tensor("K", K, (T, m, n))


@backward.must("return k of shape (T, m) and K of shape (T, m, n)")
def shapes_of_gains(answer, given):
    for sizes in [(4, 3, 2), (1, 2, 1), (3, 1, 2)]:
        run_backward(answer, horizon(given, *sizes))


@backward.must("give the last step the input that is best for it alone")
def last_step(answer, given):
    A, B, Q, q = horizon(given)
    k, K = run_backward(answer, (A, B, Q, q))
    want = -torch.linalg.solve(Q[3:, 3:], q[-1, 3:])
    mistakes = {"k has the opposite sign: downhill is -h.": -want}
    expect.close("the last k", k[-1], want, "There H = Q and h = q[-1].", mistakes)
    want = -torch.linalg.solve(Q[3:, 3:], Q[3:, :3])
    mistakes = {"K has the opposite sign.": -want}
    expect.close("the last K", K[-1], want, "There H = Q: K = -Huu^-1 Hux.", mistakes)


@backward.must("give gains that lead to the inputs of least cost")
def best_inputs(answer, given):
    n, m = given.size(3), given.size(2)
    for T in (2, given.size(5)):
        A, B, Q, q = horizon(given, T, n, m)
        came = driven(A, B, *run_backward(answer, (A, B, Q, q)))
        blind = driven(A, B, *with_slope(A, B, Q, q, lambda h, H, k, K, n: 0 * h[:n]))
        mine = driven(A, B, *with_slope(A, B, Q, q, lambda h, H, k, K, n: h[:n]))
        mixed = driven(
            A, B, *with_slope(A, B, Q, q, lambda h, H, k, K, n: h[:n] - H[n:, :n].mT @ k)
        )
        mistakes = {
            "v has lost what k changes: H_ux' k.": mine,
            "v stays 0: the slope of the future is forgotten.": blind,
            "H_ux' k has the wrong sign in v.": mixed,
        }
        hint = "Follow one step by hand: put u = k + K x into the quadratic of H and h."
        expect.close("the inputs", came, least_cost(A, B, Q, q), hint, mistakes)


kkt = Exercise("3.4", "A test for plans with bounds", minutes=10, takes="u, slope, lower, upper")


def residual(answer, u, slope, lower, upper, hint, mistakes=None):
    """Holds an answer to the residual of one plan."""
    came = expect.tensor("the residual", answer(u, slope, lower, upper), ())
    want = torch.tensor(by_cases(u, slope, lower, upper))
    expect.close("the residual", came, want, hint, mistakes)


@kkt.must("be the largest slope where no bound is near")
def free_inputs(answer, given):
    wide = torch.full((2,), 100.0)
    for largest in (1.5, -1.5):
        u, slope = given.uniform(-1, 1, 5, 2), given.uniform(-1, 1, 5, 2)
        slope[3, 1] = largest
        without = (-slope if largest > 0 else slope).max()
        mistakes = {
            "Take the absolute value before the maximum.": without,
            "This is the sum: the largest component was asked for.": slope.abs().sum(),
            "This is the mean: the largest component was asked for.": slope.abs().mean(),
        }
        hint = "Far from the bounds clipping does nothing."
        residual(answer, u, slope, -wide, wide, hint, mistakes)
    infinite = torch.full((2,), torch.inf)
    residual(answer, u, slope, -infinite, infinite, "Bounds may be infinite.")


@kkt.must("be 0 where an input stands at its bound and downhill leads out of the box")
def pushed_out(answer, given):
    lower, upper = torch.tensor([-1.0, -2.0]), torch.tensor([1.0, 0.5])
    u = torch.stack([lower, upper, lower])
    slope = torch.tensor([[0.7, 0.2], [-0.4, -3.0], [0.1, 2.0]])
    mistakes = {
        "A slope at a bound counts only if downhill, -g, leads into the box.": slope.abs().max()
    }
    hint = "Downhill is -g: at the lower bound a positive slope is allowed."
    residual(answer, u, slope, lower, upper, hint, mistakes)


@kkt.must("not be 0 where an input stands at its bound and downhill leads into the box")
def pulled_in(answer, given):
    lower, upper = torch.tensor([-1.0, -2.0]), torch.tensor([1.0, 0.5])
    for u, slope in [(lower, [-0.7, 0.0]), (upper, [0.0, 0.3])]:
        hint = (
            "Here going downhill stays inside: the plan is not optimal. Mind the sign of the step."
        )
        residual(answer, u[None], torch.tensor([slope]), lower, upper, hint)


@kkt.must("clip each input to its own two bounds")
def near_bounds(answer, given):
    lower, upper = torch.tensor([-0.3, -2.0]), torch.tensor([0.4, 1.0])
    for _ in range(4):
        T = given.size(6)
        u = torch.minimum(torch.maximum(given.randn(T, 2), lower), upper)
        hint = (
            "clip(u - slope, lower, upper) - u, with the bounds of its own column for each input."
        )
        residual(answer, u, given.randn(T, 2), lower, upper, hint)


plans = Exercise("3.5", "Which of these plans is not optimal?", minutes=10)


@plans.must("name the plan whose residual is not 0")
def not_optimal(answer, given):
    a = "Its residual is 0, up to rounding: it knew its bounds."
    c = "It began with another guess, and ended at the same plan as (a)."
    expect.choice(answer, "b", {"a": a, "c": c})


terminal = Exercise("3.6", "A terminal cost", minutes=15, points=2, seconds=60)


@terminal.must("be a symmetric matrix (4, 4) without negative eigenvalues")
def weights_of_last(answer, given):
    Qf = expect.tensor("Qf", answer, (4, 4))
    expect.that(expect.near(Qf, Qf.mT), "a symmetric matrix", "one that is not", "Weights are.")
    least = torch.linalg.eigvalsh(Qf).min().item()
    why = "A negative weight pays the car for being far away."
    expect.that(least > -1e-9, "eigenvalues >= 0", f"one of {least:.3g}", why)


@terminal.must("bring the car around with a horizon of two steps, 0.03 m from the path at most")
def around(answer, given):
    Qf = expect.tensor("Qf", answer, (4, 4)).detach()
    run = infinity.drive(MPC(DubinsCar(), chapter_Q(), None, 2, Qf=Qf), steps=60)
    reached = int(run.goal.max()) - 1 + int(run.finished)
    hint = "The car parks: a turn that pays off later pays off beyond the horizon. Weigh more."
    expect.that(run.finished, "all 16 waypoints within 60 steps", f"{reached} of them", hint)
    error = infinity.tracking_error(run.x).max().item()
    hint = "It arrives. What stands for a longer future has to weigh more; try factors of three."
    expect.that(error < 0.03, "an error below 0.03 m", f"{error:.3f} m", hint)


believed = Exercise(
    "3.7", "What does the driver believe?", 30, takes="x, target, u", points=3, seconds=120
)


@believed.must("find the slip that the driver plans with, to within 0.01")
def slip_found(answer, given):
    path = infinity.waypoints()
    for true in (0.08, 0.33):
        x = path[:12] + 0.1 * given.randn(12, 4)
        x[:, 2:] = x[:, 2:] / x[:, 2:].norm(dim=-1, keepdim=True)
        target = path[1:13]
        with torch.no_grad():
            u = MPC(DubinsCar(0.1, true), chapter_Q(), None, 10)(0.1, x, target)[1][:, 0]
        came = expect.tensor("the slip", answer(x, target, u + 0.01 * given.randn(12, 2)), ())
        off = abs(came.item() - true)
        hint = "Compare the first input of each plan, inputs[:, 0], with what the driver did."
        if min(abs(came.item() - start) for start in (0.1, 0.2)) < 1e-3:
            hint = "The guess has not moved: does the loss have a gradient with respect to slip?"
        elif abs(came.item() - (1 - true)) < 0.02:
            hint = "This is 1 - slip."
        elif off < 0.06:
            hint = "You are on the way: make more steps, or larger ones."
        elif not -0.1 <= came.item() <= 0.6:
            hint = "It has run away: go downhill, by steps that are not too large."
        expect.that(off < 0.01, f"{true} within 0.01", f"{came.item():.3f}", hint)


dog = Exercise("3.8", "Walk the dog", minutes=15, points=2, seconds=120)


@dog.must("be two tensors of shape (2,), the lower bounds below the upper ones")
def two_bounds(answer, given):
    lower, upper = expect.parts(answer, "lower", "upper")
    lower, upper = expect.tensor("lower", lower, (2,)), expect.tensor("upper", upper, (2,))
    hint = "First the least speed and turn rate, then the largest."
    expect.that((lower < upper).all(), "lower < upper", f"{lower.tolist()}, {upper.tolist()}", hint)


@dog.must("be what the dog can do: at most 1.2 m/s and 1.5 rad/s")
def possible(answer, given):
    lower, upper = (expect.tensor("a bound", bound, (2,)) for bound in answer)
    most = torch.tensor([1.2, 1.5])
    fits = (upper <= most + 1e-6).all() and (lower >= -most - 1e-6).all()
    hint = "Bounds that the dog cannot keep are no bounds."
    expect.that(
        fits, "bounds within those of the trot", f"{lower.tolist()}, {upper.tolist()}", hint
    )


@dog.must("bring the dog around within 20 s, 0.06 m from the path on average")
def walked(answer, given):
    lower, upper = (expect.tensor("a bound", bound, (2,)).detach() for bound in answer)
    planner = MPC(DubinsCar(), chapter_Q(), None, 10, ReduceToBason(steps=3))
    with go1.connect("sim", start=(0.0, 0.0, -math.pi / 2)) as robot:
        world = infinity.RealRobot(robot, 0.1)
        walk = infinity.drive(planner, world, None, None, 0.15, 200, lower, upper)
    reached = int(walk.goal.max()) - 1 + int(walk.finished)
    hint = "Is there enough speed, and enough turn rate in both directions?"
    expect.that(walk.finished, "all 16 waypoints within 20 s", f"{reached} of them", hint)
    error = infinity.tracking_error(walk.x).mean().item()
    hint = "It arrives, but far from the path. Can it turn fast enough?"
    expect.that(error < 0.06, "a mean error below 0.06 m", f"{error:.3f} m", hint)
