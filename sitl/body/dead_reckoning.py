"""How the way errs that is measured by optical flow: by a scale, a rotation, and a little more.

Flow tells the speed over ground: its scale is wrong by the height that it is taken from, its
direction by the compass. Both are the same for a whole outage, so what is flown out and back
cancels out; a small part changes all the time and does not.
"""

from __future__ import annotations

import math

import numpy as np

_MOST_SIGMAS, _MOST_WANDER = 2.5, 3.0
_WANDER_M_S = 0.02  # at rest, each axis
_WANDER_TAU_S = 5.0
_CHANGING_SHARE = 0.15  # of the drift: what no scale and no rotation explains
_BLOCK = 256


class DeadReckoning:
    """Error of a velocity that is measured by optical flow, one outage after the other.

    `drift` is the share of the distance flown over ground that the position errs by: the root mean
    square over outages, of a straight leg. No outage errs by more than `MOST` times that, apart
    from the wander.

    >>> flow = DeadReckoning([1], drift=0.02)
    >>> flow.begin()
    >>> east, north = flow.error_m_s(10.0, 0.0, 0.05)
    >>> 0.0 < math.hypot(east, north) < 10.0 * 0.02 * DeadReckoning.MOST + 0.1
    True
    """

    MOST = _MOST_SIGMAS + math.sqrt(2.0) * _MOST_WANDER * _CHANGING_SHARE

    __slots__ = ("_at", "_noise", "_rng", "_rotation", "_scale", "_wander", "drift")

    def __init__(self, seed: list[int], drift: float) -> None:
        self._rng = np.random.default_rng(seed)
        self.drift = drift
        self._scale = self._rotation = 0.0
        self._wander = (0.0, 0.0)
        self._noise: list[float] = []
        self._at = 0

    def begin(self) -> None:
        """Another outage: another scale, another rotation."""
        each = self.drift / math.sqrt(2.0)
        drawn = np.clip(self._rng.standard_normal(2), -_MOST_SIGMAS, _MOST_SIGMAS)
        self._scale, self._rotation = (each * drawn).tolist()
        self._wander = (0.0, 0.0)

    def bearing_rad(self) -> float:
        """Any direction."""
        return math.tau * float(self._rng.random())

    def error_m_s(self, v_east: float, v_north: float, dt_s: float) -> tuple[float, float]:
        """What the measured velocity (east, north) errs by, over ground at this true one."""
        if self._at + 2 > len(self._noise):
            self._noise, self._at = self._rng.standard_normal(2 * _BLOCK).tolist(), 0
        keep = math.exp(-dt_s / _WANDER_TAU_S)
        kick = math.sqrt(1.0 - keep * keep)
        east, north = self._wander
        noise, at = self._noise, self._at
        self._wander = east, north = (
            max(-_MOST_WANDER, min(_MOST_WANDER, keep * east + kick * noise[at])),
            max(-_MOST_WANDER, min(_MOST_WANDER, keep * north + kick * noise[at + 1])),
        )
        self._at = at + 2
        amount = _WANDER_M_S + _CHANGING_SHARE * self.drift * math.hypot(v_east, v_north)
        scale, rotation = self._scale, self._rotation
        return (
            scale * v_east + rotation * v_north + amount * east,
            scale * v_north - rotation * v_east + amount * north,
        )
