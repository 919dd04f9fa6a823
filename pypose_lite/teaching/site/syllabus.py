"""The tables of the page for teachers: what there is to teach, and how long it takes.

Lessons say their title, goals, minutes and what they need on their first page, and exercises say
theirs in their checks. So the tables follow when a lesson or a lab changes, or a new one comes.
"""

import re
from collections.abc import Iterator
from functools import cache
from typing import Any

import jupytext

from ..checks import Exercise, chapter, find
from .needs import needs_in
from .pages import LINK, notebooks

LESSON = re.compile(r"\d\d_\w+")
TITLE = re.compile(r"^# (.+)$", re.MULTILINE)
GOALS = re.compile(r"you can\n\n((?:- .+\n(?:  .+\n)*)+)")
NEEDS = re.compile(r"^You need .+?(?:\n\n|\Z)", re.MULTILINE | re.DOTALL)
MINUTES = re.compile(r"Take about (\d+)\s+minutes")
KIND = re.compile(r"^\*\d+ minutes\. (.+)\*$", re.MULTILINE)
HEADING = re.compile(r"^## Exercise (\d+\.\d+): ", re.MULTILINE)


@cache
def lessons() -> dict[str, str]:
    """The first page of each lesson, as text, by its name."""
    found = {}
    for page, path in notebooks().items():
        if LESSON.fullmatch(page):
            cells = jupytext.read(path).cells
            first = [cell.source for cell in cells[: _first_code(cells)]]
            found[page] = re.sub(r"<!--.*?-->\n?", "", "\n\n".join(first), flags=re.DOTALL)
    return found


def _first_code(cells: Any) -> int:
    return next((k for k, cell in enumerate(cells) if cell.cell_type == "code"), len(cells))


def number_of(page: str) -> int:
    """The number of a lesson or a lab."""
    return int(page.rpartition("/")[2][:2])


def minutes_of(page: str) -> int:
    """The minutes that a lesson says that it takes."""
    found = MINUTES.search(lessons()[page])
    if not found:
        raise ValueError(f"book/{page}.py: expected 'Take about 60 minutes' on its first page")
    return int(found[1])


def goals_of(page: str) -> str:
    """The list of what one can do after a lesson, in Markdown."""
    found = GOALS.search(lessons()[page] + "\n")
    if not found:
        raise ValueError(
            f"book/{page}.py: expected 'you can' and a list of goals on its first page"
        )
    return found[1].rstrip()


def needs_of(page: str) -> list[str]:
    """The lessons that a lesson says that one needs."""
    found = NEEDS.search(lessons()[page])
    asked = [name for _, name, *_ in LINK.findall(found[0])] if found else []
    return [name for name in dict.fromkeys(asked) if name in lessons() and name != page]


def lab_of(page: str) -> list[Exercise]:
    """The exercises of a lesson's lab; none, if it has no lab."""
    return chapter(number_of(page)) if f"solutions/{page}" in notebooks() else []


def title_of(page: str) -> str:
    """A lesson's title."""
    return TITLE.findall(lessons()[page])[0]


def overview() -> str:
    """A row for each lesson: what it takes, and which lessons it needs."""
    head = "| | Lesson | Minutes | Exercises | Minutes | Points | Needs |"
    rows = [head, "|--:|:--|--:|--:|--:|--:|:--|"]
    for page in lessons():
        lab = lab_of(page)
        sums = [len(lab), sum(e.minutes for e in lab), sum(e.points for e in lab)]
        needs = ", ".join(str(number_of(name)) for name in needs_of(page))
        shown = map(str, sums if lab else "–––")
        name = f"[{title_of(page)}]({page}.py)"
        row = [str(number_of(page)), name, str(minutes_of(page)), *shown, needs or "–"]
        rows.append(f"| {' | '.join(row)} |")
    return "\n".join(rows)


def details() -> str:
    """For each lesson its goals, and its exercises with minutes, points and kinds."""
    return "\n\n".join(part for page in lessons() for part in _details(page))


def _details(page: str) -> Iterator[str]:
    yield f"### {number_of(page)} {title_of(page)}"
    yield f"[Lesson]({page}.py), {minutes_of(page)} minutes. Afterwards students can"
    yield goals_of(page)
    if not (lab := lab_of(page)):
        yield "This lesson has no lab yet."
        return
    total = sum(exercise.minutes for exercise in lab)
    solved = f"[solutions](../solutions/{page}.py)"
    yield f"[Lab](../exercises/{page}.py), {total} minutes; its {solved}."
    kinds = kinds_of(page)
    rows = ["| Exercise | Minutes | Points | Kind |", "|:--|--:|--:|:--|"]
    for e in lab:
        rows.append(f"| {e.number} {e.title} | {e.minutes} | {e.points} | {kinds[e.number]} |")
    yield "\n".join(rows)


