"""Something goes wrong while a robot walks: it is stopped, and says why."""

import re
from dataclasses import replace

import pytest
from go1_helpers import BAD_LINES, moving

from pypose_lite import go1
from pypose_lite.go1.safety.limits import Mode
from pypose_lite.go1.wire.protocol import HighCmd
from pypose_lite.go1.wire.remote import encode_remote


def fall(dog):
    dog.leaning = (1.6, 0.0)


def be_damped_by_the_remote(dog):
    dog.ask, ask = (lambda command: None), dog.ask
    ask(HighCmd(mode=Mode.DAMP))


def press_a_button(dog):
    dog.remote = encode_remote("A")


def restart_the_odometry(dog):
    dog._odometry = (0.0, 0.0, 0.0)


def empty_the_battery(dog):
    dog._charge = 5.0


def stick_the_position(dog):
    dog.numbers = replace(dog.numbers, scale=0.0)


def turn_the_sensor(dog):
    """The yaw on another axis, as of a sensor that is mounted wrongly: the heading stays."""
    state, heading = dog.state, dog._odometry[2]
    dog.state = lambda: replace(
        state(), imu=replace(state().imu, rpy=(0.0, 0.1 * dog._odometry[2], heading))
    )


def walk_out_of_the_area(dog):
    pass


MISHAPS = {
    fall: ("it leans", 0.3),
    be_damped_by_the_remote: ("its mode is 7 (DAMP), set by another program", 0.3),
    press_a_button: ("the remote's A is pressed", 0.3),
    restart_the_odometry: ("the pose jumped by", 0.3),
    empty_the_battery: ("the battery is at 4 %", 0.3),
    stick_the_position: ("forward: asked for 0.40 m/s, seen", 2.0),
    turn_the_sensor: ("turn: asked for 0.40 rad/s, seen", 2.0),
    walk_out_of_the_area: ("it left the area", 6.0),
}


@pytest.mark.parametrize("mishap", MISHAPS, ids=lambda mishap: mishap.__name__)
def test_a_walk_on_which_something_goes_wrong_is_stopped_and_says_why(watch, mishap):
    why, within = MISHAPS[mishap]
    seen = watch(seed=3, area=(-0.9, 0.9, -0.2, 3.0))
    with pytest.raises(go1.RobotStopped, match=re.escape(why)):
        for tick in range(80):
            if tick == 20:
                mishap(seen.robot.simulator.dog)
            seen.robot.move(0.4, 0.4)
            seen.robot.wait(0.1)
    assert seen.now() < 2.0 + within + 0.2
    seen.robot.wait(0.3)
    assert not any(moving(command) for time, command in seen.sent if time > seen.now() - 0.2)
    assert why in seen.robot.events[-1][1]


def test_a_robot_that_was_stopped_walks_again_when_it_may(watch):
    seen = watch()
    dog = seen.robot.simulator.dog
    seen.robot.move(0.4, 0.0)
    seen.robot.wait(0.1)
    press_a_button(dog)
    seen.robot.wait(0.1)
    dog.remote = bytes(40)
    seen.robot.wait(1.0)
    with pytest.raises(go1.RobotStopped):
        seen.robot.move(0.4, 0.0)
    before = seen.robot.pose()[0]
    seen.robot.go_on()
    for _ in range(10):
        seen.robot.move(0.4, 0.0)
        seen.robot.wait(0.1)
    assert seen.robot.pose()[0] - before > 0.2


@pytest.mark.parametrize("faults", BAD_LINES.values(), ids=BAD_LINES)
def test_no_rule_stops_a_walk_over_a_bad_line(watch, faults):
    seen = watch(seed=2, **faults)
    for tick in range(120):
        v, yaw_rate = (0.5, 0.5) if tick < 60 else (0.1 + 0.5 * (tick // 5 % 2), -0.8)
        seen.robot.move(v, yaw_rate)
        seen.robot.wait(0.1)
    assert seen.robot.pilot.stopped is None
