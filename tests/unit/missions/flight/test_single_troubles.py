"""Single troubles that aircraft have met: the orders of the mission, step by step."""

from __future__ import annotations

from dataclasses import replace

import pytest
from shapely.geometry import LineString, Polygon

from missions.events import (
    Airborne,
    BatterySwapped,
    Connected,
    Landed,
    LiftedOff,
    LinkLost,
    OrderFailed,
    Overridden,
    Tracked,
)
from missions.flight.return_home import has_energy_for
from missions.flight.vehicle_state import Phase, ReturnReason
from missions.orders import AwaitBattery, FlyTo, Hold, Land, Look, TakeOff
from missions.units import Cell, GridPoint
from tests.support.small_missions import at_heights, square
from tests.unit.missions.flight.test_step import HOME, Service, frame, over

PAD = GridPoint(8.0, 0.0)


def test_a_take_off_that_fails_in_the_air_is_a_vehicle_in_the_air() -> None:
    made = over()
    made.connect()
    made.track(1, HOME, 4.0)
    made.track(1, HOME, 11.0)
    made.post(OrderFailed(1, 30.0, "TakeOff", "did not climb to 12 m"))
    vehicle = made.state.vehicles[1]
    assert vehicle.phase is Phase.AIRBORNE
    assert vehicle.return_reason is ReturnReason.FAULT
    assert not vehicle.landed
    assert not made.state.is_over
    made.now_s = 45.0
    made.track(1, HOME, 11.0)
    assert made.order() == Land()  # it is over its home


def test_leg_of_a_silent_vehicle_stays_reserved() -> None:
    made = over(vehicles=2)
    made.connect_all()
    leg = FlyTo((GridPoint(40.0, 0.0),), None, stop=True, height_m=12.0)
    made.fly(1, GridPoint(-15.0, 0.0), order=leg)
    made.fly(2, PAD, order=Hold(), return_reason=ReturnReason.BATTERY, over_home=True)
    made.track(2, PAD, 18.0)
    assert made.order(2) == Hold()
    made.post(LinkLost(1, made.now_s + 5.0))
    made.track(2, PAD, 18.0)
    assert made.order(2) == Hold()  # it may fly its leg to the end, through this column


def test_vehicle_that_flies_towards_air_of_a_failsafe_is_stopped() -> None:
    made = over(vehicles=2)
    made.connect_all()
    leg = FlyTo((GridPoint(40.0, 0.0),), None, stop=True, height_m=18.0)
    made.fly(1, HOME, order=Hold())
    made.fly(2, GridPoint(-30.0, 0.0), order=leg)
    orders = dict(made.post(Overridden(1, made.now_s + 1.0, "RTL")))
    assert orders[2] == Hold()  # the return climbs through its layer


@pytest.mark.parametrize("heights_m", [(0.0, 0.0), (6.0, 0.0), (-3.0, 1.5)])
@pytest.mark.parametrize("receivers_amsl_m", [(500.0, 500.0), (500.0, 505.5), (512.0, 496.0)])
def test_layers_are_counted_from_the_mission_whatever_receivers_report(
    heights_m: tuple[float, float], receivers_amsl_m: tuple[float, float]
) -> None:
    made = Service(at_heights(over(vehicles=2).setting.mission, heights_m))
    for number, at, amsl_m in zip((1, 2), (HOME, PAD), receivers_amsl_m, strict=True):
        made.post(Connected(number, 0.0, at, at, 0.0, False, True, 60.0, home_amsl_m=amsl_m))
        made.post(Airborne(number, 1.0, home=at, home_amsl_m=amsl_m + 4.0))
    levels_m = [
        height_m + made.state.vehicles[number].cruise_height_m
        for number, height_m in zip((1, 2), heights_m, strict=True)
    ]
    assert levels_m == pytest.approx([12.0, 18.0])


def test_no_look_is_given_over_a_cell_that_has_left_the_fence() -> None:
    made = over(drift_m_s=0.4, toward_deg=0.0)
    root = Cell(0, 23)  # 92 m north; the margin of the fence begins at 98
    made.exploring(at=root)
    made.put(1, order=Hold(), at_target=True)
    made.now_s = 40.0
    made.track(1, GridPoint(0.0, 92.0))
    assert not isinstance(made.order(), Look)


