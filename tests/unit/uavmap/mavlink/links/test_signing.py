"""Signing: only holders of the key are believed, also after a restart and if a clock jumps."""

import asyncio
import os
import random

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mav

from missions.errors import LinkError
from tests.support.field import mission_of, on_field
from tests.support.mavlink_peer import heartbeat
from tests.support.running import by, on_virtual_time
from uavmap.base.clock import VirtualClock, run
from uavmap.mavlink.identity import wait_for_autopilot
from uavmap.mavlink.links import signing as signing_module
from uavmap.mavlink.links.signing import (
    BESIDE,
    NEW_STREAM_BEHIND,
    REPLAYED,
    TICKS_PER_S,
    UNSIGNED,
    WRONG_KEY,
    KeptTimestamps,
    Signing,
    new_key,
    read_key,
    signing_with,
)
from uavmap.mavlink.session import Session
from uavmap.ui.cli.commands.keys import install_key, remove_key

KEY, OTHER = bytes(range(32)), bytes(range(1, 33))
NOW = 40_000_000_000_000


class Memory:
    def __init__(self):
        self.sent = 0
        self.received = {}

    def note(self):
        pass


def signing(key=KEY, now=NOW):
    return Signing(key, Memory(), lambda: now)


def beat(system=1, mode=4):
    return bytes(heartbeat(mode).pack(mav.MAVLink(None, srcSystem=system, srcComponent=1)))


# --- signatures --------------------------------------------------------------------------------
def test_pymavlink_and_session_accept_each_others_signatures():
    """pymavlink signs as a ground station does."""
    theirs = mav.MAVLink(None, srcSystem=1, srcComponent=1)
    theirs.signing.secret_key, theirs.signing.timestamp = KEY, NOW
    theirs.signing.sign_outgoing = True
    frame = bytes(heartbeat().pack(theirs))
    ours = signing()
    assert ours.fault(frame) is None
    (message,) = theirs.parse_buffer(ours.sign(beat(system=245)))
    assert message.get_signed()
    assert message.get_type() == "HEARTBEAT"


def test_ten_thousand_forged_frames_are_refused():
    """Frames that are unsigned, garbled, replayed, or signed with another key."""
    rng = random.Random(1)
    vehicle, forger, ours = signing(), signing(OTHER), signing()
    heard = []
    recorded = [vehicle.sign(beat()) for _ in range(100)]
    fine = vehicle.sign(beat())

    async def body():
        session = Session(lambda frame: None, lambda frame: None)
        session.signing = ours
        session.listen(lambda message: heard.append(message.get_type()))
        for frame in (*recorded, fine):
            session.feed(frame)
        taken = len(heard)
        assert taken == 101
        for k in range(10_000):
            garbled = bytearray(vehicle.sign(beat()))
            garbled[-rng.randrange(1, 14)] ^= 1 << rng.randrange(8)
            forged = (
                beat(mode=9),
                forger.sign(beat(mode=9)),
                rng.choice(recorded),
                bytes(garbled),
            )[k % 4]
            session.feed(forged)
        assert len(heard) == taken
        session.feed(vehicle.sign(beat()))
        assert len(heard) == taken + 1
        return session

    session = run(body(), VirtualClock())
    refused = {reason: n for (kind, reason), n in session.view.gate.refused.items()}
    assert refused == {UNSIGNED: 2500, WRONG_KEY: 5000, REPLAYED: 2500}
    assert session.view.mode == 4


@by(on_virtual_time)
async def test_refused_signature_is_reported_once():
    lines = []
    session = Session(lambda frame: None, lambda frame: None)
    session.signing, session.view.gate.say = signing(), lines.append
    for _ in range(50):
        session.feed(beat())
    assert lines == ["frames refused: not signed; further ones are counted, and not logged"]


def test_stream_may_begin_a_minute_ago_and_not_earlier():
    ours = signing()
    ours.next_tick()
    assert signing(now=NOW - NEW_STREAM_BEHIND - 5).sign(beat(2)) != b""
    assert ours.fault(signing(now=NOW - NEW_STREAM_BEHIND - 5).sign(beat(2))) == REPLAYED
    assert ours.fault(signing(now=NOW - NEW_STREAM_BEHIND + 5).sign(beat(2))) is None


def test_frames_of_another_dialect_and_of_version_1_are_not_signed():
    old = bytes(
        heartbeat().pack(mav.MAVLink(None, srcSystem=1, srcComponent=1), force_mavlink1=True)
    )
    assert signing().fault(old) == UNSIGNED
    assert signing().fault(b"\xfd\x00\x01") == UNSIGNED


