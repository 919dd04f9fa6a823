"""Slides: whatever they say of a chapter is the chapter's, and each fits on its screen."""

import re
import shutil
import subprocess
import sys
from dataclasses import asdict
from pathlib import Path

import nbformat
import pytest
from bs4 import BeautifulSoup
from nbformat.v4 import new_code_cell, new_markdown_cell, new_notebook, new_output

from pypose_lite.teaching.claims import Claim
from pypose_lite.teaching.site import slides
from pypose_lite.teaching.site.scoreboard import gather

ROOT = Path(__file__).parents[2]
EXECUTED = ROOT / "build" / "executed"
NPM = ROOT / "build" / "npm"
DECKS = sorted((ROOT / "book" / "slides").glob("*.md"))
TEXT = """\
Look at $x$.

$$
y = x^2
$$ (eq-3-square)
"""
CODE = """\
dt = 0.1


class Car:
    def step(self, x):
        return x + dt  # (3.1)


def drive(car):
    return car.step(0)
"""
IMAGE = '<img class="picture" alt="A curve that rises." src="data:image/png;base64,">'


def output(data, metadata=None):
    """What a cell displayed."""
    return new_output("display_data", data=data, metadata=metadata or {})


def claimed(value):
    """What a cell that claims a length leaves."""
    return output({}, {"claim": asdict(Claim("way", value, "below 1 m", "m"))})


@pytest.fixture
def small(tmp_path):
    """A chapter as it was executed, and a function that makes its deck from a text."""
    shown = [output({"text/html": IMAGE}), output({"text/markdown": "| a | b (m) |\n|:-|-:|\n"})]
    slider = {"state": {"m": {"state": {"value": IMAGE.replace("rises", "falls")}}}}

    def make(text, way=0.0543):
        cells = [new_markdown_cell(TEXT), new_code_cell(CODE, outputs=[*shown, claimed(way)])]
        notebook = new_notebook(cells=cells, metadata={"widgets": {"state": slider}})
        for folder in ("executed", "decks"):
            (tmp_path / folder).mkdir(exist_ok=True)
        nbformat.write(notebook, tmp_path / "executed" / "03_mpc.ipynb")
        deck = tmp_path / "decks" / "03_mpc.md"
        deck.write_text(text, encoding="utf-8")
        page = slides.deck(deck, tmp_path / "executed", gather(tmp_path / "executed"))
        return BeautifulSoup(page, "html.parser")

    return make


def test_a_number_on_a_slide_is_the_chapters(small):
    text = "It drives {claim}`way`, and {claim}`03_mpc.way`."
    assert "It drives 0.0543 m, and 0.0543 m." in small(text).section.get_text()
    assert "It drives 0.25 m, and 0.25 m." in small(text, way=0.25).section.get_text()


def test_figures_of_the_page_and_of_sliders_are_found_by_how_their_texts_begin(small):
    page = small("{figure}`A curve that r`\n\n---\n\n{figure}`A curve that falls`\n")
    assert [image["alt"] for image in page.find_all("img")] == [
        "A curve that rises.",
        "A curve that falls.",
    ]


def test_equations_keep_the_chapters_numbers_and_tables_their_head(small):
    page = small("{equation}`eq-3-square`\n\nSee {eq}`eq-3-square`.\n\n{table}`a | b`\n")
    assert re.search(r"\\\[\s*y = x\^2 \\tag\{3\.1\}\s*\\\]", page.section.get_text())
    assert "See (3.1)." in page.section.get_text()
    assert [cell.get_text() for cell in page.find_all("th")] == ["a", "b (m)"]


def test_code_is_quoted_whole_with_the_comments_at_its_ends(small):
    page = small("{code}`dt, Car.step`\n\n{code}`drive`\n")
    first, second = (block.get_text() for block in page.find_all("pre"))
    assert first == "dt = 0.1\n\ndef step(self, x):\n    return x + dt  # (3.1)\n"
    assert second == "def drive(car):\n    return car.step(0)\n"


def test_what_the_speaker_says_is_no_part_of_the_slide(small):
    page = small("# One\n\nSeen.\n\nNote:\nSaid.\n\n---\n\nTwo.\n")
    first, second = page.find_all("section")
    assert first.find("aside", class_="notes").extract().get_text().strip() == "Said."
    assert first.get_text().split() == ["One", "Seen."]
    assert not second.find("aside")


@pytest.mark.parametrize(
    ("reference", "message"),
    [
        ("{claim}`wey`", "the chapter has no claim 'wey'; near names: way"),
        ("{figure}`A curve that bends`", "the chapter has no figure 'A curve that bends'; near"),
        ("{figure}`A curve`", "2 of the chapter's figures begin with 'A curve': say more"),
        ("{code}`drive, Cat`", "the chapter has no code 'Cat'; near names: Car"),
        ("{eq}`eq-3-sqare`", "the chapter has no eq 'eq-3-sqare'; near names: eq-3-square"),
        ("{picture}`A curve`", "{picture} is no reference that slides have; expected one of claim"),
        ("0.0543 m", "prose states '0.0543 m'. Measured: let a cell claim it"),
    ],
)
def test_a_wrong_reference_is_an_error_with_file_line_and_near_names(small, reference, message):
    with pytest.raises(slides.Faults) as error:
        small(f"# Title\n\nIt is {reference}.\n")
    [line] = str(error.value).splitlines()
    assert re.fullmatch(r".*03_mpc\.md:3: " + re.escape(message) + ".*", line)


