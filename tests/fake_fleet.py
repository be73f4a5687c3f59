"""A fleet without MAVLink: vehicles that carry out orders on time, for driving `step` to the end.

The vehicles are points that fly at the mission's speed, coast a braking distance before they heed
a new order, climb and sink at fixed rates, draw somewhat more than the nominal hover power, and
report once a second; their cameras see the truth without noise. Every tick the fleet holds itself
against what must never happen, and keeps a list of what did.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Collection
from dataclasses import dataclass, field

from shapely.geometry import Point

from missions.events import (
    Airborne,
    Arrived,
    BatterySwapped,
    Connected,
    Event,
    FrameSeen,
    Landed,
    LinkLost,
    LookEnded,
    Overridden,
    Recalled,
    Released,
    Resumed,
    Tracked,
    Vote,
)
from missions.mission_file.launch_pads import homes
from missions.mission_file.schema import Mission
from missions.orders import (
    AwaitBattery,
    FlyTo,
    Hold,
    Land,
    Look,
    Order,
    StandDown,
    Sweep,
    TakeOff,
)
from missions.state import Phase, Setting, State
from missions.step import fold, step
from missions.units import Cell, GridPoint, LatLon

TICK_S = 0.25
CLIMB_M_S = 1.5
SINK_M_S = 0.75
BRAKING_M_S2 = 2.5
HANDS_OFF = (Phase.YIELDED, Phase.FAILED, Phase.OFFLINE)


@dataclass(slots=True)
class FakeVehicle:
    """One vehicle as it really is."""

    number: int
    home: GridPoint
    position: GridPoint
    wh: float
    height_m: float = 0.0
    flying: bool = False
    order: Order | None = None
    way: list[GridPoint] = field(default_factory=list)
    coast_m: float = 0.0
    moving: bool = False
    clock_s: float = 0.0
    """Time in the present order: for frames and swaps."""
    swept_m: float = 0.0
    frames: int = 0
    linked: bool = True
    piloted: bool = False
    excused: bool = False
    """It was flown by somebody else: its reserve is not ours to keep."""
    heedless: bool = False
    """It carries on with what it did until its braking distance is used up."""


@dataclass(slots=True)
class Fleet:
    """The fleet, the state that the mission has of it, and what went wrong."""

    setting: Setting
    roi: Collection[Cell]
    draw: float = 1.08
    swap_s: float = 10.0
    t_s: float = 0.0
    state: State = field(init=False)
    vehicles: dict[int, FakeVehicle] = field(init=False)
    events: list[Event] = field(default_factory=list)
    faults: list[str] = field(default_factory=list)
    orders: list[tuple[float, int, Order]] = field(default_factory=list)
    nearest_m: float = float("inf")

    def __post_init__(self) -> None:
        mission, grid = self.setting.mission, self.setting.grid
        self.state = State.initial(self.setting)
        places = [grid.fixed(place) for place in homes(mission)]
        full_wh = mission.battery.capacity_wh
        self.vehicles = {
            n: FakeVehicle(n, place, place, full_wh) for n, place in enumerate(places, start=1)
        }

    # --- the other side ------------------------------------------------------------------
    def post(self, event: Event) -> None:
        """Hand an event to the mission, and its orders to the vehicles."""
        self.events.append(event)
        self.state, orders = step(self.setting, self.state, event)
        for number, order in orders:
            self.orders.append((self.t_s, number, order))
            vehicle = self.vehicles[number]
            phase = self.state.vehicles[number].phase
            if phase in HANDS_OFF and not isinstance(order, StandDown):
                self.fault(f"{order} for vehicle {number}, which is {phase}")
            if vehicle.linked and not vehicle.piloted:
                self._accept(vehicle, order)

    def connect(self, vehicle: FakeVehicle) -> None:
        """Report that a vehicle answers."""
        vehicle.linked = True
        self.post(
            Connected(
                vehicle.number,
                self._now(),
                vehicle.home,
                vehicle.position,
                vehicle.height_m,
                vehicle.flying,
                not vehicle.piloted,
                vehicle.wh,
            )
        )

    def fault(self, text: str) -> None:
        """Note what must not happen."""
        self.faults.append(f"{self.t_s:.2f} s: {text}")

    def _now(self) -> float:
        return round(self.t_s, 3)

    # --- running -------------------------------------------------------------------------
    def start(self) -> None:
        """Everybody answers."""
        for vehicle in self.vehicles.values():
            self.connect(vehicle)

    def run(
        self,
        limit_s: float = 6000.0,
        *,
        until: Callable[[Fleet], bool] | None = None,
    ) -> None:
        """Go on until the mission is over, or until a condition holds.

        Raises AssertionError when it does not come to an end.
        """
        end_s = self.t_s + limit_s
        while not self.state.over and not (until is not None and until(self)):
            assert self.t_s < end_s, f"no end after {limit_s:g} s\n{self.describe()}"
            self.tick()

    def tick(self) -> None:
        """One tick of everybody, then the checks."""
        self.t_s += TICK_S
        for vehicle in self.vehicles.values():
            if vehicle.flying:
                power_w = self.setting.mission.battery.hover_power_w * self.draw
                vehicle.wh -= power_w * TICK_S / 3600.0
            self._advance(vehicle)
            if vehicle.linked and abs(self.t_s % 1.0 - TICK_S * (vehicle.number % 4)) < 1e-6:
                self.post(
                    Tracked(
                        vehicle.number,
                        self._now(),
                        vehicle.position,
                        vehicle.height_m,
                        vehicle.wh,
                    )
                )
        self._check()

    def _check(self) -> None:
        flying = [v for v in self.vehicles.values() if v.flying]
        for vehicle in flying:
            if not self.setting.fence.outer.covers(Point(vehicle.position)):
                self.fault(f"vehicle {vehicle.number} is outside the fence: {vehicle.position}")
            if vehicle.wh <= 0.0:
                self.fault(f"vehicle {vehicle.number} fell out of the sky")
        for a, b in itertools.combinations(flying, 2):
            apart_m = (
                a.position.distance_to(b.position) ** 2 + (a.height_m - b.height_m) ** 2
            ) ** 0.5
            self.nearest_m = min(self.nearest_m, apart_m)
            if apart_m < self.setting.mission.team.separation_m - 1e-6:
                self.fault(f"vehicles {a.number} and {b.number} are {apart_m:.1f} m apart")

    # --- what vehicles do ----------------------------------------------------------------
    def _accept(self, vehicle: FakeVehicle, order: Order) -> None:
        speed = self.setting.mission.flight.speed_m_s
        vehicle.coast_m = speed**2 / (2 * BRAKING_M_S2) if vehicle.moving else 0.0
        if isinstance(vehicle.order, FlyTo) and vehicle.order.cell is not None and not vehicle.way:
            vehicle.way = [self._over(vehicle.order.cell)]
        vehicle.order, vehicle.clock_s, vehicle.frames, vehicle.swept_m = order, 0.0, 0, 0.0
        vehicle.heedless = vehicle.coast_m > 0.0
        if not vehicle.heedless:
            self._begin(vehicle)

    def _begin(self, vehicle: FakeVehicle) -> None:
        vehicle.heedless, vehicle.way = False, []
        order = vehicle.order
        if isinstance(order, FlyTo):
            vehicle.way = list(order.route)
        elif isinstance(order, Sweep):
            vehicle.way = [order.end]
        if isinstance(order, TakeOff | FlyTo | Sweep | Look | Land) and not vehicle.flying:
            if isinstance(order, TakeOff):
                vehicle.flying = True
            else:
                self.fault(f"{order} for vehicle {vehicle.number}, which is on the ground")

    def _advance(self, vehicle: FakeVehicle) -> None:
        step_m = self.setting.mission.flight.speed_m_s * TICK_S
        vehicle.moving = False
        if vehicle.heedless:
            coast_m = min(step_m, vehicle.coast_m)
            vehicle.coast_m -= coast_m
            if vehicle.way:
                self._move(vehicle, coast_m)
            if vehicle.coast_m <= 1e-9 or not vehicle.way:
                self._begin(vehicle)
            return
        if not vehicle.linked or vehicle.piloted:
            return
        vehicle.clock_s += TICK_S
        match vehicle.order:
            case TakeOff(height_m):
                if self._climb(vehicle, height_m):
                    self.post(Airborne(vehicle.number, self._now()))
            case Land():
                self._sink(vehicle)
            case FlyTo():
                self._fly(vehicle, vehicle.order, step_m)
            case Sweep():
                self._sweep(vehicle, vehicle.order, step_m)
            case Look():
                self._look(vehicle, vehicle.order, step_m)
            case AwaitBattery():
                if vehicle.clock_s >= self.swap_s:
                    vehicle.wh = self.setting.mission.battery.capacity_wh
                    vehicle.order = None
                    self.post(BatterySwapped(vehicle.number, self._now(), vehicle.wh))
            case Hold() | StandDown() | None:
                pass

    def _climb(self, vehicle: FakeVehicle, height_m: float) -> bool:
        """Towards a height; whether it is reached."""
        rise_m = max(-CLIMB_M_S * TICK_S, min(CLIMB_M_S * TICK_S, height_m - vehicle.height_m))
        vehicle.height_m += rise_m
        return abs(height_m - vehicle.height_m) < 1e-6

    def _sink(self, vehicle: FakeVehicle) -> None:
        vehicle.height_m -= SINK_M_S * TICK_S
        if vehicle.height_m > 0.0:
            return
        vehicle.height_m, vehicle.flying, vehicle.order = 0.0, False, None
        reserve_wh = self.setting.energy.reserve_wh
        if vehicle.wh < reserve_wh and not vehicle.excused:
            self.fault(
                f"vehicle {vehicle.number} landed with {vehicle.wh:.2f} Wh, reserve {reserve_wh:g}"
            )
        if vehicle.position.distance_to(self.state.vehicles[vehicle.number].pad) > 1.0:
            self.fault(f"vehicle {vehicle.number} landed away from home, at {vehicle.position}")
        self.post(Landed(vehicle.number, self._now(), vehicle.wh))

    def _move(self, vehicle: FakeVehicle, step_m: float) -> float:
        """Along the way; how far it went."""
        moved_m = 0.0
        while vehicle.way and moved_m < step_m - 1e-9:
            target = vehicle.way[0]
            gap_m = vehicle.position.distance_to(target)
            if gap_m <= step_m - moved_m:
                vehicle.position = target
                vehicle.way.pop(0)
                moved_m += gap_m
            else:
                share = (step_m - moved_m) / gap_m
                vehicle.position = GridPoint(
                    vehicle.position.east_m + share * (target.east_m - vehicle.position.east_m),
                    vehicle.position.north_m + share * (target.north_m - vehicle.position.north_m),
                )
                moved_m = step_m
        vehicle.moving = moved_m > 0.0 and bool(vehicle.way)
        return moved_m

    def _fly(self, vehicle: FakeVehicle, order: FlyTo, step_m: float) -> None:
        at_height = self._climb(vehicle, order.height_m)
        left_m = step_m - self._move(vehicle, step_m)
        if not vehicle.way and order.cell is not None:
            there = self._over(order.cell)
            gap_m = vehicle.position.distance_to(there)
            self._towards(vehicle, there, left_m)
            vehicle.moving = gap_m > left_m
            if gap_m > left_m:
                return
        if not vehicle.way and at_height:
            vehicle.order, vehicle.moving = None, False
            self.post(Arrived(vehicle.number, self._now(), vehicle.position))

    def _towards(self, vehicle: FakeVehicle, there: GridPoint, step_m: float) -> None:
        """Straight towards a point that may itself move."""
        way, vehicle.way = vehicle.way, [there]
        self._move(vehicle, step_m)
        vehicle.way = way

    def _sweep(self, vehicle: FakeVehicle, order: Sweep, step_m: float) -> None:
        self._climb(vehicle, order.height_m)
        before_m = vehicle.swept_m
        vehicle.swept_m += self._move(vehicle, step_m)
        done = not vehicle.way
        if vehicle.swept_m // order.every_m > before_m // order.every_m or before_m == 0.0 or done:
            self._frame(vehicle, self.setting.grid.cell_at(self._place(vehicle), self.t_s))
        if done and vehicle.order is order:
            vehicle.order, vehicle.moving = None, False
            self.post(Arrived(vehicle.number, self._now(), vehicle.position))

    def _look(self, vehicle: FakeVehicle, order: Look, step_m: float) -> None:
        self._climb(vehicle, order.height_m)
        self._towards(vehicle, self._over(order.cell), step_m)
        vehicle.moving = False
        interval_s = self.setting.mission.camera.interval_s
        due = int((vehicle.clock_s - 1.0) / interval_s + 1e-9)
        if due > vehicle.frames and vehicle.frames < order.frames:
            vehicle.frames += 1
            self._frame(vehicle, order.cell)
            if vehicle.order is order and vehicle.frames == order.frames:
                vehicle.order = None
                self.post(LookEnded(vehicle.number, self._now()))

    def _frame(self, vehicle: FakeVehicle, vantage: Cell) -> None:
        votes = tuple(
            Vote(cell, cell in self.roi, float(cell in self.roi)) for cell in vantage.cross()
        )
        self.post(FrameSeen(vehicle.number, self._now(), vantage, votes))

    def _over(self, cell: Cell) -> GridPoint:
        grid = self.setting.grid
        return grid.to_fixed(grid.centre_of(cell), self.t_s)

    def _place(self, vehicle: FakeVehicle) -> LatLon:
        return self.setting.grid.position(vehicle.position)

    # --- interruptions -------------------------------------------------------------------
    def take_over(self, number: int) -> None:
        """A pilot takes the vehicle, and keeps it where it is."""
        vehicle = self.vehicles[number]
        vehicle.piloted = vehicle.excused = True
        self._stop(vehicle)
        self.post(Overridden(number, self._now(), "LOITER"))

    def post_landed(self, number: int) -> None:
        """The pilot has put it on the ground."""
        self.post(Landed(number, self._now(), self.vehicles[number].wh))

    def give_back(self, number: int) -> None:
        """The pilot gives it back."""
        vehicle = self.vehicles[number]
        vehicle.piloted = False
        self.post(Released(number, self._now(), vehicle.position, vehicle.height_m))

    def cut_link(self, number: int) -> None:
        """Nothing is heard from a vehicle; it hovers where it is."""
        vehicle = self.vehicles[number]
        vehicle.excused = True
        vehicle.linked = False
        self._stop(vehicle)
        self.post(LinkLost(number, self._now()))

    def recall(self) -> None:
        """The operator calls everybody home."""
        self.post(Recalled(self._now()))

    def crash_and_resume(self) -> None:
        """The service dies and comes back: all that it has is its journal."""
        assert fold(self.setting, self.events) == self.state
        for vehicle in self.vehicles.values():
            self._stop(vehicle)
        self.post(Resumed(self._now()))
        for vehicle in self.vehicles.values():
            vehicle.order = None
            self.connect(vehicle)

    def _stop(self, vehicle: FakeVehicle) -> None:
        """Back to hovering, or to standing."""
        vehicle.order, vehicle.way, vehicle.moving = None, [], False
        vehicle.heedless, vehicle.coast_m = False, 0.0

    def describe(self) -> str:
        """Where everybody stands, for messages."""
        lines = [f"{self.t_s:.2f} s, {len(self.events)} events"]
        lines += [str(v) for v in self.state.vehicles.values()]
        lines += [str(v) for v in self.vehicles.values()]
        lines += [str(order) for order in self.orders[-12:]]
        return "\n".join(lines)


def fleet(mission: Mission, roi: Collection[Cell], *, draw: float = 1.08) -> Fleet:
    """A fleet for a mission on a true ROI."""
    return Fleet(Setting.of(mission), roi, draw)
