"""The results of a flight in its folder: maps, picture, summary, documents."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

from shapely.geometry.base import BaseGeometry

from missions.events import Event
from missions.flight.setting import Setting
from missions.flight.state import State
from missions.mapping.evidence import Evidence
from missions.mission.schema import positions
from missions.units import Cell
from uavmap.journal.flight_plan import FlightPlan
from uavmap.output import summary as summary_file
from uavmap.output.documents import write_documents
from uavmap.output.drawing.map_scene import map_scene
from uavmap.output.drawing.sheet import write_sheet
from uavmap.output.facts.calendar import Calendar
from uavmap.output.facts.extent import extent
from uavmap.output.facts.figures import Figures, figures, summary
from uavmap.output.facts.flight_log import FlightLog
from uavmap.output.facts.flown_mission import Flown, dated
from uavmap.output.facts.map_model import CellRow, CellTable, MapData, Track
from uavmap.output.facts.map_model import State as CellState
from uavmap.output.facts.score import score, true_roi
from uavmap.output.formats import geojson_encoder as geojson
from uavmap.output.formats import kml_encoder as kml


def flown_flight(
    folder: Path,
    plan: FlightPlan,
    setting: Setting,
    events: Sequence[Event],
    simulated: Mapping[str, Any] | None = None,
) -> tuple[Flown, State]:
    """Fold the journal of a flight; return what its results show, and its last state.

    `simulated` is what the simulator watched.
    """
    state, found = figures(setting, events)
    truth = None
    if plan.simulated and setting.mission.sim.roi:
        truth = true_roi(setting.mission, setting.grid)
    data = map_data(setting, state, found, truth)
    values = _values(plan, setting, state, found, truth) | dict(simulated or {})
    calendar = Calendar.of_flight(plan)
    values = dated(values, data, extent(data, setting.mission.detector.share), calendar)
    return Flown(folder, plan, setting, data, values, FlightLog.of(events), calendar), state


def write_results(flown: Flown, say: Callable[[str], None]) -> dict[str, Any]:
    """Write the maps, the summary and then the documents of a flight; return the summary."""
    write_cells(flown)
    write_sheet(map_scene(flown.data), flown.folder / "map.png")
    summary_file.write(flown.values, flown.folder / "summary.json")
    write_documents(flown, say)
    return dict(flown.values)


def map_data(setting: Setting, state: State, found: Figures, truth: BaseGeometry | None) -> MapData:
    """Create the map of a flight."""
    grid = setting.grid
    cells = CellTable.of(
        CellRow(cell, cell_state(cell, state, recorded=False), tally.positive, tally.total)
        for cell, tally in state.belief.cells().items()
    )
    tracks = tuple(
        Track(number, tuple((t, grid.position(point), height) for t, point, height in points))
        for number, points in found.tracks.items()
        if points
    )
    lanes = tuple((grid.position(a), grid.position(b)) for a, b in state.unsearched)
    return replace(map_of(setting, state.t_s, cells, tracks), truth=truth, unsearched=lanes)


def map_of(setting: Setting, t_s: float, cells: CellTable, tracks: tuple[Track, ...]) -> MapData:
    """Create the map of some cells and tracks, in what the mission planned."""
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
    )


def write_cells(flown: Flown) -> None:
    """Write map.geojson and map.kml."""
    data = flown.data
    geojson.write(data, flown.folder / "map.geojson", flown.calendar.utc(data.t_s))
    kml.write(data, flown.folder / "map.kml")


def cell_state(cell: Cell, state: State, *, recorded: bool) -> CellState:
    """Return the state of a cell on the map; in recorded imagery every ROI cell is explored."""
    if cell not in state.belief.roi:
        votes = state.belief.tally(cell, None)
        if recorded or not votes.total or state.belief.verdict(cell) is not None:
            return "non-roi"
        return "provisional" if state.belief.provisional(cell) else "provisional non-roi"
    if recorded:
        return "explored"
    if cell in state.skipped:
        return "skipped"
    if state.tree is None:  # of a survey, or where every patch is looked for
        known = all(state.belief.verdict(near) is not None for near in cell.neighbours())
        return "explored" if known else "unexplored"
    return state.tree.state(cell).value if cell in state.tree else "unexplored"


def weighed_state(cell: Cell, evidence: Evidence, share: float) -> CellState:
    """Return the state of a cell that is decided by evidence."""
    return "explored" if evidence.is_roi(cell, share) else "non-roi"


def _values(
    plan: FlightPlan, setting: Setting, state: State, found: Figures, truth: BaseGeometry | None
) -> dict[str, Any]:
    values = summary(setting, state, found, plan.seed if plan.simulated else None)
    values |= {"cells_skipped": len(state.skipped)}
    if truth is not None:
        marks = score(state.belief.roi, truth, setting.grid, state.belief.detections())
        values |= asdict(marks) | {"iou_cells": round(marks.iou_cells, 4)}
    return values
