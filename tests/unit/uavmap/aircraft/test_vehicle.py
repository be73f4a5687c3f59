"""The driver flies a simulated vehicle: its orders, and the priority of the pilot."""

import asyncio
import itertools

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mav

from missions import events as ev
from missions.errors import LinkError
from missions.orders import Hold, Land, Look, StandDown, Sweep, TakeOff
from missions.units import Cell, GridPoint
from sitl.copter.modes import Mode
from tests.support.field import BOTH, mission_of, on_field
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
from tests.support.mavlink_peer import heartbeat
from tests.support.running import by, on_virtual_time
from uavmap.aircraft.telemetry_streams import Streams
from uavmap.base.clock import VirtualClock, run
from uavmap.mavlink.identity import ANSWER_S

GUIDED, LOITER, RTL, LAND = (int(m) for m in (Mode.GUIDED, Mode.LOITER, Mode.RTL, Mode.LAND))


# --- the straight path -----------------------------------------------------------------------
@by(fly)
async def test_home_that_moves_on_arming_is_accepted(flight, /):
    """ArduPilot sets home again when it arms; heights are then above the new home."""
    before = flight.session.view.home
    flight.vehicle._ap.error.east += 3.0
    await flight.after(TakeOff(UP_M), ev.Airborne)
    assert flight.session.view.home != before
    await flight.after(to(8.0, 8.0), ev.Arrived)
    await flight.after(to(0.0, 0.0), ev.Arrived)
    await flight.after(Land(), ev.Landed)
    assert not flight.seen(ev.OrderFailed)


@by(fly_up)
async def test_order_replaces_the_last_one_midway(flight, /):
    flight.driver.give(to(60.0, 0.0))
    await asyncio.sleep(3.0)
    await flight.after(to(0.0, 20.0), ev.Arrived)
    (arrived,) = flight.seen(ev.Arrived)
    assert arrived.position.distance_to(GridPoint(0.0, 20.0)) < 0.8
    flight.driver.give(Look(Cell(0, 5), 15, UP_M))
    await flight.sees(ev.FrameSeen, 2)
    await flight.after(to(8.0, 20.0), ev.Arrived)
    await asyncio.sleep(10.0)
    assert len(flight.seen(ev.FrameSeen)) <= 3
    assert not flight.seen(ev.LookEnded)
    assert len(flight.seen(ev.Arrived)) == 2


@by(fly)
async def test_take_off_replaced_in_the_climb_lands(flight, /):
    flight.driver.give(TakeOff(UP_M))
    await flight.until(lambda: flight.vehicle.truth.height_m > 4.0)
    await flight.after(Land(), ev.Landed)
    assert not flight.seen(ev.Airborne)


@by(fly_up)
async def test_hold_keeps_the_position(flight, /):
    flight.driver.give(to(40.0, 0.0))
    await asyncio.sleep(4.0)
    flight.driver.give(Hold())
    await asyncio.sleep(12.0)
    there = flight.seen(ev.Tracked)[-1].position
    await asyncio.sleep(10.0)
    assert flight.seen(ev.Tracked)[-1].position.distance_to(there) < 1.0
    assert not flight.seen(ev.Arrived)
    times_s = [event.t_s for event in flight.seen(ev.Tracked)]
    assert max(b - a for a, b in itertools.pairwise(times_s)) <= 1.2


# --- the pilot has the last word -------------------------------------------------------------
async def taking_off(flight):
    flight.driver.give(TakeOff(UP_M))
    await flight.until(lambda: flight.vehicle.truth.armed)


async def sweeping(flight):
    await flight.after(TakeOff(UP_M), ev.Airborne)
    flight.driver.give(Sweep(GridPoint(60.0, 0.0), 4.0, UP_M))
    await flight.sees(ev.FrameSeen, 2)


async def holding(flight):
    await flight.after(TakeOff(UP_M), ev.Airborne)
    flight.driver.give(Hold())
    await asyncio.sleep(2.0)


async def landing(flight):
    await flight.after(TakeOff(UP_M), ev.Airborne)
    flight.driver.give(Land())
    await flight.until(lambda: flight.vehicle.truth.height_m < 9.0)


async def idle(flight):
    await flight.after(TakeOff(UP_M), ev.Airborne)


PHASES = [taking_off, climbing, flying, sweeping, looking, holding, landing, idle]


