"""Cells that are plain by frames from the height of a search."""

from __future__ import annotations

from dataclasses import replace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from missions.events import FrameSeen, Vote
from missions.flight.path_orders import descent
from missions.flight.setting_of import setting_of
from missions.flight.state import State
from missions.flight.step import assign
from missions.flight.strategy.charting import chart_of
from missions.flight.strategy.every_patch import ALL, READY_S
from missions.flight.transitions import apply
from missions.flight.vehicle_state import Phase, VehicleState
from missions.geo.trajectory import rounded_path
from missions.mapping.belief import Belief, FrameId
from missions.mapping.overview import from_below, with_plain
from missions.mission.fleet_checks import with_vehicles
from missions.orders import FlyPath, TakeOff
from missions.units import Cell
from uavmap.load.mission_source import load

BOX = frozenset(Cell(east, north) for east in range(6) for north in range(5))
FRAMES = st.lists(st.dictionaries(st.sampled_from(sorted(BOX)), st.booleans()), max_size=25)


def seen(frames: int, region: frozenset[Cell]) -> Belief:
    """Return the belief with the plain cells after a number of frames of the whole box."""
    nothing = Belief(5, 3)
    belief = overview = nothing
    for t in range(frames):
        votes = {cell: cell in region for cell in sorted(BOX)}
        overview = overview.with_frame(None, FrameId(1, float(t)), votes)
        belief = with_plain(belief, overview, BOX, votes)
    return belief


def test_cells_along_an_outline_are_left_for_frames_from_below() -> None:
    region = frozenset(cell for cell in BOX if cell.east < 3)
    belief = seen(3, region)
    # cells of the region at the rim of the box have unobserved neighbours: they are not plain
    assert set(belief.roi) == {Cell(1, 1), Cell(1, 2), Cell(1, 3)}
    assert {cell for cell in BOX if belief.verdict(cell) is False} == {
        cell for cell in BOX if cell.east >= 4
    }
    assert not seen(2, region).open_ballots


def seen_from_below(belief: Belief, frames: int, region: frozenset[Cell]) -> Belief:
    """Return the belief after a number of frames from below of the whole box."""
    votes = {cell: cell in region for cell in sorted(BOX)}
    return belief.with_frames(None, {FrameId(1, 10.0 + t): votes for t in range(frames)})


def west_of(east: int) -> frozenset[Cell]:
    return frozenset(cell for cell in BOX if cell.east < east)


@pytest.mark.parametrize(("high", "column", "expected"), [(5, 3, False), (1, 2, True)])
def test_plain_cells_go_by_frames_from_below_where_these_decide_otherwise(
    high: int, column: int, expected: bool
) -> None:
    plain = seen(3, west_of(high))  # the outline lies two cells beside the true one
    belief = seen_from_below(plain, 5, west_of(3))
    # at the rim of the box a neighbour is undecided
    wrong = {Cell(column, north): expected for north in (1, 2, 3)}
    assert all(belief.verdict(cell) is not expected for cell in wrong)
    found = from_below(belief, plain)
    assert found == wrong
    corrected = belief.with_verdicts(found)
    assert all(corrected.verdict(cell) is expected for cell in wrong)
    assert all((cell in corrected.roi) is expected for cell in wrong)


def test_plain_cells_stay_so_while_frames_from_below_have_not_decided() -> None:
    plain = seen(3, west_of(5))
    assert from_below(seen_from_below(plain, 2, west_of(3)), plain) == {}


@settings(max_examples=40)
@given(frames=FRAMES)
def test_plain_cells_from_newly_decided_cells_are_those_from_all_cells(
    frames: list[dict[Cell, bool]],
) -> None:
    nothing = Belief(3, 2)
    quick = slow = overview = nothing
    for t, votes in enumerate(frames):
        fresh = overview.undecided(votes)
        overview = overview.with_frame(None, FrameId(1, float(t)), votes)
        quick = with_plain(quick, overview, BOX, fresh)
        slow = with_plain(slow, overview, BOX, BOX)
    assert quick == slow


def test_vehicle_without_lanes_takes_off_as_soon_as_there_is_an_outline_to_map() -> None:
    mission = load("bay")
    setting = setting_of(mission)
    region = frozenset(Cell(east, north) for east in range(10, 20) for north in range(20, 30))
    state = setting.initial_state()
    for number, vehicle in state.vehicles.items():
        lanes = vehicle.lanes[:1] if number < 5 else ()
        grounded = replace(
            vehicle, phase=Phase.GROUNDED, landed=True, lanes=lanes,
            position=setting.pad_of(number), home=setting.pad_of(number),
            remaining_wh=100.0,
        )  # fmt: skip
        state = state.with_vehicle(grounded)
    assert assign(state).vehicles[5].order is None
    belief = state.belief
    for k in range(3):
        belief = belief.with_frame(None, FrameId(1, float(k)), dict.fromkeys(region, True))
    order = assign(replace(state, belief=belief)).vehicles[5].order
    assert order == TakeOff(mission.altitude_m(4))


