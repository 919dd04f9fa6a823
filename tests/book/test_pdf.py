"""The book on paper: links lead to their pages, and nothing stays folded."""

import base64
import io
import subprocess
import sys

import pytest
from bs4 import BeautifulSoup
from PIL import Image

from pypose_lite.teaching.site import contents, pdf, pdf_pages

TOC = """\
root: one
parts:
- caption: The book
  chapters:
  - {file: two, sections: [{file: labs/two}]}
"""
STATE = """{"state": {
  "box": {"state": {"children": ["IPY_MODEL_slider", "IPY_MODEL_stack"]}},
  "slider": {"state": {"value": 3}},
  "stack": {"state": {"children": ["IPY_MODEL_a", "IPY_MODEL_b"], "selected_index": 1}},
  "a": {"state": {"value": "<img alt='a' src='data:image/png;base64,'>"}},
  "b": {"state": {"value": "<img alt='b' src='data:image/png;base64,'>"}}}}"""
VIEW = '<script type="application/vnd.jupyter.widget-view+json">{"model_id": "box"}</script>'
PAGE = """\
<html><head><script type="application/vnd.jupyter.widget-state+json">{state}</script></head>
<body><nav>Sidebar</nav><article><section id="{name}"><h1>Page {name}</h1>{body}
<h2 id="summary">Summary of {name}</h2><p>Nothing.</p></section></article></body></html>
"""
ONE = """\
<p><a href="two.html#summary">The summary of two</a>, <a href="labs/two.html">its lab</a>,
<a href="#summary">our own</a>, <a href="_sources/one.ipynb">a file</a>,
<a href="https://example.org/">far away</a>.</p>
<details class="answer"><summary>Open the answer</summary><p>Forty-two.</p></details>
"""


@pytest.fixture
def site(tmp_path, monkeypatch):
    """The folder of a small site that was built."""
    monkeypatch.setattr(contents, "of", lambda: TOC)
    long = "<p>Words.</p>" * 80
    back = '<p><a href="../one.html#summary">Back</a></p>'
    (tmp_path / "labs").mkdir()
    for name, body in {"one": ONE, "two": VIEW + long, "labs/two": back}.items():
        text = PAGE.format(name=name, body=body, state=STATE)
        (tmp_path / f"{name}.html").write_text(text, encoding="utf-8")
    return tmp_path


@pytest.fixture
def paper(site, tmp_path, browser):
    """The same site, printed, as pypdf reads it."""
    pypdf = pytest.importorskip("pypdf")
    pages = pdf.printed(site, tmp_path / "out" / "book.pdf", browser)
    reader = pypdf.PdfReader(tmp_path / "out" / "book.pdf")
    assert len(reader.pages) == pages
    return reader


def links(reader):
    """Where each link within the file leads: the page that it is on, and the page it leads to."""
    for number, page in enumerate(reader.pages):
        for annotation in page.get("/Annots", []):
            annotation = annotation.get_object()
            if name := annotation.get("/Dest"):
                place = reader.named_destinations[name]
                yield number, reader.get_destination_page_number(place)


def page_with(reader, words, after=2):
    """The number, from 0, of the one page after the contents that has these words."""
    [found] = [
        number
        for number, page in enumerate(reader.pages)
        if number >= after and words in page.extract_text()
    ]
    return found


def test_links_lead_to_the_right_one_of_pages_with_the_same_sections(paper):
    first, second, lab = (page_with(paper, f"Page {name}") for name in ("one", "two", "labs/two"))
    summary = page_with(paper, "Summary of two")
    assert first < second < summary < lab  # page two has more than one sheet
    from_one = [there for here, there in links(paper) if here == first]
    assert from_one == [summary, lab, first]
    assert [there for here, there in links(paper) if here == lab] == [first]


def test_the_contents_give_the_page_on_which_each_page_begins(paper):
    text = paper.pages[1].extract_text()
    for name in ("one", "two", "labs/two"):
        number = page_with(paper, f"Page {name}")
        assert f"Page {name}{number + 1}" in "".join(text.split("\n")).replace(f"{name} ", name)
    assert [there for here, there in links(paper) if here == 1] == [
        page_with(paper, f"Page {name}") for name in ("one", "two", "labs/two")
    ]


def test_nothing_stays_folded_and_sidebars_are_left_out(paper):
    text = "".join(page.extract_text() for page in paper.pages)
    assert "Forty-two." in text and "Answer" in text and "Open the answer" not in text
    assert "Sidebar" not in text


def test_links_to_files_outside_the_book_become_text_and_those_to_the_web_stay(site):
    tree = BeautifulSoup(pdf_pages.whole(site), "html.parser").find("article", id="one")
    assert "a file" in tree.get_text()
    assert [link["href"] for link in tree.find_all("a")] == [
        "#two--summary",
        "#labs-two",
        "#one--summary",
        "https://example.org/",
    ]


def test_a_slider_becomes_the_picture_that_it_shows_at_first(site):
    tree = BeautifulSoup(pdf_pages.whole(site), "html.parser").find("article", id="two")
    assert [image["alt"] for image in tree.find_all("img")] == ["b"]
    assert pdf_pages.SLIDER in tree.get_text()


def test_a_film_stands_still_at_its_end(tmp_path):
    red, blue = (Image.new("RGB", (8, 8), color) for color in ("red", "blue"))
    buffer = io.BytesIO()
    red.save(buffer, "gif", save_all=True, append_images=[blue])
    source = f"data:image/gif;base64,{base64.b64encode(buffer.getvalue()).decode()}"
    still = pdf_pages.picture(tmp_path, "one", source)
    data = base64.b64decode(still.removeprefix("data:image/png;base64,"))
    assert Image.open(io.BytesIO(data)).getpixel((4, 4)) == (0, 0, 255)


@pytest.mark.skipif(not pdf.chromium(), reason="no browser: install chromium")
def test_a_site_that_is_not_built_is_said_in_a_line(tmp_path):
    command = [sys.executable, "-m", pdf.__name__, tmp_path, tmp_path / "book.pdf"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60)
    assert done.returncode == 1
    [line] = done.stderr.splitlines()
    assert line.startswith("pypose_lite: ") and line.endswith("build the site first (make site)")


def test_a_machine_without_a_browser_is_told_what_to_do(monkeypatch):
    monkeypatch.setattr(pdf, "chromium", lambda: None)
    with pytest.raises(ValueError, match="no browser: install chromium"), pdf.browser():
        pass
