"""The aircraft of `uavmap new`: from the table of drones, from options, or asked for."""

from __future__ import annotations

import argparse
import sys
from typing import Final

from missions.errors import AreaError
from missions.mission.checks import STRATEGIES
from uavmap.load.areas.composing import STRATEGY, WIND_M_S, Figures
from uavmap.load.areas.drones import Camera, Drone, camera_named, drone_named, table_lines
from uavmap.ui.cli.common import number_type, pair, vehicle_count

LIST: Final = "list"


def add_drone_options(parser: argparse.ArgumentParser) -> None:
    """Add the options that say what flies, and how."""
    add = parser.add_argument_group("the aircraft").add_argument
    watts, metres = number_type(float, 1, 100_000), number_type(float, 1, 1000)
    add("--drone", metavar="NAME", help="from a small table; `--drone list` shows it")
    add("--camera", metavar="NAME", help="from the same table (default: the drone's)")
    add("--battery", metavar="WH", type=watts, help="energy of a full battery")
    add("--hover", metavar="W", type=watts, help="power in hover")
    add("--airspeed", metavar="M/S", type=number_type(float, 1, 60), help="that it holds")
    add("--speed", metavar="M/S", type=number_type(float, 0.5, 30), help="of the mission")
    add("--hfov", metavar="DEG", type=number_type(float, 2, 169), help="field of view, across")
    add("--pixels", metavar="WxH", help="of a picture")
    add("--interval", metavar="S", type=number_type(float, 0.01, 60), help="between pictures")
    add("--mounting", choices=("fixed", "gimbal"), help="of the camera")
    add("--vehicles", metavar="N", type=vehicle_count, default=1, help="how many (default 1)")
    add("--strategy", choices=STRATEGIES, default=STRATEGY, help=f"default {STRATEGY}", metavar="S")
    add(
        "--wind",
        metavar="M/S",
        type=number_type(float, 0, 40),
        default=WIND_M_S,
        help=f"the worst of the day (default {WIND_M_S:g})",
    )
    add("--cell", metavar="M", type=number_type(float, 0.1, 500), help="of the map (default: 4 up)")
    add("--height", metavar="M", type=metres, help="above home (default: as the pixels allow)")
    add("--ceiling", metavar="M", type=metres, help="the highest allowed (default 120)")


def asks() -> bool:
    """Whether somebody sits at a terminal."""
    return sys.stdin is not None and sys.stdin.isatty()


def answer_to(question: str) -> str:
    """A line from the terminal; standard output stays free for the result.

    Raises `AreaError` where nobody answers.
    """
    sys.stderr.write(f"{question} ")
    sys.stderr.flush()
    line = sys.stdin.readline()
    if not line.strip():
        raise AreaError("no answer")
    return line.strip()


def two_numbers(option: str, text: str) -> tuple[float, float]:
    """Two numbers with an x between them. Raises `UavmapError`.

    >>> two_numbers("--size", "200x150")
    (200.0, 150.0)
    """
    return pair(f"{option} {text}", text.lower().replace("x", ","), "WxH, as 200x150")


def figures_of(options: argparse.Namespace) -> Figures:
    """The figures of the aircraft: from the table, and over them what is given as options.

    Raises `AreaError` for a name that is not known, or where figures are missing.
    """
    _ask_for_drone(options)
    drone = None if options.drone is None else drone_named(options.drone)
    named = options.camera or (None if drone is None else drone.camera)
    camera = None if named is None else camera_named(named)
    pixels = None if options.pixels is None else two_numbers("--pixels", options.pixels)
    title = (
        "; ".join(part.title for part in (drone, camera) if part is not None)
        or "figures given by hand"
    )
    if _overridden(options) and drone is not None:
        title += "; some figures given by hand"
    speed_m_s = options.speed or (drone.speed_m_s if drone else 5.0)
    return Figures(
        title,
        _given(options.battery, drone, "capacity_wh"),
        _given(options.hover, drone, "hover_power_w"),
        options.airspeed or (drone.max_airspeed_m_s if drone else max(12.0, speed_m_s)),
        speed_m_s,
        _given(options.hfov, camera, "hfov_deg"),
        round(pixels[0]) if pixels else int(_given(None, camera, "width_px")),
        round(pixels[1]) if pixels else int(_given(None, camera, "height_px")),
        options.interval or (camera.interval_s if camera else 1.0),
        options.mounting or (camera.mounting if camera else "fixed"),
    )


def _given(option: float | None, table: Drone | Camera | None, key: str) -> float:
    if option is not None:
        return float(option)
    return float(getattr(table, key))


def _overridden(options: argparse.Namespace) -> bool:
    keys = ("battery", "hover", "airspeed", "speed", "hfov", "pixels", "interval", "mounting")
    return any(getattr(options, key) is not None for key in keys)


def _ask_for_drone(options: argparse.Namespace) -> None:
    """See that every figure is there that has no default."""
    if options.drone is not None:
        return
    needed = {"--battery WH": options.battery, "--hover W": options.hover}
    if options.camera is None:
        needed |= {"--hfov DEG": options.hfov, "--pixels WxH": options.pixels}
    missing = [option for option, value in needed.items() if value is None]
    if not missing:
        return
    if asks():
        for line in table_lines():
            sys.stderr.write(f"{line}\n")
        options.drone = answer_to("which drone:")
        return
    raise AreaError(
        f"the aircraft is not known; give --drone NAME (`uavmap new --drone {LIST}` shows which; "
        f"sim is the simulator's), or {', '.join(missing)}"
    )
