import ctypes

import pytest

from pypose_lite.go1.wire.remote import BUTTONS, decode_remote, encode_remote


class Bits(ctypes.LittleEndianStructure):
    """The buttons as the vendor's header declares them."""

    _pack_ = 1
    _fields_ = [
        *((name, ctypes.c_uint8, 1) for name in ("R1", "L1", "start", "select")),
        *((name, ctypes.c_uint8, 1) for name in ("R2", "L2", "F1", "F2")),
        *((name, ctypes.c_uint8, 1) for name in ("A", "B", "X", "Y")),
        *((name, ctypes.c_uint8, 1) for name in ("up", "right", "down", "left")),
    ]


class VendorsRemote(ctypes.LittleEndianStructure):
    _pack_ = 1
    _fields_ = [
        ("head", ctypes.c_uint8 * 2),
        ("buttons", Bits),
        *((name, ctypes.c_float) for name in ("lx", "rx", "ry", "L2", "ly")),
        ("idle", ctypes.c_uint8 * 16),
    ]


@pytest.mark.parametrize("name", BUTTONS)
def test_every_button_is_where_the_vendors_header_has_it(name):
    remote = VendorsRemote(head=(0x55, 0x51))
    setattr(remote.buttons, name, 1)
    assert decode_remote(bytes(remote)).buttons == (name,)
    assert encode_remote(name)[2:4] == bytes(remote)[2:4]


def test_the_sticks_are_where_the_vendors_header_has_them():
    remote = VendorsRemote(lx=0.25, rx=-0.5, ry=0.75, L2=1.0, ly=-1.0)
    assert decode_remote(bytes(remote)) == ((), 0.25, -0.5, 0.75, 1.0, -1.0)


def test_a_remote_that_says_nothing_presses_nothing():
    assert decode_remote(bytes(40)) == ((), 0.0, 0.0, 0.0, 0.0, 0.0)


def test_several_buttons_are_all_named():
    assert decode_remote(encode_remote("L2", "B")).buttons == ("L2", "B")


def test_another_number_of_bytes_is_refused():
    with pytest.raises(ValueError, match="expected 40 bytes, got 39"):
        decode_remote(bytes(39))
