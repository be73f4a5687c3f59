"""Simulated vehicles on loopback sockets, in real time or at a speed-up.

UDP: a vehicle sends to a port where a client listens (MAVSDK's `udpin://127.0.0.1:14550`), and to
each client that has sent to it. TCP: a vehicle listens and serves one client at a time
(`tcpout://127.0.0.1:5760`), as ArduPilot's own simulator does. HTTP serves the announced pictures.
"""

from __future__ import annotations

import asyncio
import contextlib
import socket
import threading
import time
from collections.abc import Callable, Sequence
from concurrent.futures import Future
from typing import Literal, TypeAlias, TypeVar
from urllib.parse import urlsplit

from sitl.sockets.client_sockets import LOOPBACK, TcpPort, UdpPort
from sitl.vehicle import SimVehicle

_MAX_HEADER_BYTES = 16_384
_IDLE_S = 30.0


class PictureServer:
    """Serves what `find(path)` returns over HTTP/1.1, GET only; `path` begins with a slash.

    It answers between two steps of the vehicles, so it renders a picture without a lock.
    """

    def __init__(self, find: Callable[[str], bytes | None]) -> None:
        self._find = find
        self._server: asyncio.Server | None = None
        self._writers: set[asyncio.StreamWriter] = set()
        self._talks: set[asyncio.Task[None]] = set()

    async def open(self, port: int) -> int:
        """Listen on 127.0.0.1 at `port`, 0 for any free one; return the port."""
        self._server = await asyncio.start_server(
            self._talk, LOOPBACK, port, limit=_MAX_HEADER_BYTES
        )
        return int(self._server.sockets[0].getsockname()[1])

    async def close(self) -> None:
        """Close the listening socket and every connection."""
        if self._server is None:
            return
        self._server.close()
        for writer in list(self._writers):
            writer.close()
        await self._server.wait_closed()
        if self._talks:  # they end by themselves now that their connections are closed
            await asyncio.wait(self._talks)

    async def _talk(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self._writers.add(writer)
        if (task := asyncio.current_task()) is not None:
            self._talks.add(task)
            task.add_done_callback(self._talks.discard)
        try:
            while await self._answer(reader, writer):
                pass
        except (
            TimeoutError,
            ConnectionError,
            asyncio.IncompleteReadError,
            asyncio.LimitOverrunError,
        ):
            pass  # the other side is gone, silent, or speaks no HTTP: only its connection ends
        finally:
            self._writers.discard(writer)
            writer.close()

    async def _answer(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> bool:
        """Answer one request; return whether the connection stays open."""
        async with asyncio.timeout(_IDLE_S):
            head = await reader.readuntil(b"\r\n\r\n")
        lines = head.decode("latin-1").split("\r\n")
        words = lines[0].split(" ")
        headers = {
            name.strip().lower(): value.strip().lower()
            for name, _, value in (line.partition(":") for line in lines[1:])
        }
        if len(words) != 3 or not words[2].startswith("HTTP/1."):
            writer.write(_response("400 Bad Request", b"", "close"))
            return False
        # a body would be read as the next request: such a connection ends here
        keep = words[2] == "HTTP/1.1" and headers.get("connection") != "close"
        keep = keep and headers.get("content-length", "0") == "0"
        keep = keep and "transfer-encoding" not in headers
        connection = "keep-alive" if keep else "close"
        if words[0] not in ("GET", "HEAD"):
            writer.write(_response("405 Method Not Allowed", b"", connection))
        elif (data := self._find(words[1].partition("?")[0])) is None:
            writer.write(_response("404 Not Found", b"", connection))
        else:
            writer.write(_response("200 OK", data, connection, words[0] == "HEAD"))
        await writer.drain()
        return keep


def _response(status: str, body: bytes, connection: str, head_only: bool = False) -> bytes:
    head = (
        f"HTTP/1.1 {status}\r\n"
        "Content-Type: image/jpeg\r\n"
        f"Content-Length: {len(body)}\r\n"
        f"Connection: {connection}\r\n\r\n"
    )
    return head.encode("ascii") + (b"" if head_only else body)


PORTS_BETWEEN_VEHICLES = 10
BASE_PORT = {"udp": 14550, "tcp": 5760}

_STEP_S = 0.05
_TICK_S = 0.01  # interval of checks whether a step is due
_BURST_S = 0.1  # wall time of stepping before the sockets get their turn

Transport: TypeAlias = Literal["udp", "tcp"]
Port: TypeAlias = UdpPort | TcpPort


async def serve(
    vehicles: Sequence[SimVehicle],
    *,
    speedup: float = 1.0,
    transport: Transport = "udp",
    base_port: int | None = None,
    http_port: int | None,
    on_ready: Callable[[list[str]], None],
) -> None:
    """Fly `vehicles` of one world on loopback sockets until cancelled; then close all sockets.

    Args:
        transport: "udp": the client listens. Vehicle i sends to 127.0.0.1, port `base_port + 10 i`
            (14550 first). It sends to at most seven others as well that have sent to it. With "tcp"
            the vehicle listens at that port (5760 first), its USB port. Unsigned frames are
            accepted there.
        http_port: Port of the pictures; the vehicles' `image_url_prefix` begins with its address.
            None: pictures are not served.
        on_ready: Receives the URLs to connect with, in the order of the vehicles.

    Raises:
        ValueError: A speed-up or a picture address that cannot be served.
        OSError: A port is taken.
    """
    if not 0.0 < speedup <= 1000.0:
        raise ValueError(f"a speed-up is above 0 and at most 1000: {speedup}")
    if transport not in BASE_PORT:
        raise ValueError(f'a transport is "udp" or "tcp": {transport}')
    if http_port is not None:
        for vehicle in vehicles:
            _check_prefix(vehicle.spec.image_url_prefix, http_port)
    first = BASE_PORT[transport] if base_port is None else base_port
    pictures = PictureServer(lambda path: _find(vehicles, path))
    ports: list[Port] = []
    try:
        if http_port is not None:
            await pictures.open(http_port)
        for i, vehicle in enumerate(vehicles):
            vehicle.set_speedup(speedup)
            port = UdpPort(vehicle) if transport == "udp" else TcpPort(vehicle)
            ports.append(port)
            await port.open(first + PORTS_BETWEEN_VEHICLES * i)
        on_ready([port.url for port in ports])
        await _run(vehicles, ports, speedup)
    finally:
        for port in ports:
            await port.close()
        await pictures.close()


async def _run(vehicles: Sequence[SimVehicle], ports: Sequence[Port], speedup: float) -> None:
    """Keep the vehicles' time at `speedup` times real time.

    On a slow machine the simulation falls behind: what a burst cannot catch up with is dropped.
    """
    started_s, owed_s = time.monotonic(), 0.0
    while True:
        now_s = time.monotonic()
        owed_s += (now_s - started_s) * speedup
        started_s = now_s
        while owed_s >= _STEP_S:
            for vehicle, port in zip(vehicles, ports, strict=True):
                vehicle.step(_STEP_S)
                port.flush()
            owed_s -= _STEP_S
            if time.monotonic() - now_s > _BURST_S:
                owed_s = min(owed_s, _STEP_S)
                break
        await asyncio.sleep(max(0.0, min(_TICK_S, (_STEP_S - owed_s) / speedup)))


def _find(vehicles: Sequence[SimVehicle], path: str) -> bytes | None:
    for vehicle in vehicles:
        image = vehicle.image(vehicle.spec.image_url_prefix.rstrip("/") + path)
        if image is not None:
            return image
    return None


def _check_prefix(prefix: str, http_port: int) -> None:
    parts = urlsplit(prefix)
    if (parts.scheme, parts.hostname, parts.port, parts.path) != ("http", LOOPBACK, http_port, "/"):
        raise ValueError(
            f"pictures are served at http://{LOOPBACK}:{http_port}/, "
            f"but the vehicle announces them at {prefix}"
        )


_ANSWER_WAIT_S = 20.0

T = TypeVar("T")


class Background:
    """Serves vehicles in a thread of its own until `close`; raises `OSError` if it cannot."""

    def __init__(
        self, vehicles: Sequence[SimVehicle], *, speedup: float, tcp: bool = False
    ) -> None:
        self.urls: list[str] = []
        self._vehicles = vehicles
        self._failed: BaseException | None = None
        self._ready = threading.Event()
        self._loop = asyncio.new_event_loop()
        self._speedup = speedup
        self._transport: Transport = "tcp" if tcp else "udp"
        self._thread = threading.Thread(target=self._run, name="sitl", daemon=True)
        self._thread.start()
        if not self._ready.wait(_ANSWER_WAIT_S):
            raise OSError("the simulator did not open its sockets")
        if self._failed is not None:
            self._thread.join()
            raise OSError(f"the simulator could not open its sockets: {self._failed}")

    def ask(self, question: Callable[[], T]) -> T:
        """Return the answer to a question, put between two steps of the vehicles."""
        if not self._thread.is_alive():
            return question()
        answer: Future[T] = Future()

        def put() -> None:
            try:
                answer.set_result(question())
            except BaseException as error:
                answer.set_exception(error)

        self._loop.call_soon_threadsafe(put)
        return answer.result(_ANSWER_WAIT_S)

    def check(self) -> None:
        """Raise `RuntimeError` if the thread has died."""
        if self._failed is not None or not self._thread.is_alive():
            raise RuntimeError("the simulator has stopped") from self._failed

    def close(self) -> None:
        """End the thread and close every socket."""
        if self._thread.is_alive():
            self._loop.call_soon_threadsafe(self._task.cancel)
            self._thread.join(_ANSWER_WAIT_S)

    def _run(self) -> None:
        try:
            with asyncio.Runner(loop_factory=lambda: self._loop) as runner:
                runner.run(self._serve())
        except asyncio.CancelledError:
            pass
        except BaseException as error:  # raised in the thread that waits
            self._failed = error
        finally:
            self._ready.set()

    async def _serve(self) -> None:
        task = asyncio.current_task()
        assert task is not None
        self._task = task
        port, http_port = free_ports(len(self._vehicles), tcp=self._transport == "tcp")
        for vehicle in self._vehicles:
            vehicle.announce_pictures_at(f"http://{LOOPBACK}:{http_port}/")

        def ready(urls: list[str]) -> None:
            self.urls = urls
            self._ready.set()

        await serve(
            self._vehicles,
            speedup=self._speedup,
            base_port=port,
            http_port=http_port,
            transport=self._transport,
            on_ready=ready,
        )


def free_ports(vehicles: int, *, tcp: bool = False) -> tuple[int, int]:
    """Return a port that is free for each of `vehicles`, and one for pictures."""
    kind = socket.SOCK_STREAM if tcp else socket.SOCK_DGRAM
    for _ in range(100):
        with contextlib.ExitStack() as stack, contextlib.suppress(OSError, OverflowError):
            pictures = stack.enter_context(socket.socket(socket.AF_INET, socket.SOCK_STREAM))
            pictures.bind((LOOPBACK, 0))
            first = stack.enter_context(socket.socket(socket.AF_INET, kind))
            first.bind((LOOPBACK, 0))
            port = int(first.getsockname()[1])
            for i in range(1, vehicles):
                other = stack.enter_context(socket.socket(socket.AF_INET, kind))
                other.bind((LOOPBACK, port + PORTS_BETWEEN_VEHICLES * i))
            return port, int(pictures.getsockname()[1])
    raise OSError(f"no {vehicles} free ports in a row")
