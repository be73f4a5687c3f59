"""The errors of robots' positions: by odometry alone, and observed by a waiting robot.

An extended Kalman filter estimates the places and headings of all robots at once. The position of
the observer is uncertain itself, and its error passes to the observed robot. All start at a known
place with a known heading.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from typing import Final

import numpy as np
from numpy.typing import NDArray

from missions.lab.cooperation.exploration import Exploration, turned
from missions.lab.cooperation.space import Point

Array = NDArray[np.float64]

_STILL_M: Final = 1e-9
_SLACK: Final = 1e-9
_SMALL_RAD: Final = 1e-9


@dataclass(frozen=True, slots=True)
class Noise:
    """Standard deviations of odometers and of the tracker.

    Odometry: `along_m` and `drift_rad` after a metre, both growing with the root of the way, and
    `turn_rad` at each turn. The tracker measures at the end of each leg. Its errors are `range_m`
    along the line of sight, `bearing_rad` of the direction, and `heading_rad` of the other's
    heading. `range_m` is also the error across the line: a target is no point.
    """

    along_m: float = 0.03
    drift_rad: float = math.radians(0.3)
    turn_rad: float = math.radians(1.0)
    range_m: float = 0.02
    bearing_rad: float = math.radians(0.05)
    heading_rad: float = math.radians(0.05)


@dataclass(frozen=True, slots=True)
class Leg:
    """A turn and a straight way of one robot, and the observer of its end."""

    robot: int
    turn_rad: float
    length_m: float
    end: Point
    course_rad: float
    watcher: int | None


@dataclass(frozen=True, slots=True)
class PoseEstimates:
    """The estimate of robots: east, north and heading of each in a row."""

    mean: Array
    spread: Array
    """Covariance of the errors as `Filter` counts them."""

    def place(self, robot: int) -> tuple[Array, Array]:
        """Return the place of a robot in m, and its covariance in m^2."""
        i = 3 * robot
        east, north = self.mean[i : i + 2]
        turned_too = np.array([[1.0, 0.0, -north], [0.0, 1.0, east]])
        covariance = turned_too @ self.spread[i : i + 3, i : i + 3] @ turned_too.T
        return self.mean[i : i + 2], covariance


@dataclass(frozen=True, slots=True)
class Ellipse:
    """One standard deviation of a place."""

    major_m: float
    minor_m: float
    angle_deg: float
    """Direction of the longer axis, from east against the clock, 0 to 180."""


def legs_of(exploration: Exploration) -> Iterator[Leg]:
    """Yield the straight legs of an exploration; the nearest waiting robot in range and sight
    observes.

    Robots start with the course of their first leg.
    """
    courses: list[float | None] = [None] * exploration.robots
    most_m = exploration.range_m * (1.0 + _SLACK)
    for move, standing in exploration.standing():
        robot = move.robot
        others = [i for i in range(exploration.robots) if i != robot]
        for a, b in pairwise(move.path):
            if math.dist(a, b) <= _STILL_M:
                continue
            course = math.atan2(b[1] - a[1], b[0] - a[0])
            before = courses[robot]
            courses[robot] = course
            others.sort(key=lambda i: (math.dist(standing[i], b), i))
            seen = (
                i
                for i in others
                if math.dist(standing[i], b) <= most_m and exploration.space.sees(standing[i], b)
            )
            watcher = next(seen, None)
            turn = 0.0 if before is None else turned(before, course)
            yield Leg(robot, turn, math.dist(a, b), b, course, watcher)


def first_courses(legs: list[Leg], robots: int) -> list[float]:
    """Return the heading of each robot in the beginning: the course of its first leg."""
    return [
        next((leg.course_rad for leg in legs if leg.robot == robot), 0.0) for robot in range(robots)
    ]


class Filter:
    """The estimates, leg by leg.

    Errors are stored as a turn of the robot's world about the origin, and the remaining error of
    its place (a right-invariant filter). No tracker can see a common turn of all robots. In these
    terms it is the same for any estimate, so that the filter gains no false certainty.
    """

    def __init__(self, noise: Noise, start: Point, courses: list[float]) -> None:
        """Begin with the exactly known start and headings."""
        self._noise = noise
        self._mean = np.array([value for course in courses for value in (*start, course)])
        self._spread = np.zeros((len(self._mean), len(self._mean)))

    @property
    def known(self) -> PoseEstimates:
        """Return the present estimate."""
        return PoseEstimates(self._mean.copy(), self._spread.copy())

    def reckon(self, read: Array, leg: Leg) -> None:
        """Add the values of an odometer: turn, way ahead, way aside, drift of the heading."""
        i = 3 * leg.robot
        course = self._mean[i + 2] + read[0]
        cos, sin = math.cos(course), math.sin(course)
        step = np.array([cos * read[1] - sin * read[2], sin * read[1] + cos * read[2]])
        # the beginning of the step is its origin for the effect of the turn
        x, y = self._mean[i : i + 2]
        self._mean[i : i + 2] += step
        self._mean[i + 2] = course + read[3]
        east, north = self._mean[i : i + 2]
        by_read = np.array([[y, cos, -sin, north], [-x, sin, cos, -east], [1.0, 0.0, 0.0, 1.0]])
        own = slice(i, i + 3)
        self._spread[own, own] += by_read @ odometry_noise(self._noise, leg) @ by_read.T

    def watch(self, robot: int, watcher: int, measured: Array) -> None:
        """Add the other's place and heading, as a waiting robot measured them in its frame."""
        i, j = 3 * watcher, 3 * robot
        mean = self._mean
        cos, sin = math.cos(mean[i + 2]), math.sin(mean[i + 2])
        back = np.array([[cos, sin], [-sin, cos]])
        apart = back @ (mean[j : j + 2] - mean[i : i + 2])
        off = measured - np.array([*apart, mean[j + 2] - mean[i + 2]])
        off[2] = math.remainder(off[2], math.tau)
        rows = np.zeros((3, len(mean)))
        rows[:2, i : i + 2], rows[:2, j : j + 2] = -back, back
        rows[:2, j + 2] = back @ np.array([-mean[j + 1], mean[j]])
        rows[:2, i + 2] = -rows[:2, j + 2]
        rows[2, i + 2], rows[2, j + 2] = -1.0, 1.0
        across = self._spread @ rows.T
        noise = tracker_noise(self._noise, measured)
        gain = np.linalg.solve(rows @ across + noise, across.T).T
        self._correct(gain @ off)
        keep = np.eye(len(mean)) - gain @ rows
        # Joseph's form stays positive
        self._spread = keep @ self._spread @ keep.T + gain @ noise @ gain.T

    def _correct(self, by: Array) -> None:
        for i in range(0, len(by), 3):
            turn = by[i + 2]
            east, north = rotation(turn) @ self._mean[i : i + 2] + swing(turn) @ by[i : i + 2]
            self._mean[i : i + 3] = (east, north, self._mean[i + 2] + turn)


