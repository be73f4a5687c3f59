"""Missions that cannot be flown are refused: wind, camera, battery, and boxes without a lane."""

from __future__ import annotations

import math
import re

import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from shapely.affinity import rotate
from shapely.geometry import Point, box

from missions.flight.setting_of import setting_of
from missions.geo.grid import Grid
from missions.mission import flyable
from missions.mission.checks import parse_mission
from missions.mission.energy import AIRSPEED_LIMIT_M_S, energy_model
from missions.mission.schema import Flight, Mission
from missions.units import Cell
from tests.support.small_missions import at_heights, square
from tests.support.small_missions import mission as metres
from tests.unit.missions.mission.test_mission_checks import fault, faults, rectangle, text
from vision.projection import SEEN_SHARE

FAST = settings(max_examples=60, deadline=None)


def parsed(**changes: str) -> Mission:
    return parse_mission(text(**changes), "m.toml")


def warned(mission: Mission) -> list[str]:
    return flyable.warnings(mission, Grid.at(mission.home, mission.grid.cell_m))


def area_of(mission: Mission) -> flyable.SearchArea:
    return flyable.search_area(mission, Grid.at(mission.home, mission.grid.cell_m))


@pytest.mark.parametrize(("height_m", "faulty"), [(8.0, False), (11.0, True)])
def test_flyable_home_just_below_its_layer_is_refused(height_m, faulty):
    made = at_heights(metres(square(-10, 16, 40, 30), square(-60, -60, 160, 160)), [height_m])
    fault = (
        "vehicles[0].home_height_m = 11: its layer, 12 m above the start, is less than 3 m above "
        "its home; raise flight.altitude_m"
    )
    assert list(flyable.values(made)) == [fault] * faulty


# --- refused: the changes, what the line says, and changes with which it flies ----------------
FAR = {
    "search__box": rectangle(1500, 0, 1600, 80), "fence__polygon": rectangle(-30, -30, 1700, 110),
}  # fmt: skip
HIGH = {"battery__capacity_wh": "15.0", "team__layer_m": "12.0"}
REFUSED = {
    "more wind than the airframe holds": (
        {"wind__speed_m_s": "20.0"},
        ["wind.speed_m_s = 20: ", "flight.max_airspeed_m_s = 12", "less than 11.5 m/s"], None,
    ),
    "an airframe that holds more may fly in more": (
        {"wind__speed_m_s": "14.0", "camera__mounting": "'gimbal'"}, ["wind.speed_m_s = 14: "],
        {"flight__max_airspeed_m_s": "18.0"},
    ),
    # 2 * 12 * tan(30 deg) = 13.86 m across, three quarters of it along
    "a frame of less than three by three cells": (
        {"camera__hfov_deg": "60.0"},
        ["frame shows 13.9 m x 10.4 m", "10.4 m; 0.8 m off its place",  # no wind, no lean
         "reaches 4.4 m to its nearest edge", "3 x 3 cells of 4 m it needs 5.6 m"], None,
    ),
    "an error of the pose that leaves no cell": (
        {"camera__pose_error_m": "6.0"},
        ["camera.pose_error_m = 6: from 12 m a frame shows 15.1 m"], None,
    ),
    "an upright picture": (
        {"camera__width_px": "480", "camera__height_px": "640", "camera__hfov_deg": "50.0"},
        ["11.2 m x 14.9 m"], None,
    ),
    "the lowest layer counts": (
        {"flight__altitude_m": "8.0", "vehicles": "[{}, {}]"}, ["from 8 m"], None,
    ),
    # 12.1 m along: exactly three cells of 4 m
    "no room for the stray of a hover": (
        {"flight__altitude_m": "9.6"}, ["from 9.6 m a frame shows 16.1 m x 12.1 m"], None,
    ),
    "a bolted camera leans": (
        {"wind__speed_m_s": "5.0"}, ["leaning 6.5 degrees into the wind"],
        {"camera__mounting": "'gimbal'"},
    ),
    "a bolted camera leans less": (
        {"wind__speed_m_s": "5.0"}, ["leaning 6.5 degrees into the wind"],
        {"wind__speed_m_s": "3.6"},
    ),
    "a box too far for the battery": (FAR, ["1500 m away"], {"battery__capacity_wh": "400.0"}),
    "the highest layer must be reached": (
        {**HIGH, "vehicles": "[" + "{}, " * 10 + "]"}, ["vehicles[9] takes", "climb to 120 m"],
        {"vehicles": "[{}]"},
    ),
    "a box in the margin": (
        {"search__box": rectangle(-29, -29, -25, 100), "fence__margin_m": "8.0"},
        ["search.box: fence.margin_m (8) and fence.holes leave no part"], None,
    ),
}  # fmt: skip


