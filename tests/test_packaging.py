"""The package installs anywhere, brings what it should, and needs little."""

import re
import subprocess
import sys
import tomllib
import zipfile
from importlib import metadata
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

import pypose_lite

ROOT = Path(__file__).parent.parent
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
LINES = (ROOT / "constraints.txt").read_text(encoding="utf-8").splitlines()
PINS = {
    canonicalize_name(name): version
    for name, version in (line.split("==") for line in LINES if "==" in line)
}
REQUIREMENTS = [*PROJECT["dependencies"], *sum(PROJECT["optional-dependencies"].values(), [])]

IMPORT_ALL = """
import importlib, pathlib, sys, pypose_lite
package = pathlib.Path(pypose_lite.__file__).parent
for path in package.rglob("*.py"):
    name = ".".join(path.relative_to(package.parent).with_suffix("").parts)
    if "teaching" not in name and "__main__" not in name:
        importlib.import_module(name.removesuffix(".__init__"))
print(package)
print([name for name in ("pypose_lite.teaching", "matplotlib", "IPython") if name in sys.modules])
"""


def run(*command, **options):
    """What a command prints."""
    done = subprocess.run(command, capture_output=True, text=True, timeout=240, **options)
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_the_version_stands_in_one_place(wheel):
    assert metadata.version("pypose_lite") == pypose_lite.__version__
    assert f"-{pypose_lite.__version__}-py3-none-any.whl" in wheel.name


def test_the_wheel_holds_the_package_and_nothing_else(wheel):
    names = zipfile.ZipFile(wheel).namelist()
    modules = {str(path.relative_to(ROOT)) for path in (ROOT / "pypose_lite").rglob("*.py")}
    assert modules | {"pypose_lite/py.typed"} <= set(names)
    assert "pypose_lite/teaching/legged/dog_on_infinity.jpg" in names
    assert {name.split("/")[0].split("-")[0] for name in names} == {"pypose_lite"}


def test_the_library_runs_outside_the_repository_without_the_notebooks_helpers(wheel, tmp_path):
    zipfile.ZipFile(wheel).extractall(tmp_path)
    code = f"import sys; sys.path.insert(0, {str(tmp_path)!r})\n{IMPORT_ALL}"
    where, loaded = run(sys.executable, "-I", "-c", code, cwd=tmp_path).splitlines()
    assert Path(where) == tmp_path / "pypose_lite"
    assert loaded == "[]"


@pytest.mark.parametrize("requirement", REQUIREMENTS)
def test_every_requirement_has_a_pin_that_satisfies_it(requirement):
    wanted = Requirement(requirement)
    assert PINS[canonicalize_name(wanted.name)] in wanted.specifier


def test_pins_are_plain_versions():
    assert all(re.fullmatch(r"[\w.]+", version) for version in PINS.values())
