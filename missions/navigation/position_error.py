"""What told positions err by, and what is found out about that."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

UNEASE_M: Final = 0.3
"""By how much a step errs that nobody vouches for, beyond what dead reckoning does."""


@dataclass(frozen=True, slots=True)
class ToldErrors:
    """What told positions err by; standard deviations in one direction.

    Attributes:
        satellites_m: Of a position by satellites, above 0.
        satellites_s: Over which time such an error stays alike, above 0.
        reckoned_share: What dead reckoning errs by, as a share of the way.
        reckoned_over_m: Over which way that share stays alike.
        reckoned_m_sqrt_s: What it wanders by in a second, at rest too; it grows with the root.
        common: Of the scale that pictures have (heights), as a share, and of their rotation in
            radians (headings); above 0.
        common_s: Over which time both stay alike, above 0.
        pointing_m: How far the place below the camera is off in each picture, by its attitude.
    """

    satellites_m: float = 0.7
    satellites_s: float = 60.0
    reckoned_share: float = 0.03
    reckoned_over_m: float = 50.0
    reckoned_m_sqrt_s: float = 0.1
    common: float = 0.04
    common_s: float = 80.0
    pointing_m: float = 0.05

    def __post_init__(self) -> None:
        """Refuse what is no standard deviation with `ValueError`."""
        for name in ("satellites_m", "satellites_s", "reckoned_m_sqrt_s", "common", "common_s"):
            if not getattr(self, name) > 0.0:
                raise ValueError(f"{name} is {getattr(self, name):g}, expected above 0")


@dataclass(frozen=True, slots=True)
class Estimate:
    """What is known of the newest keyframe.

    Attributes:
        error_m: Told minus true position, east and north.
        sigma_m: Its standard deviation in one direction.
        scale: By how much its picture shows ways too long, as a share.
        rotation_rad: By how much it is turned, counter-clockwise.
    """

    error_m: tuple[float, float]
    sigma_m: float
    scale: float
    rotation_rad: float


@dataclass(frozen=True, slots=True)
class Disagreement:
    """How far satellites are off, if they began to lie at `since_s`.

    Attributes:
        error_m: Told minus true position of the newest keyframe, east and north.
        sigma_m: Its standard deviation in one direction.
        since_s: When the lie began, as far as that can be told: rather too early.
        leap_m: The farthest that the told position leapt from one picture to another in the last
            minute; 0 where it did not.
    """

    error_m: tuple[float, float]
    sigma_m: float
    since_s: float
    leap_m: float = 0.0

    @property
    def least_m(self) -> float:
        """The error less 2.5 standard deviations; may be negative."""
        return math.hypot(*self.error_m) - 2.5 * self.sigma_m

    def wrong(self, tolerated_m: float) -> bool:
        """Whether satellites are off by more than that, or have leapt so far, for certain.

        A leap is known far better than the error: it does not matter how good the map is.
        """
        return max(self.least_m, self.leap_m - 2.5 * UNEASE_M) > tolerated_m
