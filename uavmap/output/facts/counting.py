"""Counts of a flight, event by event: distances, sorties, times on the tree, navigation."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

from missions.events import BatterySwapped, Connected, Event, Landed, Navigated, Told, Tracked
from missions.flight.state import Phase, State, VehicleState
from missions.orders import FlyPath
from missions.units import GridPoint


@dataclass(slots=True)
class NavigationLog:
    """How well one vehicle knew its position; times are mission seconds.

    >>> from missions.units import GridPoint
    >>> log = NavigationLog()
    >>> log.take(Navigated(1, 60.0, "lost", sigma_m=0.4, off_m=GridPoint(0.0, 0.0)))
    >>> log.take(Navigated(1, 90.0, "lost", sigma_m=0.6, off_m=GridPoint(3.0, 4.0)))
    >>> log.take(Landed(1, 100.0, 30.0))
    >>> log.figures()["lost_s"], log.figures()["off_m"], log.figures()["sigma_m"]
    (40.0, 5.0, 0.6)
    """

    noticed_s: float | None = None
    """When satellites were lost, or found to be wrong, first."""
    lost_s: float = 0.0
    wrong_s: float = 0.0
    off_m: float | None = None
    """The largest error of the told position, by the vehicle's own pictures."""
    sigma_m: float | None = None
    """The largest standard deviation of what it went by instead."""
    _gnss: str = "good"
    _since_s: float = 0.0

    def take(self, event: Event) -> None:
        """Note a change of navigation or a landing of this vehicle."""
        if isinstance(event, Landed):
            self._pass(event.t_s)
        if not isinstance(event, Navigated):
            return
        self._pass(event.t_s)
        self._gnss = event.gnss
        if event.gnss != "good" and self.noticed_s is None:
            self.noticed_s = event.t_s
        if event.off_m is not None:
            self.off_m = max(self.off_m or 0.0, math.hypot(*event.off_m))
        if event.sigma_m is not None:
            self.sigma_m = max(self.sigma_m or 0.0, event.sigma_m)

    def _pass(self, t_s: float) -> None:
        passed_s = max(t_s - self._since_s, 0.0)
        if self._gnss == "lost":
            self.lost_s += passed_s
        elif self._gnss == "wrong":
            self.wrong_s += passed_s
        self._since_s = t_s

    def figures(self) -> dict[str, Any]:
        """Return the figures for summary.json; empty where satellites were good all the time."""
        if self.noticed_s is None:
            return {}
        return {
            "noticed_s": self.noticed_s,
            "lost_s": round(self.lost_s, 1),
            "wrong_s": round(self.wrong_s, 1),
            "off_m": None if self.off_m is None else round(self.off_m, 2),
            "sigma_m": self.sigma_m,
        }


def navigation_in_words(figures: Mapping[str, Any]) -> str:
    """Write the figures of one vehicle for the report.

    >>> told = {"noticed_s": 138.7, "lost_s": 90.0, "wrong_s": 0.0, "off_m": 0.8, "sigma_m": 0.9}
    >>> navigation_in_words(told)[49:]
    'the told place was off by up to 0.8 m, and its own map told it to ±0.9 m (1 sigma) or better'
    """
    what = " and ".join(
        f"{word} for {figures[key]:.0f} s"
        for word, key in (("lost", "lost_s"), ("wrong", "wrong_s"))
        if figures[key]
    )
    text = f"satellites were {what or 'lost'}, noticed at {figures['noticed_s']:.0f} s"
    if figures["off_m"] is None or figures["sigma_m"] is None:
        return text
    return (
        f"{text}; the told place was off by up to {figures['off_m']:.1f} m, and its own map told "
        f"it to ±{figures['sigma_m']:.1f} m (1 sigma) or better"
    )


LIFT_OFF_M = 0.3


@dataclass(slots=True)
class Count:
    """The counts of one vehicle."""

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
        """Count a new position; off the ground it may begin a sortie."""
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
        """End a sortie."""
        if self.lift_off_s is not None:
            self.flight_s += t_s - self.lift_off_s
        self.lift_off_s = None
        self.last_on_ground_s = t_s


class Counter:
    """Counts of every vehicle; give it each event before and after the step of the mission."""

    def __init__(self, numbers: Iterable[int]) -> None:
        self.vehicles: Mapping[int, Count] = {number: Count() for number in numbers}
        self.first_s: float | None = None
        """The first lift-off, mission seconds."""
        self.last_s = 0.0
        """The last touch-down."""
        self._before_s = 0.0

    def before(self, event: Event, state: State) -> None:
        """Count the time up to an event; `state` is that before it."""
        if isinstance(event, Told):  # words are no part of a flight's times
            return
        for number, vehicle in state.vehicles.items():
            elapsed_s = max(event.t_s - self._before_s, 0.0)
            _on_task(self.vehicles[number], vehicle, state, elapsed_s)
        self._before_s = max(self._before_s, event.t_s)

    def after(self, event: Event) -> None:
        """Count what an event adds."""
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
    """End a sortie that an interruption hid, without its distance; return when it ended."""
    count.position = None
    if event.airborne or count.lift_off_s is None:
        return 0.0
    last_seen_s = count.points[-1][0]
    count.land(last_seen_s)
    count.last_on_ground_s = event.t_s
    return last_seen_s


def _on_task(count: Count, vehicle: VehicleState, state: State, elapsed_s: float) -> None:
    """Add the time that a vehicle spends on the tree; one on a path is there at once."""
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