def test_a_wrong_deck_ends_the_command_with_one_line(small, tmp_path):
    small("")
    (tmp_path / "decks" / "03_mpc.md").write_text("{claim}`wey`", encoding="utf-8")
    folders = [tmp_path / name for name in ("executed", "decks", "made")]
    command = [sys.executable, "-m", slides.__name__, *folders]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120)
    assert done.returncode == 1
    [line] = done.stderr.splitlines()
    assert line.endswith("03_mpc.md:1: the chapter has no claim 'wey'; near names: way")


def test_the_deck_of_a_chapter_that_is_gone_goes(small, tmp_path):
    small("# Title\n")
    (tmp_path / "made").mkdir()
    (tmp_path / "made" / "old.html").touch()
    slides.decks(*(tmp_path / name for name in ("executed", "decks", "made")))
    assert [path.name for path in (tmp_path / "made").glob("*.html")] == ["03_mpc.html"]


def executed(path):
    """Whether the chapter of a deck was executed here."""
    return (EXECUTED / f"{path.stem}.ipynb").exists()


def test_every_chapter_has_a_deck_of_ten_to_fifteen_slides():
    chapters = [path.stem for path in sorted((ROOT / "book").glob("[0-9][0-9]_*.py"))]
    assert [path.stem for path in DECKS] == chapters
    for path in DECKS:
        parts = slides.PARTS.split(path.read_text(encoding="utf-8"))
        assert 10 <= len(parts) <= 16, path.name
        assert sum("\nNote:\n" in part for part in parts) >= 10, path.name


@pytest.mark.parametrize("path", DECKS, ids=lambda path: path.stem)
def test_a_deck_of_the_book_fits_its_screen_and_asks_nothing_of_the_network(path, page, tmp_path):
    if not executed(path) or not (NPM / "slides").exists():
        pytest.skip("the chapters are not executed: make slides")
    shutil.copytree(NPM / "slides", tmp_path / "static")
    shutil.copy(NPM / "static" / "tex-svg-full.js", tmp_path / "static")
    shutil.copy(slides.LAYOUT / "slides.css", tmp_path / "static")
    deck = tmp_path / "deck.html"
    deck.write_text(slides.deck(path, EXECUTED, gather(EXECUTED)), encoding="utf-8")
    asked, errors = [], []
    page.on("request", lambda request: asked.append(request.url))
    page.on("pageerror", lambda error: errors.append(str(error)))
    page.set_viewport_size({"width": 1280, "height": 720})
    page.goto(deck.as_uri())
    page.evaluate("MathJax.startup.promise")
    assert not [url for url in asked if not url.startswith(("file:", "data:"))]
    assert errors == []
    assert page.locator("[data-mjx-error]").count() == 0
    for number in range(page.evaluate("Reveal.getTotalSlides()")):
        page.evaluate(f"Reveal.slide({number})")
        right, bottom, figure = page.evaluate(EDGES)
        assert right <= 1280 and bottom <= 705, f"slide {number + 1} is too full"
        assert figure is None or figure > 200, f"slide {number + 1} leaves its figure no room"


EDGES = """() => {
  const slide = Reveal.getCurrentSlide();
  const parts = [...slide.children].filter((part) => !part.matches('aside'));
  const boxes = parts.map((part) => part.getBoundingClientRect());
  return [Math.max(slide.scrollWidth, ...boxes.map((box) => box.right)),
          Math.max(...boxes.map((box) => box.bottom)),
          slide.querySelector('figure')?.clientHeight ?? null];
}"""


def test_a_deck_prints_one_sheet_a_slide_and_keeps_its_figures(small, page, tmp_path):
    pypdf = pytest.importorskip("pypdf")
    if not (NPM / "slides").exists():
        pytest.skip("what shows slides is not there: make slides")
    shutil.copytree(NPM / "slides", tmp_path / "static")
    shutil.copy(slides.LAYOUT / "slides.css", tmp_path / "static")
    deck = tmp_path / "deck.html"
    deck.write_text(
        str(small("# One\n\n---\n\n{figure}`A curve that r`\n\n---\n\nThree\n")), "utf-8"
    )
    page.goto(f"{deck.as_uri()}?print-pdf")
    page.wait_for_selector(".pdf-page")
    page.pdf(path=tmp_path / "deck.pdf", prefer_css_page_size=True)
    assert len(pypdf.PdfReader(tmp_path / "deck.pdf").pages) == 3
    assert page.locator("figure").bounding_box()["height"] > 400
