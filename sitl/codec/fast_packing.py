"""Payloads of MAVLink 2 packed straight from numbers, for messages that are sent often.

pymavlink's message objects cost several times what their bytes do. Here the dialect's own tables
say how the fields lie in a payload (MAVLink, "Field Reordering"), and no object is made.
"""

from __future__ import annotations

import re
import struct
from collections.abc import Callable
from operator import itemgetter
from typing import TypeAlias

from pymavlink.dialects.v20 import ardupilotmega as mav

from sitl.codec.wire import Message, Packed

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
    pack_fields = struct.Struct("<" + "".join(codes[name] for name in ordered)).pack
    message_id, crc_extra = kind.id, kind.crc_extra
    if order == list(range(count)):
        return lambda *values: (message_id, crc_extra, pack_fields(*values))
    arrange = itemgetter(*order)

    def pack(*values: float) -> Packed:
        if len(values) != count:
            raise struct.error(f"{kind.msgname} takes {count} values, not {len(values)}")
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


# what the telemetry sends; numbers count the fields before the extensions that stay zero
heartbeat = layout(mav.MAVLink_heartbeat_message)
sys_status = layout(mav.MAVLink_sys_status_message, 13)
battery_status = layout(mav.MAVLink_battery_status_message, 11)
system_time = layout(mav.MAVLink_system_time_message)
gps_raw_int = layout(mav.MAVLink_gps_raw_int_message, 13)
attitude = layout(mav.MAVLink_attitude_message)
local_position_ned = layout(mav.MAVLink_local_position_ned_message)
global_position_int = layout(mav.MAVLink_global_position_int_message)
mission_current = layout(mav.MAVLink_mission_current_message)
fence_status = layout(mav.MAVLink_fence_status_message, 4)
gps_global_origin = layout(mav.MAVLink_gps_global_origin_message, 3)
vfr_hud = layout(mav.MAVLink_vfr_hud_message)
position_target_global_int = layout(mav.MAVLink_position_target_global_int_message)
autopilot_version = layout(mav.MAVLink_autopilot_version_message, 11)
wind = layout(mav.MAVLink_wind_message)
ekf_status_report = layout(mav.MAVLink_ekf_status_report_message)
home_position = layout(mav.MAVLink_home_position_message)
extended_sys_state = layout(mav.MAVLink_extended_sys_state_message)
