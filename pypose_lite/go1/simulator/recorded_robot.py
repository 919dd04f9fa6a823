"""A recorded run at the far end of a transport, played back as if it were a robot."""

import bisect
import math
import time
from collections.abc import Callable

from ..log import Row
from ..wire.protocol import BmsState, HighState, Imu, ProtocolError, decode_command, encode_state
from ..wire.transport import Transport
from .body import quaternion


class RecordedRobot:
    """A recorded run at the far end of a transport: it reports what was recorded, at its time.

    What it is told does not move it. After its last row it says nothing new.
    """

    def __init__(
        self, transport: Transport, rows: list[Row], now: Callable[[], float] = time.monotonic
    ) -> None:
        self._transport, self._rows, self._now = transport, rows, now
        self._times = [row.t - rows[0].t for row in rows]
        self._start: float | None = None  # when the first command came
        self._shown, self._content = -1, b""

    def step(self, timeout: float = 0.0) -> None:
        """Hears what has come (waits up to `timeout` s for it), and answers."""
        data = self._transport.receive(timeout)
        while data is not None:
            try:
                decode_command(data)
                self._transport.send(self._state(self._now()))
            except ProtocolError:
                pass
            data = self._transport.receive(0.0)

    def _state(self, now: float) -> bytes:
        """The packet of that moment."""
        self._start = now if self._start is None else self._start
        index = max(bisect.bisect_right(self._times, now - self._start + 1e-9) - 1, 0)
        if index != self._shown:
            self._shown, self._content = index, encode_state(_recorded(self._rows[index]))
        return self._content


def _recorded(row: Row) -> HighState:
    """A state with what a row holds; its time, in a reserved field, keeps rows apart."""
    rpy = row.roll, row.pitch, row.heading
    feet = row.foot_fr, row.foot_fl, row.foot_rr, row.foot_rl
    return HighState(
        imu=Imu(quaternion=quaternion(*rpy), rpy=rpy),
        bms=BmsState(soc=int(row.soc)),
        foot_force=tuple(int(force) if math.isfinite(force) else 0 for force in feet),
        mode=int(row.mode),
        progress=row.t,
        position=(row.x, row.y, row.body_height if math.isfinite(row.body_height) else 0.0),
        body_height=row.body_height,
        velocity=(row.v, row.left, 0.0),
        yaw_speed=row.yaw_rate,
    )
