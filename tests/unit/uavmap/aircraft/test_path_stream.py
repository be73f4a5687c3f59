"""Paths on the wire: setpoints as bytes, with their times, leads and modes, and their end."""

import asyncio
import contextlib
import itertools
import math
from dataclasses import replace

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mav

from missions.errors import CommandRefusedError, LinkError
from missions.geo.grid import Grid
from missions.geo.trajectory import rounded_path
from missions.orders import FlyPath
from missions.units import GridPoint, LatLon
from tests.support.mavlink_peer import Peer, ack, heartbeat, position
from tests.support.running import by
from uavmap.aircraft.control import MAX_MODE_AGE_S, Holder
from uavmap.aircraft.controlled_commands import ControlledCommands
from uavmap.aircraft.guardian.monitor import Monitor
from uavmap.aircraft.path_stream import (
    BRAKE_S,
    INTERVAL_S,
    PLACES_INTERVAL_S,
    PathStream,
    StreamTimeout,
)
from uavmap.aircraft.reporter import Reporter
from uavmap.base.clock import VirtualClock, run
from uavmap.mavlink.autopilots import ARDUPILOT, PX4

# far from the zone's meridian: grid north is 1.3 degrees off true north
GRID = Grid.at(LatLon(47.4, 10.8), 4.0)
AMSL_M = 488.0
HOLD, OFFBOARD = PX4.follows, PX4.stream_mode
SET_MODE = mav.MAV_CMD_DO_SET_MODE


class Wire:
    def __init__(self, *, px4=False, by_places=False):
        self.peer = Peer()
        session = self.peer.session
        self.reporter = Reporter(1, "sim", session.view, 60.0, GRID, self.now_s, self.now_s)
        self.monitor = Monitor(self.reporter)
        self.monitor.met = True
        session.listen(self.monitor.on_message)
        commands = ControlledCommands(session, self.monitor)
        self.stream = PathStream(commands, self.reporter, by_places=by_places)
        self.mode = 0
        self.autopilot = mav.MAV_AUTOPILOT_PX4 if px4 else mav.MAV_AUTOPILOT_ARDUPILOTMEGA
        self.report_mode(HOLD if px4 else 4)

    @staticmethod
    def now_s():
        return asyncio.get_running_loop().time()

    def report_mode(self, mode, speed_m_s=0.0):
        self.mode = mode
        here = GRID.position(GridPoint(0.0, 0.0))
        velocity = (round(100 * speed_m_s), 0, 0)
        place = position(here, t_s=self.now_s(), amsl_m=AMSL_M + 12.0, velocity=velocity)
        for message in (heartbeat(mode, armed=True, autopilot=self.autopilot), place):
            self.peer.session.feed(self.peer.frame(message))

    @contextlib.asynccontextmanager
    async def beating(self):
        """Send heartbeats in the vehicle's mode, five times a second."""

        async def beat():
            while True:
                beat = heartbeat(self.mode, armed=True, autopilot=self.autopilot)
                self.peer.session.feed(self.peer.frame(beat))
                await asyncio.sleep(0.2)

        task = asyncio.create_task(beat())
        yield
        task.cancel()

    def answers_twice(self, *, refused):
        """Have the PX4's receiver accept any mode, and its commander answer with the result."""
        self.peer.send(ack(SET_MODE, mav.MAV_RESULT_ACCEPTED))
        self.peer.send(ack(SET_MODE, mav.MAV_RESULT_TEMPORARILY_REJECTED * refused), after_s=0.02)

    def changes(self, mode, after_s):
        asyncio.get_running_loop().call_later(after_s, setattr, self, "mode", mode)

    def setpoints(self):
        kind = "SET_POSITION_TARGET_GLOBAL_INT"
        return [(t_s, m) for t_s, m in self.peer.received if m.get_type() == kind]


def run_virtually(body):
    run(body(), VirtualClock())


