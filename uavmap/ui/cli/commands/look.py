"""uavmap look: the verdicts of a detector on one picture."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Final

import cv2
from rich.table import Table

from missions.errors import ImageError, OutputError
from missions.mission.height_and_speed import refuse_unknown_ground
from uavmap.base.terminal import PipeConsole
from uavmap.load.detector_source import detector_text, require_detector
from uavmap.load.mission_source import load, mission_of_text
from uavmap.output.documents import save
from uavmap.output.summary import encode
from uavmap.photos.ground.judging import PictureReport, annotated, inspect_picture
from uavmap.photos.mission_from_photos import DETECTOR, derived
from uavmap.photos.registration.calibration import calibration_of
from uavmap.photos.sources.inventory import gather, open_source
from uavmap.ui.cli.option_table import add_options

_ROWS = 40

EXAMPLES: Final = """\
  uavmap look photos/DJI_0018.JPG --mission road
  uavmap look photos/DJI_0018.JPG --mission field.toml --json --out seen.png
  uavmap look photos/DJI_0018.JPG --detector my-field
"""
NOTES: Final = """\
The command prints the place of the picture, and for each cell the share that the detector rates as
region. It writes the picture with the cells drawn on it. From a video or a folder it uses the first
picture. Without --mission the cells and the camera come from the picture.

exit codes:
  0    the picture was judged
  2    the input is wrong; a line names the fault
"""
DESCRIPTION: Final = "Show what the detector of a mission finds in one picture."


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments."""
    parser.add_argument("image", metavar="IMAGE", help="a picture")
    parser.add_argument(
        "--mission",
        metavar="MISSION",
        help="the mission with grid, camera and detector (default: from the picture)",
    )
    add_options(parser, "look")
    parser.add_argument(
        "--out",
        metavar="FILE",
        help="the annotated picture (default: NAME-looked.png in the current folder)",
    )


def run(options: argparse.Namespace) -> int:
    """Judge one picture."""
    mission = None if options.mission is None else load(options.mission, options.detector)
    if mission is not None:
        require_detector(mission.detector, options.mission)
    lens = calibration_of(options.calibration, mission, options.mission)
    source = options.mission or "derived from the picture"
    detector = DETECTOR
    if mission is None and options.detector is not None:
        detector = detector_text(Path(options.detector))
    gathered = gather(open_source(Path(options.image)))
    if mission is None:
        mission = mission_of_text(derived(gathered, lens, detector=detector), source)
    refuse_unknown_ground(mission, source)
    if not gathered.pictures:
        raise ImageError(f"{options.image}: has no readable picture; give JPEG, PNG or TIFF")
    looked = inspect_picture(gathered.pictures[0], mission, lens)
    out = Path(options.out or f"{Path(gathered.pictures[0].name).stem}-looked.png")
    good, data = cv2.imencode(".png", annotated(looked))
    if not good:
        raise OutputError(f"{out}: cannot be written as PNG")
    save(out, data.tobytes())
    if options.json:
        sys.stdout.write(encode(looked.figures() | {"out": str(out)}) + "\n")
    else:
        _show(looked, out)
    return 0


def _show(looked: PictureReport, out: Path) -> None:
    figures = looked.figures()
    place = looked.placed.pose.position
    print(
        f"{figures['picture']}: {figures['height_m']:.1f} m above {place.lat_deg:.6f}, "
        f"{place.lon_deg:.6f}; {figures['hfov_deg']:.1f} deg wide, {100 * figures['gsd_m']:.1f} cm "
        f"a pixel"
    )
    print(f"{figures['roi_share']:.0%} of the pixels are rated as region")
    if looked.doubt:
        print(f"a mission does not count this picture: {looked.doubt}")
    ranked = sorted(looked.verdicts, key=lambda v: (-v.share, v.cell))
    table = Table(title=f"{len(ranked)} cells, the {min(_ROWS, len(ranked))} with most region")
    for name in ("column", "row", "share", "region"):
        table.add_column(name, justify="right")
    for verdict in ranked[:_ROWS]:
        cell, region = verdict.cell, "yes" if verdict.positive else "no"
        table.add_row(str(cell.east), str(cell.north), f"{verdict.share:.0%}", region)
    PipeConsole().print(table)
    print(f"{sum(v.positive for v in ranked)} cells are region; annotated picture: {out}")
