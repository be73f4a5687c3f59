"""PX4 in its SITL, with its simulation in hardware (SIH, airframe 10040)."""

from __future__ import annotations

import fcntl
import math
from collections.abc import Mapping
from pathlib import Path
from typing import ClassVar

from pymavlink.dialects.v20 import ardupilotmega as mav

from missions.units import LatLon
from tests.real.autopilot import Autopilot, Pad, Truth, Values
from tests.real.pilot import Message, Pilot
from tests.real.sockets import Address, Socket


class Px4(Autopilot):
    name = "px4"
    ours = "HOLD"
    # above instance 9 all send to one port
    ports, step, most = (14580, 18570, 19410), 1, 10
    boot_speed = 4.0
    by_hand = ("POSITION", "ALTITUDE", "RTL")
    MODES: ClassVar[Mapping[str, tuple[int, int]]] = {
        "MANUAL": (1, 0), "ALTITUDE": (2, 0), "POSITION": (3, 0), "TAKEOFF": (4, 2),
        "HOLD": (4, 3), "MISSION": (4, 4), "RTL": (4, 5), "LAND": (4, 6), "OFFBOARD": (6, 0),
        "STABILIZED": (7, 0), "DESCEND": (4, 12),
    }  # fmt: skip
    failures: ClassVar[Mapping[str, Values]] = {
        "battery": {"SIM_BAT_DRAIN": 100.0},
        "satellites": {"SIM_GPS_USED": 0.0},
        "small fence": {"GF_MAX_VER_DIST": 10.0},
    }
    always: ClassVar[Values] = {
        "SIM_BAT_DRAIN": 720.0, "SIM_BAT_MIN_PCT": 0.0, "SDLOG_MODE": -1.0, "COM_LOW_BAT_ACT": 3.0,
    }  # fmt: skip

    lock: ClassVar[str] = "/tmp/px4_lock-{}"
    """Return the file that the program of an instance keeps locked."""

    @classmethod
    def is_free(cls, instance: int) -> bool:
        """Return whether its ports are free and no process has its lock."""
        try:
            with Path(cls.lock.format(instance)).open("r+b") as file:
                fcntl.lockf(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except FileNotFoundError:
            pass
        except OSError:  # locked, or another user's file, which PX4 cannot lock
            return False
        return super().is_free(instance)

    def __init__(self, program: Path, pad: Pad, extra: Values) -> None:
        super().__init__(program, pad, extra)
        self.relay_port = 14540 + pad.instance
        self._true = Socket(self._see)
        self._in = mav.MAVLink(None)
        self._in.robust_parsing = True

    def _pilot(self) -> Pilot:
        names = {numbers: name for name, numbers in self.MODES.items()}

        def mode_of(beat: Message) -> str:
            numbers = beat.custom_mode >> 16 & 255, beat.custom_mode >> 24 & 255
            return names.get(numbers, str(numbers))

        peer = ("127.0.0.1", 18570 + self.pad.instance)
        return Pilot(self.system, mode_of, bytewise=True, peer=peer)

    async def start(self, speed: float) -> None:
        """Start it; the simulation sends the truth to a port of its own."""
        await self._true.open(19410 + self.pad.instance)
        await self.pilot.open(0)
        await self._begin(speed)

    async def keep_pace(self, speed: float) -> None:
        """Restart it: it runs at one speed only."""
        await self._end()
        await self._begin(speed)
        await self._awake(ready=True)  # until it has started it answers for no parameter
        # its scripts change this by the speed of time, which passes nevertheless
        await self.pilot.set_parameter("COM_OF_LOSS_T", 1.0)

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
        await self._awake()
        await self.pilot.stream(0, 5)

    def _see(self, data: bytes, address: Address) -> None:
        for told in self._in.parse_buffer(data) or ():
            if told.get_type() == "HIL_STATE_QUATERNION":
                self._receive_truth(told)

    def _receive_truth(self, told: Message) -> None:
        w, x, y, z = told.attitude_quaternion
        roll = math.atan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y))
        pitch = math.asin(max(-1.0, min(1.0, 2 * (w * y - z * x))))
        yaw = math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))
        self.truth = Truth(
            self.pilot.time_s, LatLon(told.lat / 1e7, told.lon / 1e7), told.alt / 1000.0,
            (roll, pitch, yaw), (told.vx / 100.0, told.vy / 100.0, told.vz / 100.0),
        )  # fmt: skip

    async def set_mode(self, mode: str) -> None:
        await self.pilot.command(mav.MAV_CMD_DO_SET_MODE, 1, *self.MODES[mode])

    async def take_off(self, height_m: float) -> None:
        await self.pilot.command(mav.MAV_CMD_COMPONENT_ARM_DISARM, 1)
        nan, up_m = math.nan, self.pad.amsl_m + height_m
        await self.pilot.command(mav.MAV_CMD_NAV_TAKEOFF, 0, 0, 0, nan, nan, nan, up_m)

    def hold_sticks(self, centred: bool) -> None:
        """Send the middle of all sticks, or no message: then the radio control is lost."""
        message = mav.MAVLink_manual_control_message(self.system, 0, 0, 500, 0, 0)
        self.pilot.sticks = (lambda: message) if centred else None

    async def fail(self, what: str) -> None:
        """Cause a failure: a lost radio control sends no more messages."""
        if what in ("radio", "radio back"):
            self.hold_sticks(centred=what == "radio back")
        else:
            await super().fail(what)

    async def swap_battery(self) -> None:
        """Do nothing: on the ground its simulated battery is full at once."""

    async def stop(self) -> None:
        self._true.close()
        await super().stop()
