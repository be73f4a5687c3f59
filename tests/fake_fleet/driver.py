"""The driver of one aircraft: carries out orders, reports events, runs the guardian.

Without MAVLink it does the same as `uavmap.aircraft`. Switches set the state of its link. Orders
can be refused, fail half-way, or be carried out without an acknowledgement.
"""

from __future__ import annotations

import itertools
import math
import random
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Literal

from missions.events import (
    Airborne,
    Arrived,
    BatterySwapped,
    Connected,
    Crashed,
    Event,
    FrameLost,
    FrameSeen,
    GivenUp,
    Guarded,
    Landed,
    LiftedOff,
    LinkLost,
    LookEnded,
    OrderFailed,
    Overridden,
    Released,
    Tracked,
    Vote,
)
from missions.geo.braking import Course
from missions.guardian import (
    QUICK_DESCENT_M_S,
    Guard,
    Mode,
    Snapshot,
    Task,
    corners_home,
    quick_aim_m,
    watch,
)
from missions.orders import (
    AwaitBattery,
    FlyPath,
    FlyTo,
    Hold,
    Land,
    Look,
    Order,
    ReturnToLaunch,
    StandDown,
    Sweep,
    TakeOff,
)
from missions.units import Cell, GridPoint
from tests.support.ground.footprints import whole_cells

from .aircraft import LIFTED_M, STOP_M, Aircraft, Vector

if TYPE_CHECKING:
    from .fleet import Fleet

TRACK_S = 1.0
WATCH_S = 0.5
PATH_TRACK_S = 0.4  # on a path that is flown without stopping
LEAD_S = 0.3  # lead of the velocities: it is half a metre off its path, as a real one
LINK_LOST_S = 5.0
PATIENCE_S = 120.0  # time for which the crew waits for a silent vehicle on the ground
SPARE_S = 60.0
WORST_HEIGHT_M = 8.0  # a receiver's height above the sea is never worse
NO_ACK_S = 7.5  # without an acknowledgement a command has failed
REFUSED_S = 0.5
CLIMB_TOLERANCE_M = 0.4
PASS_M = 2.0
CORNER_M = 2.0
BRISK_M_S = 1.0
LEAP_M = 8.0  # a position that leaps farther is noticed
SLOW_M_S = 0.5
FRESH = 0.9
WIND_WINDOW = 8
MIN_WINDS = 7  # minimum measurements of a wind that is reported

Link = Literal["good", "silent", "commands lost", "acks lost"]
Camera = Literal["good", "silent", "lost", "slow", "drops"]
COMMANDS = (TakeOff, Look, Land)  # orders that end with a command that must be acknowledged


def rounded(point: GridPoint) -> GridPoint:
    return GridPoint(round(point.east_m, 2), round(point.north_m, 2))


