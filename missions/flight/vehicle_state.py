"""One vehicle as the mission knows it: its phase, its order, and its part in the exploration."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from enum import StrEnum

from missions.geo.trajectory import Trajectory
from missions.orders import FlyPath, FlyTo, Hold, Order, ReturnToLaunch, StandDown, Sweep
from missions.planning.search.lanes import Lane
from missions.units import Cell, GridPoint

_ORIGIN = GridPoint(0.0, 0.0)

BRAKING_S = 8.0
"""Time after which an interrupted vehicle counts as at rest, s, even if the wind moves it."""
OFF_LAYER_M = 1.5
"""Distance from its layer beyond which a vehicle needs all heights between, m."""
OVER_PAD_M = 1.0
"""Distance to its pad within which a vehicle is in the column over it, and may land, m."""
PASSING_S = 3.0
"""Time for which a vehicle that has flown past the end of a leg may still move, s."""


class Phase(StrEnum):
    """What a vehicle can do for the mission."""

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
    """It lies or stands away from its pad: the crew has to fetch it."""
    LOST = "lost"
    """It was silent for longer than its battery can have lasted."""
    APART = "apart"
    """The vehicle of another member of the fleet that is out of contact, in its own air."""


class ReturnReason(StrEnum):
    """Why a vehicle flies home."""

    DONE = "done"
    BATTERY = "battery"
    RECALLED = "recalled"
    TRAFFIC = "traffic"
    FAULT = "fault"
    """Its camera is silent, or an order failed."""


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
    """The parts of a map, as one member of a fleet has laid them out for all that it heard."""

    by: int
    made_s: float
    parts: Mapping[int, tuple[GridPoint, ...]]
    """By vehicle the observation points in order, as the region lies at mission time 0."""


@dataclass(frozen=True, slots=True)
class VehicleState:
    """One vehicle: where it is, what it carries out, and where it stands in the exploration."""

    vehicle: int
    cruise_altitude_m: float
    phase: Phase = Phase.OFFLINE
    tracked_s: float = 0.0
    home: GridPoint = _ORIGIN
    home_level_m: float = 0.0
    """Height of its home above what layers are counted from, m."""
    position: GridPoint = _ORIGIN
    height_m: float = 0.0
    remaining_wh: float = 0.0
    drawn_w: float = 0.0
    wind_m_s: float = 0.0
    """Wind that was measured in flight."""
    order: Order | None = None
    last_order: Order | None = None
    """Its order when its link was lost, which it may still carry out."""
    return_reason: ReturnReason | None = None
    over_home: bool = False
    """Whether it is over the place where it will land."""
    returns_by_itself: bool = False
    """Whether its autopilot flies it home, straight."""
    spare_pad: GridPoint | None = None
    """Where it lands while its own pad stays blocked."""
    lanes: tuple[Lane, ...] = ()
    on_lane: bool = False
    lane_seen_m: tuple[float, ...] = ()
    """Where along its first lane judged frames lie, m."""
    empty_passes: int = 0
    """Lanes in a row without a judged frame."""
    frames_lost: int = 0
    """Pictures in a row that were lost or are not credible."""
    judged_s: float = 0.0
    """When its last picture was judged, or its first path began."""
    home_refused: int = 0
    """How often the return path could not be flown since take-off."""
    behind: int = 0
    """How often in a row, `BEHIND_S` apart at most, it fell behind its path..."""
    behind_s: float = float("-inf")
    """... and when last."""
    candidate: Cell | None = None
    vertex: Cell | None = None
    at_target: bool = False
    """Whether it has arrived at its candidate or vertex."""
    landed: bool = True
    cleared: bool = True
    """Whether the operator has cleared it for take-off: a flight uses the clearance up, a battery
    swap or a resume renews it. No vehicle takes off beside people because a link came back."""
    fruitless_sorties: int = 0
    """Consecutive sorties that the battery ended without progress."""
    braking_until_s: float | None = None
    """Until when it comes to rest after its leg was interrupted: its place is uncertain."""
    passed_s: float | None = None
    """When it flew past the end of a leg without a stop."""
    landed_away_m: float = 0.0
    """How far from its pad a pilot or a failsafe has set it down, m."""
    was_down: bool = False
    """Whether it was down when the mission was resumed, and has not reported since."""
    called_home: bool = False
    """Whether the operator has commanded it home, to stay there."""
    asks: Column | None = None
    """The air that it asks the others of its fleet for..."""
    leased_until_s: float = float("-inf")
    """... and until when they have closed it to themselves."""
    held_until_s: float = float("-inf")
    """Out of contact: until when its work is left to it."""
    due_s: float = float("-inf")
    """Out of contact: when it should be back over its pad, its lanes flown."""
    back_s: float = float("-inf")
    """When it was last received again after it was out of contact."""
    note: str = ""

    @property
    def idle(self) -> bool:
        """Whether it waits for an order."""
        return self.order is None or isinstance(self.order, Hold)

    @property
    def works(self) -> bool:
        """Whether it flies for the mission, and not home."""
        return self.phase is Phase.AIRBORNE and self.return_reason is None

    @property
    def flees(self) -> bool:
        """Whether it flies home for traffic, and does not land yet."""
        homeward = self.return_reason is ReturnReason.TRAFFIC and not self.over_home
        return homeward and self.phase is Phase.AIRBORNE

    @property
    def uncontrolled(self) -> bool:
        """Whether it is in the air and cannot be commanded."""
        others = (Phase.YIELDED, Phase.OFFLINE, Phase.GUARDED)
        return self.phase in others and not self.landed

    @property
    def idle_in_search(self) -> bool:
        """Whether it has neither a lane nor a suspicion."""
        return not self.lanes and self.candidate is None

    @property
    def path(self) -> Trajectory | None:
        """The path that it flies without stopping."""
        return self.order.trajectory if isinstance(self.order, FlyPath) else None

    @property
    def cruise_height_m(self) -> float:
        """Its layer, above its own home."""
        return self.cruise_altitude_m - self.home_level_m

    def leg(self, route: Iterable[GridPoint]) -> FlyTo:
        """Return the order to fly along places in its layer, and to stop at the last."""
        return FlyTo(tuple(route), None, stop=True, height_m=self.cruise_height_m)

    @property
    def ended(self) -> bool:
        """Whether it will do nothing more, and is on the ground or given up.

        A vehicle that its pilot keeps on the ground may be given back: that is not waited for.
        """
        done = (Phase.FINISHED, Phase.FAILED, Phase.DOWN, Phase.YIELDED)
        return self.phase is Phase.LOST or (self.phase in done and self.landed)

    @property
    def away(self) -> bool:
        """Whether the crew has to look for it: in the air, or on the ground elsewhere."""
        is_down = self.was_down or self.phase in (Phase.DOWN, Phase.LOST)
        return is_down or not self.landed or bool(self.landed_away_m)

    @property
    def level_m(self) -> float:
        """Where it is above the level that layers are counted from."""
        return self.height_m + self.home_level_m

    @property
    def is_over_pad(self) -> bool:
        """Whether it is in the column over its pad."""
        return self.position.distance_to(self.pad) <= OVER_PAD_M

    @property
    def pad(self) -> GridPoint:
        """Where it lands."""
        return self.home if self.spare_pad is None else self.spare_pad

    def interrupted(self, t_s: float) -> VehicleState:
        """Take back its order; from a leg it has to come to rest first."""
        moves = self.passed_s is not None and t_s - self.passed_s < PASSING_S
        if moves or isinstance(self.order, FlyTo | Sweep | FlyPath):
            return replace(self, order=None, braking_until_s=t_s + BRAKING_S)
        return replace(self, order=None)

    def stood_down(self, phase: Phase, note: str) -> VehicleState:
        """End its part in the mission."""
        return replace(self, phase=phase, order=StandDown(), note=note)

    def left_to_autopilot(self, note: str) -> VehicleState:
        """Have its autopilot fly it home, watched by its guardian."""
        return replace(
            self.stood_down(Phase.GUARDED, note),
            order=ReturnToLaunch(),
            return_reason=None,
            returns_by_itself=True,
        )
