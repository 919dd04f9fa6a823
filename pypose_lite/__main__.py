"""``python -m pypose_lite`` drives the lap, prints its errors, and saves a picture of it.

The car drives twice: once it sees exactly where it is; once it sees that through noise, and steers
by the estimate of an EKF.
"""

import argparse
import os
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, NoReturn

if TYPE_CHECKING:
    from .infinity import Run

HEAD = "", "seen exactly", "through noise"
INSTALL = "pip install 'pypose_lite[book]'"


class Parser(argparse.ArgumentParser):
    """Says in one line what it does not understand."""

    def error(self, message: str) -> NoReturn:
        """Ends the program."""
        self.exit(2, f"pypose_lite: {message}; see {self.prog} --help\n")


def parser() -> Parser:
    """What the command line takes."""
    about = " ".join((__doc__ or "").replace("``", "").split())
    made = Parser(prog="python -m pypose_lite", description=about)
    made.add_argument("--picture", default="infinity.png", help="where to; %(default)s")
    made.add_argument("--seed", type=int, default=0, help="of the noise; %(default)s")
    return made


def laps(seed: int) -> "list[Run]":
    """Returns a lap of a car that sees exactly where it is, and a lap through noise."""
    import torch

    from . import EKF, DubinsCar
    from .infinity import OBSERVATION_NOISE, PROCESS_NOISE, SimulatedCar, controller, drive

    car, generator = DubinsCar(), torch.Generator().manual_seed(seed)
    noisy = SimulatedCar(car, None, PROCESS_NOISE, OBSERVATION_NOISE, generator)
    return [drive(controller(car)), drive(controller(car), noisy, EKF(car))]


def rows(runs: "list[Run]") -> Iterator[tuple[str, ...]]:
    """The lines of the table: a name, and a number for each lap; distances are in metres."""
    from .infinity import tracking_error, waypoints

    def row(name: str, distances) -> tuple[str, ...]:
        return name, *(f"{distance.item():.3f} m" for distance in distances)

    last = len(waypoints()) - 1
    reached = [last + 1 if run.finished else int(run.goal[-1]) for run in runs]
    yield "waypoints reached", *map(str, reached)
    yield "steps of 0.1 s", *(str(run.steps.item()) for run in runs)
    yield row("off the path, on average", [tracking_error(run.x).mean() for run in runs])
    yield row("off the path, at most", [tracking_error(run.x).max() for run in runs])
    yield row("error of what is seen", [position_error(run, run.y) for run in runs])
    yield row("error of the estimate", [position_error(run, run.estimate) for run in runs])


def position_error(run: "Run", seen):
    """Returns how far positions ``seen (N, 4)`` are from the true ones, on average."""
    return (seen - run.x[:-1])[:, :2].norm(dim=-1).mean()


def draw(runs: "list[Run]", path: Path) -> None:
    """Saves the picture of the laps, one above the other."""
    from matplotlib.figure import Figure

    from .teaching.plotting import GREY, plot_course, plot_heading, plot_states, use_style

    use_style()
    fig = Figure(figsize=(7, 8))
    for ax, run, title in zip(fig.subplots(2), runs, HEAD[1:]):
        plot_course(ax, title)
        if not run.y.equal(run.x[:-1]):
            ax.plot(*run.y[:, :2].mT, "x", color=GREY, ms=4, label="seen")
        plot_states(ax, run.x, "steps of the car")
        plot_heading(ax, run.x[-1:])
        ax.legend(loc="upper center", ncols=4, fontsize=8)
    fig.savefig(path, dpi=110)


def main(arguments: Sequence[str] | None = None) -> int:
    """Does it, and returns the program's exit status; what goes wrong is said in a line."""
    options = parser().parse_args(arguments)
    try:
        runs = laps(options.seed)
        for name, *numbers in (HEAD, *rows(runs)):
            print(f"{name:<26}" + "".join(f"{number:>16}" for number in numbers))
        return saved(runs, Path(options.picture).absolute())
    except ImportError as error:
        others = "PYTHONPATH" in os.environ
        return failed(f"{error}; {'unset PYTHONPATH' if others else INSTALL}")


def saved(runs: "list[Run]", path: Path) -> int:
    """Saves the picture, says where it is, and returns the exit status."""
    try:
        draw(runs, path)
    except (OSError, ValueError) as error:
        return failed(f"the picture cannot be saved: {error}; name another by --picture")
    print(f"\nThe picture: {path}")
    return 0


def failed(why: str) -> int:
    """Says it in one line, and returns the exit status."""
    print(f"pypose_lite: {' '.join(why.split())}", file=sys.stderr)
    return 1


if __name__ == "__main__":
    sys.exit(main())
