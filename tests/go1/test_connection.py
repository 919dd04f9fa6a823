"""`connect`: what it takes, what it says when nothing comes, and what it leaves as it was."""

import gc
import math
import socket
import threading
import time
import warnings
from dataclasses import replace

import pytest

from pypose_lite import go1
from pypose_lite.go1.safety.limits import Mode
from pypose_lite.go1.simulator.body import STEP
from pypose_lite.go1.wire.protocol import COMMAND_SIZE, HighState, encode_state
from pypose_lite.go1.wire.transport import UdpServer


class Answering(threading.Thread):
    """A server that gives the same answer to whatever comes."""

    def __init__(self, answer):
        super().__init__(daemon=True)
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.bind(("127.0.0.1", 0))
        self.socket.settimeout(0.1)
        self.address = f"udp://127.0.0.1:{self.socket.getsockname()[1]}"
        self.answer, self.over = answer, threading.Event()

    def run(self):
        while not self.over.is_set():
            try:
                _, client = self.socket.recvfrom(2048)
                self.socket.sendto(self.answer, client)
            except TimeoutError:
                pass

    def __enter__(self):
        self.start()
        return self

    def __exit__(self, *exception):
        self.over.set()
        self.join()
        self.socket.close()


class Standing(threading.Thread):
    """A simulated robot on UDP that stands, in a thread, and the clients that it heard."""

    def __init__(self, model="edu"):
        super().__init__(daemon=True)
        self.server = UdpServer("127.0.0.1", 0, COMMAND_SIZE, silence=5.0)
        self.address = f"udp://127.0.0.1:{self.server.port}"
        self.simulator, self.over = go1.SimulatedRobot(self.server, go1.Simulation(model)), False

    def run(self):
        while not self.over:
            self.simulator.step(STEP)

    def __enter__(self):
        self.start()
        return self

    def __exit__(self, *exception):
        self.over = True
        self.join()
        self.server.close()


@pytest.mark.wall_clock
@pytest.mark.parametrize(
    ("answer", "says"),
    [
        (bytes(1044), "times state: expected 1087 bytes, got 1044 (another robot's, an A1's"),
        (encode_state(HighState(position=(math.nan, 0.0, 0.0))), "times a number is not finite"),
        (encode_state(HighState())[:-1] + b"!", "checksum"),
    ],
    ids=["another size", "NaN", "a wrong checksum"],
)
def test_no_state_came_says_what_did_come(answer, says):
    with Answering(answer) as stranger, pytest.raises(go1.RobotTimeout) as told:
        go1.connect(stranger.address)
    assert f"{stranger.address}: no state came within 3 s; what came was refused: " in str(
        told.value
    )
    assert says in str(told.value)


@pytest.mark.wall_clock
def test_connecting_to_nobody_says_so_and_leaves_no_thread():
    before = threading.active_count()
    told = "udp://127.0.0.1:1: no state came within 3 s; nobody listens there"
    with pytest.raises(go1.RobotTimeout, match=told):
        go1.connect("udp://127.0.0.1:1")
    assert threading.active_count() <= before


@pytest.mark.wall_clock
def test_the_connect_cell_can_be_run_again():
    with Standing() as dog:
        first = go1.connect(dog.address)
        with pytest.warns(UserWarning, match="the robot of an earlier connect is closed"):
            second = go1.connect(dog.address)
        with second:
            assert first.closed and not second.closed
            second.wait(0.1)
            assert second.age < 0.3
            with pytest.raises(RuntimeError, match="the robot is closed"):
                first.move(0.1, 0.0)
        with warnings.catch_warnings():
            warnings.simplefilter("error")  # the one before was closed: nothing to say
            time.sleep(0.1)
            del first, second
            gc.collect()


@pytest.mark.parametrize("call", ["damp", "go_on", "wait"])
def test_a_closed_robot_says_so_whatever_is_asked(call):
    with go1.connect() as robot:
        pass
    with pytest.raises(RuntimeError, match="the robot is closed"):
        getattr(robot, call)(*([0.1] if call == "wait" else []))


def test_a_log_is_not_touched_while_no_state_comes(tmp_path):
    path = tmp_path / "run.csv"
    path.write_text("precious", encoding="utf-8")
    deaf = go1.Simulation(faults=go1.Faults(loss=1.0))
    for address, simulation in (("sim", deaf), ("sim", None)):
        with pytest.raises(FileExistsError, match="run.csv is there already; overwrite=True"):
            go1.connect(address, log=path, simulation=simulation)
    with pytest.raises(go1.RobotTimeout):
        go1.connect("sim", log=path, overwrite=True, simulation=deaf)
    assert path.read_text(encoding="utf-8") == "precious"
    with go1.connect("sim", log=path, overwrite=True) as robot:
        robot.wait(0.1)
    assert go1.read_log(path)[0].t == 0.0


def test_a_recording_is_not_played_back_onto_itself(tmp_path):
    path = tmp_path / "run.csv"
    with go1.connect("sim", log=path) as robot:
        robot.wait(0.1)
    before = path.read_bytes()
    with pytest.raises(ValueError, match="run.csv is the recording that is played back"):
        go1.connect(f"replay:{path}", log=path, overwrite=True)
    assert path.read_bytes() == before


