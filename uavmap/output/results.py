"""The results of a flight or a replay in its folder, read back from the journal."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from shapely.geometry.base import BaseGeometry

from missions.events import Event, FrameSeen, FrameWeighed, Tracked, Vote
from missions.flight.state import Setting, State
from missions.mapping.belief import Tally
from missions.mapping.evidence import Evidence
from missions.mapping.frame_sums import FrameSums
from missions.mapping.overview import from_below
from missions.mapping.rim_cells import rim_verdicts
from missions.mission.schema import positions
from missions.mission.views import rim_share
from missions.units import Cell, LatLon
from uavmap.base.text_files import read_text
from uavmap.journal.event_log import JournalReader
from uavmap.journal.flight_plan import JOURNAL, FlightPlan
from uavmap.output import summary as summary_file
from uavmap.output.documents import write_documents
from uavmap.output.drawing.map_scene import Photograph, map_scene, map_view
from uavmap.output.drawing.mosaic_file import Ground
from uavmap.output.drawing.sheet import write_sheet
from uavmap.output.facts import boundary_file
from uavmap.output.facts.boundary_file import BoundaryMap
from uavmap.output.facts.cell_states import cell_state
from uavmap.output.facts.detector_fit import ending, no_verdict, with_unsure
from uavmap.output.facts.figures import Figures, figures, summary
from uavmap.output.facts.flight_log import FlightLog
from uavmap.output.facts.flown_mission import (
    BOUNDARY_FILE,
    DERIVED,
    TAKEN,
    Calendar,
    FlownMission,
    dated,
)
from uavmap.output.facts.map_model import CellRow, CellTable, MapData, Track
from uavmap.output.facts.score import score, true_roi
from uavmap.output.formats import geojson_encoder as geojson
from uavmap.output.formats import kml_encoder as kml


def flown_flight(
    folder: Path,
    plan: FlightPlan,
    known: tuple[State, Figures],
    simulated: Mapping[str, Any] | None = None,
) -> tuple[FlownMission, State]:
    """Return the facts of a flight's results, and its last state.

    `known` is the return value of `figures`, `simulated` the record of the simulator. The map has
    cells at the rim without enough votes. If frames from both heights disagree, the lower count.
    """
    state, found = known
    setting = state.setting
    if not setting.team.shares_facts:  # shared facts are votes without the shares of cells
        belief = state.belief.with_verdicts(from_below(state.belief, state.overview))
        rim = rim_verdicts(found.passing, belief, rim_share(setting.mission))
        state = replace(state, belief=belief.with_verdicts(rim))
    truth = None
    if plan.simulated and setting.mission.sim.roi:
        truth = true_roi(setting.mission, setting.grid)
    data = map_data(state, found, truth)
    values = summary(state, found, plan.seed if plan.simulated else None)
    values |= {"cells_skipped": len(state.skipped)}
    values = with_unsure(values, data.cells, setting)
    if truth is not None:
        marks = score(state.belief.roi, truth, setting.grid, state.belief.detections())
        values |= asdict(marks) | {"iou_cells": round(marks.iou_cells, 4)}
    values |= dict(simulated or {})
    values |= ending(values, no_verdict(state, found.fit, real=not plan.simulated))
    calendar = Calendar.of_flight(plan)
    return dated(FlownMission(folder, plan, setting, data, values, found.log, calendar)), state


def write_results(flown: FlownMission, report: Callable[[str], None]) -> dict[str, Any]:
    """Write the maps, the summary and then the documents of a flight; return the summary."""
    write_cells(flown)
    ground = Ground.read(flown.folder, flown.data.grid)
    photograph = None if ground is None else ground.beneath(map_view(flown.data))
    write_sheet(map_scene(flown.data), flown.folder / "map.png", photograph)
    summary_file.write(flown.values, flown.folder / "summary.json")
    write_documents(flown, report)
    return dict(flown.values)


def map_data(state: State, found: Figures, truth: BaseGeometry | None) -> MapData:
    """Create the map of a flight."""
    grid, tallies = state.setting.grid, state.belief.cells()
    # a cell may be unsure by another member's frames, and have no vote here
    unsure = {Cell(*cell): Tally(0, 0) for cell in found.sums.cells().tolist()}
    cells = CellTable.from_rows(
        CellRow(cell, cell_state(cell, state, found.sums), tally.positive, tally.total)
        for cell, tally in sorted((unsure | tallies).items())
    ).with_sums(found.sums, state.setting.mission.detector.explored)
    tracks = tuple(
        Track(number, tuple((t, grid.position(point), height) for t, point, height in points))
        for number, points in found.tracks.items()
        if points
    )
    lanes = tuple((grid.position(a), grid.position(b)) for a, b in state.unsearched)
    return replace(map_of(state.setting, state.t_s, cells, tracks), truth=truth, unsearched=lanes)


def map_of(setting: Setting, t_s: float, cells: CellTable, tracks: tuple[Track, ...]) -> MapData:
    """Create the map of some cells and tracks, with the plan of the mission."""
    mission = setting.mission
    return MapData(
        mission=mission.name,
        grid=setting.grid,
        t_s=t_s,
        cells=cells,
        tracks=tracks,
        start=mission.home,
        box=positions(mission.search.box),
        fence=positions(mission.fence.polygon),
        fence_holes=tuple(positions(hole) for hole in mission.fence.holes),
        classes=mission.detector.classes,
    )


def write_cells(flown: FlownMission) -> None:
    """Write map.geojson and map.kml."""
    data = flown.data
    geojson.write(data, flown.folder / "map.geojson", flown.calendar.utc(data.t_s))
    kml.write(data, flown.folder / "map.kml")


# --- recorded pictures ----------------------------------------------------------------------------
KIND = "recorded pictures"
"""Text in place of the strategy in the summary of a replay."""


@dataclass(frozen=True, slots=True)
class ReplayFindings:
    """The cells and pictures of a replay.

    Attributes:
        cells: Every observed cell, sorted.
        undecided: Cells in too few pictures to be ROI; shape (n, 2).
        taken: Seconds since the first picture, place, and height in metres of each used picture.
        refused: Number of pictures that are not used, without copies.
        copies: Number of pictures that are copies of others.
    """

    cells: CellTable
    undecided: NDArray[np.int32]
    taken: Sequence[tuple[float, LatLon, float]]
    refused: int
    copies: int

    @property
    def end_s(self) -> float:
        """Time of the map, that of the last picture, in seconds since the first."""
        return max((t_s for t_s, _, _ in self.taken), default=0.0)


def write_replay(
    made: FlownMission,
    boundary: Callable[[], BoundaryMap | None],
    beneath: Photograph | None,
    report: Callable[[str], None],
) -> dict[str, Any]:
    """Write the results of a replay; return the summary.

    Files are written in a second thread while this one computes boundary, ground and picture.

    Args:
        made: The facts of the replay.
        boundary: A function that returns the boundary at pixel level; it may take time.
        beneath: A function that draws the ground below the map's cells.
        report: Receives a line for each document that fails.
    """
    data, values = made.data, dict(made.values)

    def write_others(flown: FlownMission, found: BoundaryMap | None) -> None:
        if found is not None:
            boundary_file.write(found, flown.folder / BOUNDARY_FILE)
        summary_file.write(flown.values, flown.folder / "summary.json")
        write_documents(flown, report)

    with ThreadPoolExecutor(1) as pool:  # short tasks: Ctrl-C takes effect soon
        cells = pool.submit(write_cells, made)
        photograph = None if beneath is None else beneath(map_view(data))
        found = boundary()
        if found is not None:
            values |= found.figures()
            data = data.with_boundary(found.boundary.region)
        others = pool.submit(write_others, replace(made, data=data, values=values), found)
        write_sheet(map_scene(data), made.folder / "map.png", photograph)
        for files in (cells, others):
            files.result()
    return values


def flown_replay(
    folder: Path,
    plan: FlightPlan,
    setting: Setting,
    replayed: ReplayFindings,
    log: FlightLog,
    calendar: Calendar,
    known: Mapping[str, Any] | None = None,
) -> FlownMission:
    """Create the facts of a replay's results; figures in `known` replace others."""
    tracks = (Track(1, tuple(replayed.taken)),) if replayed.taken else ()
    data = map_of(setting, replayed.end_s, replayed.cells, tracks)
    data = replace(data, pictures=len(replayed.taken))
    if plan.mission_source == DERIVED:
        data = replace(data, box=(), fence=(), fence_holes=())
    counted = with_unsure(_replay_summary(setting, replayed), replayed.cells, setting)
    values = {**counted, **(known or {})}
    return dated(FlownMission(folder, plan, setting, data, values, log, calendar, recorded=True))


