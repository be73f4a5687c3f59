"""A client that knows nothing of uavmap: plain pymavlink on a PX4.

    python pymavlink_px4_client.py ADDRESS

Prints what it saw as JSON.
"""

from __future__ import annotations

import json
import math
import os
import struct
import sys
from typing import Any

from pymavlink import mavutil
from pymavlink.dialects.v20 import ardupilotmega as mav

from tests.e2e.clients.pymavlink_client import (
    M_PER_DEG,
    PATIENCE_S,
    command,
    download,
    item,
    parameters,
    upload,
    wait,
)

INT32 = mav.MAV_PARAM_TYPE_INT32
HOLD = 4 << 16 | 3 << 24


def typed(value: Any) -> float:
    """What a PARAM_VALUE says, by its type."""
    if value.param_type == INT32:
        return int(struct.unpack("<i", struct.pack("<f", value.param_value))[0])
    return float(value.param_value)


def mode(link: Any, name: str) -> int:
    """DO_SET_MODE by pymavlink's own table; the result."""
    return command(link, mav.MAV_CMD_DO_SET_MODE, *mavutil.px4_map[name])


def main(address: str) -> None:
    """Fly."""
    # now and not at the first frame: it takes seconds, in which what a PX4 streams piles up
    os.environ["MAVLINK20"] = "1"
    mavutil.set_dialect("ardupilotmega")
    link = mavutil.mavlink_connection(address)
    seen: dict[str, Any] = {"autopilot": link.wait_heartbeat(timeout=PATIENCE_S).autopilot}
    home = wait(link, "GLOBAL_POSITION_INT")

    seen["parameters"] = len(parameters(link, typed))
    bits = struct.unpack("<f", struct.pack("<i", 3))[0]
    link.mav.param_set_send(1, 1, b"GF_ACTION", bits, INT32)
    seen["gf_action"] = typed(wait(link, "PARAM_VALUE", param_id="GF_ACTION"))
    link.param_set_send("MIS_TAKEOFF_ALT", 8.0, mav.MAV_PARAM_TYPE_REAL32)
    seen["take_off_alt"] = typed(wait(link, "PARAM_VALUE", param_id="MIS_TAKEOFF_ALT"))

    north = round(15.0 / M_PER_DEG * 1e7)
    items = [
        item(0, mav.MAV_CMD_NAV_WAYPOINT, home.lat + north, home.lon, 10.0),
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
    wait(link, "HEARTBEAT", custom_mode=HOLD)
    amsl_m = home.alt / 1000.0 + 12.0
    link.mav.command_int_send(
        1, 1, mav.MAV_FRAME_GLOBAL_INT, mav.MAV_CMD_DO_REPOSITION, 0, 0,
        -1, 1, 0, nan, home.lat, home.lon + north, amsl_m,
    )  # fmt: skip
    seen["reposition"] = int(wait(link, "COMMAND_ACK", command=192).result)
    while abs(wait(link, "GLOBAL_POSITION_INT").lon - home.lon - north) > 150:
        pass
    seen["mission"] = mode(link, "MISSION")
    seen["reached"] = [wait(link, "MISSION_ITEM_REACHED").seq for _ in items]
    while wait(link, "HEARTBEAT", type=mav.MAV_TYPE_QUADROTOR).base_mode & 128:
        pass
    last = wait(link, "GLOBAL_POSITION_INT")
    seen["back_m"] = math.hypot(last.lat - home.lat, last.lon - home.lon) / 1e7 * M_PER_DEG
    print(json.dumps(seen))
    link.close()


if __name__ == "__main__":
    main(sys.argv[1])
