"""Orders that the airspace lets pass, against a brute-force referee that knows no volumes.

The referee flies both vehicles in small steps and compares each place of the one with each place
of the other. Early or late, they never come nearer than `team.separation_m`.
"""

from __future__ import annotations

import math
from dataclasses import replace
from functools import lru_cache
from itertools import pairwise, product

from hypothesis import assume, event, given, settings
from hypothesis import strategies as st

from missions.flight.airspace.airspace import Airspace
from missions.flight.setting_of import setting_of
from missions.flight.state import Setting
from missions.flight.vehicle_state import OFF_LAYER_M, Phase, VehicleState
from missions.geo.trajectory import rounded_path
from missions.orders import FlyPath, FlyTo, Hold, Land, Order, TakeOff
from missions.units import GridPoint
from tests.support.small_missions import mission, square

STEP_M = 0.5
NEXT_S = 8.0
"""Part of a path without stops that is reserved, s: see docs/explanation/safety.md."""
Place = tuple[float, float, float]
"""Points: east, north and up of the start, m."""


@lru_cache
def setting() -> Setting:
    box, fence = square(0.0, 10.0, 60.0, 40.0), square(-60.0, -60.0, 200.0, 200.0)
    return setting_of(mission(box, fence, vehicles=2, homes=[(0.0, 0.0), (8.0, 0.0)]))


PLACES = st.builds(GridPoint, st.floats(-6.0, 18.0, width=32), st.floats(-8.0, 14.0, width=32))
"""Places near the pads, where vehicles are in each other's way."""


@st.composite
def orders(draw: st.DrawFn, vehicle: VehicleState) -> Order:
    """Draw an order for a vehicle in the air or on its pad."""
    height_m = vehicle.cruise_height_m
    if vehicle.landed:
        return TakeOff(height_m)
    kind = draw(st.sampled_from(("leg", "path", "land")))
    if kind == "land":
        return Land()
    places = draw(st.lists(PLACES, min_size=1, max_size=3, unique=True))
    assume(vehicle.position not in places)
    if kind == "leg":
        return FlyTo(tuple(places), None, stop=True, height_m=height_m)
    path = rounded_path([vehicle.position, *places], 0.0, speed_m_s=5.0, cut_m=0.5)
    return FlyPath(path, height_m, 0.0, 0.25)


@st.composite
def vehicles(draw: st.DrawFn, number: int) -> VehicleState:
    """Draw one of the two vehicles: in the air near its layer, over its pad, or on it."""
    pad = setting().pad_of(number)
    layer_m = setting().mission.altitude_m(number - 1)
    made = VehicleState(
        number, layer_m, Phase.AIRBORNE, home=pad, position=pad, remaining_wh=60.0, landed=False
    )
    where = draw(st.sampled_from(("on its pad", "over its pad", "in its layer", "off its layer")))
    if where == "on its pad":
        return replace(made, phase=Phase.GROUNDED, landed=True, height_m=0.0)
    off_m = draw(st.floats(-12.0, 12.0)) if where == "off its layer" else 0.0
    place = pad if where == "over its pad" else draw(PLACES)
    return replace(made, position=place, height_m=max(layer_m + off_m, 1.0))


def steps(start: Place, end: Place) -> list[Place]:
    count = max(1, math.ceil(math.dist(start, end) / STEP_M))
    return [
        tuple(a + (b - a) * k / count for a, b in zip(start, end, strict=True))
        for k in range(count + 1)
    ]  # type: ignore[misc]


def flown(vehicle: VehicleState, order: Order | None) -> list[Place]:
    """Return every place in which a vehicle may be while it carries out an order."""
    here = (*vehicle.position, vehicle.height_m)
    pad, layer_m = vehicle.pad, vehicle.cruise_altitude_m
    if isinstance(order, TakeOff):
        return steps((*vehicle.position, 0.0), (*vehicle.position, layer_m))
    if isinstance(order, Land):
        return steps((*pad, vehicle.height_m), (*pad, 0.0))
    if isinstance(order, FlyPath):
        path = order.trajectory
        end_s = min(NEXT_S, path.end_s)
        ways = [path.place_at(end_s * k / 40) for k in range(41)]
    elif isinstance(order, FlyTo):
        ways = [vehicle.position, *order.route]
    else:
        return [here]
    # it climbs or descends to its layer at once, on its way, or not at all yet
    low_m, high_m = sorted((vehicle.height_m, layer_m))
    heights_m = {low_m, high_m, (low_m + high_m) / 2.0}
    found = [here]
    for a, b in pairwise(ways):
        for height_m in heights_m:
            found += steps((*a, height_m), (*b, height_m))
    return found


@settings(max_examples=400, deadline=None)
@given(st.data())
def test_order_that_is_clear_keeps_away_from_the_other_vehicle(data: st.DataObject) -> None:
    first, second = data.draw(vehicles(1)), data.draw(vehicles(2))
    doing = None if second.landed else data.draw(st.one_of(st.just(Hold()), orders(second)))
    if second.landed and data.draw(st.booleans()):
        doing = TakeOff(second.cruise_height_m)
    if isinstance(doing, Land):  # it is over its pad when the order to land comes
        second = replace(second, position=second.pad, over_home=True)
    second = replace(second, order=doing)
    asked = data.draw(orders(first))
    if isinstance(asked, Land):
        first = replace(first, position=first.pad, over_home=True)
    separation_m = setting().mission.team.separation_m
    others = flown(second, doing)
    if second.landed and doing is None:
        others = []
    begin = (*first.position, first.height_m)
    # a vehicle that is too near already may leave; other tests judge the way there
    assume(all(math.dist(begin, place) >= separation_m + 2.0 for place in others))
    state = replace(setting().initial_state(), vehicles={1: first, 2: second})
    if not Airspace(state).is_clear(first, asked):
        event("refused")
        return
    event(f"given: {asked.kind}, {doing.kind if doing else 'on the ground'}")
    nearest_m = min(
        (math.dist(a, b) for a, b in product(flown(first, asked), others)), default=math.inf
    )
    assert nearest_m >= separation_m, (asked, doing)


def is_in_its_layer(vehicle: VehicleState) -> bool:
    off_m = vehicle.height_m - vehicle.cruise_altitude_m
    return not vehicle.landed and abs(off_m) <= OFF_LAYER_M


@settings(max_examples=100, deadline=None)
@given(st.data())
def test_vehicles_in_their_layers_never_wait_for_each_other(data: st.DataObject) -> None:
    pair = []
    for number in (1, 2):
        vehicle = data.draw(vehicles(number).filter(is_in_its_layer))
        order = data.draw(orders(vehicle).filter(lambda order: not isinstance(order, Land)))
        pair.append(replace(vehicle, order=order))
    first, second = pair
    state = replace(setting().initial_state(), vehicles={1: first, 2: second})
    assert first.order is not None
    assert Airspace(state).is_clear(first, first.order)
