"""A simulated fleet to which things happen, in one process and on virtual time, and what must hold.

    Mishaps -> flown(...) -> Outcome: what was forbidden, and what was said

A member's program dies as a process does: no goodbye, its queue is lost, nothing more goes to its
vehicle, which is left with its autopilot; it starts again with its journal.
"""

from __future__ import annotations

import asyncio
import itertools
import math
import traceback
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

from missions.flight.setting import Setting
from missions.flight.setting_of import setting_of
from missions.flight.state import State
from missions.units import Cell, GridPoint
from sitl.vehicle import SimVehicle
from tests.support.plans import plan_of
from tests.support.said import Said
from tests.support.small_missions import Points, joined, mission_text, square
from uavmap.base.clock import VirtualClock, run
from uavmap.base.messages import shown_on
from uavmap.fleet.radio import Radio, SealedRadio
from uavmap.fleet.simulated_radio import LinkModel
from uavmap.journal.event_log import Journal
from uavmap.journal.flight_plan import JOURNAL, FlightPlan
from uavmap.output.facts.figures import figures
from uavmap.output.facts.score import MISSED_SHARE, cells_near, shares_of, true_roi
from uavmap.output.merging import Source, merged
from uavmap.runner.one_flight import Flight
from uavmap.runner.operator.onlooker import folded
from uavmap.runner.simulated_fleet import SimulatedFleet, of_member
from uavmap.runner.simulation import Truth

BOX: Final = square(-6.0, 14.0, 56.0, 48.0)
PADS: Final = [(0.0, 0.0), (16.0, 0.0), (32.0, 0.0)]
TRUE: Final = [(10.0, 30.0), (44.0, 26.0), (46.0, 44.0), (30.0, 52.0), (12.0, 46.0)]
FAR: Final = [(-4.0, 52.0), (2.0, 52.0), (2.0, 60.0), (-4.0, 60.0)]
"""Another patch, for a search that finds all."""
MOST_S: Final = 1_500.0
"""Whoever has not ended by then does not end."""
CONTACT_S: Final = 30.0
"""Who could hear each other for so long at the end know the same."""
BREACH_M: Final = 0.05
"""Less than this too near is rounding."""


def field_text(
    vehicles: int = 3,
    *,
    box: Points = BOX,
    region: Points = TRUE,
    high: bool = False,
    more: str = "",
) -> str:
    """A field with a region, pads in a row south of it; `high`: two patches, all looked for, from
    30 m."""
    text = mission_text(
        box, square(-20.0, -14.0, 84.0, 92.0), vehicles=vehicles, homes=PADS[:vehicles],
        capacity_wh=60.0, strategy="swath", regions=[region, FAR] if high else [region],
    )  # fmt: skip
    if high:
        text = text.replace("[search]\n", '[search]\nfind = "all"\naltitude_m = 30.0\n')
    return text + more


@dataclass(frozen=True, slots=True)
class Death:
    """A member's program dies, and starts again; its clock has gone on meanwhile."""

    vehicle: int
    at_s: float
    for_s: float


@dataclass(frozen=True, slots=True)
class Mishaps:
    """What happens to a fleet; seconds of the world, by vehicle."""

    model: LinkModel
    ahead_s: Mapping[int, float]
    """By how much a member's clocks are ahead."""
    deaths: tuple[Death, ...]
    lost: frozenset[int]
    """Vehicles whose motor fails: they fall, wherever that is."""


