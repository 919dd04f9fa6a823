"""The Go1's packets, bytes to values and back, with no socket, clock or thread.

Every dataclass below is the table of its packet: the fields in the order of the wire, each with
its `struct` format (`layout.wire`), little-endian. A packet has no sequence number and no time.

Source: unitreerobotics/unitree_legged_sdk, branch go1, comm.h; checksums and which of them a
receiver accepts were seen by running the vendor's SDK 3.8.6 on loopback. Nothing was tried on a
robot. Chapter 9 takes both packets apart byte by byte.
"""

import zlib
from array import array
from dataclasses import dataclass
from typing import Any

from .layout import pack, unpack, wire

COMMAND_SIZE, STATE_SIZE = 129, 1087
HEAD, HIGH_LEVEL = b"\xfe\xef", 0xEE


class ProtocolError(ValueError):
    """Bytes that are no packet of this protocol."""


@dataclass(frozen=True)
class BmsCmd:
    """What a command says to the battery: 0xA5 in `off` powers it OFF, so it stays 0."""

    off: int = wire("B")
    reserve: tuple = wire("B", 3)


@dataclass(frozen=True)
class HighCmd:
    """A high-level command, computer to robot, 129 bytes with its checksum."""

    head: bytes = wire("2s", default=HEAD)
    level_flag: int = wire("B", default=HIGH_LEVEL)  # 0x00 for an Air or a Pro
    frame_reserve: int = wire("B")
    sn: tuple = wire("I", 2)
    version: tuple = wire("I", 2)
    band_width: int = wire("H")
    mode: int = wire("B")
    gait_type: int = wire("B")
    speed_level: int = wire("B")  # reserved
    foot_raise_height: float = wire("f")  # m, a change of it
    body_height: float = wire("f")  # m, a change of it
    position: tuple = wire("f", 2)  # reserved
    euler: tuple = wire("f", 3)  # rad: roll, pitch, yaw of the body, mode 1 only
    velocity: tuple = wire("f", 2)  # m/s, forward and left
    yaw_speed: float = wire("f")  # rad/s, counter-clockwise
    bms: BmsCmd = wire(BmsCmd)
    led: bytes = wire("12s")  # reserved
    wireless_remote: bytes = wire("40s")  # reserved
    reserve: int = wire("I")


@dataclass(frozen=True)
class Imu:
    """The inertial sensor."""

    quaternion: tuple = wire("f", 4)  # w x y z
    gyroscope: tuple = wire("f", 3)  # rad/s
    accelerometer: tuple = wire("f", 3)  # m/s^2
    rpy: tuple = wire("f", 3)  # rad
    temperature: int = wire("b")  # degrees Celsius


@dataclass(frozen=True)
class MotorState:
    """One motor; of the 20, the first 12 are used: FR, FL, RR, RL, each hip, thigh, calf."""

    mode: int = wire("B")
    q: float = wire("f")  # rad
    dq: float = wire("f")  # rad/s
    ddq: float = wire("f")  # rad/s^2
    tau_est: float = wire("f")  # N m
    q_raw: float = wire("f")
    dq_raw: float = wire("f")
    ddq_raw: float = wire("f")
    temperature: int = wire("b")  # degrees Celsius
    reserve: tuple = wire("I", 2)


@dataclass(frozen=True)
class BmsState:
    """The battery."""

    version_h: int = wire("B")
    version_l: int = wire("B")
    status: int = wire("B")
    soc: int = wire("B")  # %, what is left
    current: int = wire("i")  # mA
    cycle: int = wire("H")
    bq_ntc: tuple = wire("b", 2)  # degrees Celsius
    mcu_ntc: tuple = wire("b", 2)  # degrees Celsius
    cell_vol: tuple = wire("H", 10)  # mV


@dataclass(frozen=True)
class HighState:
    """A high-level state, robot to computer, 1087 bytes with its checksum."""

    head: bytes = wire("2s", default=HEAD)
    level_flag: int = wire("B", default=HIGH_LEVEL)
    frame_reserve: int = wire("B")
    sn: tuple = wire("I", 2)  # byte 0: 4 is a Go1; byte 1: 1 Air, 2 Pro, 3 Edu
    version: tuple = wire("I", 2)
    band_width: int = wire("H")
    imu: Imu = wire(Imu)
    motor_state: tuple = wire(MotorState, 20)
    bms: BmsState = wire(BmsState)
    foot_force: tuple = wire("h", 4)  # FR, FL, RR, RL
    foot_force_est: tuple = wire("h", 4)
    mode: int = wire("B")
    progress: float = wire("f")  # reserved
    gait_type: int = wire("B")
    foot_raise_height: float = wire("f")  # m, absolute, about 0.08
    position: tuple = wire("f", 3)  # m: the robot's own odometry since power-on; it drifts
    body_height: float = wire("f")  # m, absolute, about 0.28
    velocity: tuple = wire("f", 3)  # m/s, forward and left; the third is ambiguous
    yaw_speed: float = wire("f")  # rad/s
    range_obstacle: tuple = wire("f", 4)  # m
    foot_position2body: tuple = wire("f", 12)  # m, 4 feet x 3
    foot_speed2body: tuple = wire("f", 12)  # m/s, 4 feet x 3
    wireless_remote: bytes = wire("40s")
    reserve: int = wire("I")


