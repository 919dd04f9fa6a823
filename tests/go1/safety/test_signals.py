"""Whatever happens to the program that drives, zero velocity reaches the robot, and goes on.

A second program drives a simulated robot that lives here; here it is told to end, or ends by
itself, and here the commands that arrive are written down with their time.
"""

import os
import select
import signal
import socket
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest
from go1_helpers import moving

from pypose_lite import go1
from pypose_lite.go1.robot import FAREWELL
from pypose_lite.go1.safety import signals
from pypose_lite.go1.safety.guardian import Guardian
from pypose_lite.go1.safety.limits import Mode
from pypose_lite.go1.simulator.body import STEP
from pypose_lite.go1.simulator.simulated_robot import SimulatedRobot
from pypose_lite.go1.wire.protocol import COMMAND_SIZE
from pypose_lite.go1.wire.transport import UdpServer

pytestmark = pytest.mark.wall_clock
DRIVER = Path(__file__).with_name("dying_driver.py")
WITHIN = 0.4  # s, the promise; and the time that a busy machine may keep a process waiting:
MACHINE = 0.3
WATCH = 1.2  # s, for which the robot is watched after the end

BY_ITSELF = [
    *("raise_an_error", "leave_without_closing", "exit_at_once", "crash"),
    *("sleep", "spin", "hold_the_interpreter"),
]
BY_SIGNAL = {
    "Ctrl-C": ("keep_driving", signal.SIGINT),
    "kill -TERM": ("keep_driving", signal.SIGTERM),
    "a closed terminal": ("keep_driving", signal.SIGHUP),
    "kill -KILL": ("keep_driving", signal.SIGKILL),
    "Ctrl-Z": ("keep_driving", signal.SIGSTOP),
    "kill -TERM while it sleeps": ("sleep", signal.SIGTERM),
    "Ctrl-C, and the program goes on": ("swallow_everything", signal.SIGINT),
}
PAIRS = {
    "Ctrl-C twice": (signal.SIGINT, signal.SIGINT),
    "Ctrl-C, then TERM": (signal.SIGINT, signal.SIGTERM),
    "Ctrl-C, then HUP": (signal.SIGINT, signal.SIGHUP),
    "TERM, then Ctrl-C": (signal.SIGTERM, signal.SIGINT),
    "TERM twice": (signal.SIGTERM, signal.SIGTERM),
    "TERM, then HUP": (signal.SIGTERM, signal.SIGHUP),
    "HUP, then Ctrl-C": (signal.SIGHUP, signal.SIGINT),
    "HUP, then TERM": (signal.SIGHUP, signal.SIGTERM),
    "HUP twice": (signal.SIGHUP, signal.SIGHUP),
}
LIVING = {"sleep", "spin", "hold_the_interpreter", "Ctrl-Z", "Ctrl-C, and the program goes on"}


class Witness(SimulatedRobot):
    """A robot on UDP in a thread, which writes down what it is told."""

    def __init__(self):
        self.server = UdpServer("127.0.0.1", 0, COMMAND_SIZE, silence=5.0)
        super().__init__(self.server, go1.Simulation())
        self.told = []
        self.end = threading.Event()
        self.thread = threading.Thread(target=self.live)

    def apply(self, command):
        self.told.append((time.monotonic(), command))
        super().apply(command)

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


@pytest.fixture(scope="module", autouse=True)
def usual_signals():
    """Signals as a terminal leaves them: in the background, or under nohup, some are ignored."""
    usual = {
        signal.SIGINT: signal.default_int_handler,
        signal.SIGTERM: signal.SIG_DFL,
        signal.SIGHUP: signal.SIG_DFL,
    }
    found = {number: signal.signal(number, action) for number, action in usual.items()}
    yield
    for number, action in found.items():
        signal.signal(number, action)


