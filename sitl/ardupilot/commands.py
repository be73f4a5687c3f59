"""MAV_CMD_* that fly an ArduCopter: arming, modes, take-off, targets, missions, the fence."""

from __future__ import annotations

import math
from collections.abc import Callable

from pymavlink.dialects.v20 import ardupilotmega as mav

from sitl.ardupilot.autopilot import Autopilot
from sitl.copter.modes import Mode
from sitl.mavlink.commands import (
    ACCEPTED,
    DENIED,
    FAILED,
    HIGHEST_M,
    UNSUPPORTED,
    Commands,
    Reply,
    Request,
)

_GLOBAL_FRAMES = (mav.MAV_FRAME_GLOBAL, mav.MAV_FRAME_GLOBAL_INT)


class ArduPilotCommands(Commands):
    """ArduCopter's."""

    forces_arming = 2989.0

    ap: Autopilot

    def _flight_table(self) -> dict[int, Callable[[Request], Reply]]:
        return {
            mav.MAV_CMD_DO_SET_MODE: self._set_mode,
            mav.MAV_CMD_NAV_TAKEOFF: self._take_off,
            mav.MAV_CMD_NAV_LAND: lambda _: self._mode(Mode.LAND),
            mav.MAV_CMD_NAV_RETURN_TO_LAUNCH: lambda _: self._mode(Mode.RTL),
            mav.MAV_CMD_DO_REPOSITION: self._reposition,
            mav.MAV_CMD_CONDITION_YAW: self._yaw,
            mav.MAV_CMD_MISSION_START: self._mission_start,
            mav.MAV_CMD_DO_PAUSE_CONTINUE: self._pause,
            mav.MAV_CMD_DO_FENCE_ENABLE: self._fence_enable,
            mav.MAV_CMD_SET_EKF_SOURCE_SET: self._choose_sources,
        }

    def _set_mode(self, request: Request) -> Reply:
        base, number = request.integer(1), request.integer(2)
        if base is None or number is None or not base & mav.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED:
            return Reply(DENIED)
        return self.set_mode(number)

    def set_mode(self, number: int) -> Reply:
        """Change to a custom mode by its number."""
        try:
            mode = Mode(number)
        except ValueError:
            return self.answer(f"Mode change failed: no such mode {number}")
        return self._mode(mode)

    def _mode(self, mode: Mode) -> Reply:
        return self.answer(self.ap.set_mode(mode))

    def _take_off(self, request: Request) -> Reply:
        height_m = request.p[6]
        if not height_m <= HIGHEST_M:
            return Reply(FAILED)
        return Reply(ACCEPTED if self.ap.take_off(height_m) is None else FAILED)

    def _reposition(self, request: Request) -> Reply:
        if request.place is None:
            return Reply(int(mav.MAV_RESULT_COMMAND_INT_ONLY))
        change_mode = request.integer(2) or 0
        if self.ap.mode != Mode.GUIDED:
            if not change_mode & mav.MAV_DO_REPOSITION_FLAGS_CHANGE_MODE:
                return Reply(DENIED)
            if (refusal := self.ap.set_mode(Mode.GUIDED)) is not None:
                return self.answer(refusal)
        target = self.target(*request.place, request.p[6])
        if target is None:
            return Reply(DENIED)
        return Reply(ACCEPTED if self.ap.go_to(*target) else FAILED)

    def _yaw(self, request: Request) -> Reply:
        angle, _speed, direction, relative = request.p[:4]
        if not all(map(math.isfinite, (angle, direction, relative))):
            return Reply(DENIED)
        goal = math.radians(angle)
        if relative:
            goal = self.ap.yaw_goal + math.copysign(1.0, direction) * goal
        return Reply(ACCEPTED if self.ap.turn_to(goal) else FAILED)

    # --- missions, fence, home ------------------------------------------------------------------

    def _mission_start(self, request: Request) -> Reply:
        if request.p[0] or request.p[1]:  # a part of a mission cannot be flown
            return Reply(DENIED)
        return self.answer(self.ap.start_mission())

    def _pause(self, request: Request) -> Reply:
        wanted = request.integer(1)
        if wanted not in (0, 1):
            return Reply(DENIED)
        return Reply(ACCEPTED if self.ap.pause_mission(wanted == 0) else FAILED)

    def _choose_sources(self, request: Request) -> Reply:
        number = request.integer(1)
        return Reply(
            ACCEPTED if number is not None and self.ap.aiding.choose_sources(number) else DENIED
        )

    def _external_position(self, request: Request) -> Reply:
        """Take it in global frames only."""
        if request.place is not None and request.place[0] not in _GLOBAL_FRAMES:
            return Reply(UNSUPPORTED)
        return super()._external_position(request)

    def _fence_enable(self, request: Request) -> Reply:
        wanted = request.integer(1)
        if wanted not in (0, 1):
            return Reply(FAILED)
        self.ap.enable_fence(wanted == 1)
        return Reply(ACCEPTED)
