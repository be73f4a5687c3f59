"""Real autopilots in their own simulations: how each is started, failed and stopped."""

from __future__ import annotations

import asyncio
import contextlib
import math
import os
import socket
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar, Final

from pymavlink.dialects.v20 import ardupilotmega as mav

from missions.units import LatLon
from tests.real.pilot import Message, Pilot

Values = Mapping[str, float]

TRUTH_HZ: Final = 40.0
_GONE_S: Final = 5.0


class NotSimulatedError(Exception):
    """The simulation of this autopilot cannot have this happen."""


@dataclass(frozen=True, slots=True)
class Truth:
    """Where an aircraft really is, by its simulation, and how it moves (north, east, down)."""

    t_s: float
    position: LatLon
    amsl_m: float
    attitude_rad: tuple[float, float, float]
    velocity_m_s: tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class Pad:
    """Where an aircraft stands."""

    instance: int
    """Of the autopilot's program: its ports and its system follow from it."""
    place: LatLon
    amsl_m: float
    folder: Path


class Autopilot(ABC):
    """One process of an autopilot with the simulation of one aircraft."""

    name: ClassVar[str]
    """As a mission calls it."""
    ours: ClassVar[str]
    """The mode by which a pilot gives an aircraft back."""
    by_hand: ClassVar[Sequence[str]]
    """Modes of a pilot's switch in which the aircraft stays in the air for a while."""
    failures: ClassVar[Mapping[str, Values]]
    """Parameters that make something fail."""
    always: ClassVar[Values] = {}
    """What its owner has set, in every scenario."""
    ports: ClassVar[tuple[int, ...]]
    """Ports that its instance 0 has for itself, by UDP."""
    step: ClassVar[int]
    """From one instance's ports to the next."""
    most: ClassVar[int]
    """Instances that can run at a time."""

    @classmethod
    def free_instance(cls, vehicles: int) -> int:
        """The first of so many instances in a row whose ports are free."""
        for first in range(0, cls.most - vehicles + 1):
            wanted = range(first, first + vehicles)
            if all(_is_free(port + cls.step * i) for port in cls.ports for i in wanted):
                return first
        raise AssertionError(f"too many of {cls.name} run on this computer")

    def __init__(self, program: Path, pad: Pad, extra: Values) -> None:
        self.program, self.pad = program, pad
        self.speed = 1.0
        """Times real time."""
        self.relay_port = _free_port()
        """Where it sends to on its first link."""
        self.extra: Values = {**self.always, **extra}
        self.truth: Truth | None = None
        self.system = pad.instance + 1
        self.pilot = self._pilot()
        self._process: asyncio.subprocess.Process | None = None

    @abstractmethod
    def _pilot(self) -> Pilot: ...

    @abstractmethod
    async def start(self, speed: float) -> None:
        """Start it, and have the second link ask for what the referee and the camera need."""

    @abstractmethod
    async def keep_pace(self, speed: float) -> None:
        """Let its time pass at this speed from now on; it may start anew for that."""

    @abstractmethod
    async def set_mode(self, mode: str) -> None:
        """Turn the pilot's switch."""

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
        """Let something fail. Raises `NotSimulatedError`."""
        if what not in self.failures:
            raise NotSimulatedError(f"{self.name} simulates no {what}")
        for name, value in self.failures[what].items():
            await self.pilot.set_parameter(name, value)

    async def version(self) -> str:
        """The version that it tells."""
        ask = mav.MAVLink_command_long_message(
            self.system, 1, mav.MAV_CMD_REQUEST_MESSAGE, 0, 148, 0, 0, 0, 0, 0, 0
        )
        told = await self.pilot.heard(lambda m: m.get_type() == "AUTOPILOT_VERSION", ask)
        assert told is not None, "it does not tell its version"
        parts = told.flight_sw_version
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

    async def _run(self, *words: object, env: Mapping[str, str] | None = None) -> None:
        with (self.pad.folder / "autopilot.log").open("wb") as log:
            self._process = await asyncio.create_subprocess_exec(
                *map(str, words), cwd=self.pad.folder, env={**os.environ, **(env or {})},
                stdin=asyncio.subprocess.DEVNULL, stdout=log, stderr=log,
            )  # fmt: skip


