"""A chapter in JupyterLab: it opens as a notebook, runs, and its sliders compute."""

import os
import re
import socket
import subprocess
import sys
import time
from pathlib import Path
from urllib.request import urlopen

import jupytext
import pytest

ROOT = Path(__file__).parents[2]
CHAPTER = ROOT / "book" / "03_mpc.py"
HAS_RUN = re.compile(r"\[\d+\]:")
ERROR = '[data-mime-type="application/vnd.jupyter.error"]'

playwright = pytest.importorskip("playwright.sync_api")


@pytest.fixture
def lab(browser, tmp_path):
    """The address of a JupyterLab that serves a copy of the chapter and draws all its cells."""
    jupytext.write(jupytext.read(CHAPTER), tmp_path / "chapter.ipynb")
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    options = ["--no-browser", "--ip=127.0.0.1", f"--port={port}", "--allow-root"]
    options += ["--IdentityProvider.token=", "--LabApp.news_url=None", "--ServerApp.port_retries=0"]
    overrides = tmp_path / "CONFIG" / "labconfig" / "default_setting_overrides.json"
    overrides.parent.mkdir(parents=True)
    overrides.write_text('{"@jupyterlab/notebook-extension:tracker": {"windowingMode": "none"}}')
    settings = {f"JUPYTER_{kind}_DIR": str(tmp_path / kind) for kind in ("CONFIG", "DATA")}
    server = subprocess.Popen(
        [sys.executable, "-m", "jupyterlab", *options],
        cwd=tmp_path,
        env=os.environ | settings,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    try:
        yield await_answer(f"http://127.0.0.1:{port}")
    finally:
        server.terminate()
        server.wait(timeout=30)


def await_answer(address):
    """The address, once it answers."""
    for _ in range(120):
        try:
            urlopen(f"{address}/api", timeout=5)
        except OSError:
            time.sleep(0.5)
        else:
            return address
    pytest.fail("JupyterLab did not start within a minute")


@pytest.fixture
def notebook(lab, page):
    """The chapter in JupyterLab, after its cells have run: all of them, or up to an error."""
    page.goto(f"{lab}/lab/tree/chapter.ipynb?reset")
    page.locator(".jp-Notebook").wait_for(state="visible")
    indicator = page.locator('.jp-NotebookPanel-toolbar [data-status="idle"]')
    indicator.first.wait_for(state="visible")
    dialog = page.locator(".jp-Dialog")  # where the kernel starts late, Lab asks for one, or twice
    accept = dialog.locator(".jp-mod-accept").last
    page.add_locator_handler(dialog, lambda: accept.click(), no_wait_after=True)
    prompts = page.locator(".jp-CodeCell .jp-InputPrompt")
    run_all(page, prompts.first)
    ended = prompts.last.filter(has_text=HAS_RUN).or_(page.locator(ERROR))
    ended.first.wait_for(state="attached", timeout=300_000)
    return page


def run_all(page, prompt):
    """Chooses "Run All Cells", again where that came before the last kernel was connected."""
    for _ in range(4):
        page.get_by_text("Run", exact=True).first.click()
        page.get_by_text("Run All Cells", exact=True).click()
        try:
            return playwright.expect(prompt).to_have_text(HAS_RUN, timeout=30_000)
        except AssertionError:
            continue
    pytest.fail("JupyterLab did not run the cells")


@pytest.mark.timeout(480)
def test_a_chapter_runs_in_jupyterlab_and_its_sliders_redraw_the_figures(notebook):
    assert notebook.locator(ERROR).all_inner_texts() == []
    boxes = notebook.locator(".jp-OutputArea-output:has(.noUi-handle)")
    assert boxes.count() > 0
    for box in boxes.all():
        box.scroll_into_view_if_needed()
        picture = box.locator("img:visible").first
        before = picture.get_attribute("src")
        box.locator(".noUi-handle").first.press("ArrowRight")
        playwright.expect(picture).not_to_have_attribute("src", before, timeout=30_000)
