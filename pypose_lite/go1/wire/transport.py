"""Ways for datagrams to travel: UDP, and a pair of ends in memory.

A transport has three methods: `send(data)`, `receive(timeout) -> bytes | None`, and `close()`.
Nothing is promised, as with UDP itself: datagrams may be lost, late, doubled, or out of order.
"""

import queue
import socket
import time
from typing import Protocol

LARGEST = 2048  # bytes; a longer datagram is cut, and so is refused by its length


class Transport(Protocol):
    """What a robot and a simulator speak through."""

    def send(self, data: bytes) -> None:
        """Sends one datagram; what the network does not take is lost, without an error."""

    def receive(self, timeout: float) -> bytes | None:
        """The next datagram, or None when none came within `timeout` seconds."""

    def close(self) -> None:
        """Frees the resources; nothing may be sent afterwards."""


class Udp:
    """A client's socket: it talks to one address, and hears that address alone.

    Args:
        host: the robot's name or address.
        port: the robot's port.
        own_port: this end's, as a robot knows its client by it; 0 takes a free one.
    """

    def __init__(self, host: str, port: int, own_port: int = 0) -> None:
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.failures = 0  # datagrams that the network did not take, or that found nobody there
        try:
            if own_port:
                self.socket.bind(("", own_port))
            self.socket.connect((host, port))
            self.port: int = self.socket.getsockname()[1]
        except (OSError, OverflowError) as error:
            self.socket.close()
            raise ValueError(f"udp://{host}:{port}: no such address ({error})") from error

    def send(self, data: bytes) -> None:
        """Sends one datagram; with nobody listening the system complains now and then: no harm."""
        try:
            self.socket.send(data)
        except OSError:
            self.failures += 1

    def receive(self, timeout: float) -> bytes | None:
        """The next datagram, or None when none came within `timeout` seconds."""
        try:
            self.socket.settimeout(max(timeout, 0.0))
            return self.socket.recv(LARGEST)
        except ConnectionRefusedError:  # the system says that nobody is there
            self.failures += 1
            return None
        except OSError:  # nothing came in time
            return None

    def close(self) -> None:
        """Closes the socket."""
        self.socket.close()


class UdpServer:
    """A server's socket: it holds on to its first client, and lets go after a silence.

    Args:
        host: the address to listen on.
        port: the port; 0 takes a free one, found in `port`.
        size: bytes of a datagram that counts; one of another size is dropped.
        silence: seconds without a word after which another client may come.
    """

    def __init__(self, host: str, port: int, size: int, silence: float) -> None:
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        try:
            self.socket.bind((host, port))
        except (OSError, OverflowError) as error:
            self.socket.close()
            raise ValueError(f"udp://{host}:{port}: cannot listen there ({error})") from error
        self.port: int = self.socket.getsockname()[1]
        self._size, self._silence = size, silence
        self._client: tuple | None = None
        self._heard = 0.0

    def send(self, data: bytes) -> None:
        """Sends one datagram to the client, if there is one."""
        if self._client is not None:
            try:
                self.socket.sendto(data, self._client)
            except OSError:  # the client is gone; its silence will free its place
                pass

    def receive(self, timeout: float) -> bytes | None:
        """The client's next datagram, or None when none came within `timeout` seconds."""
        end = time.monotonic() + timeout
        for _ in range(64):  # a flood from strangers does not hold us here
            try:
                self.socket.settimeout(max(end - time.monotonic(), 0.0))
                data, sender = self.socket.recvfrom(LARGEST)
            except OSError:  # nothing came in time
                return None
            now = time.monotonic()
            if len(data) == self._size and self._may_speak(sender, now):
                self._client, self._heard = sender, now
                return data
        return None

    def close(self) -> None:
        """Closes the socket."""
        self.socket.close()

    def _may_speak(self, sender: tuple, now: float) -> bool:
        """Whether a datagram of that sender is heard."""
        return self._client in (None, sender) or now - self._heard > self._silence


class Memory:
    """One end of a pair in memory; see `pair`."""

    def __init__(self, inbox: queue.Queue, outbox: queue.Queue) -> None:
        self._inbox, self._outbox = inbox, outbox

    def send(self, data: bytes) -> None:
        """Puts one datagram into the other end's box; a full box loses it."""
        try:
            self._outbox.put_nowait(bytes(data))
        except queue.Full:
            pass

    def receive(self, timeout: float) -> bytes | None:
        """The next datagram, or None when none came within `timeout` seconds."""
        try:
            return self._inbox.get(block=timeout > 0, timeout=timeout)
        except queue.Empty:
            return None

    def close(self) -> None:
        """Does nothing: there is nothing to free."""


def pair(size: int = 256) -> tuple[Memory, Memory]:
    """Two ends in memory; the box of each holds `size` datagrams, further ones are lost."""
    here: queue.Queue = queue.Queue(size)
    there: queue.Queue = queue.Queue(size)
    return Memory(here, there), Memory(there, here)
