"""The commands as an owner gives them, in this process, on simulated robots."""

import json
import math
import re
import signal
import sys
from dataclasses import replace

import pytest

from pypose_lite import go1
from pypose_lite.go1 import __main__ as program
from pypose_lite.go1.program import commands, questions, walking
from pypose_lite.go1.walk import LENGTH, START
from pypose_lite.go1.wire.remote import encode_remote


@pytest.fixture
def run(capsys, tmp_path, monkeypatch):
    """Runs a command in a folder of its own: its status, and what it said where."""
    monkeypatch.chdir(tmp_path)

    def run(*arguments):
        status = program.main([*map(str, arguments)])
        said = capsys.readouterr()
        return status, said.out, said.err

    return run


@pytest.fixture
def real(monkeypatch):
    """Simulated robots, set up as one likes, behind an address of a real one."""
    made, setup = [], {}

    def connect(address, level_flag=0xEE, rate=200.0, **options):
        options |= {"realtime": None, "simulation": go1.Simulation(**setup)}
        robot = go1.connect("sim", level_flag, **options)
        robot.address = "udp://192.168.123.161:8082"
        made.append(robot)
        return robot

    monkeypatch.setattr(commands, "connect", connect)
    return made, setup


def answer(monkeypatch, text):
    """Somebody types that, whenever a question is asked."""
    asked = []

    def input_():
        asked.append(True)
        if isinstance(text, BaseException):
            raise text
        return text

    monkeypatch.setattr("builtins.input", input_)
    return asked


def test_status_tells_what_the_robot_says(run):
    status, said, _ = run("status")
    assert status == 0
    for word in ("Go1 Edu", "89 %", "IDLE", "0.28 m", "degrees Celsius", "FR 30", "no button"):
        assert word in said


def test_status_is_json_for_other_programs(run):
    status, said, _ = run("status", "--json")
    told = json.loads(said)
    assert status == 0 and told["model"] == "Edu" and told["battery"] == 89
    assert told["feet"] == {"FR": 30, "FL": 30, "RR": 30, "RL": 30} and told["refused"] == {}


def test_listening_goes_on_and_shows_a_jump_and_a_button(run, real):
    made, _ = real
    seen = []

    def watch(robot, options):
        robot.simulator.dog.remote = encode_remote("L2", "B")
        robot.wait(0.2)
        robot.simulator.dog._odometry = (99.0, 0.0, 0.0)
        options.seconds = robot.now() + 1.0
        watching(robot, options)
        seen.append(robot.pilot.stopped)

    watching, commands._watch = commands._watch, watch
    try:
        status, said, _ = run("listen", "--seconds", 1)
    finally:
        commands._watch = watching
    assert status == 0 and "L2 B" in said and "the pose jumped by" in said
    assert seen == [None]  # it was counted on from there


@pytest.mark.parametrize(
    ("command", "height", "mode"), [("stand", 0.28, 1), ("lie", 0.08, 5), ("damp", 0.08, 7)]
)
def test_a_posture_is_taken(run, command, height, mode):
    status, said, _ = run(command, "--json")
    told = json.loads(said.splitlines()[-1])
    assert status == 0 and told["mode"] == mode
    assert told["height"] == pytest.approx(height, abs=0.01)


@pytest.mark.parametrize("command", ["stand", "lie", "walk", "listen --cmd-vel -"])
@pytest.mark.parametrize("text", ["n", "", "maybe", EOFError()])
def test_nothing_moves_a_real_robot_unless_somebody_says_yes(run, real, monkeypatch, command, text):
    asked = answer(monkeypatch, text)
    status, said, _ = run(*command.split())
    assert asked and status == 1
    assert "--yes does it without asking" in said or "you said no" in said
    robot = real[0][0]
    assert robot.simulator.dog.pose == (0.0, 0.0, 0.0)
    assert robot.simulator.dog.command.mode == 0


def test_standing_up_before_a_walk_is_asked_for_as_well(run, real, monkeypatch):
    made, setup = real
    answer(monkeypatch, "n")
    status, said, _ = run("walk", "--stand-up")
    assert status == 1 and "It will stand up." in said
    assert made[0].simulator.dog.command.mode == 0


def test_damping_asks_nobody(run, real, monkeypatch):
    answer(monkeypatch, AssertionError("nobody is to be asked"))
    assert run("damp")[0] == 0


def test_the_order_to_go_limp_is_sent_even_if_nobody_answers(run, real):
    made, setup = real
    setup["faults"] = go1.Faults(loss=1.0)
    orders = []
    speak = go1.Robot._speak

    def spy(robot, command):
        orders.append(command.mode)
        speak(robot, command)

    go1.Robot._speak = spy
    try:
        status, _, error = run("damp")
    finally:
        go1.Robot._speak = speak
    assert status == 1 and "nobody answered" in error
    assert set(orders) == {7} and len(orders) > 500


