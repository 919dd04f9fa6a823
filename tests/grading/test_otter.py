"""otter-grader and Gradescope: the zip that is uploaded grades what is handed in."""

import dataclasses
import json
import os
import subprocess
import sys
import zipfile

import pytest
from submissions import BELIEVE_ME, KEY, WRONG, handed_in, saved, with_checks

from pypose_lite.teaching.grading import homework

WRITES = """
import json, pathlib, tempfile
temporary = pathlib.Path(tempfile.gettempdir())
for folder in [pathlib.Path("results"), *temporary.glob("*/autograder/results")]:
    folder.mkdir(exist_ok=True)
    for name in ("results.json", "results.pkl"):
        (folder / name).write_text(json.dumps({"score": 100, "tests": []}))
"""
ROUNDS = {
    "right": (handed_in(), [1, 1, 1]),
    "tampering": (
        with_checks(
            "grader = check = print",
            handed_in(e31=WRITES + BELIEVE_ME + WRONG["3.1"], e35="import time; time.sleep(1e6)"),
        ),
        [0, 1, 0],
    ),
    "failing": (handed_in({}, e31=WRONG["3.1"], e32="def line_search(:"), [0, 0, 0]),
}


@pytest.fixture(scope="module")
def kit(tmp_path_factory):
    """The zip of the assignment."""
    folder = tmp_path_factory.mktemp("otter")
    homework.for_otter({"03_mpc": dataclasses.replace(KEY, cell_seconds=8.0)}, folder)
    return folder / "03_mpc.zip"


@pytest.fixture(scope="module")
def installed(kit, tmp_path_factory):
    """A folder with the library as the zip brings it along."""
    folder = tmp_path_factory.mktemp("installed")
    with zipfile.ZipFile(kit) as zipped:
        zipped.extractall(folder)
    (wheel,) = (folder / "files" / "wheel").glob("*.whl")
    with zipfile.ZipFile(wheel) as zipped:
        zipped.extractall(folder / "library")
    return folder / "library"


def otter(kit, installed, folder, notebook):
    """Runs otter on a submission; returns what Gradescope is told."""
    path = saved(notebook, folder / "03_mpc.ipynb")
    command = [sys.executable, "-m", "otter", "run", str(path), "-a", str(kit), "-o", str(folder)]
    environment = os.environ | {"PYTHONPATH": str(installed)}
    done = subprocess.run(
        command, cwd=folder, env=environment, capture_output=True, text=True, timeout=300
    )
    assert done.returncode == 0, done.stderr[-3000:]
    return json.loads((folder / "results.json").read_text(encoding="utf-8"))


@pytest.mark.parametrize("student", ROUNDS)
def test_each_answer_has_its_points_and_its_words(kit, installed, tmp_path, student):
    notebook, points = ROUNDS[student]
    tests = {test["name"]: test for test in otter(kit, installed, tmp_path, notebook)["tests"]}
    rows = [tests[f"{task.number} {task.title}"] for task in KEY.tasks]
    assert [row["score"] for row in rows] == points
    assert [row["max_score"] for row in rows] == [1, 1, 1]
    if student != "right":
        assert "The input that was just used has come back at the end." in rows[0]["output"]


def test_the_zip_is_what_gradescope_expects(kit, tmp_path):
    with zipfile.ZipFile(kit) as zipped:
        zipped.extractall(tmp_path)
    for script in ("setup.sh", "run_autograder"):
        subprocess.run(["bash", "-n", tmp_path / script], check=True)
    assert "/autograder/source/run_otter.py" in (tmp_path / "run_autograder").read_text("utf-8")
    needed = (tmp_path / "environment.yml").read_text(encoding="utf-8")
    (wheel,) = (tmp_path / "files" / "wheel").glob("pypose_lite-*.whl")
    assert f"/autograder/source/files/wheel/{wheel.name}" in needed
    assert "torch==" in needed
    names = zipfile.ZipFile(wheel).namelist()
    assert "pypose_lite/teaching/checks/chapter_03.py" in names
    assert not [name for name in names if "solutions" in name]
