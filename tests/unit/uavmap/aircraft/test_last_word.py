"""A pilot and a failsafe have priority over every part of the service, on the wire.

An earlier version took the vehicle back from its pilot in each of these cases.
"""

import asyncio

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mav
from shapely.geometry import Point, Polygon

from missions import events as ev
from missions.geo.trajectory import rounded_path
from missions.orders import FlyPath, FlyTo, ReturnToLaunch, StandDown, TakeOff
from missions.units import GridPoint
from sitl.copter.modes import Mode
from sitl.px4.modes import Px4Mode
from tests.support.flights import UP_M, fly, fly_up, small_mission, to
from tests.support.mavlink_peer import heartbeat
from tests.support.running import by
from tests.support.small_missions import square
from uavmap.aircraft.control import AirState, Holder
from uavmap.aircraft.controlled_commands import NotInControlError
from uavmap.aircraft.vehicle import SILENCE_ON_GROUND_S

HOUSE = square(-20, 28, 60, 6)
"""A no-fly area between the far side and home."""


def behind_a_house():
    return small_mission(holes=[HOUSE])


def on_px4(**how):
    return small_mission(autopilot="px4", **how)


async def fly_behind_the_house(flight):
    await flight.after(TakeOff(UP_M), ev.Airborne)
    for place in (GridPoint(45.0, 20.0), GridPoint(45.0, 45.0), GridPoint(10.0, 50.0)):
        await flight.after(FlyTo((place,), None, stop=True, height_m=UP_M), ev.Arrived)


async def fly_out(flight, height_m=UP_M):
    await flight.after(TakeOff(height_m), ev.Airborne)
    await flight.after(to(20.0, 30.0, height_m), ev.Arrived)


async def keeps(flight, mode, seconds=6.0):
    """Assert that the pilot's mode stays and that the service sends nothing from then on."""
    flight.pilot_mode(mode)
    await flight.sends_nothing(seconds)
    if flight.session.view.armed:
        assert flight.session.view.mode == mode
    assert [event.mode for event in flight.seen(ev.Overridden)] == [Mode(mode).name]


# --- whoever of ours acts ------------------------------------------------------------------------
@pytest.mark.parametrize("mode", [Mode.LAND, Mode.RTL, Mode.LOITER])
@by(fly, lambda mode: behind_a_house())
async def test_pilot_takes_it_on_way_around_hole_keeps_it(flight, /, mode):
    await fly_behind_the_house(flight)
    flight.driving.cancel()
    home = asyncio.ensure_future(flight.driver.guardian.bring_home("the mission failed"))
    await asyncio.sleep(4.0)
    await keeps(flight, mode)
    await asyncio.wait_for(home, 60.0)


@by(fly, behind_a_house)
async def test_pilot_lands_it_on_way_around_avoids_the_hole(flight, /):
    await fly_behind_the_house(flight)
    flight.driver.give(ReturnToLaunch())
    await asyncio.sleep(4.0)
    flight.pilot_mode(Mode.LAND)
    house = Polygon(HOUSE)
    while not flight.vehicle.truth.landed:
        here = flight.setting.grid.fixed(flight.vehicle.truth.position)
        assert not house.contains(Point(here))
        await asyncio.sleep(0.2)
    assert flight.seen(ev.Overridden)


@by(fly)
async def test_pilot_lands_it_while_rtl_is_commanded_keeps_it(flight, /):
    await fly_out(flight)
    flight.to_vehicle = lambda message: message.get_type() == "HEARTBEAT"
    flight.driver.guardian.take_over("rtl", "it has made no progress")
    await asyncio.sleep(4.0)
    flight.pilot_mode(Mode.LAND)
    sent = len(flight.sent)
    await asyncio.sleep(4.0)
    flight.to_vehicle = lambda message: True
    await asyncio.sleep(4.0)
    assert flight.commands_after(sent) == []
    assert flight.session.view.mode == Mode.LAND
    assert not flight.driver.guardian.acting


@pytest.mark.parametrize("mode", [Mode.RTL, Mode.LAND, Mode.LOITER])
@by(fly)
async def test_pilot_takes_it_in_a_quick_descent_keeps_it(flight, /, mode):
    await fly_out(flight, 30.0)
    flight.driver.guardian.take_over("land", "the wind carries it away", hurry=True)
    await asyncio.sleep(2.0)
    await keeps(flight, mode)


