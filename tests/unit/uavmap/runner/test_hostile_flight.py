"""A flight while another sender uses the vehicle's own ids."""

from __future__ import annotations

import asyncio
import math
from dataclasses import astuple
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mav

from missions.events import Airborne, Arrived, FrameLost, FrameSeen, LinkLost, LookEnded, Tracked
from missions.geo.fence import Fence
from missions.guardian import LOW_CHARGE_S, Guard, Limits, Snapshot, Task, watch
from missions.mission.energy import EnergyModel
from missions.orders import FlyTo, Look, TakeOff
from missions.units import Cell, GridPoint
from tests.support import forging
from tests.support.flights import Flight, fly, small_mission
from tests.support.running import by
from tests.support.small_missions import START

UP_M = 12.0
FORBIDDEN = frozenset({"air", "end", "tb", "lie"})


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
async def test_garbage_position_in_flight_is_not_believed(flight, /, lat, lon):
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
        # by this value a camera reports an unknown pose: the autopilot's is used
        ({"q": [0.0] * 4}, True),
        ({"q": [math.nan] * 4}, True),
        ({"lat": 0, "lon": 0}, True),
    ],
)
@by(fly, small_mission)
async def test_rogue_camera_costs_pictures_only(flight, /, how, usable):
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
    assert all("the camera reports no usable pose" in event.reason for event in lost)


@pytest.mark.parametrize("kind", forging.KINDS)
def test_flight_survives_two_thousand_forged_frames(kind):
    flight, reached = forging.fly(kind, 1, 2000)
    assert not flight.columns & FORBIDDEN, flight.line()
    assert reached == ()
    if kind == "strangers":  # they have no effect at all
        assert flight.code == 0


def test_single_wrong_charge_does_not_land_the_vehicle_in_the_field():
    corners = ((-50, -50), (50, -50), (50, 50), (-50, 50))
    fence = Fence.from_rings([GridPoint(*corner) for corner in corners], [], 2.0)
    limits = Limits(fence, EnergyModel(300.0, 60.0, 0.15, 5.0, 2.0))
    here = GridPoint(20.0, 20.0)
    guard = Guard(task=Task("hold", 0.0, (here,), height_m=12.0))

    def seen(t_s: float, wh: float) -> Snapshot:
        return Snapshot(t_s, here, 12.0, 0.0, GridPoint(0.0, 0.0), True, True, "follow", wh)

    for second in range(40):
        guard, verdict = watch(limits, guard, seen(float(second), 0.5 if second % 3 == 0 else 50.0))
        assert verdict is None
    verdicts = []
    for second in range(40, 45):
        guard, verdict = watch(limits, guard, seen(float(second), 0.5))
        verdicts.append(verdict)
    (first,) = [v for v in verdicts if v is not None]
    assert first.rung == "land"
    assert verdicts.index(first) in (int(LOW_CHARGE_S), int(LOW_CHARGE_S) + 1)
