"""A simulated Go1 at the far end of a transport, by the rules of the robot's protocol.

`Numbers` (body.py) names what it assumes of the body, `Faults` (faults.py) what may go wrong on the
line, `Simulation` the rest. It follows what the vendor's SDK was seen to accept, not a robot.
"""

import time
from collections.abc import Callable
from dataclasses import dataclass, field

from ..safety.limits import NUMBERS, still
from ..wire.protocol import (
    COMMAND_SIZE,
    HEAD,
    HighCmd,
    ProtocolError,
    decode_command,
    encode_state,
)
from ..wire.transport import Transport
from .body import STEP, Dog, Numbers
from .faults import Faults, FaultyLine
from .floor import Floor
from .point import PointDog

BODIES = ("point", "legs")
GREATEST = 100.0  # m/s, rad/s, rad, m: more is nonsense


@dataclass(frozen=True)
class Simulation:
    """How a simulated robot is set up.

    Attributes:
        model: "edu", which takes level EE with a plain or an encrypted checksum, or "pro", which
            takes it encrypted only; both take level 00 plain. They answer EE encrypted.
        seed: of every random draw.
        numbers: of the body.
        faults: of the line.
        freeze: seconds after the first command at which its state stops changing, while it goes
            on being sent.
        vanish: seconds after the first command at which it falls silent and hears nothing more.
        body: "point", which follows the command with a lag, or "legs", a Go2's by its physics.
        floor: under the legs.
    """

    model: str = "edu"
    seed: int = 0
    numbers: Numbers = field(default_factory=Numbers)
    faults: Faults = field(default_factory=Faults)
    freeze: float = float("inf")
    vanish: float = float("inf")
    body: str = "point"
    floor: Floor = field(default_factory=Floor)


class SimulatedRobot:
    """A robot at the far end of a transport, alive as long as `step` is called.

    Attributes:
        dog: the body; `dog.pose` is where it truly is.
        applied: how many commands it has taken.
        refused: how many datagrams it did not take.
        report: called with a line for each kind of nonsense that it refuses, once.
    """

    def __init__(
        self,
        transport: Transport,
        simulation: Simulation,
        now: Callable[[], float] = time.monotonic,
        report: Callable[[str], None] = lambda line: None,
    ) -> None:
        self.dog = _born(simulation)
        self.applied = self.refused = 0
        self.report, self._reported = report, set[str]()
        self._line = FaultyLine(transport, simulation.faults, simulation.seed, now)
        self._simulation, self._now = simulation, now
        self._time = self._heard = now()  # the body's time; when a command was last applied
        self._start = float("inf")  # when the first command was applied
        self._content, self._content_due = b"", self._time

    def step(self, timeout: float = 0.0) -> None:
        """Hears what has come (waits up to `timeout` s for it), moves on to now, and answers."""
        answers = 0
        data = self._line.receive(timeout)
        while data is not None and answers < 64:  # a flood does not keep it from moving on
            answers += self._take(data)
            data = self._line.receive(0.0)
        now = self._now()
        if now - self._heard > self._simulation.numbers.watchdog:
            self.dog.ask(still(self.dog.command))
        self._time = max(self._time, now - 1.0)  # after a pause of the program, no catching up
        while self._time + STEP <= now + 1e-9:
            self.dog.step()
            self._time += STEP
        self._refresh(now)
        for _ in range(answers):
            self._line.send(self._content)

    def _take(self, data: bytes) -> bool:
        """Whether a datagram is answered; a command in it is applied if its checksum is right.

        It answers whatever looks like a command, as the state arrives even where commands are
        ignored: the usual sight when the level flag is wrong for the model.
        """
        now = self._now()
        if now - self._start > self._simulation.vanish:
            return False
        try:
            command = decode_command(data, developer=self._simulation.model == "edu")
        except ProtocolError:
            self.refused += 1
            return len(data) == COMMAND_SIZE and data[:2] == HEAD
        if nonsense := _nonsense(command):
            self.refused += 1
            if nonsense not in self._reported:
                self._reported.add(nonsense)
                self.report(f"refused: {nonsense} is not finite, or greater than {GREATEST:g}")
            return True
        self._start, self._heard = min(self._start, now), now
        self.applied += 1
        self.apply(command)
        return True

    def apply(self, command: HighCmd) -> None:
        """Hands a command to the body; tests watch here."""
        self.dog.ask(command)

    def _refresh(self, now: float) -> None:
        """Renews the content of the state when it is due, unless it is frozen."""
        if now >= self._content_due and now - self._start <= self._simulation.freeze:
            self._content = encode_state(self.dog.state())
            self._content_due = max(self._content_due, now - 1.0) + (
                1.0 / self._simulation.numbers.content_rate
            )


def _born(simulation: Simulation) -> Dog:
    """The body that a simulation asks for."""
    if simulation.body not in BODIES:
        raise ValueError(f"body: expected one of {[*BODIES]}, got {simulation.body!r}")
    setup = simulation.numbers, simulation.seed, simulation.model
    if simulation.body == "point":
        return PointDog(*setup)
    from .legs.dog import LeggedDog  # needs MuJoCo, which only legs do

    return LeggedDog(*setup, simulation.floor)


def _nonsense(command: HighCmd) -> str | None:
    """The name of a number that no body can follow, NaN, infinite or huge; None if all are sane.

    What a real robot does with such a number is not known.
    """
    for name in NUMBERS:
        value = getattr(command, name)
        numbers = value if isinstance(value, tuple) else (value,)
        if not all(abs(number) <= GREATEST for number in numbers):
            return name
    return None