def kinds_of(page: str) -> dict[str, str]:
    """What a lab says of the kind of each exercise: a warm-up, a fault to be found, ..."""
    cells = jupytext.read(notebooks()[f"solutions/{page}"]).cells
    texts = [cell.source for cell in cells if cell.cell_type == "markdown"]
    found = {head[1]: KIND.search(text) for text in texts if (head := HEADING.search(text))}
    return {number: kind[1].rstrip(".") if kind else "" for number, kind in found.items()}


def needs() -> str:
    """A row for each exercise that uses what others of its lab define."""
    rows = ["| Exercise | Needs |", "|:--|:--|"]
    for page in lessons():
        if lab_of(page):
            text = notebooks()[f"solutions/{page}"].read_text(encoding="utf-8")
            rows += [f"| {e} | {', '.join(others)} |" for e, others in needs_in(text).items()]
    return "\n".join(rows)


def opened() -> str:
    """A list of the exercises that can be answered in many ways, by what their labs say."""
    kinds = {e: kind for page in lessons() if lab_of(page) for e, kind in kinds_of(page).items()}
    found = [exercise for page in lessons() for exercise in lab_of(page)]
    rows = [f"- {e.number} {e.title}" for e in found if "open" in kinds[e.number].lower()]
    return "\n".join(rows)


# What is taught in each week: lessons, exercises ("all" of those lessons), and what else.
Week = tuple[tuple[int, ...], str, str]
SIX: list[Week] = [
    ((1,), "1.1 1.2 1.4 1.5", ""),
    ((2,), "2.1 2.2 2.4 2.5", ""),
    ((3,), "3.1 3.2 3.3 3.4", ""),
    ((4,), "4.1 4.2 4.3 4.4", ""),
    ((6, 7), "6.1 6.2 7.1 7.4 7.5", "of lesson 6 up to the local planner"),
    ((8,), "8.1 8.2 8.4", "or lesson 9, for a class with a robot"),
]
TWELVE: list[Week] = [
    ((1,), "all", ""),
    ((2,), "all", ""),
    ((3,), "3.1 3.2 3.3 3.4", "derivation and first half of the lab"),
    ((), "3.5 3.6 3.7 3.8", "lab in class; projects are proposed"),
    ((4,), "all", ""),
    ((5,), "all", ""),
    ((6,), "all", ""),
    ((7,), "all", "projects are agreed on"),
    ((8,), "all", ""),
    ((9,), "all", "with the robot, where there is one"),
    ((10,), "all", "and projects"),
    ((), "", "projects are presented"),
]


def weeks(plan: list[Week]) -> str:
    """A row a week, with the minutes and the points that lessons and checks say."""
    head = "| Week | Lessons | Minutes | Exercises | Minutes | Points | |"
    rows = [head, "|--:|:--|--:|:--|--:|--:|:--|"]
    for week, (numbers, asked, remark) in enumerate(plan, 1):
        pages = [page for page in lessons() if number_of(page) in numbers]
        of_pages = [e for page in pages for e in lab_of(page)]
        chosen = of_pages if asked == "all" else [find(number) for number in asked.split()]
        row = [
            f"{week}",
            ", ".join(f"[{number_of(page)} {title_of(page)}]({page}.py)" for page in pages),
            f"{sum(map(minutes_of, pages)) or ''}",
            ", ".join(e.number for e in chosen) if asked != "all" else "all" * bool(chosen),
            f"{sum(e.minutes for e in chosen) or ''}",
            f"{sum(e.points for e in chosen) or ''}",
            remark,
        ]
        rows.append(f"| {' | '.join(row)} |")
    return "\n".join(rows)


TABLES = {
    "overview": overview,
    "details": details,
    "needs": needs,
    "open": opened,
    "six": lambda: weeks(SIX),
    "twelve": lambda: weeks(TWELVE),
}


def filled(text: str) -> str:
    """The text with its tables, each where ``<!-- syllabus: overview -->`` asks for it."""
    return re.sub(r"<!-- syllabus: (\w+) -->", lambda found: TABLES[found[1]](), text)
