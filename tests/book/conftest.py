"""A browser, for the tests that look at pages as a reader does; small books, for the others."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from small_books import HEADER

from pypose_lite.teaching.site import pdf

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def run_book(tmp_path_factory):
    """Runs pytest, set up as in this repository, on lessons and labs; by name, cells."""

    def run(chapters, labs=None):
        root = tmp_path_factory.mktemp("root")
        for folder in ("book", "solutions"):
            (root / folder).mkdir()
        for name in ("pyproject.toml",):
            shutil.copy(ROOT / name, root)
        for name, cells in chapters.items():
            (root / "book" / name).write_text(HEADER + cells, encoding="utf-8")
        for name, cells in (labs or {}).items():
            (root / "solutions" / name).write_text(HEADER + cells, encoding="utf-8")
        command = [sys.executable, "-m", "pytest", "book", "solutions", "-q", "--color=no"]
        env = os.environ | {"PYTEST_ADDOPTS": ""}
        done = subprocess.run(
            command, cwd=root, env=env, capture_output=True, text=True, timeout=240
        )
        return root, done.stdout

    return run


@pytest.fixture(scope="session")
def browser():
    """A headless Chromium; CHROMIUM names one that is not on the path."""
    if (chromium := pdf.chromium()) is None:
        pytest.skip("no browser: install chromium, or name one in the variable CHROMIUM")
    sync_api = pytest.importorskip("playwright.sync_api")
    with sync_api.sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=chromium, args=pdf.FLAGS)
        yield browser
        browser.close()


@pytest.fixture
def page(browser):
    """A new page in it."""
    page = browser.new_page(viewport={"width": 1300, "height": 900})
    page.set_default_timeout(60_000)
    yield page
    page.close()
