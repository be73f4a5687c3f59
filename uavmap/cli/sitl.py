"""uavmap sitl: simulated vehicles and cameras on loopback sockets, for another process."""

from __future__ import annotations

import argparse
import asyncio
import signal
import sys
from typing import Any

from missions.errors import LinkError
from uavmap.cli.common import port_number, seed_number, speedup, vehicle_count
from uavmap.flight_plan import SIM_EPOCH_UTC_S, FlightPlan
from uavmap.mission_source import load_source
from uavmap.simulation import serve_vehicles

_EXAMPLES = """\
examples:
  uavmap sitl                                   one vehicle over the shipped runway
  uavmap sitl --mission spill --vehicles 3 --speedup 5
  uavmap fly runway --connect udpin://127.0.0.1:14550     in another terminal

A line a vehicle is printed: the URL that a client connects with. Ctrl-C ends it.
"""


def add_parser(commands: Any) -> None:
    """Add the command."""
    parser = commands.add_parser(
        "sitl",
        help="simulated vehicles on sockets, for any MAVLink client",
        description="Simulated vehicles and cameras over a mission's world, on loopback sockets.",
        epilog=_EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--mission", metavar="MISSION", default="runway", help="whose world to fly")
    parser.add_argument("--vehicles", metavar="N", type=vehicle_count, help="how many vehicles")
    parser.add_argument(
        "--seed", metavar="S", type=seed_number, default=1, help="of the simulation"
    )
    parser.add_argument("--speedup", metavar="X", type=speedup, default=1.0, help="times real time")
    parser.add_argument(
        "--port",
        metavar="P",
        type=port_number,
        default=14550,
        help="where the first client listens",
    )
    parser.add_argument(
        "--http-port", metavar="P", type=port_number, default=8150, help="of the picture server"
    )
    parser.set_defaults(run=run)


def run(options: argparse.Namespace) -> int:
    """Serve until Ctrl-C."""
    source = load_source(options.mission)
    plan = FlightPlan(
        source.source,
        source.text,
        strategy=None,
        vehicles=options.vehicles,
        seed=options.seed,
        urls=(),
        speedup=None,
        epoch_utc_s=SIM_EPOCH_UTC_S,
    )
    mission = plan.mission()

    def ready(urls: list[str]) -> None:
        for url in urls:
            print(url, flush=True)

    async def serve() -> None:
        task = asyncio.current_task()
        loop = asyncio.get_running_loop()
        for number in (signal.SIGINT, signal.SIGTERM):
            loop.add_signal_handler(number, task.cancel if task else loop.stop)
        await serve_vehicles(
            mission,
            options.seed,
            speedup=options.speedup,
            base_port=options.port,
            http_port=options.http_port,
            on_ready=ready,
        )

    try:
        asyncio.run(serve())
    except asyncio.CancelledError:
        print("uavmap: simulation ended", file=sys.stderr)
    except OSError as error:
        raise LinkError(
            f"a port of the simulator is taken ({error}); choose others with --port, --http-port"
        ) from None
    return 0
