"""Makes the pages ready for Sphinx: ``python book/site/stage.py build/executed build/book [PAGE]``.

Notebooks come from the folder where they were executed, other pages from ``book/``. Numbers are
filled in for ``{claim}`name``` (of the same chapter) and ``{claim}`03_mpc.name``` (of another), the
scoreboard for ``<!-- scoreboard -->``, and links to a chapter's text lead to its page.
"""

import re
import shutil
import sys
from pathlib import Path

import nbformat
from scoreboard import COLUMNS, gather, row

from pypose_lite.teaching.proofread import REFERENCE

BOOK = Path(__file__).parent.parent


def stage(executed: Path, target: Path, page: str = "*") -> None:
    """Makes ``target`` hold all pages, or the one asked for."""
    claims, pages = gather(executed), {}
    for path in executed.glob(f"{page}.ipynb"):
        notebook = nbformat.read(path, as_version=4)
        for cell in notebook.cells:
            if cell.cell_type == "markdown":
                cell.source = filled_in(cell.source, path.stem, claims)
        pages[path.name] = nbformat.writes(notebook)
    for path in BOOK.glob(f"{page}.md"):
        text = filled_in(path.read_text(), path.stem, claims)
        pages[path.name] = text.replace("<!-- scoreboard -->", table(claims))
    for path in [*BOOK.glob("*.bib"), *BOOK.parent.glob("_*.yml")]:
        pages[path.name] = path.read_text()
    put(pages, target)
    shutil.copytree(BOOK / "site" / "static", target / "static", dirs_exist_ok=True)


def filled_in(text: str, page: str, claims: dict) -> str:
    """The text with the numbers in place of their names, and links between pages."""

    def number(found: re.Match) -> str:
        *chapter, name = found[1].split(".")
        key = (*chapter, name) if chapter else (page, name)
        if key not in claims:
            sys.exit(f"{page}: no cell claims what the text refers to, {found[0]}")
        return claims[key].number

    return re.sub(r"\]\((\w+)\.py(#[\w-]+)?\)", r"](\1.ipynb\2)", REFERENCE.sub(number, text))


def table(claims: dict) -> str:
    """The scoreboard in Markdown."""
    rows = [COLUMNS, ["---"] * len(COLUMNS)]
    for (chapter, _), claim in claims.items():
        first, *rest = row(chapter, claim)
        rows.append([f"[{first}]({first}.ipynb)", *rest])
    return "\n".join(f"| {' | '.join(cells)} |" for cells in rows)


def put(pages: dict[str, str], target: Path) -> None:
    """Makes the folder hold these files and no others; Sphinx sees only the ones that changed."""
    target.mkdir(parents=True, exist_ok=True)
    for path in target.iterdir():
        if path.is_file() and path.name not in pages:
            path.unlink()
    for name, text in pages.items():
        path = target / name
        if not path.exists() or path.read_text() != text:
            path.write_text(text)


if __name__ == "__main__":
    stage(Path(sys.argv[1]), Path(sys.argv[2]), *sys.argv[3:])
