"""Estimates of wind by tilt, of leaps in positions and speeds, and of impacts on the ground."""

import asyncio
import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from missions.events import Airborne, Arrived, OrderFailed, Tracked
from missions.geo.geodesy import LocalPlane
from missions.guardian import HARD_LANDING_M_S
from missions.orders import TakeOff
from missions.units import LatLon
from tests.support.flights import UP_M, fly, small_mission, to
from tests.support.running import by
from uavmap.aircraft.guardian.estimates import (
    GRAVITY_M_S2,
    IMPACT_KEPT_S,
    Impact,
    Leaps,
    WindEstimate,
    drag_m_s2,
)

STEP_S = 0.1
LEGS = [(0.0, 0.0), (6.0, 0.0), (0.0, 0.0), (-6.0, 0.0), (0.0, 4.0), (0.0, -6.0), (0.0, 0.0)]

# --- wind: airframes of other drag, in winds from all sides, through legs and hovers -----------


def wind_estimates(wind, factor, legs, leg_s=20.0, gust_m_s=0.0):
    """Return the estimates along legs (velocity north, east) of an airframe.

    A gust to the north fills the first 6 s of every minute but the first. The attitude controller
    answers the drag a second late: at first the gust only pushes.
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
            estimate.add_attitude(roll, pitch, 0.0)
            estimate.add_velocity(t_s, north, east)
        if estimate.speed_m_s is not None:
            found.append(estimate.speed_m_s)
    return found


@pytest.mark.parametrize("wind", [(0.0, 0.0), (4.0, 0.0), (-3.0, 3.0), (0.0, -9.0)])
def test_quadcopter_estimates_its_wind(wind):
    for measured in wind_estimates(wind, 1.0, LEGS):
        assert measured == pytest.approx(math.hypot(*wind), rel=0.25, abs=1.3)


@pytest.mark.parametrize("factor", [0.6, 2.0, 4.0])
def test_estimate_of_another_airframe_is_learned_from_its_legs(factor):
    """Without learning, four times the drag would count as a wind of 7 m/s in still air."""
    assert max(wind_estimates((0.0, 0.0), factor, LEGS)[1:]) < 3.0
    assert wind_estimates((0.0, 6.0), factor, LEGS * 2)[-1] == pytest.approx(6.0, abs=2.0)


@pytest.mark.parametrize("factor", [1.0, 2.0])
def test_gusts_leave_the_airframe_estimate_and_are_no_gale(factor):
    """Gusts of 10 m/s for 6 s a minute, on legs of 5 s: no estimate may reach 12 m/s."""
    legs = [(6.0 * math.cos(1.1 * k), 6.0 * math.sin(1.1 * k)) for k in range(48)]
    found = wind_estimates((3.6, 0.0), factor, legs, leg_s=5.0, gust_m_s=6.4)
    assert 4.0 < max(found) < 9.0  # 8.4 is the mean of 8 s with a gust in them
    assert found[-1] == pytest.approx(3.6, abs=1.5)


def test_wind_in_the_first_seconds_and_on_the_ground_is_unknown():
    estimate = WindEstimate()
    estimate.add_velocity(0.0, 1.0, 1.0)
    assert estimate.speed_m_s is None
    for i in range(40):
        estimate.add_attitude(0.1, 0.0, 0.0)
        estimate.add_velocity(0.1 * i, 0.0, 0.0)
    assert estimate.speed_m_s is None
    for i in range(60):
        estimate.add_velocity(4.0 + 0.1 * i, 0.0, 0.0)
    assert estimate.speed_m_s is not None
    estimate.forget()
    assert estimate.speed_m_s is None


def test_implausible_numbers_change_no_estimate():
    estimate = WindEstimate()
    for attitude in ((math.nan, 0.0, 0.0), (0.0, 1.57, 0.0), (0.0, 0.0, math.inf)):
        estimate.add_attitude(*attitude)
    estimate.add_velocity(0.0, 0.0, 0.0)
    assert estimate.speed_m_s is None


@pytest.mark.parametrize("wind_m_s", [0.0, 7.0])
def test_simulated_flight_measures_its_wind(wind_m_s):
    made = small_mission()
    made = made.model_copy(
        update={"wind": made.wind.model_copy(update={"speed_m_s": wind_m_s, "from_deg": 40.0})}
    )

    async def body(flight):
        await flight.after(TakeOff(UP_M), Airborne)
        for place in ((30.0, 20.0), (-20.0, 30.0), (0.0, 5.0)):
            await flight.after(to(*place), Arrived)

    measured = [e.wind_m_s for e in fly(body, made).seen(Tracked) if e.wind_m_s is not None]
    assert len(measured) > 10
    assert sorted(measured)[len(measured) // 2] == pytest.approx(wind_m_s, abs=1.5)
    assert max(measured) < wind_m_s + 3.0


# --- leaps: what an aircraft can do is none ------------------------------------------------------
PLANE = LocalPlane(LatLon(47.3, 8.5))


def at(east_m, north_m):
    return PLANE.to_wgs84(east_m, north_m)


@settings(max_examples=60, deadline=None)
@given(
    accelerations=st.lists(
        st.tuples(st.floats(-8.0, 8.0), st.floats(-8.0, 8.0)), min_size=5, max_size=60
    ),
    step_s=st.sampled_from([0.1, 0.2, 0.5, 1.0, 3.0]),
    noise_m=st.floats(0.0, 0.5),
)
def test_plausible_flight_is_no_leap(accelerations, step_s, noise_m):
    leaps, t_s = Leaps(), 100.0
    east, north, v_east, v_north = 0.0, 0.0, 0.0, 0.0
    for index, (a_east, a_north) in enumerate(accelerations):
        wobble = noise_m * (-1) ** index
        leaps.add(t_s, at(east + wobble, north - wobble), (v_north, v_east))
        assert leaps.leapt == ""
        east += v_east * step_s + a_east * step_s**2 / 2.0
        north += v_north * step_s + a_north * step_s**2 / 2.0
        v_east, v_north = v_east + a_east * step_s, v_north + a_north * step_s
        t_s += step_s


@given(metres=st.floats(20.0, 500.0), bearing=st.floats(0.0, math.tau), gap_s=st.floats(0.05, 0.8))
def test_leap_of_the_position_is_noticed(metres, bearing, gap_s):
    leaps = Leaps()
    for tenth in range(20):
        leaps.add(100.0 + tenth / 10.0, at(0.5 * tenth, 0.0), (0.0, 5.0))
    assert leaps.leapt == ""
    there = at(9.5 + metres * math.sin(bearing), metres * math.cos(bearing))
    leaps.add(101.9 + gap_s, there, (0.0, 5.0))
    assert leaps.leapt.startswith("its position has jumped by ")
    leaps.leapt = ""
    leaps.add(102.0 + gap_s, there, (0.0, 5.0))
    assert leaps.leapt == ""  # one leap is reported once


def test_position_after_a_gap_or_a_restart_is_no_leap():
    leaps = Leaps()
    leaps.add(100.0, at(0.0, 0.0), (0.0, 0.0))
    leaps.add(102.0, at(80.0, 0.0), (0.0, 0.0))
    leaps.add(3.0, at(0.0, 0.0), (0.0, 0.0))
    assert leaps.leapt == ""


async def on_a_leg(flight):
    await flight.after(TakeOff(UP_M), Airborne)
    flight.driver.give(to(30.0, 20.0))
    await asyncio.sleep(3.0)


@pytest.mark.parametrize("metres", [25.0, 50.0])
@by(fly)
async def test_glitch_of_the_position_in_flight_ends_the_order(flight, /, metres):
    await on_a_leg(flight)
    flight.vehicle.fail.gps_glitch(metres=metres, toward_deg=90.0)
    failed = await flight.sees(OrderFailed, within_s=3.0)
    assert "satellite navigation cannot be trusted" in failed.reason


@pytest.mark.parametrize("gust_m_s", [8.0, 20.0])
@by(fly)
async def test_gust_is_no_leap(flight, /, gust_m_s):
    await on_a_leg(flight)
    flight.vehicle.fail.wind_gust(m_s=gust_m_s, for_s=2.0)
    await asyncio.sleep(10.0)
    assert not [e for e in flight.seen(OrderFailed) if "leapt" in e.reason]


# --- impacts: landings, falls, bounces, and messages that are wrong -------------------------------
G_M_S2 = 9.81


def impact_after(speeds, *, every_s=0.1, impact=None):
    impact = Impact() if impact is None else impact
    begin_s = impact._descent[-1][0] if impact._descent else 0.0
    for count, sink_m_s in enumerate(speeds, start=1):
        impact.add(begin_s + count * every_s, sink_m_s)
    return impact


def fall(height_m, every_s):
    """Return the speeds of a fall from rest, and of the rest after it."""
    lasts_s = (2 * height_m / G_M_S2) ** 0.5
    count = int(lasts_s / every_s)
    return [*(G_M_S2 * n * every_s for n in range(count + 1)), 0.0, 0.0]


def test_motors_that_stop_in_the_last_metre_are_an_impact():
    """Reports of a fall of 0.8 m: only its last message is faster than a hard landing."""
    end = [0.78, 1.25, 1.79, 2.33, 2.87]
    assert impact_after([*[0.48] * 20, *end, 0.0, 0.0]).speed_m_s > HARD_LANDING_M_S
    # the same last message without the messages before it
    assert impact_after([*[0.48] * 24, 2.87, 0.0, 0.0]).speed_m_s == 0.48


@pytest.mark.parametrize("fast_m_s", [0.7, 1.5, 2.4])
def test_landing_is_no_impact(fast_m_s):
    impact = impact_after([*[fast_m_s] * 50, *[0.5] * 60, 0.1, 0.0])
    assert impact.speed_m_s == 0.5
    assert impact_after([*[fast_m_s] * 50, 0.0]).speed_m_s <= HARD_LANDING_M_S


@pytest.mark.parametrize(
    ("height_m", "every_s"), [(1.5, 0.1), (3.0, 0.1), (10.0, 0.1), (3.0, 0.2), (10.0, 0.2)]
)
def test_fall_is_an_impact(height_m, every_s):
    assert impact_after(fall(height_m, every_s), every_s=every_s).speed_m_s > HARD_LANDING_M_S


def test_bounce_does_not_hide_an_impact():
    impact = impact_after(fall(3.0, 0.1))
    impact_after([-1.0, -0.5, 0.5, 1.0, 0.0, 0.0], impact=impact)
    assert impact.speed_m_s > HARD_LANDING_M_S


def test_stop_in_the_air_is_forgotten_before_the_landing():
    impact = impact_after([4.0, 4.0, 4.0, 0.0])
    impact_after([0.0] * round(IMPACT_KEPT_S / 0.1 + 1), impact=impact)
    assert impact.speed_m_s == 0.0


def test_braking_as_an_autopilot_brakes_is_no_impact():
    """Braking from 4 m/s with 2.5 m/s2 ends slowly."""
    assert impact_after([4.0 - 0.25 * n for n in range(17)]).speed_m_s < HARD_LANDING_M_S


def test_clock_that_restarts_resets_the_impact():
    impact = impact_after(fall(3.0, 0.1))
    impact.add(0.0, 0.0)
    assert impact.speed_m_s == 0.0
