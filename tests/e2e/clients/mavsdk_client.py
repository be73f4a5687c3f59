"""A client that knows nothing of uavmap: unmodified MAVSDK flies the vehicle that it finds.

    python mavsdk_client.py URL

Prints what it saw as JSON. Run as a process of its own: MAVSDK keeps threads and sockets.
"""

from __future__ import annotations

import asyncio
import json
import math
import sys
from collections.abc import Awaitable, Callable
from typing import Any

from mavsdk.asyncio import ComponentType, Configuration, Mavsdk
from mavsdk.asyncio.plugins.action import ActionAsync
from mavsdk.asyncio.plugins.telemetry import TelemetryAsync
from mavsdk.plugins.action import ActionError

NORTH_M = 15.0
M_PER_DEG = 111_200.0


async def _until(read: Callable[[], Awaitable[Any]], good: Callable[[Any], bool]) -> Any:
    async with asyncio.timeout(30.0):
        while not good(value := await read()):  # noqa: ASYNC110 - getters know no events
            await asyncio.sleep(0.02)
    return value


async def _arm(action: ActionAsync) -> None:
    """Arm, as soon as the autopilot lets us: its gyros may settle after its health is told."""
    async with asyncio.timeout(30.0):
        while True:
            try:
                return await action.arm()
            except ActionError:
                await asyncio.sleep(0.1)


async def main(url: str) -> None:
    configuration = Configuration.create_with_component_type(ComponentType.GROUND_STATION)
    async with Mavsdk(configuration) as mavsdk:
        await mavsdk.add_any_connection(url)
        system = await mavsdk.first_autopilot(timeout_s=20.0)
        assert system is not None, "no autopilot"
        action, telemetry = ActionAsync(system), TelemetryAsync(system)
        await telemetry.set_rate_position(10.0)
        await telemetry.set_rate_home(1.0)
        await telemetry.set_rate_health(2.0)
        await telemetry.set_rate_landed_state(5.0)
        await telemetry.set_rate_in_air(5.0)
        await _until(telemetry.health_all_ok, bool)
        home = await _until(telemetry.position, lambda p: math.isfinite(p.latitude_deg))
        await _arm(action)
        armed = await _until(telemetry.armed, bool)
        await action.set_takeoff_altitude(8.0)
        await action.takeoff()
        await _until(telemetry.position, lambda p: p.relative_altitude_m > 7.5)
        in_air = await _until(telemetry.in_air, bool)
        north_deg = home.latitude_deg + NORTH_M / M_PER_DEG
        await action.goto_location(
            north_deg, home.longitude_deg, home.absolute_altitude_m + 10.0, math.nan
        )
        there = await _until(
            telemetry.position, lambda p: abs(p.latitude_deg - north_deg) * M_PER_DEG < 1.5
        )
        await action.return_to_launch()
        await _until(telemetry.armed, lambda armed: not armed)
        back = await telemetry.position()
        print(
            json.dumps(
                {
                    "armed": armed,
                    "in_air": in_air,
                    "away_m": (there.latitude_deg - home.latitude_deg) * M_PER_DEG,
                    "height_m": there.relative_altitude_m,
                    "back_m": (back.latitude_deg - home.latitude_deg) * M_PER_DEG,
                    "landed_height_m": back.relative_altitude_m,
                }
            )
        )


if __name__ == "__main__":
    asyncio.run(main(sys.argv[1]))
