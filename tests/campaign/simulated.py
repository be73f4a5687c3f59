"""Flights of `uavmap.fly` against the bundled simulator, in this process, on virtual time."""

from __future__ import annotations

import math
import random
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any, Final

from shapely.geometry import Point

from missions.flight.setting_of import setting_of
from missions.flight.state import Setting
from missions.flight.vehicle_state import Phase, VehicleState
from missions.guardian import HARD_M_S, PAD_M
from missions.mission.checks import parse_mission
from missions.mission.energy import AIRSPEED_LIMIT_M_S
from missions.units import GridPoint
from sitl.vehicle import SimVehicle
from tests.benchmarks import watched
from tests.benchmarks.watched import FAR_M, SEEN_TO_S, Observer
from tests.support.folding import fold
from tests.support.small_missions import mission_text, square
from uavmap.aircraft.guardian.estimates import GRAVITY_M_S2
from uavmap.runner.simulation import STEP_S

from .outcome import FORBIDDEN, Outcome
from .plan import Plan, plan

KINDS: Final = (
    "gps", "gps_glitch", "gps_drift", "battery_sag", "battery_cell", "compass", "wind_gust",
    "motor", "camera_stall", "camera_black", "camera_corrupt", "reject", "rc", "link",
    "companion_reboot",
)  # fmt: skip
PHASES: Final = {
    "ground": 0.0, "take-off": 5.0, "search": 14.0, "look": 24.0, "explore": 32.0,
    "way home": 46.0, "landing": 58.0,
}  # fmt: skip
"""About when each phase of the small mission begins, in seconds."""
COMMANDS: Final = (20, 21, 22, 176, 192, 400, 2000)
"""RTL, land, take-off, mode, reposition, arm, capture."""
LED_AWAY_M: Final = 5.0
LIMIT_S: Final = 4000.0
"""A flight that has not ended by then never does."""


def plan_of(seed: int) -> Plan:
    return plan(seed, KINDS, tuple(PHASES))


def fault_of(kind: str, phase: str, rng: random.Random) -> dict[str, Any]:
    """A fault of a kind in a phase, as `[[sim.faults]]` holds it."""
    fault: dict[str, Any] = {"kind": kind, "at_s": round(PHASES[phase] + rng.uniform(0, 8), 2)}
    for_s = rng.choice([5.0, 20.0, 60.0, None])
    if for_s is not None and kind not in ("battery_cell", "companion_reboot"):
        fault["for_s"] = for_s
    bearing = round(rng.uniform(0, 360), 1)
    values: dict[str, dict[str, Any]] = {
        "gps_glitch": {"metres": rng.choice([10.0, 50.0]), "toward_deg": bearing},
        "gps_drift": {"m_s": rng.choice([0.2, 2.0]), "toward_deg": bearing},
        "battery_sag": {"volts": rng.choice([2.0, 12.0])},
        "compass": {"deg": rng.choice([20.0, -25.0, 90.0, 180.0])},
        "wind_gust": {"m_s": rng.choice([8.0, 12.0, 25.0]), "from_deg": bearing},
        "motor": {"share": rng.choice([0.0, 0.7])},
        "reject": {"command": rng.choice(COMMANDS)},
        "link": rng.choice([{"silent": True}, {"loss": 0.2}, {"delay_s": 0.6}, {"loss": 0.4}]),
    }
    return fault | values.get(kind, {})


def text_of(
    flight: Plan, strategy: str | None = None, quirks: Mapping[str, str] = MappingProxyType({})
) -> str:
    """The mission file of a flight: a dark square of four cells, and what goes wrong.

    `quirks` of the aircraft, as the file holds them. A single vehicle's receiver errs in height.
    """
    rng = random.Random(flight.seed)
    vehicles = rng.choice([1, 1, 2])
    text = mission_text(
        square(-4, 10, 24, 16), square(-40, -40, 100, 110), vehicles=vehicles, altitude_m=14.0,
        mounting="gimbal", capacity_wh=rng.choice([14.0, 25.0]), wind_m_s=rng.choice([0.0, 3.0]),
        strategy=strategy or rng.choice(["rdfs", "swath"]), regions=[square(6, 14, 8, 8)],
    )  # fmt: skip
    autopilot = rng.choice(["ardupilot", "px4"])
    text += f'\n[sim]\nautopilot = "{autopilot}"\nswap_s = 15.0\ngps_sigma_m = 0.1\n'
    text += "[sim.quirks]\n" + "".join(f"{key} = {value}\n" for key, value in quirks.items())
    for kind, phase in zip(flight.kinds, flight.phases, strict=True):
        fault = fault_of(kind, phase, rng) | {"vehicle": rng.randint(1, vehicles)}
        lines = [f"{key} = {_toml(value)}" for key, value in fault.items()]
        text += "[[sim.faults]]\n" + "\n".join(lines) + "\n"
    return text


def _toml(value: object) -> str:
    return str(value).lower() if isinstance(value, bool) else repr(value).replace("'", '"')


