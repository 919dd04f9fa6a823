"""Writes the page of benchmarks: ``python book/site/benchmarks.py build/bench.json PAGE``.

The first is what pytest-benchmark has recorded. What a benchmark notes in ``extra_info``:

- ``side``: the name of its row;
- ``share``: how much of the group's work it did, where it is not all;
- ``count``: how many plans or cars the work was for;
- ``sweeps``: how many it made;
- ``worse``: by how much its answer costs above the best, relatively.
"""

import ast
import json
import platform
import sys
from collections.abc import Iterator
from importlib.metadata import version
from pathlib import Path

from tabulate import tabulate

ROOT = Path(__file__).parents[2]
TOPICS = {"bench_mpc": "Planning", "bench_filters": "Filters", "bench_splines": "Splines"}
LIBRARIES = ["torch", "pypose", "casadi", "filterpy", "scipy"]
SAME = 1e-4  # answers whose costs differ by less are the same
PAGE = """# Speed

What `make bench` measured on {date}, on one machine: {cpu}, one thread,
Python {python}, {libraries}.
All sides of a table solve the same problem in the same run. A time is the processor's, so that
other work on the machine does not count, and that of the quickest round. Still, a second run may
differ by a fifth.

*Times ours* is how many times longer than ours a side takes: 8 means that ours is done in an eighth
of its time, and less than 1 that ours is the slower one. Where a side stops at a worse answer,
*cost above the best* says by how much; *none* is less than a ten-thousandth.

{topics}
"""


def topics(benchmarks: list[dict]) -> Iterator[str]:
    """A section for each file: what its docstring says, and a table for each of its groups."""
    for stem, title in TOPICS.items():
        path, groups = f"tests/bench/{stem}.py", dict[str, list]()
        for benchmark in benchmarks:
            if benchmark["fullname"].startswith(path):
                groups.setdefault(benchmark["group"], []).append(benchmark)
        if groups:
            source = (ROOT / path).read_text(encoding="utf-8")
            yield f"## {title}\n\n{ast.get_docstring(ast.parse(source))}"
        for group, rows in groups.items():
            yield f"### {group}\n\n{table(rows)}"


def table(benchmarks: list[dict]) -> str:
    """A row for each side of a group; a column only where there is something to say."""
    times = {b["extra_info"]["side"]: seconds(b) for b in benchmarks}
    one = "ours" if "ours" in times else next(iter(times))
    rows = []
    for benchmark, (side, time) in zip(benchmarks, times.items()):
        notes, row = benchmark["extra_info"], {"": side, "time": duration(time)}
        if "count" in notes:
            row["time each"] = duration(time / notes["count"])
        row[f"times {one}"] = ratio(time / times[one])
        if "sweeps" in notes:
            row["sweeps"] = str(notes["sweeps"])
        if "worse" in notes:
            row["cost above the best"] = excess(notes["worse"])
        rows.append(row)
    align = ["left", *["right"] * (len(rows[0]) - 1)]
    return tabulate(rows, "keys", "pipe", colalign=align, disable_numparse=True)


def seconds(benchmark: dict) -> float:
    """The shortest time for all the work of the group."""
    return benchmark["stats"]["min"] / benchmark["extra_info"].get("share", 1)


def duration(seconds: float) -> str:
    """A time with three digits and a unit."""
    for unit, size in (("s", 1), ("ms", 1e-3)):
        if seconds >= size:
            return f"{seconds / size:.3g} {unit}"
    return f"{seconds / 1e-6:.3g} µs"


def ratio(value: float) -> str:
    """A ratio with two digits after the point, or two digits that are not 0."""
    return f"{value:.2f}" if value >= 0.1 else f"{value:.2g}"


def excess(worse: float) -> str:
    """A relative excess in percent, with two digits."""
    return "none" if worse < SAME else f"+{100 * worse:.2g} %"


if __name__ == "__main__":
    record, page = json.loads(Path(sys.argv[1]).read_text(encoding="utf-8")), Path(sys.argv[2])
    text = PAGE.format(
        cpu=record["machine_info"]["cpu"].get("brand_raw", platform.processor()),
        python=platform.python_version(),
        libraries=", ".join(f"{name} {version(name)}" for name in LIBRARIES),
        date=record["datetime"][:10],
        topics="\n\n".join(topics(record["benchmarks"])),
    )
    page.write_text(text, encoding="utf-8")
    print(text)