def _replay_summary(setting: Setting, replayed: ReplayFindings) -> dict[str, Any]:
    cell_m2 = setting.grid.cell_m**2
    votes = int(replayed.cells.votes.sum(dtype=np.int64))
    used, roi = len(replayed.taken), int(np.count_nonzero(replayed.cells.roi))
    return {
        "mission": setting.mission.name,
        "strategy": KIND,
        "completed": len(replayed.cells) > 0 and used > replayed.refused,
        "finding": _finding(replayed, roi, roi * cell_m2),
        "photographs": used + replayed.refused,
        "photographs_judged": used,
        "photographs_refused": replayed.refused,
        "photographs_twice": replayed.copies,
        "frames_judged": used,
        "cells_seen": len(replayed.cells),
        "cells_seen_m2": round(len(replayed.cells) * cell_m2, 1),
        "cells_roi": roi,
        "cells_roi_m2": round(roi * cell_m2, 1),
        "cells_undecided": len(replayed.undecided),
        "pictures_per_cell": round(votes / len(replayed.cells), 2) if votes else 0.0,
        "decided_by": "evidence" if setting.mission.by_evidence else "count",
        "iou_cells": None,
    }


def _finding(replayed: ReplayFindings, roi: int, area_m2: float) -> str:
    used = len(replayed.taken)
    if not used:
        return f"none of {replayed.refused} pictures can be used; pictures.csv has the reasons"
    what = f"a region of {roi} cells ({area_m2:,.0f} sq m)" if roi else "no region"
    text = f"{what} in {used} pictures"
    if replayed.refused:
        text += f"; {replayed.refused} more are not used, pictures.csv has the reasons"
    if len(replayed.undecided):
        text += f"; {len(replayed.undecided)} cells are in too few pictures to be region"
    return text


