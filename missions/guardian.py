"""The guardian of one aircraft: notices that what should happen does not, and says what must.

    watch(limits, guard, seen) -> (guard, verdict)

It knows the fence, the battery, what the vehicle was told last, and what its telemetry says; not
the journal, the explorer, the camera or the other vehicles. So it goes on when they fail. Pure,
as the reducer is: the driver feeds it about once a second and carries out its verdicts, and the
tests feed it from a fleet of points.

A verdict climbs a ladder, one rung at a time, and stops where it helps:

    report   the mission is told that the order failed, and brings the vehicle home
    rtl      the autopilot brings it home by itself
    land     it lands where it is, before its energy is gone
    crashed  it is down already

Nothing is done to a vehicle that a pilot or a failsafe flies (`mode` "other").
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final, Literal

from shapely.geometry import LineString, Point
from shapely.ops import substring

from missions.energy import CLIMB_SPEED_M_S, LANDING_SPEED_M_S, EnergyModel
from missions.ground.fence import Fence, route_length_m
from missions.units import GridPoint

Mode = Literal["follow", "rtl", "land", "other"]
Doing = Literal["ground", "climb", "leg", "hold", "land"]
Action = Literal["rtl", "land"]

LEG_FACTOR: Final = 3.0
LEG_SLACK_S: Final = 20.0
"""A leg may take its estimate so many times, and so long besides."""
NO_PROGRESS_S: Final = 15.0
"""So long a leg may bring the vehicle no nearer to its end."""
PROGRESS_M: Final = 1.0
OFF_PATH_M: Final = 12.0
"""Position control holds a path within 3 m, gusts included; a turn at full speed swings out 6 m."""
OFF_PATH_S: Final = 10.0
OFF_PATH_HOME_S: Final = 5.0
"""A jump of the position estimate is flown back from by the autopilot itself, in some seconds."""
RECEDING_M_S: Final = 2.0
RECEDING_S: Final = 4.0
"""A vehicle that moves away from its goal this fast for so long is carried away."""
SWEPT_M_S: Final = 6.0
SWEPT_SHARE: Final = 1.2
SWEPT_S: Final = 3.0
"""One that is carried away faster than this, and than it flies, can do nothing against it."""
BLOWN_S: Final = 2.0
"""In a wind that the airframe cannot hold, being carried away for so long is enough."""
HOPELESS: Final = 1.5
"""In so many times the wind that it can hold it lands before it is seen to be carried away."""
OUTSIDE_S: Final = 2.0
RECOVERY_S: Final = 6.0
"""A rung of the ladder has to help within this time."""
HEIGHT_LOST_M: Final = 4.0
HEIGHT_LOST_SHARE: Final = 0.35
HEIGHT_LOST_S: Final = 3.0
DOWN_M: Final = 0.8
DOWN_S: Final = 4.0
DOWN_M_S: Final = 0.7
"""Below this height, no faster than this, for so long: it lies on the ground."""
FALL_M_S: Final = 4.0
"""Nobody descends this fast: it falls."""
STANDS_S: Final = 20.0
"""Motors that still turn so long after a touch-down will be stopped by nobody but the crew."""
UP_M: Final = 2.0
REACH_M: Final = 5.0
REACH_M_S: Final = 15.0
"""A vehicle is looked for on its path no farther ahead than it can have flown."""
PAD_M: Final = 5.0
"""A landing nearer to its pad than this is a landing at home."""
QUICK_M: Final = 2.0
"""Down to this height a vehicle that is carried away descends quickly."""
LAST_MARGIN: Final = 1.25
"""Of the energy for landing from here: with less it lands now."""
SPENT_S: Final = 2.5
"""So long the charge must be told to be so low: one wrong message is no empty battery."""


@dataclass(frozen=True, slots=True)
class Limits:
    """What the guardian holds a vehicle against: the same for a whole mission."""

    fence: Fence
    energy: EnergyModel
    slack_s: float = 0.0
    """What everything may take longer, where a simulator runs faster than a busy machine hears."""


@dataclass(frozen=True, slots=True)
class Task:
    """What the vehicle was told to do last. Points are in the grid's fixed frame.

    `path` begins where the vehicle was when it was told; for a hover it is that one point.
    `slack_m` is what it may stray besides, by a target that drifts.
    """

    doing: Doing
    since_s: float
    path: tuple[GridPoint, ...] = ()
    homeward: bool = False
    height_m: float = 0.0
    estimate_s: float = 0.0
    drift_m_s: float = 0.0
    name: str = ""


@dataclass(frozen=True, slots=True)
class Seen:
    """What telemetry says at an instant. Heights are above the vehicle's home."""

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


