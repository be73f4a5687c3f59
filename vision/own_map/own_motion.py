"""How a vehicle moves on from one picture to the next, whatever position it is told.

No aircraft moves as a told position can leap: from where it was and how fast it was, what it can
reach until the next picture is small.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

from vision.own_map.ground_patch import Patch

_FASTEST_M_S2: Final = 8.0  # a multicopter does not accelerate more
_NOISE_M: Final = 0.3  # by attitudes, of one place against another
_LONGEST_S: Final = 3.0  # after so long it may be anywhere


@dataclass(frozen=True, slots=True)
class Reach:
    """Where a vehicle may be: east and north of a keyframe, and how far around."""

    east_m: float
    north_m: float
    within_m: float


@dataclass(frozen=True, slots=True)
class OwnWay:
    """Where the newest picture whose ground was recognised was taken, and how fast it moved then.

    Attributes:
        t_s: When it was taken.
        key: The keyframe that its place is told from.
        east_m: Of that keyframe.
        north_m: Of that keyframe.
        patch: Its ground.
        velocity_m_s: East and north; None after the first one.
        over_s: Over how long a time that is the mean.
    """

    t_s: float
    key: int
    east_m: float
    north_m: float
    patch: Patch
    velocity_m_s: tuple[float, float] | None = None
    over_s: float = math.inf

    def on(self, t_s: float, key: int, east_m: float, north_m: float, patch: Patch) -> OwnWay:
        """The next one, whose place is told from the same keyframe as this one's."""
        over_s = t_s - self.t_s
        if key != self.key or over_s > _LONGEST_S:
            return OwnWay(t_s, key, east_m, north_m, patch)
        velocity = (east_m - self.east_m) / over_s, (north_m - self.north_m) / over_s
        return OwnWay(t_s, key, east_m, north_m, patch, velocity, over_s)

    def told_from(self, key: int) -> OwnWay:
        """The same, if that picture has become a keyframe itself."""
        return OwnWay(self.t_s, key, 0.0, 0.0, self.patch, self.velocity_m_s, self.over_s)

    def reach(self, t_s: float) -> Reach | None:
        """Where it can be then; None if nobody can say.

        >>> import numpy as np
        >>> ground = Patch(np.zeros((1, 1), np.int8), 0, 0, 0.2)
        >>> way = OwnWay(1.0, 7, 4.0, 0.0, ground, (5.0, 0.0), 0.2)
        >>> reach = way.reach(1.2)
        >>> round(reach.east_m, 2), round(reach.within_m, 2)
        (5.0, 1.22)
        """
        on_s = t_s - self.t_s
        if self.velocity_m_s is None or on_s > _LONGEST_S:
            return None
        east, north = self.velocity_m_s
        # the mean velocity is that of the middle between both pictures
        within_m = _FASTEST_M_S2 * on_s * (on_s + self.over_s) / 2.0
        within_m += _NOISE_M * (1.0 + 2.0 * on_s / self.over_s)
        return Reach(self.east_m + east * on_s, self.north_m + north * on_s, within_m)
