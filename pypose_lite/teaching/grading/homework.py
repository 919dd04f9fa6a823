"""Makes homework from the labs.

``python -m pypose_lite.teaching.grading.homework solutions build/homework``

``students/`` holds the notebooks that students get. Everything else is the teacher's: ``keys/``,
by which labs are graded, and a kit for each way to do it, ``nbgrader/``, ``otter/``, ``pytest/``.
The seed of the hidden numbers is drawn once and kept in ``keys/``; ``--seed 1234`` gives another
one. ``--only 3.1,3.2`` leaves the other exercises out, and the labs that have none of them.
"""

import argparse
import contextlib
import json
import secrets
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

import jupytext
import nbformat

from ..checks import chapter
from ..site import exercises as labs
from ..site.needs import needs_in
from .key import Key, checks_in, key_of
from .with_nbgrader import answer_cell, check_cell

ROOT = Path(__file__).parents[3]  # of the repository
NEEDED = ("torch", "numpy", "matplotlib", "ipython", "ipykernel", "ipywidgets", "jupytext")
CONFIG = """\
from pypose_lite.teaching.grading import with_nbgrader

c = get_config()  # noqa: F821
c.CourseDirectory.course_id = "pypose_lite"
c.Autograde.autograde_preprocessors = with_nbgrader.STEPS
c.Grade.keys = "keys"
c.OverwriteCells.add_missing_cells = True
c.ClearSolutions.code_stub = {"python": "raise NotImplementedError"}
"""
TEST = '''\
"""SUBMISSION=.../{lab}.ipynb pytest --noconftest -c /dev/null test_{lab}.py --junitxml=junit.xml"""

from pathlib import Path

from pypose_lite.teaching.grading.with_pytest import graded_by

test_exercise = graded_by(Path(__file__).with_name("key.json"))
'''


def homework(solutions: Path, target: Path, seed: int | None = None, only: str = "") -> list[str]:
    """Writes all that is made from the labs in ``solutions``, and returns their names."""
    sources = {path.stem: path.read_text("utf-8") for path in sorted(solutions.glob("[0-9]*.py"))}
    if wrong := [c for name, text in sources.items() for c in labs.complaints(text, f"{name}.py")]:
        raise ValueError("\n".join(wrong))
    sources = chosen(sources, only.split(",")) if only else sources
    seed = kept_seed(target / "keys" / "seed.txt", seed)
    keys = {name: lab_key(name, text, seed) for name, text in sources.items()}
    for name, text in sources.items():
        keys[name].write(target / "keys" / f"{name}.json")
        students = notebook_of(labs.exercises_from(text), keys[name])
        put(students, target / "students" / f"{name}.ipynb")
        for_pytest(keys[name], target / "pytest" / name)
    for_nbgrader(sources, keys, target / "nbgrader")
    for_otter(keys, target / "otter")
    return list(sources)


def chosen(sources: dict[str, str], numbers: list[str]) -> dict[str, str]:
    """The labs with these exercises and no others."""
    kept = {}
    for name, text in sources.items():
        cells = [cell for cell in labs.cells_of(text) if cell.exercise in ("", *numbers)]
        if any(cell.exercise for cell in cells):
            kept[name] = "".join(cell.text for cell in cells)
    there = {n for text in kept.values() for n, _ in labs.HEADING.findall(text)}
    if missing := sorted(set(numbers) - there):
        raise ValueError(f"only: expected numbers of exercises such as 3.1, got {missing}")
    for text in sources.values():
        for number, others in needs_in(text).items():
            if number in numbers and (missing := [n for n in others if n not in numbers]):
                raise ValueError(f"only: {number} uses cells of {', '.join(missing)}; add them")
    return kept


def kept_seed(path: Path, given: int | None) -> int:
    """The seed that is given, or that was drawn before, or a new one; it is kept."""
    kept = int(path.read_text(encoding="utf-8")) if path.exists() else 1 + secrets.randbelow(2**31)
    seed = kept if given is None else given
    if seed == 0:
        raise ValueError("seed: expected another one than 0, which is that of the public checks")
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(f"{seed}\n", encoding="utf-8")
    return seed


def lab_key(name: str, text: str, seed: int) -> Key:
    """The key of a lab, from its text and its checks."""
    cells = jupytext.reads(text, fmt="py:percent").cells
    codes = [cell.source for cell in cells if cell.cell_type == "code"]
    asked = {number for number, _ in labs.HEADING.findall(text)}
    exercises = [e for e in chapter(int(name[:2])) if e.number in asked]
    return key_of(name, codes, exercises, seed)


def notebook_of(text: str, key: Key) -> nbformat.NotebookNode:
    """A lab as a notebook, its answers and checks marked as nbgrader wants them."""
    notebook = jupytext.reads(text, fmt="py:percent")
    notebook.metadata.pop("jupytext", None)
    tasks = {task.number: task for task in key.tasks}
    number = ""
    for cell, is_answer in zip(notebook.cells, answers_in(notebook)):
        cell.id = nbformat.v4.new_code_cell().id
        if cell.cell_type == "markdown":
            number = (labs.HEADING.findall(commented(cell.source)) or [(number, "")])[-1][0]
        elif is_answer:
            cell.metadata["nbgrader"] = answer_cell(tasks[number])
        elif checked := [n for n in checks_in(cell.source) if n in tasks]:
            cell.metadata["nbgrader"] = check_cell(tasks[checked[0]])
    return notebook