@pytest.mark.parametrize(
    ("phase", "mode"),
    [*zip(PHASES, itertools.cycle([LOITER, RTL])), (flying, RTL), (landing, RTL)],
    ids=lambda value: getattr(value, "__name__", None),
)
@by(fly)
async def test_pilot_takes_over_at_once_in_every_phase(flight, /, phase, mode):
    await phase(flight)
    flight.pilot_mode(mode)
    index, t_s = len(flight.sent), flight.now_s()
    await flight.sees(ev.Overridden, within_s=0.1)
    await asyncio.sleep(8.0)  # a repeated command is repeated each second
    assert flight.commands_after(index) == []
    (overridden,) = flight.seen(ev.Overridden)
    assert overridden.mode == Mode(mode).name
    assert overridden.t_s == pytest.approx(t_s, abs=0.06)
    assert flight.vehicle.truth.mode == mode
    if flight.vehicle.truth.armed:
        flight.pilot_mode(GUIDED)
        released = await flight.sees(ev.Released, within_s=0.1)
        assert released.height_m == pytest.approx(flight.vehicle.truth.height_m, abs=0.5)
        if released.height_m > 3.0:
            await flight.after(to(0.0, 8.0), ev.Arrived)


@by(fly_up, lambda: small_mission(drift_m_s=0.1, interval_s=1.0))
async def test_drifting_look_yields_to_a_pilot(flight, /):
    """Two tasks send commands here: one follows the cell, one takes the pictures."""
    flight.driver.give(Look(Cell(0, 0), 15, UP_M))
    await flight.sees(ev.FrameSeen, 2)
    flight.pilot_mode(LOITER)
    await flight.sends_nothing(10.0)


@pytest.mark.parametrize("phase", [taking_off, flying, looking], ids=lambda f: f.__name__)
@by(fly)
async def test_pilot_takes_over_while_an_ack_is_awaited(flight, /, phase):
    """The commands are lost on the way: the driver would repeat them each second."""
    await phase(flight)
    flight.to_vehicle = lambda message: not message.get_type().startswith("COMMAND_")
    await asyncio.sleep(1.5)
    flight.pilot_mode(RTL)
    await flight.sends_nothing(10.0)


@by(fly)
async def test_mode_that_changes_quickly_is_reported_each_time(flight, /):
    await flying(flight)
    for _ in range(3):
        flight.pilot_mode(LOITER)
        flight.pilot_mode(GUIDED)
    await asyncio.sleep(0.2)
    kinds = [type(e) for e in flight.events if isinstance(e, ev.Overridden | ev.Released)]
    assert kinds == [ev.Overridden, ev.Released] * 3
    await flight.sends_nothing(5.0)  # no order was given since


@by(fly_up)
async def test_pilot_starting_from_the_ground_is_left_alone(flight, /):
    """Between two sorties the pilot switches the mode, then arms, and flies by hand."""
    await flight.after(Land(), ev.Landed)
    flight.pilot_mode(LOITER)
    await asyncio.sleep(2.0)
    await flight.sees(ev.Overridden, within_s=1.5)  # no vehicle takes off while a pilot has it
    flight.pilot(mav.MAV_CMD_COMPONENT_ARM_DISARM, 1)
    assert flight.vehicle.truth.armed
    assert not flight.seen(ev.Released)


@by(fly_up)
async def test_orders_of_a_ground_station_are_not_answered(flight, /):
    flight.driver.give(to(40.0, 0.0))
    for _ in range(20):  # the vehicle denies them, and acknowledges to their sender
        flight.pilot(mav.MAV_CMD_DO_REPOSITION, -1, 0, 0, 0, 0, 0, 20)
        flight.pilot(mav.MAV_CMD_NAV_TAKEOFF, 0, 0, 0, 0, 0, 0, 30)
        await asyncio.sleep(0.2)
    await flight.sees(ev.Arrived)
    assert not flight.seen(ev.OrderFailed)


# --- refusals --------------------------------------------------------------------------------
@by(fly)
async def test_vehicle_never_ready_fails_the_take_off(flight, /):
    flight.to_driver = lambda message: message.get_type() != "EKF_STATUS_REPORT"
    flight.session.view.ekf_flags = 0
    failed = await flight.after(TakeOff(UP_M), ev.OrderFailed, within_s=150.0)
    assert "not ready to arm within 120 s" in failed.reason
    arming = [m for _, m in flight.sent if getattr(m, "command", 0) == 400]
    assert arming == []


# --- the link --------------------------------------------------------------------------------
def silence(message):
    return False


@by(fly)
async def test_silent_vehicle_is_given_up_until_it_answers(flight, /):
    await flying(flight)
    flight.to_driver = flight.to_vehicle = silence
    await flight.sees(ev.LinkLost)
    flight.driver.give(StandDown())
    battery = flight.setting.mission.battery
    given_up = await flight.sees(ev.GivenUp, within_s=battery.endurance_s + 120.0)
    assert "longer than its battery can have lasted" in given_up.reason
    flight.to_driver = flight.to_vehicle = lambda message: True
    await flight.sees(ev.Connected, 2, within_s=20.0)


