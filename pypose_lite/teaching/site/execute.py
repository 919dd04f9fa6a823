"""Runs one chapter from a fresh kernel.

``python -m pypose_lite.teaching.site.execute book/03_mpc.py out.ipynb [LIST]``

Ends with an error, and writes nothing, where a cell fails, a claim does not hold, or the chapter
does not pass its proofreading. LIST is a file with the list of all notebooks to be made in this
run, a line each; then each chapter says when it begins and ends, and how many are left.
"""

import sys
import time
from pathlib import Path

import jupytext
import nbformat
from nbclient import NotebookClient
from nbclient.exceptions import CellExecutionError, CellTimeoutError, DeadKernelError

from ..claims import claims_in
from ..proofread import complaints

CELL_SECONDS = 120


def execute(chapter: Path, target: Path) -> str:
    """Returns a line for the log, and leaves the notebook with its outputs in ``target``."""
    start = time.monotonic()
    notebook = jupytext.read(chapter)
    folder = {"metadata": {"path": str(chapter.parent)}}
    quiet = ["--log-level=ERROR"]
    NotebookClient(
        notebook, timeout=CELL_SECONDS, resources=folder, extra_arguments=quiet
    ).execute()
    if wrong := complaints(notebook, chapter):
        raise ValueError("\n  ".join(["does not pass its proofreading:", *wrong]))
    target.parent.mkdir(parents=True, exist_ok=True)
    nbformat.write(notebook, target)
    seconds = time.monotonic() - start
    return f"{chapter.stem}: {len(claims_in(notebook))} claims hold ({seconds:.0f} s)"


def left(todo: Path) -> int:
    """How many notebooks of the list have not been made since the list was."""
    began = todo.stat().st_mtime
    paths = [Path(line) for line in todo.read_text().split()]
    return sum(not path.exists() or path.stat().st_mtime < began for path in paths)


def main(chapter: Path, target: Path, *todo: Path) -> None:
    """Makes the notebook, and says so."""
    for path in todo:
        print(f"{target.stem}: begins ({left(path)} to go)", flush=True)
    line = execute(chapter, target)
    print("; ".join([line, *(f"{left(path)} to go" for path in todo)]), flush=True)


if __name__ == "__main__":
    chapter, *paths = map(Path, sys.argv[1:])
    try:
        main(chapter, *paths)
    except (CellExecutionError, CellTimeoutError, DeadKernelError, ValueError) as error:
        sys.exit(f"{chapter}: {error}")
