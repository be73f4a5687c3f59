"""Coming home in a layer that others share."""

from __future__ import annotations

from dataclasses import replace

from missions.events import Arrived
from missions.flight.return_home import APPROACH_M, fly_home, turn_back
from missions.flight.setting import Setting
from missions.flight.setting_of import setting_of
from missions.flight.state import Phase, ReturnReason, State, VehicleState
from missions.flight.transitions import apply
from missions.geo.trajectory import rounded_path
from missions.orders import FlyPath, FlyTo, Hold, Land
from missions.units import GridPoint
from uavmap.load.mission_source import load


def out(state: State, setting: Setting, number: int, place: GridPoint) -> VehicleState:
    """A vehicle at a place that has to come home with what is left of its battery."""
    return replace(
        state.vehicles[number], phase=Phase.AIRBORNE, landed=False, position=place,
        home=setting.pad_of(number), height_m=40.0, cruise_altitude_m=40.0, remaining_wh=30.0,
        return_reason=ReturnReason.BATTERY, order=None,
    )  # fmt: skip


def test_who_has_to_wait_for_another_that_comes_home_comes_nearer_meanwhile() -> None:
    setting = setting_of(load("bay"))
    state = State.initial(setting)
    first = out(state, setting, 4, GridPoint(600.0, 60.0))
    across = FlyTo((GridPoint(-600.0, 60.0),), None, stop=True, height_m=40.0)
    first = replace(first, order=across)
    behind = out(state, setting, 5, GridPoint(120.0, 900.0))
    state = state.with_vehicle(first).with_vehicle(behind)
    order = fly_home(setting, state, behind).vehicles[5].order
    assert isinstance(order, FlyTo)
    nearer_m = order.route[-1].distance_to(behind.pad)
    assert 200.0 < nearer_m < 500.0
    # there it is not over its pad: it flies on as soon as it may, and does not land
    state = fly_home(setting, state, behind)
    arrived = apply(setting, state, Arrived(5, 60.0, order.route[-1])).vehicles[5]
    assert not arrived.over_home
    assert isinstance(fly_home(setting, state, arrived).vehicles[5].order, FlyTo | Hold)
    # alone it flies all the way at once
    alone = state.with_vehicle(replace(first, order=None, position=GridPoint(600.0, 300.0)))
    order = fly_home(setting, alone, behind).vehicles[5].order
    assert isinstance(order, FlyTo)
    assert order.route[-1] == behind.pad
    alone = fly_home(setting, alone, behind)
    arrived = apply(setting, alone, Arrived(5, 160.0, behind.pad)).vehicles[5]
    assert arrived.over_home
    assert isinstance(fly_home(setting, alone, arrived).vehicles[5].order, Land)


def on_path(setting: Setting, place: GridPoint, end: GridPoint, t_s: float) -> State:
    """All is mapped, and vehicle 5 flies a path between two places in its layer."""
    path = rounded_path([place, end], t_s, speed_m_s=10.0, cut_m=2.0)
    state = replace(State.initial(setting), exhausted=True, t_s=t_s)
    vehicle = replace(
        out(state, setting, 5, place), height_m=42.0, cruise_altitude_m=42.0, lanes=(),
        return_reason=None, remaining_wh=90.0,
        order=FlyPath(path, 42.0, setting.yaw_deg, 0.6),
    )  # fmt: skip
    return state.with_vehicle(vehicle)


def test_path_that_ends_over_the_pad_when_all_is_mapped_is_flown_on() -> None:
    setting = setting_of(load("bay"))
    pad = setting.pad_of(5)
    state = on_path(setting, GridPoint(0.0, 300.0), pad, 400.0)
    order = state.vehicles[5].order
    found = turn_back(setting, state, state.vehicles[5]).vehicles[5]
    assert (found.order, found.return_reason) == (order, ReturnReason.DONE)
    arrived = apply(setting, state.with_vehicle(found), Arrived(5, 435.0, pad)).vehicles[5]
    assert isinstance(fly_home(setting, state, arrived).vehicles[5].order, Land)


def test_path_that_ends_elsewhere_when_all_is_mapped_is_interrupted() -> None:
    setting = setting_of(load("bay"))
    state = on_path(setting, GridPoint(0.0, 300.0), GridPoint(50.0, 20.0), 400.0)
    found = turn_back(setting, state, state.vehicles[5]).vehicles[5]
    assert (found.order, found.return_reason) == (None, ReturnReason.DONE)


def test_vehicle_that_is_nearly_home_on_its_path_descends_to_the_height_of_its_approach() -> None:
    setting = setting_of(load("bay"))
    state = on_path(setting, GridPoint(0.0, 300.0), setting.pad_of(5), 400.0)
    order = state.vehicles[5].order
    assert isinstance(order, FlyPath)
    end_s = order.trajectory.end_s
    down_s = (42.0 - APPROACH_M) / 3.0
    heights = []
    for t_s in (400.0, end_s - down_s - 1.0, end_s - down_s + 0.5):
        state = replace(state, t_s=t_s)
        state = turn_back(setting, state, state.vehicles[5])
        flown = state.vehicles[5].order
        assert isinstance(flown, FlyPath)
        assert flown.trajectory == order.trajectory
        heights.append(flown.height_m)
    assert heights == [42.0, 42.0, APPROACH_M]
    # another that lands beside its path keeps it in its layer
    below = replace(
        state.vehicles[4], phase=Phase.AIRBORNE, landed=False, order=Land(), height_m=20.0,
        home=GridPoint(0.0, 20.0), position=GridPoint(0.0, 20.0), cruise_altitude_m=30.0,
    )  # fmt: skip
    near = on_path(setting, GridPoint(0.0, 40.0), setting.pad_of(5), 400.0)
    near = turn_back(setting, near, near.vehicles[5])
    crossed = turn_back(setting, near.with_vehicle(below), near.vehicles[5]).vehicles[5].order
    free = turn_back(setting, near, near.vehicles[5]).vehicles[5].order
    assert isinstance(crossed, FlyPath)
    assert isinstance(free, FlyPath)
    assert (crossed.height_m, free.height_m) == (42.0, APPROACH_M)