DRIFTING = Cell(0, 17)
"""The cell is 68 m north and drifts at 0.4 m/s; the fence margin begins at 98 m."""


def followed(made: Service) -> float:
    """Track a vehicle over its drifting cell until it stops following; return that time, s.

    As the driver does, it flies over the cell along its drift. Only the reducer watches the fence
    here.
    """
    while isinstance(order := made.order(), Look | FlyTo) and order.cell is not None:
        here = made.setting.grid.to_fixed(made.setting.grid.centre_of(order.cell), made.now_s)
        assert made.setting.fence.allows(here), f"still followed, {here}"
        made.track(1, here)
    return made.now_s


def looking(made: Service) -> Look:
    """Return the order to observe a cell which drifts towards the fence."""
    made.exploring(at=DRIFTING)
    order = made.order()
    assert isinstance(order, Look)
    return order


def test_a_look_that_lasts_ends_before_its_cell_drifts_out_of_the_fence() -> None:
    made = over(drift_m_s=0.4, toward_deg=0.0)
    looking(made)
    north = Cell(0, 18)
    made.post(*(frame(1, t_s, DRIFTING, DRIFTING, north) for t_s in (2.0, 3.0, 4.0)))
    # 30 m at 0.4 m/s are 75 s, and the fence begins 3 s earlier for the vehicle
    assert followed(made) == pytest.approx(73.0, abs=1.5)
    assert made.state.undecided == {DRIFTING}
    assert made.state.tree is not None
    assert made.state.tree.is_observed(DRIFTING)
    assert made.state.tree.children(DRIFTING) == (north,)
    assert not made.state.completed


def test_a_look_without_a_picture_is_given_up_at_the_fence_and_named() -> None:
    made = over(drift_m_s=0.4, toward_deg=0.0)
    looking(made)
    followed(made)
    assert made.state.abandoned == {DRIFTING}
    assert made.state.vehicles[1].return_reason is not ReturnReason.FAULT, "the camera is well"


def test_suspicion_that_drifts_out_while_it_is_observed_is_dropped() -> None:
    made = over(drift_m_s=0.4, toward_deg=0.0)
    made.connect()
    look = Look(DRIFTING, 30, 12.0)
    made.fly(1, HOME, candidate=DRIFTING, at_target=True, order=look, lanes=())
    followed(made)
    assert made.state.vehicles[1].candidate is None


def test_a_leg_against_the_wind_does_not_follow_its_cell_out_of_the_fence() -> None:
    made = over(drift_m_s=0.4, toward_deg=0.0)
    made.exploring(at=DRIFTING)
    leg = FlyTo((), DRIFTING, stop=True, height_m=12.0)
    made.put(1, order=leg, at_target=False)
    assert 70.0 < followed(made) < 76.0
    assert made.order() == Hold(), "it comes to rest"
    for _ in range(12):
        made.track(1, GridPoint(0.0, 96.0))
        assert not isinstance(made.order(), Look)
        assert getattr(made.order(), "cell", None) is None
    assert made.state.abandoned == {DRIFTING}


def test_region_at_rest_is_observed_for_as_long_as_it_takes() -> None:
    made = over()
    order = looking(made)
    here = made.setting.grid.centre_of(DRIFTING)
    for _ in range(100):
        made.track(1, here)
    assert made.order() is order


def test_the_way_to_a_pad_in_the_margin_goes_round_a_hole() -> None:
    hole = square(20, -6, 10, 30)
    made = over(square(40, 16, 30, 30), holes=[hole])
    home, far = GridPoint(18.5, 0.0), GridPoint(50.0, 0.0)  # 1.5 m from the hole, margin 2
    made.post(Connected(1, 0.0, home, home, 0.0, False, True, 60.0))
    made.post(Airborne(1, 8.0))
    made.fly(1, far)
    made.recall(1, far)
    order = made.leg()
    way = LineString([(p.east_m, p.north_m) for p in (far, *order.route)])
    assert order.route[-1].distance_to(home) < 0.1
    assert way.intersection(Polygon(hole)).length < 0.1


