"""MAVLink messages as MAVSDK tells and takes them: JSON here, pymavlink's objects there.

MAVSDK writes a number that is none as null, and so must we. A message is made as MAVSDK has read
it: what pymavlink would have made of the same bytes is nowhere asked.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Mapping
from typing import Any, Final

from pymavlink.dialects.v20 import ardupilotmega as mav

import uavmap.mavlink.dialect  # noqa: F401 - adds messages to the table below

Message = Any

_CLASSES: Final = {made.msgname: made for made in mav.mavlink_map.values()}
_FLOATS: Final = ("float", "double")


def fields_of(message: Message) -> dict[str, Any]:
    """A message's fields for MAVSDK.

    >>> fields_of(mav.MAVLink_command_ack_message(400, 0))["command"]
    400
    """
    return {name: _told(getattr(message, name)) for name in message.ordered_fieldnames}


def _told(value: Any) -> Any:
    if isinstance(value, bytes | bytearray):
        return value.rstrip(b"\0").decode("ascii", "replace")
    if isinstance(value, list | tuple):
        return [_told(one) for one in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value


def message_of(name: str, system: int, component: int, fields: Mapping[str, Any]) -> Message | None:
    """The message that MAVSDK has read; None for one that is not known here, or is broken.

    >>> told = {"command": 400, "result": 0, "progress": 0, "result_param2": 0}
    >>> ack = message_of("COMMAND_ACK", 1, 1, told)
    >>> ack.get_type(), ack.get_srcComponent(), ack.command, ack.target_system
    ('COMMAND_ACK', 1, 400, 0)
    """
    made = _CLASSES.get(name)
    if made is None:
        return None
    try:
        values = [_value(fields, *field) for field in _layout(name)]
    except (TypeError, ValueError):
        return None
    message = made(*values)
    message._header = mav.MAVLink_header(made.id, srcSystem=system, srcComponent=component)
    return message


def _value(fields: Mapping[str, Any], name: str, kind: str, length: int) -> Any:
    """A field's value; zero for one that MAVSDK does not know, as if the message were shorter."""
    if kind == "char":
        return str(fields.get(name) or "").encode()
    if not length:
        return _number(fields.get(name, 0), kind)
    values = fields.get(name, [0] * length)
    if len(values) != length:
        raise ValueError(f"{name} has {len(values)} elements")
    return [_number(one, kind) for one in values]


def _number(value: Any, kind: str) -> float | int:
    """A number of a field. Raises `TypeError` where a whole number is missing."""
    if kind in _FLOATS:
        return math.nan if value is None else float(value)
    if not isinstance(value, int):
        raise TypeError(f"no whole number: {value!r}")
    return value


@functools.cache
def _layout(name: str) -> tuple[tuple[str, str, int], ...]:
    """Of each field, in the order of the constructor: name, kind, length (0: no array)."""
    made = _CLASSES[name]
    lengths = dict(zip(made.ordered_fieldnames, made.array_lengths, strict=True))
    kinds = zip(made.fieldnames, made.fieldtypes, strict=True)
    return tuple((field, kind, lengths[field]) for field, kind in kinds)
