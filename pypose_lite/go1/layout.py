"""A frozen dataclass as the layout of a packed, little-endian structure.

``x: tuple = wire("f", 2)`` is a field of two floats, ``imu: Imu = wire(Imu)`` one nested part,
``motor_state: tuple = wire(MotorState, 20)`` twenty of them; fields come in the order of the wire.
"""

import struct
from collections.abc import Iterator
from dataclasses import field, fields
from functools import cache
from itertools import islice
from typing import Any


def wire(kind: str | type, count: int = 0, default: Any = None) -> Any:
    """A field: a value of a `struct` format, one part, or a tuple of `count`; zero by default."""
    layout = "<" + _format(kind) * (count or 1)
    zero = _take(kind, count, iter(struct.unpack(layout, bytes(struct.calcsize(layout)))))
    return field(default=zero if default is None else default, metadata={"wire": (kind, count)})


def unpack(part: type, data: bytes) -> Any:
    """The part that those bytes hold; their number must be right."""
    return _take(part, 0, iter(struct.unpack("<" + _format(part), data)))


def pack(name: str, part: object) -> bytes:
    """The bytes of a part called `name`.

    Raises:
        ValueError: naming the field whose value does not fit its place.
    """
    kind: Any = type(part)
    rows = list(_give(name, kind, 0, part))
    try:
        return struct.pack("<" + _format(kind), *[value for _, _, value in rows])
    except (struct.error, OverflowError):
        for path, layout, value in rows:
            try:
                struct.pack("<" + layout, value)
            except (struct.error, OverflowError) as error:
                raise ValueError(f"{path}: {value!r} does not fit ({error})") from None
        raise


@cache
def _table(part: Any) -> tuple:
    """The rows (name, kind, count) of a part."""
    return tuple((f.name, *f.metadata["wire"]) for f in fields(part))


@cache
def _format(kind: Any) -> str:
    """The `struct` format of a kind, parts spelled out."""
    if isinstance(kind, str):
        return kind
    return "".join(_format(row) * (count or 1) for _, row, count in _table(kind))


def _take(kind: Any, count: int, values: Iterator) -> Any:
    """The next value of that kind from the flat sequence that `struct` gives."""
    if isinstance(kind, str):
        return tuple(islice(values, count)) if count else next(values)
    rows = _table(kind)
    parts = [kind(*[_take(row, n, values) for _, row, n in rows]) for _ in range(count or 1)]
    return tuple(parts) if count else parts[0]


def _give(name: str, kind: Any, count: int, value: Any) -> Iterator:
    """The flat sequence (name, format, value) that `struct` takes, sizes and parts checked."""
    if count and not (isinstance(value, tuple | list) and len(value) == count):
        raise ValueError(f"{name}: expected {count} values, got {value!r}")
    for item in value if count else (value,):
        if not isinstance(kind, str):
            if not isinstance(item, kind):
                raise ValueError(f"{name}: expected {kind.__name__}, got {item!r}")
            for field_name, row, n in _table(kind):
                yield from _give(f"{name}.{field_name}", row, n, getattr(item, field_name))
        elif kind[-1] == "s" and not (isinstance(item, bytes) and len(item) == int(kind[:-1])):
            # struct would cut it short, or fill it up, in silence
            raise ValueError(f"{name}: expected {kind[:-1]} bytes, got {item!r}")
        else:
            yield name, kind, item
