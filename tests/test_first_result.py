"""``python -m pypose_lite``: its numbers are those of the laps, its picture shows them."""

import re
import subprocess
import sys

import numpy as np
import pytest
import torch
from PIL import Image

from pypose_lite import EKF, DubinsCar, __main__, infinity


def program(*words):
    """What the program did, as it is called from a command line."""
    command = [sys.executable, "-m", "pypose_lite", *words]
    return subprocess.run(command, capture_output=True, text=True, timeout=120)


@pytest.fixture(scope="module")
def ours():
    """The laps that it should drive: without noise, and with the paper's, by seed 0 of torch."""
    car, g = DubinsCar(), torch.Generator().manual_seed(0)
    noisy = infinity.SimulatedCar(car, process_noise=0.005, observation_noise=0.163, generator=g)
    controller = infinity.controller()
    return [infinity.drive(controller), infinity.drive(controller, noisy, EKF(car))]


@pytest.fixture(scope="module")
def printed(tmp_path_factory):
    """The table that it prints, by name of a row; and the picture that it leaves."""
    picture = tmp_path_factory.mktemp("first") / "lap.png"
    done = program("--picture", str(picture))
    assert done.returncode == 0, done.stderr
    head, *lines = done.stdout.splitlines()
    assert head.split("  ")[-1].strip() == "through noise"
    assert lines[-2:] == ["", f"The picture: {picture}"]
    cells = [re.split(r"\s{2,}", line) for line in lines[:-2]]
    return {name: numbers for name, *numbers in cells}, picture


def in_metres(distances):
    """As the table writes them."""
    return [f"{distance:.3f} m" for distance in distances]


def test_the_distances_from_the_path_are_those_to_its_nearest_points(ours, printed):
    angle = torch.linspace(0, 2 * torch.pi, 20_000)
    circle = torch.stack([1 + angle.cos(), angle.sin()], -1)
    path = torch.cat([circle, -circle])
    away = [torch.cdist(run.x[:, :2], path).amin(1) for run in ours]
    table, _ = printed
    assert table["off the path, on average"] == in_metres(each.mean() for each in away)
    assert table["off the path, at most"] == in_metres(each.max() for each in away)


@pytest.mark.parametrize(
    ("name", "what"), [("error of what is seen", "y"), ("error of the estimate", "estimate")]
)
def test_errors_are_mean_distances_from_the_true_positions(ours, printed, name, what):
    errors = []
    for run in ours:
        pairs = zip(getattr(run, what).tolist(), run.x.tolist())
        distances = [((a[0] - b[0]) ** 2 + (a[1] - b[1]) ** 2) ** 0.5 for a, b in pairs]
        errors.append(sum(distances) / len(distances))
    assert printed[0][name] == in_metres(errors)


def test_waypoints_and_steps_are_counted(ours, printed):
    table, _ = printed
    assert table["waypoints reached"] == ["17", "17"]
    assert table["steps of 0.1 s"] == [str(len(run.u)) for run in ours]


def test_the_picture_is_large_enough_and_shows_both_laps(printed):
    pixels = np.asarray(Image.open(printed[1]).convert("RGB"))
    assert min(pixels.shape[:2]) >= 700
    of_the_car = (pixels == (0x00, 0x72, 0xB2)).all(-1)
    assert all(half.sum() > 500 for half in np.array_split(of_the_car, 2))


def test_a_lap_that_does_not_reach_the_end_says_how_far_it_came(ours):
    early = infinity.drive(infinity.controller(), steps=9)
    lines = {name: numbers for name, *numbers in __main__.rows([early])}
    near = torch.cdist(infinity.waypoints()[:8, :2], early.x[:-1, :2]).amin(1) <= 0.1
    assert lines["waypoints reached"] == [str(int(near.sum()))]


@pytest.mark.parametrize("words", [["--seed", "x"], ["--sed", "1"], ["lap"]])
def test_what_it_does_not_understand_is_said_in_one_line(words, capsys):
    with pytest.raises(SystemExit) as ended:
        __main__.main(words)
    said = capsys.readouterr()
    assert ended.value.code == 2 and said.out == ""
    [line] = said.err.splitlines()
    assert line.startswith("pypose_lite: ") and words[-1] in line and "--help" in line


def test_help_says_what_it_does_and_takes(capsys):
    with pytest.raises(SystemExit) as ended:
        __main__.main(["--help"])
    said = capsys.readouterr().out
    assert ended.value.code == 0
    assert "drives the lap" in said and "--picture" in said and "--seed" in said


@pytest.fixture
def quick(ours, monkeypatch):
    """The program, with laps that have been driven already."""
    monkeypatch.setattr(__main__, "laps", lambda seed: ours)
    monkeypatch.delenv("PYTHONPATH", raising=False)
    return __main__.main


@pytest.mark.parametrize("name", ["no_folder/lap.png", "a_file/lap.png", "lap.docx"])
def test_a_picture_that_cannot_be_saved_is_said_in_one_line_below_the_numbers(
    quick, tmp_path, capsys, name
):
    (tmp_path / "a_file").touch()
    assert quick(["--picture", str(tmp_path / name)]) == 1
    said = capsys.readouterr()
    [line] = said.err.splitlines()
    assert line.startswith("pypose_lite: the picture cannot be saved: ") and "--picture" in line
    assert "steps of 0.1 s" in said.out


@pytest.mark.parametrize(
    ("path", "mend"), [(None, "pip install 'pypose_lite[book]'"), ("/ros", "unset PYTHONPATH")]
)
def test_a_library_that_is_missing_or_of_another_python_is_named_with_what_to_do(
    quick, monkeypatch, capsys, path, mend
):
    if path:
        monkeypatch.setenv("PYTHONPATH", path)
    monkeypatch.setitem(sys.modules, "matplotlib.figure", None)
    assert quick([]) == 1
    [line] = capsys.readouterr().err.splitlines()
    assert "matplotlib.figure" in line and line.endswith(mend)