def plan(begin_s=1.0):
    corners = [GridPoint(0, 0), GridPoint(0, 60), GridPoint(30, 60)]
    return rounded_path(corners, begin_s, speed_m_s=6.0, cut_m=2.5)


def place_of(message):
    return GRID.fixed(LatLon(message.lat_int / 1e7, message.lon_int / 1e7))


@by(run_virtually)
async def test_stream_sends_places_and_velocities_ahead_ten_times_a_second():
    wire = Wire()
    wire.stream.begin(FlyPath(plan(), 12.0, 90.0, 0.2))
    streaming = asyncio.create_task(wire.stream.run())
    await asyncio.sleep(20.05)
    streaming.cancel()
    sent = wire.setpoints()
    gaps = [b - a for (a, _), (b, _) in itertools.pairwise(sent)]
    assert gaps == pytest.approx([INTERVAL_S] * 200, abs=1e-6)
    cos, sin = math.cos(GRID.convergence_rad), math.sin(GRID.convergence_rad)
    assert abs(sin) > 0.01
    for t_s, m in sent:
        assert (m.target_system, m.target_component) == (1, 1)
        assert (m.coordinate_frame, m.alt) == (mav.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT, 12.0)
        assert m.type_mask == 0x9C0
        assert m.yaw == pytest.approx(math.pi / 2)
        assert (m.vz, m.afx, m.afy, m.afz, m.yaw_rate) == (0.0,) * 5
        # smoothed over half a second: within a sixteenth of a t^2 of the plan
        assert place_of(m).distance_to(plan().at(t_s).place) < 0.06
        ahead = plan().at(t_s + 0.5)
        north = ahead.v_north_m_s * cos - ahead.v_east_m_s * sin
        east = ahead.v_east_m_s * cos + ahead.v_north_m_s * sin
        assert (m.vx, m.vy) == pytest.approx((north, east), abs=0.3)
    speeds = [math.hypot(m.vx, m.vy) for _, m in sent]
    assert max(speeds) == pytest.approx(6.0, abs=1e-3)
    # no step that an autopilot could not follow: the jerk of the velocity is bounded
    steps = [(b - a) / INTERVAL_S for a, b in itertools.pairwise(speeds)]
    assert max(abs(b - a) for a, b in itertools.pairwise(steps)) / INTERVAL_S < 9.0


@by(run_virtually)
async def test_path_that_replaces_another_leaves_no_gap_and_no_jump():
    wire = Wire()
    first = plan()
    wire.stream.begin(FlyPath(first, 12.0, None, 0.2))
    streaming = asyncio.create_task(wire.stream.run())
    await asyncio.sleep(6.0)
    begin_s = wire.now_s() + 1.0
    here = first.at(begin_s)
    corners = [here.place, GridPoint(0, 50), GridPoint(-40, 50)]
    second = rounded_path(
        corners, begin_s, speed_m_s=6.0, cut_m=2.5, begin_speed_m_s=here.v_north_m_s
    )
    wire.stream.go_on(FlyPath(second, 15.0, None, 0.2))
    await asyncio.sleep(12.0)
    streaming.cancel()
    sent = wire.setpoints()
    assert max(b - a for (a, _), (b, _) in itertools.pairwise(sent)) < 0.11
    for (_, a), (_, b) in itertools.pairwise(sent):
        assert place_of(a).distance_to(place_of(b)) < 0.62
        assert math.hypot(b.vx - a.vx, b.vy - a.vy) < 0.25  # 2.5 m/s2
    for t_s, m in sent:
        now = first if t_s < begin_s else second
        assert place_of(m).distance_to(now.at(t_s).place) < 0.1
        assert m.alt == (12.0 if t_s < begin_s else 15.0)
        assert m.type_mask == 0xDC0  # without a heading the autopilot chooses it
    moving = [math.hypot(m.vx, m.vy) for t_s, m in sent if 4.0 < t_s < second.end_s - 4.0]
    assert min(moving) > 3.0


