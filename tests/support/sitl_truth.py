"""The referee's view of simulated aircraft: their truth, and the service's view of it."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any, Final
from unittest import mock

import shapely
from shapely.geometry import Polygon

import uavmap.runner.one_flight
import uavmap.runner.simulation
from missions.flight.state import Setting, State
from missions.geo.grid import Grid
from missions.mission.energy import AIRSPEED_LIMIT_M_S
from missions.mission.schema import Mission, positions
from missions.units import Cell
from sitl.vehicle import SimVehicle
from tests.referee import FINE, Ail, Bounds, Holder, ProductReport, Referee, Sample
from tests.support.claims import bounds_of, claim, is_reported
from uavmap.runner.simulation import Truth

LED_AWAY_M: Final = 5.0
"""Distance between true and estimated position from which a vehicle is misled, m."""
LIES_M: Final = 1.5
"""Distance between true and reported position from which its reports are wrong, m."""
COMPASS_RAD: Final = math.radians(30.0)
RACE_S: Final = 0.3
"""Maximum age of the knowledge by which a mode may be commanded, s."""
COMMANDS: Final = (20, 21, 192)
"""Commands of return, landing and flight to a target."""
LIMIT_S: Final = 20_000.0
"""Maximum duration of a flight in simulated time, s: a longer one has no end."""
HALF_SHARE: Final = 0.5


class NoEndError(Exception):
    """Raised for a flight that does not end by itself."""


@dataclass(slots=True)
class Observer(Truth):
    """An observer that shows the referee the truth of a flight; `act` may interfere, as a pilot
    does.
    """

    t_s: float = 0.0
    limit_s: float = LIMIT_S
    always: frozenset[Ail] = FINE
    """Faults of the vehicles of this flight that last all the time."""
    more_bounds: dict[str, Any] = field(default_factory=dict)
    excuses_blind: bool = False
    """True if the map of a flight with a blind vehicle is not judged."""
    missed_cells: int = 1
    """Maximum number of cells of the rim, half of them region, that may be missed."""
    referee: Referee | None = None
    mission: Mission | None = None
    states: dict[int, Any] = field(default_factory=dict)
    """Flights by member; 0 for a service that has all vehicles."""
    _modes: dict[int, str] = field(default_factory=dict)
    _authors: dict[int, Holder] = field(default_factory=dict)
    """Authors of the mode of each vehicle."""

    def watch(self, vehicles: Sequence[SimVehicle], setting: Setting) -> None:
        Truth.watch(self, vehicles, setting)
        if self.referee is None:
            self.mission = setting.mission
            pads = {v.spec.system_id: setting.grid.fixed(v.spec.home) for v in vehicles}
            # positions that find a pad have errors, and telemetry may hide a fall of a quarter
            # metre
            given = {"home_m": 7.0, "race_s": RACE_S, "fall_m": 0.25, "crash_is_known": True}
            given |= self.more_bounds
            self.referee = Referee(bounds_of(setting.mission, setting.grid, pads, **given))
        for vehicle in vehicles:
            self.t_s = vehicle.t_s
            self.referee.see(vehicle.spec.system_id, self._sample(vehicle, setting))
        if self.t_s > self.limit_s:
            raise NoEndError(f"no end after {self.limit_s:g} s")

    def act(self, vehicle: SimVehicle) -> Holder:
        """Apply the due acts to a vehicle; return the one that has its control."""
        by_failsafe = self._authors.get(vehicle.spec.system_id) == "failsafe"
        return "failsafe" if vehicle.truth.failsafe or by_failsafe else "service"

    def state_for(self, number: int) -> State | None:
        """Return the mission's state in the program that has a vehicle."""
        flight = self.states.get(number, self.states.get(0))
        return None if flight is None else flight.state

    def _sample(self, vehicle: SimVehicle, setting: Setting) -> Sample:
        number, before = vehicle.spec.system_id, self._modes.get(vehicle.spec.system_id)
        changes: list[tuple[Holder, str]] = []
        mode = vehicle.truth.mode.name
        if before is not None and mode != before:
            changes.append(("failsafe" if vehicle.truth.failsafe else "service", mode))
            self._authors[number] = changes[0][0]
        holder = self.act(vehicle)
        truth = vehicle.truth
        if truth.mode.name != mode:
            changes.append(("pilot", truth.mode.name))
        mode = self._modes[number] = truth.mode.name
        state = self.state_for(number)
        what = state.vehicles[number] if state is not None else None
        claimed = () if what is None else claim(what, returns="RTL" in mode)
        return Sample(
            truth.t_s, setting.grid.fixed(truth.position), vehicle.up_m, not truth.landed,
            truth.crashed, truth.energy_wh, mode, holder, tuple(changes),
            self.always | _ails(vehicle, holder), *claimed,
        )  # fmt: skip

    def end(self, said: ProductReport) -> Referee:
        """Have the referee judge the end."""
        referee = self.referee or Referee(Bounds(Polygon(), {}, 0.0, 0.0))
        referee.conclude(said)
        return referee

    def ever(self, ail: Ail) -> bool:
        """Return whether a vehicle had a fault in the air."""
        memories = self.referee.memories.values() if self.referee else ()
        return any(ail in memory.ever for memory in memories)

    @property
    def reported(self) -> frozenset[int]:
        found = []
        for number in self.referee.memories if self.referee else ():
            state = self.state_for(number)
            if state is not None and is_reported(state.vehicles[number]):
                found.append(number)
        return frozenset(found)


