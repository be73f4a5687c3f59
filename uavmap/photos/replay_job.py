"""A whole replay, from the user's options to the files in its folder.

Free memory is returned to the system. If memory runs out, a line reports it.
"""

from __future__ import annotations

import contextlib
import ctypes
import errno
import logging
import os
import shlex
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import cv2
import shapely

from missions.errors import OutputError, UavmapError
from missions.flight.setting_of import setting_of
from missions.mission.height_and_speed import refuse_unknown_ground
from missions.mission.schema import Mission
from uavmap.base.atomic_write import write_text
from uavmap.journal.event_log import Journal
from uavmap.journal.flight_plan import JOURNAL, SIM_EPOCH_UTC_S, FlightPlan
from uavmap.journal.results_folder import make_folder, refuse_unwritable, results_folder
from uavmap.load.detector_source import (
    detector_text,
    keep_detector,
    region_in_words,
    require_detector,
    with_relative_model,
)
from uavmap.load.mission_source import load, mission_of_text
from uavmap.output.drawing.mosaic_file import ORTHO
from uavmap.output.facts.flown_mission import DERIVED
from uavmap.photos.ground.rasters import RasterSettings
from uavmap.photos.mission_from_photos import DETECTOR, derived
from uavmap.photos.picture_replay import JudgedPictures, judge_pictures
from uavmap.photos.registration.calibration import calibration_of
from uavmap.photos.registration.refined_pictures import Overlaps
from uavmap.photos.scratch_file import FeatureFile, Spool
from uavmap.photos.sources.inventory import gather, open_source
from uavmap.photos.sources.picture_record import contradicted
from uavmap.photos.workers import Crew

