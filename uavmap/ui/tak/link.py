"""The link to a TAK server or to a multicast group, by pytak. It reconnects without end.

Marks are written one by one, so a newer mark replaces one that was not sent yet. A new connection
gets the newest state of all marks: marks that the old connection lost do not stay out of date.
"""

from __future__ import annotations

import asyncio
import contextlib
import math
import os
import socket
import time
import warnings
from collections.abc import Callable
from datetime import UTC, datetime, timedelta
from typing import Any, Final
from urllib.parse import urlsplit
from xml.etree import ElementTree as ET

from uavmap.ui.tak.marks import Mark
from uavmap.ui.tak.outbox import Outbox

with warnings.catch_warnings():  # about packages for other kinds of links
    warnings.simplefilter("ignore")
    import pytak
    from pytak.client_functions import get_ssl_ctx, get_tls_config

CONNECT_S: Final = 10.0
"""Maximum time to connect, s."""
WAIT_S: Final = (1.0, 30.0)
"""Minimum and maximum time before the next attempt to connect, s; it doubles each time."""
HELD_S: Final = 1.0
"""Time after which a connection counts as a link, s: relays accept it even for a dead server."""
SILENT_MS: Final = 20_000
"""Time without an acknowledgement after which a connection is lost, ms."""
BUFFER_BYTES: Final = 1 << 15
"""Size of the system's buffer, bytes: newer marks cannot replace those in it."""
SCHEMES: Final = ("tcp", "tls", "udp")


def config_of(url: str) -> dict[str, str]:
    """Return the configuration of pytak: the URL, and certificates from the environment.

    Raises `ValueError` for a wrong URL, or without a usable certificate.
    """
    parts = urlsplit(url)
    scheme, port = parts.scheme.replace("ssl", "tls"), parts.netloc.rpartition(":")[2]
    if scheme.partition("+")[0] not in SCHEMES or not parts.hostname or not _is_port(port):
        raise ValueError(
            f"--tak {url}: expected tcp://HOST:PORT, tls://HOST:PORT or udp://HOST:PORT"
        )
    known = {name: value for name, value in os.environ.items() if name.startswith("PYTAK_")}
    if scheme == "udp":
        scheme = "udp+wo"  # else pytak binds the port of the receiver on this computer
    config = {**known, "COT_URL": f"{scheme}://{parts.netloc}"}
    if scheme == "tls":
        try:
            get_ssl_ctx(get_tls_config(config))
        except Exception as error:  # it raises SyntaxError, ValueError and others
            raise ValueError(f"--tak {url}: {error}") from None
    return config


def _is_port(text: str) -> bool:
    return text.isascii() and text.isdigit() and 0 < int(text) < 65536


def encode_event(mark: Mark) -> bytes:
    """Return the event of a mark that is sent now. Its height above the ellipsoid is unknown."""
    times = {}
    if mark.fix_utc_s is not None:
        fix = datetime.fromtimestamp(mark.fix_utc_s, UTC)
        stale = fix + timedelta(seconds=mark.stale_s)
        times = dict.fromkeys(("time", "start"), _written(fix)) | {"stale": _written(stale)}
    event = pytak.cot_event(
        uid=mark.uid,
        cot_type=mark.cot_type,
        how=mark.how,
        stale=mark.stale_s,
        point=pytak.cot_point(mark.lat_deg, mark.lon_deg, precision=7),
        detail=ET.fromstring(mark.detail),
        extra_attrs=times,
    )
    data: bytes = pytak.serialize_cot(event, trailing_newline=True)
    return data


def _written(moment: datetime) -> str:
    return moment.strftime(pytak.W3C_XML_DATETIME)


