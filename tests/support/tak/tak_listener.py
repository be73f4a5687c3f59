"""A stand-in for a TAK server: it accepts and checks events by TCP, TLS or UDP on loopback."""

from __future__ import annotations

import contextlib
import re
import socket
import ssl
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from datetime import datetime
from functools import cached_property
from xml.etree.ElementTree import Element

from defusedxml import ElementTree
from takproto.functions import xml2message

PATIENCE_S = 30.0
END = b"</event>"


@dataclass(frozen=True)
class Event:
    xml: Element

    @property
    def uid(self) -> str:
        return self.xml.attrib["uid"]

    @cached_property
    def name(self) -> str:
        """Return its UID without the mission's."""
        return re.sub(r"^uavmap-[0-9a-f]{8}(-[0-9a-f]{4}){3}-[0-9a-f]{12}-", "", self.uid)

    @property
    def remarks(self) -> str:
        return self.xml.findtext("detail/remarks") or ""

    @property
    def stale_s(self) -> float:
        start, stale = (datetime.fromisoformat(self.xml.attrib[k]) for k in ("start", "stale"))
        return round((stale - start).total_seconds(), 3)

    @property
    def points(self) -> list[tuple[float, float]]:
        """Return latitude and longitude of each point of a shape."""
        links = (link.attrib.get("point") for link in self.xml.iterfind("detail/link"))
        return [tuple(map(float, link.split(","))) for link in links if link]  # type: ignore[misc]

    def value(self, name: str) -> str | None:
        found = self.xml.find(f"detail/{name}")
        return None if found is None else found.attrib["value"]


def checked(data: bytes) -> Event:
    """Parse an event, and check it with CoT's base schema, and TAK's own translation of it."""
    xml = ElementTree.fromstring(data.strip())
    assert xml.tag == "event"
    assert xml.attrib["version"] == "2.0"
    assert xml.attrib["uid"]
    assert xml.attrib["uid"] == " ".join(xml.attrib["uid"].split())
    assert re.fullmatch(r"\w+(-\w+)*(;[^;]*)?", xml.attrib["type"])
    assert re.fullmatch(r"\w(-\w+)*", xml.attrib["how"])
    times = [datetime.fromisoformat(xml.attrib[name]) for name in ("time", "start", "stale")]
    assert times == sorted(times)
    assert all(moment.tzinfo is not None for moment in times)
    assert [child.tag for child in xml] == ["point", "detail"]
    point = {name: float(value) for name, value in xml[0].attrib.items()}
    assert set(point) == {"lat", "lon", "hae", "ce", "le"}
    assert -90.0 <= point["lat"] <= 90.0
    assert -180.0 <= point["lon"] <= 180.0
    assert min(point["ce"], point["le"]) >= 0.0
    message = xml2message(data.strip())
    assert message.cotEvent.uid == xml.attrib["uid"]
    return Event(xml)


class Listener:
    """A server that can stop and start again at the same port; it keeps accepted `events`."""

    def __init__(self, scheme: str = "tcp", context: ssl.SSLContext | None = None) -> None:
        self.scheme, self._context = scheme, context
        self.events: list[Event] = []
        self.firsts: list[Event] = []
        """First event of each connection."""
        self.newest: dict[str, Event] = {}
        """Newest event by name."""
        self.faults: list[str] = []
        self.connections = 0
        self._changed = threading.Condition()
        self._sockets: list[socket.socket] = []
        self._threads: list[threading.Thread] = []
        self.port = 0
        self.open()

    @property
    def url(self) -> str:
        return f"{self.scheme}://127.0.0.1:{self.port}"

    def open(self) -> None:
        if self.scheme == "udp":
            listening = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
            listening.bind(("127.0.0.1", self.port))
        else:
            listening = socket.create_server(("127.0.0.1", self.port))
        self.port = listening.getsockname()[1]
        self._begin(listening, self._datagrams if self.scheme == "udp" else self._accept)

    def close(self) -> None:
        for one in self._sockets:
            with contextlib.suppress(OSError):
                one.shutdown(socket.SHUT_RDWR)  # wakes the thread that waits in `recv`
            one.close()
        for thread in self._threads:
            thread.join(PATIENCE_S)
        self._sockets.clear()
        self._threads.clear()

    def __enter__(self) -> Listener:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
        assert not self.faults

    def wait(self, condition: Callable[[], object]) -> None:
        with self._changed:
            assert self._changed.wait_for(condition, PATIENCE_S), self.faults

    # --- threads ---------------------------------------------------------------------------
    def _begin(self, one: socket.socket, run: Callable[[socket.socket], None]) -> None:
        self._sockets.append(one)
        self._threads.append(threading.Thread(target=run, args=(one,)))
        self._threads[-1].start()

    def _accept(self, listening: socket.socket) -> None:
        while True:
            try:
                connection, _ = listening.accept()
                if self._context is not None:
                    connection = self._context.wrap_socket(connection, server_side=True)
            except ssl.SSLError:
                continue
            except OSError:
                return
            self.connections += 1
            self._begin(connection, self._stream)

    def _stream(self, connection: socket.socket) -> None:
        left, number = b"", len(self.firsts)
        while piece := _received(connection):
            *whole, left = (left + piece).split(END)
            before = len(self.events)
            self._keep(*(part + END for part in whole))
            if len(self.firsts) == number:
                self.firsts += self.events[before : before + 1]

    def _datagrams(self, listening: socket.socket) -> None:
        while piece := _received(listening):
            self._keep(piece)

    def _keep(self, *events: bytes) -> None:
        for data in events:
            try:
                found = checked(data)
            except Exception as fault:
                self.faults.append(f"{fault!r}: {data!r}")
                continue
            with self._changed:
                self.events.append(found)
                self.newest[found.name] = found
                self._changed.notify_all()


def _received(one: socket.socket) -> bytes:
    try:
        return one.recv(1 << 16)
    except OSError:
        return b""


def until(condition: Callable[[], object]) -> None:
    """Wait for a condition that no thread of the listener notices."""
    due_s = time.monotonic() + PATIENCE_S
    while not condition():
        assert time.monotonic() < due_s
        time.sleep(0.01)
