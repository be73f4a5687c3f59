"""Datagrams that only holders of the mission's key can make, each accepted once.

A datagram carries its sender's number, the number of its start, a counter, and a code. The code is
that of all the rest under the key (keyed BLAKE2s, RFC 7693). A higher start replaces a lower one.
Each counter of a start is accepted once, in a window for datagrams that overtake each other. Clocks
have no part.

An unknown start may be a replay of an earlier flight with the same key. So it is accepted only
after it answers a fresh random number.
"""

from __future__ import annotations

import hmac
import json
import secrets
from collections import Counter, deque
from dataclasses import dataclass, field
from hashlib import blake2s
from typing import Final

from missions.mission.places import home_heights_m
from missions.mission.schema import Mission
from uavmap.fleet.bits import BytesError, Reader, Writer

CODE_BYTES: Final = 8
NONCE_BYTES: Final = 8
WINDOW: Final = 64
"""Maximum lag of a datagram's counter."""
MAX_SENDERS: Final = 1_000
DATA: Final = 0
ASKS: Final = 1
"""Kind of a datagram whose body is a random number, to be answered."""
ANSWERS: Final = 2
"""Kind of a datagram whose body holds such numbers."""


class _RefusedError(Exception):
    """The reason for the refusal of a datagram."""


@dataclass(slots=True)
class _SenderWindow:
    start: int
    last: int = -1
    window: int = 0
    """A bit for each of the counters before `last`, the nearest one lowest."""


@dataclass(slots=True)
class Seal:
    """Seals the messages of a member and opens received ones."""

    key: bytes
    member: int
    start: int
    """Number of this start; higher at each start of this member's program."""
    refused: Counter[str] = field(default_factory=Counter)
    """Number of refused datagrams, by reason."""
    overtaken: bool = False
    """True if a later one of the same sender was opened before the last one."""
    _counter: int = 0
    _nonce: bytes = field(default_factory=lambda: secrets.token_bytes(NONCE_BYTES))
    _windows: dict[int, _SenderWindow] = field(default_factory=dict)
    _asked: deque[bytes] = field(default_factory=lambda: deque(maxlen=16))
    """Random numbers of others that are not answered yet."""
    _ask: bool = False

    def sealed(self, body: bytes, kind: int = DATA) -> bytes:
        """Return a datagram."""
        out = Writer()
        out.count(kind)
        out.count(self.member)
        out.count(self.start)
        out.count(self._counter)
        out.raw(body)
        self._counter += 1
        return out.data + self._code(out.data)

    def opened(self, datagram: bytes) -> tuple[int, bytes] | None:
        """Return sender and body; None for a refused, old, asking or answering one."""
        try:
            return self._opened(datagram)
        except _RefusedError as refused:
            self.refused[str(refused)] += 1
            return None

    def _opened(self, datagram: bytes) -> tuple[int, bytes] | None:
        head, code = datagram[:-CODE_BYTES], datagram[-CODE_BYTES:]
        if not hmac.compare_digest(self._code(head), code):
            raise _RefusedError("not sealed with our key")
        try:
            inp = Reader(head)
            kind, sender, start, counter = (inp.count() for _ in range(4))
            body = inp.raw()
            whole = inp.at_end
        except BytesError:
            raise _RefusedError("damaged") from None
        if not whole or kind not in (DATA, ASKS, ANSWERS):
            raise _RefusedError("damaged")
        if sender == self.member:
            if start == self.start and counter < self._counter:  # our own, come back
                return None
            raise _RefusedError("from another with our number")
        if kind == ASKS:
            self._asked.append(body)
            return None
        received = self._windows.get(sender)
        known = received is not None and start <= received.start
        answers = (body[k : k + NONCE_BYTES] for k in range(0, len(body), NONCE_BYTES))
        room = received is not None or len(self._windows) < MAX_SENDERS
        if kind == ANSWERS and self._nonce in answers and not known and room:
            received = self._windows[sender] = _SenderWindow(start)
        if received is None or start > received.start:
            self._ask = True
            raise _RefusedError("not known to be alive yet")
        if start < received.start:
            raise _RefusedError("from an earlier start")
        if not _is_new(received, counter):
            raise _RefusedError("received before")
        self.overtaken = counter < received.last
        return (sender, body) if kind == DATA else None

    def errands(self) -> list[bytes]:
        """Return datagrams that have to be sent so that members accept each other."""
        out = []
        if self._asked:
            out.append(self.sealed(b"".join(dict.fromkeys(self._asked)), ANSWERS))
            self._asked.clear()
        if self._ask:
            out.append(self.sealed(self._nonce, ASKS))
            self._ask = False
        return out

    def _code(self, head: bytes) -> bytes:
        return blake2s(head, key=self.key, digest_size=CODE_BYTES, person=b"uavmap 1").digest()


def _is_new(received: _SenderWindow, counter: int) -> bool:
    ahead = counter - received.last
    if ahead > 0:
        received.window = (
            ((received.window << 1 | (received.last >= 0)) << (ahead - 1)) if ahead <= WINDOW else 0
        )
        received.window &= (1 << WINDOW) - 1
        received.last = counter
        return True
    back = -ahead - 1
    if ahead == 0 or back >= WINDOW or received.window >> back & 1:
        return False
    received.window |= 1 << back
    return True


LABEL: Final = b"uavmap fleet 1"
_MEANING: Final = (
    *("strategy", "start", "search", "fence", "grid", "flight", "votes", "drift", "team"),
)


def fleet_key(key: bytes, mission: Mission) -> bytes:
    """Derive the 32 bytes that seal a fleet's datagrams from a file of `uavmap keys new`.

    The key, which may also sign MAVLink, cannot be derived from them. Missions that differ in the
    meaning of facts (grid, box, votes) or in airspace (pads, heights, layers) get different ones.
    Their members refuse each other's datagrams.
    """
    return blake2s(LABEL + meaning_of(mission), key=key).digest()


def meaning_of(mission: Mission) -> bytes:
    """Return 32 bytes of all that has to be the same in the missions of all members."""
    # a height may be "auto", which is no number to warn of
    meaning = mission.model_dump(mode="json", include=set(_MEANING), warnings=False)
    meaning["pads"] = [vehicle.home for vehicle in mission.vehicles]
    meaning["pad heights"] = home_heights_m(mission)
    if (classes := mission.detector.classes) is not None:  # facts have shares of them
        meaning["classes"] = [classes.names, classes.explored]
    return blake2s(json.dumps(meaning, sort_keys=True).encode()).digest()