class ByMap:
    """Navigation by the map: satellites are lost, and pictures give the position."""

    by_map = True

    def leapt(self, how):
        return True

    def check(self, *, airborne):
        pass


@by(fly)
async def test_failsafe_lands_it_on_return_by_map_is_left_alone(flight, /):
    """An ArduCopter reports LAND of its EKF failsafe exactly like LAND of a pilot."""
    await fly_out(flight, 20.0)
    flight.driver._monitor.navigation = ByMap()
    flight.driver.guardian.take_over("rtl", "its own map tells where it is to 3 m only")
    await asyncio.sleep(4.0)
    await keeps(flight, Mode.LAND, 3.0)


@by(fly)
async def test_link_back_and_pilot_has_it_guardian_reports_nothing(flight, /):
    await fly_out(flight)
    flight.driver.guardian.take_over("rtl", "it has made no progress")
    await asyncio.sleep(2.0)
    flight.to_driver = lambda message: False
    await flight.sees(ev.LinkLost)
    flight.pilot(mav.MAV_CMD_DO_SET_MODE, 1, Mode.LOITER)
    lines = len(flight.service_lines)
    flight.to_driver = lambda message: True
    connected = await flight.sees(ev.Connected, 2)
    await asyncio.sleep(3.0)
    assert not connected.ours
    assert len(flight.seen(ev.Guarded)) == 1
    assert flight.service_lines[lines:] == []


# --- a PX4, which shows its mode only now and then -----------------------------------------------
def path(flight):
    north = [GridPoint(0.0, 0.0), GridPoint(0.0, 50.0)]
    return FlyPath(rounded_path(north, flight.now_s() + 1.0, speed_m_s=4.0), UP_M, 0.0, 0.5)


async def on_path(flight, seconds=6.0):
    await flight.after(TakeOff(UP_M), ev.Airborne)
    flight.driver.give(path(flight))
    await asyncio.sleep(seconds)
    assert flight.vehicle.truth.mode == Px4Mode.OFFBOARD


@pytest.mark.parametrize("after_s", [0.25, 0.3, 0.5, 0.9])
@by(fly, lambda after_s: on_px4())
async def test_px4_pilot_position_before_order_keeps_it(flight, /, after_s):
    """A PX4 sends a heartbeat a second: one from before the pilot caused a command of Hold."""
    await on_path(flight)
    flight.vehicle._ap.fail_to(Px4Mode.POSITION)
    await asyncio.sleep(after_s)
    flight.driver.give(to(0.0, 0.0))
    await asyncio.sleep(3.0)
    assert flight.vehicle.truth.mode == Px4Mode.POSITION
    assert len(flight.seen(ev.Overridden)) == 1


@pytest.mark.parametrize("lost_ack", [None, 0, 1])
@by(fly_up, lambda lost_ack: on_px4())
async def test_px4_pilot_hold_after_offboard_keeps_it(flight, /, lost_ack):
    """Seen: OFFBOARD requested at 58.81 s, the pilot's Hold at 59.0 s, ours again at 61.53 s."""
    at_s = []
    real = flight.vehicle._ap._change

    def change(mode):
        real(mode)
        if mode == Px4Mode.OFFBOARD:
            at_s.append(flight.now_s())
            # before the next heartbeat could show it
            asyncio.get_running_loop().call_later(0.01, flight.vehicle._ap.set_mode, Px4Mode.HOLD)

    flight.vehicle._ap._change = change
    acks = []

    def lossy(message):
        """Lose the reports of OFFBOARD, and perhaps one of the two acknowledgements."""
        if message.get_type() in ("HEARTBEAT", "CURRENT_MODE"):
            return int(message.custom_mode) != Px4Mode.OFFBOARD
        if getattr(message, "command", None) == mav.MAV_CMD_DO_SET_MODE:
            acks.append(message)
            return len(acks) - 1 != lost_ack
        return True

    flight.to_driver = lossy
    flight.driver.give(path(flight))
    await flight.until(lambda: bool(at_s))
    await asyncio.sleep(8.0)
    assert len(at_s) == 1
    assert flight.vehicle.truth.mode == Px4Mode.HOLD
    assert [event.mode for event in flight.seen(ev.Overridden)] == ["HOLD"]


