"""Laps of a dog with legs: the controller of a car parks, one that knows the dog comes round."""

import pytest
import torch

from pypose_lite import MPC, DubinsCar, go1, infinity, utils
from pypose_lite.go1.walk import START, walk

TOLERANCE = 0.15  # m


def on_legs(seed, **options):
    return go1.connect("sim:legs", start=START, simulation=go1.Simulation(seed=seed), **options)


def drive_as_a_car(robot, steps):
    weights = torch.diag(torch.tensor([1, 1, 0.3, 0.3, 0.01, 0.01]))
    mpc = MPC(DubinsCar(0.1), weights, None, 10, utils.ReduceToBason(steps=3))
    bounds = {"u_lower": torch.tensor([0.0, -1.2]), "u_upper": torch.tensor([0.5, 1.2])}
    world = infinity.RealRobot(robot, 0.1)
    with torch.no_grad():
        return infinity.drive(mpc, world, tolerance=TOLERANCE, steps=steps, **bounds)


def test_the_controller_of_a_car_parks_beside_the_first_waypoint():
    """It has passed it, cannot go back, and what it asks for is in the dead band."""
    with on_legs(0, ignore=["motion"]) as robot:
        run = drive_as_a_car(robot, 80)
    first = infinity.waypoints()[1]
    stands = run.x[-20:, :2]
    assert not run.finished and (run.goal[-20:] == 1).all()
    assert (stands - stands[0]).norm(dim=-1).max() < 0.05
    assert TOLERANCE < (stands[-1] - first[:2]).norm() < 0.4
    assert (run.u[-20:, 0] < 0.02).all() and (run.u[-20:, 1].abs() < 0.3).all()


def test_the_pilot_says_that_it_has_parked():
    with on_legs(0) as robot, pytest.raises(go1.RobotStopped, match="told to move for 2 s"):
        drive_as_a_car(robot, 80)


@pytest.fixture(scope="module")
def response(tmp_path_factory):
    """How another dog responds."""
    log = tmp_path_factory.mktemp("legs") / "run.csv"
    with on_legs(103, log=log) as robot:
        go1.excite(robot)
    return go1.identify(go1.read_log(log))


@pytest.mark.parametrize("seed", range(10))
def test_with_the_response_of_another_dog_a_lap_stays_near_the_curve(response, seed):
    """As the robot believes, and as the physics has it."""
    true = []
    with on_legs(seed) as robot:

        def look(waypoint):
            ahead, left, _ = robot.simulator.dog.pose
            true.append([left, -ahead])  # seen from where the walk begins

        run = walk(robot, 0.5, report=look, response=response, tolerance=TOLERANCE)
    assert bool(run.finished) and robot.events == []
    assert infinity.tracking_error(run.x).mean() < 0.04
    assert infinity.tracking_error(torch.tensor(true)).mean() < 0.06
