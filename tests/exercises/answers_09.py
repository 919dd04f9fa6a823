"""Answers to lab 9 on packets, as students give them."""

import struct

import numpy as np
from graders import right, wrong

from pypose_lite.go1.wire import protocol

# --- 9.1


@right("9.1")
def by_struct(data):
    place = {"x": 895, "y": 899, "heading": 70, "v": 911, "w": 923}
    numbers = {name: struct.unpack_from("<f", data, at)[0] for name, at in place.items()}
    return data[838], *(numbers[name] for name in ("x", "y", "heading", "v", "w"))


@right("9.1")
def by_numpy(data):
    def floats(at, count=1):
        return np.frombuffer(data, "<f4", count, at)

    x, y = floats(895, 2)
    return [data[838], x, y, floats(62, 3)[2], floats(911)[0], floats(923)[0]]


@right("9.1")
def by_the_library(data):
    state = protocol.decode_state(data)
    return state.bms.soc, *state.position[:2], state.imu.rpy[2], state.velocity[0], state.yaw_speed


@wrong("9.1", "Lowest byte first")
def big_endian(data):
    found = list(by_struct(data))
    return [found[0], *(struct.unpack_from(">f", data, at)[0] for at in (895, 899, 70, 911, 923))]


@wrong("9.1", "offsets count from 0")
def counts_from_one(data):
    return data[837], *by_struct(data)[1:]


@wrong("9.1", "That is y")
def exchanged(data):
    soc, x, y, *rest = by_struct(data)
    return soc, y, x, *rest


@wrong("9.1", "That is the roll")
def first_angle(data):
    found = list(by_struct(data))
    found[3] = struct.unpack_from("<f", data, 62)[0]
    return found


@wrong("9.1", "That is of the quaternion")
def of_the_quaternion(data):
    found = list(by_struct(data))
    found[3] = struct.unpack_from("<f", data, 34)[0]
    return found


@wrong("9.1", "That is the speed to the left")
def sideways(data):
    found = list(by_struct(data))
    found[4] = struct.unpack_from("<f", data, 915)[0]
    return found


@wrong("9.1", "6 results")
def only_the_pose(data):
    return by_struct(data)[1:4]


# --- 9.2


def blank(v, turn, layout_of_speeds="<fff", speeds=None):
    packet = bytearray(129)
    packet[:3] = b"\xfe\xef\xee"
    packet[22:24] = 2, 1
    struct.pack_into(layout_of_speeds, packet, 53, *(speeds or (v, 0.0, turn)))
    return packet


def sealed(packet, order="little"):
    packet[125:] = protocol.crc(bytes(packet[:124])).to_bytes(4, order)
    return packet


@right("9.2")
def step_by_step(v, turn):
    return bytes(sealed(blank(v, turn)))


@right("9.2")
def as_a_bytearray(v, turn):
    return sealed(blank(v, turn))


@right("9.2")
def pieces_joined(v, turn):
    head = b"\xfe\xef\xee" + bytes(19) + b"\2\1" + bytes(29)
    body = head + np.array([v, 0, turn], "<f4").tobytes() + bytes(60)
    return body + struct.pack("<I", protocol.crc(body[:124]))


@right("9.2")
def by_the_library_too(v, turn):
    return protocol.encode_command(
        protocol.HighCmd(mode=2, gait_type=1, velocity=(v, 0), yaw_speed=turn)
    )


@wrong("9.2", "a packet of 129 bytes", "124 bytes")
def too_short(v, turn):
    return bytes(blank(v, turn)[:124])


@wrong("9.2", "byte 22 02, the mode: walk")
def without_a_mode(v, turn):
    packet = blank(v, turn)
    packet[22] = 0
    return sealed(packet)


@wrong("9.2", "byte 23 01, the gait: trot")
def without_a_gait(v, turn):
    packet = blank(v, turn)
    packet[23] = 0
    return sealed(packet)


@wrong("9.2", "Lowest byte first")
def highest_first(v, turn):
    return sealed(blank(v, turn, ">fff"))


@wrong("9.2", "the second is the speed to the left")
def turns_sideways(v, turn):
    return sealed(blank(v, turn, speeds=(v, turn, 0.0)))


@wrong("9.2", "They are exchanged")
def swapped(v, turn):
    return sealed(blank(turn, v))


@wrong("9.2", "There is none")
def unsealed(v, turn):
    return blank(v, turn)


@wrong("9.2", "Lowest byte first here, too")
def sealed_the_other_way(v, turn):
    return sealed(blank(v, turn), "big")


@wrong("9.2", "Of whole words only")
def sealed_with_a_filling(v, turn):
    packet = blank(v, turn)
    packet[125:] = struct.pack("<I", protocol.crc(bytes(packet[:125]) + bytes(3)))
    return packet


@wrong("9.2", "Set the speeds first")
def sealed_too_early(v, turn):
    packet = sealed(blank(0.0, 0.0))
    struct.pack_into("<fff", packet, 53, v, 0.0, turn)
    return packet


@wrong("9.2", "All that the table does not name is 0")
def with_a_posture(v, turn):
    packet = blank(v, turn)
    struct.pack_into("<f", packet, 25, 0.08)
    return sealed(packet)


# --- 9.3


def flipped(data, mask, order=">"):
    """Data with the bits of a number flipped, as one row of bits."""
    words = struct.unpack("<31I", data)
    row = int.from_bytes(struct.pack(">31I", *words), "big") ^ mask
    return struct.pack("<31I", *struct.unpack(">31I", row.to_bytes(124, "big")))


@right("9.3")
def in_the_last_words(data):
    words = list(struct.unpack("<31I", data))
    words[29] ^= 1
    words[30] ^= 0x04C11DB7
    return struct.pack("<31I", *words)


@right("9.3")
def moved_by_seven_bits(data):
    return flipped(data, 0x104C11DB7 << 71)


@right("9.3")
def a_multiple_with_three_terms(data):
    g = 0x104C11DB7
    return bytearray(flipped(data, g << 5 ^ g << 40 ^ g << 900))


@wrong("9.3", "the same")
def unchanged(data):
    return data


@wrong("9.3", "g has 33 bits")
def without_the_leading_one(data):
    return flipped(data, 0x04C11DB7 << 64)


@wrong("9.3", "lowest byte first")
def in_the_order_of_bytes(data):
    row = int.from_bytes(data, "big") ^ (0x104C11DB7 << 64)
    return row.to_bytes(124, "big")


@wrong("9.3", "all 33 bits of g")
def one_bit(data):
    return flipped(data, 1 << 100)


@wrong("9.3", "all 33 bits of g")
def two_words_exchanged(data):
    return data[4:8] + data[:4] + data[8:]


@wrong("9.3", "of 124 bytes")
def longer(data):
    return data + bytes(4)


@wrong("9.3", "124 bytes")
def a_list_of_words(data):
    return list(struct.unpack("<31I", data))
