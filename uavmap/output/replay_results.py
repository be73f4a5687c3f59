"""The results of a replay: the same maps as of a flight, and figures that speak of pictures."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from missions.flight.setting import Setting
from missions.mission.schema import positions
from missions.units import LatLon
from uavmap.output import summary as summary_file
from uavmap.output.drawing.map_scene import Photograph, map_scene, map_view
from uavmap.output.drawing.sheet import write_sheet
from uavmap.output.facts import boundary_file
from uavmap.output.facts.boundary_file import BoundaryMap
from uavmap.output.facts.boundary_summary import FILE, BoundaryTold, boundary_of
from uavmap.output.facts.calendar import Calendar
from uavmap.output.facts.extent import Extent, extent
from uavmap.output.facts.flown_mission import dated
from uavmap.output.facts.map_model import CellTable, MapData, Track
from uavmap.output.formats import geojson_encoder as geojson
from uavmap.output.formats import kml_encoder as kml

KIND = "recorded pictures"
"""In place of a strategy: nobody has flown."""


@dataclass(frozen=True, slots=True)
class Replayed:
    """What pictures have shown.

    Attributes:
        cells: Every cell that was seen, sorted.
        undecided: Those that were seen in too few pictures to be ROI; shape (n, 2).
        taken: Of each picture that is used: seconds since the first, place, height in metres.
        refused: How many different pictures are not used.
        copies: How many files are copies of another one.
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
        """The time of the map: when the last picture was taken, in seconds since the first."""
        return max((t_s for t_s, _, _ in self.taken), default=0.0)

    @property
    def complete(self) -> bool:
        """Whether that is a map of what was photographed: most pictures are in it."""
        return len(self.cells) > 0 and len(self.taken) > self.refused


@dataclass(frozen=True, slots=True)
class Written:
    """The maps of a replay that are on the disk, for who writes more about them.

    Attributes:
        data: The map.
        values: The summary.
        size: How large the region is.
        boundary: At pixel level, if there is one.
    """

    data: MapData
    values: Mapping[str, Any]
    size: Extent
    boundary: BoundaryTold | None


def write_replay(
    folder: Path,
    setting: Setting,
    replayed: Replayed,
    boundary: Callable[[], BoundaryMap | None] = lambda: None,
    beneath: Photograph | None = None,
    calendar: Calendar | None = None,
    also: Callable[[Written], None] | None = None,
) -> dict[str, Any]:
    """Write the maps and the summary of a replay; returns the summary.

    `boundary` waits for that at pixel level, which is reckoned meanwhile. `beneath` is the ground
    of the map's picture; `calendar` says when it was. `also` is given what was written, in a
    thread of its own while the picture is drawn, which is the last that is missing then.
    """
    data = replay_map(setting, replayed)
    size = extent(data, setting.mission.detector.share)
    when = calendar or Calendar(None)
    values = dated(replay_summary(setting, replayed), data, size, when)
    with ThreadPoolExecutor(1) as pool:  # short: who breaks this off waits for a moment
        cells = pool.submit(_write_cells, folder, data, when.utc(data.t_s))
        photograph = None if beneath is None else beneath(map_view(data))
        found = boundary()
        if found is not None:
            values |= found.figures()
            data = data.with_boundary(found.boundary.region)
        others = pool.submit(_write_others, folder, data, values, size, found, also)
        write_sheet(map_scene(data), folder / "map.png", photograph)
        for files in (cells, others):
            files.result()
    return values


def _write_cells(folder: Path, data: MapData, utc: str | None) -> None:
    geojson.write(data, folder / "map.geojson", utc)
    kml.write(data, folder / "map.kml")


def _write_others(
    folder: Path,
    data: MapData,
    values: Mapping[str, Any],
    size: Extent,
    found: BoundaryMap | None,
    also: Callable[[Written], None] | None,
) -> None:
    """What is written of the boundary, the figures, and what others make of all that."""
    features = () if found is None else boundary_file.write(found, folder / FILE)
    summary_file.write(values, folder / "summary.json")
    if also is not None:
        also(Written(data, values, size, boundary_of(features, data) if features else None))


def replay_map(setting: Setting, replayed: Replayed) -> MapData:
    """What the map writers need."""
    mission, grid = setting.mission, setting.grid
    return MapData(
        mission=mission.name,
        grid=grid,
        t_s=replayed.end_s,
        cells=replayed.cells,
        tracks=(Track(1, tuple(replayed.taken)),) if replayed.taken else (),
        start=mission.home,
        box=positions(mission.search.box),
        fence=positions(mission.fence.polygon),
        fence_holes=tuple(positions(hole) for hole in mission.fence.holes),
        pictures=len(replayed.taken),
    )


def replay_summary(setting: Setting, replayed: Replayed) -> dict[str, Any]:
    """summary.json of a replay."""
    cell_m2 = setting.grid.cell_m**2
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
        "pictures_per_cell": _per_cell(replayed),
        "decided_by": "evidence" if setting.mission.by_evidence else "count",
        "iou_cells": None,
    }


def _per_cell(replayed: Replayed) -> float:
    if not len(replayed.cells):
        return 0.0
    return round(int(replayed.cells.votes.sum(dtype=np.int64)) / len(replayed.cells), 2)


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
