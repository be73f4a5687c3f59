"""The errors of the reported places of two vehicles, while one tracks the other.

Without satellites an autopilot reports a place by dead reckoning. Its error grows with the way: by
a scale and a rotation of the odometer, constant for an outage, and by a wander. A Kalman filter
follows both errors at once, by three measurements:

    reported  the way that each reports to have flown: its error changes with that
    sighted   the tracker's view of the mapper: the difference of both errors
    held      the drift over ground of a hovering vehicle since it stopped, as its pictures show:
              the change of its own error since then

The place of both together is not measured: it gets worse with each hop, not each metre.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from missions.planning.leapfrog_geometry import Role

Array = NDArray[np.float64]

_EACH: Final = 6  # error east and north, scale, rotation, error east and north when it stopped
_INDEX: Final = {Role.MAPPER: 0, Role.TRACKER: _EACH}
_HEADING: Final = 2 * _EACH
_MOUNT: Final = 2 * _EACH + 1
_STATES: Final = 2 * _EACH + 3
_GATE: Final = 20.0
"""Limit for two measured numbers, as chi square: by chance one in 20,000 is larger."""


@dataclass(frozen=True, slots=True)
class OffsetNoise:
    """Standard deviations of the filter's inputs: at least 0, `start_m` above 0.

    Attributes:
        start_m: Error of a place reported by satellites, in each direction.
        odometer: Errors of the odometer's scale and of its rotation, in radians: share of the
            distance.
        changing: Additional, varying error, as a share of the speed.
        wander_m_s: The same at rest.
        wander_s: Time over which such an error lasts.
        heading_rad: Error of the heading of the tracker's camera: how well north is known.
        mount_rad: Constant error of the tilt of the tracker's camera. It shifts all sightings
            alike, so hops are not wrong by it.
        alike_s: Time over which the errors of sightings are alike: the attitude's, mostly.
    """

    start_m: float = 0.3
    odometer: float = 0.02
    changing: float = 0.003
    wander_m_s: float = 0.02
    wander_s: float = 5.0
    heading_rad: float = math.radians(1.0)
    mount_rad: float = math.radians(0.5)
    alike_s: float = 2.0


class Offsets:
    """Errors of both reported places: reported less true, metres along the grid's axes.

    >>> both = Offsets()
    >>> both.add_move(Role.MAPPER, (10.0, 0.0), 5.0)
    >>> both.add_sighting((10.0, 0.0), (9.8, 0.0), np.eye(2) * 1e-4, 10.0)
    True
    >>> round(both.off(Role.MAPPER)[0] - both.off(Role.TRACKER)[0], 2)
    0.2
    """

    def __init__(self, noise: OffsetNoise = OffsetNoise()) -> None:
        self._noise = noise
        self.mean: Array = np.zeros(_STATES)
        """Errors of the mapper, then the tracker: error (2), scale, rotation, error when it stopped
        (2).

        Then the heading error of the tracker's camera, counter-clockwise; last its tilt (2).
        """
        self.spread: Array = np.zeros((_STATES, _STATES))
        self.spread[_HEADING, _HEADING] = noise.heading_rad**2
        self.spread[_MOUNT, _MOUNT] = self.spread[_MOUNT + 1, _MOUNT + 1] = noise.mount_rad**2
        for role in Role:
            self.restart(role)

    def off(self, role: Role) -> tuple[float, float]:
        """Return the error of a reported place, east and north."""
        i = _INDEX[role]
        return float(self.mean[i]), float(self.mean[i + 1])

    def covariance(self, role: Role) -> Array:
        """Return the covariance of that, (2, 2), m^2."""
        i = _INDEX[role]
        return self.spread[i : i + 2, i : i + 2].copy()

    def sigma_m(self, role: Role) -> float:
        """Return its largest standard deviation, m."""
        return math.sqrt(max(float(np.linalg.eigvalsh(self.covariance(role))[-1]), 0.0))

    # --- what is measured ------------------------------------------------------------------------
    def restart(self, role: Role) -> None:
        """Reset: its place is reported by satellites, and has only their error."""
        i, noise = _INDEX[role], self._noise
        own = slice(i, i + _EACH)
        self.mean[own] = 0.0
        self.spread[own, :] = 0.0
        self.spread[:, own] = 0.0
        for k in (0, 1):
            self.spread[i + k, i + k] = noise.start_m**2
            self.spread[i + 2 + k, i + 2 + k] = noise.odometer**2

    def add_move(self, role: Role, reported_m: tuple[float, float], passed_s: float) -> None:
        """Add its reported movement, east and north, in a time of at least 0 s."""
        i, noise = _INDEX[role], self._noise
        east, north = reported_m
        step = np.eye(_STATES)
        step[i, i + 2], step[i + 1, i + 2] = east, north
        step[i, i + 3], step[i + 1, i + 3] = -north, east
        self.mean = step @ self.mean
        self.spread = step @ self.spread @ step.T
        speed_m_s = math.hypot(east, north) / passed_s if passed_s > 0.0 else 0.0
        errs_m_s = noise.wander_m_s + noise.changing * speed_m_s
        grown = 2.0 * noise.wander_s * errs_m_s**2 * passed_s
        self.spread[i, i] += grown
        self.spread[i + 1, i + 1] += grown

    def add_sighting(
        self,
        reported_m: tuple[float, float],
        seen_m: tuple[float, float],
        covariance_m2: Array,
        after_s: float,
        tilts_m: Array | None = None,
    ) -> bool:
        """Add a sighting of the mapper by the tracker.

        Args:
            reported_m: From the tracker to the mapper by both reported places at the exposure.
            seen_m: The same as the picture shows it, by the camera's reported heading.
            covariance_m2: (2, 2), of `seen_m`, without the heading's error.
            after_s: Time since the sighting before; errors of close sightings are alike.
            tilts_m: (2, 2), apparent movement of the mapper east and north (rows), m, per radian of
                camera tilt to the picture's right and downwards (columns). None: the camera is
                tilted as reported.

        Returns:
            False if it is rejected: it is farther off than chance explains.
        """
        rows = np.zeros((2, _STATES))
        for role, sign in ((Role.MAPPER, 1.0), (Role.TRACKER, -1.0)):
            rows[0, _INDEX[role]] = rows[1, _INDEX[role] + 1] = sign
        rows[:, _HEADING] = -seen_m[1], seen_m[0]
        if tilts_m is not None:
            rows[:, _MOUNT:] = -tilts_m
        alike = max(1.0, self._noise.alike_s / max(after_s, 1e-3))
        measured = np.array(reported_m) - np.array(seen_m)
        return self._correct(rows, measured, np.asarray(covariance_m2) * alike)

    def start_hover(self, role: Role) -> None:
        """Start a hover: `held` compares with the present place."""
        i = _INDEX[role]
        copy = np.eye(_STATES)
        for k in (0, 1):
            copy[i + 4 + k, :] = 0.0
            copy[i + 4 + k, i + k] = 1.0
        self.mean = copy @ self.mean
        self.spread = copy @ self.spread @ copy.T

    def held(
        self,
        role: Role,
        reported_m: tuple[float, float],
        seen_m: tuple[float, float],
        sigma_m: float,
    ) -> bool:
        """Add its movement since `stopped`, as reported and as the ground shows it.

        `sigma_m`, above 0, is that of each direction. False if the measurement is rejected.
        """
        i = _INDEX[role]
        rows = np.zeros((2, _STATES))
        for k in (0, 1):
            rows[k, i + k], rows[k, i + 4 + k] = 1.0, -1.0
        measured = np.array(reported_m) - np.array(seen_m)
        return self._correct(rows, measured, np.eye(2) * sigma_m**2)

    def _correct(self, rows: Array, measured: Array, noise: Array) -> bool:
        across = self.spread @ rows.T
        expected = rows @ across + noise
        left = measured - rows @ self.mean
        if float(left @ np.linalg.solve(expected, left)) > _GATE:
            return False
        gain = np.linalg.solve(expected, across.T).T
        keep = np.eye(_STATES) - gain @ rows
        self.mean = self.mean + gain @ left
        self.spread = keep @ self.spread @ keep.T + gain @ noise @ gain.T
        return True
