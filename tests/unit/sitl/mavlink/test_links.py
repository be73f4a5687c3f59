from __future__ import annotations

from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as mav

from sitl.codec import Cutter, Packer, cut
from sitl.faults.faults import LinkQuality
from sitl.mavlink.links import Lossy
from tests.unit.sitl.conftest import plain_vehicle

KEY = bytes(range(1, 33))
MINUTE = 6_000_000  # in units of 10 us
START = 3 * 365 * 1440 * MINUTE


class Signer:
    def __init__(self, link, key=KEY, link_id=7, timestamp=START, system=255):
        self.link = link
        self.out = mav.MAVLink(None, srcSystem=system, srcComponent=190)
        self.into = mav.MAVLink(None)
        if key is not None:
            for side in (self.out, self.into):
                side.signing.secret_key = key
                side.signing.link_id = link_id
                side.signing.timestamp = timestamp
            self.out.signing.sign_outgoing = True

    def frame(self, command=mav.MAV_CMD_REQUEST_MESSAGE, p1=148, version_1=False):
        message = mav.MAVLink_command_long_message(1, 1, command, 0, p1, *([0.0] * 6))
        return message.pack(self.out, force_mavlink1=version_1)

    def receive(self, data):
        self.link.receive(data)
        return [m.get_type() for m in self.into.parse_buffer(self.link.read()) or []]

    def is_accepted(self, data=None):
        return "COMMAND_ACK" in self.receive(self.frame() if data is None else data)


@pytest.fixture
def vehicle():
    vehicle = plain_vehicle()
    vehicle.step(6.0)
    return vehicle


def set_up(link, key=KEY, timestamp=START, signer=None):
    message = mav.MAVLink_setup_signing_message(1, 1, list(key), timestamp)
    out = mav.MAVLink(None, 255, 190) if signer is None else signer.out
    link.receive(message.pack(out))
    link.read()


@pytest.fixture
def signed(vehicle):
    link = vehicle.connect()
    set_up(link)
    return link


def test_both_ends_agree(vehicle, signed):
    client = Signer(signed)
    assert client.is_accepted()
    vehicle.step(2.0)
    messages = client.into.parse_buffer(signed.read())
    assert {m.get_type() for m in messages} >= {"HEARTBEAT"}
    assert all(m.get_signed() and m.get_link_id() == signed.link_id for m in messages)
    assert client.into.signing.badsig_count == client.into.signing.reject_count == 0


def test_each_link_signs_with_its_own_id(vehicle, signed):
    other = vehicle.connect()
    assert other.link_id != signed.link_id
    vehicle.step(1.0)
    # both streams come from the same system: without their own ids one would be a replay
    client = Signer(signed)
    for link in (signed, other):
        messages = client.into.parse_buffer(link.read())
        assert {m.get_link_id() for m in messages} == {link.link_id}


def test_unsigned_wrong_key_and_version_1_are_dropped(signed):
    assert not Signer(signed, key=None).is_accepted()
    assert not Signer(signed, key=b"x" * 32).is_accepted()
    client = Signer(signed)
    assert client.is_accepted()
    client.out.signing.sign_outgoing = False
    assert not client.is_accepted(client.frame(version_1=True))
    tampered = bytearray(Signer(signed, link_id=9).frame())
    tampered[-1] ^= 1
    assert not client.is_accepted(bytes(tampered))


def test_a_replayed_frame_is_dropped(signed):
    client = Signer(signed)
    first, second = client.frame(), client.frame()
    assert client.is_accepted(first)
    assert not client.is_accepted(first)
    assert client.is_accepted(second)
    assert not client.is_accepted(first)


def test_a_wrong_signature_does_not_move_the_stream(signed):
    client = Signer(signed)
    assert client.is_accepted()
    forged = bytearray(Signer(signed, key=b"x" * 32, timestamp=START + 9 * MINUTE).frame())
    assert not client.is_accepted(bytes(forged))
    assert client.is_accepted()


