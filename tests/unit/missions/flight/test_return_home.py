"""The return in a layer that others share."""

from __future__ import annotations

import math
from dataclasses import replace

from missions.events import Arrived
from missions.flight.airspace.airspace import Airspace
from missions.flight.return_home import fly_home, has_energy_for, turn_back
from missions.flight.setting_of import setting_of
from missions.flight.state import Setting, State
from missions.flight.strategy.every_patch import ALL
from missions.flight.transitions import apply
from missions.flight.vehicle_state import Phase, ReturnReason, VehicleState
from missions.geo.trajectory import rounded_path
from missions.mission.fleet_checks import with_vehicles
from missions.orders import FlyPath, FlyTo, Hold, Land, TakeOff
from missions.units import GridPoint
from uavmap.load.mission_source import load


def out(state: State, setting: Setting, number: int, place: GridPoint) -> VehicleState:
    """Return a vehicle at a place that has to return with the rest of its battery."""
    return replace(
        state.vehicles[number], phase=Phase.AIRBORNE, landed=False, position=place,
        home=setting.pad_of(number), height_m=40.0, cruise_altitude_m=40.0, remaining_wh=30.0,
        return_reason=ReturnReason.BATTERY, order=None,
    )  # fmt: skip


def test_vehicle_that_waits_for_another_that_comes_home_comes_nearer_meanwhile() -> None:
    setting = setting_of(load("bay"))
    state = setting.initial_state()
    first = out(state, setting, 4, GridPoint(600.0, 60.0))
    across = FlyTo((GridPoint(-600.0, 60.0),), None, stop=True, height_m=40.0)
    first = replace(first, order=across)
    behind = out(state, setting, 5, GridPoint(120.0, 900.0))
    state = state.with_vehicle(first).with_vehicle(behind)
    order = fly_home(state, behind).vehicles[5].order
    assert isinstance(order, FlyTo)
    nearer_m = order.route[-1].distance_to(behind.pad)
    assert 200.0 < nearer_m < 500.0
    # there it is not over its pad: it continues as soon as it may, and does not land
    state = fly_home(state, behind)
    arrived = apply(state, Arrived(5, 60.0, order.route[-1])).vehicles[5]
    assert not arrived.over_home
    assert isinstance(fly_home(state, arrived).vehicles[5].order, FlyTo | Hold)
    # alone it flies all the way at once
    alone = state.with_vehicle(replace(first, order=None, position=GridPoint(600.0, 300.0)))
    order = fly_home(alone, behind).vehicles[5].order
    assert isinstance(order, FlyTo)
    assert order.route[-1] == behind.pad
    alone = fly_home(alone, behind)
    arrived = apply(alone, Arrived(5, 160.0, behind.pad)).vehicles[5]
    assert arrived.over_home
    assert isinstance(fly_home(alone, arrived).vehicles[5].order, Land)


def test_vehicle_on_a_path_home_flies_on_when_all_is_explored() -> None:
    setting = setting_of(load("bay"))
    state = replace(setting.initial_state(), exhausted=True)
    far = GridPoint(300.0, 400.0)
    vehicle = replace(out(state, setting, 4, far), return_reason=None)
    for end, flies_on in ((vehicle.pad, True), (GridPoint(100.0, 100.0), False)):
        path = rounded_path([far, end], 0.0, speed_m_s=10.0)
        flying = replace(vehicle, order=FlyPath(path, 40.0, None, 0.6))
        after = turn_back(state.with_vehicle(flying), flying).vehicles[4]
        # it comes to rest along its path: from there it flies home
        assert after.path is not None
        assert (after.path.end_s == path.end_s) == flies_on
        assert after.return_reason is None
    ended = replace(vehicle, order=None)
    assert turn_back(state, ended).vehicles[4].return_reason is ReturnReason.DONE
    # it does not after a recall by the operator, nor without the energy for its rest
    path = rounded_path([far, vehicle.pad], 0.0, speed_m_s=10.0)
    flying = replace(vehicle, order=FlyPath(path, 40.0, None, 0.6))
    called = turn_back(state, replace(flying, called_home=True)).vehicles[4]
    assert called.return_reason is ReturnReason.RECALLED
    low = turn_back(state, replace(flying, remaining_wh=1.0)).vehicles[4]
    assert low.return_reason is ReturnReason.DONE
    assert low.order is None


