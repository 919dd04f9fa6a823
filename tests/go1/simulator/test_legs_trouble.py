"""What can befall legs is noticed by the pilot's rules, and what is no trouble stops no walk."""

import math

import pytest

from pypose_lite import go1
from pypose_lite.go1.safety.limits import Mode
from pypose_lite.go1.simulator.floor import Floor


@pytest.fixture
def on():
    """A factory of connected dogs with legs, by their floor."""
    robots = []

    def make(seed=0, ignore=(), **floor):
        simulation = go1.Simulation(seed=seed, floor=Floor(**floor))
        robots.append(go1.connect("sim:legs", simulation=simulation, ignore=ignore))
        return robots[-1]

    yield make
    for robot in robots:
        robot.close()


def steer(robot, seconds, v=0.5, turn=0.0):
    for _ in range(round(seconds * 10)):
        robot.move(v, turn)
        robot.wait(0.1)


@pytest.mark.parametrize("seed", range(3))
def test_walks_at_changing_speeds_are_no_reason_for_an_alarm(on, seed):
    robot = on(seed)
    for v, turn in ((0.5, 0.5), (0.5, -0.5), (0.3, 0.9), (0.8, 0.0), (0.4, -0.2), (0.0, 0.6)):
        steer(robot, 2.5, v, turn)
    assert robot.pilot.stopped is None and not robot.simulator.dog.fallen


@pytest.mark.parametrize("force", [(0.0, 60.0, 0.0), (-60.0, 0.0, 0.0), (0.0, 0.0, -80.0)])
def test_a_light_push_neither_fells_it_nor_stops_the_walk(on, force):
    robot = on()
    steer(robot, 2.0, turn=0.3)
    robot.simulator.dog.physics.push(force, 0.2)
    steer(robot, 3.0, turn=0.3)
    assert robot.pilot.stopped is None and not robot.simulator.dog.fallen


def test_a_fall_on_its_side_stops_the_walk_and_it_lies_still(on):
    robot = on()
    steer(robot, 1.0)
    robot.simulator.dog.physics.push((0.0, 300.0, 0.0), 0.4)
    with pytest.raises(go1.RobotStopped, match="it leans, roll and pitch"):
        steer(robot, 3.0)
    robot.wait(2.0)
    assert robot.state.mode == Mode.DAMP and robot.state.body_height < 0.2
    assert "its mode is 7 (DAMP)" in str(robot.reasons_to_stay()) or "leans" in str(
        robot.reasons_to_stay()
    )
    lies = robot.simulator.dog.pose
    with pytest.raises(go1.RobotTimeout, match="STAND_UP: not done within 5 s"):
        robot.stand_up()
    assert math.dist(lies[:2], robot.simulator.dog.pose[:2]) < 0.02


def test_a_dog_that_topples_over_its_head_says_so_and_its_state_stays_fresh(on):
    """It looks the other way then: for one that leans that is no jump of the pose."""
    robot = on(slope=0.45)
    with pytest.raises(go1.RobotStopped):
        steer(robot, 8.0)
    for _ in range(20):
        robot.wait(0.1)
        assert robot.age < 0.1  # its state goes on to be heard
    assert robot.simulator.dog.fallen and robot.state.mode == Mode.DAMP
    assert robot.pilot.refusals["the pose jumped"] == 0


def test_a_push_that_carries_it_away_is_motion_that_nobody_asked_for(on):
    robot = on()
    steer(robot, 1.0, v=0.2, turn=0.3)
    with pytest.raises(go1.RobotStopped, match=r"left: asked for|forward: asked for|it leans"):
        for _ in range(40):
            robot.simulator.dog.physics.push((0.0, 70.0, 0.0), 0.1)
            steer(robot, 0.1, v=0.2, turn=0.3)


def test_a_wall_that_it_cannot_climb_is_a_robot_that_does_not_move(on):
    robot = on(step=0.5, distance=0.8)
    with pytest.raises(go1.RobotStopped, match=r"told to move for 2 s, it does not|asked for"):
        steer(robot, 12.0)


def test_a_low_step_is_climbed_without_an_alarm(on):
    robot = on(step=0.02, distance=0.8)
    steer(robot, 5.0, v=0.6)
    assert robot.pilot.stopped is None
    assert robot.simulator.dog.physics.place_of_trunk[2] > 0.31 and robot.pose()[0] > 1.2


def test_a_gentle_slope_is_walked_and_a_roof_is_refused(on):
    gentle, roof = on(slope=0.1), on(slope=0.65)
    steer(gentle, 4.0)
    assert gentle.pilot.stopped is None and gentle.simulator.dog.physics.place_of_trunk[2] > 0.4
    with pytest.raises(go1.RobotStopped, match="it leans|the body is"):
        steer(roof, 4.0)


def test_on_ice_the_odometry_believes_in_a_way_that_was_not_made(on):
    """No rule sees that: legs that slip look like legs that walk."""
    robot = on(friction=0.03)
    steer(robot, 4.0, v=0.6)
    believed = math.hypot(*robot.pose()[:2])
    made = math.hypot(*robot.simulator.dog.pose[:2])
    assert believed > 1.3 * made


@pytest.mark.parametrize(
    ("force", "seconds", "why"),
    [
        ((0.0, 200.0, 0.0), 0.2, "left: asked for"),
        ((-200.0, 0.0, 0.0), 0.2, "forward: asked for"),
        ((-60.0, 0.0, 0.0), 4.0, "forward: asked for"),
        ((0.0, 0.0, 170.0), 2.0, "it does not stand on the floor"),
    ],
    ids=["a kick from its right", "a kick from ahead", "held by a leash", "lifted"],
)
def test_what_befalls_it_is_seen_within_a_second(on, force, seconds, why):
    robot = on()
    steer(robot, 2.0, turn=0.3)
    befell = robot.now()
    robot.simulator.dog.physics.push(force, seconds)
    with pytest.raises(go1.RobotStopped, match=why):
        steer(robot, 4.0, turn=0.3)
    assert robot.events[-1][0] - befell < 1.0
