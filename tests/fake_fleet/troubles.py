"""Troubles as values: each begins in some phase of a vehicle's flight, and may end."""

from __future__ import annotations

import math
import random
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Final, Literal, cast

from missions.flight.vehicle_state import Phase
from missions.orders import AwaitBattery, FlyPath, FlyTo, Land, Look, Sweep, TakeOff
from missions.units import GridPoint

from .aircraft import STOP_M, Aircraft, Storm, Vector

if TYPE_CHECKING:
    from .fleet import Fleet

FlightPhase = Literal["take-off", "search", "look", "explore", "return", "landing", "ground"]
PHASES: Final[tuple[FlightPhase, ...]] = (
    "take-off", "search", "look", "explore", "return", "landing", "ground",
)  # fmt: skip


Ending = Literal["release", "land", "keep", "LAND", "RTL"]
LOW_SHARE = 0.25  # share of the battery below which a pilot lands at once


@dataclass(slots=True)
class Pilot:
    """A pilot who flies through points with heights above the vehicle's home, then ends."""

    way: list[tuple[GridPoint, float]]
    ending: Ending
    capacity_wh: float
    keeps_s: float = 20.0
    done: bool = False

    def take_over(self, craft: Aircraft) -> None:
        craft.turn_switch("other")
        if not self.way:
            self._end_by_mode(craft)

    def fly(self, craft: Aircraft, dt_s: float) -> None:
        if self.done:
            return
        if craft.crashed or not (craft.flying or craft.armed):
            self.done = True
            return
        if craft.wh < LOW_SHARE * self.capacity_wh:
            self.way, self.ending = [], "land"
        if self.way:
            point, height_m = self.way[0]
            craft.target, craft.target_height_m = point, height_m
            near = craft.believed.distance_to(point) <= 2 * STOP_M
            if near and abs(craft.height_m - height_m) < 0.5:
                self.way.pop(0)
            return
        self.keeps_s -= dt_s
        self._end_by_mode(craft)
        if self.ending == "land":
            if craft.target_height_m > -50.0:
                craft.target, craft.target_height_m = craft.believed, -99.0
        elif self.ending == "release" and self.keeps_s <= 0.0:
            craft.give_back()
            self.done = True

    def _end_by_mode(self, craft: Aircraft) -> None:
        if self.ending == "LAND":
            craft.turn_switch("land")
        elif self.ending == "RTL":
            craft.turn_switch("rtl")
        self.done = self.ending in ("LAND", "RTL")


@dataclass(frozen=True, slots=True)
class Trouble:
    """One trouble of one vehicle.

    It begins `after_s` after the vehicle is first in `phase`, and lasts `for_s`. The meaning of the
    numbers and the word depends on the kind.
    """

    kind: str
    vehicle: int
    phase: FlightPhase
    after_s: float
    for_s: float = math.inf
    size: float = 0.0
    toward_rad: float = 0.0
    word: str = ""
    begun_s: float | None = None
    ended: bool = False

    @property
    def towards(self) -> Vector:
        return self.size * math.sin(self.toward_rad), self.size * math.cos(self.toward_rad)


def in_phase(fleet: Fleet, trouble: Trouble) -> bool:
    vehicle = fleet.state.vehicles[trouble.vehicle]
    order, home = vehicle.order, vehicle.return_reason is not None
    found = fleet.state.tree is not None
    if fleet.setting.strategy.patches:
        found = bool(fleet.state.belief.roi)
    if vehicle.phase in (Phase.YIELDED, Phase.GUARDED, Phase.OFFLINE):
        return False
    match trouble.phase:
        case "take-off":
            return isinstance(order, TakeOff)
        case "search":
            return isinstance(order, Sweep) or (isinstance(order, FlyPath) and not found)
        case "look":
            return isinstance(order, Look) or (isinstance(order, FlyPath) and found)
        case "explore":
            return isinstance(order, FlyTo | FlyPath) and found and not home
        case "return":
            return isinstance(order, FlyTo) and home
        case "landing":
            return isinstance(order, Land)
        case "ground":
            return isinstance(order, AwaitBattery)


# --- beginnings and ends, by kind ------------------------------------------------------------
Act = Callable[["Fleet", Trouble], None]


def _craft(name: str, value: Callable[[Trouble], object]) -> Act:
    return lambda fleet, trouble: setattr(fleet.vehicles[trouble.vehicle], name, value(trouble))


