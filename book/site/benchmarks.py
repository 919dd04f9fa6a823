"""Writes the page of benchmarks: ``python book/site/benchmarks.py build/bench.json PAGE``.

The first is what pytest-benchmark has recorded. A time is that of the least disturbed round; a side
that did only a share of a group's work says so, and its time is that of the whole. Ratios are to
"ours" of the same group, or to the first row where nobody is called that.
"""

import json
import platform
import sys
from collections.abc import Iterator
from itertools import groupby
from pathlib import Path

import torch
from tabulate import tabulate

PAGE = """# Speed

What `make bench` has measured on one machine: {cpu}, one thread, Python {python}, PyTorch {torch},
on {date}. All sides of a table solve the same problem in the same run, one after another; where a
side stops at a worse answer the run fails, and no row is written.

A time is that of the least disturbed round. The ratio is how many times longer than *ours*, or than
the first row, a side takes.

{tables}
"""


def tables(benchmarks: list[dict]) -> Iterator[str]:
    """A section for each group."""
    for group, rows in groupby(benchmarks, lambda b: b["group"]):
        sides = {b["extra_info"]["side"]: seconds(b) for b in rows}
        one = sides.get("ours", next(iter(sides.values())))
        lines = [(side, duration(s), f"{s / one:.2f}") for side, s in sides.items()]
        table = tabulate(lines, ["", "time", "ratio"], "pipe", colalign=("left", "right", "right"))
        yield f"## {group[0].upper()}{group[1:]}\n\n{table}"


def seconds(benchmark: dict) -> float:
    """The shortest time for all the work of the group."""
    return benchmark["stats"]["min"] / benchmark["extra_info"].get("share", 1)


def duration(seconds: float) -> str:
    """A time with three digits and a unit."""
    for unit, size in (("s", 1), ("ms", 1e-3)):
        if seconds >= size:
            return f"{seconds / size:.3g} {unit}"
    return f"{seconds / 1e-6:.3g} µs"


if __name__ == "__main__":
    record, page = json.loads(Path(sys.argv[1]).read_text()), Path(sys.argv[2])
    measured = sorted(
        (b for b in record["benchmarks"] if "side" in b["extra_info"]), key=lambda b: b["group"]
    )
    text = PAGE.format(
        cpu=record["machine_info"]["cpu"].get("brand_raw", platform.processor()),
        python=platform.python_version(),
        torch=torch.__version__,
        date=record["datetime"][:10],
        tables="\n\n".join(tables(measured)),
    )
    page.write_text(text)
    print(text)
