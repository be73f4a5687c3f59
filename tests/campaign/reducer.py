"""Flights of a fleet of points: the reducer and the guardian's rules in an unkind world."""

from __future__ import annotations

import math
import random

from missions.events import FrameSeen, Tracked
from missions.flight.setting_of import setting_of
from missions.mission.schema import Mission
from tests.fake_fleet import Fleet
from tests.fake_fleet.aircraft import Air
from tests.fake_fleet.troubles import ACTS, PHASES, Trouble, drawn
from tests.support.small_missions import at_heights, scattered, unkind_scenario

from .outcome import Outcome, outcome
from .plan import Plan, plan
from .tight import Tight, tight_scenario

LIMIT_S = 4000.0
KINDS = (*ACTS, "homes")
"""`homes`: homes lie at different heights, and vehicles stand beside their planned places."""
LEGS = ("search", "explore", "return")
TIGHT = (1, 3, 5)
"""Last digits of seeds whose missions press on energy and airspace (`tests.campaign.tight`)."""


def plan_of(seed: int) -> Plan:
    return plan(seed, KINDS, PHASES)


def tight_of(seed: int, strategy: str | None = None) -> Tight | None:
    """Return the tight mission of a seed; None if its mission is another."""
    return tight_scenario(seed, strategy) if seed % 10 in TIGHT else None


def fleet_of(
    flight: Plan,
    strategy: str | None = None,
    *,
    find: str = "first",
    receiver_sigma_m: float = 3.0,
    pads_m: float = 0.0,
) -> Fleet:
    """Return the fleet of a flight, before anything has happened.

    `pads_m` is the maximum difference in height of two pads where the flight has no trouble
    with them.
    """
    rng = random.Random(flight.seed)
    tight = tight_of(flight.seed, strategy)
    scenario = unkind_scenario(flight.seed, strategy) if tight is None else tight.scenario
    if find != "first":
        scenario = scattered(scenario, flight.seed, high=find == "all, from on high")
    vehicles = len(scenario.mission.vehicles)
    chosen, off_m = scenario.mission, []
    if "homes" in flight.kinds:
        chosen, off_m = _homes(chosen, random.Random(flight.seed + 2))
    elif pads_m:
        heights = random.Random(flight.seed + 3)
        chosen = at_heights(
            chosen, [0.0, *(pads_m * heights.uniform(-0.5, 0.5) for _ in range(vehicles - 1))]
        )
    setting = setting_of(chosen)
    given = setting.energy.wind_m_s
    bearing, wind_m_s = rng.uniform(0.0, math.tau), 0.8 * given
    draw = rng.uniform(0.95, 1.05)
    if tight is not None:
        draw, wind_m_s = tight.draw, tight.wind_m_s
    air = Air(
        (wind_m_s * math.sin(bearing), wind_m_s * math.cos(bearing)),
        gust_m_s=0.1 * given + 0.3,
        rng=random.Random(flight.seed + 1),
    )
    made = Fleet(
        setting, scenario.roi, draw=draw, seed=flight.seed, air=air,
        receiver_sigma_m=receiver_sigma_m, stand_off_m=off_m,
    )  # fmt: skip
    made.troubles = _troubles(flight, vehicles, rng)
    reports_wind = rng.random() < 0.8
    if tight is not None:
        reports_wind = tight.reports_wind
    has_failsafe = rng.random() < 0.5
    for number, craft in made.vehicles.items():
        craft.noise_m = max(craft.noise_m, 0.2)
        made.drivers[number].reports_wind = reports_wind
        made.drivers[number].swap_s = rng.uniform(3.0, 20.0)
        craft.return_height_m = rng.choice([15.0, 30.0])
        if has_failsafe:
            craft.low_wh = 0.1 * scenario.mission.battery.capacity_wh
    return made


def _homes(mission: Mission, rng: random.Random) -> tuple[Mission, list[tuple[float, float]]]:
    heights = [0.0, *(rng.choice([0.0, rng.uniform(-6.0, 8.0)]) for _ in mission.vehicles[1:])]
    off_m = [(rng.gauss(0.0, 1.5), rng.gauss(0.0, 1.5)) for _ in heights]
    return at_heights(mission, heights), off_m


def _troubles(flight: Plan, vehicles: int, rng: random.Random) -> list[Trouble]:
    troubles = []
    for kind, phase in zip(flight.kinds, flight.phases, strict=True):
        if kind not in ACTS:
            continue
        trouble = drawn(kind, rng.randint(1, vehicles), phase, rng)  # type: ignore[arg-type]
        troubles.append(trouble)
    return troubles


def has_team(seed: int) -> bool:
    """Return whether several vehicles fly."""
    tight = tight_of(seed)
    scenario = unkind_scenario(seed) if tight is None else tight.scenario
    return len(scenario.mission.vehicles) > 1


def fly(
    seed: int,
    *,
    strategy: str | None = None,
    find: str = "first",
    receiver_sigma_m: float = 3.0,
    pads_m: float = 0.0,
    verbose: bool = False,
) -> Outcome:
    flight = plan_of(seed)
    fleet = fleet_of(flight, strategy, find=find, receiver_sigma_m=receiver_sigma_m, pads_m=pads_m)
    fleet.start()
    try:
        fleet.run(LIMIT_S)
    except AssertionError as error:
        fleet.referee.note(fleet.t_s, "no end", str(error).partition("\n")[0])
    except Exception as error:
        text = f"{type(error).__name__}: {error}"
        fleet.referee.note(fleet.t_s, "traceback", text)
        if verbose:
            raise
    fleet.conclude(twice=seed % 5 == 0)
    if verbose:
        narrate(fleet)
    return outcome(flight, fleet.referee, completed=fleet.state.completed)


def narrate(fleet: Fleet) -> None:
    """Print all events in their order, but for positions and frames."""
    lines = [
        (event.t_s, 0, str(event))
        for event in fleet.events
        if not isinstance(event, Tracked | FrameSeen)
    ]
    lines += [(t_s, 1, f"    -> {number}: {order}") for t_s, number, order in fleet.orders]
    for _, _, line in sorted(lines):
        print(line)
    print(fleet.describe())
