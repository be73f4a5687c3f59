"""MAV_CMD_* that fly the vehicle: arming, modes, take-off, targets, missions, the fence."""

from __future__ import annotations

import math
from collections.abc import Callable

from pymavlink.dialects.v20 import ardupilotmega as mav

from missions.geodesy import LocalPlane
from missions.units import LatLon
from sitl.autopilot import Autopilot
from sitl.fence import Place, zones
from sitl.items import FENCE, MISSION, RALLY, Item
from sitl.modes import Mode
from sitl.reply import ACCEPTED, DENIED, FAILED, UNSUPPORTED, Reply, Request, statustext

_FORCE_ARM, _FORCE_DISARM = 2989.0, 21196.0
_AMSL_FRAMES = (mav.MAV_FRAME_GLOBAL, mav.MAV_FRAME_GLOBAL_INT)
_HOME_FRAMES = (mav.MAV_FRAME_GLOBAL_RELATIVE_ALT, mav.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT)
_TERRAIN_FRAMES = (mav.MAV_FRAME_GLOBAL_TERRAIN_ALT, mav.MAV_FRAME_GLOBAL_TERRAIN_ALT_INT)
_SPEED_KINDS = {0: "speed_m_s", 1: "speed_m_s", 2: "climb_m_s", 3: "descent_m_s"}
_HIGHEST_M = 10_000.0


