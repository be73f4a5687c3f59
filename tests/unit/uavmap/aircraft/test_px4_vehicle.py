"""The driver flies a simulated PX4 with the same orders, and the pilot keeps priority."""

import asyncio

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mav

from missions import events as ev
from missions.orders import AwaitBattery, Land, Look, StandDown, TakeOff
from missions.units import Cell, GridPoint
from sitl.px4.modes import Px4Mode
from sitl.px4.params import bytewise
from tests.support.flights import (
    UP_M,
    Flight,
    climbing,
    fly,
    fly_up,
    flying,
    looking,
    small_mission,
    to,
    under_way,
)
from tests.support.running import by
from tests.support.scenarios import into
from uavmap.base.clock import VirtualClock, run

HEARTBEAT_S = 1.1


def on_px4(amsl_m=488.0, **how):
    made = small_mission(autopilot="px4", **how)
    return made.model_copy(update={"start": made.start.model_copy(update={"amsl_m": amsl_m})})


def pilot_mode(flight, mode):
    flight.pilot(mav.MAV_CMD_DO_SET_MODE, 1, mode >> 16 & 0xFF, mode >> 24)
    assert flight.vehicle.truth.mode == mode


def set_param(flight, name, value):
    message = mav.MAVLink_param_set_message(1, 1, name.encode(), bytewise(value), 6)
    flight.vehicle.receive(message.pack(mav.MAVLink(None, 255, 190)))


def modes_of(flight):
    return [m.param2 for _, m in flight.sent if getattr(m, "command", 0) == 176]


@pytest.mark.parametrize("amsl_m", [0.0, 1800.0, -20.0])
@by(fly_up, on_px4)
async def test_order_ends_with_its_event(flight, /, amsl_m):
    assert flight.vehicle.truth.mode == Px4Mode.HOLD
    assert flight.vehicle.truth.height_m == pytest.approx(UP_M, abs=0.6)
    arrived = await flight.after(to(10.0, 16.0), ev.Arrived)
    assert arrived.position.distance_to(GridPoint(10.0, 16.0)) < 0.8
    await flight.after(Look(Cell(2, 4), 5, UP_M), ev.LookEnded)
    assert len(flight.seen(ev.FrameSeen)) == 5
    assert flight.vehicle.truth.height_m == pytest.approx(UP_M, abs=0.6)
    await flight.after(to(0.0, 0.0, 16.0), ev.Arrived)
    assert flight.vehicle.truth.height_m == pytest.approx(16.0, abs=0.6)
    await flight.after(Land(), ev.Landed)
    await flight.after(AwaitBattery(), ev.BatterySwapped)
    assert not flight.seen(ev.OrderFailed, ev.Overridden)


@by(fly_up, lambda: on_px4(speed_m_s=3.0))
async def test_ordered_speed_is_flown(flight, /):
    flight.driver.give(to(0.0, 60.0))
    await asyncio.sleep(7.0)
    assert flight.vehicle.truth.velocity_m_s[1] == pytest.approx(3.0, abs=0.3)


@by(fly, on_px4)
async def test_home_that_moves_on_arming_is_accepted(flight, /):
    """Its height moves as well: by the barometer it has climbed since home was set."""
    before_m = flight.session.view.home_amsl_m
    flight.vehicle._ap.error.up += 4.0
    await flight.after(TakeOff(UP_M), ev.Airborne)
    assert flight.session.view.home_amsl_m > before_m + 1.0
    for point in ((8.0, 8.0), (0.0, 8.0)):
        await flight.after(to(*point), ev.Arrived)
        assert flight.session.view.height_m == pytest.approx(UP_M, abs=0.6)
    assert not flight.seen(ev.OrderFailed)


@by(fly, on_px4)
async def test_home_moves_before_lift_off_height_stays_as_ordered(flight, /):
    """A real PX4 moved its home by 1 m as its propellers turned: "did not climb to 12 m"."""
    flight.driver.give(TakeOff(UP_M))
    view = flight.session.view
    ordered = lambda: any(getattr(m, "command", 0) == 22 for _, m in flight.sent)  # noqa: E731
    await flight.until(lambda: ordered() and view.armed)
    autopilot = flight.vehicle._ap
    east_m, north_m, up_m = autopilot.home
    autopilot.home, autopilot.home_changed = (east_m, north_m, up_m + 1.0), True
    await flight.sees(ev.Airborne)
    assert flight.vehicle.truth.height_m == pytest.approx(UP_M, abs=0.6)
    assert view.height_m == pytest.approx(UP_M, abs=0.6)
    assert not flight.seen(ev.OrderFailed)


