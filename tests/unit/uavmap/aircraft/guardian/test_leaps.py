"""Positions and speeds that leap are noticed; what an aircraft can do is not."""

from __future__ import annotations

import asyncio
import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from missions.events import Airborne, OrderFailed
from missions.geo.geodesy import LocalPlane
from missions.orders import FlyTo, TakeOff
from missions.units import GridPoint, LatLon
from tests.support.flights import Flight, fly
from tests.support.running import by
from uavmap.aircraft.guardian.estimates import Leaps

PLANE = LocalPlane(LatLon(47.3, 8.5))
UP_M = 12.0


def at(east_m: float, north_m: float) -> LatLon:
    return PLANE.to_wgs84(east_m, north_m)


@settings(max_examples=60, deadline=None)
@given(
    accelerations=st.lists(
        st.tuples(st.floats(-8.0, 8.0), st.floats(-8.0, 8.0)), min_size=5, max_size=60
    ),
    step_s=st.sampled_from([0.1, 0.2, 0.5, 1.0, 3.0]),
    noise_m=st.floats(0.0, 0.5),
)
def test_whatever_an_aircraft_flies_is_no_leap(
    accelerations: list[tuple[float, float]], step_s: float, noise_m: float
) -> None:
    leaps, t_s = Leaps(), 100.0
    east, north, v_east, v_north = 0.0, 0.0, 0.0, 0.0
    for index, (a_east, a_north) in enumerate(accelerations):
        wobble = noise_m * (-1) ** index
        leaps.take(t_s, at(east + wobble, north - wobble), (v_north, v_east))
        assert leaps.leapt == ""
        east += v_east * step_s + a_east * step_s**2 / 2.0
        north += v_north * step_s + a_north * step_s**2 / 2.0
        v_east, v_north = v_east + a_east * step_s, v_north + a_north * step_s
        t_s += step_s


@given(metres=st.floats(20.0, 500.0), bearing=st.floats(0.0, math.tau), gap_s=st.floats(0.05, 0.8))
def test_a_leap_of_the_position_is_one(metres: float, bearing: float, gap_s: float) -> None:
    leaps = Leaps()
    for tenth in range(20):
        leaps.take(100.0 + tenth / 10.0, at(0.5 * tenth, 0.0), (0.0, 5.0))
    assert leaps.leapt == ""
    there = at(9.5 + metres * math.sin(bearing), metres * math.cos(bearing))
    leaps.take(101.9 + gap_s, there, (0.0, 5.0))
    assert leaps.leapt.startswith("its position has leapt by ")
    leaps.leapt = ""
    leaps.take(102.0 + gap_s, there, (0.0, 5.0))
    assert leaps.leapt == ""  # once is enough


def test_after_a_gap_or_a_restart_nothing_can_be_said() -> None:
    leaps = Leaps()
    leaps.take(100.0, at(0.0, 0.0), (0.0, 0.0))
    leaps.take(102.0, at(80.0, 0.0), (0.0, 0.0))
    leaps.take(3.0, at(0.0, 0.0), (0.0, 0.0))
    assert leaps.leapt == ""


@pytest.mark.parametrize("metres", [25.0, 50.0])
@by(fly)
async def test_a_glitch_in_flight_ends_the_order(flight: Flight, /, metres: float) -> None:
    await flight.after(TakeOff(UP_M), Airborne)
    flight.driver.give(FlyTo((GridPoint(30.0, 20.0),), None, stop=True, height_m=UP_M))
    await asyncio.sleep(3.0)
    flight.vehicle.fail.gps_glitch(metres=metres, toward_deg=90.0)
    failed = await flight.sees(OrderFailed, within_s=3.0)
    assert "satellite navigation is not to be trusted" in failed.reason


@pytest.mark.parametrize("gust_m_s", [8.0, 20.0])
@by(fly)
async def test_a_gust_is_no_leap(flight: Flight, /, gust_m_s: float) -> None:
    await flight.after(TakeOff(UP_M), Airborne)
    flight.driver.give(FlyTo((GridPoint(30.0, 20.0),), None, stop=True, height_m=UP_M))
    await asyncio.sleep(3.0)
    flight.vehicle.fail.wind_gust(m_s=gust_m_s, for_s=2.0)
    await asyncio.sleep(10.0)
    assert not [e for e in flight.seen(OrderFailed) if "leapt" in e.reason]
