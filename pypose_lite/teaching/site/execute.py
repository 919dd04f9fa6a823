"""Runs one chapter from a fresh kernel.

``python -m pypose_lite.teaching.site.execute book/03_mpc.py out.ipynb [LIST]``

Ends with an error, and writes nothing, where a cell fails, a claim does not hold, or the chapter
does not pass its proofreading. LIST is a file with the list of all notebooks to be made in this
run, a line each; then each chapter says when it begins and ends, and how many are left.
"""

import atexit
import os
import sys
import time
from pathlib import Path

import jupytext
import nbformat
from jupyter_client.kernelspec import NoSuchKernel
from nbclient import NotebookClient
from nbclient.exceptions import CellExecutionError, CellTimeoutError, DeadKernelError

from ..claims import claims_in
from ..proofread import complaints

CELL_SECONDS = 120
DEAD = "its kernel died, most often because memory ran out: close other programs, run it again"
NO_START = (
    "its kernel does not start ({}): unset PYTHONPATH, install ipykernel again, "
    "or have the page name the kernel python3"
)


def execute(chapter: Path, target: Path) -> str:
    """Returns a line for the log, and leaves the notebook with its outputs in ``target``."""
    start = time.monotonic()
    notebook = jupytext.read(chapter)
    folder = {"metadata": {"path": str(chapter.parent)}}
    quiet = ["--log-level=ERROR"]
    client = NotebookClient(notebook, timeout=CELL_SECONDS, resources=folder, extra_arguments=quiet)
    try:
        client.execute(env=kernel_environment())
    except DeadKernelError:
        raise ValueError(DEAD) from None
    except (RuntimeError, NoSuchKernel) as error:
        atexit.unregister(client._cleanup_kernel)  # there is none: it would say so at length
        raise ValueError(NO_START.format(error)) from None
    if wrong := complaints(notebook, chapter):
        raise ValueError("\n  ".join(["does not pass its proofreading:", *wrong]))
    target.parent.mkdir(parents=True, exist_ok=True)
    nbformat.write(notebook, target)
    seconds = time.monotonic() - start
    return f"{chapter.stem}: {len(claims_in(notebook))} claims hold ({seconds:.0f} s)"


def kernel_environment() -> dict[str, str]:
    """The environment for a kernel: it chooses the backend that shows figures itself."""
    return {key: value for key, value in os.environ.items() if key != "MPLBACKEND"}


def left(todo: Path) -> int:
    """How many notebooks of the list have not been made since the list was."""
    began = todo.stat().st_mtime
    paths = [Path(line) for line in todo.read_text(encoding="utf-8").split()]
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
    except (CellExecutionError, CellTimeoutError, ValueError) as error:
        sys.exit(f"{chapter}: {error}")