@by(fly)
async def test_silent_vehicle_on_the_ground_is_waited_for_two_minutes(flight, /):
    flight.to_driver = flight.to_vehicle = silence
    lost = await flight.sees(ev.LinkLost)
    given_up = await flight.sees(ev.GivenUp, within_s=200.0)
    assert given_up.t_s - lost.t_s == pytest.approx(115.0, abs=3.0)
    assert "on the ground" in given_up.reason


@by(on_virtual_time)
async def test_connect_without_an_answer_is_a_link_error():
    flight = Flight(small_mission())
    with pytest.raises(LinkError, match="no vehicle answered within 10 s"):
        await flight.driver.connect()
    assert flight.now_s() == pytest.approx(ANSWER_S)
    assert len(asyncio.all_tasks()) == 1


@by(on_virtual_time)
async def test_another_autopilot_is_refused_by_name():
    flight = Flight(small_mission())
    other = mav.MAVLink(None, srcSystem=1, srcComponent=1)
    flight.session.feed(heartbeat(autopilot=mav.MAV_AUTOPILOT_PPZ).pack(other))
    with pytest.raises(LinkError, match=r"MAV_AUTOPILOT 9.*flies ArduPilot and PX4"):
        await flight.driver.connect()


@by(on_virtual_time)
async def test_battery_that_reports_nothing_ends_the_connection_with_an_error():
    flight = Flight(small_mission())
    unknown = ("BATTERY_STATUS", "SYS_STATUS")
    flight.to_driver = lambda message: message.get_type() not in unknown
    async with asyncio.TaskGroup() as tasks:
        world = tasks.create_task(flight.fly_world())
        with pytest.raises(LinkError, match="battery"):
            async with asyncio.timeout(300.0):
                await flight.driver.connect()
        world.cancel()


@by(fly)
async def test_positions_that_cease_are_a_lost_link(flight, /):
    """Heartbeats alone: it restarted in the air and forgot the streams, or a router drops them."""
    await flying(flight)
    flight.to_driver = lambda message: message.get_type() != "GLOBAL_POSITION_INT"
    await flight.sees(ev.LinkLost, within_s=10.0)


@by(fly)
async def test_streams_forgotten_by_the_vehicle_are_requested_again(flight, /):
    await flying(flight)
    streams = flight.vehicle._streams
    for message_id in list(streams._interval_s):
        streams.set(message_id, None, 0.0)
    await flight.sees(ev.LinkLost, within_s=10.0)
    flight.driver.give(StandDown())
    await flight.sees(ev.Connected, 2, within_s=10.0)
    await flight.after(to(0.0, 0.0), ev.Arrived)


@pytest.mark.parametrize("caught_up", [False, True])
@by(fly, lambda caught_up: small_mission())
async def test_link_with_backlog_stays_lost(flight, /, caught_up):
    """A radio that buffers: an earlier version believed reports that were a minute old."""
    await flying(flight)
    deliver, held = flight._deliver, list[bytes]()
    flight._deliver = lambda data, later=False: held.append(data)
    await asyncio.sleep(60.0)
    assert len(flight.seen(ev.LinkLost)) == 1
    flight.driver.give(StandDown())
    await asyncio.sleep(5.0)
    sent, tracked = len(flight.sent), len(flight.seen(ev.Tracked))
    kept = len(held)
    for _ in range(1500):  # it delivers as much as it receives
        await asyncio.sleep(0.05)
        while len(held) > kept:
            deliver(held.pop(0))
    now_s = flight.now_s()
    assert flight.driver.view.silent_s(now_s) == pytest.approx(66.0, abs=3.0)
    flight.driver.guardian.take_over("rtl", "the mission has ended")
    await asyncio.sleep(5.0)
    assert {m.get_type() for m in flight.commands_after(sent)} == {"TIMESYNC"}
    assert len(flight.seen(ev.Connected)) == 1
    assert len(flight.seen(ev.Tracked)) == tracked
    assert not flight.seen(ev.GivenUp)
    flight._deliver = deliver
    if caught_up:
        deliver(b"".join(held))
    await flight.sees(ev.Connected, 2, within_s=5.0)
    assert flight.driver.view.silent_s(flight.now_s()) < 1.0


@by(fly)
async def test_clock_stood_still_vehicle_that_answers_is_connected(flight, /):
    """A simulator that was stopped sends the backlog of a radio that has kept it."""
    await flying(flight)
    step = flight.vehicle.step
    flight.vehicle.step = lambda passed_s: b""
    await flight.sees(ev.LinkLost)
    await asyncio.sleep(5.0)
    flight.vehicle.step = step
    await asyncio.sleep(0.5)
    assert flight.driver.view.gate.clock.late
    await flight.sees(ev.Connected, 2, within_s=5.0)
    assert flight.driver.view.silent_s(flight.now_s()) < 0.5


