"""The rules of the guardian: the rung of the ladder that follows from the measurements."""

from __future__ import annotations

from dataclasses import replace

from missions.geo.fence import route_length_m
from missions.guardian.guardian_state import Guard, Limits, Snapshot, Verdict
from missions.guardian.measures import (
    falling,
    is_behind,
    lasted,
    measured,
    near_height,
    off_path_m,
    planned,
    since,
)
from missions.guardian.thresholds import (
    BLOWN_AWAY_S,
    CARRIED_AWAY_M_S,
    CARRIED_AWAY_S,
    DOWN_M,
    DOWN_M_S,
    DOWN_S,
    HARD_LANDING_M_S,
    HEIGHT_LOST_S,
    LAND_AT_ONCE_WIND_FACTOR,
    LANDING_DESCENT_M,
    LANDING_ENERGY_FACTOR,
    LEG_FACTOR,
    LEG_SLACK_S,
    LOW_CHARGE_S,
    MOTORS_OFF_WAIT_S,
    NO_PROGRESS_S,
    OBEYS_S,
    OFF_PATH_HOME_S,
    OFF_PATH_S,
    OFF_PLAN_S,
    OUTSIDE_S,
    PAD_M,
    PROGRESS_M,
    QUICK_AIM_M,
    QUICK_M,
    QUICK_VERDICT_S,
    RECEDING_S,
    RECOVERY_S,
    UP_M,
)
from missions.mission.energy import EnergyModel


def crashed(limits: Limits, guard: Guard, seen: Snapshot) -> tuple[Guard, Verdict | None]:
    """Return a verdict on a vehicle that is down without a landing.

    It fell, struck the ground, stopped its motors away from home, or has no height.
    """
    if guard.down:
        return guard, None
    if guard.fell and low(seen):
        return replace(guard, down=True), Verdict("crashed", f"it fell, {_off_home(seen)}")
    if seen.struck_m_s > HARD_LANDING_M_S:
        reason = f"it struck the ground at {seen.struck_m_s:.1f} m/s, {_off_home(seen)}"
        return replace(guard, down=True), Verdict("crashed", reason)
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
    lies = low(seen) and (guard.was_up or seen.airborne)
    guard = replace(guard, low_since_s=since(guard.low_since_s, lies, seen.t_s))
    if lasted(limits, guard.low_since_s, seen.t_s, MOTORS_OFF_WAIT_S if expected else DOWN_S):
        return replace(guard, down=True), Verdict("crashed", f"it has no height, {_off_home(seen)}")
    moves = seen.amsl_m < guard.lowest_m - LANDING_DESCENT_M or seen.ground_speed_m_s > DOWN_M_S
    if seen.mode != "land" or moves:
        return replace(guard, lowest_m=seen.amsl_m, lowest_s=seen.t_s), None
    if guard.was_up and lasted(limits, guard.lowest_s, seen.t_s, MOTORS_OFF_WAIT_S):
        # the ground there can be higher than at its home
        return replace(guard, down=True), Verdict("crashed", f"it sinks no more, {_off_home(seen)}")
    return guard, None


def _off_home(seen: Snapshot) -> str:
    return f"{seen.position.distance_to(seen.home):.0f} m from home"


def low(seen: Snapshot) -> bool:
    """Return whether it has no height, and does not move."""
    return seen.height_m < DOWN_M and seen.ground_speed_m_s < DOWN_M_S