@pytest.fixture(scope="module")
def drivers(usual_signals):
    """A program that starts drivers."""
    with subprocess.Popen(
        [sys.executable, str(DRIVER)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
        bufsize=1,
    ) as program:
        yield program
        program.kill()


def start(drivers, robot, way):
    """The process of a driver that is about to end, and the time."""
    address = f"udp://127.0.0.1:{robot.server.port}"
    drivers.stdin.write(f"{address} {way}\n")
    while select.select([drivers.stdout], [], [], 20.0)[0]:
        of, *rest = drivers.stdout.readline().split()
        if of == address:  # and not of one that was given up before
            return int(rest[0]), float(rest[1])
    raise AssertionError("the driver did not get as far as its end")


def drive_and_end(drivers, way, *numbers):
    """What the robot was told after the end of a program: [(seconds after it, command)].

    It ends by itself, or by those signals, 20 ms apart.
    """
    with Witness() as robot:
        process, end = start(drivers, robot, way)
        try:
            if numbers:
                time.sleep(0.3)
                end = time.monotonic()
            for number in numbers:
                os.kill(process, number)
                time.sleep(0.02)
            time.sleep(max(end + WATCH - time.monotonic(), 0.0))
        finally:
            os.kill(process, signal.SIGKILL)  # a child not waited for keeps its number
        return [(at - end, command) for at, command in [*robot.told]]


def check(told, lives):
    before = [command for at, command in told if at < 0]
    after = [(at, command) for at, command in told if WATCH > at >= 0]
    assert sum(map(moving, before)) > 50
    last = max((at for at, command in told if moving(command)), default=0.0)
    assert last < WITHIN + MACHINE
    zeros = [at for at, command in after if at > last]
    assert len(zeros) > 10
    if lives:
        assert zeros[-1] > WATCH - MACHINE


@pytest.mark.parametrize("way", BY_ITSELF)
def test_zero_velocity_goes_out_when_the_program_comes_to_its_end(drivers, way):
    check(drive_and_end(drivers, way), way in LIVING)


@pytest.mark.parametrize("ending", BY_SIGNAL)
def test_zero_velocity_goes_out_when_the_program_is_told_to_end(drivers, ending):
    check(drive_and_end(drivers, *BY_SIGNAL[ending]), ending in LIVING)


@pytest.mark.parametrize("pair", PAIRS)
def test_two_signals_20_ms_apart_do_not_cut_the_zeros_short(drivers, pair):
    told = drive_and_end(drivers, "keep_driving", *PAIRS[pair])
    check(told, lives=False)
    zeros = [at for at, command in told if at > 0 and not moving(command)]
    assert zeros[-1] - zeros[0] > 0.5 and len(zeros) > 50
    assert max(after - before for before, after in zip(zeros, zeros[1:])) < 0.1 + MACHINE
    last = [command.mode for _, command in told][-10:]
    assert last == [Mode.STAND] * 10


def test_what_waited_while_the_program_slept_is_not_taken_for_fresh(drivers):
    """Stopped for a second, its socket full of old states: what it serves next is new."""
    with Witness() as robot:
        process, _ = start(drivers, robot, "watch_the_state")
        time.sleep(0.6)  # the walk that it began has come to its end
        os.kill(process, signal.SIGSTOP)
        time.sleep(0.1)
        x, *rest = robot.dog._odometry
        robot.dog._odometry = (x + 1.0, *rest)  # it is carried away meanwhile
        time.sleep(1.0)
        moved, resumed = robot.dog._odometry[0], time.monotonic()
        os.kill(process, signal.SIGCONT)
        lines = [line.split() for line in iter(drivers.stdout.readline, "end\n")]
    served = [float(x) for at, x in lines if float(at) > resumed]
    assert len(served) > 50
    assert all(x == pytest.approx(moved, abs=0.1) for x in served)


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP])
def test_signals_are_put_back_when_the_last_robot_is_closed(number):
    assert signal.getsignal(number) == signal.SIG_DFL
    signals.arm()
    signals.arm()
    with pytest.raises(SystemExit) as ended:
        os.kill(os.getpid(), number)
        time.sleep(1.0)
    assert ended.value.code == 128 + number
    signals.disarm()
    assert signal.getsignal(number) != signal.SIG_DFL
    signals.disarm()
    assert signal.getsignal(number) == signal.SIG_DFL


def test_a_signal_that_the_program_handles_itself_is_left_to_it():
    def mine(number, frame):
        pass

    before = signal.signal(signal.SIGTERM, mine)
    try:
        signals.arm()
        assert signal.getsignal(signal.SIGTERM) is mine
        signals.disarm()
        assert signal.getsignal(signal.SIGTERM) is mine
    finally:
        signal.signal(signal.SIGTERM, before)


