"""A client that knows nothing of uavmap: plain pymavlink, as a script of its user would do it.

    python pymavlink_client.py ADDRESS

Flies an ArduCopter or a PX4 and prints what it saw as JSON.
"""

from __future__ import annotations

import json
import math
import os
import struct
import sys
import time
from collections.abc import Callable
from typing import Any

from pymavlink import mavutil
from pymavlink.dialects.v20 import ardupilotmega as mav

M_PER_DEG = 111_200.0
PATIENCE_S = 240.0
NORTH_E7 = round(15.0 / M_PER_DEG * 1e7)
INT32 = mav.MAV_PARAM_TYPE_INT32
PX4_HOLD = 4 << 16 | 3 << 24


def wait(link: Any, kind: str, **fields: Any) -> Any:
    """The next message of a kind with such fields."""
    end_s = time.monotonic() + PATIENCE_S
    while time.monotonic() < end_s:
        message = link.recv_match(type=kind, blocking=True, timeout=1.0)
        if message is not None and all(getattr(message, k) == v for k, v in fields.items()):
            return message
    raise TimeoutError(f"no {kind} {fields}")


def command(link: Any, number: int, *p: float) -> int:
    """COMMAND_LONG and its result."""
    link.mav.command_long_send(1, 1, number, 0, *p, *([0.0] * (7 - len(p))))
    return int(wait(link, "COMMAND_ACK", command=number).result)


def parameters(link: Any, read: Callable[[Any], float] | None = None) -> dict[str, float]:
    """All of them, by how a message is read."""
    link.mav.param_request_list_send(1, 1)
    found: dict[str, float] = {}
    while True:
        value = wait(link, "PARAM_VALUE")
        found[value.param_id] = value.param_value if read is None else read(value)
        if len(found) == value.param_count:
            return found


def upload(link: Any, items: list[Any]) -> int:
    """A mission; the MAV_MISSION_RESULT."""
    link.mav.mission_count_send(1, 1, len(items), mav.MAV_MISSION_TYPE_MISSION)
    while True:
        message = wait_any(link, "MISSION_REQUEST", "MISSION_REQUEST_INT", "MISSION_ACK")
        if message.get_type() == "MISSION_ACK":
            return int(message.type)
        link.mav.send(items[message.seq])


def wait_any(link: Any, *kinds: str) -> Any:
    """The next message of several kinds."""
    message = link.recv_match(type=list(kinds), blocking=True, timeout=PATIENCE_S)
    if message is None:
        raise TimeoutError(f"none of {kinds}")
    return message


def download(link: Any) -> list[Any]:
    """The mission that the vehicle has."""
    link.mav.mission_request_list_send(1, 1, mav.MAV_MISSION_TYPE_MISSION)
    items = []
    for seq in range(wait(link, "MISSION_COUNT").count):
        link.mav.mission_request_int_send(1, 1, seq, mav.MAV_MISSION_TYPE_MISSION)
        items.append(wait(link, "MISSION_ITEM_INT", seq=seq))
    link.mav.mission_ack_send(1, 1, mav.MAV_MISSION_ACCEPTED, mav.MAV_MISSION_TYPE_MISSION)
    return items


def item(seq: int, number: int, lat_e7: int, lon_e7: int, height_m: float) -> Any:
    """A mission item, relative to home."""
    return mav.MAVLink_mission_item_int_message(
        1, 1, seq, 6, number, 0, 1, 0.0, 0.0, 0.0, 0.0, lat_e7, lon_e7, height_m, 0
    )


def typed(value: Any) -> float:
    """What a PARAM_VALUE says, by its type."""
    if value.param_type == INT32:
        return int(struct.unpack("<i", struct.pack("<f", value.param_value))[0])
    return float(value.param_value)


def mode(link: Any, name: str) -> int:
    """DO_SET_MODE by pymavlink's own table; the result."""
    return command(link, mav.MAV_CMD_DO_SET_MODE, *mavutil.px4_map[name])


