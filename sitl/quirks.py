"""What real aircraft were measured to do that a client would rather not have to know.

One value for a simulated vehicle. The defaults are what was measured on an ArduCopter 4.6 and a
PX4 1.17 where a correct client is not harmed by it; what only some aircraft have is off.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

CameraKind = Literal["component", "autopilot", "none"]
_MOST_PPM = 200_000.0
_MOST = {"home_moves_m": 20, "height_sigma_m": 8, "tilt_sigma_deg": 10, "heading_sigma_deg": 10}


@dataclass(frozen=True, slots=True, kw_only=True)
class Quirks:
    """The habits of one vehicle.

    `camera`: "component" is a MAVLink camera, component 100, that serves its pictures;
    "autopilot" is an ArduPilot with CAM1_TYPE 1 and no such component: it takes the camera's
    commands, answers them as component 1, and tells of pictures in CAMERA_FEEDBACK only, for
    nobody can fetch them; with "none" an ArduPilot refuses the camera's commands and a PX4 passes
    over them. `camera_clock_s`: how far the camera's time since boot is ahead of the autopilot's.
    `camera_tells_pose`: or else its announcements hold zeros. `clock_ppm`: how much faster the
    vehicle's clock runs than time, in millionths. `home_moves_m`: a PX4 corrects the height of its
    home in the two minutes after take-off by up to so much; 0: not at all. `stick`: a pilot's
    radio control is on, its sticks centred: modes by hand can be chosen in flight, and a PX4 whose
    stream of setpoints is lost goes to POSITION (COM_OBL_RC_ACT 0) instead of home.
    `landed_state`: it sends EXTENDED_SYS_STATE; or else it refuses to. `height_sigma_m`: standard
    deviation of its receiver's height above the sea, which wanders (`sitl.body.sensors`).
    `tilt_sigma_deg`, `heading_sigma_deg`: standard deviations of its roll and pitch, and of its
    heading (`sitl.body.sensors`).
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
        if not abs(self.clock_ppm) <= _MOST_PPM:
            problems.append(f"clock_ppm is -{_MOST_PPM:.0f} to {_MOST_PPM:.0f}")
        for name, most in _MOST.items():
            if not 0.0 <= getattr(self, name) <= most:
                problems.append(f"{name} is 0 to {most}")
        if problems:
            raise ValueError("; ".join(problems))
