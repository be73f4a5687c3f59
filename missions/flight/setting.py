"""What a mission is given and does not change: the mission file, laid out on the ground."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property

from shapely.geometry import Point, Polygon

from missions.geo.columns import columns_over, fence_without
from missions.geo.fence import Fence
from missions.geo.grid import Grid
from missions.geo.terrain import Terrain
from missions.geo.trajectory import LANE_CUTS_M, corner_pause_s
from missions.mission.energy import CLIMB_OVERHEAD_S, EnergyModel
from missions.mission.flyable import fence_of, look_s
from missions.mission.places import home_heights_m, homes, prior_of
from missions.mission.schema import Mission, positions
from missions.mission.views import energy_model, path_speed_m_s, rows_across
from missions.planning.search.lanes import (
    LANE_CELLS,
    Lane,
    along_east,
    lanes,
    longest_m,
    share_by_time,
    share_out,
)
from missions.planning.search.prior import LikelyLane, likely_lanes
from missions.planning.search.search_order import Pace, expected_s, plain_blocks, soonest
from missions.planning.stepwise import EXPLORERS, Explorer
from missions.planning.stepwise.metric import Metric
from missions.planning.sweep.plan_memo import PlanMemo
from missions.planning.sweep.strategies import LEAPFROG, ON_PATHS
from missions.units import Cell, GridPoint


@dataclass(frozen=True)
class Setting:
    """What a mission is given and does not change."""

    mission: Mission
    grid: Grid
    fence: Fence
    energy: EnergyModel
    explorer: Explorer
    """Of a strategy that does not stop, the one that is fallen back on: it plans no paths."""
    lanes: tuple[Lane, ...]
    east_ahead: bool = True
    """Whether the noses of vehicles that do not stop point along grid east, else along north."""
    lane_rows: int = LANE_CELLS
    """How many rows of cells a lane decides."""
    likely: tuple[LikelyLane, ...] = ()
    """The lanes with what the prior says of them; empty without a prior."""
    ground: Terrain | None = None
    """What layers are above; None: flat ground at the height of the start."""
    member: int | None = None
    """Of a fleet whose vehicles each have a service of their own: which vehicle is ours."""
    whole_fence: Fence | None = None
    """Of such a fleet: the fence without the columns over others' pads, which are holes of ours."""
    plans: PlanMemo = field(default_factory=PlanMemo, compare=False, repr=False)
    """What was planned before in this flight."""

    @classmethod
    def of(cls, mission: Mission, member: int | None = None) -> Setting:
        """The setting of a checked mission file.

        `member`: the one vehicle that is flown, where each has a service of its own
        (`missions.flight.team`), 0 for who flies none and only knows; None: all of them are flown.
        """
        grid = Grid.at(
            mission.home, mission.grid.cell_m, mission.drift.speed_m_s, mission.drift.toward_deg
        )
        fence = common = whole = fence_of(mission, grid)
        pads = [grid.fixed(place) for place in homes(mission)]
        if member:  # 0 flies nothing, and needs no air
            columns = columns_over(pads, mission.team.separation_m)
            others = [column for k, column in enumerate(columns, start=1) if k != member]
            fence = fence_without(whole, others, mission.fence.margin_m)
            common = fence_without(whole, columns, mission.fence.margin_m)
        box = [grid.fixed(p) for p in positions(mission.search.box)]
        nonstop = mission.strategy in ON_PATHS
        laid = []
        for ahead in _directions(mission, box):
            rows = rows_across(mission, grid, east_ahead=ahead) if nonstop else LANE_CELLS
            spare = 0
            if nonstop and mission.search.find == "all":
                # what no frame has shown is flown to: a row or two are not worth a lane
                highest = len(mission.vehicles) - 1
                spare = rows_across(mission, grid, highest, east_ahead=ahead) - rows
            flown = lanes(box, mission.grid.cell_m, common, rows, ahead, spare)
            laid.append((flown, ahead, rows))
        if len(laid) > 1:
            laid.sort(key=lambda one: longest_m(share_by_time(one[0], pads), pads))
        flown, ahead, rows = laid[0]
        prior = prior_of(mission, grid) if flown else ()
        return cls(
            mission,
            grid,
            fence,
            energy_model(mission),
            EXPLORERS["rdfs" if nonstop else mission.strategy],
            flown,
            ahead,
            rows,
            likely_lanes(flown, box, prior, mission.grid.cell_m, rows) if prior else (),
            mission.ground,
            member,
            whole if member else None,
        )

    @cached_property
    def shares(self) -> tuple[tuple[Lane, ...], ...]:
        """The lanes of each vehicle before take-off, in the order of flight.

        With a prior, so that the region is expected to be seen soonest.
        """
        vehicles = len(self.mission.vehicles)
        if not self.lanes:
            return ((),) * vehicles
        if self.leapfrogs:
            return (self.lanes, *((),) * (vehicles - 1))
        if self.likely:
            blocks = soonest(self.likely, self._pads, self._pace)
            return tuple(tuple(part.lane for part in block) for block in blocks)
        if self.finds_all and vehicles > 1:
            return share_by_time(self.lanes, self._pads)
        return share_out(self.lanes, vehicles)

    @property
    def first_sighting_s(self) -> tuple[float, float] | None:
        """The expected time from lift-off to the first sighting, and the same had the prior not
        been used; None without one, for then nobody knows.

        Nobody is held up by others, by a battery, or by what lies between two lanes.
        """
        if not self.likely:
            return None
        parts = [*self.likely, *(part.turned for part in self.likely)]
        of_lane = {part.lane: part for part in parts}
        blocks = [tuple(of_lane[lane] for lane in block) for block in self.shares]
        plain = plain_blocks(self.likely, len(blocks))
        climb_s = self.mission.top_altitude_m(0) / self.energy.climb_m_s + CLIMB_OVERHEAD_S
        soon_s, late_s = (expected_s(b, self._pads, self._pace) for b in (blocks, plain))
        return climb_s + soon_s, climb_s + late_s

    def pad_of(self, number: int) -> GridPoint:
        """Where a vehicle stands by the mission file."""
        return self._pads[number - 1]

    def home_level_m(self, number: int) -> float:
        """Return the height of a vehicle's home above what its layers are counted from, m."""
        return 0.0 if self.ground is not None else home_heights_m(self.mission)[number - 1]

    @property
    def _pads(self) -> list[GridPoint]:
        return [self.grid.fixed(place) for place in homes(self.mission)]

    @property
    def _pace(self) -> Pace:
        """How fast lanes are flown, from the lowest layer."""
        if self.nonstop:
            speed_m_s = path_speed_m_s(self.mission, self.mission.top_altitude_m(0))
            return Pace(speed_m_s, corner_pause_s(speed_m_s, LANE_CUTS_M[0]))
        return Pace(self.energy.speed_m_s, self.energy.leg_s(0.0))

    @property
    def relief_m(self) -> float:
        """From the lowest ground that a straight way home crosses to the highest; 0 if flat."""
        return self.mission.ground_span_m

    def ups_and_downs_m(self, points: Sequence[GridPoint]) -> float:
        """What the ups and downs of a way come to, in metres of climbing; 0 where it is flat."""
        if self.ground is None:
            return 0.0
        return self.ground.ups_and_downs_m(points, self.energy.speed_m_s, self.energy.climb_m_s)

    @property
    def surveys(self) -> bool:
        """Whether the whole box is judged, wherever the region is."""
        return self.mission.strategy == "survey" or self.leapfrogs

    @property
    def leapfrogs(self) -> bool:
        """Whether the first vehicle maps while the second one tracks it, by turns."""
        return self.mission.strategy == LEAPFROG.name

    @property
    def finds_all(self) -> bool:
        """Whether every patch of the region that begins in the box is looked for."""
        return self.mission.strategy == "swath" and self.mission.search.find == "all"

    @property
    def searches_high(self) -> bool:
        """Whether lanes are flown in layers of their own."""
        return self.mission.search.altitude_m is not None

    @property
    def sees_box(self) -> bool:
        """Whether all lanes are flown, whatever is seen on the way."""
        return self.surveys or self.finds_all

    @property
    def lanes_drift(self) -> bool:
        """Whether lanes lie in the frame of the cells, and drift with a region that drifts.

        Where every cell of the box is to be seen; a search for the first sight of a region flies
        over ground.
        """
        return self.sees_box and not self.leapfrogs

    def lane_time_s(self, t_s: float) -> float:
        """The time at which lanes lie where they are told to be, seen from the cells."""
        return 0.0 if self.lanes_drift else t_s

    def to_lanes(self, place: GridPoint, t_s: float) -> GridPoint:
        """A place over ground at a time in the frame in which lanes lie."""
        return self.grid.to_moving(place, t_s - self.lane_time_s(t_s))

    def over_ground(self, place: GridPoint, t_s: float) -> GridPoint:
        """The inverse of `to_lanes`."""
        return self.grid.to_fixed(place, t_s - self.lane_time_s(t_s))

    @cached_property
    def box_cells(self) -> tuple[Cell, ...]:
        """The cells whose centre lies in the search box, at mission time 0."""
        box = Polygon([self.grid.fixed(p) for p in positions(self.mission.search.box)])
        cell_m = self.grid.cell_m
        west, south, east, north = box.bounds
        columns = range(math.ceil(west / cell_m), math.floor(east / cell_m) + 1)
        rows = range(math.ceil(south / cell_m), math.floor(north / cell_m) + 1)
        return tuple(
            Cell(i, j) for i in columns for j in rows if box.covers(Point(i * cell_m, j * cell_m))
        )

    @cached_property
    def in_box(self) -> frozenset[Cell]:
        """The same as a set."""
        return frozenset(self.box_cells)

    @property
    def nonstop(self) -> bool:
        """Whether the strategy plans paths that are flown without stopping."""
        return self.mission.strategy in ON_PATHS

    @property
    def yaw_deg(self) -> float:
        """The true bearing at which vehicles that do not stop hold their noses."""
        grid_deg = 90.0 if self.east_ahead else 0.0
        return (grid_deg + math.degrees(self.grid.convergence_rad)) % 360.0

    @property
    def metric(self) -> Metric:
        """What a leg between two cells costs in seconds, in the frame of the ROI.

        A vehicle flies straight, over whatever lies between, from rest to rest. A look is its
        frames: the seconds of `look_s` besides are kept for the battery, and seldom needed.
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

    @property
    def look_s(self) -> float:
        """About how long a vehicle hovers over a cell."""
        return look_s(self.mission)


def _directions(mission: Mission, box: Sequence[GridPoint]) -> tuple[bool, ...]:
    """Whether lanes may lie along grid east, and along north; the one along the longer side first.

    Several vehicles that look for every patch take what is done sooner.
    """
    longer = along_east(box)
    both = mission.strategy == "swath" and mission.search.find == "all"
    both = both and not mission.search.prior  # which goes by lanes along the longer side
    return (longer, not longer) if both and len(mission.vehicles) > 1 else (longer,)
