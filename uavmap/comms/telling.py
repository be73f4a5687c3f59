"""Which facts are told next: new ones of ours, then what somebody lacks."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from missions.fleet.codec import Batch, Message, encode
from missions.fleet.knowledge import Knowledge
from uavmap.comms.peer import Peer

RELAY_S: Final = 8.0
"""What somebody lacks of a third one's facts for so long is told by whoever has it."""


class Telling:
    """What one member has told of its own facts, and tells the others, which are in `peers`."""

    def __init__(self, number: int, peers: Mapping[int, Peer]) -> None:
        self._number = number
        self._peers = peers
        self._told = 0
        """How many of our own facts were told once."""

    def batches(self, knowledge: Knowledge, now_s: float, room: int) -> tuple[Batch, ...]:
        """Facts to tell, in at most so many bytes."""
        found: list[Batch] = []
        for origin, first in dict.fromkeys(self._wanted(knowledge, now_s)):
            batch, size = fitting(knowledge, origin, first, room)
            if batch is None:
                continue
            found.append(batch)
            room -= size
            if origin == self._number:
                self._told = max(self._told, first + len(batch.facts))
        return tuple(found)

    def _wanted(self, knowledge: Knowledge, now_s: float) -> list[tuple[int, int]]:
        """Whose facts are to be told, and from which on."""
        wanted: list[tuple[int, int]] = []
        if self._told < len(knowledge.facts.get(self._number, [])):
            wanted.append((self._number, self._told))
        for peer in (p for p in self._peers.values() if not p.apart):
            for origin, first in knowledge.missing(peer.have).items():
                ours = origin == self._number and first < self._told
                waited = now_s - peer.lacks_since_s.get(origin, now_s) >= RELAY_S
                if ours or (origin != self._number and waited):
                    wanted.append((origin, first))
        return wanted


def fitting(knowledge: Knowledge, origin: int, first: int, room: int) -> tuple[Batch | None, int]:
    """As many facts of a member from `first` on as there is room for, and their bytes."""
    facts = knowledge.facts[origin][first:]
    count = len(facts)
    while count > 0:
        batch = Batch(origin, first, tuple(facts[:count]))
        size = len(encode(Message(0.0, batches=(batch,)))) - 4
        if size <= room:
            return batch, size
        count = min(count - 1, count * max(room, 0) // size)
    return None, 0
