"""Rewrites the book's Markdown so that it needs no extension: in JupyterLab, VS Code, Colab.

Roles become what they stand for: a number, a citation with its link, the number of an equation.
A role or directive that is not known here ends the build, since a reader would see it raw.
"""

import re
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cache
from pathlib import PurePosixPath

from pybtex.database import parse_file

from .pages import BOOK, linked

BIBLIOGRAPHY = BOOK / "references.bib"
LITERAL = re.compile(r"(```.*?```|``.+?``|<pre.*?</pre>)", re.DOTALL)
ROLE = re.compile(r"\{([\w:-]+)\}`([^`]+)`")
EQUATION = re.compile(r"\$\$(.+?)\$\$[ \t]*\(([\w-]+)\)", re.DOTALL)
FENCE = re.compile(r"^(:::+|```+)\{(\w+)\}(.*?)\n(.*?)^\1[ \t]*$", re.DOTALL | re.MULTILINE)
OWN_LINE = re.compile(r"^[ \t]*<!--.*?-->[ \t]*\n?", re.DOTALL | re.MULTILINE)
COMMENT = re.compile(r"[ \t]*<!--.*?-->", re.DOTALL)
TARGET = re.compile(r"^\([\w-]+\)=\n", re.MULTILINE)
NOTES = ("note", "tip", "important", "warning", "caution", "hint", "seealso", "admonition")


class RawText(ValueError):
    """A reader would see markup instead of what it stands for."""


@dataclass
class Plain:
    """Rewrites the text of one page.

    Args:
        page: its name, ``"03_mpc"`` or ``"exercises/03_mpc"``.
        number: what stands for a claim, from its reference (``"name"``, ``"03_mpc.name"``).
        place: where a page lies, from its name; nothing where it does not, as pages that are no
            notebooks, and a link to it becomes text.
        equations: the number of each labelled equation of the book, by its label.
    """

    page: str
    number: Callable[[str], str]
    place: Callable[[str], str]
    equations: dict[str, str] = field(default_factory=dict)

    def __call__(self, text: str) -> str:
        """Returns the text without roles and directives."""
        text = TARGET.sub("", COMMENT.sub("", OWN_LINE.sub("", text)))
        text = FENCE.sub(self._directive, text)
        parts = LITERAL.split(text)
        parts[::2] = [self._prose(part) for part in parts[::2]]
        return "".join(parts).strip()

    def _prose(self, text: str) -> str:
        text = EQUATION.sub(self._equation, text)
        text = ROLE.sub(self._role, text)
        return linked(text, self.page, self.place)

    def _equation(self, found: re.Match) -> str:
        body, label = found.groups()
        return f"$${body.rstrip()} \\tag{{{self._equation_number(label)}}}\n$$"

    def _equation_number(self, label: str) -> str:
        if label not in self.equations:
            raise RawText(f"{self.page}: no equation has the label {label!r}")
        return self.equations[label]

    def _role(self, found: re.Match) -> str:
        role, argument = found.groups()
        text, target = _split(argument)
        match role.split(":"):
            case ["claim"]:
                return self.number(argument)
            case ["eq"]:
                return f"({self._equation_number(argument)})"
            case ["cite", *kind]:
                return citation(argument, kind[0] if kind else "p")
            case ["term"]:
                return f"*{text}*"
            case ["py", _]:
                return f"`{text.lstrip('~')}`"
            case ["doc" | "ref" | "numref"] if text != target:
                return text
            case ["math"]:
                return f"${argument}$"
        raise RawText(f"{self.page}: no plain text is known for {found[0]}")

    def _directive(self, found: re.Match) -> str:
        _, name, title, body = found.groups()
        body = re.sub(r"\A(?::[\w-]+:.*\n)+", "", body).strip()
        if name == "dropdown":
            return f"<details><summary>{title.strip()}</summary>\n\n{body}\n\n</details>"
        if name in NOTES:
            head = title.strip() or name.capitalize()
            return "\n".join(f"> {line}".rstrip() for line in f"**{head}.**\n\n{body}".split("\n"))
        raise RawText(f"{self.page}: no plain text is known for the directive {{{name}}}")


def equation_numbers(page: str, text: str) -> dict[str, str]:
    """The numbers that the page builder gives to the labelled equations of a chapter's text."""
    chapter = re.match(r"\d+", PurePosixPath(page).name)
    prefix = f"{int(chapter[0])}." if chapter else ""
    labels = [label for _, label in EQUATION.findall(LITERAL.sub("", text))]
    return {label: f"{prefix}{number}" for number, label in enumerate(labels, start=1)}


def citation(keys: str, kind: str) -> str:
    """A citation in words: ``Li and Todorov (2004)`` for kind t, in parentheses for p."""
    parts = []
    for key in keys.split(","):
        authors, year, url = _entry(key.strip())
        if kind.startswith("t"):
            text = f"{authors} ({year})"
        else:
            text = f"{authors}, {year}"
        parts.append(f"[{text}]({url})" if url else text)
    joined = (", " if kind.startswith("t") else "; ").join(parts)
    return joined if kind.startswith("t") else f"({joined})"


@cache
def _entries() -> dict:
    if not BIBLIOGRAPHY.exists():
        raise RawText(f"a page cites, and there is no {BIBLIOGRAPHY}")
    return parse_file(str(BIBLIOGRAPHY), bib_format="bibtex").entries


def _entry(key: str) -> tuple[str, str, str]:
    """The authors, the year and the address of an entry."""
    if key not in _entries():
        raise RawText(f"references.bib has no entry {key!r}")
    entry = _entries()[key]
    doi, url = entry.fields.get("doi"), entry.fields.get("url", "")
    return *authors_and_year(entry), f"https://doi.org/{doi}" if doi else url


def authors_and_year(entry) -> tuple[str, str]:
    """The authors of an entry as citations name them, and the year."""
    names = [_last(person) for person in entry.persons.get("author", entry.persons.get("editor"))]
    if len(names) > 2 or names[-1] == "others":
        return f"{names[0]} et al.", entry.fields["year"]
    return " and ".join(names), entry.fields["year"]


def _last(person) -> str:
    """The last name of a person, without the braces and accents of BibTeX."""
    names = [*person.rich_prelast_names, *person.rich_last_names]
    return " ".join(str(name) for name in names)


def _split(argument: str) -> tuple[str, str]:
    """The text and the target of ``text <target>``; one and the same where there is one."""
    found = re.fullmatch(r"(.+?)\s*<(.+)>", argument, re.DOTALL)
    return (found[1], found[2]) if found else (argument, argument)