# --- time --------------------------------------------------------------------------------------
def test_timestamps_rise_with_any_change_of_the_clock(monkeypatch):
    memory, clock = Memory(), [NOW]
    ours = Signing(KEY, memory, lambda: clock[0])
    ticks = []
    for jump in (0, 0, 5, -(10**9), -3, 10**6, 0):
        clock[0] += jump
        ticks.append(ours.next_tick())
    assert ticks == sorted(set(ticks))
    monkeypatch.setattr(signing_module.time, "time", lambda: 1420070401.5)
    assert signing_module.ticks_now() == 1.5 * TICKS_PER_S


@pytest.mark.parametrize("clean", [True, False], ids=["closed", "killed"])
def test_timestamps_survive_restart_and_clock_jump(tmp_path, clean):
    path = tmp_path / "key"
    new_key(path)
    kept = KeptTimestamps(path)
    first = Signing(read_key(path), kept, lambda: NOW)
    vehicle = Signing(read_key(path), Memory(), lambda: NOW)
    frames = [vehicle.sign(beat()) for _ in range(10)]
    assert [first.fault(frame) for frame in frames] == [None] * 10
    used = [first.next_tick() for _ in range(1000)]
    kept.save() if not clean else kept.close()
    again = Signing(read_key(path), KeptTimestamps(path), lambda: NOW - 10**9)
    assert again.next_tick() > max(used)
    assert {again.fault(frame) for frame in frames} == {REPLAYED}
    assert again.fault(vehicle.sign(beat())) is None


# --- the file ----------------------------------------------------------------------------------
def test_key_file_is_readable_by_its_owner_only(tmp_path):
    path = tmp_path / "key"
    new_key(path)
    assert path.stat().st_mode & 0o777 == 0o600
    assert len(read_key(path)) == 32
    with pytest.raises(LinkError, match="exists already"):
        new_key(path)
    for mode in (0o640, 0o604, 0o620, 0o644):
        path.chmod(mode)
        with pytest.raises(LinkError, match="chmod 600"):
            read_key(path)


@pytest.mark.parametrize("text", ["", "00" * 32, "ab" * 31, "ab" * 33, "zz" * 32, "ab" * 5000])
def test_invalid_key_is_refused_without_showing_it(tmp_path, text):
    path = tmp_path / "key"
    path.write_text(text)
    path.chmod(0o600)
    with pytest.raises(LinkError, match="holds no key") as refused:
        read_key(path)
    assert not text or text not in str(refused.value)


def test_missing_key_and_damaged_timestamps_are_link_errors(tmp_path):
    path = tmp_path / "key"
    with pytest.raises(LinkError, match="uavmap keys new"):
        read_key(path)
    new_key(path)
    path.with_name(path.name + BESIDE).write_text("{")
    with pytest.raises(LinkError, match="damaged"), signing_with(str(path)):
        pass


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write anywhere")
def test_timestamps_that_cannot_be_kept_are_a_link_error(tmp_path):
    path = tmp_path / "key"
    new_key(path)
    tmp_path.chmod(0o500)
    with pytest.raises(LinkError, match="put the key where you may write"):
        KeptTimestamps(path)


def test_key_is_in_no_repr():
    assert KEY.hex() not in repr(signing())
    assert repr(signing()) == "Signing(...)"


# --- a vehicle ---------------------------------------------------------------------------------
@by(on_field, lambda: mission_of("ardupilot"))
async def test_key_removed_vehicle_sends_and_accepts_unsigned_frames(field, /):
    """A real ArduCopter 4.6.2 kept a key of zeros as its key where the time was not 0.

    It signed with it, and refused the owner's frames.
    """
    session, vehicle, ours = field.links[0].session, field.vehicles[0], signing()
    await install_key(session, ours, "udp")
    beat = mav.MAVLink_heartbeat_message(mav.MAV_TYPE_CAMERA, mav.MAV_AUTOPILOT_INVALID, 0, 0, 4, 3)
    camera = beat.pack(mav.MAVLink(None, srcSystem=1, srcComponent=100))
    asyncio.get_running_loop().call_later(1.0, session.feed, camera)
    with pytest.raises(LinkError, match="still signs"):
        await remove_key(session, signing(OTHER), "udp")
    ours.next_tick()
    await remove_key(session, ours, "udp")
    assert not vehicle.step(2.0)[2] & mav.MAVLINK_IFLAG_SIGNED
    assert field.parameter(0, "RTL_ALT") > 0.0


@pytest.mark.parametrize(("key", "words"), [(OTHER, WRONG_KEY), (None, UNSIGNED)])
@by(on_virtual_time)
async def test_wrong_key_line_names_refused_signatures(key, words):
    """To `doctor --key OTHER` a real vehicle seemed to be switched off."""
    session = Session(lambda frame: None, lambda frame: None)
    session.signing = signing()
    for _ in range(7):
        session.feed(beat() if key is None else signing(key).sign(beat()))
    with pytest.raises(LinkError, match=r"7 frames were refused for their signature") as silent:
        await wait_for_autopilot(session, "udp")
    assert words in str(silent.value)
    assert "switched on" not in str(silent.value)
