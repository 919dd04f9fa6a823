"""Slides: one deck a chapter, shown by reveal.js in a browser, without a network.

``python -m pypose_lite.teaching.site.slides build/executed book/slides build/slides``

A deck is a Markdown file with the name of its chapter. ``---`` on a line of its own ends a slide,
``Note:`` begins what only the speaker sees. Whatever the chapter has is referred to, not copied:
``{claim}`name```, ``{figure}`how its alternative text begins```, ``{table}`how its head begins```,
``{equation}`label```, ``{eq}`label``` for its number, ``{code}`function, other``` and
``{cite}`key```. A reference to what is not there ends the build, and so does a measured number
that is typed, as in a chapter's prose.
"""

import html
import re
import shutil
import sys
from collections.abc import Iterator
from pathlib import Path
from string import Template

import nbformat
from markdown_it import MarkdownIt
from mdit_py_plugins.dollarmath import dollarmath_plugin
from pygments import highlight
from pygments.formatters import HtmlFormatter
from pygments.lexers import PythonLexer

from ..proofread.prose import measured_numbers
from .plain import ROLE
from .scoreboard import Claims, gather
from .slides_source import Names, names_of, resolve

LAYOUT = Path(__file__).parent / "layout"
PARTS = re.compile(r"^---[ \t]*\n", re.MULTILINE)
NOTE = re.compile(r"^Note:[ \t]*\n", re.MULTILINE)
COMMENT = re.compile(r"[ \t]*<!--.*?-->", re.DOTALL)
STYLE = HtmlFormatter(noclasses=True, nowrap=True)


class Faults(ValueError):
    """What is wrong with a deck, a line for each fault."""


def decks(executed: Path, source: Path, target: Path) -> list[Path]:
    """Makes a page of every deck in a folder; returns their paths.

    Raises:
        Faults: decks refer to what their chapters do not have.
    """
    claims, faults, made = gather(executed), [], []
    (target / "static").mkdir(parents=True, exist_ok=True)
    for path in sorted(source.glob("*.md")):
        try:
            text = deck(path, executed, claims)
        except Faults as error:
            faults.append(str(error))
            continue
        made.append(target / f"{path.stem}.html")
        made[-1].write_text(text, encoding="utf-8")
    if faults:
        raise Faults("\n".join(faults))
    shutil.copy(LAYOUT / "slides.css", target / "static")
    for path in {*target.glob("*.html")} - {*made}:
        path.unlink()  # the deck of a chapter that the book no longer has
    return made


def deck(path: Path, executed: Path, claims: Claims) -> str:
    """The page of one deck."""
    notebook = executed / f"{path.stem}.ipynb"
    if not notebook.exists():
        raise Faults(f"{shown(path)}: there is no executed chapter {notebook}: make chapters")
    names = names_of(nbformat.read(notebook, as_version=4), path.stem, claims)
    text = path.read_text(encoding="utf-8")
    if faults := [*typed(text, path)]:
        raise Faults("\n".join(faults))
    slides = PARTS.split(COMMENT.sub("", filled(text, path, names)))
    title = re.search(r"^# (.+)$", text, re.MULTILINE)
    page = Template((LAYOUT / "slides.html").read_text(encoding="utf-8"))
    return page.substitute(
        title=html.escape(title[1] if title else path.stem),
        slides="\n".join(section(slide) for slide in slides),
    )


def filled(text: str, path: Path, names: Names) -> str:
    """The deck with all that its references stand for."""
    faults = []

    def follow(found: re.Match) -> str:
        try:
            return resolve(found[1], " ".join(found[2].split()), names)
        except ValueError as error:
            line = text.count("\n", 0, found.start()) + 1
            faults.append(f"{shown(path)}:{line}: {error}")
            return ""

    text_filled = ROLE.sub(follow, text)
    if faults:
        raise Faults("\n".join(faults))
    return text_filled


def typed(text: str, path: Path) -> Iterator[str]:
    """Complaints about measured numbers that stand in the text itself, by the rule for chapters."""
    cell = nbformat.v4.new_markdown_cell(text)
    for fault in measured_numbers(nbformat.v4.new_notebook(cells=[cell])):
        yield f"{shown(path)}:{fault.line + 1}: {fault.text}"


def shown(path: Path) -> str:
    """The path as complaints name it: from where we are, if it lies below."""
    return str(path.relative_to(Path.cwd()) if path.is_relative_to(Path.cwd()) else path)


def section(slide: str) -> str:
    """One slide as HTML, with what its speaker says."""
    text, *notes = NOTE.split(slide, maxsplit=1)
    said = f'<aside class="notes">{markdown().render(notes[0])}</aside>' if notes else ""
    return f"<section>{markdown().render(text)}{said}</section>"


def markdown() -> MarkdownIt:
    """What turns Markdown into HTML; mathematics is left to MathJax."""
    reader = MarkdownIt("commonmark", {"highlight": coloured}).enable("table")
    return dollarmath_plugin_on(reader)


def dollarmath_plugin_on(reader: MarkdownIt) -> MarkdownIt:
    """The reader with ``$..$`` and ``$$..$$``, in the delimiters that MathJax looks for."""
    inline, block = "\\({}\\)", "\\[{}\\]"

    def render(body: str, options: dict) -> str:
        return (block if options["display_mode"] else inline).format(html.escape(body))

    return reader.use(dollarmath_plugin, renderer=render, allow_space=True, double_inline=True)


def coloured(code: str, language: str, _attributes: str) -> str:
    """Code in colours."""
    return highlight(code, PythonLexer(), STYLE) if language == "python" else ""


if __name__ == "__main__":
    try:
        made = decks(*map(Path, sys.argv[1:4]))
    except (Faults, ValueError) as error:
        sys.exit(str(error))
    for path in made:
        print(f"{path.stem}: {path.read_text(encoding='utf-8').count('<section>')} slides")
