"""Marks that wait to be sent: only the newest state of each, each at its own rate. Pure."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Final

from uavmap.ui.tak.marks import Mark

REPEAT_S: Final = 60.0
"""Time after which an unchanged mark is sent again, s."""


@dataclass(slots=True)
class _Slot:
    number: int
    newest: Mark
    every_s: float
    sent: Mark | None = None
    sent_s: float = -math.inf

    def due_s(self) -> float:
        """Return the time at which it is due; infinite for a mark that the receiver has."""
        if self.newest != self.sent:
            return self.sent_s + self.every_s
        return self.sent_s + REPEAT_S if self.newest.repeats else math.inf


class Outbox:
    """Marks to be sent, in groups; each group is put as a whole.

    >>> mark = Mark("a", "u-d-f", 48.0, 11.0, "m-f", 60, b"<detail/>")
    >>> outbox = Outbox()
    >>> outbox.put("shapes", [mark], every_s=5.0)
    >>> outbox.next(0.0) == mark
    True
    >>> outbox.note_sent(mark, 0.0)
    >>> outbox.put("shapes", [], every_s=5.0)
    >>> outbox.next(1.0), outbox.next_s(1.0), outbox.next(5.0).cot_type
    (None, 4.0, 't-x-d-d')
    """

    def __init__(self) -> None:
        self._slots: dict[str, _Slot] = {}
        """Slots by UID; the one that waits longest is first."""
        self._groups: dict[str, set[str]] = {}

    def put(self, group: str, marks: Iterable[Mark], every_s: float) -> None:
        """Put the marks of a group; our own that are no longer in it are deleted."""
        newest = {mark.uid: mark for mark in marks}
        for uid in self._groups.get(group, set()) - newest.keys():
            slot = self._slots[uid]
            if slot.newest.ours:
                slot.newest = slot.newest.deleted()
            else:
                del self._slots[uid]
        self._groups[group] = set(newest)
        for uid, mark in newest.items():
            if uid in self._slots:
                self._slots[uid].newest = mark
                self._slots[uid].every_s = every_s
            else:
                self._slots[uid] = _Slot(len(self._slots), mark, every_s)

    def renew(self) -> None:
        """Have all marks sent again at once, in order: the receiver may have lost any."""
        self._slots = dict(sorted(self._slots.items(), key=lambda item: item[1].number))
        for slot in self._slots.values():
            slot.sent, slot.sent_s = None, -math.inf

    def hurry(self) -> None:
        """Have new marks sent at once: the flight is over."""
        for slot in self._slots.values():
            slot.every_s = 0.0

    def next(self, now_s: float) -> Mark | None:
        """Return the mark that is due; None if there is none."""
        due = (slot for slot in self._slots.values() if slot.due_s() <= now_s)
        return next((slot.newest for slot in due), None)

    def next_s(self, now_s: float) -> float:
        """Return the time until a mark is due, s."""
        due_s = min((slot.due_s() for slot in self._slots.values()), default=math.inf)
        return max(due_s - now_s, 0.0)

    @property
    def done(self) -> bool:
        """True if the receiver has the newest state of all marks."""
        return all(slot.newest == slot.sent for slot in self._slots.values())

    def note_sent(self, mark: Mark, now_s: float) -> None:
        """Note that a mark was sent; a newer one may have been put since."""
        for uid, slot in self._slots.items():
            if slot.newest == mark or uid == mark.uid:
                slot.sent, slot.sent_s = mark, now_s
                self._slots[uid] = self._slots.pop(uid)  # to the end of the queue
                return
