"""The energy estimate never falls with more load, and is never below the true consumption."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from missions.mission.energy import (
    LANDING_OVERHEAD_S,
    LANDING_SPEED_M_S,
    MIN_HEADWAY_M_S,
    EnergyModel,
    energy_model,
)
from tests.support.small_missions import mission, square

FAST = settings(max_examples=200, deadline=None)

MODEL = EnergyModel(
    hover_power_w=300.0, capacity_wh=60.0, reserve=0.15, speed_m_s=5.0, wind_m_s=0.0
)

distances = st.floats(0, 5000)
heights = st.floats(0, 120)
durations = st.floats(0, 600)
powers = st.floats(0, 2000)
models = st.builds(
    EnergyModel,
    hover_power_w=st.floats(50, 2000),
    capacity_wh=st.floats(1, 500),
    reserve=st.floats(0, 0.95),
    speed_m_s=st.floats(0.5, 20),
    wind_m_s=st.floats(0, 25),
    accel_m_s2=st.floats(0.5, 5),
    max_airspeed_m_s=st.floats(4, 30),
)


winds = st.floats(0, 15)
Costs = Callable[[EnergyModel, float], tuple[float, ...]]
AWAY_M = 800.0
GROWING: dict[str, tuple[st.SearchStrategy[float], Costs]] = {
    "distance": (distances, lambda m, x: (m.leg_s(x), m.leg_wh(x), m.home_wh(x, 12.0))),
    "wind": (winds, lambda m, x: home(replace(m, wind_m_s=m.wind_m_s + x))),
    "weakness of the airframe": (winds, lambda m, x: home(replace(m, max_airspeed_m_s=30.0 - x))),
    "height": (
        heights,
        lambda m, x: (m.home_wh(AWAY_M, x), m.climb_wh(x), m.sortie_wh(0.0, 0.0, x, 5.0)),
    ),
    "drawn power": (powers, lambda m, x: (m.power_w(x), m.home_wh(AWAY_M, 12.0, x))),
    "stay": (durations, lambda m, x: (m.sortie_wh(AWAY_M, AWAY_M, 12.0, x),)),
}


def home(model: EnergyModel) -> tuple[float, ...]:
    """Return the times of a short leg and a long one, and the energy of the return."""
    return (*(model.leg_s(away_m) for away_m in (1.0, AWAY_M)), model.home_wh(AWAY_M, 12.0))


@pytest.mark.parametrize("what", GROWING)
@FAST
@given(models, st.data())
def test_energy_of_more_is_never_less(what, model, data):
    values, costs = GROWING[what]
    low, high = sorted((data.draw(values), data.draw(values)))
    assert all(a <= b for a, b in zip(costs(model, low), costs(model, high), strict=True))


# --- the mission's model ---------------------------------------------------------------------
def test_the_model_is_made_of_the_mission_s_battery_wind_and_speeds():
    made = mission(square(0, 0, 40, 30), square(-30, -30, 120, 100), capacity_wh=44.0)
    made = made.model_copy(
        update={
            "wind": made.wind.model_copy(update={"speed_m_s": 3.5}),
            "flight": made.flight.model_copy(update={"max_airspeed_m_s": 9.0, "speed_m_s": 4.0}),
            "battery": made.battery.model_copy(update={"reserve": 0.25, "hover_power_w": 250.0}),
        }
    )
    assert energy_model(made) == EnergyModel(
        hover_power_w=250.0, capacity_wh=44.0, reserve=0.25, speed_m_s=4.0, wind_m_s=3.5,
        max_airspeed_m_s=9.0,
    )  # fmt: skip


# --- power -----------------------------------------------------------------------------------
@FAST
@given(models, powers)
def test_power_is_above_the_power_drawn_and_that_of_hovering(model, drawn_w):
    assert model.power_w(drawn_w) >= drawn_w
    assert model.power_w(drawn_w) > model.hover_power_w


# --- legs ------------------------------------------------------------------------------------
def flown_s(distance_m: float, speed_m_s: float, accel_m_s2: float, step_s: float = 0.002) -> float:
    """Integrate a leg from rest to rest: full acceleration, as fast as allowed, full braking."""
    t_s = at_m = v_m_s = 0.0
    while at_m < distance_m:
        braking_m = v_m_s**2 / (2 * accel_m_s2)
        if at_m + braking_m >= distance_m:
            v_m_s = max(v_m_s - accel_m_s2 * step_s, 1e-3)
        else:
            v_m_s = min(v_m_s + accel_m_s2 * step_s, speed_m_s)
        at_m += v_m_s * step_s
        t_s += step_s
        if t_s > 1e4:
            raise AssertionError("it does not arrive")
    return t_s


@pytest.mark.parametrize("distance_m", [0.5, 4.0, 12.5, 40.0, 150.0])
@pytest.mark.parametrize(("speed_m_s", "accel_m_s2"), [(1.0, 2.0), (5.0, 2.0), (10.0, 1.0)])
def test_a_leg_takes_at_least_as_long_as_flown(distance_m, speed_m_s, accel_m_s2):
    model = replace(MODEL, speed_m_s=speed_m_s, accel_m_s2=accel_m_s2)
    flown = flown_s(distance_m, speed_m_s, accel_m_s2)
    assert model.leg_s(distance_m) >= flown - 0.05
    if distance_m >= speed_m_s**2 / accel_m_s2:  # it gets up to speed: the estimate is exact
        assert model.leg_s(distance_m) == pytest.approx(flown, abs=0.05)


def test_a_leg_of_no_length_is_not_free():
    assert MODEL.leg_s(0.0) == pytest.approx(5.0 / 2.0)


@pytest.mark.parametrize(
    ("wind_m_s", "made_good_m_s"),
    [
        (7.0, 5.0),  # below the limit it leans more, and the margin on the power covers it
        (7.1, 4.9), (8.0, 4.0), (11.0, 1.0), (11.5, 0.5),
        # measured wind may be anything: the return is then costly, not endless or negative
        *((beyond_m_s, MIN_HEADWAY_M_S) for beyond_m_s in (11.6, 12.0, 40.0)),
    ],
)  # fmt: skip
def test_leg_against_wind_has_the_rest_of_the_airspeed(wind_m_s, made_good_m_s):
    windy = replace(MODEL, wind_m_s=wind_m_s)
    assert windy.leg_s(0.0) == MODEL.leg_s(0.0)
    assert windy.leg_s(1000.0) - windy.leg_s(0.0) == pytest.approx(1000.0 / made_good_m_s)
    assert math.isfinite(windy.home_wh(1000.0, 12.0))


# --- hovering, climbing, landing -------------------------------------------------------------
@FAST
@given(models, distances, heights, powers)
def test_the_reserve_is_left_at_touch_down(model, distance_m, height_m, drawn_w):
    start_wh = model.home_wh(distance_m, height_m, drawn_w)
    flown_wh = model.leg_wh(distance_m, drawn_w)
    landing_s = height_m / LANDING_SPEED_M_S + LANDING_OVERHEAD_S
    left_wh = start_wh - flown_wh - model.hover_wh(landing_s, drawn_w)
    assert left_wh == pytest.approx(model.reserve_wh, abs=1e-6)


# --- whole sorties ---------------------------------------------------------------------------
def test_a_sortie_of_the_runway_by_hand():
    """It flies 12 m up, 100 m out and home at 5 m/s, and five seconds over a cell.

    The flight takes 13 s, 22.5 s twice, 5 s and 36 s at 345 W, and 9 Wh of reserve.
    """
    seconds = 13.0 + 22.5 + 5.0 + 22.5 + 36.0
    expected = 345.0 * seconds / 3600.0 + 9.0
    assert MODEL.sortie_wh(100.0, 100.0, 12.0, 5.0) == pytest.approx(expected)


def test_energy_that_the_rule_keeps_brings_a_vehicle_home_in_a_simple_flight():
    model = replace(MODEL, wind_m_s=9.0)
    left_wh, away_m = model.capacity_wh - model.climb_wh(12.0), 0.0
    per_metre_wh = model.power_w(0.0) / model.speed_m_s / 3600.0
    while left_wh - per_metre_wh >= model.home_wh(away_m + 1.0, 12.0):
        left_wh -= per_metre_wh
        away_m += 1.0
    home_s = flown_s(away_m, 3.0, model.accel_m_s2) + 12.0 / LANDING_SPEED_M_S + LANDING_OVERHEAD_S
    at_touch_down_wh = left_wh - model.hover_wh(home_s)
    assert away_m > 500.0
    assert model.reserve_wh - 0.01 <= at_touch_down_wh <= model.reserve_wh + 0.5


def test_energy_measured_wind_counts_if_it_is_stronger_than_the_given_one() -> None:
    given = replace(MODEL, wind_m_s=4.0)
    assert given.in_wind(3.0) == given
    assert given.in_wind(9.0) == replace(given, wind_m_s=9.0)
