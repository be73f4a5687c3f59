"""Heights of layers, as given or by pixels and ceiling; speeds by blur and number of frames."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from missions.errors import MissionFileError
from missions.flight.setting_of import setting_of
from missions.geo.grid import Grid
from missions.mission import flyable
from missions.mission.checks import check, parse_mission
from missions.mission.height_and_speed import altitude_reason, speed_limits
from missions.mission.schema import Mission, VehicleSection, parse_fields
from missions.units import GridPoint
from tests.support.ground.footprints import whole_cells
from tests.support.small_missions import mission, square
from tests.unit.missions.mission.test_mission_checks import fault, text
from uavmap.runner.preflight.plan_figures import estimate

FAST = settings(max_examples=100, deadline=None)


def parsed(**changes: str) -> Mission:
    return parse_mission(text(**{"flight__altitude_m": "'auto'", **changes}), "m.toml")


def flown_by(vehicles: int, made: Mission) -> Mission:
    return made.model_copy(update={"vehicles": (VehicleSection(),) * vehicles})


def test_frames_count_for_the_map_from_where_a_cell_has_its_pixels():
    """Vehicles search from 76 m and map from 12: at 38 m a cell of 4 m has 40 of 80 pixels."""
    given = {"flight__altitude_m": "12.0", "strategy": "'swath'"}
    assert parsed(**given).overview_above_m is None
    high = parsed(**given, search__find="'all'", search__altitude_m="'auto'")
    assert high.overview_above_m is not None
    assert abs(high.overview_above_m - 19.07) < 0.01
    coarse = high.model_copy(
        update={"camera": high.camera.model_copy(update={"pixels_per_cell": 200.0})}
    )
    assert coarse.overview_above_m == 13.5  # never within the stray of a vehicle from its layer


def test_height_by_pixels_is_that_by_hand():
    """80 degrees over 640 px are 381.4 px of focal length: 4 m have 80 px from 19.07 m."""
    mission = parsed()
    assert mission.camera.pixels_per_cell == 80.0
    assert mission.altitude_m(0) == 19.0
    assert altitude_reason(mission) == "camera.pixels_per_cell"
    assert parsed(camera__pixels_per_cell="60").altitude_m(0) == 25.4
    assert parsed(grid__cell_m="8.0").altitude_m(0) == 38.1


def test_the_ceiling_holds_it_down():
    mission = parsed(fence__ceiling_m="18.37")
    assert mission.altitude_m(0) == 18.3
    assert altitude_reason(mission) == "fence.ceiling_m"
    assert parsed(grid__cell_m="8.0", camera__pixels_per_cell="20").altitude_m(0) == 120.0


def test_the_layers_of_a_team_lie_below_the_highest():
    three = flown_by(3, parsed(camera__pixels_per_cell="60"))
    assert [three.altitude_m(i) for i in range(3)] == [13.4, 19.4, 25.4]
    state = setting_of(three).initial_state()
    assert [v.cruise_altitude_m for v in state.vehicles.values()] == [13.4, 19.4, 25.4]


@FAST
@given(
    st.floats(20.0, 120.0), st.integers(64, 4000), st.floats(1.0, 10.0), st.floats(10.0, 200.0),
    st.floats(5.0, 200.0), st.integers(1, 4), st.floats(5.0, 12.0),
)  # fmt: skip
def test_every_layer_is_as_fine_as_asked_for_and_below_the_ceiling(
    hfov_deg, width_px, cell_m, pixels, ceiling_m, size, layer_m
):
    mission = parse_fields(
        text(
            flight__altitude_m="'auto'",
            camera__hfov_deg=str(hfov_deg),
            camera__width_px=str(width_px),
            grid__cell_m=str(cell_m),
            camera__pixels_per_cell=str(pixels),
            fence__ceiling_m=str(ceiling_m),
            vehicles="[" + "{}, " * size + "]",
            team__layer_m=str(layer_m),
        ),
        "m.toml",
    )
    heights = [mission.altitude_m(i) for i in range(size)]
    assert heights == sorted(heights)
    assert all(b - a == pytest.approx(layer_m, abs=1e-5) for a, b in pairwise(heights))
    top_m = heights[-1]
    assert top_m <= ceiling_m + 1e-9
    optics = mission.camera.optics
    if top_m > 0.0:
        assert optics.pixels_per_cell(top_m, cell_m) >= pixels - 1e-6
    higher_m = top_m + 0.1001
    assert higher_m > ceiling_m or optics.pixels_per_cell(higher_m, cell_m) < pixels


# --- faults ----------------------------------------------------------------------------------
def test_a_layer_above_the_ceiling_is_refused():
    line = fault(flight__altitude_m="121.0")
    assert line == (
        "flight.altitude_m = 121: the highest layer is at 121 m, above fence.ceiling_m = 120; "
        "fly lower, or raise the ceiling if you may"
    )
    parse_mission(text(flight__altitude_m="121.0", fence__ceiling_m="121.0"), "m.toml")


def test_the_highest_layer_counts():
    mission = parse_mission(text(flight__altitude_m="110.0"), "m.toml")
    check(flown_by(2, mission), "m.toml")
    with pytest.raises(MissionFileError, match=r"2 layers of 6 m above it, is at 122 m"):
        check(flown_by(3, mission), "m.toml")


def test_a_team_too_large_for_the_room_below_is_refused():
    with pytest.raises(MissionFileError) as caught:
        check(flown_by(5, parsed(camera__pixels_per_cell="60")), "m.toml")
    (line,) = str(caught.value).splitlines()
    assert line == (
        'm.toml: flight.altitude_m = "auto": camera.pixels_per_cell sets the highest layer to '
        "25.4 m; 4 layers of team.layer_m = 6 below it the lowest is at 1.4 m, and 3 m are needed; "
        "fly fewer vehicles, or raise what sets it"
    )


def test_remedy_of_a_lowest_layer_that_shows_too_little_helps():
    """Pixels allow 9 m: a frame shows less than three cells."""
    line = fault(flight__altitude_m="'auto'", camera__pixels_per_cell="160")
    assert line.startswith("camera.hfov_deg = 80: from 9.5 m")
    _, _, remedy = line.partition("lower camera.pixels_per_cell to ")
    pixels = remedy.partition(",")[0]
    assert parsed(camera__pixels_per_cell=pixels).altitude_m(0) > 9.5
    line = fault(flight__altitude_m="'auto'", fence__ceiling_m="9.0")
    _, _, remedy = line.partition("raise fence.ceiling_m to ")
    parsed(fence__ceiling_m=remedy.partition(",")[0])


# --- what follows ----------------------------------------------------------------------------
def test_a_cell_with_too_few_pixels_is_warned_of():
    coarse = parse_mission(text(flight__altitude_m="40.0"), "m.toml")
    grid = Grid.at(coarse.home, coarse.grid.cell_m)
    (line,) = [w for w in flyable.warnings(coarse, grid) if "pixels" in w]
    assert line.startswith("camera.pixels_per_cell = 80: from the highest layer, 40 m")
    assert "38.1 pixels" in line
    fine = parsed()
    assert not [w for w in flyable.warnings(fine, grid) if "pixels" in w]


def test_the_figures_of_the_layers():
    low, high = estimate(setting_of(flown_by(2, parsed(camera__pixels_per_cell="60"))))["layers"]
    assert (low["altitude_m"], high["altitude_m"]) == (19.4, 25.4)
    gsd_m = 25.4 * math.tan(math.radians(40.0)) / 320.0
    assert high["gsd_m"] == pytest.approx(gsd_m, abs=1e-4)
    assert high["footprint_m"] == pytest.approx((640 * gsd_m, 480 * gsd_m), abs=0.05)
    assert high["pixels_per_cell"] == pytest.approx(4.0 / gsd_m, abs=0.05)
    assert high["speed_without_blur_m_s"] > low["speed_without_blur_m_s"]


PLAIN = mission(square(-10, 16, 40, 30), square(-60, -60, 160, 160), interval_s=0.2, speed_m_s=30.0)


def changed(made: Mission, **sections: dict[str, Any]) -> Mission:
    update = {
        name: getattr(made, name).model_copy(update=values) for name, values in sections.items()
    }
    return made.model_copy(update=update)


def test_speed_from_12_m_is_that_by_hand():
    """80 degrees over 640 px are 381.4 px of focal length: 3.147 cm a pixel, 20.14 m x 15.10 m."""
    limits = speed_limits(PLAIN, 12.0)
    gsd_m = 12.0 * math.tan(math.radians(40.0)) / 320.0
    assert gsd_m == pytest.approx(0.031466, abs=1e-6)
    # 1.5 px in 1/500 s
    assert limits.blur_m_s == pytest.approx(1.5 * gsd_m / 0.002) == pytest.approx(23.6, abs=0.01)
    # 15.10 m less half a metre at either rim less the cell, in five frames 0.2 s apart
    assert limits.frames_m_s == pytest.approx(480 * gsd_m - 1.0 - 4.0)
    assert limits.frames_m_s == pytest.approx(10.1, abs=0.01)
    assert limits.flight_m_s == 30.0
    assert limits.least_m_s == limits.frames_m_s
    assert limits.reason == "votes.frames"


def test_speed_limit_twice_as_high_is_twice_as_fast():
    low, high = speed_limits(PLAIN, 12.0), speed_limits(PLAIN, 24.0)
    assert high.blur_m_s == pytest.approx(2.0 * low.blur_m_s)
    assert high.frames_m_s == pytest.approx(2.0 * low.frames_m_s + 5.0)  # the cell stays 4 m


@pytest.mark.parametrize(
    ("sections", "reason"),
    [
        ({"flight": {"speed_m_s": 6.0}}, "flight.speed_m_s"),
        ({"camera": {"exposure_s": 0.02}}, "camera.max_blur_px"),
        ({"wind": {"speed_m_s": 9.0}}, "flight.max_airspeed_m_s, less wind.speed_m_s"),
        ({}, "votes.frames"),
    ],
)
def test_the_reason_is_the_key_that_limits(sections, reason):
    made = changed(PLAIN, **sections)
    limits = speed_limits(made, 12.0)
    assert limits.reason == reason
    assert limits.least_m_s == min(
        limits.flight_m_s, limits.blur_m_s, limits.frames_m_s, limits.headway_m_s
    )


def test_picture_at_the_limit_of_blur_is_blurred_by_the_limit():
    made = changed(PLAIN, camera={"exposure_s": 0.01, "max_blur_px": 2.0})
    blur_m = speed_limits(made, 12.0).blur_m_s * made.camera.exposure_s
    assert blur_m / made.camera.optics.gsd_m(12.0) == pytest.approx(2.0)


def test_a_region_that_drifts_takes_its_speed_from_the_limits():
    still, drifting = (
        speed_limits(changed(PLAIN, drift={"speed_m_s": m_s}), 12.0) for m_s in (0.0, 0.4)
    )
    assert drifting.frames_m_s == pytest.approx(still.frames_m_s - 0.4)
    assert drifting.blur_m_s == pytest.approx(still.blur_m_s - 0.4)


def test_speed_limit_of_a_camera_that_shows_no_whole_cell_is_zero():
    assert speed_limits(changed(PLAIN, camera={"pose_error_m": 6.0}), 12.0).least_m_s == 0.0
    assert speed_limits(PLAIN, 3.0).least_m_s == 0.0


@FAST
@given(
    st.integers(1, 9), st.floats(0.05, 1.0), st.floats(10.0, 40.0), st.floats(0.0, 1.5),
    st.floats(-1.9, 1.9), st.floats(0.0, 1.0), st.sampled_from([0.0, 90.0, 180.0]),
)  # fmt: skip
def test_every_cell_that_is_flown_over_at_the_limit_has_its_frames(
    frames, interval_s, height_m, pose_m, off_m, phase, heading_deg
):
    made = changed(
        PLAIN,
        votes={"frames": frames, "positive": 1},
        camera={"interval_s": interval_s, "pose_error_m": pose_m, "exposure_s": 1e-6},
    )
    speed_m_s = speed_limits(made, height_m).frames_m_s
    assert speed_m_s > 0.0
    footprint = made.camera.optics.footprint(height_m)
    seen: dict[int, int] = {}
    step_m = speed_m_s * interval_s
    for number in range(math.ceil(400.0 / step_m)):
        north_m = -200.0 + (number + phase) * step_m
        # the picture's shorter side lies along the way, or its longer
        turned = math.radians(heading_deg)
        for cell in whole_cells(footprint, GridPoint(off_m, north_m), turned, 4.0, pose_m):
            if cell.east == 0:
                seen[cell.north] = seen.get(cell.north, 0) + 1
    assert min(seen[north] for north in range(-20, 21)) >= frames
    if heading_deg != 90.0:  # and it is no slower than necessary
        assert min(seen[north] for north in range(-20, 21)) <= frames + 1


def test_a_search_at_a_speed_that_blurs_is_warned_of():
    grid = Grid.at(PLAIN.home, 4.0)
    blurred = changed(PLAIN, flight={"speed_m_s": 12.0}, camera={"exposure_s": 0.01})
    (line,) = [w for w in flyable.warnings(blurred, grid) if "blurred" in w]
    assert line.startswith("flight.speed_m_s = 12: from 12 m")
    assert "3.8 px" in line
    sharp = changed(PLAIN, flight={"speed_m_s": 12.0}, camera={"exposure_s": 0.002})
    assert not [w for w in flyable.warnings(sharp, grid) if "blurred" in w]