def commented(markdown: str) -> str:
    """Markdown as it stands in the lab's file."""
    return "\n".join(f"# {line}" for line in markdown.splitlines())


def answers_in(notebook: nbformat.NotebookNode) -> Iterator[bool]:
    """Whether each cell holds an answer: a solution, or the stub in its place."""
    for cell in notebook.cells:
        code = cell.cell_type == "code"
        yield code and (labs.BEGIN in cell.source or "raise NotImplementedError(" in cell.source)


def put(notebook: nbformat.NotebookNode, path: Path) -> None:
    """Writes a notebook."""
    path.parent.mkdir(parents=True, exist_ok=True)
    nbformat.write(notebook, path)


def for_pytest(key: Key, folder: Path) -> None:
    """Writes a test file with its key."""
    key.write(folder / "key.json")
    (folder / f"test_{key.lab}.py").write_text(TEST.format(lab=key.lab), encoding="utf-8")


def for_nbgrader(sources: dict[str, str], keys: dict[str, Key], course: Path) -> None:
    """Makes nbgrader's course folder, and has nbgrader make the notebooks that it releases."""
    from nbgrader.apps import NbGraderAPI
    from nbgrader.coursedir import CourseDirectory
    from traitlets.config import Config, PyFileConfigLoader

    for name, text in sources.items():
        cells = [cell.text for cell in labs.cells_of(text) if not cell.is_solution]
        notebook = notebook_of("".join(cells), keys[name])
        put(notebook, course / "source" / name / f"{name}.ipynb")
        keys[name].write(course / "keys" / f"{name}.json")
    (course / "nbgrader_config.py").write_text(CONFIG, encoding="utf-8")
    config = Config(PyFileConfigLoader("nbgrader_config.py", str(course)).load_config())
    config.CourseDirectory.root = str(course.resolve())
    api = NbGraderAPI(CourseDirectory(config=config), config=config)
    for name in sources:
        done = api.generate_assignment(name)
        if not done["success"]:
            raise ValueError(f"nbgrader does not accept {name}:\n{done.get('error')}{done['log']}")


def for_otter(keys: dict[str, Key], folder: Path) -> None:
    """Makes the zip of each lab that otter runs, and that Gradescope takes."""
    from otter.generate import main as generate

    from . import with_otter

    folder.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as made, contextlib.chdir(made):
        wheel = library()
        for name, key in keys.items():
            tests = Path(f"tests_{name}")
            tests.mkdir()
            for task in key.tasks:
                text = with_otter.test_file(task)
                (tests / f"q{task.id}.py").write_text(text, encoding="utf-8")
            key.write(Path("key.json"))
            plugin = {with_otter.NAME: json.loads(Path("key.json").read_text(encoding="utf-8"))}
            config = {"plugins": [plugin], "show_stdout": False, "show_hidden": True}
            Path("config.json").write_text(json.dumps(config), encoding="utf-8")
            Path("needed.txt").write_text(requirements(wheel), encoding="utf-8")
            generate(
                tests_dir=str(tests),
                output_path=str(folder / f"{name}.zip"),
                config="config.json",
                requirements="needed.txt",
                no_environment=True,
                files=[str(wheel)],
                python_version="3.12",
            )


def library() -> Path:
    """Builds this library's wheel, which travels with the zips, in the folder that we are in."""
    for name in ("pyproject.toml", "README.md", "LICENSE"):
        shutil.copy(ROOT / name, name)
    shutil.copytree(ROOT / "pypose_lite", "pypose_lite", ignore=shutil.ignore_patterns("__py*__"))
    command = [sys.executable, "-m", "pip", "wheel", "-q", "--no-deps", "--no-build-isolation"]
    done = subprocess.run([*command, ".", "-w", "wheel"], capture_output=True, text=True)
    if done.returncode:
        raise ValueError(f"the library's wheel cannot be built:\n{done.stderr[-500:]}")
    return next(Path("wheel").glob("pypose_lite-*.whl"))


def requirements(wheel: Path) -> str:
    """What is installed where Gradescope grades: the versions that were tested, torch for CPUs."""
    pins = [line.split("==") for line in (ROOT / "constraints.txt").read_text("utf-8").splitlines()]
    versions = {pin[0]: pin[1] for pin in pins if len(pin) == 2}
    lines = [f"{name}=={versions[name]}" for name in NEEDED]
    index = "--extra-index-url https://download.pytorch.org/whl/cpu"
    return "\n".join([index, *lines, f"/autograder/source/files/{wheel}"]) + "\n"


def main() -> None:
    """Does what the command line says."""
    parser = argparse.ArgumentParser(prog="python -m pypose_lite.teaching.grading.homework")
    parser.add_argument("solutions", type=Path)
    parser.add_argument("target", type=Path)
    parser.add_argument("--seed", type=int)
    parser.add_argument("--only", default="")
    options = parser.parse_args()
    target = options.target.resolve()
    try:
        made = homework(options.solutions, target, options.seed, options.only)
    except ValueError as error:
        sys.exit(str(error))
    print(f"homework of {', '.join(made)}: {target}/students is for students, the rest is yours")


if __name__ == "__main__":
    main()
