"""The key, the start and the radios of a member."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import pytest

from missions.errors import LinkError
from tests.support.small_missions import mission, square
from uavmap.fleet.fleet_radio import START, check_network, member_seal
from uavmap.fleet.sealing import fleet_key
from uavmap.journal.event_log import Journal
from uavmap.journal.flight_plan import FleetNetwork
from uavmap.load.mission_source import load
from uavmap.mavlink.links.key_file import new_key

PEER = "tcp/127.0.0.1:7447"
GROUP = "udp/224.0.0.224:7447#iface=lo"


def flown(**how: Any) -> Any:
    box, fence = square(-6.0, 12.0, 28.0, 16.0), square(-20.0, -14.0, 56.0, 62.0)
    pads = [(0.0, 0.0), (16.0, 0.0)]
    return mission(box, fence, vehicles=2, homes=pads, strategy="swath", **how)


def network(tmp_path: Path, **where: Any) -> FleetNetwork:
    file = tmp_path / "fleet.key"
    if not file.exists():
        new_key(file)
    return FleetNetwork(key_file=str(file), **where)


def test_what_facts_mean_is_in_the_key_and_what_they_do_not_is_not() -> None:
    secret, one = bytes(range(32)), flown()
    assert fleet_key(secret, one) == fleet_key(secret, flown(capacity_wh=90.0))
    others = [flown(drift_m_s=0.1), flown(frames=7), flown(altitude_m=13.0)]
    assert len({fleet_key(secret, each) for each in (one, *others)}) == 4
    assert fleet_key(bytes(32), one) != fleet_key(secret, one) != secret
    fleet_key(secret, load("bay"))  # whose search is as high as it may: no warning


def test_every_start_is_higher_than_those_before(tmp_path: Path) -> None:
    where, starts = network(tmp_path, peers=(PEER,)), []
    with Journal.create(tmp_path / "journal.jsonl", {}) as journal:
        for now_utc_s in (1000.0, 1000.5, 10.0, 5000.0):  # twice in a second; a clock set back
            seal = member_seal(where, flown(), 2, journal, lambda now_s=now_utc_s: now_s)
            assert journal.meta[START] == seal.start
            starts.append(seal.start)
    assert starts == [1000, 1001, 1002, 5000]
    assert seal.member == 2


def test_a_network_without_a_key_is_refused(tmp_path: Path) -> None:
    with pytest.raises(LinkError, match=r"--fleet-key FILE is missing.*uavmap keys new"):
        check_network(FleetNetwork(listen=(GROUP,)))
    with pytest.raises(LinkError, match="cannot be read"):
        check_network(FleetNetwork(listen=(GROUP,), key_file=str(tmp_path / "none")))
    check_network(FleetNetwork())  # alone
    check_network(None)


def test_a_router_stands_alone(tmp_path: Path) -> None:
    with pytest.raises(LinkError, match="leave out --peer"):
        check_network(network(tmp_path, peers=(PEER,), routers=(PEER,)))


def test_only_links_need_zenoh(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "zenoh", None)
    check_network(network(tmp_path, listen=(GROUP,)))
    with pytest.raises(LinkError, match=r"pip install .eclipse-zenoh>="):
        check_network(network(tmp_path, peers=(PEER,)))
