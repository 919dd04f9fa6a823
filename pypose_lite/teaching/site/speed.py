"""Lays out the page of benchmarks, ``book/benchmarks.md``: plots first, tables folded.

The plots are drawn from the tables, so that they cannot disagree.
"""

import io
import re

import matplotlib.pyplot as plt
from matplotlib.axes import Axes

from .. import figures

GROUP = re.compile(r"^### (.+)\n\n((?:\|.*\n?)+)", re.MULTILINE)
SECONDS = {"s": 1.0, "ms": 1e-3, "µs": 1e-6}
Rows = list[dict[str, str]]

# Each plot: its file, what it shows, its axes' labels, and its panels, a title and the groups each.
PLOTS = {
    "speed_horizon.svg": (
        "Time for one plan against the horizon: it grows with the number of steps for all sides.",
        ("steps in a plan", "time (s)", "time"),
        [
            ("cold start", re.compile(r"One plan of (\d+) steps, cold")),
            ("warm start", re.compile(r"One plan of (\d+) steps, warm")),
        ],
    ),
    "speed_batch.svg": (
        "Time for each plan of a batch: together they take less time each than one alone.",
        ("plans in a batch", "time for each (s)", "time each"),
        [("10 steps, cold start", re.compile(r"A batch of (\d+), 10 steps, cold"))],
    ),
}


def laid_out(text: str) -> tuple[str, dict[str, str]]:
    """Returns the page, and its pictures by their files' names."""
    groups = {title: rows_of(table) for title, table in GROUP.findall(text)}
    pictures = {name: drawn(groups, *plot[1:]) for name, plot in PLOTS.items()}
    images = "\n".join(
        f"```{{image}} {name}\n:alt: {PLOTS[name][0]}\n:class: picture\n```\n"
        for name, picture in pictures.items()
        if picture
    )
    folded = GROUP.sub(r":::{dropdown} \1\n\2:::\n", text)
    before, first, after = folded.partition("\n## ")
    page = f"{before}\n{images}{first}{after}"
    return page, {name: picture for name, picture in pictures.items() if picture}


def rows_of(table: str) -> Rows:
    """The rows of a table in Markdown, by the names of its columns."""
    head, _, *rows = ([c.strip() for c in line.split("|")[1:-1]] for line in table.splitlines())
    return [dict(zip(head, row)) for row in rows]


def seconds(text: str) -> float:
    """A duration as the tables write it: ``11.9 ms``."""
    number, unit = text.split()
    return float(number) * SECONDS[unit]


def drawn(groups: dict[str, Rows], labels: tuple, panels: list) -> str:
    """The plot as SVG, or nothing where there is no group for it."""
    found = [(title, times(groups, pattern, labels[2])) for title, pattern in panels]
    found = [(title, sides) for title, sides in found if sides]
    if not found:
        return ""
    with plt.rc_context({"svg.hashsalt": "speed"}):
        figures.use_style()
        size = (5, 2.4 * len(found) + 0.6)  # inches; narrow, so that a phone shows it
        fig, axes = plt.subplots(len(found), 1, figsize=size, sharex=True, squeeze=False)
        for ax, (title, sides) in zip(axes.flat, found):
            panel(ax, title, sides)
            ax.set_ylabel(labels[1])
        ax.set_xlabel(labels[0])
        fig.legend(*ax.get_legend_handles_labels(), loc="outside lower center", ncols=3)
        file = io.StringIO()
        fig.savefig(file, format="svg", metadata={"Date": None})
        plt.close(fig)
    return file.getvalue()


def times(groups: dict[str, Rows], pattern: re.Pattern, column: str) -> dict[str, list]:
    """For each side its points: the number in the groups' titles, and the time."""
    sides: dict[str, list] = {}
    for title, rows in groups.items():
        if found := pattern.fullmatch(title):
            for row in rows:
                sides.setdefault(row[""], []).append((int(found[1]), seconds(row[column])))
    return sides


def panel(ax: Axes, title: str, sides: dict[str, list]) -> None:
    """Draws the sides of a comparison, both axes logarithmic."""
    for (side, points), marker in zip(sides.items(), "osv^Dx*"):
        ax.plot(*zip(*points), marker=marker, label=side)
    numbers = sorted({number for points in sides.values() for number, _ in points})
    ax.set(xscale="log", yscale="log", title=title)
    ax.set_xticks(numbers, labels=map(str, numbers))
    ax.minorticks_off()
