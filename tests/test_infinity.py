"""The running example: its path, its waypoints, and the loop that drives a car around."""

import math
from functools import partial

import pytest
import torch
from oracles import close, draw, rollout

import pypose_lite as pp
from pypose_lite import infinity
from pypose_lite.infinity import RealRobot, SimulatedCar

pytestmark = pytest.mark.usefixtures("float64")


def pursue(dt, x, target, *ignored):
    """A controller as cheap as can be: turn to the target, drive at up to 1.5 m/s."""
    ahead = target[..., :2] - x[..., :2]
    turn = torch.atan2(ahead[..., 1], ahead[..., 0]) - torch.atan2(x[..., 3], x[..., 2])
    turn = torch.atan2(turn.sin(), turn.cos())
    v = (ahead.norm(dim=-1) / dt).clamp(max=1.5) * turn.cos().clamp(min=0)
    u = torch.stack([v, turn / dt], -1)
    return None, u[..., None, :], None


# --- the path


def test_the_waypoints_are_the_two_circles_in_eighths():
    """The first circle counter-clockwise about (1, 0), the second clockwise about (-1, 0)."""
    w, eighth = infinity.waypoints(), math.pi / 4
    assert w.shape == (17, 4) and w.dtype == torch.float64
    for k in range(9):
        a = math.pi + k * eighth
        close(w[k], torch.tensor([1 + math.cos(a), math.sin(a), -math.sin(a), math.cos(a)]))
        a = -k * eighth
        close(w[8 + k], torch.tensor([-1 + math.cos(a), math.sin(a), math.sin(a), -math.cos(a)]))
    for k in (0, 8, 16):
        close(w[k], torch.tensor([0.0, 0, 0, -1]))
    assert infinity.waypoints(torch.float32).dtype == torch.float32


def test_the_reference_goes_at_unit_speed_along_its_heading_and_wraps():
    s = torch.linspace(-3, 20, 200).requires_grad_()
    x = infinity.reference(s)
    for i in range(2):
        speed = torch.autograd.grad(x[:, i].sum(), s, retain_graph=True)[0]
        close(speed, x[:, 2 + i])
    close(infinity.reference(s + infinity.LENGTH), x, 1e-11)
    close(infinity.reference(torch.arange(17) * math.pi / 4), infinity.waypoints())
    lead = infinity.reference(torch.zeros(2, 3))
    assert lead.shape == (2, 3, 4)


def test_the_tracking_error_is_the_distance_to_the_nearest_point_of_the_path(g):
    x = draw(g, 50, 4) * torch.tensor([1.5, 0.8, 1, 1])
    dense = infinity.reference(torch.linspace(0, infinity.LENGTH, 20001))
    nearest = torch.cdist(x[:, :2], dense[:, :2]).min(-1).values
    close(infinity.tracking_error(x), nearest, 2e-5)
    on = infinity.reference(torch.linspace(0.5, 5.5, 50))
    close(infinity.tracking_error(on), torch.zeros(50))
    left = torch.stack([-on[:, 3], on[:, 2]], -1)  # of the heading
    for side in (-0.07, 0.07):
        beside = on + side * torch.nn.functional.pad(left, (0, 2))
        close(infinity.tracking_error(beside), torch.full((50,), 0.07))


# --- the lap


@pytest.fixture(scope="module")
def lap():
    before = torch.get_default_dtype()
    torch.set_default_dtype(torch.float64)
    car = pp.DubinsCar()
    run = infinity.drive(infinity.controller(car), SimulatedCar(car))
    torch.set_default_dtype(before)
    return run


def test_the_ideal_car_visits_all_waypoints_in_order_and_ends_at_the_centre(lap):
    at = 0
    for waypoint in infinity.waypoints()[1:]:
        away = (lap.x[at:, :2] - waypoint[:2]).norm(dim=-1)
        at += int((away <= infinity.TOLERANCE).nonzero()[0])
    assert lap.finished and at == len(lap.x) - 1
    assert lap.x[-1, :2].norm() <= 0.1
    assert (lap.goal.diff() >= 0).all() and lap.goal[0] == 1 and lap.goal[-1] == 16


def test_the_ideal_car_stays_near_the_reference(lap):
    error = infinity.tracking_error(lap.x)
    assert error.mean() <= 0.03 and error.max() <= 0.1