@pytest.mark.parametrize(
    ("model", "flag", "wrong"), [("pro", 0xEE, 1), ("pro", 0, 0), ("edu", 0xEE, 0)]
)
def test_the_flag_is_compared_with_the_model_at_connect(model, flag, wrong):
    with go1.connect("sim", flag, simulation=go1.Simulation(model=model)) as robot:
        told = [text for _, text in robot.events]
        assert (
            told
            == ["this is a Go1 Pro, which takes level_flag=0x00, not 0xEE: it will not move"][
                :wrong
            ]
        )
        assert len(robot.reasons_to_stay()) == wrong


@pytest.mark.wall_clock
def test_a_wrong_flag_on_udp_is_a_warning():
    with Standing("pro") as dog:
        with pytest.warns(UserWarning, match="this is a Go1 Pro, which takes level_flag=0x00"):
            go1.connect(dog.address).close()


def test_a_battery_whose_board_is_silent_is_ignored_by_name():
    silent = go1.Simulation(numbers=go1.Numbers(charge=0.0))
    with go1.connect("sim", simulation=silent) as robot:
        assert "0 % (or its board is silent)" in robot.reasons_to_stay()[0]
        with pytest.raises(go1.RobotStopped, match="the battery is at 0 %"):
            robot.move(0.3, 0.0)
    with go1.connect("sim", simulation=silent, ignore={"battery"}) as robot:
        assert robot.reasons_to_stay() == []
        robot.move(0.3, 0.0)
        robot.wait(0.3)
        assert robot.pose()[0] > 0.01


def test_the_origin_is_where_one_says():
    with go1.connect() as robot:
        robot.move(0.5, 0.0)
        robot.wait(0.4)
        robot.stop()
        robot.wait(0.5)
        robot.reset_origin((2.0, 3.0, math.pi / 2))
        assert robot.pose() == pytest.approx((2.0, 3.0, math.pi / 2))
        robot.move(0.5, 0.0)
        robot.wait(0.4)
        x, y, _ = robot.pose()
        assert x == pytest.approx(2.0, abs=0.01) and y > 3.05
        with pytest.raises(ValueError, match="start: expected finite numbers"):
            robot.reset_origin((math.nan, 0.0, 0.0))


def test_a_trim_straightens_a_robot_that_drifts_to_its_left():
    def side(trim):
        with go1.connect("sim", trim=trim) as robot:
            dog = robot.simulator.dog
            ask = dog.ask
            drift = {Mode.WALK: 0.05}  # m/s

            def drifting(command):
                forward, left = command.velocity
                ask(replace(command, velocity=(forward, left + drift.get(command.mode, 0.0))))

            dog.ask = drifting
            for _ in range(20):
                robot.move(0.4, 0.0)
                robot.wait(0.1)
            return dog.pose[1]

    assert side((0.0, 0.0, 0.0)) > 0.08
    assert side((0.0, -0.05, 0.0)) == pytest.approx(0.0, abs=1e-6)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"address": "tcp://1.2.3.4:5"}, "address: expected 'sim', 'sim:legs', 'udp://host:port'"),
        ({"address": ""}, "address: expected"),
        ({"address": "udp://1.2.3.4"}, "expected 'udp://host:port'"),
        ({"address": "udp://1.2.3.4:99999"}, "[Pp]ort"),
        ({"address": "udp://127.0.0.1:8082/x"}, "expected 'udp://host:port'"),
        ({"address": "udp:1.2.3.4:8082"}, "expected 'udp://host:port'"),
        ({"level_flag": 0xFF}, "level_flag: expected 0xEE or 0x00, got 255"),
        ({"rate": 10.0}, "rate: expected 100 to 500 Hz, got 10"),
        ({"rate": math.nan}, "rate: expected"),
        ({"command_timeout": 0.0}, "command_timeout: expected 0.1 to 1 s, got 0"),
        ({"command_timeout": 60.0}, "command_timeout: expected"),
        ({"gait": "gallop"}, "gait: expected 'trot', 'run' or 'stairs', got 'gallop'"),
        ({"speed_limit": 0.0}, "speed_limit: expected m/s above 0, got 0"),
        ({"start": (0.0, math.nan, 0.0)}, "start: expected three finite numbers"),
        ({"trim": (0.0, math.inf, 0.0)}, "trim: expected three finite numbers"),
        ({"trim": (0.0, 0.1)}, "trim: expected three finite numbers"),
        ({"area": (1.0, -1.0, 0.0, 1.0)}, r"area: expected \(least x, most x, least y, most y\)"),
        ({"area": (-1.0, 1.0, 0.0, math.nan)}, "area: expected"),
        ({"ignore": ["speed"]}, "ignore: expected some of"),
        ({"address": "udp://127.0.0.1:1", "realtime": False}, "realtime: a robot on UDP"),
        (
            {"address": "udp://127.0.0.1:1", "simulation": go1.Simulation()},
            "simulation: only for 'sim'",
        ),
    ],
)
def test_arguments_that_do_not_fit_are_named(arguments, message):
    with pytest.raises(ValueError, match=message):
        go1.connect(**arguments)
