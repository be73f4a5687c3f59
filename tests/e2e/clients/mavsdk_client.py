"""A client without knowledge of uavmap: unmodified MAVSDK, on either autopilot.

    python mavsdk_client.py URL ardupilot|px4

On a PX4 it requests no rate: the autopilot's own streams must suffice. It prints its observations
as JSON. Run it as a process of its own: MAVSDK keeps threads and sockets.
"""

from __future__ import annotations

import asyncio
import contextlib
import json
import math
import sys
from collections.abc import AsyncIterator, Awaitable, Callable
from typing import Any

from mavsdk.asyncio import ComponentType, Configuration, Mavsdk
from mavsdk.asyncio.plugins.action import ActionAsync
from mavsdk.asyncio.plugins.mission_raw import MissionRawAsync
from mavsdk.asyncio.plugins.offboard import OffboardAsync
from mavsdk.asyncio.plugins.param import ParamAsync
from mavsdk.asyncio.plugins.telemetry import TelemetryAsync
from mavsdk.plugins.mission_raw import MissionItem
from mavsdk.plugins.offboard import PositionNedYaw

NORTH_M = 15.0
M_PER_DEG = 111_200.0
WAYPOINT, RTL, TAKEOFF, FENCE_VERTEX = 16, 20, 22, 5001


async def until(read: Callable[[], Awaitable[Any]], good: Callable[[Any], bool]) -> Any:
    async with asyncio.timeout(30.0):
        while not good(value := await read()):  # noqa: ASYNC110 - getters know no events
            await asyncio.sleep(0.02)
    return value


@contextlib.asynccontextmanager
async def connected(url: str) -> AsyncIterator[Any]:
    configuration = Configuration.create_with_component_type(ComponentType.GROUND_STATION)
    async with Mavsdk(configuration) as mavsdk:
        await mavsdk.add_any_connection(url)
        system = await mavsdk.first_autopilot(timeout_s=20.0)
        assert system is not None, "no autopilot"
        yield system


def item(seq: int, command: int, lat: float, lon: float, height_m: float, **more: Any) -> Any:
    values = {"param1": 0.0, "param2": 0.0, "param3": 0.0, "param4": 0.0, "mission_type": 0}
    return MissionItem(
        seq=seq, frame=6, command=command, current=int(seq == 0), autocontinue=1,
        x=round(lat * 1e7), y=round(lon * 1e7), z=height_m, **{**values, **more},
    )  # fmt: skip


async def upload_fence(mission: MissionRawAsync, lat: float, lon: float) -> int:
    d = 1e-3
    corners = ((-d, -d), (-d, d), (d, d), (d, -d))
    fence = [
        item(i, FENCE_VERTEX, lat + a, lon + b, 0.0, param1=4.0, mission_type=1)
        for i, (a, b) in enumerate(corners)
    ]
    await mission.upload_geofence(fence)
    return len(await mission.download_geofence())


async def there_and_back(telemetry: TelemetryAsync, lat: float, seen: dict[str, Any]) -> None:
    north = lat + NORTH_M / M_PER_DEG
    await until(telemetry.position, lambda p: abs(p.latitude_deg - north) * M_PER_DEG < 2.5)
    await until(telemetry.armed, lambda armed: not armed)
    last = await telemetry.position()
    seen["back_m"] = abs(last.latitude_deg - lat) * M_PER_DEG


async def fly(system: Any, autopilot: str, seen: dict[str, Any]) -> None:
    action, telemetry = ActionAsync(system), TelemetryAsync(system)
    mission, param = MissionRawAsync(system), ParamAsync(system)
    px4 = autopilot == "px4"
    if not px4:
        await telemetry.set_rate_position(10.0)
        await telemetry.set_rate_home(1.0)
        await telemetry.set_rate_health(2.0)
        await telemetry.set_rate_landed_state(5.0)
        await telemetry.set_rate_in_air(5.0)
    everything = await param.get_all_params()
    assert min(len(everything.int_params), len(everything.float_params)) > 15
    seen["parameters"] = len(everything.int_params) + len(everything.float_params)
    whole, real = (
        ("COM_LOW_BAT_ACT", "MIS_TAKEOFF_ALT") if px4 else ("WP_YAW_BEHAVIOR", "RALLY_LIMIT_KM")
    )
    await param.set_param_int(whole, 3)
    seen["int"] = await param.get_param_int(whole)
    await param.set_param_float(real, 8.0)
    seen["float"] = await param.get_param_float(real)
    await until(telemetry.health_all_ok, bool)
    home = await until(telemetry.position, lambda p: math.isfinite(p.latitude_deg))
    lat, lon = home.latitude_deg, home.longitude_deg
    plan = [
        (TAKEOFF, lat, lon, 8.0), (WAYPOINT, lat + NORTH_M / M_PER_DEG, lon, 8.0),
        (RTL, 0.0, 0.0, 0.0),
    ]  # fmt: skip
    if not px4:  # whose item 0 is home
        plan.insert(0, (WAYPOINT, lat, lon, 0.0))
    items = [item(seq, *row, param4=math.nan) for seq, row in enumerate(plan)]
    await mission.upload_mission(items)
    back = await mission.download_mission()
    seen["download"] = [one.command for one in back]
    seen["same"] = (back[-2].x, back[-2].y, back[-2].z) == (items[-2].x, items[-2].y, 8.0)
    seen["fence"] = await upload_fence(mission, lat, lon)
    await action.arm()
    if px4:
        await action.takeoff()  # to MIS_TAKEOFF_ALT
        await until(telemetry.position, lambda p: p.relative_altitude_m > 7.5)
        await fly_offboard(system, telemetry, seen)
    await mission.start_mission()
    await until(telemetry.position, lambda p: p.relative_altitude_m > 6.0)
    await there_and_back(telemetry, lat, seen)


async def fly_offboard(system: Any, telemetry: TelemetryAsync, seen: dict[str, Any]) -> None:
    offboard = OffboardAsync(system)
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


async def main(url: str, autopilot: str) -> None:
    seen: dict[str, Any] = {}
    async with connected(url) as system:
        await fly(system, autopilot, seen)
        print(json.dumps(seen))


if __name__ == "__main__":
    asyncio.run(main(*sys.argv[1:]))
