"""Velocities from another program: what is obeyed, what is refused, and what silence means."""

import io
import json
import math
import socket
import time

import pytest
from go1_helpers import velocity

from pypose_lite import go1
from pypose_lite.go1.program.velocities import Source, obey
from pypose_lite.go1.wire.remote import encode_remote


@pytest.mark.parametrize(
    ("line", "motion"),
    [
        ('{"v": 0.2, "yaw_rate": 0.1, "left": -0.05}', (0.2, -0.05, 0.1)),
        ('{"v": 1}', (1.0, 0.0, 0.0)),
        ('  {"yaw_rate": -0.5}\n', (0.0, 0.0, -0.5)),
    ],
)
def test_a_line_is_a_motion_for_as_long_as_a_command_lasts(watch, line, motion):
    seen = watch()
    obey(seen.robot, line)
    seen.robot.wait(0.1)
    assert velocity(seen.sent[-1][1]) == pytest.approx(motion)
    seen.robot.wait(0.4)
    assert velocity(seen.sent[-1][1]) == (0.0, 0.0, 0.0)


@pytest.mark.parametrize(
    "line",
    [
        "",
        "0.2",
        "[0.2, 0.1]",
        "{}",
        '{"v": "fast"}',
        '{"v": true}',
        '{"v": null}',
        '{"v": NaN}',
        '{"v": 1e999}',
        '{"speed": 0.2}',
        '{"v": 0.2, "stop": 1}',
        "{" * 5000,
        '{"v": 0.' + "1" * 2000 + "}",
    ],
)
def test_a_line_that_is_none_is_refused_and_moves_nothing(watch, line):
    seen = watch()
    with pytest.raises(ValueError, match="expected"):
        obey(seen.robot, line)
    seen.robot.wait(0.1)
    assert velocity(seen.sent[-1][1]) == (0.0, 0.0, 0.0)


def test_the_same_rules_hold_as_for_any_other_program(watch):
    seen = watch(speed_limit=0.3, area=(-0.1, 0.1, -1.0, 1.0))
    obey(seen.robot, '{"v": 0.6, "yaw_rate": 0.4}')
    seen.robot.wait(0.05)
    assert velocity(seen.sent[-1][1]) == pytest.approx((0.3, 0.0, 0.2))
    with pytest.raises(go1.RobotStopped, match="left the area"):
        for _ in range(20):
            obey(seen.robot, '{"v": 0.3}')
            seen.robot.wait(0.1)


def test_it_stops_and_goes_on_when_it_is_told(watch):
    seen = watch()
    obey(seen.robot, '{"v": 0.3}')
    obey(seen.robot, '{"stop": true}')
    seen.robot.wait(0.05)
    assert velocity(seen.sent[-1][1]) == (0.0, 0.0, 0.0)
    seen.robot.simulator.dog.remote = encode_remote("A")
    seen.robot.wait(0.1)
    with pytest.raises(go1.RobotStopped):
        obey(seen.robot, '{"v": 0.3}')
    seen.robot.simulator.dog.remote = bytes(40)
    seen.robot.wait(0.1)
    obey(seen.robot, '{"go_on": false, "v": 0.0}')
    with pytest.raises(go1.RobotStopped):
        obey(seen.robot, '{"v": 0.3}')
    obey(seen.robot, '{"go_on": true}')
    seen.robot.wait(0.1)
    obey(seen.robot, '{"v": 0.3}')


def test_standard_input_gives_its_lines_and_then_it_is_over():
    source = Source("-", io.StringIO('{"v": 0.1}\n\n{"v": 0.2}\n'))
    lines = [source.next(1.0) for _ in range(3)]
    assert [json.loads(line)["v"] for line in lines[:2]] == [0.1, 0.2]
    assert lines[2] is None and source.over


def test_a_writer_that_is_too_fast_loses_its_oldest_lines():
    source = Source("-", io.StringIO("".join(f"{n}\n" for n in range(1000))))
    time.sleep(0.5)
    first = int(source.next(1.0))
    assert first >= 900
    rest = [source.next(1.0) for _ in range(999 - first)]
    assert int(rest[-1]) == 999


def test_a_port_hears_this_computer_alone():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    source = Source(str(port))
    try:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as mouth:
            mouth.sendto(b'{"v": 0.1}\n{"v": 0.2}', ("127.0.0.1", port))
            mouth.sendto(b"\xff\xfe", ("127.0.0.1", port))
        lines = [source.next(1.0) for _ in range(3)]
        assert lines[:2] == ['{"v": 0.1}', '{"v": 0.2}'] and not source.over
        assert source.next(0.01) is None and not source.over
    finally:
        source.close()
    assert math.isfinite(port)
