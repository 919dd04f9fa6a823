"""What the answers of lab 9 must do: packets. Others: chapter_09_robots, chapter_09_seen."""

import math
import struct
from dataclasses import replace

from ...go1.wire import protocol
from . import expect
from .exercise import Exercise, Failure
from .words import kind

reader = Exercise("9.1", "A state, byte by byte", minutes=10, takes="data")


def as_bytes(name, came, size):
    """What came, if it is so many bytes."""
    if not isinstance(came, bytes | bytearray | memoryview):
        raise Failure(f"{name}, {size} bytes", kind(came), "`bytes(...)` makes them.")
    expect.that(len(came) == size, f"{name} of {size} bytes", f"{len(came)} bytes")
    return bytes(came)


def a_state(given):
    """A state in which no two numbers are alike."""
    draw = [round(float(x), 3) for x in given.uniform(0.1, 0.9, 12)]
    blank = protocol.HighState()
    imu = replace(blank.imu, quaternion=tuple(draw[:4]), rpy=(draw[4] / 9, draw[5] / 9, draw[6]))
    soc = 20 + int(given.uniform(0, 75))
    return replace(
        blank,
        imu=imu,
        bms=replace(blank.bms, soc=soc, status=7, version_l=1, version_h=2),
        position=(draw[7] + 1, -draw[8] - 2, draw[9] / 3),
        body_height=0.28,
        velocity=(draw[10], -draw[11] / 3, 0.0),
        yaw_speed=-draw[7] / 2,
    )


@reader.must("find the six numbers in any state")
def six_numbers(answer, given):
    names = "battery", "x", "y", "heading", "forward speed", "turn rate"
    for _ in range(3):
        state = a_state(given)
        data = protocol.encode_state(state)
        (x, y, z), rpy, (v, left, _) = state.position, state.imu.rpy, state.velocity
        wants = state.bms.soc, x, y, rpy[2], v, state.yaw_speed
        others = {
            "battery": {"That is the byte before: offsets count from 0.": state.bms.status},
            "x": {"That is y.": y, "That is z.": z},
            "y": {"That is x.": x, "That is z. Numbers take four bytes each.": z},
            "heading": {
                "That is the roll: heading is the third of the three.": rpy[0],
                "That is the pitch: heading is the third of the three.": rpy[1],
                "That is of the quaternion.": state.imu.quaternion[3],
            },
            "forward speed": {"That is the speed to the left.": left},
            "turn rate": {"That is the speed to the left.": left},
        }
        came = expect.parts(answer(data), *names)
        for name, number, want in zip(names, came, wants):
            _not_big_endian(name, number, want)
            hint = f"Look up its place, and how many bytes it has: {name} came from elsewhere."
            expect.close(name, number, want, hint, others[name], tolerance=1e-5)


def _not_big_endian(name, number, want):
    """Says so where the bytes of a number were read the other way around."""
    turned = struct.unpack(">f", struct.pack("<f", want))[0]
    if isinstance(number, float) and math.isclose(number, turned, rel_tol=1e-5):
        raise Failure(f"{name} {want:.4g}", f"{number:.4g}", 'Lowest byte first: "<f".')


writer = Exercise("9.2", "A command, sealed", minutes=15, takes="v, turn", points=2)
SIZE = protocol.COMMAND_SIZE


def a_command(given):
    """A speed and a turn rate."""
    return [round(float(x), 2) for x in given.uniform(-1.0, 1.0, 2)]


def sent(answer, v, turn):
    """The packet that an answer makes."""
    return as_bytes("a packet", answer(v, turn), SIZE)


@writer.must("begin as a command to walk at a trot does")
def begins(answer, given):
    data = sent(answer, *a_command(given))
    for place, want, what in [
        (0, 0xFE, "the head"),
        (1, 0xEF, "the head"),
        (2, 0xEE, "the level"),
        (22, 2, "the mode: walk"),
        (23, 1, "the gait: trot"),
    ]:
        hint = "The table has them."
        if place > 2 and data[place] == 0:
            hint = "Without it the robot stands, whatever its speeds are."
        expect.that(
            data[place] == want, f"byte {place} {want:02x}, {what}", f"{data[place]:02x}", hint
        )


