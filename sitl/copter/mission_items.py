"""Items of a mission, a fence or a list of rally points, and which of them a copter takes."""

from __future__ import annotations

import math
from dataclasses import dataclass

from pymavlink.dialects.v20 import ardupilotmega as mav

from sitl.codec import Message

MISSION, FENCE, RALLY, ALL = 0, 1, 2, 255  # MAV_MISSION_TYPE

OK: int = mav.MAV_MISSION_ACCEPTED
_FRAMES = (
    mav.MAV_FRAME_GLOBAL, mav.MAV_FRAME_GLOBAL_INT,
    mav.MAV_FRAME_GLOBAL_RELATIVE_ALT, mav.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT,
    mav.MAV_FRAME_GLOBAL_TERRAIN_ALT, mav.MAV_FRAME_GLOBAL_TERRAIN_ALT_INT,
)  # fmt: skip
_HIGHEST_M = 83_000.0
_FAR_E7 = 2**31 - 1  # a coordinate that is nowhere
_MAX_VERTICES = 250

# what the autopilot flies, one at a time
NAVIGATION = {
    mav.MAV_CMD_NAV_WAYPOINT: "WP",
    mav.MAV_CMD_NAV_SPLINE_WAYPOINT: "SplineWP",
    mav.MAV_CMD_NAV_LOITER_UNLIM: "LoitUnlim",
    mav.MAV_CMD_NAV_LOITER_TIME: "LoitTime",
    mav.MAV_CMD_NAV_RETURN_TO_LAUNCH: "RTL",
    mav.MAV_CMD_NAV_LAND: "Land",
    mav.MAV_CMD_NAV_TAKEOFF: "Takeoff",
    mav.MAV_CMD_NAV_DELAY: "Delay",
}
# what it does on the way
DOING = {
    mav.MAV_CMD_CONDITION_DELAY: "CondDelay",
    mav.MAV_CMD_CONDITION_DISTANCE: "CondDist",
    mav.MAV_CMD_CONDITION_YAW: "CondYaw",
    mav.MAV_CMD_DO_JUMP: "Jump",
    mav.MAV_CMD_DO_CHANGE_SPEED: "ChangeSpeed",
    mav.MAV_CMD_DO_DIGICAM_CONTROL: "DigiCamCtrl",
    mav.MAV_CMD_DO_SET_CAM_TRIGG_DIST: "SetCamTrigDst",
    mav.MAV_CMD_DO_FENCE_ENABLE: "FenceEnable",
    mav.MAV_CMD_IMAGE_START_CAPTURE: "ImageStart",
    mav.MAV_CMD_IMAGE_STOP_CAPTURE: "ImageStop",
}
# taken, kept and handed back, but without an effect: there is no gimbal, servo or video here
IDLE_COMMANDS = {
    mav.MAV_CMD_DO_SET_ROI: "SetROI",
    mav.MAV_CMD_DO_SET_ROI_LOCATION: "SetROI",
    mav.MAV_CMD_DO_SET_ROI_NONE: "SetROI",
    mav.MAV_CMD_DO_MOUNT_CONTROL: "MountControl",
    mav.MAV_CMD_DO_GIMBAL_MANAGER_PITCHYAW: "GimbalPitchYaw",
    mav.MAV_CMD_DO_SET_SERVO: "SetServo",
    mav.MAV_CMD_DO_SET_RELAY: "SetRelay",
    mav.MAV_CMD_DO_LAND_START: "LandStart",
    mav.MAV_CMD_SET_CAMERA_MODE: "SetCameraMode",
    mav.MAV_CMD_VIDEO_START_CAPTURE: "VideoStart",
    mav.MAV_CMD_VIDEO_STOP_CAPTURE: "VideoStop",
}
NAMES = {**NAVIGATION, **DOING, **IDLE_COMMANDS}

SPEEDS = {0: "speed_m_s", 1: "speed_m_s", 2: "climb_m_s", 3: "descent_m_s"}
"""Limits that DO_CHANGE_SPEED changes, by its first parameter."""

