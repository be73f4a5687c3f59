"""Two vehicles that observe each other: the positions of both, by one's view of the other.

    tracker's frame    -> marker of the mapper -> difference of both errors
    hovering vehicle   -> ground as when it stopped -> its drift
    telemetry          -> its reported way
                       all -> error of each reported place -> navigation -> view.off_deg

`missions.flight.strategy.leapfrog` decides on moves; this module has the measurements. While
satellites are good a sighting only shows whether they are.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from missions.mission.schema import NavigationSection
from missions.planning.leapfrog_geometry import Role
from missions.planning.leapfrog_offsets import Offsets
from missions.units import GridPoint
from uavmap.aircraft.reporter import Reporter
from vision.camera import euler, rotation
from vision.markers import Carrier, Sighting, SightingErrors, find_tags, sight
from vision.own_map.ground_match import match
from vision.own_map.ground_patch import Patch, patch
from vision.projection import Frame

HOVERS_M_S: Final = 0.4
"""Reported speed below which a vehicle hovers, m/s."""
STRAYS_M: Final = 1.5
"""Distance from its stop beyond which a vehicle hovers elsewhere, m."""
SEARCH_M: Final = 1.0
"""Maximum error of a hovering vehicle's reported place since it stopped, m."""
HOVER_TILT_CHANGE_RAD: Final = math.radians(0.1)
"""Change of the attitude's error while a vehicle hovers, rad."""
ERRORS: Final = SightingErrors(tilt_rad=math.radians(0.2), heading_rad=math.radians(0.1))
"""Errors of the camera from one picture to the next; constant errors are unknowns of their own."""
REPORTED_TILT_RAD: Final = math.radians(1.5)
"""Standard deviation of the mapper's reported tilt at the exposure, rad."""
TIMING_S: Final = 0.03
"""Difference in time of exposure and telemetry, s: the error of a moving vehicle's sighting."""
SEARCH_INTERVAL_S: Final = 0.9
"""Interval between two searches for the marker, s: close sightings err alike."""
MAX_TELEMETRY_GAP_S: Final = 0.5
"""Maximum gap between telemetry and exposure for the mapper's place, s."""
CONTRADICTIONS: Final = 5
"""Number of sightings in a row that must contradict satellites."""
MAX_SATELLITE_DIFFERENCE_M: Final = 1.0
"""Allowed difference of two places by satellites besides a sighting's error, m."""


@dataclass(slots=True)
class Member:
    """One of the two, for `uavmap.aircraft.map_navigation`, with its memory."""

    leapfrog: Leapfrog
    role: Role
    reporter: Reporter
    good: bool = True
    reported: GridPoint | None = None
    reported_s: float = 0.0
    ground: Patch | None = None
    """Picture of the ground when it stopped."""
    stopped_at: GridPoint | None = None
    """Reported place at that time."""
    framed_s: float = float("-inf")

    @property
    def off(self) -> GridPoint:
        """Error of its reported place."""
        return GridPoint(*self.leapfrog.offsets.off(self.role))

    @property
    def sigma_m(self) -> float:
        """Standard deviation of that, m."""
        return self.leapfrog.offsets.sigma_m(self.role)

    def add_move(self, reported: GridPoint, now_s: float, *, good: bool) -> None:
        """Note its reported place; `good`: by satellites."""
        before, before_s = self.reported, self.reported_s
        self.reported, self.reported_s = reported, now_s
        if good or self.good or before is None:
            self.leapfrog.offsets.restart(self.role)
            self._leave()
        else:
            way = (reported.east_m - before.east_m, reported.north_m - before.north_m)
            self.leapfrog.offsets.add_move(self.role, way, max(now_s - before_s, 0.0))
        self.good = good
        strays = self.stopped_at is not None and reported.distance_to(self.stopped_at) > STRAYS_M
        if strays or self.reporter.view.ground_speed_m_s > 2.0 * HOVERS_M_S:
            self._leave()

    def add_frame(self, frame: Frame) -> None:
        """Use its picture, with the pose as reported."""
        if frame.t_s <= self.framed_s:  # a late one does not show the present state
            return
        self.framed_s = frame.t_s
        self.leapfrog.look_for_mapper(self, frame)
        if not self.good and self.reporter.view.ground_speed_m_s <= HOVERS_M_S:
            self._hold_against_ground(frame)

    def _leave(self) -> None:
        self.ground = self.stopped_at = None

    def _hold_against_ground(self, frame: Frame) -> None:
        grid = self.reporter.grid
        ground, here = patch(frame, up_rad=grid.convergence_rad), grid.fixed(frame.pose.position)
        if ground is None:
            return
        if self.ground is None or self.stopped_at is None:
            self.ground, self.stopped_at = ground, here
            self.leapfrog.offsets.start_hover(self.role)
            return
        reported = (here.east_m - self.stopped_at.east_m, here.north_m - self.stopped_at.north_m)
        if not math.isclose(ground.metres_per_pixel, self.ground.metres_per_pixel):
            return
        found = match(self.ground, ground, reported, SEARCH_M)
        if found is not None:
            sigma_m = math.hypot(
                found.sigma_m, frame.pose.height_m * math.tan(HOVER_TILT_CHANGE_RAD)
            )
            self.leapfrog.offsets.held(self.role, reported, found.moved_m, sigma_m)