def test_stream_depends_on_time_alone():
    """Missing or wrong telemetry changes no setpoint."""

    def sent(*, lies):
        frames = []

        async def body():
            wire = Wire()
            wire.stream.begin(FlyPath(plan(), 12.0, None, 0.2))
            streaming = asyncio.create_task(wire.stream.run())
            for _ in range(40):
                await asyncio.sleep(0.25)
                if lies:
                    wire.report_mode(4, speed_m_s=9.0)
            streaming.cancel()
            frames.extend(bytes(m.get_payload()) for _, m in wire.setpoints())

        run_virtually(body)
        return frames

    assert sent(lies=True) == sent(lies=False)


@by(run_virtually)
async def test_px4_sees_a_stream_first_and_then_changes_to_offboard():
    wire = Wire(px4=True)
    asked = []

    def answer(message):
        if getattr(message, "command", None) == SET_MODE:
            asked.append(wire.now_s())
            assert (message.param1, message.param2) == (1.0, 6.0)
            wire.answers_twice(refused=len(asked) == 1)
            if len(asked) == 2:
                wire.changes(OFFBOARD, after_s=0.4)

    wire.peer.answer = answer
    wire.stream.begin(FlyPath(plan(2.0), 12.0, None, 0.2))
    async with wire.beating():
        streaming = asyncio.create_task(wire.stream.run())
        await asyncio.sleep(8.0)
        streaming.cancel()
    assert len(asked) == 2
    assert 0.5 < asked[0] < 1.0
    before = [t_s for t_s, _ in wire.setpoints() if t_s < asked[0]]
    assert len(before) >= 5
    assert wire.monitor.mode == "follow"
    for t_s, m in wire.setpoints():
        assert m.coordinate_frame == mav.MAV_FRAME_GLOBAL_INT
        assert m.alt == pytest.approx(AMSL_M + 12.0)
        assert place_of(m).distance_to(plan(2.0).at(t_s + 0.2).place) < 0.06


@by(run_virtually)
async def test_px4_that_does_not_change_its_mode_ends_the_order():
    wire = Wire(px4=True)

    def answer(message):
        if getattr(message, "command", None) == SET_MODE:
            wire.answers_twice(refused=True)

    wire.peer.answer = answer
    wire.stream.begin(FlyPath(plan(), 12.0, None, 0.2))
    async with wire.beating():
        with pytest.raises(ExceptionGroup) as failed:
            await asyncio.wait_for(wire.stream.run(), 60.0)
    assert failed.group_contains(LinkError, match="does not change to OFFBOARD")
    assert wire.monitor.control.holder is Holder.OURS


@by(run_virtually)
async def test_px4_acknowledges_offboard_once_and_shows_hold_is_the_pilots():
    """Seen over a link that lost 40 %: the second acknowledgement was lost.

    Each report of OFFBOARD was lost as well. After 5.1 s an earlier version overrode the pilot's
    Hold.
    """
    wire = Wire(px4=True)
    wire.peer.answer = lambda message: (
        wire.peer.send(ack(SET_MODE, 0)) if getattr(message, "command", 0) == SET_MODE else None
    )
    wire.stream.begin(FlyPath(plan(), 12.0, None, 0.2))
    async with wire.beating():
        await asyncio.wait_for(wire.stream.run(), 60.0)
    assert wire.monitor.control.holder is Holder.PILOT
    assert [command for _, command, _ in wire.peer.commands()] == [SET_MODE]


@by(run_virtually)
async def test_mode_command_is_not_repeated_on_an_older_report():
    """In an earlier version another command delayed it, and copies followed each second."""
    wire, told_s = Wire(px4=True), []
    other = asyncio.create_task(wire.peer.session.command(mav.MAV_CMD_DO_CHANGE_SPEED))

    async def beat():
        while True:
            told_s.append(wire.now_s())
            wire.report_mode(HOLD)
            await asyncio.sleep(0.7)

    beating = asyncio.create_task(beat())
    wire.stream.begin(FlyPath(plan(), 12.0, None, 0.2))
    streaming = asyncio.create_task(wire.stream.run())
    await asyncio.sleep(12.0)
    for task in (other, beating, streaming):
        task.cancel()
    asked_s = [t_s for t_s, command, _ in wire.peer.commands() if command == SET_MODE]
    assert len(asked_s) >= 4
    for at_s in asked_s:
        assert at_s - max(t_s for t_s in told_s if t_s <= at_s) <= MAX_MODE_AGE_S


