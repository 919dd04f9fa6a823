"""Builds the site from pages that were made ready for it.

``python -m pypose_lite.teaching.site.build SOURCES TARGET [OPTIONS]``

The options are those of jupyter-book. Its own output is shown only where it is a warning.
"""

import re
import subprocess
import sys
import time
from pathlib import Path

STEP = re.compile(r"(reading sources|writing output)\.\.\. \[\s*(\d+)%\] (\S+)")
JUPYTER_BOOK = [sys.executable, "-c", "from jupyter_book.cli.main import main; main()"]


def build(source: Path, target: Path, options: list[str]) -> int:
    """Runs jupyter-book, shows a line a page, and returns its exit status."""
    files = (path for path in source.rglob("*") if "_build" not in path.parts)
    pages = sum(path.suffix in (".ipynb", ".md") for path in files)
    print(f"Building {pages} pages", flush=True)
    command = [*JUPYTER_BOOK, "build", str(source), "--path-output", str(target), *options]
    start = time.monotonic()
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, bufsize=1
    ) as process:
        for line in process.stdout or ():
            show(line.rstrip(), start)
    if process.returncode == 0:
        print(f"Built in {time.monotonic() - start:.0f} s", flush=True)
    return process.returncode


def show(line: str, start: float) -> None:
    """Prints a page as it is read or written, and what is a warning; the rest is not shown."""
    line = re.sub(r"\x1b\[[0-9;]*m", "", line)
    if found := STEP.search(line):
        verb = "read" if found[1].startswith("reading") else "written"
        print(f"  {found[2]:>3} % {found[3]} {verb} ({time.monotonic() - start:.0f} s)", flush=True)
    elif re.search(r"WARNING|ERROR|Traceback|Error|Exception", line):
        print(line, flush=True)


if __name__ == "__main__":
    sys.exit(build(Path(sys.argv[1]), Path(sys.argv[2]), sys.argv[3:]))