@pytest.mark.parametrize(("changes", "message", "mended"), REFUSED.values(), ids=REFUSED)
def test_mission_that_cannot_be_flown_is_refused(changes, message, mended):
    line = fault(**changes)
    assert all(part in line for part in message)
    if mended is not None:
        parsed(**(changes | mended))


@pytest.mark.parametrize(
    ("key", "value", "message", "remedy"),
    [
        ("battery__capacity_wh", "4.0", "without battery.reserve = 0.15 there are 3.4", "raise"),
        ("battery__reserve", "0.99", "battery.reserve = 0.99 there are 0.6 Wh", "lower"),
    ],
)
def test_the_remedy_of_a_battery_suffices(key, value, message, remedy):
    line = fault(**{key: value})
    assert message in line
    found = re.search(remedy + " " + re.escape(key.replace("__", ".")) + r" to ([\d.]+)", line)
    assert found
    parsed(**{key: found[1]})
    if remedy == "raise":
        assert fault(**{key: f"{float(found[1]) - 0.2:.1f}"})


# --- wind ------------------------------------------------------------------------------------
@pytest.mark.parametrize(("wind", "refused"), [("11.5", False), ("11.6", True), ("12.0", True)])
def test_some_headway_must_be_left(wind, refused):
    changes = {"wind__speed_m_s": wind, "camera__mounting": "'gimbal'"}
    if refused:
        assert fault(**changes).startswith("wind.speed_m_s")
    else:
        parsed(**changes)


def test_the_limit_of_the_file_is_that_of_the_energy_model():
    assert Flight().max_airspeed_m_s == AIRSPEED_LIMIT_M_S
    assert setting_of(parsed()).energy.max_airspeed_m_s == AIRSPEED_LIMIT_M_S


# --- camera ----------------------------------------------------------------------------------
def test_the_share_of_a_cell_is_that_of_the_eyes():
    assert flyable.SEEN_SHARE == SEEN_SHARE


@pytest.mark.parametrize("key", ["flight.altitude_m", "hfov_deg", "grid.cell_m"])
@pytest.mark.parametrize("wind", ["0.0", "3.6", "8.0"])
def test_the_remedies_of_a_narrow_camera_suffice(key, wind):
    narrow = {"camera__hfov_deg": "60.0", "wind__speed_m_s": wind}
    line = fault(**narrow)
    found = re.search(re.escape(key) + r" to ([\d.]+)|of " + key + r" ([\d.]+)", line)
    assert found
    value = found[1] or found[2]
    full_key = {"hfov_deg": "camera__hfov_deg"}.get(key, key.replace(".", "__"))
    parsed(**(narrow | {full_key: value}))


def test_the_lean_is_that_of_the_simulator_s_airframe():
    """The simulator flew 4 degrees at 3.6 m/s."""
    lean_deg = math.degrees(flyable.lean_rad(parsed(wind__speed_m_s="3.6")))
    assert lean_deg == pytest.approx(4.0, abs=0.05)
    assert flyable.lean_rad(parsed()) == 0.0


@FAST
@given(yaw_deg=st.floats(0, 360), off_deg=st.floats(0, 360), half_m=st.floats(5.6, 8.0))
def test_a_footprint_that_reaches_far_enough_shows_nine_tenths_at_any_yaw(yaw_deg, off_deg, half_m):
    reach_m = half_m + flyable.POSITION_ERROR_M
    off = (
        flyable.POSITION_ERROR_M * math.cos(math.radians(off_deg)),
        flyable.POSITION_ERROR_M * math.sin(math.radians(off_deg)),
    )
    frame = box(-reach_m, -reach_m, reach_m, reach_m)
    frame = shapely.affinity.translate(rotate(frame, yaw_deg, origin=(0, 0)), *off)
    for cell in Cell(0, 0).cross():
        ground = Point(4.0 * cell.east, 4.0 * cell.north).buffer(2.0, cap_style="square")
        assert ground.intersection(frame).area >= (SEEN_SHARE - 1e-6) * ground.area


# --- battery ---------------------------------------------------------------------------------
@FAST
@given(
    capacity_wh=st.floats(1, 60), reserve=st.floats(0, 0.9), away_m=st.floats(0, 400),
    wind_m_s=st.floats(0, 11),
)  # fmt: skip
def test_accepted_mission_takes_off_in_the_reducer(capacity_wh, reserve, away_m, wind_m_s):
    mission = parsed(
        search__box=rectangle(away_m, 0, away_m + 40, 40),
        fence__polygon=rectangle(-30, -30, 500, 110),
        battery__reserve=f"{reserve:.3f}",
        wind__speed_m_s=f"{wind_m_s:.2f}",
        camera__mounting="'gimbal'",
        battery__capacity_wh="9999.0",
    )
    battery = mission.battery.model_copy(update={"capacity_wh": capacity_wh})
    small = mission.model_copy(update={"battery": battery})
    energy = energy_model(small)
    refused = bool(list(flyable.search(small, Grid.at(small.home, 4.0))))
    out_m = max(away_m, 0.0)
    need_wh = energy.sortie_wh(out_m, out_m, 12.0, setting_of(small).look_s)
    if not math.isclose(need_wh, capacity_wh, rel_tol=0.01):
        assert refused == (need_wh > capacity_wh)


