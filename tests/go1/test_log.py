import csv
import math
import warnings
from dataclasses import replace

import pytest

from pypose_lite import go1
from pypose_lite.go1.log import OLD_FIELDS, Row
from pypose_lite.go1.robot import FAREWELL

HEAD = ",".join(Row._fields)
WIDTH = len(Row._fields)


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """A recorded run: its file, the poses seen, and the commands given."""
    path, poses = tmp_path_factory.mktemp("log") / "run.csv", []
    with go1.connect("sim", log=path) as robot:
        for tick in range(40):
            robot.move(0.4, 0.1 * (tick % 5))
            robot.wait(0.1)
            poses.append(robot.pose())
    return path, poses


def test_a_log_has_a_row_for_every_new_state(run):
    path, poses = run
    rows = go1.read_log(path)
    assert rows[0].t == 0.0 and rows[0][1:4] == pytest.approx((0.0, 0.0, 0.0), abs=1e-6)
    assert len(rows) == pytest.approx(50 * (4.0 + FAREWELL), abs=5)  # the farewell is in it
    assert [row.t for row in rows] == sorted({row.t for row in rows})
    assert {round(row.command_v, 6) for row in rows} == {0.0, 0.4}
    assert {round(row.command_yaw_rate, 6) for row in rows} == {0.0, 0.1, 0.2, 0.3, 0.4}
    recorded = [row[1:4] for row in rows]
    for pose in poses:
        assert min(max(abs(a - b) for a, b in zip(pose, seen)) for seen in recorded) < 1e-6


def test_a_log_opens_in_any_tool_that_reads_csv(run):
    with open(run[0], newline="", encoding="utf-8") as file:
        first = next(csv.DictReader(file))
    assert set(first) == set(Row._fields) and float(first["soc"]) == 89


@pytest.mark.parametrize("realtime", [False, True])
def test_a_replay_is_a_robot_that_was_where_it_was(run, realtime):
    path, _ = run
    rows = go1.read_log(path)
    with go1.connect(f"replay:{path}", realtime=realtime) as robot:
        for _ in range(10):
            robot.move(0.1, 0.0)  # moves nothing, and is no error
            robot.wait(0.1)
            pose = robot.pose()
            near = min(rows, key=lambda row: abs(row.x - pose[0]) + abs(row.heading - pose[2]))
            assert pose == pytest.approx(near[1:4], abs=2e-6)
        assert robot.state.bms.soc == 89 and robot.simulator is None
        assert 0.2 < pose[0] < 0.5


def test_a_replay_that_has_ended_is_a_robot_that_says_nothing_new(run):
    with go1.connect(f"replay:{run[0]}") as robot:
        with pytest.raises(go1.RobotTimeout):
            for _ in range(200):
                robot.wait(0.1)
                robot.pose()


def test_a_replay_of_a_robot_that_stands_still_goes_on(tmp_path):
    path = tmp_path / "still.csv"
    row = Row(0, 1, 2, 0.5, 0, 0, 0, 0, 0, 0, 0, 0.28, 50)
    lines = [",".join(map(str, row._replace(t=0.02 * tick))) for tick in range(200)]
    path.write_text("\n".join([",".join(Row._fields), *lines]), encoding="utf-8")
    with go1.connect(f"replay:{path}") as robot:
        for _ in range(35):
            robot.wait(0.1)
            assert robot.pose() == (0.0, 0.0, 0.0)


def test_a_replay_can_be_logged_and_the_log_is_the_recording(run, tmp_path):
    again = tmp_path / "again.csv"
    with go1.connect(f"replay:{run[0]}", log=again) as robot:
        robot.wait(2.0)
    for row, copy in zip(go1.read_log(run[0]), go1.read_log(again)[:100]):
        assert copy[1:7] == pytest.approx(row[1:7], abs=3e-6)
        assert copy.t == pytest.approx(row.t, abs=0.011)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "expected a first line t,x,y"),
        ("a,b\n1,2\n", "expected a first line"),
        (HEAD + "\n", "no rows"),
        (HEAD + "\n1,2,3\n", f"line 2 is no row of {WIDTH} numbers, it has 3"),
        (f"{HEAD}\n{','.join(['0'] * (WIDTH - 1) + ['x'])}\n", "line 2 is no row"),
        (f"{HEAD}\n{','.join(['nan'] * WIDTH)}\n", "line 2: expected finite"),
        (
            "\n".join([HEAD, ",".join(["1"] * WIDTH), ",".join(["0"] * WIDTH), ""]),
            "line 3: the time goes back",
        ),
        (
            f"{HEAD}\n\n{','.join(['300' if n == 'mode' else '1' for n in Row._fields])}\n",
            "line 3: mode: expected 0 to 255, got 300",
        ),
        (f"{HEAD}\n{'1' * 131_073},1\n", r"bad.csv: line 2: field larger than field limit"),
    ],
)
def test_a_file_that_is_no_log_is_refused_with_its_line(tmp_path, text, message):
    path = tmp_path / "bad.csv"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(ValueError, match=message):
        go1.connect(f"replay:{path}")