class FlightCommands:
    """The commands that move; `table` is looked up by the number of the command.

    It knows where the world's plane lies, and so puts positions on the wire into it.
    """

    def __init__(self, autopilot: Autopilot, plane: LocalPlane, amsl_m: float) -> None:
        self._ap = autopilot
        self._plane = plane
        self._amsl_m = amsl_m
        autopilot.route.locate = self._item_place
        self.table: dict[int, Callable[[Request], Reply]] = {
            mav.MAV_CMD_COMPONENT_ARM_DISARM: self._arm_disarm,
            mav.MAV_CMD_DO_SET_MODE: self._set_mode,
            mav.MAV_CMD_NAV_TAKEOFF: self._take_off,
            mav.MAV_CMD_NAV_LAND: lambda _: self._mode(Mode.LAND),
            mav.MAV_CMD_NAV_RETURN_TO_LAUNCH: lambda _: self._mode(Mode.RTL),
            mav.MAV_CMD_DO_REPOSITION: self._reposition,
            mav.MAV_CMD_DO_CHANGE_SPEED: self._change_speed,
            mav.MAV_CMD_CONDITION_YAW: self._yaw,
            mav.MAV_CMD_MISSION_START: self._mission_start,
            mav.MAV_CMD_DO_SET_MISSION_CURRENT: self._mission_current,
            mav.MAV_CMD_DO_PAUSE_CONTINUE: self._pause,
            mav.MAV_CMD_DO_FENCE_ENABLE: self._fence_enable,
            mav.MAV_CMD_DO_SET_HOME: self._set_home,
            mav.MAV_CMD_RUN_PREARM_CHECKS: lambda _: Reply(
                FAILED if self._ap.armed else ACCEPTED, self._prearm_texts()
            ),
        }

    def _arm_disarm(self, request: Request) -> Reply:
        if request.p[0] == 1.0:
            refusal = self._ap.arm(force=request.p[1] == _FORCE_ARM)
        elif request.p[0] == 0.0:
            refusal = self._ap.disarm(force=request.p[1] == _FORCE_DISARM)
        else:
            return Reply(UNSUPPORTED)
        return _answer(refusal)

    def _prearm_texts(self) -> tuple[object, ...]:
        refusal = None if self._ap.armed else self._ap.prearm_refusal()
        return () if refusal is None else (statustext(mav.MAV_SEVERITY_CRITICAL, refusal),)

    def _set_mode(self, request: Request) -> Reply:
        base, number = request.integer(1), request.integer(2)
        if base is None or number is None or not base & mav.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED:
            return Reply(DENIED)
        return self.set_mode(number)

    def set_mode(self, number: int) -> Reply:
        """A custom mode by its number, as DO_SET_MODE and SET_MODE ask for it."""
        try:
            mode = Mode(number)
        except ValueError:
            return _answer(f"Mode change failed: no such mode {number}")
        return self._mode(mode)

    def _mode(self, mode: Mode) -> Reply:
        return _answer(self._ap.set_mode(mode))

    def _take_off(self, request: Request) -> Reply:
        height_m = request.p[6]
        if not height_m <= _HIGHEST_M:
            return Reply(FAILED)
        return Reply(ACCEPTED if self._ap.take_off(height_m) is None else FAILED)

    def _reposition(self, request: Request) -> Reply:
        if request.place is None:
            return Reply(int(mav.MAV_RESULT_COMMAND_INT_ONLY))
        change_mode = request.integer(2) or 0
        if self._ap.mode != Mode.GUIDED:
            if not change_mode & mav.MAV_DO_REPOSITION_FLAGS_CHANGE_MODE:
                return Reply(DENIED)
            if (refusal := self._ap.set_mode(Mode.GUIDED)) is not None:
                return _answer(refusal)
        target = self.target(*request.place, request.p[6])
        if target is None:
            return Reply(DENIED)
        return Reply(ACCEPTED if self._ap.go_to(*target) else FAILED)

    def target(self, frame: int, lat_e7: int, lon_e7: int, altitude_m: float) -> Place | None:
        """A global position in the world's plane (east, north, up); None when it is nowhere.

        Heights above terrain are taken from the home altitude's sea level without terrain data:
        as on the real one, the vehicle then comes down.
        """
        if not (math.isfinite(altitude_m) and abs(altitude_m) <= _HIGHEST_M):
            return None
        if not (abs(lat_e7) <= 900_000_000 and abs(lon_e7) <= 1_800_000_000):
            return None
        if frame in _AMSL_FRAMES:
            up = altitude_m - self._amsl_m
        elif frame in _HOME_FRAMES:
            up = altitude_m + self._ap.home[2]
        elif frame in _TERRAIN_FRAMES:
            up = altitude_m - self._amsl_m
        else:
            return None
        return (*self._flat(lat_e7, lon_e7), up)

    def _flat(self, lat_e7: int, lon_e7: int) -> tuple[float, float]:
        return self._plane.to_plane(LatLon(lat_e7 / 1e7, lon_e7 / 1e7))

    def _item_place(self, item: Item) -> Place | None:
        return self.target(item.frame, item.x, item.y, item.z)

    def _change_speed(self, request: Request) -> Reply:
        kind = _SPEED_KINDS.get(request.integer(1) or 0)
        speed = request.p[1]
        if kind is None or not math.isfinite(speed):
            return Reply(DENIED)
        if speed > 0.0:  # -1: no change
            self._ap.set_speed(kind, speed)
        return Reply(ACCEPTED)

    def _yaw(self, request: Request) -> Reply:
        angle, _speed, direction, relative = request.p[:4]
        if not all(map(math.isfinite, (angle, direction, relative))):
            return Reply(DENIED)
        goal = math.radians(angle)
        if relative:
            goal = self._ap.yaw_goal + math.copysign(1.0, direction) * goal
        return Reply(ACCEPTED if self._ap.turn_to(goal) else FAILED)

    # --- missions, fence, home ------------------------------------------------------------------

    def _mission_start(self, request: Request) -> Reply:
        if request.p[0] or request.p[1]:  # a part of a mission cannot be flown
            return Reply(DENIED)
        return _answer(self._ap.start_mission())

    def _pause(self, request: Request) -> Reply:
        wanted = request.integer(1)
        if wanted not in (0, 1):
            return Reply(DENIED)
        return Reply(ACCEPTED if self._ap.pause_mission(wanted == 0) else FAILED)

    def _mission_current(self, request: Request) -> Reply:
        seq = request.integer(1)
        if seq is None:
            return Reply(DENIED)
        if request.p[1] == 1.0:
            self._ap.route.reset()
        return Reply(ACCEPTED if self._ap.route.jump_to(seq, self._ap) else FAILED)

    def _fence_enable(self, request: Request) -> Reply:
        wanted = request.integer(1)
        if wanted not in (0, 1):
            return Reply(FAILED)
        self._ap.parameters.change("FENCE_ENABLE", float(wanted))
        return Reply(ACCEPTED)

    def _set_home(self, request: Request) -> Reply:
        if not self._ap.home_known:
            return Reply(FAILED)
        if request.p[0] == 1.0:
            now = self._ap.estimate
            self._ap.set_home(now.east, now.north, now.up)
            return Reply(ACCEPTED)
        if request.place is None:
            lat, lon = request.p[4], request.p[5]
            if not (abs(lat) <= 90.0 and abs(lon) <= 180.0):
                return Reply(FAILED)
            place = (int(mav.MAV_FRAME_GLOBAL), round(lat * 1e7), round(lon * 1e7))
        else:
            place = request.place
        home = self.target(*place, request.p[6])
        if home is None or place[1:] == (0, 0):
            return Reply(FAILED)
        self._ap.set_home(*home)
        return Reply(ACCEPTED)

    def plans_changed(self, kind: int) -> None:
        """A mission, a fence or the rally points have come or gone."""
        ap = self._ap
        items = ap.plans.items[kind]
        if kind == FENCE:
            ap.fence.zones = zones(items, self._flat)
            ap.parameters.change("FENCE_TOTAL", len(items))
        elif kind == RALLY:
            found = (self._item_place(item) for item in items)
            ap.rally = tuple(place for place in found if place is not None)
            ap.parameters.change("RALLY_TOTAL", len(items))
        elif kind == MISSION:
            ap.route.plan_changed()
            ap.parameters.change("MIS_TOTAL", len(items))


def _answer(refusal: str | None) -> Reply:
    """ACK, then (for a refusal) the text that explains it."""
    if refusal is None:
        return Reply(ACCEPTED)
    return Reply(FAILED, (statustext(mav.MAV_SEVERITY_CRITICAL, refusal),))
