"""The whole book as one PDF, printed by a headless Chromium.

``python -m pypose_lite.teaching.site.pdf build/site/_build/html build/book.pdf``

Links between pages lead to the right page of the file, and the contents say which it is. Chromium
is the one on the path, or that which the variable CHROMIUM names.
"""

import os
import shutil
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from .pdf_pages import whole

NAMES = "chromium", "chromium-browser", "google-chrome"
FLAGS = (
    "--no-sandbox --disable-gpu --disable-background-networking --disable-component-update "
    "--disable-sync --no-first-run --disable-quic"
).split()
MINUTES = 10  # that MathJax may take for all of the book
FOOTER = (
    '<div style="width: 100%; font-size: 8px; text-align: center; color: #555">'
    '<span class="pageNumber"></span></div>'
)
PAPER = {
    "format": "A4",
    "margin": {"top": "18mm", "bottom": "18mm", "left": "18mm", "right": "18mm"},
    "print_background": True,
    "display_header_footer": True,
    "header_template": "<span></span>",
    "footer_template": FOOTER,
    "outline": True,
    "tagged": True,
}
FILL = """(pages) => document.querySelectorAll('[data-page]').forEach(
  (room) => (room.textContent = pages[room.dataset.page] ?? ''))"""


def chromium() -> str | None:
    """Where the browser is, or nothing."""
    return os.environ.get("CHROMIUM") or next(filter(None, map(shutil.which, NAMES)), None)


@contextmanager
def browser() -> Iterator[Any]:
    """A headless Chromium.

    Raises:
        ValueError: there is none, or no playwright to drive it.
    """
    try:
        from playwright.sync_api import sync_playwright
    except ImportError:
        raise ValueError("printing needs playwright: pip install 'pypose_lite[test]'") from None
    if (path := chromium()) is None:
        raise ValueError("no browser: install chromium, or name one in the variable CHROMIUM")
    with sync_playwright() as playwright:
        running = playwright.chromium.launch(executable_path=path, args=FLAGS)
        yield running
        running.close()


def printed(html: Path, target: Path, running: Any) -> int:
    """Prints the site in a folder into a PDF, by a running browser; returns how many pages it has.

    It is printed twice: the pages' numbers, which the contents give, are known after the first.
    """
    target.parent.mkdir(parents=True, exist_ok=True)
    source = target.with_suffix(".html").resolve()
    source.write_text(whole(html), encoding="utf-8")
    page = running.new_page()
    page.set_default_timeout(MINUTES * 60_000)
    page.goto(source.as_uri(), wait_until="load")
    page.evaluate("window.MathJax?.startup?.promise")
    page.pdf(path=target, **PAPER)
    page.evaluate(FILL, begins(target))
    page.pdf(path=target, **PAPER)
    page.close()
    source.unlink()
    return len(_reader(target).pages)


def begins(path: Path) -> dict[str, int]:
    """On which page, from 1, each place that a link leads to is found in a PDF."""
    reader = _reader(path)
    places = reader.named_destinations
    return {
        name.lstrip("/"): 1 + number
        for name, place in places.items()
        if (number := reader.get_destination_page_number(place)) is not None
    }


def _reader(path: Path) -> Any:
    """The PDF as pypdf reads it."""
    try:
        from pypdf import PdfReader
    except ImportError:
        raise ValueError("printing needs pypdf: pip install 'pypose_lite[test]'") from None
    return PdfReader(path)


if __name__ == "__main__":
    try:
        with browser() as running:
            count = printed(Path(sys.argv[1]), Path(sys.argv[2]), running)
    except ValueError as error:
        sys.exit(f"pypose_lite: {error}")
    print(f"{count} pages: {Path(sys.argv[2]).resolve().as_uri()}")