MODELS = {1: "Air", 2: "Pro", 3: "Edu"}  # byte 1 of the serial number, where byte 0 is 4


def model(state: HighState) -> str | None:
    """Which Go1 it is, "Air", "Pro" or "Edu", by its serial number; None where that says nothing.

    Read in the vendor's header; whether every robot fills it in is not known.
    """
    return MODELS.get(state.sn[0] >> 8 & 0xFF) if state.sn[0] & 0xFF == 4 else None


def encode_command(command: HighCmd, encrypted: bool = False) -> bytes:
    """The 129 bytes of a command; the vendor's sender always writes the plain checksum.

    Raises:
        ValueError: naming the field whose value does not fit its place in the packet.
    """
    return _seal(pack("command", command), encrypted)


def encode_state(state: HighState, encrypted: bool = True) -> bytes:
    """The 1087 bytes of a state, as the robot sends them at level EE.

    Raises:
        ValueError: naming the field whose value does not fit its place in the packet.
    """
    return _seal(pack("state", state), encrypted)


def decode_command(data: bytes, developer: bool = True) -> HighCmd:
    """The command in a datagram, by the rules of a robot: an Edu is a `developer`, a Pro is not.

    Raises:
        ProtocolError: wrong length, head or checksum, or a checksum this robot does not take.
    """
    return _open("command", HighCmd, data, COMMAND_SIZE, developer)


def decode_state(data: bytes, developer: bool = False) -> HighState:
    """The state in a datagram, by the rules of the vendor's receiver.

    Level EE comes with the encrypted checksum (a `developer` takes the plain one too), any other
    level with the plain one. Numbers are passed on as they came, NaN and infinity too.

    Raises:
        ProtocolError: wrong length, head or checksum, or one that does not belong to the level.
    """
    return _open("state", HighState, data, STATE_SIZE, developer)


def crc(data: bytes) -> int:
    """CRC-32/MPEG-2 of 32-bit words read little-endian, most significant bit first.

    zlib computes the reflected twin of this checksum, so each byte goes in with its bits
    reversed, and the answer is reversed back.

    Raises:
        ValueError: the length is no multiple of four.
    """
    if len(data) % 4:
        raise ValueError(f"data: expected whole words of 4 bytes, got {len(data)} bytes")
    words = array("I", data)  # 4 bytes on every platform that CPython supports
    words.byteswap()
    twin = zlib.crc32(words.tobytes().translate(_MIRROR)) ^ 0xFFFFFFFF
    return int.from_bytes(twin.to_bytes(4, "little").translate(_MIRROR), "big")


_MIRROR = bytes(int(f"{byte:08b}"[::-1], 2) for byte in range(256))  # the bits of a byte reversed


def _checksum(data: bytes, encrypted: bool) -> bytes:
    """The four bytes at the end of a packet of that content; the last odd bytes are not covered."""
    covered = 4 * ((len(data) + 4) // 4 - 1)
    plain = crc(data[:covered])
    hidden = plain ^ 0xEDCAB9DE
    hidden = (hidden >> 8 | hidden << 24) & 0xFFFFFFFF
    return (hidden if encrypted else plain).to_bytes(4, "little")


def _seal(data: bytes, encrypted: bool) -> bytes:
    """A packet's content with its checksum behind it."""
    return data + _checksum(data, encrypted)


def _open(name: str, packet: type, data: bytes, size: int, developer: bool) -> Any:
    """The values of a packet whose length, head and checksum are right, else ProtocolError."""
    if len(data) != size:
        other = " (another robot's, an A1's perhaps, or another SDK's)" if name == "state" else ""
        raise ProtocolError(f"{name}: expected {size} bytes, got {len(data)}{other}")
    if data[:2] != HEAD:
        raise ProtocolError(f"{name}: expected the head {HEAD.hex()}, got {bytes(data[:2]).hex()}")
    content, end, level = data[:-4], data[-4:], data[2]
    accepted = {level == HIGH_LEVEL}  # whether encrypted
    if developer:
        accepted.add(False)
    if not any(end == _checksum(content, encrypted) for encrypted in accepted):
        wanted = " or ".join("encrypted" if which else "plain" for which in sorted(accepted))
        raise ProtocolError(f"{name}: level {level:02x} needs a right {wanted} checksum")
    return unpack(packet, content)
