"""What the MAVSDK clients share. They know nothing of uavmap and fly the vehicle that they find."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import AsyncIterator, Awaitable, Callable
from typing import Any

from mavsdk.asyncio import ComponentType, Configuration, Mavsdk
from mavsdk.asyncio.plugins.mission_raw import MissionRawAsync
from mavsdk.plugins.mission_raw import MissionItem

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
