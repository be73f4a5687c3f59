"""A vehicle without satellites is told where it is: its told place leaps, its place does not."""

from __future__ import annotations

import asyncio
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mav

from missions.units import LatLon
from tests.support.mavlink_peer import Peer, ack, heartbeat
from tests.support.running import by, on_virtual_time
from uavmap.mavlink.commands import MavlinkCommands
from uavmap.mavlink.continuity import distance_m

LAT, LON = 47.3, 8.5
DEG = 1e-5
"""1.1 m to the north."""
OFF = 18.0 * DEG
ESTIMATE: int = mav.MAV_CMD_EXTERNAL_POSITION_ESTIMATE


@by(on_virtual_time)
async def test_place_of_vehicle_that_takes_an_estimate_does_not_leap() -> None:
    """Until the next picture place and targets were off by what the autopilot had corrected."""
    peer, taken_s = Peer(), list[float]()
    view, loop = peer.session.view, asyncio.get_running_loop()
    peer.session.feed(peer.frame(heartbeat(armed=True)))

    def answer(message: Any) -> None:
        if getattr(message, "command", None) == ESTIMATE:
            taken_s.append(loop.time() + 0.05)
            peer.say(ack(ESTIMATE, mav.MAV_RESULT_ACCEPTED), after_s=0.05)

    peer.answer = answer
    places: list[float] = []

    async def fly() -> None:
        """6 m/s to the north, told 20 m too far north."""
        for n in range(60):
            true = LAT + 0.6 / 111_195.0 * n
            leapt = bool(taken_s) and loop.time() > taken_s[0]
            told = true + (0.1 * OFF if leapt else OFF)
            height = (512_000, 12_000, 600, 0, 0, 0)
            message = mav.MAVLink_global_position_int_message(
                round(loop.time() * 1000), round(told * 1e7), round(LON * 1e7), *height
            )
            peer.session.feed(peer.frame(message))
            assert view.position is not None
            places.append(distance_m(view.position, LatLon(true, LON)))
            await asyncio.sleep(0.1)

    view.off_deg = (OFF, 0.0)
    flying = asyncio.create_task(fly())
    await asyncio.sleep(2.0)
    await MavlinkCommands(peer.session).you_are_at(view.position or LatLon(0.0, 0.0), 1.0)
    await flying
    assert max(places) < 0.2
    assert abs(view.off_deg[0] - 0.1 * OFF) < 0.1 * DEG


@by(on_virtual_time)
async def test_leap_of_a_place_without_an_estimate_is_left_to_those_who_judge_it() -> None:
    peer = Peer()
    peer.session.feed(peer.frame(heartbeat(armed=True)))
    for n, north in enumerate((0.0, 0.0, 18.0 * DEG)):
        height = (512_000, 12_000, 0, 0, 0, 0)
        message = mav.MAVLink_global_position_int_message(
            1000 + 100 * n, round((LAT + north) * 1e7), round(LON * 1e7), *height
        )
        peer.session.feed(peer.frame(message))
    assert peer.session.view.off_deg == (0.0, 0.0)
