"""What a vehicle flies while plans replace one another: one course without a gap."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from missions.geo.trajectory import Motion, Trajectory

KEPT_S: Final = 2.0
"""Of the past: telemetry is older than now, and the stream is smoothed over some of it."""


@dataclass(frozen=True, slots=True)
class Course:
    """Trajectories, each of which is flown from its own beginning on, until the next begins.

    >>> from missions.geo.trajectory import rounded_path
    >>> from missions.units import GridPoint
    >>> first = rounded_path([GridPoint(0, 0), GridPoint(60, 0)], 0.0, speed_m_s=6.0)
    >>> here = first.at(5.0)
    >>> turned = [here.place, GridPoint(40, 0), GridPoint(40, 30)]
    >>> second = rounded_path(turned, 5.0, speed_m_s=6.0, begin_speed_m_s=here.v_east_m_s)
    >>> course = Course((first,)).then(second, now_s=4.0)
    >>> course.at(4.5) == first.at(4.5), course.at(5.5) == second.at(5.5)
    (True, True)
    """

    parts: tuple[Trajectory, ...]
    """At least one, in the order of their beginnings."""

    @property
    def end_s(self) -> float:
        """When it is at rest, mission seconds."""
        return self.parts[-1].end_s

    def at(self, t_s: float) -> Motion:
        """The motion at mission time `t_s`, fixed frame."""
        for part in reversed(self.parts):
            if part.begin_s <= t_s:
                return part.at(t_s)
        return self.parts[0].at(t_s)

    def then(self, plan: Trajectory, now_s: float) -> Course:
        """This course with a new plan from its beginning on.

        What was to begin later is dropped, and what ended `KEPT_S` ago.
        """
        parts = [part for part in self.parts if part.begin_s < plan.begin_s]
        while len(parts) > 1 and parts[1].begin_s <= now_s - KEPT_S:
            del parts[0]
        if plan.begin_s <= now_s - KEPT_S:
            parts.clear()
        return Course((*parts, plan))
