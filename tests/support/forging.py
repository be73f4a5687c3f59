"""Whole simulated flights while a forger sends frames of the vehicle.

During a flight the session gets forged frames beside the vehicle's own. `random` frames have any
type and value. `poisoned` frames have the types that are read, with the worst values. Both have the
vehicle's own ids; `strangers` have other ids and components.

A forged heartbeat in another mode can make the mission stand aside. This is no fault: it looks
exactly like a pilot. Forged announcements name pictures on other hosts and of other kinds.
"""

from __future__ import annotations

import asyncio
import contextlib
import functools
import random
import sys
from collections.abc import Iterator
from typing import Any
from unittest import mock

from pymavlink.dialects.v20 import ardupilotmega as mav

import uavmap.runner.simulation
from tests.benchmarks.watched import WatchedFlight, fly_watched, mission_text
from tests.support.hostile import Hostile
from uavmap.aircraft.imaging.http_pictures import PictureFetcher

KINDS = ("random", "poisoned", "strangers")
READ = (
    "HEARTBEAT", "GLOBAL_POSITION_INT", "HOME_POSITION", "SYS_STATUS", "BATTERY_STATUS",
    "EXTENDED_SYS_STATE", "EKF_STATUS_REPORT", "ATTITUDE", "AUTOPILOT_VERSION", "STATUSTEXT",
    "COMMAND_ACK", "CAMERA_IMAGE_CAPTURED",
)  # fmt: skip
URLS = (
    "http://203.0.113.7/one.jpg", "http://localhost:9/one.jpg", "file:///etc/passwd",
    "http://[::1]:9/one.jpg", "http://203.0.113.7:99999/", "ftp://203.0.113.7/one.jpg", "sim://1/0",
)  # fmt: skip
HOSTS = ("192.0.2.1",)
"""Hosts named in the mission; the forger sends for none of these."""
MISSION = "speck"
BURST_S = 0.1
LASTS_S = 75.0
"""Approximate duration of an undisturbed flight of the mission, s."""


class Forger:
    def __init__(self, kind: str, seed: int) -> None:
        self._kind = kind
        self._rng = random.Random(seed)
        self._hostile = Hostile(seed)

    def frame(self) -> bytes:
        rng, kind = self._rng, self._kind
        if kind == "strangers":
            system, component = rng.choice(((1, 180), (1, 2), (1, 25), (2, 1), (77, 1), (255, 190)))
            message = self._read() if rng.random() < 0.5 else self._any()
        else:
            system, component = 1, rng.choice((1, 1, 1, 100))
            message = self._read() if kind == "poisoned" else self._any()
        return bytes(message.pack(mav.MAVLink(None, srcSystem=system, srcComponent=component)))

    def _any(self) -> Any:
        return self._hostile._fill(self._hostile._any_type(), wrong_target=False)

    def _read(self) -> Any:
        name = self._rng.choice(READ)
        if name == "CAMERA_IMAGE_CAPTURED" and self._rng.random() < 0.7:
            return self._announcement()
        kind = mav.mavlink_map[getattr(mav, f"MAVLINK_MSG_ID_{name}")]
        return self._hostile._fill(kind, wrong_target=False)

    def _announcement(self) -> Any:
        """Return the announcement of a picture that is plausible but for its address."""
        index, url = self._rng.randrange(500), self._rng.choice(URLS).encode()
        down = [0.7071068, 0.0, -0.7071068, 0.0]
        return mav.MAVLink_camera_image_captured_message(
            1000 * index, 0, 1, 473000000, 85000000, 500000, 12000, down, index, 1, url
        )


@contextlib.contextmanager
def forging(kind: str, seed: int, frames: int) -> Iterator[None]:
    """Forge frames for the sessions of simulations while the context lasts."""
    before = uavmap.runner.simulation.Simulation
    fetcher = PictureFetcher(lambda: HOSTS)

    class Forged(before):  # type: ignore[misc, valid-type]
        async def run(self) -> None:
            forger = Forger(kind, seed)
            burst = max(round(frames * BURST_S / LASTS_S), 1)

            async def forge() -> None:
                for _ in range(frames // burst):
                    for session in self._sessions.values():
                        for _ in range(burst):
                            session.feed(forger.frame())
                    await asyncio.sleep(BURST_S)

            async with asyncio.TaskGroup() as tasks:
                tasks.create_task(forge())
                await super().run()

        async def fetch(self, url: str) -> bytes:
            if url.startswith("sim://"):
                return bytes(await super().fetch(url))
            return await fetcher(url)

    with mock.patch.object(uavmap.runner.simulation, "Simulation", Forged):
        yield


@functools.cache
def network() -> list[str]:
    """Return the connections that this process tries from now on; the recording never stops."""
    reached: list[str] = []

    def record(event: str, arguments: tuple[object, ...]) -> None:
        if event in ("socket.connect", "socket.getaddrinfo", "socket.sendto", "urllib.Request"):
            reached.append(f"{event} {arguments[-1]}")

    sys.addaudithook(record)
    return reached


def fly(kind: str, seed: int, frames: int) -> tuple[WatchedFlight, tuple[str, ...]]:
    network().clear()
    with forging(kind, seed, frames):
        flight = fly_watched(f"{kind} seed {seed}", mission_text(MISSION), seed)
    return flight, tuple(network())
