"""However the program dies that drives it, a dog with legs stands within a second, unfallen."""

import math
import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest

from pypose_lite import go1
from pypose_lite.go1.safety.limits import Gait, Mode, settled, still
from pypose_lite.go1.simulator.body import STEP
from pypose_lite.go1.simulator.simulated_robot import SimulatedRobot
from pypose_lite.go1.wire.protocol import COMMAND_SIZE, HighCmd
from pypose_lite.go1.wire.transport import UdpServer

DRIVER = Path(__file__).parents[1] / "safety" / "dying_driver.py"
AT_REST = 0.02  # m, that a dog which stands may shift in half a second


@pytest.mark.parametrize("phase", range(10))
def test_in_every_phase_of_its_gait_it_comes_to_a_stand(legged, phase):
    """Zero velocity for half a second and then a stand is what goes out, whoever dies."""
    dog, walk = legged(phase), HighCmd(mode=Mode.WALK, gait_type=Gait.TROT)
    order = HighCmd(mode=2, gait_type=1, velocity=(0.3 + 0.1 * phase, 0.0), yaw_speed=0.8)
    for command, seconds in (
        (order, 1.0 + 0.05 * phase),
        (still(order), 0.5),
        (settled(walk), 0.5),
    ):
        dog.ask(command)
        for _ in range(round(seconds / STEP)):
            dog.step()
    stands = dog.pose
    for _ in range(round(0.5 / STEP)):
        dog.step()
    assert not dog.fallen and math.dist(stands[:2], dog.pose[:2]) < AT_REST
    assert 0.27 < dog.state().body_height < 0.34


class Witness(SimulatedRobot):
    """A dog with legs on UDP, in a thread."""

    def __init__(self, **setup):
        self.server = UdpServer("127.0.0.1", 0, COMMAND_SIZE, silence=5.0)
        super().__init__(self.server, go1.Simulation(body="legs", **setup))
        self.end, self.thread = threading.Event(), threading.Thread(target=self.live)

    def live(self):
        while not self.end.is_set():
            self.step(STEP)

    def __enter__(self):
        self.thread.start()
        return self

    def __exit__(self, *exception):
        self.end.set()
        self.thread.join()
        self.server.close()


DEATHS = {
    "an exception": ("raise_an_error", None),
    "the end of the program": ("leave_without_closing", None),
    "an exit": ("exit_at_once", None),
    "a crash": ("crash", None),
    "a planner that sleeps": ("sleep", None),
    "a planner that holds the interpreter": ("hold_the_interpreter", None),
    "Ctrl-C": ("keep_driving", signal.SIGINT),
    "kill -TERM": ("keep_driving", signal.SIGTERM),
    "kill -KILL": ("keep_driving", signal.SIGKILL),
    "Ctrl-Z": ("keep_driving", signal.SIGSTOP),
}
BAD_LINE = go1.Faults(loss=0.3, delay=0.2, duplicates=0.3, reordering=0.3)


@pytest.mark.wall_clock
@pytest.mark.parametrize("death", DEATHS)
def test_whatever_the_program_dies_of_it_stands_within_a_second(death):
    die_and_look(*DEATHS[death])


@pytest.mark.wall_clock
def test_it_stands_within_a_second_after_a_death_on_a_bad_line():
    """The last commands come 200 ms late, a third of them not at all."""
    die_and_look("keep_driving", signal.SIGKILL, faults=BAD_LINE, late=0.2)


@pytest.mark.wall_clock
def test_it_stands_by_its_own_watchdog_when_the_cable_is_pulled():
    die_and_look("keep_driving", None, vanish=0.8, late=0.5)


def die_and_look(way, number, late=0.0, **setup):
    with Witness(**setup) as dog, subprocess.Popen(
        [sys.executable, str(DRIVER)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
        bufsize=1,
    ) as driver:  # fmt: skip
        try:
            driver.stdin.write(f"udp://127.0.0.1:{dog.server.port} {way}\n")
            process = int(driver.stdout.readline().split()[1])
            if number is not None:
                time.sleep(0.3)
                os.kill(process, number)
            assert math.hypot(*dog.dog.pose[:2]) > 0.03  # it was on its way
            time.sleep(1.0 + late)
            stands = dog.dog.pose
            time.sleep(0.5)
            after = dog.dog.pose
        finally:
            driver.kill()
            try:
                os.kill(process, signal.SIGKILL)
            except ProcessLookupError:
                pass
    assert not dog.dog.fallen and dog.dog.state().body_height > 0.25
    assert math.dist(stands[:2], after[:2]) < AT_REST
