"""The film of a flown mission, from its journal."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field

from shapely.geometry.base import BaseGeometry

from missions.events import Connected, Event, FrameSeen, Tracked, Weighed
from missions.flight.setting import Setting
from missions.flight.state import State
from missions.flight.step import step
from missions.mapping.evidence import Evidence, evidence_of
from missions.mission.schema import Mission
from missions.units import Cell
from uavmap.output.facts.counting import LIFT_OFF_M
from uavmap.output.facts.map_model import State as CellState
from uavmap.output.facts.score import MISSED_SHARE, cells_near, shares_of
from uavmap.output.film.film import Change, Film, Fix, Place, Unit
from uavmap.output.write_results import cell_state, weighed_state


def title_of(mission: Mission, *, recorded: bool = False) -> str:
    """Write the title of a film: the mission, its strategy and its crew, or photographs."""
    crew = "1 vehicle" if len(mission.vehicles) == 1 else f"{len(mission.vehicles)} vehicles"
    what = "photographs" if recorded else f"{mission.strategy}, {crew}"
    return f"{mission.name}   ·   {what}"


def film_of_flight(
    setting: Setting,
    events: Iterable[Event],
    title: str,
    *,
    truth: BaseGeometry | None = None,
    recorded: bool = False,
) -> tuple[Film, State]:
    """Fold a journal into a film; return also the state in which the mission ended.

    `truth` is the true ROI in ground metres of the grid's moving frame; `recorded`: the journal is
    of photographs, without a vehicle.
    """
    grid = setting.grid
    events = list(events)
    weighed = Evidence() if evidence_of(events) else None
    log = _Log(setting, State.initial(setting), recorded, evidence=weighed)
    for event in events:
        log.take_in(event)
    for cell in [] if weighed is None else weighed.cells():
        log.note(cell)  # a belief depends on the whole set, known with its last picture
    roi: frozenset[Cell] = frozenset()
    if truth is not None:
        shares = shares_of(cells_near(truth, grid), truth, grid)
        roi = frozenset(cell for cell, share in shares.items() if share >= MISSED_SHARE)
    film = Film(
        title=title,
        unit=Unit.SECONDS,
        end_t=log.t_s,
        roi=roi,
        changes=tuple(log.changes),
        tracks={number: tuple(track) for number, track in sorted(log.tracks.items())},
        start=Place(0.0, 0.0),
        start_drift=Place(-grid.drift_east_m_s / grid.cell_m, -grid.drift_north_m_s / grid.cell_m),
    )
    return film, log.state


@dataclass(slots=True)
class _Log:
    """The changes and tracks of a journal that is folded."""

    setting: Setting
    state: State
    recorded: bool
    t_s: float = 0.0
    changes: list[Change] = field(default_factory=list)
    tracks: dict[int, list[Fix]] = field(default_factory=dict)
    shown: dict[Cell, CellState] = field(default_factory=dict)
    evidence: Evidence | None = None
    """Of recorded pictures that are weighed."""
    seen: FrameSeen | None = None

    def take_in(self, event: Event) -> None:
        before, self.t_s = self.state, max(self.t_s, event.t_s)
        self.state, _ = step(self.setting, before, event)
        if isinstance(event, Tracked | Connected):
            grid = self.setting.grid
            east_m, north_m = grid.to_moving(event.position, self.t_s)
            place = Place(east_m / grid.cell_m, north_m / grid.cell_m)
            fix = Fix(self.t_s, place, event.height_m >= LIFT_OFF_M)
            self.tracks.setdefault(event.vehicle, []).append(fix)
        if isinstance(event, FrameSeen):
            self.seen = event
        cells: set[Cell] = set()
        if isinstance(event, Weighed) and self.evidence is not None and self.seen is not None:
            self.evidence.add(self.seen.votes, event.weights)
            cells = {vote.cell for vote in self.seen.votes}
        elif isinstance(event, FrameSeen) and self.evidence is None:
            cells = {vote.cell for vote in event.votes}
        if self.state.tree is not None and self.state.tree is not before.tree:
            cells |= self.state.tree.vertices.keys()
        for cell in sorted(cells):
            self.note(cell)

    def note(self, cell: Cell) -> None:
        if self.evidence is None:
            now = cell_state(cell, self.state, recorded=self.recorded)
        else:
            now = weighed_state(cell, self.evidence, self.setting.mission.detector.share)
        tree = self.state.tree
        if self.shown.get(cell) != now:
            self.shown[cell] = now
            parent = tree.parent(cell) if tree is not None and cell in tree else None
            self.changes.append(Change(self.t_s, cell, now, parent))
