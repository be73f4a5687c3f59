"""Texts of a vehicle: joined, made printable, shown within limits; failsafes by name."""

import asyncio
import struct
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mav

from missions.events import CAUSE_NOT_REPORTED, AutopilotText, Overridden
from tests.support.flights import fly
from tests.support.mavlink_peer import Peer, heartbeat
from tests.support.running import by, on_virtual_time
from uavmap.aircraft.autopilot_texts import BURST, MAX_RECORDED, failsafe_of, may_be_a_failsafe
from uavmap.mavlink.autopilots import CurrentModeMessage, EventMessage
from uavmap.mavlink.status_texts import MAX_CHUNK_WAIT_S, MAX_OPEN, Texts, number_of

CRITICAL, WARNING, INFO, DEBUG = (
    mav.MAV_SEVERITY_CRITICAL, mav.MAV_SEVERITY_WARNING, mav.MAV_SEVERITY_INFO,
    mav.MAV_SEVERITY_DEBUG,
)  # fmt: skip


def statustext(words, severity=WARNING, number=0, chunk=0):
    return mav.MAVLink_statustext_message(severity, words, number, chunk)


# --- putting together --------------------------------------------------------------------------
def test_text_of_many_chunks_is_joined():
    words = b"PreArm: " + b"x" * 60 + b"y" * 60
    texts, lines = Texts(), []
    for k in range(0, len(words), 50):
        lines += texts.add(1, statustext(words[k : k + 50], number=9, chunk=k // 50), 0.001 * k)
    assert [text.words.encode() for text in lines] == [words]


def test_interleaved_chunks_of_texts_and_components_are_joined():
    texts, lines = Texts(), []
    for component, number, chunk, words in (
        (1, 3, 0, b"a" * 50), (1, 4, 0, b"b" * 50), (100, 3, 0, b"c" * 50),
        (100, 3, 1, b"!"), (1, 3, 1, b"?"), (1, 4, 1, b""),
    ):  # fmt: skip
        lines += texts.add(component, statustext(words, number=number, chunk=chunk), 0.0)
    assert [text.words for text in lines] == ["c" * 50 + "!", "a" * 50 + "?", "b" * 50]


def test_chunk_that_is_lost_leaves_a_gap():
    texts = Texts()
    texts.add(1, statustext(b"a" * 50, number=5, chunk=0), 0.0)
    assert texts.add(1, statustext(b"end", number=5, chunk=2), 0.1) == []
    assert texts.late(MAX_CHUNK_WAIT_S) == []
    (text,) = texts.late(MAX_CHUNK_WAIT_S + 0.2)
    assert text.words == "a" * 50 + "[...]end"
    texts.add(1, statustext(b"a" * 50, number=5, chunk=0), 10.0)
    assert [text.words for text in texts.late(20.0)] == ["a" * 50 + "[...]"]


def test_unfinished_texts_are_bounded():
    texts, said = Texts(), 0
    for number in range(1, 1000):
        said += len(texts.add(1, statustext(b"z" * 50, number=number, chunk=0), 0.0))
    assert said == 999 - MAX_OPEN
    assert texts.add(1, statustext(b"z", number=1, chunk=200), 0.0) == []


# --- told and kept -----------------------------------------------------------------------------
def feed_messages(flight, *messages):
    codec = mav.MAVLink(None, srcSystem=1, srcComponent=1)
    codec.seq = flight.session.losses._last[1, 1]  # the latest picture, which no other replaces
    for message in messages:
        flight.session.feed(message.pack(codec))


@by(fly)
async def test_texts_are_shown_with_severity_and_recorded(flight, /):
    feed_messages(flight, statustext(b"Compass not calibrated", WARNING), statustext(b"x", DEBUG))
    await asyncio.sleep(1.0)
    assert "[vehicle 1, warning] Compass not calibrated" in flight.lines
    told = [e for e in flight.seen(AutopilotText) if e.text in ("Compass not calibrated", "x")]
    assert [(e.severity, e.text) for e in told] == [(WARNING, "Compass not calibrated")]


@by(fly)
async def test_repeated_text_is_counted(flight, /):
    for _ in range(140):
        feed_messages(flight, statustext(b"PreArm: no"))
        await asyncio.sleep(1.0)
    kept = [event.times for event in flight.seen(AutopilotText) if event.text == "PreArm: no"]
    assert kept == [1, 60, 60]


@by(fly)
async def test_flood_of_texts_fills_neither_screen_nor_disk(flight, /):
    for k in range(2000):
        feed_messages(flight, statustext(f"flood {k}".encode(), k % 8))
    await asyncio.sleep(10.0)
    feed_messages(flight, statustext(b"after it", CRITICAL))
    kept = [event.text for event in flight.seen(AutopilotText)]
    assert len([text for text in kept if text.startswith("flood")]) == 2 * BURST
    assert kept[-1] == "after it"
    assert any("17" in line and "not shown" in line for line in flight.lines)
    assert len(kept) < MAX_RECORDED


# --- failsafes ---------------------------------------------------------------------------------
@pytest.mark.parametrize(
    ("words", "named"),
    [
        (["Battery 1 is low 9.90V used 31 mAh"], "battery failsafe: Battery 1 is low 9.90V"),
        (["Battery Failsafe"], "battery failsafe"),
        (["Fence Breached"], "fence breached"),
        (["GPS Glitch or Compass error"], "GPS glitch: GPS Glitch or Compass error"),
        (["EKF Failsafe: changed to LAND Mode"], "EKF failsafe"),
        (["Radio Failsafe - Continuing"], "radio failsafe"),
        (["GCS Failsafe"], "ground station failsafe: GCS Failsafe"),
        (["Vibration Failsafe"], "vibration failsafe"),
        (["Manual control lost"], "radio failsafe: Manual control lost"),
        (["Low battery level! Return advised"], "battery failsafe: Low battery"),
        (["Geofence exceeded"], "fence breached: Geofence exceeded"),
        (["Connection to ground control station lost"], "ground station failsafe"),
        (["Failsafe activated: switching to Return"], "failsafe: Failsafe activated"),
        (["EKF3 IMU0 MAG0 in-flight yaw alignment complete"], None),
        (["Mission: 3 WP"], None),
        (["GPS Glitch cleared"], None),
        (["Radio Failsafe Cleared"], None),
        ([], None),
    ],
)
def test_text_gives_the_name_of_the_failsafe(words, named):
    found = failsafe_of(words)
    assert (found or "").startswith(named or "")
    assert (found is None) == (named is None)


@pytest.mark.parametrize("mode", ["LOITER", "STABILIZE", "POSHOLD", "POSITION", "AUTO"])
def test_pilots_mode_is_no_failsafe(mode):
    assert not may_be_a_failsafe(mode)


def overridden(flight):
    (event,) = flight.seen(Overridden)
    assert isinstance(event, Overridden)
    return event


@by(fly)
async def test_failsafe_is_named_in_the_event(flight, /):
    feed_messages(flight, statustext(b"Battery 1 is low 9.90V", CRITICAL))
    feed_messages(flight, heartbeat(6, armed=True))
    await asyncio.sleep(0.2)
    assert overridden(flight).cause == "battery failsafe: Battery 1 is low 9.90V"


@by(fly)
async def test_cause_of_a_failsafe_may_come_after_the_mode(flight, /):
    feed_messages(flight, heartbeat(6, armed=True))
    await asyncio.sleep(0.3)
    feed_messages(flight, statustext(b"Fence Breached", CRITICAL))
    await asyncio.sleep(0.3)
    assert overridden(flight).cause is None
    assert [e.cause for e in flight.seen(AutopilotText) if e.cause] == ["fence breached"]


@pytest.mark.parametrize(("mode", "after_s"), [(5, 0.1), (6, 6.0)])
@by(fly)
async def test_pilot_and_old_texts_are_no_cause(flight, /, mode, after_s):
    feed_messages(flight, statustext(b"Battery 1 is low 9.90V", CRITICAL))
    await asyncio.sleep(after_s)
    feed_messages(flight, heartbeat(mode, armed=True))
    await asyncio.sleep(0.2)
    assert overridden(flight).cause is None


@by(fly)
async def test_critical_state_is_an_override_without_a_cause(flight, /):
    beat = heartbeat(9, armed=True)
    beat.system_status = mav.MAV_STATE_CRITICAL
    feed_messages(flight, beat)
    await asyncio.sleep(0.2)
    assert overridden(flight).cause == CAUSE_NOT_REPORTED


# --- who we are to it --------------------------------------------------------------------------
@pytest.mark.parametrize(
    ("autopilot", "onboard", "type_"),
    [
        (mav.MAV_AUTOPILOT_ARDUPILOTMEGA, False, mav.MAV_TYPE_ONBOARD_CONTROLLER),
        (mav.MAV_AUTOPILOT_PX4, False, mav.MAV_TYPE_GCS),
        (mav.MAV_AUTOPILOT_PX4, True, mav.MAV_TYPE_ONBOARD_CONTROLLER),
    ],
)
@by(on_virtual_time)
async def test_px4_counts_the_service_as_a_ground_station(autopilot, onboard, type_):
    peer = Peer()
    peer.session.onboard = onboard
    mode = 4 if autopilot == mav.MAV_AUTOPILOT_ARDUPILOTMEGA else 4 << 16 | 3 << 24
    peer.session.feed(peer.frame(heartbeat(mode, autopilot=autopilot)))
    peer.session.heartbeat()
    assert [message.type for _, message in peer.received] == [type_]


OFFBOARD, HOLD, RTL, ALTITUDE = 6 << 16, 4 << 16 | 3 << 24, 4 << 16 | 5 << 24, 2 << 16


def event(name, arguments=b"", levels=0x42):
    number = 1 << 24 | number_of(name)
    return EventMessage(number, 1234, 7, 0, 0, levels, list(arguments.ljust(40, b"\0")))


@pytest.mark.parametrize(("onboard", "garbled"), [(True, False), (True, True), (False, False)])
@by(on_virtual_time)
async def test_event_without_text_is_shown_by_number(onboard, garbled):
    peer, heard = Peer(), list[Any]()
    peer.session.onboard = onboard
    peer.session.view.on_text = heard.append
    peer.session.feed(peer.frame(px4(armed=True)))
    frame = bytearray(peer.frame(event("commander_other")))
    frame[-1] ^= garbled
    peer.session.feed(bytes(frame))
    peer.session.feed(peer.frame(px4()))
    found = [(text.severity, text.words[:6]) for text in heard]
    assert found == ([(CRITICAL, "event ")] if onboard and not garbled else [])
    assert peer.session.view.system_id == 1


def px4(mode=OFFBOARD, *, armed=True, failsafe=False):
    beat = heartbeat(mode, armed=armed, autopilot=mav.MAV_AUTOPILOT_PX4)
    beat.system_status = mav.MAV_STATE_CRITICAL if failsafe else mav.MAV_STATE_ACTIVE
    return beat


ENTER = "commander_failsafe_enter"


@pytest.mark.parametrize(
    ("name", "arguments", "words", "cause"),
    [
        (ENTER, struct.pack("<IBB", OFFBOARD, 6, 2),
         "Failsafe activated due to ground station connection lost, triggering RTL",
         "ground station failsafe"),
        (ENTER, struct.pack("<IBB", OFFBOARD, 6, 1),
         "Failsafe activated due to manual control lost, triggering RTL", "radio failsafe"),
        (f"{ENTER}_hold", struct.pack("<IBHB", HOLD, 7, 5, 4),
         "Failsafe activated due to critical battery level, triggering LAND in 5 s",
         "battery failsafe"),
        (f"{ENTER}_generic", struct.pack("<IB", OFFBOARD, 8),
         "Failsafe activated in OFFBOARD, triggering DESCEND", "failsafe"),
        (f"{ENTER}_generic_hold", struct.pack("<IBH", HOLD, 6, 5),
         "Failsafe activated in HOLD, triggering RTL in 5 s", "failsafe"),
        (f"{ENTER}_low_bat", b"", "Low battery level, return advised", "battery failsafe"),
        ("check_gf_violation_max_alt", b"\xff\x01", "Geofence violation: too high above home",
         "fence breached"),
    ],
)  # fmt: skip
@by(on_virtual_time)
async def test_event_of_failsafe_names_its_cause_on_every_link(name, arguments, words, cause):
    """A real PX4 sent only "Failsafe activated".

    An earlier version guessed the cause "battery failsafe: Preflight Fail: Battery unhealthy". The
    cause is an argument of the EVENT.
    """
    peer = Peer()
    peer.session.feed(peer.frame(px4()))
    peer.session.feed(peer.frame(statustext(b"Preflight Fail: Battery unhealthy", CRITICAL)))
    peer.session.feed(peer.frame(event(name, arguments)))
    peer.session.feed(peer.frame(statustext(b"Failsafe activated", CRITICAL)))
    said = peer.session.view.texts_since(0.0)
    assert words in said
    if name.startswith(ENTER) and arguments:
        assert (failsafe_of(said) or "") == f"{cause}: {words}"


@by(on_virtual_time)
async def test_current_mode_shows_mode_and_failsafe_between_heartbeats():
    """Heartbeats at 1 Hz may miss a failsafe.

    A real PX4 was in RTL by a failsafe for 1.0 s, then returned to OFFBOARD by itself.
    """
    peer = Peer()
    view = peer.session.view
    peer.session.feed(peer.frame(px4()))
    for mode, words in ((RTL, "RTL by a failsafe"), (OFFBOARD, "OFFBOARD"),
                        (ALTITUDE, "DESCEND by a failsafe")):  # fmt: skip
        peer.session.feed(peer.frame(CurrentModeMessage(mode, OFFBOARD, 0)))
        assert view.mode_name == words
    peer.session.feed(peer.frame(CurrentModeMessage(ALTITUDE, ALTITUDE, 0)))
    assert view.mode_name == "ALTITUDE"
    peer.session.feed(peer.frame(CurrentModeMessage(77_777, OFFBOARD, 0)))
    peer.session.feed(peer.frame(CurrentModeMessage(RTL, OFFBOARD, 0), component=100))
    assert view.mode_name == "ALTITUDE"


@by(on_virtual_time)
async def test_current_mode_without_a_failsafe_leaves_it_to_the_heartbeat():
    """A PX4 waits in HOLD for a failsafe (COM_FAIL_ACT_T) after a request for HOLD.

    It is then in the mode requested.
    """
    peer = Peer()
    view = peer.session.view
    peer.session.feed(peer.frame(px4(HOLD, failsafe=True)))
    peer.session.feed(peer.frame(CurrentModeMessage(HOLD, HOLD, 0)))
    assert view.mode_name == "HOLD by a failsafe"
    peer.session.feed(peer.frame(px4(OFFBOARD, failsafe=True)))
    assert view.mode_name == "OFFBOARD with a failsafe"  # it waits before it leaves the mode
    peer.session.feed(peer.frame(px4(HOLD)))
    peer.session.feed(peer.frame(CurrentModeMessage(HOLD, HOLD, 0)))
    assert view.mode_name == "HOLD"
