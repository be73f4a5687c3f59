"""What the mission knows, as one immutable value: the fold of the journal.

`Setting` is what does not change during a mission; `State` is what events change.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from enum import StrEnum

from shapely.geometry import Point, Polygon

from missions.energy import CLIMB_OVERHEAD_S, EnergyModel
from missions.explorers import EXPLORERS, Explorer, Memory
from missions.explorers.metric import Metric
from missions.ground.columns import columns_over, fence_without
from missions.ground.fence import Fence
from missions.ground.grid import Grid
from missions.ground.lane_shares import longest_m, share_by_time
from missions.ground.lanes import LANE_CELLS, Lane, along_east, lanes, share_out
from missions.ground.prior import LikelyLane, likely_lanes
from missions.ground.search_order import Pace, expected_s, plain_blocks, soonest
from missions.ground.terrain import Terrain
from missions.mapping.belief import Belief
from missions.mapping.tree import Tree
from missions.mission_file.energy_model import energy_model
from missions.mission_file.launch_pads import homes
from missions.mission_file.schema import Mission, positions
from missions.mission_file.views import path_speed_m_s, rows_across
from missions.mission_file.whereabouts import prior_of
from missions.motion.trajectory import LANE_CUTS_M, corner_pause_s
from missions.orders import FlyPath, FlyTo, Hold, Order, Sweep
from missions.swath.plan_memo import PlanMemo
from missions.swath.strategies import LEAPFROG, ON_PATHS
from missions.units import Cell, GridPoint

_ORIGIN = GridPoint(0.0, 0.0)
_NOTHING = Belief(1, 1)


BRAKING_S = 8.0
"""After so long an interrupted vehicle counts as at rest, even if the wind blows it about."""


PASSING_S = 3.0
"""So long a vehicle that has flown past the end of a leg may still be on the move."""


class Phase(StrEnum):
    """What a vehicle can do for the mission just now."""

    OFFLINE = "offline"
    GROUNDED = "grounded"
    AIRBORNE = "airborne"
    YIELDED = "yielded"
    """A pilot or a failsafe flies it; nothing is sent to it."""
    GUARDED = "guarded"
    """Its guardian has it return or land by its autopilot; nothing else is sent to it."""
    FINISHED = "finished"
    FAILED = "failed"
    """It stands on the ground and takes no more part."""
    DOWN = "down"
    """It lies or stands away from its pad: somebody has to fetch it."""
    LOST = "lost"
    """It was silent for longer than its battery can have lasted, or than anybody waits."""
    APART = "apart"
    """The vehicle of another member of the fleet that is out of contact: it keeps to the air that
    is its own, as everybody does."""


class ReturnReason(StrEnum):
    """Why a vehicle flies home."""

    DONE = "done"
    BATTERY = "battery"
    RECALLED = "recalled"
    FAULT = "fault"
    """Its camera is silent, or an order failed: it takes no more part."""


@dataclass(frozen=True, slots=True)
class Column:
    """The air above and below a place, for a time: altitudes as of layers, mission seconds."""

    place: GridPoint
    low_m: float
    high_m: float
    asked_s: float
    until_s: float


@dataclass(frozen=True, slots=True)
class Allotment:
    """Who of a fleet is to map what, as one member has laid it out for all that it heard."""

    by: int
    made_s: float
    parts: Mapping[int, tuple[GridPoint, ...]]
    """By vehicle the places to see it from, in order, as the region lies at mission time 0."""


@dataclass(frozen=True, slots=True)
class VehicleState:
    """One vehicle: where it is, what it carries out, and where it stands in the exploration."""

    vehicle: int
    cruise_altitude_m: float
    phase: Phase = Phase.OFFLINE
    tracked_s: float = 0.0
    home: GridPoint = _ORIGIN
    home_level_m: float = 0.0
    """Height of its home above the home of the vehicle that spoke first: layers are level."""
    position: GridPoint = _ORIGIN
    height_m: float = 0.0
    remaining_wh: float = 0.0
    drawn_w: float = 0.0
    wind_m_s: float = 0.0
    """Wind that was measured in flight; the given one counts where it is stronger."""
    order: Order | None = None
    last_order: Order | None = None
    """What it carried out when its link was lost, and may carry out still."""
    return_reason: ReturnReason | None = None
    over_home: bool = False
    """Whether it is over the place where it will land."""
    returns_by_itself: bool = False
    """Whether a failsafe, a pilot or its guardian has the autopilot return: it flies straight."""
    spare_pad: GridPoint | None = None
    """Where it lands instead, because its own pad stays blocked."""
    lanes: tuple[Lane, ...] = ()
    on_lane: bool = False
    lane_seen_m: tuple[float, ...] = ()
    """How far along its first lane the frames lie that were judged."""
    empty_passes: int = 0
    """Lanes in a row that were flown without one frame judged."""
    frames_lost: int = 0
    """Pictures in a row that were lost or cannot be believed."""
    judged_s: float = 0.0
    """On a path: when its last picture was judged, or it was given the first path."""
    home_refused: int = 0
    """How often the way home could not be flown since it last took off."""
    behind: int = 0
    """How often in a row, `BEHIND_S` apart at most, it was left behind by its path..."""
    behind_s: float = float("-inf")
    """... and when last."""
    candidate: Cell | None = None
    vertex: Cell | None = None
    at_target: bool = False
    """Whether it has arrived at its candidate or vertex."""
    landed: bool = True
    cleared: bool = True
    """Whether the operator has cleared it for take-off; a flight uses the clearance up, a battery
    swap or a resume renews it. Nothing takes off beside people because a link came back."""
    fruitless_sorties: int = 0
    """Consecutive sorties that the battery ended without progress."""
    braking_until_s: float | None = None
    """While it comes to rest after its leg was interrupted: nobody knows where it will stop."""
    passed_s: float | None = None
    """When it flew past the end of a leg without a stop."""
    landed_away_m: float = 0.0
    """How far from its pad a pilot or a failsafe has set it down, 0 where that is its pad."""
    was_down: bool = False
    """It was down when the mission was resumed, and has not spoken since: is it still there?"""
    called_home: bool = False
    """Whether the operator wants it at home, and there to stay."""
    asks: Column | None = None
    """The air that it asks the others of its fleet for..."""
    leased_until_s: float = float("-inf")
    """... and until when they have closed it to themselves."""
    held_until_s: float = float("-inf")
    """Out of contact: until then it is taken to do what it was to do."""
    due_s: float = float("-inf")
    """Out of contact: when it should have flown its lanes, and be back over its pad."""
    back_s: float = float("-inf")
    """When it was last heard again after it was out of contact."""
    note: str = ""

    @property
    def idle(self) -> bool:
        """Whether it waits for an order."""
        return self.order is None or isinstance(self.order, Hold)

    @property
    def cruise_height_m(self) -> float:
        """Its layer, above its own home."""
        return self.cruise_altitude_m - self.home_level_m

    @property
    def ended(self) -> bool:
        """Whether it will do nothing more of its own accord, and is not in the air.

        One that was given up is an exception: nobody knows where it is. One that its pilot keeps
        on the ground may be given back, but nobody can wait for that.
        """
        done = (Phase.FINISHED, Phase.FAILED, Phase.DOWN, Phase.YIELDED)
        return self.phase is Phase.LOST or (self.phase in done and self.landed)

    @property
    def away(self) -> bool:
        """Whether somebody has to look for it: not on the ground, or on the ground elsewhere."""
        is_down = self.was_down or self.phase in (Phase.DOWN, Phase.LOST)
        return is_down or not self.landed or bool(self.landed_away_m)

    @property
    def level_m(self) -> float:
        """Where it is above the level that layers are counted from."""
        return self.height_m + self.home_level_m

    @property
    def pad(self) -> GridPoint:
        """Where it lands."""
        return self.home if self.spare_pad is None else self.spare_pad

    def interrupted(self, t_s: float) -> VehicleState:
        """This vehicle with its order taken back; from a leg it has to come to rest first."""
        moves = self.passed_s is not None and t_s - self.passed_s < PASSING_S
        if moves or isinstance(self.order, FlyTo | Sweep | FlyPath):
            return replace(self, order=None, braking_until_s=t_s + BRAKING_S)
        return replace(self, order=None)


@dataclass(frozen=True, slots=True)
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
    _shares: list[tuple[tuple[Lane, ...], ...]] = field(default_factory=list)
    _box_cells: list[Cell] = field(default_factory=list)
    _in_box: list[frozenset[Cell]] = field(default_factory=list)

    @classmethod
    def of(cls, mission: Mission, member: int | None = None) -> Setting:
        """The setting of a checked mission file.

        `member`: the one vehicle that is flown, where each has a service of its own
        (`missions.fleet`), 0 for who flies none and only knows; None: all of them are flown.
        """
        grid = Grid.at(
            mission.home, mission.grid.cell_m, mission.drift.speed_m_s, mission.drift.toward_deg
        )
        ring = [grid.fixed(p) for p in positions(mission.fence.polygon)]
        holes = [[grid.fixed(p) for p in positions(hole)] for hole in mission.fence.holes]
        fence = common = whole = Fence.of(ring, holes, mission.fence.margin_m)
        if member:  # 0 flies nothing, and needs no air
            pads = [grid.fixed(place) for place in homes(mission)]
            columns = columns_over(pads, mission.team.separation_m)
            others = [column for k, column in enumerate(columns, start=1) if k != member]
            fence = fence_without(ring, holes, others, mission.fence.margin_m)
            common = fence_without(ring, holes, columns, mission.fence.margin_m)
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
            pads = [grid.fixed(place) for place in homes(mission)]
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

    @property
    def shares(self) -> tuple[tuple[Lane, ...], ...]:
        """The lanes of each vehicle before take-off, in the order of flight.

        With a prior, so that the region is expected to be seen soonest.
        """
        vehicles = len(self.mission.vehicles)
        if not self.lanes:
            return ((),) * vehicles
        if self.leapfrogs:
            return (self.lanes, *((),) * (vehicles - 1))
        if not self.likely and not (self.finds_all and vehicles > 1):
            return share_out(self.lanes, vehicles)
        if not self._shares and not self.likely:
            self._shares.append(share_by_time(self.lanes, self._pads))
        if not self._shares:
            blocks = soonest(self.likely, self._pads, self._pace)
            self._shares.append(tuple(tuple(part.lane for part in block) for block in blocks))
        return self._shares[0]

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

    @property
    def box_cells(self) -> tuple[Cell, ...]:
        """The cells whose centre lies in the search box, at mission time 0."""
        if not self._box_cells:
            box = Polygon([self.grid.fixed(p) for p in positions(self.mission.search.box)])
            cell_m = self.grid.cell_m
            west, south, east, north = box.bounds
            columns = range(math.ceil(west / cell_m), math.floor(east / cell_m) + 1)
            rows = range(math.ceil(south / cell_m), math.floor(north / cell_m) + 1)
            self._box_cells.extend(
                Cell(i, j) for i in columns for j in rows
                if box.covers(Point(i * cell_m, j * cell_m))
            )  # fmt: skip
        return tuple(self._box_cells)

    @property
    def in_box(self) -> frozenset[Cell]:
        """The same as a set."""
        if not self._in_box:
            self._in_box.append(frozenset(self.box_cells))
        return self._in_box[0]

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
        return 2.0 + self.mission.votes.frames * self.mission.camera.interval_s


def _directions(mission: Mission, box: Sequence[GridPoint]) -> tuple[bool, ...]:
    """Whether lanes may lie along grid east, and along north; the one along the longer side first.

    Several vehicles that look for every patch take what is done sooner.
    """
    longer = along_east(box)
    both = mission.strategy == "swath" and mission.search.find == "all"
    both = both and not mission.search.prior  # which goes by lanes along the longer side
    return (longer, not longer) if both and len(mission.vehicles) > 1 else (longer,)


@dataclass(frozen=True, slots=True)
class State:
    """What is known at an instant of the mission."""

    belief: Belief
    vehicles: Mapping[int, VehicleState]
    t_s: float = 0.0
    tree: Tree | None = None
    reference_amsl_m: float | None = None
    """Height above the sea of the first home that was told: layers are counted from there."""
    exhausted: bool = False
    """Every lane of the box has its judged frames, and nobody saw the ROI."""
    falls_back: bool = False
    """Whether a strategy that does not stop has had its time: the rest is stopped and looked at."""
    surveyed: bool = False
    """Where the whole box is seen: what can be decided of what has to be is decided."""
    unreachable_lanes: tuple[Lane, ...] = ()
    """Lanes that no way inside the fence leads to."""
    recalled: bool = False
    paused: bool = False
    """Whether the operator has everybody hold where they are."""
    skipped: frozenset[Cell] = frozenset()
    """Cells that the operator has nobody look from."""
    abandoned: frozenset[Cell] = frozenset()
    """ROI cells that nobody could look from: beyond the fence or out of reach."""
    memory: Memory | None = None
    """What the explorer asked to be given at its next decision."""
    last_wait: tuple[Tree, Mapping[int, Cell], frozenset[int], float] | None = None
    """Robots that were told to wait, with the tree, the positions and the time then: they are not
    asked again until one of the first two changes."""
    undecided: frozenset[Cell] = frozenset()
    """Cells that were looked from, where votes on the cell or on a neighbour are missing."""
    found_s: float | None = None
    """When the ROI was first confirmed."""
    overview: Belief = _NOTHING
    """The votes of frames from the height of a search (`missions.flight.two_heights`)."""
    member: int | None = None
    """Of a fleet whose vehicles each have a service of their own: which vehicle is ours."""
    closed: Mapping[int, Column] = field(default_factory=dict)
    """The air that others of a fleet have asked for, which ours keeps out of."""
    shown: frozenset[Cell] = frozenset()
    """Of a fleet: what others' frames have shown, and took for no region without a decision."""
    allotment: Allotment | None = None
    shared_s: float = float("-inf")
    """When another member last told what was not known here."""
    """Of a fleet that maps: who is to map what."""

    @classmethod
    def initial(cls, setting: Setting) -> State:
        """Before anything has happened: every vehicle offline, with its share of the lanes."""
        mission = setting.mission
        # a leapfrog has its own order (`missions.flight.leapfrogging`)
        blocks = ((),) * len(mission.vehicles) if setting.leapfrogs else setting.shares
        vehicles = {
            number: VehicleState(
                number,
                mission.search_altitude_m(number - 1) or mission.altitude_m(number - 1),
                lanes=blocks[number - 1],
            )
            for number in range(1, len(mission.vehicles) + 1)
        }
        none_seen = Belief(mission.votes.frames, mission.votes.positive)
        return cls(none_seen, vehicles, overview=none_seen, member=setting.member)

    def with_vehicle(self, vehicle: VehicleState) -> State:
        """This state with one vehicle changed."""
        return replace(self, vehicles={**self.vehicles, vehicle.vehicle: vehicle})

    @property
    def our_numbers(self) -> tuple[int, ...]:
        """The numbers of the vehicles that are told what to do, in order."""
        if self.member is None:
            return tuple(sorted(self.vehicles))
        return (self.member,) if self.member in self.vehicles else ()

    @property
    def ours(self) -> tuple[VehicleState, ...]:
        """These vehicles, in the order of their numbers."""
        return tuple(self.vehicles[number] for number in self.our_numbers)

    def is_ours(self, number: int) -> bool:
        """Whether we tell a vehicle what to do."""
        return self.member is None or number == self.member

    @property
    def over(self) -> bool:
        """Whether nobody will do anything more of their own accord, and nobody is in the air."""
        if not self.ours:  # of a fleet that is only listened to
            done = (Phase.FINISHED, Phase.FAILED, Phase.DOWN, Phase.LOST)
            return all(v.phase in done for v in self.vehicles.values())
        return all(v.ended for v in self.ours)

    @property
    def unsearched(self) -> tuple[Lane, ...]:
        """Stretches of lanes that no judged frame shows, while they still matter."""
        if self.tree is not None:
            return ()
        left = [lane for v in self.vehicles.values() for lane in v.lanes]
        return (*self.unreachable_lanes, *left)

    @property
    def exploration_finished(self) -> bool:
        """Whether the question of the mission is answered: explored, or searched in vain."""
        if self.tree is None:
            return self.exhausted
        return self.tree.is_explored(self.tree.root)

    @property
    def completed(self) -> bool:
        """Mapped without a gap, and everybody is home."""
        return (
            self.exploration_finished
            and not self.abandoned
            and not self.undecided
            and not self.skipped
            and not self.unsearched
            and all(v.landed and v.phase not in (Phase.DOWN, Phase.LOST) for v in self.ours)
        )

    def robots(self) -> dict[int, Cell]:
        """For every vehicle that takes part in the exploration its vertex."""
        return {
            number: v.vertex
            for number, v in self.vehicles.items()
            if v.vertex is not None and v.phase in (Phase.AIRBORNE, Phase.GROUNDED)
        }
