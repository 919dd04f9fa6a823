import math
from dataclasses import replace

import pytest
from go1_helpers import STANDS, STILL, WALK, heard, packet, walked

from pypose_lite.go1.safety.limits import Mode
from pypose_lite.go1.safety.pilot import SETTLING, Pilot, RobotTimeout
from pypose_lite.go1.wire.protocol import HighCmd


def test_a_command_goes_out_until_it_expires_and_then_zero():
    pilot = heard(2.0, timeout=0.4, margin=0.01)
    pilot.ask(WALK, 2.0)
    heard(3.0, 2.02, pilot)
    assert pilot.command(2.389) == WALK
    assert pilot.command(2.391) == STILL
    assert pilot.command(2.88) == STILL
    assert pilot.command(2.9) == STANDS
    assert [text for _, text in pilot.events] == ["no command came in time: zero velocity goes out"]


def test_a_renewed_command_goes_on():
    pilot = heard(1.0)
    for tick in range(20):
        now = 1.0 + 0.3 * tick
        heard(now + 0.3, now + 0.02, pilot)
        pilot.ask(WALK, now + 0.3)
        assert pilot.command(now + 0.31) == WALK
        assert pilot.command(now + 0.59) == WALK


def test_a_stale_state_raises_and_zero_goes_out():
    pilot = heard(1.0, timeout=0.4, margin=0.01)
    pilot.ask(WALK, 1.0)
    pilot.ask(WALK, 1.38)
    assert pilot.command(1.385) == WALK  # the last news is of 1.0
    assert pilot.command(1.391) == STILL
    for call in (pilot.state, pilot.pose, lambda now: pilot.ask(WALK, now)):
        with pytest.raises(RobotTimeout, match="no new state from the robot for 0.41 s"):
            call(1.41)


def test_a_command_from_before_the_silence_is_not_taken_up_again():
    pilot = heard(1.0)
    pilot.ask(WALK, 1.3)
    assert pilot.command(1.45) == STILL
    pilot.hear(packet(x=0.5), 1.5)
    assert pilot.state(1.51).position[0] == 0.5
    assert pilot.command(1.51) == STILL  # 0.21 s old, but the silence has come between
    pilot.ask(WALK, 1.52)
    assert pilot.command(1.53) == WALK


def test_nothing_is_asked_of_a_robot_that_has_never_spoken():
    with pytest.raises(RobotTimeout, match="no state has come"):
        Pilot().ask(WALK, 0.0)
    assert Pilot().command(0.0) == HighCmd()


def test_a_state_that_comes_again_and_again_grows_old():
    pilot = Pilot()
    assert pilot.hear(packet(x=1.0), 0.0)
    assert not any(pilot.hear(packet(x=1.0), 0.01 * tick) for tick in range(40))
    with pytest.raises(RobotTimeout):
        pilot.state(0.4)


def test_an_old_content_that_arrives_late_does_not_bring_the_robot_back():
    pilot = heard(0.2)
    assert not pilot.hear(walked(0.1), 0.21)
    assert pilot.pose(0.21)[0] == pytest.approx(0.6 * math.sin(0.1), abs=1e-6)


@pytest.mark.parametrize("bad", [math.nan, math.inf])
@pytest.mark.parametrize("name", ["position", "velocity", "yaw_speed", "rpy"])
def test_a_state_without_finite_numbers_is_not_good(name, bad):
    fields = {"position": {"x": bad}, "rpy": {"heading": bad}, "yaw_speed": {"yaw_speed": bad}}
    fields["velocity"] = {"velocity": (bad, 0.0, 0.0)}
    pilot = heard(0.1)
    assert not pilot.hear(packet(**fields[name]), 0.11)
    assert pilot.refused == 1 and pilot.pose(0.12)[0] == pytest.approx(0.03, abs=1e-4)


def test_the_third_velocity_is_ambiguous_but_must_be_a_number():
    assert Pilot().hear(packet(velocity=(0.0, 0.0, 99.0)), 0.0)


