"""Mission time of a resumed flight.

During a flight it is the event loop's. For a new process it comes from the computer's time since
its start (in the same boot), else from the vehicle's time since boot. Only without these it comes
from the wall clock, which people and time servers set. Marks of all three are in the journal. With
a drifting region a wrong mission time displaces every cell.
"""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from enum import StrEnum
from pathlib import Path
from typing import Final

from pydantic import TypeAdapter, ValidationError

from missions.errors import JournalError
from uavmap.journal.event_log import Journal

CLOCK: Final = "clock"
"""Key of the mark in the journal's meta."""
MARK_EVERY_S: Final = 20.0
DOUBTFUL_S: Final = 180.0
"""Difference from which on a wall clock is doubtful, s."""
_BOOT_ID: Final = Path("/proc/sys/kernel/random/boot_id")


@dataclass(frozen=True, slots=True)
class Clocks:
    """The values of all clocks at an instant."""

    wall_utc_s: float
    boot_id: str | None
    """Id that is new after each start of this computer; None if it is not known."""
    since_boot_s: float
    """Time since this computer was started, including sleep, s."""
    vehicle_since_boot_s: float | None = None
    """Time since boot of the first vehicle, s; None before its first message."""


@dataclass(frozen=True, slots=True)
class Mark:
    """The values of the clocks at an instant of the mission."""

    mission_s: float
    clocks: Clocks


class Basis(StrEnum):
    """The source of the mission time."""

    COMPUTER = "time since the start of this computer"
    VEHICLE = "time since the start of the vehicle"
    WALL_CLOCK = "wall clock"
    LAST_EVENT = "last event"


@dataclass(frozen=True, slots=True)
class MissionTime:
    """The time at which the mission continues."""

    start_s: float
    basis: Basis
    note: str = ""
    """Note for the operator; empty without one."""
    question: str = ""
    """Question to the operator: yes means `if_yes_s`."""
    if_yes_s: float = 0.0


def mission_time(
    last_event_s: float,
    mark: Mark | None,
    now: Clocks,
    *,
    epoch_utc_s: float,
    speedup: float = 1.0,
    drift_m_s: float = 0.0,
) -> MissionTime:
    """Decide on the mission time at which a mission continues. It never runs backwards.

    `last_event_s` is in mission time, `mark` None in a journal of a very short flight.
    `epoch_utc_s` is the wall clock at mission time 0, `speedup` mission seconds in a second of this
    computer, `drift_m_s` the speed of a drifting region.
    """
    if mark is None:
        wall_s = (now.wall_utc_s - epoch_utc_s) * speedup
    else:
        wall_s = mark.mission_s + (now.wall_utc_s - mark.clocks.wall_utc_s) * speedup
    known_s, basis = _known(mark, now, speedup)
    if known_s is not None:
        return _by_known(max(last_event_s, known_s), basis, last_event_s, wall_s, speedup)
    gap_s = (wall_s - last_event_s) / speedup
    if abs(gap_s) <= DOUBTFUL_S:
        return MissionTime(max(last_event_s, wall_s), Basis.WALL_CLOCK)
    return _by_last_event(last_event_s, wall_s, gap_s, drift_m_s * speedup)


def _known(mark: Mark | None, now: Clocks, speedup: float) -> tuple[float | None, Basis]:
    """Return the mission time by a clock that cannot be set, if there is one."""
    if mark is None:
        return None, Basis.LAST_EVENT
    before = mark.clocks
    passed_s = now.since_boot_s - before.since_boot_s
    if now.boot_id is not None and now.boot_id == before.boot_id and passed_s >= 0.0:
        return mark.mission_s + passed_s * speedup, Basis.COMPUTER
    if now.vehicle_since_boot_s is not None and before.vehicle_since_boot_s is not None:
        # the vehicle's seconds are the mission's, at any speed-up
        passed_s = now.vehicle_since_boot_s - before.vehicle_since_boot_s
        if passed_s >= 0.0:  # else it was restarted
            return mark.mission_s + passed_s, Basis.VEHICLE
    return None, Basis.LAST_EVENT


