"""How a vehicle was turned at a moment that lies between its attitudes.

Times are of the vehicle's own clock, as in `uavmap.mavlink.position_history`.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, field
from typing import Final

from missions.units import Quaternion
from uavmap.mavlink.position_history import KEPT_S, MOST_KEPT

MOST_GAP_S: Final = 0.5
"""So far from the nearest attitude in time nobody knows how it was turned."""
_NEARLY_SAME: Final = 0.9995


@dataclass(slots=True)
class Attitudes:
    """The attitudes of the last `KEPT_S`.

    >>> track = Attitudes()
    >>> track.take(10.0, Quaternion.from_euler(0.0, 0.0, 0.0))
    >>> track.take(10.4, Quaternion.from_euler(0.0, 0.0, 0.8))
    >>> half_way = track.at(10.2)
    >>> round(2.0 * math.asin(half_way.z), 6)
    0.4
    >>> track.at(11.0) is None
    True
    """

    _kept: deque[tuple[float, Quaternion]] = field(default_factory=lambda: deque(maxlen=MOST_KEPT))

    @property
    def last_s(self) -> float:
        """The time of the latest, before all times where there is none."""
        return self._kept[-1][0] if self._kept else -math.inf

    def take(self, boot_s: float, attitude: Quaternion) -> None:
        """Take in an attitude; a clock that begins anew leaves nothing to reckon with."""
        kept = self._kept
        if kept and boot_s == kept[-1][0]:
            return
        if kept and boot_s < kept[-1][0]:
            kept.clear()
        kept.append((boot_s, attitude))
        while kept[0][0] < boot_s - KEPT_S:
            kept.popleft()

    def at(self, boot_s: float) -> Quaternion | None:
        """How it was turned at a time of its clock: between two on the shortest turn.

        None where the nearest that was told is more than `MOST_GAP_S` away.
        """
        before = after = None
        for sample in reversed(self._kept):
            if sample[0] <= boot_s:
                before = sample
                break
            after = sample
        near = [s for s in (before, after) if s is not None and abs(s[0] - boot_s) <= MOST_GAP_S]
        if not near:
            return None
        if before is None or after is None:
            return near[0][1]
        return between(before[1], after[1], (boot_s - before[0]) / (after[0] - before[0]))


def between(a: Quaternion, b: Quaternion, share: float) -> Quaternion:
    """The rotation that is a share of the shortest way from one to the other."""
    cosine = sum(p * q for p, q in zip(a, b, strict=True))
    sign = 1.0 if cosine >= 0.0 else -1.0
    cosine = min(abs(cosine), 1.0)
    if cosine > _NEARLY_SAME:
        of_a, of_b = 1.0 - share, share
    else:
        angle = math.acos(cosine)
        of_a = math.sin((1.0 - share) * angle) / math.sin(angle)
        of_b = math.sin(share * angle) / math.sin(angle)
    mixed = [of_a * p + sign * of_b * q for p, q in zip(a, b, strict=True)]
    length = math.sqrt(sum(x * x for x in mixed))
    return Quaternion(*(x / length for x in mixed))
