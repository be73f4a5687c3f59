"""A client that knows nothing of uavmap: unmodified MAVSDK flies a PX4 by all that it offers.

    python mavsdk_px4_client.py URL

No rate is asked for: what a PX4 streams by itself has to do. Prints what it saw as JSON.
"""

from __future__ import annotations

import asyncio
import json
import math
import sys
from typing import Any

from mavsdk.asyncio.plugins.action import ActionAsync
from mavsdk.asyncio.plugins.mission_raw import MissionRawAsync
from mavsdk.asyncio.plugins.offboard import OffboardAsync
from mavsdk.asyncio.plugins.param import ParamAsync
from mavsdk.asyncio.plugins.telemetry import TelemetryAsync
from mavsdk.plugins.offboard import PositionNedYaw

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


async def parameters(param: ParamAsync, seen: dict[str, Any]) -> None:
    """List them all, set one of each type."""
    everything = await param.get_all_params()
    seen["int_params"] = len(everything.int_params)
    seen["float_params"] = len(everything.float_params)
    await param.set_param_int("COM_LOW_BAT_ACT", 3)
    seen["int"] = await param.get_param_int("COM_LOW_BAT_ACT")
    await param.set_param_float("MIS_TAKEOFF_ALT", 8.0)
    seen["float"] = await param.get_param_float("MIS_TAKEOFF_ALT")


async def plans(mission: MissionRawAsync, lat: float, lon: float, seen: dict[str, Any]) -> None:
    """A mission whose item 0 is its first, and a fence."""
    north = lat + NORTH_M / M_PER_DEG
    items = [
        item(0, TAKEOFF, lat, lon, 8.0, param4=math.nan),
        item(1, WAYPOINT, north, lon, 10.0, param4=math.nan),
        item(2, RTL, 0.0, 0.0, 0.0),
    ]
    await mission.upload_mission(items)
    back = await mission.download_mission()
    seen["download"] = [one.command for one in back]
    seen["same"] = (back[1].x, back[1].y, back[1].z) == (items[1].x, items[1].y, 10.0)
    seen["fence"] = await upload_fence(mission, lat, lon)


async def main(url: str) -> None:
    async with connected(url) as system:
        action, telemetry = ActionAsync(system), TelemetryAsync(system)
        mission, offboard = MissionRawAsync(system), OffboardAsync(system)
        seen: dict[str, Any] = {}
        await parameters(ParamAsync(system), seen)
        await until(telemetry.health_all_ok, bool)
        home = await until(telemetry.position, lambda p: math.isfinite(p.latitude_deg))
        lat, lon = home.latitude_deg, home.longitude_deg
        await plans(mission, lat, lon, seen)

        def height(low_m: float) -> Any:
            return until(telemetry.position, lambda p: p.relative_altitude_m > low_m)

        await action.arm()
        await action.takeoff()  # to MIS_TAKEOFF_ALT
        await height(7.5)
        await offboard.set_position_ned(
            PositionNedYaw(north_m=0.0, east_m=NORTH_M, down_m=-10.0, yaw_deg=90.0)
        )
        await offboard.start()
        # not the height above home, which moves for two minutes after the start
        there = await until(
            telemetry.position_velocity_ned, lambda p: abs(p.position.east_m - NORTH_M) < 1.0
        )
        seen["offboard_height_m"] = -there.position.down_m
        await offboard.stop()
        await mission.start_mission()
        north = lat + NORTH_M / M_PER_DEG
        await until(telemetry.position, lambda p: abs(p.latitude_deg - north) * M_PER_DEG < 2.5)
        await until(telemetry.armed, lambda armed: not armed)
        last = await telemetry.position()
        seen["back_m"] = abs(last.latitude_deg - lat) * M_PER_DEG
        print(json.dumps(seen))


if __name__ == "__main__":
    asyncio.run(main(sys.argv[1]))
