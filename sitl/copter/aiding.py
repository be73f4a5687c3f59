"""What an autopilot lets count for its position: satellites, a second receiver, a companion.

The measurements are in the world's plane (east, north). Which of them are taken, when, and with
what answer is an autopilot's: `sitl.ardupilot.aiding`, `sitl.px4.aiding`.
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
    """To a position that is told in a command."""

    TAKEN = "taken"
    REFUSED = "refused"  # not now
    NOWHERE = "nowhere"  # no place, or no numbers


class Aiding(ABC):
    """The sources of one autopilot's position."""

    most_delay_s: ClassVar[float]
    """How old a position told in a command may be at most; older ones are taken for that old."""

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
        """The filter says that it knows where on earth it is."""

    @abstractmethod
    def step(self, t_s: float) -> None:
        """It is `t_s`: decide what counts from here on."""

    @abstractmethod
    def vision(self, east_m: float, north_m: float, sigma_m: float, resets: int) -> None:
        """A companion tells where the vehicle is.

        `sigma_m` is 0 where it does not say how well, `resets` its count of leaps.
        """

    @abstractmethod
    def receiver(self, east_m: float, north_m: float, sigma_m: float, fix_type: int) -> None:
        """A second receiver tells where the vehicle is, by GPS_INPUT."""

    @abstractmethod
    def told(
        self, east_m: float, north_m: float, sigma_m: float | None, delay_s: float, *, flying: bool
    ) -> Answer:
        """EXTERNAL_POSITION_ESTIMATE, `delay_s` old."""

    def choose_sources(self, number: int) -> bool:
        """SET_EKF_SOURCE_SET, from 1; False where there is no such set."""
        return False

    # --- for subclasses --------------------------------------------------------------------------

    def _errs_by(self, east_m: float, north_m: float, delay_s: float = 0.0) -> tuple[float, float]:
        """The error of a position measured `delay_s` ago, moved on as the filter moves it."""
        body, error = self._body, self._error
        return (
            east_m + delay_s * (body.v_east + error.v_east) - body.east,
            north_m + delay_s * (body.v_north + error.v_north) - body.north,
        )

    def _is_somewhere(self, east_m: float, north_m: float) -> bool:
        return math.hypot(east_m - self._body.east, north_m - self._body.north) <= FURTHEST_M

    def _leapt(self, resets: int) -> bool:
        """The companion has made a leap of its own since its last position."""
        before, self._resets = self._resets, resets
        return before is not None and before != resets