@writer.must("have both speeds at their places, lowest byte first")
def has_speeds(answer, given):
    v, turn = a_command(given)
    data = sent(answer, v, turn)
    want, came = struct.pack("<fff", v, 0.0, turn), data[53:65]
    mistakes = {
        'Lowest byte first: "<fff".': struct.pack(">fff", v, 0.0, turn),
        "The turn rate is the third: the second is the speed to the left.": struct.pack(
            "<fff", v, turn, 0.0
        ),
        'Four bytes each: "f", not "d".': struct.pack("<d", v) + came[8:],
        "They are exchanged.": struct.pack("<fff", turn, 0.0, v),
    }
    hint = next((text for text, wrong in mistakes.items() if came == wrong), "From byte 53 on.")
    expect.that(came == want, f"bytes 53 to 64 {want.hex(' ', 4)}", came.hex(" ", 4), hint)


@writer.must("end in the checksum of its first 124 bytes")
def is_sealed(answer, given):
    data = sent(answer, *a_command(given))
    want, came = protocol.crc(data[:124]).to_bytes(4, "little"), data[125:]
    mistakes = {
        "There is none: the last four bytes are 0.": bytes(4),
        "Lowest byte first here, too.": want[::-1],
        "Of whole words only: the first 124 bytes, not 125 and a filling.": protocol.crc(
            data[:125] + bytes(3)
        ).to_bytes(4, "little"),
        "Set the speeds first: it was made of a packet without them.": protocol.crc(
            data[:53] + bytes(12) + data[65:124]
        ).to_bytes(4, "little"),
        "Set everything first: it was made of an empty packet.": protocol.crc(bytes(124)).to_bytes(
            4, "little"
        ),
    }
    hint = next((text for text, wrong in mistakes.items() if came == wrong), "")
    expect.that(came == want, f"the checksum {want.hex()}", came.hex(), hint)


@writer.must("be what the robot takes, byte for byte")
def is_taken(answer, given):
    v, turn = a_command(given)
    command = protocol.HighCmd(mode=2, gait_type=1, velocity=(v, 0.0), yaw_speed=turn)
    want, came = protocol.encode_command(command), sent(answer, v, turn)
    places = [k for k in range(SIZE) if want[k] != came[k]]
    hint = "All that the table does not name is 0."
    expect.that(not places, f"byte {min(places, default=0)} 0", f"bytes {places[:4]} differ", hint)


forger = Exercise("9.3", "Damage that goes unseen", minutes=20, takes="data", points=2)


def damaged(answer, data):
    """What an answer makes of a content of 124 bytes."""
    return as_bytes("the damaged content", answer(data), len(data))


@forger.must("change the data")
def changes(answer, given):
    data = bytes(given.uniform(0, 256, 124).int().tolist())
    same = damaged(answer, data) == data
    expect.that(not same, "other bytes", "the same", "Add a multiple of the divisor that is not 0.")


@forger.must("leave the checksum as it was, whatever the data are")
def keeps_checksum(answer, given):
    for _ in range(3):
        data = bytes(given.uniform(0, 256, 124).int().tolist())
        came = damaged(answer, data)
        flips = int.from_bytes(data, "big") ^ int.from_bytes(came, "big")
        hint = "The damage has to be g times a power of x, with all 33 bits of g."
        if bin(flips).count("1") == bin(0x04C11DB7).count("1"):
            hint = "g has 33 bits: its leading 1 is left out in 0x04C11DB7."
        elif _by_bytes(data, came):
            hint = "The robot reads words with the lowest byte first: so must the damage lie."
        want, got = protocol.crc(data), protocol.crc(came)
        expect.that(want == got, f"the checksum {want:08x}", f"{got:08x}", hint)


def _by_bytes(data, came):
    """Whether damage would go unseen if words were read with the highest byte first."""
    turned = [struct.pack(">31I", *struct.unpack("<31I", part)) for part in (data, came)]
    return protocol.crc(turned[0]) == protocol.crc(turned[1])
