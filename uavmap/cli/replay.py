"""uavmap replay: a map from recorded photographs."""

from __future__ import annotations

import argparse
from dataclasses import asdict
from pathlib import Path
from typing import Any

from missions.mission_file.terrain_checks import refuse_unknown_ground
from missions.state import Setting
from uavmap.cli.common import DETECTOR_HELP, report, results_folder
from uavmap.fly.progress import Terminal
from uavmap.mission_source import load_source
from uavmap.offline.photos import list_photos
from uavmap.offline.replay import replay
from uavmap.record.flight_plan import JOURNAL, SIM_EPOCH_UTC_S, FlightPlan
from uavmap.record.journal import Journal

_EXAMPLES = """\
examples:
  uavmap replay photos/ --mission road
  uavmap replay photos/ --mission field.toml --out field-map
  uavmap replay photos/ --mission field.toml --detector my-field

Photographs need EXIF GPS positions, and height and angles in XMP, as a DJI writes them.
"""


def add_parser(commands: Any) -> None:
    """Add the command."""
    parser = commands.add_parser(
        "replay",
        help="map what recorded photographs show",
        description="Recorded imagery through the same eyes and the same mission as a flight.",
        epilog=_EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("images", metavar="IMAGES", help="a folder of JPEGs, or one of them")
    parser.add_argument("--mission", metavar="MISSION", required=True, help="grid and detector")
    parser.add_argument("--detector", metavar="DIR", help=DETECTOR_HELP)
    parser.add_argument("--out", metavar="DIR", help="folder for the results (default: a new one)")
    parser.add_argument("--json", action="store_true", help="print the summary as JSON")
    parser.set_defaults(run=run)


def run(options: argparse.Namespace) -> int:
    """Replay."""
    source = load_source(options.mission, options.detector)
    mission = source.parse()
    refuse_unknown_ground(mission, source.source)
    images = Path(options.images)
    list_photos(images)  # say what is wrong before a folder is made
    folder = results_folder(options.out, mission.name)
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
    meta = {"plan": asdict(plan), "replay": str(images)}
    with Journal.create(folder / JOURNAL, meta) as journal:
        summary = replay(images, Setting.of(mission), journal, folder, Terminal())
    return report(summary, folder, as_json=options.json)
