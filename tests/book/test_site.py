"""The built site (``make site``): every link leads somewhere, and every page works offline."""

import re
import threading
from functools import cache, partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from urllib.parse import unquote, urlparse

import jupytext
import nbformat
import pytest
import yaml
from bs4 import BeautifulSoup

ROOT = Path(__file__).parents[2]
HTML = ROOT / "build" / "site" / "_build" / "html"
TOC = yaml.safe_load((ROOT / "_toc.yml").read_text())
NAMES = [TOC["root"], *(c["file"] for part in TOC["parts"] for c in part["chapters"])]
CHAPTERS = [name for name in NAMES if (ROOT / "book" / f"{name}.py").exists()]

playwright = pytest.importorskip("playwright.sync_api")
pytestmark = pytest.mark.skipif(not HTML.exists(), reason="the site is not built: make site")


class Quiet(SimpleHTTPRequestHandler):
    """A file server that does not log."""

    def log_message(self, *_):
        """Says nothing."""


@pytest.fixture(scope="module")
def server():
    """The site's address while it is served on this machine."""
    with ThreadingHTTPServer(("127.0.0.1", 0), partial(Quiet, directory=str(HTML))) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        yield f"http://127.0.0.1:{server.server_port}"
        server.shutdown()


@cache
def soup(path):
    """The page as a tree."""
    return BeautifulSoup(path.read_text(), "html.parser")


def inner_links(path):
    """All links and sources of a page that stay within the site."""
    tags = soup(path).find_all(["a", "link", "script", "img"])
    links = [tag.get("href") or tag.get("src") or "" for tag in tags]
    return [link for link in links if not urlparse(link).scheme and not link.startswith("//")]


@pytest.mark.parametrize("name", NAMES)
def test_every_link_leads_somewhere(name):
    page = HTML / f"{name}.html"
    for link in inner_links(page):
        url = urlparse(link)
        target = (page.parent / unquote(url.path)) if url.path else page
        assert target.exists(), link
        if url.fragment and target.suffix == ".html":
            assert soup(target.resolve()).find(id=unquote(url.fragment)), link


@pytest.mark.parametrize("name", NAMES)
def test_nothing_is_left_to_fill_in(name):
    article = soup(HTML / f"{name}.html").find("article")
    for code in article.find_all(["pre", "code"]):
        code.clear()
    assert not re.search(r"\{claim\}|\{cite\}|\{eq\}|<!--", article.get_text())


@pytest.mark.parametrize("name", CHAPTERS)
def test_every_chapter_is_there_as_a_notebook_with_outputs(name):
    [link] = [link for link in inner_links(HTML / f"{name}.html") if link.endswith(".ipynb")]
    notebook = nbformat.read(HTML / link, as_version=4)
    source = jupytext.read(ROOT / "book" / f"{name}.py")
    assert [cell.source for cell in notebook.cells if cell.cell_type == "code"] == [
        cell.source for cell in source.cells if cell.cell_type == "code"
    ]
    assert any(cell.get("outputs") for cell in notebook.cells)
    assert all("{claim}`" not in cell.source.replace("`{", "") for cell in notebook.cells)


def test_the_scoreboard_has_every_claim_of_every_chapter():
    rows = soup(HTML / "scoreboard.html").find("table").find_all("tr")[1:]
    names = [row.find_all("td")[1].get_text() for row in rows]
    claims = sum((ROOT / "book" / f"{name}.py").read_text().count("\nclaim(") for name in CHAPTERS)
    assert len(names) >= claims > 0


def drawn(page):
    """The page's widgets, once all are drawn and typeset: a slider and a picture each."""
    widgets = page.locator('script[type="application/vnd.jupyter.widget-view+json"]').count()
    boxes = page.locator(".jupyter-widgets.widget-vbox:has(.noUi-handle):has(img)")
    playwright.expect(boxes).to_have_count(widgets, timeout=60_000)
    page.evaluate("() => window.MathJax?.startup?.promise")
    return boxes


@pytest.mark.parametrize("name", NAMES)
def test_a_page_reports_no_error_and_asks_only_its_own_server(name, page, server):
    asked, errors = [], []
    page.on("request", lambda request: asked.append(request.url))
    page.on("pageerror", lambda error: errors.append(str(error)))
    page.on("console", lambda entry: errors.append(entry.text) if entry.type == "error" else None)
    page.goto(f"{server}/{name}.html", wait_until="networkidle")
    drawn(page)
    assert [url for url in asked if not url.startswith((server, "data:", "blob:"))] == []
    assert [error for error in errors if "THEBE_JS_URL" not in error] == []  # the theme's own


@pytest.mark.parametrize("name", CHAPTERS)
def test_a_page_opened_from_a_file_asks_nothing_of_the_network(name, page):
    asked = []
    page.on("request", lambda request: asked.append(request.url))
    page.goto((HTML / f"{name}.html").as_uri(), wait_until="networkidle")
    assert [url for url in asked if not url.startswith(("file:", "data:", "blob:"))] == []


@pytest.mark.parametrize("name", NAMES)
def test_mathematics_is_typeset(name, page):
    page.goto((HTML / f"{name}.html").as_uri())
    formulas = page.locator(".math").count()
    if formulas:
        page.wait_for_function("window.MathJax?.startup?.promise")
        page.evaluate("MathJax.startup.promise")
    assert page.locator("mjx-container").count() >= formulas
    assert page.locator("mjx-merror, [data-mjx-error]").count() == 0


@pytest.mark.parametrize("name", CHAPTERS)
def test_every_widget_is_drawn_and_its_slider_moves_it_without_a_kernel(name, page):
    page.goto((HTML / f"{name}.html").as_uri())
    boxes = drawn(page)
    for box in boxes.all():
        picture = box.locator("img:visible")
        before = picture.get_attribute("src")
        assert box.locator(".noUi-target").first.bounding_box()["width"] > 150  # pixels
        box.locator(".noUi-handle").first.press("ArrowRight")
        playwright.expect(picture).not_to_have_attribute("src", before)
