"""The table of contents: that of ``_toc.yml``, with the exercises and solutions that there are."""

import api
import yaml
from pages import ROOT, notebooks

BESIDE = "glossary", "bibliography"  # pages that any single page needs


def of(only: str = "*") -> str:
    """Returns the contents of the site as text, or those of a site of one page."""
    if only != "*":
        beside = "".join(f"  - file: {page}\n" for page in BESIDE if page != only)
        return f"format: jb-book\nroot: {only}\nchapters:\n{beside}"
    toc = yaml.safe_load((ROOT / "_toc.yml").read_text())
    for part in toc["parts"]:
        for chapter in part["chapters"]:
            lab = f"exercises/{chapter['file']}"
            if lab in notebooks():
                chapter["sections"] = [{"file": lab}]
    beside = toc["parts"][-1]["chapters"]
    library = next(page for page in beside if page["file"] == "api")
    library["sections"] = [{"file": page} for page in api.pages()]
    solved = [{"file": page} for page in notebooks() if page.startswith("solutions/")]
    if solved:
        toc["parts"].insert(-1, {"caption": "Solutions", "chapters": solved})
    return yaml.safe_dump(toc, sort_keys=False, allow_unicode=True)


def names() -> list[str]:
    """The names of all pages of the site, in their order."""
    toc = yaml.safe_load(of())
    chapters = [chapter for part in toc["parts"] for chapter in part["chapters"]]
    found = [toc["root"]]
    for chapter in chapters:
        found += [chapter["file"], *(section["file"] for section in chapter.get("sections", []))]
    return found
