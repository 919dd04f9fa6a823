"""Makes exercises from solutions.

``python -m pypose_lite.teaching.site.exercises solutions exercises``

What stands between ``### BEGIN SOLUTION`` and ``### END SOLUTION`` becomes a NotImplementedError
with the exercise's number, and cells with the tag ``solution`` are left out. Writes nothing, and
ends with an error, where a lab is not in its form: an exercise is a text cell with a heading
``## Exercise 2.1: One Riccati step``, a line ``*10 minutes. Warm-up.*`` and three hints; then a
cell with the solution, its explanation in a cell with the tag ``solution``, and the check.
"""

import re
import sys
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from ..checks import chapter

BEGIN, END = "### BEGIN SOLUTION", "### END SOLUTION"
HEADING = re.compile(r"^# ## Exercise (\d+\.\d+): (.+)$", re.MULTILINE)
MINUTES = re.compile(r"^# \*(\d+) minutes\.", re.MULTILINE)
CHECK = re.compile(r"^check\(\s*\"(\d+\.\d+)\"", re.MULTILINE)
HINTS = [f"# :::{{dropdown}} Hint {k}\n" for k in (1, 2, 3)]


@dataclass
class Cell:
    """A cell of a jupytext file: its text with its header, and its first line in the file."""

    line: int
    text: str
    exercise: str = ""  # the number of the exercise that it belongs to
    title: str = ""

    @property
    def header(self) -> str:
        """The line that begins the cell."""
        return self.text.split("\n", 1)[0]

    @property
    def is_solution(self) -> bool:
        """Whether exercises do without the whole cell."""
        return bool(re.search(r'tags=\[[^]]*"solution"', self.header))

    @property
    def first_line(self) -> int:
        """The line of the exercise's heading where it stands in this cell."""
        heading = f"# ## Exercise {self.exercise}:"
        return self.line_of(heading) if heading in self.text else self.line

    def line_of(self, part: str) -> int:
        """The line in the file of a part of the cell."""
        return self.line + self.text[: self.text.index(part)].count("\n")


def cells_of(lab: str) -> list[Cell]:
    """Returns the cells of a lab, the file's header first, each with its exercise."""
    cells, line, number, title = [], 1, "", ""
    for text in re.split(r"^(?=# %%)", lab, flags=re.MULTILINE):
        if found := HEADING.search(text):
            number, title = found.groups()
        cells.append(Cell(line, text, number, title))
        line += text.count("\n")
    return cells


def exercises_from(lab: str) -> str:
    """Returns the lab without its solutions."""
    kept = [_stubbed(cell) for cell in cells_of(lab) if not cell.is_solution]
    return "".join(kept).rstrip("\n") + "\n"


def _stubbed(cell: Cell) -> str:
    stub = f'raise NotImplementedError("{cell.exercise} {cell.title}")'
    solution = rf"^([ ]*){BEGIN}\n.*?^[ ]*{END}$"
    flags = re.MULTILINE | re.DOTALL
    return re.sub(solution, lambda found: found[1] + stub, cell.text, flags=flags)


def complaints(lab: str, name: str) -> list[str]:
    """Returns what is not in its form, each with the file, the line and the exercise."""
    cells = cells_of(lab)
    by_number: dict[str, list[Cell]] = {}
    for cell in cells:
        by_number.setdefault(cell.exercise, []).append(cell)
    found = [*markers(cells), *twice(cells), *checks_elsewhere(cells), *unknown(by_number, name)]
    for number, its_cells in by_number.items():
        if number:
            found += [(its_cells[0].first_line, number, wrong) for wrong in incomplete(its_cells)]
    return [f"{name}:{line}: exercise {number or '(none)'}: {w}" for line, number, w in found]


