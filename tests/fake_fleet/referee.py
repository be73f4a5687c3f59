"""The referee: compares every instant of a flight, in truth, with what must never happen."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Final

import shapely
from shapely.geometry import Point

from missions.events import FrameSeen, from_json, to_json
from missions.flight.return_home import BESIDE_M
from missions.flight.vehicle_state import Phase
from missions.guardian import PAD_M
from missions.lab.arena.roi import component
from missions.mapping.belief import FrameId
from missions.mapping.tree import patches
from missions.orders import StandDown, TakeOff
from missions.planning.search.lanes import point_on
from missions.units import GridPoint
from tests.support.folding import fold
from tests.support.small_missions import reachable

from .aircraft import Aircraft

if TYPE_CHECKING:
    from .driver import Driver
    from .fleet import Fleet

LIES_M: Final = 1.5  # positions that are off by more lie
COMPASS_RAD: Final = math.radians(30.0)
FORGIVEN_S: Final = 60.0  # after leaving the fence unknowingly it lands or returns by then
FAR_M: Final = 150.0
ALONE_S: Final = 8.0  # reports come once a second, a lost link takes five
REACTION_S: Final = 12.0  # others need it to leave the airspace of a failsafe
CRASH_M: Final = 2.0
PAD_CRASH_M: Final = 5.0  # on its pad telemetry does not tell a fall from a hard landing

Kind = str


@dataclass(slots=True)
class Notes:
    """What the referee remembers of one vehicle."""

    blind_s: float = -math.inf  # when it last suffered what no rule can see
    hands_s: float = -math.inf  # when a pilot or a failsafe flew it last
    known_s: float = -math.inf  # since when the mission knows of that
    mode: str = ""  # that it had when it was looked at last
    guarded_s: float = -math.inf
    only_rtl_s: float = -math.inf  # when it obeyed no target last
    deaf_s: float = -math.inf  # when no command reached it last
    outside_s: float | None = None
    far_told: bool = False
    breach_told: bool = False
    alone_s: float | None = None
    sortie_free: bool = False  # its energy or landing is out of the mission's hands
    known_wind_m_s: float = 0.0
    was_flying: bool = False
    lied: bool = False  # its positions lied when it landed last
    spoofed_s: float = -math.inf
    fell: bool = False


@dataclass(slots=True)
class Referee:
    """What went wrong, as (kind, text)."""

    found: list[tuple[Kind, str]] = field(default_factory=list)
    notes: dict[int, Notes] = field(default_factory=dict)
    nearest_m: float = math.inf
    _close: set[tuple[int, int]] = field(default_factory=set)

    def note(self, t_s: float, kind: Kind, text: str) -> None:
        self.found.append((kind, f"{t_s:.2f} s: {text}"))

    # --- every tick ------------------------------------------------------------------------
    def check(self, fleet: Fleet) -> None:
        for number, craft in fleet.vehicles.items():
            notes = self.notes.setdefault(number, Notes())
            self._remember(fleet, craft, fleet.drivers[number], notes)
            self._check_fence(fleet, craft, notes)
            self._check_energy(fleet, craft, notes)
            self._check_responsible(fleet, craft, fleet.drivers[number], notes)
        self._check_apart(fleet)

    def _remember(self, fleet: Fleet, craft: Aircraft, driver: Driver, notes: Notes) -> None:
        t_s, vehicle = fleet.t_s, fleet.state.vehicles[craft.number]
        wind_m_s = math.hypot(*craft.wind_m_s) if craft.flying else 0.0
        lies = math.hypot(*craft.offset_m) > LIES_M or abs(craft.compass_rad) > COMPASS_RAD
        if lies or wind_m_s > fleet.setting.energy.max_airspeed_m_s:
            notes.blind_s = t_s
        if craft.drift_m_s != (0.0, 0.0):
            notes.spoofed_s = t_s
        others = craft.mode == "other" or craft.failsafe or craft.piloted
        if others:
            notes.hands_s = t_s
        if craft.taken_back:
            craft.taken_back = False
            self.note(t_s, "taken", f"vehicle {craft.number} is taken back from its pilot")
        if _obeys_no_target(fleet, craft):
            notes.only_rtl_s = t_s
        # a pilot may have it return later than take it
        returns = craft.mode == "rtl"
        known = vehicle.phase is Phase.YIELDED and vehicle.returns_by_itself >= returns
        if not known or craft.mode != notes.mode:  # which may be known at once
            notes.known_s = t_s
        notes.mode = craft.mode
        if not driver.obeys or fleet.gone:
            notes.deaf_s = t_s
        if vehicle.phase is not Phase.GUARDED:
            notes.guarded_s = t_s
        if craft.flying and not notes.was_flying:
            notes.sortie_free, notes.known_wind_m_s = False, 0.0
            fleet.emptied.pop(craft.number, None)
        if vehicle.return_reason is None:
            notes.known_wind_m_s = max(fleet.setting.energy.wind_m_s, vehicle.wind_m_s)
        stormy = wind_m_s > max(notes.known_wind_m_s, fleet.setting.energy.wind_m_s) + 1.0
        if craft.flying and (others or stormy or fleet.dead or notes.blind_s == t_s):
            notes.sortie_free = True

    def _check_fence(self, fleet: Fleet, craft: Aircraft, notes: Notes) -> None:
        at, outer = craft.position, fleet.setting.fence.outer
        if not craft.flying or shapely.contains_xy(outer, at.east_m, at.north_m):
            notes.outside_s, notes.breach_told, notes.far_told = None, False, False
            return
        t_s = fleet.t_s
        theirs = craft.mode == "other" or craft.piloted or craft.failsafe or craft.unasked
        if theirs or craft.motors_failed:
            notes.outside_s = None
            return
        if notes.outside_s is None:
            notes.outside_s = t_s
        out_m = float(outer.distance(Point(at)))
        if out_m < 0.01 or fleet.stood_outside or t_s - notes.spoofed_s < FORGIVEN_S:
            return  # it cannot notice positions and velocities that agree
        forgiven = max(notes.blind_s, notes.hands_s) >= notes.outside_s - FORGIVEN_S
        only_rtl = craft.mode == "rtl" and t_s - notes.only_rtl_s < FORGIVEN_S
        if not notes.breach_told and not forgiven and not only_rtl:
            notes.breach_told = True
            self.note(t_s, "breach", f"vehicle {craft.number} is {out_m:.1f} m outside the fence")
        heard = t_s - notes.deaf_s > FORGIVEN_S
        late = t_s - notes.outside_s > FORGIVEN_S and heard
        if forgiven and late and not notes.breach_told:
            notes.breach_told = True
            text = f"vehicle {craft.number} is {out_m:.0f} m outside the fence and in the air"
            self.note(t_s, "breach", text)
        if out_m > FAR_M and not notes.far_told and heard:
            notes.far_told = True
            self.note(t_s, "far", f"vehicle {craft.number} is {out_m:.0f} m outside the fence")

    def _check_energy(self, fleet: Fleet, craft: Aircraft, notes: Notes) -> None:
        if craft.flying and craft.wh <= 0.0 and not notes.fell:
            notes.fell = True
            if not self._fall_forgiven(fleet, craft, notes):
                self.note(fleet.t_s, "fell", f"vehicle {craft.number} fell out of the sky")
        landed = notes.was_flying and not craft.flying
        if landed:
            notes.lied = fleet.t_s - notes.blind_s < FORGIVEN_S
        notes.was_flying = craft.flying
        if not landed or craft.crashed:
            return
        reserve_wh = fleet.setting.energy.reserve_wh
        deaf = fleet.t_s - notes.deaf_s < FORGIVEN_S
        theirs = notes.sortie_free or fleet.emptied.get(craft.number, 0.0) or deaf
        if craft.wh < reserve_wh - 0.01 and not theirs:
            text = f"vehicle {craft.number} landed with {craft.wh:.2f} Wh, reserve {reserve_wh:g}"
            self.note(fleet.t_s, "reserve", text)

    def _fall_forgiven(self, fleet: Fleet, craft: Aircraft, notes: Notes) -> bool:
        """Whether it was deaf until late, obeyed no descent, or was under other control."""
        theirs = craft.mode == "other" or craft.failsafe or craft.piloted
        refuses = {"FlyTo", "Land", "ReturnToLaunch"} <= {*fleet.drivers[craft.number].refuses}
        return refuses or (
            fleet.t_s - notes.deaf_s < FORGIVEN_S
            or theirs
            or fleet.emptied.get(craft.number, 0) > 0.3
        )

    def _check_responsible(
        self, fleet: Fleet, craft: Aircraft, driver: Driver, notes: Notes
    ) -> None:
        if not craft.flying or fleet.dead:
            notes.alone_s = None
            return
        reason = _alone(fleet, craft, driver)
        if not reason:
            notes.alone_s = None
            return
        if notes.alone_s is None:
            notes.alone_s = fleet.t_s
        if fleet.t_s - notes.alone_s > ALONE_S and math.isfinite(notes.alone_s):
            notes.alone_s = math.inf
            self.note(fleet.t_s, "alone", f"vehicle {craft.number} flies, {reason}")

    def _check_apart(self, fleet: Fleet) -> None:
        flying = [craft for craft in fleet.vehicles.values() if craft.flying]
        for a, b in itertools.combinations(flying, 2):
            height_m = a.level_m + a.height_m - b.level_m - b.height_m
            apart_m = math.hypot(a.position.distance_to(b.position), height_m)
            pair = (a.number, b.number)
            if apart_m >= fleet.setting.mission.team.separation_m - 1e-6:
                self._close.discard(pair)
                self.nearest_m = min(self.nearest_m, apart_m)
                continue
            if pair in self._close or any(self._unforeseen(fleet, c) for c in (a, b)):
                continue
            self._close.add(pair)
            self.nearest_m = min(self.nearest_m, apart_m)
            text = f"vehicles {a.number} and {b.number} are {apart_m:.1f} m apart"
            self.note(fleet.t_s, "near", text)

    def _unforeseen(self, fleet: Fleet, craft: Aircraft) -> bool:
        """Whether its position could not be foreseen (docs/explanation/safety.md)."""
        t_s, notes = fleet.t_s, self.notes[craft.number]
        if craft.mode == "other" or craft.motors_failed or fleet.dead:
            return True
        if t_s - notes.blind_s < FORGIVEN_S:
            return True
        if craft.failsafe or craft.piloted:
            return t_s - notes.known_s < REACTION_S and fleet.drivers[craft.number].hears
        if t_s - notes.hands_s < REACTION_S:
            return True
        guarded = fleet.state.vehicles[craft.number].phase is Phase.GUARDED
        return guarded and t_s - notes.guarded_s < REACTION_S

    # --- at the end ------------------------------------------------------------------------
    def conclude(self, fleet: Fleet, *, twice: bool) -> None:
        """Check what must hold once a flight is over. `twice`: also by its journal's text."""
        state, t_s = fleet.state, fleet.t_s
        for number, craft in fleet.vehicles.items():
            phase = state.vehicles[number].phase
            fell_m = craft.crash_height_m
            at_pad = craft.position.distance_to(craft.home) < PAD_M
            hard = fell_m > (PAD_CRASH_M if at_pad else CRASH_M)
            if craft.crashed and hard and not fleet.dead and not (at_pad and craft.unseen):
                if phase not in (Phase.DOWN, Phase.LOST):
                    self.note(t_s, "unreported", f"vehicle {number} lies there as {phase}")
                if state.completed:
                    self.note(t_s, "lie", f"completed, with vehicle {number} down")
            # given up because its battery must be empty, it is not in the air any more
            if craft.flying and not fleet.dead:
                text = f"vehicle {number} is in the air at the end, {phase}, {craft.wh:.1f} Wh left"
                self.note(t_s, "air", text)
            self._stands_away(fleet, craft)
        for fault in self._belief(fleet):
            self.note(t_s, "lost votes", fault)
        misplaced = any(driver.misplaced for driver in fleet.drivers.values())
        if state.completed and not misplaced:
            for fault in self._map(fleet):
                self.note(t_s, "lie", fault)
        if twice:
            again = fold(fleet.setting, [from_json(to_json(event)) for event in fleet.events])
            if again != state:
                self.note(t_s, "fold", "the journal's text tells another state")

    def _stands_away(self, fleet: Fleet, craft: Aircraft) -> None:
        vehicle = fleet.state.vehicles[craft.number]
        away_m = craft.position.distance_to(craft.home)
        at_home = vehicle.phase in (Phase.FINISHED, Phase.GROUNDED)
        if not craft.flying and at_home and away_m > BESIDE_M and not self.notes[craft.number].lied:
            text = f"vehicle {craft.number} stands {away_m:.0f} m from its pad"
            self.note(fleet.t_s, "unreported", f"{text} as {vehicle.phase}")

    def _belief(self, fleet: Fleet) -> Iterator[str]:
        state = fleet.state
        for event in fleet.events:
            if isinstance(event, FrameSeen):
                frame = FrameId(event.vehicle, event.t_s)
                looks = (state.overview if event.overview else state.belief).looks
                if frame not in looks.get(event.vantage, {}):
                    yield f"the frame of {event.t_s} s over {event.vantage} is lost"

    def _map(self, fleet: Fleet) -> Iterator[str]:
        state, setting, roi = fleet.state, fleet.setting, fleet.roi
        if setting.strategy.whole_box:
            if missing := {cell for cell in setting.box_cells if cell in roi} - state.belief.roi:
                yield f"surveyed without {sorted(missing)}"
            return
        if setting.strategy.patches:
            box = frozenset(setting.box_cells)
            there = [patch for patch in patches(roi) if patch & box]
            if missing := frozenset().union(*there) - state.belief.roi:
                yield f"completed without {sorted(missing)}"
            if wrong := state.belief.roi - frozenset(roi):
                yield f"not ROI: {sorted(wrong)}"
            return
        if state.tree is None:
            yield from _unseen_lanes(fleet)
            return
        root = state.tree.root
        if root not in roi:
            yield f"the root {root} is no ROI"
        elif setting.grid.drift_speed_m_s > 0.0 or not setting.strategy.stops:
            # without a stop it judges cells from beside, also those beyond the fence
            if missing := component(roi, root) - state.belief.roi:
                yield f"completed without {sorted(missing)}"
        else:
            looked, mapped = reachable(setting, roi, root)
            if missing := mapped - state.belief.roi:
                yield f"completed without {sorted(missing)}"
            if looked != component(roi, root):
                yield "completed, although the fence forbids a part of the ROI"
        if wrong := state.belief.roi - frozenset(roi):
            yield f"not ROI: {sorted(wrong)}"