def test_a_run_records_the_loop(lap):
    n = len(lap.u)
    assert lap.steps == n and lap.running.all()
    assert [tuple(z.shape) for z in lap[:4]] == [(n + 1, 4), (n, 2), (n, 4), (n, 4)]
    assert lap.P is None
    close(lap.y, lap.x[:-1], 0), close(lap.estimate, lap.y, 0)
    close(rollout(pp.DubinsCar(), lap.x[0], lap.u), lap.x)
    plan = infinity.controller()(0.1, lap.x[0], infinity.waypoints()[1])
    close(lap.u[0], plan[1][0])


def test_a_batch_of_cars_runs_as_each_alone_each_at_its_own_waypoint(g):
    x = infinity.waypoints()[0] + torch.tensor([0.3, 0.3, 0.5, 0.5]) * draw(g, 5, 4)
    run = infinity.drive(pursue, SimulatedCar(x_init=x))
    assert run.finished.all() and len(set(run.steps.tolist())) > 1
    assert (run.goal.max(-1).values == 17).any() and (run.goal[0] != run.goal[1]).any()
    for i in range(5):
        alone, n = infinity.drive(pursue, SimulatedCar(x_init=x[i])), int(run.steps[i])
        assert alone.finished and alone.steps == n
        close(run.x[i, : n + 1], alone.x), close(run.u[i, :n], alone.u)
        close(run.x[i, n:], alone.x[-1:].expand_as(run.x[i, n:]))
        close(run.u[i, n:], torch.zeros_like(run.u[i, n:]), 0)
        assert run.running[i].sum() == n


def test_a_batch_of_cars_under_mpc_runs_as_each_alone(g):
    x = infinity.waypoints()[0] + 0.1 * draw(g, 2, 2, 4)
    run = infinity.drive(infinity.controller(T=5), SimulatedCar(x_init=x), steps=6)
    assert run.x.shape == (2, 2, 7, 4) and run.steps.shape == (2, 2)
    alone = infinity.drive(infinity.controller(T=5), SimulatedCar(x_init=x[1, 0]), steps=6)
    close(run.x[1, 0], alone.x, 1e-9), close(run.u[1, 0], alone.u, 1e-8)


def test_an_mpc_is_started_from_its_last_plan_shifted():
    starts = []

    class Watched(pp.MPC):
        def forward(self, dt, x, target, u_init=None):
            starts.append(u_init)
            plans.append(super().forward(dt, x, target, u_init))
            return plans[-1]

    plans, q = [], infinity.controller().Q
    infinity.drive(Watched(pp.DubinsCar(), q, None, 4), steps=3)
    assert starts[0] is None
    for start, plan in zip(starts[1:], plans):
        close(start, pp.shift(plan[1]), 0)


def test_a_bounded_mpc_is_started_from_its_last_plan_too():
    starts, plans, low, high = [], [], torch.tensor([0.0, -1.5]), 2.0

    class Watched(pp.MPC):
        def forward(self, dt, x, target, u_init=None, **bounds):
            assert bounds == {"u_lower": low, "u_upper": high}
            starts.append(u_init)
            plans.append(super().forward(dt, x, target, u_init, **bounds))
            return plans[-1]

    q = infinity.controller().Q
    run = infinity.drive(Watched(pp.DubinsCar(), q, None, 6), steps=8, u_lower=low, u_upper=high)
    for start, plan in zip(starts[1:], plans):
        close(start, pp.shift(plan[1]), 0)
    alone = pp.MPC(pp.DubinsCar(), q, None, 6)
    free = infinity.drive(alone, steps=8)
    assert (run.u >= low).all() and (run.u <= high).all() and (free.u > high).any()
    cold = infinity.drive(partial(alone, u_lower=low, u_upper=high), steps=8)
    close(run.u, cold.u, 1e-7)


def test_one_bound_alone_reaches_a_controller_as_a_keyword_and_none_is_not_passed():
    heard = []

    def controller(dt, x, target, **keywords):
        heard.append(keywords)
        return pursue(dt, x, target)

    infinity.drive(controller, steps=1)
    infinity.drive(controller, steps=1, u_upper=1.5)
    assert heard == [{}, {"u_upper": 1.5}]
    with pytest.raises(TypeError, match="u_lower"):
        infinity.drive(lambda dt, x, target: pursue(dt, x, target), steps=1, u_lower=0.0)


def test_a_lap_that_is_cut_short_says_that_it_has_not_finished():
    run = infinity.drive(pursue, steps=7)
    assert not run.finished and run.steps == 7 and run.x.shape == (8, 4)


def test_a_waypoint_counts_as_reached_within_the_tolerance():
    near, far = (infinity.drive(pursue, tolerance=t, steps=12).goal for t in (0.05, 0.3))
    assert (far >= near).all() and (far > near).any()


