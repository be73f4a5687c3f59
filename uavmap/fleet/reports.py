"""Order of facts to send: those of a lost datagram, new ones of ours, those that others lack.

A fact is sent again only to a member that has reported since, without it, what it holds. Facts of
a third member are relayed where nothing of that one has got through for a while.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Final

from uavmap.fleet.codec import Batch, Message, encode
from uavmap.fleet.knowledge import NOTHING, Knowledge, runs_of
from uavmap.fleet.peer import Peer

RELAY_S: Final = 8.0
"""Time without news of a third member, after which others relay its facts, s."""
UNDERWAY_S: Final = 1.0
"""So long a datagram, and what says that it has come, are on the way at most."""


class Telling:
    """What one member has told of facts, and tells the others, which are in `peers`."""

    def __init__(self, number: int, peers: Mapping[int, Peer]) -> None:
        self._number = number
        self._peers = peers
        self._told_s: dict[int, dict[int, float]] = {}
        """When facts were told last, by whose they are and by number."""

    def clock_moved(self, by_s: float) -> None:
        """Our clock was put forward, or back, by so much."""
        for told_s in self._told_s.values():
            for number in told_s:
                told_s[number] += by_s

    def batches(self, knowledge: Knowledge, now_s: float, room: int) -> tuple[Batch, ...]:
        """Return facts to send, in at most so many bytes.

        Lost ones come first, in half of the room: to a member that hears nothing they are lost for
        ever.
        """
        new = self._new(knowledge, now_s)
        found: list[Batch] = []
        lost = self._lost(knowledge, now_s)
        used = self._put(found, knowledge, lost, now_s, room // 2 if new else room)
        if lost and not used:  # a single one may need more than half
            origin, numbers = next(iter(lost.items()))
            used = self._put(found, knowledge, {origin: numbers[:1]}, now_s, room)
        used += self._put(found, knowledge, {self._number: new}, now_s, room - used)
        self._put(found, knowledge, self._lost(knowledge, now_s), now_s, room - used)
        return tuple(found)

    def _new(self, knowledge: Knowledge, now_s: float) -> list[int]:
        """Facts of ours that were not told since this start, and somebody may not know."""
        if self._peers and all(peer.apart for peer in self._peers.values()):
            return []  # nobody hears it, and what is saved is there for who comes back
        told_s = self._told_s.setdefault(self._number, {})
        untold = sorted(
            number for number in knowledge.facts.get(self._number, ()) if number not in told_s
        )
        held = [
            peer.have.get(self._number, NOTHING)
            for peer in self._peers.values()
            if not peer.apart and peer.have_s > -math.inf
        ]
        known = [number for number in untold if held and all(h.holds(number) for h in held)]
        told_s.update(dict.fromkeys(known, now_s))
        return [number for number in untold if number not in told_s]

    def _put(
        self,
        found: list[Batch],
        knowledge: Knowledge,
        wanted: Mapping[int, list[int]],
        now_s: float,
        room: int,
    ) -> int:
        """Add as many of the facts that are wanted as there is room for; returns their bytes."""
        used = 0
        for origin, numbers in wanted.items():
            for run in runs_of(numbers):
                batch, size = _fitting(knowledge, origin, run[0], len(run), room - used)
                if batch is None:
                    return used
                found.append(batch)
                used += size
                told_s = self._told_s.setdefault(origin, {})
                told_s.update((batch.first + k, now_s) for k in range(len(batch.facts)))
        return used

    def _lost(self, knowledge: Knowledge, now_s: float) -> dict[int, list[int]]:
        """What somebody lacks that it should have heard, by whose it is; ours first."""
        lost: dict[int, set[int]] = {}
        for peer in (p for p in self._peers.values() if not p.apart):
            for origin, numbers in knowledge.missing(peer.have).items():
                ours = origin == self._number
                if not ours and now_s < peer.lacks_since_s.get(origin, now_s) + RELAY_S:
                    continue
                told_s = self._told_s.get(origin, {})
                never_s = math.inf if ours else -math.inf
                due_s = peer.have_s - UNDERWAY_S
                lost.setdefault(origin, set()).update(
                    number for number in numbers if told_s.get(number, never_s) < due_s
                )
        first = sorted(lost, key=lambda origin: (origin != self._number, origin))
        return {origin: sorted(lost[origin]) for origin in first if lost[origin]}


def _fitting(
    knowledge: Knowledge, origin: int, first: int, count: int, room: int
) -> tuple[Batch | None, int]:
    """As many facts of a member from `first` on, of so many, as there is room for; their bytes."""
    facts = [knowledge.facts[origin][first + k] for k in range(count)]
    while count > 0:
        batch = Batch(origin, first, tuple(facts[:count]))
        size = len(encode(Message(0.0, batches=(batch,)))) - 4
        if size <= room:
            return batch, size
        count = min(count - 1, count * max(room, 0) // size)
    return None, 0
