"""A fleet without MAVLink: aircraft that carry out orders, to run `step` to the end.

In the unkind world troubles begin in phases of the flight (`tests.fake_fleet.troubles`). The fleet
plays the driver (`tests.fake_fleet.driver`) with its guardian, and each tick it shows the referee
(`tests.referee`) its truth (`tests.fake_fleet.record`).
"""

from __future__ import annotations

import math
import random
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, field, replace

from missions.events import Event, Recalled, Resumed
from missions.flight.setting_of import setting_of
from missions.flight.state import Setting, State
from missions.flight.step import step
from missions.guardian import Guard, Limits
from missions.mission.places import homes
from missions.mission.schema import Mission
from missions.orders import Order
from missions.units import Cell, GridPoint
from tests.referee import Referee
from tests.support.claims import CHARGES, bounds_of
from tests.support.folding import fold

from .aircraft import Air, Aircraft
from .driver import PATH_TRACK_S, TRACK_S, WATCH_S, Driver
from .record import Recorder, holder_of, report_of
from .troubles import ACTS, Pilot, Trouble, in_phase

TICK_S = 0.25
SETTLED_S = 10.0  # time that the service runs after its last vehicle: late starts show
OPERATOR_S = 600.0  # without a battery the operator recalls all vehicles
NEAR_HOME_M = 6.0  # radius around a home within which the ground is as high as there


