"""Makes the pages ready for Sphinx.

``python -m pypose_lite.teaching.site.stage build/executed build/book [PAGE]``

Notebooks come from the folder where they were executed, other pages from ``book/``. Numbers are
filled in for ``{claim}`name``` (of the same page) and ``{claim}`03_mpc.name``` (of another), the
scoreboard for ``<!-- scoreboard -->``; links to a chapter's text lead to its page, and tags become
folds. ``TARGET-notebooks`` holds the same notebooks in plain Markdown, for those who download them.
"""

import shutil
import sys
from fnmatch import fnmatch
from pathlib import Path

import jupytext
import nbformat

from ..proofread import REFERENCE
from . import api, config, contents, folds
from .given import with_given_outputs
from .pages import BOOK, ROOT, linked, notebooks, on_site, texts
from .plain import Plain, equation_numbers
from .scoreboard import gather, page_of

STATIC = Path(__file__).parent / "static"
UNKNOWN = "…"  # a number of a chapter that has not been run


class Numbers:
    """What stands for a claim in a page's text."""

    def __init__(self, page: str, claims: dict, strict: bool = True):
        self.page, self.claims, self.strict = page, claims, strict

    def __call__(self, reference: str) -> str:
        """The number with its unit; ends the build where no cell claims it."""
        *chapter, name = reference.split(".")
        key = (chapter[0] if chapter else self.page, name)
        if key in self.claims:
            return self.claims[key].number
        if self.strict or any(page == key[0] for page, _ in self.claims):
            sys.exit(f"{self.page}: no cell claims what the text refers to, {{claim}}`{reference}`")
        return UNKNOWN

    def fill(self, text: str) -> str:
        """The text with all its numbers."""
        return REFERENCE.sub(lambda found: self(found[1]), text)


def stage(executed: Path, target: Path, only: str = "*") -> None:
    """Makes ``target`` hold all pages, or the one asked for."""
    claims, strict = gather(executed), only == "*"
    equations = all_equations()
    pages: dict[str, str] = {}
    plain: dict[str, str] = {}
    for page in notebooks():
        if not fnmatch(page, only):
            continue
        notebook, numbers = read(page, executed), Numbers(page, claims, strict)
        pages[f"{page}.ipynb"] = nbformat.writes(for_page(notebook, page, numbers))
        rewrite = Plain(page, numbers, notebook_place, equations)
        plain[f"{page}.ipynb"] = nbformat.writes(for_download(notebook, rewrite))
    for page, path in texts().items():
        if fnmatch(page, only) or page in contents.BESIDE:
            text = with_syllabus(path.read_text(encoding="utf-8"))
            text = linked(Numbers(page, claims, strict).fill(text), page, on_site)
            if page == "benchmarks":
                from . import speed  # draws, from the page's tables

                text, pictures = speed.laid_out(text)
                pages |= pictures
            pages[f"{page}.md"] = with_lists(text, claims)
    pages |= made(only)
    put(pages, target)
    put(plain, target.with_name(f"{target.name}-notebooks"))
    for folder in (STATIC, ROOT / "static"):  # an author's own files come last
        if folder.is_dir():
            shutil.copytree(folder, target / "static", dirs_exist_ok=True)


def made(only: str = "*") -> dict[str, str]:
    """The files that nobody writes: settings, contents, bibliography, the pages of the library."""
    toc = contents.of(only)
    pages = {f"{page}.md": text for page, text in contents.made().items()}
    pages |= {f"{page}.md": api.page(page) for page in api.pages() if f"file: {page}\n" in toc}
    pages |= {path.name: path.read_text(encoding="utf-8") for path in BOOK.glob("*.bib")}
    return pages | {"_config.yml": config.merged(), "_toc.yml": toc}


def with_syllabus(text: str) -> str:
    """The text with the tables of lessons and exercises where it asks for them."""
    if "<!-- syllabus:" in text:
        from . import syllabus  # asks the checks, which need torch

        text = syllabus.filled(text)
    return text


def with_lists(text: str, claims: dict) -> str:
    """The text with the scoreboard and the list of modules where they belong."""
    if "<!-- scoreboard -->" in text:
        text = text.replace("<!-- scoreboard -->", page_of(claims))
    return text.replace(api.LIST, api.modules()) if api.LIST in text else text


def read(page: str, executed: Path) -> nbformat.NotebookNode:
    """The notebook of a page as it was executed; an exercise has what its solution shows."""
    if page.startswith("exercises/"):
        exercise = jupytext.read(notebooks()[page])
        solution = executed / f"{page.replace('exercises', 'solutions')}.ipynb"
        if not solution.exists():
            return exercise
        return with_given_outputs(exercise, nbformat.read(solution, as_version=4))
    return nbformat.read(executed / f"{page}.ipynb", as_version=4)


def for_page(notebook, page: str, numbers: Numbers):
    """The notebook as the page builder takes it."""
    notebook = folds.for_page(notebook)
    for cell in notebook.cells:
        if cell.cell_type == "markdown":
            cell.source = linked(numbers.fill(cell.source), page, on_site)
        elif page.startswith("solutions/"):
            folds.fold_code(cell)
    return notebook


def for_download(notebook, rewrite: Plain):
    """The notebook as any reader of notebooks takes it."""
    notebook = folds.for_lab(notebook)
    for cell in notebook.cells:
        if cell.cell_type == "markdown":
            cell.source = rewrite(cell.source)
    return notebook


def notebook_place(page: str) -> str:
    """Where a notebook lies beside the others, once downloaded."""
    return f"{page}.ipynb" if page in notebooks() else ""


def all_equations() -> dict[str, str]:
    """The number of every labelled equation of the book."""
    found: dict[str, str] = {}
    for page, path in notebooks().items():
        cells = jupytext.read(path).cells
        text = "\n\n".join(cell.source for cell in cells if cell.cell_type == "markdown")
        found |= equation_numbers(page, text)
    return found


def put(pages: dict[str, str], target: Path) -> None:
    """Makes the folder hold these pages and no others; Sphinx sees only the ones that changed."""
    target.mkdir(parents=True, exist_ok=True)
    for path in [*target.glob("*"), *(p for d in pages_folders(target) for p in d.glob("*"))]:
        if path.is_file() and str(path.relative_to(target)) not in pages:
            path.unlink()
    for name, text in pages.items():
        path = target / name
        path.parent.mkdir(exist_ok=True)
        if not path.exists() or path.read_text(encoding="utf-8") != text:
            path.write_text(text, encoding="utf-8")


def pages_folders(target: Path) -> list[Path]:
    """The folders of pages within ``target``; others hold scripts and the built site."""
    return [target / name for name in ("exercises", "solutions", "api") if (target / name).is_dir()]


if __name__ == "__main__":
    try:
        stage(Path(sys.argv[1]), Path(sys.argv[2]), *sys.argv[3:])
    except ValueError as error:
        sys.exit(str(error))