TURNS: Final = {
    "ardupilot": ("LAND", "RTL", "LOITER", "BRAKE", "POSHOLD", "ALT_HOLD", "STABILIZE"),
    "px4": ("LAND", "RTL", "HOLD", "POSITION", "ALTITUDE"),
}
"""What a pilot turns his switch to."""
RACE_S: Final = 0.3
"""A mode may be commanded by what was known so long ago."""
KEEPS_S: Final = 20.0
"""So long he keeps a vehicle in such a mode, then he lands it."""


@dataclass(slots=True)
class Pilot:
    """Turns the mode switch of one vehicle at a moment in flight, and holds what became of that."""

    vehicle: int
    at_s: float
    mode: str
    since_s: float = math.inf
    """Since when it is his."""
    done: bool = False
    """It is on the ground again."""
    taken: str = ""
    """The mode that somebody else put it into."""

    @classmethod
    def of(cls, seed: int, vehicles: int, autopilot: str) -> Pilot:
        rng = random.Random(f"pilot {seed}")
        at_s = rng.uniform(6.0, 70.0)
        return cls(rng.randint(1, vehicles), at_s, rng.choice(TURNS[autopilot]))

    def watch(self, vehicle: SimVehicle) -> None:
        truth, t_s = vehicle.truth, vehicle.truth.t_s
        self.done = self.done or (truth.landed and math.isfinite(self.since_s))
        if truth.landed or truth.crashed or not truth.armed or self.taken or self.done:
            return
        mode = truth.mode.name
        if math.isinf(self.since_s):
            # Hold is his on a path only: elsewhere it says that the vehicle is given back
            takes = mode != self.mode and (self.mode != "HOLD" or mode == "OFFBOARD")
            if t_s >= self.at_s and takes and not truth.failsafe:
                self._turn(vehicle, self.mode)
        elif mode != self.mode and truth.failsafe:
            self.mode = mode  # a failsafe comes before him
        elif mode != self.mode and t_s - self.since_s <= RACE_S:
            self._turn(vehicle, self.mode)  # a command was on its way: he turns it again
        elif mode != self.mode:
            self.taken = f"out of {self.mode} into {mode} after {t_s - self.since_s:.1f} s"
        elif t_s - self.since_s > KEEPS_S and mode not in ("LAND", "RTL"):
            self._turn(vehicle, "LAND")

    def _turn(self, vehicle: SimVehicle, mode: str) -> None:
        """By radio control, which no link has a part in."""
        autopilot: Any = vehicle._ap
        if not vehicle.fail.rc_lost and autopilot.set_mode(type(autopilot.mode)[mode]) is None:
            self.mode, self.since_s = mode, vehicle.t_s


@dataclass(slots=True)
class Witness(Observer):
    """The truth of a flight, with what the referee has to know."""

    pilot: Pilot | None = None

    found: list[tuple[str, str]] = field(default_factory=list)
    last: dict[int, Any] = field(default_factory=dict)
    outside_s: dict[int, float] = field(default_factory=dict)
    flagged: set[tuple[int, str]] = field(default_factory=set)
    at: dict[int, GridPoint] = field(default_factory=dict)
    struck_m_s: dict[int, float] = field(default_factory=dict)
    """How fast each came down in the moment before it met the ground last."""

    def watch(self, vehicles: Sequence[SimVehicle], setting: Setting) -> None:
        Observer.watch(self, vehicles, setting)
        for vehicle in vehicles:
            number, truth = vehicle.spec.system_id, vehicle.truth
            if self.pilot is not None and self.pilot.vehicle == number:
                self.pilot.watch(vehicle)
            at = setting.grid.fixed(truth.position)
            self.last[number], self.at[number] = truth, at
            if not truth.landed:
                self.struck_m_s[number] = -truth.velocity_m_s[2]
            out_m = float(setting.fence.outer.distance(Point(at)))
            if truth.landed or out_m < 0.01:
                self.outside_s.pop(number, None)
                continue
            # positions and velocities that agree, and lie, cannot be seen
            if _is_led_away(vehicle):
                self.outside_s[number] = truth.t_s
                continue
            since_s = self.outside_s.setdefault(number, truth.t_s)
            by_itself = truth.failsafe and truth.mode.name in RETURNS
            by_itself = by_itself or self.has(number)
            if out_m > FAR_M and not by_itself:
                self._flag(number, "far", f"{truth.t_s:.1f} s: {out_m:.0f} m outside")
            if truth.t_s - since_s > SEEN_TO_S and not by_itself:
                text = f"{truth.t_s:.1f} s: {out_m:.0f} m outside, still in {truth.mode.name}"
                self._flag(number, "breach", text)

    def has(self, number: int) -> bool:
        pilot = self.pilot
        has = pilot is not None and pilot.vehicle == number and not pilot.done
        return has and math.isfinite(pilot.since_s)

    def _flag(self, number: int, kind: str, text: str) -> None:
        if (number, kind) not in self.flagged:
            self.flagged.add((number, kind))
            self.found.append((kind, f"vehicle {number}: {text}"))


def _is_led_away(vehicle: SimVehicle) -> bool:
    """Whether the vehicle is elsewhere than its autopilot believes, by more than it may err."""
    body, believed = vehicle._body, vehicle._ap.estimate
    return math.hypot(believed.east - body.east, believed.north - body.north) > LED_AWAY_M


