"""Checks of continuity between messages: of a clock, and of the place of a flying vehicle.

Neither the clock nor the track accepts a jump at once. A jump is accepted when it persists: when
the messages after it agree with it, and none in between agrees with the state before.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, field
from typing import Final

from missions.units import LatLon

REBOOT_CONFIRMED_S: Final = 1.0
JUMP_CONFIRMED_S: Final = 3.0
STANDSTILL_S: Final = 2.0
"""Time with the same stamp after which a clock stands still, s: old messages are repeated."""
MAX_DELAY_S: Final = 5.0
"""Delay of messages from which on a link counts as lost, s."""
MAX_AHEAD_S: Final = 10.0
FASTEST_CLOCK: Final = 30.0
"""Maximum ratio of a clock to ours, as of a simulator."""

OLDER: Final = "older than the one before"
"""Reason for messages in another order; it is not logged."""

FASTEST_M_S: Final = 50.0
"""Maximum speed of a multicopter on missions, with the wind, m/s."""
SLACK_M: Final = 25.0
"""Maximum instant correction of a position estimate, m."""

OFFSET_WINDOW_S: Final = 120.0
"""Time whose fastest messages give a clock's offset, s: a backlog does not change it."""
_OFFSET_STEP_S: Final = 2.0
_MIN_SPAN_S: Final = 30.0
"""Minimum time over which a clock's drift is measured, s."""
_DRIFT: Final = 0.001
"""Drift of two good clocks that needs no measurement, s/s."""
_LEAD_WINDOW_S: Final = 30.0
_SAME_CLOCK_S: Final = 0.3
_OLDEST_ANNOUNCEMENT_S: Final = 60.0
_CAMERA_AHEAD_S: Final = 5.0
_M_PER_DEG: Final = 111_195.0


def distance_m(a: LatLon, b: LatLon) -> float:
    """Return the approximate distance of two positions over ground, m; within 1 % up to 100 km.

    >>> round(distance_m(LatLon(47.0, 179.9999), LatLon(47.0, -179.9999)), 1)
    15.2
    """
    east_deg = math.remainder(b.lon_deg - a.lon_deg, 360.0)
    east_m = east_deg * math.cos(math.radians((a.lat_deg + b.lat_deg) / 2.0))
    return math.hypot(east_m, b.lat_deg - a.lat_deg) * _M_PER_DEG


@dataclass(slots=True)
class RecentLeast:
    """The minimum of the values of the last one to two windows of time."""

    window_s: float
    _begin_s: float = float("-inf")
    _now: float | None = None
    _before: float | None = None

    def add(self, value: float, now_s: float) -> None:
        """Add a value."""
        if now_s - self._begin_s > self.window_s:
            self._begin_s, self._before, self._now = now_s, self._now, None
        self._now = value if self._now is None else min(self._now, value)

    def clear(self) -> None:
        """Drop all values."""
        self._begin_s, self._now, self._before = float("-inf"), None, None

    @property
    def value(self) -> float | None:
        """Minimum, None before the first value."""
        if self._now is None or self._before is None:
            return self._now
        return min(self._now, self._before)


@dataclass(slots=True)
class ClockOffset:
    """The lag of a clock behind ours: by the fastest messages of two minutes.

    The delay of a link is never negative, so the least of the differences is the offset. It rises
    only as fast as the clocks drift apart, which the two halves of the time show. Messages that are
    late for seconds do not change it.
    """

    value: float | None = None
    """Our time minus the other, s; None before the first message."""
    _least: deque[tuple[float, float, float]] = field(default_factory=deque)
    """Begin of a step, time of its least difference, and that difference."""
    _drift: float = _DRIFT

    def add(self, difference_s: float, now_s: float) -> None:
        """Add the difference of a message that has just arrived."""
        least = self._least
        if not least or now_s - least[-1][0] >= _OFFSET_STEP_S:
            least.append((now_s, now_s, difference_s))
            while least[0][0] < now_s - OFFSET_WINDOW_S:
                least.popleft()
            self._drift = _DRIFT + self._measured_drift()
        elif difference_s < least[-1][2]:
            least[-1] = (least[-1][0], now_s, difference_s)
        drifted = min(value + self._drift * (now_s - at_s) for _, at_s, value in least)
        self.value = min(drifted, difference_s)

    def _measured_drift(self) -> float:
        """Return the rise of the least difference, s/s; 0 if it falls, which shows by itself."""
        begin_s, end_s = self._least[0][0], self._least[-1][0]
        half_s = (end_s - begin_s) / 2.0
        if 2.0 * half_s < _MIN_SPAN_S:
            return 0.0
        halves: tuple[list[float], list[float]] = ([], [])
        for step_s, _, value in self._least:
            halves[step_s >= begin_s + half_s].append(value)
        return max((min(halves[1]) - min(halves[0])) / half_s, 0.0)