def _ails(vehicle: SimVehicle, holder: Holder) -> frozenset[Ail]:
    body, believed, fail = vehicle._body, vehicle._ap.estimate, vehicle.fail
    off_m = math.hypot(believed.east - body.east, believed.north - body.north)
    refused = [number for number in COMMANDS if fail.rejection(number) is not None]
    wind_m_s = math.hypot(*vehicle._wind())
    ails: dict[Ail, bool] = {
        "blind": off_m > LIES_M or abs(body.compass_rad) > COMPASS_RAD
        or wind_m_s > AIRSPEED_LIMIT_M_S - 0.01,
        "misled": off_m > LED_AWAY_M,
        "unheard": fail.down.silent,
        "deaf": fail.up.silent,
        "straight": 192 in refused,
        "helpless": len(refused) == len(COMMANDS),
        "stormy": fail.gust_m_s != (0.0, 0.0),
        "falling": any(fault.numbers[0] < HALF_SHARE for fault in fail.active("motor")),
        "by hand": holder == "pilot",
    }  # fmt: skip
    return frozenset(ail for ail, holds in ails.items() if holds)


@contextlib.contextmanager
def observed(observer: Observer) -> Iterator[None]:
    """Let an observer see the simulation of this process, and the flight of the command."""
    flight = uavmap.runner.one_flight.Flight
    begin = flight.__init__

    def begun(self: Any, *values: Any, **more: Any) -> None:
        begin(self, *values, **more)
        observer.states[0] = self

    class Watched(uavmap.runner.simulation.Simulation):
        def __init__(self, *values: Any, **more: Any) -> None:
            super().__init__(*values, **more)
            self.truth = observer

    with (
        mock.patch.object(uavmap.runner.simulation, "Simulation", Watched),
        mock.patch.object(flight, "__init__", begun),
    ):
        yield


# --- the ground ----------------------------------------------------------------------------------
def ground_of(mission: Mission) -> tuple[frozenset[Cell], frozenset[Cell]]:
    """Return the cells that the region touches in truth, and those of which it covers half."""
    grid = Grid.at(mission.home, mission.grid.cell_m)
    half_m = 0.5 * grid.cell_m
    touched, owed = set[Cell](), set[Cell]()
    for region in mission.sim.roi:
        ring = [grid.fixed(p) for p in positions(region.polygon)]
        holes = [[grid.fixed(p) for p in positions(hole)] for hole in region.holes]
        truth = Polygon(ring, holes)
        ends = [grid.cell_of(p) for p in ring]
        for east in range(min(c.east for c in ends) - 1, max(c.east for c in ends) + 2):
            for north in range(min(c.north for c in ends) - 1, max(c.north for c in ends) + 2):
                cell = Cell(east, north)
                x, y = grid.centre_of(cell)
                square = shapely.box(x - half_m, y - half_m, x + half_m, y + half_m)
                share = truth.intersection(square).area / square.area
                touched |= {cell} if share > 0.0 else set()
                owed |= {cell} if share >= HALF_SHARE else set()
    return frozenset(touched), frozenset(owed)
