"""uavmap new: a mission from an area that is drawn in a file, or given by its centre."""

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
from missions.mission import flyable
from missions.mission.checks import STRATEGIES
from missions.mission.sections import LATER
from missions.units import LatLon
from uavmap.journal.results_folder import folder_name
from uavmap.load.areas.drawing import Area, Drawing
from uavmap.load.areas.drones import camera_named, drone_named, table_lines
from uavmap.load.areas.formats import TITLES
from uavmap.load.areas.layout import Layout, LayoutOptions, lay_out, rectangle
from uavmap.load.areas.mission_text import (
    STRATEGY,
    WIND_M_S,
    AircraftFigures,
    FlightChoices,
    compose,
    largest_cell_m,
    with_zone_files,
)
from uavmap.load.areas.reading import read_area_file
from uavmap.load.detector_source import SIMULATOR_DETECTOR, region_lines
from uavmap.load.mission_source import mission_of_text
from uavmap.output.documents import save
from uavmap.runner.preflight.plan_figures import estimate, zone_lines
from uavmap.ui.cli import complain
from uavmap.ui.cli.commands.check import box_line, check_kind, search_line, write_map, zone_name
from uavmap.ui.cli.common import ask, epsg_code, is_interactive, number_type, pair, vehicle_count
from uavmap.ui.cli.detector_choice import (
    add_detector_options,
    choose_detector,
    detector_table,
    train_detector,
)

