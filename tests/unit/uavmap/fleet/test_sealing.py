"""Only fresh messages of holders of the key are accepted, and each once; the key of a member."""

from __future__ import annotations

import random
import sys
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from missions.errors import LinkError
from tests.support.small_missions import mission, square
from uavmap.fleet.fleet_radio import START, check_network, member_seal
from uavmap.fleet.sealing import ASKS, WINDOW, Seal, fleet_key
from uavmap.journal.event_log import Journal
from uavmap.journal.flight_plan import FleetNetwork
from uavmap.load.mission_source import load
from uavmap.mavlink.links.signing import new_key

KEY, OTHER = bytes(range(32)), bytes(range(1, 33))


def met(one: Seal, other: Seal) -> None:
    """Have two members prove to each other that they are active."""
    for _ in range(2):
        for speaker, listener in ((one, other), (other, one)):
            listener.opened(speaker.sealed(b"here"))
        for speaker, listener in ((one, other), (other, one)) * 2:
            for errand in speaker.errands():
                listener.opened(errand)


def pair() -> tuple[Seal, Seal]:
    one, other = Seal(KEY, 1, 1), Seal(KEY, 2, 1)
    met(one, other)
    return one, other


def test_members_that_have_met_open_each_others_datagrams():
    one, other = pair()
    assert other.opened(one.sealed(b"hello")) == (1, b"hello")
    assert one.opened(other.sealed(b"")) == (2, b"")


def test_ten_thousand_strange_datagrams_are_refused():
    one, other = pair()
    chance = random.Random(1)
    stranger = Seal(OTHER, 1, 1)
    good = one.sealed(b"a fact of ours")
    taken = 0
    for k in range(10_000):
        kind = k % 4
        if kind == 0:
            datagram = stranger.sealed(chance.randbytes(20))
        elif kind == 1:
            datagram = chance.randbytes(chance.randrange(60))
        elif kind == 2:
            damaged = bytearray(good)
            damaged[chance.randrange(len(damaged))] ^= 1 << chance.randrange(8)
            datagram = bytes(damaged)
        else:
            datagram = good[: chance.randrange(len(good))]
        taken += other.opened(datagram) is not None
    assert taken == 0
    assert other.refused["not sealed with our key"] == 10_000
    assert other.opened(good) == (1, b"a fact of ours")


def test_ten_thousand_replayed_datagrams_are_refused():
    one, other = pair()
    datagrams = [one.sealed(bytes([k % 256])) for k in range(500)]
    assert sum(other.opened(datagram) is not None for datagram in datagrams) == 500
    chance = random.Random(2)
    assert not any(other.opened(chance.choice(datagrams)) for _ in range(10_000))
    assert other.refused["received before"] == 10_000


def test_datagrams_of_an_earlier_flight_are_refused_after_a_start():
    one, other = Seal(KEY, 1, 5), Seal(KEY, 2, 5)
    recorded: list[bytes] = []
    for _ in range(3):
        for speaker, listener in ((one, other), (other, one)) * 2:
            for datagram in (speaker.sealed(b"old"), *speaker.errands()):
                recorded.append(datagram)
                listener.opened(datagram)
    new = Seal(KEY, 2, 1)  # its journal is gone, and its clock stands in the past
    for _ in range(20):
        assert not any(new.opened(datagram) for datagram in recorded)
        new.errands()
    assert new.refused["not known to be alive yet"] > 0


def test_restarted_member_is_accepted_and_its_earlier_start_refused():
    one, other = pair()
    late = one.sealed(b"from before")
    again = Seal(KEY, 1, 2)
    met(again, other)
    assert other.opened(again.sealed(b"now")) == (1, b"now")
    assert other.opened(late) is None
    assert other.refused["from an earlier start"] == 1


def test_second_member_with_the_same_number_is_reported():
    one, other = pair()
    twin = Seal(KEY, 1, 9)
    assert one.opened(twin.sealed(b"I am 1")) is None
    assert one.refused["from another with our number"] == 1
    assert one.opened(one.sealed(b"echo")) is None
    assert one.refused["from another with our number"] == 1
    assert other.opened(one.sealed(b"still 1")) == (1, b"still 1")


