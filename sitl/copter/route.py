"""A mission in flight: one navigation item at a time.

The items behind a reached navigation item are done on the way to the next one; a condition delays
those behind it.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from enum import IntEnum
from typing import Protocol

from pymavlink.dialects.v20 import ardupilotmega as mav

from sitl.copter.control import Estimate, Tuning
from sitl.copter.failsafes import INFO
from sitl.copter.fence import Place
from sitl.copter.mission_items import IDLE_COMMANDS, NAMES, NAVIGATION, SPEEDS, Item
from sitl.copter.modes import Phase

_MAX_JUMPS = 64  # without a navigation item between them


class Progress(IntEnum):
    """The progress of a mission; the values are MISSION_STATE's."""

    NOT_STARTED = 2
    ACTIVE = 3
    PAUSED = 4
    COMPLETE = 5


class Pilot(Protocol):
    """The part of an autopilot that a route uses."""

    t_s: float
    phase: Phase
    estimate: Estimate
    hold: Place

    @property
    def tuning(self) -> Tuning: ...  # noqa: D102
    @property
    def airborne(self) -> bool: ...  # noqa: D102
    @property
    def yaw_goal(self) -> float: ...  # noqa: D102
    @property
    def turned(self) -> bool: ...  # noqa: D102
    def distance_to(self, place: Place) -> float: ...  # noqa: D102
    def climb_to(self, up_m: float) -> None: ...  # noqa: D102
    def fly_to(self, place: Place, yaw_rad: float | None = None) -> None: ...  # noqa: D102
    def stay(self) -> None: ...  # noqa: D102
    def land(self) -> None: ...  # noqa: D102
    def go_home(self) -> None: ...  # noqa: D102
    def face(self, yaw_rad: float) -> None: ...  # noqa: D102
    def set_speed(self, kind: str, speed_m_s: float) -> None: ...  # noqa: D102
    def enable_fence(self, on: bool) -> None: ...  # noqa: D102
    def send_text(self, severity: int, text: str) -> None: ...  # noqa: D102
    def mission_done(self) -> None: ...  # noqa: D102


