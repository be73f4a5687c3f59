"""uavmap onboard: fly one vehicle of a fleet, from its own computer."""

from __future__ import annotations

import argparse
from dataclasses import replace
from typing import Any

from uavmap.cli.common import EXIT_CODES, vehicle_count
from uavmap.cli.fleet_options import add_fleet_options, network_of
from uavmap.cli.flight_options import (
    add_camera_option,
    add_flight_options,
    add_mission,
    begin,
    preflight_of,
    wanted_of,
)
from uavmap.comms.fleet_radio import check_network
from uavmap.fly.planned import planned

_EXAMPLES = """\
examples:
  uavmap onboard bay.toml --vehicle 2 --connect serial:///dev/ttyAMA0:921600 --camera libcamera \\
         --listen 'udp/224.0.0.224:7447#iface=wlan0' --fleet-key ~/.uavmap.fleet --yes
  uavmap onboard bay.toml --vehicle 1 --connect serial:///dev/ttyAMA0:921600 \\
         --listen tcp/0.0.0.0:7447 --fleet-key ~/.uavmap.fleet
  uavmap onboard bay.toml --vehicle 2 --connect serial:///dev/ttyAMA0:921600 \\
         --peer tcp/192.168.7.11:7447 --fleet-key ~/.uavmap.fleet
  uavmap onboard bay.toml --vehicle 3 --connect serial:///dev/ttyAMA0:921600 \\
         --router tcp/192.168.7.1:7447 --fleet-key ~/.uavmap.fleet

Each aircraft of a fleet has a computer that runs this, with the same mission file and the same
fleet key; --vehicle is its number in the file. They tell each other what they see and do, and each
commands its own aircraft only: who is out of reach goes on alone. Afterwards `uavmap merge` makes
one map of all journals. Without --listen, --peer and --router it flies alone.

Ctrl-C brings this aircraft home; `uavmap resume DIR` goes on later.
"""


def add_parser(commands: Any) -> None:
    """Add the command."""
    parser = commands.add_parser(
        "onboard",
        description="Fly one vehicle of a fleet, each having a service of its own on board.",
        epilog=f"{_EXAMPLES}\n{EXIT_CODES}",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    add_mission(parser)
    parser.add_argument(
        "--vehicle",
        metavar="K",
        type=vehicle_count,
        required=True,
        help="which vehicle of the mission file this one is, from 1",
    )
    parser.add_argument(
        "--connect",
        metavar="URL",
        action="append",
        default=[],
        help="where its autopilot is reached (default: its url in the mission file)",
    )
    add_fleet_options(parser)
    add_camera_option(parser, "this vehicle")
    add_flight_options(parser, fleet=True)
    parser.set_defaults(run=run)


def run(options: argparse.Namespace) -> int:
    """Fly."""
    network = network_of(options)
    wanted = replace(wanted_of(options), onboard=True, member=options.vehicle, network=network)
    check_network(network)
    plan, mission = planned(wanted)
    return begin(options, plan, mission, preflight_of(options))
