"""Vehicles on loopback sockets in a thread of their own, whatever process the client is in."""

from __future__ import annotations

import asyncio
import contextlib
import socket
import threading
from collections.abc import Callable, Sequence
from concurrent.futures import Future
from typing import TypeVar

from sitl.sockets.server import LOOPBACK, PORTS_BETWEEN_VEHICLES, Transport, serve
from sitl.vehicle import SimVehicle

_PATIENCE_S = 20.0

T = TypeVar("T")


class Background:
    """Serves from its construction until `close`; raises `OSError` when it cannot."""

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
        if not self._ready.wait(_PATIENCE_S):
            raise OSError("the simulator did not open its sockets")
        if self._failed is not None:
            self._thread.join()
            raise OSError(f"the simulator could not open its sockets: {self._failed}")

    def ask(self, question: Callable[[], T]) -> T:
        """The answer to a question, put to the vehicles between two steps."""
        if not self._thread.is_alive():
            return question()
        answer: Future[T] = Future()

        def put() -> None:
            try:
                answer.set_result(question())
            except BaseException as error:
                answer.set_exception(error)

        self._loop.call_soon_threadsafe(put)
        return answer.result(_PATIENCE_S)

    def check(self) -> None:
        """Raise `RuntimeError` when the thread has died."""
        if self._failed is not None or not self._thread.is_alive():
            raise RuntimeError("the simulator has stopped") from self._failed

    def close(self) -> None:
        """End the thread and close every socket."""
        if self._thread.is_alive():
            self._loop.call_soon_threadsafe(self._task.cancel)
            self._thread.join(_PATIENCE_S)

    def _run(self) -> None:
        try:
            with asyncio.Runner(loop_factory=lambda: self._loop) as runner:
                runner.run(self._serve())
        except asyncio.CancelledError:
            pass
        except BaseException as error:  # told to whoever waits
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
    """A port whose neighbours, those of further vehicles, are free too; and one for pictures."""
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
