import csv

import pytest

from pypose_lite import go1
from pypose_lite.go1.log import Row


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
    assert len(rows) == pytest.approx(50 * (4.0 + 0.5), abs=5)  # the farewell is in it
    assert [row.t for row in rows] == sorted({row.t for row in rows})
    assert {round(row.command_v, 6) for row in rows} == {0.0, 0.4}
    assert {round(row.command_yaw_rate, 6) for row in rows} == {0.0, 0.1, 0.2, 0.3, 0.4}
    recorded = [row[1:4] for row in rows]
    for pose in poses:
        assert min(max(abs(a - b) for a, b in zip(pose, seen)) for seen in recorded) < 1e-6


def test_a_log_opens_in_any_tool_that_reads_csv(run):
    with open(run[0], newline="") as file:
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
    path.write_text("\n".join([",".join(Row._fields), *lines]))
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
        (",".join(Row._fields) + "\n", "no rows"),
        (",".join(Row._fields) + "\n1,2,3\n", "line 2 is no row of 13"),
        (",".join(Row._fields) + "\n" + ",".join(["0"] * 12 + ["x"]) + "\n", "line 2 is no row"),
        (",".join(Row._fields) + "\n" + ",".join(["nan"] * 13) + "\n", "line 2: expected finite"),
        (
            "\n".join([",".join(Row._fields), ",".join(["1"] * 13), ",".join(["0"] * 13)]),
            "line 3: the time goes back",
        ),
    ],
)
def test_a_file_that_is_no_log_is_refused_with_its_line(tmp_path, text, message):
    path = tmp_path / "bad.csv"
    path.write_text(text)
    with pytest.raises(ValueError, match=message):
        go1.connect(f"replay:{path}")


def test_a_file_that_is_not_there_is_an_ordinary_error(tmp_path):
    with pytest.raises(FileNotFoundError):
        go1.connect(f"replay:{tmp_path}/none.csv")
    with pytest.raises(FileNotFoundError):
        go1.connect("sim", log=tmp_path / "no folder" / "run.csv")