def markers(cells: list[Cell]) -> Iterator[tuple[int, str, str]]:
    """Yields markers that are not closed, not opened, or belong to no exercise."""
    for cell in cells:
        inside = False
        for offset, line in enumerate(cell.text.splitlines()):
            place = cell.line + offset, cell.exercise
            if BEGIN in line and (inside or not cell.exercise):
                yield (*place, f"{BEGIN} within another one" if inside else f"{BEGIN} before any")
            if END in line and not inside:
                yield (*place, f"{END} without {BEGIN}")
            inside = BEGIN in line or (inside and END not in line)
        if inside:
            yield cell.line_of(BEGIN), cell.exercise, f"{BEGIN} is not closed by {END} in its cell"


def twice(cells: list[Cell]) -> Iterator[tuple[int, str, str]]:
    """Yields each number that two exercises have."""
    heads = [(cell, *found) for cell in cells for found in HEADING.findall(cell.text)]
    for number, count in Counter(number for _, number, _ in heads).items():
        if count > 1:
            *_, (cell, _, title) = (head for head in heads if head[1] == number)
            yield cell.line_of(f"# ## Exercise {number}: {title}"), number, f"{count} have it"


def checks_elsewhere(cells: list[Cell]) -> Iterator[tuple[int, str, str]]:
    """Yields each check that stands in another exercise than its own."""
    for cell in cells:
        for number in CHECK.findall(cell.text):
            if number != cell.exercise:
                where = f"stands in exercise {cell.exercise}" if cell.exercise else "has none"
                yield cell.line_of(f'"{number}"'), number, f'check("{number}", ...) {where}'


def unknown(by_number: dict[str, list[Cell]], name: str) -> Iterator[tuple[int, str, str]]:
    """Yields what is in the lab and not among its checks, or the other way round."""
    known = {exercise.number: exercise for exercise in chapter(int(name[:2]))}
    where = f"pypose_lite/teaching/checks/chapter_{name[:2]}.py"
    for number, cells in by_number.items():
        if number and number not in known:
            yield cells[0].first_line, number, f"has no properties in {where}"
        elif number and cells[0].title != known[number].title:
            yield cells[0].first_line, number, f"is called {known[number].title!r} in {where}"
    for number in known:
        if number not in by_number:
            yield 1, number, f"is in {where} and not in this lab"


def incomplete(cells: list[Cell]) -> Iterator[str]:
    """Yields what an exercise lacks of its form."""
    text = "".join(cell.text for cell in cells)
    number = cells[0].exercise
    if BEGIN not in text:
        yield f"does not mark its solution by {BEGIN} and {END}"
    if number not in CHECK.findall(text):
        yield f'has no check: a cell with check("{number}", ...)'
    if not any(cell.is_solution for cell in cells):
        yield 'has no explanation: a text cell with the tag "solution"'
    if not MINUTES.search(text):
        yield "does not say its minutes: a line that begins *10 minutes."
    if missing := [hint for hint in HINTS if hint not in text]:
        yield f"lacks {len(missing)} of its three hints: {missing[0].strip('# ')!r}".replace(
            "\n", ""
        )


def make(solutions: Path, exercises: Path) -> list[str]:
    """Writes the exercises that are not as their solutions say, and returns their names."""
    labs = {path.name: path.read_text("utf-8") for path in sorted(solutions.glob("[0-9]*.py"))}
    if wrong := [line for name, lab in labs.items() for line in complaints(lab, name)]:
        raise ValueError("\n".join(wrong))
    exercises.mkdir(exist_ok=True)
    new = {name: text for name, text in differing(labs, exercises).items()}
    for name, text in new.items():
        (exercises / name).write_text(text, "utf-8")
    for path in exercises.glob("[0-9]*.py"):
        if path.name not in labs:
            path.unlink()
    return list(new)


def differing(labs: dict[str, str], exercises: Path) -> dict[str, str]:
    """The exercises that are not as their solutions say, as they should be."""
    made = {name: exercises_from(lab) for name, lab in labs.items()}
    there = {name: exercises / name for name in made}
    return {
        name: text
        for name, text in made.items()
        if not there[name].exists() or there[name].read_text("utf-8") != text
    }


if __name__ == "__main__":
    try:
        changed = make(*map(Path, sys.argv[1:]))
    except ValueError as error:
        sys.exit(str(error))
    print(f"exercises made anew: {', '.join(changed)}" if changed else "exercises are as they were")