@by(run_virtually)
async def test_take_off_refused_keeps_the_earlier_mode_requested():
    wire = Wire(px4=True)
    wire.peer.answer = lambda message: (
        wire.peer.send(ack(message.command, mav.MAV_RESULT_DENIED))
        if getattr(message, "command", 0) == mav.MAV_CMD_NAV_TAKEOFF
        else None
    )
    async with wire.beating():
        with pytest.raises(CommandRefusedError):
            await wire.stream._commands.take_off(12.0, lambda: False)
        await asyncio.sleep(5.0)
    control = wire.monitor.control
    assert control.request is not None
    assert (control.holder, control.request.mode) == (Holder.OURS, HOLD)


# --- leaving -------------------------------------------------------------------------------------
@by(run_virtually)
async def test_ardupilot_is_braked_by_a_velocity_of_zero():
    wire = Wire()
    assert await wire.stream.leave() is False
    wire.stream.begin(FlyPath(plan(), 12.0, None, 0.2))
    wire.report_mode(4, speed_m_s=6.0)
    leaving = asyncio.create_task(wire.stream.leave())
    await asyncio.sleep(2.05)
    assert not leaving.done()
    wire.report_mode(4, speed_m_s=0.4)
    await asyncio.sleep(0.2)
    assert leaving.result() is True
    sent = wire.setpoints()
    assert len(sent) == 21
    for _, m in sent:
        assert (m.type_mask, m.vx, m.vy, m.vz) == (0xDC7, 0.0, 0.0, 0.0)
    assert await wire.stream.leave() is False


@pytest.mark.parametrize("mode", [4, 5])
@by(run_virtually)
async def test_braking_ends_in_time_and_sends_nothing_to_a_pilot(mode):
    wire = Wire()
    wire.stream.begin(FlyPath(plan(), 12.0, None, 0.2))
    wire.report_mode(mode, speed_m_s=6.0)
    begin_s = wire.now_s()
    await wire.stream.leave()
    took_s = wire.now_s() - begin_s
    assert took_s == pytest.approx(BRAKE_S if mode == 4 else 0.0, abs=0.11)
    assert len(wire.setpoints()) in ((60, 61) if mode == 4 else (0,))


@by(run_virtually)
async def test_px4_returns_to_hold_while_the_stream_continues():
    wire = Wire(px4=True)
    wire.monitor.control = wire.monitor.control.with_request(OFFBOARD, wire.now_s())
    wire.report_mode(OFFBOARD, speed_m_s=6.0)

    def answer(message):
        if getattr(message, "command", None) == SET_MODE:
            assert (message.param2, message.param3) == (4.0, 3.0)
            wire.peer.send(ack(SET_MODE, 0))
            wire.changes(HOLD, after_s=0.85)

    wire.peer.answer = answer
    wire.stream.begin(FlyPath(plan(), 12.0, None, 0.2))
    async with wire.beating():
        assert await wire.stream.leave() is True
    assert len(wire.setpoints()) == 11


# --- the parameter -------------------------------------------------------------------------------
def value(name, number):
    return mav.MAVLink_param_value_message(name.encode(), number, 9, 1, 0)


class Keeper:
    """A vehicle with one parameter, over a link that loses every other message."""

    def __init__(self, number, *, lossy=False, stubborn=False):
        self.wire = Wire()
        self.number, self.told = number, []
        self.timeout = StreamTimeout("sim", self.wire.peer.session, self.told.append)
        self._lossy, self._stubborn, self._heard = lossy, stubborn, 0
        self.wire.peer.answer = self._answer

    def _answer(self, message):
        if not message.get_type().startswith("PARAM_"):
            return
        assert message.param_id == "GUID_TIMEOUT"
        self._heard += 1
        if message.get_type() == "PARAM_SET" and not self._stubborn:
            self.number = message.param_value
        if not (self._lossy and self._heard % 2):
            self.wire.peer.send(value("SERIAL0_BAUD", 57.0), value("GUID_TIMEOUT", self.number))


