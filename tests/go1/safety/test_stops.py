"""A walk is stopped when a rule is broken, and stays stopped until it may go on."""

import math
from dataclasses import replace

import pytest
from go1_helpers import FIT, STANDS, STILL, WALK, heard, packet

from pypose_lite.go1.safety.limits import Mode
from pypose_lite.go1.safety.pilot import SETTLING, Pilot, RobotStopped, RobotTimeout
from pypose_lite.go1.wire.protocol import BmsState, HighCmd, HighState, Imu, encode_state
from pypose_lite.go1.wire.remote import encode_remote

STATES = {
    "jump": packet(x=0.9, y=0.97),
    "lean": encode_state(
        HighState(position=(0.0, 0.97, 0.28), imu=Imu(rpy=(1.5, 0.0, 0.0)), **FIT)
    ),
    "posture": packet(y=0.97, mode=Mode.DAMP),
    "battery": packet(y=0.97, bms=BmsState(soc=10)),
    "remote": packet(y=0.97, wireless_remote=encode_remote("A")),
    "area": packet(y=1.02),
}
WHY = {
    "jump": "the pose jumped",
    "lean": "it leans",
    "posture": "its mode is 7",
    "battery": "10 %",
    "remote": "the remote's A is pressed",
    "area": "it left the area",
}


def fenced(**options):
    """A pilot whose robot stands at the edge of its area and was told to walk."""
    pilot = Pilot(area=(-1.0, 1.0, -1.0, 1.0), **options)
    pilot.hear(packet(y=0.95), 0.9)
    pilot.hear(packet(y=0.96), 1.0)
    pilot.reset_origin((0.0, 0.96, 0.0), 1.0)
    pilot.ask(WALK, 1.0)
    assert pilot.command(1.0) == WALK
    return pilot


@pytest.mark.parametrize("rule", STATES)
def test_a_rule_that_is_broken_stops_the_robot_until_it_may_go_on(rule):
    pilot = fenced()
    pilot.hear(STATES[rule], 1.02)
    assert WHY[rule] in pilot.stopped and WHY[rule] in pilot.events[-1][1]
    assert pilot.command(1.03) == STILL
    with pytest.raises(RobotStopped, match=WHY[rule]):
        pilot.ask(WALK, 1.03)
    assert pilot.hear(packet(y=0.9), 1.04)  # all is well again: it stays stopped
    with pytest.raises(RobotStopped, match=WHY[rule]):
        pilot.ask(WALK, 1.05)
    pilot.go_on()
    assert pilot.command(1.05) == STILL  # what was asked before is void
    pilot.ask(WALK, 1.06)
    assert pilot.command(1.06) == WALK


@pytest.mark.parametrize("rule", STATES)
def test_a_rule_can_be_done_without_by_its_name(rule):
    pilot = fenced(ignore={rule})
    pilot.hear(STATES[rule], 1.02)
    assert pilot.stopped is None and pilot.command(1.03) == WALK


def test_an_unknown_rule_is_named():
    with pytest.raises(ValueError, match=r"ignore: expected some of .*, got \['batery'\]"):
        Pilot(ignore={"batery"})


@pytest.mark.parametrize("rule", [name for name in STATES if name not in ("jump", "area")])
def test_a_walk_does_not_begin_where_it_would_be_stopped(rule):
    pilot = Pilot()
    pilot.hear(STATES[rule], 1.0)
    with pytest.raises(RobotStopped, match=WHY[rule]):
        pilot.ask(WALK, 1.0)
    assert pilot.command(1.0) == HighCmd()
    assert pilot.ask(STANDS, 1.0) == STANDS  # what does not move it may be asked for


def test_a_robot_that_does_not_move_is_stopped_and_the_flag_is_named_first():
    pilot = Pilot()
    for tick in range(150):
        now = tick / 50
        pilot.hear(packet(x=1e-5 * tick, sn=(4 | 2 << 8, 0)), now)
        if pilot.stopped:
            break
        pilot.ask(WALK, now)
        pilot.command(now)
    assert 1.5 < now < 2.1
    assert "this is a Go1 Pro, which takes level_flag=0x00" in pilot.stopped


def test_a_jump_is_never_served_and_the_pose_goes_on_from_where_it_was():
    pilot = heard(1.0)
    before = pilot.pose(1.0)
    for tick in range(10):
        assert not pilot.hear(packet(x=50.0 + 0.01 * tick), 1.02 + tick / 50)
        assert pilot.pose(1.02 + tick / 50) == before
    assert pilot.refusals["the pose jumped"] == 10
    with pytest.raises(RobotTimeout, match="the pose jumped by"):
        pilot.pose(1.5)
    pilot.go_on()
    assert pilot.hear(packet(x=50.2), 1.5)
    assert pilot.pose(1.5) == pytest.approx(before, abs=1e-9)
    assert pilot.hear(packet(x=50.3), 1.6)
    assert math.dist(pilot.pose(1.6)[:2], before[:2]) == pytest.approx(0.1, abs=1e-5)


def test_a_replayed_loop_of_twenty_seconds_grows_old():
    pilot, loop = Pilot(), [packet(x=0.001 * tick) for tick in range(1000)]
    for tick in range(1000):
        assert pilot.hear(loop[tick], tick / 50)
    assert not any(pilot.hear(loop[tick], 20.0 + tick / 50) for tick in range(1000))


def test_zero_velocity_at_the_end_of_a_walk_becomes_a_stand_and_a_walk_can_follow():
    pilot = heard(1.0)
    pilot.ask(WALK, 1.0)
    assert pilot.command(1.0) == WALK
    pilot.halt()
    assert pilot.command(1.1) == STILL and pilot.command(1.1 + SETTLING - 0.01) == STILL
    assert pilot.command(1.1 + SETTLING) == STANDS and pilot.command(9.0) == STANDS
    heard(9.1, 8.9, pilot)
    pilot.ask(WALK, 9.1)
    assert pilot.command(9.1) == WALK
    pilot.halt()
    assert pilot.command(9.2) == STILL  # and again half a second of zeros first


def test_a_stand_keeps_the_level_flag():
    pilot = heard(1.0, level_flag=0)
    pilot.ask(WALK, 1.0)
    pilot.halt()
    pilot.command(1.0)
    assert pilot.command(2.0) == HighCmd(level_flag=0, mode=Mode.STAND)


def test_a_trim_is_added_to_motions_alone_and_clamped_with_them():
    pilot = heard(1.0, trim=(0.01, -0.02, 0.03))
    sent = pilot.ask(WALK, 1.0)
    assert (*sent.velocity, sent.yaw_speed) == pytest.approx((0.31, -0.02, 0.53))
    assert pilot.ask(STILL, 1.0) == STILL
    assert pilot.ask(replace(WALK, velocity=(1.5, 0.0)), 1.0).velocity[0] == 1.5


def test_the_origin_can_be_said_anew():
    pilot = heard(2.0)
    pilot.reset_origin((1.0, -1.0, 0.5), 2.0)
    assert pilot.pose(2.0) == pytest.approx((1.0, -1.0, 0.5))


def test_refusals_are_counted_by_their_reason():
    pilot = Pilot()
    for data in (bytes(1044), bytes(1044), packet()[:-1] + b"!", packet(x=math.nan)):
        assert not pilot.hear(data, 0.0)
    assert pilot.refused == 4 and [count for _, count in pilot.refusals.most_common()] == [2, 1, 1]
    assert any("expected 1087 bytes, got 1044" in reason for reason in pilot.refusals)
