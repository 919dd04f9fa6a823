import pytest
import torch
from go1_helpers import velocity

from pypose_lite import go1, infinity
from pypose_lite.go1 import Response
from pypose_lite.go1.walk import AREA, LENGTH, LONGEST, START, STEP, Guide, Stuck, draw, walk
from pypose_lite.systems import Legs


@pytest.mark.parametrize(
    ("faults", "delay"),
    [({"loss": 0.05, "delay": 0.05}, 0.1), ({"loss": 0.3, "delay": 0.2}, 0.4)],
    ids=["5 % loss and 50 ms", "30 % loss and 200 ms"],
)
def test_the_dog_visits_all_waypoints_over_a_bad_line_at_the_speed_that_was_said(
    watch, faults, delay
):
    seen = watch(seed=1, start=START, area=AREA, speed_limit=0.4, **faults)
    begun = seen.now()
    run = walk(seen.robot, 0.4, delay)
    assert bool(run.finished)
    assert infinity.tracking_error(run.x).mean() < 0.01
    near = torch.cdist(run.x[:, :2], infinity.waypoints()[:, :2]).amin(0)
    assert near.max() < infinity.TOLERANCE
    assert seen.now() - begun == pytest.approx(LENGTH / 0.4, rel=0.1)
    forward, left, turn = torch.tensor([velocity(c) for _, c in seen.told]).unbind(-1)
    assert forward.min() >= 0 and forward.max() <= 0.4 + 1e-6
    assert turn.abs().max() <= 1.2 + 1e-6 and left.abs().max() == 0
    assert seen.robot.events == []  # nothing was clamped, nothing was stopped
    # what was told was asked: nothing is made up on the way
    asked = {tuple(round(n, 5) for n in velocity(command)) for _, command in seen.sent}
    told = {tuple(round(n, 5) for n in velocity(command)) for _, command in seen.told}
    assert told <= asked | {(0.0, 0.0, 0.0)}


def test_the_length_of_the_infinity_is_the_examples():
    assert LENGTH == infinity.LENGTH
    curve = infinity.reference(torch.linspace(0, LENGTH, 1000))
    assert AREA[0] <= curve[:, 0].min() - 0.7 and AREA[1] >= curve[:, 0].max() + 0.7
    assert AREA[2] <= curve[:, 1].min() - 0.7 and AREA[3] >= curve[:, 1].max() + 0.7


def test_a_planner_that_knows_no_way_on_is_not_left_standing_for_ever(watch):
    """Every plan is to rest: after three seconds of that it is said."""
    robot = watch(start=START).robot
    guide = Guide(robot, 0.4, Response(), lambda waypoint: None)
    rest = torch.zeros(11, 6), torch.zeros(10, 2), torch.tensor(0.0)
    guide._mpc.forward = lambda *arguments, **bounds: rest
    x, target = infinity.waypoints()[0], guide.aim(infinity.waypoints()[0], torch.tensor(1))
    for _ in range(round(LONGEST / STEP)):
        guide(STEP, x, target)
    with pytest.raises(Stuck, match="Walk slower"):
        guide(STEP, x, target)


def test_the_plan_begins_where_the_robot_will_be(watch):
    """The state that the planner starts from, against the legs' model applied by hand."""
    robot = watch(start=START).robot
    response = Response(0.2, (0.3, 0.3))
    guide, legs = Guide(robot, 0.4, response, lambda waypoint: None), Legs(STEP, lag=0.3)
    x = infinity.waypoints()[0]
    sent = []
    for _ in range(4):
        with torch.no_grad():
            target = guide.aim(x, torch.tensor(1))
            sent.append(guide(STEP, x, target)[1][0])
        robot.wait(STEP)
    state = robot.state
    guide.aim(x, torch.tensor(1))
    expected = torch.cat([x, torch.tensor([state.velocity[0], state.yaw_speed])])
    for u in sent[-2:]:
        expected = legs(expected, u)[0]
    assert torch.allclose(guide._from, expected, atol=1e-6)


