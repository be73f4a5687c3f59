"""How the autopilot's idea of its position errs: slowly, as satellite navigation does."""

from __future__ import annotations

import math

import numpy as np

_SMOOTHING_S = 3.0  # a navigation filter lets no jump through
_BLOCK = 1024
# Without satellites only accelerations are known: their bias becomes a speed, the speed a way
_WANDER_M_S, _WANDER_M_S2 = 0.2, 0.02


class PositionError:
    """Error of the estimated position, metres (east, north, up), zero at the beginning.

    A Gauss-Markov process of standard deviation `sigma_m` and correlation time `tau_s`, smoothed
    so that its rate is finite: the estimate moves, it does not jitter. The vertical error (a
    barometer's) has a third of the deviation. `disturb` makes it worse: `lost` says that there is
    no satellite navigation.
    """

    def __init__(self, rng: np.random.Generator, sigma_m: float, tau_s: float) -> None:
        self._rng = rng
        # smoothing takes away variance: tau / (tau + smoothing) of it is left
        widened = sigma_m * math.sqrt((tau_s + _SMOOTHING_S) / tau_s)
        self._sigma = (widened, widened, widened / 3.0)
        self._tau_s = tau_s
        self._raw = (0.0, 0.0, 0.0)
        self._step_s = 0.0  # the length of step for which the shares below hold
        self._keep = self._kick = self._follow = 0.0
        self._noise: list[float] = []
        self._at = 0
        self.east = self.north = self.up = 0.0
        self.v_east = self.v_north = self.v_up = 0.0
        self.lost = False
        self.disturbed = False  # now or ever
        self._glitch = self._drift = (0.0, 0.0)
        self._drifted = [0.0, 0.0]
        self._wander = [0.0, 0.0]
        self._lost_s = 0.0

    def disturb(
        self, *, lost: bool, glitch_m: tuple[float, float], drift_m_s: tuple[float, float]
    ) -> None:
        """Satellite navigation is gone, wrong by `glitch_m`, moves off with `drift_m_s`."""
        self.disturbed |= lost or glitch_m != (0.0, 0.0) or drift_m_s != (0.0, 0.0)
        if lost and not self.lost:
            self._lost_s = 0.0
            bearing = math.tau * self._rng.random()
            self._wander = [math.sin(bearing), math.cos(bearing)]
        self.lost = lost
        self._glitch, self._drift = glitch_m, drift_m_s
        if drift_m_s == (0.0, 0.0):
            self._drifted = [0.0, 0.0]

    def step(self, dt_s: float) -> None:
        """Advance by `dt_s`."""
        if self.lost:
            self._wander_off(dt_s)
            return
        if self._sigma[0] == 0.0 and not self.disturbed:
            return
        self._follow_to(self._fix(dt_s))

    def _fix(self, dt_s: float) -> tuple[float, float, float]:
        """What the receiver's position errs by, after another `dt_s`."""
        if self._at + 3 > len(self._noise):
            # drawn in blocks: one call of numpy a step would cost more than the physics
            self._noise = self._rng.standard_normal(3 * _BLOCK).tolist()
            self._at = 0
        if dt_s != self._step_s:
            self._step_s = dt_s
            self._keep = math.exp(-dt_s / self._tau_s)
            self._kick = math.sqrt(1.0 - self._keep * self._keep)
            self._follow = -math.expm1(-dt_s / _SMOOTHING_S) * _SMOOTHING_S
        keep, kick = self._keep, self._kick
        raw_east, raw_north, raw_up = self._raw
        sigma_east, sigma_north, sigma_up = self._sigma
        noise, at = self._noise, self._at
        raw_east = keep * raw_east + kick * sigma_east * noise[at]
        raw_north = keep * raw_north + kick * sigma_north * noise[at + 1]
        raw_up = keep * raw_up + kick * sigma_up * noise[at + 2]
        self._raw = (raw_east, raw_north, raw_up)
        self._at = at + 3
        if self.disturbed:
            self._drifted[0] += self._drift[0] * dt_s
            self._drifted[1] += self._drift[1] * dt_s
            raw_east += self._glitch[0] + self._drifted[0]
            raw_north += self._glitch[1] + self._drifted[1]
        return raw_east, raw_north, raw_up

    def _follow_to(self, fix: tuple[float, float, float]) -> None:
        """Draw the estimate towards the receiver's position, for the step of the last `_fix`."""
        raw_east, raw_north, raw_up = fix
        follow = self._follow
        self.v_east = v_east = (raw_east - self.east) / _SMOOTHING_S
        self.v_north = v_north = (raw_north - self.north) / _SMOOTHING_S
        self.v_up = v_up = (raw_up - self.up) / _SMOOTHING_S
        self.east += follow * v_east
        self.north += follow * v_north
        self.up += follow * v_up

    def _wander_off(self, dt_s: float) -> None:
        """Dead reckoning: ever faster away, height still known from the air's pressure."""
        self._lost_s += dt_s
        speed = _WANDER_M_S + _WANDER_M_S2 * self._lost_s
        self.v_east, self.v_north = speed * self._wander[0], speed * self._wander[1]
        self.v_up = 0.0
        self.east += self.v_east * dt_s
        self.north += self.v_north * dt_s
