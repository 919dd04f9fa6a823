"""The pages of the book: which there are, and how they lead to each other.

A page is named by its place on the site: ``03_mpc`` for ``book/03_mpc.py``, ``exercises/03_mpc``
and ``solutions/03_mpc`` for the files in those folders. A small book may do without the folder
``book``: its lessons lie where its ``_toc.yml`` does.
"""

import re
from collections.abc import Callable
from pathlib import Path
from posixpath import dirname, join, normpath, relpath


def root_of(folder: Path) -> Path:
    """The folder of the book in which we are: the nearest one upwards with a ``_toc.yml``."""
    above = [folder, *folder.parents]
    return next((path for path in above if (path / "_toc.yml").exists()), folder)


ROOT = root_of(Path.cwd())
BOOK = ROOT / "book" if (ROOT / "book").is_dir() else ROOT
PREFIX = "" if BOOK == ROOT else "book/"
LABS = "exercises", "solutions"  # folders beside the book's, of the same names on the site
MADE = (*LABS, f"{PREFIX}api/")  # pages that are made, or may come later
HEADER = re.compile(r"# ---\n# jupyter:\n")
LINK = re.compile(r"\[([^\]\[]*)\]\(([\w./-]+)\.(py|md)(#[\w-]+)?\)")


def notebooks() -> dict[str, Path]:
    """The sources of all pages that are notebooks, by name: lessons, exercises, solutions."""
    lessons = {path.stem: path for path in sorted(BOOK.glob("*.py")) if is_notebook(path)}
    labs = [path for folder in LABS for path in sorted((ROOT / folder).glob("[0-9][0-9]_*.py"))]
    return lessons | {f"{path.parent.name}/{path.stem}": path for path in labs}


def is_notebook(path: Path) -> bool:
    """Whether a Python file is a notebook: it begins with jupytext's header."""
    with path.open(encoding="utf-8") as file:
        return bool(HEADER.match(file.readline() + file.readline()))


def texts() -> dict[str, Path]:
    """The sources of all other pages, by name; README and the like are none."""
    return {path.stem: path for path in sorted(BOOK.glob("*.md")) if not path.stem.isupper()}


def on_site(page: str) -> str:
    """Where a page lies on the site before it is built: its file, or nothing where it has none."""
    if page in notebooks():
        return f"{page}.ipynb"
    return f"{page}.md" if page in texts() or page.startswith("api/") else ""


def linked(text: str, page: str, place: Callable[[str], str]) -> str:
    """Returns the text with links to sources leading to where ``place`` puts their pages.

    Sources link to sources, ``[chapter 2](02_lqr.py)``, ``[the lab](../exercises/03_mpc.py)``, so
    that they work in an editor, too. Where a page has no place, its link becomes text.

    Raises:
        ValueError: there is no such source; one of exercises or solutions may come later.
    """

    def follow(found: re.Match) -> str:
        words, target, suffix, anchor = found.groups()
        source = normpath(join(page if page.startswith(LABS) else f"{PREFIX}{page}", "..", target))
        if not (source.startswith(MADE) or (ROOT / f"{source}.{suffix}").exists()):
            raise ValueError(f"{page}: links to {target}.{suffix}, which does not exist")
        there = place(source.removeprefix(PREFIX))
        if not there:
            return words
        return f"[{words}]({relpath(there, dirname(place(page)) or '.')}{anchor or ''})"

    return LINK.sub(follow, text)
