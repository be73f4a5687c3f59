"""A client without knowledge of uavmap: MAVSDK reads a plan and a waypoint file and uploads both.

    python mavsdk_plan_client.py URL FILE.plan FILE.waypoints

It prints its observations as JSON.
"""

from __future__ import annotations

import asyncio
import json
import sys
from typing import Any

from mavsdk.asyncio.plugins.mission_raw import MissionRawAsync

from tests.e2e.clients.mavsdk_client import connected


def places(items: Any) -> list[tuple[int, int, int, float]]:
    return [(one.command, one.x, one.y, one.z) for one in items]


async def main(url: str, plan: str, waypoints: str) -> None:
    async with connected(url) as system:
        raw = MissionRawAsync(system)
        read = await raw.import_qgroundcontrol_mission(plan)
        old = await raw.import_mission_planner_mission(waypoints)
        seen: dict[str, Any] = {
            "mission": places(read.mission_items),
            "fence": places(read.geofence_items),
            "rally": places(read.rally_items),
            "waypoints": places(old.mission_items),
        }
        await raw.upload_mission(read.mission_items)
        await raw.upload_geofence(read.geofence_items)
        await raw.upload_rally_points(read.rally_items)
        seen["mission_back"] = places(await raw.download_mission())
        seen["fence_back"] = places(await raw.download_geofence())
        seen["rally_back"] = places(await raw.download_rallypoints())
        print(json.dumps(seen))


if __name__ == "__main__":
    asyncio.run(main(*sys.argv[1:]))
