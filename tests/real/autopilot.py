"""The interface of a real autopilot in its own simulation, as the scenarios need it."""

from __future__ import annotations

import asyncio
import contextlib
import os
import time
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from socket import SOCK_DGRAM
from typing import ClassVar, Final

from pymavlink.dialects.v20 import ardupilotmega as mav

from missions.units import LatLon
from tests.real.pilot import Pilot
from tests.real.sockets import is_free
from tests.support.ports import free_port

Values = Mapping[str, float]

TRUTH_HZ: Final = 40.0
_GONE_S: Final = 5.0
_WAKES_S: Final = 180.0
_LAST_WORDS: Final = 500
"""Number of characters of a program's log that a failed start quotes."""


class NotSimulatedError(Exception):
    """The simulation of this autopilot cannot cause this failure."""


@dataclass(frozen=True, slots=True)
class Truth:
    """The true position of an aircraft, by its simulation, and its velocity (north, east, down)."""

    t_s: float
    """Time by the vehicle's own clock, s."""
    position: LatLon
    amsl_m: float
    attitude_rad: tuple[float, float, float]
    velocity_m_s: tuple[float, float, float]
    arrived_s: float = field(default_factory=time.monotonic)
    """Time of arrival by the computer's clock, which all vehicles share, s."""


@dataclass(frozen=True, slots=True)
class Pad:
    instance: int
    """Number of the autopilot's program: its ports and its system follow from it."""
    place: LatLon
    amsl_m: float
    folder: Path


class Autopilot(ABC):
    """One process of an autopilot with the simulation of one aircraft."""

    name: ClassVar[str]
    """Name in a mission file."""
    ours: ClassVar[str]
    """Mode by which a pilot gives an aircraft back."""
    boot_speed: ClassVar[float]
    """Speed at the start, times real time; the speed that it keeps measures the computer."""
    by_hand: ClassVar[Sequence[str]]
    """Modes of a pilot's switch in which the aircraft stays in the air for a while."""
    failures: ClassVar[Mapping[str, Values]]
    """Parameters that cause a failure."""
    always: ClassVar[Values] = {}
    """Parameters of the owner, in every scenario."""
    ports: ClassVar[tuple[int, ...]]
    """UDP ports that its instance 0 has for itself."""
    step: ClassVar[int]
    """Distance from one instance's ports to the next."""
    most: ClassVar[int]
    """Maximum number of instances at the same time."""

    @classmethod
    def free_instance(cls, vehicles: int) -> int:
        """Return the first of a number of consecutive free instances."""
        for first in range(0, cls.most - vehicles + 1):
            if all(cls.is_free(instance) for instance in range(first, first + vehicles)):
                return first
        raise AssertionError(f"too many of {cls.name} run on this computer")

    @classmethod
    def is_free(cls, instance: int) -> bool:
        return all(is_free(port + cls.step * instance) for port in cls.ports)

    def __init__(self, program: Path, pad: Pad, extra: Values) -> None:
        self.program, self.pad = program, pad
        self.speed = 1.0
        """Speed, times real time."""
        self.relay_port = free_port(SOCK_DGRAM)
        """Port to which it sends on its first link."""
        self.extra: Values = {**self.always, **extra}
        self.truth: Truth | None = None
        self.system = pad.instance + 1
        self.pilot = self._pilot()
        self._process: asyncio.subprocess.Process | None = None

    @abstractmethod
    def _pilot(self) -> Pilot: ...

    @abstractmethod
    async def start(self, speed: float) -> None:
        """Start it, and have the second link request the messages for referee and camera."""

    @abstractmethod
    async def keep_pace(self, speed: float) -> None:
        """Let its time pass at this speed from now on; it may restart for that."""

    @abstractmethod
    async def set_mode(self, mode: str) -> None:
        """Turn the pilot's mode switch."""

    @abstractmethod
    def hold_sticks(self, centred: bool) -> None:
        """Switch the radio control on with its sticks in the middle, or off."""

    @abstractmethod
    async def take_off(self, height_m: float) -> None:
        """Take off as a pilot with a ground station does."""

    @abstractmethod
    async def swap_battery(self) -> None:
        """Give an aircraft on the ground a fresh battery."""

    async def fail(self, what: str) -> None:
        """Cause a failure. Raises `NotSimulatedError`."""
        if what not in self.failures:
            raise NotSimulatedError(f"{self.name} simulates no {what}")
        for name, value in self.failures[what].items():
            await self.pilot.set_parameter(name, value)

    async def version(self) -> str:
        ask = mav.MAVLink_command_long_message(
            self.system, 1, mav.MAV_CMD_REQUEST_MESSAGE, 0, 148, 0, 0, 0, 0, 0, 0
        )
        parts = (await self.pilot.answer(ask, "AUTOPILOT_VERSION")).flight_sw_version
        return f"{parts >> 24}.{parts >> 16 & 255}.{parts >> 8 & 255}"

    async def stop(self) -> None:
        """End the process that `start` started, and the second link."""
        await self._end()
        self.pilot.close()

    async def _end(self) -> None:
        if self._process is None or self._process.returncode is not None:
            return
        self._process.terminate()
        with contextlib.suppress(TimeoutError):
            await asyncio.wait_for(self._process.wait(), _GONE_S)
        if self._process.returncode is None:
            self._process.kill()
            await self._process.wait()

    async def _awake(self, *, ready: bool = False) -> None:
        """Wait for the autopilot's first message, or until it would arm."""
        assert self._process is not None
        end_s, pilot = time.monotonic() + _WAKES_S, self.pilot
        while "HEARTBEAT" not in pilot.latest or (ready and not pilot.ready):
            code = self._process.returncode
            assert code is None, f"{self.name} ended with {code}: {self._last_words}"
            assert time.monotonic() < end_s, f"{self.name} does not wake up: {self._last_words}"
            await asyncio.sleep(0.1)

    @property
    def _last_words(self) -> str:
        text = self._log.read_text("utf-8", errors="replace")
        return " / ".join(text[-_LAST_WORDS:].split("\n")).strip(" /")

    @property
    def _log(self) -> Path:
        return self.pad.folder / "autopilot.log"

    async def _run(self, *words: object, env: Mapping[str, str] | None = None) -> None:
        with self._log.open("wb") as log:
            self._process = await asyncio.create_subprocess_exec(
                *map(str, words), cwd=self.pad.folder, env={**os.environ, **(env or {})},
                stdin=asyncio.subprocess.DEVNULL, stdout=log, stderr=log,
            )  # fmt: skip
