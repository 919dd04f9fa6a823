"""The rules by which a walk is stopped, each by itself: what they stop, and what they let pass."""

import math
from dataclasses import replace

import pytest

from pypose_lite.go1.safety import rules
from pypose_lite.go1.safety.limits import Mode
from pypose_lite.go1.safety.rules import Moment
from pypose_lite.go1.wire.protocol import BmsState, HighState, Imu
from pypose_lite.go1.wire.remote import encode_remote

GOOD = HighState(
    sn=(4 | 3 << 8, 0),
    mode=Mode.WALK,
    body_height=0.28,
    bms=BmsState(soc=80),
)


def walk(motion, seen=None, seconds=3.0, late=0.0):
    """Moments, 50 a second, of who was asked for a motion and moves by `seen`, `late` after."""
    moments, pose, dt = [], (1.0, -2.0, 3.0), 0.02
    for tick in range(round(seconds / dt)):
        moments.append(Moment(tick * dt, motion, pose))
        forward, left, turn = (seen or motion) if tick * dt >= late else (0.0, 0.0, 0.0)
        x, y, heading = pose
        c, s = math.cos(heading + turn * dt / 2), math.sin(heading + turn * dt / 2)
        heading = math.remainder(heading + turn * dt, 2 * math.pi)
        pose = x + (c * forward - s * left) * dt, y + (s * forward + c * left) * dt, heading
    return moments


@pytest.mark.parametrize(
    ("after", "seconds", "jump"),
    [
        ((0.2, 0.0, 0.0), 0.02, False),
        ((0.4, 0.0, 0.0), 0.02, True),
        ((0.0, -0.4, 0.0), 0.02, True),
        ((0.0, 0.0, 1.0), 0.02, True),
        ((0.0, 0.0, -1.0), 0.2, False),
        ((1.0, 0.0, 0.0), 0.4, False),
        ((3.0, 0.0, 0.0), 0.4, True),
    ],
)
def test_a_pose_that_no_dog_can_reach_is_a_jump(after, seconds, jump):
    assert bool(rules.jumped((0.0, 0.0, 0.0), after, seconds)) == jump


def test_a_heading_that_goes_through_pi_is_no_jump():
    assert rules.jumped((0.0, 0.0, 3.14), (0.0, 0.0, -3.14), 0.02) is None


def test_the_fastest_gait_is_no_jump_however_the_packets_come():
    for lost in range(25):
        seconds = 0.02 * (1 + lost)
        pose = 3.5 * seconds, 1.0 * seconds, 4.0 * seconds
        assert rules.jumped((0.0, 0.0, 0.0), pose, seconds) is None


@pytest.mark.parametrize(
    ("x", "y", "out"),
    [(0.0, 0.0, False), (1.1, 0.0, True), (-2.1, 0.0, True), (0.0, 3.1, True), (0.0, -4.1, True)],
)
def test_a_robot_that_leaves_its_area_is_stopped(x, y, out):
    assert bool(rules.left_area((x, y, 0.0), (-2.0, 1.0, -4.0, 3.0))) == out


def test_without_an_area_it_may_be_anywhere():
    assert rules.left_area((1e6, -1e6, 0.0), None) is None


@pytest.mark.parametrize("axis", [0, 1])
@pytest.mark.parametrize(("angle", "falls"), [(0.5, False), (0.7, True), (-0.7, True)])
def test_a_body_that_leans_is_stopped(axis, angle, falls):
    rpy = [0.0, 0.0, 3.0]
    rpy[axis] = angle
    assert bool(rules.leans(replace(GOOD, imu=Imu(rpy=tuple(rpy))))) == falls


@pytest.mark.parametrize(
    ("mode", "seconds", "stops"),
    [
        (Mode.WALK, 9.0, False),
        (Mode.IDLE, 9.0, False),  # a robot that does not move is found by its motion
        (Mode.DAMP, 0.0, True),
        (Mode.LIE_DOWN, 0.0, True),
        (Mode.STAND_UP, 0.5, False),
        (Mode.STAND_UP, 1.5, True),
        (Mode.RECOVER, 1.5, True),
        (12, 1.5, True),
    ],
)
def test_a_mode_that_is_not_walkings_is_stopped(mode, seconds, stops):
    assert bool(rules.not_walking(replace(GOOD, mode=mode), seconds)) == stops


@pytest.mark.parametrize(
    ("height", "stops"), [(0.28, False), (0.15, True), (0.5, True), (math.nan, True)]
)
def test_a_height_that_is_not_walkings_is_stopped(height, stops):
    assert bool(rules.not_walking(replace(GOOD, body_height=height), 0.0)) == stops


