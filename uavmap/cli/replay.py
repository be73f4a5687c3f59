"""uavmap replay: a map from recorded pictures."""

from __future__ import annotations

import argparse
import errno
import os
import time
from dataclasses import asdict
from pathlib import Path
from typing import Any

from missions.errors import OutputError
from missions.mission_file.terrain_checks import refuse_unknown_ground
from missions.state import Setting
from uavmap.cli.common import (
    DETECTOR_HELP,
    make_folder,
    number_type,
    refuse_unwritable,
    report,
    results_folder,
    utc_seconds,
    worker_count,
)
from uavmap.cli.endings import INTERRUPTED, complain
from uavmap.detector_source import detector_text
from uavmap.fly.progress import Terminal
from uavmap.kept_detector import keep_detector, with_relative_model
from uavmap.mission_source import MissionSource, load_source
from uavmap.offline.calibration import calibration_of
from uavmap.offline.cluster import Cluster
from uavmap.offline.derived import DETECTOR, derived
from uavmap.offline.gathering import Gathered, gather
from uavmap.offline.rasters import ORTHO, Wishes
from uavmap.offline.refined_pictures import RefinedSet, refined
from uavmap.offline.replay import Looked, Options, look_at_all
from uavmap.offline.sources.opening import open_source
from uavmap.offline.spool import Spool
from uavmap.offline.workers import Crew, Threads
from uavmap.record.flight_plan import JOURNAL, SIM_EPOCH_UTC_S, FlightPlan
from uavmap.record.journal import Journal
from uavmap.results.atomic import write_text
from vision.lens import Lens

MISSION_FILE = "mission.toml"
"""In the results, of a replay without --mission: what was derived from the pictures."""

_EXAMPLES = """\
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

The region's outline at pixel level is boundary.geojson. With uavmap[geo] there are also
probability.tif, how likely each pixel of the ground is region, and ortho.tif, the pictures laid on
the ground.

A picture that cannot be used is named with its reason, in pictures.csv too, and the others are
mapped.

exit codes:
  0    most pictures are in the map
  2    something is wrong with the input; a line says what
  3    half of the pictures or more could not be used, or they show no cell
"""


def add_parser(commands: Any) -> None:
    """Add the command."""
    parser = commands.add_parser(
        "replay",
        description="Recorded pictures through the same detector and the same votes as a flight.",
        epilog=_EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("path", metavar="PATH", help="a folder of pictures, or one picture")
    parser.add_argument("--mission", metavar="MISSION", help="grid, camera, detector and votes")
    parser.add_argument("--detector", metavar="DIR", help=DETECTOR_HELP)
    parser.add_argument("--out", metavar="DIR", help="folder for the results (default: a new one)")
    parser.add_argument(
        "--calibration",
        metavar="FILE",
        help="the camera's calibration by OpenCV: YAML, XML or JSON; instead of the tags' focal "
        "length",
    )
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
        "uavmap[geo] is installed)",
    )
    parser.add_argument(
        "--gsd",
        metavar="M",
        type=number_type(float, 0.005, 10.0),
        help="metres of ground a pixel of ortho.tif (default: as fine as the pictures, at the "
        "finest 0.05)",
    )
    parser.add_argument("--json", action="store_true", help="print the summary as JSON")
    parser.set_defaults(run=run)


def run(options: argparse.Namespace) -> int:
    """Replay."""
    if options.scheduler is None:
        return _replay(options, Threads(options.workers))
    with Cluster(options.scheduler) as cluster:
        return _replay(options, cluster)