# --- pictures --------------------------------------------------------------------------------
@by(fly_up)
async def test_camera_that_stalls_is_reported_and_the_look_order_ends(flight, /):
    flight.to_driver = lambda message: message.get_type() != "CAMERA_IMAGE_CAPTURED"
    await flight.after(Look(Cell(0, 0), 5, UP_M), ev.LookEnded, within_s=300.0)
    assert len(flight.seen(ev.FrameLost)) == 5
    assert "none was announced" in flight.seen(ev.FrameLost)[0].reason
    assert not flight.seen(ev.FrameSeen)


@by(fly_up)
async def test_lost_announcement_is_requested_again(flight, /):
    heard = []

    def lossy(message):
        """Lose the second and the last announcement once."""
        if message.get_type() != "CAMERA_IMAGE_CAPTURED":
            return True
        heard.append(message.image_index)
        return message.image_index not in (1, 4) or heard.count(message.image_index) > 1

    flight.to_driver = lossy
    await flight.after(Look(Cell(0, 0), 5, UP_M), ev.LookEnded)
    assert len(flight.seen(ev.FrameSeen)) == 5
    assert not flight.seen(ev.FrameLost)


@pytest.mark.parametrize("part", [0.0, 0.5])
@by(fly_up)
async def test_corrupt_picture_is_a_lost_frame(flight, /, part):
    flight.change = lambda picture: picture[: int(len(picture) * part)]
    await flight.after(Look(Cell(0, 0), 3, UP_M), ev.LookEnded)
    assert len(flight.seen(ev.FrameLost)) == 3
    assert "not a readable picture" in flight.seen(ev.FrameLost)[0].reason
    flight.change = lambda picture: picture
    await flight.after(Look(Cell(0, 0), 3, UP_M), ev.LookEnded)
    assert len(flight.seen(ev.FrameSeen)) == 3


@by(fly_up)
async def test_camera_without_an_answer_loses_its_pictures(flight, /):
    flight.to_vehicle = lambda message: getattr(message, "command", 0) != 2000
    lost = await flight.after(Look(Cell(0, 0), 3, UP_M), ev.FrameLost)
    assert "the camera is silent" in lost.reason
    assert not flight.seen(ev.OrderFailed)


@by(fly_up)
async def test_wild_picture_number_is_not_requested_a_million_times(flight, /):
    camera = mav.MAVLink(None, srcSystem=1, srcComponent=100)
    flight.driver.give(Look(Cell(0, 0), 15, UP_M))
    await flight.sees(ev.FrameSeen, 1)
    index = len(flight.sent)
    wild = mav.MAVLink_camera_image_captured_message(
        0, 0, 0, 0, 0, 0, 0, [1, 0, 0, 0], 200_000, 1, b"sim://1/0.jpg"
    )
    flight.session.feed(wild.pack(camera))
    assert len(flight.sent) - index < 100


# --- who carries out orders ------------------------------------------------------------------
def test_driver_before_it_runs_refuses_orders():
    flight = Flight(small_mission())
    with pytest.raises(RuntimeError, match="only while it runs"):
        flight.driver.give(Hold())


@by(fly)
async def test_driver_sends_a_heartbeat_once_a_second(flight, /):
    await asyncio.sleep(30.0)
    beats = [t_s for t_s, m in flight.sent if m.get_type() == "HEARTBEAT"]
    assert len(beats) == pytest.approx(31, abs=2)


def test_report_that_fails_ends_the_driver():
    """The journal's disk is full: to continue without a journal would be worse."""

    class FullError(Exception):
        pass

    async def main():
        flight = Flight(small_mission())

        def report(event):
            if isinstance(event, ev.Tracked) and event.t_s > 20.0:
                raise FullError

        flight.report = report
        async with under_way(flight):
            await asyncio.sleep(60.0)

    with pytest.raises(ExceptionGroup) as caught:
        run(main(), VirtualClock())
    assert caught.group_contains(FullError)


@pytest.mark.parametrize("autopilot", BOTH)
@by(on_field, mission_of)
async def test_streams_with_a_refused_one_are_complete(field, /, autopilot):
    """An older PX4 has no CURRENT_MODE: all other streams return without a new request."""
    session = field.links[0].session
    rates = {**session.view.kind.streams, 12_900: 5.0}  # an identifier that no vehicle sends
    streams = Streams("sim", session, rates)
    await streams.ask(lambda: True)
    await asyncio.sleep(6.0)
    assert streams.go_on


@by(on_field, lambda: mission_of("ardupilot"))
async def test_heartbeat_of_ardupilot_is_received_at_5_hz(field, /):
    session, beats = field.links[0].session, []

    def collect(message):
        if message.get_type() == "HEARTBEAT" and message.get_srcComponent() == 1:
            beats.append(message)

    await Streams("sim", session).ask(lambda: True)
    session.listen(collect)
    await asyncio.sleep(4.0)
    assert len(beats) >= 18
