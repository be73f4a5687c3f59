"""The results of a mission in its folder: maps, picture, summary."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from shapely.geometry.base import BaseGeometry

from missions.events import Event
from missions.flight.setting import Setting
from missions.flight.state import State
from missions.mapping.evidence import Evidence
from missions.mapping.tree import Tree
from missions.mission.schema import positions
from missions.units import Cell
from uavmap.output import summary as summary_file
from uavmap.output.drawing.map_scene import map_scene
from uavmap.output.drawing.sheet import write_sheet
from uavmap.output.facts.calendar import Calendar
from uavmap.output.facts.extent import extent
from uavmap.output.facts.figures import Figures, figures, summary
from uavmap.output.facts.flown_mission import dated
from uavmap.output.facts.map_model import CellRow, MapData, Track
from uavmap.output.facts.map_model import State as CellState
from uavmap.output.facts.score import score
from uavmap.output.formats import geojson_encoder as geojson
from uavmap.output.formats import kml_encoder as kml


def map_data(
    setting: Setting,
    state: State,
    found: Figures,
    truth: BaseGeometry | None,
    *,
    recorded: bool = False,
    evidence: Evidence | None = None,
) -> MapData:
    """What the map writers need. In `recorded` imagery whatever was judged was also seen whole;
    `evidence` is what decides there, where votes are not counted."""
    mission, grid = setting.mission, setting.grid
    share = mission.detector.share
    rows = tuple(
        CellRow(
            cell,
            cell_state(cell, state, recorded=recorded)
            if evidence is None
            else weighed_state(cell, evidence, share),
            tally.positive,
            tally.total,
        )
        for cell, tally in state.belief.cells().items()
    )
    tracks = tuple(
        Track(number, tuple((t, grid.position(point), height) for t, point, height in points))
        for number, points in found.tracks.items()
        if points
    )
    return MapData(
        mission=mission.name,
        grid=grid,
        t_s=state.t_s,
        cells=rows,
        tracks=tracks,
        start=mission.home,
        box=positions(mission.search.box),
        fence=positions(mission.fence.polygon),
        fence_holes=tuple(positions(hole) for hole in mission.fence.holes),
        truth=truth,
        unsearched=tuple((grid.position(a), grid.position(b)) for a, b in state.unsearched),
    )


def cell_state(cell: Cell, state: State, *, recorded: bool) -> CellState:
    """What the map says of a cell; in `recorded` imagery every ROI cell counts as explored."""
    if cell not in state.belief.roi:
        votes = state.belief.tally(cell, None)
        if recorded or not votes.total or state.belief.verdict(cell) is not None:
            return "non-roi"
        return "provisional" if state.belief.provisional(cell) else "provisional non-roi"
    if recorded:
        return "explored"
    if cell in state.skipped:
        return "skipped"
    tree: Tree | None = state.tree
    if tree is None:  # of a survey, or where every patch is looked for
        known = all(state.belief.verdict(near) is not None for near in cell.neighbours())
        return "explored" if known else "unexplored"
    if cell not in tree:
        return "unexplored"
    return tree.state(cell).value


def weighed_state(cell: Cell, evidence: Evidence, share: float) -> CellState:
    """What the map says of a cell that is decided by evidence."""
    return "explored" if evidence.is_roi(cell, share) else "non-roi"


def flight_values(
    setting: Setting,
    state: State,
    found: Figures,
    seed: int | None,
    simulated: Mapping[str, Any] | None = None,
    roi: BaseGeometry | None = None,
) -> dict[str, Any]:
    """The figures of a flight, with what the truth says of them, where it is known."""
    values = summary(setting, state, found, seed)
    values |= {"cells_skipped": len(state.skipped)}
    if roi is not None:
        marks = score(state.belief.roi, roi, setting.grid, state.belief.detections())
        values |= {
            "false_positives": marks.false_positives,
            "false_negatives": marks.false_negatives,
            "cells_missed": marks.cells_missed,
            "iou_cells": round(marks.iou_cells, 4),
        }
    return values | dict(simulated or {})


def write_results(
    folder: Path,
    setting: Setting,
    events: list[Event],
    seed: int | None,
    simulated: Mapping[str, Any] | None = None,
    roi: BaseGeometry | None = None,
    calendar: Calendar | None = None,
    also: Callable[[MapData, Mapping[str, Any]], None] | None = None,
) -> dict[str, Any]:
    """Write the maps and the summary of a journal; returns the summary.

    `roi` is the true ROI in the moving frame, where it is known; `simulated` what the simulator
    watched; `calendar` when it was. `also` is given the map and the summary once all of it is on
    the disk.
    """
    state, found = figures(setting, events)
    data = map_data(setting, state, found, roi)
    when = calendar or Calendar(None)
    geojson.write(data, folder / "map.geojson", when.utc(data.t_s))
    kml.write(data, folder / "map.kml")
    write_sheet(map_scene(data), folder / "map.png")
    values = flight_values(setting, state, found, seed, simulated, roi)
    size = extent(data, setting.mission.detector.share)
    values = dated(values, data, size, when)
    summary_file.write(values, folder / "summary.json")
    if also is not None:
        also(data, values)
    return values
