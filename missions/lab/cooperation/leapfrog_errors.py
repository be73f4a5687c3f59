"""The position errors of two multicopters that track each other, and of one alone.

A Kalman filter over both: place, heading, and the scale error of the odometer. It is linearised
about the plan, which both follow. So all measurements agree on what cannot be seen (the direction
of north), and the filter gains no false certainty. Both start at known places with known headings,
in any frame: the map's place on the earth does not matter.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Final

import numpy as np
from numpy.typing import NDArray

from missions.lab.cooperation.space import Point
from missions.lab.cooperation.tracking import rotation
from missions.planning.leapfrog_geometry import Leapfrog, Role, Step

Array = NDArray[np.float64]

_EACH: Final = 4  # east, north, heading, share by which the odometer reads too much
_INDEX = {Role.MAPPER: 0, Role.TRACKER: _EACH}


@dataclass(frozen=True, slots=True)
class LeapfrogNoise:
    """Standard deviations of the measurements of both; those of sightings are above 0.

    Attributes:
        scale: Relative error of an odometer's distance (optical flow over a height), the same for
            the whole flight.
        drift_rad: Error of the heading after a metre, growing with the root of the way. It is that
            of a gyro, without a compass (beneath steel there is none to trust).
        place_m: Error of a sighting, aside: the attitude's error times the height above.
        yaw_rad: Error of the marker's heading in the tracker's picture.
        hover_m: Error of the place that a hovering vehicle holds while the other one moves: it
            compares the ground with its picture at the stop.
        hover_rad: Error of its heading meanwhile.
    """

    scale: float = 0.02
    drift_rad: float = math.radians(0.3)
    place_m: float = 0.1
    yaw_rad: float = math.radians(0.12)
    hover_m: float = 0.02
    hover_rad: float = math.radians(0.05)

    @classmethod
    def of_tracker(cls, above_m: float, tilt_rad: float = math.radians(0.5)) -> LeapfrogNoise:
        """Return noise with sightings of such an attitude error from such a height."""
        return cls(place_m=above_m * math.tan(tilt_rad))


class Team:
    """The estimates for mapper and tracker, step by step."""

    def __init__(self, noise: LeapfrogNoise, mapper: Point, tracker: Point) -> None:
        """Begin with places and headings that are known exactly."""
        self._noise = noise
        self.mean = np.array([*mapper, 0.0, 0.0, *tracker, 0.0, 0.0])
        """East, north, heading (against the clock), scale: of the mapper, then of the tracker."""
        self.spread = np.zeros((2 * _EACH, 2 * _EACH))
        self.spread[3, 3] = self.spread[7, 7] = noise.scale**2

    def place(self, role: Role) -> tuple[Array, Array]:
        """Return the estimated place of a vehicle, m, and the covariance, m^2."""
        i = _INDEX[role]
        return self.mean[i : i + 2].copy(), self.spread[i : i + 2, i : i + 2].copy()

    def reckon(self, role: Role, read: Array, drift_rad: float, leg: Array) -> None:
        """Add a straight leg by plan, metres east and north.

        `read` is the odometer's value, in the axes of the vehicle at the beginning of the leg;
        `drift_rad` is the gyro's error of turn. Both are accepted: there is no other measurement.
        """
        i = _INDEX[role]
        heading, scale = self.mean[i + 2], self.mean[i + 3]
        self.mean[i : i + 2] += rotation(heading) @ read / (1.0 + scale)
        self.mean[i + 2] += drift_rad
        moved = np.eye(2 * _EACH)
        moved[i : i + 2, i + 2] = _across(leg)
        moved[i : i + 2, i + 3] = -leg
        self.spread = moved @ self.spread @ moved.T
        shaken = np.stack([np.append(_across(leg) / np.hypot(*leg), 0.0), [0.0, 0.0, 1.0]], axis=1)
        own = slice(i, i + 3)
        by_gyro = drift_covariance(self._noise, float(np.hypot(*leg)))
        self.spread[own, own] += shaken @ by_gyro @ shaken.T

    def hover(self, role: Role) -> None:
        """Add a hover of a vehicle through a step: it assumes that it was still."""
        i = _INDEX[role]
        noise = self._noise
        self.spread[i : i + 3, i : i + 3] += np.diag(
            [noise.hover_m**2, noise.hover_m**2, noise.hover_rad**2]
        )

    def sight(self, measured: Array, apart: Array) -> None:
        """Add the tracker's view of the mapper.

        It is in metres along the tracker's own east and north, and the heading relative to its own.
        By the plan the mapper is `apart`, metres east and north.
        """
        mapper, tracker = self.mean[:3], self.mean[_EACH : _EACH + 3]
        expected = np.append(
            rotation(-tracker[2]) @ (mapper[:2] - tracker[:2]), mapper[2] - tracker[2]
        )
        rows = np.zeros((3, 2 * _EACH))
        rows[:3, :3] = np.eye(3)
        rows[:3, _EACH : _EACH + 3] = -np.eye(3)
        rows[:2, _EACH + 2] = -_across(apart)
        noise = sighting_covariance(self._noise)
        across = self.spread @ rows.T
        gain = np.linalg.solve(rows @ across + noise, across.T).T
        self.mean -= gain @ (expected - measured)
        keep = np.eye(2 * _EACH) - gain @ rows
        self.spread = keep @ self.spread @ keep.T + gain @ noise @ gain.T


@dataclass(frozen=True, slots=True)
class LeapfrogFlight:
    """One flight with one draw of the noise, after each hop of the mapper.

    Attributes:
        errors_m: (hops, 2), the believed place of the mapper less its true place.
        sigmas_m: (hops,), the root of the expected square of their length.
        nees: (hops,), normalised estimation error squared: 2 on average for an honest filter.
    """

    errors_m: Array
    sigmas_m: Array
    nees: Array

    @property
    def rms_m(self) -> float:
        """Root of the mean square of the mapper's errors, m: that of its map."""
        return float(np.sqrt((self.errors_m**2).sum(axis=1).mean()))


