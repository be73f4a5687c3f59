"""Flights of fleets in this process, on virtual time: a service for each vehicle, a bad radio.

Vehicles search from high up and map from below. Therefore they change their layers all the time,
in air that is reserved with the others, or over their own pads.
"""

from __future__ import annotations

import asyncio
import random
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

from missions.errors import PreflightError
from missions.fleet_events import Partition
from tests.referee import ProductReport
from tests.support.fleet_rig import field_text
from tests.support.plans import plan_of
from tests.support.sitl_truth import Observer
from tests.support.small_missions import with_small_pictures
from uavmap.base.clock import VirtualClock, run
from uavmap.fleet.simulated_radio import LinkModel
from uavmap.runner.simulated_fleet import SimulatedFleet

from .outcome import Outcome, outcome
from .plan import Plan, plan

KINDS: Final = ("none", "motor", "link", "wind_gust", "camera_stall", "reject", "rc", "hear")
"""`hear`: for a time members do not receive each other."""
PHASES: Final = {"take-off": 8.0, "climb": 18.0, "search": 35.0, "descent": 55.0, "map": 80.0}
"""About when each phase begins, s."""
LIMIT_S: Final = 3000.0
VEHICLES: Final = 4


def plan_of_seed(seed: int) -> Plan:
    return plan(seed, KINDS, tuple(PHASES))


def radio_of(flight: Plan, rng: random.Random) -> LinkModel:
    """Return the radio of a flight: good, lossy, slow, or of a short range."""
    partitions: list[Partition] = []
    for kind, phase in zip(flight.kinds, flight.phases, strict=True):
        if kind == "hear":
            begin_s = PHASES[phase] + rng.uniform(0.0, 10.0)
            groups: Sequence[frozenset[int]] = rng.choice([(), (frozenset({1, 2}),)])
            end_s = begin_s + rng.choice([10.0, 30.0, 90.0])
            partitions.append(Partition(begin_s, end_s, tuple(groups)))
    return LinkModel(
        range_m=rng.choice([float("inf"), float("inf"), 60.0, 30.0]),
        loss=rng.choice([0.0, 0.1, 0.3]),
        delay_s=rng.choice([0.02, 0.1, 1.0]),
        jitter_s=rng.choice([0.0, 0.0, 3.0]),
        doubled=rng.choice([0.0, 0.2]),
        partitions=partitions,
    )


def text_of(flight: Plan, rng: random.Random) -> str:
    """Return the mission of a flight."""
    text = with_small_pictures(field_text(VEHICLES, high=True))
    rates = rng.choice(["", "climb_m_s = 4.0\ndescent_m_s = 3.0\n"])
    text = text.replace("[flight]\n", f"[flight]\n{rates}")
    layers = {"layer_m = 6.0": f"layer_m = {rng.choice([4.5, 5.0])}"}
    cheap = {"interval_s = 0.25": "interval_s = 0.5"}
    high = {"altitude_m = 30.0\n": "altitude_m = 36.0\n"}
    for before, after in (layers | cheap | high).items():
        text = text.replace(before, after, 1)
    for kind, phase in zip(flight.kinds, flight.phases, strict=True):
        fault = _fault(kind, phase, rng)
        if fault:
            text += "[[sim.faults]]\n" + "".join(f"{k} = {v}\n" for k, v in fault.items())
    return text


def _fault(kind: str, phase: str, rng: random.Random) -> dict[str, Any]:
    if kind in ("none", "hear"):
        return {}
    fault: dict[str, Any] = {"kind": f'"{kind}"', "vehicle": rng.randint(1, VEHICLES)}
    fault["at_s"] = round(PHASES[phase] + rng.uniform(0.0, 10.0), 2)
    if (for_s := rng.choice([5.0, 20.0, 60.0])) and kind != "motor":
        fault["for_s"] = for_s
    values: dict[str, dict[str, Any]] = {
        "link": rng.choice([{"silent": "true"}, {"loss": 0.4}, {"delay_s": 0.6}]),
        "wind_gust": {"m_s": 6.0, "from_deg": rng.choice([0.0, 90.0, 200.0])},
        "motor": {"share": 0.0},
        "reject": {"command": rng.choice([20, 22, 192])},
    }
    return fault | values.get(kind, {})


class Limited(SimulatedFleet):
    """A fleet whose flight has to end."""

    async def fly(self) -> dict[str, Any]:
        async with asyncio.timeout(LIMIT_S):
            return await super().fly()


def fly(seed: int, *, strategy: str | None = None, verbose: bool = False) -> Outcome:
    """Fly the flight of a seed to its end."""
    flight, rng, faults = plan_of_seed(seed), random.Random(seed), list[tuple[str, str]]()
    radio, text = radio_of(flight, rng), text_of(flight, rng)
    observer = Observer()
    with tempfile.TemporaryDirectory() as folder:
        fleet = Limited(plan_of("field.toml", text, seed=seed, comms="free"), Path(folder), radio)
        fleet.world.truth = observer
        observer.states = dict(fleet.flights)
        try:
            run(fleet.fly(), VirtualClock(None))
        except PreflightError:  # refused on the ground: receivers contradict the mission
            return Outcome(seed, flight.label, str(flight), frozenset({"inc", "home"}), ())
        except Exception as error:
            if verbose:
                raise
            kind = "no end" if isinstance(error, TimeoutError) else "traceback"
            faults.append((kind, f"{type(error).__name__}: {error}"))
        states = {number: one.state for number, one in fleet.flights.items()}
    completed = any(state.completed for state in states.values())
    referee = observer.end(
        ProductReport(observer.t_s, completed=completed, reported=observer.reported, faults=faults)
    )
    if verbose:
        for number, state in states.items():
            vehicle = state.vehicles[number]
            print(number, vehicle.phase, vehicle.note, state.completed)
        print(text, radio, observer.figures(), referee.forgiven, sep="\n")
    return outcome(flight, referee, completed=completed)