# --- votes of recorded pictures ------------------------------------------------------------------
Decided = tuple[CellTable, NDArray[np.int32]]
"""All cells, and the undecided ones among them, shape (n, 2)."""


@dataclass(slots=True)
class Votes:
    """The votes of recorded pictures, counted in the order of exposure with a fixed cost per cell.

    The rule is that of `missions.mapping.belief.Belief`: the first `frames` votes on a cell from
    one vantage count, and `positive` of them make it ROI. No picture arrives late or twice, so sums
    are enough: memory grows with the ground, not with the pictures.

    >>> votes = Votes(frames=2, positive=2)
    >>> for _ in range(2):
    ...     votes.add(Cell(0, 0), [Vote(Cell(1, 0), True, 0.9)])
    >>> table, undecided = votes.counted()
    >>> list(table.values()), len(undecided)
    ([([1, 0], 'explored', 2, 2, None)], 0)
    """

    frames: int
    positive: int
    roi: set[Cell] = field(default_factory=set)
    _ballots: dict[tuple[Cell, Cell], tuple[int, int]] = field(default_factory=dict)
    _cells: dict[Cell, tuple[int, int]] = field(default_factory=dict)
    """Number of votes, and of positive votes, by cell."""

    def add(self, vantage: Cell, votes: Iterable[Vote]) -> None:
        """Count the votes of the next picture."""
        for vote in votes:
            votes_in_all, yes = self._cells.get(vote.cell, (0, 0))
            self._cells[vote.cell] = votes_in_all + 1, yes + vote.positive
            cast, yes = self._ballots.get((vantage, vote.cell), (0, 0))
            if cast < self.frames:
                self._ballots[vantage, vote.cell] = cast + 1, yes + vote.positive
                if yes + vote.positive >= self.positive:
                    self.roi.add(vote.cell)

    def counted(self) -> Decided:
        """Return every cell with votes, sorted; and those with too few votes to be ROI."""
        found = sorted(self._cells.items())
        cells = np.array([cell for cell, _ in found], np.int32).reshape(-1, 2)
        roi = np.array([cell in self.roi for cell, _ in found], np.bool_)
        votes, positive = np.array([n for _, n in found], np.int32).reshape(-1, 2).T
        return CellTable.judged(cells, roi, positive, votes, None), cells[votes < self.positive]


