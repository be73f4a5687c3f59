"""Which message is due when: intervals on the vehicle's own time."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

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
"""What REQUEST_DATA_STREAM's groups hold."""


@dataclass(slots=True)
class _Group:
    """Messages that are always due together."""

    interval_s: float
    next_s: float
    message_ids: list[int] = field(default_factory=list)


class Streams:
    """Message ids and their intervals.

    >>> streams = Streams()
    >>> streams.set(33, 0.1, now_s=0.0)
    >>> streams.due(0.05), streams.due(0.1), streams.due(0.15), streams.due(0.2)
    ([], [33], [], [33])
    """

    def __init__(self) -> None:
        self._interval_s: dict[int, float] = {}
        self._groups: list[_Group] = []
        self._earliest_s = math.inf

    def set(self, message_id: int, interval_s: float | None, now_s: float) -> None:
        """Send a message every `interval_s` from now on; None stops it."""
        next_s = {number: group.next_s for group in self._groups for number in group.message_ids}
        if interval_s is None:
            self._interval_s.pop(message_id, None)
        else:
            self._interval_s[message_id] = interval_s
            next_s[message_id] = now_s + interval_s
        groups: dict[tuple[float, float], _Group] = {}
        for number, every_s in self._interval_s.items():
            key = (every_s, next_s[number])
            groups.setdefault(key, _Group(*key)).message_ids.append(number)
        self._groups = list(groups.values())
        self._earliest_s = min((group.next_s for group in self._groups), default=math.inf)

    def interval_s(self, message_id: int) -> float | None:
        """The interval of a message, None while it is not streamed."""
        return self._interval_s.get(message_id)

    def due(self, now_s: float) -> list[int]:
        """The messages to send now, in a fixed order.

        Intervals keep their phase. One shorter than the step sends once a step.
        """
        now_s += _SOON_S
        if now_s < self._earliest_s:
            return []
        groups = [group for group in self._groups if group.next_s <= now_s]
        for group in groups:
            following_s = group.next_s + group.interval_s
            group.next_s = following_s if following_s > now_s else now_s
        self._earliest_s = min([group.next_s for group in self._groups])
        if len(groups) == 1:
            return groups[0].message_ids.copy()
        due = {message_id for group in groups for message_id in group.message_ids}
        return [message_id for message_id in self._interval_s if message_id in due]