EXAMPLES: Final = """\
  uavmap new field.kml --drone x500 --out field.toml      a polygon of Google Earth
  uavmap new field.kml --drone sim                        for the bundled simulator: field.toml
  uavmap new parcels.gpkg --area "North field" --drone astro
  uavmap new survey.plan --drone solo --camera rpi-hq-6mm survey, fence and home of QGroundControl
  uavmap new --at 37.198,-80.578 --size 200x150 --drone x500 --out field.toml
  uavmap new field.kml --battery 90 --hover 320 --hfov 66 --pixels 4608x2592
  uavmap new field.kml --drone x500 --detector paved      find bare ground
  uavmap new field.kml --drone x500 --like a.jpg b.jpg c.jpg   find what you paint in these
  uavmap new --drone list                                 the known drones and cameras

then:
  uavmap fly field.toml --sim                             fly it in the simulator
  uavmap check field.toml --map field.html                show the plan as a page
"""
NOTES: Final = """\
A polygon with "fence" in its name is the geofence. One with "no-fly" or "keep-out" in its name is a
hole of the fence. A point named "home", "start" or "take-off" is the home. At a terminal the
command asks for all that is missing.
"""
DESCRIPTION: Final = f"Make a mission file from an area. Files: {TITLES}."


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments."""
    # else argparse reads the place in `--at -33.8,151.2` as an option
    parser._negative_number_matcher = re.compile(r"^-\.?\d[\d.,eE+-]*$")
    add = parser.add_argument
    add("source", metavar="AREA", nargs="?", help="a file with the area")
    add("--at", metavar="LAT,LON", help="the centre of a rectangle, instead of AREA")
    add("--size", metavar="WxH", help="the rectangle, east by north, m (default 100x100)")
    add("--out", metavar="FILE.toml", type=Path, help="the mission file (default: as AREA)")
    add(
        "--preview",
        metavar="FILE",
        type=Path,
        help="the picture of the plan, .png or .html (default: a .png beside the mission file)",
    )
    add(
        "--zones",
        metavar="FILE",
        nargs="+",
        default=[],
        help="files of airspace zones, which become holes of the fence: ED-269, ED-318 or GeoJSON",
    )
    _add_area_options(parser)
    add_detector_options(parser)
    add_drone_options(parser)


def _add_area_options(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument_group("the area").add_argument
    add("--area", metavar="NAME", help="the name of the area, if the file has several")
    add("--together", action="store_true", help="search all areas: one box around them")
    add("--home", metavar="LAT,LON", help="the home of the first vehicle (default: as drawn)")
    add(
        "--fence-room",
        metavar="M",
        type=number_type(float, 5, 1000),
        default=20.0,
        help="the distance from the area to the fence if none is drawn, m (default 20)",
    )
    add("--swap", action="store_true", help="exchange latitude and longitude of the file")
    add(
        "--crs",
        metavar="EPSG",
        type=epsg_code,
        help="the coordinate system of a file that names none, such as 25832",
    )
    add("--name", help="the name of the mission (default: as the file of --out)")


def run(options: argparse.Namespace) -> int:
    """Make a mission."""
    if LIST in (options.drone, options.camera):
        for line in table_lines():
            print(line)
        return 0
    if options.find == "all" and options.strategy != STRATEGY:
        raise AreaError(
            f"--find all is for --strategy {STRATEGY}, not {options.strategy}, which maps only "
            "the first patch that it sees; leave --find out"
        )
    _ask_for_source(options)
    out = options.out or Path(f"{folder_name(Path(options.source or 'area').stem)}.toml")
    preview = options.preview or out.with_suffix(".png")
    _check_files(out, preview)
    drawing = _drawing(options)
    figures = figures_of(options)
    flying = FlightChoices(
        options.vehicles, options.strategy, options.wind, options.height, options.ceiling,
        options.find or "all",
    )  # fmt: skip
    layout = lay_out(drawing, _layout_options(options, drawing, largest_cell_m(figures, flying)))
    name = options.name or folder_name(out.stem)
    detector = choose_detector(options)

    def composed() -> tuple[str, Setting]:
        table = detector_table(detector, out.parent)
        text = compose(name, Path(drawing.source).name, layout, figures, flying, table)
        mission = mission_of_text(text, str(out), zones=options.zones)
        named = [os.path.relpath(file, out.parent) for file in options.zones]
        return with_zone_files(text, named) if named else text, setting_of(mission)

    try:
        text, setting = composed()
    except MissionFileError as error:
        raise AreaError(
            f"the mission could not be flown, so no file is written:\n{error}"
        ) from None
    if options.like is not None:  # training takes a while, so all else is checked before
        detector = train_detector(options.like, out)
        text, setting = composed()
    save(out, text.encode())
    write_map(setting, estimate(setting), preview)
    _print(layout, setting, figures, out, preview)
    return 0


def _print(
    layout: Layout, setting: Setting, aircraft: AircraftFigures, out: Path, preview: Path
) -> None:
    zones = zone_lines(setting.mission)
    for notice in (*layout.notices, *zones, *flyable.warnings(setting.mission, setting.grid)):
        complain(notice)
    home = setting.mission.home
    north, east = "NS"[home.lat_deg < 0.0], "EW"[home.lon_deg < 0.0]
    print(f"{out}: {layout.name}, {box_line(setting)}, cells of {layout.cell_m:g} m")
    print(
        f"  home {abs(home.lat_deg):.5f} {north} {abs(home.lon_deg):.5f} {east}, UTM zone "
        f"{zone_name(setting.grid)}; check the place"
    )
    place = f"mlat={home.lat_deg:.5f}&mlon={home.lon_deg:.5f}"
    print(f"  on an online map: https://www.openstreetmap.org/?{place}#map=17")
    print(f"  aircraft: {aircraft.title}")
    for line in region_lines(setting.mission.detector, out.parent):
        print(f"  {line}")
    print(f"  {search_line(estimate(setting))}")
    print(f"  picture of the plan: {preview}")
    print(f"  next: {_next(setting.mission.detector.name, shlex.quote(str(out)))}")


def _next(detector: str, out: str) -> str:
    """Write the next commands: the simulator paints its ground for one detector."""
    if detector == LATER:
        return (
            f"uavmap fly {out} --sim; before a real flight choose a detector "
            "(docs/how-to/detectors.md) and set detector.name"
        )
    simulators = "" if detector == SIMULATOR_DETECTOR else f" --detector {SIMULATOR_DETECTOR}"
    return f"uavmap check {out}; uavmap fly {out} --sim{simulators}"


def _check_files(out: Path, preview: Path) -> None:
    """Raise `OutputError` for a file that cannot be written or already exists."""
    if out.suffix.lower() != ".toml":
        raise OutputError(f"--out {out}: must end with .toml")
    check_kind(preview, "--preview")
    for option, path in (("--out", out), ("--preview", preview)):
        if path.exists():
            raise OutputError(f"{option} {path}: already exists; choose another name")
        if not path.parent.is_dir():
            raise OutputError(f"{option} {path}: there is no folder {path.parent}; make it first")


# --- questions at the terminal ----------------------------------------------------------------
def _ask_for_source(options: argparse.Namespace) -> None:
    if options.source is not None and options.at is not None:
        raise AreaError(f"--at {options.at}: excludes the file {options.source}; give one of them")
    if options.size is not None and options.at is None:
        raise AreaError(f"--size {options.size}: needs --at LAT,LON; add it")
    if options.source is not None or options.at is not None:
        return
    if not is_interactive():
        raise AreaError("no area; give a file, or --at LAT,LON --size WxH")
    answer = ask("area (a file, or LAT,LON of its centre):")
    if Path(answer).exists() or not re.fullmatch(r"[-+\d.]+ *, *[-+\d.]+", answer):
        options.source = answer
        return
    options.at = answer
    options.size = options.size or ask("its size in metres, east by north, such as 200x150:")


def _drawing(options: argparse.Namespace) -> Drawing:
    if options.source is not None:
        return read_area_file(options.source, epsg=options.crs, swap=options.swap)
    middle = _place("--at", options.at)
    wide_m, high_m = two_numbers("--size", options.size or "100x100")
    area = Area("area", rectangle(middle, wide_m, high_m))
    return Drawing(f"--at {options.at}", (area,))


def _place(option: str, text: str) -> LatLon:
    lat_deg, lon_deg = pair(f"{option} {text}", text, "LAT,LON")
    if not -90.0 <= lat_deg <= 90.0 or not -180.0 <= lon_deg <= 180.0:
        raise AreaError(
            f"{option} {text}: latitude is from -90 to 90, longitude from -180 to 180; exchange "
            "them if they are swapped"
        )
    return LatLon(lat_deg, lon_deg)


def _layout_options(
    options: argparse.Namespace, drawing: Drawing, largest_m: float
) -> LayoutOptions:
    name = options.area
    if name is None and len(drawing.areas) > 1 and not options.together and is_interactive():
        for number, area in enumerate(drawing.areas[:50], 1):
            sys.stderr.write(f"  {number}  {area.name}\n")
        answer = ask("area (number or name):")
        known = {str(i): area.name for i, area in enumerate(drawing.areas, 1)}
        name = known.get(answer, answer)
    return LayoutOptions(
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
    add("--drone", metavar="NAME", help="a drone of the table that `--drone list` shows")
    add("--camera", metavar="NAME", help="a camera of that table (default: the drone's camera)")
    add("--battery", metavar="WH", type=watts, help="the energy of a full battery, Wh")
    add("--hover", metavar="W", type=watts, help="the power in hover, W")
    add(
        "--airspeed",
        metavar="M/S",
        type=number_type(float, 1, 60),
        help="the maximum airspeed of the drone, m/s",
    )
    add(
        "--speed",
        metavar="M/S",
        type=number_type(float, 0.5, 30),
        help="the speed of the mission, m/s",
    )
    add(
        "--hfov",
        metavar="DEG",
        type=number_type(float, 2, 169),
        help="the horizontal field of view of the camera, degrees",
    )
    add("--pixels", metavar="WxH", help="the width and height of a picture, px")
    add(
        "--interval",
        metavar="S",
        type=number_type(float, 0.01, 60),
        help="the time between two pictures, s",
    )
    add("--mounting", choices=("fixed", "gimbal"), help="the mounting of the camera")
    add("--vehicles", metavar="N", type=vehicle_count, default=1, help="their number (default 1)")
    add(
        "--find",
        choices=("first", "all"),
        help="map the patch that is seen first, or all patches in the area (default; swath only)",
    )
    add(
        "--strategy",
        choices=STRATEGIES,
        default=STRATEGY,
        help=f"the strategy: {', '.join(STRATEGIES)} (default {STRATEGY})",
        metavar="NAME",
    )
    add(
        "--wind",
        metavar="M/S",
        type=number_type(float, 0, 40),
        default=WIND_M_S,
        help=f"the strongest wind of the day, m/s (default {WIND_M_S:g})",
    )
    add(
        "--cell",
        metavar="M",
        type=number_type(float, 0.1, 500),
        help="the side of a cell of the map, m (default: at least 4)",
    )
    add(
        "--height",
        metavar="M",
        type=metres,
        help="the height above home, m (default: as high as the camera's pixels allow)",
    )
    add("--ceiling", metavar="M", type=metres, help="the maximum height, m (default 120)")


def two_numbers(option: str, text: str) -> tuple[float, float]:
    """Read two numbers with an x between them. Raises `UavmapError`.

    >>> two_numbers("--size", "200x150")
    (200.0, 150.0)
    """
    return pair(f"{option} {text}", text.lower().replace("x", ","), "WxH, such as 200x150")


def figures_of(options: argparse.Namespace) -> AircraftFigures:
    """Return the aircraft's figures from table and options. Raises `AreaError` if some miss."""
    _ask_for_drone(options)
    drone = None if options.drone is None else drone_named(options.drone)
    named = options.camera or (None if drone is None else drone.camera)
    camera = None if named is None else camera_named(named)
    title = (
        "; ".join(part.title for part in (drone, camera) if part is not None)
        or "figures from the command line"
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
        title += "; some figures from the command line"
    speed_m_s = given.get("speed_m_s", drone.speed_m_s if drone else 5.0)
    values = {"max_airspeed_m_s": max(12.0, speed_m_s), "interval_s": 1.0, "mounting": "fixed"}
    for part in (drone, camera):
        values |= {} if part is None else asdict(part)
    values |= {"speed_m_s": speed_m_s, **given, "title": title}
    return AircraftFigures(**{field.name: values[field.name] for field in fields(AircraftFigures)})


def _ask_for_drone(options: argparse.Namespace) -> None:
    if options.drone is not None:
        return
    needed = {"--battery WH": options.battery, "--hover W": options.hover}
    if options.camera is None:
        needed |= {"--hfov DEG": options.hfov, "--pixels WxH": options.pixels}
    missing = [option for option, value in needed.items() if value is None]
    if not missing:
        return
    if is_interactive():
        sys.stderr.writelines(f"{line}\n" for line in table_lines())
        options.drone = ask("drone:")
        return
    raise AreaError(
        f"no drone; give --drone NAME (`uavmap new --drone {LIST}` lists them; sim is the "
        f"simulator's), or {', '.join(missing)}"
    )
