"""uavmap fly: fly a mission, in the bundled simulator or with real aircraft."""

from __future__ import annotations

import argparse
from functools import partial
from typing import Final

from missions.errors import LinkError, UavmapError
from uavmap.base.messages import shown_on
from uavmap.base.terminal import Terminal
from uavmap.fleet.fleet_radio import check_network
from uavmap.journal.flight_plan import FleetNetwork, FlightPlan
from uavmap.journal.results_folder import results_folder
from uavmap.runner.flight import planned
from uavmap.runner.ground_survey import with_ground
from uavmap.runner.simulated_fleet import fly_fleet
from uavmap.ui.cli.common import EXIT_CODES, report
from uavmap.ui.cli.flight_options import (
    begin,
    flight_options,
    gives_network,
    network_of,
    preflight_of,
)
from uavmap.ui.cli.option_table import add_options

EXAMPLES: Final = """\
  uavmap fly runway --sim                           a shipped mission, simulated
  uavmap fly spill --sim --seed 7 --out spill-7     with another seed, into your own folder
  uavmap fly field.toml --connect udpin://0.0.0.0:14550
  uavmap fly field.toml --connect serial:///dev/ttyACM0:57600
  uavmap fly field.toml --connect udpin://0.0.0.0:14540 --driver mavsdk
  uavmap fly field.toml --connect serial:///dev/ttyACM0:57600 --camera libcamera
  uavmap fly lake.toml --connect udpin://0.0.0.0:14550 --connect udpin://0.0.0.0:14560
  uavmap fly field.toml --connect udpin://0.0.0.0:14550 --detector my-field
  uavmap fly field.toml --connect udpin://0.0.0.0:14550 --dry-run     all checks, no take-off

  uavmap fly field.toml --fleet --listen 'udp/224.0.0.224:7447#iface=wlan0' \\
             --fleet-key ~/.uavmap.fleet --page            on the ground, beside `uavmap onboard`

  uavmap fly field.toml --connect udpin://0.0.0.0:14550?system=1 \\
                        --connect udpin://0.0.0.0:14550?system=2
  uavmap fly field.toml --connect serial:///dev/ttyUSB0:57600 --forward udpout://127.0.0.1:14550
  uavmap fly field.toml --connect udpin://0.0.0.0:14550 --key ~/.uavmap.key
  uavmap fly field.toml --connect udpin://0.0.0.0:14550 --page         a live page in the browser
  uavmap fly field.toml --connect udpin://0.0.0.0:14550 --tak tcp://192.168.1.5:8087
"""
NOTES: Final = f"""\
Keys in flight: p pause, c continue, r return, k skip a cell, q land, ? help.

Ctrl-C returns real aircraft. A second Ctrl-C commands the RTL of their autopilots, and the command
ends when they return. After both `uavmap resume DIR` continues later.

{EXIT_CODES}"""
DESCRIPTION: Final = "Fly a mission: search the box, explore the region, return, write the map."


add_arguments: Final = partial(add_options, command="fly")


def run(options: argparse.Namespace) -> int:
    """Fly the mission."""
    member = 0 if options.fleet else None
    asked = flight_options(options, member=member, network=_network(options))
    with shown_on(Terminal()):
        plan = planned(asked)
    if plan.comms is not None:
        return _fly_fleet(options, plan)
    no_take_off = options.sim or options.fleet
    return begin(options, plan, None if no_take_off else preflight_of(options))


def _network(options: argparse.Namespace) -> FleetNetwork | None:
    """Return the network of the fleet to join; None without one. Raises `LinkError`."""
    if not options.fleet:
        if gives_network(options):
            raise LinkError(
                "--listen, --peer, --router and --fleet-key need --fleet; each vehicle of the "
                "fleet runs `uavmap onboard`"
            )
        return None
    network = network_of(options)
    if network.alone:
        raise LinkError(
            "--fleet: no endpoint; give --listen, --peer or --router, as for the aircraft"
        )
    check_network(network)
    return network


def _fly_fleet(options: argparse.Namespace, plan: FlightPlan) -> int:
    if options.tak is not None:
        raise UavmapError(
            "--tak: excludes --comms, with which each simulated member has its own map; give one "
            "of them"
        )
    mission = plan.mission
    terminal, folder = Terminal(), results_folder(options.out, mission.name)
    with shown_on(terminal):
        plan = with_ground(plan)
        terminal.show(f"{mission.name} into {folder}")
        summary = fly_fleet(plan, folder)
    return report(summary, folder, as_json=options.json, verbose=options.verbose)
