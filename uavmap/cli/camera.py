"""uavmap camera: a device of a companion computer as a MAVLink camera."""

from __future__ import annotations

import argparse
import asyncio
import re
import signal
from typing import Any

from missions.errors import LinkError
from uavmap.cameras.mount import Mount
from uavmap.cameras.opening import Settings
from uavmap.cameras.serving import CameraPlan, serve_camera
from uavmap.cameras.spec import parse_camera
from uavmap.cli.common import number_type
from uavmap.cli.endings import complain
from uavmap.link.urls import parse_url

_EXAMPLES = """\
examples:
  uavmap camera --connect serial:///dev/serial0:921600 --source libcamera --serve 10.41.1.2:8120
  uavmap camera --connect udpin://127.0.0.1:14551 --source v4l2:/dev/video0
  uavmap camera --connect udpin://127.0.0.1:14551 --source folder:/mnt/card --latency 0.4

It is a camera component of the aircraft (100) for uavmap and for ground stations: they start and
stop it, and fetch its pictures from --serve. Ctrl-C ends it.

exit codes:
  0    ended by Ctrl-C or SIGTERM
  2    the link, the source or the address cannot be opened; a line says what
"""


def add_parser(commands: Any) -> None:
    """Add the command."""
    parser = commands.add_parser(
        "camera",
        description="On a companion computer: make a camera, a stream or a folder a MAVLink camera "
        "of the aircraft, with the pose of each exposure from the autopilot's telemetry.",
        epilog=_EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--connect", metavar="URL", required=True, help="the link to the autopilot")
    parser.add_argument(
        "--source",
        metavar="SPEC",
        required=True,
        help="v4l2:/dev/video0, libcamera, rtsp://..., http://..., gstreamer:PIPELINE, folder:PATH",
    )
    parser.add_argument(
        "--serve",
        metavar="HOST:PORT",
        default="127.0.0.1:8120",
        help="where pictures are served: an address of this computer by which others reach it "
        "(default: 127.0.0.1:8120, for uavmap on this computer)",
    )
    parser.add_argument(
        "--size", metavar="WxH", default="640x480", help="of a picture, pixels (default 640x480)"
    )
    parser.add_argument(
        "--hfov",
        metavar="DEG",
        type=number_type(float, 1.0, 170.0),
        default=80.0,
        help="angle of view across a picture (default 80)",
    )
    parser.add_argument(
        "--mounting",
        choices=("fixed", "gimbal"),
        default="fixed",
        help="bolted to the airframe, or held straight down (default fixed)",
    )
    for name, most, what in (
        ("yaw", 360.0, "bearing of the picture's upper edge relative to the nose"),
        ("pitch", 45.0, "how far forward of straight down it looks"),
        ("roll", 45.0, "how far to the left of straight down it looks"),
    ):
        parser.add_argument(
            f"--{name}",
            metavar="DEG",
            type=number_type(float, -most, most),
            default=0.0,
            help=f"{what} (default 0)",
        )
    parser.add_argument(
        "--latency",
        metavar="S",
        type=number_type(float, -1.0, 10.0),
        default=0.0,
        help="seconds from an exposure until its picture is here (default 0)",
    )
    parser.add_argument(
        "--component",
        metavar="ID",
        type=number_type(int, 100, 105),
        default=100,
        help="MAVLink component id, 100 to 105 (default 100)",
    )
    parser.set_defaults(run=run)


def run(options: argparse.Namespace) -> int:
    """Be a camera until interrupted."""
    mount = Mount(options.mounting == "fixed", options.yaw, options.pitch, options.roll)
    host, port = _address(options.serve)
    plan = CameraPlan(
        endpoint=parse_url(options.connect),
        spec=parse_camera(options.source),
        host=host,
        port=port,
        settings=Settings(_size_px(options.size), 1.0, options.latency, mount),
        hfov_deg=options.hfov,
        component=options.component,
    )

    async def serve() -> None:
        loop, task = asyncio.get_running_loop(), asyncio.current_task()
        for number in (signal.SIGINT, signal.SIGTERM):
            loop.add_signal_handler(number, task.cancel if task else loop.stop)
        await serve_camera(plan, complain)

    try:
        asyncio.run(serve())
    except asyncio.CancelledError:
        complain("camera ended")
    return 0


def _address(text: str) -> tuple[str, int]:
    """Host and port. Raises `LinkError`."""
    host, _, port = text.rpartition(":")
    host = host.strip("[]")
    if not host or not port.isdecimal() or not 0 <= int(port) < 65536:
        raise LinkError(f"--serve {text} is not HOST:PORT, such as 10.41.1.2:8120")
    if host in ("0.0.0.0", "::"):
        raise LinkError(
            f"--serve {text}: pictures cannot be fetched from {host}; name the address of this "
            "computer by which the others reach it"
        )
    return host, int(port)


def _size_px(text: str) -> tuple[int, int]:
    """Width and height. Raises `LinkError`."""
    match = re.fullmatch(r"(\d{2,5})x(\d{2,5})", text)
    if match is None:
        raise LinkError(f"--size {text} is not WIDTHxHEIGHT in pixels, such as 1280x960")
    return int(match[1]), int(match[2])
