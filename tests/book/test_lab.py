"""Readers' notebooks in JupyterLab: they run, fold, show their own numbers; sliders compute."""

import os
import re
import socket
import subprocess
import time
from pathlib import Path
from urllib.request import urlopen

import jupytext
import pytest
from small_books import LESSON

from pypose_lite.teaching.site import lab as readers
from pypose_lite.teaching.site.plain import Plain
from pypose_lite.teaching.site.stage import for_download

ROOT = Path(__file__).parents[2]
LESSONS = [path.stem for path in sorted((ROOT / "book").glob("[01]*.py"))]
HAS_RUN = re.compile(r"\[\d+\]:")
ERROR = '[data-mime-type="application/vnd.jupyter.stderr"]:has-text("Traceback")'
ROLE = re.compile(r"\{[\w:-]+\}`|:::|\{(claim|cite|eq|term|eval)\b|<!--")

playwright = pytest.importorskip("playwright.sync_api")


def small_lesson(**changes):
    """A lesson as readers get it, "12" filled in for its number; with changes of a reader."""
    notebook = jupytext.reads(LESSON, "py:percent")
    rewrite = Plain(
        "01_small",
        lambda name: f'<span class="claim" title="{name}">12</span>',
        readers.place,
        {"eq-1-square": "1.1"},
    )
    notebook = for_download(notebook, rewrite)
    for cell in notebook.cells:
        for old, new in changes.items():
            cell.source = cell.source.replace(old, new)
    return notebook


