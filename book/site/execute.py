"""Runs one chapter from a fresh kernel: ``python book/site/execute.py book/03_mpc.py out.ipynb``.

Ends with an error, and writes nothing, where a cell fails, a claim does not hold, or the chapter
does not pass its proofreading.
"""

import sys
import time
from pathlib import Path

import jupytext
import nbformat
from nbclient import NotebookClient
from nbclient.exceptions import CellExecutionError, CellTimeoutError, DeadKernelError

from pypose_lite.teaching.claims import claims_in
from pypose_lite.teaching.proofread import complaints

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
    if wrong := complaints(notebook, chapter.name):
        raise ValueError("\n  ".join(["does not pass its proofreading:", *wrong]))
    target.parent.mkdir(parents=True, exist_ok=True)
    nbformat.write(notebook, target)
    seconds = time.monotonic() - start
    return f"{chapter.stem}: {len(claims_in(notebook))} claims hold ({seconds:.0f} s)"


if __name__ == "__main__":
    chapter, target = map(Path, sys.argv[1:])
    try:
        print(execute(chapter, target), flush=True)
    except (CellExecutionError, CellTimeoutError, DeadKernelError, ValueError) as error:
        sys.exit(f"{chapter}: {error}")
