"""After a flight: results that take longer than its map, the boundary and ortho.tif.

Kept pictures are judged again with their poses in the air; the map of cells stays as flown. If none
are kept, ortho.tif is the mosaic of the flight.
"""

from __future__ import annotations

import logging
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Final

import numpy as np

from missions.errors import UavmapError
from missions.flight.state import State
from uavmap.base.messages import muted
from uavmap.journal.event_log import JournalReader
from uavmap.journal.flight_plan import JOURNAL, FlightPlan
from uavmap.journal.kept_frames import FRAMES, POSES
from uavmap.output.documents import write_documents
from uavmap.output.drawing.map_scene import map_scene, map_view
from uavmap.output.drawing.mosaic_file import ORTHO, Ground
from uavmap.output.drawing.sheet import write_sheet
from uavmap.output.facts import boundary_file
from uavmap.output.facts.figures import figures
from uavmap.output.facts.flown_mission import BOUNDARY_FILE
from uavmap.output.results import flown_flight
from uavmap.photos.ground.fine_map import FineMap, beneath
from uavmap.photos.ground.rasters import COLOURS, Rasters, RasterSettings, there, write_cog
from uavmap.photos.ground.surface import Footing, Scene
from uavmap.photos.picture_replay import JudgedPictures, judge_pictures
from uavmap.photos.scratch_file import Spool
from uavmap.photos.sources.inventory import FlightFrames, gather

_LOG: Final = logging.getLogger("uavmap.photos")


def kept_frames(folder: Path) -> bool:
    """Return True if the flight in a folder kept its pictures."""
    return (folder / FRAMES / POSES).is_file()


def draw_ground(folder: Path, complain: Callable[[str], None]) -> None:
    """Write the mosaic of a flight that is over; faults go to `complain`."""
    if kept_frames(folder):
        draw_boundary(folder, complain)
    elif there():
        try:
            _write_ortho(folder)
        except UavmapError as error:
            complain(f"{error}; all other results are complete")
        except KeyboardInterrupt:
            complain(f"interrupted: {ORTHO} is not written; all other results are complete")


def _write_ortho(folder: Path) -> None:
    grid = FlightPlan.read(JournalReader(folder / JOURNAL)).known_setting().grid
    ground = Ground.read(folder, grid)
    if ground is not None:
        block = ground.raster.whole, np.ascontiguousarray(ground.image.transpose(2, 0, 1))
        write_cog(folder / ORTHO, ground.raster, grid, 0.0, COLOURS, [block])


def draw_boundary(
    folder: Path,
    complain: Callable[[str], None],
    settings: RasterSettings | None = None,
) -> None:
    """Write boundary.geojson, the GeoTIFFs, and map.png again, of a flight that is over.

    Every fault, and Ctrl-C, is a line to `complain`: the other results are written already.
    """
    try:
        with Spool() as spool:
            _draw(folder, spool, settings or RasterSettings())
    except UavmapError as error:
        complain(f"{error}; all other results are complete")
    except OSError as error:
        complain(
            f"{BOUNDARY_FILE} is not written ({error.strerror}); all other results are "
            f"complete, and `uavmap replay {folder}` makes it anew"
        )
    except KeyboardInterrupt:
        complain(
            f"interrupted: not all of {BOUNDARY_FILE}, {ORTHO} is there; all other results "
            f"are complete, and `uavmap replay {folder}` makes these anew"
        )


def _draw(folder: Path, spool: Spool, settings: RasterSettings) -> None:
    journal = JournalReader(folder / JOURNAL)
    plan = FlightPlan.read(journal)
    setting = plan.setting(lambda _: None)
    known = figures(setting, journal.events())
    flown, state = flown_flight(folder, plan, known, journal.meta.get("truth"))
    gathered = gather(FlightFrames(folder))
    _LOG.info(
        f"drawing the boundary from {len(gathered.pictures)} kept pictures; all other results are "
        "there (Ctrl-C leaves it out)"
    )
    with muted():
        looked = judge_pictures(gathered, setting, spool)
    scene = Scene.from_footings(_footings(looked), setting)
    if scene is None:
        return
    fine = FineMap.from_scene(setting, looked.judge, scene, spool, looked.threads)
    content = _boundary_map(fine, looked, state)
    boundary_file.write(content, folder / BOUNDARY_FILE)
    data = flown.data.with_boundary(fine.boundary.region)
    ground = beneath(scene, spool, setting.grid, looked.threads, state.t_s)
    write_sheet(map_scene(data), folder / "map.png", ground(map_view(data)))
    write_documents(flown, _LOG.info)
    placed = [shot.placed for shot in looked.shots]
    rasters = Rasters(fine, looked.judge, placed, state.t_s, looked.threads)
    rasters.write(folder, settings)


def _footings(looked: JudgedPictures) -> list[Footing]:
    """Return the used pictures, at the mission times of their exposures: the region may drift."""
    return [
        replace(footing, t_s=looked.shots[footing.number].placed.picture.taken_s or 0.0)
        for footing in looked.footings()
    ]


def _boundary_map(fine: FineMap, looked: JudgedPictures, state: State) -> boundary_file.BoundaryMap:
    belief = state.belief
    seen = sorted(belief.cells())
    undecided = [cell for cell in seen if belief.verdict(cell) is None and cell not in belief.roi]
    sigmas_m = [shot.placed.picture.position_sigma_m for shot in looked.shots if not shot.reason]
    cells, without = (np.array(some, np.int32).reshape(-1, 2) for some in (seen, undecided))
    return fine.boundary_map(state.t_s, sigmas_m, cells, without)
