"""A second process that keeps the robot standing when the program that drives it cannot.

The sender's thread tells it in every beat which packet would be zero velocity. When the thread
falls silent (the program was killed, stopped, crashed, or hangs inside a C function), the guardian
sends that packet itself, from the same address. It needs pass_fds, that is Linux or macOS.
"""

import os
import select
import signal
import socket
import subprocess
import sys
import time

AFTERLIFE = 2.0  # s, for which it goes on after the program has died


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

    def beat(self, packet: bytes) -> bool:
        """Says "I am alive, and this would be zero velocity"; False if the guardian is dead."""
        try:
            os.write(self._pipe, packet)
        except BlockingIOError:  # it is slow; one beat is like another
            pass
        except OSError:
            return False
        return True

    def close(self) -> None:
        """Ends it."""
        self._process.kill()
        self._process.wait()
        assert self._process.stdin is not None
        self._process.stdin.close()


def guard(sock: socket.socket, pipe: int, size: int, period: float, silence: float) -> None:
    """Reads beats from the pipe; sends the last packet while none come; ends after the program."""
    packet, heard, parent = b"", time.monotonic(), os.getppid()
    while os.getppid() == parent:
        if select.select([pipe], [], [], period)[0]:
            beats = os.read(pipe, 1 << 16)
            if not beats:
                break
            packet, heard = beats[-size:], time.monotonic()
        elif packet and time.monotonic() - heard > silence:
            _send(sock, packet)
    for _ in range(int(AFTERLIFE / period) if packet else 0):
        _send(sock, packet)
        time.sleep(period)


def _send(sock: socket.socket, packet: bytes) -> None:
    """Sends a packet; a network that does not take it is tried again with the next."""
    try:
        sock.send(packet)
    except OSError:
        pass


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