class ArduCopter(Autopilot):
    """ArduCopter in its SITL."""

    name = "ardupilot"
    ours = "GUIDED"
    ports, step, most = (5501,), 10, 90
    by_hand = ("LOITER", "BRAKE", "ALT_HOLD", "POSHOLD", "STABILIZE", "RTL")
    MODES: ClassVar[Mapping[str, int]] = {
        "STABILIZE": 0, "ALT_HOLD": 2, "GUIDED": 4, "LOITER": 5, "RTL": 6, "LAND": 9,
        "POSHOLD": 16, "BRAKE": 17,
    }  # fmt: skip
    failures: ClassVar[Mapping[str, Values]] = {
        "battery": {"SIM_BATT_VOLTAGE": 9.9},
        "satellites": {"SIM_GPS_DISABLE": 1.0},
        "glitch": {"SIM_GPS_GLITCH_X": 0.0005},
        "motor": {"SIM_ENGINE_MUL": 0.0, "SIM_ENGINE_FAIL": 1.0},
        "small fence": {"FENCE_ALT_MAX": 11.0},
        "radio": {"SIM_RC_FAIL": 1.0},
        "no glitch": {"SIM_GPS_GLITCH_X": 0.0},
        "radio back": {"SIM_RC_FAIL": 0.0},
    }
    always: ClassVar[Values] = {
        "BATT_LOW_VOLT": 10.5, "BATT_FS_LOW_ACT": 2.0, "BATT_CRT_VOLT": 9.0, "BATT_FS_CRT_ACT": 1.0,
    }  # fmt: skip

    def _pilot(self) -> Pilot:
        names = {number: name for name, number in self.MODES.items()}
        return Pilot(
            self.system, lambda m: names.get(m.custom_mode, str(m.custom_mode)), bytewise=False
        )

    async def start(self, speed: float) -> None:
        """Start it: its second serial port is the mission's.

        The first is the pilot's: it is a cable (USB), and hears also what is not signed.
        """
        self.speed = speed
        folder, pad = self.pad.folder, self.pad
        extra = folder / "extra.parm"
        extra.write_text("".join(f"{key} {value}\n" for key, value in self.extra.items()))
        defaults = self.program.parents[3] / "Tools/autotest/default_params/copter.parm"
        first = _free_port()
        await self.pilot.open(first)
        home = f"{pad.place.lat_deg:.8f},{pad.place.lon_deg:.8f},{pad.amsl_m},0"
        await self._run(
            self.program, "--model", "+", "--home", home, "--speedup", f"{speed:g}",
            f"-I{pad.instance}", "--sysid", self.system, "--defaults",
            f"{defaults},{extra}", "--serial0", f"udpclient:127.0.0.1:{first}",
            "--serial1", f"udpclient:127.0.0.1:{self.relay_port}",
        )  # fmt: skip
        self.pilot.follow.append(self._see)
        await self.pilot.awake()
        for message_id, rate_hz in ((0, 5), (1, 2), (30, TRUTH_HZ), (33, 20), (108, TRUTH_HZ)):
            await self.pilot.stream(message_id, rate_hz)

    async def keep_pace(self, speed: float) -> None:
        """Let its time pass at this speed."""
        self.speed = speed
        await self.pilot.set_parameter("SIM_SPEEDUP", speed)

    def _see(self, told: Message) -> None:
        if told.get_type() != "SIM_STATE":
            return
        lat, lon = told.lat_int / 1e7, told.lon_int / 1e7
        self.truth = Truth(
            self.pilot.time_s, LatLon(lat, lon), told.alt, (told.roll, told.pitch, told.yaw),
            (told.vn, told.ve, told.vd),
        )  # fmt: skip

    async def set_mode(self, mode: str) -> None:
        """Turn the pilot's switch."""
        await self.pilot.command(mav.MAV_CMD_DO_SET_MODE, 1, self.MODES[mode])

    def hold_sticks(self, centred: bool) -> None:
        """Override the channels with their middle, or give them back to the simulated radio."""
        at = 1500 if centred else 0
        self.pilot.sticks = lambda: mav.MAVLink_rc_channels_override_message(
            self.system, 1, at, at, at, at, 0, 0, 0, 0
        )

    async def take_off(self, height_m: float) -> None:
        """Take off in GUIDED."""
        await self.set_mode("GUIDED")
        await self.pilot.command(mav.MAV_CMD_COMPONENT_ARM_DISARM, 1)
        await self.pilot.command(mav.MAV_CMD_NAV_TAKEOFF, 0, 0, 0, 0, 0, 0, height_m)

    async def swap_battery(self) -> None:
        """Give an aircraft on the ground a fresh battery."""
        await self.pilot.command(mav.MAV_CMD_BATTERY_RESET, 1, 100)


