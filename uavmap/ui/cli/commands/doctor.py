"""uavmap doctor: checks of the installation, of a vehicle, and of a vehicle for a mission."""

from __future__ import annotations

import argparse
import asyncio
import json
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Final

from missions.errors import MissionFileError
from missions.flight.setting_of import setting_of
from missions.flight.state import Setting
from missions.mission.schema import CameraSection
from uavmap.aircraft.cameras.spec import CameraSpec, parse_camera
from uavmap.aircraft.imaging.classifier import detector_of
from uavmap.base.clock import ScaledClock
from uavmap.base.clock import run as run_on
from uavmap.base.messages import shown_on
from uavmap.base.terminal import Terminal
from uavmap.journal.flight_plan import FlightOptions
from uavmap.load.detector_source import require_detector
from uavmap.load.mission_source import load, shipped_missions
from uavmap.runner.flight_links import Link, cameras_of, check_urls
from uavmap.runner.preflight.autopilot_fence import outside_m
from uavmap.runner.preflight.autopilot_setup import AutopilotSetup
from uavmap.runner.preflight.computer_check import ComputerSpeed, computer_findings, installation
from uavmap.runner.preflight.examination import Examination, connect, open_answering_links
from uavmap.runner.preflight.finding import Finding, could_fly, for_vehicle, ok
from uavmap.runner.preflight.plan_figures import plan_lines
from uavmap.ui.cli import INCOMPLETE
from uavmap.ui.cli.flight_options import key_file
from uavmap.ui.cli.option_table import add_options

Add = Callable[[Sequence[Finding]], None]
"""Function that receives findings as they are made."""
PICTURES: Final = "doctor"
"""Default folder of test pictures."""

EXAMPLES: Final = """\
  uavmap doctor                                                check the installation
  uavmap doctor --connect udpin://0.0.0.0:14550                and a vehicle
  uavmap doctor field.toml --connect udpin://0.0.0.0:14550     for a mission, with a test picture
  uavmap doctor field.toml --connect serial:///dev/ttyACM0:57600 --json
"""
NOTES: Final = """\
The doctor arms nothing and sets nothing. `uavmap fly MISSION --connect URL --dry-run` also sets the
fence, and restores the old one.

exit codes:
  0    no finding is bad: the mission could fly
  2    the input is wrong, or a vehicle does not answer; a line names the fault
  3    a finding is bad; its line has the remedy
  130  interrupted
"""
DESCRIPTION: Final = "List what is right, doubtful or bad, each with its remedy."


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments."""
    parser.add_argument(
        "mission",
        metavar="MISSION",
        nargs="?",
        help=f"a mission file or a shipped mission: {', '.join(shipped_missions())}",
    )
    add_options(parser, "doctor")
    parser.add_argument(
        "--out",
        metavar="DIR",
        default=PICTURES,
        help="the folder of test pictures (default: doctor)",
    )


def run(options: argparse.Namespace) -> int:
    """Check and print the findings."""
    urls, folder = tuple(options.connect or ()), Path(options.out)
    check_urls(urls)
    links = FlightOptions(
        mission_source="", urls=urls, speedup=options.speedup, key_file=key_file(options)
    )
    setting = _setting(options.mission, len(urls))
    cameras = _cameras(tuple(options.camera or ()), setting, len(urls))
    found = list(installation(folder))
    vehicles = len(urls) or (1 if setting is None else len(setting.mission.vehicles))
    found += computer_findings(ComputerSpeed.measured(setting), setting, vehicles)
    if not options.json:
        _print(found)
        if setting is not None:
            print("\n".join(plan_lines(setting)))
    if urls:
        clock = ScaledClock(options.speedup or 1.0)
        seen: list[Finding] = []

        def add(findings: Sequence[Finding]) -> None:
            seen.extend(findings)
            if not options.json:
                _print(findings)

        run_on(_vehicles(links, cameras, setting, folder, add), clock)
        found += seen
    able = could_fly(found)
    if options.json:
        values = {"could_fly": able, "findings": [finding.as_json() for finding in found]}
        print(json.dumps(values, indent=2))
    else:
        print("no finding is bad" if able else "do not fly: some findings above are bad")
    return 0 if able else INCOMPLETE


def _setting(name: str | None, links: int) -> Setting | None:
    """Load the mission, with a vehicle for each link where links are given."""
    if name is None:
        return None
    mission = load(name)
    require_detector(mission.detector, name)
    if links > len(mission.vehicles):
        raise MissionFileError(
            f"{name}: {len(mission.vehicles)} vehicles, but {links} connection URLs; give "
            "--connect at most once for each vehicle"
        )
    return setting_of(mission)


def _cameras(given: Sequence[str], setting: Setting | None, links: int) -> list[CameraSpec]:
    """Return the camera at each link; without a mission no camera is checked."""
    if setting is None:
        if given:
            raise MissionFileError("--camera needs a MISSION, which has the size of its pictures")
        return [parse_camera("mavlink")] * links
    cameras = cameras_of(given, setting.mission)
    if len(cameras) < links:
        raise MissionFileError(
            f"{links} connection URLs, but {len(cameras)} times --camera; give one for each vehicle"
        )
    return cameras[:links]


def _print(found: Sequence[Finding]) -> None:
    for finding in found:
        print(finding.line(), flush=True)


async def _vehicles(
    options: FlightOptions,
    cameras: Sequence[CameraSpec],
    setting: Setting | None,
    folder: Path,
    add: Add,
) -> None:
    section = CameraSection() if setting is None else setting.mission.camera
    with shown_on(Terminal()):
        async with (
            open_answering_links(options, cameras, section) as links,
            asyncio.TaskGroup() as tasks,
        ):
            for link in links:
                if setting is not None:
                    link.session.view.gate.area = setting.mission.home
            for number, link in enumerate(links, start=1):
                tasks.create_task(_vehicle(number, link, setting, folder, add))


async def _vehicle(
    number: int, link: Link, setting: Setting | None, folder: Path, add: Add
) -> None:
    examination = Examination(number, link.session, link.camera)
    setup = None if setting is None else AutopilotSetup(number, link.session, setting, folder)
    await connect(link.session, link.name)
    add(await examination.vehicle(setting))
    if setting is None or setup is None:
        return
    mission = setting.mission
    ratio = mission.altitude_m(number - 1) / mission.altitude_m(0)
    if not link.session.view.armed:
        add(await examination.camera(setting, detector_of(mission, ratio), folder))
    before, findings = await setup.examine()
    by_m = outside_m(mission.flight.speed_m_s, setting.energy.accel_m_s2)
    findings.append(
        ok(
            "fence",
            f"{setup.settings_text(before)}; a flight sets the mission's fence, {by_m:.0f} m wider",
        )
    )
    add(for_vehicle(number, findings))
