import math
import os
import signal
import subprocess
import sys
from dataclasses import replace

import pytest

from pypose_lite import go1
from pypose_lite.go1.wire.protocol import HighCmd, encode_command

PROGRAM = [sys.executable, "-W", "error", "-m", "pypose_lite.go1.simulator", "--port", "0"]


@pytest.mark.wall_clock
def test_the_simulator_is_a_program_of_its_own_that_ctrl_c_ends_quietly():
    with subprocess.Popen(
        [*PROGRAM, "--loss", "0.1", "--delay", "0.02", "--garbage", "0.2", "--vanish", "2.5"],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    ) as program:
        try:
            address = program.stdout.readline().split()[-1]
            with go1.connect(address) as robot:
                for _ in range(10):
                    robot.move(0.4, 0.3)
                    robot.wait(0.1)
                assert robot.pose()[0] > 0.1 and robot.pilot.refused > 10
                with pytest.raises(go1.RobotTimeout):
                    for _ in range(40):
                        robot.move(0.4, 0.3)
                        robot.wait(0.1)
            os.kill(program.pid, signal.SIGINT)
            assert program.wait(5.0) == 0 and program.stderr.read() == ""
        finally:
            program.kill()


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--loss", "2"], "loss: expected a share"),
        (["--host", "256.0.0.1"], "cannot listen there"),
        (["--model", "air"], "invalid choice: 'air'"),
    ],
)
def test_options_that_do_not_fit_are_told_in_one_line(options, message, capsys):
    from pypose_lite.go1.simulator.__main__ import main

    with pytest.raises(SystemExit) as ended:
        main(["--port", "0", *options])
    assert ended.value.code == 2
    assert message in capsys.readouterr().err.splitlines()[-1]


def test_a_packet_that_no_body_can_follow_is_a_line_and_not_the_end(monkeypatch, capsys):
    """The program's own loop, for three packets and then Ctrl-C."""
    from pypose_lite.go1.simulator import __main__ as program

    walk = HighCmd(mode=2, gait_type=1)
    packets = [replace(walk, yaw_speed=math.inf), replace(walk, euler=(math.nan, 0.0, 0.0)), walk]
    waiting, answers = [encode_command(packet) for packet in packets], []

    class Server:
        port = 8082

        def __init__(self, *arguments):
            pass

        def receive(self, timeout):
            if not waiting and timeout > 0.0:
                raise KeyboardInterrupt
            return waiting.pop(0) if waiting else None

        def send(self, data):
            answers.append(data)

        def close(self):
            answers.append("closed")

    monkeypatch.setattr(program, "UdpServer", Server)
    program.main([])
    said = capsys.readouterr().out.splitlines()
    assert said[1:] == [
        "refused: yaw_speed is not finite, or greater than 100",
        "refused: euler is not finite, or greater than 100",
    ]
    assert len(answers) == 4 and answers[-1] == "closed"
