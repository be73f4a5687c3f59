"""What a member knows of another one, what it tells of its vehicle, what another makes of that."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Final

from missions.fleet_events import Heard
from missions.flight.lane_progress import lanes_held
from missions.flight.setting import Setting
from missions.flight.state import Phase, State, VehicleState
from missions.orders import FlyPath
from missions.units import GridPoint, PadHeight
from uavmap.fleet.codec import Ask, Does, Presence
from uavmap.fleet.knowledge import Holding


@dataclass(slots=True)
class Peer:
    """Another member, as it was heard; times are those of our clock."""

    heard_s: float
    have: dict[int, Holding] = field(default_factory=dict)
    """Which facts of each member it knows..."""
    have_s: float = -math.inf
    """... as it said then."""
    lacks_since_s: dict[int, float] = field(default_factory=dict)
    """Since when it lacks facts of a member that are known here, and got no later one of it."""
    apart: bool = False
    done: bool = False
    told_all: bool = False
    """Whether it has told what it knows since it was done."""
    begun: bool = False
    """Whether its clock moves no more."""
    ask: Ask | None = None
    promised: int = -1
    """Which of our questions for air it has promised."""
    pad: PadHeight | None = None
    ahead_s: float = -math.inf
    """By how much its clock is ahead of ours, at least: what comes late seems less."""

    def clock_moved(self, by_s: float) -> None:
        """Our clock was put forward, or back, by so much."""
        self.heard_s += by_s
        self.have_s += by_s
        self.ahead_s -= by_s
        self.lacks_since_s = {o: at_s + by_s for o, at_s in self.lacks_since_s.items()}


PATH_S: Final = 8.0
"""The places of a path that are told lie so far apart..."""
PATH_PLACES: Final = 4
"""... and are so many."""


def presence_of(setting: Setting, state: State, vehicle: VehicleState) -> Presence:
    """What a member tells of its vehicle."""
    capacity_wh = setting.mission.battery.capacity_wh
    return Presence(
        _does(vehicle),
        vehicle.position,
        vehicle.height_m,
        vehicle.remaining_wh / capacity_wh,
        vehicle.cruise_altitude_m,
        lanes_held(setting, vehicle),
        _places_ahead(vehicle, state.t_s),
    )


def heard_of(setting: Setting, sender: int, now_s: float, said: Presence) -> Heard:
    """What another has told of its vehicle, for our service."""
    capacity_wh = setting.mission.battery.capacity_wh
    return Heard(
        sender, round(now_s, 3), said.position, said.height_m,
        round(said.charge * capacity_wh, 2), said.does, setting.pad_of(sender),
        said.lanes, said.path, said.layer_m,
    )  # fmt: skip


def _does(vehicle: VehicleState) -> Does:
    if vehicle.phase in (Phase.DOWN, Phase.LOST):
        return "down"
    if vehicle.phase in (Phase.FINISHED, Phase.FAILED):
        return "ended"
    if vehicle.landed:
        return "stands"
    if vehicle.phase in (Phase.YIELDED, Phase.OFFLINE):
        return "pilot"
    if vehicle.phase is Phase.GUARDED:
        return "guarded"
    return "flies" if vehicle.return_reason is None else "returns"


def _places_ahead(vehicle: VehicleState, t_s: float) -> tuple[GridPoint, ...]:
    order = vehicle.order
    if not isinstance(order, FlyPath):
        return ()
    path = order.trajectory
    times = [t_s + PATH_S * k for k in range(1, PATH_PLACES + 1)]
    return tuple(
        path.place_at(min(at_s, path.end_s)) for at_s in times if at_s - PATH_S < path.end_s
    )
