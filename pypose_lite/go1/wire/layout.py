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
    values: list = []
    try:
        _give(kind, 0, part, values)
        return struct.pack("<" + _format(kind), *values)
    except (struct.error, OverflowError, TypeError, AttributeError):
        _explain(name, kind, 0, part)
        raise


def places(part: type) -> dict[str, slice]:
    """Where each field of a part lies, in bytes from its beginning, by name."""
    found, start = {}, 0
    for name, kind, count, _ in _table(part):
        end = start + struct.calcsize("<" + _format(kind) * (count or 1))
        found[name], start = slice(start, end), end
    return found


@cache
def _table(part: Any) -> tuple:
    """The rows (name, kind, count, is it a lone number) of a part."""
    rows = ((f.name, *f.metadata["wire"]) for f in fields(part))
    return tuple((name, kind, n, isinstance(kind, str) and not n) for name, kind, n in rows)


@cache
def _format(kind: Any) -> str:
    """The `struct` format of a kind, parts spelled out."""
    if isinstance(kind, str):
        return kind
    return "".join(_format(row) * (count or 1) for _, row, count, _ in _table(kind))


def _take(kind: Any, count: int, values: Iterator) -> Any:
    """The next value of that kind from the flat sequence that `struct` gives."""
    if isinstance(kind, str):
        return tuple(islice(values, count)) if count else next(values)
    rows = _table(kind)
    parts = [
        kind(*[next(values) if lone else _take(row, n, values) for _, row, n, lone in rows])
        for _ in range(count or 1)
    ]
    return tuple(parts) if count else parts[0]


def _give(kind: Any, count: int, value: Any, values: list) -> None:
    """Adds a value to the flat sequence that `struct` takes."""
    if count and len(value) != count:
        raise struct.error  # for `_explain` to name
    if isinstance(kind, str):
        if kind[-1] == "s" and len(value) != int(kind[:-1]):
            raise struct.error  # struct itself would cut it short, or fill it up, in silence
        values += value if count else (value,)
        return
    for part in value if count else (value,):
        for name, row, n, lone in _table(kind):
            if lone and row[-1] != "s":
                values.append(getattr(part, name))
            else:
                _give(row, n, getattr(part, name), values)


def _explain(name: str, kind: Any, count: int, value: Any) -> None:
    """Raises ValueError for the first value that does not fit, with its name."""
    if count and not (isinstance(value, tuple | list) and len(value) == count):
        raise ValueError(f"{name}: expected {count} values, got {value!r}")
    for item in value if count else (value,):
        if not isinstance(kind, str):
            if not isinstance(item, kind):
                raise ValueError(f"{name}: expected {kind.__name__}, got {item!r}")
            for field_name, row, n, _ in _table(kind):
                _explain(f"{name}.{field_name}", row, n, getattr(item, field_name))
        elif kind[-1] == "s":
            if not (isinstance(item, bytes) and len(item) == int(kind[:-1])):
                raise ValueError(f"{name}: expected {kind[:-1]} bytes, got {item!r}")
        else:
            try:
                struct.pack("<" + kind, item)
            except (struct.error, OverflowError) as error:
                raise ValueError(f"{name}: {item!r} does not fit ({error})") from None
