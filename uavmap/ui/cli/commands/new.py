"""uavmap new: a mission from an area that was drawn elsewhere."""

from __future__ import annotations

import argparse
import os
import re
import shlex
import sys
from dataclasses import asdict, fields
from pathlib import Path
from typing import Final

from missions.errors import AreaError, MissionFileError, OutputError
from missions.flight.setting_of import setting_of
from missions.flight.state import Setting
from missions.geo.grid import Grid
from missions.mission import flyable
from missions.mission.checks import STRATEGIES
from missions.mission.sections import LATER
from missions.units import GridPoint, LatLon
from uavmap.journal.results_folder import folder_name
from uavmap.load.areas.drawing import Area, Drawing
from uavmap.load.areas.drones import camera_named, drone_named, table_lines
from uavmap.load.areas.layout import Layout, Wishes, lay_out
from uavmap.load.areas.mission_text import (
    STRATEGY,
    WIND_M_S,
    Figures,
    Flying,
    compose,
    largest_cell_m,
    naming_zones,
)
from uavmap.load.areas.reading import KINDS, read_area_file
from uavmap.load.detector_source import SIMULATORS, region_lines
from uavmap.load.mission_source import mission_of_text
from uavmap.output.documents import save
from uavmap.runner.preflight.plan_figures import estimate, zone_lines
from uavmap.ui.cli import complain
from uavmap.ui.cli.commands.check import box_line, check_kind, search_line, write_map, zone_name
from uavmap.ui.cli.common import answer_to, asks, epsg_code, number_type, pair, vehicle_count
from uavmap.ui.cli.detector_choice import add_detector_options, chosen, detector_table, learned

