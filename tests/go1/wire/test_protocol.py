import json
import random
import struct
from dataclasses import fields, replace
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pypose_lite.go1 import protocol
from pypose_lite.go1.safety.pilot import Pilot
from pypose_lite.go1.wire.layout import places
from pypose_lite.go1.wire.protocol import (
    BmsCmd,
    BmsState,
    HighCmd,
    HighState,
    Imu,
    MotorState,
    ProtocolError,
    decode_command,
    decode_state,
    encode_command,
    encode_state,
)

VECTORS = Path(__file__).parent / "vectors"
INDEX = json.loads((VECTORS / "index.json").read_text(encoding="utf-8"))
STATES = [name for name in INDEX["states"] if name.endswith(".hex")]
# the formats as the specification of the protocol states them
COMMAND_FORMAT = "<2sBB2I2IHBBBff2f3f2ff4s12s40sI"
STATE_FORMAT = "<2sBB2I2IH13fb" + "B7fb2I" * 20 + "4BiH2b2b10H4h4hBfBf3ff3ff4f12f12f40sI"


def golden(name):
    return bytes.fromhex((VECTORS / name).read_text(encoding="utf-8"))


def slow_crc(data):
    """CRC-32/MPEG-2, bit by bit, over little-endian words."""
    register = 0xFFFFFFFF
    for (word,) in struct.iter_unpack("<I", data):
        register ^= word
        for _ in range(32):
            register = register << 1 ^ (0x04C11DB7 if register >> 31 else 0)
            register &= 0xFFFFFFFF
    return register


@pytest.mark.parametrize(
    ("data", "value"), [("00000000", 0xC704DD7B), ("01000000", 0xC3C5C0CC), ("", 0xFFFFFFFF)]
)
def test_the_checksum_of_a_word_is_the_one_that_the_vendor_computes(data, value):
    assert protocol.crc(bytes.fromhex(data)) == value


@settings(deadline=None)
@given(st.integers(0, 300).flatmap(lambda n: st.binary(min_size=4 * n, max_size=4 * n)))
def test_the_checksum_equals_the_one_computed_bit_by_bit(data):
    assert protocol.crc(data) == slow_crc(data)


def test_a_checksum_of_a_broken_word_is_refused():
    with pytest.raises(ValueError, match="whole words of 4 bytes, got 5"):
        protocol.crc(bytes(5))


@pytest.mark.parametrize("name", INDEX["commands"])
def test_a_command_of_the_vendor_decodes_to_its_values_and_back_to_its_bytes(name):
    names = {"levelFlag": "level_flag", "gaitType": "gait_type", "yawSpeed": "yaw_speed"}
    names |= {"bodyHeight": "body_height"}
    command = decode_command(golden(name))
    for key, value in INDEX["commands"][name].items():
        expected = tuple(value) if isinstance(value, list) else value
        assert getattr(command, names.get(key, key)) == pytest.approx(expected, rel=1e-6)
    assert encode_command(command) == golden(name)


@pytest.mark.parametrize("name", INDEX["commands"])
def test_a_command_built_from_values_alone_is_the_packet_of_the_vendor(name):
    said = INDEX["commands"][name]
    command = HighCmd(
        level_flag=said["levelFlag"],
        mode=said["mode"],
        gait_type=said.get("gaitType", 0),
        velocity=tuple(said.get("velocity", (0, 0))),
        yaw_speed=said.get("yawSpeed", 0),
        euler=tuple(said.get("euler", (0, 0, 0))),
        body_height=said.get("bodyHeight", 0),
    )
    assert encode_command(command) == golden(name)


@pytest.mark.parametrize("name", STATES)
def test_a_state_is_taken_exactly_where_the_vendor_takes_it(name):
    if INDEX["states"][name]["vendor_accepts"]:
        state = decode_state(golden(name))
        encrypted = INDEX["states"][name]["crc"] == "encrypted"
        assert encode_state(state, encrypted) == golden(name)
    else:
        with pytest.raises(ProtocolError, match="checksum"):
            decode_state(golden(name))


def test_a_developer_takes_level_ee_with_a_plain_checksum_too():
    plain, encrypted = golden("state_ee_plain.hex"), golden("state_ee_encrypted.hex")
    assert decode_state(plain, developer=True) == decode_state(encrypted, developer=True)
    assert encode_state(decode_state(encrypted), encrypted=False) == plain
    with pytest.raises(ProtocolError, match="checksum"):
        decode_state(golden("state_00_encrypted.hex"), developer=True)


