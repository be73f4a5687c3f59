"""The truth of one multicopter: a point with a velocity, a battery, and an autopilot.

It flies by its own estimate (`believed`), which satellites, a wandering error and a compass may
falsify. Heights are above its own home. The air has a given wind, gusts, and storms.
"""

from __future__ import annotations

import math
import random
from dataclasses import dataclass, field

from missions.guardian import Mode
from missions.units import GridPoint
from tests.referee.track import Holder

ROUGHNESS_M = 0.03  # of a meadow: the wind is weaker near the ground
REFERENCE_M = 12.0  # height of given winds
STRONGEST_M_S = 25.0  # maximum at any height, gusts included
RAMP_S = 3.0  # time within which a storm rises
GUST_TAU_S = 4.0

Vector = tuple[float, float]


def profile(height_m: float) -> float:
    """Return the share of the wind at the reference height, by a logarithmic profile."""
    at_m = min(max(height_m, 0.5), 60.0)
    return math.log(at_m / ROUGHNESS_M) / math.log(REFERENCE_M / ROUGHNESS_M)


@dataclass(frozen=True, slots=True)
class Storm:
    """Wind in addition to the given one, at the reference height, towards east and north."""

    begin_s: float
    end_s: float
    wind_m_s: Vector

    def share(self, t_s: float) -> float:
        return min(max((t_s - self.begin_s) / RAMP_S, 0.0), 1.0) if t_s < self.end_s else 0.0


@dataclass(slots=True)
class Air:
    given_m_s: Vector = (0.0, 0.0)
    gust_m_s: float = 0.0
    storms: list[Storm] = field(default_factory=list)
    rng: random.Random = field(default_factory=lambda: random.Random(0))
    _gust: Vector = (0.0, 0.0)

    def step(self, dt_s: float) -> None:
        if self.gust_m_s > 0.0:
            self._gust = _wandered(self._gust, self.gust_m_s, GUST_TAU_S, dt_s, self.rng)

    def wind(self, t_s: float, height_m: float, *, gusts: bool = True) -> Vector:
        """Return the wind at a height; without `gusts` its mean."""
        gust_east, gust_north = self._gust if gusts else (0.0, 0.0)
        east, north = self.given_m_s[0] + gust_east, self.given_m_s[1] + gust_north
        for storm in self.storms:
            share = storm.share(t_s)
            east += share * storm.wind_m_s[0]
            north += share * storm.wind_m_s[1]
        strength = math.hypot(east, north)
        if strength == 0.0:
            return 0.0, 0.0
        weaker = min(profile(height_m), STRONGEST_M_S / strength)
        return weaker * east, weaker * north


ACCEL_M_S2 = 2.5
AIRSPEED_M_S = 13.0  # what the airframe can fly
CLIMB_M_S = 1.5
DESCENT_M_S = 1.5
DESCENT_M_S2 = 1.0  # acceleration of a faster descent, and of braking it
SINK_M_S = 0.75  # on the last metres of a landing
FINAL_M = 10.0  # height of these metres above ground; above it lands as fast as it descends
SPIN_UP_S = 2.0
DISARM_S = 1.0
STOP_M = 0.7
FALL_M_S = 12.0
LIFTED_M = 0.3
NOISE_TAU_S = 20.0
AIRSPEED_DRAW = 0.1  # additional power at 12 m/s, over that of hovering
STREAM_TIMEOUT_S = 1.0  # without a setpoint it brakes
STREAM_GAIN_1_S = 0.6  # gain towards a streamed place, 1/s


