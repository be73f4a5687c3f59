"""What `uavmap fly` and `uavmap onboard` have in common: options, and the flight itself."""

from __future__ import annotations

import argparse

from missions.errors import NotFlownError, leaves
from missions.mission_file import fleet_checks
from missions.mission_file.checks import STRATEGIES
from missions.mission_file.schema import Mission
from uavmap.base.messages import shown_on
from uavmap.base.terminal import Terminal
from uavmap.cameras.spec import HELP
from uavmap.cli.common import DETECTOR_HELP, report, speedup
from uavmap.cli.endings import AIRCRAFT_DOWN, INCOMPLETE, complain
from uavmap.cli.link_options import add_link_options, key_file
from uavmap.cli.page_options import add_page_options, beside
from uavmap.cli.summary import add_summary_options
from uavmap.fly.before_flight import Preflight
from uavmap.fly.flight import fly
from uavmap.fly.ground_survey import with_ground
from uavmap.fly.one_flight import Company
from uavmap.fly.planned import Wanted
from uavmap.mission_source import shipped_missions
from uavmap.offline.after_flight import draw_boundary, kept_frames
from uavmap.preflight.plan_figures import plan_lines
from uavmap.record.flight_plan import DRIVERS, PYMAVLINK, FlightPlan
from uavmap.record.results_folder import results_folder


def add_mission(parser: argparse.ArgumentParser) -> None:
    """Add MISSION."""
    parser.add_argument(
        "mission",
        metavar="MISSION",
        help=f"a mission file, or a shipped mission: {', '.join(shipped_missions())}",
    )


def add_camera_option(parser: argparse.ArgumentParser, whose: str) -> None:
    """Add `--camera`."""
    parser.add_argument(
        "--camera",
        metavar="SPEC",
        action="append",
        default=[],
        help=f"the camera of {whose}: {HELP} (default: as the mission file says, else mavlink)",
    )


def add_flight_options(parser: argparse.ArgumentParser, *, fleet: bool = False) -> None:
    """Add what every flight may be given; of a `fleet` the help says what its vehicles can fly."""
    strategies = fleet_checks.STRATEGIES if fleet else STRATEGIES
    parser.add_argument("--strategy", metavar="NAME", help=f"one of: {', '.join(strategies)}")
    alone = "; with --sim the default is as fast as it goes, with --connect 1"
    parser.add_argument(
        "--speedup",
        metavar="X",
        type=speedup,
        help="times real time" + (", for simulators (default 1)" if fleet else alone),
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
        "(default), or MAVSDK" + ("" if fleet else "; not with --sim"),
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
    parser.add_argument("--out", metavar="DIR", help="folder for the results (default: a new one)")
    add_summary_options(parser)


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


def wanted_of(options: argparse.Namespace, *, sim: bool = False) -> Wanted:
    """The flight that options ask for which every flight may be given; without a key if simulated.

    Raises `LinkError` for a key without a name.
    """
    return Wanted(
        mission=options.mission,
        sim=sim,
        connect=tuple(options.connect),
        camera=tuple(options.camera),
        strategy=options.strategy,
        detector=options.detector,
        speedup=options.speedup,
        auto_swap=options.auto_swap,
        driver=options.driver,
        key=None if sim else key_file(options),
        forward=tuple(options.forward or ()),
    )


def preflight_of(options: argparse.Namespace) -> Preflight:
    """What is asked for before the first take-off of real aircraft."""
    return Preflight(plan_lines, options.yes, options.dry_run, options.keep_fence)


def begin(
    options: argparse.Namespace, plan: FlightPlan, mission: Mission, preflight: Preflight | None
) -> int:
    """Fly a plan into the folder of --out, with what is asked for beside it; the exit code."""
    terminal = Terminal()
    with shown_on(terminal):
        return _begin(options, plan, mission, preflight, terminal)


def _begin(
    options: argparse.Namespace,
    plan: FlightPlan,
    mission: Mission,
    preflight: Preflight | None,
    terminal: Terminal,
) -> int:
    plan = with_ground(plan)
    folder = results_folder(options.out, mission.name)
    terminal.show(f"{mission.name} into {folder}; if it is interrupted: uavmap resume {folder}")
    if mission.camera.calibration is not None:
        terminal.show("camera.calibration is for recorded pictures; this flight uses hfov_deg")
    code, summary = 0, None
    try:
        with beside(options, plan, folder, terminal) as onlookers:
            company = Company(onlookers=onlookers, preflight=preflight)
            summary = fly(plan, folder, company, keep_frames=options.keep_frames)
    except* NotFlownError as group:
        for over in leaves(group):
            complain(str(over))
            if isinstance(over, NotFlownError) and not over.could_fly:
                code = INCOMPLETE
    if summary is None:
        return code
    code = report(summary, folder, as_json=options.json, verbose=options.verbose)
    if kept_frames(folder) and code != AIRCRAFT_DOWN:
        draw_boundary(folder, complain)
    return code
