"""Messages that pymavlink's ardupilotmega dialect lacks, added to its table.

A PX4 sends EVENT and CURRENT_MODE. The parser checks and decodes them as all others from then on;
an import of this module is enough.
"""

from __future__ import annotations

import struct
from typing import Any, Final

from pymavlink.dialects.v20 import ardupilotmega as mav

EVENT: Final = 410
CURRENT_MODE: Final = 436

_LETTERS: Final = {"uint32_t": "I", "uint16_t": "H", "uint8_t": "B"}

Field = tuple[str, str, int]
"""Name, type, and length of the array, 0 for a number."""


def add_message(message_id: int, name: str, crc_extra: int, *fields: Field) -> Any:
    """Add a message to the dialect.

    Args:
        message_id: MAVLink's number of the message.
        name: MAVLink's name of it.
        crc_extra: What its definition adds to the checksum.
        fields: Its fields in the order of the wire, which is that of the constructor, too.

    Returns:
        The class of the message, as pymavlink's generator would make it.
    """
    names, kinds, arrays = (list(column) for column in zip(*fields, strict=True))
    layout = struct.Struct("<" + "".join(f"{n or ''}{_LETTERS[kind]}" for _, kind, n in fields))

    class Added(mav.MAVLink_message):  # type: ignore[misc]
        id, msgname = message_id, name
        fieldnames = ordered_fieldnames = names
        fieldtypes = kinds
        native_format = bytearray("<" + "".join(_LETTERS[kind] for kind in kinds), "ascii")
        orders = tuple(range(len(fields)))
        array_lengths = arrays
        lengths = tuple(max(n, 1) for n in arrays)
        unpacker = layout

        def __init__(self, *values: Any) -> None:
            super().__init__(message_id, name)
            self._fieldnames = names
            self._instance_field, self._instance_offset = None, -1
            for field, value in zip(names, values, strict=True):
                setattr(self, field, value)

        def pack(self, codec: Any, force_mavlink1: bool = False) -> bytes:
            values = [getattr(self, field) for field in names]
            flat = [n for v in values for n in (v if isinstance(v, list | tuple) else (v,))]
            frame: bytes = self._pack(codec, crc_extra, layout.pack(*flat), force_mavlink1)
            return frame

    Added.crc_extra = crc_extra
    mav.mavlink_map[message_id] = Added
    setattr(mav, f"MAVLINK_MSG_ID_{name}", message_id)
    return Added


EventMessage: Final = add_message(
    EVENT,
    "EVENT",
    160,
    ("id", "uint32_t", 0),
    ("event_time_boot_ms", "uint32_t", 0),
    ("sequence", "uint16_t", 0),
    ("destination_component", "uint8_t", 0),
    ("destination_system", "uint8_t", 0),
    ("log_levels", "uint8_t", 0),
    ("arguments", "uint8_t", 40),
)
CurrentModeMessage: Final = add_message(
    CURRENT_MODE,
    "CURRENT_MODE",
    193,
    ("custom_mode", "uint32_t", 0),
    ("intended_custom_mode", "uint32_t", 0),
    ("standard_mode", "uint8_t", 0),
)