def fly_copter(link: Any, home: Any, seen: dict[str, Any]) -> None:
    """Parameters, a mission, guided flight, then the mission."""
    link.mav.request_data_stream_send(1, 1, mav.MAV_DATA_STREAM_ALL, 10, 1)
    command(link, mav.MAV_CMD_SET_MESSAGE_INTERVAL, mav.MAVLINK_MSG_ID_EXTENDED_SYS_STATE, 100_000)
    found = parameters(link)
    seen["parameters"] = len(found)
    link.param_set_send("RTL_ALT", 1200)
    seen["rtl_alt"] = wait(link, "PARAM_VALUE", param_id="RTL_ALT").param_value

    items = [
        item(0, mav.MAV_CMD_NAV_WAYPOINT, home.lat, home.lon, 0.0),
        item(1, mav.MAV_CMD_NAV_TAKEOFF, 0, 0, 8.0),
        item(2, mav.MAV_CMD_NAV_WAYPOINT, home.lat + NORTH_E7, home.lon, 8.0),
        item(3, mav.MAV_CMD_NAV_RETURN_TO_LAUNCH, 0, 0, 0.0),
    ]
    seen["upload"] = upload(link, items)
    back = download(link)
    seen["download"] = [one.command for one in back]
    seen["same"] = (back[2].x, back[2].y) == (items[2].x, items[2].y)

    link.set_mode("GUIDED")
    wait(link, "HEARTBEAT", custom_mode=4)
    seen["arm"] = command(link, mav.MAV_CMD_COMPONENT_ARM_DISARM, 1)
    seen["take_off"] = command(link, mav.MAV_CMD_NAV_TAKEOFF, 0, 0, 0, 0, 0, 0, 8)
    while wait(link, "GLOBAL_POSITION_INT").relative_alt < 7_500:
        pass
    link.mav.set_position_target_global_int_send(
        0, 1, 1, 6, 0x0DF8, home.lat + NORTH_E7, home.lon, 8.0, *([0.0] * 8)
    )
    while abs(wait(link, "GLOBAL_POSITION_INT").lat - home.lat - NORTH_E7) > 150:
        pass

    seen["auto"] = command(link, mav.MAV_CMD_DO_SET_MODE, 1, 3)
    seen["reached"] = wait(link, "MISSION_ITEM_REACHED", seq=2).seq
    wait(link, "EXTENDED_SYS_STATE", landed_state=mav.MAV_LANDED_STATE_ON_GROUND)


def fly_px4(link: Any, home: Any, seen: dict[str, Any]) -> None:
    """The same by a PX4's parameters, modes and commands."""
    seen["parameters"] = len(parameters(link, typed))
    bits = struct.unpack("<f", struct.pack("<i", 3))[0]
    link.mav.param_set_send(1, 1, b"GF_ACTION", bits, INT32)
    seen["gf_action"] = typed(wait(link, "PARAM_VALUE", param_id="GF_ACTION"))
    link.param_set_send("MIS_TAKEOFF_ALT", 8.0, mav.MAV_PARAM_TYPE_REAL32)
    seen["take_off_alt"] = typed(wait(link, "PARAM_VALUE", param_id="MIS_TAKEOFF_ALT"))

    items = [
        item(0, mav.MAV_CMD_NAV_WAYPOINT, home.lat + NORTH_E7, home.lon, 10.0),
        item(1, mav.MAV_CMD_NAV_WAYPOINT, home.lat, home.lon, 10.0),
        item(2, mav.MAV_CMD_NAV_LAND, home.lat, home.lon, 0.0),
    ]
    seen["upload"] = upload(link, items)
    seen["download"] = [one.command for one in download(link)]

    seen["hold"] = mode(link, "LOITER")
    seen["arm"] = command(link, mav.MAV_CMD_COMPONENT_ARM_DISARM, 1)
    nan = math.nan
    seen["take_off"] = command(link, mav.MAV_CMD_NAV_TAKEOFF, 0, 0, 0, nan, nan, nan, nan)
    while wait(link, "GLOBAL_POSITION_INT").relative_alt < 7_500:
        pass
    wait(link, "HEARTBEAT", custom_mode=PX4_HOLD)
    amsl_m = home.alt / 1000.0 + 12.0
    link.mav.command_int_send(
        1, 1, mav.MAV_FRAME_GLOBAL_INT, mav.MAV_CMD_DO_REPOSITION, 0, 0,
        -1, 1, 0, nan, home.lat, home.lon + NORTH_E7, amsl_m,
    )  # fmt: skip
    seen["reposition"] = int(wait(link, "COMMAND_ACK", command=192).result)
    while abs(wait(link, "GLOBAL_POSITION_INT").lon - home.lon - NORTH_E7) > 150:
        pass
    seen["mission"] = mode(link, "MISSION")
    seen["reached"] = [wait(link, "MISSION_ITEM_REACHED").seq for _ in items]


def main(address: str) -> None:
    """Fly."""
    # now and not at the first frame: it takes seconds, in which what a PX4 streams piles up
    os.environ["MAVLINK20"] = "1"
    mavutil.set_dialect("ardupilotmega")
    link = mavutil.mavlink_connection(address)
    seen: dict[str, Any] = {"autopilot": link.wait_heartbeat(timeout=PATIENCE_S).autopilot}
    px4 = seen["autopilot"] == mav.MAV_AUTOPILOT_PX4
    if not px4:
        link.mav.request_data_stream_send(1, 1, mav.MAV_DATA_STREAM_POSITION, 10, 1)
    home = wait(link, "GLOBAL_POSITION_INT")
    (fly_px4 if px4 else fly_copter)(link, home, seen)
    while wait(link, "HEARTBEAT", type=mav.MAV_TYPE_QUADROTOR).base_mode & 128:
        pass
    last = wait(link, "GLOBAL_POSITION_INT")
    seen["back_m"] = math.hypot(last.lat - home.lat, last.lon - home.lon) / 1e7 * M_PER_DEG
    print(json.dumps(seen))
    link.close()


if __name__ == "__main__":
    main(sys.argv[1])
