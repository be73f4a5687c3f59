"""What a route needs of the autopilot."""

from __future__ import annotations

from typing import Protocol

from sitl.copter.control import Estimate
from sitl.copter.modes import Phase
from sitl.copter.tuning import Tuning

Place = tuple[float, float, float]


class Pilot(Protocol):
    """What a route needs of the autopilot."""

    t_s: float
    phase: Phase
    estimate: Estimate
    hold: Place
    tuning: Tuning

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
    def say(self, severity: int, text: str) -> None: ...  # noqa: D102
    def mission_done(self) -> None: ...  # noqa: D102