class Px4(Autopilot):
    """PX4 in its SITL, with its simulation in hardware (SIH, airframe 10040)."""

    name = "px4"
    ours = "HOLD"
    # above instance 9 all send to one port
    ports, step, most = (14580, 18570), 1, 10
    by_hand = ("POSITION", "ALTITUDE", "RTL")
    MODES: ClassVar[Mapping[str, tuple[int, int]]] = {
        "MANUAL": (1, 0), "ALTITUDE": (2, 0), "POSITION": (3, 0), "TAKEOFF": (4, 2),
        "HOLD": (4, 3), "MISSION": (4, 4), "RTL": (4, 5), "LAND": (4, 6), "OFFBOARD": (6, 0),
        "STABILIZED": (7, 0), "DESCEND": (4, 12),
    }  # fmt: skip
    failures: ClassVar[Mapping[str, Values]] = {
        "battery": {"SIM_BAT_DRAIN": 40.0},
        "satellites": {"SIM_GPS_USED": 0.0},
        "small fence": {"GF_MAX_VER_DIST": 10.0},
    }
    always: ClassVar[Values] = {
        "SIM_BAT_DRAIN": 720.0, "SIM_BAT_MIN_PCT": 0.0, "SDLOG_MODE": -1.0, "COM_LOW_BAT_ACT": 3.0,
    }  # fmt: skip

    def __init__(self, program: Path, pad: Pad, extra: Values) -> None:
        super().__init__(program, pad, extra)
        self.relay_port = 14540 + pad.instance
        self._true = _Listener(self)

    def _pilot(self) -> Pilot:
        names = {numbers: name for name, numbers in self.MODES.items()}

        def mode_of(beat: Message) -> str:
            numbers = beat.custom_mode >> 16 & 255, beat.custom_mode >> 24 & 255
            return names.get(numbers, str(numbers))

        peer = ("127.0.0.1", 18570 + self.pad.instance)
        return Pilot(self.system, mode_of, bytewise=True, peer=peer)

    async def start(self, speed: float) -> None:
        """Start it; the simulation sends the truth to a port of its own."""
        await asyncio.get_running_loop().create_datagram_endpoint(
            lambda: self._true, local_addr=("127.0.0.1", 19410 + self.pad.instance)
        )
        await self.pilot.open(0)
        await self._begin(speed)

    async def keep_pace(self, speed: float) -> None:
        """Start it anew: it knows one speed only."""
        await self._end()
        await self._begin(speed)

    async def _begin(self, speed: float) -> None:
        pad, etc = self.pad, self.program.parents[1] / "etc"
        self.speed = speed
        self.pilot.forget()
        environment = {
            "PX4_SYS_AUTOSTART": "10040", "PX4_SIMULATOR": "sihsim",
            "PX4_SIM_MODEL": "sihsim_quadx",
            "PX4_HOME_LAT": f"{pad.place.lat_deg:.7f}", "PX4_HOME_LON": f"{pad.place.lon_deg:.7f}",
            "PX4_HOME_ALT": f"{pad.amsl_m}",
        }  # fmt: skip
        if speed != 1.0:
            environment["PX4_SIM_SPEED_FACTOR"] = f"{speed:g}"
        environment |= {f"PX4_PARAM_{key}": f"{value:g}" for key, value in self.extra.items()}
        await self._run(
            self.program, "-d", "-i", pad.instance, "-w", pad.folder, "-s",
            "etc/init.d-posix/rcS", etc, env=environment,
        )  # fmt: skip
        await self.pilot.awake()
        await self.pilot.stream(0, 5)
        if speed != 1.0:  # its scripts lengthen this by the speed of time, which needs it not
            await self.pilot.set_parameter("COM_OF_LOSS_T", 1.0)

    def see(self, told: Message) -> None:
        """Take the truth."""
        w, x, y, z = told.attitude_quaternion
        roll = math.atan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y))
        pitch = math.asin(max(-1.0, min(1.0, 2 * (w * y - z * x))))
        yaw = math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))
        self.truth = Truth(
            self.pilot.time_s, LatLon(told.lat / 1e7, told.lon / 1e7), told.alt / 1000.0,
            (roll, pitch, yaw), (told.vx / 100.0, told.vy / 100.0, told.vz / 100.0),
        )  # fmt: skip

    async def set_mode(self, mode: str) -> None:
        """Turn the pilot's switch."""
        await self.pilot.command(mav.MAV_CMD_DO_SET_MODE, 1, *self.MODES[mode])

    async def take_off(self, height_m: float) -> None:
        """Take off in its own mode for that."""
        await self.pilot.command(mav.MAV_CMD_COMPONENT_ARM_DISARM, 1)
        nan, up_m = math.nan, self.pad.amsl_m + height_m
        await self.pilot.command(mav.MAV_CMD_NAV_TAKEOFF, 0, 0, 0, nan, nan, nan, up_m)

    def hold_sticks(self, centred: bool) -> None:
        """Send the middle of all sticks, or nothing: then the radio control is lost."""
        message = mav.MAVLink_manual_control_message(self.system, 0, 0, 500, 0, 0)
        self.pilot.sticks = (lambda: message) if centred else None

    async def fail(self, what: str) -> None:
        """Let something fail: a lost radio control is one that sends nothing more."""
        if what in ("radio", "radio back"):
            self.hold_sticks(centred=what == "radio back")
        else:
            await super().fail(what)

    async def swap_battery(self) -> None:
        """Do nothing: on the ground its simulated battery is full at once."""

    async def stop(self) -> None:
        """End it."""
        self._true.close()
        await super().stop()


class _Listener(asyncio.DatagramProtocol):
    """Where the simulation of a PX4 sends where it really is."""

    def __init__(self, autopilot: Px4) -> None:
        self._autopilot = autopilot
        self._in = mav.MAVLink(None)
        self._in.robust_parsing = True
        self._transport: asyncio.BaseTransport | None = None

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        self._transport = transport

    def datagram_received(self, data: bytes, addr: tuple[str | Any, int]) -> None:
        for message in self._in.parse_buffer(data) or ():
            if message.get_type() == "HIL_STATE_QUATERNION":
                self._autopilot.see(message)

    def close(self) -> None:
        if self._transport is not None:
            self._transport.close()


PROGRAMS: Final[Mapping[str, type[Autopilot]]] = {"ardupilot": ArduCopter, "px4": Px4}


def _free_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as one:
        one.bind(("127.0.0.1", 0))
        port: int = one.getsockname()[1]
        return port


def _is_free(port: int) -> bool:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as one, contextlib.suppress(OSError):
        one.bind(("127.0.0.1", port))
        return True
    return False
