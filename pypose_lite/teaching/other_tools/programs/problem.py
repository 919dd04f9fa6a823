"""The one problem that every tool here is given, and how its answer is printed."""

import json
import math
import statistics
import time

DT = 0.1  # s
T = 10  # steps
START = [0.0, 0.0, 0.0, -1.0]  # [i, j, cos, sin]: the first waypoint
ROOT = math.sqrt(0.5)
TARGET = [1 - ROOT, -ROOT, ROOT, -ROOT]  # the second waypoint
STATE_WEIGHTS = [1.0, 1.0, 0.3, 0.3]
INPUT_WEIGHTS = [0.01, 0.01]
LOWER = [0.0, -4.0]  # m/s, rad/s
UPPER = [2.0, 4.0]


def car(x, u, cos, sin):
    """The next state of the car, by any tool's cosine and sine."""
    i, j, c, s = (x[k] for k in range(4))
    turn = u[1] * DT
    c, s = c * cos(turn) - s * sin(turn), s * cos(turn) + c * sin(turn)
    return [i + u[0] * DT * c, j + u[0] * DT * s, c, s]


def report(tool: str, version: str, solve) -> None:
    """Prints a plan's first input, its cost, and the median time of nine."""
    plan = solve()  # warms up
    times = []
    for _ in range(9):
        begin = time.perf_counter()
        plan = solve()
        times.append(time.perf_counter() - begin)
    u = [[float(a), float(b)] for a, b in plan]
    found = {"u0": u[0], "cost": cost(u), "ms": 1e3 * statistics.median(times)}
    print(json.dumps({"tool": tool, "version": version, **found}))


def cost(u) -> float:
    """What a plan costs, however the tool itself counts."""
    x, total = START, 0.0
    for step in u:
        away = [a - b for a, b in zip(x, TARGET)]
        total += sum(w * a**2 for w, a in zip(STATE_WEIGHTS, away)) / 2
        total += sum(w * a**2 for w, a in zip(INPUT_WEIGHTS, step)) / 2
        x = car(x, step, math.cos, math.sin)
    return total