def test_a_corner_that_no_battery_reaches_is_a_warning():
    far = parsed(
        search__box=rectangle(0, 0, 1500, 40),
        fence__polygon=rectangle(-30, -30, 1600, 110),
        battery__capacity_wh="100.0",
    )
    (line,) = warned(far)
    assert line.startswith("battery.capacity_wh = 100: the corner of search.box that is farthest")
    assert "1501 m" in line


def test_the_way_to_the_farthest_corner_goes_round_the_holes():
    fence = square(-60, -60, 160, 160)
    wall = square(20, -58, 4, 100)
    made = metres(square(30, 0, 20, 20), fence, [wall])
    corner = flyable.farthest_corner(made, Grid.at(made.home, 4.0))
    free = flyable.farthest_corner(metres(square(30, 0, 20, 20), fence), Grid.at(made.home, 4.0))
    assert free.away_m == pytest.approx(math.hypot(50, 20), abs=0.01)
    assert corner.away_m > free.away_m + 20
    assert corner.sortie_wh > free.sortie_wh


# --- ground to search ------------------------------------------------------------------------
def test_a_box_covered_by_holes_is_refused():
    holes = f"[{rectangle(40, 30, 60, 51)}, {rectangle(40, 50, 60, 70)}]"
    lines = faults(search__box=rectangle(45, 40, 55, 60), fence__holes=holes)
    assert any("leave no part of it" in line for line in lines)


def test_a_box_that_no_way_leads_to_is_refused():
    wall = f"[{rectangle(40, -31, 44, 111)}]"
    assert "leave no part of it" in fault(search__box=rectangle(60, 0, 100, 80), fence__holes=wall)
    both = parsed(fence__holes=wall)
    assert all(max(a.east_m, b.east_m) < 40 for a, b in area_of(both).lanes)


def test_a_second_vehicle_on_the_other_side_searches_there():
    fence, wall = square(-60, -60, 160, 160), square(40, -61, 4, 162)
    alone = metres(square(0, 0, 80, 40), fence, [wall])
    two = metres(square(0, 0, 80, 40), fence, [wall], vehicles=2, homes=[(0, 0), (60, 0)])
    assert area_of(alone).cut_off_m2 == pytest.approx(40 * 35, rel=0.15)
    assert area_of(two).cut_off_m2 < 8 * 40


def test_a_box_well_inside_is_searched_whole():
    area = area_of(parsed())
    assert area.box_m2 == pytest.approx(8000, rel=0.001)
    assert area.cut_off_m2 == 0.0
    assert warned(parsed()) == []


@pytest.mark.parametrize("depth_m", [20.0, 40.0])
def test_part_that_holes_cut_off_is_a_warning_with_its_size(depth_m):
    holed = parsed(fence__holes=f"[{rectangle(30, 20, 70, 20 + depth_m)}]", fence__margin_m="10.0")
    cut_m2 = area_of(holed).cut_off_m2
    in_margin_m2 = (40 + 20) * (depth_m + 20)
    assert (40 + 8) * (depth_m + 8) * 0.75 < cut_m2 < in_margin_m2
    (line,) = warned(holed)
    assert line.startswith(f"search.box: {cut_m2:.0f} m2 of its 8000 m2 cannot be searched")


def test_a_wide_margin_cuts_off_a_rim():
    whole = {"search__box": rectangle(-30, -30, 130, 110)}
    narrow, wide = (area_of(parsed(**whole, fence__margin_m=m)) for m in ("2.0", "16.0"))
    assert narrow.cut_off_m2 < 0.02 * narrow.box_m2
    rim_m2 = 160 * 140 - (160 - 2 * 10) * (140 - 2 * 10)
    assert wide.cut_off_m2 == pytest.approx(rim_m2, rel=0.35)


def test_simulation_without_noise_is_warned_about_its_pictures():
    (line,) = warned(parsed(sim__sensor_noise="0.0"))
    assert line.startswith("sim.sensor_noise = 0: ")
    assert warned(parsed(sim__sensor_noise="0.0", camera__noiseless="true")) == []
