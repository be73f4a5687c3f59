from __future__ import annotations

import asyncio
import itertools
import math
from collections import defaultdict

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mav

from missions.errors import LinkError
from missions.events import (
    Airborne,
    Arrived,
    BatterySwapped,
    Connected,
    FrameSeen,
    Guarded,
    Landed,
    LinkLost,
    LookEnded,
    OrderFailed,
    Overridden,
    Released,
)
from missions.geo.trajectory import rounded_path
from missions.orders import (
    AwaitBattery,
    FlyPath,
    FlyTo,
    Hold,
    Land,
    Look,
    ReturnToLaunch,
    Sweep,
    TakeOff,
)
from missions.units import Cell, GridPoint, LatLon
from sitl.copter.modes import Mode
from sitl.px4.modes import Px4Mode
from tests.conformance.rig import DRIVERS, by_each_driver, turned_to
from tests.support.flights import UP_M, to
from tests.unit.uavmap.mavlink.links.test_signing import KEY, Memory
from uavmap.journal.flight_plan import DRIVERS as OFFERED
from uavmap.mavlink.links.signing import Signing, ticks_now
from uavmap.runner.vehicles import STREAMED_SPEEDUP

# the mode that a pilot selects to take the vehicle, and the parameters that select it
HOLDS = {"ardupilot": (Mode.BRAKE, (int(Mode.BRAKE),)), "px4": (Px4Mode.RTL, (4, 5))}


def commands(flight, since=0):
    return [m.command for _, m in flight.sent[since:] if m.get_type().startswith("COMMAND_")]


def assert_not_flown(flight, since):
    harmless = {
        mav.MAV_CMD_IMAGE_STOP_CAPTURE, mav.MAV_CMD_REQUEST_MESSAGE,
        mav.MAV_CMD_SET_MESSAGE_INTERVAL,
    }  # fmt: skip
    assert [c for c in commands(flight, since) if c not in harmless] == []
    kinds = {m.get_type() for _, m in flight.sent[since:]}
    assert kinds <= {"HEARTBEAT", "COMMAND_LONG"}


async def take_over_while_it_waits(flight, autopilot):
    """Let a pilot take the vehicle while a target waits for its acknowledgement, which is lost."""
    mode, asked = HOLDS[autopilot]
    await flight.after(TakeOff(UP_M), Airborne)
    flight.to_driver = lambda message: message.get_type() != "COMMAND_ACK"
    before = len(flight.sent)
    flight.driver.give(to(20.0, 0.0))
    await flight.until(lambda: mav.MAV_CMD_DO_REPOSITION in commands(flight, before))
    await turned_to(flight, int(mode), *asked)


@by_each_driver()
async def test_every_order_ends_with_its_event(flight, autopilot):
    assert flight.seen(Connected)[0].airborne is False
    await flight.after(TakeOff(UP_M), Airborne)
    assert flight.vehicle.truth.height_m == pytest.approx(UP_M, abs=0.7)
    arrived = await flight.after(to(10.0, 10.0), Arrived)
    assert arrived.position.distance_to(GridPoint(10.0, 10.0)) < 0.8
    await flight.after(Sweep(GridPoint(10.0, 22.0), 4.0, UP_M), Arrived)
    assert len(flight.seen(FrameSeen)) >= 3
    await flight.after(FlyTo((), Cell(2, 4), stop=True, height_m=UP_M), Arrived)
    before = len(flight.seen(FrameSeen))
    await flight.after(Look(Cell(2, 4), 3, UP_M), LookEnded)
    looked = flight.seen(FrameSeen)[before:]
    assert [f.vantage for f in looked] == [Cell(2, 4)] * 3
    assert all(v.positive for f in looked for v in f.votes if v.cell == Cell(2, 4))
    await flight.after(to(0.0, 0.0), Arrived)
    await flight.after(Land(), Landed)
    await flight.after(AwaitBattery(), BatterySwapped)
    assert not flight.seen(OrderFailed)
    assert not flight.seen(Overridden)
    assert not flight.seen(LinkLost)
    assert flight.vehicle.truth.landed


