"""The Unitree Go1: its packets, its safety rules, a robot for the closed loop, and a simulator.

`connect` gives a robot; `python -m pypose_lite.go1 walk` walks the infinity with it, and
`python -m pypose_lite.go1.simulator` is one to try that on. Chapter 9 tells how. Nothing here was
tried on a real robot.

The public names are imported when they are first asked for, and nothing but `walk` and the model of
a `Response` needs torch: whoever wants the packets alone, on a small computer, loads those alone.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .connection import connect
    from .identification import Response, excite, identify
    from .log import read_log
    from .robot import Robot
    from .safety.limits import Gait, Mode
    from .safety.pilot import Pilot, RobotStopped, RobotTimeout
    from .simulator.body import Numbers
    from .simulator.faults import Faults
    from .simulator.simulated_robot import SimulatedRobot, Simulation
    from .wire import protocol

_PLACES = {
    "connect": "connection",
    "Response": "identification",
    "excite": "identification",
    "identify": "identification",
    "Robot": "robot",
    "RobotTimeout": "safety.pilot",
    "RobotStopped": "safety.pilot",
    "Pilot": "safety.pilot",
    "Mode": "safety.limits",
    "Gait": "safety.limits",
    "SimulatedRobot": "simulator.simulated_robot",
    "Simulation": "simulator.simulated_robot",
    "Numbers": "simulator.body",
    "Faults": "simulator.faults",
    "read_log": "log",
    "protocol": "wire.protocol",
}

__all__ = [
    "connect",
    "Robot",
    "RobotTimeout",
    "RobotStopped",
    "Pilot",
    "Mode",
    "Gait",
    "SimulatedRobot",
    "Simulation",
    "Numbers",
    "Faults",
    "read_log",
    "Response",
    "excite",
    "identify",
    "protocol",
]


def __getattr__(name: str) -> Any:
    """Imports a public name when it is first asked for."""
    if name not in _PLACES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    module = import_module(f".{_PLACES[name]}", __name__)
    globals()[name] = value = module if name == "protocol" else getattr(module, name)
    return value


def __dir__() -> list[str]:
    return sorted(__all__)
