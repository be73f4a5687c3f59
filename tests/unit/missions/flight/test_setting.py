"""The setting of a mission before take-off: grid, fence, lanes, energy, metric and shares."""

from __future__ import annotations

import pytest

from missions.flight.setting_of import setting_of
from missions.flight.state import Setting
from missions.mission.flyable import fence_of, look_s, search_area
from missions.planning.search.lanes import share_out
from missions.units import Cell, GridPoint
from tests.support.small_missions import CELL_M, mission, square

BOX, FENCE = square(-10, 16, 40, 30), square(-60, -60, 160, 160)


def setting(**changes: object) -> Setting:
    return setting_of(mission(BOX, FENCE, **changes))  # type: ignore[arg-type]


@pytest.mark.parametrize("margin_m", [0.0, 2.0, 5.0])
def test_the_fence_is_that_of_the_file_with_its_margin(margin_m: float) -> None:
    made = setting(margin_m=margin_m)
    assert made.fence.allows(GridPoint(-60 + margin_m + 0.1, 0))
    assert made.fence.allows(GridPoint(-60 + margin_m - 0.1, 0)) is False


def test_checks_and_flights_have_the_same_fence_and_lanes() -> None:
    hole = square(0, 25, 8, 8)
    made = mission(BOX, FENCE, [hole])
    flown = setting_of(made)
    checked = fence_of(made, flown.grid)
    assert checked.inner.equals(flown.fence.inner)
    assert search_area(made, flown.grid).lanes == flown.lanes


# --- what planners reckon with ---------------------------------------------------------------
def test_the_metric_counts_in_cells_and_seconds() -> None:
    metric = setting(speed_m_s=5.0).metric
    assert metric.straight
    assert metric.leg(Cell(0, 0), Cell(10, 0)) == pytest.approx(10 * CELL_M / 5.0)
    assert metric.look == 5 * 0.25
    assert metric.ramp == pytest.approx(5.0 / 2.0)


def test_the_metric_and_the_energy_agree_on_long_legs() -> None:
    made = setting(speed_m_s=5.0)
    leg_s = made.metric.from_rest(made.metric.leg(Cell(0, 0), Cell(30, 40)))
    assert leg_s == pytest.approx(made.energy.leg_s(50 * CELL_M))


def test_the_metric_drifts_with_the_region() -> None:
    metric = setting(speed_m_s=5.0, drift_m_s=0.5, toward_deg=90.0).metric
    with_it, against = (metric.leg(Cell(0, 0), Cell(e, 0)) for e in (10, -10))
    assert with_it == pytest.approx(40 / 4.5, rel=0.01)
    assert against == pytest.approx(40 / 5.5, rel=0.01)


@pytest.mark.parametrize(("frames", "interval_s"), [(5, 0.25), (3, 1.0), (20, 0.5)])
def test_a_look_takes_its_frames_and_a_moment(frames: int, interval_s: float) -> None:
    made = setting(frames=frames, interval_s=interval_s, capacity_wh=60.0)
    assert made.look_s == 2.0 + frames * interval_s
    assert look_s(made.mission) == made.look_s  # the lanes of checks, and of flights


# --- before take-off -------------------------------------------------------------------------
@pytest.mark.parametrize("vehicles", [1, 2, 3, 4])
def test_the_lanes_are_shared_out_among_all(vehicles: int) -> None:
    made = setting(vehicles=vehicles, capacity_wh=60.0)
    state = made.initial_state()
    assert sorted(state.vehicles) == list(range(1, vehicles + 1))
    blocks = [state.vehicles[n].lanes for n in sorted(state.vehicles)]
    assert tuple(lane for block in blocks for lane in block) == made.lanes
    assert tuple(blocks) == share_out(made.lanes, vehicles)
