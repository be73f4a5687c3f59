"""Flights of `uavmap.fly` against the bundled simulator, in this process, on virtual time."""

from __future__ import annotations

import math
import random
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, Final

from sitl.vehicle import SimVehicle
from tests.benchmarks import watched
from tests.referee import FINE, Holder
from tests.support.sitl_truth import RACE_S, Observer
from tests.support.small_missions import mission_text, square

from .outcome import Outcome, outcome
from .plan import Plan, plan

KINDS: Final = (
    "gps", "gps_glitch", "gps_drift", "battery_sag", "battery_cell", "compass", "wind_gust",
    "motor", "camera_stall", "camera_black", "camera_corrupt", "reject", "rc", "link",
    "companion_reboot",
)  # fmt: skip
PHASES: Final = {
    "ground": 0.0, "take-off": 5.0, "search": 14.0, "look": 24.0, "explore": 32.0,
    "return": 46.0, "landing": 58.0,
}  # fmt: skip
"""About when each phase of the small mission begins, in seconds."""
COMMANDS: Final = (20, 21, 22, 176, 192, 400, 2000)
"""RTL, land, take-off, mode, reposition, arm, capture."""
LIMIT_S: Final = 4000.0
"""Duration after which a flight counts as endless, s."""


def plan_of(seed: int) -> Plan:
    return plan(seed, KINDS, tuple(PHASES))


def fault_of(kind: str, phase: str, rng: random.Random) -> dict[str, Any]:
    """Return a fault of a kind in a phase, as `[[sim.faults]]` holds it."""
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
    """Return the mission file of a flight: a dark square of four cells, and the faults.

    `quirks` are those of the aircraft, as in the file. The receiver of a single vehicle errs in
    height.
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
"""Modes that a pilot selects."""
KEEPS_S: Final = 20.0
"""Time for which a pilot keeps a vehicle in such a mode before landing it, s."""


@dataclass(slots=True)
class Pilot:
    """A pilot who turns the mode switch of one vehicle at a moment in flight."""

    vehicle: int
    at_s: float
    mode: str
    since_s: float = math.inf
    """Time from which the pilot has the vehicle, s."""
    done: bool = False
    """The vehicle is on the ground again."""

    @classmethod
    def from_seed(cls, seed: int, vehicles: int, autopilot: str) -> Pilot:
        rng = random.Random(f"pilot {seed}")
        at_s = rng.uniform(6.0, 70.0)
        return cls(rng.randint(1, vehicles), at_s, rng.choice(TURNS[autopilot]))

    def watch(self, vehicle: SimVehicle) -> None:
        truth, t_s = vehicle.truth, vehicle.truth.t_s
        self.done = self.done or (truth.landed and math.isfinite(self.since_s))
        if truth.landed or truth.crashed or not truth.armed or self.done:
            return
        mode = truth.mode.name
        if math.isinf(self.since_s):
            # Hold takes control on a path only: elsewhere it gives the vehicle back
            takes = mode != self.mode and (self.mode != "HOLD" or mode == "OFFBOARD")
            if t_s >= self.at_s and takes and not truth.failsafe:
                self._turn(vehicle, self.mode)
        elif mode != self.mode and truth.failsafe:
            self.mode = mode  # a failsafe acted before the pilot
        elif mode != self.mode and t_s - self.since_s <= RACE_S:
            self._turn(vehicle, self.mode)  # a command was on its way: turn again
        elif mode == self.mode and t_s - self.since_s > KEEPS_S and mode not in ("LAND", "RTL"):
            self._turn(vehicle, "LAND")

    def _turn(self, vehicle: SimVehicle, mode: str) -> None:
        """Set the mode by radio control, without any link."""
        autopilot: Any = vehicle._ap
        if not vehicle.fail.rc_lost and autopilot.set_mode(type(autopilot.mode)[mode]) is None:
            self.mode, self.since_s = mode, vehicle.t_s


@dataclass(slots=True)
class Witness(Observer):
    """A witness that shows the referee a flight in which a pilot may take a vehicle."""

    pilot: Pilot | None = None

    def act(self, vehicle: SimVehicle) -> Holder:
        pilot = self.pilot
        if pilot is None or pilot.vehicle != vehicle.spec.system_id:
            return Observer.act(self, vehicle)
        pilot.watch(vehicle)
        has = math.isfinite(pilot.since_s) and not pilot.done and not vehicle.truth.failsafe
        return "pilot" if has else Observer.act(self, vehicle)


def fly(
    seed: int,
    *,
    strategy: str | None = None,
    pilots: bool = False,
    quirks: Mapping[str, str] = MappingProxyType({}),
    verbose: bool = False,
) -> Outcome:
    """Fly the flight of a seed to its end; with `pilots` a pilot takes a vehicle in it."""
    flight = plan_of(seed)
    text = text_of(flight, strategy, quirks)
    # a battery that fails and a gust take charge before it is reported
    poor = any(kind in ("battery_cell", "battery_sag", "wind_gust") for kind in flight.kinds)
    witness = Witness(
        limit_s=LIMIT_S, always=frozenset({"drained"}) if poor else FINE, missed_cells=0,
        excuses_blind=True, more_bounds={"ends_with_program": True},
    )  # fmt: skip
    if pilots:
        autopilot = "px4" if 'autopilot = "px4"' in text else "ardupilot"
        witness.pilot = Pilot.from_seed(seed, text.count("[[vehicles]]"), autopilot)
    flown = watched.fly_watched(str(flight), text, seed, observer=witness)
    if verbose:
        reported = (event for event in flown.events if event.kind not in ("tracked", "frame_seen"))
        print(*reported, text, flown.stderr, flown.summary, flown.line(), sep="\n")
    return outcome(flight, flown.referee, completed=bool(flown.summary.get("completed")))
