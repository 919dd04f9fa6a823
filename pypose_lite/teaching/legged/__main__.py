"""Makes the picture of README and opening page: ``python -m pypose_lite.teaching.legged FILE``.

A dog with legs walks the infinity by chapter 3's controller, at up to 1 m/s.
"""

import math
import sys
from pathlib import Path

import torch

from ... import go1, infinity
from ...utils import ReduceToBason
from .pictures import ON_INFINITY, snapshots, walked
from .render import NoOpenGL
from .scene import Array

START = (0.0, 0.0, -math.pi / 2)  # m, m, rad
LOW, HIGH = torch.tensor([[0.0, -1.2], [1.0, 1.2]], dtype=torch.float64)  # m/s, rad/s
TOLERANCE = 0.2  # m


def lap() -> tuple[infinity.Run, Array]:
    """A lap by the book's loop, and where the dog's joints were."""
    mpc = infinity.controller(dtype=torch.float64)
    mpc.stepper = ReduceToBason(steps=2)
    first = infinity.waypoints(torch.float64)[0]
    with go1.connect("sim:legs", start=START) as robot:
        world = infinity.RealRobot(robot, x_init=first)
        run = infinity.drive(mpc, world, tolerance=TOLERANCE, steps=300, u_lower=LOW, u_upper=HIGH)
        return run, walked(robot, START, world.dt * int(run.steps))


def main(target: Path) -> None:
    """Writes the picture, or ends with a line that says why not."""
    run, walk = lap()
    if not run.finished:
        sys.exit(f"the dog has not come around: {int(run.goal[-1]) - 1} waypoints reached")
    try:
        picture = snapshots(walk, run.x, ON_INFINITY, stand_in=False)
    except NoOpenGL as reason:
        sys.exit(f"{target} stays as it is: MuJoCo cannot draw here ({reason})")
    target.write_bytes(picture.data)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
