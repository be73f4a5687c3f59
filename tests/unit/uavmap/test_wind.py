"""Wind by tilt: airframes of other drag, in winds from all sides, through legs and hovers."""

from __future__ import annotations

import math

import pytest

from missions.events import Airborne, Tracked
from missions.orders import FlyTo, TakeOff
from missions.units import GridPoint
from tests.unit.uavmap.flights import Flight, fly, small_mission
from uavmap.fly.wind import GRAVITY_M_S2, WindEstimate, drag_m_s2

STEP_S = 0.1


def flown(wind: tuple[float, float], factor: float, legs: list[tuple[float, float]]) -> list[float]:
    """What is measured along legs (velocity north, east; each 20 s) by an airframe."""
    estimate = WindEstimate()
    north, east, t_s = 0.0, 0.0, 0.0
    found = []
    for want_north, want_east in legs:
        for _ in range(200):
            a_north = min(max((want_north - north) / 1.0, -2.5), 2.5)
            a_east = min(max((want_east - east) / 1.0, -2.5), 2.5)
            air_north, air_east = north - wind[0], east - wind[1]
            air = math.hypot(air_north, air_east)
            share = factor * drag_m_s2(air) / air if air > 1e-9 else 0.0
            thrust_north, thrust_east = a_north + share * air_north, a_east + share * air_east
            # nose to the north: forward is north, right is east
            pitch = -math.atan2(thrust_north, GRAVITY_M_S2)
            roll = math.atan2(thrust_east * math.cos(pitch), GRAVITY_M_S2)
            north += a_north * STEP_S
            east += a_east * STEP_S
            t_s += STEP_S
            estimate.tilted(roll, pitch, 0.0)
            estimate.moved(t_s, north, east)
        if estimate.speed_m_s is not None:
            found.append(estimate.speed_m_s)
    return found


LEGS = [(0.0, 0.0), (6.0, 0.0), (0.0, 0.0), (-6.0, 0.0), (0.0, 4.0), (0.0, -6.0), (0.0, 0.0)]


@pytest.mark.parametrize("wind", [(0.0, 0.0), (4.0, 0.0), (-3.0, 3.0), (0.0, -9.0)])
def test_the_quadcopter_measures_its_wind(wind: tuple[float, float]) -> None:
    for measured in flown(wind, 1.0, LEGS):
        assert measured == pytest.approx(math.hypot(*wind), rel=0.25, abs=1.3)


@pytest.mark.parametrize("factor", [0.6, 2.0, 4.0])
def test_another_airframe_is_learned_from_its_legs(factor: float) -> None:
    """Without learning, four times the drag would pass for a wind of 7 m/s in still air."""
    assert max(flown((0.0, 0.0), factor, LEGS)[1:]) < 3.0
    assert flown((0.0, 6.0), factor, LEGS * 2)[-1] == pytest.approx(6.0, abs=2.0)


def test_nothing_is_said_of_the_first_seconds_nor_on_the_ground() -> None:
    estimate = WindEstimate()
    estimate.moved(0.0, 1.0, 1.0)
    assert estimate.speed_m_s is None
    for i in range(40):
        estimate.tilted(0.1, 0.0, 0.0)
        estimate.moved(0.1 * i, 0.0, 0.0)
    assert estimate.speed_m_s is None
    for i in range(60):
        estimate.moved(4.0 + 0.1 * i, 0.0, 0.0)
    assert estimate.speed_m_s is not None
    estimate.forget()
    assert estimate.speed_m_s is None


def test_numbers_that_make_no_sense_change_nothing() -> None:
    estimate = WindEstimate()
    for attitude in ((math.nan, 0.0, 0.0), (0.0, 1.57, 0.0), (0.0, 0.0, math.inf)):
        estimate.tilted(*attitude)
    estimate.moved(0.0, 0.0, 0.0)
    assert estimate.speed_m_s is None


@pytest.mark.parametrize("wind_m_s", [0.0, 7.0])
def test_a_simulated_flight_measures_its_wind(wind_m_s: float) -> None:
    made = small_mission()
    made = made.model_copy(
        update={"wind": made.wind.model_copy(update={"speed_m_s": wind_m_s, "from_deg": 40.0})}
    )

    async def body(flight: Flight) -> None:
        await flight.after(TakeOff(12.0), Airborne)
        for place in ((30.0, 20.0), (-20.0, 30.0), (0.0, 5.0)):
            flight.driver.give(FlyTo((GridPoint(*place),), None, stop=True, height_m=12.0))
            await flight.until(lambda p=place: _there(flight, GridPoint(*p)))  # type: ignore[misc]

    measured = [e.wind_m_s for e in fly(body, made).seen(Tracked) if e.wind_m_s is not None]
    assert len(measured) > 10
    assert sorted(measured)[len(measured) // 2] == pytest.approx(wind_m_s, abs=1.5)
    assert max(measured) < wind_m_s + 3.0


def _there(flight: Flight, place: GridPoint) -> bool:
    return flight.setting.grid.fixed(flight.vehicle.truth.position).distance_to(place) < 1.5
