"""uavmap onboard: fly one vehicle of a fleet from its own computer."""

from __future__ import annotations

import argparse
from functools import partial
from typing import Final

from uavmap.fleet.fleet_radio import check_network
from uavmap.runner.flight import planned
from uavmap.ui.cli.common import EXIT_CODES
from uavmap.ui.cli.flight_options import begin, flight_options, network_of, preflight_of
from uavmap.ui.cli.option_table import add_options

EXAMPLES: Final = """\
  uavmap onboard bay.toml --vehicle 2 --connect serial:///dev/ttyAMA0:921600 --camera libcamera \\
         --listen 'udp/224.0.0.224:7447#iface=wlan0' --fleet-key ~/.uavmap.fleet --yes
  uavmap onboard bay.toml --vehicle 1 --connect serial:///dev/ttyAMA0:921600 \\
         --listen tcp/0.0.0.0:7447 --fleet-key ~/.uavmap.fleet
  uavmap onboard bay.toml --vehicle 2 --connect serial:///dev/ttyAMA0:921600 \\
         --peer tcp/192.168.7.11:7447 --fleet-key ~/.uavmap.fleet
  uavmap onboard bay.toml --vehicle 3 --connect serial:///dev/ttyAMA0:921600 \\
         --router tcp/192.168.7.1:7447 --fleet-key ~/.uavmap.fleet
"""
NOTES: Final = f"""\
Each aircraft of a fleet has a computer that runs this command, with the same mission file and the
same fleet key. The services exchange their observations and orders, and each commands only its own
aircraft. A vehicle out of contact continues alone. After the flight `uavmap merge` makes one map
from all journals. Without --listen, --peer and --router the vehicle flies alone.

Ctrl-C returns this aircraft; `uavmap resume DIR` continues later.

{EXIT_CODES}"""
DESCRIPTION: Final = (
    "Fly one vehicle of a fleet in which each vehicle has its own service on board."
)


add_arguments: Final = partial(add_options, command="onboard")


def run(options: argparse.Namespace) -> int:
    """Fly this vehicle."""
    network = network_of(options)
    asked = flight_options(options, onboard=True, network=network)
    check_network(network)
    return begin(options, planned(asked), preflight_of(options))