_LOG: Final = logging.getLogger("uavmap.photos")
MEMORY_HELPS: Final = (
    "end other programs, or replay with --workers 1, fewer pictures at a time, or larger cells "
    "(grid.cell_m of a mission file)"
)
MISSION_FILE = "mission.toml"
"""Name of the derived mission in the results of a replay without --mission."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ReplayOptions:
    """The options of `uavmap replay`.

    Attributes:
        path: A folder of pictures, or one file.
        mission: A mission file, or the name of a shipped one; None: derived from the pictures.
        video_start: Begin of a video with a .tlog beside it, in seconds since 1970.
        refine: True to refine poses by overlaps of pictures.
    """

    path: str
    mission: str | None = None
    detector: str | None = None
    out: str | None = None
    calibration: str | None = None
    any_day: bool = False
    video_start: float | None = None
    refine: bool = True
    rasters: RasterSettings = field(default_factory=RasterSettings)


@dataclass(frozen=True, slots=True)
class ReplayResult:
    """A replay that is over. `interrupted`: all but the GeoTIFFs is complete."""

    folder: Path
    summary: dict[str, Any]
    interrupted: bool = False


def replay_pictures(
    options: ReplayOptions, crew: Crew, complain: Callable[[str], None]
) -> ReplayResult:
    """Map the ground of recorded pictures, into a folder.

    `crew` examines them; `complain` receives faults of the GeoTIFFs, without which the results are
    complete. Raises `MissionFileError`, `ImageError`, `OutputError`, `JournalError`, and
    `UavmapError` where memory runs out.
    """
    with report_memory_error(f"{options.path} is not mapped", MEMORY_HELPS):
        return _replayed(options, crew, complain)


def _replayed(options: ReplayOptions, crew: Crew, complain: Callable[[str], None]) -> ReplayResult:
    options.rasters.check()
    # faults of the mission and the detector are reported before pictures are read
    given = None if options.mission is None else load(options.mission, options.detector)
    if given is not None:
        require_detector(given.detector, options.mission or "")
    detector = DETECTOR
    if given is None and options.detector is not None:
        detector = detector_text(Path(options.detector))
    lens = calibration_of(options.calibration, given, options.mission)
    if options.out is not None:  # reported before pictures are read, which may take long
        refuse_unwritable(results_folder(options.out, ""))
    gathered = gather(open_source(Path(options.path), options.video_start))
    source = options.mission or DERIVED
    with Spool() as spool, FeatureFile() as kept:
        overlaps = None
        if options.refine:
            overlaps = Overlaps.examine(gathered, given, kept, lens=lens, crew=crew)
        bad = contradicted(gathered.pictures, given, any_day=options.any_day)
        if len(bad) < len(gathered.pictures):
            gathered = gathered.without(bad)
        while True:
            better = None if overlaps is None else overlaps.refined(gathered)
            gathered = gathered if better is None else better.gathered
            text, mission = "", given
            if mission is None:
                text = derived(gathered, lens, any_day=options.any_day, detector=detector)
                mission = mission_of_text(text, source)
            refuse_unknown_ground(mission, source)
            looked = judge_pictures(
                gathered, setting_of(mission), spool, crew, lens=lens, any_day=options.any_day
            )
            bad = looked.unused()
            if not bad or (given is not None and overlaps is None):
                break
            # poses, and cells that depend on them, come from the others alone
            _LOG.info(f"{len(bad)} of them are set aside; once more without")
            gathered = gathered.without(bad)
        looked.refuse_empty()
        folder = results_folder(options.out, mission.name)
        if given is None:
            for line in _choices(mission, options):
                _LOG.info(line)
        make_folder(folder)
        keep_detector(mission.detector, folder)
        try:
            if better is not None:
                better.write(folder)
            if given is None:
                write_text(folder / MISSION_FILE, with_relative_model(text))
                _LOG.info(f"the mission file is {folder / MISSION_FILE}: edit it, replay again")
            began_s = time.perf_counter()
            meta = journal_meta(mission, source, options.path) | looked.start_time()
            with Journal.create(folder / JOURNAL, meta) as journal:
                summary = looked.written(journal, folder)
            _LOG.info(f"results written in {time.perf_counter() - began_s:.2f} s")
        except OSError as error:
            raise OutputError(_unwritten(folder, error)) from None
        interrupted = _rasters(looked, folder, options.rasters, complain)
    return ReplayResult(folder, summary, interrupted)


def _unwritten(folder: Path, error: OSError) -> str:
    """Return a line for results that the disk refuses: file, reason, remedy."""
    file = error.filename2 or error.filename  # the second one where a file takes its name
    name = f"{Path(os.fsdecode(file)).name}: " if isinstance(file, (str, bytes)) else ""
    helps = "make room, and" if error.errno in (errno.ENOSPC, errno.EDQUOT) else "mend that, or"
    return (
        f"{folder}: the results cannot be written ({name}{error.strerror}); {helps} replay into "
        "another folder"
    )


def _rasters(
    looked: JudgedPictures,
    folder: Path,
    settings: RasterSettings,
    complain: Callable[[str], None],
) -> bool:
    """Write the GeoTIFFs, which are optional; return True if interrupted."""
    began_s = time.perf_counter()
    give_back()
    try:
        with report_memory_error(
            "not all GeoTIFFs are written", "try a coarser --gsd, or --no-ortho"
        ):
            if looked.write_rasters(folder, settings):
                _LOG.info(f"GeoTIFFs written in {time.perf_counter() - began_s:.1f} s more")
    except UavmapError as error:
        complain(f"{error}; all other results are complete")
    except KeyboardInterrupt:
        complain(f"interrupted: {ORTHO} is not written; all other results are complete")
        return True
    return False


def _choices(mission: Mission, options: ReplayOptions) -> list[str]:
    """Return the choices of a replay without --mission, and the options for others."""
    camera, path = mission.camera, shlex.quote(options.path)
    lines = [
        f"cells of {mission.grid.cell_m:g} m, pictures judged at {camera.width_px} px, "
        f"{camera.hfov_deg:.1f} deg wide, from {mission.altitude_m(0):.0f} m",
        f"region = {region_in_words(mission.detector)}",
    ]
    if options.detector is None:
        lines += [
            f"the default detector is {mission.detector.name}, which depends least on the light "
            "and needs no examples; it knows nothing of your region",
            "another one: --detector NAME; one that has seen your region: "
            f"uavmap tune {path} --paint --examples painted --out my-field, then --detector "
            "my-field",
        ]
    return ["without --mission, from the pictures:", *(f"  {line}" for line in lines)]


def journal_meta(mission: Mission, source: str, path: str) -> dict[str, Any]:
    """Return the begin of a replay's journal: its mission, and the path of the pictures."""
    plan = FlightPlan(
        mission_source=source,
        simulated=True,
        seed=0,
        mission=mission,
        epoch_utc_s=SIM_EPOCH_UTC_S,
    )
    return {"plan": plan.as_json(), "replay": path}


# --- memory -------------------------------------------------------------------------------------
def give_back() -> None:
    """Have the C library return free memory to the system, if it can.

    Many threads use memory for a moment each, and glibc keeps it for them. After the maps of 1,000
    pictures a quarter of the process's memory was free.
    """
    trim = getattr(ctypes.CDLL(None), "malloc_trim", None)
    if trim is not None:  # glibc; other libraries return memory by themselves
        trim(0)


@contextlib.contextmanager
def report_memory_error(what: str, remedy: str) -> Iterator[None]:
    """Report in a line that memory ran out in the block; other errors pass.

    >>> with report_memory_error("the map is not written", "map fewer pictures"):
    ...     raise MemoryError
    Traceback (most recent call last):
    missions.errors.UavmapError: memory ran out: the map is not written; map fewer pictures
    """
    try:
        yield
    except Exception as error:
        if not ran_out(error):
            raise
        raise UavmapError(f"memory ran out: {what}; {remedy}") from None


def ran_out(error: BaseException) -> bool:
    """Return True if an error means lack of memory, in Python, NumPy, OpenCV or GEOS.

    >>> ran_out(MemoryError()), ran_out(RuntimeError("can't start new thread")), ran_out(KeyError())
    (True, True, False)
    """
    if isinstance(error, MemoryError):
        return True
    if isinstance(error, cv2.error):
        return error.code == cv2.Error.StsNoMem or "bad_alloc" in str(error)
    if isinstance(error, shapely.errors.GEOSException):
        return "bad_alloc" in str(error)
    # a stack needs memory as well
    return isinstance(error, RuntimeError) and "can't start new thread" in str(error)
