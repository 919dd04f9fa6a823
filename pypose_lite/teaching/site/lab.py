"""The folder in which readers work, in JupyterLab: lessons, exercises, solutions as notebooks.

``python -m pypose_lite.teaching.site.lab stage EXECUTED LAB`` makes it, or brings it up to
date. A notebook that its reader has changed is left alone. ``... reset EXECUTED LAB 03_mpc`` puts
an exercise (or another notebook, by its path in the folder) back, and keeps the reader's version
beside it. ``... start LAB`` opens JupyterLab in it.
"""

import hashlib
import json
import os
import sys
from pathlib import Path

import jupytext
import nbformat
from nbformat.sign import NotebookNotary

from .pages import ROOT, notebooks
from .plain import Plain
from .scoreboard import gather
from .stage import Numbers, all_equations, for_download, read

FOLDERS = {"": "1_lessons", "exercises": "2_exercises", "solutions": "3_solutions"}
START = "start_here"
RECORD = ".written.json"  # what was written, by file: so it is known what readers have changed
EXTENSION = Path(__file__).parent / "labextension"
SETTINGS = {
    "@jupyterlab/apputils-extension:notification": {
        "fetchNews": "false",
        "checkForUpdates": False,
    },
    "@jupyterlab/notebook-extension:tracker": {"windowingMode": "none"},
}


def place(page: str) -> str:
    """Where a page lies in the folder; nothing for pages that are no notebooks."""
    if page not in notebooks():
        return ""
    folder, _, name = page.rpartition("/")
    return f"{START}.ipynb" if page == "index" else f"{FOLDERS[folder]}/{name}.ipynb"


class LabNumbers(Numbers):
    """Numbers that our extension finds again, and replaces by those of the reader's kernel."""

    def __call__(self, reference: str) -> str:
        """The number in an element that names its claim."""
        return f'<span class="claim" title="{reference}">{super().__call__(reference)}</span>'


def staged(executed: Path) -> dict[str, nbformat.NotebookNode]:
    """All notebooks for readers, by their place; with outputs where they have been executed."""
    claims, equations, made = gather(executed), all_equations(), {}
    for page, source in notebooks().items():
        made_before = page.startswith("exercises/") or (executed / f"{page}.ipynb").exists()
        notebook = read(page, executed) if made_before else jupytext.read(source)
        notebook.metadata.pop("jupytext", None)
        numbers = LabNumbers(page, claims, strict=False)
        made[place(page)] = for_download(notebook, Plain(page, numbers, place, equations))
    return made


def stage(executed: Path, lab: Path) -> None:
    """Makes the folder hold all notebooks; those that a reader has changed stay as they are."""
    lab.mkdir(exist_ok=True)
    record, made = read_record(lab), staged(executed)
    kept = []
    for name, notebook in made.items():
        path, new = lab / name, text_of(notebook)
        old = record.get(name)
        if path.exists() and text_of(nbformat.read(path, 4)) not in (old, new):
            kept.append(name)
            continue
        if not path.exists() or old != new:
            write(path, notebook)
        record[name] = new
    for name in set(record) - set(made):
        forget(lab / name, record.pop(name))
    (lab / RECORD).write_text(json.dumps(record, indent=1), encoding="utf-8")
    if kept:
        print("Left as you changed them: " + ", ".join(kept))


def forget(path: Path, written: str) -> None:
    """Removes a notebook that is no longer in the book, unless its reader has changed it."""
    if path.exists() and text_of(nbformat.read(path, 4)) == written:
        path.unlink()


def reset(executed: Path, lab: Path, wanted: str) -> None:
    """Puts a notebook back; what the reader had stays beside it as ``NAME.mine.ipynb``."""
    if not wanted:
        sys.exit("which one? make reset EXERCISE=03_mpc")
    name = f"{wanted if '/' in wanted else FOLDERS['exercises'] + '/' + wanted}.ipynb"
    made = staged(executed)
    if name not in made:
        there = ", ".join(sorted(path.removesuffix(".ipynb") for path in made))
        sys.exit(f"there is no {name}; there are {there}")
    path, record = lab / name, read_record(lab)
    if path.exists():
        mine = free(path)
        path.rename(mine)
        print(f"Yours is now {mine}")
    write(path, made[name])
    record[name] = text_of(made[name])
    (lab / RECORD).write_text(json.dumps(record, indent=1), encoding="utf-8")
    print(f"{path} is as it was")


def free(path: Path) -> Path:
    """A name for the reader's version that is not taken."""
    names = [path.with_suffix(".mine.ipynb")]
    names += [path.with_suffix(f".mine{number}.ipynb") for number in range(2, 100)]
    return next(name for name in names if not name.exists())


def write(path: Path, notebook) -> None:
    """Writes a notebook, and has JupyterLab trust its outputs, which this build has made."""
    path.parent.mkdir(parents=True, exist_ok=True)
    nbformat.write(notebook, path)
    NotebookNotary().sign(notebook)


def read_record(lab: Path) -> dict[str, str]:
    """What was written last time, by file."""
    path = lab / RECORD
    return json.loads(path.read_text(encoding="utf-8")) if path.exists() else {}


def text_of(notebook) -> str:
    """A mark of a notebook's cells without their outputs: running cells is no change."""
    cells = [[cell.cell_type, cell.source] for cell in notebook.cells if cell.source.strip()]
    return hashlib.sha256(json.dumps(cells).encode()).hexdigest()


def settings(folder: Path) -> dict[str, str]:
    """Writes JupyterLab's settings into a folder of our own; returns the environment for them."""
    file = folder / "labconfig" / "default_setting_overrides.json"
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_text(json.dumps(SETTINGS, indent=1), encoding="utf-8")
    return {"JUPYTER_CONFIG_DIR": str(folder)}


def command(*options: str) -> list[str]:
    """How JupyterLab is started with our extension; it opens the first page."""
    words = [sys.executable, "-m", "jupyterlab", "--ip=127.0.0.1", *options]
    if hasattr(os, "geteuid") and os.geteuid() == 0:
        words.append("--allow-root")  # it serves this machine alone
    words += [f"--LabApp.extra_labextensions_path={EXTENSION}", "--LabApp.news_url=None"]
    return [*words, f"--LabApp.default_url=/lab/tree/{START}.ipynb"]


def start(lab: Path, *options: str) -> None:
    """Becomes JupyterLab, in that folder."""
    environment = os.environ | settings(ROOT / "build" / "jupyter")
    os.chdir(lab)
    os.execve(sys.executable, command(*options), environment)


def main(task: str, *arguments: str) -> None:
    """Does what the command line says."""
    if task == "stage":
        stage(*map(Path, arguments))
    elif task == "reset":
        executed, lab, *wanted = arguments
        reset(Path(executed), Path(lab), "".join(wanted))
    else:
        start(Path(arguments[0]), *arguments[1:])


if __name__ == "__main__":
    try:
        main(*sys.argv[1:])
    except ValueError as error:
        sys.exit(str(error))
