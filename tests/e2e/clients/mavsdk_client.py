"""A client that knows nothing of uavmap: unmodified MAVSDK, on either autopilot.

    python mavsdk_client.py URL ardupilot|px4

On a PX4 no rate is asked for: what it streams by itself has to do. Prints what it saw as JSON. Run
as a process of its own: MAVSDK keeps threads and sockets.
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
    """Poll until a value is good, at most 30 s."""
    async with asyncio.timeout(30.0):
        while not good(value := await read()):  # noqa: ASYNC110 - getters know no events
            await asyncio.sleep(0.02)
    return value


@contextlib.asynccontextmanager
async def connected(url: str) -> AsyncIterator[Any]:
    """The first autopilot at a URL."""
    configuration = Configuration.create_with_component_type(ComponentType.GROUND_STATION)
    async with Mavsdk(configuration) as mavsdk:
        await mavsdk.add_any_connection(url)
        system = await mavsdk.first_autopilot(timeout_s=20.0)
        assert system is not None, "no autopilot"
        yield system


def item(seq: int, command: int, lat: float, lon: float, height_m: float, **more: Any) -> Any:
    """A mission item, relative to home."""
    values = {"param1": 0.0, "param2": 0.0, "param3": 0.0, "param4": 0.0, "mission_type": 0}
    return MissionItem(
        seq=seq, frame=6, command=command, current=int(seq == 0), autocontinue=1,
        x=round(lat * 1e7), y=round(lon * 1e7), z=height_m, **{**values, **more},
    )  # fmt: skip


async def upload_fence(mission: MissionRawAsync, lat: float, lon: float) -> int:
    """Upload a square; how many corners the vehicle then has."""
    d = 1e-3
    corners = ((-d, -d), (-d, d), (d, d), (d, -d))
    fence = [
        item(i, FENCE_VERTEX, lat + a, lon + b, 0.0, param1=4.0, mission_type=1)
        for i, (a, b) in enumerate(corners)
    ]
    await mission.upload_geofence(fence)
    return len(await mission.download_geofence())


async def fly_copter(system: Any, seen: dict[str, Any]) -> None:
    """Rates, parameters, a mission from take-off to the ground, a fence."""
    action, telemetry = ActionAsync(system), TelemetryAsync(system)
    mission, param = MissionRawAsync(system), ParamAsync(system)
    await telemetry.set_rate_position(10.0)
    await telemetry.set_rate_home(1.0)
    await telemetry.set_rate_health(2.0)
    await telemetry.set_rate_landed_state(5.0)
    await telemetry.set_rate_in_air(5.0)

    await count(param, seen)
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
    await there_and_back(telemetry, lat, seen)


async def there_and_back(telemetry: TelemetryAsync, lat: float, seen: dict[str, Any]) -> None:
    """Watch a mission until it is over."""
    north = lat + NORTH_M / M_PER_DEG
    await until(telemetry.position, lambda p: abs(p.latitude_deg - north) * M_PER_DEG < 2.5)
    await until(telemetry.armed, lambda armed: not armed)
    last = await telemetry.position()
    seen["back_m"] = abs(last.latitude_deg - lat) * M_PER_DEG


async def count(param: ParamAsync, seen: dict[str, Any]) -> None:
    """List all parameters."""
    everything = await param.get_all_params()
    assert min(len(everything.int_params), len(everything.float_params)) > 15
    seen["parameters"] = len(everything.int_params) + len(everything.float_params)


async def parameters(param: ParamAsync, seen: dict[str, Any]) -> None:
    """List them all, set one of each type."""
    await count(param, seen)
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


async def fly_px4(system: Any, seen: dict[str, Any]) -> None:
    """Parameters of both types, take-off, offboard flight, a mission."""
    action, telemetry = ActionAsync(system), TelemetryAsync(system)
    mission, offboard = MissionRawAsync(system), OffboardAsync(system)
    await parameters(ParamAsync(system), seen)
    await until(telemetry.health_all_ok, bool)
    home = await until(telemetry.position, lambda p: math.isfinite(p.latitude_deg))
    lat, lon = home.latitude_deg, home.longitude_deg
    await plans(mission, lat, lon, seen)
    await action.arm()
    await action.takeoff()  # to MIS_TAKEOFF_ALT
    await until(telemetry.position, lambda p: p.relative_altitude_m > 7.5)
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
    await there_and_back(telemetry, lat, seen)


async def main(url: str, autopilot: str) -> None:
    seen: dict[str, Any] = {}
    async with connected(url) as system:
        await (fly_px4 if autopilot == "px4" else fly_copter)(system, seen)
        print(json.dumps(seen))


if __name__ == "__main__":
    asyncio.run(main(*sys.argv[1:]))