def test_a_golden_state_holds_the_values_that_were_put_in():
    state, said = decode_state(golden("state_ee_encrypted.hex")), INDEX["states"]["fields"]
    found = {
        "position": state.position,
        "velocity": state.velocity,
        "yawSpeed": state.yaw_speed,
        "mode": state.mode,
        "gaitType": state.gait_type,
        "imu.quaternion_wxyz": state.imu.quaternion,
        "imu.gyroscope": state.imu.gyroscope,
        "imu.accelerometer": state.imu.accelerometer,
        "imu.rpy": state.imu.rpy,
        "imu.temperature": state.imu.temperature,
        "bms.soc": state.bms.soc,
        "bms.current_mA": state.bms.current,
        "footForce": state.foot_force,
        "bodyHeight": state.body_height,
        "footRaiseHeight": state.foot_raise_height,
        "rangeObstacle": state.range_obstacle,
    }
    assert set(found) == set(said)
    for name, value in said.items():
        expected = tuple(value) if isinstance(value, list) else value
        assert found[name] == pytest.approx(expected, rel=1e-6), name


@pytest.mark.parametrize(
    ("encrypted", "level", "checksum"),
    [(False, 0xEE, "d8fc0f0b"), (False, 0x00, None), (True, 0xEE, None)],
)
def test_an_idle_command_ends_with_its_checksum(encrypted, level, checksum):
    data = encode_command(HighCmd(level_flag=level), encrypted)
    plain = slow_crc(data[:124])
    mixed = plain ^ 0xEDCAB9DE
    turned = mixed >> 8 | (mixed & 0xFF) << 24
    assert int.from_bytes(data[125:], "little") == (turned if encrypted else plain)
    assert checksum is None or plain == int(checksum, 16)


def test_the_golden_state_ends_with_the_bytes_that_the_specification_names():
    assert golden("state_ee_encrypted.hex")[-4:].hex() == "cad2a855"
    assert int.from_bytes(golden("state_ee_plain.hex")[-4:], "little") == 0x4518738B


@pytest.mark.parametrize(
    ("field", "value", "offset", "layout"),
    [
        ("level_flag", 0x17, 2, "<B"),
        ("frame_reserve", 9, 3, "<B"),
        ("sn", (1, 2), 4, "<2I"),
        ("version", (3, 4), 12, "<2I"),
        ("band_width", 5, 20, "<H"),
        ("mode", 6, 22, "<B"),
        ("gait_type", 7, 23, "<B"),
        ("speed_level", 8, 24, "<B"),
        ("foot_raise_height", 0.5, 25, "<f"),
        ("body_height", 0.25, 29, "<f"),
        ("position", (1.0, 2.0), 33, "<2f"),
        ("euler", (1.0, 2.0, 3.0), 41, "<3f"),
        ("velocity", (1.0, 2.0), 53, "<2f"),
        ("yaw_speed", 4.0, 61, "<f"),
        ("bms", BmsCmd(0xA5, (1, 2, 3)), 65, "<4B"),
        ("led", bytes(range(12)), 69, "<12s"),
        ("wireless_remote", bytes(range(40)), 81, "<40s"),
        ("reserve", 0x01020304, 121, "<I"),
    ],
)
def test_a_field_of_a_command_lies_where_the_specification_says(field, value, offset, layout):
    data = encode_command(replace(HighCmd(), **{field: value}))
    flat = (0xA5, 1, 2, 3) if field == "bms" else value if isinstance(value, tuple) else (value,)
    assert struct.unpack_from(layout, data, offset) == flat
    assert getattr(decode_command(data, developer=True), field) == value
    assert places(HighCmd)[field] == slice(offset, offset + struct.calcsize(layout))


