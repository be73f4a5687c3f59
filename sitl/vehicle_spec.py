"""The parts of a simulated vehicle, its true state, and the choice of its autopilot."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import IntEnum
from typing import NamedTuple

from missions.units import LatLon
from sitl.ardupilot.autopilot import Autopilot
from sitl.ardupilot.commands import ArduPilotCommands
from sitl.camera.pinhole import CameraSpec
from sitl.mavlink.commands import Commands
from sitl.mavlink.interpreter import Interpreter
from sitl.mavlink.telemetry import Telemetry
from sitl.px4.autopilot import Px4Autopilot
from sitl.px4.commands import Px4Commands
from sitl.px4.interpreter import Px4Interpreter
from sitl.px4.telemetry import Px4Telemetry
from sitl.quirks import Quirks

MAX_DRIFT = 0.5


@dataclass(frozen=True, kw_only=True)
class Equipment:
    """The equipment on board of vehicles.

    Attributes:
        autopilot: A name in `FLAVOURS`.
        swap_after_s: How long it stands disarmed before the crew swaps its battery; 0: never.
        gps_sigma_m: Standard deviation of the horizontal position error.
        gps_tau_s: Correlation time of that error.
        optical_flow: Without satellites it navigates by optical flow, which errs by the share
            `odometry_drift` of the distance.
        ready_after_s: From boot until arming is allowed.
    """

    autopilot: str = "ardupilot"
    battery_wh: float = 60.0
    hover_power_w: float = 300.0
    swap_after_s: float = 60.0
    camera: CameraSpec = field(default_factory=CameraSpec)
    gps_sigma_m: float = 0.3
    gps_tau_s: float = 60.0
    optical_flow: bool = False
    odometry_drift: float = 0.02
    ready_after_s: float = 5.0
    quirks: Quirks = field(default_factory=Quirks)


@dataclass(frozen=True)
class VehicleSpec(Equipment):
    """One vehicle.

    `image_url_prefix`: what the pictures' addresses begin with; the system id and the picture's
    index follow. `parameters` of the autopilot are set before it flies.
    """

    system_id: int
    home: LatLon
    home_yaw_deg: float = 0.0
    max_speed_m_s: float = 15.0
    max_accel_m_s2: float = 3.0
    max_tilt_deg: float = 30.0
    image_url_prefix: str = "sim://"
    parameters: tuple[tuple[str, float], ...] = ()

    def __post_init__(self) -> None:
        problems = []
        if not 1 <= self.system_id <= 254:
            problems.append("system_id is 1 to 254")
        if not (self.gps_sigma_m >= 0.0 and self.gps_tau_s > 0.0):
            problems.append("gps_sigma_m is not negative, gps_tau_s positive")
        if not 0.0 <= self.odometry_drift <= MAX_DRIFT:
            problems.append(f"odometry_drift is a share of 0 to {MAX_DRIFT:g}")
        if not (self.max_speed_m_s > 0.0 and self.max_accel_m_s2 > 0.0):
            problems.append("max_speed_m_s and max_accel_m_s2 are positive")
        if not 5.0 <= self.max_tilt_deg <= 30.0:
            problems.append("max_tilt_deg is 5 to 30")
        if not (self.hover_power_w > 0.0 and self.battery_wh > 0.0):
            problems.append("battery_wh and hover_power_w are positive")
        if self.quirks.camera == "autopilot" and self.autopilot != "ardupilot":
            problems.append("camera 'autopilot' is an ArduPilot's, its CAM1_TYPE")
        if len(self.image_url_prefix) > 180:
            problems.append("image_url_prefix is at most 180 characters")
        if problems:
            raise ValueError(f"vehicle {self.system_id}: " + "; ".join(problems))


@dataclass(frozen=True, slots=True)
class VehicleTruth:
    """The true state, which no client sees.

    `velocity_m_s` is (east, north, up), `yaw_rad` true bearing, `height_m` over the ground.
    """

    t_s: float
    position: LatLon
    height_m: float
    velocity_m_s: tuple[float, float, float]
    roll_rad: float
    pitch_rad: float
    yaw_rad: float
    armed: bool
    landed: bool
    crashed: bool
    energy_wh: float
    mode: IntEnum
    swaps: int
    failsafe: bool
    """One of its own failsafes is on."""
    estimate_error_m: tuple[float, float] = (0.0, 0.0)
    """Error of the autopilot's position estimate (east, north)."""


class Flavour(NamedTuple):
    """The classes of one autopilot."""

    aircraft: type[Autopilot | Px4Autopilot]
    telemetry: type[Telemetry]
    commands: type[Commands]
    interpreter: type[Interpreter]


FLAVOURS: Mapping[str, Flavour] = {
    "ardupilot": Flavour(Autopilot, Telemetry, ArduPilotCommands, Interpreter),
    "px4": Flavour(Px4Autopilot, Px4Telemetry, Px4Commands, Px4Interpreter),
}