RETURNS: Final = ("RTL", "LAND", "SMART_RTL", "AUTO_RTL", "AUTO_LAND", "RETURN")
BLIND: Final = ("gps", "gps_glitch", "gps_drift")


def _blind(text: str, flight: Plan) -> bool:
    """Whether positions lie, or the compass or the wind is beyond what can be flown."""
    if any(kind in BLIND for kind in flight.kinds):
        return True
    lines = [line.split(" = ") for line in text.splitlines() if " = " in line]
    return any(
        (key == "deg" and abs(float(value)) > 30.0)
        or (key == "m_s" and float(value) >= AIRSPEED_LIMIT_M_S)
        for key, value in ((parts[0].strip(), parts[1]) for parts in lines)
        if key in ("deg", "m_s")
    )


def fly(
    seed: int,
    *,
    strategy: str | None = None,
    pilots: bool = False,
    quirks: Mapping[str, str] = MappingProxyType({}),
    verbose: bool = False,
) -> Outcome:
    """Fly the flight of a seed to its end; with `pilots` one takes a vehicle in it."""
    flight = plan_of(seed)
    text = text_of(flight, strategy, quirks)
    witness = Witness(limit_s=LIMIT_S)
    if pilots:
        autopilot = "px4" if 'autopilot = "px4"' in text else "ardupilot"
        witness.pilot = Pilot.of(seed, text.count("[[vehicles]]"), autopilot)
    flown = watched.flown(str(flight), text, seed, observer=witness)
    setting = setting_of(parse_mission(text, "campaign"))
    left = dict(fold(setting, flown.events).vehicles)
    found = _judged(flight, text, witness, flown.summary, left)
    if flown.raised:
        kind = "no end" if "no end" in flown.raised else "traceback"
        found.append((kind, flown.raised.strip().splitlines()[-1]))
    if verbose:
        told = (event for event in flown.events if event.kind not in ("tracked", "frame_seen"))
        print(*told, text, flown.said, flown.summary, left, witness, sep="\n")
    counts = {FORBIDDEN[kind] for kind, _ in found}
    counts.add("ok" if flown.summary.get("completed") else "inc")
    away = any(at.distance_to(_home(number)) > 2 * PAD_M for number, at in witness.at.items())
    counts.add("away" if away else "home")
    if witness.crashes:
        counts.add("crash")
    return Outcome(seed, flight.label, str(flight), frozenset(counts), tuple(found))


def _home(number: int) -> GridPoint:
    return GridPoint(8.0 * (number - 1), 0.0)


def _judged(
    flight: Plan,
    text: str,
    witness: Witness,
    summary: Mapping[str, Any],
    left: Mapping[int, VehicleState],
) -> list[tuple[str, str]]:
    """What of a flight is forbidden."""
    pilot = witness.pilot
    by_hand = pilot is not None and math.isfinite(pilot.since_s)
    blind = _blind(text, flight) or by_hand
    found = list(witness.found)
    if pilot is not None and pilot.taken:
        found.append(("taken", f"vehicle {pilot.vehicle} is taken {pilot.taken}"))
    if not blind and witness.fence_breaches:
        found.append(("breach", f"{witness.fence_breaches} breaches"))
    # what fell, as a silent one does in the end, has not landed
    if not blind and witness.reserve_violations > witness.crashes and not _poor(flight):
        found.append(("reserve", f"{witness.reserve_violations} violations"))
    for number, truth in witness.last.items():
        theirs = truth.mode.name in RETURNS or witness.has(number)
        if not truth.landed and not truth.crashed and not theirs:
            text = f"in {truth.mode.name}, with {truth.energy_wh:.1f} Wh, {_phase(left, number)}"
            found.append(("air", f"vehicle {number} is in the air {text}"))
        # (of one that never told where it is a crash is no more than a landing away from home)
        told = _phase(left, number) in (Phase.DOWN, Phase.LOST, Phase.OFFLINE)
        told = told or (number in left and left[number].landed_away_m > 0.0)
        away = witness.at[number].distance_to(_home(number)) > PAD_M
        # a fall from a quarter of a metre tells itself from a landing by no message
        hard = witness.struck_m_s.get(number, 0.0) > HARD_M_S - STEP_S * GRAVITY_M_S2
        if truth.crashed and not told and away and hard:
            found.append(("unreported", f"vehicle {number} is down as {_phase(left, number)}"))
    if summary.get("completed") and not blind:
        if summary.get("cells_missed"):
            found.append(("lie", f"completed, {summary['cells_missed']} cells missed"))
        if witness.crashes:
            found.append(("lie", "completed, with an aircraft down"))
    return found


def _phase(left: Mapping[int, VehicleState], number: int) -> Phase | None:
    return left[number].phase if number in left else None


def _poor(flight: Plan) -> bool:
    """Whether battery or wind are what goes wrong (docs/explanation/safety.md)."""
    return any(kind in ("battery_cell", "battery_sag", "wind_gust") for kind in flight.kinds)
