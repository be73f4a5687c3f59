"""MAV_CMD_* that fly a PX4.

It refuses with TEMPORARILY_REJECTED and a text. The altitude of every command is above sea level,
whatever the frame of a COMMAND_INT. A PX4 of 2024 ignores the frame, one of 2026 takes GLOBAL_INT
only.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

from pymavlink.dialects.v20 import ardupilotmega as mav

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
from sitl.px4.autopilot import PartialPlace, Px4Autopilot
from sitl.px4.modes import Px4Mode, requested_mode
from sitl.px4.telemetry import DEFAULT_S

_NAN_AS_INT = 0x7FF80000
_GLOBAL: int = mav.MAV_FRAME_GLOBAL


class Px4Commands(Commands):
    """PX4's."""

    refused = int(mav.MAV_RESULT_TEMPORARILY_REJECTED)
    nowhere = FAILED
    unknown_rally_frames = (mav.MAV_FRAME_GLOBAL_INT, mav.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT)

    ap: Px4Autopilot
    default_s = DEFAULT_S
    answers_for_camera = False

    def _flight_table(self) -> dict[int, Callable[[Request], Reply]]:
        return {
            mav.MAV_CMD_DO_SET_MODE: self._set_mode,
            mav.MAV_CMD_NAV_TAKEOFF: self._take_off,
            mav.MAV_CMD_NAV_LAND: lambda _: self._mode(Px4Mode.LAND),
            mav.MAV_CMD_NAV_RETURN_TO_LAUNCH: lambda _: self._mode(Px4Mode.RTL),
            mav.MAV_CMD_DO_REPOSITION: self._reposition,
            mav.MAV_CMD_MISSION_START: self._mission_start,
            mav.MAV_CMD_DO_SET_HOME: self._set_home_amsl,
        }

    def answer(self, refusal: str | None) -> Reply:
        """Return the ACK; the text that explains a refusal follows as any other text."""
        if refusal is None:
            return Reply(ACCEPTED)
        self.ap.send_text(mav.MAV_SEVERITY_CRITICAL, refusal)
        return Reply(self.refused)

    def _set_mode(self, request: Request) -> Reply:
        base, main, sub = request.integer(1), request.integer(2), request.integer(3)
        mode = None
        if base is not None and base & mav.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED and main is not None:
            mode = requested_mode(main & 0xFF, (sub or 0) & 0xFF)
        # the receiver of the message accepts it before the commander checks it
        return replace(self._mode(mode), before=(ACCEPTED,))

    def set_mode(self, number: int) -> Reply:
        """Execute SET_MODE: main mode and sub-mode in one number."""
        return self._mode(requested_mode(number >> 16 & 0xFF, number >> 24 & 0xFF))

    def _mode(self, mode: Px4Mode | None) -> Reply:
        return self.answer("Unsupported mode" if mode is None else self.ap.set_mode(mode))

    def _take_off(self, request: Request) -> Reply:
        return self.answer(self.ap.take_off(self._partial_place(request)))

    def _reposition(self, request: Request) -> Reply:
        place = request.place
        if place is not None and place[1:] == (_NAN_AS_INT, _NAN_AS_INT):
            return Reply(DENIED)
        changes_mode = (request.integer(2) or 0) & mav.MAV_DO_REPOSITION_FLAGS_CHANGE_MODE
        if changes_mode and self.ap.set_mode(Px4Mode.HOLD) is not None:
            return self.answer("Reposition command rejected")
        speed_m_s, yaw_rad = request.p[0], request.p[3]
        text = self.ap.reposition(
            self._partial_place(request), yaw_rad if math.isfinite(yaw_rad) else None
        )
        if text is not None:
            self.ap.send_text(mav.MAV_SEVERITY_CRITICAL, text)
            return Reply(ACCEPTED)
        if math.isfinite(speed_m_s) and speed_m_s > 0.0:
            self.ap.set_speed("speed_m_s", speed_m_s)
        # without the flag it flies there in Hold, and answers that it does not
        return Reply(ACCEPTED if changes_mode else UNSUPPORTED)

    def _partial_place(self, request: Request) -> PartialPlace:
        """Return the place of a command, None where it has no coordinate."""
        where, amsl_m = request.lat_lon_e7, request.p[6]
        up = amsl_m - self.telemetry.amsl_m if abs(amsl_m) <= HIGHEST_M else None
        if where is None or abs(where[0]) > 900_000_000 or abs(where[1]) > 1_800_000_000:
            return None, None, up
        return (*self._flat(*where), up)

    def _external_position(self, request: Request) -> Reply:
        """Refuse it without a delay."""
        if not math.isfinite(request.p[1]):
            return Reply(self.refused)
        return super()._external_position(request)

    def _mission_start(self, request: Request) -> Reply:
        first = request.p[0]
        total = self.ap.route.total
        if total == 0:
            return replace(self.answer("Mission start denied! No valid mission"), result=DENIED)
        if not (math.isfinite(first) and -1.0 <= first < total):
            return Reply(DENIED)
        if first > 0.0:
            self.ap.route.jump_to(int(first), self.ap)
        return self.answer(self.ap.start_mission())

    def _set_home_amsl(self, request: Request) -> Reply:
        if request.place is not None:
            request = replace(request, place=(_GLOBAL, *request.place[1:]))
        return self._set_home(request)
