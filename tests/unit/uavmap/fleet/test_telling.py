"""What is told of facts: each once, and again where it was lost, and only that."""

from __future__ import annotations

import asyncio
from collections import Counter
from dataclasses import dataclass, field

import pytest

from missions.fleet_events import Fact
from missions.units import Cell, GridPoint
from tests.unit.uavmap.fleet.test_members_in_air import KEY, made
from uavmap.base.clock import VirtualClock, run
from uavmap.fleet.codec import Batch, Message, encode
from uavmap.fleet.knowledge import Holding, Knowledge
from uavmap.fleet.member import Member
from uavmap.fleet.peer import RELAY_S, Peer, Telling
from uavmap.fleet.sealing import Seal
from uavmap.fleet.simulated_radio import Air, LinkModel

ROOM = 900
FACTS = 200
SLOWEST_S = 30.0
ALL_BELIEVED_S = 20.0
"""By then each has proven to all that it is alive."""


def fact(k: int) -> Fact:
    return Fact(float(k), ((Cell(k, 0), True),))


def facts(first: int, end: int) -> list[Fact]:
    return [fact(k) for k in range(first, end)]


def told(batches: tuple[Batch, ...]) -> list[tuple[int, int]]:
    return [(b.origin, b.first + k) for b in batches for k in range(len(b.facts))]


def size(batches: tuple[Batch, ...]) -> int:
    return len(encode(Message(0.0, batches=batches))) - len(encode(Message(0.0)))


def test_what_is_on_its_way_is_not_told_again_and_what_was_lost_is() -> None:
    peer, known = Peer(0.0), Knowledge()
    telling = Telling(1, {2: peer})
    known.take(1, 0, facts(0, 6))
    assert told(telling.batches(known, 10.0, ROOM)) == [(1, k) for k in range(6)]
    peer.have, peer.have_s = {}, 10.5  # said before it could have come
    assert not telling.batches(known, 12.0, ROOM)
    peer.have, peer.have_s = {1: Holding(1, ((3, 4), (5, 6)))}, 13.0
    known.take(1, 6, facts(6, 8))
    again = telling.batches(known, 14.0, ROOM)
    assert told(again) == [(1, 1), (1, 2), (1, 4), (1, 6), (1, 7)]


def test_what_was_lost_takes_half_of_the_room_while_there_is_news() -> None:
    """Somebody who hears nothing of us would else have it all."""
    peer, known = Peer(0.0), Knowledge()
    telling = Telling(1, {2: peer})
    known.take(1, 0, facts(0, 60))
    telling.batches(known, 1.0, 10_000)
    peer.have_s = 5.0
    known.take(1, 60, facts(60, 120))
    said = telling.batches(known, 6.0, 200)
    numbers = {number for _, number in told(said)}
    assert size(said) <= 200
    assert 60 in numbers
    assert 0 in numbers
    assert telling.batches(known, 6.0, 0) == ()


def test_others_facts_are_told_to_who_has_heard_nothing_of_them_for_long() -> None:
    peer, known = Peer(0.0), Knowledge()
    telling = Telling(1, {2: peer})
    known.take(3, 0, facts(0, 4))
    peer.have, peer.have_s, peer.lacks_since_s = {3: Holding(1)}, 20.0, {3: 20.0}
    assert not telling.batches(known, 20.0 + RELAY_S - 0.1, ROOM)
    assert told(telling.batches(known, 20.0 + RELAY_S, ROOM)) == [(3, 1), (3, 2), (3, 3)]
    peer.apart = True
    assert not telling.batches(known, 60.0, ROOM)


def test_who_starts_anew_tells_only_what_somebody_lacks() -> None:
    peer, known = Peer(0.0), Knowledge()
    peer.have, peer.have_s = {1: Holding(5)}, 3.0
    known.take(1, 0, facts(0, 7))
    assert told(Telling(1, {2: peer}).batches(known, 4.0, ROOM)) == [(1, 5), (1, 6)]


@dataclass(slots=True)
class Talk:
    """Members that each find a fact a second, and when each has heard of which."""

    members: list[Member]
    late_s: list[float] = field(default_factory=list)
    known: Counter[tuple[int, int]] = field(default_factory=Counter)

    def look(self, now_s: float) -> None:
        for ours in self.members:
            for origin in range(1, len(self.members) + 1):
                have = ours.knowledge.facts.get(origin, {})
                before = self.known[ours._number, origin]
                news = (have[k].t_s for k in sorted(have)[before:])
                self.late_s.extend(now_s - at_s for at_s in news if at_s >= ALL_BELIEVED_S)
                self.known[ours._number, origin] = len(have)


@pytest.mark.parametrize("loss", [0.0, 0.2])
def test_news_is_told_soon_and_once_and_what_was_lost_again(loss: float) -> None:
    async def talk() -> tuple[Talk, int, dict[int, int]]:
        air = Air(LinkModel(loss=loss, delay_s=0.1), seed=3)
        loop = asyncio.get_running_loop()
        members = []
        for number in (1, 2, 3):
            radio = air.radio(number, lambda: (GridPoint(0.0, 0.0), 0.0))
            seal = Seal(KEY, number, 1)
            member = Member(made(number), seal, radio, loop.time, lambda event: None)
            member.clock_moved(0.0)
            members.append(member)
        said = Counter[tuple[int, int]]()
        for member in members:
            tell = member._telling.batches

            def counted(known, now_s, room, tell=tell):  # type: ignore[no-untyped-def]
                batches = tell(known, now_s, room)
                said.update(told(batches))
                return batches

            member._telling.batches = counted  # type: ignore[method-assign]
        tasks = [asyncio.create_task(member.run()) for member in members]
        found = Talk(members)
        for k in range(FACTS + int(SLOWEST_S)):
            if k < FACTS:
                for member in members:
                    member.knowledge.take(member._number, k, [fact(k)])
            await asyncio.sleep(1.0)
            found.look(float(k + 1))
        for task in tasks:
            task.cancel()
        return found, said.total(), air.sent_bytes

    found, said, sent = run(talk(), VirtualClock())
    assert all(found.known[one, other] == FACTS for one in (1, 2, 3) for other in (1, 2, 3))
    late_s = sorted(found.late_s)
    if loss == 0.0:
        assert said <= 3 * FACTS * 1.05  # each once, but for what nobody believed yet
        assert late_s[-1] <= 6.0
    else:
        assert said <= 3 * FACTS * 1.8
        assert late_s[len(late_s) * 9 // 10] <= 10.0
        assert late_s[-1] <= SLOWEST_S
    assert max(sent.values()) / (FACTS + SLOWEST_S) * 60 <= 5_000
