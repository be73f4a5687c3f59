"""uavmap fly: fly a mission, in the bundled simulator or with real aircraft."""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path
from typing import Any

from missions.errors import LinkError, NotFlownError, leaves
from missions.mission_file.checks import STRATEGIES
from uavmap.cameras.spec import HELP
from uavmap.cli.common import (
    DETECTOR_HELP,
    EXIT_CODES,
    report,
    seed_number,
    speedup,
    vehicle_count,
)
from uavmap.cli.endings import AIRCRAFT_DOWN, INCOMPLETE, complain
from uavmap.cli.link_options import add_link_options, key_file
from uavmap.cli.page_options import add_page_options, add_rerun_option, beside, check_beside
from uavmap.fly.before_flight import Preflight
from uavmap.fly.flight import fly
from uavmap.fly.ground_survey import with_ground
from uavmap.fly.planned import Wanted, planned
from uavmap.fly.progress import Terminal
from uavmap.fly.simulated_fleet import fly_fleet
from uavmap.mission_source import shipped_missions
from uavmap.offline.after_flight import draw_boundary, kept_frames
from uavmap.preflight.plan_figures import plan_lines
from uavmap.record.flight_plan import DRIVERS, PYMAVLINK, FlightPlan
from uavmap.record.results_folder import results_folder

_EXAMPLES = """\
examples:
  uavmap fly runway --sim                           the shipped mission, simulated
  uavmap fly spill --sim --seed 7 --out spill-7     another seed, into a folder of your choice
  uavmap fly field.toml --connect udpin://0.0.0.0:14550
  uavmap fly field.toml --connect serial:///dev/ttyACM0:57600
  uavmap fly field.toml --connect udpin://0.0.0.0:14540 --driver mavsdk
  uavmap fly field.toml --connect serial:///dev/ttyACM0:57600 --camera libcamera
  uavmap fly lake.toml --connect udpin://0.0.0.0:14550 --connect udpin://0.0.0.0:14560
  uavmap fly field.toml --connect udpin://0.0.0.0:14550 --detector my-field
  uavmap fly field.toml --connect udpin://0.0.0.0:14550 --dry-run     all but the take-off

  uavmap fly field.toml --connect udpin://0.0.0.0:14550?system=1 \\
                        --connect udpin://0.0.0.0:14550?system=2
  uavmap fly field.toml --connect serial:///dev/ttyUSB0:57600 --forward udpout://127.0.0.1:14550
  uavmap fly field.toml --connect udpin://0.0.0.0:14550 --key ~/.uavmap.key
  uavmap fly field.toml --connect udpin://0.0.0.0:14550 --page         a live page in the browser
  uavmap fly field.toml --connect udpin://0.0.0.0:14550 --rerun field.rrd    for the Rerun viewer

In flight the keys p, c, r, k, q and ? pause, go on, call home, skip a cell, land, and help.
Ctrl-C brings real aircraft home; a second Ctrl-C has their autopilots do it (RTL) and ends as soon
as that is seen. Either way `uavmap resume DIR` goes on later.
"""


