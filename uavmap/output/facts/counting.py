"""What is counted of a flight while its events come: distances, sorties, times on the tree."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

from missions.events import BatterySwapped, Connected, Event, Landed, Navigated, Told, Tracked
from missions.flight.state import Phase, State, VehicleState
from missions.orders import FlyPath
from missions.units import GridPoint
from uavmap.output.facts.navigation_error import NavigationLog

LIFT_OFF_M = 0.3


@dataclass(slots=True)
class Count:
    """What is counted for one vehicle."""

    position: GridPoint | None = None
    distance_m: float = 0.0
    last_on_ground_s: float = 0.0
    lift_off_s: float | None = None
    flight_s: float = 0.0
    sorties: int = 0
    swaps: int = 0
    on_task_s: float = 0.0
    on_tree: bool = False
    stints: int = 0
    points: list[tuple[float, GridPoint, float]] = field(default_factory=list)
    navigation: NavigationLog = field(default_factory=NavigationLog)

    def track(self, event: Tracked) -> None:
        """Where it is now: farther, and perhaps off the ground."""
        if self.position is not None:
            self.distance_m += self.position.distance_to(event.position)
        self.position = event.position
        if event.height_m < LIFT_OFF_M and self.lift_off_s is None:
            self.last_on_ground_s = event.t_s
            return
        if self.lift_off_s is None:
            self.lift_off_s = self.last_on_ground_s
            self.sorties += 1
        self.points.append((event.t_s, event.position, event.height_m))

    def land(self, t_s: float) -> None:
        """A sortie ends."""
        if self.lift_off_s is not None:
            self.flight_s += t_s - self.lift_off_s
        self.lift_off_s = None
        self.last_on_ground_s = t_s


class Counter:
    """Counts of every vehicle. Tell it each event, before and after it is taken in."""

    def __init__(self, numbers: Iterable[int]) -> None:
        self.vehicles: Mapping[int, Count] = {number: Count() for number in numbers}
        self.first_s: float | None = None
        """The first lift-off, mission seconds."""
        self.last_s = 0.0
        """The last touch-down."""
        self._before_s = 0.0

    def before(self, event: Event, state: State) -> None:
        """What the time up to an event was spent on; `state` is that before it."""
        if isinstance(event, Told):  # words are no part of a flight's times
            return
        for number, vehicle in state.vehicles.items():
            elapsed_s = max(event.t_s - self._before_s, 0.0)
            _on_task(self.vehicles[number], vehicle, state, elapsed_s)
        self._before_s = max(self._before_s, event.t_s)

    def after(self, event: Event) -> None:
        """What an event itself adds."""
        if isinstance(event, Landed | Navigated):
            self.vehicles[event.vehicle].navigation.take(event)
        if isinstance(event, Tracked):
            count = self.vehicles[event.vehicle]
            count.track(event)
            if self.first_s is None and count.lift_off_s is not None:
                self.first_s = count.lift_off_s
        elif isinstance(event, Landed):
            self.vehicles[event.vehicle].land(event.t_s)
            self.last_s = event.t_s
        elif isinstance(event, Connected):
            self.last_s = max(self.last_s, _reconnect(self.vehicles[event.vehicle], event))
        elif isinstance(event, BatterySwapped):
            self.vehicles[event.vehicle].swaps += 1


def _reconnect(count: Count, event: Connected) -> float:
    """After an interruption: what nobody saw is not counted. Returns when a flight so ended."""
    count.position = None
    if event.airborne or count.lift_off_s is None:
        return 0.0
    last_seen_s = count.points[-1][0]
    count.land(last_seen_s)
    count.last_on_ground_s = event.t_s
    return last_seen_s


def _on_task(count: Count, vehicle: VehicleState, state: State, elapsed_s: float) -> None:
    """Add the time that a vehicle spends on the tree; one that does not stop is there at once."""
    if (
        state.tree is None
        or vehicle.phase is not Phase.AIRBORNE
        or vehicle.return_reason is not None
    ):
        count.on_tree = False
        return
    if not count.on_tree and (vehicle.at_target or isinstance(vehicle.order, FlyPath)):
        count.on_tree = True
        count.stints += 1
    if count.on_tree:
        count.on_task_s += elapsed_s
