"""Input, memory and output of the guardian."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

from missions.geo.braking import Course
from missions.geo.fence import Fence
from missions.guardian.thresholds import HEIGHT_LOST_M
from missions.mission.energy import EnergyModel
from missions.units import GridPoint

Mode = Literal["follow", "rtl", "land", "other"]
Doing = Literal["ground", "climb", "leg", "path", "hold", "land"]
Action = Literal["rtl", "land"]


@dataclass(frozen=True, slots=True)
class Limits:
    """The limits of a vehicle: the same for a whole mission."""

    fence: Fence
    energy: EnergyModel
    slack_s: float = 0.0
    """Addition to every time limit for a simulator that is faster than the machine, s."""
    relief_m: float = 0.0
    """Highest ground above lowest ground, m: a return may climb by this much more."""


@dataclass(frozen=True, slots=True)
class Task:
    """The last order of a vehicle, with points in the grid's fixed frame.

    `path` begins where the vehicle was at the order; for a hover it is that one point. The vehicle
    may also stray as far as a target drifts. A `course` gives its position at each moment, without
    a path.
    """

    doing: Doing
    since_s: float
    path: tuple[GridPoint, ...] = ()
    homeward: bool = False
    height_m: float = 0.0
    estimate_s: float = 0.0
    drift_m_s: float = 0.0
    name: str = ""
    course: Course | None = None


@dataclass(frozen=True, slots=True)
class Snapshot:
    """The vehicle's state by telemetry at an instant. Heights are above the vehicle's home."""

    t_s: float
    position: GridPoint
    height_m: float
    ground_speed_m_s: float
    home: GridPoint
    armed: bool
    airborne: bool
    """True if it is armed, and in the air by the autopilot's own landing detector."""
    mode: Mode
    remaining_wh: float | None = None
    """Charge, Wh; None if it is not known."""
    wind_m_s: float | None = None
    struck_m_s: float = 0.0
    """Sink rate at a touch-down since the last call, m/s; 0 if it flies or is on the ground."""
    by_map: bool = False
    """True if its position comes from its own map: it flies home by targets, not by RTL."""
    slews: bool = False
    """True if its position has just jumped and still settles: its motion is no speed."""
    home_amsl_m: float = 0.0
    """Height above the sea of the origin of `height_m`, m; a PX4 moves it after a landing."""

    @property
    def amsl_m(self) -> float:
        """Height above the sea, m."""
        return self.home_amsl_m + self.height_m


@dataclass(frozen=True, slots=True)
class Verdict:
    """A measure that must be taken now, and its reason as text for the operator."""

    rung: Literal["report", "rtl", "land", "crashed"]
    reason: str
    hurry: bool = False
    """True to descend quickly to `QUICK_M` before the landing.

    A landing takes 20 s for the last 10 m; a storm carries the vehicle 200 m in that time.
    """
    behind: bool = False
    """True if it is on its path and only later than planned: it may continue from its place."""


@dataclass(frozen=True, slots=True)
class Guard:
    """The guardian's memory of one vehicle."""

    task: Task = Task("ground", 0.0)
    action: Action | None = None
    """Action of the autopilot that it has commanded; None while the mission flies the vehicle."""
    acted_s: float = 0.0
    hurries: bool = False
    """True if its action is to land after a quick descent."""
    reported: bool = False
    reported_s: float = 0.0
    was_up: bool = False
    at_height: bool = False
    down: bool = False
    amsl_m: float = 0.0
    fell: bool = False
    """True if it came down faster than any commanded descent."""
    along_m: float = 0.0
    """Distance flown along its path, m."""
    best_m: float = float("inf")
    best_s: float = 0.0
    receding_since_s: float | None = None
    swept_since_s: float | None = None
    last_gap_m: float | None = None
    last_position: GridPoint | None = None
    last_s: float | None = None
    off_since_s: float | None = None
    outside_since_s: float | None = None
    outside_m: float = 0.0
    leaves_fence: bool = False
    """True if it is outside the fence, or soon will be at its present motion."""
    low_since_s: float | None = None
    lowest_m: float = float("inf")
    """Lowest height above the sea in its landing, by steps of `LANDING_DESCENT_M`, m."""
    lowest_s: float = 0.0
    sunk_since_s: float | None = None
    spent_since_s: float | None = None

    @property
    def landing(self) -> bool:
        """True if it lands by an order of the mission or of the guardian."""
        return self.action == "land" or (self.action is None and self.task.doing == "land")

    def with_task(self, task: Task) -> Guard:
        """Return this guard after a new order; it keeps a vehicle that it has taken over."""
        if self.action is not None:
            return self
        if task.doing == "ground" and self.task.doing == "land" and self.was_up:
            return self  # it has landed and waits: stopped motors are no crash
        again = task.doing == "climb"  # a new flight from the ground
        climbs = task.height_m > self.task.height_m + HEIGHT_LOST_M / 2  # to another layer
        # plans of a path follow one another faster than a deviation is seen
        goes_on = task.course is not None and self.task.course is not None
        return replace(
            self,
            task=task,
            was_up=self.was_up and not again,
            at_height=self.at_height and not (again or climbs),
            down=self.down and not again,
            reported=False,
            along_m=0.0,
            best_m=float("inf"),
            best_s=task.since_s,
            last_gap_m=None,
            off_since_s=self.off_since_s if goes_on else None,
            sunk_since_s=self.sunk_since_s if goes_on else None,
        )

    def with_action(self, action: Action, t_s: float, *, hurry: bool = False) -> Guard:
        """Return this guard after it has commanded the autopilot to return or land."""
        return replace(
            self, action=action, acted_s=t_s, hurries=hurry,
            along_m=0.0, best_m=float("inf"), best_s=t_s,
            receding_since_s=None, last_gap_m=None, off_since_s=None,
        )  # fmt: skip

    def released(self) -> Guard:
        """Return this guard after a pilot took the vehicle, or after its landing."""
        return Guard()
