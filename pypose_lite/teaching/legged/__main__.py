"""Makes the picture of README and opening page: ``python -m pypose_lite.teaching.legged FILE``.

A dog with legs is asked how it responds to commands, and another one then walks the infinity by a
planner that knows: chapter 9's lap.
"""

import sys
import tempfile
from pathlib import Path

from ... import go1, infinity
from ...go1.walk import START, walk
from .pictures import ON_INFINITY, snapshots, walked
from .render import NoOpenGL
from .scene import Array

SPEED, TOLERANCE, STEP = 0.5, 0.15, 0.1  # m/s, m, s


def lap() -> tuple[infinity.Run, Array]:
    """A lap by the book's loop, and where the dog's joints were."""
    other = go1.Simulation(body="legs", seed=100)
    with tempfile.TemporaryDirectory() as folder:
        log = Path(folder) / "response.csv"
        with go1.connect("sim:legs", simulation=other, ignore=("motion",), log=log) as robot:
            go1.excite(robot)
        response = go1.identify(go1.read_log(log))
    with go1.connect("sim:legs", start=START, trim=response.trim) as robot:
        run = walk(robot, SPEED, response=response, tolerance=TOLERANCE)
        return run, walked(robot, START, STEP * int(run.steps))


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
