"""ArduCopter in its SITL, with its own default parameters."""

from __future__ import annotations

from collections.abc import Mapping
from socket import SOCK_DGRAM
from typing import ClassVar

from pymavlink.dialects.v20 import ardupilotmega as mav

from missions.units import LatLon
from tests.real.autopilot import TRUTH_HZ, Autopilot, Truth, Values
from tests.real.pilot import Message, Pilot
from tests.support.ports import free_port


class ArduCopter(Autopilot):
    name = "ardupilot"
    ours = "GUIDED"
    ports, step, most = (5501,), 10, 90
    boot_speed = 20.0
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
    # 12 minutes of hovering at its 30 A, as in the missions
    always: ClassVar[Values] = {
        "SIM_BATT_CAP_AH": 6.0, "BATT_CAPACITY": 6000.0,
        "BATT_LOW_VOLT": 10.5, "BATT_FS_LOW_ACT": 2.0, "BATT_CRT_VOLT": 9.0, "BATT_FS_CRT_ACT": 1.0,
    }  # fmt: skip

    def _pilot(self) -> Pilot:
        names = {number: name for name, number in self.MODES.items()}
        return Pilot(
            self.system, lambda m: names.get(m.custom_mode, str(m.custom_mode)), bytewise=False
        )

    async def start(self, speed: float) -> None:
        """Start it: its second serial port is the mission's.

        The first port is the pilot's: it is a cable (USB), and accepts unsigned frames as well.
        """
        self.speed = speed
        folder, pad = self.pad.folder, self.pad
        extra = folder / "extra.parm"
        extra.write_text("".join(f"{key} {value}\n" for key, value in self.extra.items()))
        defaults = self.program.parents[3] / "Tools/autotest/default_params/copter.parm"
        first = free_port(SOCK_DGRAM)
        await self.pilot.open(first)
        home = f"{pad.place.lat_deg:.8f},{pad.place.lon_deg:.8f},{pad.amsl_m},0"
        await self._run(
            self.program, "--model", "+", "--home", home, "--speedup", f"{speed:g}",
            f"-I{pad.instance}", "--sysid", self.system, "--defaults",
            f"{defaults},{extra}", "--serial0", f"udpclient:127.0.0.1:{first}",
            "--serial1", f"udpclient:127.0.0.1:{self.relay_port}",
        )  # fmt: skip
        self.pilot.follow.append(self._see)
        await self._awake()
        for message_id, rate_hz in ((0, 5), (1, 2), (30, TRUTH_HZ), (33, 20), (108, TRUTH_HZ)):
            await self.pilot.stream(message_id, rate_hz)

    async def keep_pace(self, speed: float) -> None:
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
        await self.pilot.command(mav.MAV_CMD_DO_SET_MODE, 1, self.MODES[mode])

    def hold_sticks(self, centred: bool) -> None:
        """Override the channels with their middle, or return them to the simulated radio."""
        at = 1500 if centred else 0
        self.pilot.sticks = lambda: mav.MAVLink_rc_channels_override_message(
            self.system, 1, at, at, at, at, 0, 0, 0, 0
        )

    async def fail(self, what: str) -> None:
        """Cause a failure: while channels are overridden no radio control is lost."""
        if what in ("radio", "radio back"):
            self.pilot.sticks = None
        await super().fail(what)
        if what == "radio back":
            self.hold_sticks(centred=True)

    async def take_off(self, height_m: float) -> None:
        await self.set_mode("GUIDED")
        await self.pilot.command(mav.MAV_CMD_COMPONENT_ARM_DISARM, 1)
        await self.pilot.command(mav.MAV_CMD_NAV_TAKEOFF, 0, 0, 0, 0, 0, 0, height_m)

    async def swap_battery(self) -> None:
        await self.pilot.set_parameter("SIM_BATT_VOLTAGE", 12.6)
        await self.pilot.command(mav.MAV_CMD_BATTERY_RESET, 1, 100)