def test_a_new_stream_may_be_a_minute_behind(signed):
    assert Signer(signed, link_id=1, timestamp=START + MINUTE).is_accepted()
    assert Signer(signed, link_id=2, timestamp=START + 1000).is_accepted()
    assert not Signer(signed, link_id=3, timestamp=START - 1000).is_accepted()
    # one frame dated an hour ahead locks out all later links
    assert Signer(signed, link_id=4, timestamp=START + 60 * MINUTE).is_accepted()
    assert not Signer(signed, link_id=5, timestamp=START + 2 * MINUTE).is_accepted()
    # but not the streams that were there before
    assert Signer(signed, link_id=1, timestamp=START + 2 * MINUTE).is_accepted()


def test_streams_are_distinguished_by_system_and_link(signed):
    for system, link_id in ((255, 1), (255, 2), (254, 1)):
        assert Signer(signed, link_id=link_id, system=system).is_accepted()
        assert not Signer(signed, link_id=link_id, system=system).is_accepted()


def test_a_flood_of_streams_is_bounded(signed):
    accepted = [Signer(signed, link_id=n).is_accepted() for n in range(40)]
    assert accepted == [True] * 16 + [False] * 24


def test_unsigned_frame_on_a_cable_is_received_and_answered_signed(vehicle, signed):
    cable = vehicle.connect(trusted=True)
    client = Signer(cable, key=None)
    assert client.is_accepted()
    assert client.is_accepted(client.frame(version_1=True))
    assert client.is_accepted(Signer(cable, key=b"x" * 32).frame())
    vehicle.step(1.0)
    assert all(
        m.get_header().incompat_flags & 1 for m in mav.MAVLink(None).parse_buffer(cable.read())
    )


def test_key_is_set_up_only_while_disarmed_and_signs_from_then_on(vehicle):
    link = vehicle.connect()
    client = Signer(link, key=None)
    client.receive(client.frame(mav.MAV_CMD_DO_SET_MODE, 1))
    message = mav.MAVLink_command_long_message(1, 1, mav.MAV_CMD_DO_SET_MODE, 0, 1, 4, *([0] * 5))
    client.receive(message.pack(client.out))
    assert "COMMAND_ACK" in client.receive(client.frame(mav.MAV_CMD_COMPONENT_ARM_DISARM, 1))
    assert vehicle.truth.armed
    set_up_text = client.receive(
        mav.MAVLink_setup_signing_message(1, 1, list(KEY), START).pack(client.out)
    )
    assert set_up_text == ["STATUSTEXT"]
    assert client.is_accepted()
    vehicle.step(15.0)  # disarms by itself
    link.read()
    assert not vehicle.truth.armed
    set_up(link)
    assert not client.is_accepted()
    # for another vehicle, or without the key: nothing changes
    set_up(link, key=b"x" * 32)
    assert Signer(link).is_accepted()


def test_the_key_stays_when_clients_come_and_go(vehicle, signed):
    vehicle.disconnect(signed)
    link = vehicle.connect()
    assert not Signer(link, key=None).is_accepted()
    assert Signer(link, timestamp=START + 1000).is_accepted()


def test_a_key_of_zeros_ends_it_with_the_time_zero_only(signed):
    client = Signer(signed)
    set_up(signed, key=bytes(32), signer=client)
    assert not Signer(signed, key=None).is_accepted()
    zeros = Signer(signed, key=bytes(32), timestamp=START + 1000)
    assert zeros.is_accepted()
    set_up(signed, key=bytes(32), timestamp=0, signer=zeros)
    plain = Signer(signed, key=None)
    assert plain.is_accepted()
    set_up(signed, key=b"y" * 32)
    # a new key does not make old timestamps good
    assert not Signer(signed, key=b"y" * 32, timestamp=START - 2 * MINUTE).is_accepted()
    assert Signer(signed, key=b"y" * 32, timestamp=START + MINUTE).is_accepted()


def test_key_meant_for_another_vehicle_changes_nothing(vehicle):
    link = vehicle.connect()
    message = mav.MAVLink_setup_signing_message(2, 1, list(KEY), START)
    link.receive(message.pack(mav.MAVLink(None, 255, 190)))
    assert Signer(link, key=None).is_accepted()


