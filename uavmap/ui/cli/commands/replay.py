"""uavmap replay: a map from recorded pictures."""

from __future__ import annotations

import argparse
from contextlib import AbstractContextManager, nullcontext
from typing import Final

from uavmap.base.messages import shown_on
from uavmap.base.terminal import Terminal
from uavmap.photos.ground.rasters import Wishes
from uavmap.photos.replay_job import Wanted, replay_pictures
from uavmap.photos.workers import Cluster, Crew, Threads
from uavmap.ui.cli import INTERRUPTED, complain
from uavmap.ui.cli.common import number_type, report, utc_seconds, worker_count
from uavmap.ui.cli.option_table import add_options

EXAMPLES: Final = """\
examples:
  uavmap replay photos/
  uavmap replay photos/ --detector my-field
  uavmap replay photos/ --mission road
  uavmap replay photos/ --mission field.toml --out field-map --calibration camera.yaml
  uavmap replay photos/ --mission field.toml --detector my-field
  uavmap replay photos/ --refine off
  uavmap replay archive/ --scheduler tcp://10.0.0.5:8786
  uavmap replay photos/ --gsd 0.02          a finer mosaic
  uavmap replay photos/ --no-ortho          none

PATH is a folder with its subfolders, or one file. Pictures are JPEG, PNG or TIFF of 8 or 16 bits.
Positions come from EXIF, heights and angles from XMP as drones write them, or all of them from a
geo.txt of OpenDroneMap in the folder. Without --mission the cells, the box, the camera and the
height come from the pictures; the mission file that this makes is left in the results.

The region's outline at pixel level is boundary.geojson. With rasterio there are also
probability.tif, how likely each pixel of the ground is region, and ortho.tif, the pictures laid on
the ground.

A picture that cannot be used is named with its reason, in pictures.csv too, and the others are
mapped.

exit codes:
  0    most pictures are in the map
  2    something is wrong with the input; a line says what
  3    half of the pictures or more could not be used, or they show no cell
"""
DESCRIPTION: Final = "Recorded pictures through the same detector and the same votes as a flight."


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments."""
    parser.add_argument("path", metavar="PATH", help="a folder of pictures, or one picture")
    parser.add_argument("--mission", metavar="MISSION", help="grid, camera, detector and votes")
    add_options(parser, "replay")
    parser.add_argument(
        "--any-day", action="store_true", help="use pictures of other days than most, too"
    )
    parser.add_argument(
        "--video-start",
        metavar="TIME",
        type=utc_seconds,
        help="when a video with a .tlog beside it begins: 2024-05-01T10:11:12.5Z",
    )
    who = parser.add_mutually_exclusive_group()
    who.add_argument(
        "--workers",
        metavar="N",
        type=worker_count,
        help="how many pictures are looked at at once (default: one a core); the map is the same",
    )
    who.add_argument(
        "--scheduler",
        metavar="ADDRESS",
        help="of a Dask cluster that looks at the pictures: tcp://HOST:PORT; the map is the same",
    )
    parser.add_argument(
        "--refine",
        choices=("on", "off"),
        default="on",
        help="on: refine poses where pictures overlap; off: take them as tagged (default: on)",
    )
    parser.add_argument(
        "--ortho",
        action=argparse.BooleanOptionalAction,
        help="write the pictures laid side by side on the ground, as a GeoTIFF (default: if "
        "rasterio is installed)",
    )
    parser.add_argument(
        "--gsd",
        metavar="M",
        type=number_type(float, 0.005, 10.0),
        help="metres of ground a pixel of ortho.tif (default: as fine as the pictures, at the "
        "finest 0.05)",
    )


def run(options: argparse.Namespace) -> int:
    """Replay."""
    wanted = Wanted(
        path=options.path,
        mission=options.mission,
        detector=options.detector,
        out=options.out,
        calibration=options.calibration,
        any_day=options.any_day,
        video_start=options.video_start,
        refine=options.refine == "on",
        rasters=Wishes(options.ortho, options.gsd),
    )
    by: AbstractContextManager[Crew] = nullcontext(Threads(options.workers))
    if options.scheduler is not None:
        by = Cluster(options.scheduler)
    with by as crew, shown_on(Terminal()):
        done = replay_pictures(wanted, crew, complain)
    code = report(done.summary, done.folder, as_json=options.json, verbose=options.verbose)
    return code or (INTERRUPTED if done.interrupted else 0)
