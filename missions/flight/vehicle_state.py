"""One vehicle in the mission: its phase, its order, and its part in the exploration."""

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
"""Maximum time that a vehicle which has passed the end of a leg may still move, s."""


class Phase(StrEnum):
    """The ability of a vehicle to take part in the mission."""

    OFFLINE = "offline"
    GROUNDED = "grounded"
    AIRBORNE = "airborne"
    YIELDED = "yielded"
    """A pilot or a failsafe flies it; no command is sent to it."""
    GUARDED = "guarded"
    """Its guardian has its autopilot return or land; no other command is sent to it."""
    FINISHED = "finished"
    FAILED = "failed"
    """It is on the ground and takes no more part."""
    DOWN = "down"
    """It lies or stands away from its pad: the crew has to fetch it."""
    LOST = "lost"
    """It was silent for longer than its battery can have lasted."""
    APART = "apart"
    """Another member's vehicle that is out of contact, in its own air."""


class ReturnReason(StrEnum):
    """Reason of a return."""

    DONE = "done"
    BATTERY = "battery"
    RECALLED = "recalled"
    TRAFFIC = "traffic"
    FAULT = "fault"
    """Its camera is silent, or an order failed."""


@dataclass(frozen=True, slots=True)
class Column:
    """The air above and below a place, for a time: altitudes of layers, m; mission time, s."""

    place: GridPoint
    low_m: float
    high_m: float
    asked_s: float
    until_s: float


@dataclass(frozen=True, slots=True)
class Allotment:
    """Parts of a map that one member of a fleet has assigned to all that it is in contact with."""

    by: int
    made_s: float
    parts: Mapping[int, tuple[GridPoint, ...]]
    """Observation points in order, by vehicle, as the region lies at mission time 0."""


