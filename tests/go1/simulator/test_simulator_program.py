import os
import signal
import subprocess
import sys

import pytest

from pypose_lite import go1

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
