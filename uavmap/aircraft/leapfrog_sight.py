"""Two vehicles that look after each other: where both are, by what one sees of the other.

    tracker's frame -> marker of the mapper -> difference of both errors
    who hovers      -> ground as when it stopped -> how far it was moved
    telemetry       -> way that it tells to have flown
                       all -> by how much each told place is off -> navigation -> view.off_deg

`missions.flight.strategy.leapfrog` says who moves when; here is what is measured meanwhile.
While satellites are good a sighting only shows whether they are.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import NDArray

from missions.mission.schema import NavigationSection
from missions.planning.leapfrog_geometry import Role
from missions.planning.leapfrog_offsets import Offsets
from missions.units import GridPoint, Quaternion
from uavmap.aircraft.reporter import Reporter
from uavmap.mavlink.position_history import Attitudes
from uavmap.mavlink.vehicle_view import VehicleView
from vision.camera import euler, rotation
from vision.markers import Carrier, Sighting, SightingErrors, find_tags, sight
from vision.own_map.ground_match import match
from vision.own_map.ground_patch import Patch, patch
from vision.projection import Frame

if TYPE_CHECKING:
    from uavmap.mavlink.session import Message

HOVERS_M_S: Final = 0.4
"""Who tells to be slower hovers."""
STRAYS_M: Final = 1.5
"""Who is farther from where it stopped hovers elsewhere."""
SEARCH_M: Final = 1.0
"""So far off a hovering vehicle's told place may be since it stopped."""
HELD_RAD: Final = math.radians(0.1)
"""By how much the attitude's error changes while a vehicle hovers."""
ERRORS: Final = SightingErrors(tilt_rad=math.radians(0.2), heading_rad=math.radians(0.1))
"""Of the camera from one picture to the next; errors that stay are unknowns of their own."""
TOLD_TILT_RAD: Final = math.radians(1.5)
"""How well the mapper's telemetry tells its tilt at the exposure."""
TIMING_S: Final = 0.03
"""How well exposure and telemetry of both agree in time: what moves is seen that far off."""
LOOK_S: Final = 0.9
"""Between two looks for the marker: sightings soon after each other err alike."""
GAP_S: Final = 0.5
"""Telemetry that is farther from the exposure does not say where the mapper was."""
APART_TIMES: Final = 5
"""So many sightings in a row have to contradict satellites."""
BY_SATELLITES_M: Final = 1.0
"""Two places told by satellites may differ by so much beside what a sighting errs by."""


class Member:
    """One of the two, as `uavmap.aircraft.map_navigation` asks it."""

    def __init__(self, leapfrog: Leapfrog, role: Role) -> None:
        self._leapfrog, self._role = leapfrog, role

    @property
    def off(self) -> GridPoint:
        """By how much its told place is off."""
        return GridPoint(*self._leapfrog.offsets.off(self._role))

    @property
    def sigma_m(self) -> float:
        """How well that is known."""
        return self._leapfrog.offsets.sigma_m(self._role)

    def moved(self, told: GridPoint, now_s: float, *, good: bool) -> None:
        """It tells its place; `good`: by satellites."""
        self._leapfrog.moved(self._role, told, now_s, good=good)

    def take(self, frame: Frame) -> None:
        """It took a picture, with the pose as told."""
        self._leapfrog.take(self._role, frame)


@dataclass(slots=True)
class _Half:
    """What is remembered of one vehicle."""

    reporter: Reporter
    view: VehicleView
    attitudes: Attitudes = field(default_factory=Attitudes)
    good: bool = True
    told: GridPoint | None = None
    told_s: float = 0.0
    ground: Patch | None = None
    """As it saw it when it stopped..."""
    stopped_at: GridPoint | None = None
    """... and where it then told to be."""
    framed_s: float = float("-inf")

    def leave(self) -> None:
        """It does not hover any more."""
        self.ground = self.stopped_at = None

    def on_message(self, message: Message) -> None:
        """Note how it is tilted."""
        if message.get_type() == "ATTITUDE":
            turned = Quaternion.from_euler(message.roll, message.pitch, message.yaw)
            self.attitudes.take(message.time_boot_ms / 1000.0, turned)