def _driver(name: str, value: Callable[[Trouble], object]) -> Act:
    return lambda fleet, trouble: setattr(fleet.drivers[trouble.vehicle], name, value(trouble))


_cut, _mend = _driver("link", lambda t: t.word), _driver("link", lambda _: "good")
_spoil, _clean = _driver("camera", lambda t: t.word), _driver("camera", lambda _: "good")


def _storm(fleet: Fleet, trouble: Trouble) -> None:
    end_s = fleet.t_s + trouble.for_s
    fleet.air.storms.append(Storm(fleet.t_s, end_s, trouble.towards))


def _jump(fleet: Fleet, trouble: Trouble) -> None:
    fleet.vehicles[trouble.vehicle].offset_m = trouble.towards
    fleet.drivers[trouble.vehicle].report_leap(trouble.size)


def _drift_ends(fleet: Fleet, trouble: Trouble) -> None:
    fleet.vehicles[trouble.vehicle].drift_m_s = (0.0, 0.0)
    fleet.vehicles[trouble.vehicle].offset_m = (0.0, 0.0)


def _fail_order(fleet: Fleet, trouble: Trouble) -> None:
    driver = fleet.drivers[trouble.vehicle]
    driver.fail_in_s = driver.clock_s + 0.1


def _refuse(fleet: Fleet, trouble: Trouble) -> None:
    fleet.drivers[trouble.vehicle].refuses += tuple(trouble.word.split())


def _pilot(fleet: Fleet, trouble: Trouble) -> None:
    craft, rng = fleet.vehicles[trouble.vehicle], fleet.rng
    if not craft.armed or craft.crashed:
        return
    where, _, ending = trouble.word.partition(" ")
    here = craft.believed
    if where == "home":
        way = [(here, 10.0 + 5.0 * rng.random()), (craft.home, 12.0)]
    else:
        way = [
            (
                GridPoint(here.east_m + rng.uniform(-15, 15), here.north_m + rng.uniform(-15, 15)),
                rng.uniform(3.0, 35.0),
            )
            for _ in range(0 if where == "here" else 3)
        ]
    full_wh = fleet.setting.mission.battery.capacity_wh
    pilot = Pilot(way, cast(Ending, ending), full_wh, keeps_s=rng.uniform(1.0, 20.0))
    pilot.take_over(craft)
    fleet.pilots[trouble.vehicle] = pilot


def _failsafe(fleet: Fleet, trouble: Trouble) -> None:
    craft = fleet.vehicles[trouble.vehicle]
    if craft.flying:
        craft.return_height_m = trouble.size
        craft.mode, craft.piloted = "follow", False
        craft.failsafe = True
        craft.switch("rtl" if trouble.word == "rtl" else "land")


def _link_failsafe(fleet: Fleet, trouble: Trouble) -> None:
    """Silence a vehicle; after some seconds its own failsafe brings it home."""
    _cut(fleet, replace(trouble, word="silent"))
    fleet.link_failsafes[trouble.vehicle] = fleet.t_s + trouble.size


def _link_is_back(fleet: Fleet, trouble: Trouble) -> None:
    fleet.link_failsafes.pop(trouble.vehicle, None)
    _mend(fleet, trouble)


def _motor(fleet: Fleet, trouble: Trouble) -> None:
    craft = fleet.vehicles[trouble.vehicle]
    if craft.flying:
        craft.motors_failed, craft.stays_armed = True, trouble.word == "armed"


def _cell(fleet: Fleet, trouble: Trouble) -> None:
    fleet.emptied[trouble.vehicle] = trouble.size
    fleet.vehicles[trouble.vehicle].wh *= 1.0 - trouble.size


def _sag(fleet: Fleet, trouble: Trouble) -> None:
    capacity_wh = fleet.setting.mission.battery.capacity_wh
    fleet.drivers[trouble.vehicle].hides_wh = trouble.size * capacity_wh


def _poor_swaps(fleet: Fleet, trouble: Trouble) -> None:
    rng = random.Random(int(trouble.size * 1e6))
    shares = [rng.uniform(0.3, 0.97) for _ in range(int(rng.uniform(1, 4)))]
    fleet.drivers[trouble.vehicle].poor_batteries = shares


def _nothing(fleet: Fleet, trouble: Trouble) -> None:
    pass