@pytest.mark.parametrize("lossy", [False, True])
@by(run_virtually)
async def test_timeout_is_shortened_once_for_the_flight(lossy):
    keeper = Keeper(3.0, lossy=lossy)
    await keeper.timeout.shorten()
    assert keeper.number == 1.0
    heard = len(keeper.wire.peer.received)
    await keeper.timeout.shorten()
    assert len(keeper.wire.peer.received) == heard
    assert not keeper.told


@pytest.mark.parametrize(("found", "flown_with"), [(0.5, 0.5), (0.8, 0.8), (0.1, 1.0), (0.0, 1.0)])
@by(run_virtually)
async def test_timeout_short_enough_is_left_alone(found, flown_with):
    keeper = Keeper(found)
    await keeper.timeout.shorten()
    assert keeper.number == pytest.approx(flown_with)


@by(run_virtually)
async def test_timeout_that_cannot_be_set_is_reported_once_and_is_no_failure():
    keeper = Keeper(3.0, stubborn=True)
    await keeper.timeout.shorten()
    await keeper.timeout.shorten()
    assert len(keeper.told) == 1
    assert "GUID_TIMEOUT could not be set" in keeper.told[0]
    mute = Keeper(3.0)
    mute.wire.peer.answer = lambda message: None
    await mute.timeout.shorten()
    await mute.timeout.shorten()
    assert len(mute.told) == 1
    assert "does not report its GUID_TIMEOUT" in mute.told[0]


@by(run_virtually)
async def test_px4_keeps_its_parameters():
    wire = Wire(px4=True)
    timeout = StreamTimeout("sim", wire.peer.session, lambda text: None)
    await timeout.shorten()
    assert not wire.peer.received


@by(run_virtually)
async def test_impossible_place_is_not_sent():
    wire = Wire()
    lost = replace(plan(), drift_m_s=(math.nan, 0.0))
    wire.stream.begin(FlyPath(lost, 12.0, None, 0.2))
    with pytest.raises(LinkError, match="no place"):
        await wire.stream.run()


# --- on a fast clock -----------------------------------------------------------------------------
@pytest.mark.parametrize("px4", [False, True])
@by(run_virtually)
async def test_driver_without_a_stream_sends_places_ahead(px4):
    """A vehicle stops at the last of these places by itself: no velocity continues."""
    wire = Wire(px4=px4, by_places=True)
    wire.stream.begin(FlyPath(plan(), 12.0, 90.0, 0.2))
    telling = asyncio.create_task(wire.stream.run())
    await asyncio.sleep(10.0)
    telling.cancel()
    if px4:
        places = [
            (t_s, GRID.fixed(LatLon(m.x / 1e7, m.y / 1e7)))
            for t_s, m in wire.peer.received
            if m.get_type() == "COMMAND_INT"
            and m.command == mav.MAV_CMD_DO_REPOSITION
            and m.param4 == pytest.approx(math.pi / 2)
        ]
        assert not wire.setpoints()
    else:
        places = [(t_s, place_of(m)) for t_s, m in wire.setpoints()]
        assert {m.type_mask for _, m in wire.setpoints()} == {0x9F8}
    assert len(places) == 10.0 / PLACES_INTERVAL_S
    lead_s = (PX4 if px4 else ARDUPILOT).places_lead_s
    for t_s, place in places:
        assert place.distance_to(plan().at(t_s + lead_s).place) < 0.05
    modes = [m for _, m in wire.peer.received if getattr(m, "command", 0) == SET_MODE]
    assert not modes
    assert await wire.stream.leave()
    assert not await wire.stream.leave()
