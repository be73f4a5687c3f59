"""Rows out of single pages of an SQLite file, without SQLite.

https://www.sqlite.org/fileformat2.html, sections 1.6 and 2.1. Only what a journal has: leaves of
tables with a row number, and pages of tables without. What makes no sense is left out; nothing
here raises, whatever the bytes are.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from typing import Final

from uavmap.record.journal_file import PAGE_BYTES

Value = int | float | str | bytes | None

_TABLE_LEAF: Final = 13
_INDEX_LEAF: Final = 10
_INDEX_INNER: Final = 2
_FILE_HEADER: Final = 100
_LONGEST: Final = 64_000_000
_WIDTHS: Final = {1: 1, 2: 2, 3: 3, 4: 4, 5: 6, 6: 8, 7: 8}


@dataclass(frozen=True, slots=True)
class Pages:
    """Pages by their number, counted from 1."""

    data: Mapping[int, bytes]


def rows_of(page: bytes, pages: Pages, *, first: bool) -> Iterator[tuple[int | None, bytes]]:
    """The rows of a page as bytes, each with its number; None in a table that has no numbers.

    Args:
        page: its bytes.
        pages: where the rest of a long row lies.
        first: whether it is page 1, which begins with the header of the file.
    """
    for kind, place in _cells(page, first=first):
        try:
            if (cell := _cell(page, place, kind, pages)) is not None:
                yield cell
        except IndexError:
            continue


def row_numbers(page: bytes) -> list[int]:
    """The numbers of the rows of a page other than the first, whether they can be read or not."""
    found = []
    for kind, place in _cells(page, first=False):
        if kind == _TABLE_LEAF:
            with suppress(IndexError):
                _, place = _varint(page, place)
                found.append(_varint(page, place)[0])
    return found


def _cells(page: bytes, *, first: bool) -> Iterator[tuple[int, int]]:
    """Kind and place of what a page points to."""
    start = _FILE_HEADER if first else 0
    if len(page) < start + 12 or page[start] not in (_TABLE_LEAF, _INDEX_LEAF, _INDEX_INNER):
        return
    pointers = start + (12 if page[start] == _INDEX_INNER else 8)
    count = min(int.from_bytes(page[start + 3 : start + 5], "big"), PAGE_BYTES // 2)
    for n in range(count):
        place = int.from_bytes(page[pointers + 2 * n : pointers + 2 * n + 2], "big")
        yield page[start], place


def _cell(page: bytes, place: int, kind: int, pages: Pages) -> tuple[int | None, bytes] | None:
    """The number and the bytes of a row."""
    if kind == _INDEX_INNER:
        place += 4
    size, place = _varint(page, place)
    number: int | None = None
    if kind == _TABLE_LEAF:
        number, place = _varint(page, place)
    if not 0 < size < _LONGEST:
        return None
    local = _local(size, kind)
    head = page[place : place + local]
    if local < size:
        following = int.from_bytes(page[place + local : place + local + 4], "big")
        head += _overflow(following, size - local, pages)
    return (number, head) if len(head) == size else None


def _local(size: int, kind: int) -> int:
    """How many bytes of a row lie in its page, by the rules of the format."""
    usable = PAGE_BYTES
    most = usable - 35 if kind == _TABLE_LEAF else (usable - 12) * 64 // 255 - 23
    if size <= most:
        return size
    least = (usable - 12) * 32 // 255 - 23
    wanted = least + (size - least) % (usable - 4)
    return wanted if wanted <= most else least


def _overflow(page: int, size: int, pages: Pages) -> bytes:
    parts: list[bytes] = []
    seen: set[int] = set()
    while size > 0 and page in pages.data and page not in seen:
        seen.add(page)
        data = pages.data[page]
        parts.append(data[4 : 4 + size])
        size -= len(parts[-1])
        page = int.from_bytes(data[:4], "big")
    return b"".join(parts)


def values_of(row: bytes) -> list[Value]:
    """The values of a row; empty for what is none."""
    try:
        return _values(row)
    except (IndexError, ValueError):
        return []


def _values(row: bytes) -> list[Value]:
    end, place = _varint(row, 0)
    kinds: list[int] = []
    while place < end:
        kind, place = _varint(row, place)
        kinds.append(kind)
    values: list[Value] = []
    place = end
    for kind in kinds:
        width = _WIDTHS.get(kind, (kind - 12) // 2 if kind >= 12 else 0)
        raw = row[place : place + width]
        if len(raw) != width:
            raise ValueError("a value is cut short")
        values.append(_value(kind, raw))
        place += width
    return values


def _value(kind: int, raw: bytes) -> Value:
    if kind == 0:
        return None
    if kind == 7:
        (number,) = struct.unpack(">d", raw)
        return float(number)
    if kind < 7:
        return int.from_bytes(raw, "big", signed=True)
    if kind in (8, 9):
        return kind - 8
    if kind < 12:
        raise ValueError("reserved")
    return raw.decode() if kind % 2 else raw


def _varint(data: bytes, place: int) -> tuple[int, int]:
    """A number of one to nine bytes, seven bits in each of the first eight."""
    value = 0
    for n in range(8):
        byte = data[place + n]
        value = value << 7 | byte & 0x7F
        if byte < 0x80:
            return value, place + n + 1
    return value << 8 | data[place + 8], place + 9
