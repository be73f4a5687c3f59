"""Options of a member of a fleet: where the others are reached, and the fleet's key."""

from __future__ import annotations

import argparse
import os
from pathlib import Path
from typing import Final

from missions.errors import LinkError
from uavmap.record.flight_plan import FleetNetwork

KEY_VARIABLE: Final = "UAVMAP_FLEET_KEY_FILE"


def add_fleet_options(parser: argparse.ArgumentParser) -> None:
    """Add --listen, --peer, --router and --fleet-key."""
    parser.add_argument(
        "--listen",
        metavar="EP",
        action="append",
        help="where the other vehicles' services reach this one: tcp/0.0.0.0:7447, or the "
        "multicast group of all, udp/224.0.0.224:7447#iface=wlan0; may be repeated",
    )
    parser.add_argument(
        "--peer",
        metavar="EP",
        action="append",
        help="where another vehicle's service is reached: tcp/192.168.7.12:7447; may be repeated",
    )
    parser.add_argument(
        "--router",
        metavar="EP",
        action="append",
        help="speak with the others by a Zenoh router there: tcp/192.168.7.1:7447; of several the "
        "first that answers",
    )
    parser.add_argument(
        "--fleet-key",
        metavar="FILE",
        help="the fleet's key, the same for all its vehicles: only who has it is believed "
        f"(default: the file that {KEY_VARIABLE} names; `uavmap keys new FILE` makes one). --key "
        "is another: it signs MAVLink with one's own autopilot",
    )


def network_of(options: argparse.Namespace, before: FleetNetwork | None = None) -> FleetNetwork:
    """The network of the options; what is not given is as `before`. Raises `LinkError`."""
    before = before or FleetNetwork()
    given = options.listen, options.peer, options.router
    if any(part is not None for part in given):
        listen, peers, routers = (tuple(part or ()) for part in given)
    else:
        listen, peers, routers = before.listen, before.peers, before.routers
    key = options.fleet_key if options.fleet_key is not None else os.environ.get(KEY_VARIABLE)
    if options.fleet_key == "":
        raise LinkError("--fleet-key is empty; name the file of a key")
    file = str(Path(key).expanduser().absolute()) if key else before.key_file
    return FleetNetwork(listen, peers, routers, file)


def given_network(options: argparse.Namespace) -> bool:
    """Whether any of them is given."""
    return any(
        part is not None
        for part in (options.listen, options.peer, options.router, options.fleet_key)
    )