def test_the_worse_of_measured_and_given_wind_counts() -> None:
    made = over(wind_m_s=3.0)
    made.exploring()
    here = made.state.vehicles[1].position
    for wind_m_s, counted_m_s in ((1.0, 3.0), (9.0, 9.0)):
        made.now_s += 1.0
        made.post(Tracked(1, made.now_s, here, 12.0, 60.0, wind_m_s=wind_m_s))
        assert made.setting.energy.in_wind(made.state.vehicles[1].wind_m_s).wind_m_s == counted_m_s


def test_consumption_of_a_wavering_estimate_is_the_power_drawn() -> None:
    """Two estimates of the charge of a real PX4 differed by a percent.

    113 falls and 77 rises were
    1,744 W where 300 were drawn, and the vehicle came home with 79 %.
    """
    made = over()
    made.exploring()
    here, drawn = made.state.vehicles[1].position, []
    made.post(Tracked(1, made.now_s, here, 12.0, 50.0))
    for n in range(1, 200):
        made.now_s += 0.4
        left_wh = 50.0 - 300.0 * 0.4 * n / 3600.0 - 0.6 * (n % 2)
        made.post(Tracked(1, made.now_s, here, 12.0, left_wh))
        drawn.append(made.state.vehicles[1].drawn_w)
    assert max(drawn[100:]) < 500.0
    made.post(Tracked(1, made.now_s + 0.4, here, 12.0, 0.0))  # unknown: no consumption
    assert made.state.vehicles[1].drawn_w == drawn[-1]


def test_a_landing_away_from_home_is_no_battery_swap() -> None:
    made = over()
    made.exploring()
    made.put(1, return_reason=ReturnReason.BATTERY)
    made.post(Landed(1, 61.0, 0.0, position=GridPoint(50.0, 50.0)))
    vehicle = made.state.vehicles[1]
    assert vehicle.phase is Phase.DOWN
    assert "from its pad" in vehicle.note
    made.post(BatterySwapped(1, 90.0, 60.0))
    assert not isinstance(made.order(), TakeOff)


def test_vehicle_above_a_blocked_pad_lands_beside_it_while_the_reserve_is_whole() -> None:
    made = over(vehicles=2)
    made.connect_all()
    made.put(1, phase=Phase.OFFLINE, landed=False, position=PAD, height_m=12.0)
    made.fly(2, PAD, return_reason=ReturnReason.BATTERY, over_home=True)
    reserve_wh = made.setting.energy.reserve_wh
    for tenths in range(400, int(10 * reserve_wh), -1):
        made.now_s += 1.2
        made.post(Tracked(2, made.now_s, PAD, 18.0, tenths / 10.0))
        if made.order(2) != Hold():
            break
    assert tenths / 10.0 > reserve_wh + 2.0
    assert made.state.vehicles[2].phase in (Phase.AIRBORNE, Phase.GUARDED)


def test_a_battery_that_counts_as_fresh_is_not_asked_for_again() -> None:
    made = over(capacity_wh=14.0, speed_m_s=1.0)
    made.post(Connected(1, 0.0, HOME, HOME, 0.0, False, True, 12.9))
    for _ in range(3):
        made.post(BatterySwapped(1, 1.0, 12.9))
    assert not isinstance(made.order(), AwaitBattery)


def test_a_vehicle_that_was_moved_at_its_swap_comes_home_to_its_new_place() -> None:
    made = over()
    made.connect()
    moved = GridPoint(6.0, -8.0)
    made.post(LiftedOff(1, 8.0))
    made.post(Airborne(1, 15.0, home=moved))
    assert made.state.vehicles[1].pad == moved
    made.recall(1, GridPoint(10.0, 20.0))
    assert made.leg().route[-1].distance_to(moved) < 0.1


def test_vehicle_higher_than_its_layer_turns_back_for_the_longer_descent() -> None:
    made = over()
    made.exploring()
    here = made.state.vehicles[1]

    def enough(height_m: float, remaining_wh: float) -> bool:
        it = replace(here, height_m=height_m, remaining_wh=remaining_wh)
        return has_energy_for(made.setting, it, it.position, hover_s=3.0)

    least_wh = next(wh / 10 for wh in range(90, 400) if enough(12.0, wh / 10))
    # 60 m at 0.5 m/s are 2 minutes, of 300 W and 15 % more
    assert not enough(72.0, least_wh + 11.0)
    assert enough(72.0, least_wh + 12.0)
