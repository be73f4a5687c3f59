"""Intervals of streamed messages, in vehicle time."""

from __future__ import annotations

import math

from pymavlink.dialects.v20 import ardupilotmega as mav

_SOON_S = 1e-6

STREAM_GROUPS = {
    mav.MAV_DATA_STREAM_EXTENDED_STATUS: (
        mav.MAVLINK_MSG_ID_SYS_STATUS,
        mav.MAVLINK_MSG_ID_MISSION_CURRENT,
        mav.MAVLINK_MSG_ID_GPS_RAW_INT,
        mav.MAVLINK_MSG_ID_FENCE_STATUS,
        mav.MAVLINK_MSG_ID_POSITION_TARGET_GLOBAL_INT,
    ),
    mav.MAV_DATA_STREAM_POSITION: (
        mav.MAVLINK_MSG_ID_GLOBAL_POSITION_INT,
        mav.MAVLINK_MSG_ID_LOCAL_POSITION_NED,
    ),
    mav.MAV_DATA_STREAM_EXTRA1: (mav.MAVLINK_MSG_ID_ATTITUDE,),
    mav.MAV_DATA_STREAM_EXTRA2: (mav.MAVLINK_MSG_ID_VFR_HUD,),
    mav.MAV_DATA_STREAM_EXTRA3: (
        mav.MAVLINK_MSG_ID_SYSTEM_TIME,
        mav.MAVLINK_MSG_ID_BATTERY_STATUS,
        mav.MAVLINK_MSG_ID_WIND,
        mav.MAVLINK_MSG_ID_EKF_STATUS_REPORT,
    ),
}
"""The groups of REQUEST_DATA_STREAM."""


class Streams:
    """Message ids and their intervals.

    >>> streams = Streams()
    >>> streams.set(33, 0.1, now_s=0.0)
    >>> streams.due(0.05), streams.due(0.1), streams.due(0.15), streams.due(0.2)
    ([], [33], [], [33])
    >>> streams.set(30, 0.01, now_s=0.2)  # shorter than a step: once a step
    >>> streams.due(0.25), streams.due(0.3)
    ([30], [33, 30])
    """

    def __init__(self) -> None:
        self._interval_s: dict[int, float] = {}
        self._next_s: dict[int, float] = {}
        self._earliest_s = math.inf

    def set(self, message_id: int, interval_s: float | None, now_s: float) -> None:
        """Send a message every `interval_s` from now on; None stops it."""
        if interval_s is None:
            self._interval_s.pop(message_id, None)
            self._next_s.pop(message_id, None)
        else:
            self._interval_s[message_id] = interval_s
            self._next_s[message_id] = now_s + interval_s
        self._earliest_s = min(self._next_s.values(), default=math.inf)

    def interval_s(self, message_id: int) -> float | None:
        """Return the interval of a message, None while it is not streamed."""
        return self._interval_s.get(message_id)

    def due(self, now_s: float) -> list[int]:
        """Return the messages that are due, in a fixed order; an interval keeps its phase."""
        now_s += _SOON_S
        if now_s < self._earliest_s:
            return []
        due = [message_id for message_id, next_s in self._next_s.items() if next_s <= now_s]
        for message_id in due:
            following_s = self._next_s[message_id] + self._interval_s[message_id]
            self._next_s[message_id] = max(following_s, now_s)
        self._earliest_s = min(self._next_s.values())
        return due
