"""Wind by tilt: airframes of other drag, in winds from all sides, through legs and hovers."""

from __future__ import annotations

import math

import pytest

from missions.events import Airborne, Tracked
from missions.orders import FlyTo, TakeOff
from missions.units import GridPoint
from tests.support.flights import Flight, fly, small_mission
from uavmap.aircraft.guardian.estimates import GRAVITY_M_S2, WindEstimate, drag_m_s2

STEP_S = 0.1


def flown(
    wind: tuple[float, float],
    factor: float,
    legs: list[tuple[float, float]],
    leg_s: float = 20.0,
    gust_m_s: float = 0.0,
) -> list[float]:
    """What is measured along legs (velocity north, east) by an airframe.

    After a minute there is a gust to the north in the first 6 s of every minute. The attitude
    controller answers the drag a second late: a gust pushes at first.
    """
    estimate = WindEstimate()
    north, east, t_s = 0.0, 0.0, 0.0
    known_north, known_east = 0.0, 0.0
    found = []
    for want_north, want_east in legs:
        for _ in range(round(leg_s / STEP_S)):
            gust = gust_m_s if t_s > 60.0 and t_s % 60.0 < 6.0 else 0.0
            a_north = min(max((want_north - north) / 1.0, -2.5), 2.5)
            a_east = min(max((want_east - east) / 1.0, -2.5), 2.5)
            air_north, air_east = north - wind[0] - gust, east - wind[1]
            air = math.hypot(air_north, air_east)
            share = factor * drag_m_s2(air) / air if air > 1e-9 else 0.0
            drag_north, drag_east = share * air_north, share * air_east
            late = STEP_S if gust_m_s else 1.0
            known_north += (drag_north - known_north) * late
            known_east += (drag_east - known_east) * late
            thrust_north, thrust_east = a_north + known_north, a_east + known_east
            a_north, a_east = thrust_north - drag_north, thrust_east - drag_east
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


@pytest.mark.parametrize("factor", [1.0, 2.0])
def test_gusts_say_nothing_of_the_airframe_and_are_no_gale(factor: float) -> None:
    """Six seconds of 10 m/s in a minute, on legs of five seconds: they pass for no 12 m/s."""
    legs = [(6.0 * math.cos(1.1 * k), 6.0 * math.sin(1.1 * k)) for k in range(48)]
    found = flown((3.6, 0.0), factor, legs, leg_s=5.0, gust_m_s=6.4)
    assert 4.0 < max(found) < 9.0  # 8.4 is the mean of 8 s with a gust in them
    assert found[-1] == pytest.approx(3.6, abs=1.5)


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