POLYGONS = (
    mav.MAV_CMD_NAV_FENCE_POLYGON_VERTEX_INCLUSION,
    mav.MAV_CMD_NAV_FENCE_POLYGON_VERTEX_EXCLUSION,
)
CIRCLES = (mav.MAV_CMD_NAV_FENCE_CIRCLE_INCLUSION, mav.MAV_CMD_NAV_FENCE_CIRCLE_EXCLUSION)
_FENCE_COMMANDS = (*POLYGONS, *CIRCLES, mav.MAV_CMD_NAV_FENCE_RETURN_POINT)
_COMMANDS = {MISSION: NAMES, FENCE: _FENCE_COMMANDS, RALLY: (mav.MAV_CMD_NAV_RALLY_POINT,)}
# x and y of all other mission items are two more plain parameters
_PLACES = (
    mav.MAV_CMD_NAV_WAYPOINT, mav.MAV_CMD_NAV_SPLINE_WAYPOINT, mav.MAV_CMD_NAV_LOITER_UNLIM,
    mav.MAV_CMD_NAV_LOITER_TIME, mav.MAV_CMD_NAV_LAND, mav.MAV_CMD_NAV_TAKEOFF,
    mav.MAV_CMD_DO_SET_ROI, mav.MAV_CMD_DO_SET_ROI_LOCATION, mav.MAV_CMD_DO_LAND_START,
    mav.MAV_CMD_NAV_RALLY_POINT, *_FENCE_COMMANDS,
)  # fmt: skip


@dataclass(frozen=True, slots=True)
class Item:
    """One item as received: `x` and `y` are 1e-7 degrees where the command has a place."""

    command: int
    frame: int = mav.MAV_FRAME_GLOBAL_RELATIVE_ALT
    p: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0)
    x: int = 0
    y: int = 0
    z: float = 0.0
    autocontinue: int = 1

    @classmethod
    def from_message(cls, m: Message) -> Item:
        """Read a MISSION_ITEM_INT, or a MISSION_ITEM with its coordinates in degrees."""
        x, y = m.x, m.y
        if m.get_type() == "MISSION_ITEM":
            scale = 1e7 if m.command in _PLACES else 1.0
            x, y = _whole(x * scale), _whole(y * scale)
        p = (m.param1, m.param2, m.param3, m.param4)
        return cls(m.command, m.frame, p, x, y, m.z, m.autocontinue)

    def message(self, seq: int, kind: int, partner: tuple[int, int], *, exact: bool) -> Message:
        """Return MISSION_ITEM_INT (`exact`) or MISSION_ITEM for a partner (system, component)."""
        head = (*partner, seq, self.frame, self.command, 0, self.autocontinue, *self.p)
        if exact:
            return mav.MAVLink_mission_item_int_message(*head, self.x, self.y, self.z, kind)
        scale = 1e7 if self.command in _PLACES else 1.0
        x, y = self.x / scale, self.y / scale
        return mav.MAVLink_mission_item_message(*head, x, y, self.z, kind)

    @property
    def here(self) -> bool:
        """True if it has no place: 0, 0 is the vehicle's place."""
        return self.x == 0 and self.y == 0


def _whole(value: float) -> int:
    return round(value) if math.isfinite(value) and abs(value) <= _FAR_E7 else _FAR_E7


def check(kind: int, item: Item) -> int:
    """Return the MAV_MISSION_RESULT for one item of a list of this kind."""
    if item.command not in _COMMANDS[kind]:
        return int(mav.MAV_MISSION_UNSUPPORTED)
    for index, value in enumerate(item.p):
        # a yaw that is no number leaves the yaw alone, and is what many clients send
        heading = index == 3 and math.isnan(value)
        if not math.isfinite(value) and not heading:
            return int(mav.MAV_MISSION_INVALID_PARAM1) + index
    if not math.isfinite(item.z) or abs(item.z) > _HIGHEST_M:
        return int(mav.MAV_MISSION_INVALID_PARAM7)
    if item.command in _PLACES:
        if item.frame not in _FRAMES:
            return int(mav.MAV_MISSION_UNSUPPORTED_FRAME)
        if abs(item.x) > 900_000_000:
            return int(mav.MAV_MISSION_INVALID_PARAM5_X)
        if abs(item.y) > 1_800_000_000:
            return int(mav.MAV_MISSION_INVALID_PARAM6_Y)
    bounded = not (item.command in POLYGONS and not 3 <= item.p[0] <= _MAX_VERTICES)
    if not bounded or (item.command in CIRCLES and not item.p[0] > 0.0):
        return int(mav.MAV_MISSION_INVALID_PARAM1)
    return OK


def check_fence(items: list[Item]) -> int:
    """Return MAV_MISSION_INVALID unless each polygon has its stated number of vertices in a row."""
    at = 0
    while at < len(items):
        item = items[at]
        count = int(item.p[0]) if item.command in POLYGONS else 1
        ring = items[at : at + count]
        if len(ring) < count or any((i.command, i.p[0]) != (item.command, item.p[0]) for i in ring
                                    if count > 1):  # fmt: skip
            return int(mav.MAV_MISSION_INVALID)
        at += count
    return OK
