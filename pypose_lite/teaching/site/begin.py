"""Begins a tutorial: a lesson that passes its checks, to be rewritten piece by piece."""

import re
from datetime import date
from pathlib import Path

from .pages import BOOK, ROOT

TEMPLATE = Path(__file__).parent / "template"
LESSON = TEMPLATE / "lesson.py"
BESIDE = {  # what a book has once
    ROOT / "_config.yml": TEMPLATE / "_config.yml",
    ROOT / "_toc.yml": TEMPLATE / "_toc.yml",
    BOOK / "glossary.md": TEMPLATE / "glossary.md",
    BOOK / "references.bib": TEMPLATE / "references.bib",
}


def begin(name: str) -> None:
    """Writes NAME.py, and what a new book lacks; nothing that is there is written over.

    Raises:
        ValueError: the name cannot be one of a page, or there is such a tutorial.
    """
    if not re.fullmatch(r"[a-z0-9]\w*", name):
        raise ValueError(f"name: expected letters, digits, underscores, got {name!r}")
    path = BOOK / f"{name}.py"
    if path.exists():
        raise ValueError(f"{path} exists already; choose another name")
    new_book = not (ROOT / "_toc.yml").exists()
    for target, source in {path: LESSON, **BESIDE}.items():
        if not target.exists():
            text = source.read_text(encoding="utf-8")
            text = text.replace("NAME", name).replace("YEAR", str(date.today().year))
            target.write_text(text, encoding="utf-8")
            print(f"wrote {target.relative_to(ROOT)}")
    if not new_book:
        print(f"Add it to _toc.yml, where it belongs:  - file: {name}")
    print(f"Check it:  pytest {path.relative_to(ROOT)}")
    print("Build it:  python -m pypose_lite.teaching.site build")