def add_parser(commands: Any) -> None:
    """Add the command."""
    parser = commands.add_parser(
        "fly",
        description="Fly a mission: search the box, explore the region, come home, write the map.",
        epilog=f"{_EXAMPLES}\n{EXIT_CODES}",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument(
        "mission",
        metavar="MISSION",
        help=f"a mission file, or a shipped mission: {', '.join(shipped_missions())}",
    )
    where = parser.add_mutually_exclusive_group()
    where.add_argument(
        "--sim", action="store_true", help="simulate the aircraft in this process, on virtual time"
    )
    where.add_argument(
        "--connect",
        metavar="URL",
        action="append",
        default=[],
        help="where a vehicle is reached; once a vehicle (default: the URLs of the mission file)",
    )
    parser.add_argument(
        "--camera",
        metavar="SPEC",
        action="append",
        default=[],
        help=f"the camera of a vehicle, once a vehicle, in the order of --connect: {HELP} "
        "(default: those of the mission file, else mavlink)",
    )
    parser.add_argument(
        "--vehicles", metavar="N", type=vehicle_count, help="fly with so many vehicles"
    )
    parser.add_argument("--strategy", metavar="NAME", help=f"one of: {', '.join(STRATEGIES)}")
    parser.add_argument(
        "--seed", metavar="S", type=seed_number, default=1, help="of the simulation (default 1)"
    )
    parser.add_argument(
        "--comms",
        metavar="HOW",
        help="with --sim: a service on each aircraft, which hear each other over a simulated "
        "radio: free, range:METRES, or meeting (within 20 m); more after commas: loss:0.1, "
        "delay:SECONDS, jitter:SECONDS, rate:BYTES_A_SECOND (default: one service for all)",
    )
    parser.add_argument(
        "--speedup",
        metavar="X",
        type=speedup,
        help="times real time; with --sim the default is as fast as it goes, with --connect 1",
    )
    parser.add_argument(
        "--auto-swap",
        action="store_true",
        help="take off again as soon as a battery is fresh, unasked; only for simulators "
        "(the bundled one is recognised)",
    )
    parser.add_argument(
        "--driver",
        choices=DRIVERS,
        default=PYMAVLINK,
        help="who speaks MAVLink with real aircraft: this program with pymavlink's codec "
        "(default), or MAVSDK; not with --sim",
    )
    parser.add_argument(
        "--onboard",
        action="store_true",
        help="the service flies with the vehicle: no ground station to a PX4, which then says its "
        "texts, and its failsafe for a lost ground station listens, to others",
    )
    add_link_options(parser)
    _add_preflight_options(parser)
    parser.add_argument("--detector", metavar="DIR", help=DETECTOR_HELP)
    parser.add_argument(
        "--keep-frames",
        action="store_true",
        help="keep every picture with its pose in the results, for `uavmap replay`",
    )
    add_page_options(parser)
    add_rerun_option(parser)
    parser.add_argument("--out", metavar="DIR", help="folder for the results (default: a new one)")
    parser.add_argument("--json", action="store_true", help="print the summary as JSON")
    parser.set_defaults(run=run)


def _fly_fleet(
    options: argparse.Namespace, plan: FlightPlan, folder: Path, progress: Terminal
) -> int:
    """Fly a simulated fleet whose members each have a service of their own."""
    if not options.sim:
        raise LinkError(
            "--comms is for --sim; on real aircraft each computer runs `uavmap onboard`"
        )
    summary = fly_fleet(replace(plan, comms=options.comms), folder, progress)
    return report(summary, folder, as_json=options.json)


def _add_preflight_options(parser: argparse.ArgumentParser) -> None:
    """Add what concerns the time before the first take-off."""
    parser.add_argument(
        "--yes",
        action="store_true",
        help="take off without a question; what must not be passed over (fence, battery, camera) "
        "keeps everybody on the ground all the same",
    )
    parser.add_argument(
        "--dry-run",
        action="store_true",
        help="look at everything, set fences and return heights, put them back, and arm nothing; "
        "exit code 3 where the mission could not be flown",
    )
    parser.add_argument(
        "--keep-fence",
        action="store_true",
        help="leave fence, rally points and return heights of the autopilots as they are; a "
        "mission that leaves such a fence is not flown",
    )


def run(options: argparse.Namespace) -> int:
    """Fly."""
    wanted = Wanted(
        mission=options.mission,
        sim=options.sim,
        connect=tuple(options.connect),
        camera=tuple(options.camera),
        vehicles=options.vehicles,
        strategy=options.strategy,
        detector=options.detector,
        seed=options.seed,
        speedup=options.speedup,
        auto_swap=options.auto_swap,
        driver=options.driver,
        onboard=options.onboard,
        key=None if options.sim else key_file(options),
        forward=tuple(options.forward or ()),
    )
    check_beside(options)
    plan, mission = planned(wanted)
    progress = Terminal()
    plan = with_ground(plan, progress.say)
    folder = results_folder(options.out, mission.name)
    progress.say(f"{mission.name} into {folder}; if it is interrupted: uavmap resume {folder}")
    if mission.camera.calibration is not None:
        progress.say("camera.calibration is for recorded pictures; this flight uses hfov_deg")
    preflight = Preflight(plan_lines, options.yes, options.dry_run, options.keep_fence)
    code, summary = 0, None
    if options.comms is not None:
        return _fly_fleet(options, plan, folder, progress)
    try:
        before = None if options.sim else preflight
        with beside(options, plan, folder, progress) as (heard, seen):
            summary = fly(
                plan, folder, heard, before, keep_frames=options.keep_frames, onlooker=seen
            )
    except* NotFlownError as group:
        for over in leaves(group):
            complain(str(over))
            if isinstance(over, NotFlownError) and not over.could_fly:
                code = INCOMPLETE
    if summary is None:
        return code
    code = report(summary, folder, as_json=options.json)
    if kept_frames(folder) and code != AIRCRAFT_DOWN:
        draw_boundary(folder, progress, complain)
    return code
