"""A serial port as a link: read and written by the loop, reopened when unplugged."""

from __future__ import annotations

import asyncio
import contextlib
import os
from collections.abc import Callable, Hashable
from typing import Final

import serial

REOPEN_S: Final = 1.0
MAX_UNSENT: Final = 1 << 14
"""Maximum number of waiting bytes, three seconds at 57600 baud; more are lost."""
_MAX_READS: Final = 64
"""Maximum number of reads in one turn of the loop, until the port is empty."""


class SerialPort:
    """One serial port. Raises pyserial's errors, only when it is opened for the first time."""

    peer_host: str | None = None

    def __init__(self, name: str, baud: int, on_bytes: Callable[[bytes], object]) -> None:
        self._name = name
        self._baud = baud
        self._on_bytes = on_bytes
        self._loop = asyncio.get_running_loop()
        self._port: serial.Serial | None = None
        self._unsent = bytearray()
        self._reopening: asyncio.Task[None] | None = None
        self._open()

    @property
    def destination(self) -> Hashable:
        """Itself: no other link leads there."""
        return id(self)

    def send(self, data: bytes) -> None:
        """Write, now or as soon as the port accepts it.

        Full or unplugged it drops the data, and the session misses the heartbeats.
        """
        if self._port is None or len(self._unsent) + len(data) > MAX_UNSENT:
            return
        waits = bool(self._unsent)
        self._unsent += data
        if not waits:
            self._write()

    def close(self) -> None:
        """Close the port."""
        if self._reopening is not None:
            self._reopening.cancel()
        self._shut()

    def _open(self) -> None:
        port = serial.Serial(self._name, self._baud, timeout=0)
        os.set_blocking(port.fileno(), False)
        self._port = port
        self._loop.add_reader(port.fileno(), self._read)

    def _shut(self) -> None:
        port, self._port = self._port, None
        self._unsent.clear()
        if port is not None:
            self._loop.remove_reader(port.fileno())
            self._loop.remove_writer(port.fileno())
            with contextlib.suppress(OSError):
                port.close()

    def _read(self) -> None:
        for _ in range(_MAX_READS):
            try:
                data = self._port.read(4096) if self._port is not None else b""
            except (serial.SerialException, OSError):  # unplugged
                self._note_loss()
                return
            if not data:
                return
            self._on_bytes(data)

    def _write(self) -> None:
        if self._port is None:
            return
        file = self._port.fileno()
        try:
            del self._unsent[: os.write(file, self._unsent)]
        except BlockingIOError:
            pass
        except OSError:  # unplugged
            self._note_loss()
            return
        if self._unsent:
            self._loop.add_writer(file, self._write)
        else:
            self._loop.remove_writer(file)

    def _note_loss(self) -> None:
        self._shut()
        if self._reopening is None or self._reopening.done():
            self._reopening = self._loop.create_task(self._reopen())

    async def _reopen(self) -> None:
        while self._port is None:
            await asyncio.sleep(REOPEN_S)
            with contextlib.suppress(serial.SerialException, OSError, ValueError):
                self._open()
