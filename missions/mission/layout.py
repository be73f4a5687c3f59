"""The layout of a mission on the ground: its grid, fence, lanes and pads."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache, cached_property, partial

from missions.geo.fence import Fence
from missions.geo.grid import Grid
from missions.geo.terrain import Terrain
from missions.mission.energy import EnergyModel, energy_model
from missions.mission.flyable import look_s
from missions.mission.places import drawn, home_heights_m, homes, prior_of
from missions.mission.schema import Mission, positions
from missions.mission.views import DRAG_1_S, G_M_S2, path_speed_m_s, seen_whole_m, wind_toward
from missions.planning.search.lanes import LANE_CELLS, Lane
from missions.planning.search.prior import LikelyLane, likely_lanes
from missions.planning.search.strip import Strip
from missions.planning.stepwise.interface import Metric
from missions.planning.stepwise.rdfs import drift_factor
from missions.planning.sweep.paths import Kinematics
from missions.units import Cell, GridPoint


@dataclass(frozen=True)
class Layout:
    """A mission file in coordinates of the ground."""

    mission: Mission
    grid: Grid
    fence: Fence
    lanes: tuple[Lane, ...]
    member: int | None = None
    """Number of the only commanded vehicle, 0 for a fleet without any; None commands all."""
    east_ahead: bool = True
    """True if vehicles that do not stop point along grid east, else along north."""
    lane_rows: int = LANE_CELLS
    """Number of rows of cells that a lane decides."""
    lanes_drift: bool = False
    """True if lanes drift with the cells; else they are fixed over ground."""
    whole_fence: Fence | None = None
    """A member's fence without the columns over others' pads, which are holes of `fence`."""

    @cached_property
    def energy(self) -> EnergyModel:
        """The model of battery and wind."""
        return energy_model(self.mission)

    @property
    def ground(self) -> Terrain | None:
        """Ground below the layers; None means flat ground at the level of the start."""
        return self.mission.ground

    @cached_property
    def likely(self) -> tuple[LikelyLane, ...]:
        """Lanes with their weight in the prior; empty without a prior."""
        prior = prior_of(self.mission, self.grid) if self.lanes else ()
        if not prior:
            return ()
        box = [self.grid.fixed(place) for place in positions(self.mission.search.box)]
        return likely_lanes(self.lanes, box, prior, self.grid.cell_m, self.lane_rows)

    @cached_property
    def path_speed_m_s(self) -> Callable[[float, float], float]:
        """Speed of paths in the frame of the region by height and measured wind, m/s."""
        return cache(partial(path_speed_m_s, self.mission))

    @cached_property
    def seen_whole_m(self) -> Callable[[float], tuple[float, float]]:
        """Distance east and north of the middle of a picture up to which cells are whole, by
        height, m."""
        return cache(partial(seen_whole_m, self.mission, east_ahead=self.east_ahead))

    def kinematics(self, height_m: float, wind_m_s: float) -> Kinematics:
        """Return the kinematics and view of a vehicle at a height in a measured wind, along the
        grid."""
        mission, grid = self.mission, self.grid
        half_east_m, half_north_m = self.seen_whole_m(height_m)
        fixed = mission.camera.mounting == "fixed"
        wind_east, wind_north = self.wind_m_s
        return Kinematics(
            speed_m_s=self.path_speed_m_s(height_m, wind_m_s),
            accel_m_s2=self.energy.accel_m_s2,
            frame_s=mission.camera.interval_s,
            half_east_m=max(half_east_m, 0.1),
            half_north_m=max(half_north_m, 0.1),
            tilt_m_s2=height_m / G_M_S2 if fixed else 0.0,
            drag_1_s=DRAG_1_S,
            wind_east_m_s=wind_east - grid.drift_east_m_s,  # relative to the region
            wind_north_m_s=wind_north - grid.drift_north_m_s,
        )

    @cached_property
    def wind_m_s(self) -> tuple[float, float]:
        """Wind of the mission file: its direction of motion along grid east and north, m/s."""
        return wind_toward(self.mission, self.grid)

    def pad_of(self, number: int) -> GridPoint:
        """Return the position of a vehicle's pad in the mission file."""
        return self.pads[number - 1]

    def home_level_m(self, number: int) -> float:
        """Return the height of a vehicle's home above the origin of its layers, m."""
        return 0.0 if self.ground is not None else home_heights_m(self.mission)[number - 1]

    @cached_property
    def pads(self) -> tuple[GridPoint, ...]:
        """Positions of the vehicles' pads in the mission file."""
        return tuple(self.grid.fixed(place) for place in homes(self.mission))

    @property
    def relief_m(self) -> float:
        """Height of the ground below straight returns, from lowest to highest, m."""
        return self.mission.ground_span_m

    def ups_and_downs_m(self, points: Sequence[GridPoint]) -> float:
        """Return the ups and downs of a way, as metres of climbing."""
        if self.ground is None:
            return 0.0
        return self.ground.ups_and_downs_m(points, self.energy.speed_m_s, self.energy.climb_m_s)

    def where(self, cell: Cell, t_s: float) -> GridPoint:
        """Return the centre of a cell at a time, in the fixed frame."""
        return self.grid.to_fixed(self.grid.centre_of(cell), t_s)

    @cached_property
    def whole_lanes(self) -> frozenset[Lane]:
        """The lanes as planned, in either direction."""
        return frozenset(each for lane in self.lanes for each in (lane, (lane[1], lane[0])))

    @property
    def aimed_lanes(self) -> frozenset[Lane]:
        """The whole lanes where a prior has chosen their directions; else none."""
        return self.whole_lanes if self.likely else frozenset()

    def lane_time_s(self, t_s: float) -> float:
        """Return the time for which lanes are planned, in the frame of the cells."""
        return 0.0 if self.lanes_drift else t_s

    def to_lanes(self, place: GridPoint, t_s: float) -> GridPoint:
        """Return a place over ground at a time in the frame of the lanes."""
        return self.grid.to_moving(place, t_s - self.lane_time_s(t_s))

    def over_ground(self, place: GridPoint, t_s: float) -> GridPoint:
        """Return a place in the frame of the lanes over ground: the inverse of `to_lanes`."""
        return self.grid.to_fixed(place, t_s - self.lane_time_s(t_s))

    def strip(self, lane: Lane, t_s: float) -> Strip:
        """Return the cells that a lane decides, as they lie at a time."""
        return Strip.along_lane(self.grid, lane, self.lane_rows, self.lane_time_s(t_s))

    @cached_property
    def box_cells(self) -> tuple[Cell, ...]:
        """The cells whose centre lies in the search box, at mission time 0."""
        return tuple(self.grid.cells_in(drawn(self.mission.search.box, self.grid)))

    @cached_property
    def in_box(self) -> frozenset[Cell]:
        """The same as a set."""
        return frozenset(self.box_cells)

    @property
    def yaw_deg(self) -> float:
        """True bearing of the noses of vehicles that do not stop, degrees."""
        grid_deg = 90.0 if self.east_ahead else 0.0
        return (grid_deg + math.degrees(self.grid.convergence_rad)) % 360.0

    @property
    def metric(self) -> Metric:
        """Cost of a leg between two cells in seconds, in the frame of the region.

        A vehicle flies straight from rest to rest. An observation costs its frames. The other parts
        of `look_s` are reserved in the battery, and seldom needed.
        """
        grid, votes = self.grid, self.mission.votes
        return Metric(
            self.mission.flight.speed_m_s / grid.cell_m,
            grid.drift_east_m_s / grid.cell_m,
            grid.drift_north_m_s / grid.cell_m,
            straight=True,
            look=votes.frames * self.mission.camera.interval_s,
            ramp=self.energy.leg_s(0.0),
        )

    def moves_s(self, moves: float) -> float:
        """Return a bound in moves of an exploration with stops as a bound in seconds.

        A move takes at most a leg between two cells. Tours are closed and each vertex is visited
        once, so at most every second move ends with an observation. The root has one more.
        """
        move_s = self.energy.leg_s(self.grid.cell_m) + self.look_s / 2.0
        factor = drift_factor(self.mission.flight.speed_m_s, self.mission.drift.speed_m_s)
        return moves * move_s * factor + self.look_s

    @property
    def look_s(self) -> float:
        """Time that a vehicle hovers over a cell, about, s."""
        return look_s(self.mission)
