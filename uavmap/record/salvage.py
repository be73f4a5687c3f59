"""What can still be read of a damaged journal: rows from single pages, judged by the checksums.

SQLite refuses a file whose header or upper pages are damaged, although the events lie whole in
others. Here every page image of the file and of its write-ahead log is read by itself (the format:
https://www.sqlite.org/fileformat2.html), and the chain of checksums tells which rows belong to the
journal and in which order. So nothing that is read wrongly can come out as an event.

Journals of version 1 have no checksums: there a row counts if it reads as an event whose time,
vehicle and kind agree with its text.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Final, NamedTuple

from missions.events import from_json
from uavmap.record import chain
from uavmap.record.journal_file import PAGE_BYTES, EventRow
from uavmap.record.sqlite_pages import Pages, Value, row_numbers, rows_of, values_of

_LOG_HEADER: Final = 32
_FRAME_HEADER: Final = 24
_FRAME: Final = _FRAME_HEADER + PAGE_BYTES

Candidate = tuple[EventRow, bytes | None]


class _Frame(NamedTuple):
    """A page in the log; `ends` a transaction or not."""

    page: int
    ends: bool
    salts: bytes
    data: bytes


@dataclass(frozen=True, slots=True)
class Salvaged:
    """The good beginning of a journal."""

    version: int
    meta: Mapping[str, str]
    events: tuple[EventRow, ...]
    seen: int
    """The highest number of an event of which there is a trace: so many there were at least."""


@dataclass(slots=True)
class _Found:
    """All that reads as a row, whether it belongs to the journal or not."""

    meta: dict[str, list[tuple[str, bytes | None]]] = field(default_factory=dict)
    events: dict[int, list[Candidate]] = field(default_factory=dict)
    seen: set[tuple[int | None, bytes]] = field(default_factory=set)

    def take_in_all(self, rows: Iterable[tuple[int | None, bytes]]) -> None:
        for number, row in rows:
            if (number, row) in self.seen:  # each page of the log repeats what was on it before
                continue
            self.seen.add((number, row))
            if number is None:
                self._take_in_meta(values_of(row))
            else:
                self._take_in_event(number, values_of(row))

    def _take_in_event(self, number: int, row: list[Value]) -> None:
        # the number is the key of the table, and lies outside of the row
        if len(row) not in (5, 6) or row[0] is not None:
            return
        if (event := event_row(row[1:5])) is not None:
            checksum = row[5] if len(row) == 6 else None
            if checksum is None or isinstance(checksum, bytes):
                self.events.setdefault(number, []).append((event, checksum))

    def has_checksums(self) -> bool:
        """Whether any event has one; then none counts without."""
        return any(own is not None for rows in self.events.values() for _, own in rows)

    def _take_in_meta(self, row: list[Value]) -> None:
        if len(row) not in (2, 3) or not (isinstance(row[0], str) and isinstance(row[1], str)):
            return
        checksum = row[2] if len(row) == 3 else None
        if checksum is None or isinstance(checksum, bytes):
            self.meta.setdefault(row[0], []).append((row[1], checksum))


def event_row(values: list[Value]) -> EventRow | None:
    """A row of the table of events, if it can be one."""
    t_s, vehicle, kind, body = values
    if (
        not isinstance(t_s, int | float)
        or not isinstance(vehicle, int | None)
        or not (isinstance(kind, str) and isinstance(body, str))
    ):
        return None
    return EventRow(float(t_s), vehicle, kind, body)


def agrees(row: EventRow) -> bool:
    """Whether the text of a row is an event, and the columns beside it say the same.

    >>> agrees(EventRow(2.5, 1, "airborne", '{"vehicle":1,"t_s":2.5,"kind":"airborne"}'))
    True
    """
    try:
        event = from_json(row.body)
    except ValueError:
        return False
    return row[:3] == (event.t_s, getattr(event, "vehicle", None), event.kind)


def salvage(data: bytes, log: bytes = b"") -> Salvaged | None:
    """The good beginning of a journal from the bytes of its file and of its log.

    None where the flight plan cannot be read: nothing can go on then.
    """
    frames = list(_frames(log))
    found = _Found()
    whole, current = _page_maps(data, frames)
    for pages in (whole, current) if frames else (whole,):
        for number, page in pages.data.items():
            found.take_in_all(rows_of(page, pages, first=number == 1))
    for frame in frames:
        found.take_in_all(rows_of(frame.data, current, first=frame.page == 1))
    return _judged(found)


def confirmed_in_log(log: bytes) -> int:
    """The highest number of an event in a transaction of the log that was written to its end.

    What a killed process or a full disk leaves of an unfinished transaction does not count.
    """
    return max(
        (
            number
            for transaction in _transactions(_frames(log))
            for frame in transaction
            if frame.page != 1
            for number in row_numbers(frame.data)
        ),
        default=0,
    )


# --- pages -----------------------------------------------------------------------------------
def _frames(log: bytes) -> Iterator[_Frame]:
    for start in range(_LOG_HEADER, len(log) - _FRAME + 1, _FRAME):
        head = log[start : start + _FRAME_HEADER]
        page, size = int.from_bytes(head[0:4], "big"), int.from_bytes(head[4:8], "big")
        yield _Frame(page, size > 0, head[8:16], log[start + _FRAME_HEADER : start + _FRAME])


def _transactions(frames: Iterable[_Frame]) -> Iterator[list[_Frame]]:
    """The frames by transaction; the salts change with every new start of the log."""
    pending: list[_Frame] = []
    for frame in frames:
        if pending and pending[-1].salts != frame.salts:
            pending = []
        pending.append(frame)
        if frame.ends:
            yield pending
            pending = []


def _page_maps(data: bytes, frames: list[_Frame]) -> tuple[Pages, Pages]:
    """The pages of the file alone, and with the log taken in."""
    starts = range(0, len(data), PAGE_BYTES)
    whole = {1 + n: data[s : s + PAGE_BYTES] for n, s in enumerate(starts)}
    current = dict(whole)
    for frame in frames:
        if frame.salts == frames[0].salts:  # others are of an earlier start of the log
            current[frame.page] = frame.data
    return Pages(whole), Pages(current)


# --- judging ---------------------------------------------------------------------------------
def _judged(found: _Found) -> Salvaged | None:
    seen = max(found.events, default=0)
    for plan, checksum in reversed(found.meta.get("plan", [])):
        if checksum is None:
            if not _is_json(plan) or found.has_checksums():
                continue
            meta = {k: v for k, rows in found.meta.items() for v, _ in rows if _is_json(v)}
            return Salvaged(1, {**meta, "plan": plan}, _unchained(found), seen)
        events = _chained(found, plan)
        # its own checksum may be what is damaged
        if events or checksum == chain.of_meta("plan", plan):
            meta = {
                key: value
                for key, rows in found.meta.items()
                for value, own in rows
                if own == chain.of_meta(key, value)
            }
            return Salvaged(2, {**meta, "plan": plan}, events, seen)
    return None


def _chained(found: _Found, plan: str) -> tuple[EventRow, ...]:
    events: list[EventRow] = []
    last = chain.seed(plan)
    while True:
        number = len(events) + 1
        for row, checksum in found.events.get(number, []):
            if checksum == chain.link(last, number, row.body):
                break
        else:
            return tuple(events)
        # the columns beside the text are written anew from it
        if (event := _from_text(row.body)) is None:
            return tuple(events)
        events.append(event)
        last = chain.link(last, number, row.body)


def _unchained(found: _Found) -> tuple[EventRow, ...]:
    events: list[EventRow] = []
    while True:
        rows = [row for row, _ in found.events.get(len(events) + 1, []) if agrees(row)]
        if not rows:
            return tuple(events)
        events.append(rows[-1])


def _from_text(body: str) -> EventRow | None:
    try:
        event = from_json(body)
    except ValueError:
        return None
    return EventRow(event.t_s, getattr(event, "vehicle", None), event.kind, body)


def _is_json(text: str) -> bool:
    try:
        json.loads(text)
    except (ValueError, RecursionError):
        return False
    return True
