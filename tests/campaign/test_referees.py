"""The referees see each fault that one of them once missed."""

from __future__ import annotations

import math

import pytest

from missions.flight.setting_of import setting_of
from sitl.scenario import Setup
from tests.campaign.reducer import fleet_of, plan_of
from tests.campaign.simulated import Pilot, Witness
from tests.fake_fleet import Fleet
from tests.fake_fleet.driver import Driver
from tests.support.scenarios import command
from tests.support.small_missions import mission, square


def untroubled(seed: int) -> Fleet:
    fleet = fleet_of(plan_of(seed), "swath")
    fleet.troubles = []
    for craft in fleet.vehicles.values():
        craft.low_wh = 0.0
    return fleet


def kinds(fleet: Fleet) -> set[str]:
    return {kind for kind, _ in fleet.referee.found}


@pytest.mark.parametrize("forgets", [True, False])
def test_a_silent_vehicle_given_up_before_its_battery_can_be_empty_is_seen(monkeypatch, forgets):
    """The link was cut before lift-off was reported: over at 122 s, 14 m up, 6 to 13 Wh left."""
    fleet = untroubled(0)
    listen = Driver.listen

    def cut(driver: Driver, dt_s: float) -> None:
        if driver.number == 1 and driver.craft.flying and not driver.was_airborne:
            driver.link = "silent"
            driver.sent_up = driver.sent_up and not forgets
        listen(driver, dt_s)

    monkeypatch.setattr(Driver, "listen", cut)
    fleet.start()
    fleet.run(4000.0)
    fleet.conclude()
    assert ("air" in kinds(fleet)) == forgets


def airborne(fleet: Fleet) -> Fleet:
    fleet.start()
    fleet.run(until=lambda fleet: fleet.vehicles[1].height_m > 8.0)
    return fleet


@pytest.mark.parametrize("mode", ["land", "rtl", "other"])
def test_change_of_a_pilots_mode_is_seen(mode):
    """The pilot selected LAND while a guardian flew home: mode 9 became 6 within a second."""
    fleet = airborne(untroubled(0))
    craft = fleet.vehicles[1]
    craft.turn_switch(mode)  # type: ignore[arg-type]
    fleet.tick()
    assert "taken" not in kinds(fleet)
    craft.switch("rtl" if mode == "land" else "land")
    fleet.tick()
    assert "taken" in kinds(fleet)


@pytest.mark.parametrize("mode", ["land", "rtl"])
def test_land_or_rtl_by_a_pilot_ends_the_control_of_the_service(mode):
    fleet = airborne(untroubled(0))
    fleet.vehicles[1].turn_switch(mode)  # type: ignore[arg-type]
    orders = len(fleet.orders)
    fleet.run()
    assert kinds(fleet) == set()
    assert not fleet.vehicles[1].flying
    given = [type(order).__name__ for _, number, order in fleet.orders[orders:] if number == 1]
    assert given[:1] == ["StandDown"]


@pytest.mark.parametrize("deaf_for_s", [0.0, 150.0])
def test_a_landing_below_the_reserve_is_seen_unless_no_command_could_reach_it(deaf_for_s):
    """Seed 20471: commands were lost for 149 s, and the next one landed the vehicle."""
    fleet = airborne(untroubled(0))
    fleet.drivers[1].link = "commands lost"
    received_s = fleet.t_s + deaf_for_s
    fleet.run(until=lambda fleet: fleet.t_s >= received_s)
    fleet.drivers[1].link = "good"
    fleet.vehicles[1].wh = 0.5 * fleet.setting.energy.reserve_wh
    fleet.run(until=lambda fleet: not fleet.vehicles[1].flying)
    assert ("reserve" in kinds(fleet)) == (deaf_for_s == 0.0)


@pytest.mark.parametrize("reports", [True, False])
def test_referee_wind_above_the_given_one_is_a_storm_unless_telemetry_reports_it(reports):
    fleet = untroubled(0)
    fleet.air.given_m_s = (fleet.setting.energy.wind_m_s + 4.0, 0.0)
    for driver in fleet.drivers.values():
        driver.reports_wind = reports
    airborne(fleet)
    begin_s = fleet.t_s
    fleet.run(until=lambda fleet: fleet.t_s >= begin_s + 30.0)
    assert ("stormy" in fleet.referee.memories[1].ever) == (not reports)


def test_vehicles_are_apart_by_their_true_heights():
    """Receivers 5.5 m apart: vehicles in layers of 12 and 18 m flew at 12.1 and 12.5 m."""
    fleet = next(f for f in map(untroubled, range(100)) if len(f.vehicles) > 1)
    airborne(fleet)
    a, b = fleet.vehicles[1], fleet.vehicles[2]
    b.flying = b.armed = True
    b.position, b.height_m = a.position, a.height_m + a.level_m - b.level_m
    b.sea_error_m = 20.0  # its reported height
    for _ in range(2):
        fleet.t_s += 0.25
        fleet.look()
    assert "near" in kinds(fleet)


def test_receivers_err_as_configured_and_anew_after_a_swap():
    fleet = fleet_of(plan_of(3), "swath", receiver_sigma_m=3.0)
    driver = fleet.drivers[1]
    errors_m = []
    for _ in range(200):
        errors_m.append(driver.craft.sea_error_m)
        driver.switch_on()
    assert 2.0 < math.sqrt(sum(e * e for e in errors_m) / len(errors_m)) < 4.0
    assert max(map(abs, errors_m)) <= 8.0
    assert driver.home_amsl_m == driver.craft.level_m + driver.craft.sea_error_m


@pytest.mark.parametrize("autopilot", ["ardupilot", "px4"])
def test_change_of_a_simulated_pilots_mode_is_seen(autopilot):
    (vehicle,) = Setup(autopilot=autopilot, gps_sigma_m=0.0).build()
    vehicle.step(6.0)
    command(vehicle, 400, 1)
    if autopilot == "ardupilot":
        command(vehicle, 176, 1, 4)
        command(vehicle, 400, 1)
    command(vehicle, 22, 0, 0, 0, math.nan, math.nan, math.nan, 500.0)
    vehicle.step(12.0)
    witness = Witness(pilot=Pilot(1, at_s=15.0, mode="RTL"))
    setting = setting_of(mission(square(-10, 16, 40, 30), square(-60, -60, 160, 160)))

    def look() -> set[str]:
        witness.watch([vehicle], setting)
        assert witness.referee is not None
        return {kind for kind, _ in witness.referee.found if kind == "taken"}

    assert look() == set()
    assert vehicle.truth.mode.name == "RTL"
    command(vehicle, 21)  # was on its way
    assert look() == set()
    assert vehicle.truth.mode.name == "RTL"
    assert witness.referee.forgiven["on its way"] == 1
    vehicle.step(1.0)
    command(vehicle, 21)
    assert look() == {"taken"}