class Route:
    """The mission `plan` and its progress.

    Items before `first` are not flown: an ArduPilot's item 0 is home. `locate` puts an item into
    the world's plane; `camera` takes the interval and count of IMAGE_START_CAPTURE, or None to
    stop.
    """

    def __init__(self, plan: list[Item], first: int = 1) -> None:
        self.plan = plan
        self.first = first
        self.progress = Progress.NOT_STARTED
        self.current = 0
        self.reached: list[int] = []  # not yet sent
        self.locate: Callable[[Item], Place | None] = lambda _: None
        self.camera: Callable[[tuple[float, int] | None], None] = lambda _: None
        self._item: Item | None = None
        self._pending: list[int] = []
        self._held_since_s: float | None = None  # when a condition began
        self._jumps: dict[int, int] = {}
        self._goal: Place | None = None
        self._arrived_s: float | None = None
        self._begun_s = 0.0
        self._landing = False
        self._every_m = 0.0
        self._last_shot: Place | None = None

    @property
    def total(self) -> int:
        """Count of items that are flown."""
        return max(0, len(self.plan) - self.first)

    @property
    def begins_with_takeoff(self) -> bool:
        """True if the next navigation item is a take-off."""
        start = self.current if self.progress == Progress.PAUSED else self.first
        ahead = self.plan[max(self.first, start) :]
        following = (item.command for item in ahead if item.command in NAVIGATION)
        return bool(next(following, None) == mav.MAV_CMD_NAV_TAKEOFF)

    # --- what can be asked for ------------------------------------------------------------------

    def jump_to(self, seq: int, pilot: Pilot) -> bool:
        """Execute MISSION_SET_CURRENT; home stands for the first item. False: no such item."""
        index = max(self.first, seq)
        if seq < 0 or index >= len(self.plan):
            return False
        if self.progress == Progress.ACTIVE:
            self._search(index, pilot)
        else:
            self.current = index
            self.progress = Progress.PAUSED
        return True

    def begin(self, pilot: Pilot) -> None:
        """Start, or resume the item that was flown."""
        fresh = self.progress != Progress.PAUSED or pilot.tuning.mission_restarts
        if fresh:
            self.reset()
        self.progress = Progress.ACTIVE
        self._search(self.first if fresh else max(self.first, self.current), pilot)

    def pause(self, pilot: Pilot) -> bool:
        """Hold position (DO_PAUSE_CONTINUE); return False if no item is being flown."""
        if self.progress != Progress.ACTIVE or not pilot.airborne:
            return False
        self.progress = Progress.PAUSED
        pilot.stay()
        return True

    def proceed(self, pilot: Pilot) -> bool:
        """Resume after a pause; return False if there is none."""
        if self.progress != Progress.PAUSED:
            return False
        self.progress = Progress.ACTIVE
        self._search(max(self.first, self.current), pilot)
        return True

    def stop(self) -> None:
        """Pause: another mode flies."""
        self._every_m = 0.0
        if self.progress == Progress.ACTIVE:
            self.progress = Progress.PAUSED

    def reset(self) -> None:
        """Begin with the first item next time."""
        self.current = 0
        self._jumps.clear()
        self._pending.clear()
        self._item = None
        self._every_m = 0.0
        if self.progress != Progress.COMPLETE:
            self.progress = Progress.NOT_STARTED

    def plan_changed(self) -> None:
        """Note that the plan was replaced; a mission in flight continues."""
        if self.progress == Progress.ACTIVE:
            return
        self.progress = Progress.NOT_STARTED
        self.reset()

    # --- time -----------------------------------------------------------------------------------

    def step(self, pilot: Pilot) -> None:
        """Advance to the next item once the present one is done."""
        if self.progress != Progress.ACTIVE:
            return
        self._do_pending(pilot)
        if self._every_m > 0.0:
            self._shoot_by_distance(pilot)
        if self._item is None:
            if not self._pending:
                self._complete(pilot)
        elif self._verify(self._item, pilot):
            self.reached.append(self.current)
            self._search(self.current + 1, pilot)

    def _search(self, index: int, pilot: Pilot) -> None:
        self._pending.clear()
        self._held_since_s = None
        self._item = None
        jumps = 0
        while index < len(self.plan):
            item = self.plan[index]
            if item.command == mav.MAV_CMD_DO_JUMP:
                jumps += 1
                if jumps > _MAX_JUMPS:
                    break
                index = self._jump(index, item)
            elif item.command in NAVIGATION:
                self._item = item
                self.current = index
                self._start(item, pilot)
                return
            else:
                self._pending.append(index)
                index += 1

    def _jump(self, index: int, item: Item) -> int:
        target, repeat = int(item.p[0]), int(item.p[1])
        done = self._jumps.get(index, 0)
        if not self.first <= target < len(self.plan) or (repeat >= 0 and done >= repeat):
            return index + 1
        self._jumps[index] = done + 1
        return target

    def _complete(self, pilot: Pilot) -> None:
        self.progress = Progress.COMPLETE
        self._every_m = 0.0
        pilot.mission_done()

    # --- navigation -----------------------------------------------------------------------------

    def _start(self, item: Item, pilot: Pilot) -> None:
        pilot.send_text(INFO, f"Mission: {self.current} {NAMES[item.command]}")
        self._arrived_s, self._goal, self._landing = None, None, False
        self._begun_s = pilot.t_s
        command = item.command
        if command == mav.MAV_CMD_NAV_RETURN_TO_LAUNCH:
            if pilot.airborne:
                pilot.go_home()
        elif command == mav.MAV_CMD_NAV_TAKEOFF:
            place = self.locate(item)
            pilot.climb_to(pilot.hold[2] if place is None else place[2])
        elif command != mav.MAV_CMD_NAV_DELAY:
            self._goal = self._place(item, pilot)
            if pilot.airborne:
                pilot.fly_to(self._goal)

    def _place(self, item: Item, pilot: Pilot) -> Place:
        """Return where an item lies: 0, 0 is here, and landing keeps the height."""
        place = self.locate(item)
        east, north, up = pilot.hold
        if place is None or (item.here and item.z == 0.0):
            return pilot.hold
        if not item.here:
            east, north = place[:2]
        if item.command != mav.MAV_CMD_NAV_LAND:
            up = place[2]
        return east, north, up

    def _verify(self, item: Item, pilot: Pilot) -> bool:
        command = item.command
        if command == mav.MAV_CMD_NAV_TAKEOFF:
            return pilot.phase == Phase.FLY
        if command == mav.MAV_CMD_NAV_DELAY:
            return pilot.t_s - self._begun_s >= item.p[0]
        if command == mav.MAV_CMD_NAV_RETURN_TO_LAUNCH:
            return not pilot.airborne
        if command == mav.MAV_CMD_NAV_LAND:
            return self._verify_land(pilot)
        if not pilot.airborne or not self._arrived(pilot):
            return False
        if command == mav.MAV_CMD_NAV_LOITER_UNLIM:
            return False
        return pilot.t_s - (self._arrived_s or 0.0) >= item.p[0]

    def _verify_land(self, pilot: Pilot) -> bool:
        if not pilot.airborne:
            return True
        if not self._landing and self._arrived(pilot):
            self._landing = True
            pilot.land()
        return False

    def _arrived(self, pilot: Pilot) -> bool:
        near_m = pilot.tuning.arrival_m
        if self._arrived_s is None and self._goal and pilot.distance_to(self._goal) <= near_m:
            self._arrived_s = pilot.t_s
        return self._arrived_s is not None

    # --- on the way -----------------------------------------------------------------------------

    def _do_pending(self, pilot: Pilot) -> None:
        while self._pending:
            index = self._pending[0]
            if index >= len(self.plan):  # the mission was replaced by a shorter one
                self._pending.clear()
                return
            item = self.plan[index]
            if self._held_since_s is None:
                text = f"Mission: {index} {NAMES[item.command]}"
                idle = item.command in IDLE_COMMANDS
                pilot.send_text(INFO, text + " has no effect" * idle)
                self._held_since_s = pilot.t_s
                self._do(item, pilot)
            if not self._condition_met(item, pilot, pilot.t_s - self._held_since_s):
                return
            self._held_since_s = None
            self._pending.pop(0)

    def _condition_met(self, item: Item, pilot: Pilot, held_s: float) -> bool:
        if item.command == mav.MAV_CMD_CONDITION_DELAY:
            return held_s >= item.p[0]
        if item.command == mav.MAV_CMD_CONDITION_DISTANCE:
            return self._goal is None or pilot.distance_to(self._goal) <= item.p[0]
        return item.command != mav.MAV_CMD_CONDITION_YAW or pilot.turned

    def _do(self, item: Item, pilot: Pilot) -> None:
        command, p = item.command, item.p
        if command == mav.MAV_CMD_DO_CHANGE_SPEED:
            kind = SPEEDS.get(int(p[0]))
            if kind is not None and p[1] > 0.0:
                pilot.set_speed(kind, p[1])
        elif command == mav.MAV_CMD_CONDITION_YAW:
            goal = math.radians(p[0])
            if p[3] and not math.isnan(p[3]):
                goal = pilot.yaw_goal + math.copysign(1.0, p[2]) * goal
            pilot.face(goal)
        elif command == mav.MAV_CMD_DO_DIGICAM_CONTROL:
            if item.x == 1:
                self.camera((0.0, 1))
        elif command == mav.MAV_CMD_IMAGE_START_CAPTURE:
            self.camera((p[1], int(max(0.0, min(p[2], 1e6)))))
        elif command == mav.MAV_CMD_IMAGE_STOP_CAPTURE:
            self.camera(None)
        elif command == mav.MAV_CMD_DO_SET_CAM_TRIGG_DIST:
            self._every_m = max(0.0, p[0])
            self._last_shot = None
        elif command == mav.MAV_CMD_DO_FENCE_ENABLE:
            pilot.enable_fence(p[0] == 1.0)

    def _shoot_by_distance(self, pilot: Pilot) -> None:
        if self._last_shot is None or pilot.distance_to(self._last_shot) >= self._every_m:
            self._last_shot = pilot.estimate.place
            self.camera((0.0, 1))
