"""What a vehicle says in words: STATUSTEXT, put together from its chunks and made harmless."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Final, NamedTuple

from uavmap.base.printable import printable

CHUNK_BYTES: Final = 50
MOST_CHUNKS: Final = 16
MOST_OPEN: Final = 4
"""So many texts of a vehicle may be half told at a time."""
LATE_S: Final = 2.0
"""A text whose other chunks do not come within this time is told as far as it was heard."""
TEXT_LENGTH: Final = 400
_GAP: Final = "[...]"


class Text(NamedTuple):
    """Words of a vehicle, whole or as much as was heard of them."""

    severity: int
    """MAV_SEVERITY: 0 is an emergency, 7 for debugging."""
    words: str


@dataclass(slots=True)
class _Open:
    severity: int
    begun_s: float
    chunks: dict[int, str] = field(default_factory=dict)
    last: int | None = None
    """The number of the last chunk, once it was heard."""

    @property
    def whole(self) -> bool:
        return self.last is not None and len(self.chunks) == self.last + 1

    def text(self) -> Text:
        end = max(self.chunks) + 1 if self.last is None else self.last + 1
        words = "".join(self.chunks.get(k, _GAP) for k in range(end))
        return _harmless(self.severity, words if self.last is not None else words + _GAP)


class Texts:
    """Puts texts together; a chunk that is lost leaves a gap, and holds nothing up.

    >>> from pymavlink.dialects.v20 import ardupilotmega as mav
    >>> said = Texts()
    >>> first = mav.MAVLink_statustext_message(4, b"x" * 50, id=7, chunk_seq=0)
    >>> said.take(1, first, now_s=0.0)
    []
    >>> rest = mav.MAVLink_statustext_message(4, b"yz", id=7, chunk_seq=1)
    >>> [text.words[-4:] for text in said.take(1, rest, now_s=0.1)]
    ['xxyz']
    """

    def __init__(self) -> None:
        self._open: dict[tuple[int, int], _Open] = {}

    def take(self, component: int, message: Any, now_s: float) -> list[Text]:
        """A STATUSTEXT was heard; the texts that are whole, or given up, with it."""
        done = self.late(now_s)
        words, full = _words(message)
        number, chunk = int(message.id), int(message.chunk_seq)
        if number == 0 or (chunk == 0 and not full):  # told in one piece
            return [*done, _harmless(message.severity, words)]
        if chunk >= MOST_CHUNKS:
            return done
        key = (component, number)
        if key not in self._open and len(self._open) >= MOST_OPEN:
            done.append(self._open.pop(next(iter(self._open))).text())
        part = self._open.setdefault(key, _Open(int(message.severity), now_s))
        part.chunks[chunk] = words
        if not full:
            part.last = chunk
        if part.whole:
            done.append(self._open.pop(key).text())
        return done

    def late(self, now_s: float) -> list[Text]:
        """The texts whose other chunks are not waited for any longer."""
        keys = [key for key, part in self._open.items() if now_s - part.begun_s > LATE_S]
        return [self._open.pop(key).text() for key in keys]


def _words(message: Any) -> tuple[str, bool]:
    """The words of one chunk, and whether it is full: then another follows."""
    text = message.text
    raw = text if isinstance(text, bytes) else str(text).encode("utf-8", "replace")
    raw = raw.split(b"\0", 1)[0]
    return raw.decode("utf-8", "replace"), len(raw) >= CHUNK_BYTES


def _harmless(severity: int, words: str) -> Text:
    return Text(int(severity), printable(words, TEXT_LENGTH).strip())
