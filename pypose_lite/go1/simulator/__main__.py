"""The simulated Go1 as a program of its own.

python -m pypose_lite.go1.simulator --port 8082 --model edu
python -m pypose_lite.go1.simulator --body legs
"""

import argparse
import sys
from collections.abc import Sequence
from dataclasses import fields

from ..wire.protocol import COMMAND_SIZE
from ..wire.transport import UdpServer
from .body import STEP, Numbers
from .faults import Faults
from .floor import Floor
from .simulated_robot import BODIES, SimulatedRobot, Simulation


def main(arguments: Sequence[str] | None = None) -> int:
    """Runs a simulated robot until Ctrl-C, and returns the program's exit status."""
    parser = _parser()
    options = parser.parse_args(arguments)
    try:
        faults = Faults(**{f.name: getattr(options, f.name) for f in fields(Faults)})
        floor = Floor(**{f.name: getattr(options, f.name) for f in fields(Floor)})
        server = UdpServer(options.host, options.port, COMMAND_SIZE, Numbers().silence)
    except ValueError as error:
        parser.error(str(error))
    numbers = Numbers(lag=options.lag, dead_band=options.dead_band)
    line = faults, options.freeze, options.vanish
    setup = Simulation(options.model, options.seed, numbers, *line, options.body, floor)
    walker = "simulated Go1" if options.body == "point" else "Go2's body and gait as a Go1"
    try:
        simulator = SimulatedRobot(server, setup, report=_say)
        _say(f"{walker} ({options.model}) on udp://{options.host}:{server.port}")
        while True:
            simulator.step(timeout=STEP)
    except KeyboardInterrupt:
        return 0
    except RuntimeError as error:  # legs that are not installed, or physics that failed
        print(error, file=sys.stderr, flush=True)
        return 1
    finally:
        server.close()


def _say(line: str) -> None:
    """Prints a line at once, also into a pipe."""
    print(line, flush=True)


def _parser() -> argparse.ArgumentParser:
    """What `python -m pypose_lite.go1.simulator` takes."""
    parser = argparse.ArgumentParser(
        prog="python -m pypose_lite.go1.simulator",
        description="A simulated Go1 on UDP: it speaks the robot's protocol.",
        formatter_class=argparse.ArgumentDefaultsHelpFormatter,
    )
    add, standard = parser.add_argument, Simulation()
    add("--host", default="127.0.0.1", help="address to listen on")
    add("--port", type=int, default=8082, help="port to listen on; 0 takes a free one")
    add("--model", choices=["edu", "pro"], default="edu", help="whose checksums it takes")
    add("--seed", type=int, default=0, help="of its noise and its faults")
    add("--body", choices=BODIES, default="point", help="a point with a lag, or legs with physics")
    add("--lag", type=float, default=standard.numbers.lag, help="s, of a point's velocities")
    add("--dead-band", type=float, default=standard.numbers.dead_band, help="m/s, of a point")
    for name, what in (
        ("slope", "rad, by which the floor under legs rises ahead"),
        ("friction", "of a foot on it"),
        ("step", "m, the height of a step up"),
        ("distance", "m, to the step"),
    ):
        add(f"--{name}", type=float, default=getattr(standard.floor, name), help=what)
    for name, what in (
        ("loss", "share of datagrams lost, each way"),
        ("delay", "s, each way"),
        ("duplicates", "share of datagrams that come twice"),
        ("reordering", "share of datagrams held back"),
        ("garbage", "share of datagrams followed by garbage"),
        ("lateness", "s, the most a doubled or held-back datagram is late"),
    ):
        add(f"--{name}", type=float, default=getattr(standard.faults, name), help=what)
    add("--freeze", type=float, default=standard.freeze, help="s until its state stops changing")
    add("--vanish", type=float, default=standard.vanish, help="s until it falls silent")
    return parser


if __name__ == "__main__":
    sys.exit(main())