@dataclass(slots=True)
class Fleet:
    """The fleet, the mission's state of it, and its troubles."""

    setting: Setting
    roi: Collection[Cell]
    draw: float = 1.08
    seed: int = 0
    troubles: list[Trouble] = field(default_factory=list)
    air: Air = field(default_factory=Air)
    stand_off_m: Sequence[tuple[float, float]] = ()  # from their planned homes
    receiver_sigma_m: float = 3.0  # error of heights above the sea, drawn anew after each swap
    t_s: float = 0.0
    state: State = field(init=False)
    vehicles: dict[int, Aircraft] = field(init=False)
    drivers: dict[int, Driver] = field(init=False)
    pilots: dict[int, Pilot] = field(default_factory=dict)
    link_failsafes: dict[int, float] = field(default_factory=dict)
    emptied: dict[int, float] = field(default_factory=dict)  # shares of charge lost at once
    rng: random.Random = field(init=False)
    limits: Limits = field(init=False)
    referee: Referee = field(init=False)
    recorder: Recorder = field(default_factory=Recorder)
    events: list[Event] = field(default_factory=list)
    orders: list[tuple[float, int, Order]] = field(default_factory=list)
    dead: bool = False  # the mission has ended, and no event is accepted
    homing: bool = False  # the mission failed, and its guardians still bring vehicles down
    back_s: float = math.inf  # time of the next start
    settled_s: float = 0.0

    def __post_init__(self) -> None:
        mission, grid = self.setting.mission, self.setting.grid
        self.state = self.setting.initial_state()
        self.rng = random.Random(self.seed)
        self.limits = Limits(self.setting.fence, self.setting.energy)
        self.vehicles, self.drivers = {}, {}
        for number, planned in enumerate((grid.fixed(p) for p in homes(mission)), start=1):
            east, north = self.stand_off_m[number - 1] if self.stand_off_m else (0.0, 0.0)
            place = GridPoint(planned.east_m + east, planned.north_m + north)
            craft = Aircraft(
                number, place, place, mission.battery.capacity_wh, mission.flight.speed_m_s,
                mission.battery.hover_power_w * self.draw,
                level_m=self._level_m(number, place),
                rng=random.Random(self.seed * 31 + number),
            )  # fmt: skip
            if self.setting.ground is not None:  # as set before a flight
                highest_m = mission.highest_ground_m - self.setting.ground.height_m(place)
                craft.return_height_m = highest_m + mission.altitude_m(number - 1)
            self.vehicles[number] = craft
            self.drivers[number] = Driver(
                craft, self, receiver_sigma_m=self.receiver_sigma_m,
                receivers=random.Random(self.seed * 37 + number),
            )  # fmt: skip
            self.drivers[number].switch_on()
        pads = {number: craft.home for number, craft in self.vehicles.items()}
        self.referee = Referee(bounds_of(mission, grid, pads))

    def _level_m(self, number: int, place: GridPoint) -> float:
        ground = self.setting.ground
        if ground is not None:
            return ground.height_m(place)
        return self.setting.home_level_m(number)

    @property
    def faults(self) -> list[str]:
        return [f"{kind}: {text}" for kind, text in self.referee.found]

    @property
    def stood_outside(self) -> bool:
        contains = self.setting.fence.contains
        return not all(contains(craft.home) for craft in self.vehicles.values())

    @property
    def now_s(self) -> float:
        return round(self.t_s, 3)

    def homeward(self, number: int) -> bool:
        return self.state.vehicles[number].return_reason is not None

    # --- the mission ---------------------------------------------------------------------
    def post(self, event: Event) -> None:
        """Hand an event to the mission, and its orders to the vehicles."""
        if self.is_without_service:
            return
        self.events.append(event)
        try:
            self.state, orders = step(self.state, event)
        except Exception as failure:
            text = f"{type(failure).__name__}: {failure} at {event}"
            self.referee.note(self.t_s, "traceback", text)
            self.die(kill=False, away_s=math.inf)
            return
        if self.dead:  # the guardians' last events are kept, without orders
            return
        for number, order in orders:
            self.orders.append((self.t_s, number, order))
            charge = CHARGES[self.state.vehicles[number].phase]
            name, holder = type(order).__name__, holder_of(self.vehicles[number])
            self.referee.ordered(number, self.t_s, name, charge, holder)
            self.drivers[number].give(order)

    def die(self, *, kill: bool, away_s: float) -> None:
        """End the process: killed, or by an error, after which all vehicles are brought home first.

        It starts again `away_s` later, or once all are down if that is later.
        """
        if self.dead:
            return
        self.dead, self.homing, self.back_s = True, not kill, self.t_s + away_s

    @property
    def is_without_service(self) -> bool:
        """No process controls the vehicles."""
        return self.dead and not self.homing

    def revive(self) -> None:
        """Resume from the journal, as the operator does."""
        if fold(self.setting, self.events) != self.state:
            self.referee.note(self.t_s, "fold", "the journal gives another state")
        self._take_up()

    def _take_up(self) -> None:
        self.dead, self.homing, self.back_s = False, False, math.inf
        for driver in self.drivers.values():
            driver.order, driver.course, driver.guard, driver.late = None, None, Guard(), []
            driver.connected, driver.given_up, driver.corners = False, False, None
        self.post(Resumed(self.now_s))
        for driver in self.drivers.values():
            if driver.has_telemetry:
                driver.connect()

    # --- running -------------------------------------------------------------------------
    def start(self) -> None:
        for driver in self.drivers.values():
            driver.connect()

    def run(self, limit_s: float = 6000.0, *, until: Callable[[Fleet], bool] | None = None) -> None:
        """Fly until the mission is over, or a condition holds; fail after `limit_s`."""
        end_s = self.t_s + limit_s
        while not self.ended and not (until is not None and until(self)):
            assert self.t_s < end_s, f"no end after {limit_s:g} s\n{self.describe()}"
            self.tick()

    @property
    def ended(self) -> bool:
        """The process ends: no vehicle flies, or none has anything more to do."""
        if self.dead:
            flying = any(craft.flying for craft in self.vehicles.values())
            return not flying and not math.isfinite(self.back_s)
        return self.state.is_over and self.t_s >= self.settled_s

    def tick(self) -> None:
        self.t_s += TICK_S
        self.air.step(TICK_S)
        if self.troubles:
            self._update_troubles()
        for number, pilot in self.pilots.items():
            pilot.fly(self.vehicles[number], TICK_S)
        for number, craft in self.vehicles.items():
            craft.step(TICK_S, self.air, self._ground_m(craft))
            if self.t_s >= self.link_failsafes.get(number, math.inf):
                del self.link_failsafes[number]
                if craft.flying and craft.mode == "follow":
                    failsafe = self.rng.random() < 0.5
                    craft.switch("rtl")
                    craft.failsafe, craft.unasked = failsafe, True
        if self.homing:
            self._bring_home()
        if self.is_without_service and self.t_s >= self.back_s:
            self.revive()
        if not self.dead:
            self._drive()
        self.look()

    def look(self) -> None:
        """Show the referee every vehicle as it is now."""
        for number, craft in self.vehicles.items():
            self.referee.see(number, self.recorder.sample(self, craft))

    def conclude(self, *, twice: bool = False) -> None:
        """Have the referee judge the end. `twice`: also by the journal's text."""
        self.referee.conclude(report_of(self, twice=twice))

    def _drive(self) -> None:
        for driver in self.drivers.values():
            driver.listen(TICK_S)
            driver.deliver_late()
            if driver.connected and driver.has_telemetry:
                driver.carry_out(TICK_S)
                if self._is_report_due(driver) and not self.dead:
                    driver.track()
                elif self._is_check_due(driver) and not self.dead:
                    driver.watch_over()
            elif not driver.connected:
                driver.carry_out(TICK_S)
        waited_s = max(driver.waited_s for driver in self.drivers.values())
        if waited_s > OPERATOR_S and not self.state.recalled:
            self.recall()
        ours = any(
            d.craft.armed and d.has_telemetry and not d.craft.crashed for d in self.drivers.values()
        )
        if not self.state.is_over or (ours and self.troubles):
            self.settled_s = self.t_s + (SETTLED_S if self.troubles else 0.0)

    def _bring_home(self) -> None:
        """Let the guardians act alone until all vehicles are down or under other control."""
        for driver in self.drivers.values():
            driver.listen(TICK_S)
            if driver.responsible and driver.has_telemetry:
                driver.bring_home()
                if self._is_report_due(driver):
                    driver.track()
                elif self._is_check_due(driver):
                    driver.watch_over()
        self.homing = any(driver.responsible for driver in self.drivers.values())

    def _is_report_due(self, driver: Driver) -> bool:
        """Return whether a vehicle reports its position: each second, or faster along a path."""
        if driver.course is None:
            return abs(self.t_s % TRACK_S - TICK_S * (driver.number % 4)) < 1e-6
        return self.t_s - driver.tracked_s >= PATH_TRACK_S - 1e-6

    def _is_check_due(self, driver: Driver) -> bool:
        """Return whether its guardian checks between two reports."""
        shifted_s = self.t_s - TICK_S * (driver.number % 4)
        return driver.course is None and abs(shifted_s % WATCH_S) < 1e-6

    def _ground_m(self, craft: Aircraft) -> float:
        """Return the height of the ground below a vehicle above its home, m."""
        ground = self.setting.ground
        if ground is not None:
            return ground.height_m(craft.position) - ground.height_m(craft.home)
        below_m = next(
            (v.level_m for v in self.vehicles.values()
             if v.home.distance_to(craft.position) <= NEAR_HOME_M),
            0.0,
        )  # fmt: skip
        if craft.home.distance_to(craft.position) <= NEAR_HOME_M:
            below_m = craft.level_m
        return below_m - craft.level_m

    # --- troubles ------------------------------------------------------------------------
    def _update_troubles(self) -> None:
        for i, trouble in enumerate(self.troubles):
            if trouble.ended:
                continue
            if trouble.begun_s is None:
                if not self.dead and in_phase(self, trouble):
                    self.troubles[i] = replace(trouble, begun_s=self.t_s + trouble.after_s)
                continue
            begin_s = trouble.begun_s
            begin, end = ACTS[trouble.kind]
            if begin_s <= self.t_s < begin_s + TICK_S:
                begin(self, trouble)
            elif self.t_s >= begin_s + trouble.for_s:
                end(self, trouble)
                self.troubles[i] = replace(trouble, ended=True)

    # --- interruptions by hand -----------------------------------------------------------
    def take_over(self, number: int) -> None:
        """Let a pilot take the vehicle and hold it where it is."""
        craft = self.vehicles[number]
        if not craft.armed:
            return
        self.pilots[number] = Pilot([], "keep", self.setting.mission.battery.capacity_wh)
        self.pilots[number].take_over(craft)
        self.drivers[number].listen(0.0)

    def put_down(self, number: int) -> None:
        """Let the pilot land it where it is, and leave it there."""
        self.pilots[number].ending = "land"

    def give_back(self, number: int) -> None:
        if self.pilots.pop(number, None) is None:
            return
        self.vehicles[number].give_back()
        self.drivers[number].listen(0.0)

    def cut_link(self, number: int) -> None:
        self.drivers[number].link = "silent"

    def mend_link(self, number: int) -> None:
        self.drivers[number].link = "good"

    def recall(self) -> None:
        self.post(Recalled(self.now_s))

    def crash_and_resume(self) -> None:
        """Kill the service and resume it at once from its journal."""
        assert fold(self.setting, self.events) == self.state
        self.die(kill=True, away_s=0.0)
        self._take_up()

    def describe(self) -> str:
        lines = [f"{self.t_s:.2f} s, {len(self.events)} events", *map(str, self.troubles)]
        lines += [str(v) for v in self.state.vehicles.values()]
        lines += [str(v) for v in self.vehicles.values()]
        lines += [str(order) for order in self.orders[-12:]]
        lines += [str(event) for event in self.events[-12:]]
        return "\n".join(lines)


def fleet(mission: Mission, roi: Collection[Cell], *, draw: float = 1.08) -> Fleet:
    """Return a fleet for a mission on a true ROI, in the kind world."""
    return Fleet(setting_of(mission), roi, draw)