class Leapfrog:
    """What both vehicles measure of each other. `say` tells the operator a line."""

    def __init__(self, wanted: NavigationSection, say: Callable[[str], None]) -> None:
        self._wanted, self._say = wanted, say
        self.offsets = Offsets()
        self._halves: dict[Role, _Half] = {}
        self._sighted_s = float("-inf")
        self._looked_s = float("-inf")
        self._apart = 0

    def join(
        self,
        role: Role,
        reporter: Reporter,
        view: VehicleView,
        listen: Callable[[Callable[[Message], None]], None],
    ) -> Member:
        """Take part, with a vehicle's telemetry."""
        half = _Half(reporter, view)
        self._halves[role] = half
        listen(half.on_message)
        return Member(self, role)

    def moved(self, role: Role, told: GridPoint, now_s: float, *, good: bool) -> None:
        """A vehicle tells its place."""
        half = self._halves[role]
        before, before_s = half.told, half.told_s
        half.told, half.told_s = told, now_s
        if good or half.good or before is None:
            self.offsets.restart(role)
            half.leave()
        else:
            way = (told.east_m - before.east_m, told.north_m - before.north_m)
            self.offsets.moved(role, way, max(now_s - before_s, 0.0))
        half.good = good
        strays = half.stopped_at is not None and told.distance_to(half.stopped_at) > STRAYS_M
        if strays or half.view.ground_speed_m_s > 2.0 * HOVERS_M_S:
            half.leave()

    def take(self, role: Role, frame: Frame) -> None:
        """A vehicle took a picture."""
        half = self._halves[role]
        if frame.t_s <= half.framed_s:  # one that comes late says nothing of now
            return
        half.framed_s = frame.t_s
        due = frame.t_s - self._looked_s >= LOOK_S
        if role is Role.TRACKER and len(self._halves) == len(Role) and due:
            self._looked_s = frame.t_s
            self._look_for_mapper(half, frame)
        if not half.good and half.view.ground_speed_m_s <= HOVERS_M_S:
            self._hold_against_ground(role, half, frame)

    # --- the other one -----------------------------------------------------------------------
    def _look_for_mapper(self, tracker: _Half, frame: Frame) -> None:
        mapper = self._halves[Role.MAPPER]
        number = mapper.reporter.number
        tags = find_tags(frame.image, self._wanted.tag_dictionary)
        found = next((tag for tag in tags if tag.tag_id == number), None)
        loop_s = tracker.reporter.loop_s() - (tracker.reporter.now_s() - frame.t_s)
        place = mapper.view.place_at(loop_s)
        if found is None or place is None or place.gap_s > GAP_S:
            return
        seen = sight(
            found, frame.camera, frame.pose.attitude, self._wanted.tag_m,
            self._carrier(mapper, loop_s), ERRORS,
        )  # fmt: skip
        if seen is None:
            return
        grid = tracker.reporter.grid
        there, here = grid.fixed(place.position), grid.fixed(frame.pose.position)
        told = (there.east_m - here.east_m, there.north_m - here.north_m)
        late_m = TIMING_S * (tracker.view.ground_speed_m_s + mapper.view.ground_speed_m_s)
        tilts = _tilts_m(frame, -seen.up_m, grid.convergence_rad)
        self._compare(frame.t_s, told, seen, grid.convergence_rad, late_m, tilts)

    def _compare(
        self,
        t_s: float,
        told: tuple[float, float],
        seen: Sighting,
        up_rad: float,
        late_m: float,
        tilts_m: NDArray[np.float64],
    ) -> None:
        """Hold a sighting against what both tell."""
        cos, sin = math.cos(up_rad), math.sin(up_rad)
        apart = (seen.east_m * cos - seen.north_m * sin, seen.east_m * sin + seen.north_m * cos)
        if not all(half.good for half in self._halves.values()):
            # the grid is turned by a degree or two: a covariance is about the same along its axes
            covariance = seen.covariance_m2[:2, :2] + late_m**2 * np.eye(2)
            after_s = t_s - self._sighted_s
            if self.offsets.sighted(told, apart, covariance, after_s, tilts_m):
                self._sighted_s = t_s
            return
        off_m = math.dist(told, apart)
        self._apart = self._apart + 1 if off_m > self._wanted.tolerated_m + BY_SATELLITES_M else 0
        if self._apart == APART_TIMES:
            number = self._halves[Role.MAPPER].reporter.number
            self._say(
                f"vehicle {number} is seen {off_m:.1f} m from where both tell it to be: satellites "
                "or navigation.tag_m are wrong"
            )

    def _carrier(self, mapper: _Half, loop_s: float) -> Carrier:
        """How the mapper was tilted, as far as it has said."""
        turned = mapper.attitudes.at(loop_s - (mapper.view.boot_offset_s or 0.0))
        if turned is None:
            return Carrier()
        roll, pitch, _ = euler(turned)
        return Carrier(roll, pitch, TOLD_TILT_RAD)

    # --- the ground ----------------------------------------------------------------------------
    def _hold_against_ground(self, role: Role, half: _Half, frame: Frame) -> None:
        grid = half.reporter.grid
        ground, here = patch(frame, up_rad=grid.convergence_rad), grid.fixed(frame.pose.position)
        if ground is None:
            return
        if half.ground is None or half.stopped_at is None:
            half.ground, half.stopped_at = ground, here
            self.offsets.stopped(role)
            return
        told = (here.east_m - half.stopped_at.east_m, here.north_m - half.stopped_at.north_m)
        if not math.isclose(ground.metres_per_pixel, half.ground.metres_per_pixel):
            return
        found = match(half.ground, ground, told, SEARCH_M)
        if found is not None:
            sigma_m = math.hypot(found.sigma_m, frame.pose.height_m * math.tan(HELD_RAD))
            self.offsets.held(role, told, found.moved_m, sigma_m)


def _tilts_m(frame: Frame, below_m: float, up_rad: float) -> NDArray[np.float64]:
    """How far what lies so much lower seems to move, along the grid's axes, by a radian of tilt.

    Columns: to the right and downwards in the picture.
    """
    north_east = rotation(frame.pose.attitude)[:2, 1:]
    cos, sin = math.cos(up_rad), math.sin(up_rad)
    to_grid = np.array([[-sin, cos], [cos, sin]])  # from north and east to east and north
    return np.asarray(below_m * to_grid @ north_east, dtype=np.float64)