def test_float32_stays_float32():
    start = infinity.waypoints(torch.float32)[0]
    run = infinity.drive(pursue, SimulatedCar(x_init=start), steps=5)
    assert {z.dtype for z in run[:4]} == {torch.float32}


# --- noise, estimators, targets of one's own


def test_noise_is_as_large_as_stated_and_the_same_for_the_same_generator():
    x = infinity.waypoints()[0].expand(400, 4)

    def run(seed):
        generator = torch.Generator().manual_seed(seed)
        q = infinity.OBSERVATION_NOISE
        return infinity.drive(pursue, SimulatedCar(None, x, 0.02, q, generator), steps=20)

    one, other = run(1), run(2)
    close(run(1).x, one.x, 0), close(run(1).y, one.y, 0)
    assert (one.x[:, 1:] - other.x[:, 1:]).abs().min() > 0
    v = one.y - one.x[:, :-1]
    assert abs(v.mean()) < 0.005 and abs(v.std() - infinity.OBSERVATION_NOISE) < 0.003
    assert abs(v[..., :2].norm(dim=-1).mean() - 0.2045) < 0.004
    w = one.x[:, 1:] - pp.DubinsCar().transition(one.x[:, :-1], one.u)
    assert abs(w.mean()) < 1e-3 and abs(w.std() - 0.02) < 5e-4
    white = torch.corrcoef(
        torch.stack([v[:, :-1].flatten(), v[:, 1:].flatten(), w[:, :-1].flatten()])
    )
    assert (white - torch.eye(3)).abs().max() < 0.03


def test_an_estimator_is_called_as_in_the_paper_and_the_controller_hears_its_estimate(g):
    calls, heard = [], []

    def estimator(x, y, u, P, Q, R):
        calls.append((x, y, u, P, Q, R))
        return x + 0.1, 2 * P

    def controller(dt, x, target):
        heard.append((dt, x, target))
        return pursue(dt, x, target)

    x = infinity.waypoints()[:3]
    world = SimulatedCar(pp.DubinsCar(0.2), x, 0.01, 0.3, generator=g)
    run = infinity.drive(controller, world, estimator, steps=4)
    for i, (X, y, u, P, Q, R) in enumerate(calls):
        close(X, run.estimate[:, i], 0), close(y, run.y[:, i], 0), close(u, run.u[:, i], 0)
        close(P, run.P[:, i], 0), close(P, 2.0**i * 0.05**2 * torch.eye(4).expand(3, 4, 4))
        close(Q, 0.01**2 * torch.eye(4)), close(R, 0.3**2 * torch.eye(4))
        close(X, calls[0][0] + 0.1 * i)
        assert heard[i][0] == 0.2
        close(heard[i][1], X, 0)
    first = calls[0][0] - x
    assert 0 < first.abs().max() < 0.3 and first.std() == pytest.approx(0.05, rel=0.5)
    assert len(calls) == 4 and run.P.shape == (3, 4, 4, 4)


def test_waypoints_are_reached_by_what_is_believed_not_by_what_is_true():
    w = infinity.waypoints()

    def dreamer(x, y, u, P, Q, R):
        return w[min(len(asked), 16)], P

    asked = []

    def still(dt, x, target):
        asked.append(target)
        return None, torch.zeros(1, 2), None

    run = infinity.drive(still, estimator=dreamer)
    assert run.finished
    close(run.x, w[:1].expand_as(run.x))


def test_a_target_of_ones_own_is_aimed_at():
    targets, asked = [], []

    def aim(x, index):
        asked.append((x, index))
        return infinity.waypoints()[index] + 0.5

    def controller(dt, x, target):
        targets.append(target)
        return pursue(dt, x, target)

    run = infinity.drive(controller, aim=aim, steps=3)
    for i in range(3):
        close(asked[i][0], run.estimate[i], 0)
        assert asked[i][1] == run.goal[i]
        close(targets[i], infinity.waypoints()[run.goal[i]] + 0.5, 0)


# --- robots, and what is left behind


class Toy:
    """A robot that moves at once and notes what it is told."""

    def __init__(self, breaks_at=99, x=(0.0, 0, 0, -1)):
        self.x, self.told, self.breaks_at = torch.tensor(x), [], breaks_at

    def pose(self):
        return (*self.x[:2].tolist(), math.atan2(self.x[3], self.x[2]))

    def move(self, v, phi):
        if len(self.told) >= self.breaks_at:
            raise OSError("the robot is gone")
        self.told.append((v, phi))

    def wait(self, dt):
        self.x = pp.DubinsCar(dt)(self.x, torch.tensor(self.told[-1]))[0]

    def stop(self):
        self.told.append("stop")