@pytest.fixture(scope="module")
def lab(browser, tmp_path_factory):
    """The address of a JupyterLab that serves a reader's folder and draws all cells."""
    folder = tmp_path_factory.mktemp("readers")
    readers.stage(folder / "nothing", folder)
    readers.write(folder / "small.ipynb", small_lesson())
    readers.write(folder / "changed.ipynb", small_lesson(**{"steps = 11": "steps = 5"}))
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    options = ["--no-browser", f"--port={port}", "--allow-root", "--IdentityProvider.token="]
    settings = readers.settings(folder / "CONFIG") | {"JUPYTER_DATA_DIR": str(folder / "DATA")}
    server = subprocess.Popen(
        readers.command(*options, "--ServerApp.port_retries=0"),
        cwd=folder,
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
def opened(lab, page):
    """Opens a notebook of the folder in JupyterLab."""

    def open_notebook(name):
        page.goto(f"{lab}/lab/tree/{name}?reset")
        page.locator(".jp-Notebook").wait_for(state="visible")
        page.locator('.jp-NotebookPanel-toolbar [data-status="idle"]').first.wait_for()
        return page

    return open_notebook


@pytest.fixture
def run(opened):
    """Opens one and runs its cells: all of them, or up to an error."""

    def run_notebook(name):
        page = opened(name)
        dialog = page.locator(".jp-Dialog")  # where the kernel starts late, Lab asks for one
        accept = dialog.locator(".jp-mod-accept").last
        page.add_locator_handler(dialog, lambda: accept.click(), no_wait_after=True)
        prompts = page.locator(".jp-CodeCell .jp-InputArea-prompt")
        run_all(page, prompts.first)
        ended = prompts.last.filter(has_text=HAS_RUN).or_(page.locator(ERROR))
        ended.first.wait_for(state="attached", timeout=300_000)
        return page

    return run_notebook


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


def text(page):
    """The text of the notebook's Markdown cells, as it is rendered."""
    return "\n".join(page.locator(".jp-MarkdownCell .jp-RenderedMarkdown").all_inner_texts())


def claims_shown(page):
    """Lines of visible code that claim something; Lab folds a cell some time after it is drawn."""
    for _ in range(60):
        shown = page.locator(".jp-CodeCell .jp-InputArea:visible").all_inner_texts()
        lines = [line for code in shown for line in code.splitlines()]
        found = [line for line in lines if line.startswith("claim(")]
        if not found:
            break
        page.wait_for_timeout(1000)
    return found


@pytest.mark.timeout(480)
@pytest.mark.parametrize("name", LESSONS)
def test_a_lesson_runs_in_jupyterlab_reads_as_on_the_page_and_its_sliders_compute(run, name):
    page = run(f"1_lessons/{name}.ipynb")
    assert page.locator(ERROR).all_inner_texts() == []
    words = text(page)
    assert not ROLE.search(words)
    own = page.locator("span.claim[title]:not([title*='.'])")
    playwright.expect(own.filter(has_text="…")).to_have_count(0, timeout=60_000)
    assert not claims_shown(page)
    buttons = page.locator(".lite-button strong").all()
    assert len(buttons) == words.count("Predict.")
    for button in buttons:
        button.click()
    boxes = page.locator(".jp-OutputArea-output:has(.noUi-handle)")
    assert boxes.count() > 0
    for box in boxes.all():
        box.scroll_into_view_if_needed()
        picture = box.locator("img:visible").first
        before = picture.get_attribute("src")
        box.locator(".noUi-handle").first.press("ArrowRight")
        playwright.expect(picture).not_to_have_attribute("src", before, timeout=30_000)


@pytest.mark.timeout(480)
def test_a_lesson_reads_as_on_the_page(run):
    page = run("small.ipynb")
    playwright.expect(page.locator("span.claim").first).to_have_text("11")
    words = text(page)
    assert not ROLE.search(words)
    assert "It takes 11 steps (Li and Todorov, 2004), by (1.1) and another." in words
    playwright.expect(page.locator(".jp-MathJax-CHTML, mjx-container").first).to_be_visible()


@pytest.mark.timeout(480)
def test_code_claims_and_answers_are_folded_and_an_answer_opens_by_one_click(run):
    page = run("small.ipynb")
    shown = page.locator(".jp-CodeCell:not(.lm-mod-hidden) .jp-InputArea:visible")
    assert "linspace" in shown.all_inner_texts()[0]
    claims = page.locator(".lite-hold:visible")
    playwright.expect(claims).to_have_text(["1 claim holds"])
    assert page.get_by_text("equal to 11").is_hidden()
    answer = page.locator(".jp-RenderedMarkdown").get_by_text("It is below it: yes.")
    assert answer.is_hidden()
    page.locator(".lite-button strong").click()
    playwright.expect(answer).to_be_visible()
    playwright.expect(page.get_by_text("tensor(")).to_be_visible()
    page.locator(".lite-button strong").click()
    playwright.expect(answer).to_be_hidden()


@pytest.mark.timeout(480)
def test_a_readers_own_number_is_in_the_text_and_says_where_it_is_not_as_claimed(run):
    page = run("changed.ipynb")
    number = page.locator("span.claim").first
    playwright.expect(number).to_have_text("5")
    playwright.expect(number).to_have_class(re.compile("lite-fails"))
    playwright.expect(page.locator(ERROR).filter(has_text="claimed: equal to 11")).to_be_visible()
    playwright.expect(page.locator(".jupyter-widgets img.picture")).to_be_visible()  # ran on


HEADING_ERROR = """\
def heading_error(theta, theta_ref):
    difference = {difference}
    return torch.atan2(difference.sin(), difference.cos())
"""


@pytest.mark.timeout(480)
def test_an_exercise_is_solved_and_accepted_and_broken_and_told_why(run):
    page = run("2_exercises/01_systems.ipynb")
    cells = page.locator(".jp-CodeCell")
    stub = cells.filter(has_text="def heading_error(theta, theta_ref)")
    verdict = cells.filter(has_text='check("1.1", heading_error)').locator(".jp-OutputArea-output")
    playwright.expect(verdict).to_have_text("… 1.1 The shorter way around: not done yet.")

    def answer(difference):
        stub.locator(".cm-content").click()
        page.keyboard.press("ControlOrMeta+A")
        page.keyboard.insert_text(HEADING_ERROR.format(difference=difference))
        page.keyboard.press("Shift+Enter")
        page.keyboard.press("Shift+Enter")

    answer("theta - theta_ref")
    accepted = "✓ 1.1 The shorter way around: accepted."
    playwright.expect(verdict).to_have_text(accepted, timeout=30_000)
    answer("theta_ref - theta")
    told = re.compile(r"✗ 1\.1 .*Expected the error.*Hint: The sign is the other way round", re.S)
    playwright.expect(verdict).to_have_text(told, timeout=30_000)
