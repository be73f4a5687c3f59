"""Returns around a hole in the fence, over steep ground."""

from __future__ import annotations

import asyncio

from shapely.geometry import Point, Polygon

from missions.events import Airborne, Arrived
from missions.mission.schema import Mission
from missions.orders import FlyTo, TakeOff
from missions.units import GridPoint
from tests.support.flights import fly
from tests.support.ground.hills import over, slope
from tests.support.running import by
from tests.support.small_missions import mission, square

UP_M = 14.0
HOUSE = square(-6, 30, 12, 64)
"""A hole between home and the place of the return; the path around it has a long leg."""
FENCE = square(-20, -20, 60, 140)
BEHIND = GridPoint(0.0, 100.0)


def steep() -> Mission:
    """Return ground that rises to the north by 90 %, and a fence with a hole in it."""
    box = square(-4, 10, 24, 12)
    made = mission(box, FENCE, [HOUSE], altitude_m=UP_M, speed_m_s=8.0, capacity_wh=80.0)
    made = over(made, slope(90.0, 0.0))
    return made.model_copy(update={"sim": made.sim.model_copy(update={"gps_sigma_m": 0.0})})


@by(fly, steep)
async def test_return_down_a_steep_slope_goes_around_a_hole(flight, /):
    nearest_m: list[float] = []
    hole = Polygon([tuple(corner) for corner in HOUSE])
    await flight.after(TakeOff(UP_M), Airborne)
    out = FlyTo((BEHIND,), None, stop=True, height_m=UP_M)
    await flight.after(out, Arrived, within_s=600.0)

    def watch() -> bool:
        at = flight.setting.grid.fixed(flight.vehicle.truth.position)
        nearest_m.append(float(hole.distance(Point(at))))
        return flight.vehicle.truth.landed

    homeward = asyncio.create_task(flight.driver.guardian.bring_home("the disk is full"))
    await flight.until(watch, within_s=600.0)
    await homeward
    assert flight.driver.guardian.fate() == ""
    assert min(nearest_m) > 0.5
    assert [line.rpartition("; ")[2] for line in flight.service_lines] == [
        "it is flown home around the fence",
        "it is commanded to return (RTL)",
    ]