def found_in_offboard(body, made):
    """Run a test with a PX4 on the ground that an earlier process left in OFFBOARD."""
    flight = Flight(made)
    flight.vehicle.step(6.0)
    into(flight.vehicle, Px4Mode.OFFBOARD)

    async def main():
        async with under_way(flight):
            await body(flight)

    run(main(), VirtualClock())
    return flight


@by(found_in_offboard, on_px4)
async def test_px4_left_in_offboard_by_a_failsafe_takes_off_again(flight, /):
    """A real PX4 stood disarmed in OFFBOARD: every resume failed with "not ready to arm"."""
    await asyncio.sleep(3.0)
    assert not flight.session.view.prearm_ok
    await flight.after(TakeOff(UP_M), ev.Airborne, within_s=60.0)
    assert flight.vehicle.truth.mode == Px4Mode.HOLD


@by(found_in_offboard, on_px4)
async def test_prearm_wait_names_the_mode(flight, /, monkeypatch):
    await asyncio.sleep(3.0)
    monkeypatch.setattr(type(flight.vehicle._ap), "prearm_refusal", lambda ap: "a check fails")
    failed = await flight.after(TakeOff(UP_M), ev.OrderFailed, within_s=150.0)
    assert "not ready to arm within 120 s, in HOLD" in failed.reason
    assert any(
        "waits for the checks before arming, in HOLD" in line for line in flight.service_lines
    )


# --- who has the last word -----------------------------------------------------------------------
async def landing(flight):
    await flight.after(TakeOff(UP_M), ev.Airborne)
    flight.driver.give(Land())
    await asyncio.sleep(3.0)


@pytest.mark.parametrize(
    ("phase", "turned"),
    [
        (climbing, Px4Mode.RTL),
        (flying, Px4Mode.OFFBOARD),
        (looking, Px4Mode.RTL),
        (landing, Px4Mode.OFFBOARD),
    ],
    ids=lambda value: getattr(value, "__name__", None),
)
@by(fly, on_px4)
async def test_pilot_takes_over_in_every_phase(flight, /, phase, turned):
    await phase(flight)
    if turned == Px4Mode.OFFBOARD:
        flight.vehicle._ap.setpoints.note(flight.vehicle.t_s + 1e3)  # a stream without end
    pilot_mode(flight, turned)
    await flight.sees(ev.Overridden, within_s=HEARTBEAT_S)
    await flight.sends_nothing(10.0)
    assert flight.vehicle.truth.mode == turned
    assert [e.mode for e in flight.seen(ev.Overridden)] == [turned.name]
    pilot_mode(flight, Px4Mode.HOLD)
    await flight.sees(ev.Released, within_s=HEARTBEAT_S)
    await flight.after(to(0.0, 8.0, 15.0), ev.Arrived)


@by(fly, on_px4)
async def test_pilots_mission_ending_in_hold_gives_nothing_back(flight, /):
    await flying(flight)
    pilot = mav.MAVLink(None, 255, 190)
    place = (round(48.0 * 1e7), round(11.0 * 1e7), 15.0, 0)
    item = mav.MAVLink_mission_item_int_message(1, 1, 0, 6, 16, 0, 1, 0, 0, 0, 0, *place)
    for message in (mav.MAVLink_mission_count_message(1, 1, 1, 0), item):
        flight.vehicle.receive(message.pack(pilot))
    pilot_mode(flight, Px4Mode.MISSION)
    await flight.sees(ev.Overridden, within_s=HEARTBEAT_S)
    await flight.until(lambda: flight.vehicle.truth.mode == Px4Mode.HOLD)
    await flight.sends_nothing(5.0)
    assert not flight.seen(ev.Released)


@by(fly, on_px4)
async def test_failsafe_waiting_in_hold_is_not_under_our_control(flight, /):
    await flying(flight)
    flight.vehicle.fail.rc(for_s=2.0)
    overridden = await flight.sees(ev.Overridden, within_s=HEARTBEAT_S)
    assert overridden.mode == "HOLD by a failsafe"
    await flight.sees(ev.Landed)
    assert flight.vehicle.truth.mode == Px4Mode.HOLD
    assert not flight.seen(ev.Released)


@by(fly, on_px4)
async def test_failsafe_return_for_the_battery_is_left_alone(flight, /):
    set_param(flight, "COM_LOW_BAT_ACT", 2)
    await flying(flight)
    flight.vehicle.fail.battery_sag(8.0)
    await flight.sees(ev.Overridden, within_s=HEARTBEAT_S)
    index = len(flight.sent)
    await flight.sees(ev.Landed)
    assert flight.commands_after(index) == []


def silence(message):
    return False