def _replay(options: argparse.Namespace, crew: Crew) -> int:
    progress, wishes = Terminal(), Wishes(options.ortho, options.gsd)
    wishes.check()
    given = None if options.mission is None else load_source(options.mission, options.detector)
    asked = None if given is None else given.parse()  # say what is wrong before pictures are read
    detector = DETECTOR
    if given is None and options.detector is not None:
        detector = detector_text(Path(options.detector))
    lens = calibration_of(options.calibration, asked, options.mission)
    if options.out is not None:  # said before pictures are read, which may take long
        refuse_unwritable(results_folder(options.out, ""))
    gathered = gather(open_source(Path(options.path), options.video_start))
    better = _refined(gathered, lens, given, options, progress, crew)
    gathered = gathered if better is None else better.gathered
    source = given or _derived(gathered, lens, detector, any_day=options.any_day)
    mission = source.parse()
    refuse_unknown_ground(mission, source.source)
    folder = results_folder(options.out, mission.name)
    if given is None:
        for line in _shown(source):
            progress.say(line)
    with Spool() as spool:
        how = Options(crew, lens, options.any_day, refine=better is not None)
        looked = look_at_all(gathered, Setting.of(mission), spool, progress, how)
        looked.refuse_empty()
        make_folder(folder)
        keep_detector(mission.detector, source.text, folder)
        try:
            if better is not None:
                better.write(folder)
            if given is None:
                write_text(folder / MISSION_FILE, with_relative_model(source.text, source.source))
                progress.say(f"the mission file is {folder / MISSION_FILE}: edit it, replay again")
            began_s = time.perf_counter()
            meta = _meta(source, options.path) | looked.taken()
            with Journal.create(folder / JOURNAL, meta) as journal:
                summary = looked.written(journal, folder, progress)
            progress.say(f"results written in {time.perf_counter() - began_s:.2f} s")
        except OSError as error:
            raise OutputError(_unwritten(folder, error)) from None
        code = _rasters(looked, folder, wishes, progress)
    return report(summary, folder, as_json=options.json) or code


def _unwritten(folder: Path, error: OSError) -> str:
    """A line for results that the disk refuses: which file, why, and what helps."""
    told = error.filename2 or error.filename  # the second one where a file takes its name
    name = f"{Path(os.fsdecode(told)).name}: " if isinstance(told, (str, bytes)) else ""
    helps = "make room, and" if error.errno in (errno.ENOSPC, errno.EDQUOT) else "mend that, or"
    return (
        f"{folder}: the results cannot be written ({name}{error.strerror}); {helps} replay into "
        "another folder"
    )


def _rasters(looked: Looked, folder: Path, wishes: Wishes, progress: Terminal) -> int:
    """The GeoTIFFs, without which the results are complete; what goes wrong is told in a line."""
    began_s = time.perf_counter()
    try:
        if looked.write_rasters(folder, wishes, progress):
            progress.say(f"GeoTIFFs written in {time.perf_counter() - began_s:.1f} s more")
    except OutputError as error:
        complain(f"{error}; all other results are complete")
    except KeyboardInterrupt:
        complain(f"interrupted: {ORTHO} is not written; all other results are complete")
        return INTERRUPTED
    return 0


def _refined(
    gathered: Gathered,
    lens: Lens | None,
    given: MissionSource | None,
    options: argparse.Namespace,
    progress: Terminal,
    crew: Crew,
) -> RefinedSet | None:
    """The set with the poses that its overlaps give; None where those of the tags are wanted."""
    if options.refine == "off":
        return None
    mission = None if given is None else given.parse()
    return refined(gathered, progress, mission, lens=lens, crew=crew)


def _derived(
    gathered: Gathered, lens: Lens | None, detector: str, *, any_day: bool
) -> MissionSource:
    text = derived(gathered, lens, any_day=any_day, detector=detector)
    return MissionSource("derived from the pictures", text)


def _shown(source: MissionSource) -> list[str]:
    """The lines of a derived mission that a user may want to change."""
    lines = [line for line in source.text.splitlines() if line and not line.startswith("#")]
    return ["without --mission, from the pictures:", *(f"  {line}" for line in lines)]


def _meta(source: MissionSource, path: str) -> dict[str, Any]:
    plan = FlightPlan(
        source.source,
        source.text,
        strategy=None,
        vehicles=None,
        seed=0,
        urls=(),
        speedup=None,
        epoch_utc_s=SIM_EPOCH_UTC_S,
    )
    return {"plan": asdict(plan), "replay": path}
