"""Lets pytest check tutorials: ``pytest tutorial.py``, in any repository that has pypose_lite.

nbval runs notebooks, and jupytext makes a notebook of a tutorial, cell by cell in a fresh kernel;
then it is proofread, and its claims are written to ``build/claims/tutorial.json`` (or into the
folder CLAIMS, if that is set). Files that are no notebooks are left to pytest.
"""

import json
import os
import time
from collections import Counter
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from queue import Empty
from typing import Any
from unittest import mock

import pytest

from .site.pages import is_notebook

CELL_SECONDS = 120


def pytest_pycollect_makemodule(module_path: Path, parent: pytest.Collector):
    """Makes a notebook, not a module, of a file that begins with jupytext's header."""
    if is_notebook(module_path):
        return _tutorial().from_parent(parent, path=module_path)


def _tutorial() -> Any:
    """The class of tutorials: nbval is imported only where there is one."""
    import jupytext
    import nbval.plugin

    class Tutorial(nbval.plugin.IPyNbFile):
        """A notebook kept as a jupytext text file."""

        def setup(self):
            """Starts the kernel, which chooses the backend that shows figures itself."""
            with mock.patch.dict(os.environ):
                os.environ.pop("MPLBACKEND", None)
                super().setup()
            self.kernel.await_reply = _awaits(self.kernel)

        def collect(self):
            """Returns one test a code cell, and the proofreading at the end."""
            self.compare_outputs = False  # claims say what has to be; outputs may differ
            options = self.config.option
            options.nbval_cell_timeout = min(options.nbval_cell_timeout, CELL_SECONDS)
            reader = mock.patch(
                "nbval.plugin.nbformat.read", lambda path, as_version: jupytext.read(path)
            )
            with reader:
                self.cells = list(super().collect())
            return [*self.cells, Proofreading.from_parent(self, name="proofreading")]

    return Tutorial


def _awaits(kernel: Any) -> Callable[..., None]:
    """The kernel's way to await the end of a cell, which a kernel that has died ends at once."""
    await_reply = kernel.await_reply

    def wait(message: str, timeout: float) -> None:
        began = time.monotonic()
        while True:
            try:
                return await_reply(message, timeout=1)
            except Empty:
                if not kernel.is_alive():
                    from .site.execute import DEAD

                    raise RuntimeError(DEAD) from None
                if time.monotonic() - began > timeout:
                    raise

    return wait


class Proofreading(pytest.Item):
    """Collects the outputs of the cells that ran, and holds the tutorial to its rules."""

    def runtest(self):
        """Writes the claims, then complains."""
        from . import claims, proofread

        chapter: Any = self.parent
        for item in chapter.cells:
            item.cell.outputs = item.test_outputs or []
        made = [asdict(claim) for claim in claims.claims_in(chapter.nb)]
        record = self.record()
        record.parent.mkdir(parents=True, exist_ok=True)
        record.write_text(json.dumps(made, indent=1) + "\n", encoding="utf-8")
        if complaints := proofread.complaints(chapter.nb, chapter.path):
            raise AssertionError("\n".join(complaints))

    def record(self) -> Path:
        """Where the claims are written: labs bear lessons' names, and lie in their own folder."""
        root = self.config.rootpath
        folder = Path(os.environ.get("CLAIMS", root / "build" / "claims"))
        page = self.path.relative_to(root).with_suffix(".json")
        return folder / (page.relative_to("book") if page.parts[0] == "book" else page)

    def repr_failure(self, excinfo, style=None):
        """The complaints alone, without a traceback through this file."""
        return str(excinfo.value)

    def reportinfo(self):
        """Where pytest says that it failed."""
        return self.path, 0, f"{self.path.name}::proofreading"


def pytest_terminal_summary(terminalreporter):
    """Prints how many answers the check of each exercise accepted and refused, as it should."""
    done = [
        report for key in ("passed", "failed") for report in terminalreporter.stats.get(key, [])
    ]
    graded = [value for report in done for key, value in report.user_properties if key == "grader"]
    table = Counter(map(tuple, graded))
    if table:
        terminalreporter.section("graders: exercise, right answers accepted, wrong ones refused")
    for number in sorted({number for number, _ in table}):
        right, wrong = table[number, "right accepted"], table[number, "wrong refused"]
        terminalreporter.write_line(f"{number:>5} {right:>4} {wrong:>4}")
