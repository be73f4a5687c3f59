"""What the mission knows, as one immutable value: the fold of the journal.

`Setting` is what does not change during a mission; `State` is what events change.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from enum import StrEnum

from missions.energy import EnergyModel
from missions.explorers import EXPLORERS, Explorer, Memory
from missions.explorers.metric import Metric
from missions.ground.fence import Fence
from missions.ground.grid import Grid
from missions.ground.lanes import Lane, lanes, share_out
from missions.mapping.belief import Belief
from missions.mapping.tree import Tree
from missions.mission_file.energy_model import energy_model
from missions.mission_file.schema import Mission, positions
from missions.orders import FlyTo, Hold, Order, Sweep
from missions.units import Cell, GridPoint

_ORIGIN = GridPoint(0.0, 0.0)


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


class ReturnReason(StrEnum):
    """Why a vehicle flies home."""

    DONE = "done"
    BATTERY = "battery"
    RECALLED = "recalled"
    FAULT = "fault"
    """Its camera is silent, or an order failed: it takes no more part."""


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
    def away(self) -> bool:
        """Whether somebody has to look for it: not on the ground, or on the ground elsewhere."""
        return not self.landed or bool(self.landed_away_m) or self.phase in (Phase.DOWN, Phase.LOST)

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
        if moves or isinstance(self.order, FlyTo | Sweep):
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
    lanes: tuple[Lane, ...]

    @classmethod
    def of(cls, mission: Mission) -> Setting:
        """The setting of a checked mission file."""
        grid = Grid.at(
            mission.home, mission.grid.cell_m, mission.drift.speed_m_s, mission.drift.toward_deg
        )
        fence = Fence.of(
            [grid.fixed(p) for p in positions(mission.fence.polygon)],
            [[grid.fixed(p) for p in positions(hole)] for hole in mission.fence.holes],
            mission.fence.margin_m,
        )
        box = [grid.fixed(p) for p in positions(mission.search.box)]
        return cls(
            mission,
            grid,
            fence,
            energy_model(mission),
            EXPLORERS[mission.strategy],
            lanes(box, mission.grid.cell_m, fence),
        )

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
    unreachable_lanes: tuple[Lane, ...] = ()
    """Lanes that no way inside the fence leads to."""
    recalled: bool = False
    abandoned: frozenset[Cell] = frozenset()
    """ROI cells that nobody could look from: beyond the fence or out of reach."""
    memory: Memory | None = None
    """What the explorer asked to be given at its next decision."""
    last_wait: tuple[Tree, Mapping[int, Cell], frozenset[int]] | None = None
    """Robots that were told to wait, with the tree and the positions then: they are not asked again
    until one of these changes."""
    undecided: frozenset[Cell] = frozenset()
    """Cells that were looked from, where votes on the cell or on a neighbour are missing."""
    found_s: float | None = None
    """When the ROI was first confirmed."""

    @classmethod
    def initial(cls, setting: Setting) -> State:
        """Before anything has happened: every vehicle offline, with its share of the lanes."""
        mission = setting.mission
        blocks = share_out(setting.lanes, len(mission.vehicles)) if setting.lanes else ()
        vehicles = {
            number: VehicleState(
                number,
                mission.altitude_m(number - 1),
                lanes=blocks[number - 1] if blocks else (),
            )
            for number in range(1, len(mission.vehicles) + 1)
        }
        return cls(Belief(mission.votes.frames, mission.votes.positive), vehicles)

    def with_vehicle(self, vehicle: VehicleState) -> State:
        """This state with one vehicle changed."""
        return replace(self, vehicles={**self.vehicles, vehicle.vehicle: vehicle})

    @property
    def over(self) -> bool:
        """Whether nobody will do anything more of their own accord, and nobody is in the air.

        A vehicle that was given up is an exception: nobody knows where it is.
        """
        ended = (Phase.FINISHED, Phase.FAILED, Phase.DOWN, Phase.YIELDED)
        return all(
            v.phase is Phase.LOST or (v.phase in ended and v.landed) for v in self.vehicles.values()
        )

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
            and not self.unsearched
            and all(
                v.landed and v.phase not in (Phase.DOWN, Phase.LOST) for v in self.vehicles.values()
            )
        )

    def robots(self) -> dict[int, Cell]:
        """For every vehicle that takes part in the exploration its vertex."""
        return {
            number: v.vertex
            for number, v in self.vehicles.items()
            if v.vertex is not None and v.phase in (Phase.AIRBORNE, Phase.GROUNDED)
        }