def rotation(angle_rad: float) -> Array:
    """Return the matrix of a counter-clockwise turn."""
    cos, sin = math.cos(angle_rad), math.sin(angle_rad)
    return np.array([[cos, -sin], [sin, cos]])


def swing(angle_rad: float) -> Array:
    """Return the result of a shift all through a turn: the mean of `rotation`.

    With it the exponential of a motion of the plane is exact: a turn on the spot moves nothing.
    """
    if abs(angle_rad) < _SMALL_RAD:
        return np.eye(2)
    ahead, aside = math.sin(angle_rad) / angle_rad, (1.0 - math.cos(angle_rad)) / angle_rad
    return np.array([[ahead, -aside], [aside, ahead]])


def odometry_noise(noise: Noise, leg: Leg) -> Array:
    """Return the covariance of the values of a leg: turn, ahead, aside, drift.

    The heading drifts all along the leg, so its drift and the way aside are correlated.
    """
    length, drift = leg.length_m, noise.drift_rad**2
    turn = noise.turn_rad**2 if abs(leg.turn_rad) > _STILL_M else 0.0
    found = np.diag([turn, noise.along_m**2 * length, drift * length**3 / 3.0, drift * length])
    found[2, 3] = found[3, 2] = drift * length**2 / 2.0
    return found


