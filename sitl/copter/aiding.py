"""The sources of an autopilot for its position: satellites, a second receiver, a companion.

Measurements are in the world's plane (east, north). Each autopilot decides which of them it uses
and what it answers: `sitl.ardupilot.aiding`, `sitl.px4.aiding`.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from enum import Enum
from typing import ClassVar

from sitl.body.estimator import Estimator
from sitl.body.physics import Body
from sitl.copter.params import Parameters

FURTHEST_M = 1e6  # from here: what is further is nowhere


class Answer(Enum):
    """To a position in a command."""

    TAKEN = "taken"
    REFUSED = "refused"  # not now
    NOWHERE = "nowhere"  # no place, or no numbers


class Aiding(ABC):
    """The sources of one autopilot's position."""

    most_delay_s: ClassVar[float]
    """Largest age of a position in a command, s; an older one is taken for that old."""

    def __init__(self, body: Body, error: Estimator, parameters: Parameters) -> None:
        self._body = body
        self._error = error
        self._get = parameters
        self._t_s = 0.0
        self._vision_s = -math.inf
        self._resets: int | None = None

    @property
    @abstractmethod
    def absolute(self) -> bool:
        """True if the filter reports an absolute position."""

    @abstractmethod
    def step(self, t_s: float) -> None:
        """Decide what is fused from `t_s` on."""

    @abstractmethod
    def vision(self, east_m: float, north_m: float, sigma_m: float, resets: int) -> None:
        """Receive a companion's position, of unknown accuracy where `sigma_m` is 0.

        `resets` counts the leaps of its estimate.
        """

    @abstractmethod
    def receiver(self, east_m: float, north_m: float, sigma_m: float, fix_type: int) -> None:
        """Receive a second receiver's position, by GPS_INPUT."""

    @abstractmethod
    def external_position(
        self, east_m: float, north_m: float, sigma_m: float | None, delay_s: float, *, flying: bool
    ) -> Answer:
        """Receive EXTERNAL_POSITION_ESTIMATE, `delay_s` old."""

    def choose_sources(self, number: int) -> bool:
        """Choose a set of sources, from 1 (SET_EKF_SOURCE_SET); False where there is none."""
        return False

    # --- for subclasses --------------------------------------------------------------------------

    def _errs_by(self, east_m: float, north_m: float, delay_s: float = 0.0) -> tuple[float, float]:
        """Return the error of a position measured `delay_s` ago, moved as the filter moves it."""
        body, error = self._body, self._error
        return (
            east_m + delay_s * (body.v_east + error.v_east) - body.east,
            north_m + delay_s * (body.v_north + error.v_north) - body.north,
        )

    def _is_somewhere(self, east_m: float, north_m: float) -> bool:
        return math.hypot(east_m - self._body.east, north_m - self._body.north) <= FURTHEST_M

    def _leapt(self, resets: int) -> bool:
        before, self._resets = self._resets, resets
        return before is not None and before != resets
