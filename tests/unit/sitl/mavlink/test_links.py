"""MAVLink 2 signing against pymavlink's own implementation as the client."""

from __future__ import annotations

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mav

from tests.unit.sitl.conftest import plain_vehicle

KEY = bytes(range(1, 33))
MINUTE = 6_000_000  # in units of 10 us
START = 3 * 365 * 1440 * MINUTE


class Signer:
    """A client with pymavlink's signing at one link of a vehicle."""

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

    def give(self, data):
        """The types of the messages that come back, each verified."""
        self.link.receive(data)
        return [m.get_type() for m in self.into.parse_buffer(self.link.take()) or []]

    def heard(self, data=None):
        return "COMMAND_ACK" in self.give(self.frame() if data is None else data)


@pytest.fixture
def vehicle():
    vehicle = plain_vehicle()
    vehicle.step(6.0)
    return vehicle


def set_up(link, key=KEY, timestamp=START, signer=None):
    message = mav.MAVLink_setup_signing_message(1, 1, list(key), timestamp)
    out = mav.MAVLink(None, 255, 190) if signer is None else signer.out
    link.receive(message.pack(out))
    link.take()


@pytest.fixture
def signed(vehicle):
    link = vehicle.connect()
    set_up(link)
    return link


def test_both_ends_agree(vehicle, signed):
    client = Signer(signed)
    assert client.heard()
    vehicle.step(2.0)
    messages = client.into.parse_buffer(signed.take())
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
        messages = client.into.parse_buffer(link.take())
        assert {m.get_link_id() for m in messages} == {link.link_id}


def test_unsigned_wrong_key_and_version_1_are_dropped(signed):
    assert not Signer(signed, key=None).heard()
    assert not Signer(signed, key=b"x" * 32).heard()
    client = Signer(signed)
    assert client.heard()
    client.out.signing.sign_outgoing = False
    assert not client.heard(client.frame(version_1=True))
    tampered = bytearray(Signer(signed, link_id=9).frame())
    tampered[-1] ^= 1
    assert not client.heard(bytes(tampered))


def test_a_replayed_frame_is_dropped(signed):
    client = Signer(signed)
    first, second = client.frame(), client.frame()
    assert client.heard(first)
    assert not client.heard(first)
    assert client.heard(second)
    assert not client.heard(first)


def test_a_wrong_signature_does_not_move_the_stream(signed):
    client = Signer(signed)
    assert client.heard()
    forged = bytearray(Signer(signed, key=b"x" * 32, timestamp=START + 9 * MINUTE).frame())
    assert not client.heard(bytes(forged))
    assert client.heard()


def test_a_new_stream_may_be_a_minute_behind(signed):
    assert Signer(signed, link_id=1, timestamp=START + MINUTE).heard()
    assert Signer(signed, link_id=2, timestamp=START + 1000).heard()
    assert not Signer(signed, link_id=3, timestamp=START - 1000).heard()
    # one frame dated an hour ahead locks out all later links
    assert Signer(signed, link_id=4, timestamp=START + 60 * MINUTE).heard()
    assert not Signer(signed, link_id=5, timestamp=START + 2 * MINUTE).heard()
    # but not the streams that were there before
    assert Signer(signed, link_id=1, timestamp=START + 2 * MINUTE).heard()


def test_streams_are_told_apart_by_system_and_link(signed):
    for system, link_id in ((255, 1), (255, 2), (254, 1)):
        assert Signer(signed, link_id=link_id, system=system).heard()
        assert not Signer(signed, link_id=link_id, system=system).heard()


def test_a_flood_of_streams_is_bounded(signed):
    heard = [Signer(signed, link_id=n).heard() for n in range(40)]
    assert heard == [True] * 16 + [False] * 24


def test_on_a_cable_unsigned_is_heard_and_answered_signed(vehicle, signed):
    cable = vehicle.connect(trusted=True)
    client = Signer(cable, key=None)
    assert client.heard()
    assert client.heard(client.frame(version_1=True))
    assert client.heard(Signer(cable, key=b"x" * 32).frame())
    vehicle.step(1.0)
    assert all(
        m.get_header().incompat_flags & 1 for m in mav.MAVLink(None).parse_buffer(cable.take())
    )


def test_set_up_only_while_disarmed_and_from_now_on_signed(vehicle):
    link = vehicle.connect()
    client = Signer(link, key=None)
    client.give(client.frame(mav.MAV_CMD_DO_SET_MODE, 1))
    message = mav.MAVLink_command_long_message(1, 1, mav.MAV_CMD_DO_SET_MODE, 0, 1, 4, *([0] * 5))
    client.give(message.pack(client.out))
    assert "COMMAND_ACK" in client.give(client.frame(mav.MAV_CMD_COMPONENT_ARM_DISARM, 1))
    assert vehicle.truth.armed
    set_up_text = client.give(
        mav.MAVLink_setup_signing_message(1, 1, list(KEY), START).pack(client.out)
    )
    assert set_up_text == ["STATUSTEXT"]
    assert client.heard()
    vehicle.step(15.0)  # disarms by itself
    link.take()
    assert not vehicle.truth.armed
    set_up(link)
    assert not client.heard()
    # for another vehicle, and for nobody without the key: nothing changes
    set_up(link, key=b"x" * 32)
    assert Signer(link).heard()


def test_the_key_stays_when_clients_come_and_go(vehicle, signed):
    vehicle.disconnect(signed)
    link = vehicle.connect()
    assert not Signer(link, key=None).heard()
    assert Signer(link, timestamp=START + 1000).heard()


def test_a_key_of_zeros_ends_it_with_the_time_zero_only(signed):
    client = Signer(signed)
    set_up(signed, key=bytes(32), signer=client)
    assert not Signer(signed, key=None).heard()
    zeros = Signer(signed, key=bytes(32), timestamp=START + 1000)
    assert zeros.heard()
    set_up(signed, key=bytes(32), timestamp=0, signer=zeros)
    plain = Signer(signed, key=None)
    assert plain.heard()
    set_up(signed, key=b"y" * 32)
    # a new key does not make old timestamps good
    assert not Signer(signed, key=b"y" * 32, timestamp=START - 2 * MINUTE).heard()
    assert Signer(signed, key=b"y" * 32, timestamp=START + MINUTE).heard()


def test_signing_meant_for_another_vehicle(vehicle):
    link = vehicle.connect()
    message = mav.MAVLink_setup_signing_message(2, 1, list(KEY), START)
    link.receive(message.pack(mav.MAVLink(None, 255, 190)))
    assert Signer(link, key=None).heard()