def test_a_file_that_is_not_there_is_an_ordinary_error(tmp_path):
    with pytest.raises(FileNotFoundError):
        go1.connect(f"replay:{tmp_path}/none.csv")
    with pytest.raises(FileNotFoundError):
        go1.connect("sim", log=tmp_path / "no folder" / "run.csv")


def cells(**changes):
    """A line of a log, with a few columns changed."""
    return ",".join(changes.get(name, "1.000000") for name in Row._fields)


@pytest.mark.parametrize(
    "changed",
    [
        lambda text: "\ufeff" + text,
        lambda text: text.replace("\n", "\r\n"),
        lambda text: text.replace(",", ";"),
        lambda text: text + "\n\n",
        lambda text: text.rstrip("\n"),
    ],
    ids=["a BOM", "CRLF", "semicolons", "blank last lines", "no last newline"],
)
def test_what_a_spreadsheet_makes_of_a_log_is_read(tmp_path, changed):
    path = tmp_path / "run.csv"
    path.write_bytes(changed(f"{HEAD}\n{cells()}\n{cells(t='2')}\n").encode())
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        rows = go1.read_log(path)
    assert [row.t for row in rows] == [1.0, 2.0] and rows[0].soc == 1.0


@pytest.mark.parametrize("length", [1, 9, 30, 100])
def test_a_last_row_that_was_cut_off_is_left_out_with_a_warning(tmp_path, length):
    path = tmp_path / "run.csv"
    path.write_text(f"{HEAD}\n{cells()}\n{cells(t='2.000000')[:length]}", encoding="utf-8")
    with pytest.warns(UserWarning, match=r"run.csv: line 3 is no row .* it was cut off"):
        rows = go1.read_log(path)
    assert [row.t for row in rows] == [1.0]


def test_a_row_that_is_short_in_the_middle_is_no_crash_and_is_refused(tmp_path):
    path = tmp_path / "run.csv"
    path.write_text(f"{HEAD}\n{cells()}\n1,2,3\n{cells()}", encoding="utf-8")
    with pytest.raises(ValueError, match="run.csv: line 3 is no row"):
        go1.read_log(path)


def test_a_file_from_before_the_new_columns_is_read(tmp_path):
    path = tmp_path / "run.csv"
    path.write_text(f"{','.join(OLD_FIELDS)}\n{','.join(['1'] * 13)}\n", encoding="utf-8")
    (row,) = go1.read_log(path)
    assert row.soc == 1.0 and row.roll == row.age == row.target == 0.0


def test_a_body_height_that_is_no_number_makes_no_log_unreadable(tmp_path):
    path = tmp_path / "run.csv"
    with go1.connect("sim", log=path) as robot:
        state = robot.simulator.dog.state
        robot.simulator.dog.state = lambda: replace(state(), body_height=math.nan)
        robot.wait(0.2)
    rows = go1.read_log(path)
    assert len(rows) > 5 and math.isnan(rows[5].body_height)
    with go1.connect(f"replay:{path}") as robot:
        robot.wait(0.1)
        assert math.isnan(robot.state.body_height)


def test_a_log_holds_what_explains_a_bad_day(tmp_path):
    path = tmp_path / "run.csv"
    faults = go1.Faults(garbage=0.3, loss=0.3)
    setup = go1.Simulation(seed=1, faults=faults)
    with go1.connect("sim", log=path, simulation=setup) as robot:
        robot.simulator.dog.leaning = (0.1, -0.2)
        robot.target = 7
        robot.wait(1.0)
        refused = robot.pilot.refused
    rows = go1.read_log(path)
    assert rows[20].roll == pytest.approx(0.1) and rows[20].pitch == pytest.approx(-0.2)
    assert rows[20].target == 7 and rows[20].foot_rl == 30
    assert rows[-1].refused >= refused > 10
    gaps = [after.t - before.t for before, after in zip(rows, rows[1:])]
    assert [row.age for row in rows[1:]] == pytest.approx(gaps, abs=2e-6)


def test_what_was_walked_is_in_the_file_before_the_robot_is_closed(tmp_path):
    path = tmp_path / "run.csv"
    with go1.connect("sim", log=path) as robot:
        for _ in range(10):
            robot.wait(0.1)
        assert go1.read_log(path)[-1].t > 0.8
