"""The autopilot's position estimate: satellites, optical flow, positions of others.

`PositionError` is satellite navigation, whose error changes slowly, and its loss. `Estimator` adds
optical flow while there are no satellites, and a companion's positions. The autopilot decides
which of them count (`sitl.copter.aiding`).

Flow measures the speed over ground: the assumed height scales it, the compass turns it. Both errors
hold for a whole outage, so a flight out and back cancels them; a small part changes all the time.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

_SMOOTHING_S = 3.0  # a navigation filter lets no jump through
_FIX_BLOCK = 1024
# Without satellites only accelerations are known: their bias becomes a speed, the speed a way
_LOST_M_S, _LOST_M_S2 = 0.2, 0.02


class PositionError:
    """Error of the estimated position, metres (east, north, up), zero at the beginning.

    A Gauss-Markov process of standard deviation `sigma_m` and correlation time `tau_s`, smoothed
    so that its rate is finite. The vertical error (a barometer's) has a third of the deviation.
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
        """Lose satellites, shift them by `glitch_m`, or move them with `drift_m_s`."""
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
        if self._at + 3 > len(self._noise):
            # drawn in blocks: one call of numpy a step would cost more than the physics
            self._noise = self._rng.standard_normal(3 * _FIX_BLOCK).tolist()
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
        raw_east, raw_north, raw_up = fix
        follow = self._follow
        self.v_east = v_east = (raw_east - self.east) / _SMOOTHING_S
        self.v_north = v_north = (raw_north - self.north) / _SMOOTHING_S
        self.v_up = v_up = (raw_up - self.up) / _SMOOTHING_S
        self.east += follow * v_east
        self.north += follow * v_north
        self.up += follow * v_up

    def _wander_off(self, dt_s: float) -> None:
        """Reckon by accelerations: ever faster away; the barometer gives the height."""
        self._lost_s += dt_s
        speed = _LOST_M_S + _LOST_M_S2 * self._lost_s
        self.v_east, self.v_north = speed * self._wander[0], speed * self._wander[1]
        self.v_up = 0.0
        self.east += self.v_east * dt_s
        self.north += self.v_north * dt_s


_MAX_SIGMAS, _MAX_WANDER = 2.5, 3.0
_WANDER_M_S = 0.02  # at rest, each axis
_WANDER_TAU_S = 5.0
_CHANGING_SHARE = 0.15  # of the drift: what no scale and no rotation explains
_FLOW_BLOCK = 256


class DeadReckoning:
    """Error of a velocity that optical flow measures, outage by outage.

    `drift` is the error as a share of the distance over ground: the root mean square over outages,
    of a straight leg. No outage errs by more than `MOST` times that, apart from the wander.
    """

    MOST = _MAX_SIGMAS + math.sqrt(2.0) * _MAX_WANDER * _CHANGING_SHARE

    def __init__(self, seed: list[int], drift: float) -> None:
        self._rng = np.random.default_rng(seed)
        self.drift = drift
        self._scale = self._rotation = 0.0
        self._wander = (0.0, 0.0)
        self._noise: list[float] = []
        self._at = 0

    def begin(self) -> None:
        """Draw scale and rotation of another outage."""
        each = self.drift / math.sqrt(2.0)
        drawn = np.clip(self._rng.standard_normal(2), -_MAX_SIGMAS, _MAX_SIGMAS)
        self._scale, self._rotation = (each * drawn).tolist()
        self._wander = (0.0, 0.0)

    def bearing_rad(self) -> float:
        """Draw any direction."""
        return math.tau * float(self._rng.random())

    def error_m_s(self, v_east: float, v_north: float, dt_s: float) -> tuple[float, float]:
        """Return the error of the measured velocity (east, north) at this true one over ground."""
        if self._at + 2 > len(self._noise):
            self._noise, self._at = self._rng.standard_normal(2 * _FLOW_BLOCK).tolist(), 0
        keep = math.exp(-dt_s / _WANDER_TAU_S)
        kick = math.sqrt(1.0 - keep * keep)
        east, north = self._wander
        noise, at = self._noise, self._at
        self._wander = east, north = (
            max(-_MAX_WANDER, min(_MAX_WANDER, keep * east + kick * noise[at])),
            max(-_MAX_WANDER, min(_MAX_WANDER, keep * north + kick * noise[at + 1])),
        )
        self._at = at + 2
        amount = _WANDER_M_S + _CHANGING_SHARE * self.drift * math.hypot(v_east, v_north)
        scale, rotation = self._scale, self._rotation
        return (
            scale * v_east + rotation * v_north + amount * east,
            scale * v_north - rotation * v_east + amount * north,
        )


_FLOW_SEED = 44
_REGAINED_S = 1.0  # time of a fix before it counts
_FIX_M = 0.3 / math.sqrt(2.0)  # accuracy of the position by satellites, each axis
_GROWTH_M2_S = 0.15  # of the variance between two measurements: what an IMU leaves open
_WANDER_M2_S = 0.004  # of the variance by optical flow, at rest
_LOST_M2_S = 1.0  # of the variance with nothing at all
_OUTPUT_TAU_S = 0.25  # a correction is spread over time, so that no position leaps
_MIN_M2, _MAX_M2 = 1e-6, 1e6


class Estimator(PositionError):  # noqa: N818 - an error of a position is no exception
    """Error of the estimated position, metres (east, north, up).

    With satellites alone it is `PositionError`, number for number. `flow`: there is optical flow,
    which errs by the share `drift` of the distance. The autopilot sets `satellites_used` and
    `aided` between steps.
    """

    def __init__(
        self,
        rng: np.random.Generator,
        sigma_m: float,
        tau_s: float,
        *,
        seed: Sequence[int] = (0,),
        flow: bool = False,
        drift: float = 0.02,
    ) -> None:
        super().__init__(rng, sigma_m, tau_s)
        self.flow = flow
        self.satellites_used = True
        self.aided = False
        """True if positions of a second receiver or a companion are used."""
        self.fix = (0.0, 0.0)
        """Error of the receiver alone, once something else is used."""
        self.no_fix_s = 0.0
        """Since an absolute position of any kind was fused."""
        self.outage_s = 0.0
        """Since satellites were last fused."""
        self.still_near = True
        """True if the estimate has stayed near the satellites: their return needs no reset."""
        self.resets = 0
        """Count of leaps of the position."""
        self._plain = not flow
        self._reckoning = DeadReckoning([*seed, _FLOW_SEED], drift)
        self._regained_s = _REGAINED_S
        self._unaided_s = 0.0
        self._variance = _FIX_M * _FIX_M  # each axis
        self._flow_m = 0.0  # flown by flow alone
        self._pending = (0.0, 0.0)

    # --- what is known ---------------------------------------------------------------------------

    @property
    def calm(self) -> bool:
        """True if there are satellites, and there was never anything else."""
        return self._plain and not self.lost and self.outage_s == 0.0

    @property
    def by_satellites(self) -> bool:
        """True if satellites are fused now."""
        return self.satellites_used and not self.lost and self._regained_s >= _REGAINED_S

    @property
    def unaided(self) -> bool:
        """True if neither position nor velocity is measured."""
        if self.flow or self.aided:
            return False
        return self.lost or not self.satellites_used

    @property
    def accuracy_m(self) -> float:
        """Standard deviation of the horizontal position by the filter."""
        return math.sqrt(2.0 * self._variance + self._by_flow_m2)

    @property
    def _by_flow_m2(self) -> float:
        """Variance by flow, of both axes together."""
        way_m = self._reckoning.drift * self._flow_m
        return way_m * way_m

    # --- positions of others ----------------------------------------------------------------------

    def fuse(self, east_m: float, north_m: float, sigma_m: float) -> None:
        """Fuse a measured position with this error, weighed by the variances."""
        self._leave_plain()
        variance = self._variance + 0.5 * self._by_flow_m2
        gain = variance / (variance + max(sigma_m * sigma_m, _MIN_M2))
        pending_east, pending_north = self._pending
        self._pending = (
            pending_east + gain * (east_m - self.east - pending_east),
            pending_north + gain * (north_m - self.north - pending_north),
        )
        self._variance, self._flow_m = (1.0 - gain) * variance, 0.0

    def reset_to(self, east_m: float, north_m: float, sigma_m: float) -> None:
        """Set the error of the position."""
        self._leave_plain()
        self.east, self.north = east_m, north_m
        self._pending = (0.0, 0.0)
        self._variance, self._flow_m = min(sigma_m * sigma_m, _MAX_M2), 0.0
        self.resets += 1

    def far_off(self, east_m: float, north_m: float, sigma_m: float, gate: float) -> bool:
        """Return whether a measurement is more than `gate` standard deviations away."""
        variance = self._variance + 0.5 * self._by_flow_m2 + sigma_m * sigma_m
        away = math.hypot(east_m - self.east, north_m - self.north)
        return away * away > gate * gate * variance

    # --- time ------------------------------------------------------------------------------------

    def move(self, dt_s: float, v_east: float, v_north: float) -> None:
        """Advance by `dt_s`, over ground at this true velocity (east, north)."""
        if self._plain and (not self.satellites_used or self.aided):
            self._leave_plain()
        if self._plain:
            self.step(dt_s)
            self.no_fix_s = self.outage_s = self.outage_s + dt_s if self.lost else 0.0
            return
        fix = (0.0, 0.0, 0.0)
        if not self.lost:
            if self._sigma[0] != 0.0 or self.disturbed:
                fix = self._fix(dt_s)
            self.fix = fix[:2]
        self._regained_s = 0.0 if self.lost else self._regained_s + dt_s
        if self.by_satellites:
            self._with_satellites(fix)
            return
        if self.outage_s == 0.0:
            self._reckoning.begin()
        self.disturbed = True  # from here on its error is not the receiver's
        self.outage_s += dt_s
        self.no_fix_s = 0.0 if self.aided else self.no_fix_s + dt_s
        self._without_satellites(dt_s, v_east, v_north)
        self._correct(dt_s)

    def _leave_plain(self) -> None:
        if self._plain:
            self._plain = False
            self._regained_s = 0.0 if self.lost else _REGAINED_S
            self._unaided_s = self.outage_s
            if self.outage_s > 0.0:
                self._variance += _LOST_M2_S * self.outage_s

    def _with_satellites(self, fix: tuple[float, float, float]) -> None:
        if self.outage_s > 0.0 and not self.still_near:
            self.reset_to(fix[0], fix[1], _FIX_M)
        self.outage_s = self.no_fix_s = self._unaided_s = 0.0
        self._pending = (0.0, 0.0)
        self._variance, self._flow_m = _FIX_M * _FIX_M, 0.0
        if self._sigma[0] != 0.0 or self.disturbed:
            self._follow_to(fix)

    def _without_satellites(self, dt_s: float, v_east: float, v_north: float) -> None:
        if self.unaided:
            if self._unaided_s == 0.0:
                bearing = self._reckoning.bearing_rad()
                self._wander, self._lost_s = [math.sin(bearing), math.cos(bearing)], 0.0
            self._unaided_s += dt_s
            self._wander_off(dt_s)
            self._grow(_LOST_M2_S * dt_s)
            return
        self._unaided_s = self.v_up = 0.0
        if self.flow:
            self.v_east, self.v_north = self._reckoning.error_m_s(v_east, v_north, dt_s)
            self._flow_m += math.hypot(v_east, v_north) * dt_s
        else:
            self.v_east = self.v_north = 0.0
        self.east += self.v_east * dt_s
        self.north += self.v_north * dt_s
        self._grow((_GROWTH_M2_S if self.aided else _WANDER_M2_S) * dt_s)

    def _grow(self, variance_m2: float) -> None:
        self._variance = min(self._variance + variance_m2, _MAX_M2)

    def _correct(self, dt_s: float) -> None:
        east, north = self._pending
        if east == 0.0 == north:
            return
        share = -math.expm1(-dt_s / _OUTPUT_TAU_S)
        self.east += share * east
        self.north += share * north
        self._pending = (east - share * east, north - share * north)
