import pytest
import torch
from go1_helpers import velocity

from pypose_lite import go1, infinity
from pypose_lite.go1 import __main__ as program
from pypose_lite.go1.walk import LONGEST, START, Ahead, Stuck, walk
from pypose_lite.systems import DubinsCar


@pytest.mark.parametrize(
    ("faults", "delay"),
    [
        ({"loss": 0.05, "delay": 0.05}, 0.2),
        ({"loss": 0.3, "delay": 0.2}, 0.5),
    ],
    ids=["5 % loss and 50 ms", "30 % loss and 200 ms"],
)
def test_the_dog_visits_all_waypoints_over_a_bad_line(watch, faults, delay):
    seen = watch(seed=1, start=START, speed_limit=0.5, **faults)
    run = walk(seen.robot, delay=delay)
    assert bool(run.finished)
    assert infinity.tracking_error(run.x).mean() < 0.04
    near = torch.cdist(run.x[:, :2], infinity.waypoints()[:, :2]).amin(0)
    assert near.max() < 2 * infinity.TOLERANCE
    forward, left, turn = torch.tensor([velocity(c) for _, c in seen.told]).unbind(-1)
    assert forward.min() >= 0 and forward.max() <= 0.5 + 1e-6
    assert turn.abs().max() <= 1.2 + 1e-6 and left.abs().max() == 0
    # what was told was asked: nothing is made up on the way
    asked = {tuple(round(n, 5) for n in velocity(command)) for _, command in seen.sent}
    told = {tuple(round(n, 5) for n in velocity(command)) for _, command in seen.told}
    assert told <= asked | {(0.0, 0.0, 0.0)}


def test_a_dog_that_has_missed_a_waypoint_is_not_left_standing_for_ever(watch):
    seen = watch(start=START, speed_limit=1.0, ignore={"jump", "motion"})

    def carried_away(waypoint):
        """It slips sideways out of the tolerance, just before the third waypoint."""
        if waypoint == 3 and not carried:
            x, y, heading = seen.robot.simulator.dog._odometry
            seen.robot.simulator.dog._odometry = x, y + 3.0, heading
            carried.append(seen.now())

    carried = []
    with pytest.raises(Stuck, match="Walk slower"):
        walk(seen.robot, 0.8, report=carried_away)
    assert LONGEST < seen.now() - carried[0] < 30
    seen.robot.wait(0.1)
    assert velocity(seen.sent[-1][1]) == (0.0, 0.0, 0.0)


def test_the_pose_is_rolled_forward_by_what_is_on_its_way():
    car, inputs = DubinsCar(), torch.tensor([[0.3, 0.1], [0.4, -0.2], [0.5, 0.6]])
    y, P = torch.tensor([1.0, 2.0, 0.6, 0.8]), torch.eye(4)
    ahead = Ahead(car, 2)
    for u in inputs[:2]:
        ahead(None, y, u, P, None, None)
    told, covariance = ahead(None, y, inputs[2], P, None, None)
    expected = car(car(y, inputs[1])[0], inputs[2])[0]
    assert torch.equal(told, expected) and covariance is P


@pytest.mark.parametrize(
    ("numbers", "reason"),
    [
        (go1.Numbers(charge=19.5), "the battery is at 19 %, below 20 %"),
        (go1.Numbers(height=0.12), "the body is 0.12 m above the ground: it lies"),
    ],
)
def test_a_robot_that_should_not_walk_says_why(watch, numbers, reason):
    assert watch(numbers=numbers).robot.reasons_to_stay() == [reason]


def test_a_robot_whose_state_is_old_should_not_walk(watch):
    seen = watch(freeze=1.0)
    seen.robot.wait(1.2)
    assert [reason.split(" s old")[0][:16] for reason in seen.robot.reasons_to_stay()] == [
        "its state is 0.2"
    ]


def test_the_program_walks_and_leaves_a_log_and_a_picture(tmp_path, capsys):
    log, picture = tmp_path / "run.csv", tmp_path / "run.png"
    status = program.main(
        ["walk", "--speed-limit", "1", "--log", str(log), "--picture", str(picture)]
    )
    said = capsys.readouterr().out
    assert status == 0
    assert "battery 89 %" in said and "17 of 17 waypoints" in said
    assert [f"waypoint {number:2d} of 17" in said for number in range(2, 18)] == [True] * 16
    rows = go1.read_log(log)
    assert max(row.command_v for row in rows) <= 1.0 + 1e-6 and rows[-1].command_v == 0.0
    assert picture.read_bytes().startswith(b"\x89PNG")


@pytest.fixture
def on_udp(monkeypatch, tmp_path):
    """The program with a simulated robot behind an address of a real one; runs only its talk."""
    walks = []

    def connected(options):
        robot = go1.connect(start=START)
        robot.address = "udp://192.168.123.161:8082"
        return robot

    def pretended(robot, *arguments):
        walks.append(robot)
        raise KeyboardInterrupt

    monkeypatch.setattr(program, "_connected", connected)
    monkeypatch.setattr(program, "walk", pretended)
    monkeypatch.setattr(program, "_tell", lambda options: None)

    def run(*arguments):
        return program.main(["walk", *arguments]), bool(walks)

    return run


@pytest.mark.parametrize(
    ("answer", "walks"), [("y", True), ("YES", True), ("n", False), ("", False), ("maybe", False)]
)
def test_a_real_robot_walks_only_when_somebody_says_yes(on_udp, monkeypatch, capsys, answer, walks):
    asked = []
    monkeypatch.setattr("builtins.input", lambda text: asked.append(text) or answer)
    assert on_udp() == ((130 if walks else 1), walks)
    assert asked == ["Walk? [y/N] "]
    said = capsys.readouterr().out
    assert "3 m to each side" in said and "0.5 m/s" in said
    assert ("you said no" in said) == (not walks)


def test_a_real_robot_does_not_walk_when_nobody_can_answer(on_udp, monkeypatch, capsys):
    def nobody(text):
        raise EOFError

    monkeypatch.setattr("builtins.input", nobody)
    assert on_udp() == (1, False)
    assert "--yes walks without asking" in capsys.readouterr().out


def test_yes_walks_without_asking(on_udp):
    assert on_udp("--yes") == (130, True)


def test_without_matplotlib_the_program_says_what_to_install(monkeypatch, capsys):
    monkeypatch.setattr(program.importlib.util, "find_spec", lambda name: None)
    assert program.main(["walk"]) == 2
    assert "pip install 'pypose_lite[book]', or --no-picture" in capsys.readouterr().out


def test_an_address_that_fits_nothing_is_told_without_a_traceback(tmp_path, capsys):
    log = str(tmp_path / "run.csv")
    assert program.main(["walk", "--robot", "tcp://x", "--log", log]) == 1
    assert "address: expected 'sim'" in capsys.readouterr().out
