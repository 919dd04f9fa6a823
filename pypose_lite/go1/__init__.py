"""The Unitree Go1: its packets, its safety rules, a robot for the closed loop, and a simulator.

`connect` gives a robot; `python -m pypose_lite.go1 walk` walks the infinity with it, and
`python -m pypose_lite.go1.simulator` is one to try that on. Chapter 9 tells how. Nothing here was
tried on a real robot.
"""

from . import protocol
from .commands import Gait, Mode
from .connection import connect
from .dog import Numbers
from .faults import Faults
from .log import read_log
from .pilot import RobotTimeout
from .robot import Robot
from .simulation import Simulation

__all__ = [
    "connect",
    "Robot",
    "RobotTimeout",
    "Mode",
    "Gait",
    "Simulation",
    "Numbers",
    "Faults",
    "read_log",
    "protocol",
]