@pytest.mark.parametrize(("soc", "low"), [(20, False), (19, True), (0, True)])
def test_a_low_battery_is_a_reason_to_stop(soc, low):
    assert bool(rules.battery_low(replace(GOOD, bms=BmsState(soc=soc)))) == low


def test_a_battery_of_nothing_may_be_a_silent_board():
    assert "board is silent" in rules.battery_low(replace(GOOD, bms=BmsState(soc=0)))


def test_any_button_of_the_remote_is_a_reason_to_stop():
    pressed = replace(GOOD, wireless_remote=encode_remote("L2", "B"))
    assert rules.remote_used(pressed) == "the remote's L2 and B is pressed"
    assert rules.remote_used(GOOD) is None


@pytest.mark.parametrize(
    ("model", "flag", "wrong"),
    [(1, 0xEE, True), (2, 0xEE, True), (3, 0xEE, False), (2, 0x00, False), (9, 0xEE, False)],
)
def test_the_level_flag_is_compared_with_the_model(model, flag, wrong):
    state = replace(GOOD, sn=(4 | model << 8, 0))
    assert bool(rules.wrong_flag(state, flag)) == wrong
    assert rules.wrong_flag(replace(state, sn=(5 | model << 8, 0)), flag) is None


@pytest.mark.parametrize(
    "motion", [(0.5, 0.0, 0.0), (0.3, 0.2, 0.5), (-0.3, 0.0, -1.0), (0.0, 0.0, 0.8)]
)
@pytest.mark.parametrize("late", [0.0, 0.9])
def test_who_does_what_was_asked_agrees(motion, late):
    moments = walk(motion, late=late)
    for upto in range(1, len(moments)):
        assert rules.disagrees(moments[:upto]) is None
        assert rules.does_not_move(moments[:upto]) is None


@pytest.mark.parametrize(
    ("asked", "seen", "name"),
    [
        ((0.5, 0.0, 0.4), (0.0, 0.0, 0.4), "forward"),  # a position that stays
        ((0.5, 0.0, 0.4), (-0.5, 0.0, 0.4), "forward"),
        ((0.5, 0.0, 0.4), (0.0, 0.5, 0.4), "forward"),
        ((0.4, 0.0, 0.4), (0.4, 0.4, 0.4), "left"),
        ((0.4, 0.0, 0.4), (0.4, 0.0, 0.0), "turn"),  # a yaw on the wrong axis
        ((0.4, 0.0, 0.4), (0.4, 0.0, -0.4), "turn"),
        ((0.3, 0.0, 0.0), (1.2, 0.0, 0.0), "forward"),
    ],
)
def test_motion_seen_that_is_not_what_was_asked_disagrees_within_two_seconds(asked, seen, name):
    moments = walk(asked, seen)
    reason = rules.disagrees(moments[:90])
    assert reason.startswith(name) and "for a second" in reason
    assert rules.disagrees(moments[:50]) is None


@pytest.mark.parametrize("share", [0.7, 1.3])
def test_a_little_slip_and_a_side_drift_agree(share):
    forward, left, turn = 0.5, 0.0, 0.4
    seen = share * forward, left + 0.1, share * turn
    assert rules.disagrees(walk((forward, left, turn), seen)) is None


def test_a_motion_that_changes_all_the_time_agrees_with_any_of_its_values():
    moments = walk((0.0, 0.0, 0.0), (0.3, 0.0, 0.0))
    asked = [(0.6 * (tick // 25 % 2), 0.0, 0.0) for tick in range(len(moments))]
    assert rules.disagrees([m._replace(asked=a) for m, a in zip(moments, asked)]) is None


def test_states_that_are_too_few_to_tell_are_no_reason():
    moments = walk((0.5, 0.0, 0.0), (0.0, 0.0, 0.0), seconds=9.0)
    assert rules.disagrees([moments[0], moments[-1]]) is None
    assert rules.disagrees([]) is None and rules.does_not_move([]) is None


@pytest.mark.parametrize(
    ("asked", "stays"),
    [((0.1, 0.0, 0.0), True), ((0.0, 0.0, 0.15), True), ((0.02, 0.0, 0.0), False)],
)
def test_who_stays_for_two_seconds_although_told_to_move_is_found(asked, stays):
    moments = walk(asked, (0.0, 0.0, 0.0))
    assert bool(rules.does_not_move(moments)) == stays
    assert rules.does_not_move(moments[:100]) is None


def test_the_usual_cause_of_standing_still_is_named_first():
    pro = replace(GOOD, sn=(4 | 2 << 8, 0))
    assert rules.why_still(pro, 0xEE).startswith("this is a Go1 Pro, which takes level_flag=0x00")
    assert rules.why_still(GOOD, 0xEE).startswith("level_flag=0xee may not be its model's")
