"""What README says: its commands exist, its links lead somewhere, its numbers are the program's."""

import importlib.util
import re
from pathlib import Path

import pytest

from pypose_lite import __main__

ROOT = Path(__file__).parent.parent
TEXT = (ROOT / "README.md").read_text("utf-8")
BLOCKS = re.findall(r"^```(\w*)\n(.*?)^```", TEXT, re.MULTILINE | re.DOTALL)
LINKS = [link for link in re.findall(r"\]\(([^)\s]+)\)", TEXT) if "://" not in link]
TARGETS = re.findall(r"(?:^|`)make ([a-z-]+)", TEXT, re.MULTILINE)
MODULES = re.findall(r"python -m ([\w.]+)", TEXT)


@pytest.mark.parametrize("link", LINKS)
def test_a_link_leads_to_a_file_that_is_there(link):
    assert (ROOT / link).is_file()


@pytest.mark.parametrize("target", sorted(set(TARGETS)))
def test_a_command_of_make_is_a_target(target):
    makefile = (ROOT / "Makefile").read_text("utf-8")
    assert re.search(rf"^{target}:", makefile, re.MULTILINE)


def test_both_commands_and_all_doors_are_there():
    assert {"lab", "book", "homework", "test"} <= set(TARGETS)
    assert {"pypose_lite", "pypose_lite.teaching.site", "pytest"} <= set(MODULES)


@pytest.mark.parametrize("module", sorted(set(MODULES)))
def test_a_program_of_python_is_there(module):
    spec = importlib.util.find_spec(module)
    assert spec.name == module
    assert spec.origin.endswith("__init__.py") and importlib.util.find_spec(f"{module}.__main__")


def test_an_exercise_that_is_named_is_there():
    for name in re.findall(r"EXERCISE=(\w+)", TEXT):
        assert (ROOT / "exercises" / f"{name}.py").is_file()


def test_the_code_runs():
    [code] = [code for language, code in BLOCKS if language == "python"]
    names = {}
    exec(compile(code, "README.md", "exec"), names)
    assert names["run"].finished


def numbers(cell):
    """A cell's number; its digits may differ in the last but one, by another version of torch."""
    return pytest.approx(float(cell.split()[0]), abs=2 if "." not in cell else 0.02)


def test_the_first_result_is_what_the_program_prints():
    [shown] = [block.splitlines()[1:] for _, block in BLOCKS if "seen exactly" in block]
    head, *lines = [re.split(r"\s{2,}", line) for line in shown]
    made = list(__main__.rows(__main__.laps(0)))
    assert head == list(__main__.HEAD)
    assert [name for name, *_ in lines] == [name for name, *_ in made]
    for (_, *ours), (_, *theirs) in zip(lines, made):
        assert [float(cell.split()[0]) for cell in ours] == list(map(numbers, theirs))


def test_every_chapter_is_listed():
    listed = re.findall(r"^\| (\d+) ", TEXT, re.MULTILINE)
    lessons = [path.stem for path in sorted((ROOT / "book").glob("[0-9][0-9]_*.py"))]
    assert [int(number) for number in listed] == [int(name[:2]) for name in lessons]


def test_each_chapter_is_a_lesson_and_a_lab_as_is_said():
    assert "Each chapter is a lesson and a lab" in TEXT
    folders = ROOT / "book", ROOT / "exercises"
    lessons, labs = ([path.stem[:2] for path in f.glob("[0-9][0-9]_*.py")] for f in folders)
    assert sorted(labs) == sorted(lessons)
