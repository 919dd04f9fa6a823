"""What one car of a batch costs, against the size of the batch: measured once, and kept.

`python -m pypose_lite.teaching.batches` measures on one thread and writes a record, which takes
minutes. The lesson on thousands of cars shows the record, so that building the book measures
nothing. Times are the processor's, of the quickest of a few rounds.
"""

import json
import platform
import time
from collections.abc import Callable
from datetime import date
from pathlib import Path

import torch

from .. import infinity
from ..control import MPC
from ..systems import DubinsCar
from ..utils import ReduceToBason

RECORD = Path(__file__).parent / "recordings" / "batches.json"
HORIZONS = (5, 10, 20, 50)
SIZES = (1, 4, 16, 64, 256, 1024, 4096)
CARS = (1, 8, 64, 512, 4096, 32768, 100_000)


def record() -> dict:
    """Returns the record, with its ``date`` and its ``machine``.

    ``plan`` has seconds of a batch of plans, three sweeps each, by horizon and size; ``step`` those
    of one step of cars that a gain steers, by size; ``compiled`` those of a small function of
    100,000 numbers, plain and compiled, and how long the compiler took.
    """
    return json.loads(RECORD.read_text(encoding="utf-8"))


def plans(horizon: int, size: int) -> Callable[[], object]:
    """Returns a function that makes a batch of cold plans, three sweeps each."""
    path, i = infinity.waypoints(), torch.arange(size) % 15
    noise = torch.randn(size, 4, generator=torch.Generator().manual_seed(0))
    Q = torch.diag(torch.tensor([1, 1, 0.3, 0.3, 0.01, 0.01]))
    mpc = MPC(DubinsCar(), Q, None, horizon, ReduceToBason(steps=3))
    return lambda: mpc(0.1, path[i] + infinity.OBSERVATION_NOISE * noise, path[i + 2])


def steps(cars: int) -> Callable[[], object]:
    """Returns a function that moves a batch of cars by one step, with a gain and with noise."""
    car, gain, aim = DubinsCar(), torch.full((2, 4), -0.1), infinity.waypoints()[0]
    x, generator = aim.expand(cars, 4), torch.Generator().manual_seed(0)

    def step():
        moved = car.transition(x, (x - aim) @ gain.mT)
        return moved + 0.01 * torch.randn(cars, 4, generator=generator)

    return step


def turned(theta: torch.Tensor) -> torch.Tensor:
    """Returns the squared sine and cosine of an angle, added up in a roundabout way."""
    return theta.sin().square() + theta.cos().square() * torch.exp(-theta.square())


def seconds(work: Callable[[], object], at_least: float = 0.5) -> float:
    """Returns the processor's seconds of the quickest round, of three or more."""
    work()
    rounds: list[float] = []
    while len(rounds) < 3 or sum(rounds) < at_least:
        begin = time.process_time()
        work()
        rounds.append(time.process_time() - begin)
    return min(rounds)


def compiled() -> dict[str, float]:
    """Returns what torch.compile costs and brings for one small function."""
    theta = torch.linspace(-3, 3, 100_000)
    plain = seconds(lambda: turned(theta))
    quick = torch.compile(turned)
    begin = time.perf_counter()
    torch.testing.assert_close(quick(theta), turned(theta))
    compiler = time.perf_counter() - begin
    return {"plain": plain, "compiled": seconds(lambda: quick(theta)), "compiler": compiler}


def measure() -> dict:
    """Returns a new record."""
    table = {
        str(horizon): {str(size): seconds(plans(horizon, size)) for size in SIZES}
        for horizon in HORIZONS
    }
    machine = f"{platform.machine()}, one thread, Python {platform.python_version()}, "
    return {
        "date": date.today().isoformat(),
        "machine": machine + f"torch {torch.__version__}",
        "plan": table,
        "step": {str(cars): seconds(steps(cars)) for cars in CARS},
        "compiled": compiled(),
    }


if __name__ == "__main__":
    torch.set_num_threads(1)
    torch.set_default_dtype(torch.float64)
    RECORD.write_text(json.dumps(measure(), indent=1) + "\n", encoding="utf-8")
    print(f"wrote {RECORD}")