def tracker_noise(noise: Noise, apart: Array) -> Array:
    """Return the covariance of a measured place in the observer's frame, and of the heading."""
    away = math.hypot(apart[0], apart[1])
    ahead = np.array([apart[0], apart[1]]) / away if away > 0.0 else np.array([1.0, 0.0])
    aside = np.array([-ahead[1], ahead[0]])
    found = np.zeros((3, 3))
    found[:2, :2] = noise.range_m**2 * np.outer(ahead, ahead)
    found[:2, :2] += (noise.range_m**2 + (away * noise.bearing_rad) ** 2) * np.outer(aside, aside)
    found[2, 2] = noise.heading_rad**2
    return found


@dataclass(frozen=True, slots=True)
class Outcome:
    """The final estimates of robots, and their true places."""

    known: PoseEstimates
    truth: Array

    def error_m(self, robot: int) -> float:
        """Return the distance of a robot from its estimate, m."""
        place, _ = self.known.place(robot)
        return float(np.hypot(*(place - self.truth[3 * robot : 3 * robot + 2])))

    def sigma_m(self, robot: int) -> float:
        """Return its own estimate of that error: the root of the expected square, m."""
        return math.sqrt(float(np.trace(self.known.place(robot)[1])))

    def nees(self, robot: int) -> float:
        """Return the normalised estimation error squared of a robot's place and heading.

        For an honest filter it is distributed as chi square with 3 degrees of freedom.
        """
        i = 3 * robot
        x, y, heading = self.known.mean[i : i + 3]
        east, north, course = self.truth[i : i + 3]
        turn = math.remainder(course - heading, math.tau)
        shift = np.array([east, north]) - rotation(turn) @ np.array([x, y])
        off = np.array([*np.linalg.solve(swing(turn), shift), turn])
        return float(off @ np.linalg.solve(self.known.spread[i : i + 3, i : i + 3], off))

    def ellipse(self, robot: int) -> Ellipse:
        """Return the estimated place of a robot, as one standard deviation."""
        values, vectors = np.linalg.eigh(self.known.place(robot)[1])
        angle = math.degrees(math.atan2(vectors[1, 1], vectors[0, 1])) % 180.0
        minor, major = np.sqrt(np.maximum(values, 0.0))
        return Ellipse(float(major), float(minor), angle)


def followed(
    exploration: Exploration, noise: Noise, seed: int, *, legs: list[Leg] | None = None
) -> tuple[Outcome, Outcome]:
    """Return the end of an exploration with one draw of the noise: observed, and by odometry alone.

    Both read the same odometers. `legs` are those of the exploration, if they are known already.
    """
    legs = list(legs_of(exploration)) if legs is None else legs
    courses = first_courses(legs, exploration.robots)
    watched, alone = (Filter(noise, exploration.start, courses) for _ in range(2))
    odometers, trackers = (np.random.default_rng((seed, which)) for which in (0, 1))
    truth = watched.known.mean
    for leg in legs:
        i = 3 * leg.robot
        truth[i : i + 3] = (*leg.end, truth[i + 2] + leg.turn_rad)
        exact = np.array([leg.turn_rad, leg.length_m, 0.0, 0.0])
        # a covariance is singular if nothing was turned: its root is drawn part by part
        read = exact + _drawn(odometry_noise(noise, leg), odometers)
        watched.reckon(read, leg)
        alone.reckon(read, leg)
        if leg.watcher is not None:
            off = trackers.standard_normal(3)
            measured = _measured(noise, truth, leg, off)
            watched.watch(leg.robot, leg.watcher, measured)
    return Outcome(watched.known, truth), Outcome(alone.known, truth)


def _drawn(covariance: Array, rng: np.random.Generator) -> Array:
    values, vectors = np.linalg.eigh(covariance)
    root = vectors * np.sqrt(np.maximum(values, 0.0))
    return np.asarray(root @ rng.standard_normal(len(covariance)))


def _measured(noise: Noise, truth: Array, leg: Leg, off: Array) -> Array:
    """Return the measurements of the observer, with errors of `off` standard deviations."""
    assert leg.watcher is not None
    i, j = 3 * leg.watcher, 3 * leg.robot
    cos, sin = math.cos(truth[i + 2]), math.sin(truth[i + 2])
    apart = np.array([[cos, sin], [-sin, cos]]) @ (truth[j : j + 2] - truth[i : i + 2])
    exact = np.array([apart[0], apart[1], truth[j + 2] - truth[i + 2]])
    return np.asarray(exact + np.linalg.cholesky(tracker_noise(noise, exact)) @ off)