class Leapfrog:
    """The measurements of both vehicles of each other; `say` logs a line."""

    def __init__(self, wanted: NavigationSection, say: Callable[[str], None]) -> None:
        self._wanted, self._log = wanted, say
        self.offsets = Offsets()
        self._members: dict[Role, Member] = {}
        self._sighted_s = float("-inf")
        self._looked_s = float("-inf")
        self._apart = 0

    def join(self, role: Role, reporter: Reporter) -> Member:
        """Take part, with a vehicle's telemetry."""
        member = self._members[role] = Member(self, role, reporter)
        return member

    def look_for_mapper(self, tracker: Member, frame: Frame) -> None:
        """Search the mapper in a picture of the tracker, at intervals."""
        due = frame.t_s - self._looked_s >= SEARCH_INTERVAL_S
        if tracker.role is not Role.TRACKER or len(self._members) < len(Role) or not due:
            return
        self._looked_s = frame.t_s
        mapper = self._members[Role.MAPPER]
        number = mapper.reporter.number
        tags = find_tags(frame.image, self._wanted.tag_dictionary)
        found = next((tag for tag in tags if tag.tag_id == number), None)
        loop_s = tracker.reporter.loop_s() - (tracker.reporter.now_s() - frame.t_s)
        place = mapper.reporter.view.place_at(loop_s)
        if found is None or place is None or place.gap_s > MAX_TELEMETRY_GAP_S:
            return
        seen = sight(
            found, frame.camera, frame.pose.attitude, self._wanted.tag_m,
            self._carrier(mapper, loop_s), ERRORS,
        )  # fmt: skip
        if seen is None:
            return
        grid = tracker.reporter.grid
        there, here = grid.fixed(place.position), grid.fixed(frame.pose.position)
        reported = (there.east_m - here.east_m, there.north_m - here.north_m)
        late_m = TIMING_S * (
            tracker.reporter.view.ground_speed_m_s + mapper.reporter.view.ground_speed_m_s
        )
        tilts = _tilts_m(frame, -seen.up_m, grid.convergence_rad)
        self._compare(frame.t_s, reported, seen, grid.convergence_rad, late_m, tilts)

    def _compare(
        self,
        t_s: float,
        reported: tuple[float, float],
        seen: Sighting,
        up_rad: float,
        late_m: float,
        tilts_m: NDArray[np.float64],
    ) -> None:
        """Compare a sighting with both reports."""
        cos, sin = math.cos(up_rad), math.sin(up_rad)
        apart = (seen.east_m * cos - seen.north_m * sin, seen.east_m * sin + seen.north_m * cos)
        if not all(member.good for member in self._members.values()):
            # the grid is turned by a degree or two: a covariance is nearly the same along its axes
            covariance = seen.covariance_m2[:2, :2] + late_m**2 * np.eye(2)
            after_s = t_s - self._sighted_s
            if self.offsets.add_sighting(reported, apart, covariance, after_s, tilts_m):
                self._sighted_s = t_s
            return
        off_m = math.dist(reported, apart)
        self._apart = (
            self._apart + 1 if off_m > self._wanted.tolerated_m + MAX_SATELLITE_DIFFERENCE_M else 0
        )
        if self._apart == CONTRADICTIONS:
            number = self._members[Role.MAPPER].reporter.number
            self._log(
                f"vehicle {number} is seen {off_m:.1f} m from its place by both reports: "
                "satellites or navigation.tag_m are wrong"
            )

    def _carrier(self, mapper: Member, loop_s: float) -> Carrier:
        """Return the tilt of the mapper, as far as it has reported it."""
        turned = mapper.reporter.view.attitude_at(loop_s)
        if turned is None:
            return Carrier()
        roll, pitch, _ = euler(turned)
        return Carrier(roll, pitch, REPORTED_TILT_RAD)


def _tilts_m(frame: Frame, below_m: float, up_rad: float) -> NDArray[np.float64]:
    """Return how far ground `below_m` lower seems to move by a radian of tilt, along the grid's
    axes.

    Columns: to the right and downwards in the picture.
    """
    north_east = rotation(frame.pose.attitude)[:2, 1:]
    cos, sin = math.cos(up_rad), math.sin(up_rad)
    to_grid = np.array([[-sin, cos], [cos, sin]])  # from north and east to east and north
    return np.asarray(below_m * to_grid @ north_east, dtype=np.float64)