@dataclass(frozen=True, slots=True)
class Verdict:
    """What must happen now, and why, in words for the operator."""

    rung: Literal["report", "rtl", "land", "crashed"]
    reason: str
    hurry: bool = False
    """It is carried away: descend as fast as it flies to `QUICK_M`, and land only from there.

    A landing takes twenty seconds for the last ten metres, in which a storm carries it 200 m.
    """


@dataclass(frozen=True, slots=True)
class Guard:
    """What the guardian remembers of one vehicle."""

    task: Task = Task("ground", 0.0)
    action: Action | None = None
    """What it has the autopilot do by itself; None while the mission flies the vehicle."""
    acted_s: float = 0.0
    reported: bool = False
    reported_s: float = 0.0
    was_up: bool = False
    at_height: bool = False
    down: bool = False
    height_m: float = 0.0
    fell: bool = False
    """It came down faster than anybody flies it."""
    along_m: float = 0.0
    """How far along its path it has come."""
    best_m: float = float("inf")
    best_s: float = 0.0
    receding_since_s: float | None = None
    swept_since_s: float | None = None
    last_gap_m: float | None = None
    last_s: float | None = None
    off_since_s: float | None = None
    outside_since_s: float | None = None
    outside_m: float = 0.0
    low_since_s: float | None = None
    sunk_since_s: float | None = None
    spent_since_s: float | None = None

    def told(self, task: Task) -> Guard:
        """This guard after a new order; a vehicle that it has taken over it keeps."""
        if self.action is not None:
            return self
        again = task.doing == "climb"  # from the ground: what was before is over
        return replace(
            self,
            task=task,
            was_up=self.was_up and not again,
            at_height=self.at_height and not again,
            down=self.down and not again,
            reported=False,
            along_m=0.0,
            best_m=float("inf"),
            best_s=task.since_s,
            last_gap_m=None,
            off_since_s=None,
            sunk_since_s=None,
        )

    def acting(self, action: Action, t_s: float) -> Guard:
        """This guard after it had the autopilot return or land by itself."""
        return replace(
            self, action=action, acted_s=t_s, along_m=0.0, best_m=float("inf"), best_s=t_s,
            receding_since_s=None, last_gap_m=None, off_since_s=None,
        )  # fmt: skip

    def released(self) -> Guard:
        """This guard after a pilot took the vehicle, or after it stands on the ground."""
        return Guard()


def watch(limits: Limits, guard: Guard, seen: Seen) -> tuple[Guard, Verdict | None]:
    """What the guard remembers after a look at the vehicle, and what must happen.

    Call it about once a second. A verdict of `rtl` or `land` is in force at once: the guard that
    is returned has it as its action.
    """
    guard = _falling(guard, seen)
    if seen.mode == "other" and seen.armed and not (guard.fell and _low(seen)):
        free = guard.released()
        return replace(free, height_m=guard.height_m, fell=guard.fell, last_s=seen.t_s), None
    guard = replace(
        guard,
        was_up=guard.was_up or (seen.airborne and seen.height_m > UP_M),
        at_height=guard.at_height or _near_height(guard.task, seen),
    )
    guard, verdict = _crashed(limits, guard, seen)
    if verdict is not None or guard.down or not seen.airborne:
        return replace(guard, last_s=seen.t_s), verdict
    guard = _measured(limits, guard, seen)
    guard = replace(
        guard, spent_since_s=_since(guard.spent_since_s, _is_spent(limits, seen), seen.t_s)
    )
    verdict = _last_reserve(limits, guard, seen) or _trouble(limits, guard, seen)
    guard = replace(guard, last_s=seen.t_s)
    if verdict is None:
        return guard, None
    if verdict.rung == "report":
        return replace(guard, reported=True, reported_s=seen.t_s), verdict
    if verdict.rung in ("rtl", "land"):
        action: Action = "rtl" if verdict.rung == "rtl" else "land"
        guard = guard.acting(action, seen.t_s)
    return guard, verdict


# --- what is measured -------------------------------------------------------------------------
def _near_height(task: Task, seen: Seen) -> bool:
    return task.doing in ("leg", "hold") and seen.height_m >= task.height_m - HEIGHT_LOST_M / 2