def _by_known(
    start_s: float, basis: Basis, last_event_s: float, wall_s: float, speedup: float
) -> MissionTime:
    off_s = (wall_s - start_s) / speedup
    if abs(off_s) <= DOUBTFUL_S:
        jump_s = (start_s - last_event_s) / speedup
        text = f"{duration(jump_s)} have passed since the last event"
        return MissionTime(start_s, basis, text if jump_s > DOUBTFUL_S else "")
    way = "forward" if off_s > 0 else "back"
    note = (
        f"the wall clock was set {way} by {duration(off_s)} since the flight; mission time "
        f"continues by the {basis}"
    )
    if basis is Basis.COMPUTER or off_s < 0:
        return MissionTime(start_s, basis, note)
    # a vehicle that was restarted long ago may still have a higher time than before
    question = f"Have {duration((wall_s - last_event_s) / speedup)} passed since the last event?"
    return MissionTime(start_s, basis, note, question, wall_s)


def _by_last_event(
    last_event_s: float, wall_s: float, gap_s: float, drift_m_s: float
) -> MissionTime:
    if gap_s < 0.0:
        note = (
            f"the wall clock is {duration(gap_s)} before the last event, so it is wrong; mission "
            "time goes on from the last event"
        )
        if drift_m_s > 0.0:
            note += (
                f"; the region drifts, so every cell is displaced by {drift_m_s:g} m for each "
                "second that has passed since"
            )
        return MissionTime(last_event_s, Basis.LAST_EVENT, note)
    note = (
        f"by the wall clock {duration(gap_s)} have passed since the last event, and nothing "
        "confirms it; mission time continues from the last event"
    )
    if drift_m_s > 0.0:
        note += (
            f"; if the clock is right, the region has drifted on and every cell is displaced by "
            f"{drift_m_s * gap_s:,.0f} m"
        )
    question = f"Have {duration(gap_s)} passed since the last event, as by the wall clock?"
    return MissionTime(last_event_s, Basis.LAST_EVENT, note, question, wall_s)


def duration(seconds: float) -> str:
    """Return a length of time in its two largest units.

    >>> duration(3 * 86400.0 + 7200.0), duration(-250.0), duration(7.0)
    ('3 d 2 h', '4 min 10 s', '7 s')
    """
    left = round(abs(seconds))
    parts: list[str] = []
    for unit, size in (("d", 86400), ("h", 3600), ("min", 60), ("s", 1)):
        count, left = divmod(left, size)
        if count or (unit == "s" and not parts):
            parts.append(f"{count:,} {unit}")
    return " ".join(parts[:2])


# --- on this computer ------------------------------------------------------------------------
def read_clocks(vehicle_since_boot_s: float | None = None) -> Clocks:
    """Return the clocks of this computer."""
    try:
        boot_id = _BOOT_ID.read_text("ascii").strip() or None
    except (OSError, UnicodeDecodeError):  # not Linux: only the wall clock is left
        boot_id = None
    clock = getattr(time, "CLOCK_BOOTTIME", time.CLOCK_MONOTONIC)
    return Clocks(time.time(), boot_id, time.clock_gettime(clock), vehicle_since_boot_s)


class Marks:
    """Keeps a mark in the journal regularly; a mark that cannot be written stops nothing."""

    def __init__(self, journal: Journal, clocks: Callable[[], Clocks] = read_clocks) -> None:
        self._journal = journal
        self._clocks = clocks
        self._due_s = float("-inf")

    def note(self, mission_s: float) -> None:
        """Note the present mission time; call it as often as you like."""
        now_s = time.monotonic()
        if now_s < self._due_s:
            return
        self._due_s = now_s + MARK_EVERY_S
        mark = Mark(round(mission_s, 3), self._clocks())
        with contextlib.suppress(JournalError):
            self._journal.put_meta(CLOCK, asdict(mark))


_ADAPTER: Final[TypeAdapter[Mark]] = TypeAdapter(Mark)


def last_mark(meta: Mapping[str, object]) -> Mark | None:
    """Return the mark in a journal's meta."""
    try:
        return _ADAPTER.validate_python(meta.get(CLOCK))
    except ValidationError:
        return None


def resume_time_s(
    found: MissionTime, say: Callable[[str], None], ask: Callable[[str], bool] | None
) -> float:
    """Return the mission time at which a flight with real clocks continues.

    Reports notes, and asks about doubtful times; without a terminal the safe assumption holds.
    """
    if found.question and ask is not None and ask(found.question):
        say(f"mission time continues at {found.if_yes_s:.0f} s, by the wall clock")
        return found.if_yes_s
    if found.note:
        say(found.note)
    return found.start_s