# --- a bad radio -------------------------------------------------------------------------------

FRAMES = [bytes([n // 256, n % 256]) * 10 for n in range(2000)]


def through(quality, seed=1, frames=FRAMES):
    """Return all arrivals of a frame each 10 ms, with their times."""
    radio = Lossy([seed])
    arrived = []
    for tick in range(len(frames) + 2000):
        now_s = tick * 0.01
        if tick < len(frames):
            radio.put([frames[tick]], quality, now_s)
        arrived += [(now_s, frame) for frame in radio.due(now_s)]
    assert radio.idle
    return arrived


def test_a_clean_radio_changes_nothing():
    arrived = through(LinkQuality())
    assert [frame for _, frame in arrived] == FRAMES
    assert [now_s for now_s, _ in arrived] == pytest.approx([n * 0.01 for n in range(2000)])


@pytest.mark.parametrize("loss", [0.05, 0.2, 1.0])
def test_loss_is_the_share_asked_for(loss):
    left = len(through(LinkQuality(loss=loss)))
    assert left == pytest.approx(2000 * (1 - loss), abs=60)


def test_late_frames_keep_their_order_and_overtaken_ones_do_not():
    late = through(LinkQuality(delay_s=0.3, jitter_s=0.1))
    assert [frame for _, frame in late] == FRAMES
    delays = [now_s - n * 0.01 for n, (now_s, _) in enumerate(late)]
    assert min(delays) >= 0.3
    assert max(delays) <= 0.41
    assert max(delays) - min(delays) > 0.08
    mixed = [frame for _, frame in through(LinkQuality(reorder=0.1))]
    assert sorted(mixed) == FRAMES
    passed = sum(a > b for a, b in pairwise(mixed))
    assert 100 < passed < 300


def test_frames_are_doubled_and_garbled_as_asked_for():
    doubled = [frame for _, frame in through(LinkQuality(duplicate=0.1))]
    assert 2150 < len(doubled) < 2250
    assert sorted(set(doubled)) == FRAMES
    garbled = [frame for _, frame in through(LinkQuality(corrupt=0.1))]
    wrong = [(a, b) for a, b in zip(FRAMES, garbled, strict=True) if a != b]
    assert 150 < len(wrong) < 250
    assert all(sum(x != y for x, y in zip(a, b, strict=True)) == 1 for a, b in wrong)


def test_silent_radio_loses_frames_that_were_under_way():
    radio = Lossy([1])
    radio.put([b"a"], LinkQuality(delay_s=1.0), 0.0)
    radio.put([b"b"], LinkQuality(silent=True), 0.0)
    radio.drop()
    assert radio.idle
    assert radio.due(2.0) == []


def test_equal_seeds_give_equal_radios():
    bad = LinkQuality(0.2, 0.1, 0.1, 0.05, 0.1, 0.1)
    assert through(bad, seed=3) == through(bad, seed=3)
    assert through(bad, seed=3) != through(bad, seed=4)


@pytest.mark.parametrize(
    "wrong", [{"loss": 1.5}, {"corrupt": -0.1}, {"delay_s": float("nan")}, {"jitter_s": -1.0}]
)
def test_impossible_qualities_are_refused(wrong):
    with pytest.raises(ValueError, match="are 0 to"):
        LinkQuality(**wrong)


@given(st.binary(max_size=600), st.integers(1, 50))
def test_cutting_loses_no_byte(data, step):
    cutter = Cutter()
    pieces = [p for at in range(0, len(data), step) for p in cutter.feed(data[at : at + step])]
    joined = b"".join(pieces)
    assert data.startswith(joined)
    assert len(data) - len(joined) < 300


def test_cutting_finds_the_frames():
    packer = Packer(1, 1)
    frames = [packer.pack(mav.MAVLink_ping_message(n, n, 0, 0)) for n in range(5)]
    assert cut(b"".join(frames)) == frames
    cutter = Cutter()
    assert cutter.feed(b"noise" + b"".join(frames)) == [b"noise", *frames]
    assert cutter.empty
