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
from bs4 import BeautifulSoup

from pypose_lite.teaching.site import contents
from pypose_lite.teaching.site.pages import notebooks
from pypose_lite.teaching.site.stage import all_equations

ROOT = Path(__file__).parents[2]
HTML = ROOT / "build" / "site" / "_build" / "html"
NAMES = contents.names()
CHAPTERS = [name for name in NAMES if name in notebooks()]
LESSONS = [name for name in CHAPTERS if "/" not in name]
ROLE = re.compile(r"\{[\w:-]+\}`|:::|<!--")
UNFOLD = "document.querySelectorAll('details').forEach((fold) => (fold.open = true))"

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
    return BeautifulSoup(path.read_text(encoding="utf-8"), "html.parser")


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
    assert not ROLE.search(article.get_text())


@pytest.mark.parametrize("name", CHAPTERS)
def test_every_chapter_is_there_as_a_notebook_with_outputs(name):
    page = HTML / f"{name}.html"
    [link] = [link for link in inner_links(page) if link.endswith(".ipynb")]
    notebook = nbformat.read(page.parent / link, as_version=4)
    source = jupytext.read(notebooks()[name])
    assert [cell.source for cell in notebook.cells if cell.cell_type == "code"] == [
        cell.source for cell in source.cells if cell.cell_type == "code"
    ]
    assert any(cell.get("outputs") for cell in notebook.cells)
    texts = [cell.source for cell in notebook.cells if cell.cell_type == "markdown"]
    assert not any(ROLE.search(re.sub(r"`.*?`", "", text)) for text in texts)


def test_the_scoreboard_has_every_claim_of_every_chapter():
    paper, *chapters = soup(HTML / "scoreboard.html").find("article").find_all("table")
    rows = [row for table in chapters for row in table.find_all("tr")[1:]]
    claims = sum(
        notebooks()[name].read_text(encoding="utf-8").count("\nclaim(") for name in CHAPTERS
    )
    assert len(rows) >= claims > 0
    assert 0 < len(paper.find_all("tr")) < len(rows) / 5


def test_the_scoreboard_leads_to_the_cell_of_each_claim():
    for link in soup(HTML / "scoreboard.html").find("article").find("table").find_all("a"):
        page, name = link["href"].split("#")
        assert soup(HTML / page).find(id=name), link


@pytest.mark.parametrize("name", LESSONS)
def test_answers_are_folded_with_all_that_belongs_to_them(name):
    answers = soup(HTML / f"{name}.html").find_all("details", class_="answer")
    asked = notebooks()[name].read_text(encoding="utf-8").count("**Predict.**")
    assert len(answers) == asked
    for answer in answers:
        assert answer.find("div", class_="cell") and not answer.has_attr("open")


@pytest.mark.parametrize("name", LESSONS)
def test_every_picture_says_in_words_what_it_shows(name):
    pictures = soup(HTML / f"{name}.html").find("article").find_all("img")
    assert all(picture.get("alt", "").strip() for picture in pictures)


@pytest.mark.parametrize("name", CHAPTERS)
def test_the_notebook_has_the_equation_numbers_of_the_page(name):
    source = notebooks()[name].read_text(encoding="utf-8")
    for label, number in all_equations().items():
        if f"({label})" in source:
            equation = soup(HTML / f"{name}.html").find(id=f"equation-{label}")
            assert f"({number})" in equation.get_text()


def test_the_site_has_the_title_of_the_book_and_a_logo():
    brand = soup(HTML / "index.html").find(class_="navbar-brand")
    assert brand.get_text().strip() == "Robot motion on one infinity"
    assert (HTML / brand.find("img")["src"]).exists()


@pytest.mark.parametrize("name", NAMES)
def test_a_phone_shows_a_page_without_scrolling_sideways(name, page):
    page.set_viewport_size({"width": 390, "height": 844})
    page.goto((HTML / f"{name}.html").as_uri())
    page.evaluate(UNFOLD)
    assert page.evaluate("document.documentElement.scrollWidth") <= 390


def drawn(page):
    """The page's widgets, once all are unfolded, drawn and typeset: a slider and a picture."""
    page.evaluate(UNFOLD)
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
