"""The checksums of a journal: each event's is taken over the one before it.

The first takes in the flight plan, so a digit that changes anywhere, in an event or in the plan,
breaks the chain at that event. The chain is against accidents, not against forgers: who can write
the file can compute it anew.
"""

from __future__ import annotations

import hashlib
from typing import Final

SIZE: Final = 32
_SEED: Final = b"uavmap journal 2, flight plan: "
_META: Final = b"uavmap journal 2, meta: "


def seed(plan: str | None) -> bytes:
    """Where the chain begins: the text of the flight plan as it lies in the journal."""
    return hashlib.sha256(_SEED + (plan or "").encode()).digest()


def link(previous: bytes, number: int, body: str) -> bytes:
    """The checksum of event `number`, counted from 1."""
    return hashlib.sha256(previous + number.to_bytes(8, "big") + body.encode()).digest()


def of_meta(key: str, value: str) -> bytes:
    """The checksum of what is said of the mission as a whole; it stands by itself."""
    return hashlib.sha256(_META + key.encode() + b"\0" + value.encode()).digest()