def test_a_robot_moves_in_the_cars_place_and_is_stopped_at_the_end():
    start = infinity.waypoints()[0] + torch.tensor([0.2, 0.1, 0, 0])
    robot, car = Toy(x=start.tolist()), infinity.drive(pursue, SimulatedCar(x_init=start), steps=30)
    run = infinity.drive(pursue, RealRobot(robot), steps=30)
    close(run.x, car.x, 1e-9), close(run.y, run.x[:-1])
    close(torch.tensor(robot.told[:-1]), run.u, 0)
    assert robot.told[-1] == "stop" and len(robot.told) == 31


@pytest.mark.parametrize("who", ["robot", "controller"])
def test_a_robot_is_stopped_also_after_an_error(who):
    robot = Toy(3 if who == "robot" else 99)

    def controller(dt, x, target):
        if who == "controller" and len(robot.told) == 3:
            raise OSError("the planner is gone")
        return pursue(dt, x, target)

    with pytest.raises(OSError, match=f"the {'robot' if who == 'robot' else 'planner'} is gone"):
        infinity.drive(controller, RealRobot(robot))
    assert robot.told[-1] == "stop" and len(robot.told) == 4


def test_the_clock_is_put_back_also_after_an_error():
    car = pp.DubinsCar().reset(4)

    def controller(dt, x, target):
        if car.systime == 6:
            raise OSError("the planner is gone")
        return pursue(dt, x, target)

    with pytest.raises(OSError, match="the planner is gone"):
        infinity.drive(controller, SimulatedCar(car))
    assert car.systime == 4


def test_a_robot_whose_first_pose_never_comes_is_stopped():
    class Silent(Toy):
        def pose(self):
            raise TimeoutError("no state came")

    robot = Silent()
    with pytest.raises(TimeoutError):
        infinity.drive(pursue, RealRobot(robot))
    assert robot.told == ["stop"]


def test_a_world_can_be_driven_in_again_from_its_start(g):
    world = SimulatedCar(x_init=infinity.waypoints()[:2])
    first, second = (infinity.drive(pursue, world, steps=4) for _ in range(2))
    close(first.x, second.x, 0)


def test_a_world_of_ones_own_needs_three_functions():
    class Still(infinity.World):
        told = "started"

        def look(self):
            return self.x

        def move(self, u, running):
            return self.x

        def stop(self):
            self.told = "stopped"

    world = Still(0.25)
    run = infinity.drive(lambda dt, x, target: (dt, torch.ones(1, 2), None), world, steps=3)
    assert world.told == "stopped" and run.x.shape == (4, 4)
    close(run.x, infinity.waypoints()[:1].expand(4, 4))


def test_a_lap_leaves_cars_and_controllers_as_they_were():
    car = pp.DubinsCar().reset(4)
    mpc = infinity.controller(car, T=3)
    first, second = (infinity.drive(mpc, SimulatedCar(car), steps=3) for _ in range(2))
    close(first.x, second.x, 0)
    assert car.systime == 4


def test_the_clock_runs_while_the_car_drives():
    seen, car = [], pp.DubinsCar().reset(2)

    def controller(dt, x, target):
        seen.append(int(car.systime))
        return pursue(dt, x, target)

    infinity.drive(controller, SimulatedCar(car), steps=3)
    assert seen == [2, 3, 4]


@pytest.mark.parametrize(
    "change, words",
    [
        ({"steps": 0}, "steps: expected at least one, got 0"),
        ({"x_init": (3,)}, r"x_init: expected \(..., n=4\), got \(3,\)"),
        ({"x_init": (4,), "spoil": float("nan")}, "x_init: expected finite numbers, got nan"),
    ],
    ids=str,
)
def test_bad_arguments_are_named(change, words):
    change = dict(change)
    if "x_init" in change:
        change["x_init"] = torch.ones(change["x_init"]) * change.pop("spoil", 1.0)
    with pytest.raises(ValueError, match=words):
        start = {"x_init": change.pop("x_init")} if "x_init" in change else {}
        infinity.drive(pursue, SimulatedCar(**start), **change)


def test_the_controller_has_the_books_weights():
    mpc = infinity.controller(T=7)
    close(mpc.Q, torch.diag(torch.tensor([1, 1, 0.3, 0.3, 0.01, 0.01])), 0)
    assert mpc.T == 7 and mpc.p is None and isinstance(mpc.system, pp.DubinsCar)
    assert infinity.controller(dtype=torch.float32).Q.dtype == torch.float32
