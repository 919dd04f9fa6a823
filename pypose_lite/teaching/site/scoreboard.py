"""Gathers the claims of executed chapters; prints them, or says which numbers did not repeat.

``python -m pypose_lite.teaching.site.scoreboard EXECUTED [RECORDS]`` prints the scoreboard of a
folder of notebooks, or compares it with the records of another run.
"""

import json
import math
import re
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import nbformat

from ..claims import Claim, claims_in
from .pages import notebooks

COLUMNS = ["chapter", "claim", "paper", "ours", "bound", "cell"]
Claims = dict[tuple[str, str], Claim]  # by chapter and name


def gather(executed: Path) -> Claims:
    """The claims of all notebooks in a folder, in the order of the chapters' names."""
    return {
        (_page(path, executed), claim.name): claim
        for path in sorted(executed.rglob("*.ipynb"))
        for claim in claims_in(nbformat.read(path, as_version=4))
    }


def recorded(folder: Path) -> Claims:
    """The claims that pytest wrote down when it ran the chapters."""
    return {
        (_page(path, folder), record["name"]): Claim(**record)
        for path in sorted(folder.rglob("*.json"))
        for record in json.loads(path.read_text(encoding="utf-8"))
    }


def _page(path: Path, folder: Path) -> str:
    """The name of the page whose notebook or record this is."""
    return str(path.relative_to(folder).with_suffix(""))


def row(chapter: str, claim: Claim) -> list[str]:
    """One line of the scoreboard."""
    return [chapter, claim.name, claim.reported, claim.number, claim.bound, str(claim.cell)]


def table(claims: Claims) -> str:
    """The scoreboard as aligned text."""
    rows = [COLUMNS, *(row(chapter, claim) for (chapter, _), claim in claims.items())]
    widths = [max(map(len, column)) for column in zip(*rows)]
    return "\n".join("  ".join(map(str.ljust, line, widths)).rstrip() for line in rows)


def page_of(claims: Claims) -> str:
    """The scoreboard in Markdown: the paper's numbers beside ours, then all by page."""
    reported = {key: claim for key, claim in claims.items() if claim.paper is not None}
    parts = ["## Beside the paper", board(reported, ["claim", "paper", "here"], _beside)]
    for page in dict.fromkeys(page for page, _ in claims):
        parts += [f"## {title_of(page)}"]
        own = {key: claim for key, claim in claims.items() if key[0] == page}
        parts.append(board(own, ["claim", "value", "claimed"], _claimed))
    return "\n\n".join(parts)


def board(claims: Claims, head: list[str], columns: Callable[[Claim], list[str]]) -> str:
    """A table of claims, each with a link to its cell."""
    rows = [head, ["---"] * len(head)]
    for (page, name), claim in claims.items():
        rows.append([f'<a href="{page}.html#{anchor(name)}">{name}</a>', *columns(claim)])
    return "\n".join(f"| {' | '.join(cells)} |" for cells in rows)


def anchor(name: str) -> str:
    """What a link to a claim's cell ends in."""
    return f"claim-{name}"


def title_of(page: str) -> str:
    """The title of a page as it stands in its source."""
    source = notebooks()[page].read_text(encoding="utf-8") if page in notebooks() else ""
    found = re.search(r"^# # (.+)$", source, re.MULTILINE)
    return found[1] if found else page


def _beside(claim: Claim) -> list[str]:
    return [claim.reported, claim.number]


def _claimed(claim: Claim) -> list[str]:
    return [claim.number, claim.bound]


def unrepeated(first: Claims, second: Claims) -> Iterator[str]:
    """Says which numbers differ between two runs, or were claimed in one of them only."""
    for key in sorted({*first, *second}):
        if key not in first or key not in second:
            yield f"{'.'.join(key)}: claimed in one run only"
        elif not first[key].varies:
            a, b = first[key].value, second[key].value
            if not math.isclose(a, b, rel_tol=1e-6, abs_tol=1e-9):
                yield f"{'.'.join(key)}: {a!r} in one run, {b!r} in the other"


def changes(before: Claims, now: Claims) -> str:
    """The claims that differ, as a table in Markdown, but for those that vary with each run."""
    lines = ["| claim | before | now | claimed |", "|---|---|---|---|"]
    for key in sorted({*before, *now}):
        old, new = before.get(key), now.get(key)
        latest = new or old
        if latest and not latest.varies and (not old or not new or not _same(old, new)):
            told = [each.number if each else "none" for each in (old, new)]
            lines.append(f"| {'.'.join(key)} | {' | '.join(told)} | {latest.bound} |")
    count = len(lines) - 2
    return "\n".join([f"{count} claims changed.", "", *lines]) if count else "No claim changed."


def _same(a: Claim, b: Claim) -> bool:
    """Whether two runs claim the same of a number, and it is the same."""
    equal = math.isclose(a.value, b.value, rel_tol=1e-6, abs_tol=1e-9)
    return equal and (a.bound, a.paper) == (b.bound, b.paper)


if __name__ == "__main__":
    if sys.argv[1] == "--changes":
        print(changes(*(recorded(Path(folder)) for folder in sys.argv[2:])))
        sys.exit()
    claims = gather(Path(sys.argv[1]))
    if len(sys.argv) == 2:
        print(table(claims))
    elif differences := list(unrepeated(claims, recorded(Path(sys.argv[2])))):
        sys.exit("Claims that did not repeat from one run to the next:\n" + "\n".join(differences))
    else:
        print(f"{len(claims)} claims, the same in two runs from fresh kernels.")
