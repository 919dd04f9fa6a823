"""Lets pytest run the chapters: nbval reads notebooks, and jupytext makes a notebook of a chapter.

``pytest book/03_mpc.py`` runs one chapter from a fresh kernel, cell by cell, then proofreads it
and writes its claims to ``build/claims/03_mpc.json`` (or to the folder CLAIMS, if that is set).
"""

import json
import os
from collections import Counter
from dataclasses import asdict
from pathlib import Path
from unittest import mock

import nbval.plugin
import pytest

ROOT = Path(__file__).parent
NOTEBOOKS = {ROOT / "book", ROOT / "solutions"}


def pytest_pycollect_makemodule(module_path, parent):
    """Makes a notebook, not a module, of a chapter."""
    if module_path.parent in NOTEBOOKS:
        return Chapter.from_parent(parent, path=module_path)


class Chapter(nbval.plugin.IPyNbFile):
    """A notebook kept as a jupytext text file."""

    def collect(self):
        """Returns one test a code cell, and the proofreading at the end."""
        import jupytext

        with mock.patch("nbval.plugin.nbformat.read", lambda path, as_version: jupytext.read(path)):
            self.cells = list(super().collect())
        return [*self.cells, Proofreading.from_parent(self, name="proofreading")]


class Proofreading(pytest.Item):
    """Collects the outputs of the cells that ran, and holds the chapter to its rules."""

    def runtest(self):
        """Writes the claims, then complains."""
        from pypose_lite.teaching import claims, proofread

        chapter = self.parent
        for item in chapter.cells:
            item.cell.outputs = item.test_outputs or []
        made = [asdict(claim) for claim in claims.claims_in(chapter.nb)]
        folder = Path(os.environ.get("CLAIMS", ROOT / "build" / "claims"))
        page = chapter.path.relative_to(ROOT).with_suffix(".json")  # labs bear lessons' names
        record = folder / (page.relative_to("book") if page.parts[0] == "book" else page)
        record.parent.mkdir(parents=True, exist_ok=True)
        record.write_text(json.dumps(made, indent=1) + "\n")
        if complaints := proofread.complaints(chapter.nb, chapter.path):
            raise AssertionError("\n".join(complaints))

    def repr_failure(self, excinfo):
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