def test_a_body_that_slides_in_turns_looks_aside_so_that_it_moves_along_the_curve(watch):
    """On a circle of 1 m its velocity, by the model, has the direction of the tangent."""
    response = Response(axle=0.2)
    guide = Guide(watch(start=START).robot, 0.4, response, lambda waypoint: None)
    tangents = infinity.reference(0.3 + torch.arange(10.0) * 0.04)
    looks = guide._looking(tangents)
    assert torch.equal(looks[:, :2], tangents[:, :2])
    for look, tangent in zip(looks, tangents):
        state = torch.cat([look, torch.tensor([0.4, 0.4])])  # at 0.4 m/s it turns by 0.4 rad/s
        before = torch.cat([look[:2], *rotated(look[2:], -0.04), state[4:]])
        moved = (response.model(STEP)(before, state[4:])[0] - before)[:2]
        assert torch.allclose(moved / moved.norm(), tangent[2:], atol=2e-3)


def rotated(way, angle):
    c, s = torch.tensor(angle).cos(), torch.tensor(angle).sin()
    return [(way[0] * c - way[1] * s)[None], (way[0] * s + way[1] * c)[None]]


def test_a_speed_in_the_dead_band_is_refused(watch):
    with pytest.raises(ValueError, match=r"more than the dead band, 0\.2 m/s, got 0\.15"):
        walk(watch(start=START).robot, 0.15, response=Response(dead_band=(0.2, 0.0)))


def test_the_log_knows_which_waypoint_was_aimed_at(tmp_path):
    log = tmp_path / "run.csv"
    with go1.connect("sim", start=START, log=log) as robot:
        walk(robot, 0.8)
    targets = [row.target for row in go1.read_log(log)]
    assert targets == sorted(targets) and set(targets) == set(range(17))


@pytest.mark.parametrize(
    ("mishap", "why"),
    [
        ({"numbers": go1.Numbers(scale=0.0)}, "forward: asked for"),
        ({"leaning": (0.0, 1.5)}, "it leans"),
        ({"_odometry": (40.0, 40.0, 0.0)}, "the pose jumped"),
    ],
    ids=["its position stays", "it falls", "its odometry restarts"],
)
def test_a_walk_is_stopped_when_the_robot_does_something_else(watch, mishap, why):
    seen = watch(start=START, area=AREA)
    stopped = []

    def befall(waypoint):
        if waypoint == 2 and not stopped:
            for name, value in mishap.items():
                setattr(seen.robot.simulator.dog, name, value)
            stopped.append(seen.now())

    with pytest.raises(go1.RobotStopped, match=why):
        walk(seen.robot, report=befall)
    assert seen.now() - stopped[0] < 2.0
    seen.robot.wait(0.1)
    assert velocity(seen.sent[-1][1]) == (0.0, 0.0, 0.0)


def test_a_robot_without_an_area_is_kept_in_the_infinitys_for_the_walk(watch):
    seen = watch(start=START, ignore={"motion"})
    seen.robot.simulator.dog.numbers = go1.Numbers(scale=8.0)  # it believes that it is far away

    with pytest.raises(go1.RobotStopped, match="it left the area"):
        walk(seen.robot)
    assert seen.robot.pilot.watcher.area is None


@pytest.mark.parametrize(
    ("numbers", "reason"),
    [
        (go1.Numbers(charge=19.5), "the battery is at 19 %, below 20 %"),
        (go1.Numbers(height=0.12), "the body is 0.12 m above the ground: it lies"),
    ],
)
def test_a_robot_that_should_not_walk_says_why(watch, numbers, reason):
    assert watch(numbers=numbers).robot.reasons_to_stay() == [reason]


def test_a_robot_whose_state_is_old_should_not_walk(watch):
    seen = watch(freeze=1.0)
    seen.robot.wait(1.2)
    assert [reason.split(" s old")[0][:16] for reason in seen.robot.reasons_to_stay()] == [
        "its state is 0.2"
    ]


def test_a_picture_shows_poses_and_targets(tmp_path):
    path = tmp_path / "run.png"
    with go1.connect("sim", log=tmp_path / "run.csv") as robot:
        robot.wait(0.5)
    draw(go1.read_log(tmp_path / "run.csv"), path)
    assert path.read_bytes().startswith(b"\x89PNG")