@dataclass(slots=True)
class Driver:
    craft: Aircraft
    fleet: Fleet
    link: Link = "good"
    camera: Camera = "good"
    refuses: tuple[str, ...] = ()  # names of orders that it refuses
    poor_batteries: list[float] = field(default_factory=list)  # capacities of the next, as shares
    swap_s: float = 10.0
    swaps: int = 0  # in the present wait
    waited_s: float = 0.0
    hides_wh: float = 0.0  # error of its battery monitor
    reports_wind: bool = False
    order: Order | None = None
    clock_s: float = 0.0
    frames: int = 0
    begun: bool = False
    course: Course | None = None  # while it flies a path
    photographed_s: float = 0.0  # when the next picture on a path is due
    tracked_s: float = -math.inf
    way: list[GridPoint] = field(default_factory=list)
    guard: Guard = field(default_factory=Guard)
    connected: bool = False
    hurry: bool = False  # the guardian has it descend before it lands
    overridden: bool = False
    reported_mode: str = ""  # the mode of a pilot or a failsafe that was reported last
    was_airborne: bool = False
    silent_s: float = 0.0
    known_wh: float = 0.0
    given_up: bool = False
    asked: Mode = "follow"  # the last commanded mode; another mode is a pilot's or a failsafe's
    sent_up: bool = False  # a take-off was commanded, and no landing reported since
    receiver_sigma_m: float = 0.0
    receivers: random.Random = field(default_factory=lambda: random.Random(0))
    winds: list[Vector] = field(default_factory=list)
    late: list[tuple[float, Event]] = field(default_factory=list)
    # when and where, in truth, frames were judged, and how far they show the ground, m
    seen_from: list[tuple[float, GridPoint, float]] = field(default_factory=list)
    misplaced: bool = False  # a frame was judged while positions were off by half a cell
    corners: list[GridPoint] | None = None
    stops: bool = False  # corners of the return path after the mission has failed; None before
    fail_in_s: float = math.inf  # until the present order fails
    least_off_m: float = math.inf  # least true height above ground, less that of its layer

    @property
    def number(self) -> int:
        return self.craft.number

    @property
    def remaining_wh(self) -> float:
        return round(max(self.craft.wh - self.hides_wh, 0.0), 3)

    @property
    def position(self) -> GridPoint:
        return rounded(self.craft.believed)

    @property
    def height_m(self) -> float:
        """Return the height by telemetry, above ground where a mission flies by that."""
        return round(self.craft.height_m - self.lift_m(self.craft.believed), 2)

    def lift_m(self, point: GridPoint) -> float:
        """Return the height of the ground there above its home; 0 on flat ground."""
        ground = self.fleet.setting.ground
        return 0.0 if ground is None else ground.height_m(point) - ground.height_m(self.craft.home)

    def _note_height(self, order: Order) -> None:
        if isinstance(order, FlyTo | Sweep | Look | FlyPath):
            above_m = self.craft.height_m - self.lift_m(self.craft.position)
            self.least_off_m = min(self.least_off_m, above_m - order.height_m)

    @property
    def has_telemetry(self) -> bool:
        return self.link != "silent"

    @property
    def receives_commands(self) -> bool:
        return self.link in ("good", "acks lost")

    @property
    def home_amsl_m(self) -> float:
        return self.craft.level_m + self.craft.sea_error_m

    def switch_on(self) -> None:
        """Draw the error of its receiver, as after each change of battery."""
        error_m = self.receivers.gauss(0.0, self.receiver_sigma_m)
        self.craft.sea_error_m = max(-WORST_HEIGHT_M, min(WORST_HEIGHT_M, error_m))

    @property
    def is_foreign(self) -> bool:
        """Its mode is a pilot's or a failsafe's."""
        return self.craft.failsafe or self.craft.mode != self.asked

    def _switch(self, mode: Mode) -> None:
        self.asked = mode
        self.craft.switch(mode)

    # --- orders ----------------------------------------------------------------------------
    def give(self, order: Order) -> None:
        """Carry out an order instead of the present one."""
        if isinstance(order, FlyPath):
            self._continue_path(order)
        else:
            self.course = None
        if isinstance(order, StandDown):
            self.order = order  # it continues its present flight, and its guardian keeps watching
            return
        self.order, self.clock_s, self.frames, self.begun = order, 0.0, 0, False
        self.swaps, self.waited_s = 0, 0.0
        self.way, self.corners = self._points(order), None
        t_s = self.fleet.now_s
        if isinstance(order, ReturnToLaunch):
            self.bring_home()  # the guardian's, from now on
        elif isinstance(order, AwaitBattery):
            self.guard = self.guard.released()
        else:
            self.guard = self.guard.with_task(self._task(order, t_s))

    def _report(self, kind: Callable[..., Event], *what: object, **more: object) -> None:
        self.fleet.post(kind(self.number, self.fleet.now_s, *what, **more))

    def report_leap(self, by_m: float) -> None:
        """Report that its position has leapt, as telemetry shows."""
        reports = (
            self.connected
            and self.has_telemetry
            and not self.overridden
            and self.guard.action is None
        )
        if by_m > LEAP_M and self.craft.flying and reports and self.order is not None:
            self._fail(f"its position has jumped by {by_m:.0f} m")

    def _continue_path(self, order: FlyPath) -> None:
        """Continue the present path with this one, or begin it at rest."""
        if self.course is not None and isinstance(self.order, FlyPath):
            self.course = self.course.then(order.trajectory, self.fleet.t_s)
        else:
            self.course = Course((order.trajectory,))
            self.photographed_s = self.fleet.t_s

    def _points(self, order: Order) -> list[GridPoint]:
        if isinstance(order, FlyTo):
            return list(order.route)
        if isinstance(order, Sweep):
            return [order.end]
        return []

    def _over(self, cell: Cell) -> GridPoint:
        grid = self.fleet.setting.grid
        return grid.to_fixed(grid.centre_of(cell), self.fleet.t_s)

    def _task(self, order: Order, t_s: float) -> Task:
        here, name = self.position, type(order).__name__
        homeward, energy = self.fleet.homeward(self.number), self.fleet.setting.energy
        drift_m_s = self.fleet.setting.grid.drift_speed_m_s
        if isinstance(order, TakeOff):
            return Task("climb", t_s, (here,), homeward, order.height_m, name=name)
        if isinstance(order, FlyTo | Sweep):
            cell = order.cell if isinstance(order, FlyTo) else None
            path = (here, *self.way, *([self._over(cell)] if cell is not None else []))
            estimate_s = sum(energy.leg_s(a.distance_to(b)) for a, b in itertools.pairwise(path))
            estimate_s += abs(order.height_m - self.height_m) / 1.5
            return Task(
                "leg", t_s, path, homeward, order.height_m, estimate_s, drift_m_s, name=name
            )
        if isinstance(order, FlyPath):
            return Task(
                "path", t_s, homeward=homeward, height_m=order.height_m, drift_m_s=drift_m_s,
                name=name, course=self.course,
            )  # fmt: skip
        if isinstance(order, Look):
            return Task(
                "hold", t_s, (self._over(order.cell),), homeward, order.height_m,
                drift_m_s=drift_m_s, name=name,
            )  # fmt: skip
        if isinstance(order, Land):
            return Task("land", t_s, (here,), homeward, self.height_m, name=name)
        return Task("hold", t_s, (here,), homeward, self.height_m, name=name)

    def _begin(self) -> None:
        self.begun = True
        craft, order = self.craft, self.order
        if isinstance(order, TakeOff):
            self.asked, self.sent_up = "follow", True
            craft.take_off(order.height_m)
        elif isinstance(order, Land):
            self._switch("land")
        elif isinstance(order, Hold) and craft.armed:
            if craft.streamed is not None:
                craft.brake()
            else:
                craft.aim(craft.believed, craft.height_m)

    def carry_out(self, dt_s: float) -> None:
        order = self.order
        if self.corners is not None and not self.overridden:
            self.bring_home()
        if order is None or isinstance(order, StandDown) or self.overridden:
            return
        self.clock_s += dt_s
        if isinstance(order, AwaitBattery):
            self._await_battery()
            return
        if not self.has_telemetry:
            return
        refused = type(order).__name__ in self.refuses or (
            isinstance(order, FlyTo | FlyPath | Sweep | Look) and self.craft.mode != "follow"
        )
        if not self.begun and not refused and self.receives_commands:
            self._begin()
        if refused and self.clock_s >= REFUSED_S:
            self._fail("it was refused")
        elif self.clock_s >= NO_ACK_S and self._misses_acknowledgement(order):
            self._fail("it was not acknowledged 5 times")
        elif isinstance(order, TakeOff) and self.clock_s >= 60.0 + 3.0 * order.height_m:
            self._fail("it did not climb")
        elif self.clock_s >= self.fail_in_s:
            self.fail_in_s = math.inf
            self._fail("it failed half-way")
        elif self.begun:
            self._progress(order)

    def _misses_acknowledgement(self, order: Order) -> bool:
        """Return whether an order lacks its acknowledgement, and telemetry does not show it."""
        lands = isinstance(order, Land) and self.craft.mode == "land"
        climbs = isinstance(order, TakeOff) and self.craft.flying
        return isinstance(order, COMMANDS) and self.link != "good" and not (lands or climbs)

    def _fail(self, reason: str) -> None:
        name = type(self.order).__name__
        self.order = self.course = None
        self._report(OrderFailed, name, reason)

    def _progress(self, order: Order) -> None:
        craft = self.craft
        self._note_height(order)
        if isinstance(order, TakeOff):
            if craft.flying and craft.height_m >= order.height_m - CLIMB_TOLERANCE_M:
                self.order = None
                home = rounded(craft.home)
                self._report(Airborne, home=home, home_amsl_m=self.home_amsl_m)
        elif isinstance(order, FlyTo):
            self._fly(order)
        elif isinstance(order, FlyPath):
            self._along_path(order)
        elif isinstance(order, Sweep):
            self._sweep(order)
        elif isinstance(order, Look):
            self._look(order)
        elif isinstance(order, Land) and not craft.armed and not self.was_airborne:
            self._on_ground()  # a take-off that was cancelled in time

    def _reached(self, point: GridPoint, *, stop: bool) -> bool:
        off_m = self.craft.believed.distance_to(point)
        slow_m_s = SLOW_M_S + self.fleet.setting.grid.drift_speed_m_s
        if stop:
            return off_m <= STOP_M and self.craft.ground_speed_m_s <= slow_m_s
        return off_m <= min(PASS_M, 0.5 * self.fleet.setting.grid.cell_m)

    def _aim(self, point: GridPoint, height_m: float) -> None:
        ground = self.fleet.setting.ground
        if self.receives_commands and ground is None:
            self.craft.aim(point, height_m)
        elif self.receives_commands and ground is not None:
            here, above_m = self.craft.believed, self.height_m
            aim, aim_m = ground.sent_target(here, above_m, point, height_m)
            self.craft.aim(aim, aim_m + self.lift_m(aim))

    def _fly(self, order: FlyTo) -> None:
        final = len(self.way) <= 1 if order.cell is None else not self.way
        target = self.way[0] if self.way else (
            self._over(order.cell) if order.cell is not None else self.craft.believed
        )  # fmt: skip
        self._aim(target, order.height_m)
        if not self._reached(target, stop=order.stop or not final):
            return
        if not final:
            self.way.pop(0)
        elif abs(self.height_m - order.height_m) <= 1.0:
            self.order = None
            self._report(Arrived, self.position)

    def _sweep(self, order: Sweep) -> None:
        self._aim(order.end, order.height_m)
        every_s = order.every_m / self.fleet.setting.mission.flight.speed_m_s
        done = self._reached(order.end, stop=False)
        if self.clock_s >= self.frames * every_s or done:
            self.frames += 1
            here, grid = self.position, self.fleet.setting.grid
            self._frame(grid.cell_of(grid.to_moving(here, self.fleet.t_s)))
        if done and self.order is order:
            self.order = None
            self._report(Arrived, self.position)

    def _along_path(self, order: FlyPath) -> None:
        """Stream setpoints and take pictures until at rest at the end."""
        course, craft, t_s = self.course, self.craft, self.fleet.t_s
        assert course is not None
        ahead = course.at(t_s + LEAD_S)
        if self.receives_commands:
            place = course.at(t_s).place
            height_m = order.height_m + self.lift_m(place)
            craft.stream(place, (ahead.v_east_m_s, ahead.v_north_m_s), height_m)
        if t_s >= self.photographed_s:
            self.photographed_s = max(self.photographed_s + order.every_s, t_s)
            self._frame(None)
        end = course.at(t_s).place
        slow_m_s = SLOW_M_S + self.fleet.setting.grid.drift_speed_m_s
        there = craft.believed.distance_to(end) <= STOP_M
        at_rest = there and craft.ground_speed_m_s <= slow_m_s
        if self.order is order and t_s >= course.end_s and at_rest:
            self.order, self.course = None, None
            craft.brake()
            self._report(Arrived, self.position)

    def _look(self, order: Look) -> None:
        self._aim(self._over(order.cell), order.height_m)
        interval_s = self.fleet.setting.mission.camera.interval_s
        if self.clock_s >= 1.0 + (self.frames + 1) * interval_s:
            self.frames += 1
            self._frame(order.cell)
            if self.order is order and self.frames >= order.frames:
                self.order = None
                self._report(LookEnded)

    # --- the camera ------------------------------------------------------------------------
    def _frame(self, vantage: Cell | None) -> None:
        """Take a picture of the ground below, filed under the estimated position.

        Without a vantage the picture judges every cell that it shows whole.
        """
        now_s, rng = self.fleet.now_s, self.fleet.rng
        if self.camera == "silent":
            return
        if self.camera == "lost" or (self.camera == "drops" and rng.random() < 0.5):
            self._report(FrameLost, "the picture cannot be read")
            return
        cell_m = self.fleet.setting.grid.cell_m
        east, north = (round(-error / cell_m) for error in self.craft.error_m)
        if east or north:
            self.misplaced = True
        roi = self.fleet.roi
        votes = []
        shown = self._visible_cells() if vantage is None else vantage.cross()
        for cell in shown:
            positive = Cell(cell.east + east, cell.north + north) in roi
            votes.append(Vote(cell, positive, float(positive)))
        above_m = self.fleet.setting.mission.overview_above_m
        high = True if above_m is not None and self.height_m > above_m else None
        event = FrameSeen(self.number, now_s, vantage, tuple(votes), overview=high)
        reach_m = 0.0 if vantage is not None else self._reach_m()
        self.seen_from.append((now_s, self.craft.position, reach_m))
        if self.camera == "slow":
            self.late.append((self.fleet.t_s + rng.uniform(0.5, 6.0), event))
        else:
            self.fleet.post(event)

    def _reach_m(self) -> float:
        optics = self.fleet.setting.mission.camera.optics
        return 0.5 * optics.footprint(max(self.height_m, 0.1)).short_m

    def _visible_cells(self) -> tuple[Cell, ...]:
        setting, craft = self.fleet.setting, self.craft
        camera, grid = setting.mission.camera, setting.grid
        yaw_rad = math.radians(setting.yaw_deg + camera.yaw_deg) - grid.convergence_rad
        below = grid.to_moving(craft.believed, self.fleet.t_s)
        footprint = camera.optics.footprint(max(self.height_m, 0.1))
        return whole_cells(footprint, below, yaw_rad, grid.cell_m, camera.pose_error_m)

    def deliver_late(self) -> None:
        due = [event for at_s, event in self.late if at_s <= self.fleet.t_s]
        self.late = [(at_s, event) for at_s, event in self.late if at_s > self.fleet.t_s]
        for event in due:
            self.fleet.post(event)

    # --- what happens by itself ------------------------------------------------------------
    def connect(self) -> None:
        craft = self.craft
        self.connected, self.given_up, self.silent_s = True, False, 0.0
        self.was_airborne = craft.flying
        if not craft.flying:
            self.asked, self.sent_up = craft.mode, False
        ours = not self.is_foreign
        self.overridden = craft.flying and not ours
        self.order = self.course = None
        if not craft.flying:
            self.guard = self.guard.released()
        action = self.guard.action
        self._report(
            Connected, rounded(craft.home), self.position, self.height_m, craft.flying, ours,
            self.remaining_wh, home_amsl_m=self.home_amsl_m,
            mode=craft.mode if craft.flying else None,
        )  # fmt: skip
        if action is not None and craft.flying and ours:
            self.guard = self.guard.with_action(action, self.fleet.now_s)
            reason = "it goes on with what it had begun"
            self._report(Guarded, action, reason)

    def listen(self, dt_s: float) -> None:
        """Watch the link, the mode and the ground."""
        if not self.has_telemetry:
            self._silent(dt_s)
            return
        if not self.connected:
            self.connect()
            return
        self.silent_s, self.known_wh = 0.0, self.remaining_wh
        craft = self.craft
        others = craft.armed and self.is_foreign
        mode = self._mode_name()
        if others and (not self.overridden or mode != self.reported_mode):
            self.overridden, self.reported_mode = True, mode
            self._report(Overridden, mode)
        elif self.overridden and craft.armed and craft.mode == "follow" and not craft.failsafe:
            self.overridden, self.asked = False, "follow"
            self._report(Released, self.position, self.height_m)
        if craft.armed and craft.flying and craft.height_m > LIFTED_M and not self.was_airborne:
            self.was_airborne = True
            self._report(LiftedOff)
        elif not craft.armed and self._owes_landing:
            self._on_ground()

    @property
    def _owes_landing(self) -> bool:
        """A landing is still to be reported: it flew, or its guardian had acted."""
        return self.was_airborne or (self.guard.action is not None and not self.guard.down)

    def _mode_name(self) -> str:
        return {"rtl": "RTL", "land": "LAND", "other": "LOITER"}.get(self.craft.mode, "failsafe")

    def _on_ground(self) -> None:
        self.was_airborne = self.sent_up = False
        self.asked = self.craft.mode
        if self.watch_over():
            return  # its crash is reported already
        self.guard, self.order = self.guard.released(), None
        self._report(Landed, self.remaining_wh, position=self.position)

    def _silent(self, dt_s: float) -> None:
        self.silent_s += dt_s
        if self.connected and self.silent_s >= LINK_LOST_S:
            self.connected = False
            self._report(LinkLost)
        elif not self.connected and not self.given_up:
            lasts_s = PATIENCE_S
            if self.was_airborne or self.sent_up:
                hover_w = self.fleet.setting.mission.battery.hover_power_w
                lasts_s = self.known_wh * 3600.0 / hover_w + SPARE_S
            if self.silent_s > lasts_s:
                self.given_up = True
                reason = f"it has been silent for {self.silent_s:.0f} s"
                self._report(GivenUp, reason)

    @property
    def responsible(self) -> bool:
        """Its guardian has to bring it home, until its end was reported."""
        in_air = self.craft.flying or (self.was_airborne and not self.guard.down)
        return in_air and not self.overridden and not self.given_up

    def bring_home(self) -> None:
        """Fly home along corners of the fence while it takes targets; then by RTL."""
        craft, t_s, way = self.craft, self.fleet.now_s, self.corners
        if self.guard.action is not None:
            return
        if way is None:
            self.order = self.course = None
            way = self.corners = self._corners()
            self.stops = bool(way) and craft.ground_speed_m_s > BRISK_M_S
            if self.stops:  # a fast vehicle flies on for a while, perhaps over a corner
                way[:] = [self.position]
            self._turn(way)
        if way and craft.mode == "follow" and "FlyTo" not in self.refuses:
            self._aim(way[0], self.guard.task.height_m)
            if self.stops and craft.ground_speed_m_s <= BRISK_M_S:
                self.stops, way[:] = False, self._corners()
                self._turn(way)
            elif not self.stops and self.position.distance_to(way[0]) <= CORNER_M:
                way.pop(0)
                self._turn(way)
        else:
            self.corners = None
            self.guard = self.guard.with_action("rtl", t_s)
            self._insist()

    def _corners(self) -> list[GridPoint]:
        home = rounded(self.craft.home)
        return list(corners_home(self.fleet.limits.fence, self.position, home))

    def _turn(self, way: list[GridPoint]) -> None:
        if not way:
            return
        path = (self.position, way[0])
        estimate_s = self.fleet.setting.energy.leg_s(path[0].distance_to(path[1])) + 5.0
        self.guard = self.guard.with_task(
            Task("leg", self.fleet.now_s, path, homeward=True, height_m=self.height_m,
                 estimate_s=estimate_s, name="return path")
        )  # fmt: skip

    def track(self) -> None:
        craft, self.tracked_s = self.craft, self.fleet.t_s
        measures = craft.flying and craft.height_m > 2.0
        self.winds = [*self.winds[-WIND_WINDOW:], craft.wind_m_s] if measures else []
        here = self.position, self.height_m, self.remaining_wh
        self._report(Tracked, *here, wind_m_s=self.measured_m_s())
        self.watch_over()

    def measured_m_s(self) -> float | None:
        """Return the wind that its telemetry reports; None if it reports none."""
        if not self.reports_wind or len(self.winds) < MIN_WINDS:
            return None
        east, north = (sum(parts) / len(self.winds) for parts in zip(*self.winds, strict=True))
        return round(math.hypot(east, north), 1)

    def watch_over(self) -> bool:
        """Run the guardian's check; return whether it found the vehicle down."""
        craft, now_s = self.craft, self.fleet.now_s
        mode: Mode = "other" if self.overridden else craft.mode
        wind_m_s = self.measured_m_s()
        seen = Snapshot(
            now_s, self.position, self.height_m, craft.ground_speed_m_s, craft.home, craft.armed,
            craft.flying or (craft.crashed and craft.armed), mode, self.remaining_wh, wind_m_s,
        )  # fmt: skip
        self.guard, verdict = watch(self.fleet.limits, self.guard, seen)
        if verdict is None:
            self._insist()
            return False
        if verdict.rung == "report":
            name = self.guard.task.name
            self.order = self.course = None
            self._report(OrderFailed, name, verdict.reason, behind=verdict.behind)
        elif verdict.rung == "crashed":
            self.order, self.was_airborne = None, False
            self._report(Crashed, self.position, verdict.reason)
            return True
        else:
            self.hurry = verdict.hurry
            self._insist()
            self._report(Guarded, verdict.rung, verdict.reason)
        return False

    def _insist(self) -> None:
        """Repeat the guardian's command until the vehicle executes it."""
        action, craft = self.guard.action, self.craft
        named = {"rtl": "ReturnToLaunch", "land": "Land"}
        if action is None or self.overridden or not self.receives_commands or not craft.armed:
            return
        aim_m = quick_aim_m(self.height_m) if action == "land" and self.hurry else None
        if aim_m is not None:
            self._switch("follow")
            craft.aim(craft.believed, aim_m + self.lift_m(craft.believed))
            craft.descent_m_s = QUICK_DESCENT_M_S
        elif named[action] not in self.refuses:
            self._switch(action)

    def _await_battery(self) -> None:
        self.waited_s = self.clock_s
        if self.clock_s < self.swap_s * (1 + self.swaps) or self.craft.flying:
            return
        self.swaps += 1
        capacity_wh = self.fleet.setting.mission.battery.capacity_wh
        share = self.poor_batteries.pop(0) if self.poor_batteries else 1.0
        self.craft.wh = share * capacity_wh
        self.switch_on()
        if self.remaining_wh >= FRESH * capacity_wh and self.has_telemetry:
            self.order, self.waited_s = None, 0.0
            self._report(BatterySwapped, self.remaining_wh)
