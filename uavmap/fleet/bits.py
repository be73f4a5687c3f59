"""Numbers and small maps of cells as few bytes."""

from __future__ import annotations

import zlib
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import groupby

import numpy as np

MAX_CELLS = 1 << 20
"""Maximum number of cells in the rectangle of a fact."""


class BytesError(ValueError):
    """Bytes that no `Writer` has written."""


class Writer:
    """Bytes that grow.

    >>> out = Writer()
    >>> out.count(300); out.integer(-2)
    >>> inp = Reader(out.data)
    >>> inp.count(), inp.integer(), inp.at_end
    (300, -2, True)
    """

    def __init__(self) -> None:
        self._data = bytearray()

    @property
    def data(self) -> bytes:
        """Written bytes."""
        return bytes(self._data)

    def count(self, value: int) -> None:
        """Write a number from 0 on: seven bits a byte, the low ones first."""
        if value < 0:
            raise ValueError(f"{value} is negative")
        while value > 127:
            self._data.append(value & 127 | 128)
            value >>= 7
        self._data.append(value)

    def integer(self, value: int) -> None:
        """Write a number of either sign: near 0 it is short."""
        self.count(2 * value if value >= 0 else -2 * value - 1)

    def raw(self, data: bytes) -> None:
        """Write bytes, with their number before them."""
        self.count(len(data))
        self._data += data

    def flags(self, bits: Sequence[bool]) -> None:
        """Write a row of bits whose number the reader knows: as runs or one by one, by length."""
        runs = _runs(bits)
        one_by_one = np.packbits(np.array(bits, np.bool_), bitorder="little").tobytes()
        as_runs = Writer()
        as_runs.count(2 * len(runs))
        for run in runs:
            as_runs.count(run)
        if len(as_runs._data) <= len(one_by_one) + 1:
            self._data += as_runs._data
        else:
            self.count(1)
            self._data += one_by_one


@dataclass(slots=True)
class Reader:
    """The inverse of `Writer`. Raises `BytesError` for other bytes."""

    data: bytes
    place: int = 0

    @property
    def at_end(self) -> bool:
        """True if everything is read."""
        return self.place >= len(self.data)

    def count(self) -> int:
        """Read a number from 0 on, below 2**63."""
        value, shift = 0, 0
        while True:
            if self.at_end or shift > 56:
                raise BytesError("a number does not end")
            byte = self.data[self.place]
            self.place += 1
            value |= (byte & 127) << shift
            if byte < 128:
                return value
            shift += 7

    def integer(self) -> int:
        """Read a number of either sign."""
        value = self.count()
        return value // 2 if value % 2 == 0 else -(value + 1) // 2

    def raw(self) -> bytes:
        """Read bytes with their number before them."""
        return self._part(self.count(), "bytes")

    def _part(self, length: int, what: str) -> bytes:
        if length > len(self.data) - self.place:
            raise BytesError(f"{what} are missing")
        self.place += length
        return self.data[self.place - length : self.place]

    def flags(self, number: int) -> list[bool]:
        """Read a row of `number` bits."""
        head = self.count()
        if head % 2:
            part = np.frombuffer(self._part((number + 7) // 8, "bits"), np.uint8)
            unpacked = np.unpackbits(part, count=number, bitorder="little")
            return [bool(bit) for bit in unpacked.tolist()]
        bits: list[bool] = []
        for turn in range(head // 2):
            run = self.count()
            if run > number - len(bits):
                raise BytesError("a run is too long")
            bits.extend([bool(turn % 2)] * run)
        if len(bits) != number:
            raise BytesError("runs do not add up")
        return bits


def deflated(data: bytes) -> bytes:
    """Return bytes, smaller if possible; the first byte shows which."""
    packer = zlib.compressobj(9, zlib.DEFLATED, -15)
    small = packer.compress(data) + packer.flush()
    return b"\x01" + small if len(small) < len(data) else b"\x00" + data


def inflated(data: bytes, most: int) -> bytes:
    """Return the original bytes: the inverse of `deflated`.

    Raises `BytesError`, also for more than `most` bytes.
    """
    if data[:1] == b"\x00":
        return data[1:]
    if data[:1] != b"\x01":
        raise BytesError("neither packed nor plain")
    unpacker = zlib.decompressobj(-15)
    try:
        found = unpacker.decompress(data[1:], most)
    except zlib.error:
        raise BytesError("packed bytes are damaged") from None
    if not unpacker.eof or unpacker.unused_data:
        raise BytesError("packed bytes are too many or too few")
    return found


def _runs(bits: Sequence[bool]) -> list[int]:
    runs = [len(list(same)) for _, same in groupby(bits)]
    return runs if bits and not bits[0] else [0, *runs]