def watch(limits: Limits, guard: Guard, seen: Snapshot) -> tuple[Guard, Verdict | None]:
    """Return the guard after a new report of the vehicle, and its verdict; call it at 1 to 2 Hz.

    A verdict of `rtl` or `land` is in force at once, as the guard's action.
    """
    guard = falling(guard, seen)
    is_down = (guard.fell and low(seen)) or seen.struck_m_s > HARD_LANDING_M_S
    if seen.mode == "other" and seen.armed and not is_down:
        free = guard.released()
        return replace(free, amsl_m=guard.amsl_m, fell=guard.fell, last_s=seen.t_s), None
    guard = replace(
        guard,
        was_up=guard.was_up or (seen.airborne and seen.height_m > UP_M),
        at_height=guard.at_height or near_height(guard.task, seen),
    )
    guard, verdict = crashed(limits, guard, seen)
    if verdict is not None or guard.down or not seen.airborne:
        return replace(guard, last_s=seen.t_s, last_position=seen.position), verdict
    guard = measured(limits, guard, seen)
    spent_since_s = since(guard.spent_since_s, _is_spent(limits, seen), seen.t_s)
    guard = replace(guard, spent_since_s=spent_since_s)
    verdict = _last_reserve(limits, guard, seen) or _trouble(limits, guard, seen)
    guard = replace(guard, last_s=seen.t_s, last_position=seen.position)
    if verdict is None:
        return guard, None
    if verdict.rung == "report":
        return replace(guard, reported=True, reported_s=seen.t_s), verdict
    if verdict.rung != "crashed":
        guard = guard.with_action(verdict.rung, seen.t_s, hurry=verdict.hurry)
    return guard, verdict


def quick_aim_m(height_m: float) -> float | None:
    """Return the target height for a quick descent of a vehicle that is carried away; None to land.

    >>> quick_aim_m(9.0), quick_aim_m(0.5), quick_aim_m(-3.0)
    (-1.0, None, -7.0)
    """
    if height_m > QUICK_M:
        return QUICK_M - QUICK_AIM_M
    return height_m - 2.0 * QUICK_AIM_M if height_m < -QUICK_M else None


def landing_wh(energy: EnergyModel, height_m: float) -> float:
    """Return the energy of a landing from a height, here and now, without the reserve, Wh."""
    return energy.hover_wh(energy.descent_s(max(height_m, 0.0)) + 8.0)


def _is_spent(limits: Limits, seen: Snapshot) -> bool:
    if seen.remaining_wh is None:
        return False
    return seen.remaining_wh <= LANDING_ENERGY_FACTOR * landing_wh(limits.energy, seen.height_m)


def _last_reserve(limits: Limits, guard: Guard, seen: Snapshot) -> Verdict | None:
    spent = lasted(limits, guard.spent_since_s, seen.t_s, LOW_CHARGE_S)
    landing = guard.action == "land" or seen.mode == "land"
    if seen.remaining_wh is None or landing or not spent:
        return None
    need_wh = LANDING_ENERGY_FACTOR * landing_wh(limits.energy, seen.height_m)
    return Verdict(
        "land", f"{seen.remaining_wh:.1f} Wh are left, and landing from here takes {need_wh:.1f}"
    )


def _trouble(limits: Limits, guard: Guard, seen: Snapshot) -> Verdict | None:
    """Return the next rung of the ladder, if something has been wrong for too long."""
    if _carried_off_landing(limits, guard, seen):
        return Verdict("land", "it is carried off while it lands", hurry=True)
    if guard.action == "land":
        return None
    if guard.task.doing == "land" and guard.action is None:
        hovers = seen.mode == "follow" and seen.t_s - guard.task.since_s > OBEYS_S + limits.slack_s
        return Verdict("land", "it hovers, and was commanded to land") if hovers else None
    reason = _wrong(limits, guard, seen)
    if guard.action == "rtl" and seen.mode == "follow" and not seen.by_map:
        # it did not take the command, or received another one
        due = seen.t_s - guard.acted_s >= OBEYS_S + limits.slack_s
        return Verdict("land", "it does not return by its autopilot") if due else None
    swept_s = QUICK_VERDICT_S if guard.leaves_fence else CARRIED_AWAY_S
    if lasted(limits, guard.swept_since_s, seen.t_s, swept_s):
        # no control helps, and a climb would cost time for a landing nearby
        return Verdict("land", "it is carried off faster than it flies", hurry=True)
    climbs = guard.task.doing == "climb" and seen.ground_speed_m_s > CARRIED_AWAY_M_S
    if climbs and lasted(limits, guard.receding_since_s, seen.t_s, QUICK_VERDICT_S):
        return Verdict("land", "it is carried off while it climbs", hurry=True)
    blown = _blown_away(limits, guard, seen)
    if blown is not None:
        return Verdict("land", blown, hurry=True)
    if reason is None:
        return None
    if guard.action == "rtl":
        # the climb to its return height comes first, and is no fault
        settled = seen.t_s - guard.acted_s >= RECOVERY_S + limits.slack_s
        return Verdict("land", f"{reason}, returning by its autopilot") if settled else None
    if guard.outside_m > 0.0 and lasted(limits, guard.receding_since_s, seen.t_s, RECEDING_S):
        # the same cause would mislead its autopilot, and a climb costs time
        return Verdict("land", f"{reason}, outside the geofence", hurry=True)
    if guard.task.homeward:
        return Verdict("rtl", f"{reason}, on its return")
    if not guard.reported:
        return Verdict("report", reason, behind=is_behind(guard, seen))
    if seen.t_s - guard.reported_s >= RECOVERY_S + limits.slack_s:
        return Verdict("rtl", f"{reason}, and the mission did not bring it home")
    return None