@dataclass(slots=True)
class BootClock:
    """An autopilot's time since boot beside the time of our loop.

    A link that was silent for more than `limit_s`, and then continues where it had stopped, has
    kept old messages. They are late, and give no offset, until the link has caught up or answers at
    once. In the second case the clock stood still, as a simulator's may.
    """

    boot_s: float | None = None
    reboots: int = 0
    limit_s: float = MAX_DELAY_S
    late: bool = False
    """True while the link delivers old messages."""
    _asked_ns: deque[int] = field(default_factory=lambda: deque(maxlen=10))
    _received_s: float = float("-inf")
    _moved_s: float = float("-inf")
    _other: tuple[float, float, float] | None = None
    """First and last arrival, and time, of a clock that does not continue this one."""
    _offset: ClockOffset = field(default_factory=ClockOffset)

    @property
    def offset_s(self) -> float | None:
        """Loop time minus time since boot, s: that of the fastest messages."""
        return self._offset.value

    def add(self, boot_s: float, now_s: float) -> str | None:
        """Add a reported time; return its fault."""
        if self.boot_s is None:
            self._adopt(boot_s, now_s)
        elif boot_s == self.boot_s:
            return None if now_s - self._moved_s <= STANDSTILL_S else "its clock stands still"
        elif _goes_on(self.boot_s, self._received_s, boot_s, now_s):
            self._set(boot_s, now_s)
        elif not self._confirms(boot_s, now_s):
            return OLDER if boot_s < self.boot_s else "its clock leapt ahead"
        return None

    def ask(self, now_s: float) -> int:
        """Return the stamp of a TIMESYNC that is sent now, ns."""
        self._asked_ns.append(round(now_s * 1e9))
        return self._asked_ns[-1]

    def add_answer(self, asked_ns: int, now_s: float) -> None:
        """Add the answer to a TIMESYNC of this stamp."""
        soon = now_s - asked_ns / 1e9 < self.limit_s
        if self.late and self.boot_s is not None and asked_ns in self._asked_ns and soon:
            self._adopt(self.boot_s, now_s)

    def _confirms(self, boot_s: float, now_s: float) -> bool:
        """Return whether this confirms that the clock has restarted."""
        other = self._other
        if other is None or not _goes_on(other[2], other[1], boot_s, now_s):
            self._other = (now_s, now_s, boot_s)
            return False
        self._other = (other[0], now_s, boot_s)
        if now_s - other[0] < REBOOT_CONFIRMED_S:
            return False
        self.reboots += 1
        self._adopt(boot_s, now_s)
        return True

    def _adopt(self, boot_s: float, now_s: float) -> None:
        self._offset, self.boot_s, self.late = ClockOffset(), None, False
        self._set(boot_s, now_s)

    def _set(self, boot_s: float, now_s: float) -> None:
        difference_s, offset_s = now_s - boot_s, self.offset_s
        if self.boot_s is not None and offset_s is not None:
            kept_s = difference_s - (self._received_s - self.boot_s)
            late = self.late or kept_s > self.limit_s
            self.late = late and difference_s - offset_s > self.limit_s
        self.boot_s, self._received_s, self._moved_s = boot_s, now_s, now_s
        self._other = None
        if not self.late:
            self._offset.add(difference_s, now_s)


def _goes_on(boot_s: float, received_s: float, next_boot_s: float, now_s: float) -> bool:
    """Return whether a clock that showed one time may show the other now."""
    most_s = MAX_AHEAD_S + FASTEST_CLOCK * (now_s - received_s)
    return 0.0 < next_boot_s - boot_s <= most_s


@dataclass(slots=True)
class CameraClock:
    """A camera's own time since boot, against the autopilot's, which most cameras use.

    Another clock is ahead or behind by a constant, which the fastest announcement shows best.
    """

    _suspect_s: float | None = None
    _lead: RecentLeast = field(default_factory=lambda: RecentLeast(_LEAD_WINDOW_S))

    @property
    def lead_s(self) -> float:
        """Return the difference between the autopilot's offset and this camera's, s."""
        lead_s = self._lead.value
        return 0.0 if lead_s is None or abs(lead_s) < _SAME_CLOCK_S else lead_s

    def add(self, boot_s: float, now_s: float, autopilot_offset_s: float) -> None:
        """Add the time of an announcement that has just arrived."""
        lead_s = now_s - boot_s - autopilot_offset_s
        least_s = self._lead.value
        if least_s is not None:
            ahead = lead_s - least_s < -_CAMERA_AHEAD_S
            # requested announcements are late, but not by a minute
            if ahead or lead_s - least_s > _OLDEST_ANNOUNCEMENT_S:
                again = self._suspect_s is not None and abs(lead_s - self._suspect_s) < 2.0
                self._suspect_s = lead_s
                if not again:
                    return
                self._lead.clear()
        self._suspect_s = None
        self._lead.add(lead_s, now_s)


@dataclass(frozen=True, slots=True)
class Fix:
    """A reported place, and its times (our loop, its own clock)."""

    position: LatLon
    amsl_m: float
    home_amsl_m: float
    now_s: float
    boot_s: float

    def fault_after(self, before: Fix) -> str | None:
        """Return why the vehicle cannot be here after it was there."""
        passed_s = max(self.now_s - before.now_s, self.boot_s - before.boot_s, 0.0)
        most_m = SLACK_M + FASTEST_M_S * passed_s
        if distance_m(before.position, self.position) > most_m:
            return "farther from the last position than it can fly"
        if abs(self.amsl_m - before.amsl_m) > most_m:
            return "farther from the last height than it can climb"
        if abs(self.home_amsl_m - before.home_amsl_m) > SLACK_M:
            return "the height of its home changed"
        return None


@dataclass(slots=True)
class Track:
    """The last place of a vehicle, and a jump that is not accepted yet."""

    last: Fix | None = None
    jumps: int = 0
    jumped_m: float = 0.0
    _first: Fix | None = None
    _latest: Fix | None = None

    def add(self, fix: Fix) -> str | None:
        """Add a reported place; return its fault."""
        fault = None if self.last is None else fix.fault_after(self.last)
        if fault is not None and self.last is not None:
            if self._first is None or self._latest is None or fix.fault_after(self._latest):
                self._first = fix
            self._latest = fix
            if fix.now_s - self._first.now_s < JUMP_CONFIRMED_S:
                return fault
            self.jumps += 1
            self.jumped_m = max(
                distance_m(self.last.position, fix.position),
                abs(fix.amsl_m - self.last.amsl_m),
                abs(fix.home_amsl_m - self.last.home_amsl_m),
            )
        self.last, self._first, self._latest = fix, None, None
        return None