def fly_leapfrog(
    plan: Leapfrog, noise: LeapfrogNoise, seed: int
) -> tuple[LeapfrogFlight, LeapfrogFlight]:
    """Fly both on their plan, with one draw of the noise: tracked, and by odometry alone.

    Both read the same odometer.
    """
    rng = np.random.default_rng((seed, 27))
    mapper, tracker = _starts(plan)
    tracked, alone = (Team(noise, mapper, tracker) for _ in range(2))
    scales = {role: float(rng.normal(0.0, noise.scale)) for role in Role}
    # unnoticed drift and turns of a hover are only in the truth of hovering vehicles
    heading = dict.fromkeys(Role, 0.0)
    at = {Role.MAPPER: np.array(mapper), Role.TRACKER: np.array(tracker)}
    by_sight: list[tuple[Array, Array]] = []
    by_odometry: list[tuple[Array, Array]] = []
    for step in plan.steps:
        mover, other = step.mover, _other(step.mover)
        for leg in _legs(step):
            off = _drawn(drift_covariance(noise, float(np.hypot(*leg))), rng)
            aside = off[0] * _across(leg) / np.hypot(*leg)
            read = (1.0 + scales[mover]) * leg
            tracked.reckon(mover, rotation(-heading[mover]) @ read + aside, off[1], leg)
            alone.reckon(mover, read + aside, off[1], leg)
            at[mover] = at[mover] + leg
        at[other] = at[other] + rng.normal(0.0, noise.hover_m, 2)
        heading[other] += float(rng.normal(0.0, noise.hover_rad))
        tracked.hover(other)
        exact = np.append(
            rotation(-heading[Role.TRACKER]) @ (at[Role.MAPPER] - at[Role.TRACKER]),
            heading[Role.MAPPER] - heading[Role.TRACKER],
        )
        tracked.sight(exact + _drawn(sighting_covariance(noise), rng), _apart(step))
        if mover is Role.MAPPER:
            place, spread = tracked.place(mover)
            by_sight.append((place - at[mover], spread))
            place, spread = alone.place(mover)
            by_odometry.append((place - step.end, spread))
    return _flight(by_sight), _flight(by_odometry)


