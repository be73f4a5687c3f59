"""uavmap fly: fly a mission, in the bundled simulator or with real aircraft."""

from __future__ import annotations

import argparse
from dataclasses import replace
from typing import Any

from missions.errors import LinkError
from missions.mission_file.schema import Mission
from uavmap.base.messages import shown_on
from uavmap.base.terminal import Terminal
from uavmap.cli.common import EXIT_CODES, report, seed_number, vehicle_count
from uavmap.cli.fleet_options import add_fleet_options, given_network, network_of
from uavmap.cli.flight_options import (
    add_camera_option,
    add_flight_options,
    add_mission,
    begin,
    preflight_of,
    wanted_of,
)
from uavmap.comms.fleet_radio import check_network
from uavmap.fly.ground_survey import with_ground
from uavmap.fly.planned import planned
from uavmap.fly.simulated_fleet import fly_fleet
from uavmap.record.flight_plan import FleetNetwork, FlightPlan
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

  uavmap fly field.toml --fleet --listen 'udp/224.0.0.224:7447#iface=wlan0' \\
             --fleet-key ~/.uavmap.fleet --page            on the ground, beside `uavmap onboard`

  uavmap fly field.toml --connect udpin://0.0.0.0:14550?system=1 \\
                        --connect udpin://0.0.0.0:14550?system=2
  uavmap fly field.toml --connect serial:///dev/ttyUSB0:57600 --forward udpout://127.0.0.1:14550
  uavmap fly field.toml --connect udpin://0.0.0.0:14550 --key ~/.uavmap.key
  uavmap fly field.toml --connect udpin://0.0.0.0:14550 --page         a live page in the browser

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
    add_mission(parser)
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
    where.add_argument(
        "--fleet",
        action="store_true",
        help="fly nothing, and join a fleet whose vehicles each run `uavmap onboard`: its map "
        "grows here, and what keys and page order is told to all of them",
    )
    add_fleet_options(parser)
    add_camera_option(parser, "a vehicle, once a vehicle, in the order of --connect")
    parser.add_argument(
        "--vehicles", metavar="N", type=vehicle_count, help="fly with so many vehicles"
    )
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
        "--onboard",
        action="store_true",
        help="the service flies with the vehicle: no ground station to a PX4, which then says its "
        "texts, and its failsafe for a lost ground station listens, to others",
    )
    add_flight_options(parser)
    parser.set_defaults(run=run)


def run(options: argparse.Namespace) -> int:
    """Fly."""
    network = _network(options)
    wanted = replace(
        wanted_of(options, sim=options.sim),
        vehicles=options.vehicles,
        seed=options.seed,
        onboard=options.onboard,
        member=0 if options.fleet else None,
        network=network,
    )
    plan, mission = planned(wanted)
    if options.comms is not None:
        return _fly_fleet(options, plan, mission)
    no_take_off = options.sim or options.fleet
    return begin(options, plan, mission, None if no_take_off else preflight_of(options))


def _network(options: argparse.Namespace) -> FleetNetwork | None:
    """The network of the fleet that is joined; None for a flight of one's own. `LinkError`."""
    if not options.fleet:
        if given_network(options):
            raise LinkError(
                "--listen, --peer, --router and --fleet-key go with --fleet (and with "
                "`uavmap onboard`)"
            )
        return None
    network = network_of(options)
    if network.alone:
        raise LinkError(
            "--fleet: where is it heard? Give --listen, --peer or --router, as on the aircraft"
        )
    check_network(network)
    return network


def _fly_fleet(options: argparse.Namespace, plan: FlightPlan, mission: Mission) -> int:
    """Fly a simulated fleet whose members each have a service of their own."""
    if not options.sim:
        raise LinkError(
            "--comms is for --sim; on real aircraft each computer runs `uavmap onboard`"
        )
    terminal, folder = Terminal(), results_folder(options.out, mission.name)
    with shown_on(terminal):
        plan = with_ground(plan)
        terminal.show(f"{mission.name} into {folder}")
        summary = fly_fleet(replace(plan, comms=options.comms), folder)
    return report(summary, folder, as_json=options.json, verbose=options.verbose)