EXAMPLES: Final = """\
examples:
  uavmap new field.kml --drone x500 --out field.toml      a polygon of Google Earth
  uavmap new field.kml --drone sim                        for the bundled simulator: field.toml
  uavmap new parcels.gpkg --area "North field" --drone astro
  uavmap new survey.plan --drone solo --camera rpi-hq-6mm survey, fence and home of QGroundControl
  uavmap new --at 37.198,-80.578 --size 200x150 --drone x500 --out field.toml
  uavmap new field.kml --battery 90 --hover 320 --hfov 66 --pixels 4608x2592
  uavmap new field.kml --drone x500 --detector paved      look for bare ground
  uavmap new field.kml --drone x500 --like a.jpg b.jpg c.jpg   or for what is painted in these
  uavmap new --drone list                                 which drones and cameras are known

then:
  uavmap fly field.toml --sim                             in the simulator
  uavmap check field.toml --map field.html                what would be flown, as a page

A polygon whose name has "fence" in it is the geofence, one with "no-fly" or "keep-out" a hole of
it, a point named "home", "start" or "take-off" the home. At a terminal what is missing is asked.
"""
DESCRIPTION: Final = f"Make a mission file from an area that was drawn elsewhere: {KINDS}."


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments."""
    # --at -33.8,151.2 is a place, not an option
    parser._negative_number_matcher = re.compile(r"^-\.?\d[\d.,eE+-]*$")
    add = parser.add_argument
    add("source", metavar="AREA", nargs="?", help="a file with the area")
    add("--at", metavar="LAT,LON", help="instead of AREA: the middle of a rectangle")
    add("--size", metavar="WxH", help="of it, in metres, east by north (default 100x100)")
    add("--out", metavar="FILE.toml", type=Path, help="the mission (default: named after AREA)")
    add(
        "--preview",
        metavar="FILE",
        type=Path,
        help="the plan as .png or .html (default: a .png beside the mission)",
    )
    add(
        "--zones",
        metavar="FILE",
        nargs="+",
        default=[],
        help="zones that are left out of the fence: ED-269, ED-318 or GeoJSON",
    )
    _add_area_options(parser)
    add_detector_options(parser)
    add_drone_options(parser)


def _add_area_options(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument_group("the area").add_argument
    add("--area", metavar="NAME", help="which, where the file has several")
    add("--together", action="store_true", help="all of them: what encloses them")
    add("--home", metavar="LAT,LON", help="where the first vehicle stands (default: as drawn)")
    add(
        "--fence-room",
        metavar="M",
        type=number_type(float, 5, 1000),
        default=20.0,
        help="from the area to the fence, where none is drawn (default 20)",
    )
    add("--swap", action="store_true", help="the file has latitude and longitude exchanged")
    add("--crs", metavar="EPSG", type=epsg_code, help="of a file that names no system, as 25832")
    add("--name", help="of the mission (default: as the file of --out)")


def run(options: argparse.Namespace) -> int:
    """Make a mission."""
    if LIST in (options.drone, options.camera):
        for line in table_lines():
            print(line)
        return 0
    if options.find == "all" and options.strategy != STRATEGY:
        raise AreaError(
            f"--find all is for --strategy {STRATEGY}, not {options.strategy}, which maps the "
            "piece that is seen first; leave --find out"
        )
    _ask_for_source(options)
    out = options.out or Path(f"{folder_name(Path(options.source or 'area').stem)}.toml")
    preview = options.preview or out.with_suffix(".png")
    _check_files(out, preview)
    drawing = _drawing(options)
    figures = figures_of(options)
    flying = Flying(
        options.vehicles, options.strategy, options.wind, options.height, options.ceiling,
        options.find or "all",
    )  # fmt: skip
    layout = lay_out(drawing, _wishes(options, drawing, largest_cell_m(figures, flying)))
    name = options.name or folder_name(out.stem)
    origin = Path(drawing.source).name
    detector = chosen(options)

    def composed() -> tuple[str, Setting]:
        table = detector_table(detector, out.parent)
        text = compose(name, origin, layout, figures, flying, table)
        mission = mission_of_text(text, str(out), zones=options.zones)
        named = [os.path.relpath(file, out.parent) for file in options.zones]
        return naming_zones(text, named) if named else text, setting_of(mission)

    try:
        text, setting = composed()
    except MissionFileError as error:
        raise AreaError(
            f"such a mission could not be flown, nothing is written:\n{error}"
        ) from None
    if options.like is not None:  # which takes a while, so all else is checked before
        detector = learned(options.like, out)
        text, setting = composed()
    save(out, text.encode())
    write_map(setting, estimate(setting), preview)
    _print(layout, setting, figures, out, preview)
    return 0


def _print(layout: Layout, setting: Setting, aircraft: Figures, out: Path, preview: Path) -> None:
    zones = zone_lines(setting.mission)
    for notice in (*layout.notices, *zones, *flyable.warnings(setting.mission, setting.grid)):
        complain(notice)
    home = setting.mission.home
    north, east = "NS"[home.lat_deg < 0.0], "EW"[home.lon_deg < 0.0]
    print(f"{out}: {layout.name}, {box_line(setting)}, cells of {layout.cell_m:g} m")
    print(
        f"  home {abs(home.lat_deg):.5f} {north} {abs(home.lon_deg):.5f} {east}, UTM zone "
        f"{zone_name(setting.grid)}; is that the place?"
    )
    place = f"mlat={home.lat_deg:.5f}&mlon={home.lon_deg:.5f}"
    print(f"  with internet, on a map: https://www.openstreetmap.org/?{place}#map=17")
    print(f"  aircraft: {aircraft.title}")
    for line in region_lines(setting.mission.detector, out.parent):
        print(f"  {line}")
    print(f"  {search_line(estimate(setting))}")
    print(f"  the plan is drawn in {preview}")
    print(f"  next: {_next(setting.mission.detector.name, shlex.quote(str(out)))}")


def _next(detector: str, out: str) -> str:
    """Write the next commands: the simulator's ground is painted for one detector."""
    if detector == LATER:
        return (
            f"uavmap fly {out} --sim; before a real flight choose a detector "
            "(docs/how-to/detectors.md) and set detector.name"
        )
    simulators = "" if detector == SIMULATORS else f" --detector {SIMULATORS}"
    return f"uavmap check {out}; uavmap fly {out} --sim{simulators}"


def _check_files(out: Path, preview: Path) -> None:
    """Raise `OutputError` for a file that cannot be written or is there already."""
    if out.suffix.lower() != ".toml":
        raise OutputError(f"--out {out}: a mission is a .toml")
    check_kind(preview, "--preview")
    for option, path in (("--out", out), ("--preview", preview)):
        if path.exists():
            raise OutputError(f"{option} {path}: is there already; choose another name")
        if not path.parent.is_dir():
            raise OutputError(f"{option} {path}: there is no folder {path.parent}")