def test_cell_beside_region_seen_from_high_up_is_requested_until_it_is_decided() -> None:
    setting = setting_of(load("bay"))
    state = setting.initial_state()
    region, beside, far = Cell(10, 20), Cell(11, 20), Cell(30, 20)
    overview, belief = state.overview, state.belief
    for k in range(3):
        overview = overview.with_frame(None, FrameId(1, float(k)), {region: True})
    belief = belief.with_frame(None, FrameId(2, 5.0), {beside: False, far: False})
    state = replace(state, belief=belief, overview=overview)
    asked = ALL.required_cells(state)
    assert beside in asked
    assert far not in asked  # a frame showed it as ground, and no region is near
    seen = state.belief
    for k in range(3):
        seen = seen.with_frame(None, FrameId(2, 6.0 + k), {region: False})
    assert beside not in ALL.required_cells(replace(state, belief=seen))


def searching() -> State:
    """Return three vehicles over `burn`: two fly a lane each, the third stands on its pad."""
    setting = setting_of(with_vehicles(load("burn"), 3))
    state = replace(setting.initial_state(), t_s=40.0)
    for number, vehicle in state.vehicles.items():
        state = state.with_vehicle(replace(
            vehicle, phase=Phase.GROUNDED, home=setting.pad_of(number), remaining_wh=60.0,
            position=setting.pad_of(number), tracked_s=40.0, order=None,
        ))  # fmt: skip
    for number, vehicle in state.vehicles.items():
        if not vehicle.lanes:
            continue
        start, end = vehicle.lanes[0]
        path = rounded_path([start, end], 38.0 + 10.0 * number, speed_m_s=6.0)
        state = state.with_vehicle(replace(
            vehicle, phase=Phase.AIRBORNE, landed=False, position=start, on_lane=True,
            height_m=vehicle.cruise_height_m, order=FlyPath(path, 64.0, None, 0.2),
        ))  # fmt: skip
    return state


def some(state: State, *, lanes: bool) -> VehicleState:
    """Return the first vehicle with lanes, or without."""
    return next(v for v in state.vehicles.values() if bool(v.lanes) is lanes)


def test_vehicle_without_lanes_takes_off_before_the_first_lanes_are_flown() -> None:
    state = searching()
    ready = some(state, lanes=False)
    paths = [vehicle.path for vehicle in state.vehicles.values()]
    first = min((path for path in paths if path is not None), key=lambda path: path.end_s)
    for before_s, target in ((READY_S + 1.0, None), (READY_S - 1.0, first.place_at(first.end_s))):
        t_s = first.end_s - before_s
        at = replace(state, t_s=t_s)
        assert ALL.beside_lanes(at, replace(ready, tracked_s=t_s)) == target
        after = assign(at.with_vehicle(replace(ready, tracked_s=t_s))).vehicles[ready.vehicle]
        assert isinstance(after.order, TakeOff) == (target is not None)


def test_vehicle_with_nothing_else_to_do_maps_behind_lanes_that_are_still_flown() -> None:
    state = searching()
    flying = some(state, lanes=True)
    half_m = flying.lanes[0][0].distance_to(flying.lanes[0][1]) / 2.0
    flown = replace(flying, lane_seen_m=tuple(4.0 * k for k in range(int(half_m / 4.0))))
    state = state.with_vehicle(flown)
    chart = chart_of(state, None, 41.0, state.vehicles).chart
    start, end = (Cell(*(round(at / 4.0) for at in place)) for place in flying.lanes[0])
    assert chart.closed[chart.index(start)]
    assert chart.open_behind()
    assert not chart.closed[chart.index(start)]
    assert chart.closed[chart.index(end)]
    assert not chart.open_behind()


def test_vehicle_that_waits_above_its_layer_descends_on_the_spot() -> None:
    state = searching()
    setting, vehicle = state.setting, some(state, lanes=True)
    waits = replace(vehicle, cruise_altitude_m=12.0, height_m=42.0, order=None)
    path = descent(setting, waits, 50.0)
    assert path is not None
    assert path.end_s - path.begin_s == pytest.approx(30.0 / setting.energy.descent_m_s)
    assert path.place_at(path.begin_s) == path.place_at(path.end_s) == waits.position
    assert descent(setting, replace(waits, height_m=13.0), 50.0) is None


def test_sortie_that_sees_nothing_new_of_the_box_counts_as_fruitless() -> None:
    """Frames over the pad counted as progress: a lane out of reach was flown to without an end."""
    state = searching()
    vehicle = replace(some(state, lanes=True), fruitless_sorties=2)
    state, inside = state.with_vehicle(vehicle), min(state.setting.in_box)
    for cell, left in ((Cell(inside.east - 100, inside.north), 2), (inside, 0)):
        seen = FrameSeen(vehicle.vehicle, 41.0, None, (Vote(cell, False, 0.0),), overview=True)
        assert apply(state, seen).vehicles[vehicle.vehicle].fruitless_sorties == left