def test_a_walk_announces_walks_and_reports(run, tmp_path):
    status, said, _ = run("walk", "--speed", 0.8, "--log", "a.csv", "--picture", "a.png")
    assert status == 0
    assert "at 0.8 m/s, for about 16 s" in said and "2.75 m to a side" in said
    (seconds,) = re.findall(r"17 of 17 waypoints in (.*) s of the robot's simulated time", said)
    assert float(seconds) == pytest.approx(LENGTH / 0.8, rel=0.05)
    assert "off the curve, as the robot believes: 0.0" in said
    assert "\n0 of 1" in said and "steps came late\nno events" in said
    assert [f"waypoint {number:2d} of 17" in said for number in range(2, 18)] == [True] * 16
    assert go1.read_log("a.csv")[-1].command_v == 0.0
    assert (tmp_path / "a.png").read_bytes().startswith(b"\x89PNG")
    status, said, _ = run("replay", "a.csv", "--json", "--picture", "b.png")
    lines = [json.loads(line) for line in said.splitlines()[:-1]]
    assert status == 0 and len(lines) > 70 and lines[40]["pose"] != lines[0]["pose"]
    assert (tmp_path / "b.png").read_bytes().startswith(b"\x89PNG")


def test_a_walk_told_as_json_says_nothing_else(run):
    status, said, error = run("walk", "--speed", 1, "--no-picture", "--json")
    *steps, report = map(json.loads, said.splitlines())
    assert status == 0 and [step["waypoint"] for step in steps] == [*range(1, 17)]
    assert report["finished"] and report["waypoints"] == 17 and report["mean_error"] < 0.05
    assert "It will walk an infinity" in error


def test_a_walk_that_is_stopped_says_why_and_keeps_its_log(run, real, monkeypatch):
    made, setup = real
    setup["numbers"] = go1.Numbers(scale=0.0)
    status, said, _ = run("walk", "--yes", "--log", "a.csv", "--no-picture")
    assert status == 1
    assert "m/s for a second" in said and "zero velocity goes out" in said
    assert "1 of 17 waypoints in" in said
    assert go1.read_log("a.csv")[-1].mode == 1  # it stands


@pytest.mark.parametrize(
    ("setup", "why"),
    [
        ({"numbers": go1.Numbers(charge=3.0)}, "the battery is at 2 %"),
        ({"model": "pro"}, "this is a Go1 Pro, which takes level_flag=0x00"),
        ({"numbers": go1.Numbers(height=0.1)}, "it lies"),
    ],
)
def test_a_robot_that_should_not_walk_is_not_even_asked_for(run, real, monkeypatch, setup, why):
    real[1].update(setup)
    asked = answer(monkeypatch, "y")
    status, said, _ = run("walk", "--no-picture")
    assert status == 1 and why in said and not asked


def test_a_silent_battery_board_can_be_ignored_by_name(run, real, monkeypatch):
    real[1]["numbers"] = go1.Numbers(charge=0.0)
    answer(monkeypatch, "y")
    assert run("walk", "--no-picture", "--speed", 1)[0] == 1
    assert (
        run("walk", "--no-picture", "--speed", 1, "--ignore", "battery", "--log", "b.csv")[0] == 0
    )


def test_late_steps_are_told_of_a_real_robot(real, monkeypatch):
    robot = commands.connect("udp", start=START)
    with robot:
        progress = walking.Progress(robot)
        times = iter([0.0, 0.1, 0.4, 0.5])
        monkeypatch.setattr(walking.time, "monotonic", lambda: next(times))
        for waypoint in (1, 1, 1, 2):
            progress(waypoint)
        assert (progress.late, progress.steps) == (1, 4)
        assert "too slowly" in walking.as_text(walking.report(robot, progress, None))


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["walk", "--picture", "a.doc"], "--picture: expected a name that ends in"),
        (["walk", "--picture", "no/folder/a.png"], "--picture: there is no folder"),
        (["walk", "--log", "no/folder/a.csv"], "--log: there is no folder"),
        (["walk", "--log", "."], "--log: '.' is a folder"),
        (["walk", "--delay", "inf"], "expected 0 to 1, got inf"),
        (["walk", "--delay", "-3"], "expected 0 to 1, got -3"),
        (["walk", "--delay", "nan"], "expected 0 to 1, got nan"),
        (["walk", "--speed", "9"], "expected 0.05 to 1, got 9"),
        (["walk", "--lag", "0"], "expected 0.01 to 1, got 0"),
        (["walk", "--level-flag", "7"], "expected 0xEE or 0, got 7"),
        (["walk", "--level-flag", "x"], "invalid"),
        (["walk", "--rate", "10"], "expected 100 to 500, got 10"),
        (["walk", "--trim", "1,2"], "expected 3 numbers with commas, got 1,2"),
        (["listen", "--seconds", "inf"], "expected 0 to inf, got inf"),
        (["listen", "--area", "1,2,3,inf"], "expected 4 numbers with commas"),
        (["listen", "--cmd-vel", "tcp:9"], "--cmd-vel: expected - or a port"),
        (["replay"], "required: file"),
        (["dance"], "invalid choice: 'dance'"),
        ([], "required: command"),
    ],
)
def test_options_that_do_not_fit_are_told_in_a_line_before_a_robot_hears_of_it(
    capsys, monkeypatch, arguments, message
):
    monkeypatch.setattr(commands, "connect", None)
    with pytest.raises(SystemExit) as ended:
        program.main(arguments)
    assert ended.value.code == 2 and message in capsys.readouterr().err.splitlines()[-1]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["status", "--robot", "tcp://x"], "address: expected 'sim'"),
        (["status", "--ignore", "gravity"], "ignore: expected some of"),
        (["replay", "none.csv"], "No such file"),
        (["replay", "bad.csv"], "bad.csv: expected a first line t,x,y"),
        (["walk", "--log", "bad.csv"], "bad.csv is there already"),
    ],
)
def test_what_goes_wrong_is_told_in_one_line(run, tmp_path, arguments, message):
    (tmp_path / "bad.csv").write_text("precious", encoding="utf-8")
    status, said, error = run(*arguments)
    assert status == 1 and message in error and len(error.splitlines()) == 1
    assert (tmp_path / "bad.csv").read_text(encoding="utf-8") == "precious"