@dataclass(slots=True)
class Aircraft:
    """One multicopter: its truth, and the targets of its autopilot."""

    number: int
    home: GridPoint
    position: GridPoint
    wh: float
    speed_m_s: float
    hover_w: float
    level_m: float = 0.0  # height of home above the first vehicle's home
    height_m: float = 0.0
    velocity_m_s: Vector = (0.0, 0.0)
    wind_m_s: Vector = (0.0, 0.0)
    armed: bool = False
    flying: bool = False  # in the air, under any control
    mode: Mode = "follow"
    failsafe: bool = False  # it returns or lands by a failsafe of its own
    unasked: bool = False  # it returns by itself, without a failsafe in its telemetry
    piloted: bool = False  # a pilot chose the mode that it is in
    changes: list[tuple[Holder, str]] = field(default_factory=list)  # modes since the last sample
    sea_error_m: float = 0.0  # error of its receiver's height above the sea
    target: GridPoint | None = None
    target_height_m: float = 0.0
    streamed: tuple[GridPoint, Vector] | None = None  # place and velocity of the last setpoint
    streamed_s: float = 0.0
    descent_m_s: float = DESCENT_M_S  # commanded, until its mode changes
    sink_m_s: float = 0.0
    return_height_m: float = 15.0
    returning: str = ""
    crashed: bool = False
    crash_height_m: float = 0.0
    motors_failed: bool = False
    stays_armed: bool = False  # after a crash its motors go on turning: no crash detection
    low_wh: float = -1.0  # charge of its own battery failsafe; -1: none
    offset_m: Vector = (0.0, 0.0)  # error of satellite navigation
    drift_m_s: Vector = (0.0, 0.0)
    compass_rad: float = 0.0
    noise_m: float = 0.0
    rng: random.Random = field(default_factory=lambda: random.Random(0))
    clock_s: float = 0.0
    _noise: Vector = (0.0, 0.0)
    _armed_s: float = 0.0
    _down_s: float = 0.0
    _fall_m_s: float = 0.0

    # --- its telemetry ---------------------------------------------------------------------
    @property
    def error_m(self) -> Vector:
        return self.offset_m[0] + self._noise[0], self.offset_m[1] + self._noise[1]

    @property
    def believed(self) -> GridPoint:
        east, north = self.error_m
        return GridPoint(self.position.east_m + east, self.position.north_m + north)

    @property
    def ground_speed_m_s(self) -> float:
        """Return the speed by its own estimate; spoofed positions have spoofed velocities."""
        (east, north), drift = self.velocity_m_s, self.drift_m_s
        return math.hypot(east + drift[0], north + drift[1]) if self.flying else 0.0

    # --- commands --------------------------------------------------------------------------
    def take_off(self, height_m: float) -> None:
        if not self.armed:
            self.armed, self._armed_s = True, self.clock_s
        if self.mode != "follow":
            self.changes.append(("service", "follow"))
        self.mode, self.target, self.target_height_m = "follow", self.believed, height_m
        self.streamed, self.piloted = None, False

    def aim(self, point: GridPoint, height_m: float) -> bool:
        """Fly to a point; return False unless it follows."""
        if self.mode != "follow" or not self.armed:
            return False
        self.target, self.target_height_m, self.streamed = point, height_m, None
        return True

    def stream(self, place: GridPoint, velocity_m_s: Vector, height_m: float) -> None:
        """Follow a setpoint; ignored unless it follows."""
        if self.mode == "follow" and self.armed:
            self.streamed, self.streamed_s = (place, velocity_m_s), self.clock_s
            self.target_height_m = height_m

    def brake(self) -> None:
        if self.streamed is not None:
            self.streamed_s = -math.inf

    def switch(self, mode: Mode) -> None:
        """Change the mode; returning and landing begin here."""
        if mode == self.mode:
            return
        self.piloted = False
        self.changes.append(("failsafe" if self.failsafe else "service", mode))
        self.mode, self.target, self.target_height_m = mode, self.believed, self.height_m
        self.streamed, self.descent_m_s, self.unasked = None, DESCENT_M_S, False
        if mode == "rtl":
            self.returning = "climb"
            self.target_height_m = max(self.height_m, self.return_height_m)

    def turn_switch(self, mode: Mode) -> None:
        """Change the mode for the pilot, which ends a failsafe."""
        self.piloted = self.failsafe = False
        changes = mode != self.mode
        self.switch(mode)
        self.piloted = changes
        if changes:
            self.changes[-1] = ("pilot", mode)

    def give_back(self) -> None:
        """Return to the mode in which it follows; it stops here."""
        self.mode, self.piloted = "follow", False
        self.changes.append(("pilot", ""))
        self.target, self.target_height_m = self.believed, self.height_m

    # --- time ------------------------------------------------------------------------------
    def step(self, dt_s: float, air: Air, ground_m: float) -> None:
        """Let time pass. `ground_m` is the ground below it, above its home."""
        self.clock_s += dt_s
        self._wander(dt_s)
        if not self.flying:
            self._stand(dt_s)
            return
        wind = self.wind_m_s = air.wind(self.clock_s, self.height_m + self.level_m)
        self._drain(dt_s, wind)
        if self.motors_failed or self.wh <= 0.0:
            self._fall(dt_s, ground_m)
            return
        if 0.0 < self.wh <= self.low_wh and self.mode == "follow":
            self.failsafe = True
            self.switch("rtl")
        if self.mode == "rtl":
            self._return()
        self._fly(dt_s, wind)
        self._climb(dt_s, ground_m)

    def _wander(self, dt_s: float) -> None:
        drift = self.drift_m_s
        if drift != (0.0, 0.0):
            east, north = self.offset_m
            self.offset_m = (east + drift[0] * dt_s, north + drift[1] * dt_s)
        if self.noise_m > 0.0:
            self._noise = _wandered(self._noise, self.noise_m, NOISE_TAU_S, dt_s, self.rng)

    def _stand(self, dt_s: float) -> None:
        self.velocity_m_s = (0.0, 0.0)
        if not self.armed:
            return
        rising = self.mode in ("follow", "other") and self.target_height_m > self.height_m + 0.5
        if rising and not self.crashed and not self.motors_failed:
            if self.clock_s - self._armed_s >= SPIN_UP_S:
                self.flying = True
        elif self.clock_s - self._down_s >= DISARM_S and not (self.crashed and self.stays_armed):
            self.armed = False

    def _drain(self, dt_s: float, wind: Vector) -> None:
        airspeed = math.hypot(self.velocity_m_s[0] - wind[0], self.velocity_m_s[1] - wind[1])
        power_w = self.hover_w * (1.0 + AIRSPEED_DRAW * min(airspeed, AIRSPEED_M_S) ** 2 / 144.0)
        self.wh -= power_w * dt_s / 3600.0

    def _fall(self, dt_s: float, ground_m: float) -> None:
        self._fall_m_s = min(self._fall_m_s + 9.8 * dt_s, FALL_M_S)
        if not self.crashed:
            self.crashed, self.crash_height_m = True, self.height_m - ground_m
        self.height_m -= self._fall_m_s * dt_s
        if self.height_m <= ground_m:
            self._touch(ground_m)

    def _touch(self, ground_m: float) -> None:
        self.height_m, self.flying, self.velocity_m_s = ground_m, False, (0.0, 0.0)
        self._down_s, self.failsafe, self.piloted = self.clock_s, False, False

    def _return(self) -> None:
        if self.returning == "climb" and self.height_m >= self.target_height_m - 0.5:
            self.returning, self.target = "fly", self.home
        elif self.returning == "fly" and self.believed.distance_to(self.home) <= STOP_M:
            self.returning = "land"

    def _target_velocity(self, dt_s: float) -> Vector:
        """Return the velocity over ground, along its stream or towards its target."""
        here, target = self.believed, self.target
        east = north = 0.0
        if self.streamed is not None:
            if self.clock_s - self.streamed_s > STREAM_TIMEOUT_S:
                if self.ground_speed_m_s < 0.3:
                    self.streamed, self.target = None, here
                return 0.0, 0.0
            place, (east, north) = self.streamed
            off_e, off_n = place.east_m - here.east_m, place.north_m - here.north_m
            return east + STREAM_GAIN_1_S * off_e, north + STREAM_GAIN_1_S * off_n
        if target is not None:
            east, north = target.east_m - here.east_m, target.north_m - here.north_m
            gap_m = math.hypot(east, north)
            if gap_m > 1e-9:
                speed = min(self.speed_m_s, math.sqrt(1.4 * ACCEL_M_S2 * gap_m), gap_m / dt_s)
                east, north = east * speed / gap_m, north * speed / gap_m
        return east, north

    def _fly(self, dt_s: float, wind: Vector) -> None:
        east, north = self._target_velocity(dt_s)
        east, north = east - self.drift_m_s[0], north - self.drift_m_s[1]
        east, north = _through_air(east, north, wind)
        ve, vn = self.velocity_m_s
        change = math.hypot(east - ve, north - vn)
        share = 1.0 if change <= ACCEL_M_S2 * dt_s else ACCEL_M_S2 * dt_s / change
        east, north = (east - ve) * share, (north - vn) * share
        if self.compass_rad:  # it leans the wrong way; its velocity is measured all the same
            sin, cos = math.sin(self.compass_rad), math.cos(self.compass_rad)
            east, north = east * cos + north * sin, north * cos - east * sin
            ve, vn = _through_air(ve + east, vn + north, wind)
        else:  # a wind that comes up takes hold by and by
            ve, vn = ve + east, vn + north
        self.velocity_m_s = (ve, vn)
        self.position = GridPoint(
            self.position.east_m + ve * dt_s, self.position.north_m + vn * dt_s
        )

    def _climb(self, dt_s: float, ground_m: float) -> None:
        landing = self.mode == "land" or (self.mode == "rtl" and self.returning == "land")
        goal_m = ground_m - 1.0 if landing else self.target_height_m
        if landing:
            low = self.height_m - ground_m < FINAL_M
            self.sink_m_s = SINK_M_S if low else DESCENT_M_S
        else:
            brakes_m_s = math.sqrt(2.0 * DESCENT_M_S2 * max(self.height_m - goal_m, 0.0))
            faster_m_s = max(self.sink_m_s, DESCENT_M_S) + DESCENT_M_S2 * dt_s
            self.sink_m_s = min(self.descent_m_s, max(brakes_m_s, DESCENT_M_S), faster_m_s)
        self.height_m += max(-self.sink_m_s * dt_s, min(CLIMB_M_S * dt_s, goal_m - self.height_m))
        if self.height_m <= ground_m and goal_m <= ground_m:
            self._touch(ground_m)


def _wandered(now: Vector, sigma: float, tau_s: float, dt_s: float, rng: random.Random) -> Vector:
    """Return the next value of a Gauss-Markov process."""
    keep = math.exp(-dt_s / tau_s)
    kick = sigma * math.sqrt(1.0 - keep * keep)
    return keep * now[0] + kick * rng.gauss(0.0, 1.0), keep * now[1] + kick * rng.gauss(0.0, 1.0)


def _through_air(east_m_s: float, north_m_s: float, wind: Vector) -> Vector:
    """Return a velocity over ground, limited to the airspeed of the airframe."""
    through = math.hypot(east_m_s - wind[0], north_m_s - wind[1])
    if through <= AIRSPEED_M_S:
        return east_m_s, north_m_s
    share = AIRSPEED_M_S / through
    return wind[0] + (east_m_s - wind[0]) * share, wind[1] + (north_m_s - wind[1]) * share