def _alone(fleet: Fleet, craft: Aircraft, driver: Driver) -> str:
    """Return why no part is responsible for a vehicle in the air; empty if one is."""
    vehicle = fleet.state.vehicles[craft.number]
    theirs = craft.mode == "other" or craft.failsafe or craft.piloted or craft.motors_failed
    match vehicle.phase:
        case Phase.AIRBORNE:
            left = vehicle.order is None or isinstance(vehicle.order, StandDown)
            return "without an order" if left and not theirs else ""
        case Phase.GROUNDED:
            return "" if isinstance(vehicle.order, TakeOff) else "and counts as on the ground"
        case Phase.GUARDED:
            sinks = craft.target_height_m < craft.height_m
            hovers = craft.mode == "follow" and not sinks and driver.obeys and not driver.refuses
            hovers = hovers and not theirs and driver.corners is None  # it flies to one of them
            return "guarded, but it hovers" if hovers else ""
        case Phase.YIELDED:
            return "" if theirs or craft.mode != "follow" else "yielded, but nobody has it"
        case Phase.OFFLINE:
            return ""
        case Phase.LOST:
            return "" if not driver.hears else "lost, but it speaks"
        case _:
            return f"and counts as {vehicle.phase}" if driver.hears else ""


def _unseen_lanes(fleet: Fleet) -> Iterator[str]:
    """Yield points on lanes, in truth, that no judged frame lies near, or shows from on high."""
    cell_m = fleet.setting.grid.cell_m
    seen = [
        (place, max(reach_m, 2.0 * cell_m))
        for driver in fleet.drivers.values()
        for _, place, reach_m in driver.seen_from
    ]
    for lane in fleet.setting.lanes:
        length_m = lane[0].distance_to(lane[1])
        for i in range(int(length_m // cell_m) + 1):
            at: GridPoint = point_on(lane, i * cell_m)
            if not any(place.distance_to(at) <= reach_m for place, reach_m in seen):
                yield f"no frame shows {at}, on a lane"


def _obeys_no_target(fleet: Fleet, craft: Aircraft) -> bool:
    """Whether only RTL brings it home, which is straight, also past a hole."""
    return "FlyTo" in fleet.drivers[craft.number].refuses
