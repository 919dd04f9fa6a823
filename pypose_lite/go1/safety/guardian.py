"""A second process that keeps the robot standing when the program that drives it cannot.

The sender's thread tells it in every beat what would be zero velocity, and what a stand. When the
thread falls silent (the program was killed, stopped, crashed, or hangs inside a C function), the
guardian sends them itself, from the same address: zero velocity first, then the stand. It ends
when the program has said goodbye to the robot, or `AFTERLIFE` seconds after the program.

It needs pass_fds, that is Linux or macOS. It dies with a container whose first process is the
program: the kernel ends all that lives there ("On the real robot" in the book has the remedy).
"""

import os
import select
import signal
import socket
import subprocess
import sys
import time

AFTERLIFE = 2.0  # s, for which it goes on after the program has died
SETTLING = 0.5  # s of zero velocity, after which it sends the stand


class Guardian:
    """The program's end of it.

    Args:
        sock: the socket on which commands go to the robot.
        size: bytes of a packet.
        period: s between two of its packets.
        silence: s without a beat after which it begins to send.
    """

    def __init__(self, sock: socket.socket, size: int, period: float, silence: float) -> None:
        numbers = (sock.fileno(), size, period, silence)
        self._process = subprocess.Popen(
            [sys.executable, "-I", __file__, *map(str, numbers)],
            stdin=subprocess.PIPE,
            bufsize=0,
            pass_fds=[sock.fileno()],
            start_new_session=True,  # Ctrl-C and Ctrl-Z in the terminal do not reach it
        )
        assert self._process.stdin is not None
        self._pipe = self._process.stdin.fileno()
        os.set_blocking(self._pipe, False)

    def beat(self, zero: bytes, stand: bytes) -> bool:
        """Says "I am alive, and these would stop the robot"; False if the guardian is dead."""
        try:
            os.write(self._pipe, zero + stand)
        except BlockingIOError:  # it is slow; one beat is like another
            pass
        except OSError:
            return False
        return True

    def close(self, complete: bool = False) -> None:
        """Ends it after a complete farewell; after another it does its work, and then ends."""
        assert self._process.stdin is not None
        if complete:
            self._process.kill()
            self._process.wait()
        self._process.stdin.close()


def guard(sock: socket.socket, pipe: int, size: int, period: float, silence: float) -> None:
    """Reads beats from the pipe; sends the last one while none come; ends after the program."""
    beat, heard, parent = b"", time.monotonic(), os.getppid()
    began = None  # when it began to send
    while os.getppid() == parent:
        if select.select([pipe], [], [], period)[0]:
            beats = os.read(pipe, 1 << 16)
            if not beats:
                break
            beat, heard, began = beats[-2 * size :], time.monotonic(), None
        elif beat and time.monotonic() - heard > silence:
            began = _send(sock, beat, size, began)
    for _ in range(int(AFTERLIFE / period) if beat else 0):
        began = _send(sock, beat, size, began)
        time.sleep(period)


def _send(sock: socket.socket, beat: bytes, size: int, began: float | None) -> float:
    """Sends the half of a beat that is due; a network that does not take it is tried again."""
    began = time.monotonic() if began is None else began
    try:
        sock.send(beat[:size] if time.monotonic() - began < SETTLING else beat[size:])
    except OSError:
        pass
    return began


if __name__ == "__main__":
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, signal.SIG_IGN)  # it ends when its program has ended, not before
    guard(
        socket.socket(fileno=int(sys.argv[1])),
        sys.stdin.fileno(),
        int(sys.argv[2]),
        float(sys.argv[3]),
        float(sys.argv[4]),
    )
