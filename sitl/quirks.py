"""Measured habits of real aircraft that burden a client.

The defaults were measured on an ArduCopter 4.6 and a PX4 1.17 and do not harm a correct client;
what only some aircraft have is off.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

CameraKind = Literal["component", "autopilot", "none"]
_MAX_PPM = 200_000.0
_MOST = {"home_moves_m": 20, "height_sigma_m": 8, "tilt_sigma_deg": 10, "heading_sigma_deg": 10}


@dataclass(frozen=True, slots=True, kw_only=True)
class Quirks:
    """The habits of one vehicle.

    Attributes:
        camera: "component": a MAVLink camera, component 100, that serves its pictures. "autopilot":
            an ArduPilot with CAM1_TYPE 1 answers the camera's commands as component 1. It reports
            pictures in CAMERA_FEEDBACK only; no client can fetch them. "none": an ArduPilot refuses
            the camera's commands, a PX4 ignores them.
        camera_clock_s: Lead of the camera's time since boot over the autopilot's.
        camera_tells_pose: Otherwise its announcements hold zeros.
        clock_ppm: Excess rate of the vehicle's clock, in millionths.
        home_moves_m: Largest correction by which a PX4 changes the height of home in the two
            minutes after take-off.
        stick: The pilot's radio control is on, its sticks centred. Modes by hand can be chosen in
            flight, and a PX4 that loses its setpoints goes to POSITION (COM_OBL_RC_ACT 0).
        landed_state: It sends EXTENDED_SYS_STATE; otherwise it refuses to.
        height_sigma_m: Standard deviation of its receiver's height above the sea, which wanders.
        tilt_sigma_deg: Standard deviation of its roll and of its pitch (`sitl.body.sensors`).
        heading_sigma_deg: The same of its heading.
    """

    camera: CameraKind = "component"
    camera_clock_s: float = 0.0
    camera_tells_pose: bool = True
    clock_ppm: float = 0.0
    home_moves_m: float = 1.5
    stick: bool = True
    landed_state: bool = True
    height_sigma_m: float = 3.0
    tilt_sigma_deg: float = 0.8
    heading_sigma_deg: float = 2.0

    def __post_init__(self) -> None:
        problems = []
        if self.camera not in ("component", "autopilot", "none"):
            problems.append("camera is component, autopilot or none")
        if not math.isfinite(self.camera_clock_s):
            problems.append("camera_clock_s is a number of seconds")
        if not abs(self.clock_ppm) <= _MAX_PPM:
            problems.append(f"clock_ppm is -{_MAX_PPM:.0f} to {_MAX_PPM:.0f}")
        for name, most in _MOST.items():
            if not 0.0 <= getattr(self, name) <= most:
                problems.append(f"{name} is 0 to {most}")
        if problems:
            raise ValueError("; ".join(problems))