@by(fly, on_px4)
async def test_px4_back_in_offboard_after_failsafe_is_not_under_our_control(flight, /):
    """Seen: RTL by a failsafe for 1.0 s, then OFFBOARD by itself; the flight continued."""
    await on_path(flight)
    autopilot = flight.vehicle._ap
    autopilot.failsafes.engaged = True
    autopilot._change(Px4Mode.RTL)
    await asyncio.sleep(0.5)
    autopilot.failsafes.engaged = False
    sent = len(flight.sent)
    autopilot._change(Px4Mode.OFFBOARD)
    await asyncio.sleep(3.0)
    assert flight.seen(ev.Overridden)
    assert not flight.seen(ev.Released)
    assert not any(
        m.get_type() == "SET_POSITION_TARGET_GLOBAL_INT" for m in flight.commands_after(sent)
    )


@by(fly, on_px4)
async def test_px4_in_failsafe_when_link_is_back_is_not_put_into_hold(flight, /):
    """Seen: a new position came before a new heartbeat, and the earlier mode was believed."""
    await on_path(flight)
    flight.to_driver = lambda message: False
    await flight.sees(ev.LinkLost)
    flight.driver.give(StandDown())
    flight.vehicle._ap.set_mode(Px4Mode.RTL)
    flight.to_driver = lambda message: message.get_type() != "HEARTBEAT"
    before = heartbeat(Px4Mode.OFFBOARD, armed=True, autopilot=mav.MAV_AUTOPILOT_PX4)
    flight.session.feed(before.pack(mav.MAVLink(None, srcSystem=1, srcComponent=1)))
    await asyncio.sleep(1.5)
    assert len(flight.seen(ev.Connected)) == 1
    flight.to_driver = lambda message: True
    connected = await flight.sees(ev.Connected, 2)
    assert (connected.ours, flight.vehicle.truth.mode) == (False, Px4Mode.RTL)
    await flight.sends_nothing(3.0)


# --- in the air from the first NAV_TAKEOFF on ----------------------------------------------------
@by(fly)
async def test_link_lost_between_take_off_and_lift_off_is_in_air(flight, /):
    """Arming browns a radio out: an earlier version gave the vehicle up 12 m above the ground."""
    cut = []

    def to_vehicle(message):
        if getattr(message, "command", None) == mav.MAV_CMD_NAV_TAKEOFF and not cut:
            cut.append(flight.now_s())
            flight.to_driver = lambda message: False
            return True
        return not cut

    flight.to_vehicle = to_vehicle
    flight.driver.give(TakeOff(UP_M))
    await flight.sees(ev.LinkLost)
    flight.driver.give(StandDown())
    assert flight.driver.guardian.responsible
    await asyncio.sleep(SILENCE_ON_GROUND_S + 10.0)
    assert flight.vehicle.truth.height_m == pytest.approx(UP_M, abs=0.5)
    assert not flight.seen(ev.GivenUp)
    assert "in the air at its last report" in flight.driver.guardian.fate()
    flight.to_driver = flight.to_vehicle = lambda message: True
    connected = await flight.sees(ev.Connected, 2)
    assert (connected.airborne, connected.ours) == (True, True)
    assert not flight.seen(ev.LiftedOff)


@pytest.mark.parametrize("autopilot", ["ardupilot", "px4"])
def test_vehicle_without_a_landed_state_is_guarded_and_brought_home(autopilot):
    """Without EXTENDED_SYS_STATE no rule of an earlier guardian watched the vehicle."""

    async def body(flight):
        flight.to_driver = lambda message: message.get_type() != "EXTENDED_SYS_STATE"
        await asyncio.sleep(6.0)
        flight.vehicle.fail.link()
        await flight.after(TakeOff(UP_M), ev.Airborne)
        assert len(flight.seen(ev.LiftedOff)) == 1
        assert flight.driver.guardian.responsible
        assert flight.driver._monitor.control.air is AirState.AIRBORNE
        await asyncio.wait_for(flight.driver.guardian.bring_home("the mission failed"), 120.0)
        assert flight.vehicle.truth.landed
        assert len(flight.seen(ev.Landed)) == 1
        assert flight.driver.guardian.fate() == ""

    fly(body, small_mission(autopilot=autopilot))