def _carried_off_landing(limits: Limits, guard: Guard, seen: Snapshot) -> bool:
    """Return whether it is carried away during a landing at normal descent rate."""
    if guard.hurries or not guard.landing or seen.height_m <= 2.0 * QUICK_M:
        return False
    return lasted(limits, guard.swept_since_s, seen.t_s, BLOWN_AWAY_S)


def _blown_away(limits: Limits, guard: Guard, seen: Snapshot) -> str | None:
    """Return a reason if the airframe cannot hold the wind: a return would carry it farther."""
    limit_m_s = limits.energy.max_airspeed_m_s
    if seen.wind_m_s is None or seen.wind_m_s < limit_m_s:
        return None
    hopeless = seen.wind_m_s >= LAND_AT_ONCE_WIND_FACTOR * limit_m_s
    if not hopeless and not lasted(limits, guard.receding_since_s, seen.t_s, BLOWN_AWAY_S):
        return None
    return f"the wind of {seen.wind_m_s:.0f} m/s carries it away"


def _wrong(limits: Limits, guard: Guard, seen: Snapshot) -> str | None:
    t_s, task = seen.t_s, guard.task
    if lasted(limits, guard.outside_since_s, t_s, OUTSIDE_S) and not _coming_back(
        limits, guard, seen
    ):
        return f"it is {guard.outside_m:.0f} m outside the geofence"
    if lasted(limits, guard.receding_since_s, t_s, RECEDING_S):
        return "it is carried away from where it should go"
    place = planned(task, seen)
    patience_s = OFF_PATH_HOME_S if task.homeward else OFF_PATH_S
    if lasted(limits, guard.off_since_s, t_s, patience_s if place is None else OFF_PLAN_S):
        if place is not None:
            return f"it is {seen.position.distance_to(place):.0f} m off its path by now"
        off_m = off_path_m(seen.position, task.path)
        return f"it is {off_m:.0f} m off its way"
    if lasted(limits, guard.sunk_since_s, t_s, HEIGHT_LOST_S):
        return f"it has lost height ({seen.height_m:.0f} m instead of {task.height_m:.0f})"
    return _too_long(limits, guard, seen)


def _coming_back(limits: Limits, guard: Guard, seen: Snapshot) -> bool:
    """Return whether a vehicle outside the fence is on its way back, with progress."""
    homeward = guard.action == "rtl" or guard.task.homeward
    recent = seen.t_s - guard.best_s < RECOVERY_S + limits.slack_s
    return homeward and recent and guard.receding_since_s is None


def _too_long(limits: Limits, guard: Guard, seen: Snapshot) -> str | None:
    task, t_s = guard.task, seen.t_s
    if guard.action == "rtl":
        returns_m = max(30.0, task.height_m) + limits.relief_m
        climb_s = max(returns_m - seen.height_m, 0.0) / limits.energy.climb_m_s
        way_m = route_length_m(seen.position, (seen.home,))
        if way_m > PAD_M and t_s - guard.best_s > NO_PROGRESS_S + climb_s + limits.slack_s:
            return f"it has come no nearer to home for {t_s - guard.best_s:.0f} s"
        return None
    if task.course is not None:
        late_s = t_s - task.course.end_s
        if late_s > LEG_SLACK_S + limits.slack_s:
            return f"its path ended {late_s:.0f} s ago, and it has not come to rest there"
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