def _goal(guard: Guard, seen: Seen) -> tuple[GridPoint, ...]:
    """The way that the vehicle should be on, its goal the last point."""
    if guard.action == "rtl":
        return (seen.position, seen.home)
    return guard.task.path


def _measured(limits: Limits, guard: Guard, seen: Seen) -> Guard:
    """The guard with distances to the goal, the path and the fence taken in."""
    path = _goal(guard, seen)
    task = guard.task
    if guard.action == "land" or not path or task.doing in ("land", "ground"):
        path = path if guard.action == "rtl" else ()
    outside_m = float(limits.fence.outer.distance(Point(seen.position)))
    guard = replace(
        guard,
        outside_m=outside_m,
        outside_since_s=_since(guard.outside_since_s, outside_m > 0.0, seen.t_s),
    )
    if not path:
        return replace(guard, last_gap_m=None, receding_since_s=None, off_since_s=None)
    along_m = 0.0 if guard.action == "rtl" else _along_m(guard, seen, path)
    gap_m = _left_m(seen.position, path, along_m)
    receding = guard.receding_since_s is not None  # a new order does not bring it to rest
    swept = guard.swept_since_s is not None
    if guard.last_gap_m is not None and guard.last_s is not None and seen.t_s > guard.last_s:
        away_m_s = (gap_m - guard.last_gap_m) / (seen.t_s - guard.last_s)
        receding = away_m_s > RECEDING_M_S
        swept = away_m_s > max(SWEPT_M_S, SWEPT_SHARE * limits.energy.speed_m_s)
    progressed = gap_m <= guard.best_m - PROGRESS_M or guard.best_m == float("inf")
    allowed_m = OFF_PATH_M + task.drift_m_s * (seen.t_s - task.since_s)
    off = guard.action is None and _off_path_m(seen.position, path) > allowed_m
    sunk = seen.height_m < task.height_m - max(HEIGHT_LOST_M, HEIGHT_LOST_SHARE * task.height_m)
    return replace(
        guard,
        along_m=along_m,
        best_m=gap_m if progressed else guard.best_m,
        best_s=seen.t_s if progressed else guard.best_s,
        last_gap_m=gap_m,
        receding_since_s=_since(guard.receding_since_s, receding, seen.t_s),
        swept_since_s=_since(guard.swept_since_s, swept, seen.t_s),
        off_since_s=_since(guard.off_since_s, off, seen.t_s),
        sunk_since_s=_since(
            guard.sunk_since_s, guard.action is None and guard.at_height and sunk, seen.t_s
        ),
    )


def _since(since_s: float | None, holds: bool, t_s: float) -> float | None:
    """Since when something holds, None while it does not."""
    if not holds:
        return None
    return t_s if since_s is None else since_s


def _lasted(limits: Limits, since_s: float | None, t_s: float, limit_s: float) -> bool:
    return since_s is not None and t_s - since_s >= limit_s + limits.slack_s


def _along_m(guard: Guard, seen: Seen, path: Sequence[GridPoint]) -> float:
    """How far along its path a vehicle is, near where it was last: a path may cross itself."""
    if len(set(path)) < 2:
        return 0.0
    line = LineString(path)
    elapsed_s = seen.t_s - (guard.last_s if guard.last_s is not None else guard.task.since_s)
    begin_m = max(guard.along_m - REACH_M, 0.0)
    end_m = min(guard.along_m + REACH_M + REACH_M_S * max(elapsed_s, 0.0), float(line.length))
    here = Point(seen.position)
    near = begin_m + float(substring(line, begin_m, end_m).project(here))
    within_m = float(line.interpolate(near).distance(here)) + REACH_M / 2
    # where it turns back nearly the way it came, the farther of two places is the likelier
    ahead = near
    step_m = REACH_M / 5
    while ahead + step_m <= end_m:
        ahead += step_m
        if float(line.interpolate(ahead).distance(here)) <= within_m:
            near = ahead
    return near


def _left_m(position: GridPoint, path: Sequence[GridPoint], along_m: float) -> float:
    """How far it is to the end of a path: back to it, and then along what is left of it."""
    if len(set(path)) < 2:
        return position.distance_to(path[-1])
    line = LineString(path)
    return float(line.length) - along_m + float(line.interpolate(along_m).distance(Point(position)))