@by(fly)
async def test_take_off_is_held_until_it_is_known_to_be_on_the_ground(flight, /):
    """A vehicle that is armed, low, and without a landed state may stand or hover."""
    monitor = flight.driver._monitor
    flight.to_driver = lambda message: message.get_type() not in (
        "EXTENDED_SYS_STATE", "HEARTBEAT",
    )  # fmt: skip
    await flight.sees(ev.LinkLost, within_s=10.0)
    autopilot = mav.MAVLink(None, srcSystem=1, srcComponent=1)
    for _ in range(20):
        flight.session.feed(heartbeat(Mode.GUIDED, armed=True).pack(autopilot))
        await asyncio.sleep(0.2)
    await flight.sees(ev.Connected, 2)
    assert monitor.control.air is AirState.UNKNOWN
    sent = len(flight.sent)
    flight.driver.give(TakeOff(UP_M))
    for _ in range(20):
        flight.session.feed(heartbeat(Mode.GUIDED, armed=True).pack(autopilot))
        await asyncio.sleep(0.2)
    commands = [getattr(m, "command", None) for m in flight.commands_after(sent)]
    assert mav.MAV_CMD_NAV_TAKEOFF not in commands
    flight.to_driver = lambda message: True
    await flight.sees(ev.Airborne)


# --- a crash -------------------------------------------------------------------------------------
@by(fly)
async def test_crash_leaves_motors_running_they_are_stopped_by_force(flight, /):
    """A real ArduCopter with a dead motor stayed armed in LAND on the ground for 138 s."""
    await fly_out(flight)
    stops = only_forced_disarms(flight)
    flight.vehicle.fail.motor(share=0.0)
    await flight.sees(ev.Crashed)
    await asyncio.wait_for(flight.driver.guardian.bring_home("the mission failed"), 30.0)
    assert len(stops) == 2  # the request is repeated until it is disarmed
    assert not flight.session.view.armed
    assert "vehicle 1: its motors still run; they are stopped by force" in flight.service_lines
    assert flight.service_lines[-1] == "vehicle 1: its motors have stopped"
    assert "motors" not in flight.driver.guardian.fate()


@by(fly)
async def test_crash_under_pilot_with_motors_running_is_reported_only(flight, /):
    await fly_out(flight)
    flight.pilot_mode(Mode.LOITER)
    sent = len(flight.sent)
    only_forced_disarms(flight)
    flight.vehicle.fail.motor(share=0.0)
    await flight.sees(ev.Crashed)
    await asyncio.sleep(5.0)
    assert flight.driver._monitor.control.holder is Holder.PILOT
    assert flight.commands_after(sent) == []
    assert "vehicle 1: its motors still run; keep away" in flight.service_lines
    assert flight.driver.guardian.fate().endswith("and its motors still run")


def only_forced_disarms(flight):
    """Its landing detector does not detect this landing; it obeys the second forced disarming."""
    autopilot, stops = flight.vehicle._ap, []
    real = autopilot.disarm

    def to_vehicle(message):
        if getattr(message, "command", None) == mav.MAV_CMD_COMPONENT_ARM_DISARM:
            assert (message.param1, message.param2) == (0.0, 21196.0)
            stops.append(flight.now_s())
        return True

    flight.to_vehicle = to_vehicle
    autopilot.disarm = lambda force=False: real(force) if len(stops) > 1 else "not landed"
    return stops


# --- commands at the last place before the wire --------------------------------------------------
async def commands_are_refused(flight):
    """Assert that each command of the mission is refused at the last place before the wire."""
    commands, place = flight.driver._commands, flight.session.view.position
    for command in (
        commands.follow(), commands.land(), commands.return_to_launch(), commands.arm(),
        commands.take_off(UP_M, lambda: False), commands.speed(3.0), commands.fly_to(place, UP_M),
    ):  # fmt: skip
        with pytest.raises(NotInControlError):
            await command
    with pytest.raises(NotInControlError):
        commands.point_to(place, UP_M)


@by(fly_up)
async def test_no_command_of_the_mission_leaves_while_a_pilot_has_the_vehicle(flight, /):
    flight.driving.cancel()
    flight.pilot_mode(Mode.LOITER)
    await flight.until(lambda: flight.driver._monitor.control.holder is Holder.PILOT)
    sent = len(flight.sent)
    await commands_are_refused(flight)
    assert flight.commands_after(sent) == []


@by(fly_up)
async def test_no_command_of_the_mission_leaves_while_the_guardian_acts(flight, /):
    flight.driving.cancel()
    home = asyncio.ensure_future(flight.driver.guardian.bring_home("the mission failed"))
    await flight.until(lambda: flight.driver._monitor.control.holder is Holder.GUARDIAN)
    await commands_are_refused(flight)
    await asyncio.wait_for(home, 60.0)