@pytest.mark.parametrize(
    ("first", "then", "raises"),
    [
        (signal.SIGINT, signal.SIGINT, KeyboardInterrupt),
        (signal.SIGINT, signal.SIGTERM, SystemExit),
        (signal.SIGTERM, signal.SIGINT, SystemExit),
        (signal.SIGHUP, signal.SIGTERM, SystemExit),
    ],
)
def test_a_block_is_run_to_its_end_and_then_the_signals_do_their_work(first, then, raises):
    signals.arm()
    try:
        found = signal.getsignal(signal.SIGINT), signal.getsignal(signal.SIGTERM)
        reached = []
        with pytest.raises(raises):
            with signals.postponed():
                signal.raise_signal(first)
                signal.raise_signal(then)
                reached.append(True)
        assert reached
        assert found == (signal.getsignal(signal.SIGINT), signal.getsignal(signal.SIGTERM))
    finally:
        signals.disarm()


def test_signals_are_not_postponed_in_another_thread_and_nothing_is_raised():
    failures = []

    def postpone():
        try:
            with signals.postponed():
                pass
        except BaseException as error:
            failures.append(error)

    thread = threading.Thread(target=postpone)
    thread.start()
    thread.join()
    assert failures == []


def test_a_guardian_whose_program_said_no_complete_goodbye_does_that_itself():
    """Zero velocity first, then the stand, and then it ends."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as ear:
        ear.bind(("127.0.0.1", 0))
        ear.settimeout(3.0)
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as mouth:
            mouth.connect(ear.getsockname())
            guardian = Guardian(mouth, 4, 0.01, 0.2)
            assert guardian.beat(b"zero", b"rest")
            guardian.close()
        heard = [(ear.recv(100), time.monotonic())]
        while heard[-1][1] - heard[0][1] < 1.0:
            heard.append((ear.recv(100), time.monotonic()))
    zeros = [at for data, at in heard if data == b"zero"]
    rests = [at for data, at in heard if data == b"rest"]
    assert len(zeros) > 10 and len(rests) > 10 and zeros[-1] < rests[0]
    assert 0.3 < zeros[-1] - zeros[0] < 0.5 + MACHINE
    assert guardian._process.wait(5.0) == 0


def test_a_dead_guardian_is_told():
    with Witness() as robot:
        with go1.connect(f"udp://127.0.0.1:{robot.server.port}") as driver:
            driver._guardian._process.kill()
            driver._guardian._process.wait()
            driver.wait(0.2)
            assert [text for _, text in driver.events] == ["the guardian process is dead"]
            driver.move(0.4, 0.0)
            driver.wait(0.1)


INIT = """
import os, subprocess, sys
subprocess.Popen(sys.argv[1:])
while True:
    try:
        os.wait()
    except ChildProcessError:
        break
"""
ALONE = ["unshare", "--user", "--map-root-user", "--pid", "--fork", "--mount-proc"]


def can_unshare():
    try:
        return subprocess.run([*ALONE, "true"], capture_output=True, timeout=20).returncode == 0
    except OSError:
        return False


@pytest.mark.parametrize("init", [False, True], ids=["as process 1", "under an init"])
def test_in_a_container_the_guardian_needs_an_init_beside_it(init):
    """The kernel ends a container with its process 1; `docker run --init` puts another there."""
    if not can_unshare():
        pytest.skip("no container can be made here")
    with Witness() as robot:
        address = f"udp://127.0.0.1:{robot.server.port}"
        wrap = [*ALONE, *([sys.executable, "-c", INIT] if init else [])]
        program = f"""
import os
from pypose_lite import go1
robot = go1.connect("{address}")
for tick in range(600):
    robot.move(0.4, 0.3)
    robot.wait(0.1)
    if tick == 10:
        os.kill(os.getpid(), 9)  # process 1 is spared by its own signals, so:
        os._exit(1)
"""
        with subprocess.Popen([*wrap, sys.executable, "-c", program]) as container:
            container.wait(30.0)
            time.sleep(0.0 if init else 1.0)
        told = [(at, moving(command)) for at, command in [*robot.told]]
        last = max(at for at, moves in told if moves)
        zeros = [at for at, moves in told if at > last]
    assert (len(zeros) > 10) == init


def test_the_last_packets_all_go_out_however_often_ctrl_c_is_pressed():
    """No guardian helps here: the robot lives in this program."""
    robot = go1.connect("sim", realtime=True)
    robot.move(0.4, 0.0)
    robot.wait(0.1)
    sent = robot.sent
    presses = [threading.Timer(0.02 * n, os.kill, (os.getpid(), signal.SIGINT)) for n in (1, 2, 3)]
    for press in presses:
        press.start()
    began = time.monotonic()
    with pytest.raises(KeyboardInterrupt):
        robot.close()
    assert time.monotonic() - began > FAREWELL - 0.05
    assert robot.sent - sent > 0.5 * 200 * FAREWELL and robot.closed
