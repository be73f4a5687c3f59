from __future__ import annotations

import copy

import pytest
from shapely.geometry import LineString, Point

from missions.events import from_json, to_json
from missions.flight.setting_of import setting_of
from missions.flight.step import step
from missions.mission.checks import FLOWN, parse_mission
from missions.units import Cell
from tests.fake_fleet import Fleet
from tests.support.small_missions import mission_text, square

BOX = square(0.0, -4.0, 48.0, 36.0)
FENCE = square(-30.0, -40.0, 130.0, 120.0)
ROI = frozenset(Cell(east, north) for east in range(6, 10) for north in range(3, 7))


def made(strategy, vehicles):
    name, _, find = strategy.partition(" ")
    text = mission_text(
        BOX, FENCE, vehicles=vehicles, strategy=name, capacity_wh=60.0, layer_m=12.0
    )
    if find:
        text = text.replace("[search]\n", f'[search]\nfind = "{find}"\n', 1)
    return parse_mission(text, "a test")


EACH = [
    pytest.param(name, vehicles, id=f"{name}, {vehicles}")
    for name in (*FLOWN, "swath all")
    for vehicles in ((2,) if name == "leapfrog" else (1, 3))
]
each = pytest.mark.parametrize(("strategy", "vehicles"), EACH)


@each
def test_lanes_lie_in_the_fence_and_leave_no_cell_of_the_box_out(strategy, vehicles):
    setting = setting_of(made(strategy, vehicles))
    assert setting.lanes
    for lane in setting.lanes:
        assert setting.fence.allows_leg(*lane)
    # a lane is cut half a cell before the rim of the box, whose cells its pictures show
    reach_m = ((setting.lane_rows - 1) / 2 + 1.0) * setting.grid.cell_m
    strips = [LineString(lane).buffer(reach_m) for lane in setting.lanes]
    flown_to = setting.strategy.open_cells(setting.initial_state())
    for cell in setting.box_cells:
        place = Point(setting.where(cell, 0.0))
        assert cell in flown_to or any(strip.covers(place) for strip in strips), cell


@each
def test_each_lane_is_of_exactly_one_vehicle(strategy, vehicles):
    setting = setting_of(made(strategy, vehicles))
    shares = setting.shares
    assert len(shares) == vehicles
    held = [frozenset(lane) for share in shares for lane in share]
    assert len(held) == len(set(held))
    assert set(held) == {frozenset(lane) for lane in setting.lanes}


@each
def test_a_flight_maps_the_region_ends_at_home_and_may_be_flown_again(strategy, vehicles):
    setting = setting_of(made(strategy, vehicles))
    before = copy.deepcopy(vars(setting.strategy))
    flight = Fleet(setting, ROI)
    flight.start()
    flight.run()
    assert flight.faults == []
    state = flight.state
    assert state.completed
    assert state.belief.roi >= ROI
    assert not setting.strategy.open_cells(state)
    # once it has ended no vehicle gets an order
    last = next(event for event in reversed(flight.events) if event.kind == "tracked")
    assert step(state, last)[1] == ()
    # it keeps no state of its own: another that never flew gives the same orders
    assert vars(setting.strategy) == before
    again = setting_of(setting.mission).initial_state()
    given = []
    for event in flight.events:
        again, orders = step(again, from_json(to_json(event)))
        given += [order for _, order in orders]
    assert again == state
    assert given == [order for _, _, order in flight.orders]
