import math
from dataclasses import fields, replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pypose_lite.go1.safety.limits import SPEEDS, Gait, Mode, slower, still, vet
from pypose_lite.go1.wire.protocol import BmsCmd, HighCmd

WALK = HighCmd(mode=Mode.WALK, gait_type=Gait.TROT)
LIMITS = {  # the specification's table
    1: ((-1.1, 1.5), (-1.0, 1.0), (-4.0, 4.0)),
    2: ((-2.5, 3.5), (-1.0, 1.0), (-4.0, 4.0)),
    3: ((-0.2, 0.25), (-0.15, 0.15), (-0.7, 0.7)),
}
any_float = st.floats(allow_nan=False, allow_infinity=False)


@given(st.sampled_from(sorted(LIMITS)), any_float, any_float, any_float)
def test_speeds_are_clamped_to_the_limits_of_the_gait_and_reported(gait, forward, left, turn):
    asked = replace(WALK, gait_type=gait, velocity=(forward, left), yaw_speed=turn)
    sent, notes = vet(asked)
    values = zip((forward, left, turn), (*sent.velocity, sent.yaw_speed), LIMITS[gait])
    changed = 0
    for value, held, (low, high) in values:
        assert held == min(max(value, low), high)
        changed += held != value
    assert len(notes) == changed


@pytest.mark.parametrize("mode", [3, 4, 9, 10, 11, 12, 13, 14, 255, -1])
def test_reserved_modes_and_stunts_are_refused(mode):
    with pytest.raises(ValueError, match=f"mode: expected one of .*, got {mode}"):
        vet(HighCmd(mode=mode))


@pytest.mark.parametrize("gait", [4, 5, 255])
def test_gaits_without_documented_limits_are_refused(gait):
    with pytest.raises(ValueError, match="gait_type"):
        vet(replace(WALK, gait_type=gait))


@pytest.mark.parametrize("off", [0xA5, 1, 255])
def test_the_batterys_off_switch_cannot_be_sent(off):
    with pytest.raises(ValueError, match="bms: reserved"):
        vet(HighCmd(bms=BmsCmd(off=off)))


@pytest.mark.parametrize(
    "name",
    [
        f.name
        for f in fields(HighCmd)
        if f.name
        not in (
            *("level_flag", "mode", "gait_type", "velocity", "yaw_speed", "euler"),
            *("body_height", "foot_raise_height", "bms"),
        )
    ],
)
def test_every_reserved_field_must_stay_as_it_is(name):
    value = getattr(HighCmd(), name)
    other = {bytes: b"x", int: 1, float: 1.0}.get(type(value), (1,))
    with pytest.raises(ValueError, match=f"{name}: reserved"):
        vet(replace(HighCmd(), **{name: other}))


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize(
    "place",
    [
        lambda bad: {"velocity": (bad, 0.0)},
        lambda bad: {"velocity": (0.0, bad)},
        lambda bad: {"yaw_speed": bad},
        lambda bad: {"euler": (0.0, 0.0, bad)},
        lambda bad: {"body_height": bad},
        lambda bad: {"foot_raise_height": bad},
    ],
)
def test_nan_and_infinity_are_refused(place, bad):
    with pytest.raises(ValueError, match="expected finite numbers"):
        vet(replace(WALK, **place(bad)))


@pytest.mark.parametrize(
    ("change", "held"),
    [
        ({"euler": (1.0, -1.0, 1.0)}, {"euler": (0.75, -0.75, 0.6)}),
        ({"body_height": -1.0}, {"body_height": -0.13}),
        ({"body_height": 1.0}, {"body_height": 0.03}),
        ({"foot_raise_height": -1.0}, {"foot_raise_height": -0.06}),
        ({"foot_raise_height": 1.0}, {"foot_raise_height": 0.03}),
    ],
)
def test_a_posture_is_clamped_and_the_note_says_how(change, held):
    sent, notes = vet(replace(HighCmd(mode=Mode.STAND), **change))
    (name,) = held
    assert getattr(sent, name) == held[name]
    assert notes and all(note.startswith(name) and "clamped to" in note for note in notes)


def test_a_command_inside_the_limits_passes_unchanged_and_without_a_note():
    asked = replace(WALK, velocity=(1.5, -1.0), yaw_speed=4.0)
    assert vet(asked) == (asked, [])


def test_without_a_gait_there_is_no_walking():
    sent, notes = vet(HighCmd(mode=Mode.WALK, gait_type=Gait.IDLE, velocity=(0.3, 0.0)))
    assert sent.velocity == (0.0, 0.0) and len(notes) == 1


@given(*[st.floats(-1.0, 1.0)] * 3, st.floats(0.05, 2.0))
def test_a_speed_limit_keeps_the_arc(forward, left, turn, limit):
    asked = replace(WALK, velocity=(forward, left), yaw_speed=turn)
    sent = slower(asked, limit)
    speed, asked_speed = math.hypot(*sent.velocity), math.hypot(forward, left)
    assert speed == pytest.approx(min(asked_speed, limit))
    # the curvature is turn over speed; crosswise, so that zero speed needs no case of its own
    assert sent.yaw_speed * asked_speed == pytest.approx(turn * speed)
    assert sent.velocity[0] * asked_speed == pytest.approx(forward * speed)


@pytest.mark.parametrize("mode", Mode)
def test_still_has_the_same_mode_and_no_velocity(mode):
    asked = replace(WALK, mode=mode, velocity=(0.3, 0.1), yaw_speed=0.2)
    assert still(asked) == replace(WALK, mode=mode)


def test_the_table_of_limits_is_the_specifications():
    assert {int(gait): limits for gait, limits in SPEEDS.items() if gait} == LIMITS
