"""Maps of recorded pictures from Python."""

from __future__ import annotations

import logging
from contextlib import AbstractContextManager, nullcontext
from datetime import datetime
from typing import Final

from missions.errors import UavmapError
from uavmap.base.arguments import Paths, number, path_text, whole
from uavmap.base.messages import muted, shown_on
from uavmap.base.terminal import Terminal
from uavmap.photos.ground.rasters import RasterSettings
from uavmap.photos.replay_job import ReplayOptions, replay_pictures
from uavmap.photos.workers import Cluster, Crew, Threads
from uavmap.ui.api.results import Results, open_results

_LOG: Final = logging.getLogger("uavmap.photos")


def replay(
    path: Paths,
    *,
    mission: Paths | None = None,
    detector: Paths | None = None,
    out: Paths | None = None,
    calibration: Paths | None = None,
    any_day: bool = False,
    video_start: datetime | None = None,
    workers: int | None = None,
    scheduler: str | None = None,
    refine: bool = True,
    ortho: bool | None = None,
    gsd_m: float | None = None,
    quiet: bool = False,
) -> Results:
    """Map recorded pictures, as `uavmap replay` does, with detector and votes as in a flight.

    Args:
        path: A folder of pictures with its subfolders, one file, or a flight with kept frames.
        mission: A mission file, or the name of a shipped one: grid, camera, detector and votes. By
            default they come from the pictures.
        detector: A name such as `"paved"`, or a folder made by `uavmap tune`, instead of the
            mission's detector.
        out: The folder of the results; by default a new one in `results`.
        calibration: The camera's calibration by OpenCV, instead of the tags' focal length.
        any_day: Use pictures of all days. By default those of the day with the most pictures.
        video_start: The time at which a video with a .tlog beside it begins, with its time zone.
        workers: The number of pictures that are judged at once, 1 to 256. By default one per core.
        scheduler: The address of a Dask cluster that judges the pictures (the extra `cluster`).
        refine: Refine the poses where pictures overlap.
        ortho: Write the mosaic `ortho.tif`. By default if rasterio is installed.
        gsd_m: The size of its pixels on the ground, 0.005 to 10 m. By default as fine as the
            pictures, but at least 0.05.
        quiet: Write nothing to standard error.

    Returns:
        The results. `completed` is False if half of the pictures or more could not be used.

    Raises:
        MissionFileError: The mission file is wrong; file, key, value and remedy.
        ImageError: No picture can be used, or a calibration cannot be read.
        UavmapError: Any other cause outside of the program; it is the base of all above.

    Examples:
        >>> replay("no-such-folder")
        Traceback (most recent call last):
        missions.errors.ImageError: no-such-folder: ...
    """
    if video_start is not None and video_start.tzinfo is None:
        raise UavmapError(f"video_start = {video_start!r}: expected a time with its time zone")
    if workers is not None and scheduler is not None:
        raise UavmapError("workers excludes scheduler; give one of them")
    wanted = ReplayOptions(
        path=path_text("path", path),
        mission=None if mission is None else path_text("mission", mission),
        detector=None if detector is None else path_text("detector", detector),
        out=None if out is None else path_text("out", out),
        calibration=None if calibration is None else path_text("calibration", calibration),
        any_day=any_day,
        video_start=None if video_start is None else video_start.timestamp(),
        refine=refine,
        rasters=RasterSettings(
            ortho, None if gsd_m is None else number("gsd_m", gsd_m, 0.005, 10.0)
        ),
    )
    count = None if workers is None else whole("workers", workers, 1, 256)
    by: AbstractContextManager[Crew] = nullcontext(Threads(count))
    with (
        muted() if quiet else shown_on(Terminal()),
        by if scheduler is None else Cluster(scheduler) as crew,
    ):
        done = replay_pictures(wanted, crew, _LOG.info)
    if done.interrupted:
        raise KeyboardInterrupt(f"{done.folder} has all results but the GeoTIFFs")
    return open_results(done.folder)