def weighed(evidence: Evidence, share: float) -> Decided:
    """Return every observed cell, sorted, and the undecided ones, from evidence.

    A cell is region if the believed share is at least `share`.
    """
    found = evidence.weighings()
    positive, pictures = (count.astype(np.int32) for count in (found.positive, found.pictures))
    table = CellTable.judged(found.cells, found.roi(share), positive, pictures, found.belief)
    return table, found.cells[~found.decided]


# --- read back ------------------------------------------------------------------------------------
_MAX_BYTES: Final = 10_000_000


def flown_of(folder: Path) -> FlownMission:
    """Read a folder of results. Raises `JournalError`, `MissionFileError`."""
    journal = JournalReader(folder / JOURNAL)
    plan = FlightPlan.read(journal)
    events, meta = list(journal.events()), journal.meta
    setting = plan.known_setting()
    if "replay" in meta:
        return _replayed(folder, plan, setting, events, Calendar.of_replay(meta.get(TAKEN)))
    return flown_flight(folder, plan, figures(setting, events), meta.get("truth"))[0]


def _replayed(
    folder: Path, plan: FlightPlan, setting: Setting, events: Sequence[Event], calendar: Calendar
) -> FlownMission:
    """Count the votes of the journal again: the pictures need not be present."""
    mission, grid = setting.mission, setting.grid
    votes = Votes(mission.votes.frames, mission.votes.positive)
    evidence = Evidence() if mission.by_evidence else None
    taken: list[tuple[float, LatLon, float]] = []
    place: Tracked | None = None
    frame: FrameSeen | None = None
    sums = FrameSums()
    for event in events:
        if isinstance(event, Tracked):
            place = event
        elif isinstance(event, FrameSeen):
            frame = event
            sums.note(event)
            if place is not None:
                taken.append((event.t_s, grid.position(place.position), place.height_m))
            if evidence is None and event.vantage is not None:
                votes.add(event.vantage, event.votes)
        elif isinstance(event, FrameWeighed) and evidence is not None and frame is not None:
            evidence.add(frame.votes, event.weights)
    table, undecided = votes.counted()
    if evidence is not None:
        table, undecided = weighed(evidence, mission.detector.share)
    log = FlightLog.from_events(events)
    table = table.with_sums(sums, mission.detector.explored)
    replayed = ReplayFindings(table, undecided, taken, len(log.troubles), 0)
    try:  # the summary of the replay has counts of files, which the journal lacks
        known = json.loads(read_text(folder / "summary.json", _MAX_BYTES))
    except (OSError, ValueError, RecursionError):
        known = None
    if not isinstance(known, dict) or "completed" not in known:
        known = {}
    return flown_replay(folder, plan, setting, replayed, log, calendar, known)
