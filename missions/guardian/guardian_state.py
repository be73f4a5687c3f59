"""What the guardian is given, what it remembers, and what it says."""

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
    """What the guardian holds a vehicle against: the same for a whole mission."""

    fence: Fence
    energy: EnergyModel
    slack_s: float = 0.0
    """What every limit is longer, where a simulator runs faster than a busy machine reads, s."""
    relief_m: float = 0.0
    """From the lowest to the highest ground, m: so much more an autopilot may climb to return."""


@dataclass(frozen=True, slots=True)
class Task:
    """What the vehicle was told to do last. Points are in the grid's fixed frame.

    `path` begins where the vehicle was when it was told; for a hover it is that one point.
    It may stray besides as far as a target drifts. A `course` says where it is at each moment; then
    there is no path.
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
class Seen:
    """What telemetry reports at an instant. Heights are above the vehicle's home."""

    t_s: float
    position: GridPoint
    height_m: float
    ground_speed_m_s: float
    home: GridPoint
    armed: bool
    airborne: bool
    """Armed, and in the air by the autopilot's own landing detector."""
    mode: Mode
    remaining_wh: float | None = None
    """None where the charge is not known."""
    wind_m_s: float | None = None
    struck_m_s: float = 0.0
    """How fast it came down at the touch-down since the last look; 0 if it flies, or stands."""
    by_map: bool = False
    """It knows better than its autopilot where it is: it is flown home by targets."""
    slews: bool = False
    """Its position leapt just now, and still follows: how fast that moves is no speed."""
    home_amsl_m: float = 0.0
    """Height above the sea that `height_m` is counted from; a PX4 moves it when it has landed."""

    @property
    def amsl_m(self) -> float:
        """Its height above the sea."""
        return self.home_amsl_m + self.height_m


@dataclass(frozen=True, slots=True)
class Verdict:
    """What must happen now, and why, in words for the operator."""

    rung: Literal["report", "rtl", "land", "crashed"]
    reason: str
    hurry: bool = False
    """Descend as fast as it flies to `QUICK_M`, and land only from there: a landing takes 20 s for
    the last 10 m, in which a storm carries it 200 m."""
    behind: bool = False
    """It is on its path, and only later than planned: it may go on from where it is."""


@dataclass(frozen=True, slots=True)
class Guard:
    """What the guardian remembers of one vehicle."""

    task: Task = Task("ground", 0.0)
    action: Action | None = None
    """What it has the autopilot do by itself; None while the mission flies the vehicle."""
    acted_s: float = 0.0
    hurries: bool = False
    """Its action is to land, and to descend as fast as it flies before."""
    reported: bool = False
    reported_s: float = 0.0
    was_up: bool = False
    at_height: bool = False
    down: bool = False
    amsl_m: float = 0.0
    fell: bool = False
    """It came down faster than anybody flies it."""
    along_m: float = 0.0
    """How far along its path it has come."""
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
    """It is outside of the fence, or soon will be if it moves on like this."""
    low_since_s: float | None = None
    lowest_m: float = float("inf")
    """Height above the sea that its landing has come down to, by steps of `SINKS_M`, m."""
    lowest_s: float = 0.0
    sunk_since_s: float | None = None
    spent_since_s: float | None = None

    @property
    def landing(self) -> bool:
        """Whether it lands by our order, the mission's or its own."""
        return self.action == "land" or (self.action is None and self.task.doing == "land")

    def told(self, task: Task) -> Guard:
        """This guard after a new order; a vehicle that it has taken over it keeps."""
        if self.action is not None:
            return self
        if task.doing == "ground" and self.task.doing == "land" and self.was_up:
            return self  # it has landed, and stands by: when its motors stop, that is no crash
        again = task.doing == "climb"  # from the ground: what was before is over
        climbs = task.height_m > self.task.height_m + HEIGHT_LOST_M / 2  # to another layer
        # plans of a path follow one another faster than a vehicle is seen to be off it
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

    def acting(self, action: Action, t_s: float, *, hurry: bool = False) -> Guard:
        """This guard after it had the autopilot return or land by itself."""
        return replace(
            self, action=action, acted_s=t_s, hurries=hurry,
            along_m=0.0, best_m=float("inf"), best_s=t_s,
            receding_since_s=None, last_gap_m=None, off_since_s=None,
        )  # fmt: skip

    def released(self) -> Guard:
        """This guard after a pilot took the vehicle, or after it stands on the ground."""
        return Guard()