def _off_path_m(position: GridPoint, path: Sequence[GridPoint]) -> float:
    line = LineString(path) if len(set(path)) > 1 else Point(path[0])
    return float(line.distance(Point(position)))


# --- what follows -----------------------------------------------------------------------------
def _falling(guard: Guard, seen: Seen) -> Guard:
    """The guard with the height, and with whether the vehicle falls."""
    fell = guard.fell
    if guard.last_s is not None and seen.t_s > guard.last_s:
        sink_m_s = (guard.height_m - seen.height_m) / (seen.t_s - guard.last_s)
        limit_m_s = FALL_M_S / 2 if guard.task.doing == "climb" else FALL_M_S
        # on the ground a height only jumps: arming sets it to zero anew
        in_air = guard.was_up or seen.airborne
        fell = in_air and (sink_m_s > limit_m_s or (fell and sink_m_s > -UP_M))
    return replace(guard, height_m=seen.height_m, fell=fell)


def _low(seen: Seen) -> bool:
    """Whether it has no height, and does not move."""
    return seen.height_m < DOWN_M and seen.ground_speed_m_s < DOWN_M_S


def _crashed(limits: Limits, guard: Guard, seen: Seen) -> tuple[Guard, Verdict | None]:
    """Down without having been told to land: it fell, motors off away from home, or no height."""
    if guard.down:
        return guard, None
    if guard.fell and _low(seen):
        return replace(guard, down=True), Verdict("crashed", f"it fell, {_off_home(seen)}")
    at_home = seen.position.distance_to(seen.home) <= PAD_M
    landing = guard.action == "land" or guard.task.doing == "land" or seen.mode == "land"
    if not seen.armed:
        if not guard.was_up or landing or at_home:
            return (guard.released() if guard.was_up else guard), None
        reason = f"its motors are off, {_off_home(seen)}"
        return replace(guard, down=True), Verdict("crashed", reason)
    returning = guard.action == "rtl" or seen.mode == "rtl"
    # a landing, or a climb that does not begin, may take its time at the ground
    expected = landing or (returning and at_home) or not guard.was_up
    expected = expected or guard.task.doing in ("ground", "climb")
    low = _low(seen) and (guard.was_up or seen.airborne)
    guard = replace(guard, low_since_s=_since(guard.low_since_s, low, seen.t_s))
    if _lasted(limits, guard.low_since_s, seen.t_s, STANDS_S if expected else DOWN_S):
        return replace(guard, down=True), Verdict("crashed", f"it has no height, {_off_home(seen)}")
    return guard, None


def _off_home(seen: Seen) -> str:
    return f"{seen.position.distance_to(seen.home):.0f} m from home"


def landing_wh(energy: EnergyModel, height_m: float) -> float:
    """Energy to land from a height, here and now, the reserve not counted."""
    return energy.hover_wh(max(height_m, 0.0) / LANDING_SPEED_M_S + 8.0)


def _is_spent(limits: Limits, seen: Seen) -> bool:
    if seen.remaining_wh is None:
        return False
    return seen.remaining_wh <= LAST_MARGIN * landing_wh(limits.energy, seen.height_m)


def _last_reserve(limits: Limits, guard: Guard, seen: Seen) -> Verdict | None:
    """Land while the energy for it is there."""
    spent = _lasted(limits, guard.spent_since_s, seen.t_s, SPENT_S)
    landing = guard.action == "land" or seen.mode == "land"
    if seen.remaining_wh is None or landing or not spent:
        return None
    need_wh = LAST_MARGIN * landing_wh(limits.energy, seen.height_m)
    return Verdict(
        "land",
        f"{seen.remaining_wh:.1f} Wh are left, and landing from here takes {need_wh:.1f}",
    )