@dataclass(frozen=True, slots=True)
class VehicleState:
    """One vehicle: its position, its order, and its part in the exploration."""

    vehicle: int
    cruise_altitude_m: float
    phase: Phase = Phase.OFFLINE
    tracked_s: float = 0.0
    home: GridPoint = _ORIGIN
    home_level_m: float = 0.0
    """Height of its home above the origin of layer altitudes, m."""
    position: GridPoint = _ORIGIN
    height_m: float = 0.0
    remaining_wh: float = 0.0
    drawn_w: float = 0.0
    wind_m_s: float = 0.0
    """Wind that was measured in flight."""
    order: Order | None = None
    last_order: Order | None = None
    """Order at the loss of its link; it may still carry it out."""
    return_reason: ReturnReason | None = None
    over_home: bool = False
    """True if it is over its landing place."""
    returns_by_itself: bool = False
    """True if its autopilot flies it home, straight."""
    spare_pad: GridPoint | None = None
    """Landing place while its own pad stays blocked."""
    lanes: tuple[Lane, ...] = ()
    on_lane: bool = False
    lane_seen_m: tuple[float, ...] = ()
    """Positions of judged frames along its first lane, m."""
    empty_lanes: int = 0
    """Lanes in a row without a judged frame."""
    frames_lost: int = 0
    """Pictures in a row that were lost or are not credible."""
    judged_s: float = 0.0
    """Time of its last judged picture, or of the beginning of its first path, s."""
    home_refused: int = 0
    """Number of refused return paths since take-off."""
    behind: int = 0
    """Number of times in a row that it fell behind its path, at most `BEHIND_S` apart."""
    behind_s: float = float("-inf")
    """Time of the last of them, s."""
    candidate: Cell | None = None
    vertex: Cell | None = None
    at_target: bool = False
    """True if it has arrived at its candidate or vertex."""
    landed: bool = True
    cleared: bool = True
    """True if the operator has cleared it for take-off. A flight uses up the clearance; a battery
    swap or a resume renews it. No vehicle takes off beside people because a link has come back."""
    fruitless_sorties: int = 0
    """Consecutive sorties that the battery ended without progress."""
    braking_until_s: float | None = None
    """Time until which it comes to rest after an interrupted leg, s; its place is uncertain."""
    passed_s: float | None = None
    """Time when it flew past the end of a leg without a stop, s."""
    landed_away_m: float = 0.0
    """Distance from its pad at which a pilot or a failsafe has landed it, m."""
    was_down: bool = False
    """True if it was down when the mission was resumed, and has not reported since."""
    called_home: bool = False
    """True if the operator has recalled it, to stay on the ground."""
    asks: Column | None = None
    """Air that it requests from the other members of its fleet."""
    leased_until_s: float = float("-inf")
    """Time until which the others stay out of that air, s."""
    held_until_s: float = float("-inf")
    """For a vehicle out of contact: time until which its work is reserved for it, s."""
    due_s: float = float("-inf")
    """For a vehicle out of contact: time when it should be over its pad, its lanes flown, s."""
    back_s: float = float("-inf")
    """Time when it was last back in contact, s."""
    note: str = ""

    @property
    def idle(self) -> bool:
        """True if it waits for an order."""
        return self.order is None or isinstance(self.order, Hold)

    @property
    def works(self) -> bool:
        """True if it flies for the mission, and not home."""
        return self.phase is Phase.AIRBORNE and self.return_reason is None

    @property
    def flees(self) -> bool:
        """True if it returns for traffic, and does not land yet."""
        homeward = self.return_reason is ReturnReason.TRAFFIC and not self.over_home
        return homeward and self.phase is Phase.AIRBORNE

    @property
    def uncontrolled(self) -> bool:
        """True if it is in the air and cannot be commanded."""
        others = (Phase.YIELDED, Phase.OFFLINE, Phase.GUARDED)
        return self.phase in others and not self.landed

    @property
    def idle_in_search(self) -> bool:
        """True if it has neither a lane nor a suspicion."""
        return not self.lanes and self.candidate is None

    @property
    def path(self) -> Trajectory | None:
        """The path that it flies without stopping."""
        return self.order.trajectory if isinstance(self.order, FlyPath) else None

    @property
    def cruise_height_m(self) -> float:
        """Height of its layer above its own home, m."""
        return self.cruise_altitude_m - self.home_level_m

    def leg(self, route: Iterable[GridPoint]) -> FlyTo:
        """Return the order to fly along places in its layer, and to stop at the last."""
        return FlyTo(tuple(route), None, stop=True, height_m=self.cruise_height_m)

    @property
    def ended(self) -> bool:
        """True if it will do nothing more, and is on the ground or given up. A pilot may return
        control of a vehicle on the ground; that is not waited for."""
        done = (Phase.FINISHED, Phase.FAILED, Phase.DOWN, Phase.YIELDED)
        return self.phase is Phase.LOST or (self.phase in done and self.landed)

    @property
    def away(self) -> bool:
        """True if the crew has to look for it: in the air, or on the ground away from its pad."""
        is_down = self.was_down or self.phase in (Phase.DOWN, Phase.LOST)
        return is_down or not self.landed or bool(self.landed_away_m)

    @property
    def level_m(self) -> float:
        """Height above the origin of layer altitudes, m."""
        return self.height_m + self.home_level_m

    @property
    def is_over_pad(self) -> bool:
        """True if it is in the column over its pad."""
        return self.position.distance_to(self.pad) <= OVER_PAD_M

    @property
    def pad(self) -> GridPoint:
        """Its landing place."""
        return self.home if self.spare_pad is None else self.spare_pad

    def interrupted(self, t_s: float) -> VehicleState:
        """Return the vehicle without its order; after a leg it has to come to rest first."""
        moves = self.passed_s is not None and t_s - self.passed_s < PASSING_S
        if moves or isinstance(self.order, FlyTo | Sweep | FlyPath):
            return replace(self, order=None, braking_until_s=t_s + BRAKING_S)
        return replace(self, order=None)

    def stood_down(self, phase: Phase, note: str) -> VehicleState:
        """Return the vehicle after the end of its part in the mission."""
        return replace(self, phase=phase, order=StandDown(), note=note)

    def left_to_autopilot(self, note: str) -> VehicleState:
        """Return the vehicle in a return by its autopilot, watched by its guardian."""
        return replace(
            self.stood_down(Phase.GUARDED, note),
            order=ReturnToLaunch(),
            return_reason=None,
            returns_by_itself=True,
        )