@settings(max_examples=100, deadline=None)
@given(st.lists(st.integers(0, 120), max_size=200))
def test_counter_is_accepted_once_in_any_order(order):
    one, other = pair()
    datagrams = [one.sealed(bytes([k])) for k in range(121)]
    taken: list[int] = []
    newest = -1
    for k in order:
        opened = other.opened(datagrams[k])
        fresh = k not in taken and newest - k <= WINDOW
        assert (opened is not None) == fresh, k
        if opened is not None:
            assert opened == (1, bytes([k]))
            taken.append(k)
            newest = max(newest, k)


def test_question_is_answered_once_and_is_no_fact():
    one, other = pair()
    question = one.sealed(bytes(8), ASKS)
    assert other.opened(question) is None
    assert len(other.errands()) == 1
    assert other.errands() == []


PEER = "tcp/127.0.0.1:7447"
GROUP = "udp/224.0.0.224:7447#iface=lo"


def fleet_mission(**how: Any) -> Any:
    box, fence = square(-6.0, 12.0, 28.0, 16.0), square(-20.0, -14.0, 56.0, 62.0)
    pads = [(0.0, 0.0), (16.0, 0.0)]
    return mission(box, fence, vehicles=2, homes=pads, strategy="swath", **how)


def network(tmp_path: Path, **where: Any) -> FleetNetwork:
    file = tmp_path / "fleet.key"
    if not file.exists():
        new_key(file)
    return FleetNetwork(key_file=str(file), **where)


def test_key_depends_on_the_meaning_of_facts_alone():
    secret, one = bytes(range(32)), fleet_mission()
    assert fleet_key(secret, one) == fleet_key(secret, fleet_mission(capacity_wh=90.0))
    others = [fleet_mission(drift_m_s=0.1), fleet_mission(frames=7), fleet_mission(altitude_m=13.0)]
    assert len({fleet_key(secret, each) for each in (one, *others)}) == 4
    assert fleet_key(bytes(32), one) != fleet_key(secret, one) != secret
    slick = load("slick")
    unclassed = slick.detector.model_copy(update={"classes": None})
    assert fleet_key(secret, slick) != fleet_key(
        secret, slick.model_copy(update={"detector": unclassed})
    )
    fleet_key(secret, load("bay"))  # whose search is at the highest allowed height: no warning


def test_start_number_rises_with_each_start(tmp_path):
    where, starts = network(tmp_path, peers=(PEER,)), []
    with Journal.create(tmp_path / "journal.jsonl", {}) as journal:
        for now_utc_s in (1000.0, 1000.5, 10.0, 5000.0):  # twice in a second; a clock set back
            seal = member_seal(where, fleet_mission(), 2, journal, lambda now_s=now_utc_s: now_s)
            assert journal.meta[START] == seal.start
            starts.append(seal.start)
    assert starts == [1000, 1001, 1002, 5000]
    assert seal.member == 2


def test_network_without_a_key_is_refused(tmp_path):
    with pytest.raises(LinkError, match=r"--fleet-key FILE is missing.*uavmap keys new"):
        check_network(FleetNetwork(listen=(GROUP,)))
    with pytest.raises(LinkError, match="cannot be read"):
        check_network(FleetNetwork(listen=(GROUP,), key_file=str(tmp_path / "none")))
    check_network(FleetNetwork())  # alone
    check_network(None)


def test_router_with_peers_is_refused(tmp_path):
    with pytest.raises(LinkError, match="leave out --peer"):
        check_network(network(tmp_path, peers=(PEER,), routers=(PEER,)))


def test_zenoh_is_needed_for_links_only(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "zenoh", None)
    check_network(network(tmp_path, listen=(GROUP,)))
    with pytest.raises(LinkError, match=r"pip install .eclipse-zenoh>="):
        check_network(network(tmp_path, peers=(PEER,)))
