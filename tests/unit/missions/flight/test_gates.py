"""Paths among pads of others end before their own pad, where columns close the way."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from shapely.geometry import LineString

from missions.fleet_events import Fact, FactsShared
from missions.flight.setting_of import setting_of
from missions.flight.state import Setting, State
from missions.flight.strategy.charting import chart_of, flyer_of, gate_of
from missions.flight.transitions import apply
from missions.flight.vehicle_state import Phase
from missions.geo.path_in_fence import allowed
from missions.geo.trajectory import rounded_path
from missions.mission.checks import parse_mission
from missions.mission.fleet_checks import with_own_air
from missions.orders import FlyPath
from missions.units import Cell, GridPoint
from tests.benchmarks.fleet_growth import text_for

CORNERS = [GridPoint(-600.0, 100.0), GridPoint(600.0, 100.0), GridPoint(0.0, 900.0)]


def made(vehicles: int, member: int) -> Setting:
    text = text_for(vehicles, apart=True)
    return setting_of(with_own_air(parse_mission(text, "bay")), member)


def over(setting: Setting, place: GridPoint) -> State:
    """Return a state in which our vehicle maps, at a place, and the others stand."""
    number = setting.member or 0
    state = replace(setting.initial_state(), t_s=100.0)
    low_m = setting.mission.altitude_m(number - 1)
    return state.with_vehicle(
        replace(
            state.vehicles[number], phase=Phase.AIRBORNE, landed=False, lanes=(), position=place,
            cruise_altitude_m=low_m, height_m=low_m, tracked_s=100.0, remaining_wh=80.0,
            home=setting.pad_of(number),
        )
    )  # fmt: skip


@pytest.mark.parametrize(("vehicles", "member"), [(5, 1), (5, 5), (10, 4), (10, 10)])
def test_every_way_to_the_box_is_free_from_a_gate(vehicles: int, member: int) -> None:
    setting = made(vehicles, member)
    pad = setting.pad_of(member)
    state = over(setting, pad)
    gate = gate_of(setting, state.vehicles[member])
    assert 0.0 < gate.distance_to(pad) < 40.0
    free = setting.fence.shrunk(-0.02)
    assert free.covers(LineString([pad, gate]))
    for corner in CORNERS:
        assert allowed(setting.fence, rounded_path([corner, gate], 0.0, speed_m_s=8.0))
    known = chart_of(state, None, 101.0, {member: state.vehicles[member]})
    chart = known.chart
    for corner in CORNERS:
        for share in np.linspace(0.0, 1.0, 200):
            east_m = corner.east_m + share * (gate.east_m - corner.east_m)
            north_m = corner.north_m + share * (gate.north_m - corner.north_m)
            place = setting.grid.to_moving(GridPoint(east_m, north_m), 101.0)
            cell = Cell(*(math.floor(at / chart.cell_m + 0.5) for at in place))
            if chart.holds(cell):
                assert chart.allowed[chart.index(cell)]


def test_one_service_has_no_gates() -> None:
    setting = setting_of(parse_mission(text_for(5), "bay"))
    vehicle = setting.initial_state().vehicles[1]
    assert gate_of(setting, replace(vehicle, home=setting.pad_of(1))) == setting.pad_of(1)


def test_vehicle_between_two_columns_has_a_plan() -> None:
    """The path to its work leads past pads of others: it leaves straight and continues there."""
    setting = made(10, 3)
    region = {Cell(20 + i, 2 + j) for i in range(4) for j in range(3)}  # far to the east, and near
    state = over(setting, setting.pad_of(3))
    reported = Fact(90.0, tuple((cell, True) for cell in sorted(region)))
    state = apply(state, FactsShared(1, 99.0, 0, (reported,)))
    lanes = {number: replace(v, lanes=()) for number, v in state.vehicles.items()}
    state = replace(state, vehicles=lanes, t_s=110.0)
    order = setting.strategy.plan(state).vehicles[3].order
    assert isinstance(order, FlyPath)
    assert allowed(setting.fence, order.trajectory)
    assert order.trajectory.length_m > 5.0
    flyer = flyer_of(setting, state.vehicles[3], None, None, 111.0)
    assert flyer.end != setting.grid.to_moving(setting.pad_of(3), 111.0)
