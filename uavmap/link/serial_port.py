"""A serial port as a link: read when the loop says so, and opened again when it was unplugged."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Callable
from typing import Final

import serial

REOPEN_S: Final = 1.0


class SerialPort:
    """One serial port. Raises what pyserial raises, when it is opened for the first time only."""

    peer_host: str | None = None

    def __init__(self, name: str, baud: int, on_bytes: Callable[[bytes], object]) -> None:
        self._name = name
        self._baud = baud
        self._on_bytes = on_bytes
        self._loop = asyncio.get_running_loop()
        self._port: serial.Serial | None = None
        self._reopening: asyncio.Task[None] | None = None
        self._open()

    def send(self, data: bytes) -> None:
        """Write; full, or unplugged: the session will miss the heartbeats."""
        if self._port is not None:
            with contextlib.suppress(serial.SerialException):
                self._port.write(data)

    def close(self) -> None:
        """Let go of it."""
        if self._reopening is not None:
            self._reopening.cancel()
        self._shut()

    def _open(self) -> None:
        port = serial.Serial(self._name, self._baud, timeout=0, write_timeout=0.2)
        self._port = port
        self._loop.add_reader(port.fileno(), self._read)

    def _shut(self) -> None:
        port, self._port = self._port, None
        if port is not None:
            self._loop.remove_reader(port.fileno())
            with contextlib.suppress(OSError):
                port.close()

    def _read(self) -> None:
        try:
            data = self._port.read(4096) if self._port is not None else b""
        except (serial.SerialException, OSError):  # unplugged
            self._shut()
            self._reopening = self._loop.create_task(self._reopen())
            return
        if data:
            self._on_bytes(data)

    async def _reopen(self) -> None:
        """Try until it is plugged in again, under the same name."""
        while self._port is None:
            await asyncio.sleep(REOPEN_S)
            with contextlib.suppress(serial.SerialException, OSError, ValueError):
                self._open()
