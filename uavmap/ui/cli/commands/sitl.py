"""uavmap sitl: simulated vehicles and cameras on loopback sockets for another process."""

from __future__ import annotations

import argparse
import asyncio
import contextlib
import shlex
import signal
import sys
from collections.abc import Callable, Sequence
from typing import Any, Final

from missions.errors import LinkError, UavmapError
from missions.mission.checks import check
from missions.mission.fleet_checks import with_vehicles
from uavmap.load.mission_source import load
from uavmap.runner import simulation
from uavmap.ui.cli.common import epsg_code, pair, port_number, seed_number, speedup, vehicle_count

EXAMPLES: Final = """\
  uavmap sitl                                   one vehicle over the shipped runway
  uavmap sitl --mission spill --vehicles 3 --speedup 5
  uavmap fly runway --connect udpin://127.0.0.1:14550     in another terminal

  uavmap sitl --home 47.3977,8.5456,488,0 --vehicles 5    no mission: an empty meadow
  uavmap sitl --home 47.3977,8.5456 --wind 6,270 --tcp    as ArduPilot's own simulator
  uavmap sitl --home 47.3977,8.5456 --world oil.geojson --world field.tif
"""
NOTES: Final = """\
Standard output has a line for each vehicle: the URL for a client. Standard error has a help on how
to connect. Ctrl-C ends the simulation.
"""
_WITHOUT_MISSION = ("home", "world", "world_crs", "wind", "optical_flow")


