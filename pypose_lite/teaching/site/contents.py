"""The table of contents: that of ``_toc.yml``, with the exercises and solutions that there are."""

from typing import Any

import yaml

from . import api
from .pages import BOOK, ROOT, notebooks, texts

BESIDE = "glossary", "bibliography"  # pages that any single page needs
BIBLIOGRAPHY = """# Bibliography

```{bibliography}
```
"""


def of(only: str = "*") -> str:
    """Returns the contents of the site as text, or those of a site of one page."""
    if only != "*":
        there = [page for page in BESIDE if page in {*texts(), *made()} and page != only]
        toc: dict[str, Any] = {"format": "jb-book", "root": only}
        toc["chapters"] = [{"file": page} for page in there]
    else:
        toc = own()
        _with_labs(toc)
        if _lists(toc, "api"):
            _entry(toc, "api")["sections"] = [{"file": page} for page in api.pages()]
        added = [page for page in made() if not _lists(toc, page)]
        _last(toc).extend({"file": page} for page in added)
    return yaml.safe_dump(toc, sort_keys=False, allow_unicode=True)


def own() -> dict[str, Any]:
    """The contents as the author gives them: without ``_toc.yml``, all pages by name."""
    path = ROOT / "_toc.yml"
    if path.exists():
        return yaml.safe_load(path.read_text(encoding="utf-8"))
    pages = [page for page in [*notebooks(), *texts()] if "/" not in page]
    if not pages:
        raise ValueError(f"{BOOK} has no page: no jupytext file with a header, and no Markdown")
    root = "index" if "index" in pages else pages[0]
    chapters = [{"file": page} for page in pages if page != root]
    return {"format": "jb-book", "root": root, "chapters": chapters}


def made() -> dict[str, str]:
    """Pages that no author has to write, by name: the bibliography, where there are references."""
    texts_there = [path.read_text(encoding="utf-8") for path in texts().values()]
    if not (BOOK / "references.bib").exists() or any("{bibliography}" in t for t in texts_there):
        return {}
    return {"bibliography": BIBLIOGRAPHY}


def names() -> list[str]:
    """The names of all pages of the site, in their order."""
    toc = yaml.safe_load(of())
    found = [toc["root"]]
    for chapter in _chapters(toc):
        found += [chapter["file"], *(section["file"] for section in chapter.get("sections", []))]
    return found


def _with_labs(toc: dict[str, Any]) -> None:
    """Puts each lab's exercises below their lesson, and the solutions into a part of their own."""
    for chapter in _chapters(toc):
        lab = f"exercises/{chapter['file']}"
        if lab in notebooks():
            chapter["sections"] = [{"file": lab}]
    solved = [{"file": page} for page in notebooks() if page.startswith("solutions/")]
    if solved and "parts" in toc:
        toc["parts"].insert(-1, {"caption": "Solutions", "chapters": solved})
    elif solved:
        toc["chapters"] += solved


def _chapters(toc: dict[str, Any]) -> list[dict[str, Any]]:
    """The entries of all parts, in their order."""
    return [chapter for part in toc.get("parts", [toc]) for chapter in part.get("chapters", [])]


def _last(toc: dict[str, Any]) -> list[dict[str, Any]]:
    """The list of entries to which pages are added."""
    return (toc["parts"][-1] if "parts" in toc else toc).setdefault("chapters", [])


def _entry(toc: dict[str, Any], page: str) -> dict[str, Any]:
    return next(chapter for chapter in _chapters(toc) if chapter["file"] == page)


def _lists(toc: dict[str, Any], page: str) -> bool:
    return any(chapter["file"] == page for chapter in _chapters(toc))