def test_a_vehicle_descends_on_its_path_home_to_the_lowest_layer_that_is_clear() -> None:
    setting = setting_of(with_vehicles(load("burn"), 3))
    start = replace(setting.initial_state(), exhausted=True)

    def coming(number: int, far: GridPoint) -> VehicleState:
        layer_m = setting.mission.altitude_m(number - 1)
        vehicle = out(start, setting, number, far)
        path = rounded_path([far, vehicle.pad], 0.0, speed_m_s=6.0)
        return replace(
            vehicle, return_reason=None, height_m=layer_m, cruise_altitude_m=layer_m,
            order=FlyPath(path, layer_m, None, 0.2),
        )  # fmt: skip

    def layer_of_third(*others: VehicleState) -> float:
        third, state = coming(3, GridPoint(120.0, 150.0)), start
        for vehicle in (*others, third):
            state = state.with_vehicle(vehicle)
        after = turn_back(state, third).vehicles[3]
        assert isinstance(after.order, FlyPath)
        assert after.order.trajectory is third.path
        assert after.order.height_m == after.cruise_height_m
        return after.cruise_altitude_m

    assert layer_of_third() == 12.0
    beside = coming(1, GridPoint(-20.0, 100.0))
    assert layer_of_third(beside) == 12.0
    # all the way counts, not the next seconds alone: in 15 s the first crosses its path
    crossing = coming(1, GridPoint(150.0, 40.0))
    assert layer_of_third(crossing) == 18.0
    assert layer_of_third(crossing, coming(2, GridPoint(150.0, 40.0))) == 24.0
    # a path that the exploration still needs stays in its layer
    third = coming(3, GridPoint(120.0, 150.0))
    busy = replace(start, exhausted=False).with_vehicle(third)
    assert turn_back(busy, third).vehicles[3] == third


def test_path_home_around_cells_explored_by_now_is_made_straight() -> None:
    setting = setting_of(with_vehicles(load("burn"), 1))
    start = replace(setting.initial_state(), exhausted=True, t_s=10.0)
    here, beyond, layer_m = GridPoint(60.0, 90.0), GridPoint(160.0, 150.0), 12.0
    path = rounded_path([here, beyond, GridPoint(0.0, 0.0)], 9.0, speed_m_s=6.0)
    vehicle = replace(
        out(start, setting, 1, path.place_at(10.0)), return_reason=None, height_m=layer_m,
        cruise_altitude_m=layer_m, order=FlyPath(path, layer_m, None, 0.2),
    )  # fmt: skip

    after = ALL.plan(start.with_vehicle(vehicle)).vehicles[1]
    shorter = after.path
    assert shorter is not None
    assert shorter.end_s < path.end_s - 15.0
    assert shorter.place_at(shorter.end_s).distance_to(vehicle.pad) < 0.1
    # it goes on from the path that is flown, at its speed
    begins, flown = shorter.at(shorter.begin_s), path.at(shorter.begin_s)
    assert begins.place.distance_to(flown.place) < 0.01
    assert math.isclose(begins.v_east_m_s, flown.v_east_m_s, abs_tol=0.01)
    assert math.isclose(begins.v_north_m_s, flown.v_north_m_s, abs_tol=0.01)

    # one that is as good as straight is flown on
    again = replace(start, t_s=20.0).with_vehicle(after)
    assert ALL.plan(again).vehicles[1].path is shorter


