"""A command as it was asked, and what is answered."""

from __future__ import annotations

import math
from dataclasses import dataclass

from pymavlink.dialects.v20 import ardupilotmega as mav

from sitl.codec.wire import Message

ACCEPTED: int = mav.MAV_RESULT_ACCEPTED
DENIED: int = mav.MAV_RESULT_DENIED
FAILED: int = mav.MAV_RESULT_FAILED
UNSUPPORTED: int = mav.MAV_RESULT_UNSUPPORTED


@dataclass(frozen=True, slots=True)
class Request:
    """A COMMAND_LONG or COMMAND_INT; `place` is the INT's frame, latitude and longitude (1e7)."""

    command: int
    p: tuple[float, float, float, float, float, float, float]
    place: tuple[int, int, int] | None

    def integer(self, index: int) -> int | None:
        """Parameter `index` (from 1) as an integer, None when it is no finite number."""
        value = self.p[index - 1]
        return int(value) if math.isfinite(value) and abs(value) < 2**31 else None


@dataclass(frozen=True, slots=True)
class Reply:
    """Result of a command, and what is sent behind the ACK by whom.

    `before` are results that are told before that one, by whoever looks at the command first.
    `by_autopilot`: the autopilot answers, although its camera was asked.
    """

    result: int
    messages: tuple[Message, ...] = ()
    from_camera: bool = False
    before: tuple[int, ...] = ()
    by_autopilot: bool = False
    silent: bool = False


def statustext(severity: int, text: str) -> Message:
    """STATUSTEXT of at most 50 bytes."""
    return mav.MAVLink_statustext_message(severity, text.encode("ascii", "replace")[:50])