DESCRIPTION: Final = (
    "Simulate vehicles and cameras on loopback sockets, over the world of a mission or without one."
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments."""
    add = parser.add_argument
    add(
        "--mission",
        metavar="MISSION",
        help="the mission whose world is simulated (default: runway, or none with --home)",
    )
    add("--home", metavar="LAT,LON,AMSL,YAW", help="the home, for a simulation without a mission")
    add(
        "--autopilot",
        metavar="NAME",
        help="the autopilot, ardupilot or px4 (default: the mission's, or ardupilot)",
    )
    add(
        "--vehicles",
        metavar="N",
        type=vehicle_count,
        help="the number of vehicles (default: the mission's, or 1)",
    )
    add(
        "--seed",
        metavar="S",
        type=seed_number,
        default=1,
        help="the seed of the simulation (default 1)",
    )
    add(
        "--speedup",
        metavar="X",
        type=speedup,
        default=1.0,
        help="the speed, as a multiple of real time (default 1)",
    )
    add(
        "--wind",
        metavar="SPEED,FROM",
        help="the wind: speed, m/s, and the bearing from which it blows, degrees",
    )
    add(
        "--world",
        metavar="FILE",
        action="append",
        help="the ground: regions in GeoJSON, a GeoTIFF, or a PNG or JPEG with a world file; may "
        "be repeated",
    )
    add(
        "--world-crs",
        metavar="EPSG",
        type=epsg_code,
        help="the coordinate system of a world file (default 4326)",
    )
    add(
        "--optical-flow",
        action="store_true",
        default=None,
        help="fly on by optical flow if satellites are lost (in a mission: [sim] optical_flow)",
    )
    add("--tcp", action="store_true", help="listen on TCP instead of sending UDP to the client")
    add(
        "--port",
        metavar="P",
        type=port_number,
        help="the port of the first vehicle (default: 14550, with --tcp 5760)",
    )
    add(
        "--http-port",
        metavar="P",
        type=port_number,
        default=8150,
        help="the port of the server of pictures (default 8150)",
    )


def run(options: argparse.Namespace) -> int:
    """Serve until Ctrl-C."""
    without = [name for name in _WITHOUT_MISSION if getattr(options, name) is not None]
    if without and options.mission is not None:
        name = without[0].replace("_", "-")
        raise UavmapError(f"--{name}: excludes --mission; give one of them")
    if without and options.home is None:
        name = without[0].replace("_", "-")
        raise UavmapError(f"--{name}: needs --home LAT,LON,AMSL,YAW; add it")
    made = _by_home(options) if options.home is not None else _by_mission(options)

    async def serve() -> None:
        task = asyncio.current_task()
        loop = asyncio.get_running_loop()
        for number in (signal.SIGINT, signal.SIGTERM):
            loop.add_signal_handler(number, task.cancel if task else loop.stop)
        await simulation.serve_vehicles(
            made(),
            speedup=options.speedup,
            transport="tcp" if options.tcp else "udp",
            base_port=options.port,
            http_port=options.http_port,
            on_ready=lambda urls: _print(options, urls),
        )

    try:
        asyncio.run(serve())
    except asyncio.CancelledError:
        print("uavmap: simulation ended", file=sys.stderr)
    except OSError as error:
        raise LinkError(
            f"a port of the simulator is in use ({error}); choose others with --port and "
            "--http-port"
        ) from None
    return 0


def _by_mission(options: argparse.Namespace) -> Callable[[], Sequence[Any]]:
    if options.autopilot is not None:  # this refuses an unknown name
        simulation.setup_without_mission(autopilot=options.autopilot)
    name = options.mission or "runway"
    mission = load(name)
    if options.vehicles not in (None, len(mission.vehicles)):
        mission = with_vehicles(mission, options.vehicles)
        check(mission, name, detectors=(mission.detector.name,))
    at = simulation.pictures_at(options.http_port)
    return lambda: simulation.make_vehicles(
        mission, options.seed, autopilot=options.autopilot, image_url_prefix=at
    )


def _by_home(options: argparse.Namespace) -> Callable[[], Sequence[Any]]:
    speed_m_s, from_deg = 0.0, 0.0
    if options.wind is not None:
        expected = "SPEED,FROM in m/s and degrees, such as 6,270"
        speed_m_s, from_deg = pair(f"--wind {options.wind}", options.wind, expected)
    setup = simulation.setup_without_mission(
        autopilot=options.autopilot or "ardupilot",
        vehicles=options.vehicles or 1,
        home=options.home,
        speedup=options.speedup,
        seed=options.seed,
        tcp=options.tcp,
        wind_speed_m_s=speed_m_s,
        wind_from_deg=from_deg,
        world=tuple(options.world or ()),
        world_epsg=options.world_crs,
        optical_flow=bool(options.optical_flow),
    )
    return lambda: setup.build(simulation.pictures_at(options.http_port))


def _print(options: argparse.Namespace, urls: list[str]) -> None:
    """Print the URLs to standard output, for programs, and the help to standard error."""
    for url in urls:
        print(url, flush=True)
    with contextlib.suppress(OSError):  # vehicles fly also without a reader
        print(how_to_connect(options, urls), file=sys.stderr, flush=True)


def how_to_connect(options: argparse.Namespace, urls: Sequence[str]) -> str:
    """Write what was started, and how to connect and to end it."""
    scheme, _, address = urls[0].partition("://")
    host, _, port = address.rpartition(":")
    if scheme.startswith("tcp"):
        place, master = f"listening on TCP port {port}", f"tcp:{address}"
        station = f"Application Settings, Comm Links: TCP, {host}, port {port}"
    else:
        place, master = f"sending MAVLink to UDP port {port}", f"udpin:{address}"
        station = "connects by itself" if port == "14550" else f"Comm Links: UDP, port {port}"
    what = "1 simulated aircraft" if len(urls) == 1 else f"{len(urls)} simulated aircraft"
    others = " and those of the other URLs" if len(urls) > 1 else ""
    mission = options.mission or ("FILE" if options.home is not None else "runway")
    fly = ["uavmap fly", shlex.quote(mission), *(f"--connect {url}" for url in urls)]
    if options.speedup != 1.0:
        fly.append(f"--speedup {options.speedup:g}")
    lines = (
        f"{what}, {place}{others}",
        f"  fly a mission   {' '.join(fly)}",
        f"  QGroundControl  {station}",
        f"  MAVProxy        mavproxy.py --master={master}",
        "  a port serves one program; for another, fly with --forward udpout://127.0.0.1:PORT",
        "Ctrl-C ends the simulation",
    )
    return "\n".join(lines)