def _trouble(limits: Limits, guard: Guard, seen: Seen) -> Verdict | None:
    """The next rung of the ladder, if something is wrong for too long."""
    if guard.action == "land":
        return None
    if guard.task.doing == "land" and guard.action is None:
        hovers = (
            seen.mode == "follow" and seen.t_s - guard.task.since_s > NO_PROGRESS_S + limits.slack_s
        )
        return Verdict("land", "it was told to land, and hovers") if hovers else None
    reason = _wrong(limits, guard, seen)
    if guard.action == "rtl" and seen.mode == "follow":
        # it did not take the command, or was told something else
        due = seen.t_s - guard.acted_s >= NO_PROGRESS_S + limits.slack_s
        return Verdict("land", "it does not return by its autopilot") if due else None
    if _lasted(limits, guard.swept_since_s, seen.t_s, SWEPT_S):
        # nothing that it flies helps, and a climb would cost the time to land near
        return Verdict("land", "it is carried off faster than it flies", hurry=True)
    blown = _blown_away(limits, guard, seen)
    if blown is not None:
        return Verdict("land", blown, hurry=True)
    if reason is None:
        return None
    if guard.action == "rtl":
        # the climb to its return height comes first, and is no fault
        settled = seen.t_s - guard.acted_s >= RECOVERY_S + limits.slack_s
        return Verdict("land", f"{reason}, returning by its autopilot") if settled else None
    if guard.outside_m > 0.0 and _lasted(limits, guard.receding_since_s, seen.t_s, RECEDING_S):
        # what leads it astray would lead its autopilot astray, too, and a climb costs the time
        return Verdict("land", f"{reason}, outside of the geofence", hurry=True)
    if guard.task.homeward:
        return Verdict("rtl", f"{reason}, on its way home")
    if not guard.reported:
        return Verdict("report", reason)
    if seen.t_s - guard.reported_s >= RECOVERY_S + limits.slack_s:
        return Verdict("rtl", f"{reason}, and the mission did not bring it home")
    return None


def _blown_away(limits: Limits, guard: Guard, seen: Seen) -> str | None:
    """Wind that the airframe cannot hold: returning by itself would only carry it farther."""
    limit_m_s = limits.energy.max_airspeed_m_s
    if seen.wind_m_s is None or seen.wind_m_s < limit_m_s:
        return None
    hopeless = seen.wind_m_s >= HOPELESS * limit_m_s
    if not hopeless and not _lasted(limits, guard.receding_since_s, seen.t_s, BLOWN_S):
        return None
    return f"the wind of {seen.wind_m_s:.0f} m/s carries it away"


def _wrong(limits: Limits, guard: Guard, seen: Seen) -> str | None:
    """What is wrong, in words; None while all is well."""
    t_s, task = seen.t_s, guard.task
    if _lasted(limits, guard.outside_since_s, t_s, OUTSIDE_S) and not _coming_back(
        limits, guard, seen
    ):
        return f"it is {guard.outside_m:.0f} m outside of the geofence"
    if _lasted(limits, guard.receding_since_s, t_s, RECEDING_S):
        return "it is carried away from where it should go"
    if _lasted(limits, guard.off_since_s, t_s, OFF_PATH_HOME_S if task.homeward else OFF_PATH_S):
        off_m = _off_path_m(seen.position, task.path)
        return f"it is {off_m:.0f} m off its way"
    if _lasted(limits, guard.sunk_since_s, t_s, HEIGHT_LOST_S):
        return f"it has lost height ({seen.height_m:.0f} m instead of {task.height_m:.0f})"
    return _too_long(limits, guard, seen)


def _coming_back(limits: Limits, guard: Guard, seen: Seen) -> bool:
    """Whether a vehicle outside of the fence is on its way back, with progress."""
    homeward = guard.action == "rtl" or guard.task.homeward
    recent = seen.t_s - guard.best_s < RECOVERY_S + limits.slack_s
    return homeward and recent and guard.receding_since_s is None


def _too_long(limits: Limits, guard: Guard, seen: Seen) -> str | None:
    """No progress, or a leg that takes a multiple of its estimate."""
    task, t_s = guard.task, seen.t_s
    if guard.action == "rtl":
        climb_s = max(30.0 - seen.height_m, 0.0) / CLIMB_SPEED_M_S
        way_m = route_length_m(seen.position, (seen.home,))
        if way_m > PAD_M and t_s - guard.best_s > NO_PROGRESS_S + climb_s + limits.slack_s:
            return f"it has come no nearer to home for {t_s - guard.best_s:.0f} s"
        return None
    if task.doing != "leg":
        return None
    # near the end it settles, which brings it no nearer
    if guard.best_m > PROGRESS_M * 3 and t_s - guard.best_s > NO_PROGRESS_S + limits.slack_s:
        return f"it has made no progress for {t_s - guard.best_s:.0f} s"
    limit_s = LEG_FACTOR * task.estimate_s + LEG_SLACK_S + 2.0 * limits.slack_s
    if t_s - task.since_s > limit_s:
        return f"a leg of some {task.estimate_s:.0f} s has taken {t_s - task.since_s:.0f} s"
    return None