@pytest.mark.parametrize(
    ("change", "offset", "layout", "flat"),
    [
        ({"sn": (0x304, 0)}, 4, "<2I", (0x304, 0)),
        ({"imu": Imu(quaternion=(1.0, 2.0, 3.0, 4.0))}, 22, "<4f", (1.0, 2.0, 3.0, 4.0)),
        ({"imu": Imu(gyroscope=(1.0, 2.0, 3.0))}, 38, "<3f", (1.0, 2.0, 3.0)),
        ({"imu": Imu(accelerometer=(1.0, 2.0, 3.0))}, 50, "<3f", (1.0, 2.0, 3.0)),
        ({"imu": Imu(rpy=(1.0, 2.0, 3.0))}, 62, "<3f", (1.0, 2.0, 3.0)),
        ({"imu": Imu(temperature=-7)}, 74, "<b", (-7,)),
        ({"bms": BmsState(1, 2, 3, 83)}, 835, "<4B", (1, 2, 3, 83)),
        ({"bms": BmsState(current=-1234, cycle=7)}, 839, "<iH", (-1234, 7)),
        ({"bms": BmsState(bq_ntc=(1, -2), mcu_ntc=(3, 4))}, 845, "<4b", (1, -2, 3, 4)),
        ({"bms": BmsState(cell_vol=tuple(range(10)))}, 849, "<10H", tuple(range(10))),
        ({"foot_force": (1, 2, 3, -4)}, 869, "<4h", (1, 2, 3, -4)),
        ({"foot_force_est": (1, 2, 3, -4)}, 877, "<4h", (1, 2, 3, -4)),
        ({"mode": 1, "progress": 2.0, "gait_type": 3}, 885, "<BfB", (1, 2.0, 3)),
        ({"foot_raise_height": 0.5}, 891, "<f", (0.5,)),
        ({"position": (1.0, 2.0, 3.0)}, 895, "<3f", (1.0, 2.0, 3.0)),
        ({"body_height": 0.5}, 907, "<f", (0.5,)),
        ({"velocity": (1.0, 2.0, 3.0)}, 911, "<3f", (1.0, 2.0, 3.0)),
        ({"yaw_speed": 0.5}, 923, "<f", (0.5,)),
        ({"range_obstacle": (1.0, 2.0, 3.0, 4.0)}, 927, "<4f", (1.0, 2.0, 3.0, 4.0)),
        ({"foot_position2body": (0.5,) * 12}, 943, "<12f", (0.5,) * 12),
        ({"foot_speed2body": (0.5,) * 12}, 991, "<12f", (0.5,) * 12),
        ({"wireless_remote": bytes(range(40))}, 1039, "<40s", (bytes(range(40)),)),
        ({"reserve": 9}, 1079, "<I", (9,)),
    ],
)
def test_a_field_of_a_state_lies_where_the_specification_says(change, offset, layout, flat):
    state = replace(HighState(), **change)
    data = encode_state(state)
    assert struct.unpack_from(layout, data, offset) == flat
    assert decode_state(data) == state


def test_the_places_of_a_states_fields_follow_each_other_as_in_the_specification():
    found = places(HighState)
    starts = {"imu": 22, "motor_state": 75, "bms": 835, "foot_force": 869, "mode": 885}
    starts |= {"position": 895, "velocity": 911, "range_obstacle": 927, "wireless_remote": 1039}
    assert {name: found[name].start for name in starts} == starts
    ends = [0, *(place.stop for place in found.values())]
    assert ends[:-1] == [place.start for place in found.values()] and ends[-1] == 1083


@pytest.mark.parametrize("number", range(20))
def test_a_motor_lies_where_the_specification_says(number):
    motor = MotorState(1, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, -9, (10, 11))
    motors = tuple(motor if i == number else MotorState() for i in range(20))
    data = encode_state(HighState(motor_state=motors))
    found = struct.unpack_from("<B7fb2I", data, 75 + 38 * number)
    assert found == (1, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, -9, 10, 11)
    assert decode_state(data).motor_state == motors


@settings(deadline=None, max_examples=50)
@given(st.binary(min_size=122, max_size=122), st.sampled_from([0x00, 0xEE]))
def test_any_content_of_a_command_survives_decoding_and_encoding(content, level):
    data = protocol._seal(b"\xfe\xef" + bytes([level]) + content, level == 0xEE)
    again = encode_command(decode_command(data), level == 0xEE)
    assert repr(struct.unpack(COMMAND_FORMAT, again[:-4])) == repr(
        struct.unpack(COMMAND_FORMAT, data[:-4])
    )


@settings(deadline=None, max_examples=50)
@given(st.binary(min_size=1080, max_size=1080), st.sampled_from([0x00, 0xEE]))
def test_any_content_of_a_state_survives_decoding_and_encoding(content, level):
    data = protocol._seal(b"\xfe\xef" + bytes([level]) + content, level == 0xEE)
    again = encode_state(decode_state(data), level == 0xEE)
    # by value: a signalling NaN comes back as a quiet one
    assert repr(struct.unpack(STATE_FORMAT, again[:-4])) == repr(
        struct.unpack(STATE_FORMAT, data[:-4])
    )


