"""Whether a vehicle is down without having been told to land."""

from __future__ import annotations

from dataclasses import replace

from missions.guardian.guardian_state import Guard, Limits, Seen, Verdict
from missions.guardian.measures import lasted, since
from missions.guardian.thresholds import DOWN_M, DOWN_M_S, DOWN_S, HARD_M_S, PAD_M, STANDS_S


def crashed(limits: Limits, guard: Guard, seen: Seen) -> tuple[Guard, Verdict | None]:
    """Down without having landed: it fell, struck, motors off away from home, or no height."""
    if guard.down:
        return guard, None
    if guard.fell and low(seen):
        return replace(guard, down=True), Verdict("crashed", f"it fell, {_off_home(seen)}")
    if seen.struck_m_s > HARD_M_S:
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
    low_since_s = since(guard.low_since_s, lies, seen.t_s)
    if low_since_s != guard.low_since_s:
        guard = replace(guard, low_since_s=low_since_s)
    if lasted(limits, guard.low_since_s, seen.t_s, STANDS_S if expected else DOWN_S):
        return replace(guard, down=True), Verdict("crashed", f"it has no height, {_off_home(seen)}")
    return guard, None


def _off_home(seen: Seen) -> str:
    return f"{seen.position.distance_to(seen.home):.0f} m from home"


def low(seen: Seen) -> bool:
    """Whether it has no height, and does not move."""
    return seen.height_m < DOWN_M and seen.ground_speed_m_s < DOWN_M_S