@pytest.mark.parametrize("meanwhile", [None, Px4Mode.RTL])
@by(fly, on_px4)
async def test_link_lost_and_back_reports_the_control(flight, /, meanwhile):
    await flying(flight)
    flight.to_driver = flight.to_vehicle = silence
    await flight.sees(ev.LinkLost, within_s=6.0)
    flight.driver.give(StandDown())
    if meanwhile is not None:
        pilot_mode(flight, meanwhile)
    flight.to_driver = flight.to_vehicle = lambda message: True
    connected = await flight.sees(ev.Connected, 2, within_s=5.0)
    assert (connected.airborne, connected.ours) == (True, meanwhile is None)
    if meanwhile is None:
        await flight.after(to(0.0, 0.0), ev.Arrived)
    else:
        await flight.sees(ev.Landed)
    assert not flight.seen(ev.OrderFailed)


@by(fly, on_px4)
async def test_heartbeat_of_a_camera_reports_no_mode(flight, /):
    """It came between two heartbeats of the autopilot; the earlier mode counted as new."""
    await flying(flight)
    flight.to_driver = silence
    await asyncio.sleep(1.0)
    camera = mav.MAVLink(None, 1, mav.MAV_COMP_ID_CAMERA)
    beat = mav.MAVLink_heartbeat_message(mav.MAV_TYPE_CAMERA, mav.MAV_AUTOPILOT_INVALID, 0, 0, 4, 3)
    flight.session.feed(beat.pack(camera))
    assert not flight.driver._monitor.control.is_mode_known(asyncio.get_running_loop().time())


@by(fly, on_px4)
async def test_refused_arming_is_reported_with_its_reason(flight, /):
    flight.vehicle._ap.arm = lambda force=False: "Arming denied! Compass"
    failed = await flight.after(TakeOff(UP_M), ev.OrderFailed, within_s=200.0)
    assert "COMPONENT_ARM_DISARM was refused: temporarily rejected" in failed.reason
    assert "Compass" in failed.reason


@by(fly_up, on_px4)
async def test_mode_in_flight_is_changed_by_landing_only(flight, /):
    before = len(modes_of(flight))
    await flight.after(to(10.0, 10.0), ev.Arrived)
    assert len(modes_of(flight)) == before
    targets = [m for _, m in flight.sent if getattr(m, "command", 0) == 192]
    assert {m.param2 for m in targets} == {0.0}
    assert {m.frame for m in targets} == {mav.MAV_FRAME_GLOBAL_INT}


@by(fly_up, on_px4)
async def test_stand_down_after_landing_away_is_no_crash(flight, /):
    """A spare pad: the order to stand by comes while its motors run; it holds by itself."""
    await flight.after(to(-11.0, -11.0), ev.Arrived)
    report = flight.driver._reporter.report

    def standing_by(event):
        report(event)
        if isinstance(event, ev.Landed):
            flight.driver.give(StandDown())

    flight.driver._reporter.report = standing_by
    await flight.after(Land(), ev.Landed)
    await asyncio.sleep(20.0)
    assert not flight.session.view.armed
    assert not flight.seen(ev.Crashed)


@pytest.mark.parametrize("after_s", [1.75, 4.5, 5.0, 6.0])
@by(fly, on_px4)
async def test_take_off_called_off_on_slow_link_stays_under_our_control(flight, /, after_s):
    """Its arming, climb and landing are reported after the service has commanded something else."""
    flight.vehicle.fail.link(delay_s=0.6)
    flight.driver.give(TakeOff(UP_M))
    await asyncio.sleep(after_s)
    flight.driver.give(Land())
    await flight.sees(ev.Landed, within_s=40.0)
    await asyncio.sleep(20.0)
    assert flight.vehicle.truth.landed
    assert not flight.vehicle.truth.armed
    assert not flight.seen(ev.Overridden)


@by(fly, on_px4)
async def test_vehicle_taken_before_take_off_and_disarmed_has_landed(flight, /):
    flight.vehicle.fail.reject(command=mav.MAV_CMD_NAV_TAKEOFF, for_s=20.0)
    flight.driver.give(TakeOff(UP_M))
    await flight.until(lambda: flight.session.view.armed)
    flight.vehicle._ap.setpoints.note(flight.vehicle.t_s + 1e3)  # a stream without end
    pilot_mode(flight, Px4Mode.OFFBOARD)
    await flight.sees(ev.Overridden, within_s=5.0)
    await flight.sees(ev.Landed, within_s=40.0)
    assert not flight.seen(ev.LiftedOff)


@by(fly, on_px4)
async def test_pilots_landing_in_a_guardians_descent_is_noticed(flight, /):
    """In its guardian's descent a vehicle flies to targets: LAND is a command of the pilot."""
    await flying(flight)
    flight.driver.guardian.take_over("land", "a test", hurry=True)
    await asyncio.sleep(1.0)
    assert not flight.seen(ev.Overridden)
    pilot_mode(flight, Px4Mode.LAND)
    await flight.sees(ev.Overridden, within_s=HEARTBEAT_S)