@pytest.mark.parametrize(
    ("decode", "name"),
    [(decode_command, "cmd_walk.hex"), (decode_state, "state_ee_encrypted.hex")],
)
def test_every_other_length_is_refused(decode, name):
    data = golden(name)
    for size in range(len(data)):
        with pytest.raises(ProtocolError, match=f"expected {len(data)} bytes, got {size}"):
            decode(data[:size])
    with pytest.raises(ProtocolError, match=f"got {len(data) + 1}"):
        decode(data + b"\0")


@pytest.mark.parametrize(
    ("decode", "name", "uncovered"),
    [
        (decode_command, "cmd_walk.hex", {124}),
        (decode_command, "cmd_walk_level0.hex", {124}),
        (decode_state, "state_ee_encrypted.hex", {1080, 1081, 1082}),
        (decode_state, "state_00_plain.hex", {1080, 1081, 1082}),
    ],
)
def test_every_single_flipped_bit_in_what_the_checksum_covers_is_refused(decode, name, uncovered):
    data = golden(name)
    taken = set()
    for bit in range(8 * len(data)):
        spoiled = bytearray(data)
        spoiled[bit // 8] ^= 1 << bit % 8
        try:
            decode(bytes(spoiled))
            taken.add(bit // 8)
        except ProtocolError:
            pass
    assert taken == uncovered


def test_a_million_random_datagrams_leave_the_last_good_state_where_it_was():
    pilot, draw = Pilot(), random.Random(1)
    assert pilot.hear(golden("state_ee_encrypted.hex"), now=0.0)
    good = pilot.state(0.1)
    pool = draw.randbytes(1 << 20)
    with_head = b"\xfe\xef\xee"
    for number in range(1_000_000):
        start = draw.randrange(len(pool) - 1500)
        if number % 3 == 0:
            data = pool[start : start + number % 1501]
        elif number % 3 == 1:
            data = pool[start : start + 1087]
        else:
            data = with_head[: 2 + number % 2] + pool[start : start + 1085 - number % 2]
        assert not pilot.hear(data, now=0.05)
    assert pilot.state(0.1) is good
    assert (pilot.news, pilot.refused) == (1, 1_000_000)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"velocity": (1.0,)}, "command.velocity: expected 2 values"),
        ({"velocity": (1.0, 2.0, 3.0), "position": (1.0,)}, "command.position: expected 2"),
        ({"velocity": 1.0}, "command.velocity: expected 2 values, got 1.0"),
        ({"level_flag": 300}, "command.level_flag: 300 does not fit"),
        ({"mode": 1.5}, "command.mode: 1.5 does not fit"),
        ({"led": b"1"}, "command.led: expected 12 bytes"),
        ({"led": bytes(13)}, "command.led: expected 12 bytes"),
        ({"yaw_speed": 1e39}, "command.yaw_speed: 1e\\+39 does not fit"),
        ({"yaw_speed": None}, "command.yaw_speed: None does not fit"),
        ({"bms": 3}, "command.bms: expected BmsCmd, got 3"),
        ({"bms": BmsCmd(off=-1)}, "command.bms.off: -1 does not fit"),
    ],
)
def test_a_value_that_does_not_fit_is_named(change, message):
    with pytest.raises(ValueError, match=message):
        encode_command(HighCmd(**change))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"motor_state": (MotorState(),) * 19}, "state.motor_state: expected 20 values"),
        ({"motor_state": (1,) * 20}, "state.motor_state: expected MotorState, got 1"),
        ({"imu": Imu(temperature=200)}, "state.imu.temperature: 200 does not fit"),
        ({"bms": BmsState(cell_vol=(1,) * 9)}, "state.bms.cell_vol: expected 10 values"),
    ],
)
def test_a_value_deep_in_a_state_that_does_not_fit_is_named(change, message):
    with pytest.raises(ValueError, match=message):
        encode_state(HighState(**change))


@pytest.mark.parametrize("packet", [HighCmd, HighState])
def test_packets_are_frozen(packet):
    with pytest.raises(AttributeError):
        setattr(packet(), fields(packet)[0].name, b"xx")


def test_a_wrong_head_is_named():
    with pytest.raises(ProtocolError, match="expected the head feef, got 0000"):
        decode_command(bytes(129))
