"""Which items a PX4 takes: not-a-numbers stand for defaults where nothing is flown by them."""

from __future__ import annotations

import math
from dataclasses import replace

from pymavlink.dialects.v20 import ardupilotmega as mav

from sitl.copter.mission_items import IDLE_COMMANDS, MISSION, Item
from sitl.copter.mission_items import check as check_any

_TERRAIN = (mav.MAV_FRAME_GLOBAL_TERRAIN_ALT, mav.MAV_FRAME_GLOBAL_TERRAIN_ALT_INT)
# parameters (from 0) by which an item is flown; all others may be not-a-numbers
_FLOWN_BY = {
    mav.MAV_CMD_NAV_WAYPOINT: (0,),
    mav.MAV_CMD_NAV_SPLINE_WAYPOINT: (0,),
    mav.MAV_CMD_NAV_LOITER_TIME: (0,),
    mav.MAV_CMD_NAV_DELAY: (0,),
    mav.MAV_CMD_CONDITION_DELAY: (0,),
    mav.MAV_CMD_CONDITION_DISTANCE: (0,),
    mav.MAV_CMD_CONDITION_YAW: (0, 2),
    mav.MAV_CMD_DO_JUMP: (0, 1),
    mav.MAV_CMD_DO_CHANGE_SPEED: (0, 1),
    mav.MAV_CMD_DO_SET_CAM_TRIGG_DIST: (0,),
    mav.MAV_CMD_DO_FENCE_ENABLE: (0,),
    mav.MAV_CMD_IMAGE_START_CAPTURE: (1, 2),
}


def check(kind: int, item: Item) -> int:
    """MAV_MISSION_RESULT for one item of a list of this kind.

    >>> check(MISSION, Item(mav.MAV_CMD_NAV_TAKEOFF, p=(math.nan,) * 4))
    0
    >>> check(MISSION, Item(mav.MAV_CMD_NAV_WAYPOINT, p=(math.nan,) * 4))
    6
    """
    if item.frame in _TERRAIN:
        return int(mav.MAV_MISSION_UNSUPPORTED_FRAME)
    if kind == MISSION:
        needed = _FLOWN_BY.get(item.command, ())
        p = [0.0 if math.isnan(v) and i not in needed else v for i, v in enumerate(item.p)]
        idle = item.command in IDLE_COMMANDS and math.isnan(item.z)
        item = replace(item, p=(p[0], p[1], p[2], p[3]), z=0.0 if idle else item.z)
    return check_any(kind, item)
