"""Payloads of MAVLink 2 packed straight from numbers, for messages that are sent many times a second.

pymavlink's message objects cost several times what their bytes do. Here the dialect's own tables
say how the fields lie in a payload (MAVLink, "Field Reordering"), and no object is made.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from operator import itemgetter
from struct import Struct
from struct import error as StructError
from typing import TypeAlias

from pymavlink.dialects.v20 import ardupilotmega as mav

from sitl.wire import Message, Packed

Pack: TypeAlias = Callable[..., Packed]


def layout(kind: Message, fields: int | None = None) -> Pack:
    """A function that packs messages of pymavlink's class `kind`.

    It takes the values in the order of that class, arrays flat, a text as bytes, and does for
    them what the message's `pack` does; it raises `struct.error` for what does not fit. With
    `fields` only the first so many are taken and the rest is zero; raises `ValueError` when it is
    not the rest in the payload too (extensions are).

    >>> pack = layout(mav.MAVLink_system_time_message)
    >>> pack(0, 1000)
    (2, 137, b'\\x00\\x00\\x00\\x00\\x00\\x00\\x00\\x00\\xe8\\x03\\x00\\x00')
    """
    names = kind.fieldnames[:fields]
    ordered = kind.ordered_fieldnames[: len(names)]
    if set(ordered) != set(names):
        raise ValueError(f"{kind.msgname}: other fields than the first {fields} begin its payload")
    codes = dict(
        zip(kind.ordered_fieldnames, re.findall(r"\d*[a-zA-Z]", kind.unpacker.format), strict=True)
    )
    places: dict[str, range] = {}
    count = 0
    for name in names:
        code = codes[name]
        values = 1 if code.endswith("s") else int(code[:-1] or 1)
        places[name] = range(count, count + values)
        count += values
    order = [at for name in ordered for at in places[name]]
    pack_fields = Struct("<" + "".join(codes[name] for name in ordered)).pack
    message_id, crc_extra = kind.id, kind.crc_extra
    if order == list(range(count)):
        return lambda *values: (message_id, crc_extra, pack_fields(*values))
    arrange = itemgetter(*order)

    def pack(*values: float) -> Packed:
        if len(values) != count:
            raise StructError(f"{kind.msgname} takes {count} values, not {len(values)}")
        return message_id, crc_extra, pack_fields(*arrange(values))

    return pack


def int16(value: float) -> int:
    """Rounded, and held to what an int16_t can say.

    >>> int16(1.7), int16(-1e9)
    (2, -32768)
    """
    rounded = round(value)
    return rounded if -0x8000 <= rounded <= 0x7FFF else 0x7FFF if rounded > 0 else -0x8000


def uint16(value: float) -> int:
    """Rounded, and held to what a uint16_t can say."""
    rounded = round(value)
    return rounded if 0 <= rounded <= 0xFFFF else 0xFFFF if rounded > 0 else 0


def int32(value: float) -> int:
    """Rounded, and held to what an int32_t can say."""
    rounded = round(value)
    if -0x80000000 <= rounded <= 0x7FFFFFFF:
        return rounded
    return 0x7FFFFFFF if rounded > 0 else -0x80000000
