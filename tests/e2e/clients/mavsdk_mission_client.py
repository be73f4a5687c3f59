"""A client that knows nothing of uavmap: unmodified MAVSDK with parameters, mission and fence.

    python mavsdk_mission_client.py URL

Prints what it saw as JSON. Run as a process of its own: MAVSDK keeps threads and sockets.
"""

from __future__ import annotations

import asyncio
import json
import math
import sys
from typing import Any

from mavsdk.asyncio.plugins.action import ActionAsync
from mavsdk.asyncio.plugins.mission_raw import MissionRawAsync
from mavsdk.asyncio.plugins.param import ParamAsync
from mavsdk.asyncio.plugins.telemetry import TelemetryAsync

from tests.e2e.clients.mavsdk_client import (
    M_PER_DEG,
    NORTH_M,
    RTL,
    TAKEOFF,
    WAYPOINT,
    connected,
    item,
    until,
    upload_fence,
)


async def main(url: str) -> None:
    async with connected(url) as system:
        action, telemetry = ActionAsync(system), TelemetryAsync(system)
        mission, param = MissionRawAsync(system), ParamAsync(system)
        await telemetry.set_rate_position(10.0)
        await telemetry.set_rate_home(1.0)
        await telemetry.set_rate_health(2.0)
        await telemetry.set_rate_landed_state(5.0)
        await telemetry.set_rate_in_air(5.0)
        seen: dict[str, Any] = {}

        everything = await param.get_all_params()
        names = [p.name for p in (*everything.int_params, *everything.float_params)]
        seen["parameters"] = len(names)
        await param.set_param_int("RTL_ALT", 1200)
        seen["rtl_alt"] = await param.get_param_int("RTL_ALT")

        await until(telemetry.health_all_ok, bool)
        home = await until(telemetry.position, lambda p: math.isfinite(p.latitude_deg))
        lat, lon = home.latitude_deg, home.longitude_deg
        north = lat + NORTH_M / M_PER_DEG
        items = [
            item(0, WAYPOINT, lat, lon, 0.0),
            item(1, TAKEOFF, lat, lon, 8.0),
            item(2, WAYPOINT, north, lon, 8.0),
            item(3, RTL, 0.0, 0.0, 0.0),
        ]
        await mission.upload_mission(items)
        back = await mission.download_mission()
        seen["download"] = [one.command for one in back]
        seen["same"] = (back[2].x, back[2].y) == (items[2].x, items[2].y)

        seen["fence"] = await upload_fence(mission, lat, lon)

        await action.arm()
        await mission.start_mission()
        await until(telemetry.position, lambda p: p.relative_altitude_m > 7.5)
        await until(telemetry.position, lambda p: abs(p.latitude_deg - north) * M_PER_DEG < 2.5)
        await until(telemetry.armed, lambda armed: not armed)
        last = await telemetry.position()
        seen["back_m"] = abs(last.latitude_deg - lat) * M_PER_DEG
        print(json.dumps(seen))


if __name__ == "__main__":
    asyncio.run(main(sys.argv[1]))
