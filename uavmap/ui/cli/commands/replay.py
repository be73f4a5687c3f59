"""uavmap replay: make a map from recorded pictures."""

from __future__ import annotations

import argparse
from contextlib import AbstractContextManager, nullcontext
from typing import Final

from uavmap.base.messages import shown_on
from uavmap.base.terminal import Terminal
from uavmap.photos.ground.rasters import RasterSettings
from uavmap.photos.replay_job import ReplayOptions, replay_pictures
from uavmap.photos.workers import Cluster, Crew, Threads
from uavmap.ui.cli import INTERRUPTED, complain
from uavmap.ui.cli.common import number_type, report, utc_seconds, worker_count
from uavmap.ui.cli.option_table import add_options

EXAMPLES: Final = """\
  uavmap replay photos/
  uavmap replay photos/ --detector my-field
  uavmap replay photos/ --mission road
  uavmap replay photos/ --mission field.toml --out field-map --calibration camera.yaml
  uavmap replay photos/ --mission field.toml --detector my-field
  uavmap replay photos/ --refine off
  uavmap replay archive/ --scheduler tcp://10.0.0.5:8786
  uavmap replay photos/ --gsd 0.02          a finer mosaic
  uavmap replay photos/ --no-ortho          no mosaic
"""
NOTES: Final = """\
PATH is a folder with its subfolders, or one file. Pictures are JPEG, PNG or TIFF of 8 or 16 bits.
Positions come from EXIF, heights and angles from XMP; or all come from a geo.txt of OpenDroneMap in
the folder. Without --mission the cells, the box, the camera and the height come from the pictures,
and the results contain the mission file.

boundary.geojson has the outline of the region at pixel level. With rasterio there are also
probability.tif, the probability of region for each pixel of the ground, and ortho.tif, the mosaic.

If a picture cannot be used, a line and pictures.csv give the reason, and the others are mapped.

exit codes:
  0    most pictures are in the map
  2    the input is wrong; a line names the fault
  3    half of the pictures or more could not be used, or they show no cell
"""
DESCRIPTION: Final = (
    "Map recorded pictures with the same detector and the same votes as in a flight."
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments."""
    parser.add_argument("path", metavar="PATH", help="a folder of pictures, or one picture")
    parser.add_argument(
        "--mission",
        metavar="MISSION",
        help="the mission with grid, camera, detector and votes (default: from the pictures)",
    )
    add_options(parser, "replay")
    parser.add_argument(
        "--any-day",
        action="store_true",
        help="use pictures of all days (default: of the day with the most pictures)",
    )
    parser.add_argument(
        "--video-start",
        metavar="TIME",
        type=utc_seconds,
        help="the time at which a video with a .tlog beside it begins: 2024-05-01T10:11:12.5Z",
    )
    workers = parser.add_mutually_exclusive_group()
    workers.add_argument(
        "--workers",
        metavar="N",
        type=worker_count,
        help="the number of pictures that are judged at once (default: one per core); the map does "
        "not depend on it",
    )
    workers.add_argument(
        "--scheduler",
        metavar="ADDRESS",
        help="the address of a Dask cluster that judges the pictures: tcp://HOST:PORT",
    )
    parser.add_argument(
        "--refine",
        choices=("on", "off"),
        default="on",
        help="on: refine poses where pictures overlap; off: use the poses in the tags (default: "
        "on)",
    )
    parser.add_argument(
        "--ortho",
        action=argparse.BooleanOptionalAction,
        help="write the mosaic as a GeoTIFF (default: if rasterio is installed)",
    )
    parser.add_argument(
        "--gsd",
        metavar="M",
        type=number_type(float, 0.005, 10.0),
        help="the size of a pixel of ortho.tif, m (default: as fine as the pictures, at least "
        "0.05)",
    )


def run(options: argparse.Namespace) -> int:
    """Map the pictures."""
    wanted = ReplayOptions(
        path=options.path,
        mission=options.mission,
        detector=options.detector,
        out=options.out,
        calibration=options.calibration,
        any_day=options.any_day,
        video_start=options.video_start,
        refine=options.refine == "on",
        rasters=RasterSettings(options.ortho, options.gsd),
    )
    by: AbstractContextManager[Crew] = nullcontext(Threads(options.workers))
    if options.scheduler is not None:
        by = Cluster(options.scheduler)
    with by as crew, shown_on(Terminal()):
        done = replay_pictures(wanted, crew, complain)
    code = report(done.summary, done.folder, as_json=options.json, verbose=options.verbose)
    return code or (INTERRUPTED if done.interrupted else 0)