@dataclass(slots=True)
class Watch(Truth):
    """What the simulator watches, and who came too near to whom, and when."""

    apart_m: float = 0.0
    lost: frozenset[int] = frozenset()
    near: list[str] = field(default_factory=list)
    _near: dict[tuple[int, int], float] = field(default_factory=dict)

    def watch(self, vehicles: Sequence[SimVehicle], setting: Setting) -> None:
        # (a vehicle that falls is nobody's fault in the air)
        steered = [v for v in vehicles if v.spec.system_id not in self.lost or v.truth.landed]
        Truth.watch(self, steered, setting)
        places = [
            (v.spec.system_id, setting.grid.fixed(v.truth.position), v.up_m)
            for v in steered
            if not v.truth.landed
        ]
        now_s = asyncio.get_running_loop().time()
        for (a, at, high_m), (b, there, low_m) in itertools.combinations(places, 2):
            distance_m = math.hypot(at.distance_to(there), high_m - low_m)
            if distance_m < self.apart_m - BREACH_M and now_s - self._near.get((a, b), -9.0) > 5.0:
                self._near[a, b] = now_s
                self.near.append(
                    f"{a} and {b} {distance_m:.1f} m apart at {now_s:.1f} s, "
                    f"{_at(at, high_m)} and {_at(there, low_m)}"
                )


@dataclass(slots=True)
class Outcome:
    forbidden: list[str]
    said: list[str]


@dataclass(slots=True)
class Mortal:
    """A radio that is silent once its program has died."""

    radio: Radio
    dead: bool = False

    @property
    def overhead_bytes(self) -> int:
        return self.radio.overhead_bytes

    def send(self, datagram: bytes) -> None:
        if not self.dead:
            self.radio.send(datagram)

    def listen(self, heard: Callable[[bytes], None]) -> None:
        self.radio.listen(heard)


class Beset(SimulatedFleet):
    def __init__(self, plan: FlightPlan, folder: Path, mishaps: Mishaps) -> None:
        super().__init__(plan, folder, mishaps.model)
        self.mishaps = mishaps
        self.watched = Watch(apart_m=self.setting.mission.team.separation_m, lost=mishaps.lost)
        self.world.truth = self.watched
        self.ended_s: dict[int, float] = {}
        self.begun_s: dict[int, float] = {}
        self.radios: dict[int, Mortal] = {}

    def radio(self, flight: Flight, number: int, start: int = 1) -> SealedRadio:
        sealed = super().radio(flight, number, start)
        self.radios[number] = Mortal(sealed.radio)
        return SealedRadio(self.radios[number], sealed.seal)

    def again(self, number: int) -> Flight:
        at = self.folder(number)
        journal = Journal.open(at / JOURNAL)
        own = FlightPlan.read(journal)
        mine = setting_of(self.setting.mission, number)
        return Flight(own, mine, at, journal, folded(mine, journal.events()))

    async def live(self, number: int) -> None:
        loop, mishaps = asyncio.get_running_loop(), self.mishaps
        flight = self.flights[number]
        flight.clock.set(mishaps.ahead_s.get(number, 0.0))
        deaths = [death for death in mishaps.deaths if death.vehicle == number]
        for start, death in enumerate(sorted(deaths, key=lambda d: d.at_s), start=1):
            program = asyncio.create_task(self._program(flight, number, start))
            await asyncio.wait([program], timeout=max(death.at_s - loop.time(), 0.0))
            if program.done():
                await program
                return
            clock_s = flight.clock.now_s() - loop.time()
            await self._die(number, flight, program)
            await asyncio.sleep(death.for_s)
            flight = self.flights[number] = self.again(number)
            flight.clock.set(clock_s + loop.time())
        await self._program(flight, number, len(deaths) + 1)

    async def _program(self, flight: Flight, number: int, start: int) -> None:
        loop = asyncio.get_running_loop()
        self.begun_s[number] = loop.time()
        with of_member(number):
            await flight.fly_member(self.world, self.radio(flight, number, start))
        self.air.silence(number)
        self.ended_s[number] = loop.time()

    async def _die(self, number: int, flight: Flight, program: asyncio.Task[None]) -> None:
        self.world.open_session(number - 1, lambda frame: None)  # nobody hears it any more
        self.air.silence(number)
        self.radios[number].dead = True  # what was scheduled may still run, unheard
        flight._journal.close()
        program.cancel()
        await asyncio.gather(program, return_exceptions=True)