@by_each_driver()
async def test_autopilot_commanded_rtl_returns_by_itself(flight, autopilot):
    await flight.after(TakeOff(UP_M), Airborne)
    await flight.after(to(12.0, 0.0), Arrived)
    await flight.after(ReturnToLaunch(), Landed)
    assert flight.driver.guardian.fate() == ""
    # and out again, from the mode in which it has landed
    await flight.after(TakeOff(UP_M), Airborne)
    await flight.after(Land(), Landed)
    assert not flight.seen(Overridden)
    assert flight.vehicle.truth.landed


@by_each_driver()
async def test_vehicle_that_refuses_rtl_is_commanded_to_land(flight, autopilot):
    await flight.after(TakeOff(UP_M), Airborne)
    for command in (mav.MAV_CMD_NAV_RETURN_TO_LAUNCH, mav.MAV_CMD_DO_SET_MODE):
        flight.vehicle.fail.reject(command, mav.MAV_RESULT_DENIED)
    await flight.after(ReturnToLaunch(), Landed)
    assert [guarded.action for guarded in flight.seen(Guarded)] == ["rtl", "land"]
    assert "denied" in flight.seen(Guarded)[-1].reason


@by_each_driver(speedup=STREAMED_SPEEDUP)
async def test_a_path_is_flown_without_a_halt(flight, autopilot):
    corners = [GridPoint(0, 0), GridPoint(24, 0), GridPoint(24, 24)]
    off_m = []
    if autopilot == "px4":  # a slow machine is not what is tested
        flight.vehicle._ap.parameters.preset("COM_OF_LOSS_T", 10.0)
    await flight.after(TakeOff(UP_M), Airborne)
    plan = rounded_path(corners, flight.now_s() + 2.0, speed_m_s=5.0, cut_m=2.5)
    flight.driver.give(FlyPath(plan, UP_M, 0.0, 0.5))
    while flight.now_s() < plan.end_s:
        await asyncio.sleep(0.2)
        place = flight.setting.grid.fixed(flight.vehicle.truth.position)
        off_m.append(place.distance_to(plan.at(flight.now_s()).place))
    await flight.sees(Arrived)
    flight.driver.give(Hold())
    await asyncio.sleep(2.0)
    assert not flight.seen(OrderFailed)
    assert not flight.seen(Overridden)
    assert len(flight.seen(FrameSeen)) > 5
    setpoints = [m for _, m in flight.sent if m.get_type() == "SET_POSITION_TARGET_GLOBAL_INT"]
    assert len(setpoints) > 60
    assert sorted(off_m)[len(off_m) // 2] < 2.5  # delays of the wire, not of a busy machine


@by_each_driver()
async def test_a_pilot_has_the_last_word(flight, autopilot):
    mode, asked = HOLDS[autopilot]
    await flight.after(TakeOff(UP_M), Airborne)
    flight.driver.give(to(60.0, 0.0))
    await flight.until(lambda: flight.session.view.ground_speed_m_s > 2.0)
    await turned_to(flight, int(mode), *asked)
    await flight.sees(Overridden)
    since = len(flight.sent)
    await asyncio.sleep(12.0)
    assert_not_flown(flight, since)
    assert flight.session.view.mode == int(mode)
    follows = flight.session.view.kind
    await turned_to(flight, follows.follows, *follows.follow_params[1:])
    await flight.sees(Released)


@by_each_driver()
async def test_a_command_that_is_waited_for_ends_with_its_order(flight, autopilot):
    """No acknowledgement arrives, and a pilot takes the vehicle: the order is not repeated."""
    await take_over_while_it_waits(flight, autopilot)
    await flight.sees(Overridden)
    since = len(flight.sent)
    await asyncio.sleep(30.0)
    assert_not_flown(flight, since)


@by_each_driver()
async def test_refused_target_is_reported_and_not_sent_again(flight, autopilot):
    await flight.after(TakeOff(UP_M), Airborne)
    flight.vehicle.fail.reject(mav.MAV_CMD_DO_REPOSITION, mav.MAV_RESULT_DENIED)
    before = len(flight.sent)
    failed = await flight.after(to(20.0, 0.0), OrderFailed)
    assert "MAV_CMD_DO_REPOSITION was refused: denied" in failed.reason
    assert commands(flight, before).count(mav.MAV_CMD_DO_REPOSITION) == 1


@by_each_driver()
async def test_refused_arming_is_reported_with_its_reason(flight, autopilot):
    flight.vehicle.fail.reject(mav.MAV_CMD_COMPONENT_ARM_DISARM, mav.MAV_RESULT_DENIED)
    failed = await flight.after(TakeOff(UP_M), OrderFailed)
    assert "denied" in failed.reason
    assert not flight.session.view.armed


@by_each_driver(autopilots=("ardupilot",))
async def test_a_silent_link_is_lost_and_found_again(flight, autopilot):
    await flight.after(TakeOff(UP_M), Airborne)
    flight.to_vehicle = flight.to_driver = _swallowed
    await flight.sees(LinkLost)
    flight.to_vehicle = flight.to_driver = _passed
    await flight.sees(Connected, 2)
    assert flight.seen(Connected)[-1].ours
    await flight.after(to(6.0, 0.0), Arrived)


@by_each_driver(autopilots=("ardupilot",))
async def test_flight_with_a_fifth_of_all_frames_lost_lands(flight, autopilot):
    """The second of every five frames of a kind is lost, so repeats of a command arrive."""
    numbers = defaultdict(itertools.count)
    flight.to_driver = flight.to_vehicle = lambda message: (
        next(numbers[message.get_type()]) % 5 != 1
    )
    await flight.after(TakeOff(UP_M), Airborne, within_s=400.0)
    await flight.after(to(10.0, 0.0), Arrived, within_s=400.0)
    await flight.after(Land(), Landed, within_s=400.0)
    assert not flight.seen(OrderFailed)
    assert not flight.seen(Overridden)


@by_each_driver(autopilots=("ardupilot",))
async def test_a_link_is_signed_in_both_directions(flight, autopilot):
    """With a key all frames are sent signed, and unsigned frames are ignored."""
    begun = []
    session, feed = flight.session, flight.session.feed
    others, parser = Signing(KEY, Memory(), ticks_now), mav.MAVLink(None)

    def signed(data):
        frames = [bytes(m.get_msgbuf()) for m in parser.parse_buffer(data) or ()]
        return feed(b"".join(map(others.sign, frames)))

    session.signing = Signing(KEY, Memory(), ticks_now)
    session.feed = signed  # type: ignore[method-assign]
    begun.append(len(flight.sent))
    await flight.after(TakeOff(UP_M), Airborne)
    await flight.after(to(6.0, 0.0), Arrived)
    session.feed = feed  # type: ignore[method-assign]
    await flight.sees(LinkLost)
    flags = {m.get_header().incompat_flags for _, m in flight.sent[begun[0] + 1 :]}
    assert flags == {mav.MAVLINK_IFLAG_SIGNED}


@by_each_driver(autopilots=("ardupilot",))
async def test_no_number_that_does_not_fit_is_sent(flight, autopilot):
    for bad_m in (math.nan, math.inf, 1e300):
        with pytest.raises(LinkError, match=r"cannot be sent|no place"):
            await flight.session.command_at(
                mav.MAV_CMD_DO_REPOSITION, 3, (-1.0, 0.0, 0.0, math.nan), LatLon(47.0, 8.0), bad_m
            )
    with pytest.raises(LinkError, match="cannot be sent"):
        flight.session.send(mav.MAVLink_command_ack_message(-1, 0))
    assert mav.MAV_CMD_DO_REPOSITION not in commands(flight)


def _swallowed(message):
    return False


def _passed(message):
    return True


def test_each_driver_that_can_be_asked_for_is_tested_here():
    assert tuple(OFFERED) == DRIVERS