def test_without_matplotlib_the_program_says_what_to_install(capsys, monkeypatch):
    import importlib.util

    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    with pytest.raises(SystemExit):
        program.main(["walk"])
    assert "pip install 'pypose_lite[book]', or --no-picture" in capsys.readouterr().err


@pytest.mark.parametrize("moment", ["connecting", "the question", "the walk"])
def test_ctrl_c_is_one_line_at_any_time(run, real, monkeypatch, moment):
    def interrupted(*arguments, **options):
        signal.raise_signal(signal.SIGINT)

    answer(monkeypatch, KeyboardInterrupt() if moment == "the question" else "y")
    if moment == "connecting":
        monkeypatch.setattr(commands, "connect", interrupted)
    if moment == "the walk":
        monkeypatch.setattr(walking, "walk", interrupted)
    status, _, error = run("walk", "--no-picture")
    assert status == 130 and error.splitlines()[-1] == "stopped" and "Traceback" not in error


def test_what_the_table_cannot_know_is_said(run, real):
    real[1]["freeze"] = 0.1
    status, said, _ = run("status", "--robot", "udp")
    assert status == 0 and "no new state from the robot for" in said


def test_a_question_is_put_where_people_read_it(capsys, monkeypatch):
    monkeypatch.setattr(sys, "stdin", None)
    answer(monkeypatch, "y")
    with go1.connect() as robot:
        robot.address = "udp://"
        options = type("options", (), {"yes": False, "json": True})
        assert questions.agreed(robot, options, "It will move.")
    said = capsys.readouterr()
    assert said.out == "" and said.err == "It will move.\nDo it? [y/N] "
    assert math.isfinite(robot.now())


def test_versions_are_told_where_packets_carry_them():
    from pypose_lite.go1.program.description import as_table, describe

    with go1.connect() as robot:
        assert "version" not in as_table(describe(robot))
        state = robot.simulator.dog.state
        robot.simulator.dog.state = lambda: replace(state(), version=(0x25, 0x386))
        robot.wait(0.1)
        assert "Go1 Edu, version 0x25 0x386" in as_table(describe(robot))


def test_a_robot_is_identified_and_a_walk_plans_with_its_log(run, tmp_path):
    status, said, _ = run("identify", "--log", "how.csv", "--json")
    told = json.loads(said.splitlines()[-1])
    assert status == 0 and told["lag"] == pytest.approx([0.15, 0.15], abs=0.03)
    assert told["dead_band"] == [0.0, 0.0] and told["axle"] == pytest.approx(0.0, abs=0.01)
    status, said, _ = run("identify", "--log", "how.csv", "--overwrite")
    assert status == 0 and "It will walk ahead in pulses" in said and "lag       0.15 s" in said
    status, said, _ = run("walk", "--identified", "how.csv", "--speed", 0.8, "--no-picture")
    assert status == 0 and "17 of 17 waypoints" in said


def test_a_log_that_identifies_nothing_is_a_line_and_nothing_moves(run, real):
    made, _ = real
    run("walk", "--speed", 1.0, "--log", "lap.csv", "--no-picture", "--yes")
    made.clear()
    status, said, error = run("walk", "--identified", "lap.csv", "--no-picture", "--yes")
    assert status == 1 and made == [] and error.startswith("rows: of ") and "\n" not in error[:-1]


def test_nobody_is_identified_without_a_yes(run, real, monkeypatch):
    made, _ = real
    answer(monkeypatch, "n")
    status, said, _ = run("identify", "--log", "how.csv")
    assert status == 1 and "it does not move: you said no" in said
    assert made[0].simulator.dog.pose == (0.0, 0.0, 0.0)


def test_a_dog_with_legs_walks_the_infinity_from_the_command_line(run):
    numbers = "--speed", 0.5, "--tolerance", 0.15
    status, said, _ = run("walk", "--robot", "sim:legs", *numbers, "--no-picture", "--json")
    told = json.loads(said.splitlines()[-1])
    assert status == 0 and told["finished"] and told["mean_error"] < 0.04 and told["events"] == []