ACTS: Final[dict[str, tuple[Act, Act]]] = {
    "none": (_nothing, _nothing),
    "storm": (_storm, _nothing),
    "gnss jump": (_jump, _craft("offset_m", lambda _: (0.0, 0.0))),
    "gnss drift": (_craft("drift_m_s", lambda t: t.towards), _drift_ends),
    "compass": (
        _craft("compass_rad", lambda t: math.radians(t.size)),
        _craft("compass_rad", lambda _: 0.0),
    ),
    "noise": (_craft("noise_m", lambda t: t.size), _nothing),
    "link silent": (_cut, _mend),
    "link failsafe": (_link_failsafe, _link_is_back),
    "commands lost": (_cut, _mend),
    "acks lost": (_cut, _mend),
    "order fails": (_fail_order, _nothing),
    "order refused": (_refuse, _driver("refuses", lambda _: ())),
    "camera silent": (_spoil, _clean),
    "camera lost": (_spoil, _clean),
    "camera slow": (_spoil, _clean),
    "camera drops": (_spoil, _clean),
    "pilot": (_pilot, _nothing),
    "failsafe": (_failsafe, _nothing),
    "motor": (_motor, _nothing),
    "battery cell": (_cell, _nothing),
    "battery sag": (_sag, _driver("hides_wh", lambda _: 0.0)),
    "poor swaps": (_poor_swaps, _nothing),
    "process ends": (lambda fleet, t: fleet.die(kill=t.word == "killed", away_s=t.size), _nothing),
    "recall": (lambda fleet, _: fleet.recall(), _nothing),
}


REFUSED = (
    "FlyTo Sweep FlyPath", "Look FlyPath", "Land", "TakeOff", "ReturnToLaunch", "FlyTo Land",
)  # fmt: skip


def drawn(kind: str, vehicle: int, phase: FlightPhase, rng: random.Random) -> Trouble:
    made = Trouble(kind, vehicle, phase, rng.uniform(0.0, 8.0), toward_rad=rng.uniform(0, math.tau))
    short = rng.choice([rng.uniform(1, 8), rng.uniform(8, 60), rng.uniform(60, 200), math.inf])
    match kind:
        case "storm":
            return replace(made, size=rng.choice([7, 9, 12, 16, 20, 25]) * 1.0, for_s=short)
        case "gnss jump":
            return replace(made, size=rng.uniform(5, 60), for_s=rng.uniform(3, 60))
        case "gnss drift":
            return replace(made, size=rng.choice([0.1, 0.5, 2.0]), for_s=rng.uniform(20, 150))
        case "compass":
            return replace(made, size=rng.choice([-1, 1]) * rng.uniform(10, 150), for_s=short)
        case "noise":
            return replace(made, size=rng.uniform(0.3, 0.8))
        case "link silent" | "commands lost" | "acks lost":
            word = kind.removeprefix("link ")
            return replace(made, word=word, for_s=short)
        case "link failsafe":
            return replace(made, size=rng.uniform(5, 30), for_s=rng.choice([short, math.inf]))
        case "order refused":
            return replace(made, word=rng.choice(REFUSED), for_s=short)
        case "camera silent" | "camera lost" | "camera slow" | "camera drops":
            return replace(made, word=kind.removeprefix("camera "), for_s=short)
        case "pilot":
            where = rng.choice(["here", "roam", "roam", "home"])
            ending = rng.choice(["release", "land"])
            if ending == "land":  # by hand, or by one of two modes
                ending = ("land", "LAND", "RTL")[int(1e4 * made.toward_rad) % 3]
            return replace(made, word=f"{where} {ending}")
        case "failsafe":
            return replace(
                made, word=rng.choice(["rtl", "rtl", "land"]), size=rng.choice([15.0, 30.0])
            )
        case "motor":
            return replace(made, word=rng.choice(["armed", "disarmed"]))
        case "battery cell":
            return replace(made, size=rng.uniform(0.2, 0.5))
        case "battery sag":
            return replace(made, size=rng.choice([rng.uniform(0.05, 0.4), 1.0]), for_s=short)
        case "poor swaps":
            return replace(made, after_s=0.0, size=rng.random())
        case "process ends":
            return replace(made, word=rng.choice(["killed", "raised"]), size=rng.uniform(3, 90))
    return made