# --- what is asked for ------------------------------------------------------------------------
def _ask_for_source(options: argparse.Namespace) -> None:
    if options.source is not None and options.at is not None:
        raise AreaError(f"--at {options.at}: beside the file {options.source}; give one of them")
    if options.size is not None and options.at is None:
        raise AreaError(f"--size {options.size}: goes with --at LAT,LON")
    if options.source is not None or options.at is not None:
        return
    if not asks():
        raise AreaError("no area; give a file, or --at LAT,LON --size WxH")
    answer = answer_to("area (a file, or LAT,LON of its middle):")
    if Path(answer).exists() or not re.fullmatch(r"[-+\d.]+ *, *[-+\d.]+", answer):
        options.source = answer
        return
    options.at = answer
    options.size = options.size or answer_to("its size in metres, east by north, as 200x150:")


def _drawing(options: argparse.Namespace) -> Drawing:
    if options.source is not None:
        return read_area_file(options.source, epsg=options.crs, swap=options.swap)
    middle = _place("--at", options.at)
    wide_m, high_m = two_numbers("--size", options.size or "100x100")
    if not (4.0 <= wide_m <= 10_000.0 and 4.0 <= high_m <= 10_000.0):
        raise AreaError(f"--size {options.size}: give each side from 4 to 10000 metres")
    grid = Grid.at(middle, 1.0)
    corners = [
        grid.position(GridPoint(e * wide_m / 2.0, n * high_m / 2.0))
        for e, n in ((-1, -1), (1, -1), (1, 1), (-1, 1))
    ]
    return Drawing(f"--at {options.at}", (Area("area", tuple(corners)),))


def _place(option: str, text: str) -> LatLon:
    lat_deg, lon_deg = pair(f"{option} {text}", text, "LAT,LON")
    if not -90.0 <= lat_deg <= 90.0 or not -180.0 <= lon_deg <= 180.0:
        raise AreaError(
            f"{option} {text}: latitude is from -90 to 90, longitude from -180 to 180; are they "
            "swapped?"
        )
    return LatLon(lat_deg, lon_deg)


def _wishes(options: argparse.Namespace, drawing: Drawing, largest_m: float) -> Wishes:
    name = options.area
    if name is None and len(drawing.areas) > 1 and not options.together and asks():
        for number, area in enumerate(drawing.areas[:50], 1):
            sys.stderr.write(f"  {number}  {area.name}\n")
        answer = answer_to("which area (its number or name):")
        known = {str(i): area.name for i, area in enumerate(drawing.areas, 1)}
        name = known.get(answer, answer)
    return Wishes(
        None if options.home is None else _place("--home", options.home),
        name,
        options.together,
        options.fence_room,
        options.cell,
        largest_m,
        options.vehicles,
    )


# --- the aircraft of a new mission ------------------------------------------------------------
LIST: Final = "list"


def add_drone_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of the aircraft."""
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
    add(
        "--find",
        choices=("first", "all"),
        help="map the piece that is seen first, or all in the area (default; swath only)",
    )
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


def two_numbers(option: str, text: str) -> tuple[float, float]:
    """Read two numbers with an x between them. Raises `UavmapError`.

    >>> two_numbers("--size", "200x150")
    (200.0, 150.0)
    """
    return pair(f"{option} {text}", text.lower().replace("x", ","), "WxH, as 200x150")


def figures_of(options: argparse.Namespace) -> Figures:
    """Return the aircraft's figures by table and options. Raises `AreaError` where some miss."""
    _ask_for_drone(options)
    drone = None if options.drone is None else drone_named(options.drone)
    named = options.camera or (None if drone is None else drone.camera)
    camera = None if named is None else camera_named(named)
    title = (
        "; ".join(part.title for part in (drone, camera) if part is not None)
        or "figures given by hand"
    )
    given = {
        "capacity_wh": options.battery, "hover_power_w": options.hover,
        "max_airspeed_m_s": options.airspeed, "speed_m_s": options.speed,
        "hfov_deg": options.hfov, "interval_s": options.interval, "mounting": options.mounting,
    }  # fmt: skip
    if options.pixels is not None:
        sides = two_numbers("--pixels", options.pixels)
        given |= dict(zip(("width_px", "height_px"), map(round, sides), strict=True))
    given = {key: value for key, value in given.items() if value is not None}
    if given and drone is not None:
        title += "; some figures given by hand"
    speed_m_s = given.get("speed_m_s", drone.speed_m_s if drone else 5.0)
    values = {"max_airspeed_m_s": max(12.0, speed_m_s), "interval_s": 1.0, "mounting": "fixed"}
    for part in (drone, camera):
        values |= {} if part is None else asdict(part)
    values |= {"speed_m_s": speed_m_s, **given, "title": title}
    return Figures(**{field.name: values[field.name] for field in fields(Figures)})


def _ask_for_drone(options: argparse.Namespace) -> None:
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
