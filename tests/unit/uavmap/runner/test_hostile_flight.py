"""A flight while somebody sends frames with the vehicle's own ids."""

from __future__ import annotations

import asyncio
import math
from dataclasses import astuple
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mav

from missions.events import Airborne, Arrived, FrameLost, FrameSeen, LinkLost, LookEnded, Tracked
from missions.orders import FlyTo, Look, TakeOff
from missions.units import Cell, GridPoint
from tests.support.flights import Flight, fly, small_mission
from tests.support.running import by
from tests.support.small_missions import START

UP_M = 12.0


def forged(flight: Flight, message: Any, component: int = 1) -> None:
    codec = mav.MAVLink(None, srcSystem=1, srcComponent=component)
    flight.session.feed(message.pack(codec))


def numbers(value: object) -> list[float]:
    if isinstance(value, tuple | list):
        return [number for part in value for number in numbers(part)]
    return [value] if isinstance(value, float) else []


@pytest.mark.parametrize(
    ("lat", "lon"),
    [(214.7, 8.5), (-200.0, 8.5), (START.lat_deg, 200.0), (-33.0, 151.0), (0.0, 0.0)],
)
@by(fly, small_mission)
async def test_a_garbage_position_in_flight_is_not_believed(
    flight: Flight, /, lat: float, lon: float
) -> None:
    """One of the first, for a moment, made the journal unreadable and ended the program."""
    await flight.after(TakeOff(UP_M), Airborne)
    flight.driver.give(FlyTo((GridPoint(30.0, 12.0),), None, True, UP_M))
    before = flight.session.view.gate.refused.total()
    for _ in range(26):  # 1.3 s
        ms = round(flight.now_s() * 1000)
        forged(
            flight,
            mav.MAVLink_global_position_int_message(
                ms, round(lat * 1e7), round(lon * 1e7), 500_000, 12_000, 0, 0, 0, 0
            ),
        )
        await asyncio.sleep(0.05)
    await flight.sees(Arrived)
    assert flight.session.view.gate.refused.total() == before + 26
    assert flight.seen(LinkLost) == []
    for event in flight.events:
        assert all(map(math.isfinite, numbers(astuple(event))))
    assert all(abs(e.position.east_m) < 60.0 for e in flight.seen(Tracked))


@pytest.mark.parametrize(
    ("how", "usable"),
    [
        ({"lat": 2_147_000_000}, False),
        ({"q": [5.0, 0.0, 0.0, 0.0]}, False),
        # so a camera says that it does not know: the autopilot does
        ({"q": [0.0] * 4}, True),
        ({"q": [math.nan] * 4}, True),
        ({"lat": 0, "lon": 0}, True),
    ],
)
@by(fly, small_mission)
async def test_a_rogue_camera_costs_pictures_and_nothing_more(
    flight: Flight, /, how: dict[str, Any], usable: bool
) -> None:
    def poison(message: Any) -> bool:
        if message.get_type() != "CAMERA_IMAGE_CAPTURED":
            return True
        for field, value in how.items():
            setattr(message, field, value)
        forged(flight, message, component=100)
        return False

    await flight.after(TakeOff(UP_M), Airborne)
    flight.to_driver = poison
    await flight.after(Look(Cell(0, 0), 5, UP_M), LookEnded)
    lost, seen = flight.seen(FrameLost), flight.seen(FrameSeen)
    assert (len(seen), len(lost)) == ((5, 0) if usable else (0, 5))
    assert all("the camera tells no usable pose" in event.reason for event in lost)