def test_a_vehicle_leaves_the_air_above_one_that_has_fallen_and_is_not_known_to_lie_there() -> None:
    """The fallen vehicle holds, and still counts as climbing to its layer."""
    setting = setting_of(with_vehicles(load("burn"), 3))
    state, here = setting.initial_state(), GridPoint(40.0, 60.0)
    fallen = replace(
        out(state, setting, 3, here), height_m=4.0, cruise_altitude_m=24.0, order=Hold()
    )
    above = replace(
        out(state, setting, 1, GridPoint(40.3, 60.0)), height_m=12.0, cruise_altitude_m=12.0
    )
    state = state.with_vehicle(fallen).with_vehicle(above)
    order = fly_home(state, above).vehicles[1].order
    assert isinstance(order, FlyTo)
    assert order.route[-1] == above.pad
    # a vehicle whose path leads through the other's column does not begin it
    beyond = replace(above, position=GridPoint(80.0, 120.0))
    order = fly_home(state.with_vehicle(beyond), beyond).vehicles[1].order
    assert not isinstance(order, FlyTo) or order.route[-1] != above.pad or len(order.route) > 1


def test_vehicle_needs_energy_for_the_flight_to_its_target_and_back() -> None:
    setting = setting_of(load("bay"))
    state = setting.initial_state()
    target = GridPoint(300.0, 400.0)
    there = out(state, setting, 4, target)
    enough_wh = next(
        wh
        for wh in range(1, 500)
        if has_energy_for(setting, replace(there, remaining_wh=wh), target, 0.0)
    )
    here = replace(there, position=there.pad, remaining_wh=enough_wh)
    assert not has_energy_for(setting, here, target, 0.0)
    assert has_energy_for(setting, replace(here, remaining_wh=3.0 * enough_wh), target, 0.0)


def test_vehicle_over_a_blocked_pad_waits_while_its_reserve_is_whole_then_lands_beside() -> None:
    setting = setting_of(load("bay"))
    state = setting.initial_state()
    waiting = replace(out(state, setting, 4, setting.pad_of(4)), over_home=True)
    below = replace(out(state, setting, 5, setting.pad_of(4)), cruise_altitude_m=20.0)
    blocking = replace(below, height_m=20.0, order=Hold())
    state = state.with_vehicle(waiting).with_vehicle(blocking)
    rich = fly_home(state, replace(waiting, remaining_wh=300.0)).vehicles[4]
    assert (rich.order, rich.spare_pad) == (Hold(), None)
    poor = fly_home(state, replace(waiting, remaining_wh=1.0)).vehicles[4]
    assert poor.spare_pad is not None


def test_vehicle_whose_return_is_blocked_at_the_pad_lands_beside_before_its_reserve_is_used() -> (
    None
):
    """Another landed near its pad for half a minute: it waited at 11 m until its guardian acted."""
    setting = setting_of(load("bay"))
    state, pad = setting.initial_state(), setting.pad_of(4)
    waiting = out(state, setting, 4, GridPoint(pad.east_m, pad.north_m + 30.0))
    blocking = replace(out(state, setting, 5, pad), order=Hold())
    state = state.with_vehicle(waiting).with_vehicle(blocking)
    rich = fly_home(state, replace(waiting, remaining_wh=300.0)).vehicles[4]
    assert (rich.order, rich.spare_pad) == (Hold(), None)
    poor = fly_home(state, replace(waiting, remaining_wh=1.0)).vehicles[4]
    assert isinstance(poor.order, FlyTo)
    assert poor.spare_pad == poor.order.route[-1]


