"""The record of a fleet for the referee: the truth of each vehicle, and the mission's view."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Final

from missions.events import FrameSeen, from_json, to_json
from missions.flight.vehicle_state import Phase
from missions.lab.arena.roi import component
from missions.mapping.belief import FrameId
from missions.units import Cell
from tests.referee import ProductReport, Sample
from tests.referee.track import FINE, Ail, Holder
from tests.support.claims import claim
from tests.support.folding import fold
from tests.support.small_missions import reachable

from .aircraft import Aircraft

if TYPE_CHECKING:
    from .fleet import Fleet

LIES_M: Final = 1.5  # positions with a larger error count as wrong
COMPASS_RAD: Final = math.radians(30.0)
LEARNS_S: Final = 20.0  # a vehicle measures the wind near its pad for so long


@dataclass(slots=True)
class Recorder:
    """A recorder of samples of a fleet, one after the other."""

    known_wind_m_s: dict[int, float] = field(default_factory=dict)
    """Strongest wind in the estimates of each sortie, m/s."""
    lifted_s: dict[int, float] = field(default_factory=dict)
    """Time of the last take-off, s."""

    def sample(self, fleet: Fleet, craft: Aircraft) -> Sample:
        vehicle = fleet.state.vehicles[craft.number]
        changes, craft.changes = tuple(craft.changes), []
        return Sample(
            fleet.t_s, craft.position, craft.level_m + craft.height_m, craft.flying, craft.crashed,
            craft.wh, craft.mode, holder_of(craft), changes, self._conditions(fleet, craft),
            *claim(vehicle, returns=craft.mode == "rtl"),
        )  # fmt: skip

    def _conditions(self, fleet: Fleet, craft: Aircraft) -> frozenset[Ail]:
        number, driver = craft.number, fleet.drivers[craft.number]
        energy, vehicle = fleet.setting.energy, fleet.state.vehicles[craft.number]
        if not craft.flying:  # a sortie begins with another battery
            self.known_wind_m_s.pop(number, None)
            self.lifted_s[number] = fleet.t_s
            fleet.emptied.pop(number, None)
        if vehicle.return_reason is None:
            reported_m_s = driver.measured_m_s() or 0.0
            self.known_wind_m_s[number] = max(energy.wind_m_s, reported_m_s)
        wind_m_s = math.hypot(*craft.wind_m_s) if craft.flying else 0.0
        up_m = craft.level_m + craft.height_m
        mean_m_s = math.hypot(*fleet.air.wind(craft.clock_s, up_m, gusts=False))
        reckoned_m_s = self.known_wind_m_s.get(number, energy.wind_m_s) + 1.0
        learns = fleet.t_s - self.lifted_s.get(number, fleet.t_s) < LEARNS_S
        lies = math.hypot(*craft.offset_m) > LIES_M or abs(craft.compass_rad) > COMPASS_RAD
        emptied = fleet.emptied.get(number, 0.0)
        refuses = {*driver.refuses}
        ails: dict[Ail, bool] = {
            "blind": lies or wind_m_s > energy.max_airspeed_m_s,
            "misled": craft.drift_m_s != (0.0, 0.0),
            "unheard": not driver.has_telemetry,
            "deaf": not driver.receives_commands or fleet.is_without_service,
            "straight": "FlyTo" in refuses,
            "helpless": refuses >= {"FlyTo", "Land", "ReturnToLaunch"},
            "stormy": mean_m_s > reckoned_m_s and not learns,
            "drained": emptied > 0.0,
            "emptied": emptied > 0.3,
            "falling": craft.motors_failed,
            "by hand": craft.mode == "other",
            "idle": craft.mode == "follow" and craft.target_height_m >= craft.height_m
            and driver.receives_commands and not refuses and driver.corners is None,
            "unserved": fleet.dead,
            "unasked": craft.unasked,
            "pads outside": fleet.stood_outside,
        }  # fmt: skip
        return frozenset(ail for ail, holds in ails.items() if holds) or FINE


def holder_of(craft: Aircraft) -> Holder:
    """Return the holder of a vehicle in truth: service, pilot or failsafe."""
    if craft.failsafe:
        return "failsafe"
    return "pilot" if craft.mode == "other" or craft.piloted else "service"


def report_of(fleet: Fleet, *, twice: bool) -> ProductReport:
    """Return the report of a fleet at its end. `twice`: also fold the text of its journal."""
    state, setting, cell_m = fleet.state, fleet.setting, fleet.setting.grid.cell_m
    faults: list[tuple[str, str]] = []
    if twice:
        again = fold(setting, [from_json(to_json(event)) for event in fleet.events])
        if again != state:
            faults.append(("fold", "the journal's text gives another state"))
    owed, forbidden = _owed_cells(fleet)
    explored = setting.strategy.whole_box or setting.strategy.patches or state.tree is not None
    frames = [
        (place, max(reach_m, 2.0 * cell_m))
        for driver in fleet.drivers.values()
        for _, place, reach_m in driver.seen_from
    ]
    return ProductReport(
        fleet.t_s,
        completed=state.completed,
        reported=frozenset(
            n for n, v in state.vehicles.items() if v.phase in (Phase.DOWN, Phase.LOST)
        ),
        region=frozenset(fleet.roi),
        owed=owed,
        mapped=frozenset(state.belief.roi),
        misjudged=any(driver.misplaced for driver in fleet.drivers.values()),
        forbidden=forbidden,
        lanes=() if explored else setting.lanes,
        frames=frames,
        step_m=cell_m,
        lost=_lost_frames(fleet),
        faults=faults,
    )


def _lost_frames(fleet: Fleet) -> list[str]:
    state = fleet.state
    return [
        f"the frame of {event.t_s} s over {event.vantage} is lost"
        for event in fleet.events
        if isinstance(event, FrameSeen)
        and FrameId(event.vehicle, event.t_s)
        not in (state.overview if event.overview else state.belief).looks.get(event.vantage, {})
    ]


def _owed_cells(fleet: Fleet) -> tuple[frozenset[Cell], bool]:
    """Return the cells of a complete map in truth, and whether the fence forbids a part."""
    state, setting, region = fleet.state, fleet.setting, frozenset(fleet.roi)
    box = region & frozenset(setting.box_cells)
    if setting.strategy.whole_box:
        return box, False
    if setting.strategy.patches:
        return frozenset().union(*(component(region, cell) for cell in box)), False
    if state.tree is None:
        return frozenset(), False
    patch = frozenset(component(region, state.tree.root) & region)
    if setting.grid.drift_speed_m_s > 0.0 or not setting.strategy.stops:
        # without a stop frames judge cells beside the path, also those beyond the fence
        return patch, False
    looked, mapped = reachable(setting, region, state.tree.root)
    return frozenset(mapped), looked != patch