@pytest.mark.parametrize("heading", [0.0, 1.0, 3.0, -3.1])
def test_the_pose_is_seen_from_where_the_robot_stood_first(heading):
    pilot = Pilot()
    pilot.hear(packet(5.0, -3.0, heading), 0.0)
    assert pilot.pose(0.0) == pytest.approx((0.0, 0.0, 0.0), abs=1e-6)
    ahead, left = 2.0, 0.5  # a rotation matrix as the oracle
    x = 5.0 + ahead * math.cos(heading) - left * math.sin(heading)
    y = -3.0 + ahead * math.sin(heading) + left * math.cos(heading)
    pilot.hear(packet(x, y, math.remainder(heading + 0.4, 2 * math.pi)), 1.0)
    assert pilot.pose(1.0) == pytest.approx((2.0, 0.5, 0.4), abs=1e-5)


def test_the_pose_can_be_counted_from_a_start_of_ones_own():
    plain, placed = Pilot(), Pilot(start=(1.0, 2.0, -math.pi / 2))
    for pilot in (plain, placed):
        pilot.hear(packet(5.0, -3.0, 0.7), 0.0)
        pilot.hear(packet(5.5, -2.0, 1.9), 1.0)
    x, y, heading = plain.pose(1.0)
    # ahead of who looks down the page is down, and to the left is right
    assert placed.pose(1.0) == pytest.approx((1.0 + y, 2.0 - x, heading - math.pi / 2))


def test_a_clamped_command_is_told_once_for_a_row_of_them():
    pilot = heard(1.0)
    for _ in range(5):
        assert pilot.ask(replace(WALK, velocity=(9.0, 0.0)), 1.0).velocity == (1.5, 0.0)
    pilot.ask(WALK, 1.0)
    pilot.ask(replace(WALK, yaw_speed=-9.0), 1.0)
    texts = [text for _, text in pilot.events]
    assert texts == ["velocity[0]: 9 clamped to 1.5", "yaw_speed: -9 clamped to -4"]


def test_a_speed_limit_is_told_too():
    pilot = heard(1.0, speed_limit=0.15)
    sent = pilot.ask(WALK, 1.0)
    assert sent.velocity[0] == pytest.approx(0.15) and sent.yaw_speed == pytest.approx(0.25)
    assert [text for _, text in pilot.events] == ["speed: held to the limit of 0.15 m/s"]


@pytest.mark.parametrize("mode", [Mode.LIE_DOWN, Mode.DAMP])
def test_who_lies_has_to_stand_up_before_it_walks(mode):
    pilot = heard(1.0)
    pilot.ask(WALK, 1.0)
    pilot.halt(mode)
    assert pilot.command(1.0) == replace(STILL, mode=mode)
    for other in (Mode.IDLE, Mode.STAND, Mode.WALK):
        with pytest.raises(RuntimeError, match="stand_up"):
            pilot.ask(replace(WALK, mode=other), 1.0)
    assert pilot.command(1.0).mode == mode
    pilot.ask(HighCmd(mode=Mode.STAND_UP), 1.0)
    pilot.ask(WALK, 1.0)
    assert pilot.command(1.0) == WALK


@pytest.mark.parametrize("mode", [None, Mode.DAMP])
def test_halting_works_when_the_robot_is_silent(mode):
    pilot = heard(1.0)
    pilot.ask(WALK, 1.0)
    pilot.halt(mode)
    assert pilot.command(60.0) == (STILL if mode is None else replace(STILL, mode=mode))
    settled = pilot.command(60.0 + SETTLING)
    assert settled == (STANDS if mode is None else replace(STILL, mode=mode))


def test_the_level_flag_of_the_connection_is_on_every_command():
    pilot = heard(1.0, level_flag=0x00)
    assert pilot.command(1.0).level_flag == 0
    pilot.ask(WALK, 1.0)
    assert pilot.command(1.0).level_flag == 0


def test_a_refused_command_leaves_the_last_one():
    pilot = heard(1.0)
    pilot.ask(WALK, 1.0)
    with pytest.raises(ValueError):
        pilot.ask(replace(WALK, yaw_speed=math.nan), 1.0)
    assert pilot.command(1.0) == WALK
