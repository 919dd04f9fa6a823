"""The public names of `pypose_lite.go1`, and what importing them costs."""

import subprocess
import sys

import pytest

from pypose_lite import go1

HEAVY = {"torch", "numpy", "scipy", "matplotlib", "IPython"}


def in_a_new_process(code):
    """What a program prints, and on which of the heavy packages it ends."""
    code += f"\nimport sys; print(sorted({HEAVY!r} & set(sys.modules)))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60)
    assert (done.returncode, done.stderr) == (0, "")
    return done.stdout


@pytest.mark.parametrize(
    "code",
    [
        "import pypose_lite.go1",
        "from pypose_lite.go1 import *",
        "from pypose_lite import go1\n"
        "with go1.connect() as robot:\n"
        "    robot.move(0.3, 0.1)\n"
        "    robot.wait(0.2)",
        "import pypose_lite.go1.walk, pypose_lite.go1.__main__, pypose_lite.go1.simulator.__main__",
    ],
    ids=["the package", "its names", "a robot", "its programs"],
)
def test_the_robots_owner_needs_no_torch_and_nothing_is_printed(code):
    assert in_a_new_process(code) == "[]\n"


def test_importing_the_package_loads_none_of_its_modules():
    code = "import pypose_lite.go1, sys; print([m for m in sys.modules if 'go1.' in m])"
    assert in_a_new_process(code) == "[]\n[]\n"


@pytest.mark.parametrize("name", go1.__all__)
def test_every_public_name_is_there_and_listed(name):
    assert getattr(go1, name) is not None and name in dir(go1)


def test_an_unknown_name_is_an_ordinary_error():
    with pytest.raises(AttributeError, match="module 'pypose_lite.go1' has no attribute 'conect'"):
        go1.conect  # noqa: B018
