"""The results of a replay: the maps of a flight, and figures of pictures."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from missions.flight.setting import Setting
from missions.units import LatLon
from uavmap.journal.flight_plan import FlightPlan
from uavmap.output import summary as summary_file
from uavmap.output.documents import write_documents
from uavmap.output.drawing.map_scene import Photograph, map_scene, map_view
from uavmap.output.drawing.sheet import write_sheet
from uavmap.output.facts import boundary_file
from uavmap.output.facts.boundary_file import BoundaryMap
from uavmap.output.facts.boundary_model import FILE
from uavmap.output.facts.calendar import Calendar
from uavmap.output.facts.extent import extent
from uavmap.output.facts.flight_log import FlightLog
from uavmap.output.facts.flown_mission import Flown, dated
from uavmap.output.facts.map_model import CellTable, Track
from uavmap.output.write_results import map_of, write_cells

KIND = "recorded pictures"
"""Stands in the summary in place of a strategy."""


@dataclass(frozen=True, slots=True)
class Replayed:
    """What pictures have shown.

    Attributes:
        cells: Every cell that was seen, sorted.
        undecided: Cells in too few pictures to be ROI; shape (n, 2).
        taken: Of each used picture seconds since the first, place, height in metres.
        refused: Number of different pictures that are not used.
        copies: Number of files that are copies of another one.
    """

    cells: CellTable
    undecided: NDArray[np.int32]
    taken: Sequence[tuple[float, LatLon, float]]
    refused: int
    copies: int

    @property
    def pictures(self) -> int:
        """All different pictures."""
        return len(self.taken) + self.refused

    @property
    def end_s(self) -> float:
        """The time of the map: of the last picture, in seconds since the first."""
        return max((t_s for t_s, _, _ in self.taken), default=0.0)

    @property
    def complete(self) -> bool:
        """Whether most pictures are in the map."""
        return len(self.cells) > 0 and len(self.taken) > self.refused


def write_replay(
    made: Flown,
    boundary: Callable[[], BoundaryMap | None],
    beneath: Photograph | None,
    say: Callable[[str], None],
) -> dict[str, Any]:
    """Write the results of a replay; return the summary.

    `boundary` waits for the boundary at pixel level; `beneath` is the ground of the map's picture.
    Files are written in a second thread while these two, and then the picture, are computed.
    """
    data, values = made.data, dict(made.values)
    with ThreadPoolExecutor(1) as pool:  # short tasks: Ctrl-C waits for a moment only
        cells = pool.submit(write_cells, made)
        photograph = None if beneath is None else beneath(map_view(data))
        found = boundary()
        if found is not None:
            values |= found.figures()
            data = data.with_boundary(found.boundary.region)
        flown = replace(made, data=data, values=values)
        others = pool.submit(_write_others, flown, found, say)
        write_sheet(map_scene(data), flown.folder / "map.png", photograph)
        for files in (cells, others):
            files.result()
    return values


def _write_others(flown: Flown, boundary: BoundaryMap | None, say: Callable[[str], None]) -> None:
    """Write the boundary, the summary and the documents."""
    if boundary is not None:
        boundary_file.write(boundary, flown.folder / FILE)
    summary_file.write(flown.values, flown.folder / "summary.json")
    write_documents(flown, say)


def flown_replay(
    folder: Path,
    plan: FlightPlan,
    setting: Setting,
    replayed: Replayed,
    log: FlightLog,
    calendar: Calendar,
    known: Mapping[str, Any] | None = None,
) -> Flown:
    """Create what the results of a replay show; `known` are figures that replace others."""
    tracks = (Track(1, tuple(replayed.taken)),) if replayed.taken else ()
    data = map_of(setting, replayed.end_s, replayed.cells, tracks)
    data = replace(data, pictures=len(replayed.taken))
    size = extent(data, setting.mission.detector.share)
    values = dated({**_replay_summary(setting, replayed), **(known or {})}, data, size, calendar)
    return Flown(folder, plan, setting, data, values, log, calendar, recorded=True)


def _replay_summary(setting: Setting, replayed: Replayed) -> dict[str, Any]:
    cell_m2 = setting.grid.cell_m**2
    votes = int(replayed.cells.votes.sum(dtype=np.int64))
    used, roi = len(replayed.taken), int(np.count_nonzero(replayed.cells.roi))
    return {
        "mission": setting.mission.name,
        "strategy": KIND,
        "completed": replayed.complete,
        "finding": _finding(replayed, roi, roi * cell_m2),
        "photographs": replayed.pictures,
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


def _finding(replayed: Replayed, roi: int, area_m2: float) -> str:
    used = len(replayed.taken)
    if not used:
        return f"none of {replayed.pictures} pictures can be used; pictures.csv says why"
    what = f"a region of {roi} cells ({area_m2:,.0f} sq m)" if roi else "no region"
    text = f"{what} in {used} pictures"
    if replayed.refused:
        text += f"; {replayed.refused} more are not used, pictures.csv says why"
    if len(replayed.undecided):
        text += f"; {len(replayed.undecided)} cells were seen in too few pictures to be region"
    return text