def flown(text: str, mishaps: Mishaps, folder: Path, seed: int = 1) -> Outcome:
    plan = plan_of("field.toml", text, seed=seed, comms="free")
    said = Said()
    fleet = Beset(plan, folder, mishaps)
    forbidden: list[str] = []

    async def fly() -> None:
        async with asyncio.timeout(MOST_S):
            await fleet.fly()

    try:
        with shown_on(said):
            run(fly(), VirtualClock())
    except TimeoutError:
        forbidden.append(f"no end: {sorted(set(fleet.flights) - set(fleet.ended_s))}")
    except BaseExceptionGroup as failed:
        forbidden.append(f"failed: {_leaves(failed)}")
    for flight in fleet.flights.values():
        flight._journal.close()
    forbidden += [f"mute: {n}" for n in fleet.flights if not fleet.air.sent_bytes.get(n)]
    forbidden += _of_the_air(fleet) + _of_the_maps(fleet)
    return Outcome(forbidden, said)


def _of_the_air(fleet: Beset) -> list[str]:
    watched, found = fleet.watched, [f"near: {text}" for text in fleet.watched.near]
    if watched.fence_breaches:
        found.append(f"fence: {watched.fence_breaches}")
    if watched.reserve_violations:
        found.append(f"reserve: {watched.reserve_violations}")
    for vehicle in fleet.world.vehicles:
        number = vehicle.spec.system_id
        if not vehicle.truth.landed:
            found.append(f"air: {number} is left in the air")
        if vehicle.truth.crashed and number not in fleet.mishaps.lost:
            found.append(f"crash: {number}")
    return found


def _of_the_maps(fleet: Beset) -> list[str]:
    sources = [Source.read(fleet.folder(number)) for number in fleet.flights]
    regions: dict[int, frozenset[Cell]] = {}
    for source in sources:
        setting = source.plan.known_setting()
        state = joined(setting, State.initial(setting), source.events)
        regions[source.plan.member or 0] = frozenset(state.belief.roi)
    forbidden = []
    for one, other in itertools.combinations(regions, 2):
        begun_s = max(fleet.begun_s.get(one, 9e9), fleet.begun_s.get(other, 9e9))
        ended_s = min(fleet.ended_s.get(one, 0.0), fleet.ended_s.get(other, 0.0))
        if ended_s - begun_s > CONTACT_S and regions[one] != regions[other]:
            off = len(regions[one] ^ regions[other])
            forbidden.append(f"maps: {one} and {other} differ in {off} cells")
    plan, events = merged(sources)
    setting = plan.known_setting()
    state, _ = figures(setting, events)
    # (what was decided wrongly is the detector's affair: cells that the region covers by half)
    truth = true_roi(setting.mission, setting.grid)
    near = cells_near(truth, setting.grid)
    shares = shares_of(near, truth, setting.grid)
    orphans = [c for c in near if shares[c] >= MISSED_SHARE and state.belief.verdict(c) is None]
    whole = state.exploration_finished and not (state.undecided or state.unsearched)
    if (orphans or not whole) and len(fleet.mishaps.lost) < len(fleet.flights):
        forbidden.append(
            f"orphans: {len(orphans)} of the region, {len(state.undecided)} undecided, "
            f"{len(state.unsearched)} lanes, explored {state.exploration_finished}"
        )
    return forbidden


def _at(place: GridPoint, height_m: float) -> str:
    return f"({place.east_m:.0f}, {place.north_m:.0f}, {height_m:.1f})"


def _leaves(failure: BaseException) -> str:
    if isinstance(failure, BaseExceptionGroup):
        return "; ".join(_leaves(each) for each in failure.exceptions)
    where = traceback.extract_tb(failure.__traceback__)[-3:]
    return f"{failure!r} in " + " < ".join(f"{f.name}:{f.lineno}" for f in reversed(where))
