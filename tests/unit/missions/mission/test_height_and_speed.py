"""What limits the speed of a vehicle that takes pictures: blur, and frames enough for a cell."""

from __future__ import annotations

import math
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from missions.geo.grid import Grid
from missions.mission import flyable
from missions.mission.height_and_speed import blur_px, speed_limits
from missions.mission.schema import Mission
from missions.units import GridPoint
from tests.support.footprints import whole_cells
from tests.support.small_missions import mission, square

FAST = settings(max_examples=100, deadline=None)
PLAIN = mission(square(-10, 16, 40, 30), square(-60, -60, 160, 160), interval_s=0.2, speed_m_s=30.0)


def changed(made: Mission, **sections: dict[str, Any]) -> Mission:
    update = {
        name: getattr(made, name).model_copy(update=values) for name, values in sections.items()
    }
    return made.model_copy(update=update)


def test_by_hand_from_12_m() -> None:
    """80 degrees over 640 px: 381.4 px of focal length, 3.147 cm a pixel, 20.14 m x 15.10 m."""
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


def test_twice_as_high_a_picture_may_be_taken_at_twice_the_speed() -> None:
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
def test_the_reason_is_the_key_that_limits(sections: dict[str, Any], reason: str) -> None:
    made = changed(PLAIN, **sections)
    limits = speed_limits(made, 12.0)
    assert limits.reason == reason
    assert limits.least_m_s == min(
        limits.flight_m_s, limits.blur_m_s, limits.frames_m_s, limits.headway_m_s
    )


def test_at_the_limit_of_blur_a_picture_is_blurred_by_what_is_allowed() -> None:
    made = changed(PLAIN, camera={"exposure_s": 0.01, "max_blur_px": 2.0})
    assert blur_px(made, 12.0, speed_limits(made, 12.0).blur_m_s) == pytest.approx(2.0)


def test_a_region_that_drifts_takes_its_speed_from_the_limits() -> None:
    still, drifting = (
        speed_limits(changed(PLAIN, drift={"speed_m_s": m_s}), 12.0) for m_s in (0.0, 0.4)
    )
    assert drifting.frames_m_s == pytest.approx(still.frames_m_s - 0.4)
    assert drifting.blur_m_s == pytest.approx(still.blur_m_s - 0.4)


def test_where_no_cell_is_ever_whole_no_speed_is_slow_enough() -> None:
    assert speed_limits(changed(PLAIN, camera={"pose_error_m": 6.0}), 12.0).least_m_s == 0.0
    assert speed_limits(PLAIN, 3.0).least_m_s == 0.0


@FAST
@given(
    st.integers(1, 9), st.floats(0.05, 1.0), st.floats(10.0, 40.0), st.floats(0.0, 1.5),
    st.floats(-1.9, 1.9), st.floats(0.0, 1.0), st.sampled_from([0.0, 90.0, 180.0]),
)  # fmt: skip
def test_at_the_limit_every_cell_that_is_flown_over_has_its_frames(
    frames: int, interval_s: float, height_m: float, pose_m: float, off_m: float, phase: float,
    heading_deg: float,
) -> None:  # fmt: skip
    """Frame by frame over a line of cells, wherever the first one happens to be taken."""
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
    if heading_deg != 90.0:  # and it is no slower than it has to be
        assert min(seen[north] for north in range(-20, 21)) <= frames + 1


def test_a_search_at_a_speed_that_blurs_is_warned_of() -> None:
    grid = Grid.at(PLAIN.home, 4.0)
    blurred = changed(PLAIN, flight={"speed_m_s": 12.0}, camera={"exposure_s": 0.01})
    (line,) = [w for w in flyable.warnings(blurred, grid) if "blurred" in w]
    assert line.startswith("flight.speed_m_s = 12: from 12 m")
    assert "3.8 px" in line
    sharp = changed(PLAIN, flight={"speed_m_s": 12.0}, camera={"exposure_s": 0.002})
    assert not [w for w in flyable.warnings(sharp, grid) if "blurred" in w]