def test_place_beside_a_pad_is_outside_the_columns_of_other_pads_and_kept_for_the_landing() -> None:
    """Another took off beside it meanwhile; or it blocked the pad of another by its landing."""
    setting = setting_of(load("bay"))
    state, pad = setting.initial_state(), setting.pad_of(4)
    lands = replace(out(state, setting, 4, pad), over_home=True)
    nearest = Airspace(state.with_vehicle(lands)).places_beside_pad(lands)[0]
    beside = replace(state.vehicles[5], phase=Phase.GROUNDED, home=nearest, position=nearest)
    state = state.with_vehicle(beside)
    places = Airspace(state.with_vehicle(lands)).places_beside_pad(lands)
    assert places[0].distance_to(nearest) > setting.mission.team.separation_m + 2.0
    assert nearest in places
    lands = replace(lands, spare_pad=nearest, order=lands.leg((nearest,)))
    assert not Airspace(state.with_vehicle(lands)).is_clear(beside, TakeOff(40.0))
    lands = replace(lands, spare_pad=places[0], order=lands.leg((places[0],)))
    assert Airspace(state.with_vehicle(lands)).is_clear(beside, TakeOff(30.0))


def test_vehicle_with_an_uncontrolled_one_in_its_way_turns_back_with_the_energy_of_an_rtl() -> None:
    """It turned back with that of its path alone, and landed half-way, over the other."""
    setting = setting_of(load("bay"))
    state, pad = setting.initial_state(), setting.pad_of(4)
    out_there = out(state, setting, 4, GridPoint(pad.east_m, pad.north_m + 100.0))
    low = replace(out_there, height_m=12.0, cruise_altitude_m=12.0)
    works = replace(low, return_reason=None, order=Hold())
    hovers = replace(out(state, setting, 5, pad), phase=Phase.YIELDED)
    enough_wh = next(
        wh
        for wh in range(1, 500)
        if has_energy_for(setting, replace(works, remaining_wh=wh), works.position, 5.0)
    )
    works = replace(works, remaining_wh=enough_wh)
    assert turn_back(state.with_vehicle(works), works).vehicles[4].return_reason is None
    state = state.with_vehicle(hovers)
    returns = turn_back(state.with_vehicle(works), works).vehicles[4]
    assert returns.return_reason is ReturnReason.BATTERY
    aside = replace(hovers, position=GridPoint(pad.east_m - 100.0, pad.north_m + 100.0))
    state = state.with_vehicle(aside)
    assert turn_back(state.with_vehicle(works), works).vehicles[4].return_reason is None


def test_vehicle_strayed_into_the_column_of_a_climb_leaves_it() -> None:
    """It waited for the end of the climb, 5 cm inside, until its energy was used up."""
    setting = setting_of(load("bay"))
    state, pad = setting.initial_state(), setting.pad_of(5)
    near_m = setting.mission.team.separation_m + 1.95
    beside = out(state, setting, 4, GridPoint(pad.east_m, pad.north_m + near_m))
    climbing = replace(out(state, setting, 5, pad), height_m=5.0, order=TakeOff(60.0))
    state = state.with_vehicle(beside).with_vehicle(replace(climbing, cruise_altitude_m=60.0))
    away = beside.leg((GridPoint(pad.east_m, pad.north_m + 50.0),))
    assert Airspace(state).is_clear(beside, away)
    through = beside.leg((GridPoint(pad.east_m, pad.north_m - 50.0),))
    assert not Airspace(state).is_clear(beside, through)


def test_vehicle_above_its_layer_returns_at_its_height_if_the_way_down_is_blocked() -> None:
    """Two that waited for each other emptied their batteries."""
    setting = setting_of(load("bay"))
    state = setting.initial_state()
    place, beside = GridPoint(300.0, 400.0), GridPoint(302.0, 400.0)
    above = replace(out(state, setting, 4, place), height_m=70.0)
    below = replace(out(state, setting, 5, beside), height_m=55.0, cruise_altitude_m=55.0)
    state = state.with_vehicle(above).with_vehicle(replace(below, order=Hold()))
    order = fly_home(state, above).vehicles[4].order
    assert isinstance(order, FlyTo)
    assert (order.height_m, order.route[-1]) == (70.0, above.pad)