@dataclass(frozen=True, slots=True)
class Comparison:
    """Many flights: root mean squares of the mapper's errors after each hop, and mean NEES."""

    path_m: float
    hops: int
    tracked_m: float
    alone_m: float
    tracked_nees: float
    alone_nees: float

    @property
    def times_better(self) -> float:
        """Return the ratio of the errors of odometry alone to these errors."""
        return self.alone_m / self.tracked_m


def compare(plan: Leapfrog, noise: LeapfrogNoise, seeds: Sequence[int]) -> Comparison:
    """Return the gain of tracking each other on a plan, by a flight for each seed."""
    flights = [fly_leapfrog(plan, noise, seed) for seed in seeds]
    rms = [math.sqrt(float(np.mean([f[i].rms_m ** 2 for f in flights]))) for i in (0, 1)]
    # of the last hop alone: those of one flight are not independent
    nees = [float(np.mean([f[i].nees[-1] for f in flights])) for i in (0, 1)]
    return Comparison(plan.length_m(Role.MAPPER), plan.hops, *rms, *nees)


def drift_covariance(noise: LeapfrogNoise, length_m: float) -> Array:
    """Return the covariance of the way aside and of the heading, by a gyro along a straight leg."""
    drift, square = noise.drift_rad**2, length_m**2
    return drift * length_m * np.array([[square / 3.0, length_m / 2.0], [length_m / 2.0, 1.0]])


def sighting_covariance(noise: LeapfrogNoise) -> Array:
    """Return the covariance of the mapper's place, east and north, and of its heading."""
    variances = np.array([noise.place_m, noise.place_m, noise.yaw_rad]) ** 2
    return np.asarray(np.diag(variances), dtype=np.float64)


def _starts(plan: Leapfrog) -> tuple[Point, Point]:
    first = plan.steps[0]
    both = (first.start, first.hovering)
    return both if first.mover is Role.MAPPER else (both[1], both[0])


def _other(role: Role) -> Role:
    return Role.TRACKER if role is Role.MAPPER else Role.MAPPER


def _legs(step: Step) -> Sequence[Array]:
    pairs = ((np.array(a), np.array(b)) for a, b in pairwise(step.path) if math.dist(a, b) > 0.0)
    return [b - a for a, b in pairs]


def _apart(step: Step) -> Array:
    """Return the way from the tracker to the mapper at a step's end, by the plan."""
    towards = np.array(step.hovering) - np.array(step.end)
    return np.asarray(towards if step.mover is Role.TRACKER else -towards, dtype=np.float64)


def _drawn(covariance: Array, rng: np.random.Generator) -> Array:
    values, vectors = np.linalg.eigh(covariance)
    shares = np.sqrt(np.maximum(values, 0.0)) * rng.standard_normal(len(values))
    return np.asarray(vectors @ shares, dtype=np.float64)


def _flight(ends: list[tuple[Array, Array]]) -> LeapfrogFlight:
    errors = np.stack([error for error, _ in ends])
    sigmas = np.array([math.sqrt(float(np.trace(spread))) for _, spread in ends])
    nees = np.array([float(error @ np.linalg.solve(spread, error)) for error, spread in ends])
    return LeapfrogFlight(errors, sigmas, nees)


def _across(leg: Array) -> Array:
    """Return a leg turned left: the motion of its end, for each radian."""
    return np.asarray([-leg[1], leg[0]], dtype=np.float64)