class Link:
    """A link that sends the marks of an outbox.

    `report` gets a line when the link is lost, and when it is back.
    """

    def __init__(self, url: str, outbox: Outbox, report: Callable[[str], None]) -> None:
        self._url = url
        self._config = config_of(url)
        self._outbox = outbox
        self._report = report
        self._up: bool | None = None
        """True if there is a link; None before the first attempt."""
        self._was_up = False
        self._news = asyncio.Event()
        self._ending = asyncio.Event()

    def wake(self) -> None:
        """Wake the sender: the outbox has new marks."""
        self._news.set()

    async def run(self) -> None:
        """Send until `finish`."""
        wait_s = WAIT_S[0]
        while True:
            begin_s = time.monotonic()
            try:
                await self._stay()
                return
            except Exception as error:  # pytak raises errors of any class: the flight continues
                self._note_loss(error)
            if time.monotonic() - begin_s > WAIT_S[1]:
                wait_s = WAIT_S[0]
            if self._ending.is_set():
                return
            with contextlib.suppress(TimeoutError):
                await asyncio.wait_for(self._ending.wait(), wait_s)
            wait_s = min(2.0 * wait_s, WAIT_S[1])

    async def finish(self, running: asyncio.Task[None], most_s: float) -> None:
        """Send the remaining marks, and end; report it if that is impossible."""
        self._outbox.hurry()
        self._ending.set()
        self._news.set()
        await asyncio.wait({running}, timeout=most_s)
        running.cancel()
        if not self._outbox.done:
            self._report(f"TAK: no link to {self._url}: the end of the flight was not sent")

    async def _stay(self) -> None:
        """Connect, and send until the flight ends. Raises an error when the link is lost."""
        async with asyncio.timeout(CONNECT_S):
            reader, writer = await pytak.protocol_factory(self._config)
        self._outbox.renew()
        closed = asyncio.create_task(_discard(reader))
        try:
            _tune(writer)
            await self._send_all(writer, closed)
        finally:
            closed.cancel()
            writer.close()
            if hasattr(writer, "wait_closed"):
                with contextlib.suppress(OSError):
                    await writer.wait_closed()

    async def _send_all(self, writer: Any, closed: asyncio.Task[None]) -> None:
        since_s = time.monotonic()
        while not closed.done():
            now_s = time.monotonic()
            self._news.clear()
            if not self._up and now_s - since_s >= HELD_S:
                self._note_link()
            if (mark := self._outbox.next(now_s)) is not None:
                await _send(writer, encode_event(mark))
                self._outbox.note_sent(mark, time.monotonic())
                continue
            if self._ending.is_set():
                return
            news = asyncio.create_task(self._news.wait())
            left_s = min(self._outbox.next_s(now_s), math.inf if self._up else HELD_S)
            await asyncio.wait(
                {news, closed},
                timeout=None if math.isinf(left_s) else left_s,
                return_when=asyncio.FIRST_COMPLETED,
            )
            news.cancel()
        raise ConnectionResetError("the receiver has closed the connection")

    def _note_link(self) -> None:
        news = "the link is back" if self._was_up else "linked"
        self._up = self._was_up = True
        self._report(f"TAK: {news}: {self._url}")

    def _note_loss(self, error: Exception) -> None:
        if self._up is False:
            return
        before, self._up = self._up, False
        news = "the link is lost" if before else "no link yet"
        why = "no answer" if isinstance(error, TimeoutError) else str(error) or repr(error)
        self._report(f"TAK: {news}: {self._url} ({why}); the flight continues, and it tries again")


async def _send(writer: Any, data: bytes) -> None:
    if not hasattr(writer, "send"):
        writer.write(data)
        await writer.drain()
        return
    while True:
        try:
            await writer.send(data)
            return
        except ConnectionRefusedError:  # for an earlier datagram: no receiver yet
            continue


async def _discard(reader: asyncio.StreamReader | None) -> None:
    """Discard the messages of the receiver; return when it closes the connection."""
    if reader is None:  # datagrams have no connection
        await asyncio.Event().wait()
        return
    with contextlib.suppress(OSError):
        while await reader.read(1 << 16):
            pass


def _tune(writer: Any) -> None:
    """Allow one mark at most in the write buffer, and detect a receiver that is gone."""
    if hasattr(writer, "send"):
        return
    writer.transport.set_write_buffer_limits(1)  # with 0, a TLS transport pauses for good
    connection = writer.get_extra_info("socket")
    connection.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, BUFFER_BYTES)
    connection.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
    if hasattr(socket, "TCP_USER_TIMEOUT"):
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT, SILENT_MS)
